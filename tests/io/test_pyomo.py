"""Pyomo: models in, bounds and values back; files that it writes."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp

pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")
network = pytest.importorskip("pyomo.network", reason="Pyomo is the optional extra pyomo")


def small() -> Any:
    """max x1 - x2 on the unit circle: sqrt(2)."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var([1, 2])
    model.cost = pyo.Objective(expr=model.x[1] - model.x[2], sense=pyo.maximize)
    model.circle = pyo.Constraint(expr=model.x[1] ** 2 + model.x[2] ** 2 == 1)
    return model


def knapsack() -> Any:
    """max 3 a + 5 b + 4 k - k^2, 2 a + 3 b + k <= 6; k integer in [-1, 4], by enumeration 11."""
    model = pyo.ConcreteModel()
    model.a, model.b = pyo.Var(domain=pyo.Binary), pyo.Var(domain=pyo.Binary)
    model.k = pyo.Var(domain=pyo.Integers, bounds=(-1.5, 4.2))
    model.worth = pyo.Objective(
        expr=3 * model.a + 5 * model.b + 4 * model.k - model.k**2, sense=pyo.maximize
    )
    model.room = pyo.Constraint(expr=2 * model.a + 3 * model.b + model.k <= 6)
    return model


def enumerated() -> float:
    return max(
        3 * a + 5 * b + 4 * k - k**2
        for a in (0, 1)
        for b in (0, 1)
        for k in range(-1, 5)
        if 2 * a + 3 * b + k <= 6
    )


def test_a_model_becomes_a_problem() -> None:
    model = small()
    model.unused = pyo.Var()
    model.p = pyo.Param(initialize=3, mutable=True)
    model.y, model.z = pyo.Var(bounds=(0, None)), pyo.Var()
    model.z.fix(2.0)
    model.e = pyo.Expression(expr=(model.x[1] + model.y) ** 2 * model.p)
    model.band = pyo.Constraint(expr=pyo.inequality(-1, model.e - model.z * model.y / 4, 5))
    model.off = pyo.Constraint(expr=pyo.sin(model.y) <= 1)
    model.off.deactivate()
    model.number = pyo.Constraint(expr=model.y <= pyo.sqrt(model.p * 3))
    x1, x2, y = sp.variables(3, ["x[1]", "x[2]", "y"])
    expected = sp.Problem(
        -(x1 - x2),
        [
            3 * (x1 + y) ** 2 - 0.5 * y >= -1,
            3 * (x1 + y) ** 2 - 0.5 * y <= 5,
            x1**2 + x2**2 == 1,
            y <= 3,
        ],
        lower=[-np.inf, -np.inf, 0],
        sense="max",
    )
    found = sp.from_pyomo(model)
    assert found.sense == "max"
    assert found.names == ("x[1]", "x[2]", "y")
    assert str(found).replace("band: ", "").replace("circle: ", "").replace("number: ", "") == str(
        expected
    )


def test_values_and_bounds_come_back_in_the_sense_of_the_model() -> None:
    model = small()
    solver = pyo.SolverFactory("sparsepop")
    assert solver.available()
    results = solver.solve(model, timelimit=20)
    assert pyo.check_optimal_termination(results)
    low, high = results.problem.lower_bound, results.problem.upper_bound
    assert low <= 2**0.5 <= high
    assert (low, high) == pytest.approx((2**0.5, 2**0.5), abs=1e-5)
    assert pyo.value(model.cost) == pytest.approx(2**0.5, abs=1e-5)
    assert model.x[1].value == pytest.approx(0.5**0.5, abs=1e-3)
    assert not model.x[1].stale
    assert solver.result.certificate.verify(solver.problem).ok
    assert solver.problem.sense == "max"


def test_integers() -> None:
    model = knapsack()
    results = pyo.SolverFactory("sparsepop").solve(model, options={"time_limit": 30.0})
    assert pyo.check_optimal_termination(results)
    assert enumerated() == 11
    assert results.problem.upper_bound == pytest.approx(11, abs=1e-4)
    assert results.problem.upper_bound >= 11
    assert (model.a.value, model.b.value, model.k.value) == (1.0, 1.0, 1.0)


def test_ratios() -> None:
    """x / (1 + x^2) on [-3, 3] is least, -1/2, at -1; y >= 1 / (2 + x) there is y >= 1."""
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(bounds=(-1.5, 3)), pyo.Var(bounds=(0, 5))
    model.b = pyo.Var(domain=pyo.Binary)
    model.cost = pyo.Objective(expr=model.x / (1 + model.x**2) + 0.0 * model.b)
    model.above = pyo.Constraint(expr=(2 + model.x) ** -1 <= model.y)
    assert isinstance(sp.from_pyomo(model), sp.RationalProblem)
    results = pyo.SolverFactory("sparsepop").solve(model, timelimit=30)
    assert results.problem.lower_bound <= -0.5 <= results.problem.upper_bound
    assert results.problem.lower_bound == pytest.approx(-0.5, abs=1e-4)
    assert model.x.value == pytest.approx(-1, abs=1e-2)
    assert model.y.value * (2 + model.x.value) >= 1 - 1e-9
    model.worse = pyo.Constraint(expr=1 / model.x <= 4)
    with pytest.raises(sp.ProblemError, match="x"):
        pyo.SolverFactory("sparsepop").solve(model, timelimit=30)


