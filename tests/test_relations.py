"""Relations between problems: what must not change a bound, and what must not worsen it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import strategies as st

import sparsepop_py as sp

SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Case:
    """A problem, the feasible points of a grid and the objective there."""

    problem: sp.Problem
    points: np.ndarray
    values: np.ndarray

    @property
    def least(self):
        return float(self.values.min())


def some_polynomial(rng, x, degree):
    n = len(x)
    parts = [0.0 * x[0]]
    for _ in range(int(rng.integers(1, 6))):
        word = rng.integers(0, n, int(rng.integers(1, degree + 1)))
        term = float(rng.integers(-12, 13)) / 4
        for v in word.tolist():
            term = term * x[v]
        parts.append(term)
    return sp.total(parts)


def on_grid(polynomial, points):
    """Values on the grid, term by term, apart from the package's own evaluation."""
    result = np.zeros(points.shape[0])
    for word, coefficient in zip(polynomial.words, polynomial.coefficients, strict=True):
        term = np.full(points.shape[0], coefficient)
        for letter in word.tolist():
            if letter:
                term = term * points[:, letter - 1]
        result += term
    return result


def exact(polynomial, point):
    result = Fraction(0)
    for word, coefficient in zip(polynomial.words, polynomial.coefficients, strict=True):
        term = Fraction(float(coefficient))
        for letter in word.tolist():
            if letter:
                term *= Fraction(float(point[letter - 1]))
        result += term
    return result


def random_case(seed, *, constrained=True):
    """A box, a planted grid point that satisfies every constraint, and the whole grid."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    x = sp.variables(n)
    low = rng.integers(-2, 1, n).astype(float)
    high = low + rng.integers(1, 4, n)
    step = (1 / 64, 1 / 16, 1 / 4)[n - 1]
    planted = low + step * rng.integers(0, np.round((high - low) / step) + 1)
    rows = []
    for _ in range(int(rng.integers(0, 4)) if constrained else 0):
        g = some_polynomial(rng, x, int(rng.integers(1, 5)))
        at = float(exact(g, planted))
        kind = rng.integers(0, 5)
        if kind <= 2:
            rows.append(g >= at - float(rng.integers(0, 5)) / 4)
        elif kind == 3:
            i, j = rng.integers(0, n, 2)
            factor = x[i] - planted[i]
            rows.append(factor * (x[j] - float(rng.integers(-2, 3))) == 0)
        else:
            rows.append(g == at)
    problem = sp.Problem(some_polynomial(rng, x, 4), rows, low, high)
    axes = [np.arange(a, b + step / 2, step) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, n)
    keep = np.ones(points.shape[0], bool)
    for row in rows:
        value = on_grid(row.polynomial, points)
        keep &= value == 0 if row.kind is sp.Kind.ZERO else value >= 0
    points = points[keep]
    case = Case(problem, points, on_grid(problem.objective, points))
    assert np.any(np.all(points == planted, axis=1))
    # the arithmetic was exact: once more in rationals, at the best point
    best = points[int(np.argmin(case.values))]
    assert exact(problem.objective, best) == Fraction(case.least)
    for row in rows:
        value = exact(row.polynomial, best)
        assert value == 0 if row.kind is sp.Kind.ZERO else value >= 0
    return case


# ---- relations between problems ---------------------------------------------------------------


def bound(problem, **fields):
    return sp.solve(problem, sp.Options(order=2, **fields)).lower_bound


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("effort", ["plain", "presolve"])
def test_more_constraints_and_tighter_bounds_never_lower_the_bound(seed, effort):
    case = random_case([seed, 5])
    problem = case.problem
    base = bound(problem, effort=effort)
    best = case.points[int(np.argmin(case.values))]
    x = sp.variables(problem.dimension)
    scale = 1e-5 * (1 + abs(base))
    extra = sp.total((v - float(p)) ** 2 for v, p in zip(x, best, strict=True)) <= 4
    more = sp.Problem(
        problem.objective, [*problem.constraints, extra], problem.lower, problem.upper
    )
    assert base - scale <= bound(more, effort=effort) <= case.least
    middle = 0.5 * (problem.lower + best), 0.5 * (problem.upper + best)
    tighter = sp.Problem(problem.objective, problem.constraints, *middle)
    assert base - scale <= bound(tighter, effort=effort) <= case.least


@pytest.mark.parametrize("seed", range(8))
def test_names_of_variables_do_not_matter(seed):
    case = random_case([seed, 6])
    problem = case.problem
    order = np.random.default_rng(seed).permutation(problem.dimension)
    place = np.argsort(order)
    x = sp.variables(problem.dimension)

    def moved(p):
        parts = [0.0 * x[0]]
        for word, coefficient in zip(p.words.tolist(), p.coefficients.tolist(), strict=True):
            term = coefficient
            for letter in word:
                term = term * x[place[letter - 1]] if letter else term
            parts.append(term)
        return sp.total(parts)

    relabelled = sp.Problem(
        moved(problem.objective),
        [sp.Constraint(moved(c.polynomial), c.kind) for c in problem.constraints],
        problem.lower[order],
        problem.upper[order],
    )
    assert bound(relabelled, effort="plain") == pytest.approx(
        bound(problem, effort="plain"), rel=1e-6, abs=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("factor", [1e3, 1e-3, 2.0**20])
def test_the_bound_scales_with_the_objective(seed, factor):
    problem = random_case([seed, 8]).problem
    large = sp.Problem(
        factor * problem.objective, problem.constraints, problem.lower, problem.upper
    )
    expected = bound(problem, effort="plain")
    assert bound(large, effort="plain") / factor == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_a_shift_of_the_objective_shifts_the_bound(seed):
    problem = random_case([seed, 9]).problem
    moved = sp.Problem(problem.objective + 7.0, problem.constraints, problem.lower, problem.upper)
    assert bound(moved, effort="plain") == pytest.approx(
        bound(problem, effort="plain") + 7.0, abs=1e-5
    )


@pytest.mark.parametrize("seed", range(1, 6))
def test_higher_orders_prove_more(seed):
    problem = random_case([seed, 10]).problem
    scale = 1e-6 * (1 + abs(bound(problem)))
    values = [sp.solve(problem, sp.Options(order=k, effort="plain")).lower_bound for k in (2, 3, 4)]
    assert values[0] <= values[1] + scale
    assert values[1] <= values[2] + scale
