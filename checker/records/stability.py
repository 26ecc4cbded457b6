"""Zeros of polynomials in the unit disc (I. Schur, A. Cohn), with coefficients in intervals."""

from __future__ import annotations

from ..arithmetic import interval as iv
from ..arithmetic.interval import ONE, Interval


def in_disc(coefficients: list[Interval]) -> bool:
    """Check that the zeros of z^n + a_1 z^(n-1) + ... + a_n lie in the closed unit disc.

    They lie inside of it if abs(a_n) < 1 and those of the polynomial with coefficients
    (a_k - a_n a_(n-k)) / (1 - a_n^2), k = 1, ..., n - 1, do. Of order 1 they may lie on it.
    """
    one, _ = ONE
    while coefficients:
        *others, last = coefficients
        if not others:
            return bool(-one <= last[0] and last[1] <= one)
        if not (-one < last[0] and last[1] < one):
            return False
        below = iv.minus(ONE, iv.power(last, 2))
        turned = (iv.times(last, a) for a in reversed(others))
        coefficients = [
            iv.quotient(iv.minus(a, b), below) for a, b in zip(others, turned, strict=True)
        ]
    return True
