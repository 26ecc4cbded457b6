"""Intervals of single numbers as pairs, rounded outwards, with infinite ends.

The arithmetic of :class:`~sparsepop_py.verified.arithmetic.interval.Interval` for loops over single
numbers, in which arrays of one entry would cost fifty times as much. Each sum and product is
rounded outwards by one unit in the last place.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import inf, isfinite, isinf, nextafter

__all__ = [
    "Ends",
    "meet",
    "odd_root",
    "plus",
    "power",
    "product",
    "quotient",
    "sum_of",
    "times",
]

Ends = tuple[float, float]


def meet(one: Ends, other: Ends) -> Ends:
    """Intersect; the ends cross where nothing is in both."""
    return max(one[0], other[0]), min(one[1], other[1])


def plus(one: Ends, other: Ends) -> Ends:
    """Add two intervals."""
    return nextafter(one[0] + other[0], -inf), nextafter(one[1] + other[1], inf)


def sum_of(parts: Sequence[Ends]) -> Ends:
    """Add several intervals."""
    found = (0.0, 0.0)
    for part in parts:
        found = plus(found, part)
    return found


def times(one: Ends, other: Ends) -> Ends:
    """Multiply two intervals, with 0 * inf = 0."""
    corners = [0.0 if 0.0 in (a, b) else a * b for a in one for b in other]
    return nextafter(min(corners), -inf), nextafter(max(corners), inf)


def product(factors: Sequence[Ends]) -> Ends:
    """Multiply several; a single one stays as it is."""
    if not factors:
        return 1.0, 1.0
    found = factors[0]
    for other in factors[1:]:
        found = times(found, other)
    return float(found[0]), float(found[1])


def quotient(top: Ends, below: Ends) -> Ends:
    """Divide two intervals; everything where the divisor may be zero."""
    if below[0] <= 0.0 <= below[1] or below[0] > below[1]:
        return -inf, inf
    inverse = tuple(0.0 if isinf(b) else 1.0 / b for b in (below[1], below[0]))
    if below == (1.0, 1.0):
        return top
    return times(top, (nextafter(inverse[0], -inf), nextafter(inverse[1], inf)))


def power(ends: Ends, exponent: int) -> Ends:
    """Raise to an integer power; a negative one is that of the inverse.

    Examples
    --------
    >>> power((-1.0, 2.0), 2)[1] >= 4.0
    True
    """
    if exponent < 0:
        return quotient((1.0, 1.0), power(ends, -exponent))
    found = product([ends] * exponent)
    if exponent % 2 == 0 and exponent and ends[0] <= 0.0 <= ends[1]:
        top = max(abs(ends[0]), abs(ends[1]))
        return 0.0, product([(top, top)] * exponent)[1]
    return found


def odd_root(ends: Ends, degree: int) -> Ends:
    """Take an odd root; ends move outwards until their powers pass the given ones.

    Parameters
    ----------
    ends : (low, high)
    degree : int
        Odd and positive.

    Examples
    --------
    >>> low, high = odd_root((-8.0, 27.0), 3)
    >>> low <= -2.0 and high >= 3.0
    True
    """
    if degree == 1:
        return ends
    low, high = (abs(e) ** (1.0 / degree) * (1.0 if e >= 0 else -1.0) for e in ends)
    while isfinite(low) and Fraction(low) ** degree > Fraction(ends[0]):
        low = nextafter(low, -inf)
    while isfinite(high) and Fraction(high) ** degree < Fraction(ends[1]):
        high = nextafter(high, inf)
    return low, high
