"""Random small problems with matrices of polynomials, and their exactly feasible grid points."""

from __future__ import annotations

from fractions import Fraction
from itertools import permutations, product

import numpy as np
from exact_polynomials import value_at
from random_cases import some_polynomial

import sparsepop_py as sp


def matrix_at(constraint, values):
    """The matrix of a constraint from values of its entries, by the definition of its kind."""
    if constraint.kind is sp.Kind.SECOND_ORDER:
        side = len(values)
        arrow = [[values[0] if i == j else 0 * values[0] for j in range(side)] for i in range(side)]
        for k in range(1, side):
            arrow[0][k] = arrow[k][0] = values[k]
        return arrow
    side = int(np.sqrt(2 * len(values)))
    place = iter(values)
    lower = [[next(place) for _ in range(i + 1)] for i in range(side)]
    return [[lower[max(i, j)][min(i, j)] for j in range(side)] for i in range(side)]


def determinant(rows):
    """By the formula of Leibniz."""
    total = Fraction(0)
    for order in permutations(range(len(rows))):
        turned = sum(a > b for k, b in enumerate(order) for a in order[:k])
        term = Fraction((-1) ** turned)
        for i, j in enumerate(order):
            term *= rows[i][j]
        total += term
    return total


def exactly_semidefinite(rows):
    """All principal minors are non-negative, in rationals."""
    size = range(len(rows))
    return all(
        determinant([[rows[i][j] for j in chosen] for i in chosen]) >= 0
        for chosen in (tuple(k for k in size if mask >> k & 1) for mask in range(1, 2 ** len(rows)))
    )


def holds(constraint, x):
    """Whether a matrix constraint holds at a rational point."""
    values = [value_at(p, x) for p in constraint.entries]
    return exactly_semidefinite(matrix_at(constraint, values))


def random_matrix(rng, x, side, round_):
    """A matrix constraint of degree at most two that holds in some neighbourhood of 0."""
    if round_:
        entries = [some_polynomial(rng, x, 2) for _ in range(side)]
        return sp.second_order(entries[0] + 1.5, *entries[1:])
    table = [[some_polynomial(rng, x, 2) for _ in range(i + 1)] for i in range(side)]
    return sp.psd(
        [[table[max(i, j)][min(i, j)] + 1.5 * (i == j) for j in range(side)] for i in range(side)]
    )


def random_problem(seed, side=None):
    """Two variables in [-1, 1] and one matrix or cone of two or three rows."""
    rng = np.random.default_rng(seed)
    x = sp.variables(2)
    row = random_matrix(rng, x, side or int(rng.integers(2, 4)), bool(rng.integers(2)))
    return sp.Problem(some_polynomial(rng, x, 2), [row], lower=-1, upper=1)


def feasible_grid(problem, steps=8):
    """Points k / steps of the box that are feasible, checked in rationals, and their values."""
    points, values = [], []
    for corner in product(range(-steps, steps + 1), repeat=problem.dimension):
        x = [Fraction(k, steps) for k in corner]
        if all(holds(c, x) for c in problem.constraints):
            points.append([float(v) for v in x])
            values.append(float(value_at(problem.objective, x)))
    return np.array(points).reshape(-1, problem.dimension), np.array(values)
