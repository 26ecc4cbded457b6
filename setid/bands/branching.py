"""Search for cells on which the range of an output is narrow: branch and bound.

Cells of the denominator's parameters are halved until the union of their proved ranges is within a
tolerance of what the vertices that the linear programs meet attain, or until the time is over.
Without a time limit it ends, too, where what the last doublings of their number gained forecasts
too many of them.
Everything here only guides: the proof is that of :mod:`setid.proofs.time_bands.partition`.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.bands.model_outputs import (
    attained_by,
    denominator_of,
    force_of,
    impulse_response,
    outputs_of,
)
from setid.bands.verdicts import FLOOR
from setid.feasible_set.proposer import Proposer
from setid.proofs.supports import Cover
from setid.proofs.time_bands.enclosures import Centre, Experiment, Frame
from setid.proofs.time_bands.partition import Partition, Ranges

__all__ = [
    "FIRST_SECONDS",
    "Effort",
    "Branching",
    "branched",
    "principal_frame",
    "surveyed",
]

Reals = NDArray[np.float64]
FIRST_SECONDS = 5.0  # after the time limit, or the limit again if longer: the end of first cells
_GAIN = 0.9  # cells with a larger gain are halved before they are enclosed
_ROUNDING = 1e-10  # of the largest output: narrower ranges need no further cells
_ZERO = 1e-280  # the same where all outputs are zero
_FIRST_SURVEY = 50  # cells at which they are all enclosed where there is no time limit
_DIRECTIONS = 40  # that are looked at for the principal axes of the set


@dataclass(frozen=True, slots=True)
class Effort:
    """Limits at which cells are no longer halved.

    Parameters
    ----------
    tolerance : float
        Share of the attained width by which the proved range may reach beyond it on each side.
    until : float
        Reading of ``time.monotonic``.
    cells : int
        Largest number of cells that are looked at, and that a forecast may call for where there is
        no time limit.
    first : float
        Reading after which the first cell, too, begins no program: the box bounds what is left.
    """

    tolerance: float
    until: float
    cells: int = 20_000
    first: float = inf


@dataclass(frozen=True, slots=True, eq=False)
class Branching:
    """Outcome of the search for cells.

    Parameters
    ----------
    ranges : Ranges or None
        Proved; None where the set is proved empty.
    low, high : (N,) float
        What vertices of the cover attain.
    points : (M, p) float
        Those vertices.
    cells : int
        Number of cells that were looked at.
    left : int
        Number of cells whose union is the range.
    growing : int
        Number of these with a gain of 1 or more.
    excess : float
        Largest distance of the range from what is attained, as a share of the attained width.
    spent : bool
        Whether more time would not have led to more cells.
    """

    ranges: Ranges | None
    low: Reals
    high: Reals
    points: Reals
    cells: int
    left: int
    growing: int
    excess: float
    spent: bool


@dataclass(slots=True, eq=False)
class _Leaf:
    """Facts about a cell that choices use."""

    number: int
    source: Proposer
    centre: Centre
    gain: float
    cost: Reals  # (q, N), or (q, 1) before it is enclosed
    enclosed: bool


@dataclass(slots=True, eq=False)
class _Search:
    experiment: Experiment
    cover: Cover
    effort: Effort
    settle: int  # samples of the impulse response that are kept
    partition: Partition
    force: Reals
    low: Reals
    high: Reals
    points: dict[bytes, Reals] = field(default_factory=dict)
    leaves: dict[int, _Leaf] = field(default_factory=dict)
    cells: int = 0
    slowest: float = 0.0  # seconds for one enclosure
    reached: list[float] = field(default_factory=list)  # excess at forecasts
    spent: bool = False

    def run(self, seeds: list[NDArray[np.int64]]) -> Branching:
        heap: list[tuple[float, int]] = []
        for number in self.partition.numbers:
            self._look(number, seeds, heap, self.effort.first)
        while heap:
            _, number = heapq.heappop(heap)
            worst = self._excess(number)  # less than it was when more points are known
            if heap and worst < -heap[0][0]:
                heapq.heappush(heap, (-worst, number))
                continue
            cell = self.partition.cell(number)
            parts = cell.tight[0].size  # none where nothing is fed back
            if worst <= self.effort.tolerance or not self._more(parts):
                break
            leaf = self.leaves[number]
            if not self.slowest:  # what its parts will take is not known otherwise
                self._enclose(leaf, inf)
            axis = self._axis(leaf)
            at = float((cell.tight[0][axis] + cell.tight[1][axis]) / 2)
            if not cell.box[0][axis] < at < cell.box[1][axis]:  # rounding is all that is left
                self.spent = True
                break
            del self.leaves[number]
            for part in self.partition.cut(number, axis, at):
                self._look(part, leaf.source.bases, heap)
        return self._found()

    def _more(self, parts: int) -> bool:
        """Check for time for both halves of another cell and for those not enclosed yet."""
        due = _FIRST_SURVEY << len(self.reached)
        surveyed = self.effort.until == inf and self.cells >= due
        needed = self._forecast() if surveyed else float(self.cells)
        self.spent = not parts or max(needed, self.cells) >= self.effort.cells
        waiting = 2 + sum(not leaf.enclosed for leaf in self.leaves.values())
        timely = time.monotonic() + self.slowest * waiting < self.effort.until
        return timely and needed > 0.0 and not self.spent

    def _forecast(self) -> float:
        """Forecast the number of cells from what its last two doublings gained; 0 if all is done.

        Two doublings took the excess from b to c. If it goes on falling so, the tolerance t takes
        2 log(c / t) / log(b / c) more of them.
        All cells are enclosed for that, those of large gain too.
        """
        excess = self._excess_of_all()
        self.reached.append(excess)
        if excess <= self.effort.tolerance:
            return 0.0
        if len(self.reached) < 3:
            return float(self.cells)
        before = self.reached[-3]
        if not excess < before:
            return inf
        with np.errstate(all="ignore"):
            doublings = 2.0 * np.log(excess / self.effort.tolerance) / np.log(before / excess)
            return float(self.cells * np.exp2(doublings))

    def _excess_of_all(self) -> float:
        """Find the largest excess of a cell, after those that wait are enclosed."""
        for leaf in self.leaves.values():
            if not leaf.enclosed and self._excess(leaf.number) > self.effort.tolerance:
                self._enclose(leaf, inf)
        return max((self._excess(number) for number in self.leaves), default=0.0)

    def _look(
        self,
        number: int,
        seeds: list[NDArray[np.int64]],
        heap: list[tuple[float, int]],
        until: float = inf,
    ) -> None:
        """Enclose a cell, or find it empty."""
        self.cells += 1
        source = Proposer(self.partition.polytope(number), seeds, until)
        if not self.partition.tighten(number, source):
            return
        if source.contradictory:
            weights = source.contradiction()
            if weights is not None and self.partition.drop(number, weights):
                return
        leaf = _Leaf(number, source, self._centre(number, source), inf, np.zeros((0, 0)), False)
        self.leaves[number] = leaf
        self._enclose(leaf, _GAIN)
        heapq.heappush(heap, (-self._excess(number), number))

    def _enclose(self, leaf: _Leaf, limit: float) -> None:
        begin = time.monotonic()
        known, found = self.partition.enclose(leaf.number, leaf.centre, leaf.source, limit)
        leaf.gain, leaf.enclosed = known.gain, found is not None
        each = np.abs(known.spread).max(axis=0)[:, None] * np.abs(known.slopes)
        leaf.cost = each.sum(axis=1, keepdims=True) if found is None else found.cost
        for point in leaf.source.points:
            self.attain(point)
        if found is not None:
            self.slowest = max(self.slowest, time.monotonic() - begin)

    def attain(self, theta: Reals) -> None:
        """Take the outputs of a point into what is attained, once."""
        width = np.maximum(self.cover.upper - self.cover.lower, 1e-300)
        key = np.round(theta / width, 6).tobytes()
        if key in self.points:
            return
        self.points[key] = theta
        low, high = attained_by(self.experiment, theta, self.force)
        if np.all(np.isfinite(low) & np.isfinite(high)):
            self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)

    def _centre(self, number: int, source: Proposer) -> Centre:
        """Take the middle of the cell, and the other parameters from the mean vertex."""
        points, cell = source.points, self.partition.cell(number)
        frame = self.partition.frame
        theta = points.mean(axis=0) if len(points) else self.cover.centre.copy()
        theta[frame.columns] = frame.back @ ((cell.tight[0] + cell.tight[1]) / 2)
        count = self.experiment.samples
        with np.errstate(all="ignore"):
            impulse = impulse_response(denominator_of(self.experiment, theta), count)
            outputs = outputs_of(self.experiment, theta, self.force)
        if self.settle < count:
            impulse[self.settle :] = 0.0
            still = min(2 * self.settle, outputs.size - 1)
            outputs[still:] = outputs[still]
        return Centre(theta, outputs, impulse)

    # ---- choices ------------------------------------------------------------------------

    def _scale(self) -> Reals:
        width = self.high - self.low
        top = float(width.max(initial=0.0))
        size = float(np.abs([self.low, self.high]).max(initial=0.0)) if len(self.points) else 0.0
        least = _ROUNDING * size if np.isfinite(size) else 0.0  # no cell narrows rounding
        return np.asarray(np.maximum(width, max(FLOOR * top, least, _ZERO)), np.float64)

    def _beyond(self, number: int) -> Reals:
        """Measure how far a cell's range reaches beyond what is attained, in widths, (N,)."""
        ranges = self.partition.range_of(number)
        if not len(self.points):
            return np.full(self.low.size, inf)
        with np.errstate(invalid="ignore"):
            gap = np.maximum(ranges.high - self.high, self.low - ranges.low) / self._scale()
        return np.where(np.isnan(gap), inf, gap)

    def _excess(self, number: int) -> float:
        leaf = self.leaves[number]
        beyond = float(self._beyond(number)[self.experiment.first.size :].max(initial=-inf))
        return beyond if leaf.enclosed or beyond <= self.effort.tolerance else inf

    def _axis(self, leaf: _Leaf) -> int:
        """Choose the coordinate that adds most width where the range reaches farthest beyond."""
        if not leaf.enclosed or leaf.cost.shape[1] < self.low.size:
            return int(np.argmax(leaf.cost[:, 0]))
        place = int(np.argmax(self._beyond(leaf.number)))
        column = leaf.cost[:, place]
        return int(np.argmax(column if np.all(np.isfinite(column)) else leaf.cost[:, -1]))

    def _found(self) -> Branching:
        excess = self._excess_of_all()
        growing = sum(not leaf.gain < 1.0 for leaf in self.leaves.values())
        points = np.array(list(self.points.values())).reshape(-1, self.cover.lower.size)
        ranges, left = self.partition.ranges(), len(self.leaves)
        counts = self.cells, left, growing
        return Branching(ranges, self.low, self.high, points, *counts, excess, self.spent)


