"""Verified arithmetic: every enclosure holds the exact rational result.

Interval operations are monotone in each argument on either side of zero, so the exact
range of an operation over finite boxes is the hull of its values at the corners (and 0
for even powers across zero); it is computed here in Fractions.
"""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from sparsepop_py.verified.arithmetic import interval as rounding
from sparsepop_py.verified.arithmetic.interval import Interval, exact_values, gram, sum_by

LARGEST = float(np.finfo(float).max)
SMALLEST = 5e-324

special = st.sampled_from(
    [0.0, -0.0, 1.0, -1.0, SMALLEST, -SMALLEST, 2.0**-1022, 1e-200, -1e200, 1e308, -LARGEST]
    + [0.1, -0.3, 1 + 2.0**-52, 1e16, 3.0, LARGEST]
)
doubles = st.one_of(special, st.floats(allow_nan=False, allow_infinity=False), st.floats(-10, 10))
moderate = st.one_of(
    st.floats(-1e6, 1e6), st.sampled_from([0.0, SMALLEST, -SMALLEST, 1e-200, 0.1, -1e16, 1e100])
)


@st.composite
def intervals(draw, of=doubles):
    a, b = draw(of), draw(of)
    return Interval(np.array([min(a, b)]), np.array([max(a, b)]))


def inside(value, low, high):
    """low <= value <= high with infinite ends, exactly."""
    above = low == -np.inf or (np.isfinite(low) and Fraction(float(low)) <= value)
    below = high == np.inf or (np.isfinite(high) and value <= Fraction(float(high)))
    return bool(above and below)


def holds(interval, value, index=0):
    return inside(value, interval.lo[index], interval.hi[index])


def corners(interval):
    return [Fraction(float(interval.lo[0])), Fraction(float(interval.hi[0]))]


# ---- elementwise operations --------------------------------------------------------------


@given(doubles, st.integers(-30, 30))
@settings(deadline=None)
def test_down_and_up_step_outward(x, _):
    with np.errstate(over="ignore", under="ignore"):
        assert rounding.down(x) < x < rounding.up(x)


@given(intervals(), intervals())
@settings(deadline=None)
def test_sums_and_differences_hold_every_exact_result(a, b):
    for x, y in product(corners(a), corners(b)):
        assert holds(a + b, x + y)
        assert holds(a - b, x - y)
    assert holds(-a, -corners(a)[0])
    assert holds(-a, -corners(a)[1])


@given(intervals(), intervals())
@example(Interval(np.array([SMALLEST]), np.array([SMALLEST])), Interval.point([0.25]))
@example(Interval.point([1e300]), Interval.point([-1e300]))
@settings(deadline=None)
def test_products_hold_every_exact_result(a, b):
    with np.errstate(over="ignore"):
        result = a * b
    for x, y in product(corners(a), corners(b)):
        assert holds(result, x * y)


@given(intervals(), intervals())
@example(Interval.point([1.0]), Interval.point([SMALLEST]))
@example(Interval.point([1.0]), Interval.point([-LARGEST]))
@settings(deadline=None)
def test_quotients_hold_every_exact_result(a, b):
    assume(b.lo[0] > 0 or b.hi[0] < 0)
    with np.errstate(over="ignore"):
        result = a / b
    for x, y in product(corners(a), corners(b)):
        assert holds(result, x / y)


@given(
    intervals(), st.sampled_from([(-1.0, 2.0), (0.0, 2.0), (-1.0, 0.0), (0.0, 0.0), (-0.0, 1.0)])
)
@settings(deadline=None)
def test_division_by_an_interval_with_zero_gives_the_whole_line(a, ends):
    quotient = a / Interval(np.array([ends[0]]), np.array([ends[1]]))
    assert quotient.lo[0] == -np.inf
    assert quotient.hi[0] == np.inf


