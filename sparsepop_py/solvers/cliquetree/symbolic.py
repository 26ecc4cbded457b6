"""What depends on the pattern of a program only: layout of blocks, fronts, index maps.

Every semidefinite block, linear row and equality row couples the moments it holds, so the
matrix of the Newton system is a union of cliques. These are eliminated along a tree of
fronts (multifrontal method). All work of a solve is then done on dense arrays whose places
are found here, once for every program of the same pattern.

References
----------
J. W. H. Liu, The multifrontal method for sparse matrix solution, SIAM Review 34, 1992.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...conic import Cones, ConicProgram
from .elimination import amalgamate, eliminate, maximal
from .fronts import Fronts, line_up
from .tree import Tree, plant

__all__ = [
    "Assembly",
    "BlockPairs",
    "BlockStack",
    "Layout",
    "RowPairs",
    "Symbolic",
    "analyse",
    "pattern_key",
]

Indices = NDArray[np.int64]
_SHALLOW, _LEAN = 2.0, 1.1  # slack of elimination orders for stacks and for single fronts
_CHUNK = 2**16  # doubles that the temporary products of one assembly may take


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


@dataclass(frozen=True, slots=True, eq=False)
class BlockPairs:
    """All blocks for the compiled assembly: moments, their nonzeros, places of their pairs.

    Parameters
    ----------
    start, size : (K,) int
        Where the entries of each block begin, and its rows.
    member : (K + 1,) int
        Where the moments of each block begin.
    first : (C + 1,) int
        Where the nonzeros of each moment of each block begin.
    entry, source : int arrays
        Entry i s + j of each nonzero in its block; its number in the entry matrix.
    at : (K + 1,) int
        Where the places of each block begin.
    place : int array
        Places of all pairs p <= q, row by row.
    """

    start: Indices
    size: Indices
    member: Indices
    first: Indices
    entry: Indices
    source: Indices
    at: Indices
    place: Indices


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


@dataclass(frozen=True, slots=True, eq=False)
class Symbolic:
    """Everything that a solve needs to know of the pattern.

    Parameters
    ----------
    key : bytes
        Digest of the pattern; programs with the same key share this object.
    moments : int
    layout : Layout
    assemblies : tuple of Assembly, or BlockPairs
    zero, linear : RowPairs
    tree : Tree or Fronts
        Stacks of equal fronts for numpy, single fronts for compiled kernels.
    """

    key: bytes
    moments: int
    layout: Layout
    assemblies: tuple[Assembly, ...] | BlockPairs
    zero: RowPairs
    linear: RowPairs
    tree: Tree | Fronts


def pattern_key(program: ConicProgram) -> bytes:
    """A digest of the pattern of A and of the cones."""
    digest = hashlib.blake2b(digest_size=16)
    cones = program.cones
    digest.update(repr((program.A.shape, cones.zero, cones.nonnegative, cones.psd)).encode())
    digest.update(np.ascontiguousarray(program.A.indptr, np.int64).tobytes())
    digest.update(np.ascontiguousarray(program.A.indices, np.int64).tobytes())
    return digest.digest()


def analyse(program: ConicProgram, compiled: bool = False) -> Symbolic:
    """Find fronts and index maps of a program, which serve all programs of its pattern.

    Parameters
    ----------
    program : ConicProgram
        Only the pattern of A and the cones are read.
    compiled : bool
        Whether for the compiled kernels.
    """
    moments = program.q.size
    row = program.A.indices.astype(np.int64)
    column = np.repeat(np.arange(moments), np.diff(program.A.indptr))
    layout = _layout(program.cones, row, column)
    keys, local = np.unique(layout.block[row] * max(moments, 1) + column, return_inverse=True)
    owner, member = np.divmod(keys, max(moments, 1))
    first = np.searchsorted(owner, np.arange(int(layout.block.max(initial=-1)) + 2))
    local = local - first[layout.block[row]]
    tree = _tree(member, first, moments, compiled)
    spot = tree.locate(owner, member, first)
    assemblies: tuple[Assembly, ...] | BlockPairs
    if isinstance(tree, Fronts):
        order = np.lexsort((spot, owner))
        turned = np.empty(order.size, np.int64)
        turned[order] = np.arange(order.size)
        spot = spot[order]
        local = turned[first[layout.block[row]] + local] - first[layout.block[row]]
        assemblies = _block_pairs(layout, program.cones, first, spot, local, tree)
    else:
        assemblies = tuple(_assemblies(layout, program.cones, first, spot, local, tree))
    lines = _row_pairs(program.cones, row, first, spot, local, tree)
    return Symbolic(pattern_key(program), moments, layout, assemblies, *lines, tree)


def _layout(cones: Cones, row: Indices, column: Indices) -> Layout:
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


def _tree(member: Indices, first: Indices, moments: int, compiled: bool) -> Tree | Fronts:
    """The elimination tree of the cliques."""
    cliques = [member[a:b] for a, b in zip(first, first[1:], strict=False)]
    order = eliminate(maximal(cliques, moments), moments, _LEAN if compiled else _SHALLOW)
    fronts = amalgamate(order, moments)
    return line_up(fronts, moments) if compiled else plant(fronts, moments)


def _block_pairs(
    layout: Layout, cones: Cones, first: Indices, spot: Indices, local: Indices, tree: Fronts
) -> BlockPairs:
    """Nonzeros of each moment of each block, and the places of all pairs of its moments."""
    head = cones.zero + cones.nonnegative
    sizes = np.array(cones.psd, np.int64)
    order = np.argsort(sizes, kind="stable")  # as the stacks have them
    size = sizes[order]
    start = np.concatenate([[0], np.cumsum(size**2)]).astype(np.int64)
    low, high = first[head + order], first[head + order + 1]
    member = np.concatenate([[0], np.cumsum(high - low)]).astype(np.int64)
    entry = np.repeat(np.arange(layout.entries), np.diff(layout.indptr[: layout.entries + 1]))
    block = np.repeat(np.arange(size.size), size**2)[entry]
    moment = member[block] + local[layout.source[: entry.size]]
    turned = np.argsort(moment, kind="stable")
    width = high - low
    at = np.concatenate([[0], np.cumsum(width * (width + 1) // 2)]).astype(np.int64)
    place = np.empty(at[-1], np.int64)
    for count in np.unique(width).tolist():
        upper = np.triu_indices(count)
        which = np.flatnonzero(width == count)
        step = max(1, _CHUNK // max(1, count**2))
        for some in (which[k : k + step] for k in range(0, which.size, step)):
            ranks = spot[low[some][:, None] + np.arange(count)]
            found = tree.pairs(ranks, np.ones(ranks.shape, bool))[:, upper[0], upper[1]]
            place[at[some][:, None] + np.arange(upper[0].size)] = found
    return BlockPairs(
        start[:-1],
        size,
        member,
        np.searchsorted(moment[turned], np.arange(member[-1] + 1)),
        (entry - start[block])[turned],
        turned,
        at,
        place,
    )


def _assemblies(
    layout: Layout, cones: Cones, first: Indices, spot: Indices, local: Indices, tree: Tree
) -> Iterator[Assembly]:
    """Blocks of similar numbers of moments, in chunks that fit into the cache."""
    sizes = np.array(cones.psd, np.int64)
    head = cones.zero + cones.nonnegative
    for stack in layout.stacks:
        which = head + np.flatnonzero(sizes == stack.size)
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
        span,
        count,
        size,
        width,
        number[order],
        (k * size + j)[order],
        np.searchsorted(left[order], np.arange(count * size * width + 1)),
        number[turned],
        entry[turned],
        np.searchsorted(right[turned], np.arange(count * width + 1)),
        place.ravel(),
    )


def _row_pairs(
    cones: Cones,
    row: Indices,
    first: Indices,
    spot: Indices,
    local: Indices,
    tree: Tree | Fronts,
) -> tuple[RowPairs, RowPairs]:
    """Pairs of nonzeros of every zero row and of every linear row."""
    head = cones.zero + cones.nonnegative
    order = np.argsort(row, kind="stable")
    begin = np.searchsorted(row[order], np.arange(head + 1))
    length = np.diff(begin)
    found: list[list[Indices]] = [[], [], [], []]
    for size in np.unique(length[length > 0]).tolist():
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
