"""Best-first search over cones of denominators: what its kinds share.

Cones with the least proved factor are split first, until that is within the tolerance of what the
best denominator needs.
"""

from __future__ import annotations

import heapq
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from setid.feasible_points.fits.stable_poles import monic
from setid.minimum_noise.claims import FoundDenominators, claimed, with_better
from setid.minimum_noise.programs import Programs, grows, programs_for_growth
from setid.proofs.denominators.cones import Cone, first_cones
from setid.proofs.denominators.denominator_cells import Cell, DenominatorCells, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows
from sparsepop_py.budget import EARLY, Deadline

__all__ = ["BestFirst"]

Reals = NDArray[np.float64]
Open = TypeVar("Open")
_MOST_BYTES = 2.0**28  # bytes of multipliers


class BestFirst(ABC, Generic[Open]):
    """A tree of cones, numbered, with the factor that is proved of each. Mutable.

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

    _claim: type[DenominatorCells] = DenominatorCells  # what the tree is stated as

    def __init__(
        self, rows: OutputRows, programs: Programs, output: int, tol: float, deadline: Deadline
    ) -> None:
        self._rows, self._programs, self._output = rows, programs, output
        self._growing = programs_for_growth(rows, programs)
        self._tol, self._deadline = tol, deadline
        self._multipliers: list[Reals] = []
        self._cells: list[Cell | VaryingLeaf] = []
        self._proved: list[float] = []
        self._waiting: list[tuple[float, int, Open]] = []  # cones that nothing refutes yet
        self._level, self._cap, self._best = np.inf, np.inf, list[Reals]()
        self._most = int(_MOST_BYTES / (8.0 * rows.y.size))

    def run(self) -> FoundDenominators:
        """Split cones until the target is proved, or time or memory ends; state what is proved."""
        if not self._begun():
            return FoundDenominators(0.0, None, tuple(self._best))
        while self._waiting:
            low, number, node = heapq.heappop(self._waiting)
            enough = low >= min(self.target, self._cap)
            if enough or self._ended:
                break
            kept = len(self._cells), self._cells[number]
            try:
                self._split(low, number, node)
            except EARLY as cause:  # the cone stays whole
                self._deadline.ended(cause)
                del self._cells[kept[0] :], self._proved[kept[0] :]
                self._cells[number] = kept[1]
                break
        assert self._programs.free is not None
        none, free = np.zeros((0, self._rows.y.size)), self._programs.free
        claim = self._claim(self._output, free, none, tuple(self._cells))
        numbered = self._multipliers.__getitem__
        return claimed(self._rows, claim, numbered, self._proved, self._best)

    def _begun(self) -> bool:
        """File the first cones; False if time or memory ends before the last of them."""
        try:
            for number, cone in enumerate(first_cones(self._rows.order, self._rows.stable)):
                if number and self._ended:
                    return False
                self._begin(cone)
        except EARLY as cause:
            self._deadline.ended(cause)
            return False
        return True

    @property
    def _ended(self) -> bool:
        return self._deadline.over or len(self._multipliers) >= self._most

    @property
    def target(self) -> float:
        """The factor that is to be refuted."""
        return (1.0 - self._tol) * self._level if np.isfinite(self._level) else np.inf

    def _programs_for(self, a: Reals) -> Programs:
        """Programs of a denominator: those without the first rows where a mode grows."""
        return self._growing if grows(a, self._rows.y.size) else self._programs

    def _note(self, a: Reals, level: float) -> None:
        """Remember a denominator that needs less noise; no more than that can be refuted."""
        if not level < self._level:
            return
        self._level = level
        found = monic(a, self._rows.stable)
        if found is not None:
            self._best = with_better(self._best, found)

    @abstractmethod
    def _begin(self, cone: Cone) -> None:
        """File one of the first cones."""

    @abstractmethod
    def _split(self, low: float, number: int, node: Open) -> None:
        """File the halves of a cone of which a factor is proved; lower the cap without any."""
