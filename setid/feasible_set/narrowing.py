"""Proved ranges of chosen functions, where a question needs a narrower cover of a feasible set.

Where noise couples the rows, the rows in theta alone say little more than the outer box, although
members fill a thin part of it. What a band asks of the set are ranges of linear functions, such as
outputs to first order. The engine proves those that are widest beside what members reach, roughly
first, then more closely where the same function is the widest again.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import EmptySetError
from setid.feasible_set.coordinates import Coordinates, asked_of, parameter_coordinates
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.supports import supports
from setid.formulation.units import in_units
from setid.proofs.existence import admitted
from setid.proofs.supports import Cover

__all__ = ["Narrowing", "narrowing_of", "solved_heights"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_FIRST, _LAST, _FALL = 0.5, 0.01, 4.0  # gaps in widths: the first one, the last, and its fall
_MOST = 1e300  # an excess that is infinite counts as this
_AT_ONCE = 3  # functions that the engine is asked about together


def solved_heights(
    result: FeasibleSet,
    directions: Reals,
    options: sp.Options,
    coordinates: Coordinates | None = None,
) -> tuple[Reals, Reals]:
    """Bound linear functions of theta, or of other coordinates, by the engine.

    Parameters
    ----------
    result : FeasibleSet
    directions : (K, n) float
    options : sparsepop_py.Options
    coordinates : Coordinates, optional
        The parameters when left out.

    Returns
    -------
    heights : (K,) float
        Proved upper bounds, infinite where the engine has none.
    points : (M, p) float
        Consistent parameter vectors that the engine found.

    Raises
    ------
    EmptySetError
        If the engine proves that the set is empty, which the result does not say.
    """
    result, unknowns = asked_of(result, coordinates or parameter_coordinates(result))
    formulation = result.formulation
    scaled = in_units(result.problem, formulation)
    p, known = len(formulation.parameters), len(unknowns)
    heights = np.full(len(directions), inf)
    about = np.flatnonzero(~np.any(directions[:, known:], axis=1))
    if not about.size:
        return heights, np.zeros((0, p))
    asked = [scaled.asked(_negated(unknowns, d)) for d in directions[about, :known].tolist()]
    objectives, factors = zip(*asked, strict=True)
    found = sp.solve_each(scaled.problem, objectives, options)
    units = scaled.units
    points = [
        point.x[:p] * units[:p]
        for point in (r.attained for r in found if r.attained is not None)
        if admitted(formulation, point.x[:p] * units[:p], point.radius * units[:p])
    ]
    proved = -np.array([r.lower_bound for r in found]) * factors
    if np.any(proved == -inf):
        raise EmptySetError(
            "result: found a set that is now proved empty: identify the record again"
        )
    heights[about] = np.where(np.isnan(proved), inf, proved + 4 * _EPS * np.abs(proved))
    return heights, np.reshape(points, (-1, p))


def _negated(unknowns: Sequence[sp.Polynomial], direction: Sequence[float]) -> sp.Polynomial:
    return sp.total([unknown * -value for unknown, value in zip(unknowns, direction, strict=True)])


@dataclass(slots=True, eq=False)
class Narrowing:
    """A cover of a feasible set that is not exact, and what has been asked to narrow it. Mutable.

    Parameters
    ----------
    result : FeasibleSet
        With finite intervals.
    coordinates : Coordinates
    cover : Cover
        In these coordinates.
    points : (M, p) float
        Members that were found on the way.
    gaps : dict of bytes to float
        Next gap for each function that was asked about.
    """

    result: FeasibleSet
    coordinates: Coordinates
    cover: Cover
    points: Reals
    gaps: dict[bytes, float] = field(default_factory=dict)

    def excess(self, functions: Reals, tolerance: float) -> Reals:
        """Find by how much ranges of functions are too wide, beside those of members.

        Parameters
        ----------
        functions : (N, n) float
        tolerance : float
            Share of the members' range that may be added on each side.

        Returns
        -------
        (N,) float
            In widths of the members' range; 0 where that is empty.
        """
        known = self.coordinates.values(np.concatenate([self.result.attained, self.points]))
        reached = np.ptp(known @ functions.T, axis=0) if len(known) else np.zeros(len(functions))
        width = np.ptp(supports(self.cover, functions), axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (width - reached) / reached - 2 * tolerance
        return np.where(np.isfinite(found), found, 0.0)

    def narrow(self, functions: Reals, excess: Reals, until: float) -> bool:
        """Ask for ranges of functions that reach too far.

        Parameters
        ----------
        functions : (N, n) float
            Coefficients.
        excess : (N,) float
            By how much the range of each is too wide; nothing is asked where it is not positive.
        until : float
            Reading of ``time.monotonic``.

        Returns
        -------
        bool
            Whether anything was asked.
        """
        chosen = self._chosen(functions, excess)
        left = until - time.monotonic()
        if not chosen or left <= 0.0:
            return False
        keys = [functions[place].tobytes() for place in chosen]
        gap = min(self.gaps.get(key, _FIRST) for key in keys)
        directions = np.concatenate([functions[chosen], -functions[chosen]])
        engine, limit = self.result.options.for_engine(), None if left == inf else left
        options = replace(engine, gap=gap, gap_kind="width", time_limit=limit)
        heights, points = solved_heights(self.result, directions, options, self.coordinates)
        proved = np.isfinite(heights)
        cover = self.cover  # once: threads that ask about one result share it
        matrix = np.concatenate([cover.matrix, directions[proved]])
        right = np.concatenate([cover.right, heights[proved]])
        self.cover = replace(cover, matrix=frozen(matrix), right=frozen(right))
        self.points = np.concatenate([self.points, points])
        if time.monotonic() < until:  # else the gap may not have been reached
            self.gaps |= dict.fromkeys(keys, gap / _FALL)
        return True

    def _chosen(self, functions: Reals, excess: Reals) -> list[int]:
        """Choose the widest functions, each as little as possible like those before it."""
        shapes = functions * (self.cover.upper - self.cover.lower)
        size = np.linalg.norm(shapes, axis=1)
        known = len(asked_of(self.result, self.coordinates)[1])
        usable = (size > 0) & np.isfinite(size) & ~np.any(functions[:, known:], axis=1)
        left = np.where(usable, np.minimum(excess, _MOST), 0.0)
        for place in np.flatnonzero(left > 0).tolist():
            if self.gaps.get(functions[place].tobytes(), _FIRST) < _LAST:
                left[place] = 0.0
        shapes = np.where(usable[:, None], shapes / np.where(usable, size, 1.0)[:, None], 0.0)
        worth, chosen = left, list[int]()
        while len(chosen) < _AT_ONCE and worth.max(initial=0.0) > 0.0:
            chosen.append(int(np.argmax(worth)))
            basis, _ = np.linalg.qr(shapes[chosen].T)
            away = np.linalg.norm(shapes - shapes @ basis @ basis.T, axis=1)
            worth = left * np.where(away > 1e-6, away, 0.0)
        return chosen


@lru_cache(maxsize=4)
def narrowing_of(result: FeasibleSet, coordinates: Coordinates) -> Narrowing:
    """Start from the plain cover of a result, or go on where an earlier question ended.

    All questions about a result share one object: what narrows it for one holds for the others.

    Parameters
    ----------
    result : FeasibleSet
    coordinates : Coordinates

    Raises
    ------
    SetidError
        If the feasible set is empty.
    """
    none = np.zeros((0, len(result.formulation.parameters)))
    return Narrowing(result, coordinates, coordinates.cover(result), none)
