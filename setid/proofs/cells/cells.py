"""Cells of parameters that cover a feasible set.

Any rule may choose where a cell is branched. The cells cover the set nevertheless: two halves share
the number at which they were branched, and a cell is removed only if it is proved empty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.proofs.supports import Cover, Multipliers, safe_maxima, supports

__all__ = ["Cell", "Cells"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """The members of a set with low <= s <= high.

    Parameters
    ----------
    low, high : (q,) float
        Of the coordinates, where the cell was cut.
    tight : (low, high), each (q,) float
        Proved range of them on the cell.
    """

    low: Reals
    high: Reals
    tight: tuple[Reals, Reals]

    @property
    def box(self) -> tuple[Reals, Reals]:
        """Box of the coordinates: between the cuts, in the proved range."""
        return np.maximum(self.low, self.tight[0]), np.minimum(self.high, self.tight[1])


class Cells:
    """Cells that cover the members of a cover.

    Parameters
    ----------
    cover : Cover
        A finite one.
    directions : (q, p) float
        The coordinates s in which cells are cut, as linear functions of theta.
    source : Multipliers
        For the rows of the cover; not trusted.
    """

    def __init__(self, cover: Cover, directions: Reals, source: Multipliers) -> None:
        self._cover, self._directions = cover, directions
        low, high = supports(cover, directions, lambda _: source).T
        whole = Cell(frozen(low.copy()), frozen(high.copy()), (low, high))
        self._cells = {0: whole}
        self._next = 1

    @property
    def numbers(self) -> list[int]:
        """Numbers of the cells that are left."""
        return list(self._cells)

    def cell(self, number: int) -> Cell:
        """Return a cell that is left."""
        return self._cells[number]

    def polytope(self, number: int) -> Cover:
        """State a cell as a cover: rows of the set, then both sides of the coordinates."""
        cover = self._cover
        matrix = np.concatenate([cover.matrix, self._directions, -self._directions])
        low, high = self._cells[number].box
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
