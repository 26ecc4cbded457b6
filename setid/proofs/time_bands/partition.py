"""Cells of the denominator's parameters, with the range of an output that is proved on each.

Any rule may choose the centres. A cell whose range is not computed keeps the range of the cell that
was branched into it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.proofs.cells.cells import Cells
from setid.proofs.supports import Cover, Multipliers
from setid.proofs.time_bands.enclosures import (
    Centre,
    Enclosure,
    Experiment,
    Frame,
    Leak,
    enclosure,
    leak,
)

__all__ = ["Attempt", "Partition", "Ranges"]

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
        """Join ranges: each contains both."""
        return self._by(other, np.minimum, np.maximum)

    def met(self, other: Ranges) -> Ranges:
        """Intersect ranges."""
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


class Attempt(NamedTuple):
    """Enclosure of one cell, as found.

    Parameters
    ----------
    leak : Leak
    found : Enclosure or None
        None where the gain was above the limit.
    """

    leak: Leak
    found: Enclosure | None


class Partition(Cells):
    """Cells of the denominator's parameters with ranges of an output.

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
        super().__init__(cover, frame.directions(cover.lower.size), source)
        self._experiment, self._frame = experiment, frame
        high = np.full(len(experiment.u), np.inf)
        self._ranges = {0: Ranges(-high, high, -high, high, np.array([-np.inf, np.inf]))}

    @property
    def frame(self) -> Frame:
        """Coordinates in which cells are cut."""
        return self._frame

    def range_of(self, number: int) -> Ranges:
        """Bound the output on a cell that is left."""
        return self._ranges[number]

    def cut(self, number: int, axis: int, at: float) -> tuple[int, int]:
        """Part a cell at a value of one coordinate; both parts keep its range."""
        first, second = super().cut(number, axis, at)
        self._ranges[first] = self._ranges[second] = self._ranges[number]
        return first, second

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
        polytope, box = self.polytope(number), self.cell(number).box
        with np.errstate(over="ignore", invalid="ignore"):
            row, task = self._experiment.row, self._experiment
            known = leak(row, self._frame, box, polytope, centre, lambda _: source)
            if not known.gain <= limit:
                return Attempt(known, None)
            found = enclosure(task, polytope, centre, known, lambda _: source)
        low, high, driven_low, driven_high, later, _ = found
        ranges = Ranges(low, high, driven_low, driven_high, later)
        self._ranges[number] = self._ranges[number].met(ranges)
        return Attempt(known, found)

    def ranges(self) -> Ranges | None:
        """Join the ranges of all cells; None where every cell is proved empty."""
        found = [self._ranges[number] for number in self.numbers]
        if not found:
            return None
        joined = found[0]
        for ranges in found[1:]:
            joined = joined.joined(ranges)
        return joined
