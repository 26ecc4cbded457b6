"""Interval arithmetic against rationals of FLINT, on numbers of all sizes that cancel.

Operations are monotone in each argument on either side of zero, so corners and points in
between say whether an enclosure holds.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import scipy.sparse as sps
from flint import fmpq
from flint_oracle import (
    LARGEST,
    SMALLEST,
    at_most,
    between,
    cancelling,
    doubles,
    ends,
    fraction,
    inside,
    moderate,
    rational,
    real,
    shares,
    wild,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sparsepop_py.verified.arithmetic.interval import (
    Interval,
    applied,
    gram,
    matmul,
    sum_by,
)

quick = settings(max_examples=80, deadline=None)


def of(pair):
    return Interval(np.array([pair[0]]), np.array([pair[1]]))


def holds(interval, value, index=0):
    return inside(real(value), interval.lo[index], interval.hi[index])


# ---- elementwise ------------------------------------------------------------------------------


@given(ends(), ends(), shares, shares)
@quick
def test_sums_differences_and_products_hold_points_in_between(a, b, s, t):
    x, y = between(*a, s), between(*b, t)
    with np.errstate(all="ignore"):
        assert holds(of(a) + of(b), x + y)
        assert holds(of(a) - of(b), x - y)
        assert holds(of(a) * of(b), x * y)


@given(ends(), ends(), shares, shares)
@quick
def test_quotients_hold_points_in_between(a, b, s, t):
    y = between(*b, t)
    if y == 0:
        return
    with np.errstate(all="ignore"):
        assert holds(of(a) / of(b), between(*a, s) / y)


@given(ends(), st.integers(0, 12), shares)
@example((-SMALLEST, SMALLEST), 3, 1.0)
@example((-1e-200, -1e-200), 5, 0.0)
@example((0.5, 0.75), 12, 0.0)
@quick
def test_powers_hold_points_in_between(a, exponent, s):
    with np.errstate(all="ignore"):
        found = of(a).power(np.array([exponent]))
    assert holds(found, between(*a, s) ** exponent)
    for end in a:
        assert holds(found, rational(end) ** exponent)


def test_many_quotients_of_numbers_with_all_their_digits():
    """Two roundings of half an ulp each: only what is rounded twice outwards holds them."""
    rng = np.random.default_rng(3)
    a, b = rng.uniform(1, 2, 4000), rng.uniform(1, 2, 4000)
    found = Interval.point(a) / Interval.point(b)
    for k in range(a.size):
        exact = rational(a[k]) / rational(b[k])
        assert rational(found.lo[k]) <= exact <= rational(found.hi[k])


@pytest.mark.parametrize("value", [fmpq(10) ** 400, -(fmpq(10) ** 400), fmpq(2) ** 1024])
def test_rationals_beyond_all_doubles_have_an_infinite_end(value):
    found = Interval.of_fraction(fraction(value))
    assert inside(real(value), found.lo, found.hi)
    assert np.isinf(found.hi) == (value > 0) and np.isinf(found.lo) == (value < 0)


# ---- sums -------------------------------------------------------------------------------------


@given(st.one_of(cancelling(), cancelling(of=wild), st.lists(doubles, max_size=9)))
@quick
def test_sums_hold_what_cancels(terms):
    array = np.array(terms, float)
    with np.errstate(all="ignore"):
        found = sum_by(np.zeros(array.size, int), Interval.point(array), 1)
    assert holds(found, sum(map(rational, terms), fmpq(0)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [10, 1000, 30000])
def test_rounding_errors_of_one_sign_add_up(sign, count):
    """1 + 2^-53 is rounded to 1, however often: the error grows with the number of terms."""
    terms = sign * np.append(1.0, np.full(count, 2.0**-53))
    found = sum_by(np.zeros(count + 1, int), Interval.point(terms), 1)
    assert holds(found, fmpq(int(sign)) * (1 + fmpq(count, 2**53)))


def test_pairs_are_sums_too():
    """Of two terms one is lost altogether, in either direction."""
    for sign in (1.0, -1.0):
        found = sum_by(np.zeros(2, int), Interval.point([1.0, sign * 1e-30]), 1)
        assert holds(found, 1 + rational(sign * 1e-30))


# ---- products of matrices ---------------------------------------------------------------------


@given(st.data())
@quick
def test_grams_hold_what_cancels(data):
    width = data.draw(st.integers(1, 6))
    kind = data.draw(st.sampled_from([moderate, doubles]))
    rows = [data.draw(st.lists(kind, min_size=width, max_size=width)) for _ in range(3)]
    rows[1] = [-v for v in rows[0][:-1]] + [rows[0][-1]]  # its products with row 0 cancel
    with np.errstate(all="ignore"):
        found = gram(np.array([rows]))
    for i, j in product(range(3), repeat=2):
        exact = sum(
            (rational(a) * rational(b) for a, b in zip(rows[i], rows[j], strict=True)), fmpq(0)
        )
        assert inside(real(exact), found.lo[0, i, j], found.hi[0, i, j])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_grams_of_long_rows_whose_errors_add_up(sign):
    """Each product 2^-53 is lost beside the first, 1: together they are 2000 times that."""
    first = np.append(1.0, np.full(2000, 2.0**-26))
    second = sign * np.append(1.0, np.full(2000, 2.0**-27))
    found = gram(np.stack([first, second])[None])
    exact = rational(sign) * (1 + fmpq(2000, 2**53))
    assert inside(real(exact), found.lo[0, 0, 1], found.hi[0, 0, 1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_grams_of_rows_whose_products_underflow(sign):
    """64 products of 2^-1076 are 2^-1070, and each of them is rounded to 0."""
    rows = 2.0**-538 * np.ones((2, 64))
    rows[1] *= sign
    found = gram(rows[None])
    assert inside(real(rational(sign) * fmpq(2) ** -1070), found.lo[0, 0, 1], found.hi[0, 0, 1])


def test_grams_that_overflow_are_not_known():
    found = gram(np.array([[[1e200, 1.0], [1e200, -1e200]]]))
    assert found.lo[0, 0, 0] == -np.inf and found.hi[0, 0, 0] == np.inf
    assert inside(
        real(rational(1e200) ** 2 - rational(1e200)), found.lo[0, 0, 1], found.hi[0, 0, 1]
    )


def corners_of_a_product(a, b):
    """The exact range of each entry of a product of interval matrices, term by term."""
    rows, inner, columns = a.lo.shape[0], a.lo.shape[1], b.lo.shape[1]
    for i, j in product(range(rows), range(columns)):
        low, high = fmpq(0), fmpq(0)
        for k in range(inner):
            values = [
                rational(x) * rational(y)
                for x, y in product((a.lo[i, k], a.hi[i, k]), (b.lo[k, j], b.hi[k, j]))
            ]
            low, high = low + min(values), high + max(values)
        yield (i, j), low, high


@given(st.data())
@quick
def test_products_of_interval_matrices_hold_their_corners(data):
    shape = data.draw(st.tuples(st.integers(1, 2), st.integers(1, 4), st.integers(1, 2)))
    kind = data.draw(st.sampled_from([moderate, doubles]))

    def matrix(rows, columns):
        pairs = [data.draw(ends(of=kind)) for _ in range(rows * columns)]
        low, high = np.array(pairs).T.reshape(2, rows, columns)
        return Interval(low, high)

    a, b = matrix(shape[0], shape[1]), matrix(shape[1], shape[2])
    with np.errstate(all="ignore"):
        found = matmul(a, b)
    for place, low, high in corners_of_a_product(a, b):
        assert inside(real(low), found.lo[place], found.hi[place])
        assert inside(real(high), found.lo[place], found.hi[place])


def test_wide_intervals_around_zero_multiply_their_radii():
    """[-1, 1] [-1, 1] and [0, 2] [-1, 1]."""
    a = Interval(np.array([[-1.0], [0.0]]), np.array([[1.0], [2.0]]))
    b = Interval(np.array([[-1.0]]), np.array([[1.0]]))
    found = matmul(a, b)
    assert np.all(found.lo.ravel() <= [-1.0, -2.0]) and np.all(found.hi.ravel() >= [1.0, 2.0])
    assert np.all(found.hi.ravel() <= np.array([1.0, 2.0]) * (1 + 1e-14))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_long_products_of_points_whose_errors_add_up(sign):
    a = Interval.point(np.append(1.0, np.full(4000, 2.0**-26))[None])
    b = Interval.point(sign * np.append(1.0, np.full(4000, 2.0**-27))[:, None])
    found = matmul(a, b)
    exact = rational(sign) * (1 + fmpq(4000, 2**53))
    assert inside(real(exact), found.lo[0, 0], found.hi[0, 0])


def test_products_that_cancel_keep_the_error_of_their_terms():
    """(1 + e)(1 - e) - 1 = -e^2 with e = 2^-27 is lost in doubles."""
    e = 2.0**-27
    a, b = Interval.point(np.array([[1 + e, -1.0]])), Interval.point(np.array([[1 - e], [1.0]]))
    found = matmul(a, b)
    assert inside(real(-(fmpq(2) ** -54)), found.lo[0, 0], found.hi[0, 0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_products_that_underflow_keep_their_sign(sign):
    a = Interval.point(np.full((1, 64), 2.0**-538))
    found = matmul(a, Interval.point(sign * np.full((64, 1), 2.0**-538)))
    assert inside(real(rational(sign) * fmpq(2) ** -1070), found.lo[0, 0], found.hi[0, 0])


def test_products_that_overflow_are_not_known():
    with np.errstate(all="ignore"):
        found = matmul(Interval.point([[LARGEST, 1.0]]), Interval.point([[2.0], [1.0]]))
        wide = matmul(Interval(np.array([[-np.inf]]), np.array([[1.0]])), Interval.point([[1.0]]))
    for each in (found, wide):
        assert each.lo[0, 0] == -np.inf and each.hi[0, 0] == np.inf


@given(ends(), shares, st.floats(-10, 10))
@quick
def test_radii_reach_all_points_from_the_middle_and_elsewhere(pair, share, elsewhere):
    point = between(*pair, share)
    with np.errstate(all="ignore"):
        interval = of(pair)
        for centre in (interval.middle()[0], elsewhere):
            if np.isfinite(centre):
                away = point - rational(centre)
                reach = interval.radius(np.array([centre]))[0]
                assert at_most(real(max(away, -away)), float(reach))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_radii_are_rounded_up(sign):
    """1 + 2^-60 is 1 in doubles; the other end is nearer."""
    pair = sorted([sign, -sign * 2.0**-61])
    (reach,) = of(pair).radius(np.array([-sign * 2.0**-60]))
    assert rational(reach) >= 1 + fmpq(2) ** -60


# ---- matrices of numbers and vectors -----------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.sampled_from([0, 6, 300, 500]))
@quick
def test_applied_matrices_hold_the_products_of_points_in_between(seed, size, spread):
    """Ends of all signs and sizes; sparse matrices give the same as dense ones."""
    rng = np.random.default_rng(seed)
    matrix = np.ldexp(rng.normal(size=(3, size)), rng.integers(-spread, spread + 1, (3, size)))
    matrix[rng.random((3, size)) < 0.3] = 0.0
    low = np.ldexp(rng.normal(size=size), rng.integers(-spread, spread + 1, size))
    high = low + rng.choice([0.0, 1.0, 1e-9], size) * np.abs(low)
    share = [fmpq(int(rng.integers(0, 9)), 8) for _ in range(size)]
    x = [between(*ends, t) for *ends, t in zip(low, high, share, strict=True)]
    vector = Interval(low, high)
    sparse = applied(sps.csr_array(matrix), vector)
    for found in (applied(matrix, vector), sparse):
        for k in range(3):
            exact = sum((rational(a) * v for a, v in zip(matrix[k], x, strict=True)), fmpq(0))
            assert holds(found, exact, k)


@pytest.mark.parametrize("kind", [np.array, sps.csr_array])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_applied_matrices_keep_what_doubles_lose(kind, sign):
    """Errors that add up, terms that cancel, and products that underflow."""
    long = applied(
        kind(np.append(1.0, np.full(4000, 2.0**-26))[None]),
        Interval.point(sign * np.append(1.0, np.full(4000, 2.0**-27))),
    )
    assert holds(long, rational(sign) * (1 + fmpq(4000, 2**53)))
    e = 2.0**-27
    lost = applied(kind(np.array([[1 + e, -1.0]])), Interval.point(sign * np.array([1 - e, 1.0])))
    assert holds(lost, -rational(sign) * fmpq(2) ** -54)
    tiny = np.full(64, 2.0**-538)
    assert holds(
        applied(kind(tiny[None]), Interval.point(sign * tiny)), rational(sign) * fmpq(2) ** -1070
    )
    wide = applied(kind(np.array([[sign, 2.0]])), Interval(np.array([-1.0, 0.0]), np.ones(2)))
    assert wide.lo[0] <= -1.0 and wide.hi[0] >= 3.0
    assert max(-wide.lo[0] - 1.0, wide.hi[0] - 3.0) <= 1e-14


def test_applied_matrices_that_overflow_are_not_known():
    cases = [
        applied(np.array([[LARGEST, 1.0]]), Interval.point([2.0, 1.0])),
        applied(np.array([[1.0]]), Interval(np.array([-np.inf]), np.array([1.0]))),
        applied(np.array([[np.inf, 1.0]]), Interval.point([0.0, 1.0])),
    ]
    for each in cases:
        assert each.lo[0] == -np.inf and each.hi[0] == np.inf
