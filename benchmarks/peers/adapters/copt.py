"""COPT, in the limited version that runs without a licence file."""

import time

import coptpy as cp
from common import INF, Quadratic, Refused, answer, degree, run

_WORDS = {1: "optimal", 2: "infeasible", 3: "unbounded", 8: "budget: time limit", 20: "local"}


def solve(task, number):
    begin = time.process_time()
    settings = cp.EnvrConfig()
    settings.set("nobanner", "1")
    model = cp.Envr(settings).createModel()
    model.setParam("Logging", 0)
    model.setParam("Threads", 1)
    model.setParam("NonConvex", 2)
    model.setParam("TimeLimit", task["seconds"])
    model.setParam("AbsGap", task["gaps"][number])
    model.setParam("RelGap", task["relative"])

    def variable(low, high):
        return model.addVar(lb=max(low, -1e30), ub=min(high, 1e30))

    def say(body, equal, quadratic):
        if quadratic:
            model.addQConstr(body == 0 if equal else body >= 0)
        else:
            model.addConstr(body == 0 if equal else body >= 0)

    quadratic = Quadratic(task, variable, lambda w, u, v: say(w - u * v, True, True))
    for row in task["rows"]:
        if degree(row["terms"]):
            body = quadratic.value(row["terms"])
            say(body, row["equal"], degree(row["terms"]) > 1)
    model.setObjective(quadratic.value(task["objectives"][number]), cp.COPT.MINIMIZE)
    middle = time.process_time()
    try:
        model.solve()
    except cp.CoptError as error:
        if "icense" in str(error):
            raise Refused(error) from None
        raise
    status = _WORDS.get(model.status, f"status {model.status}")
    known = hasattr(model, "bestbnd") and (model.ismip or model.hasmipsol)
    lower = model.bestbnd if known else -INF
    if known and model.hasmipsol:
        x = [v.x for v in quadratic.x[: task["n"]]]
        return answer(status, lower, model.objval, x, begin, middle)
    if model.status == 1:
        x = [v.x for v in quadratic.x[: task["n"]]]
        return answer(status, model.objval, model.objval, x, begin, middle)
    return answer(status, lower, begin=begin, middle=middle)


run(solve)
