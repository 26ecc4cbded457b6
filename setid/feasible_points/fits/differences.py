"""Errors of a local search in doubles: slopes by differences, and numbers that overflow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["HUGE", "capped", "slopes_of_errors"]

Reals = NDArray[np.float64]
HUGE = 1e100  # stands for errors that overflow
_LEAST = 1e-3  # size of an unknown, at least: its step is a part of that


def capped(errors: Reals) -> Reals:
    """Replace errors that are no numbers, or larger than :data:`HUGE`, by that.

    Parameters
    ----------
    errors : float array

    Examples
    --------
    >>> import numpy as np
    >>> capped(np.array([1.0, np.nan, -np.inf])).tolist()
    [1.0, 1e+100, -1e+100]
    """
    found = np.nan_to_num(errors, nan=HUGE, posinf=HUGE, neginf=-HUGE)
    return np.asarray(found.clip(-HUGE, HUGE), np.float64)


def slopes_of_errors(
    errors: Callable[[Reals], Reals], x: Reals, values: Reals, part: float
) -> Reals:
    """Differentiate errors by differences over a part of each unknown.

    Parameters
    ----------
    errors : callable
        Of a vector (k,); returns (R,).
    x : (k,) float
    values : (R,) float
        The errors there.
    part : float
        Step of an unknown as a part of its size; 1 is exact for affine errors.

    Returns
    -------
    (R, k) float

    Examples
    --------
    >>> import numpy as np
    >>> square = lambda x: x**2
    >>> slopes_of_errors(square, np.array([3.0]), np.array([9.0]), 1e-6).round(4)
    array([[6.]])
    """
    found = np.zeros((values.size, x.size))
    for place in range(x.size):
        step = part * max(abs(float(x[place])), _LEAST)
        moved = x.copy()
        moved[place] += step
        found[:, place] = (errors(moved) - values) / step
    return found
