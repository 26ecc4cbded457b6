"""Search for the least sum of errors, by multipliers of the vectors that span each cone.

For one denominator the least sum of the sizes of errors is a linear program, and its dual solution
a multiplier, 1 or -1 at most samples. Hence a multiplier lets more noise through at once where the
denominator is another one. A cone is bounded by the family of the multipliers at
its vectors (:mod:`setid.proofs.denominators.varying_multipliers`), which follow the denominator, so
that the gap is of second order in the width of the cone. Cones with the least bound are split
first, at the pair of vectors that says least.

What a system at rest does with a growing mode depends on its first samples. The least error is not
continuous there, so that multipliers of such denominators leave the first rows alone.
"""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.minimum_noise.claims import FoundDenominators
from setid.minimum_noise.cones.best_first import BestFirst
from setid.minimum_noise.cones.edges import edge_weights
from setid.minimum_noise.programs import Programs, shifted
from setid.proofs.denominators.cones import Cone, split_cone
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf, dual_norm
from setid.proofs.denominators.output_rows import OutputRows
from setid.proofs.denominators.varying_multipliers import VaryingCells, pairs
from sparsepop_py.budget import Deadline

__all__ = ["by_corners"]

Reals = NDArray[np.float64]
_Open = tuple[Cone, tuple[int, int]]  # a cone, and the pair of its vectors that says least


class _Corner(NamedTuple):
    """A vector of a cone, divided by a power of two, with its multiplier."""

    number: int
    power: int
    vector: Reals  # (n + 1,)
    moment: Reals  # (n + 1,)


def by_corners(
    rows: OutputRows, programs: Programs, output: int, tol: float, deadline: Deadline
) -> FoundDenominators:
    """Bound the least factor on the noise bounds of one output from below.

    Parameters
    ----------
    rows : OutputRows
    programs : Programs
        Of these rows.
    output : int
    tol : float
        Of the factor.
    deadline : Deadline
    """
    return _Search(rows, programs, output, tol, deadline).run()


class _Search(BestFirst[_Open]):
    """Best-first search over cones, with one multiplier for each vector."""

    _claim = VaryingCells

    def __init__(
        self, rows: OutputRows, programs: Programs, output: int, tol: float, deadline: Deadline
    ) -> None:
        super().__init__(rows, programs, output, tol, deadline)
        self._corners: dict[tuple[int, ...], _Corner | None] = {}
        self._one, self._two = np.array(pairs(rows.order + 1)).T

    def _begin(self, cone: Cone) -> None:
        """File a cone with the error that the family of its vectors refutes."""
        number = len(self._cells)
        corners = [self._corner(vector) for vector in cone]
        self._cells.append(Cell())
        self._proved.append(0.0)
        known = [corner for corner in corners if corner is not None]
        if len(known) < len(corners):
            self._cap = 0.0
            return
        low, edge = self._bound(known)
        if low > 0.0:
            family = tuple(corner.number for corner in known)
            powers = tuple(corner.power for corner in known)
            self._cells[number] = VaryingLeaf((family,), (1.0,), powers)
            self._proved[number] = low
        heapq.heappush(self._waiting, (low, number, (cone, edge)))

    def _corner(self, whole: NDArray[np.object_]) -> _Corner | None:
        """The multiplier of the denominator that a vector is; None where it overflows."""
        key = tuple(whole.tolist())
        if key not in self._corners:
            self._corners[key] = self._solved(whole)
        return self._corners[key]

    def _solved(self, whole: NDArray[np.object_]) -> _Corner | None:
        power = max(int(value).bit_length() for value in whole.tolist()) - 1
        vector = np.ldexp(whole.astype(np.float64), -power)
        size = float(np.linalg.norm(vector))
        programs = self._programs_for(vector)
        solved = programs.solve(vector / size, None)
        if solved is None:
            return None
        level, multiplier, _ = solved
        if programs is self._programs:
            self._note(vector, level)
        noise = float(dual_norm(self._rows, vector @ shifted(multiplier, self._rows.order)))
        if not (np.isfinite(noise) and noise > 0.0):
            return None
        multiplier = multiplier * (size * size / noise)
        self._multipliers.append(multiplier)
        moment = shifted(multiplier, self._rows.order) @ self._rows.y
        return _Corner(len(self._multipliers) - 1, power, vector, moment)

    def _bound(self, corners: list[_Corner]) -> tuple[float, tuple[int, int]]:
        """The error that a family refutes, and the pair of vectors that says least."""
        one, two = self._one, self._two
        vectors = np.array([corner.vector for corner in corners])
        order = self._rows.order
        ahead = np.array([shifted(self._multipliers[c.number], order) for c in corners])
        value = vectors @ np.array([corner.moment for corner in corners]).T
        filtered = np.einsum("jv,kvn->jkn", vectors, ahead)
        needed = value[one, two] + value[two, one]
        noise = dual_norm(self._rows, filtered[one, two] + filtered[two, one])
        ratio = needed / np.maximum(noise, 1e-300)
        apart = np.where(one == two, np.inf, ratio)
        place = int(np.argmin(apart))
        return max(0.0, float(ratio.min())), (int(one[place]), int(two[place]))

    def _split(self, low: float, number: int, node: _Open) -> None:
        cone, edge = node
        i, j = edge
        sizes = [max(abs(int(v)) for v in cone[place].tolist()) for place in edge]
        weights = edge_weights(sizes[1].bit_length() - sizes[0].bit_length())
        halves = split_cone(cone, (i, j), weights) if i != j else None
        if halves is None:  # too thin: it stays a leaf
            self._cap = min(self._cap, low)
            return
        first = len(self._cells)
        self._cells[number] = Cell((first, first + 1), (i, j), weights)
        for half in halves:
            self._begin(half)
