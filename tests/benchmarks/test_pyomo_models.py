"""The Pyomo models of the benchmark, those that take no time."""

from __future__ import annotations

import math

import pytest

pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is the optional extra pyomo")

from benchmarks.pyomo_models import MODELS  # noqa: E402


@pytest.mark.parametrize(
    "name", ["rosenbrock", "reactor", "knapsack", "haverly", "camel", "ratios"]
)
def test_bounds_hold_the_known_optimum(name: str) -> None:
    make, known = MODELS[name]
    model = make()
    results = pyo.SolverFactory("sparsepop").solve(model, timelimit=30)
    slack = 1e-5 * max(1.0, abs(known))
    assert math.isfinite(known)
    assert results.problem.lower_bound <= known + slack
    assert results.problem.upper_bound >= known - slack
    assert pyo.value(model.cost) == pytest.approx(known, abs=slack)
    assert results.problem.upper_bound - results.problem.lower_bound <= slack
