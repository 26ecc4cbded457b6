"""Linear rows r + C theta = 0 with intervals as coefficients, and a left inverse M of them.

Then |theta - centre| <= G |theta - centre| + d, with G = |I - M C| and d = |M (r + C centre)|.
"""

from __future__ import annotations

from fractions import Fraction

from . import interval as iv
from .interval import Interval
from .polynomial import dyadic


def contracts(
    inverse: list[list[float]],
    table: list[list[Interval]],
    centre: list[float],
    radius: list[float],
) -> bool:
    """Whether G radius + d < radius, so that |theta - centre| <= radius; r stands last in rows."""
    middle, exp = dyadic(centre)
    one = iv.scaled(1, 0)[0]
    offset = [dot([*middle, 1 << -exp], row) for row in table]  # (r + C centre) * 2**-exp
    for i, reach in enumerate(radius):
        weights, bits = dyadic(inverse[i])
        unit = one << -bits
        reached = Fraction(size(dot(weights, offset)), unit << -exp)
        for j, other in enumerate(radius):
            low, high = dot(weights, [row[j] for row in table])
            own = unit if i == j else 0
            reached += Fraction(size((own - high, own - low)), unit) * Fraction(other)
        if not reached < Fraction(reach):
            return False
    return True


def dot(weights: list[int], column: list[Interval]) -> Interval:
    """The sum of whole numbers times intervals, exactly."""
    pairs = [
        (c * low, c * high) if c >= 0 else (c * high, c * low)
        for c, (low, high) in zip(weights, column, strict=True)
    ]
    return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)


def size(x: Interval) -> int:
    """The largest absolute value in an interval."""
    return max(abs(x[0]), abs(x[1]))
