"""Random small problems with exactly checked feasible grids."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from exact_polynomials import value_at
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
        at = float(value_at(g, planted))
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
    assert value_at(problem.objective, best) == Fraction(case.least)
    for row in rows:
        value = value_at(row.polynomial, best)
        assert value == 0 if row.kind is sp.Kind.ZERO else value >= 0
    return case
