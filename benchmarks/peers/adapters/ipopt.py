"""IPOPT by CasADi, from several starts: points, and no bounds."""

import math
import random
import time

import casadi
from common import INF, answer, degree, run, value

_STARTS = 10


def solve(task, number):
    begin = time.process_time()
    x = casadi.SX.sym("x", task["n"])
    letters = [x[v] for v in range(task["n"])]
    rows = [row for row in task["rows"] if degree(row["terms"])]
    bodies = [value(row["terms"], letters) for row in rows]
    problem = {
        "x": x,
        "f": value(task["objectives"][number], letters),
        "g": casadi.vertcat(*bodies),
    }
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_cpu_time": task["seconds"]},
    }
    solver = casadi.nlpsol("solver", "ipopt", problem, options)
    high = [0.0 if row["equal"] else INF for row in rows]
    middle = time.process_time()
    source, best, point = random.Random(0), INF, None
    for _ in range(_STARTS):
        start = [
            source.uniform(a if math.isfinite(a) else -1.0, b if math.isfinite(b) else 1.0)
            for a, b in zip(task["lower"], task["upper"], strict=True)
        ]
        found = solver(
            x0=start, lbx=task["lower"], ubx=task["upper"], lbg=[0.0] * len(rows), ubg=high
        )
        if solver.stats()["success"] and float(found["f"]) < best:
            best, point = float(found["f"]), [float(v) for v in found["x"].full().ravel()]
        if time.process_time() - middle > task["seconds"]:
            break
    return answer("local" if point else "not found", -INF, best, point, begin, middle)


run(solve)
