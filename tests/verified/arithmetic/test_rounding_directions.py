"""Which way the arithmetic rounds, one place at a time: each end against exact rationals."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic import definiteness
from sparsepop_py.verified.arithmetic.definiteness import hold_over, is_semidefinite
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import _binomials
from sparsepop_py.verified.arithmetic.scalar_interval import quotient

LEAST = 2.0**-1074
x, y = sp.variables(2)


def test_binomial_coefficients_that_are_no_doubles_are_enclosed():
    """From C(57, 28) > 2^53 on most of them need more than 53 bits."""
    table = _binomials(60)
    exact = [[comb(a, b) for b in range(61)] for a in range(61)]
    low = [[Fraction(v) for v in row] for row in table.lo.tolist()]
    high = [[Fraction(v) for v in row] for row in table.hi.tolist()]
    assert all(low[a][b] <= exact[a][b] <= high[a][b] for a in range(61) for b in range(61))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_rest_of_a_cone_counts_at_its_farther_end(sign):
    """1 >= |x| fails at -2, an end of [-2, 1/2], and at 2, an end of [-1/2, 2]."""
    matrices = sp.Problem(y, [sp.second_order(1, sign * x)]).matrices
    assert not hold_over(matrices, Interval(np.array([-2.0, 0.0]), np.array([0.5, 0.0])))
    assert hold_over(matrices, Interval(np.array([-0.75, 0.0]), np.array([0.5, 0.0])))


def test_squares_beyond_all_doubles_are_not_compared():
    """1e200 < 1e201, although both squares are infinite in doubles."""
    matrices = sp.Problem(y, [sp.second_order(1e200, x)]).matrices
    far = np.array([1e201, 0.0])
    with np.errstate(over="ignore"):
        assert not hold_over(matrices, Interval(far, far))


def test_rational_matrices_are_enclosed(monkeypatch):
    """What is compared with L L' holds the matrix, entry by entry, at both ends."""
    seen = []

    def record(matrix):
        seen.append(matrix)
        return False

    monkeypatch.setattr(definiteness, "surely_semidefinite", record)
    third = Fraction(1, 3)
    matrix = [[third, -(third**2)], [-(third**2), Fraction(10) ** 400]]
    assert is_semidefinite(matrix)
    for i in range(2):
        for j in range(2):
            low, high = float(seen[0].lo[i, j]), float(seen[0].hi[i, j])
            assert Fraction(low) <= matrix[i][j]
            assert high == np.inf or matrix[i][j] <= Fraction(high)


def test_quotients_of_doubles_are_enclosed():
    """The double nearest to 1 / d and that nearest to n / d both err: one step is too little."""
    rng = np.random.default_rng(0)
    for top, below in rng.uniform(1.0, 2.0, (3000, 2)).tolist():
        for sign in (-1.0, 1.0):
            low, high = quotient((sign * top, sign * top), (below, below))
            exact = Fraction(sign * top) / Fraction(below)
            assert Fraction(low) <= exact <= Fraction(high)