@given(intervals(), st.integers(0, 9))
@example(Interval(np.array([-2.0]), np.array([1.0])), 2)
@example(Interval(np.array([-1e-300]), np.array([1e-200])), 3)
@example(Interval(np.array([0.0]), np.array([SMALLEST])), 4)
@settings(deadline=None)
def test_powers_hold_every_exact_result(a, exponent):
    with np.errstate(over="ignore"):
        result = a.power(np.array([exponent]))
    low, high = corners(a)
    values = [low**exponent, high**exponent]
    if low <= 0 <= high:
        values.append(Fraction(0) ** exponent)
    for value in values:
        assert holds(result, value)
    if exponent % 2 == 0:
        assert result.lo[0] >= 0.0


def test_power_zero_is_one_even_of_zero_and_of_the_whole_line():
    a = Interval(np.array([0.0, -np.inf, -1.0]), np.array([0.0, np.inf, 3.0]))
    result = a.power(np.zeros(3, int))
    assert result.lo.tolist() == result.hi.tolist() == [1.0, 1.0, 1.0]


def test_powers_of_infinite_intervals():
    inf = np.inf
    a = Interval(np.array([-inf, 2.0, -inf, -inf]), np.array([inf, inf, -2.0, 1.0]))
    even, odd = a.power(np.full(4, 2)), a.power(np.full(4, 3))
    assert even.lo[[0, 3]].tolist() == [0.0, 0.0]
    assert np.all((3.9 < even.lo[1:3]) & (even.lo[1:3] <= 4.0))
    assert even.hi.tolist() == [inf] * 4
    assert odd.lo[[0, 2, 3]].tolist() == [-inf] * 3
    assert odd.hi[[0, 1]].tolist() == [inf, inf]
    assert 7.9 < odd.lo[1] <= 8.0
    assert -8.0 <= odd.hi[2] < -7.9
    assert 1.0 <= odd.hi[3] < 1.1


@given(intervals(), doubles, doubles)
@settings(deadline=None)
def test_half_lines_hold_the_products_and_sums_of_their_points(a, start, step):
    """[start, inf) times and plus a, judged at the rational point start + |step|."""
    line = Interval(np.array([start]), np.array([np.inf]))
    x = Fraction(start) + abs(Fraction(step))
    with np.errstate(over="ignore"):
        total, times, negative = line + a, line * a, (-line) * a
    for y in corners(a):
        assert holds(total, x + y)
        assert holds(times, x * y)
        assert holds(negative, -x * y)


def test_zero_times_infinity_is_exactly_zero():
    whole = Interval(np.array([-np.inf]), np.array([np.inf]))
    zero = Interval.point([0.0])
    for result in (whole * zero, zero * whole):
        assert result.lo[0] == 0.0
        assert result.hi[0] == 0.0


def joined(*parts):
    return Interval(np.concatenate([p.lo for p in parts]), np.concatenate([p.hi for p in parts]))


@given(intervals(), intervals())
@settings(deadline=None)
def test_parts_of_intervals_have_both_ends(a, b):
    both = joined(a, b)
    for part, whole in ((both[np.array([1])], b), (both[:1], a)):
        assert part.lo.tolist() == whole.lo.tolist()
        assert part.hi.tolist() == whole.hi.tolist()


COMPANY = [
    (Interval.point([0.0]), Interval(np.array([-np.inf]), np.array([np.inf]))),
    (Interval.point([1e-300]), Interval.point([-1e-300])),
    (Interval.point([0.0]), Interval.point([2.0])),
]


@given(intervals(), intervals())
@settings(deadline=None)
def test_products_do_not_depend_on_those_beside_them(a, b):
    alone = a * b
    for x, y in COMPANY:
        beside = joined(a, x) * joined(b, y)
        assert (beside.lo[0], beside.hi[0]) == (alone.lo[0], alone.hi[0])
        exact = Fraction(float(x.lo[0])) * Fraction(float(y.lo[0])) if y.lo[0] > -np.inf else 0
        assert holds(beside, exact, 1)


@given(doubles, intervals())
@settings(deadline=None)
def test_products_of_points_are_those_of_their_ends(x, b):
    point, ends = Interval.point([x]), Interval(np.array([x]), np.array([x]))
    for one, other in ((point * b, ends * b), (b * point, b * ends)):
        assert one.lo[0] == other.lo[0]
        assert one.hi[0] == other.hi[0]
        assert holds(one, Fraction(x) * corners(b)[0])
        assert holds(one, Fraction(x) * corners(b)[1])


