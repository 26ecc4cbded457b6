"""Verified boxes of parameters from rows |Y + R theta| <= w0 + W |theta|.

Where the signs of theta are known a row is linear. Where a sign is open, |theta_i| is at most its
secant over the bounds known so far, which is linear as well; where no bounds are known, the rows
in which it occurs are left out. So a linear program at a node of the tree bounds all its leaves,
and a node that is infeasible is fathomed with one proof.

A first box is known already, or comes from a left inverse M of R: theta - theta0 = M R (theta -
theta0) + (I - M R)(theta - theta0) gives abs(theta - theta0) <= d + G abs(theta - theta0).

:mod:`sparsepop_py.uncertain_rows.sign_tree` finds such boxes; nothing here runs a linear program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, variables
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.arithmetic.interval import require_ieee
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.uncertain_rows.box import Bounds, Box
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows

__all__ = ["LeftInverse", "ParameterBox", "SignTree", "halves", "hull", "intersect", "linear_rows"]

Reals = NDArray[np.float64]

_UNIT = 2.0**-53
_LEAST = 2.0**-1074  # a product that underflows loses at most this


@dataclass(frozen=True, slots=True, eq=False)
class LeftInverse:
    """A first box around ``centre``, from an approximate left inverse of the regressors.

    Parameters
    ----------
    inverse : (p, R) float
    centre, radius : (p,) float
    """

    inverse: Reals
    centre: Reals
    radius: Reals

    def holds(self, rows: UncertainRows) -> bool:
        """Check abs(theta - centre) <= radius with all rounding errors counted.

        d + G v <= v and G v < v for v = radius > 0 imply it, since G is not negative.
        """
        count, p = rows.regressors.shape
        if self.inverse.shape != (p, count) or self.centre.shape != (p,):
            return False
        if self.radius.shape != (p,) or not np.all(self.radius > 0):
            return False
        drive, coupling = drive_and_coupling(rows, self.inverse, self.centre)
        reached = (coupling @ self.radius + drive) * (1.0 + 1e-12) + (p + 8) * _LEAST
        return bool(np.all(np.isfinite(reached)) and np.all(reached < self.radius))

    def box(self) -> tuple[Reals, Reals]:
        """Compute its ends, rounded outwards."""
        low, high = self.centre - self.radius, self.centre + self.radius
        return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)


def drive_and_coupling(rows: UncertainRows, inverse: Reals, centre: Reals) -> tuple[Reals, Reals]:
    """Compute upper ends of d (p,) and G (p, p)."""
    count, p = rows.regressors.shape
    loss, lost = 2.0 * (count + p + 8) * _UNIT, (count + p + 8) * _LEAST
    size, slope = np.abs(inverse), np.abs(rows.regressors)
    offset = np.abs(rows.target + rows.regressors @ centre)
    offset = offset + loss * (np.abs(rows.target) + slope @ np.abs(centre))
    drive = size @ (offset + rows.radius + rows.radii @ np.abs(centre) + 3 * lost)
    rest = np.abs(np.eye(p) - inverse @ rows.regressors)
    coupling = size @ rows.radii + rest + loss * (size @ slope + np.eye(p))
    return drive * (1.0 + 4 * loss) + lost, coupling * (1.0 + 4 * loss) + 3 * lost


@dataclass(frozen=True, slots=True, eq=False)
class SignTree:
    """Linear programs on the nodes of a tree over the signs of theta.

    Parameters
    ----------
    split : int
        Parameter (from 0) at whose zero the node is branched; -1 for a leaf.
    children : tuple of SignTree
        The nodes theta_i <= 0 and theta_i >= 0, where there are children.
    bounds : tuple of LinearBound
        At a leaf: of theta_1, -theta_1, theta_2, ..., or a single one that proves it empty,
        or none where the time was over: then the box of the node is kept as it is.
    """

    split: int
    children: tuple[SignTree, ...]
    bounds: tuple[LinearBound, ...]

    def leaves(self) -> list[SignTree]:
        """List the nodes without children."""
        return [leaf for child in self.children for leaf in child.leaves()] or [self]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ParameterBox(Bounds):
    """A box that holds every parameter vector with these rows, with its proof.

    Parameters
    ----------
    names, lower, upper
        As of :class:`sparsepop_py.verified.uncertain_rows.box.Bounds`.
    start : (2, p) float
        Bounds that were known already.
    steps : tuple of LeftInverse and SignTree
        What made it smaller, in this order.
    """

    start: Reals
    steps: tuple[LeftInverse | SignTree, ...]

    def verify(self, rows: UncertainRows, start: Reals) -> bool:
        """Replay all steps from the rows, without any solver.

        Parameters
        ----------
        rows : UncertainRows
        start : (2, p) float
            Bounds that are known already.
        """
        require_ieee()
        box = (start[0], start[1])
        for step in self.steps:
            if isinstance(step, LeftInverse):
                if not step.holds(rows):
                    return False
                box = intersect(box, step.box())
            else:
                found = _replay(step, rows, box)
                if found is None:
                    return False
                box = found
        return self.follow(*box)

    @property
    def cut_short(self) -> bool:
        """True if time ended before all nodes had been processed."""
        trees = [step for step in self.steps if isinstance(step, SignTree)]
        return any(not leaf.bounds for tree in trees for leaf in tree.leaves())

    def used_rows(self, rows: UncertainRows) -> dict[int, int]:
        """Count how often the last tree uses each row in a proof of emptiness.

        Parameters
        ----------
        rows : UncertainRows

        Returns
        -------
        dict of int to int
            Rows by number, from 0.
        """
        count: dict[int, int] = {}
        trees = [step for step in self.steps if isinstance(step, SignTree)]
        for leaf in (leaf for tree in trees[-1:] for leaf in tree.leaves() if leaf.bounds):
            used = np.array([number for number, _ in leaf.bounds[0].multipliers], np.int64)
            for row in np.unique(used[used < 2 * rows.target.size] // 2).tolist():
                count[row] = count.get(row, 0) + 1
        return count


def intersect(one: Box, other: Box) -> Box:
    """Intersect two boxes; ends cross where nothing is in both."""
    return np.maximum(one[0], other[0]), np.minimum(one[1], other[1])


def hull(parts: Sequence[Box]) -> Box:
    """Enclose boxes by one; those whose ends cross are empty."""
    full = [part for part in parts if not np.any(part[0] > part[1])]
    if not full:
        return parts[0]
    lows, highs = zip(*full, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def halves(box: Box, place: int) -> tuple[Box, Box]:
    """Split a box at zero of one coordinate: below, then above."""
    high, low = box[1].copy(), box[0].copy()
    high[place], low[place] = min(high[place], 0.0), max(low[place], 0.0)
    return (box[0], high), (low, box[1])


def _replay(tree: SignTree, rows: UncertainRows, box: Box) -> Box | None:
    if np.any(box[0] > box[1]):  # nothing is in it
        return box
    if tree.split >= 0:
        if len(tree.children) != 2 or tree.split >= len(rows.names):
            return None
        ends = halves(box, tree.split)
        parts = [_replay(c, rows, half) for c, half in zip(tree.children, ends, strict=True)]
        found = [part for part in parts if part is not None]
        return hull(found) if len(found) == 2 else None
    if not tree.bounds:
        return box
    problem, objectives = linear_rows(rows, box), signed_variables(len(rows.names))
    empty = tree.bounds[0].status == "INFEASIBLE"
    if len(tree.bounds) != len(objectives) and not (empty and len(tree.bounds) == 1):
        return None
    for bound, objective in zip(tree.bounds, objectives, strict=False):
        if not bound.verify(problem, objective).ok:
            return None
    return nothing(box) if empty else shrunk(box, tree.bounds)


def signed_variables(p: int) -> list[Polynomial]:
    return [sign * x for x in variables(p) for sign in (1.0, -1.0)]


def shrunk(box: Box, bounds: Sequence[LinearBound]) -> Box:
    ends = np.array([bound.lower for bound in bounds])
    return intersect(box, (ends[0::2], -ends[1::2]))


def nothing(box: Box) -> Box:
    return np.full(box[0].size, np.inf), np.full(box[0].size, -np.inf)


def linear_rows(rows: UncertainRows, box: Box) -> Problem:
    """Linearise the rows on a box, all roundings outwards.

    Parameters
    ----------
    rows : UncertainRows
    box : (lower, upper), each (p,)

    Returns
    -------
    Problem
        In theta alone. Constraints 2 k and 2 k + 1 belong to row k.
    """
    p = rows.regressors.shape[1]
    low, high = box
    sign = np.where(low >= 0, 1.0, np.where(high <= 0, -1.0, 0.0))
    noisy = rows.radii > 0
    open_ = (sign == 0.0) & noisy.any(axis=0)
    slope, shift = np.zeros(p), np.zeros(p)
    for i in np.flatnonzero(open_).tolist():
        slope[i], shift[i] = _secant(float(low[i]), float(high[i]))
    lost = np.any(noisy & np.isinf(shift), axis=1)
    reach = np.where(open_ & np.isfinite(shift), np.maximum(np.abs(low), np.abs(high)), 0.0)
    spare = _up(rows.radius + 0.0)
    for i in np.flatnonzero(open_ & np.isfinite(shift)).tolist():
        spare = _up(spare + _up(rows.radii[:, i] * shift[i]))
    parts: list[list[Constraint]] = []
    for side in (1.0, -1.0):
        regressors, target = side * rows.regressors, side * rows.target
        settled = sign * _up(rows.radii - sign * regressors)
        rough = rows.radii * slope - regressors
        error = 4 * _UNIT * (np.abs(rows.radii * slope) + np.abs(regressors))
        error = (error + 2 * _LEAST) * reach + _LEAST
        used = open_ & noisy & np.isfinite(shift)
        matrix = np.where(noisy, np.where(used, rough, settled), -regressors)
        room = _up(spare - target)
        room = _up(room + _up(np.where(used, error, 0.0).sum(axis=1) * (1 + 1e-14)))
        matrix[lost], room[lost] = 0.0, 1.0
        parts.append(_constraints(matrix, room, p))
    both = [row for pair in zip(*parts, strict=True) for row in pair]
    return Problem(variables(p)[0], both, low, high, rows.names)


def _secant(low: float, high: float) -> tuple[float, float]:
    """Compute (s, c) with abs(x) <= s x + c on [low, high].

    c is infinite if an end is.
    """
    if np.isinf(low) or np.isinf(high):
        return 0.0, np.inf
    slope = (high + low) / (high - low)
    ends = [high - slope * high, -low - slope * low]
    return slope, float(max(ends) + 8 * _UNIT * max(-low, high) + 4 * _LEAST)


def _up(values: Reals) -> Reals:
    return np.nextafter(values, np.inf)


def _constraints(matrix: Reals, room: Reals, p: int) -> list[Constraint]:
    """Rows matrix theta + room >= 0.

    Raises
    ------
    ProblemError
        If a number is not finite.
    """
    words = frozen(np.arange(p + 1, dtype=np.int32)[:, None])
    table = np.column_stack([room, matrix])
    table[:, 0] = np.where(table.any(axis=1), table[:, 0], 1.0)  # 0 >= 0 becomes 1 >= 0
    if not np.all(np.isfinite(table)):
        raise ProblemError("rows on a box: found numbers beyond the largest double")
    found = []
    for row, kept in zip(frozen(table), table != 0.0, strict=True):
        letters, values = (words, row) if kept.all() else (words[kept], row[kept])
        made = Polynomial._of_sorted(letters, values, p)  # distinct, in order, none zero
        found.append(Constraint(made, Kind.NONNEGATIVE))
    return found
