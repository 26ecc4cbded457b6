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


def over_a_polyhedron(seed):
    """A convex problem without a box and its minimum, planted: f' = sum of multipliers times rows.

    Linear where the seed is a multiple of 3; every number is a double, the minimum rational.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    m = int(rng.integers(1, n + 4))
    x, unit = sp.variables(n), int(rng.integers(1, 4))
    rows = rng.integers(-3, 4, (m, n))
    point = [Fraction(int(v), unit) for v in rng.integers(-6, 7, n)]
    equal, active = rng.random(m) < 0.4, rng.random(m) < 0.7
    multiplier = np.where(equal, rng.integers(-3, 4, m), rng.integers(0, 4, m) * active)
    bounded = rng.random(n) < 0.4
    price = rng.integers(0, 3, n) * bounded
    squares = rng.integers(-2, 3, (int(rng.integers(1, n + 1)), n)) * (seed % 3 > 0)
    lower = np.where(bounded, [float(np.floor(float(v))) for v in point], -np.inf)
    touched = np.array([bounded[j] and point[j].denominator == 1 for j in range(n)])
    slope = [
        sum(int(multiplier[i] * rows[i, j]) * unit for i in range(m)) + int(price[j] * touched[j])
        for j in range(n)
    ]
    constraints = []
    for i in range(m):
        if not rows[i].any():
            continue
        left = sp.total([float(unit * int(a)) * v for a, v in zip(rows[i], x, strict=True)])
        right = float(sum(unit * int(a) * p for a, p in zip(rows[i], point, strict=True)))
        slack = 0.0 if equal[i] or active[i] else float(rng.integers(0, 4))
        constraints.append(left == right if equal[i] else left >= right - slack)
    forms = [[int(a) for a in row] for row in squares]
    at = [sum(a * p for a, p in zip(row, point, strict=True)) for row in forms]
    # unit |L (x - point)|^2 + slope (x - point): the minimum is 0 at the point
    parts, constant = [0.0 * x[0]], Fraction(0)
    for row, value in zip(forms, at, strict=True):
        form = sp.total([float(a) * v for a, v in zip(row, x, strict=True)])
        parts.append(float(unit) * form**2 - float(2 * unit * value) * form)
        constant += unit * value**2
    parts += [float(s) * v for s, v in zip(slope, x, strict=True)]
    constant -= sum(s * p for s, p in zip(slope, point, strict=True))
    return sp.Problem(sp.total(parts), constraints, lower), -constant
