"""Propagation against exact values of FLINT: a feasible point is never lost, whatever its size.

Each row is a polynomial and the two doubles around its exact value at the point, so that the
point lies on the boundary of what the row allows and every rounding counts.
"""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb
from flint_oracle import (
    at_most,
    fraction,
    inside,
    moderate,
    rational,
    real,
    value_at,
    wild,
)
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import Rows, is_empty, sweep

N = 2
quick = settings(max_examples=60, deadline=None)
few = settings(max_examples=25, deadline=None)
exponents = st.tuples(st.integers(0, 4), st.integers(0, 2)).filter(any)
numbers = st.one_of(moderate, wild)
INF = np.inf


def rows_around(tables, x, slack=(0, 0)):
    """Rows that the point x satisfies exactly at an end, or between the neighbouring doubles."""
    polynomials, low, high = [], [], []
    for table in tables:
        exact = value_at(table, [rational(v) for v in x])
        around = Interval.of_fraction(fraction(exact))
        low.append(-INF if slack[0] else float(around.lo))
        high.append(INF if slack[1] else float(around.hi))
        polynomials.append(Polynomial.from_terms(np.array(list(table)), list(table.values())))
    system = PolynomialSystem.stack(polynomials, N)
    return Rows(system, Interval(np.array(low), np.array(high)))


def kept(rows, x, low, high, times=4):
    box = Interval(np.array(low, float), np.array(high, float))
    with np.errstate(all="ignore"):
        for _ in range(times):
            box = sweep(rows, box)
            assert not is_empty(box)
            for v in range(N):
                assert inside(real(x[v]), box.lo[v], box.hi[v])
    return box


def tables(of):
    return st.dictionaries(exponents, of.filter(bool), min_size=1, max_size=4)


def around(x, widths, shape):
    """Boxes in which the point is an end or lies inside; endless where a width is infinite."""
    low = [v - w if s != 0 else v for v, w, s in zip(x, widths, shape, strict=True)]
    high = [v + w if s != 2 else v for v, w, s in zip(x, widths, shape, strict=True)]
    return low, high


widths = st.one_of(st.sampled_from([0.0, 1e-8, 1.0, INF]), moderate.map(abs))
shapes = st.tuples(st.integers(0, 2), st.integers(0, 2))
slacks = st.sampled_from([(0, 0), (0, 0), (1, 0), (0, 1)])


@given(
    st.lists(tables(numbers), min_size=1, max_size=2),
    st.tuples(numbers, numbers),
    st.tuples(widths, widths),
    shapes,
    slacks,
)
@example([{(2, 0): 1e-200, (1, 0): 1e200}], (1.0, 0.0), (INF, 0.0), (1, 1), (0, 0))
@quick
def test_a_point_on_the_boundary_of_every_row_stays(given_, x, width, shape, slack):
    low, high = around(x, width, shape)
    kept(rows_around(given_, x, slack), x, low, high)


@given(
    moderate.filter(bool),
    moderate.filter(bool),
    moderate,
    moderate.filter(bool),
    moderate,
    st.tuples(widths, widths),
    shapes,
    slacks,
)
@quick
def test_points_on_parabolas_stay(c2, c1, x, other, y, width, shape, slack):
    """c2 x^2 + c1 x + other y: x is a root of the square that is completed."""
    table = {(2, 0): c2, (1, 0): c1, (0, 1): other}
    low, high = around((x, y), width, shape)
    kept(rows_around([table], (x, y), slack), (x, y), low, high)


@given(st.data())
@few
def test_points_at_the_edge_of_the_gap_of_a_parabola_stay(data):
    """c2 x^2 + c1 x at least (or at most) its value at x, over boxes on either side."""
    digits = st.integers(2**52, 2**53)
    c2, c1, x = (
        float(np.ldexp(float(data.draw(digits)), data.draw(st.integers(-60, -40))))
        * data.draw(st.sampled_from([1.0, -1.0]))
        for _ in range(3)
    )
    table = {(2, 0): c2, (1, 0): c1}
    for slack in ((1, 0), (0, 1), (0, 0)):
        rows = rows_around([table], (x, 0.0), slack)
        for low, high in ((x, INF), (-INF, x), (x - 1e-3, x), (x, x + 1e-3), (-INF, INF)):
            kept(rows, (x, 0.0), [low, 0.0], [high, 0.0], times=2)


@given(st.integers(2, 9), numbers.filter(bool), numbers.filter(bool), shapes, slacks)
@few
def test_points_at_the_end_of_powers_stay(power, coefficient, x, shape, slack):
    """c x^p at most its value at x."""
    rows = rows_around([{(power, 0): coefficient}], (x, 0.0), slack)
    for width in (0.0, abs(x), INF):
        low, high = around((x, 0.0), (width, 0.0), shape)
        kept(rows, (x, 0.0), low, high)


