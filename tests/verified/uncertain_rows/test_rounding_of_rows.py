"""Rounding of left inverses and of linear programs from rows: against exact rationals."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import (
    LeftInverse,
    drive_and_coupling,
    linear_rows,
)


def single(target, regressor):
    """One row target + regressor * theta = 0, without noise."""
    return UncertainRows(("theta",), [target], [[regressor]], [0.0], [[0.0]])


def test_ends_of_the_box_are_rounded_outwards():
    """1 - 2^-60 and 1 + 2^-60 both round to 1."""
    inverse = np.ones((1, 1))
    for centre in (1.0, -3.0, 0.1):
        step = LeftInverse(inverse, np.array([centre]), np.array([2.0**-60]))
        low, high = step.box()
        assert Fraction(float(low[0])) <= Fraction(centre) - Fraction(1, 2**60)
        assert Fraction(float(high[0])) >= Fraction(centre) + Fraction(1, 2**60)


def test_residuals_count_what_rounding_hides():
    """0.1 * 3 rounds to 0.30000000000000004: the computed residual is 0, the exact one is not."""
    target = -(0.1 * 3.0)
    drive, _ = drive_and_coupling(single(target, 0.1), np.ones((1, 1)), np.array([3.0]))
    exact = abs(Fraction(target) + 3 * Fraction(0.1))
    assert exact > Fraction(1, 2**56)
    assert Fraction(float(drive[0])) >= exact


def test_couplings_count_what_rounding_hides():
    """3 * (1/3) rounds to 1: the computed coupling is 0, the exact one 2^-54."""
    third = 1.0 / 3.0
    _, coupling = drive_and_coupling(single(0.0, third), np.full((1, 1), 3.0), np.zeros(1))
    assert 1 - 3 * Fraction(third) == Fraction(1, 2**54)
    assert Fraction(float(coupling[0, 0])) >= Fraction(1, 2**54)


def least_value(rows, low, high, theta):
    """The least left side of the linear program's rows at a point, in rationals."""
    problem = linear_rows(rows, (np.array(low, float), np.array(high, float)))
    values = []
    for row in problem.constraints:
        words, values_of = row.polynomial.words[:, -1].tolist(), row.polynomial.coefficients
        factors = [Fraction(theta[v - 1]) if v else 1 for v in words]
        values.append(sum(Fraction(c) * f for c, f in zip(values_of, factors, strict=True)))
    return min(values)


def test_rows_keep_what_rounding_takes_from_their_coefficients():
    """|6 w + x + y| <= w |x| + w |y| at (3, -3): 1 - w / 2 and 1 + w / 2 both round to 1."""
    w = 2.0**-54
    rows = UncertainRows(("x", "y"), [6 * w], [[1.0, 1.0]], [0.0], [[w, w]])
    assert least_value(rows, [-1, -3], [3, 1], (3, -3)) >= 0


def test_rows_keep_what_rounding_takes_from_their_uncertainty():
    """1 + 2^-51 <= 1 + 20 * 2^-54: each of the twenty disappears when it is added to 1."""
    names = tuple(f"x{k}" for k in range(20))
    radii = np.full((1, 20), 2.0**-54)
    rows = UncertainRows(names, [1.0 + 2.0**-51], np.zeros((1, 20)), [1.0], radii)
    assert least_value(rows, [-1] * 20, [1] * 20, [1] * 20) >= 0