def test_infeasible_unbounded_and_open_models() -> None:
    Condition = pyo.TerminationCondition
    model = small()
    model.far = pyo.Constraint(expr=model.x[1] >= 1.1)
    results = pyo.SolverFactory("sparsepop").solve(model)
    assert results.solver.termination_condition == Condition.infeasible
    assert model.x[1].value is None
    ray = pyo.ConcreteModel()
    ray.x = pyo.Var(bounds=(None, 0))
    ray.cost = pyo.Objective(expr=ray.x)
    results = pyo.SolverFactory("sparsepop").solve(ray, options={"effort": "presolve"})
    assert results.solver.termination_condition == Condition.unbounded
    assert results.problem.lower_bound == -math.inf
    # order 1 leaves the gap of x^4 - x^2 over a box open; the values are those attained
    opened = pyo.ConcreteModel()
    opened.x, opened.y = pyo.Var(bounds=(-1, 1)), pyo.Var(bounds=(-1, 1))
    opened.cost = pyo.Objective(expr=-((opened.x - opened.y) ** 2) + opened.x * opened.y)
    solver = pyo.SolverFactory("sparsepop", options={"effort": "plain", "order": 1})
    results = solver.solve(opened)
    least = -5.0  # at (1, -1)
    assert results.problem.lower_bound <= least <= results.problem.upper_bound
    assert pyo.value(opened.cost) == pytest.approx(results.problem.upper_bound, abs=1e-9)


def test_without_an_objective_a_feasible_point_is_found() -> None:
    model = small()
    model.cost.deactivate()
    results = pyo.SolverFactory("sparsepop").solve(model)
    assert pyo.check_optimal_termination(results)
    assert model.x[1].value ** 2 + model.x[2].value ** 2 == pytest.approx(1)


def unexpanded(model: Any) -> None:
    """Two ports that an arc makes equal once it is expanded."""
    model.p, model.q = network.Port(), network.Port()
    model.p.add(model.x[1], "flow")
    model.q.add(model.x[2], "flow")
    model.wire = network.Arc(source=model.p, destination=model.q)


def test_arcs_that_were_expanded_are_rows() -> None:
    model = small()
    unexpanded(model)
    pyo.TransformationFactory("network.expand_arcs").apply_to(model)
    rows = [str(row) for row in sp.from_pyomo(model).constraints]
    assert any("flow" in row and row.endswith("== 0") for row in rows)


def test_numbers_that_no_double_holds_are_rounded_once_and_said() -> None:
    model = pyo.ConcreteModel()
    model.x = pyo.Var(bounds=(0, 2**53 + 1))
    model.p = pyo.Param(initialize=0.1, mutable=True)
    model.cost = pyo.Objective(expr=(2**53 + 1) * model.x + model.p * 3 * model.x + model.p**2)
    problem = sp.from_pyomo(model)
    slope = 2**53 + 1 + 3 * Fraction(0.1)
    assert problem.objective.coefficients.tolist() == [float(Fraction(0.1) ** 2), float(slope)]
    assert {record.place for record in problem.rounding} == {"objective", "upper"}
    model.y = pyo.Var(domain=pyo.Integers, bounds=(2**53, 2**53 + 2))
    model.more = pyo.Constraint(expr=model.y >= model.x)
    with pytest.raises(sp.ProblemError, match="expected none beyond 2\\^53"):
        sp.from_pyomo(model)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=pyo.exp(m.x[1]) <= 1)),
            r"constraint c: found exp\(x\[1\]\), expected a polynomial",
        ),
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=m.x[1] ** 0.5 <= 1)),
            r"constraint c: found x\[1\]\*\*0.5, expected a polynomial",
        ),
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=abs(m.x[1]) <= 1)),
            r"constraint c: found abs\(x\[1\]\), expected a polynomial",
        ),
        (
            lambda m: m.add_component("second", pyo.Objective(expr=m.x[1])),
            "active objectives cost, second, expected one",
        ),
        (
            lambda m: m.add_component("s", pyo.SOSConstraint(var=m.x, sos=1)),
            "s: found a SOSConstraint",
        ),
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=m.x[1] / m.zero <= 1)),
            "constraint c: found .*expected a polynomial",
        ),
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=m.x[1] * m.zero**-1 <= 1)),
            "constraint c: found .*expected a polynomial",
        ),
        (
            lambda m: m.add_component("c", pyo.Constraint(expr=m.x[1] * m.large**2 <= 1)),
            "expected a finite number",
        ),
        (unexpanded, "wire: found a Arc"),
        (lambda m: setattr(m.x[1], "domain", pyo.Integers), r"x\[1\]: found an integer variable"),
    ],
)
def test_what_has_no_polynomial_form_is_refused_by_name(spoil: Any, message: str) -> None:
    model = small()
    model.zero = pyo.Param(initialize=0.0, mutable=True)
    model.large = pyo.Param(initialize=1e200, mutable=True)
    spoil(model)
    with pytest.raises(sp.ProblemError, match=message):
        sp.from_pyomo(model)


