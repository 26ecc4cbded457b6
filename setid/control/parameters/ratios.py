"""Proved ranges of ratios of parameters, for the forms of PID controllers."""

from __future__ import annotations

from math import inf, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from setid.control.parameters.parameter_set import ParameterSet

__all__ = ["ratio_range", "series_times"]

Reals = NDArray[np.float64]
_BISECTIONS = 60


def ratio_range(found: ParameterSet, top: Reals, below: Reals) -> tuple[float, float]:
    """Bound top'theta / below'theta over a set; infinite where the divisor may vanish.

    A number c is a lower bound where the least value of (top - c below)'theta is proved to be
    >= 0 for a positive divisor; bisection finds the largest such c.

    Parameters
    ----------
    found : ParameterSet
    top, below : (p,) float
    """
    zero = np.zeros(1)
    low, high = found.ranges(zero, below[None, :])
    if low[0] <= 0.0 <= high[0]:
        return -inf, inf
    sign = 1.0 if low[0] > 0 else -1.0
    top, below = sign * top, sign * below
    least = _bound(found, top, below)
    return least, -_bound(found, -top, below)


def _bound(found: ParameterSet, top: Reals, below: Reals) -> float:
    """A proved lower bound of top'theta / below'theta, the divisor being positive."""
    zero = np.zeros(1)
    ends = found.ranges(np.zeros(2), np.stack([top, below]))
    size = max(abs(ends[0][0]), abs(ends[1][0])) / min(abs(ends[0][1]), abs(ends[1][1]))
    low, high = -2.0 * size - 1e-300, 2.0 * size + 1e-300
    if not found.ranges(zero, (top - low * below)[None, :])[0][0] >= 0.0:
        return -inf
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if found.ranges(zero, (top - middle * below)[None, :])[0][0] >= 0.0:
            low = middle
        else:
            high = middle
    # top - c below is rounded: the weights are those of another c, within one unit each
    return float(low - 1e-14 * (abs(low) + size))


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
