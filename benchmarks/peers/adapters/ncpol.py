"""ncpol2sdpa with commuting variables, solved through cvxpy."""

import time

from common import answer, bounds_as_rows, run, value
from ncpol2sdpa import SdpRelaxation, generate_variables


def solve(task, number):
    begin = time.process_time()
    x = generate_variables("x", task["n"], commutative=True)
    above = [row["terms"] for row in task["rows"] if not row["equal"]] + bounds_as_rows(task)
    equal = [value(row["terms"], x) for row in task["rows"] if row["equal"]]
    relaxation = SdpRelaxation(x)
    relaxation.get_relaxation(
        task["order"],
        objective=value(task["objectives"][number], x),
        inequalities=[value(terms, x) for terms in above],
        equalities=equal,
    )
    middle = time.process_time()
    relaxation.solve(solver="cvxpy")
    return answer(relaxation.status, relaxation.dual, begin=begin, middle=middle)


run(solve)
