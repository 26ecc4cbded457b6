"""Zeros of polynomials in the unit disc (I. Schur, A. Cohn), with coefficients in intervals."""

from __future__ import annotations

from fractions import Fraction

Ends = tuple[Fraction, Fraction]


def in_disc(coefficients: list[Ends]) -> bool:
    """Check that the zeros of z^n + a_1 z^(n-1) + ... + a_n lie in the closed unit disc.

    They lie inside of it if abs(a_n) < 1 and those of the polynomial with coefficients
    (a_k - a_n a_(n-k)) / (1 - a_n^2), k = 1, ..., n - 1, do. Of order 1 they may lie on it.
    """
    while coefficients:
        low, high = coefficients[-1]
        if len(coefficients) == 1:
            return -1 <= low and high <= 1
        if not (-1 < low and high < 1):
            return False
        least, most = sorted((1 - low * low, 1 - high * high))
        below = (least, Fraction(1) if low < 0 < high else most)
        turned = coefficients[-2::-1]
        coefficients = [
            quotient(minus(a, times((low, high), b)), below)
            for a, b in zip(coefficients[:-1], turned, strict=True)
        ]
    return True


def minus(one: Ends, other: Ends) -> Ends:
    """Subtract."""
    return one[0] - other[1], one[1] - other[0]


def times(one: Ends, other: Ends) -> Ends:
    """Multiply."""
    products = [a * b for a in one for b in other]
    return min(products), max(products)


def quotient(one: Ends, positive: Ends) -> Ends:
    """Divide by what is positive."""
    quotients = [a / b for a in one for b in positive]
    return min(quotients), max(quotients)
