"""Blocks of a relaxation: a generator, a clique and a monomial basis each.

Every generator (see :mod:`sparsepop_py.problem.generators`) makes one block in its home clique; the
bounds of a variable make one in every clique that holds it. A matrix G of polynomials makes
one with the entries L(G_pq b c), for all pairs (p, b) and (q, c) of a row of G and a monomial.
Blocks of equal size are stacked, so that nothing here runs over monomials one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.problem import generators
from sparsepop_py.problem.generators import Generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.basis import by_size, clique_bases, reduced_bases
from sparsepop_py.relaxation.newton_polytope import consistent_bases
from sparsepop_py.sparsity.correlative import Cliques

__all__ = [
    "BlockGroup",
    "Blocks",
    "block_groups",
    "matrix_block",
    "matrix_blocks",
    "ragged",
    "row_monomials",
    "stacked_groups",
]


@dataclass(frozen=True, eq=False)
class BlockGroup:
    """Blocks of one size, stacked.

    Parameters
    ----------
    free : bool
        Rows L(g b_i) = 0 of an equality when true, matrices L(g b b') when false.
    generator : (K,) int
        What each block is made of, numbered as in :mod:`sparsepop_py.problem.generators`; 0 is
        the constant 1 (a moment matrix).
    clique : (K,) int
        The clique of each block.
    basis : (K, s, D) int32
        The monomials b of each block as words.
    place : (K, s) int, optional
        Of blocks made of matrices: the row of the matrix that goes with each monomial.
    """

    free: bool
    generator: NDArray[np.int64]
    clique: NDArray[np.int64]
    basis: Words
    place: NDArray[np.int64] | None = None

    @property
    def size(self) -> int:
        """Number of monomials s in each basis."""
        return self.basis.shape[1]

    @property
    def count(self) -> int:
        """Number of blocks K."""
        return self.basis.shape[0]

    @property
    def rows_each(self) -> int:
        """Rows of one block: s when free, s (s + 1) / 2 otherwise."""
        return self.size if self.free else self.size * (self.size + 1) // 2

    @cached_property
    def pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows i <= columns j of the upper triangle, column by column."""
        j, i = np.tril_indices(self.size)
        return i, j

    def products(self) -> Words:
        """Multiply the monomials of every row, shape (K, rows_each, D')."""
        if self.free:
            return self.basis
        i, j = self.pairs
        check()  # high orders have millions of products of long words
        return monomials.multiply(self.basis[:, i], self.basis[:, j])

    def terms(self, system: Generators) -> tuple[NDArray[np.int64], Words, NDArray[np.float64]]:
        """Expand every term of every row.

        Parameters
        ----------
        system : Generators
            The polynomials that the blocks multiply.

        Returns
        -------
        row : (T,) int
            Row of each term, from 0.
        words : (T, D) int32
            Its monomial.
        coefficients : (T,) float
        """
        source: PolynomialSystem = system
        number, products = self.generator, self.products()
        if self.place is not None:
            i, j = self.pairs
            source = system.matrices.system
            owner = self.generator[:, None] - 1
            number = system.matrices.entry(owner, self.place[:, i], self.place[:, j]).ravel()
            products = products.reshape(number.size, 1, products.shape[2])
        each = products.shape[1]
        block, term = source.terms_of(number)
        row = block[:, None] * each + np.arange(each)
        check()
        words, factor = products[block], source.words[term]
        if factor.any():  # not of moment matrices
            words = monomials.multiply(words, factor[:, None, :])
        words = monomials.trim(words.reshape(-1, words.shape[-1]))
        return row.ravel(), words, np.repeat(source.coefficients[term], each)


Blocks = list[BlockGroup]


def block_groups(
    problem: Problem,
    cliques: Cliques,
    order: int,
    system: Generators,
    objectives: Sequence[Polynomial],
    reduce: bool,
    lean: bool,
) -> tuple[BlockGroup, ...]:
    """Build the blocks of the full shape: free rows first, then matrices by size."""
    fixed = problem.lower == problem.upper
    members = [tuple(v for v in clique if not fixed[v]) for clique in cliques.members]
    blocks = _localizing(problem, cliques, members, order, system, lean)
    if reduce and problem.equality.any():
        moment = reduced_bases(problem, members, cliques.home, order)
    else:
        moment = clique_bases(members, np.arange(len(members)), order)
    unbounded = ~fixed & (np.isinf(problem.lower) | np.isinf(problem.upper))
    if lean or unbounded.any():
        held = [row_monomials(group, system) for group in stacked_groups(blocks)]
        held += [f.words for f in (problem.objective, *objectives)]
        moment = consistent_bases(moment, held, problem.dimension)
    zero = [np.zeros(place.size, int) for place, _ in moment]
    blocks += [
        BlockGroup(False, z, place, basis) for z, (place, basis) in zip(zero, moment, strict=True)
    ]
    return stacked_groups(blocks)


_SHARED = 4  # cliques a variable may be in on average for its bounds to enter all of them


def _localizing(
    problem: Problem,
    cliques: Cliques,
    members: list[tuple[int, ...]],
    order: int,
    system: Generators,
    lean: bool,
) -> Blocks:
    """Build localizing blocks and equality rows in the homes of their generators.

    The bounds of a variable enter every clique that holds it, unless lean. Generators of a degree
    that the order does not reach are left out.
    """
    degree = np.zeros(system.size, int)
    np.maximum.at(degree, system.row, monomials.degrees(system.words))
    degree[1 + system.matrices.constraints] = 0  # the block of the matrix says more
    box, lower, upper = generators.bound_family(len(problem.constraints), problem.dimension)
    if lean:
        degree[box] = 0
    else:
        boxed = degree[box] > 0
        degree[lower][boxed] = degree[upper][boxed] = 0
    single = generators.count(len(problem.constraints), problem.dimension)
    home = np.zeros(degree.size, int)  # products are single rows and need no clique
    home[:single] = np.concatenate([[0], cliques.home, *[cliques.home_of_variable] * 3])
    free = np.zeros(degree.size, bool)
    free[1 : problem.equality.size + 1] = problem.equality
    top = np.maximum(2 * order - 1 if lean else 2 * order, degree)
    reach = np.where(free, top - degree, order - (degree + 1) // 2)
    reach[single:] = 0
    reach[home < 0] = 0
    home = np.maximum(home, 0)
    number = np.flatnonzero((degree > 0) & (degree <= 2 * order))
    place = home[number]
    if not lean and order > 1:
        extra, where = _elsewhere(cliques, members, degree[box] > 0)
        number, place = np.append(number, box.start + extra), np.append(place, where)
    blocks: Blocks = []
    for is_free in (True, False):
        for half in monomials.distinct(reach[number]):
            chosen = (free[number] == is_free) & (reach[number] == half)
            index, clique = number[chosen], place[chosen]
            for part, basis in clique_bases(members, clique, int(half)):
                blocks.append(BlockGroup(is_free, index[part], clique[part], basis))
    return blocks + matrix_blocks(system, cliques, members, order)


def matrix_blocks(
    system: Generators, cliques: Cliques, members: list[tuple[int, ...]], order: int
) -> Blocks:
    """Build the localizing matrices of matrix constraints.

    A matrix of degree k takes all monomials up to degree d - ceil(k / 2), if there are any.
    """
    matrices, blocks = system.matrices, []
    degree = np.zeros(matrices.side.size, int)
    entries = matrices.system
    np.maximum.at(degree, matrices.owner[entries.row], monomials.degrees(entries.words))
    reached = (degree > 0) & (degree <= 2 * order)
    for k in matrices.constraints[reached[matrices.constraints]]:
        home = int(cliques.home[k])
        reach = order - (int(degree[k]) + 1) // 2 if home >= 0 else 0
        [(_, basis)] = clique_bases(members, np.array([max(home, 0)]), reach)
        blocks.append(matrix_block(int(k), max(home, 0), basis[0], int(matrices.side[k])))
    return blocks


def matrix_block(constraint: int, clique: int, basis: Words, side: int) -> BlockGroup:
    """Build the block of one matrix with monomials (s, D) in each of its rows."""
    place = np.repeat(np.arange(side), basis.shape[0])
    repeated = np.tile(basis, (side, 1))
    return BlockGroup(
        False, np.array([constraint + 1]), np.array([clique]), repeated[None], place[None]
    )


def _elsewhere(
    cliques: Cliques, members: list[tuple[int, ...]], boxed: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List boxed variables with the cliques that hold them besides their home.

    With a multiplier in every clique the value does not depend on which clique is called
    home. Where variables are shared by many cliques that would cost too much: none then.
    """
    pairs = [(v, k) for k, clique in enumerate(members) for v in clique if boxed[v]]
    variable, clique = np.array(pairs, np.int64).reshape(-1, 2).T
    other = cliques.home_of_variable[variable] != clique
    if variable.size > _SHARED * max(1, int(boxed.sum())):
        other[:] = False
    return variable[other], clique[other]


def ragged(block: BlockGroup, keep: NDArray[np.bool_]) -> Blocks:
    """Keep chosen monomials (K, s) of blocks (K, s, D), stacked by their number."""
    parts = []
    for rows, basis in by_size(block.basis, keep):
        place = block.place
        if place is not None:
            place = place[rows][keep[rows]].reshape(rows.size, basis.shape[1])
        parts.append(
            BlockGroup(block.free, block.generator[rows], block.clique[rows], basis, place)
        )
    return parts


def stacked_groups(blocks: Blocks) -> tuple[BlockGroup, ...]:
    """Join blocks of equal kind and size to groups; free rows first, then by size."""
    keyed: dict[tuple[bool, int, bool], Blocks] = {}
    for block in blocks:
        key = (not block.free, block.size, block.place is not None)
        keyed.setdefault(key, []).append(block)
    groups = []
    for (square, _, matrix), parts in sorted(keyed.items(), key=lambda item: item[0]):
        groups.append(
            BlockGroup(
                not square,
                np.concatenate([part.generator for part in parts]),
                np.concatenate([part.clique for part in parts]),
                monomials.stack(part.basis for part in parts),
                np.concatenate([p.place for p in parts if p.place is not None]) if matrix else None,
            )
        )
    return tuple(groups)


def row_monomials(group: BlockGroup, system: Generators) -> Words:
    """List every monomial of every row of a group, one row a term."""
    return group.terms(system)[1]
