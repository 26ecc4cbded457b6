"""Bounds as people read them: never better than the number that is proved."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sparsepop_py.errors import ProblemError
from sparsepop_py.verified.arithmetic.display import rounded

SMALLEST = 5e-324  # 2^-1074


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.booleans(),
    st.integers(1, 15),
    st.booleans(),
)
@example(4 * SMALLEST, False, 2, True)  # the doubles nearby have one digit
@example(-4 * SMALLEST, True, 2, True)
@example(1.7976931348623157e308, True, 3, True)
@example(9.9999999999999999e22, True, 15, False)
@example(-0.0, True, 4, True)
@settings(max_examples=300, deadline=None)
def test_what_is_shown_is_on_the_safe_side(value, upwards, digits, scientific):
    text = rounded(value, upwards, digits, scientific)
    if text.endswith("inf"):
        assert upwards == (text[0] != "-") and abs(value) > 1e308
        return
    shown = Fraction(text)
    assert shown >= Fraction(value) if upwards else shown <= Fraction(value)
    # and it loses at most a unit of its last digit, or a few of the least doubles
    size = abs(Fraction(value))
    assert abs(shown - Fraction(value)) <= size / 10 ** (digits - 1) + 3 * Fraction(SMALLEST)


@pytest.mark.parametrize("upwards, text", [(True, "+3.334e-01"), (False, "+3.333e-01")])
def test_a_third_in_four_digits(upwards, text):
    assert rounded(1 / 3, upwards, digits=4, scientific=True) == text


def test_infinite_bounds_are_shown_as_they_are():
    assert rounded(float("inf"), True, scientific=True) == "+inf"
    assert rounded(float("-inf"), False) == "-inf"


def test_other_kinds_of_doubles_are_shown_outwards():
    assert rounded(np.float32(0.1), False, 15) == "0.100000001490116"  # it is 0.1000000014901161...
    assert rounded(2**53, True) == "9.007199255e+15"


@pytest.mark.parametrize("value", [Fraction(1, 3), "nan", 2**53 + 1, 10**400, None, 1j])
def test_what_is_no_double_is_refused(value):
    with pytest.raises(ProblemError, match="^value: found "):
        rounded(value, True)


@pytest.mark.parametrize("digits", [0, 16, 2.0, "5"])
def test_digits_have_limits(digits):
    with pytest.raises(ProblemError, match="^digits: found "):
        rounded(0.5, True, digits)