def test_wrong_models_and_options() -> None:
    with pytest.raises(sp.ProblemError, match="found str, expected a Pyomo model"):
        sp.from_pyomo("model")
    with pytest.raises(sp.ProblemError, match="abstract model"):
        sp.from_pyomo(pyo.AbstractModel())
    with pytest.raises(sp.ProblemError, match="no variable"):
        sp.from_pyomo(pyo.ConcreteModel())
    with pytest.raises(sp.ProblemError, match="time_limit: found 'abc'"):
        pyo.SolverFactory("sparsepop").solve(small(), timelimit="abc")
    with pytest.raises(sp.ProblemError, match="options: found 'iterations'"):
        pyo.SolverFactory("sparsepop").solve(small(), options={"iterations": 3})


@pytest.mark.parametrize("first", ["pyomo.environ", "sparsepop_py"])
def test_importing_both_packages_enters_the_solver(first: str) -> None:
    second = {"pyomo.environ": "sparsepop_py", "sparsepop_py": "pyomo.environ"}[first]
    code = (
        f"import {first}, {second}, pyomo.environ as pyo, sys; "
        "solver = pyo.SolverFactory('sparsepop'); "
        "print(type(solver).__module__, 'scipy.sparse' in sys.modules)"
    )
    folder = Path(sp.__file__).resolve().parents[1]
    printed = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    assert printed.stdout.split() == ["sparsepop_py.pyomo", "False"]


@pytest.mark.parametrize("symbolic", [True, False])
def test_gams_files_that_pyomo_writes(symbolic: bool, tmp_path: Path) -> None:
    """Statements after Solve assign scalars, the last without a semicolon."""
    path = tmp_path / "model.gms"
    knapsack().write(str(path), io_options={"symbolic_solver_labels": symbolic})
    assert path.read_text().rstrip().endswith("etsolve")
    result = sp.solve(sp.read(path), sp.Options(effort="auto", time_limit=30))
    assert -result.lower_bound == pytest.approx(enumerated(), abs=1e-4)
    small().write(str(path))
    result = sp.solve(sp.read(path), sp.Options(order=1))
    assert -result.lower_bound == pytest.approx(2**0.5, abs=1e-5)


@pytest.mark.parametrize(
    "domain",
    [
        lambda: pyo.RangeSet(0, 10, 2),
        lambda: pyo.Set(initialize=[1, 3, 7]),
        lambda: pyo.RangeSet(0, 1, 0) | pyo.RangeSet(3, 4, 0),
        lambda: pyo.RangeSet(0, 2, 0.5),
        lambda: pyo.EmptySet,
    ],
)
def test_domains_with_gaps_are_refused(domain) -> None:
    """Their hull would be read: with points that the model has not."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var(domain=domain())
    model.cost = pyo.Objective(expr=(model.x - 3) ** 2)
    with pytest.raises(sp.ProblemError, match="x: found the domain"):
        sp.from_pyomo(model)


def test_integers_without_gaps_are_read() -> None:
    model = pyo.ConcreteModel()
    model.x = pyo.Var(domain=pyo.Set(initialize=[1, 2, 3]))
    model.cost = pyo.Objective(expr=model.x)
    assert sp.from_pyomo(model).dimension == 3


def test_conditions_are_refused_by_name() -> None:
    model = pyo.ConcreteModel()
    model.x = pyo.Var(bounds=(0, 1))
    model.cost = pyo.Objective(expr=pyo.Expr_if(IF=model.x >= 0.5, THEN=model.x, ELSE=2))
    with pytest.raises(sp.ProblemError, match="objective cost"):
        sp.from_pyomo(model)


@pytest.mark.parametrize("end", [math.nan, -math.inf])
def test_rows_with_ends_that_are_no_ends_are_refused(end: float) -> None:
    """A row x <= NaN holds for no x: without it the model would be another one."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var(bounds=(0, 3))
    model.end = pyo.Param(initialize=end, mutable=True, within=pyo.Any)
    model.cost = pyo.Objective(expr=-model.x)
    model.row = pyo.Constraint(expr=model.x <= model.end)
    with pytest.raises(sp.ProblemError, match="constraint row: found"):
        sp.from_pyomo(model)


def test_models_of_the_kernel_are_refused_by_name() -> None:
    kernel = pytest.importorskip("pyomo.kernel")
    with pytest.raises(
        sp.ProblemError, match="found block, expected a Pyomo model, of pyomo.environ"
    ):
        sp.from_pyomo(kernel.block())
