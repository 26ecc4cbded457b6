"""Term sparsity and sign symmetry: smaller blocks from the monomials that occur.

A moment matrix L(b c) needs only those entries whose monomials occur somewhere else. Let A
hold the monomials of the objective, of the constraints, and the squares b^2. Two monomials
b, c of a block of g are joined if some monomial of g b c is in A; the graph is closed, its
blocks keep their entries, and the monomials of these entries enlarge A. This is repeated.

``"components"`` closes a graph to its connected components. Once A has become stable, the
value is that of the whole relaxation: let L be feasible for the small blocks and put L = 0
outside A; then every entry of a large block lies in a small one or is zero. ``"chordal"``
takes the maximal cliques of a chordal extension, which are smaller, and may lose.

``"sign"`` uses the sign changes x_v -> s_v x_v that keep the problem, which are the null
space over GF(2) of the exponents in A: a moment that one of them negates may be zero. A
family of inequalities may be kept as a whole, such as 1 + x and 1 - x, or the four
products (1 +- x)(1 +- y); then its own monomials do not enter A. With full bases, the
components grow until they are these classes.

Each new block is a principal part of an old one, so that nothing here touches soundness.

References
----------
J. Wang, V. Magron, J.-B. Lasserre, TSSOS: A moment-SOS hierarchy that exploits term
sparsity, SIAM J. Optim. 31 (2021) 30-58.
J. Wang, V. Magron, J.-B. Lasserre, Chordal-TSSOS: A moment-SOS hierarchy that exploits term
sparsity with chordal extension, SIAM J. Optim. 31 (2021) 114-141.
J. Wang, V. Magron, J.-B. Lasserre, N. H. A. Mai, CS-TSSOS: Correlative and term sparsity
for large-scale polynomial optimization, ACM Trans. Math. Softw. 48 (2022).
J. Loefberg, Pre- and post-processing sum-of-squares programs in practice, IEEE Trans.
Automatic Control 54 (2009) (sign symmetries).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.budget import check
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.generators import Generators
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks, row_monomials, stacked_groups
from sparsepop_py.relaxation.sign_symmetry import invariant_words, sign_codes
from sparsepop_py.sparsity.chordal import chordal_extension, clique_tree

__all__ = ["Closure", "TermGraphs", "Terms", "term_sparse"]

Closure = Literal["components", "chordal", "sign"]
Terms = Literal["none", "components", "chordal", "sign"]

Cover = list[tuple[NDArray[np.int64], NDArray[np.int64]]]


def term_sparse(
    groups: tuple[BlockGroup, ...],
    system: Generators,
    support: Words,
    dimension: int,
    method: Closure,
    steps: int | None = None,
) -> tuple[BlockGroup, ...]:
    """Split blocks by the monomials that occur.

    Parameters
    ----------
    groups : tuple of BlockGroup
    system : Generators
        All generators; blocks name theirs by its row.
    support : (T, D) int32
        The monomials of all objectives, and others that shall count as occurring. Those of
        the generators in ``groups`` are added here.
    dimension : int
        Number of variables.
    method : {"components", "chordal", "sign"}
        See :mod:`sparsepop_py.relaxation.term_sparsity`.
    steps : int, optional
        Number of times that the graphs are closed, until nothing changes when left out;
        ``"sign"`` needs one.

    Returns
    -------
    tuple of BlockGroup
        Free rows first, then matrices by size. Trivial rows and blocks that occur
        twice are left out.

    Raises
    ------
    ProblemError
        If ``method`` is unknown or ``steps`` is below 1.

    References
    ----------
    Wang, Magron, Lasserre (2021), sections 4 and 5; for cliques Wang et al. (2022), section 3.

    Examples
    --------
    The moment matrix of order 2 of an even polynomial falls apart by parity of exponents.

    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x**4 + y**4 - x**2 * y**2, lower=-1, upper=1)
    >>> sorted(sp.relax(problem, 2).block_sizes.items())
    [(3, 2), (6, 1)]
    >>> sorted(sp.relax(problem, 2, terms="sign").block_sizes.items())
    [(1, 9), (3, 1)]
    """
    return TermGraphs.of(groups, system, support, dimension).split(method, steps)


@dataclass(frozen=True, eq=False)
class TermGraphs:
    """The monomials of all blocks, to be split by more than one method.

    Parameters
    ----------
    tables : list of table
        Groups of blocks with the numbers of their monomials.
    known : (M,) bool
        Monomials that count as occurring.
    even : (M,) bool
        Monomials that no sign change negates.
    dimension : int
        Number of variables.
    """

    tables: list[_Table]
    known: NDArray[np.bool_]
    even: NDArray[np.bool_]
    dimension: int

    @staticmethod
    def of(
        groups: tuple[BlockGroup, ...], system: Generators, support: Words, dimension: int
    ) -> TermGraphs:
        """Number the monomials of groups, arguments as of :func:`term_sparse`."""
        system = _merged(system)
        start = _initial_support(groups, system, support)
        tables, distinct, number = _numbered(groups, system, start, dimension)
        code = sign_codes(start, dimension)
        even = np.bitwise_xor.reduce(code[distinct], axis=1) == 0
        known = np.zeros(even.size, bool)
        known[number] = True
        return TermGraphs(tables, known, even, dimension)

    def split(self, method: Closure, steps: int | None = None) -> tuple[BlockGroup, ...]:
        """Split the blocks, see :func:`term_sparse`."""
        if method not in ("components", "chordal", "sign"):
            raise ProblemError(
                f"method: found {method!r}, expected 'components', 'chordal' or 'sign'"
            )
        if steps is not None and steps < 1:
            raise ProblemError(f"steps: found {steps}, expected at least 1")
        alive = self.even if method == "sign" else self.known
        step = 0
        while True:
            step += 1
            check()
            grown, covers = alive.copy(), []
            for table in self.tables:
                # an arrow would lose its shape if it fell into cliques
                chordal = method == "chordal" and table.group.place is None
                inside, cover = table.close(alive, chordal)
                grown[table.words(inside)] = True
                covers.append(cover)
            grown &= self.even  # what a sign change negates may be zero
            if method == "sign" or step == steps or np.array_equal(grown, alive):
                break
            alive = grown
        blocks: Blocks = []
        for table, cover in zip(self.tables, covers, strict=True):
            blocks += table.blocks(cover, self.even)
        return stacked_groups(_distinct(blocks, self.dimension))


# ---- blocks and their monomials ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Table:
    """A group with the number of each monomial of each row.

    ``number`` is (L, r) for L pairs of a block and a term of its generator, r rows a block;
    ``block`` (L,) ascends, ``first`` (K,) says where each block starts. Where each row has a
    polynomial of its own, that is, in matrices, r is 1 and ``block`` says row; rows may be empty.
    """

    group: BlockGroup
    number: NDArray[np.int64]
    block: NDArray[np.int64]
    first: NDArray[np.int64]
    negative: NDArray[np.bool_]  # (K,): the generator's constant is below zero

    def any(self, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mark the rows (K, r) with a known monomial."""
        if self.group.place is not None:
            rows = np.zeros(self.group.count * self.group.rows_each, bool)
            rows[self.block[known[self.number[:, 0]]]] = True
            return rows.reshape(self.group.count, self.group.rows_each)
        return np.logical_or.reduceat(known[self.number], self.first, axis=0)

    def words(self, inside: NDArray[np.bool_]) -> NDArray[np.int64]:
        """List the monomials of the chosen rows (K, r)."""
        if self.group.place is not None:
            return self.number[inside.ravel()[self.block]]
        return self.number[inside[self.block]]

    def close(self, alive: NDArray[np.bool_], chordal: bool) -> tuple[NDArray[np.bool_], Cover]:
        """Close the graphs of all blocks.

        Returns
        -------
        kept : (K, r) bool
            Rows that are kept.
        cover : list of (old block (q,), positions (q, c))
            The new blocks by size.
        """
        hit = self.any(alive)
        if self.group.free:
            return hit, _chosen(hit)
        if self.group.size == 1:
            alone = np.arange(self.group.count)
            return np.ones_like(hit), [(alone, np.zeros((alone.size, 1), np.int64))]
        # Cliques of one shape have one graph: each is closed once.
        keys = [row.tobytes() for row in np.packbits(hit, axis=1)]
        number = {key: k for k, key in enumerate(sorted(set(keys)))}
        shape = np.array([number[key] for key in keys])
        first = np.unique(shape, return_index=True)[1]
        filled, cover = _close_graphs(hit[first], self.group, chordal)
        return filled[shape], [_everywhere(graph, shape, place) for graph, place in cover]

    def blocks(self, cover: Cover, even: NDArray[np.bool_]) -> Blocks:
        """Build the new blocks, without trivial single rows where odd moments are zero.

        Such a row is c >= 0 with c the constant of its generator.
        """
        group, result = self.group, []
        for old, place in cover:
            if place.shape[1] == 1 and not group.free:
                says = self.any(even & (np.arange(even.size) > 0))[old]
                column = place[:, 0] * (place[:, 0] + 3) // 2  # the diagonal, see pairs
                keep = says[np.arange(old.size), column]
                keep |= (group.generator[old] == 0) | self.negative[old]
                old, place = old[keep], place[keep]
            if old.size:
                rows = old[:, None], place
                within = None if group.place is None else group.place[rows]
                generator, clique = group.generator[old], group.clique[old]
                result.append(BlockGroup(group.free, generator, clique, group.basis[rows], within))
        return result


