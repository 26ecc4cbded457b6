"""Cones, matrices and linear programs whose numbers are near the ends of doubles."""

from __future__ import annotations

from typing import Any

import pytest

import sparsepop_py as sp

X, Y = sp.variables(2)


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
