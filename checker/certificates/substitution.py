"""Rows solved one after the other: each variable as a whole number and the room around it.

A pair (m, r) of whole numbers stands for all reals within r * 2**-K of m * 2**-K, r >= 0. Results
are rounded to whole m, and r grows by what that can change: by nothing where they are exact. K
grows until all r are small.
"""

from __future__ import annotations

from fractions import Fraction

from ..arithmetic.polynomial import Polynomial

Disc = tuple[int, int]
BITS = (300, 1200, 4800, 19200, 76800)
SMALL = 70  # an enclosure is less wide than 2**-SMALL


def substituted(
    rows: list[Polynomial], solved: list[int], x: list[Fraction], first: list[Fraction]
) -> list[tuple[Fraction, Fraction]] | None:
    """Enclose each variable of ``solved`` in turn by its row.

    The first variables are known.
    """
    place = {v: i for i, v in enumerate(solved)}
    for bits in BITS:
        found = _discs(rows, place, x, first, bits)
        if found is None or len(found) == len(rows):
            unit = 1 << bits
            return found and [(Fraction(m - r, unit), Fraction(m + r, unit)) for m, r in found]
    return None


def blocks(rows: list[Polynomial], solved: list[int]) -> list[int]:
    """Bound the first blocks of rows, to the end of the last with several rows.

    A block is as short as can be without a variable of a later one.
    """
    place = {v + 1: i for i, v in enumerate(solved)}
    found, latest, begin, ends = [0], 0, 0, [0]
    for number, row in enumerate(rows):
        latest = max([latest, number, *(place.get(v, 0) for word in row.terms for v in word)])
        if latest == number:
            ends.append(number + 1)
            if number > begin:
                found = list(ends)
            begin = number + 1
    return found


def _discs(
    rows: list[Polynomial],
    place: dict[int, int],
    x: list[Fraction],
    first: list[Fraction],
    bits: int,
) -> list[Disc] | None:
    """Enclosures, fewer where one is too wide; None where the rows are not of this kind."""
    found: list[Disc] = [_times_number((1 << bits, 0), value) for value in first]
    for number, row in list(enumerate(rows))[len(first) :]:
        rest: Disc = 0, 0
        slope: Disc = 0, 0
        for word, factor in row.coefficients().items():
            inside = [place[v - 1] for v in word if v - 1 in place]
            own = inside.count(number)
            if own > 1 or any(j > number for j in inside):
                return None
            for v in word:
                factor *= 1 if v - 1 in place else x[v - 1]
            term = _times_number((1 << bits, 0), factor)
            before = [found[j] for j in inside if j != number]
            if before:
                product = before[0]
                for disc in before[1:]:
                    product = _times(product, disc, bits)
                term = _times_number(product, factor)
            if own:
                slope = slope[0] + term[0], slope[1] + term[1]
            else:
                rest = rest[0] + term[0], rest[1] + term[1]
        disc = _divided(rest, slope, bits)
        if disc is None:
            return None
        if disc[1] >> (bits - SMALL):
            return found
        found.append((-disc[0], disc[1]))
    return found


def _times_number(disc: Disc, factor: Fraction) -> Disc:
    """A disc times an exact number."""
    top, bottom = factor.numerator, factor.denominator
    whole, rest = divmod(disc[0] * top, bottom)
    return whole, -(-disc[1] * abs(top) // bottom) + bool(rest)


def _times(one: Disc, two: Disc, bits: int) -> Disc:
    """|a b - m n| <= |m| s + |n| r + r s for |a - m| <= r and |b - n| <= s."""
    (m, r), (n, s) = one, two
    whole, rest = divmod(m * n, 1 << bits)
    return whole, -(-(abs(m) * s + abs(n) * r + r * s) >> bits) + bool(rest)


def _divided(rest: Disc, slope: Disc, bits: int) -> Disc | None:
    """|a / b - m / n| <= (r + |m / n| s) / (|n| - s); None where b may be zero."""
    (m, r), (n, s) = rest, slope
    least = abs(n) - s
    if least <= 0:
        return None
    quotient, rest = divmod(m << bits, n)
    return quotient, -(-((r << bits) + (abs(quotient) + 1) * s) // least) + bool(rest)
