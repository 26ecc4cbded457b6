"""Intervals of single numbers against rationals of FLINT, on numbers of all sizes."""

from __future__ import annotations

from math import inf

from flint_oracle import LARGEST, SMALLEST, between, doubles, ends, inside, rational, real, shares
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sparsepop_py.verified.arithmetic.scalar_interval import (
    meet,
    odd_root,
    plus,
    power,
    product,
    quotient,
    sum_of,
    times,
)

quick = settings(max_examples=100, deadline=None)


def holds(pair, value):
    return inside(real(value), float(pair[0]), float(pair[1]))


@given(ends(), ends(), ends(), shares, shares, shares)
@quick
def test_sums_and_products_hold_points_in_between(a, b, c, s, t, u):
    x, y, z = between(*a, s), between(*b, t), between(*c, u)
    assert holds(plus(a, b), x + y)
    assert holds(sum_of([a, b, c]), x + y + z)
    assert holds(times(a, b), x * y)
    assert holds(product([a, b, c]), x * y * z)
    assert product([a]) == a and product([]) == (1.0, 1.0) and sum_of([]) == (0.0, 0.0)


@given(ends(), ends(), shares, shares)
@example((1.0, 1.0), (SMALLEST, SMALLEST), 0.0, 0.0)
@example((1.0, 1.0), (-LARGEST, -LARGEST), 0.0, 0.0)
@quick
def test_quotients_hold_points_in_between(a, b, s, t):
    y = between(*b, t)
    if y != 0:
        assert holds(quotient(a, b), between(*a, s) / y)


@given(ends(), doubles)
@quick
def test_divisors_that_hold_zero_bound_nothing(a, b):
    for divisor in ((0.0, abs(b)), (-abs(b), 0.0), (-abs(b), abs(b)), (-0.0, abs(b)), (2.0, 1.0)):
        assert quotient(a, divisor) == (-inf, inf)


@given(ends(), st.integers(-4, 7), shares)
@example((-2.0, 1.0), 2, 0.0)
@example((-1.0, 2.0), 3, 0.0)
@example((0.5, 0.75), -3, 1.0)
@quick
def test_powers_hold_points_in_between(a, exponent, s):
    x = between(*a, s)
    if x == 0 and exponent < 0:
        return
    assert holds(power(a, exponent), x**exponent)


@given(ends(), ends(), doubles)
@quick
def test_intersections_hold_exactly_the_common_points(a, b, x):
    common = a[0] <= x <= a[1] and b[0] <= x <= b[1]
    low, high = meet(a, b)
    assert (low <= x <= high) == common


@given(ends(), st.sampled_from([1, 3, 5, 9]), shares)
@example((0.001953125, 1.0), 9, 0.0)  # 1/2, a root that is a double
@quick
def test_odd_roots_hold_every_root(a, degree, s):
    low, high = odd_root(a, degree)
    x = between(*a, s)
    assert rational(low) ** degree <= rational(a[0])
    assert rational(low) ** degree <= x <= rational(high) ** degree
    assert rational(high) ** degree >= rational(a[1])


def test_half_lines():
    line = (2.0, inf)
    assert plus(line, (1.0, 1.0))[1] == inf and plus(line, (1.0, 1.0))[0] <= 3.0
    assert times(line, (-1.0, 0.0))[0] == -inf and times(line, (-1.0, 0.0))[1] >= 0.0
    low, high = times((0.0, 0.0), (-inf, inf))
    assert low <= 0.0 <= high <= SMALLEST and low >= -SMALLEST
    low, high = quotient((1.0, 1.0), line)
    assert low <= 0.0 and 0.5 <= high <= 0.5 * (1 + 1e-15)
    assert odd_root((-inf, inf), 3) == (-inf, inf)