@given(st.lists(st.tuples(intervals(of=moderate), st.integers(0, 4)), min_size=1, max_size=6))
@settings(deadline=None)
def test_mixed_powers_are_those_of_each_alone(entries):
    base = joined(*(each for each, _ in entries))
    found = base.power(np.array([power for _, power in entries]))
    for number, (each, power) in enumerate(entries):
        alone = each.power(np.array([power]))
        assert (found.lo[number], found.hi[number]) == (alone.lo[0], alone.hi[0])
        for x in corners(each):
            assert holds(found, x**power, number)


@given(doubles)
@settings(deadline=None)
def test_products_with_zero_and_negation_stay_exact(x):
    zero = Interval.point([0.0]) * Interval.point([x])
    assert zero.lo[0] == zero.hi[0] == 0.0
    assert (-Interval.point([x])).lo[0] == -x


@given(intervals())
@settings(deadline=None)
def test_magnitude_width_and_middle(a):
    low, high = corners(a)
    assert Fraction(float(a.magnitude()[0])) == max(abs(low), abs(high))
    try:
        assert float(a.width()[0]) == float(high - low)
    except OverflowError:  # of Fraction's conversion
        assert a.width()[0] == np.inf
    assert holds(a, Fraction(float(a.middle()[0]))) or high - low <= Fraction(SMALLEST)


@given(intervals(), intervals(), doubles)
@settings(deadline=None)
def test_intersections_hold_exactly_the_common_points(a, b, x):
    value = Fraction(x)
    assert holds(a.intersect(b), value) == (holds(a, value) and holds(b, value))


@given(st.fractions() | st.builds(Fraction, st.integers(), st.integers(1, 10**40)))
@example(Fraction(1, 3))
@example(Fraction(1, 10**400))
@example(-Fraction(1, 10**400))
@example(Fraction(3, 2**1074))
@example(Fraction(LARGEST))
@settings(deadline=None)
def test_fractions_are_enclosed_by_neighbouring_doubles(value):
    assume(abs(value) <= Fraction(LARGEST))
    found = Interval.of_fraction(value)
    low, high = float(found.lo), float(found.hi)
    assert Fraction(low) <= value <= Fraction(high)
    assert low == high or np.nextafter(low, np.inf) == high


# ---- sums --------------------------------------------------------------------------------


@given(st.lists(st.tuples(st.integers(0, 3), intervals(of=moderate)), max_size=25))
@settings(max_examples=80, deadline=None)
def test_sums_by_index_hold_the_exact_sums(entries):
    index = np.array([i for i, _ in entries], int)
    low = np.array([t.lo[0] for _, t in entries], float)
    high = np.array([t.hi[0] for _, t in entries], float)
    sums = sum_by(index, Interval(low, high), 5)
    for k in range(5):
        mine = np.flatnonzero(index == k)
        least = sum((Fraction(v) for v in low[mine].tolist()), Fraction(0))
        most = sum((Fraction(v) for v in high[mine].tolist()), Fraction(0))
        assert holds(sums, least, k)
        assert holds(sums, most, k)
        if mine.size <= 1:
            assert Fraction(float(sums.lo[k])) == least
            assert Fraction(float(sums.hi[k])) == most


def test_sums_that_cancel_hold_what_floating_point_loses():
    terms = np.array([1e16, 1.0, -1e16, 2.0**-60])
    sums = sum_by(np.zeros(4, int), Interval.point(terms), 1)
    assert holds(sums, 1 + Fraction(2) ** -60)


def test_sums_of_many_terms_hold_the_exact_sum_and_stay_narrow():
    rng = np.random.default_rng(1)
    terms = rng.normal(size=5000)
    sums = sum_by(np.zeros(5000, int), Interval.point(terms), 1)
    exact = sum(map(Fraction, terms.tolist()), Fraction(0))
    assert holds(sums, exact)
    assert sums.hi[0] - sums.lo[0] < 1e-8


