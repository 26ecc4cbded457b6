"""Xpress with its global solver, under the community licence that comes with its wheel."""

import time

import xpress as xp
from common import INF, Refused, answer, degree, run, value

_WORDS = {0: "not found", 1: "optimal", 2: "feasible", 3: "infeasible", 4: "unbounded"}


def _power(terms):
    """The same terms with repeated variables as powers, which Xpress wants."""
    return [(c, sorted(letters)) for c, letters in terms]


def solve(task, number):
    begin = time.process_time()
    problem = xp.problem()
    problem.controls.outputlog = 0
    problem.controls.threads = 1
    problem.controls.timelimit = task["seconds"]
    problem.controls.miprelstop = task["relative"]
    problem.controls.mipabsstop = task["gaps"][number]
    ends = zip(task["lower"], task["upper"], strict=True)
    infinite = xp.infinity
    ends = [(max(low, -infinite), min(high, infinite)) for low, high in ends]
    x = [problem.addVariable(lb=low, ub=high) for low, high in ends]
    try:
        for row in task["rows"]:
            if degree(row["terms"]):
                body = value(_power(row["terms"]), x)
                problem.addConstraint(body == 0 if row["equal"] else body >= 0)
        objective = task["objectives"][number]
        if degree(objective) > 1:
            least = problem.addVariable(lb=-infinite, ub=infinite)
            problem.addConstraint(value(_power(objective), x) - least <= 0)
            problem.setObjective(least)
        else:
            problem.setObjective(value(objective, x))
        middle = time.process_time()
        problem.optimize()
    except (xp.SolverError, xp.ModelError) as error:
        if "icense" in str(error):
            raise Refused(error) from None
        raise
    found = problem.attributes
    status = _WORDS.get(int(found.solstatus), f"status {found.solstatus}")
    if int(found.solvestatus) == 1:
        status = f"budget: {status}"
    if int(found.solstatus) not in (1, 2):
        return answer(status, begin=begin, middle=middle)
    lower = found.bestbound if abs(found.bestbound) < 1e19 else -INF
    if int(found.solstatus) == 1 and lower > found.objval + 1e-3:
        lower = found.objval
    point = problem.getSolution(x)
    return answer(status, lower, found.objval, point, begin, middle)


run(solve)
