"""Grow the tree of regions that proves a box of the parameters by simulations.

Over a region each output is affine in the parameters up to a remainder
(:mod:`setid.proofs.simulated.forms`), so that readings give half spaces. Multipliers of these
tighten the region. The one that reaches farthest beyond the attained ends is split first.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.feasible_set.proposer import Proposer
from setid.formulation.formulation import Formulation
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.row_boxes import RowBox
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import Recursion, half_spaces
from setid.proofs.simulated.tree import (
    SimulatedBox,
    Step,
    TreeNode,
    asked,
    first_region,
    split_region,
    tightened,
    widened,
)
from setid.proofs.supports import Cover
from sparsepop_py.budget import Deadline

__all__ = ["SplitLimits", "principal_directions", "simulated_box"]

Reals = NDArray[np.float64]
_STEPS = 12  # in a row at one region
_GAIN = 0.8  # of a width: a step that leaves more is the last one


@dataclass(slots=True)
class _RegionNode:
    """A region, and what its node of the tree will record."""

    region: Region | None
    steps: list[Step] = field(default_factory=list)
    split: int = -1
    at: float = 0.0
    children: tuple[_RegionNode, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SplitLimits:
    """Limits at which regions are no longer split.

    Parameters
    ----------
    attained : (lower, upper), each (p,) float, or None
        Ends that consistent parameters reach.
    tol : float
        Of the attained widths: a region that reaches less far beyond these ends is not split.
    deadline : Deadline
    splits : float
        Regions that are split at most.
    near : float
        Of the attained widths: where the first region reaches farther beyond, none is split.
    """

    attained: tuple[Reals, Reals] | None
    tol: float
    deadline: Deadline
    splits: float = inf
    near: float = inf


def principal_directions(slopes: Reals, units: Reals) -> Reals:
    """Find directions (p, p) along which outputs change independently of each other.

    Parameters
    ----------
    slopes : (R, p) float
        Of errors in noise bounds.
    units : (p,) float
        Sizes of the parameters.
    """
    small = np.linalg.qr(slopes * units, mode="r")  # the left factor of many rows is large
    right = np.linalg.svd(small, full_matrices=True)[2]
    return np.asarray(right / units, np.float64)


def simulated_box(
    formulation: Formulation,
    recursion: Recursion,
    box: tuple[Reals, Reals],
    first: CellBox | DenominatorBox | RowBox | None,
    directions: Reals,
    limits: SplitLimits,
) -> SimulatedBox | None:
    """Tighten a finite box by simulations over regions; None where it is not finite.

    Parameters
    ----------
    formulation : Formulation
    recursion : Recursion
        The record as a simulation.
    box : (lower, upper), each (d,) float
        Of the parameters, and of first samples that no equation gives.
    first : CellBox, DenominatorBox, RowBox or None
        What proved the box, where priors alone do not.
    directions : (q, d) float
        Linear functions of these unknowns that are bounded beside them; rows as of
        :func:`principal_directions`.
    limits : SplitLimits
    """
    if not np.all(np.isfinite(box)):
        return None
    region = first_region(formulation, *box, directions)
    root = _RegionNode(region)
    grower = _Grower(formulation, recursion, limits)
    complete = grower.grow(root)
    leaves = [g.region for g in grower.leaves if g.region is not None]
    p = len(formulation.parameters)
    lower, upper = np.full(p, np.inf), np.full(p, -np.inf)
    if leaves:
        lower = np.min([r.lower[:p] for r in leaves], axis=0)
        upper = np.max([r.upper[:p] for r in leaves], axis=0)
        lower, upper = widened(lower, upper)
    return SimulatedBox(
        formulation.parameters, lower, upper, first, directions, _numbered(root), complete
    )


def _numbered(root: _RegionNode) -> tuple[TreeNode, ...]:
    """Number all nodes, parents before their children."""
    every, found = [root], list[TreeNode]()
    for node in every:
        children = tuple(range(len(every), len(every) + len(node.children)))
        every += node.children
        found.append(TreeNode(tuple(node.steps), node.split, node.at, children))
    return tuple(found)


class _Grower:
    """A tree of regions while it grows. Mutable."""

    def __init__(self, formulation: Formulation, recursion: Recursion, limits: SplitLimits) -> None:
        self._formulation, self._recursion, self._limits = formulation, recursion, limits
        self.leaves: list[_RegionNode] = []

    def grow(self, root: _RegionNode) -> bool:
        """Tighten and split regions, the one that reaches farthest first; whether time sufficed."""
        self._tighten(root)
        if root.region is None:
            return True
        if self._beyond(root.region) > self._limits.near:
            self.leaves.append(root)
            return False
        scale = np.maximum(_widths(root.region), 1e-300)
        scale[self._recursion.readings] = np.inf  # outputs are affine in them, nearly
        waiting: list[tuple[float, int, _RegionNode]] = []
        count = 0
        self._file(root, waiting, count)
        while waiting:
            _, _, node = heapq.heappop(waiting)
            if self._limits.deadline.over or count >= 2 * self._limits.splits:
                self.leaves += [node, *(other for _, _, other in waiting)]
                return False
            assert node.region is not None
            node.split, node.at = self._cut(node.region, scale)
            halves = split_region(node.region, node.split, node.at)
            node.children = tuple(_RegionNode(half) for half in halves)
            for child in node.children:
                self._tighten(child)
                count += 1
                self._file(child, waiting, count)
        return True

    def _file(
        self, node: _RegionNode, waiting: list[tuple[float, int, _RegionNode]], count: int
    ) -> None:
        beyond = self._beyond(node.region)
        if beyond <= self._limits.tol:
            self.leaves.append(node)
        else:
            heapq.heappush(waiting, (-beyond, count, node))

    def _beyond(self, region: Region | None) -> float:
        """Measure how far a region reaches beyond the attained ends, in their widths."""
        if region is None:
            return 0.0
        if self._limits.attained is None:
            return float(np.max(region.upper - region.lower)) + 1.0
        low, high = self._limits.attained
        width = np.maximum(high - low, 1e-12 * np.maximum(np.abs(low), np.abs(high)) + 1e-300)
        p = low.size
        beyond = np.maximum(low - region.lower[:p], region.upper[:p] - high)
        return float(np.max(beyond / width))

    def _cut(self, region: Region, scale: Reals) -> tuple[int, float]:
        """Choose the widest parameter or direction, in the root's widths, and its middle."""
        low = np.append(region.lower, region.low)
        high = np.append(region.upper, region.high)
        split = int(np.argmax((high - low) / scale))
        return split, float(low[split] / 2 + high[split] / 2)

    def _tighten(self, node: _RegionNode) -> None:
        for _ in range(_STEPS):
            if node.region is None or self._limits.deadline.over:
                return
            before = _widths(node.region)
            spaces = half_spaces(self._formulation, self._recursion, node.region)
            step = _step(spaces, asked(node.region.directions))
            if step is None:
                return
            node.region = tightened(node.region, spaces, step)
            node.steps.append(step)
            if node.region is None or self._beyond(node.region) <= self._limits.tol:
                return
            if np.all(_widths(node.region) >= _GAIN * before):
                return


