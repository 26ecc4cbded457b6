"""MAiNGO: McCormick relaxations in branch and bound; it wants finite bounds."""

import math
import time

import maingopy as mg
from common import Refused, answer, degree, run, value


class _Model(mg.MAiNGOmodel):
    def __init__(self, task, number):
        mg.MAiNGOmodel.__init__(self)
        self.task, self.number = task, number

    def get_variables(self):
        ends = zip(self.task["lower"], self.task["upper"], strict=True)
        return [mg.OptimizationVariable(mg.Bounds(a, b), mg.VT_CONTINUOUS) for a, b in ends]

    def get_initial_point(self):
        return [0.5 * (a + b) for a, b in zip(self.task["lower"], self.task["upper"], strict=True)]

    def evaluate(self, x):
        found = mg.EvaluationContainer()
        zero = 0.0 * x[0]
        found.objective = value(self.task["objectives"][self.number], x, zero)
        rows = [row for row in self.task["rows"] if degree(row["terms"])]
        found.eq = [value(row["terms"], x, zero) for row in rows if row["equal"]]
        found.ineq = [-value(row["terms"], x, zero) for row in rows if not row["equal"]]
        return found


def solve(task, number):
    if not all(map(math.isfinite, [*task["lower"], *task["upper"]])):
        raise Refused("variables without finite bounds")
    begin = time.process_time()
    model = _Model(task, number)
    solver = mg.MAiNGO(model)
    solver.set_log_file_name("")
    for name in ("LBP_verbosity", "UBP_verbosity", "BAB_verbosity"):
        solver.set_option(name, 0)
    solver.set_option("loggingDestination", 0)
    solver.set_option("epsilonA", task["gaps"][number])
    solver.set_option("epsilonR", max(task["relative"], 1e-12))
    solver.set_option("maxTime", max(task["seconds"], 1.0))
    middle = time.process_time()
    status = str(solver.solve()).split(".")[-1].lower().replace("_", " ")
    late = time.process_time() - middle > 0.98 * task["seconds"]
    status = f"budget: {status}" if late and status != "globally optimal" else status
    lower = solver.get_final_LBD()
    try:
        point, upper = solver.get_solution_point(), solver.get_objective_value()
    except Exception:  # it has no point
        return answer(status, lower, begin=begin, middle=middle)
    return answer(status, lower, upper, point, begin, middle)


run(solve)
