"""Interval arithmetic in fixed point: whole multiples of 2**-K, rounded outwards.

A whole number z stands for z * 2**-K. Sums are exact; products, quotients and roots are rounded
down at lower ends and up at upper ends. K is so large that every double is a whole multiple of
2**-K: where rounded operations of doubles give a box, the same operations here give one that lies
in it, since a number that lies below a double is rounded up to at most that double. Infinite ends
are ``INF``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import isqrt
from typing import Any

from .polynomial import INF, Polynomial, powers

End = Any  # int, or INF or -INF
Interval = tuple[End, End]
WHOLE: Interval = (-INF, INF)
ZERO: Interval = (0, 0)

_K = 1152  # the least positive double is 2**-1074
ONE: Interval = (1 << _K, 1 << _K)


def below(value: Fraction | float | int) -> End:
    """Round a rational number down; infinities stay."""
    if value in (INF, -INF):
        return value
    return (Fraction(value) * (1 << _K)).__floor__()


def above(value: Fraction | float | int) -> End:
    """Round a rational number up; infinities stay."""
    return -below(-value)


def exact(end: End) -> Any:
    """Take an end as a Fraction; infinities stay."""
    return end if end in (INF, -INF) else Fraction(end, 1 << _K)


def around(low: Any, high: Any) -> Interval:
    """Enclose rational ends."""
    return below(low), above(high)


def exactly(x: Interval) -> tuple[Any, Any]:
    """Take both ends as Fractions; infinities stay."""
    return exact(x[0]), exact(x[1])


def scaled(value: int, exp: int) -> Interval:
    """Compute value * 2**exp."""
    shift = exp + _K
    if shift >= 0:
        return value << shift, value << shift
    return value >> -shift, -(-value >> -shift)


def times_end(a: End, b: End) -> End:
    """Multiply two ends, not rounded and not scaled; 0 times infinity is 0."""
    if not a or not b:
        return 0
    if a in (INF, -INF) or b in (INF, -INF):
        return INF if (a > 0) == (b > 0) else -INF
    return a * b


def times(x: Interval, y: Interval) -> Interval:
    """Multiply; 0 times infinity is 0, as for limits of numbers."""
    ends = [times_end(a, b) for a in x for b in y]
    low, high = min(ends), max(ends)
    return (low if low == -INF else low >> _K), (high if high == INF else -(-high >> _K))


def plus(x: Interval, y: Interval) -> Interval:
    """Add."""
    low = -INF if -INF in (x[0], y[0]) else x[0] + y[0]
    return low, (INF if INF in (x[1], y[1]) else x[1] + y[1])


def total(parts: Iterable[Interval]) -> Interval:
    """Sum intervals."""
    found: Interval = ZERO
    for part in parts:
        found = plus(found, part)
    return found


def met(x: Interval, y: Interval) -> Interval:
    """Intersect; ends cross where nothing is common."""
    return max(x[0], y[0]), min(x[1], y[1])


def minus(x: Interval, y: Interval) -> Interval:
    """Subtract."""
    return plus(x, (-y[1], -y[0]))


def power(x: Interval, n: int) -> Interval:
    """Enclose z^n for z in x, n >= 1."""
    if n == 1:
        return x
    low, high = (_powered(end, n) for end in x)
    if n % 2:
        return low[0], high[1]
    far = max(low[1], high[1])
    return (0 if x[0] <= 0 <= x[1] else min(low[0], high[0])), far


def _powered(end: End, n: int) -> Interval:
    if end in (INF, -INF):
        found = INF if end > 0 or n % 2 == 0 else -INF
        return found, found
    whole = end**n
    return whole >> _K * (n - 1), -(-whole >> _K * (n - 1))


def divided(a: End, b: End, up: bool) -> End:
    """Divide a by b > 0 or INF, rounded; 0 stands for a limit."""
    if not a or b == INF:
        return 0
    if a in (INF, -INF) or not b:
        return INF if a > 0 else -INF
    return -((-a << _K) // b) if up else (a << _K) // b


def quotient(target: Interval, divisor: Interval) -> Interval:
    """Enclose all q that some d in the divisor takes into the target."""
    (low, high), (d, e) = target, divisor
    if d < 0 < e or d == e == 0 or (low <= 0 <= high and d <= 0 <= e):
        return WHOLE
    if e <= 0:
        low, high, d, e = -high, -low, -e, -d
    return divided(low, e if low >= 0 else d, False), divided(high, d if high > 0 else e, True)


def root_below(value: End, n: int) -> End:
    """Compute the n-th root of value >= 0, rounded down."""
    if value == INF or n == 1:
        return value
    wanted = value << _K * (n - 1)
    if n == 2:
        return isqrt(wanted)
    if not wanted:
        return 0
    guess = 1 << -(-wanted.bit_length() // n)  # Newton from above
    while True:
        better = ((n - 1) * guess + wanted // guess ** (n - 1)) // n
        if better >= guess:
            return guess
        guess = better


def root_above(value: End, n: int) -> End:
    """Compute the n-th root of value >= 0, rounded up."""
    found = root_below(value, n)
    whole = value == INF or found**n == value << _K * (n - 1)
    return found if whole else found + 1


def roots(value: Interval, n: int, x: Interval) -> Interval:
    """Enclose the z in x with z^n in value; ends cross where there is none."""
    low, high = value
    if n == 1:
        return value
    if n % 2:
        first = root_below(low, n) if low >= 0 else -root_above(-low, n)
        return first, (root_above(high, n) if high >= 0 else -root_below(-high, n))
    if high < 0:
        return INF, -INF
    near, far = root_below(max(low, 0), n), root_above(high, n)
    if near <= 0:
        return -far, far
    return (near if x[0] > -near else -far), (-near if x[1] < near else far)


def monomial_range(word: tuple[int, ...], box: Sequence[Interval]) -> Interval:
    """Enclose a monomial over a box."""
    found = ONE
    for variable, n in powers(word):
        found = times(found, power(box[variable], n))
    return found


def range_over(polynomial: Polynomial, box: Sequence[Interval]) -> Interval:
    """Bound a polynomial over a box by the sum of the ranges of its terms."""
    terms = ((word, scaled(value, polynomial.exp)) for word, value in polynomial.terms.items())
    return total(times(term, monomial_range(word, box)) if word else term for word, term in terms)