def _widths(region: Region) -> Reals:
    return np.append(region.upper - region.lower, region.high - region.low)


def _step(every: Cover, wanted: Reals) -> Step | None:
    """Propose multipliers of the rows that cut the box, by linear programs."""
    middle, far = every.centre, every.spread
    cuts = np.flatnonzero(every.matrix @ middle + np.abs(every.matrix) @ far > every.right)
    spaces = replace(every, matrix=every.matrix[cuts], right=every.right[cuts])
    found = _multipliers(spaces, wanted)
    return None if found is None else replace(found, rows=cuts[found.rows])


def _multipliers(spaces: Cover, wanted: Reals) -> Step | None:
    proposer = Proposer(spaces)
    parts = list(proposer.multipliers(wanted[:-1]))
    if proposer.contradictory:
        found = proposer.contradiction()
        if found is None:
            return None
        rows = np.flatnonzero(found > 0.0)
        weights = np.zeros((len(wanted), rows.size))
        weights[-1] = found[rows]
        return Step(rows, weights)
    rows = np.unique(np.concatenate([part.rows for part in parts] or [np.zeros(0, np.int64)]))
    weights = np.zeros((len(wanted), rows.size))
    for part in parts:
        weights[np.ix_(part.places, np.searchsorted(rows, part.rows))] = part.weights
    return Step(rows, weights)
