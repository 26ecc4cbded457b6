"""Proved ranges of ratios of parameters, for the forms of PID controllers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import inf, nan, sqrt

from setid.control.parameters.parameter_set import ParameterSet

__all__ = ["ratio_range", "series_times"]

_BISECTIONS = 60


def ratio_range(
    found: ParameterSet, top: Sequence[Fraction], below: Sequence[Fraction]
) -> tuple[float, float]:
    """Bound top'theta / below'theta over a set; infinite where the divisor may vanish.

    A number c is a lower bound where the least value of (top - c below)'theta is proved to be
    >= 0 for a positive divisor; bisection finds the largest such c.

    Parameters
    ----------
    found : ParameterSet
    top, below : p rationals
    """
    low, high = found.exact_ranges([below])
    if low[0] <= 0.0 <= high[0]:
        return -inf, inf
    sign = 1 if low[0] > 0 else -1
    top, below = [sign * c for c in top], [sign * c for c in below]
    least = _bound(found, top, below)
    return least, -_bound(found, [-c for c in top], below)


def _bound(found: ParameterSet, top: list[Fraction], below: list[Fraction]) -> float:
    """Find a proved lower bound of top'theta / below'theta, the divisor being positive."""
    ends = found.exact_ranges([top, below])
    size = max(abs(ends[0][0]), abs(ends[1][0])) / min(abs(ends[0][1]), abs(ends[1][1]))
    low, high = -2.0 * size - 1e-300, 2.0 * size + 1e-300
    if not _holds(found, top, below, low):
        return -inf
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _holds(found, top, below, middle):
            low = middle
        else:
            high = middle
    return float(low)


def _holds(found: ParameterSet, top: list[Fraction], below: list[Fraction], c: float) -> bool:
    """Check by proof that (top - c below)'theta >= 0 all over the set."""
    if not abs(c) < inf:
        return False
    weights = [t - Fraction(c) * b for t, b in zip(top, below, strict=True)]
    return bool(found.exact_ranges([weights])[0][0] >= 0.0)


def series_times(
    integral: tuple[float, float], derivative: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Convert Ti and Td of the ideal form to those of the series form.

    With ideal Ti, Td the series times are the roots of x^2 - Ti x + Ti Td: the larger is Ti.
    It grows with Ti and falls with Td where Ti >= 4 Td > 0.

    Examples
    --------
    >>> from setid.control.parameters.ratios import series_times
    >>> [tuple(round(v, 6) for v in ends) for ends in series_times((4.0, 4.0), (0.75, 0.75))]
    [(3.0, 3.0), (1.0, 1.0)]
    """
    if not (0.0 < integral[0] <= integral[1] < inf and 0.0 <= derivative[0] <= derivative[1]):
        return (nan, nan), (nan, nan)
    if integral[0] < 4.0 * derivative[1]:
        return (nan, nan), (nan, nan)

    def roots(ti: float, td: float) -> tuple[float, float]:
        large = 0.5 * ti * (1.0 + sqrt(max(1.0 - 4.0 * td / ti, 0.0)))
        return large, ti - large

    slack = 1e-12
    large = roots(integral[0], derivative[1])[0], roots(integral[1], derivative[0])[0]
    small = roots(integral[1], derivative[0])[1], roots(integral[0], derivative[1])[1]
    return (
        (large[0] * (1 - slack), large[1] * (1 + slack)),
        (small[0] - slack * integral[1], small[1] + slack * integral[1]),
    )
