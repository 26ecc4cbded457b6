"""Linear rows r + C theta = 0 with intervals as coefficients, and a left inverse M of them.

Then |theta - centre| <= G |theta - centre| + d, with G = |I - M C| and d = |M (r + C centre)|.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import dyadic


def reached(
    inverse: Sequence[Sequence[float | Fraction]],
    table: Sequence[list[Interval]],
    centre: Sequence[float],
    radius: Sequence[Any],
) -> list[Fraction]:
    """Compute G radius + d; the rest r of a row stands behind its coefficients.

    Where it is below the radius, |theta - centre| <= radius for each solution theta.
    """
    middle, exp = dyadic(centre)
    one = iv.scaled(1, 0)[0]
    offset = [dot([*middle, 1 << -exp], row) for row in table]  # (r + C centre) * 2**-exp
    found = []
    for i, row in enumerate(inverse):
        weights, bits = dyadic(row)
        unit = one << -bits
        total = Fraction(size(dot(weights, offset)), unit << -exp)
        for j, reach in enumerate(radius):
            low, high = dot(weights, [line[j] for line in table])
            own = unit if i == j else 0
            total += Fraction(size((own - high, own - low)), unit) * Fraction(reach)
        found.append(total)
    return found


def contracts(
    inverse: list[list[float]],
    table: list[list[Interval]],
    centre: list[float],
    radius: list[float],
) -> bool:
    """Check whether |theta - centre| <= radius is proved."""
    pairs = zip(reached(inverse, table, centre, radius), radius, strict=True)
    return all(total < reach for total, reach in pairs)


def dot(weights: list[int], column: list[Interval]) -> Interval:
    """Sum whole numbers times intervals, exactly."""
    pairs = [
        (c * low, c * high) if c >= 0 else (c * high, c * low)
        for c, (low, high) in zip(weights, column, strict=True)
    ]
    return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)


def size(x: Interval) -> int:
    """Find the largest absolute value in an interval."""
    return max(abs(x[0]), abs(x[1]))
