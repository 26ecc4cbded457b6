"""A box of the parameters from cells that simulations tighten, with what proves it.

A node of the tree is a region. Its steps tighten it: rows of the simulation over the region as it
is, and multipliers of them for the largest and least values of each parameter and direction. Then
it is split, or it is a leaf. Every consistent vector lies in a leaf that is not proved empty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.fields import well_formed
from setid.proofs.row_boxes import RowBox, rows_prove
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import Recursion, half_spaces, recursion_of
from setid.proofs.supports import Cover, box_ranges, safe_maxima
from sparsepop_py.verified.uncertain_rows.box import Bounds

__all__ = [
    "SimulatedBox",
    "Step",
    "TreeNode",
    "asked",
    "first_region",
    "split_region",
    "tightened",
    "widened",
]

Reals = NDArray[np.float64]
_WIDER = 1e-12  # of the ends: what a claim leaves to sums in another order


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Multipliers that tighten a region.

    Parameters
    ----------
    rows : (r,) int
        Rows of :func:`setid.proofs.simulated.outputs.half_spaces` that are used.
    weights : (2 (d + q) + 1, r) float
        For the largest values of the parameters and directions, of their negatives, and of 0.
    """

    rows: NDArray[np.int64]
    weights: Reals

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", frozen(np.array(self.rows, np.int64)))
        object.__setattr__(self, "weights", frozen(np.array(self.weights, np.float64)))


@dataclass(frozen=True, slots=True, eq=False)
class TreeNode:
    """A region that is tightened, then split.

    Parameters
    ----------
    steps : tuple of Step
    split : int
        Number of the parameter or direction at which it is split; -1 for a leaf.
    at : float
    children : tuple of int
        Numbers of the nodes below and above, larger than its own; none for a leaf.
    """

    steps: tuple[Step, ...] = ()
    split: int = -1
    at: float = 0.0
    children: tuple[int, ...] = ()


def asked(directions: Reals) -> Reals:
    """List directions that are bounded from above in each region, (2 (d + q) + 1, d)."""
    every = np.concatenate([np.eye(directions.shape[1]), directions])
    return np.concatenate([every, -every, np.zeros((1, directions.shape[1]))])


def first_region(
    formulation: Formulation, lower: Reals, upper: Reals, directions: Reals
) -> Region | None:
    """State the region of a finite box; None where it is empty."""
    nothing = np.zeros((0, lower.size))
    box = Cover(formulation.parameters, lower, upper, nothing, np.zeros(0), False)
    ranges = box_ranges(box, directions)
    return _checked(Region(lower, upper, directions, ranges[:, 0], ranges[:, 1]))


def tightened(region: Region, spaces: Cover, step: Step) -> Region | None:
    """Tighten a region by multipliers of its rows; None where it is proved empty.

    Parameters
    ----------
    region : Region
    spaces : Cover
        Its half spaces.
    step : Step
    """
    most = safe_maxima(spaces, asked(region.directions), step.rows, step.weights)
    if most[-1] < 0.0:
        return None
    d, q = region.lower.size, region.low.size
    high, low = most[: d + q], -most[d + q : -1]
    return _checked(
        replace(
            region,
            lower=np.fmax(region.lower, low[:d]),
            upper=np.fmin(region.upper, high[:d]),
            low=np.fmax(region.low, low[d:]),
            high=np.fmin(region.high, high[d:]),
        )
    )


def split_region(region: Region, split: int, at: float) -> tuple[Region | None, Region | None]:
    """Split a region below and above a number; None for a half that is empty."""
    d = region.lower.size
    own = np.arange(d + region.low.size) == split
    below = replace(
        region,
        upper=np.where(own[:d], np.fmin(region.upper, at), region.upper),
        high=np.where(own[d:], np.fmin(region.high, at), region.high),
    )
    above = replace(
        region,
        lower=np.where(own[:d], np.fmax(region.lower, at), region.lower),
        low=np.where(own[d:], np.fmax(region.low, at), region.low),
    )
    return _checked(below), _checked(above)


