"""Intervals of single numbers against rationals, and against the intervals of arrays."""

from __future__ import annotations

from fractions import Fraction
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparsepop_py.verified.arithmetic import scalar_interval as scalar
from sparsepop_py.verified.arithmetic.interval import Interval

NUMBERS = st.floats(-1e6, 1e6).map(lambda v: 0.0 if abs(v) < 1e-6 else v)
SHARE = st.fractions(0, 1, max_denominator=97)


@st.composite
def ends(draw: st.DrawFn) -> tuple[float, float]:
    low, high = sorted((draw(NUMBERS), draw(NUMBERS)))
    return low, high


def inside(pair: tuple[float, float], share: Fraction) -> Fraction:
    return Fraction(pair[0]) + share * (Fraction(pair[1]) - Fraction(pair[0]))


def holds(found: tuple[float, float], value: Fraction) -> bool:
    low = found[0] == -inf or Fraction(found[0]) <= value
    return low and (found[1] == inf or value <= Fraction(found[1]))


@given(ends(), ends(), SHARE, SHARE)
def test_results_hold_every_value(one, other, s, t) -> None:
    x, y = inside(one, s), inside(other, t)
    assert holds(scalar.plus(one, other), x + y)
    assert holds(scalar.times(one, other), x * y)
    assert holds(scalar.sum_of([one, other, one]), x + y + x)
    assert holds(scalar.product([one, other, other]), x * y * y)
    if y:
        assert holds(scalar.quotient(one, other), x / y)


@given(ends(), SHARE, st.integers(0, 5))
def test_powers_hold_every_value(pair, s, exponent) -> None:
    assert holds(scalar.power(pair, exponent), inside(pair, s) ** exponent)


@given(ends(), st.sampled_from([1, 3, 5]))
def test_roots_hold_the_ends(pair, degree) -> None:
    low, high = scalar.odd_root(pair, degree)
    assert Fraction(low) ** degree <= Fraction(pair[0])
    assert Fraction(high) ** degree >= Fraction(pair[1])
    assert low**degree >= pair[0] - 1e-12 * abs(pair[0])
    assert high**degree <= pair[1] + 1e-12 * abs(pair[1])


@given(ends(), ends())
def test_arrays_say_the_same_but_for_last_digits(one, other) -> None:
    a, b = (Interval(np.float64(low), np.float64(high)) for low, high in (one, other))
    for mine, theirs in (
        (scalar.plus(one, other), a + b),
        (scalar.times(one, other), a * b),
        (scalar.quotient(one, other), a / b),
    ):
        for value, wanted in zip(mine, (theirs.lo, theirs.hi), strict=True):
            assert value == pytest.approx(float(wanted), rel=1e-14, abs=1e-300)


def test_infinite_ends_and_zeros() -> None:
    low, high = scalar.times((0.0, 0.0), (-inf, inf))
    assert low <= 0.0 <= high
    assert high < 1e-300
    assert scalar.quotient((1.0, 2.0), (-1.0, 1.0)) == (-inf, inf)
    assert scalar.quotient((1.0, 2.0), (2.0, inf))[0] <= 0.0
    assert scalar.power((-2.0, 1.0), 2)[0] == 0.0
    assert scalar.meet((0.0, 1.0), (2.0, 3.0)) == (2.0, 1.0)
    assert scalar.odd_root((-inf, inf), 3) == (-inf, inf)
