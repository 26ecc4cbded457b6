"""Index maps of the Newton matrix: products of blocks and rows, and their places.

With A_p the coefficient matrices of the moments of a block, its part of the matrix is
<A_p, P A_q Z>. For numpy, blocks of one size are taken together in chunks that fit into the
cache; the compiled kernel takes them one by one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.conic.program import Cones
from sparsepop_py.solvers.cliquetree.kernels.batched import Workers, check, compiled_kernels
from sparsepop_py.solvers.cliquetree.symbolic.fronts import Fronts
from sparsepop_py.solvers.cliquetree.symbolic.layout import BlockStack, Layout
from sparsepop_py.solvers.cliquetree.symbolic.tree import Tree

__all__ = ["Assembly", "BlockPairs", "PairProduct", "RowPairs", "StackProduct"]
__all__ += ["block_pairs", "row_pairs", "stacked"]

Indices = NDArray[np.int64]
Reals = NDArray[np.float64]
_CHUNK = 2**16  # doubles that the temporary products of one assembly may take
_TEMPORARY = 2**22  # doubles that those of one large block may take
_HELD = 2**15  # sums of pairs that are held before they are added to the fronts
_PART, _MOST_PARTS = 5e5, 8  # multiplications that are worth a thread, parts of one operation


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """Blocks of one size whose matrices A_p' (P x Z) A_q are formed together.

    Parameters
    ----------
    span : slice
        Their entries.
    count, size, moments : int
        Blocks K, their size s, and moments C of each (the largest number of them).
    left_source, left_indices, left_indptr : int arrays
        The matrix (K s C, K s) that takes Z to all A_p Z: numbers in the entry matrix, pattern.
    right_source, right_indices, right_indptr : int arrays
        The matrix (K C, K s s) of inner products with all A_q.
    place : (K C C,) int
        Where the results are added among the entries of all fronts.
    """

    span: slice
    count: int
    size: int
    moments: int
    left_source: Indices
    left_indices: Indices
    left_indptr: Indices
    right_source: Indices
    right_indices: Indices
    right_indptr: Indices
    place: Indices

    def bound(self, data: Reals, workers: Workers) -> StackProduct:
        """Attach numbers: ``data`` of the entry matrix."""
        count, size, moments = self.count, self.size, self.moments
        left = sps.csr_array(
            (data[self.left_source], self.left_indices, self.left_indptr),
            shape=(count * size * moments, count * size),
        )
        right = sps.csr_array(
            (data[self.right_source], self.right_indices, self.right_indptr),
            shape=(count * moments, count * size * size),
        )
        width = max(1, _TEMPORARY // (count * size * moments))  # columns of Z at a time
        if width >= size:
            return StackProduct(self, left, ((slice(0, size), right),))
        turned = sps.csc_array(right)
        entry = np.arange(count * size * size).reshape(count, size, size)
        pieces = [slice(j, min(j + width, size)) for j in range(0, size, width)]
        rights = [sps.csr_array(turned[:, entry[:, :, part].ravel()]) for part in pieces]
        return StackProduct(self, left, tuple(zip(pieces, rights, strict=True)))


@dataclass(frozen=True, slots=True, eq=False)
class StackProduct:
    """Two sparse factors of one assembly, the second for ranges of columns.

    Large blocks are taken in ranges: their products take less memory, and the clock is looked at
    in between.
    """

    pattern: Assembly
    left: sps.csr_array
    rights: tuple[tuple[slice, sps.csr_array], ...]

    def add(self, entries: Reals, inverse: Reals, dual: Reals, deadline: float | None) -> None:
        """Add A_p' (P x Z) A_q of these blocks to the entries of all fronts."""
        a = self.pattern
        count, size, moments = a.count, a.size, a.moments
        z = dual[a.span].reshape(count * size, size)
        p = inverse[a.span].reshape(count, size, size)
        total: Reals | float = 0.0
        for part, right in self.rights:
            check(deadline)
            turned = (self.left @ z[:, part]).reshape(count, size, -1)
            both = (p @ turned).reshape(count, size, moments, -1)
            columns = both.transpose(0, 1, 3, 2).reshape(-1, moments)
            total = total + right @ columns
        np.add.at(entries, a.place, np.ravel(total))