def branched(
    experiment: Experiment,
    cover: Cover,
    effort: Effort,
    points: Reals | None = None,
    settle: int | None = None,
) -> Branching:
    """Bound an output by cells of the denominator's parameters.

    Parameters
    ----------
    experiment : Experiment
        With at least one sample after the first ones.
    cover : Cover
        A finite one.
    effort : Effort
    points : (M, p) float, optional
        Parameter vectors whose outputs are attained, besides the vertices that are met.
    settle : int, optional
        Samples after which the impulse response of the centre is cut off, so that a bound for
        all time can be proved; the input must be constant in the last ones.
    """
    columns = experiment.row.columns
    root = surveyed(cover, columns, effort.first)
    width = np.maximum(cover.upper - cover.lower, 1e-300)
    frame = principal_frame(root.points, columns, width[columns])
    partition = Partition(experiment, cover, frame, root)
    far = np.full(len(experiment.u), inf)
    count = experiment.samples if settle is None else settle
    force = force_of(experiment, cover)
    search = _Search(experiment, cover, effort, count, partition, force, far, -far)
    for point in root.points if points is None else np.concatenate([points, root.points]):
        search.attain(point)
    m = len(cover.right)
    sides = [np.where(rows < m, rows, rows + 2 * columns.size) for rows in root.bases]
    return search.run(sides)


def surveyed(cover: Cover, columns: NDArray[np.int64], until: float = inf) -> Proposer:
    """Choose bases of a cover for directions all around, most of them of some parameters."""
    source = Proposer(cover, until=until)
    rng, p = np.random.default_rng(0), cover.lower.size
    width = np.maximum(cover.upper - cover.lower, 1e-300)
    wanted = rng.standard_normal((_DIRECTIONS, p)) / width
    wanted[:, columns] *= 3.0
    for _ in source.multipliers(np.concatenate([wanted, np.diag(1.0 / width)])):
        pass
    return source


def principal_frame(points: Reals, columns: NDArray[np.int64], width: Reals) -> Frame:
    """Compute the principal axes of points, in units of the box."""
    q = columns.size
    if len(points) < 2 or not q:
        return Frame(columns, np.eye(q) / width[:, None], np.eye(q) * width)
    a = points[:, columns]
    _, _, axes = np.linalg.svd((a - a.mean(axis=0)) / width)
    return Frame(columns, axes / width, axes.T * width[:, None])
