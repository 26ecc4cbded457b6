"""Zeros of polynomials in the unit disc (I. Schur, A. Cohn), with coefficients in intervals."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval

Ends = tuple[Fraction, Fraction]


def in_disc(coefficients: list[Interval]) -> bool:
    """Check that the zeros of z^n + a_1 z^(n-1) + ... + a_n lie in the closed unit disc.

    They lie inside of it if abs(a_n) < 1 and those of the polynomial with coefficients
    (a_k - a_n a_(n-k)) / (1 - a_n^2), k = 1, ..., n - 1, do. Of order 1 they may lie on it, so
    nothing is rounded.
    """
    exact = [iv.exactly(a) for a in coefficients]
    while exact:
        *others, last = exact
        if not others:
            return bool(-1 <= last[0] and last[1] <= 1)
        if not (-1 < last[0] and last[1] < 1):
            return False
        squares = [end * end for end in last]
        least = Fraction(0) if last[0] < 0 < last[1] else min(squares)
        below = 1 - max(squares), 1 - least
        turned = [_ends(a * b for a in last for b in other) for other in reversed(others)]
        exact = [
            _ends(x / y for x in (a[0] - b[1], a[1] - b[0]) for y in below)
            for a, b in zip(others, turned, strict=True)
        ]
    return True


def _ends(values: Iterable[Fraction]) -> Ends:
    """Take the least and the largest."""
    found = list(values)
    return min(found), max(found)