def _merged(system: Generators) -> Generators:
    """Add equal monomials of each polynomial up and leave zeros out."""
    distinct, number = monomials.collect(system.words, system.dimension)
    shape = (system.size, distinct.shape[0])
    table = sps.csr_array((system.coefficients, (system.row, number)), shape=shape)
    table.sum_duplicates()
    table.eliminate_zeros()
    row = np.repeat(np.arange(system.size), np.diff(table.indptr))
    words, n = distinct[table.indices], system.dimension
    return Generators(words, table.data, row, system.size, n, system.matrices)


def _numbered(
    groups: tuple[BlockGroup, ...], system: Generators, start: Words, dimension: int
) -> tuple[list[_Table], Words, NDArray[np.int64]]:
    """Number the distinct monomials of all groups, from 1, and those of ``start``."""
    terms = np.bincount(system.row, minlength=system.size)
    constant = np.zeros(system.size)
    flat = ~system.words.any(axis=1)
    constant[system.row[flat]] = system.coefficients[flat]
    used = [
        _part(g, np.flatnonzero(terms[g.generator] > 0)) if g.place is None else g for g in groups
    ]
    used = [group for group in used if group.count and group.size]
    words = [start, *(row_monomials(group, system) for group in used)]
    distinct, number = monomials.collect(monomials.stack(words), dimension)
    parts = np.split(number, np.cumsum([w.shape[0] for w in words])[:-1])
    tables = []
    for group, part in zip(used, parts[1:], strict=True):
        negative = constant[group.generator] < 0
        if group.place is None:
            block, _ = system.terms_of(group.generator)
        else:
            block = group.terms(system)[0]
            negative[:] = True  # its rows are kept
        first = np.searchsorted(block, np.arange(group.count))
        tables.append(_Table(group, part.reshape(block.size, -1), block, first, negative))
    return tables, distinct, parts[0]


