"""Cells of the denominator's parameters that cover a set, with what is proved on each.

Where cells are cut, in which order and around which centre they are enclosed may come from
anywhere. What makes the union a proof is here: neighbours share the number that parts them, a cell
leaves the partition only if it is proved empty, and every cell has a range, its own or that of the
cell it was cut from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.proofs.supports import Cover, Multipliers, safe_maxima, supports
from setid.proofs.time_bands.enclosures import (
    Centre,
    Enclosure,
    Experiment,
    Frame,
    Leak,
    enclosure,
    leak,
)

__all__ = ["Attempt", "Cell", "Partition", "Ranges"]

Reals = NDArray[np.float64]


class Ranges(NamedTuple):
    """Proved ranges of an output: of the model's, and of the system's with equation errors.

    Parameters
    ----------
    low, high, driven_low, driven_high : (N,) float
    later : (2,) float
        After the last sample.
    """

    low: Reals
    high: Reals
    driven_low: Reals
    driven_high: Reals
    later: Reals

    def joined(self, other: Ranges) -> Ranges:
        """What contains both."""
        return self._by(other, np.minimum, np.maximum)

    def met(self, other: Ranges) -> Ranges:
        """What is in both."""
        return self._by(other, np.maximum, np.minimum)

    def _by(self, other: Ranges, low: np.ufunc, high: np.ufunc) -> Ranges:
        later = np.array([low(self.later[0], other.later[0]), high(self.later[1], other.later[1])])
        return Ranges(
            low(self.low, other.low),
            high(self.high, other.high),
            low(self.driven_low, other.driven_low),
            high(self.driven_high, other.driven_high),
            later,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """The members of a set with low <= s <= high.

    Parameters
    ----------
    low, high : (q,) float
        Of the coordinates, where the cell was cut.
    tight : (low, high), each (q,) float
        Proved range of them on the cell.
    ranges : Ranges
        Of the output.
    """

    low: Reals
    high: Reals
    tight: tuple[Reals, Reals]
    ranges: Ranges


class Attempt(NamedTuple):
    """What one try to enclose a cell found.

    Parameters
    ----------
    leak : Leak
    found : Enclosure or None
        None where the gain was above the limit.
    """

    leak: Leak
    found: Enclosure | None


class Partition:
    """Cells that cover the members of a cover.

    Parameters
    ----------
    experiment : Experiment
        With at least one sample after the first ones.
    cover : Cover
        A finite one.
    frame : Frame
    source : Multipliers
        For the rows of the cover; not trusted.
    """

    def __init__(
        self, experiment: Experiment, cover: Cover, frame: Frame, source: Multipliers
    ) -> None:
        self._experiment, self._cover, self._frame = experiment, cover, frame
        self._directions = frame.directions(cover.lower.size)
        high = np.full(len(experiment.u), np.inf)
        unknown = Ranges(-high, high, -high, high, np.array([-np.inf, np.inf]))
        low, high = supports(cover, self._directions, lambda _: source).T
        whole = Cell(frozen(low.copy()), frozen(high.copy()), (low, high), unknown)
        self._cells = {0: whole}
        self._next = 1

    @property
    def frame(self) -> Frame:
        """Coordinates in which cells are cut."""
        return self._frame

    @property
    def numbers(self) -> list[int]:
        """Numbers of the cells that are left."""
        return list(self._cells)

    def cell(self, number: int) -> Cell:
        """A cell that is left."""
        return self._cells[number]

    def polytope(self, number: int) -> Cover:
        """A cell as a cover: the rows of the set, then those of the coordinates' two sides."""
        cell, cover = self._cells[number], self._cover
        matrix = np.concatenate([cover.matrix, self._directions, -self._directions])
        low, high = np.maximum(cell.low, cell.tight[0]), np.minimum(cell.high, cell.tight[1])
        return replace(cover, matrix=matrix, right=np.concatenate([cover.right, high, -low]))

    def tighten(self, number: int, source: Multipliers) -> bool:
        """Shrink the proved range of a cell's coordinates; False where the cell is proved empty.

        Parameters
        ----------
        number : int
        source : Multipliers
            For the rows of :meth:`polytope`.
        """
        cell = self._cells[number]
        low, high = supports(self.polytope(number), self._directions, lambda _: source).T
        low, high = np.maximum(low, cell.tight[0]), np.minimum(high, cell.tight[1])
        if np.any(np.maximum(low, cell.low) > np.minimum(high, cell.high)):
            del self._cells[number]
            return False
        self._cells[number] = replace(cell, tight=(low, high))
        return True

    def drop(self, number: int, weights: Reals) -> bool:
        """Leave a cell out where multipliers (m,) of its rows prove that it is empty."""
        nothing = np.zeros((1, self._cover.lower.size))
        bound = safe_maxima(
            self.polytope(number), nothing, np.arange(weights.size), weights[None, :]
        )
        if bound[0] < 0.0:
            del self._cells[number]
            return True
        return False

    def cut(self, number: int, axis: int, at: float) -> tuple[int, int]:
        """Part a cell at a value of one coordinate; returns the numbers of the parts."""
        cell = self._cells.pop(number)
        below, above = cell.high.copy(), cell.low.copy()
        below[axis] = above[axis] = at
        first = self._next
        self._next += 2
        self._cells[first] = replace(cell, high=below)
        self._cells[first + 1] = replace(cell, low=above)
        return first, first + 1

    def enclose(
        self, number: int, centre: Centre, source: Multipliers, limit: float = np.inf
    ) -> Attempt:
        """Bound the output on a cell.

        Parameters
        ----------
        number : int
        centre : Centre
        source : Multipliers
            For the rows of :meth:`polytope`.
        limit : float
            Of the gain above which nothing more is tried.
        """
        assert centre.fits(self._experiment)
        cell, polytope = self._cells[number], self.polytope(number)
        with np.errstate(over="ignore", invalid="ignore"):
            row, task = self._experiment.row, self._experiment
            box = np.maximum(cell.low, cell.tight[0]), np.minimum(cell.high, cell.tight[1])
            known = leak(row, self._frame, box, polytope, centre, lambda _: source)
            if not known.gain <= limit:
                return Attempt(known, None)
            found = enclosure(task, polytope, centre, known, lambda _: source)
        ranges = cell.ranges.met(Ranges(*found[:5]))
        self._cells[number] = replace(cell, ranges=ranges)
        return Attempt(known, found)

    def ranges(self) -> Ranges | None:
        """Join the ranges of all cells; None where every cell is proved empty."""
        found = [cell.ranges for cell in self._cells.values()]
        if not found:
            return None
        joined = found[0]
        for ranges in found[1:]:
            joined = joined.joined(ranges)
        return joined