@dataclass(frozen=True, slots=True, eq=False)
class BlockPairs:
    """Blocks for the compiled assembly: moments, their nonzeros, places of their pairs.

    Parameters
    ----------
    lanes : int
        How many blocks of one pattern stand side by side, as a group; or one.
    start, size : (K,) int
        Where the entries of each group begin, and the rows of its blocks.
    member : (K + 1,) int
        Where the moments of each group begin.
    first : (C + 1,) int
        Where the nonzeros of each moment of each group begin.
    row, column : uint32 arrays
        Of each nonzero of the lower triangle.
    source : int array
        Its number in the entry matrix, for each of the blocks side by side.
    at : (K + 1,) int
        Where the places of each group begin.
    place : int array
        Where the pairs p <= q of moments are added: those of the first q, of the second, and
        so on, for each of the blocks side by side.
    """

    lanes: int
    start: Indices
    size: Indices
    member: Indices
    first: Indices
    row: NDArray[np.uint32]
    column: NDArray[np.uint32]
    source: Indices
    at: Indices
    place: NDArray[np.uint32] | Indices

    def parts(self) -> list[tuple[int, int]]:
        """Split groups into ranges of about equal work, one if the work is small."""
        return _ranges(self.lanes * self.size.astype(float) ** 3 + 50.0, _PART, _MOST_PARTS)

    def bound(self, data: Reals, workers: Workers) -> PairProduct:
        """Attach numbers: ``data`` of the entry matrix."""
        half = np.repeat(np.where(self.row == self.column, 0.5, 1.0), self.lanes)
        held = np.diff(self.at)
        ranges = _ranges(held, _HELD, held.size + 1)
        room = max((int(self.at[high] - self.at[low]) for low, high in ranges), default=0)
        memory = [np.empty(room) for _ in range(workers.threads)]
        return PairProduct(self, half * data[self.source], ranges, memory, workers)


@dataclass(frozen=True, slots=True, eq=False)
class PairProduct:
    """The weights of all nonzeros, and the ranges of blocks that are taken together.

    Their sums are computed in parallel and then added to the fronts one range after the other,
    so that the result does not depend on the number of threads. Memory is taken once: pages
    that are returned and asked for in every iteration cost as much as the sums.
    """

    pattern: BlockPairs
    weight: Reals
    ranges: list[tuple[int, int]]
    memory: list[Reals]
    workers: Workers

    def add(self, entries: Reals, inverse: Reals, dual: Reals, deadline: float | None) -> None:
        """Add A_p' (P x Z) A_q of all blocks to the entries of all fronts."""
        b, compiled = self.pattern, compiled_kernels()
        kernel = (compiled.lanes if b.lanes > 1 else compiled.pairs).pair_sums
        numbers = inverse, dual, b.start, b.size, b.member, b.first, b.row, b.column, self.weight

        def sums(part: tuple[tuple[int, int], Reals]) -> None:
            check(deadline)
            kernel(*numbers, *part[0], part[1])

        for begin in range(0, len(self.ranges), self.workers.threads):
            parts = list(zip(self.ranges[begin:], self.memory, strict=False))
            self.workers.each(sums, parts)
            for (low, high), found in parts:
                compiled.scatter(entries, found, b.place, b.at[low], b.at[high])