def _part(group: BlockGroup, chosen: NDArray[Any]) -> BlockGroup:
    place = None if group.place is None else group.place[chosen]
    generator, clique = group.generator[chosen], group.clique[chosen]
    return BlockGroup(group.free, generator, clique, group.basis[chosen], place)


def _chosen(mask: NDArray[np.bool_]) -> Cover:
    """List the chosen positions of each block, blocks of equal numbers together."""
    count = mask.sum(axis=1)
    cover = []
    for size in monomials.distinct(count[count > 0]):
        old = np.flatnonzero(count == size)
        cover.append((old, np.nonzero(mask[old])[1].reshape(old.size, int(size))))
    return cover


def _everywhere(
    graph: NDArray[Any], shape: NDArray[Any], place: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Repeat positions (q, c) in graphs (q,) at every block of that shape (K,)."""
    ranked = np.argsort(shape, kind="stable")
    count = np.bincount(shape)
    times = count[graph]
    index = np.repeat(np.arange(graph.size), times)
    within = np.arange(index.size) - np.repeat(np.cumsum(times) - times, times)
    old = ranked[(np.cumsum(count) - count)[graph[index]] + within]
    return old, place[index]


def _distinct(blocks: Blocks, dimension: int) -> Blocks:
    """Keep each generator and basis once, and no single row that a matrix holds."""
    if not blocks:
        return blocks
    width = max(b.basis.shape[2] for b in blocks)
    flat = [monomials.widen(b.basis, width).reshape(-1, width) for b in blocks]
    _, number = monomials.collect(np.concatenate(flat), dimension)
    parts = np.split(number, np.cumsum([w.shape[0] for w in flat])[:-1])
    total = int(number.max()) + 1
    names = [part.reshape(b.basis.shape[:2]) for part, b in zip(parts, blocks, strict=True)]
    names = [  # a monomial in a row of a matrix has a name of its own
        name if b.place is None else name + total * (1 + b.place)
        for name, b in zip(names, blocks, strict=True)
    ]
    total *= 2 + max((int(b.place.max()) for b in blocks if b.place is not None), default=-1)
    held = [np.zeros(0, np.int64)]
    for b, name in zip(blocks, names, strict=True):
        if not b.free and b.size > 1:
            held.append((b.generator[:, None] * total + name).ravel())
    inner = monomials.distinct(np.concatenate(held))
    seen: dict[tuple[bool, int], NDArray[Any]] = {}
    result: Blocks = []
    for b, name in zip(blocks, names, strict=True):
        key = (b.free, b.size)
        table = np.column_stack([b.generator, name])
        known = seen.get(key, table[:0])
        both = np.concatenate([known, table])
        _, first = np.unique(both, axis=0, return_index=True)
        keep = np.sort(first[first >= known.shape[0]]) - known.shape[0]
        if key == (False, 1):
            keep = keep[~np.isin(b.generator[keep] * total + name[keep, 0], inner)]
        seen[key] = both
        if keep.size:
            result.append(_part(b, keep))
    return result


def _initial_support(groups: tuple[BlockGroup, ...], system: Generators, support: Words) -> Words:
    """Collect the constant, ``support``, squares of moment matrices, generators' monomials."""
    words = [np.zeros((1, 1), np.int32), support]
    for group in groups:
        if not group.free:
            basis = group.basis[group.generator == 0]
            words.append(monomials.multiply(basis, basis).reshape(-1, 2 * basis.shape[2]))
    none = [np.zeros(0, np.int64)]
    free = monomials.distinct(np.concatenate(none + [g.generator for g in groups if g.free]))
    rest = monomials.distinct(np.concatenate(none + [g.generator for g in groups if not g.free]))
    words += [system.words[system.terms_of(free)[1]], system.matrices.system.words]
    words += invariant_words(system, np.setdiff1d(rest, free))
    return monomials.stack(words)


# ---- graphs ------------------------------------------------------------------------------


def _close_graphs(
    hit: NDArray[np.bool_], group: BlockGroup, chordal: bool
) -> tuple[NDArray[np.bool_], Cover]:
    """Close the graphs whose edges are rows ``hit`` (u, r), and list what covers them."""
    size, (i, j) = group.size, group.pairs
    graph, row = np.nonzero(hit & (i != j))
    source, target = graph * size + i[row], graph * size + j[row]
    total = hit.shape[0] * size
    ones = np.ones(source.size, bool)
    edges = sps.csr_array((ones, (source, target)), shape=(total, total))
    parts, label = connected_components(edges, directed=False)
    count = np.bincount(label, minlength=parts)
    whole = np.ones(parts, bool)
    if chordal:
        whole = np.bincount(label[source], minlength=parts) == count * (count - 1) // 2
    table = label.reshape(-1, size)
    filled = (table[:, i] == table[:, j]) & whole[table[:, i]] | (i == j)
    ranked, start = np.argsort(label, kind="stable"), np.cumsum(count) - count
    members = [
        ranked[start[(count == c) & whole][:, None] + np.arange(c)]
        for c in monomials.distinct(count)
    ]
    rest = np.flatnonzero(~whole[label])
    if rest.size:
        graph = sps.csr_array((edges + edges.T)[rest][:, rest])
        extended, order = chordal_extension(graph, "min-degree")
        cliques, _ = clique_tree(extended, order)
        sizes = np.array([len(c) for c in cliques])
        members += [
            rest[np.array([c for c in cliques if len(c) == s], np.int64)]
            for s in monomials.distinct(sizes)
        ]
        a, b = (rest[c] for c in sps.coo_array(extended).coords)
        low, high = a % size, b % size
        up = low < high
        filled[a[up] // size, (high * (high + 1) // 2 + low)[up]] = True
    return filled, [(m[:, 0] // size, m % size) for m in members if m.size]
