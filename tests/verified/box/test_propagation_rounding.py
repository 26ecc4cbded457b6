"""Which way propagation rounds, one function at a time: each end against exact rationals."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import (
    Rows,
    _allowed,
    _quadratic_range,
    _tighten_quadratics,
    box_rows,
    sweep,
)

INF = np.inf
LEAST = 2.0**-1074
ONE = np.zeros(1, np.int64)
x, y = sp.variables(2)


def interval(*ends):
    return Interval(np.array([low for low, _ in ends]), np.array([high for _, high in ends]))


def tightened(c1, c2, box, allowed):
    """What c1 x + c2 x^2 in ``allowed`` leaves of a box."""
    lo, hi = np.array([box[0]]), np.array([box[1]])
    given = np.array([c1]), np.array([c2])
    _tighten_quadratics(lo, hi, ONE, *given, interval(box), interval(allowed))
    return float(lo[0]), float(hi[0])


def value(c1, c2, point):
    """c1 x + c2 x^2 in rationals."""
    point = Fraction(point)
    return Fraction(c1) * point + Fraction(c2) * point**2


# ---- what a row leaves to an atom -------------------------------------------------------------


def test_targets_that_are_no_numbers_say_nothing():
    rows = Rows(PolynomialSystem.stack([x + y**2], 2), interval((np.nan, np.nan)))
    with np.errstate(invalid="ignore"):
        found = sweep(rows, interval((-1.0, 2.0), (-3.0, 4.0)))
    assert found.lo.tolist() == [-1.0, -3.0] and found.hi.tolist() == [2.0, 4.0]


def test_others_that_may_be_positive_are_not_zero():
    """x + y = 1 holds at (0, 1), though the least of y, 2^-1073, is rounded to 0."""
    row = np.zeros(2, np.int64)
    allowed = _allowed(row, interval((0.0, 1.0), (2 * LEAST, 1.0)), interval((1.0, 1.0)), 1)
    assert allowed.lo[0] <= 0.0
    allowed = _allowed(row, interval((-1.0, 0.0), (-1.0, -2 * LEAST)), interval((-1.0, -1.0)), 1)
    assert allowed.hi[0] >= 0.0


def test_the_target_less_the_others_is_rounded_outwards():
    """x + y >= -1 leaves x >= -1 - 2^-60 for y <= 2^-60, and the mirror image."""
    step = 2.0**-60
    row = np.zeros(2, np.int64)
    allowed = _allowed(row, interval((-9.0, 0.0), (0.0, step)), interval((-1.0, INF)), 1)
    assert Fraction(float(allowed.lo[0])) <= -1 - Fraction(step)
    allowed = _allowed(row, interval((0.0, 9.0), (-step, 0.0)), interval((-INF, 1.0)), 1)
    assert Fraction(float(allowed.hi[0])) >= 1 + Fraction(step)


# ---- the range of c1 x + c2 x^2 ---------------------------------------------------------------


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_vertex_between_two_doubles_lies_inside(side):
    """1e300 x^2 - 1e-300 x is least at 5e-601, between 0 and the smallest double, below 0."""
    c1, c2 = -side * 1e-300, 1e300
    box = (-1.0, LEAST) if side > 0 else (-LEAST, 1.0)
    found = _quadratic_range(np.array([c1]), np.array([c2]), interval(box))
    least = value(c1, c2, -Fraction(c1) / (2 * Fraction(c2)))
    assert least < 0 and Fraction(float(found.lo[0])) <= least


def test_the_value_at_the_vertex_is_rounded_outwards():
    """c1 x + c2 x^2 ranges from or to -c1^2 / (4 c2)."""
    rng = np.random.default_rng(1)
    c1, c2 = rng.uniform(-2, 2, (2, 200))
    found = _quadratic_range(c1, c2, Interval(np.full(200, -1e6), np.full(200, 1e6)))
    for k in range(200):
        extreme = -(Fraction(c1[k]) ** 2) / (4 * Fraction(c2[k]))
        assert Fraction(float(found.lo[k])) <= extreme <= Fraction(float(found.hi[k]))


# ---- solving c1 x + c2 x^2 in an interval -----------------------------------------------------


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_vertex_that_is_hardly_known_moves_no_solution(sign):
    """Twice 1e308 is infinite in doubles: the vertex is known to a tenth of its value only."""
    c1, c2 = sign * 1e150, 1e308
    vertex = -Fraction(c1) / (2 * Fraction(c2))
    low, high = tightened(c1, c2, (-1.0, 1.0), (-INF, 1.0))
    assert low < vertex < high
    assert value(c1, c2, low) >= 1 and value(c1, c2, high) >= 1
    low, high = tightened(c1, c2, (0.0, 1.0), (1.0, INF))
    assert vertex < low < high and value(c1, c2, low) <= 1
    low, high = tightened(c1, c2, (-1.0, 0.0), (1.0, INF))
    assert low < high < vertex and value(c1, c2, high) <= 1


def test_ends_of_parabolas_keep_every_solution():
    """The solutions of c1 x + c2 x^2 <= c, and those of >= c on each side of the vertex."""
    rng = np.random.default_rng(2)
    for c1, c2, ratio in rng.uniform(1, 2, (100, 3)).tolist():
        c = ratio * 2.0 ** float(rng.integers(-6, 7))
        low, high = tightened(c1, c2, (-1e9, 1e9), (-INF, c))
        assert value(c1, c2, low) >= c and value(c1, c2, high) >= c
        assert value(c1, c2, tightened(c1, c2, (0.0, 1e9), (c, INF))[0]) <= c
        assert value(c1, c2, tightened(c1, c2, (-1e9, -c1 / c2), (c, INF))[1]) <= c


# ---- squares below a cutoff -------------------------------------------------------------------


@pytest.mark.parametrize(
    "weight, constant, cutoff",
    [
        ("0x1.b5c07a00087d2p+0", "-0x1.f16cd619a9120p-6", "0x1.e91c4b88224c8p+0"),
        ("0x1.9d2944bb14c28p+0", "-0x1.6a0bb4a3df090p-3", "0x1.df560bbb9282cp+2"),
        ("0x1.cf795377c70dbp+0", "-0x1.c2b2d1d5e2a50p-5", "0x1.cc4077f1bb8e0p+0"),
        ("0x1.9c98e766fd474p+0", "0x1.0519c4160ec10p-11", "0x1.fd161a845beaap+0"),
    ],
)
def test_the_radius_of_a_square_is_rounded_up(weight, constant, cutoff):
    """w r^2 <= cutoff - constant, in rationals, where the nearest root is too small."""
    weight, constant, cutoff = map(float.fromhex, (weight, constant, cutoff))
    f = weight * x**2 + constant
    rows = box_rows(sp.Problem(f, squares=[(weight, x)]), cutoff)
    radius = Fraction(float(rows.target.hi[-1]))
    assert radius**2 * Fraction(weight) >= Fraction(cutoff) - Fraction(constant)
