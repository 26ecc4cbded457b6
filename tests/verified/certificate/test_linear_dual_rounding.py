"""Rounding of linear duals: the bound against the exact remainder, in rationals."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.lp_dual import LinearDual

x = sp.variables(1)[0]


def test_remainders_count_at_both_ends():
    """0 = f - v h + v h with h = x^9 and x = w t: f >= -|v| w^9 over |t| <= 1."""
    rng = np.random.default_rng(0)
    none, zero, one = np.zeros((0, 2), np.int64), np.zeros(1, np.int64), np.ones(1, np.int64)
    for w, v in rng.uniform(1, 2, (60, 2)).tolist():
        scaling = Scaling(np.zeros(1), np.array([w]), np.ones(1, bool), np.zeros(1, int))
        exact = -Fraction(v) * Fraction(w) ** 9
        for sign in (-1.0, 1.0):
            value = np.array([sign * v])
            dual = LinearDual(scaling, one, np.zeros((1, 1), np.int32), value, zero, none)
            rows, nothing = (PolynomialSystem.stack([p], 1) for p in (x**9, 0.0 * x))
            bound = float(dual.evaluate(rows, np.ones(1, bool), nothing)[0])
            assert Fraction(bound) <= exact
            assert bound >= float(exact) * (1 + 1e-13)
