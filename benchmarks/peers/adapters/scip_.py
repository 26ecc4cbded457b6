"""SCIP in an interpreter of its own."""

import math
import time

from common import INF, answer, degree, run, value
from pyscipopt import Model

_BUDGET = {"timelimit", "memlimit", "nodelimit", "totalnodelimit", "stallnodelimit"}


def solve(task, number):
    begin = time.process_time()
    model = Model()
    model.hideOutput()
    settings = {
        "timing/clocktype": 1,
        "limits/time": task["seconds"],
        "limits/absgap": task["gaps"][number],
        "limits/gap": task["relative"],
    }
    for name, setting in settings.items():
        model.setParam(name, setting)
    x = [
        model.addVar(
            lb=low if math.isfinite(low) else None, ub=high if math.isfinite(high) else None
        )
        for low, high in zip(task["lower"], task["upper"], strict=True)
    ]
    for row in task["rows"]:
        if degree(row["terms"]):
            body = value(row["terms"], x)
            model.addCons(body == 0 if row["equal"] else body >= 0)
    body = value(task["objectives"][number], x)
    if degree(task["objectives"][number]) > 1:
        least = model.addVar(lb=None, ub=None)
        model.addCons(body - least <= 0)
        body = least
    model.setObjective(body)
    middle = time.process_time()
    model.optimize()
    status = model.getStatus()
    status = f"budget: {status}" if status in _BUDGET else status
    low = model.getDualbound()
    lower = low if abs(low) < 1e19 else math.copysign(INF, low)
    if not model.getNSols():
        return answer(status, lower, begin=begin, middle=middle)
    point = [model.getVal(v) for v in x]
    return answer(status, lower, model.getPrimalbound(), point, begin, middle)


run(solve)
