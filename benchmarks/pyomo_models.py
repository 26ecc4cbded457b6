"""Ten models in Pyomo beside IPOPT and SCIP: what each finds, what each claims, CPU seconds.

Run as ``python -m benchmarks.pyomo_models``. Pyomo writes each model as a .nl file. IPOPT reads it
through CasADi, SCIP through PySCIPOpt; where one of them is not installed, its columns are empty.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyomo.environ as pyo

import sparsepop_py as sp
from sparsepop_py.budget import cpu_seconds

from .tables.text import table

SECONDS = 60.0
_HEAD = [
    *("model", "sense", "known", "proved", "attained", "status", "CPU s"),
    *("IPOPT value", "IPOPT status", "CPU s", "SCIP bound", "SCIP value", "SCIP status", "CPU s"),
]


def rosenbrock() -> Any:
    """Rosenbrock's function: 0. W. Hart et al., Pyomo (2012), nonlinear chapter."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.5), pyo.Var(initialize=1.5)
    m.cost = pyo.Objective(expr=(1 - m.x) ** 2 + 100 * (m.y - m.x**2) ** 2)
    return m


def reactor() -> Any:
    """Concentration of B in a stirred tank: 1072.44. The book's reactor design."""
    m = pyo.ConcreteModel()
    k1, k2, k3, feed = 5.0 / 6.0, 5.0 / 3.0, 1.0 / 6000.0, 10000.0
    m.sv = pyo.Var(initialize=1.0, bounds=(0, 10))
    m.ca, m.cb, m.cc, m.cd = (pyo.Var(initialize=2000.0, bounds=(0, feed)) for _ in range(4))
    m.cost = pyo.Objective(expr=m.cb, sense=pyo.maximize)
    m.a = pyo.Constraint(expr=m.sv * feed - m.sv * m.ca - k1 * m.ca - 2 * k3 * m.ca**2 == 0)
    m.b = pyo.Constraint(expr=-m.sv * m.cb + k1 * m.ca - k2 * m.cb == 0)
    m.c = pyo.Constraint(expr=-m.sv * m.cc + k2 * m.cb == 0)
    m.d = pyo.Constraint(expr=-m.sv * m.cd + k3 * m.ca**2 == 0)
    return m


def knapsack() -> Any:
    """Hammer, wrench, screwdriver, towel: 25. The book's knapsack."""
    m = pyo.ConcreteModel()
    benefit, weight = [8, 3, 6, 11], [5, 7, 4, 3]
    m.x = pyo.Var(range(4), domain=pyo.Binary)
    m.cost = pyo.Objective(expr=sum(b * m.x[i] for i, b in enumerate(benefit)), sense=pyo.maximize)
    m.room = pyo.Constraint(expr=sum(w * m.x[i] for i, w in enumerate(weight)) <= 14)
    return m


def warehouses() -> Any:
    """Two of three warehouses for four customers: 2745. The book's warehouse location."""
    m = pyo.ConcreteModel()
    d = [[1956, 1606, 1410, 330], [1096, 1792, 531, 567], [485, 2322, 324, 1236]]
    m.x = pyo.Var(range(3), range(4), bounds=(0, 1))
    m.y = pyo.Var(range(3), domain=pyo.Binary)
    m.cost = pyo.Objective(expr=sum(d[i][j] * m.x[i, j] for i in range(3) for j in range(4)))
    m.one = pyo.Constraint(range(4), rule=lambda m, j: sum(m.x[i, j] for i in range(3)) == 1)
    m.open = pyo.Constraint(range(3), range(4), rule=lambda m, i, j: m.x[i, j] <= m.y[i])
    m.most = pyo.Constraint(expr=sum(m.y[i] for i in range(3)) <= 2)
    return m