@given(
    st.lists(moderate.filter(bool), min_size=2, max_size=2),
    st.tuples(moderate, moderate),
    st.tuples(st.integers(0, 1), st.integers(0, 1)),
)
@few
def test_products_with_factors_that_touch_zero_keep_their_points(c, x, sides):
    """c x y over boxes of which a factor begins or ends at zero."""
    low = [min(v, 0.0) if s else v - 1.0 for v, s in zip(x, sides, strict=True)]
    high = [max(v, 0.0) if s else v + 1.0 for v, s in zip(x, sides, strict=True)]
    for table in ({(1, 1): c[0]}, {(1, 2): c[0], (1, 0): c[1]}, {(2, 1): c[0], (0, 1): c[1]}):
        for slack in ((0, 0), (1, 0), (0, 1)):
            kept(rows_around([table], x, slack), x, low, high)
        for target in ((0.0, abs(c[1])), (-abs(c[1]), 0.0)):
            exact = value_at(table, [rational(v) for v in x])
            if rational(target[0]) <= exact <= rational(target[1]):
                given_ = rows_around([table], x)
                ends = Interval(np.array([target[0]]), np.array([target[1]]))
                kept(Rows(given_.system, ends), x, low, high)


@given(st.lists(moderate, min_size=3, max_size=3), st.integers(-3, 3))
@few
def test_sums_that_cancel_keep_their_points(c, steps):
    """a x + b y with b y nearly the opposite of a x, over narrow and endless boxes."""
    a, b, x = c
    assume(a and b and x)
    y = -a * x / b
    assume(1e-100 < abs(y) < 1e100)
    y = float(y + steps * np.spacing(y))
    table = {(1, 0): a, (0, 1): b}
    for low, high in (
        ([-INF, y], [INF, y]),
        ([x, -INF], [x, INF]),
        ([x - abs(x), y - abs(y)], [x + abs(x), y + abs(y)]),
    ):
        kept(rows_around([table], (x, y)), (x, y), low, high)


# ---- roots that are no rationals --------------------------------------------------------------


@pytest.mark.parametrize("power", [2, 3, 4, 7])
def test_the_roots_of_doubles_lie_in_the_box(power):
    """x^p <= v: the box ends at the root or beyond, and hardly beyond."""
    rng = np.random.default_rng(power)
    (x, _) = sp.variables(2)
    system = PolynomialSystem.stack([x**power], N)
    for value in [
        2.0,
        5e-324,
        1e-300,
        1e300,
        *rng.uniform(1, 2, 100),
        *10 ** rng.uniform(-9, 9, 50),
    ]:
        rows = Rows(system, Interval(np.array([-INF]), np.array([value])))
        box = sweep(rows, Interval(np.array([0.0, 0.0]), np.array([INF, 0.0])))
        root = real(value).root(power)
        assert at_most(root, float(box.hi[0]))
        if 1e-9 < value < 1e9:
            assert at_most(float(box.hi[0]), root * arb("1.00000000000001"))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_both_roots_of_quadratics_lie_in_the_box(sign):
    """sign (a x^2 + b x - c) <= 0 or >= 0 from nothing, and over boxes right or left of the gap."""
    rng = np.random.default_rng(5)
    (x, _) = sp.variables(2)
    for a, b, c in rng.uniform(1, 2, (60, 3)):
        b *= 10.0 ** rng.integers(-2, 4)
        system = PolynomialSystem.stack([sign * (a * x**2 + b * x) - sign * c], N)
        disc = real(b) ** 2 + 4 * real(a) * real(c)
        roots = [(-real(b) + s * disc.sqrt()) / (2 * real(a)) for s in (-1, 1)]
        ends = (-INF, 0.0) if sign > 0 else (0.0, INF)
        inner = Rows(system, Interval(np.array(ends[:1]), np.array(ends[1:])))
        box = sweep(inner, Interval(np.array([-INF, 0.0]), np.array([INF, 0.0])))
        assert at_most(float(box.lo[0]), roots[0]) and at_most(roots[1], float(box.hi[0]))
        assert box.hi[0] - box.lo[0] <= float((roots[1] - roots[0]).mid()) * (1 + 1e-9)
        ends = (0.0, INF) if sign > 0 else (-INF, 0.0)
        outer = Rows(system, Interval(np.array(ends[:1]), np.array(ends[1:])))
        middle = -b / (2 * a)
        right = sweep(outer, Interval(np.array([middle, 0.0]), np.array([middle + 1e6, 0.0])))
        left = sweep(outer, Interval(np.array([middle - 1e6, 0.0]), np.array([middle, 0.0])))
        assert at_most(float(right.lo[0]), roots[1]) and at_most(roots[0], float(left.hi[0]))
        # one double inside the gap belongs to the right branch as well
        near = float(np.nextafter(float(roots[0].mid()), INF))
        while at_most(near, roots[0]):
            near = float(np.nextafter(near, INF))
        begin = sweep(outer, Interval(np.array([near, 0.0]), np.array([middle + 1e6, 0.0])))
        assert at_most(float(begin.lo[0]), roots[1])
        before = float(np.nextafter(near, -INF))
        if at_most(before, roots[0]):
            begin = sweep(outer, Interval(np.array([before, 0.0]), np.array([1e6, 0.0])))
            assert begin.lo[0] <= before
