"""Inner ends of intervals: the most extreme values of parameters at points proved to exist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

__all__ = ["inner_ends", "loosened"]

Ends = tuple[float, float]


def inner_ends(
    points: Sequence[sp.ProvedPoint | None], place: int
) -> tuple[Ends | None, tuple[NDArray[Any] | None, NDArray[Any] | None]]:
    """Find the lowest and highest attained values of a parameter, and where.

    Parameters
    ----------
    points : sequence of ProvedPoint or None
        Attained for theta_1, -theta_1, theta_2, ...; None where none was found.
    place : int
        The parameter, from 0.

    Returns
    -------
    (low, high) or None
        Values at or beyond which proved points lie.
    (low, high) of (n,) float or None
        All unknowns there.
    """
    attained = [point for point in points if point is not None]
    if not attained:
        return None, (None, None)
    lows = [(_edge(point, place, 1.0), number) for number, point in enumerate(attained)]
    highs = [(_edge(point, place, -1.0), number) for number, point in enumerate(attained)]
    ends, where = [], []
    for side, values in enumerate((lows, highs)):
        value, number = min(values)
        mine = points[2 * place + side]
        if mine is not None and loosened(mine.value, mine) <= value:
            value = loosened(mine.value, mine)
            where.append(mine.x)
        else:
            where.append(attained[number].x)
        ends.append(value)
    low, high = ends[0], -ends[1]
    return (low, high), (where[0], where[1])


def _edge(point: sp.ProvedPoint, place: int, sign: float) -> float:
    """Bound sign * theta from above at the proved point near x."""
    return loosened(sign * float(point.x[place]) + point.radius, point)


def loosened(value: float, point: sp.ProvedPoint) -> float:
    """Return a little more than a value at a proved point.

    Its last digits may move by rounding.

    Parameters
    ----------
    value : float
    point : sparsepop_py.ProvedPoint
    """
    return float(value + point.radius + 8 * np.spacing(abs(value)))