def haverly() -> Any:
    """Haverly's pooling problem: -400. C. Haverly, SIGMAP Bulletin 25 (1978)."""
    m = pyo.ConcreteModel()
    m.f = pyo.Var(["A", "B", "Cx", "Cy", "Px", "Py"], bounds=(0, 300), initialize=50)
    m.p = pyo.Var(bounds=(1, 3), initialize=2)
    f = m.f
    m.x = pyo.Constraint(expr=f["Px"] + f["Cx"] <= 100)
    m.y = pyo.Constraint(expr=f["Py"] + f["Cy"] <= 200)
    m.pool = pyo.Constraint(expr=f["A"] + f["B"] == f["Px"] + f["Py"])
    m.sulfur = pyo.Constraint(expr=3 * f["A"] + f["B"] == m.p * (f["Px"] + f["Py"]))
    m.qx = pyo.Constraint(expr=m.p * f["Px"] + 2 * f["Cx"] <= 2.5 * (f["Px"] + f["Cx"]))
    m.qy = pyo.Constraint(expr=m.p * f["Py"] + 2 * f["Cy"] <= 1.5 * (f["Py"] + f["Cy"]))
    m.cost = pyo.Objective(
        expr=6 * f["A"]
        + 16 * f["B"]
        + 10 * (f["Cx"] + f["Cy"])
        - 9 * (f["Px"] + f["Cx"])
        - 15 * (f["Py"] + f["Cy"])
    )
    return m


def hs71() -> Any:
    """Problem 71 of Hock and Schittkowski (1981): 17.0140173."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(1, 5), bounds=(1, 5), initialize={1: 1, 2: 5, 3: 5, 4: 1})
    x = m.x
    m.cost = pyo.Objective(expr=x[1] * x[4] * (x[1] + x[2] + x[3]) + x[3])
    m.product = pyo.Constraint(expr=x[1] * x[2] * x[3] * x[4] >= 25)
    m.sphere = pyo.Constraint(expr=sum(x[i] ** 2 for i in range(1, 5)) == 40)
    return m


def camel() -> Any:
    """Six-hump camel back function: -1.0316285. L. Dixon, G. Szego (1978)."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-3, 3), initialize=-1.5), pyo.Var(bounds=(-2, 2), initialize=1)
    x, y = m.x, m.y
    m.cost = pyo.Objective(expr=4 * x**2 - 2.1 * x**4 + x**6 / 3 + x * y - 4 * y**2 + 4 * y**4)
    return m


def ratios() -> Any:
    """Three Lorentz curves with centres 1, 4, 9: by a scan in steps of 1e-5, -1.1234085."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, 12), initialize=10.5)
    m.cost = pyo.Objective(
        expr=-1 / (1 + (m.x - 1) ** 2) - 1 / (1 + 2 * (m.x - 4) ** 2) - 0.6 / (1 + (m.x - 9) ** 2)
    )
    return m


def portfolio() -> Any:
    """Least variance with a return of 0.12 and at most three of five assets, by enumeration."""
    m = pyo.ConcreteModel()
    mean = [0.08, 0.11, 0.14, 0.10, 0.17]
    m.x = pyo.Var(range(5), bounds=(0, 1), initialize=0.2)
    m.b = pyo.Var(range(5), domain=pyo.Binary)
    sigma = [0.10, 0.15, 0.22, 0.13, 0.30]
    m.cost = pyo.Objective(
        expr=sum((sigma[i] * m.x[i]) ** 2 for i in range(5))
        + 0.4 * sum(sigma[i] * sigma[j] * m.x[i] * m.x[j] for i, j in pairwise(range(5)))
    )
    m.whole = pyo.Constraint(expr=sum(m.x[i] for i in range(5)) == 1)
    m.gain = pyo.Constraint(expr=sum(mean[i] * m.x[i] for i in range(5)) >= 0.12)
    m.held = pyo.Constraint(range(5), rule=lambda m, i: m.x[i] <= m.b[i])
    m.few = pyo.Constraint(expr=sum(m.b[i] for i in range(5)) <= 3)
    return m


def circles() -> Any:
    """Three points in the unit square, as far apart as possible: sqrt(6) - sqrt(2)."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), bounds=(0, 1), initialize={0: 0.1, 1: 0.8, 2: 0.4})
    m.y = pyo.Var(range(3), bounds=(0, 1), initialize={0: 0.2, 1: 0.1, 2: 0.9})
    m.d = pyo.Var(bounds=(0, 2), initialize=0.5)
    m.cost = pyo.Objective(expr=m.d, sense=pyo.maximize)
    m.apart = pyo.Constraint(
        [(0, 1), (0, 2), (1, 2)],
        rule=lambda m, i, j: (m.x[i] - m.x[j]) ** 2 + (m.y[i] - m.y[j]) ** 2 >= m.d**2,
    )
    return m


