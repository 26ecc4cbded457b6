"""Irene: dense moment relaxations, solved by CVXOPT."""

import time

import sympy
from common import INF, answer, bounds_as_rows, run, value
from Irene import SDPRelaxations


def solve(task, number):
    begin = time.process_time()
    x = sympy.symbols(f"x:{task['n']}")
    relaxation = SDPRelaxations(list(x))
    relaxation.SetObjective(value(task["objectives"][number], x))
    for row in task["rows"]:
        body = value(row["terms"], x)
        relaxation.AddConstraint(body >= 0)
        if row["equal"]:
            relaxation.AddConstraint(-body >= 0)
    for terms in bounds_as_rows(task):
        relaxation.AddConstraint(value(terms, x) >= 0)
    relaxation.MomentsOrd(task["order"])
    relaxation.SetSDPSolver("CVXOPT")
    relaxation.InitSDP()
    middle = time.process_time()
    relaxation.Minimize()
    solution = relaxation.Solution
    found = -INF if solution.Primal is None else solution.Primal
    return answer(solution.Status, found, begin=begin, middle=middle)


run(solve)
