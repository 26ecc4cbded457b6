"""Cones, matrices and linear programs whose numbers are near the ends of doubles."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp

X, Y = sp.variables(2)
LARGEST = sys.float_info.max


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
@pytest.mark.parametrize(
    ("row", "least"),
    [
        (sp.second_order(1e200 * X, 1e200 * Y), 0.0),
        (sp.second_order(X + 2, 1e155 * Y), -1.0),
        (sp.psd([[1e160 * X + 1, Y], [Y, 1]]), -1e-160),
    ],
)
def test_squares_of_entries_may_overflow(row: Any, least: float, effort: Any) -> None:
    """The search for points scales them; the least x on [-1, 1] is known."""
    result = sp.solve(sp.Problem(X, [row], -1, 1), sp.Options(effort=effort, time_limit=10))
    assert result.status is sp.Status.OPTIMAL
    assert least - 1e-6 <= result.lower_bound <= least <= result.upper_bound + 1e-9
    assert result.certificate.verify(result.problem)


def test_eigenvalues_that_overflow_end_no_search() -> None:
    entry = 1e238 - Y * Y
    row = sp.psd([[1 + X, entry, Y], [entry, 1 + X * Y, X], [Y, X, 1 + Y]])
    result = sp.solve(sp.Problem(X, [row], -1, 1), sp.Options(effort="plain"))
    assert result.status is sp.Status.INFEASIBLE  # the minor 4 - 1e476 is negative
    assert result.certificate.verify(result.problem)


@pytest.mark.parametrize(
    "made", [lambda: (1e308 * X + 5e-324) ** 2, lambda: (1e308 * X) * (1e9 * Y)]
)
def test_products_beyond_all_doubles_are_named(made: Any) -> None:
    with pytest.raises(sp.ProblemError, match="overflows"):
        made()


@pytest.mark.parametrize("high", [5e-324, 1.5e-320, 1e-310, 1e-300])
def test_vertices_that_are_subnormal_are_those_that_verify(high: float) -> None:
    problem = sp.Problem(-X, (), [0, 0], [high, 1])
    (bound,) = sp.linear_bounds(problem, [-X])
    assert bound.x is not None and bound.x[0] == high == float(bound.vertex[0])
    assert bound.verify(problem, -X)


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
@pytest.mark.parametrize(
    ("objective", "row"),
    [
        (1e146 + 1e-168 * X * X, X >= -5),
        (X * Y, 1e300 + 1e-300 * X * X * Y * Y >= 0),
        (X * Y, sp.psd([[1e300 + 1e-300 * X, 1e-300 * Y], [1e-300 * Y, 1e300]])),
        (X * Y, sp.second_order(1e300 + 1e-300 * X * Y, 1e-300 * Y)),
    ],
)
def test_constants_beyond_all_doubles_times_the_rest(objective, row: Any, effort: Any) -> None:
    """A row divided by its largest coefficient has a constant that no double holds."""
    result = sp.solve(sp.Problem(objective, [row], -1, 1), sp.Options(effort=effort, work_limit=1))
    least = 1e146 if objective.constant_term else -1.0
    assert result.lower_bound <= least <= result.upper_bound
    assert result.lower_bound >= least - 1e-6 * abs(least)
    assert result.certificate.verify(result.problem)


@pytest.mark.parametrize(
    ("objective", "rows", "lower", "upper"),
    [
        (3e221 * X + 1e-270 * X**3, [1e-298 * X**2 >= 1e-89, 2e282 * X >= 2e35], -4, 4),
        (-2 * X, [X * Y >= 0], [0, -1e-20], 1.7e308),
        (2e-67 * X**2 - 3e127 * X, [2e13 * X >= 1e-80], -3e170, 3e275),
    ],
)
def test_searches_beyond_all_doubles_are_silent(objective, rows: Any, lower, upper) -> None:
    """Warnings are errors here."""
    problem = sp.Problem(objective, rows, lower, upper)
    for effort in ("plain", "auto"):
        result = sp.solve(problem, sp.Options(effort=effort, work_limit=0.03))
        assert result.lower_bound <= result.upper_bound


@pytest.mark.parametrize("effort", ["plain", "auto"])
@pytest.mark.parametrize(
    ("problem", "gap"),
    [
        (sp.Problem(LARGEST * X + LARGEST * Y, [], -1, 1), 1e-6),
        (sp.Problem(LARGEST * X + X * Y, [X * Y <= 1], -1, 1), 1e-6),
        (sp.RationalProblem(LARGEST * X / (0.5 + 0.25 * X**2), [], -1, 1), 1e-6),
        (sp.Problem(X**3 * Y - X, [X * Y <= 1, X >= -1], None, 1), np.inf),
    ],
)
def test_no_gap_is_closed_by_a_bound_of_minus_infinity(problem, gap: float, effort: Any) -> None:
    """Each objective falls below all doubles."""
    options = sp.Options(effort=effort, gap=gap, work_limit=0.01)
    result = sp.solve(problem, options)
    assert result.lower_bound == -np.inf
    assert result.status is not sp.Status.OPTIMAL