MODELS: dict[str, tuple[Callable[[], Any], float]] = {
    "rosenbrock": (rosenbrock, 0.0),
    "reactor": (reactor, 1072.4372),
    "knapsack": (knapsack, 25.0),
    "warehouses": (warehouses, 2745.0),
    "haverly": (haverly, -400.0),
    "hs71": (hs71, 17.0140173),
    "camel": (camel, -1.0316285),
    "ratios": (ratios, -1.1234085),
    "portfolio": (portfolio, math.nan),
    "circles": (circles, math.sqrt(6.0) - math.sqrt(2.0)),
}


def by_ipopt(path: Path, sign: float) -> list[str]:
    """Value, status and CPU seconds of IPOPT, a local solver: integers are relaxed."""
    try:
        import casadi
    except ImportError:
        return ["", "", ""]
    start = cpu_seconds()
    read = casadi.NlpBuilder()
    read.import_nl(str(path), {"verbose": False})
    nlp = {"x": casadi.vertcat(*read.x), "f": read.f, "g": casadi.vertcat(*read.g)}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    solver = casadi.nlpsol("solver", "ipopt", nlp, quiet)
    found = solver(x0=read.x_init, lbx=read.x_lb, ubx=read.x_ub, lbg=read.g_lb, ubg=read.g_ub)
    status = solver.stats()["return_status"]
    return [f"{sign * float(found['f']):.7g}", status, f"{cpu_seconds() - start:.2f}"]


def by_scip(path: Path) -> list[str]:
    """Bound, value, status and CPU seconds of SCIP."""
    try:
        import pyscipopt
    except ImportError:
        return ["", "", "", ""]
    start = cpu_seconds()
    model = pyscipopt.Model()
    model.hideOutput()
    model.readProblem(str(path))
    model.setParam("limits/time", SECONDS)
    model.optimize()
    value = f"{model.getObjVal():.7g}" if model.getNSols() else "none"
    seconds = f"{cpu_seconds() - start:.2f}"
    return [f"{model.getDualbound():.7g}", value, model.getStatus(), seconds]


def by_sparsepop(model: Any) -> tuple[str, list[str]]:
    """Sense; proved and attained value, status and CPU seconds of this package."""
    solver = pyo.SolverFactory("sparsepop")
    start = cpu_seconds()
    results = solver.solve(model, timelimit=SECONDS)
    seconds = cpu_seconds() - start
    low, high = results.problem.lower_bound, results.problem.upper_bound
    sense = solver.problem.sense
    ends = (high, low) if sense == "max" else (low, high)
    return sense, [f"{e:.8g}" for e in ends] + [str(solver.result.status), f"{seconds:.2f}"]


def main() -> int:
    """Print the table."""
    sp.solve(sp.parse("min x^4 - x; s.t. x^2 <= 4"), sp.Options(order=2))  # imports
    rows = []
    for name, (make, known) in MODELS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "model.nl")
            make().write(str(path))
            sense, ours = by_sparsepop(make())
            peers = by_ipopt(path, -1.0 if sense == "max" else 1.0) + by_scip(path)
        shown = "" if math.isnan(known) else f"{known:.8g}"
        rows.append([name, sense, shown, *ours, *peers])
        print(rows[-1], file=sys.stderr)
    print(table(_HEAD, rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
