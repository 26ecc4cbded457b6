"""SumOfSquares over PICOS and CVXOPT: a dense sum-of-squares bound."""

import time

import sympy
from common import answer, bounds_as_rows, run, value
from SumOfSquares import poly_opt_prob


def solve(task, number):
    begin = time.process_time()
    x = sympy.symbols(f"x:{task['n']}")
    above = [row["terms"] for row in task["rows"] if not row["equal"]] + bounds_as_rows(task)
    equal = [value(row["terms"], x) for row in task["rows"] if row["equal"]]
    objective = value(task["objectives"][number], x)
    problem = poly_opt_prob(
        list(x), objective, eqs=equal, ineqs=[value(t, x) for t in above], deg=task["order"]
    )
    middle = time.process_time()
    found = problem.solve(solver="cvxopt", timelimit=max(1, int(task["seconds"])))
    return answer(found.claimedStatus, problem.value, begin=begin, middle=middle)


run(solve)
