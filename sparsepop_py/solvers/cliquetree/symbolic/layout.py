"""Layout of the entries of all blocks and rows in one vector.

Matrices are written out in full, blocks of one size one after the other, so that all
of them are one (K, s, s) array; linear rows follow. For compiled kernels, small blocks of one size
and pattern are taken eight at a time: their entries at one place stand side by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.conic.program import Cones

__all__ = ["LANES", "BlockStack", "Layout", "lay_out"]

Indices = NDArray[np.int64]
Reals = NDArray[np.float64]
LANES = 8  # blocks that compiled kernels take side by side, doubles of a vector
_LANED = 12  # rows up to which blocks are taken several at a time


@dataclass(frozen=True, slots=True)
class BlockStack:
    """Semidefinite blocks of one size in the vector of all matrix entries.

    Parameters
    ----------
    size : int
    start : int
        Where the entries begin.
    blocks : (count,) int
        Numbers of the blocks.
    lanes : int
        How many of them stand side by side: the entries are (count / lanes, size, size, lanes).
    """

    size: int
    start: int
    blocks: Indices
    lanes: int = 1

    @property
    def count(self) -> int:
        """Number of blocks."""
        return int(self.blocks.size)

    @property
    def span(self) -> slice:
        """The entries of all these blocks."""
        return slice(self.start, self.start + self.count * self.size**2)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(count, size, size)."""
        return self.count, self.size, self.size

    def matrices(self, x: Reals) -> Reals:
        """View the blocks (count, size, size) of a vector; those side by side are copied."""
        if self.lanes == 1:
            return x[self.span].reshape(self.shape)
        groups = x[self.span].reshape(-1, self.size, self.size, self.lanes)
        return groups.transpose(0, 3, 1, 2).reshape(self.shape)

    def entries(self, matrices: Reals) -> Reals:
        """Arrange the entries of blocks (count, size, size) as in the vector."""
        groups = matrices.reshape(-1, self.lanes, self.size, self.size)
        return groups.transpose(0, 2, 3, 1).ravel()


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Matrices written out in full, and the linear map from moments to their entries.

    Parameters
    ----------
    stacks : tuple of BlockStack
    head : int
        Number of zero rows and linear rows, which come before the blocks.
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
    head: int
    entries: int
    place: Indices
    mirror: Indices
    block: Indices
    source: Indices
    indices: Indices
    indptr: Indices


def lay_out(cones: Cones, row: Indices, column: Indices, compiled: bool = False) -> Layout:
    """Lay out a program by the rows and columns of its nonzeros.

    Parameters
    ----------
    cones : Cones
    row, column : (nnz,) int
    compiled : bool
        Whether to put small blocks of one pattern side by side.

    Returns
    -------
    Layout
    """
    sizes = np.array(cones.psd, np.int64)
    head = cones.zero + cones.nonnegative
    begin = head + np.concatenate([[0], np.cumsum(sizes * (sizes + 1) // 2)]).astype(np.int64)
    place = np.full(cones.rows, -1, np.int64)
    mirror, block = place.copy(), np.arange(cones.rows)
    block[head:] = head + np.repeat(np.arange(sizes.size), np.diff(begin))
    order = np.lexsort((column, row))
    row, column = row[order], column[order]  # by rows
    alike = _alike(sizes, begin, block, row, column) if compiled else []
    alone = np.ones(sizes.size, bool)
    for which in alike:
        alone[which] = False
    single = [np.flatnonzero(alone & (sizes == size)) for size in monomials.distinct(sizes[alone])]
    stacks: list[BlockStack] = []
    start = 0
    for which, side in [*((w, 1) for w in single), *((w, LANES) for w in alike)]:
        size = int(sizes[which[0]])
        j, i = np.tril_indices(size)
        rows = begin[which][:, None] + np.arange(i.size)
        group, lane = np.divmod(np.arange(which.size), side)
        base = (start + group * side * size * size + lane)[:, None]
        place[rows], mirror[rows] = base + side * (i * size + j), base + side * (j * size + i)
        stacks.append(BlockStack(size, start, which, side))
        start += which.size * size * size
    place[cones.zero : head] = mirror[cones.zero : head] = start + np.arange(cones.nonnegative)
    conic = np.flatnonzero(row >= cones.zero)
    twice = conic[place[row[conic]] != mirror[row[conic]]]
    source = np.concatenate([conic, twice])
    entry = np.concatenate([place[row[conic]], mirror[row[twice]]])
    turned = np.lexsort((column[source], entry))
    indptr = np.searchsorted(entry[turned], np.arange(start + cones.nonnegative + 1))
    source = source[turned]
    return Layout(
        tuple(stacks),
        head,
        start,
        place,
        mirror,
        block,
        order[source],
        column[source],
        indptr.astype(np.int64),
    )


def _alike(
    sizes: Indices, begin: Indices, block: Indices, row: Indices, column: Indices
) -> list[Indices]:
    """Small blocks whose nonzeros differ by their moments only, as many as fill groups.

    ``row`` and ``column`` are those of the nonzeros by rows, ``begin`` has the first row of each
    block, ``block`` the block of each row.
    """
    keys = block[row] * (int(column.max(initial=0)) + 1) + column
    _, first, back = np.unique(keys, return_index=True, return_inverse=True)
    at = np.searchsorted(row, begin)
    shape = np.stack([row, first[back]])  # each moment is named by its first nonzero
    found: dict[tuple[int, bytes], list[int]] = {}
    for number in np.flatnonzero(sizes <= _LANED).tolist():
        low, high = at[number], at[number + 1]
        pattern = shape[:, low:high] - np.array([[begin[number]], [low]])
        found.setdefault((int(sizes[number]), pattern.tobytes()), []).append(number)
    full = [np.array(which[: len(which) // LANES * LANES], np.int64) for which in found.values()]
    return [which for which in full if which.size]
