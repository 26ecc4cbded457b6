"""Local searches and proofs of points where unknowns are tiny; the minima are known."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.local_search.own_units import in_own_units, largest_violation

x, y = sp.variables(2)
HYPERBOLA = sp.Problem(x + 4 * y, [x * y >= 1], [0, 0], [4, 4])  # 4, by the means of x and 4 y
QUARTICS = sp.Problem(  # problem 4.10 of Floudas and Pardalos (1990): -5.50801
    -x - y,
    [
        y <= 2 * x**4 - 8 * x**3 + 8 * x**2 + 2,
        y <= 4 * x**4 - 32 * x**3 + 88 * x**2 - 96 * x + 36,
    ],
    [0, 0],
    [3, 4],
)


def restated(problem: sp.Problem, unit: float) -> sp.Problem:
    """The same problem in z = unit * x; ``unit`` is a power of two, so that nothing is rounded."""

    def in_z(given: sp.Polynomial) -> sp.Polynomial:
        factors = np.append(1.0, np.full(given.dimension, 1.0 / unit))[given.words]
        values = given.coefficients * np.prod(factors, axis=1)
        return sp.Polynomial(given.words, values, given.dimension)

    rows = [sp.Constraint(in_z(c.polynomial), c.kind) for c in problem.constraints]
    return sp.Problem(in_z(problem.objective), rows, problem.lower * unit, problem.upper * unit)


@pytest.mark.parametrize(("problem", "least"), [(HYPERBOLA, 4.0), (QUARTICS, -5.50801)])
@pytest.mark.parametrize("power", [-17, -30])
def test_minima_among_tiny_unknowns_are_attained(
    problem: sp.Problem, least: float, power: int
) -> None:
    """Searches that step by 1e-6 and stop at violations of 1e-6 end far from them."""
    result = sp.solve(restated(problem, 2.0**power), sp.Options(effort="auto", gap=1e-6))
    assert result.status is sp.Status.OPTIMAL
    assert result.upper_bound == pytest.approx(least, abs=2e-5)


def test_units_are_exact() -> None:
    scaled = in_own_units(restated(QUARTICS, 2.0**-20))
    assert scaled.units.tolist() == [2.0**-18, 2.0**-17]
    point = np.array([2.0, 3.0])
    for given, own in zip(QUARTICS.constraints, scaled.problem.constraints, strict=True):
        value = own.polynomial(point * 2.0**-20 / scaled.units) / given.polynomial(point)
        assert np.frexp(value)[0] == 0.5  # a power of two


def test_other_problems_stay_as_they_are() -> None:
    for problem in (HYPERBOLA, restated(HYPERBOLA, 2.0**40), sp.Problem(x - y, [x == y])):
        assert in_own_units(problem).problem is problem
        vector = np.array([0.25, 0.5]) * (problem.upper if np.isfinite(problem.upper[0]) else 1.0)
        assert largest_violation(problem, vector) == problem.violation(vector)


def test_tiny_products_are_violations() -> None:
    """Both factors are as large as they can be, and the product is below 1e-12."""
    either = sp.Problem(x, [x * y == 0], [0, 0], [1e-6, 1e-6])
    assert either.violation(either.upper) < 1e-11
    assert largest_violation(either, either.upper) > 0.1