def _checked(region: Region) -> Region | None:
    empty = np.any(region.lower > region.upper) or np.any(region.low > region.high)
    return None if empty else region


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SimulatedBox(Bounds):
    """A box of theta from a tree of regions.

    Parameters
    ----------
    names, lower, upper
        As of :class:`sparsepop_py.verified.uncertain_rows.box.Bounds`.
    first : CellBox, DenominatorBox, ParameterBox, DirectionBox, LiftedBox or None
        A box to begin with, where the priors give no finite one.
    directions : (q, d) float
        Along which regions are bounded besides the parameters and first samples.
    nodes : tuple of TreeNode
        The first is the root.
    complete : bool
        Whether time sufficed; says nothing that is trusted.
    """

    first: CellBox | DenominatorBox | RowBox | None
    directions: Reals
    nodes: tuple[TreeNode, ...]
    complete: bool = True

    @property
    def cut_short(self) -> bool:
        """True if time ended before all regions were small."""
        return not self.complete

    @property
    def open(self) -> tuple[str, ...]:
        """Names of parameters that are not bounded on both sides: none."""
        return ()

    @property
    def leaves(self) -> int:
        """Number of leaves, empty ones included."""
        return sum(not node.children for node in self.nodes)

    def verify(self, formulation: Formulation, start: Reals) -> bool:
        """Run every recursion again and apply its multipliers; there is no solver in it."""
        if not well_formed(self):
            return False
        parts = recursion_of(formulation, self.first)
        low, high = start
        if self.first is not None:
            if not _first_follows(self.first, formulation, start):
                return False
            low, high = np.maximum(low, self.first.lower), np.minimum(high, self.first.upper)
        shape = self.directions.shape
        if parts is None or len(shape) != 2 or shape[1] != parts.dimension:
            return False
        low, high = parts.box(low, high)
        if not np.all(np.isfinite([low, high])) or not np.all(np.isfinite(self.directions)):
            return False
        hull = self._hull(formulation, parts, first_region(formulation, low, high, self.directions))
        if hull is None:
            return False
        # where every leaf is empty, whatever is claimed holds
        p = len(formulation.parameters)
        return self.follow(hull[0][:p], hull[1][:p])

    def _hull(
        self, formulation: Formulation, parts: Recursion, root: Region | None
    ) -> tuple[Reals, Reals] | None:
        """Compute the box of all leaves that are not empty; None where the tree is malformed."""
        d = parts.dimension
        low, high = np.full(d, np.inf), np.full(d, -np.inf)
        waiting, seen = [(root, 0)], set[int]()
        while waiting:
            region, number = waiting.pop()
            if number in seen or not 0 <= number < len(self.nodes):
                return None
            seen.add(number)
            node = self.nodes[number]
            region = _after_steps(formulation, parts, region, node)
            if region is None:
                continue
            if not node.children:
                low, high = np.minimum(low, region.lower), np.maximum(high, region.upper)
                continue
            if len(node.children) != 2 or min(node.children) <= number:
                return None
            waiting += zip(split_region(region, node.split, node.at), node.children, strict=True)
        return low, high

    def _text(self) -> str:
        return f"{self.leaves} cells, {Bounds._text(self)}"


def _first_follows(
    first: CellBox | DenominatorBox | RowBox, formulation: Formulation, start: Reals
) -> bool:
    if isinstance(first, CellBox | DenominatorBox):
        return first.verify(formulation, start)
    return rows_prove(first, formulation, start)


def _after_steps(
    formulation: Formulation, parts: Recursion, region: Region | None, node: TreeNode
) -> Region | None:
    for step in node.steps:
        if region is None:
            return None
        spaces = half_spaces(formulation, parts, region)
        rows = step.rows
        if rows.size and not (0 <= rows.min() and rows.max() < spaces.right.size):
            continue
        if step.weights.shape != (len(asked(region.directions)), rows.size):
            continue
        region = tightened(region, spaces, step)
    return region


def widened(lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
    """Widen ends to what is claimed."""
    room = _WIDER * np.maximum(np.abs(lower), np.abs(upper))
    return frozen(lower - room), frozen(upper + room)