def _ranges(work: NDArray[Any], least: float, most: int) -> list[tuple[int, int]]:
    """Ranges of about equal work, at least so much each and at most so many."""
    total = np.concatenate([[0.0], np.cumsum(work, dtype=float)])
    count = int(np.clip(total[-1] // least, 1, most))
    cuts = np.searchsorted(total, total[-1] / count * np.arange(1, count))
    ends = monomials.distinct(np.concatenate([[0], cuts, [work.size]])).tolist()
    return list(pairwise(ends))


@dataclass(frozen=True, slots=True, eq=False)
class RowPairs:
    """Products a_rp a_rq of zero rows or of linear rows, and where they are added.

    Parameters
    ----------
    left, right : (P,) int
        Nonzeros of the program.
    row : (P,) int
        Row of the program.
    place : (P,) int
    """

    left: Indices
    right: Indices
    row: Indices
    place: Indices


def block_pairs(
    layout: Layout, first: Indices, spot: Indices, local: Indices, tree: Fronts
) -> tuple[BlockPairs, ...]:
    """Collect the pairs of single blocks and those of blocks side by side.

    Parameters
    ----------
    layout : Layout
    first : int array
        Start of the moments of each block or row among those of all.
    spot : int array
        Moment of each rank.
    local : (nnz,) int
        Number of the moment of each nonzero within its block or row.
    tree : Fronts

    Returns
    -------
    tuple of BlockPairs
    """
    kinds = [[s for s in layout.stacks if (s.lanes > 1) == beside] for beside in (False, True)]
    return tuple(_pairs(kind, layout, first, spot, local, tree) for kind in kinds if kind)


def _pairs(
    stacks: list[BlockStack],
    layout: Layout,
    first: Indices,
    spot: Indices,
    local: Indices,
    tree: Fronts,
) -> BlockPairs:
    """Collect nonzeros of each moment of each group, and places of moment pairs."""
    lanes = stacks[0].lanes
    blocks = layout.head + np.concatenate([s.blocks for s in stacks])
    size = np.concatenate([np.full(s.count // lanes, s.size) for s in stacks])
    begin = stacks[0].start + np.concatenate([[0], np.cumsum(lanes * size**2)]).astype(np.int64)
    low, high = first[blocks], first[blocks + 1]
    width = (high - low)[::lanes]
    member = np.concatenate([[0], np.cumsum(width)]).astype(np.int64)
    lines = layout.indptr[begin[0] : begin[-1] + 1]
    nonzero = np.arange(lines[0], lines[-1])
    entry = np.repeat(np.arange(begin[0], begin[-1]), np.diff(lines))
    group = np.searchsorted(begin, entry, side="right") - 1
    offset, lane = np.divmod(entry - begin[group], lanes)
    i, j = np.divmod(offset, size[group])
    moment = member[group] + local[layout.source[nonzero]]
    order = np.lexsort((lane, offset, moment))
    order = order[i[order] >= j[order]]
    leaders = order[::lanes]
    at = np.concatenate([[0], np.cumsum(lanes * (width * (width + 1) // 2))]).astype(np.int64)
    return BlockPairs(
        lanes=lanes,
        start=begin[:-1],
        size=size,
        member=member,
        first=np.searchsorted(moment[leaders], np.arange(member[-1] + 1)),
        row=i[leaders].astype(np.uint32),
        column=j[leaders].astype(np.uint32),
        source=nonzero[order],
        at=at,
        place=_places(low.reshape(-1, lanes), width, at, spot, tree),
    )


def _places(
    low: Indices, width: Indices, at: Indices, spot: Indices, tree: Fronts
) -> NDArray[np.uint32] | Indices:
    """Find the entries of fronts for pairs of groups of blocks side by side."""
    lanes = low.shape[1]
    place = np.empty(at[-1], np.uint32 if tree.entries < 2**32 else np.int64)
    for count in monomials.distinct(width).tolist():
        later, earlier = np.tril_indices(count)
        which = np.flatnonzero(width == count)
        step = max(1, _CHUNK // max(1, lanes * count**2))
        for some in (which[k : k + step] for k in range(0, which.size, step)):
            ranks = spot[low[some].reshape(-1, 1) + np.arange(count)]
            order = np.argsort(ranks, axis=1)
            turned = np.argsort(order, axis=1)
            ranks = np.take_along_axis(ranks, order, axis=1)
            found = tree.pairs(ranks, np.ones(ranks.shape, bool))
            one, two = turned[:, earlier], turned[:, later]
            number = np.arange(ranks.shape[0])[:, None]
            pairs = found[number, np.minimum(one, two), np.maximum(one, two)]
            pairs = pairs.reshape(some.size, lanes, later.size).swapaxes(1, 2)
            place[at[some][:, None] + np.arange(lanes * later.size)] = pairs.reshape(some.size, -1)
    return place


def stacked(
    layout: Layout, first: Indices, spot: Indices, local: Indices, tree: Tree
) -> Iterator[Assembly]:
    """Stack blocks of similar numbers of moments, in chunks that fit into the cache."""
    for stack in layout.stacks:
        which = layout.head + stack.blocks
        width = int((first[which + 1] - first[which]).max())
        chunk = max(1, _CHUNK // max(1, width * stack.size**2))
        for begin in range(0, stack.count, chunk):
            some = which[begin : begin + chunk]
            yield _assembly(layout, stack, begin, some, first, spot, local, tree)


def _assembly(
    layout: Layout,
    stack: BlockStack,
    begin: int,
    blocks: Indices,
    first: Indices,
    spot: Indices,
    local: Indices,
    tree: Tree,
) -> Assembly:
    size, count = stack.size, blocks.size
    span = slice(stack.start + begin * size**2, stack.start + (begin + count) * size**2)
    low, high = layout.indptr[[span.start, span.stop]]
    number = np.arange(low, high)
    entry = np.repeat(
        np.arange(count * size**2), np.diff(layout.indptr[span.start : span.stop + 1])
    )
    k, i, j = entry // size**2, entry // size % size, entry % size
    p = local[layout.source[low:high]]
    width = int((first[blocks + 1] - first[blocks]).max())
    left = (k * size + i) * width + p
    right = k * width + p
    order = np.argsort(left, kind="stable")
    turned = np.argsort(right, kind="stable")
    taken = first[blocks][:, None] + np.arange(width)
    inside = taken < first[blocks + 1][:, None]
    taken = np.where(inside, taken, first[blocks][:, None])
    place = tree.pairs(spot[taken], inside)
    return Assembly(
        span=span,
        count=count,
        size=size,
        moments=width,
        left_source=number[order],
        left_indices=(k * size + j)[order],
        left_indptr=np.searchsorted(left[order], np.arange(count * size * width + 1)),
        right_source=number[turned],
        right_indices=entry[turned],
        right_indptr=np.searchsorted(right[turned], np.arange(count * width + 1)),
        place=place.ravel(),
    )


def row_pairs(
    cones: Cones,
    row: Indices,
    first: Indices,
    spot: Indices,
    local: Indices,
    tree: Tree | Fronts,
) -> tuple[RowPairs, RowPairs]:
    """List pairs of nonzeros of every zero row and of every linear row."""
    head = cones.zero + cones.nonnegative
    order = np.argsort(row, kind="stable")
    begin = np.searchsorted(row[order], np.arange(head + 1))
    length = np.diff(begin)
    found: list[list[Indices]] = [[], [], [], []]
    for size in monomials.distinct(length[length > 0]).tolist():
        rows = np.flatnonzero(length == size)
        nonzero = order[begin[rows][:, None] + np.arange(size)]
        at = spot[first[rows][:, None] + local[nonzero]]
        ascending = np.argsort(at, axis=1)
        at, nonzero = (np.take_along_axis(x, ascending, axis=1) for x in (at, nonzero))
        place = tree.pairs(at, np.ones(at.shape, bool))
        wide = (rows.size, size, size)
        found[0].append(np.broadcast_to(nonzero[:, :, None], wide).ravel())
        found[1].append(np.broadcast_to(nonzero[:, None, :], wide).ravel())
        found[2].append(np.broadcast_to(rows[:, None, None], wide).ravel())
        found[3].append(place.ravel())
    joined = [np.concatenate([np.zeros(0, np.int64), *parts]) for parts in found]
    equality = joined[2] < cones.zero
    return RowPairs(*(x[equality] for x in joined)), RowPairs(*(x[~equality] for x in joined))
