"""Points near a corner at which rows are curved, moved to where they hold with a margin."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.budget import LimitReached
from sparsepop_py.local_search import feasibility
from sparsepop_py.local_search.feasibility import prove_feasible

# Haverly's pooling problem (C. A. Haverly, SIGMAP Bulletin 25 (1978) 19-28), optimum -400
POOLING = """min 6*x1 + 16*x2 - 9*x5 + 10*x6 + 10*x7 - 15*x8;
s.t. x1 + x2 - x3 - x4 == 0; 0.03*x1 + 0.01*x2 - x3*x9 - x4*x9 == 0; x3 - x5 + x6 == 0;
x4 + x7 - x8 == 0; -x3*x9 + 0.025*x5 - 0.02*x6 >= 0; -x4*x9 - 0.02*x7 + 0.015*x8 >= 0;
x1 >= 0; 300 - x1 >= 0; x2 >= 0; 300 - x2 >= 0; x3 >= 0; 100 - x3 >= 0; x4 >= 0; 200 - x4 >= 0;
x5 >= 0; 100 - x5 >= 0; x6 >= 0; 300 - x6 >= 0; x7 >= 0; 100 - x7 >= 0; x8 >= 0; 200 - x8 >= 0;
x9 - 0.01 >= 0; 0.03 - x9 >= 0"""
CORNER = np.array([0.0, 100.0, 0.0, 100.0, 0.0, 0.0, 100.0, 200.0, 0.01])


@pytest.mark.parametrize("off", [0.0, 1e-15, 1e-14, 1e-12, 1e-9])
def test_points_are_found_however_rounding_falls(off: float) -> None:
    """In doubles .015 * 200 is less than .02 * 100 + .01 * 100: the corner itself is outside."""
    problem, random = sp.parse(POOLING), np.random.default_rng(0)
    for _ in range(5):
        near = CORNER + off * random.normal(size=9) * (1.0 + CORNER)
        found = prove_feasible(problem, np.clip(near, problem.lower, problem.upper))
        assert found is not None and -400.0 <= found.value <= -400.0 + 1e-3


@pytest.mark.parametrize("effort", ["presolve", "auto"])
def test_opposite_inequalities_and_repeated_equations_are_solved_once(effort: str) -> None:
    """min x + 2 y on the unit circle is -sqrt 5, however the circle is written."""
    x, y = sp.variables(2)
    circle = x**2 + y**2 - 1
    for rows in ([circle <= 0, circle >= 0], [circle == 0, -circle == 0, circle <= 0]):
        problem = sp.Problem(x + 2 * y, rows, -3, 3)
        result = sp.solve(problem, sp.Options(effort=effort, time_limit=20))
        assert result.status is sp.Status.OPTIMAL
        assert result.attained is not None and result.attained.proof == "krawczyk"
        assert result.lower_bound <= -np.sqrt(5.0) + 1e-15 <= result.upper_bound + 2e-15
        assert sp.from_json(sp.to_json(result)).upper_bound == result.upper_bound


@pytest.mark.parametrize("pinned", [lambda v: [v >= 0.3, v <= 0.3], lambda v: [v == 0.3]])
def test_rows_of_pinned_variables_are_not_solved(pinned: Callable[[Any], list[Any]]) -> None:
    """Beside so many equations, rows that nothing can be solved for cost the test of Krawczyk."""
    *x, a, v = sp.variables(27)
    problem = sp.Problem(a, [*(each**2 + a == 2 for each in x), *pinned(v)], -3, 3)
    near = np.append(np.full(25, np.sqrt(1.01)), [0.99, 0.3])
    found = prove_feasible(problem, near)
    assert found is not None and found.proof == "krawczyk"
    assert found.rows.tolist() == list(range(25)) and found.x[-1] == 0.3


def test_no_factorisation_begins_that_outlasts_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feasibility, "before_check", lambda: 1e-6)  # seconds that are left
    assert feasibility._leading_columns(np.eye(2)).tolist() == [0, 1]
    with pytest.raises(LimitReached):
        feasibility._leading_columns(np.eye(200))
