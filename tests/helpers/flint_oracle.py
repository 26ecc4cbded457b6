"""Exact values from FLINT (fmpq, arb), and doubles at the ends of what doubles hold.

Doubles are rationals: fmpq takes them as they are. Where a value is no rational (roots), arb
encloses it in 400 bits and a comparison that is not decided raises.
"""

from __future__ import annotations

from fractions import Fraction

import flint
import numpy as np
from flint import arb, fmpq
from hypothesis import strategies as st

flint.ctx.prec = 400
LARGEST = float(np.finfo(float).max)
SMALLEST = 5e-324


def rational(value):
    """A double or a Fraction as it is."""
    numerator, denominator = (
        value.as_integer_ratio() if isinstance(value, Fraction) else float(value).as_integer_ratio()
    )
    return fmpq(numerator, denominator)


def real(value):
    """A double, a Fraction or an fmpq as an arb; exact for doubles."""
    return arb(value if isinstance(value, fmpq) else rational(value))


def fraction(value):
    """An fmpq as a Fraction."""
    return Fraction(int(value.p), int(value.q))


def at_most(a, b):
    """a <= b for doubles (infinite ones too) and arbs; raises where 400 bits do not tell."""
    if isinstance(a, float) and not np.isfinite(a):
        return a < 0 or (isinstance(b, float) and b == np.inf)
    if isinstance(b, float) and not np.isfinite(b):
        return b > 0
    a, b = (v if isinstance(v, arb) else real(v) for v in (a, b))
    if a <= b:
        return True
    assert a > b, "400 bits do not decide"
    return False


def inside(value, low, high):
    """low <= value <= high, for doubles low and high that may be infinite."""
    return at_most(float(low), value) and at_most(value, float(high))


def value_at(table, x):
    """The value of a polynomial {exponents: coefficient} at numbers of one kind."""
    total = x[0] * 0
    for powers, coefficient in table.items():
        term = rational(coefficient) + x[0] * 0
        for base, power in zip(x, powers, strict=True):
            term = term * base**power
        total = total + term
    return total


# ---- doubles ----------------------------------------------------------------------------------

special = st.sampled_from(
    [0.0, 1.0, -1.0, 0.1, 3.0, SMALLEST, -SMALLEST, 2.0**-1022, 1e-160, -1e160, 1e16]
    + [1 + 2.0**-52, 1 - 2.0**-53, 2.0**53, LARGEST, -LARGEST, 1e308, 1e-308]
)
# all digits, and any exponent: most products of two overflow, underflow or are subnormal
wild = st.builds(
    lambda digits, exponent: float(np.ldexp(float(digits), exponent)),
    st.integers(-(2**53), 2**53),
    st.integers(-1127, 970),
)
doubles = st.one_of(special, wild, st.floats(-10, 10))
# of all sizes whose products of five are no problem
moderate = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.1, 1e-30, -1e30, 1 + 2.0**-52, 1e16, -1e-16]),
    st.builds(
        lambda digits, exponent: float(np.ldexp(float(digits), exponent)),
        st.integers(-(2**53), 2**53),
        st.integers(-120, 20),
    ),
    st.floats(-4, 4),
)


@st.composite
def cancelling(draw, of=moderate, least=2, most=12):
    """Numbers whose sum is much smaller than they are: each is nearly the opposite of another."""
    values = draw(st.lists(of, min_size=1, max_size=most // 2))
    for value in list(values):
        steps = draw(st.integers(-3, 3))
        values.append(float(-value + steps * np.spacing(value)))
    values += draw(st.lists(of, max_size=2))
    return draw(st.permutations(values))


@st.composite
def ends(draw, of=doubles):
    """Two doubles in order, now and then equal or neighbours."""
    first, second = draw(of), draw(of)
    kind = draw(st.integers(0, 4))
    if kind == 0:
        second = first
    elif kind == 1:
        second = float(np.nextafter(first, 2.0))
    return min(first, second), max(first, second)


def between(low, high, share):
    """The rational point of [low, high] at that share of the way."""
    return rational(low) + (rational(high) - rational(low)) * rational(share)


shares = st.sampled_from([0.0, 1.0, 0.5, 0.25, 0.3125, 2.0**-40, 1 - 2.0**-40])
