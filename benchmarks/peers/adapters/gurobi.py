"""Gurobi: spatial branch and bound, in the limited version that comes with its wheel."""

import time

import gurobipy as gp
from common import INF, Quadratic, Refused, answer, run

_WORDS = {
    2: "optimal",
    3: "infeasible",
    4: "infeasible or unbounded",
    5: "unbounded",
    13: "suboptimal",
}


def solve(task, number):
    begin = time.process_time()
    environment = gp.Env(params={"OutputFlag": 0})
    model = gp.Model(env=environment)
    model.Params.Threads, model.Params.NonConvex = 1, 2
    model.Params.TimeLimit = task["seconds"]
    model.Params.MIPGapAbs, model.Params.MIPGap = task["gaps"][number], task["relative"]

    def variable(low, high):
        return model.addVar(lb=max(low, -1e100), ub=min(high, 1e100))

    quadratic = Quadratic(task, variable, lambda w, u, v: model.addConstr(w == u * v))
    for row in task["rows"]:
        body = quadratic.value(row["terms"])
        if not isinstance(body, float):
            model.addConstr(body == 0 if row["equal"] else body >= 0)
    model.setObjective(quadratic.value(task["objectives"][number]))
    middle = time.process_time()
    try:
        model.optimize()
    except gp.GurobiError as error:
        if "license" in str(error):
            raise Refused(error) from None
        raise
    status = _WORDS.get(model.Status, f"status {model.Status}")
    if model.Status in (7, 8, 9, 16, 17):
        status = f"budget: {status}"
    lower = model.ObjBound if model.IsMIP or model.NumQConstrs or model.IsQP else model.ObjVal
    if not model.SolCount:
        return answer(status, lower, begin=begin, middle=middle)
    x = [v.X for v in quadratic.x[: task["n"]]]
    return answer(status, lower, model.ObjVal if model.SolCount else INF, x, begin, middle)


run(solve)
