"""The blocks of a relaxation: which polynomial, which clique, which monomials.

Every generator (see :mod:`sparsepop_py.generators`) makes one block in its home clique; the
bounds of a variable make one in every clique that holds it. Blocks of equal size are
stacked, so that nothing here runs over monomials one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from . import generators, monomials
from .basis import by_size, clique_bases, consistent_bases, reduced_bases
from .monomials import Words
from .polynomial import Polynomial
from .problem import Problem
from .sparsity import Cliques
from .system import PolynomialSystem

__all__ = [
    "Block",
    "BlockGroup",
    "Blocks",
    "block_groups",
    "ragged",
    "row_monomials",
    "stacked_groups",
]

Block = tuple[bool, NDArray[np.int64], NDArray[np.int64], Words]
Blocks = list[Block]


@dataclass(frozen=True, eq=False)
class BlockGroup:
    """Blocks of one size, stacked.

    Parameters
    ----------
    free : bool
        Rows L(g b_i) = 0 of an equality when true, matrices L(g b b') when false.
    generator : (K,) int
        What each block is made of, numbered as in :mod:`sparsepop_py.generators`; 0 is
        the constant 1 (a moment matrix).
    clique : (K,) int
        The clique of each block.
    basis : (K, s, D) int32
        The monomials b of each block as words.
    """

    free: bool
    generator: NDArray[np.int64]
    clique: NDArray[np.int64]
    basis: Words

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
        """The monomial of every row, shape (K, rows_each, D')."""
        if self.free:
            return self.basis
        i, j = self.pairs
        return monomials.multiply(self.basis[:, i], self.basis[:, j])


def block_groups(
    problem: Problem,
    cliques: Cliques,
    order: int,
    system: PolynomialSystem,
    objectives: Sequence[Polynomial],
    reduce: bool,
    lean: bool,
) -> tuple[BlockGroup, ...]:
    """Every block of the relaxation: free rows first, then matrices by size."""
    fixed = problem.lower == problem.upper
    members = [tuple(v for v in clique if not fixed[v]) for clique in cliques.members]
    blocks = _localizing(problem, cliques, members, order, system, lean)
    if reduce and problem.equality.any():
        moment = reduced_bases(problem, members, cliques.home, order)
    else:
        moment = clique_bases(members, np.arange(len(members)), order)
    endless = ~fixed & (np.isinf(problem.lower) | np.isinf(problem.upper))
    if lean or endless.any():
        held = [row_monomials(group, system) for group in stacked_groups(blocks)]
        held += [f.words for f in (problem.objective, *objectives)]
        moment = consistent_bases(moment, held, problem.dimension)
    zero = [np.zeros(place.size, int) for place, _ in moment]
    blocks += [(False, z, place, basis) for z, (place, basis) in zip(zero, moment, strict=True)]
    return stacked_groups(blocks)


_SHARED = 4  # cliques a variable may be in on average for its bounds to enter all of them


def _localizing(
    problem: Problem,
    cliques: Cliques,
    members: list[tuple[int, ...]],
    order: int,
    system: PolynomialSystem,
    lean: bool,
) -> Blocks:
    """Localizing blocks and equality rows in the homes of their generators.

    The bounds of a variable enter every clique that holds it, unless lean.
    """
    degree = np.zeros(system.size, int)
    np.maximum.at(degree, system.row, monomials.degrees(system.words))
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
    number = np.flatnonzero(degree > 0)
    place = home[number]
    if not lean and order > 1:
        extra, where = _elsewhere(cliques, members, degree[box] > 0)
        number, place = np.append(number, box.start + extra), np.append(place, where)
    blocks: Blocks = []
    for is_free in (True, False):
        for level in np.unique(reach[number]):
            chosen = (free[number] == is_free) & (reach[number] == level)
            index, clique = number[chosen], place[chosen]
            for part, basis in clique_bases(members, clique, int(level)):
                blocks.append((is_free, index[part], clique[part], basis))
    return blocks


def _elsewhere(
    cliques: Cliques, members: list[tuple[int, ...]], boxed: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Boxed variables and the cliques that hold them besides their home.

    With a multiplier in every clique the value does not depend on which clique is called
    home. Where variables are shared by many cliques that would cost too much: none then.
    """
    pairs = [(v, k) for k, clique in enumerate(members) for v in clique if boxed[v]]
    variable, clique = np.array(pairs, np.int64).reshape(-1, 2).T
    other = cliques.home_of_variable[variable] != clique
    if variable.size > _SHARED * max(1, int(boxed.sum())):
        other[:] = False
    return variable[other], clique[other]


def ragged(block: Block, keep: NDArray[np.bool_]) -> Blocks:
    """Blocks (K, s, D) with only the monomials to keep (K, s), stacked by what is left of s."""
    free, generator, clique, basis = block
    return [(free, generator[rows], clique[rows], words) for rows, words in by_size(basis, keep)]


def stacked_groups(blocks: Blocks) -> tuple[BlockGroup, ...]:
    """Blocks of equal kind and size in one group; free rows first, then by size."""
    keyed: dict[tuple[bool, int], Blocks] = {}
    for block in blocks:
        keyed.setdefault((not block[0], block[3].shape[1]), []).append(block)
    groups = []
    for (matrix, _), parts in sorted(keyed.items(), key=lambda item: item[0]):
        width = max(basis.shape[2] for *_, basis in parts)
        groups.append(
            BlockGroup(
                not matrix,
                np.concatenate([generator for _, generator, _, _ in parts]),
                np.concatenate([clique for _, _, clique, _ in parts]),
                np.concatenate([monomials.widen(basis, width) for *_, basis in parts]),
            )
        )
    return tuple(groups)


def row_monomials(group: BlockGroup, system: PolynomialSystem) -> Words:
    """Every monomial of every row of a group, one row a term."""
    block, term = system.terms_of(group.generator)
    words = system.words[term][:, None, :]
    joined = monomials.multiply(group.products()[block], words)
    return monomials.trim(joined.reshape(-1, joined.shape[-1]))
