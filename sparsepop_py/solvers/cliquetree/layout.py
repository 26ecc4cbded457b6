"""Where the entries of all blocks and rows stand in one vector.

Matrices are written out in full, blocks of one size one after the other, so that all
of them are one (K, s, s) array; linear rows follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...conic import Cones

__all__ = ["BlockStack", "Layout", "lay_out"]

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class BlockStack:
    """Semidefinite blocks of one size in the vector of all matrix entries.

    Parameters
    ----------
    size, count : int
    start : int
        Where the (count, size, size) entries begin.
    """

    size: int
    count: int
    start: int

    @property
    def span(self) -> slice:
        """The entries of all these blocks."""
        return slice(self.start, self.start + self.count * self.size**2)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(count, size, size)."""
        return self.count, self.size, self.size


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Matrices written out in full, and the linear map from moments to their entries.

    Parameters
    ----------
    stacks : tuple of BlockStack
    entries : int
        Matrix entries of all blocks; the linear rows follow them.
    place, mirror : (R,) int
        Entry of each row of the program and the mirrored entry; -1 for zero rows.
    block : (R,) int
        Zero rows, linear rows and blocks are numbered in turn.
    source : (N,) int
        The nonzero of the program behind each nonzero of the entry matrix, by rows.
    indices, indptr : int arrays
        Pattern of the entry matrix.
    """

    stacks: tuple[BlockStack, ...]
    entries: int
    place: Indices
    mirror: Indices
    block: Indices
    source: Indices
    indices: Indices
    indptr: Indices


def lay_out(cones: Cones, row: Indices, column: Indices) -> Layout:
    """The layout of a program whose nonzeros stand in these rows and columns."""
    sizes = np.array(cones.psd, np.int64)
    head = cones.zero + cones.nonnegative
    begin = head + np.concatenate([[0], np.cumsum(sizes * (sizes + 1) // 2)]).astype(np.int64)
    place = np.full(cones.rows, -1, np.int64)
    mirror, block = place.copy(), np.arange(cones.rows)
    stacks: list[BlockStack] = []
    start = 0
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size)
        j, i = np.tril_indices(size)
        rows = begin[which][:, None] + np.arange(i.size)
        base = start + size * size * np.arange(which.size)[:, None]
        place[rows], mirror[rows] = base + i * size + j, base + j * size + i
        block[rows] = head + which[:, None]
        stacks.append(BlockStack(size, which.size, start))
        start += which.size * size * size
    place[cones.zero : head] = mirror[cones.zero : head] = start + np.arange(cones.nonnegative)
    conic = np.flatnonzero(row >= cones.zero)
    twice = conic[place[row[conic]] != mirror[row[conic]]]
    source = np.concatenate([conic, twice])
    entry = np.concatenate([place[row[conic]], mirror[row[twice]]])
    order = np.lexsort((column[source], entry))
    indptr = np.searchsorted(entry[order], np.arange(start + cones.nonnegative + 1))
    source = source[order]
    return Layout(
        tuple(stacks), start, place, mirror, block, source, column[source], indptr.astype(np.int64)
    )
