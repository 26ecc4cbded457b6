"""Proved ranges along the principal axes of the members of a feasible set.

Where noise couples the rows, the rows in theta alone say little more than the outer box, although
members fill a thin part of it. The axes of that part are directions in which the engine is asked
for proved bounds, all at once, and then the diagonals of each pair of axes: the part is no box.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import SetidError
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.supports import cover_of
from setid.formulation.units import in_units
from setid.proofs.existence import admitted
from setid.proofs.supports import Cover

__all__ = ["principal_cover", "solved_heights"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_FIXED, _TINY = 1e-13, 1e-250  # widths that are rounding: relative, and absolute
_GAPS = 1e-2, 5e-2  # of the width along an axis, and along a diagonal of two


def solved_heights(
    result: FeasibleSet, directions: Reals, options: sp.Options
) -> tuple[Reals, Reals]:
    """Bound linear functions of theta by :func:`sparsepop_py.solve_each`.

    Parameters
    ----------
    result : FeasibleSet
    directions : (K, p) float
    options : sparsepop_py.Options

    Returns
    -------
    heights : (K,) float
        Proved upper bounds, infinite where the engine has none.
    points : (M, p) float
        Consistent parameter vectors that the engine found.

    Raises
    ------
    SetidError
        If the engine proves that the set is empty, which the result does not say.
    """
    formulation = result.formulation
    scaled = in_units(result.problem, formulation)
    p = len(formulation.parameters)
    asked = [scaled.asked(_negated(result, d)) for d in directions.tolist()]
    objectives, factors = zip(*asked, strict=True)
    found = sp.solve_each(scaled.problem, objectives, options)
    units = scaled.units
    points = [
        point.x[:p] * units[:p]
        for point in (r.attained for r in found if r.attained is not None)
        if admitted(formulation, point.x[:p] * units[:p], point.radius * units[:p])
    ]
    heights = -np.array([r.lower_bound for r in found]) * factors
    if np.any(heights == -inf):
        raise SetidError("result: found a set that is now proved empty: identify the record again")
    heights = np.where(np.isnan(heights), inf, heights + 4 * _EPS * np.abs(heights))
    return heights, np.reshape(points, (-1, p))


def _negated(result: FeasibleSet, direction: Sequence[float]) -> sp.Polynomial:
    layout = result.formulation.layout
    total = layout.polynomial(0) * (-direction[0])
    for number, value in enumerate(direction[1:], 1):
        total = total + layout.polynomial(number) * (-value)
    return total


@lru_cache(maxsize=4)
def principal_cover(result: FeasibleSet, time_limit: float) -> tuple[Cover, Reals]:
    """Cover a feasible set by proved ranges along principal axes and their diagonals.

    The last few results are kept, so that several bands of one result ask once.

    Parameters
    ----------
    result : FeasibleSet
        With finite intervals.
    time_limit : float
        Seconds for the engine.

    Returns
    -------
    cover : Cover
        That of :func:`cover_of` where it is the set itself or too few members are known.
    points : (M, p) float
        Members that were found on the way.

    Raises
    ------
    SetidError
        If the feasible set is empty.
    """
    cover, known = cover_of(result), result.attained
    p = cover.lower.size
    finite = bool(np.all(np.isfinite([cover.lower, cover.upper])))
    if cover.exact or not finite or len(known) < 2 or time_limit <= 0:
        return cover, np.zeros((0, p))
    until = time.monotonic() + time_limit
    found = []
    kinds = _directions(known, cover)
    for directions, gap in zip(kinds, _GAPS, strict=False):  # one parameter has no diagonals
        left = until - time.monotonic()
        if left > 0:
            options = replace(
                result.options.for_engine(), gap=gap, gap_kind="width", time_limit=left
            )
            found.append((directions, *solved_heights(result, directions, options)))
    matrix, right, points = [cover.matrix], [cover.right], [np.zeros((0, p))]
    for directions, heights, attained in found:
        proved = np.isfinite(heights)
        matrix.append(directions[proved])
        right.append(heights[proved])
        points.append(attained)
    rows = frozen(np.concatenate(matrix)), frozen(np.concatenate(right))
    return replace(cover, matrix=rows[0], right=rows[1]), frozen(np.concatenate(points))


def _directions(known: Reals, cover: Cover) -> list[Reals]:
    """The principal axes of members (M, p), then the diagonals of each pair of them.

    What has one value up to rounding has no part in them: its unit would be that of the rounding.
    """
    width = cover.upper - cover.lower
    moves = width > np.maximum(_FIXED * np.maximum(-cover.lower, cover.upper), _TINY)
    if not moves.any():
        return []
    each = known[:, moves] / width[moves]
    _, _, axes = np.linalg.svd(each - each.mean(axis=0))
    spread = np.ptp(each @ axes.T, axis=0)[:, None]
    even = axes / np.maximum(spread, max(1e-12 * spread.max(), _TINY))  # members have the width 1
    one, two = np.triu_indices(len(axes), 1)
    across = np.concatenate([even[one] + even[two], even[one] - even[two]])
    found = []
    for kind in (axes, across):
        full = np.zeros((2 * len(kind), width.size))
        full[:, moves] = np.concatenate([kind, -kind]) / width[moves]
        found.append(full)
    return [each for each in found if each.size]