def test_infinite_ends_stay_infinite_in_sums():
    low, high = np.array([-np.inf, 1.0, 2.0]), np.array([0.0, 1.0, np.inf])
    sums = sum_by(np.array([0, 0, 1]), Interval(low, high), 2)
    assert sums.lo[0] == -np.inf
    assert holds(sums, Fraction(1))
    assert sums.lo[1] == 2.0
    assert sums.hi[1] == np.inf


@pytest.mark.parametrize(
    "terms", [[LARGEST, LARGEST], [1.5e308, 1.5e308, -1.7e308], [-LARGEST, -LARGEST, LARGEST]]
)
def test_sums_whose_partial_sums_overflow_still_hold_the_exact_sum(terms):
    sums = sum_by(np.zeros(len(terms), int), Interval.point(terms), 1)
    assert holds(sums, sum(map(Fraction, terms), Fraction(0)))


def test_products_at_the_end_of_the_doubles_do_not_warn():
    result = Interval.point([1.0]) * Interval.point([LARGEST])
    assert holds(result, Fraction(LARGEST))


# ---- Gram matrices -----------------------------------------------------------------------


@given(
    st.integers(1, 3).flatmap(
        lambda r: st.lists(
            st.lists(st.lists(moderate, min_size=r, max_size=r), min_size=2, max_size=2),
            min_size=1,
            max_size=3,
        )
    )
)
@settings(max_examples=60, deadline=None)
def test_gram_holds_the_exact_product(blocks):
    enclosure = gram(np.array(blocks, float))
    for k, rows in enumerate(blocks):
        for i, a in enumerate(rows):
            for j, b in enumerate(rows):
                exact = sum(Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True))
                assert inside(exact, enclosure.lo[k, i, j], enclosure.hi[k, i, j])


def test_gram_of_a_large_factor_holds_the_exact_product():
    rng = np.random.default_rng(2)
    factor = rng.normal(size=(1, 3, 200)) * 10.0 ** rng.integers(-9, 9, size=(1, 3, 200))
    enclosure = gram(factor)
    rows = [[Fraction(v) for v in row] for row in factor[0].tolist()]
    for i in range(3):
        for j in range(3):
            exact = sum(x * y for x, y in zip(rows[i], rows[j], strict=True))
            assert inside(exact, enclosure.lo[0, i, j], enclosure.hi[0, i, j])
            size = float(sum(abs(x * y) for x, y in zip(rows[i], rows[j], strict=True)))
            assert enclosure.hi[0, i, j] - enclosure.lo[0, i, j] <= 1e-12 * size


def test_gram_of_no_columns_is_zero():
    enclosure = gram(np.zeros((2, 3, 0)))
    assert np.all(enclosure.lo <= 0.0)
    assert np.all(enclosure.hi >= 0.0)
    assert np.all(enclosure.hi < 1e-300)


# ---- exact values ------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(st.integers(0, 2), st.integers(0, 3), st.integers(0, 3), st.floats(-9, 9)),
        max_size=8,
    ),
    st.tuples(st.fractions(-5, 5), st.fractions(-5, 5)),
)
@settings(deadline=None)
def test_exact_values_are_exact(terms, x):
    words = np.array([[0] * (6 - i - j) + [1] * i + [2] * j for _, i, j, _ in terms], np.int32)
    values = exact_values(
        words.reshape(-1, 6),
        np.array([c for *_, c in terms], float),
        np.array([row for row, *_ in terms], int),
        3,
        x,
    )
    expected = [Fraction(0)] * 3
    for row, i, j, c in terms:
        expected[row] += Fraction(c) * x[0] ** i * x[1] ** j
    assert values == expected


def test_this_process_keeps_subnormal_numbers():
    rounding.require_ieee()


def test_a_process_that_flushes_subnormal_numbers_is_refused(monkeypatch):
    monkeypatch.setattr(rounding, "_TINY", 0.0)  # what a flushed product looks like
    with pytest.raises(FloatingPointError, match="IEEE"):
        rounding.require_ieee()


def test_the_middle_of_the_whole_line_is_no_number():
    """Warnings are errors here: none may reach who asks."""
    middle = Interval(np.array([-np.inf, -1e308, 0.0]), np.array([np.inf, 1e308, np.inf])).middle()
    assert np.isnan(middle[0]) and middle[1:].tolist() == [0.0, np.inf]
