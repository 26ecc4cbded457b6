"""Moment relaxations: the problem, a family of cliques and an order make blocks.

For a clique C and the vector v_d(C) of its monomials of degree at most d, the
relaxation of order d asks of the moments y_a = L(x^a) that

    M_d(y; C)                 = L(v_d v_d')              be positive semidefinite,
    M_{d - ceil(deg g / 2)}(g y; C) = L(g v v')          likewise, for each g(x) >= 0,
    L(h x^a)                  = 0                        for each h(x) == 0 and
                                                         deg h + |a| <= 2d,

with each constraint in one clique that holds its variables. A variable between finite
bounds l <= x <= u enters by (u - x)(x - l) >= 0 (or by two linear rows, when lean).
Equalities put vectors into the kernel
of the moment matrix; facial reduction drops as many monomials from its basis, which
restores an interior. Where variables lack finite bounds, monomials whose squares nothing
else can match are dropped as well. The relaxation knows no objective: it is built once and every
objective of the same variables' sparsity can be put on it.

References
----------
J. B. Lasserre, Global optimization with polynomials and the problem of moments, SIAM J.
Optim. 11, 2001.
H. Waki, S. Kim, M. Kojima, M. Muramatsu, Sums of squares and semidefinite program
relaxations for polynomial optimization problems with structured sparsity, SIAM J. Optim.
17, 2006.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from . import generators, monomials
from .basis import clique_bases, consistent_bases, reduced_bases
from .errors import ProblemError
from .monomials import Words
from .polynomial import Polynomial
from .problem import Problem
from .sparsity import Cliques, find_cliques
from .system import PolynomialSystem

__all__ = ["BlockGroup", "Relaxation", "least_order", "relax"]


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


@dataclass(frozen=True, eq=False)
class Relaxation:
    """A moment relaxation without objective.

    Parameters
    ----------
    problem : Problem
        The (scaled) problem that was relaxed.
    cliques : Cliques
    order : int
        The relaxation order used, at least the least legal one.
    groups : tuple of BlockGroup
        Free groups first, then blocks of size one, then larger ones.
    moments : (M, D) int32
        The monomials of the moment variables y, without the constant.
    entries : csr (R, M + 1)
        Row r is the affine form of y in conic row r; column 0 holds its constant.
    products : (P, 2) int
        Generators that are products, by the numbers of their factors.
    notes : tuple of str
        What was changed on the way, such as a raised order.
    """

    problem: Problem
    cliques: Cliques
    order: int
    groups: tuple[BlockGroup, ...]
    moments: Words
    entries: sps.csr_array
    products: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of conic rows R."""
        return self.entries.shape[0]

    @cached_property
    def block_sizes(self) -> Counter[int]:
        """How many positive semidefinite blocks there are of each size (1: linear rows)."""
        sizes: Counter[int] = Counter()
        for group in self.groups:
            if not group.free:
                sizes[group.size] += group.count
        return sizes

    @property
    def equality_rows(self) -> int:
        """Number of rows that say L(...) = 0."""
        return sum(g.count * g.rows_each for g in self.groups if g.free)

    def moment_numbers(self, words: Words) -> NDArray[np.int64]:
        """Column of each word in ``entries`` (0: the constant, -1: not a moment here)."""
        number = monomials.lookup(words, self.moments, self.problem.dimension)
        return np.where(words.any(axis=1), np.where(number < 0, -1, number + 1), 0)

    @cached_property
    def scaled_rows(self) -> tuple[sps.csc_array, NDArray[np.float64]]:
        """A and b of A y + s = b, off-diagonal rows of semidefinite blocks times sqrt 2."""
        scale = [np.zeros(0)]
        for group in self.groups:
            weight = np.ones(group.rows_each)
            if not group.free:
                i, j = group.pairs
                weight[i != j] = np.sqrt(2.0)
            scale.append(np.tile(weight, group.count))
        rows = np.repeat(np.arange(self.rows), np.diff(self.entries.indptr))
        scaled = self.entries.copy()
        scaled.data = scaled.data * np.concatenate(scale)[rows]
        columns = scaled.tocsc()
        return (-columns[:, 1:]).tocsc(), columns[:, [0]].toarray().ravel()

    def objective_vector(self, objective: Polynomial) -> tuple[NDArray[np.float64], float]:
        """Coefficients (M,) of L(objective) in the moments, and its constant.

        Raises
        ------
        ProblemError
            If the objective has a monomial that the relaxation does not hold.
        """
        number = self.moment_numbers(objective.words)
        if np.any(number < 0):
            bad = Polynomial.from_words(
                objective.words[number < 0][:1], np.ones(1), objective.dimension, objective.names
            )
            raise ProblemError(
                f"objective: the monomial {bad} is not among the moments of this relaxation; "
                "name the objective when the cliques are found, or raise the order"
            )
        vector = np.bincount(
            number, weights=objective.coefficients, minlength=self.moments.shape[0] + 1
        )
        return vector[1:].astype(float), float(vector[0])

    def __str__(self) -> str:
        cliques = Counter(len(c) for c in self.cliques.members)
        moments, rows = self.moments.shape[0], self.rows
        lines = [
            f"moment relaxation of order {self.order}: {self.problem.dimension} variables, "
            f"{len(self.cliques.members)} cliques",
            "  clique sizes   " + _histogram(cliques),
            "  block sizes    " + _histogram(self.block_sizes),
            f"  moments M = {moments}, conic rows R = {rows} "
            f"({self.equality_rows} equalities), {self.entries.nnz} nonzeros",
        ]
        return "\n".join(lines + [f"  note: {note}" for note in self.notes])


def _histogram(counts: Counter[int]) -> str:
    return ", ".join(f"{size} x {counts[size]}" for size in sorted(counts)) or "none"


def relax(
    problem: Problem,
    order: int | None = None,
    *,
    cliques: Cliques | None = None,
    objectives: Sequence[Polynomial] = (),
    reduce: bool = True,
    lean: bool = False,
    products: bool = False,
) -> Relaxation:
    """Build the moment relaxation of a problem.

    Parameters
    ----------
    problem : Problem
        Variables with finite bounds should have been scaled to [-1, 1].
    order : int, optional
        Relaxation order d; raised to the least legal one (with a note) when smaller.
    cliques : Cliques, optional
        Found from the problem when left out.
    objectives : sequence of Polynomial
        Further objectives that the relaxation must be able to carry.
    reduce : bool
        Whether equalities reduce the bases of moment matrices (facial reduction).
    lean : bool
        Let finite bounds enter as x - l >= 0 and u - x >= 0 instead of their product, and
        stop the multipliers of equalities one degree earlier; the squares of the highest
        monomials then match nothing and leave. A weaker relaxation with far smaller
        blocks, about what Waki et al. solve where the data are of low degree.
    products : bool
        Add products of bounds and linear inequalities where variables multiply each other.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2, x3 = sp.variables(3)
    >>> problem = sp.Problem(x1 * x2 + x2 * x3, lower=-1, upper=1)
    >>> print(sp.relax(problem, 2))
    moment relaxation of order 2: 3 variables, 2 cliques
      clique sizes   2 x 2
      block sizes    3 x 3, 6 x 2
      moments M = 24, conic rows R = 60 (0 equalities), 78 nonzeros
    """
    cliques = cliques or find_cliques(problem, objectives=objectives)
    least = least_order(problem, objectives)
    notes: tuple[str, ...] = ()
    if order is not None and order < least:
        notes = (f"order {order} raised to {least}, the least for these degrees",)
    order = max(order or least, least)
    pairs = np.zeros((0, 2), np.int64)
    if products:
        pairs = generators.useful_products(problem, cliques.members, cliques.home, objectives)
    system = generators.stacked(problem, pairs)
    groups = _groups(problem, cliques, order, system, objectives, reduce, lean)
    moments, entries = _entries(groups, system, problem.dimension)
    return Relaxation(problem, cliques, order, groups, moments, entries, pairs, notes)


def least_order(problem: Problem, objectives: Sequence[Polynomial] = ()) -> int:
    """The least legal relaxation order: half the largest degree, rounded up."""
    return (max([problem.degree, 1, *(f.degree for f in objectives)]) + 1) // 2


def _groups(
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
        held = [_products(group, system) for group in _stack(blocks)]
        held += [f.words for f in (problem.objective, *objectives)]
        moment = consistent_bases(moment, held, problem.dimension)
    zero = [np.zeros(place.size, int) for place, _ in moment]
    blocks += [(False, z, place, basis) for z, (place, basis) in zip(zero, moment, strict=True)]
    return _stack(blocks)


_Blocks = list[tuple[bool, NDArray[np.int64], NDArray[np.int64], Words]]


def _localizing(
    problem: Problem,
    cliques: Cliques,
    members: list[tuple[int, ...]],
    order: int,
    system: PolynomialSystem,
    lean: bool,
) -> _Blocks:
    """Localizing blocks and equality rows, each in the home of its generator."""
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
    blocks: _Blocks = []
    for is_free in (True, False):
        for level in np.unique(reach[degree > 0]):
            index = np.flatnonzero((degree > 0) & (free == is_free) & (reach == level))
            for place, basis in clique_bases(members, home[index], int(level)):
                blocks.append((is_free, index[place], home[index[place]], basis))
    return blocks


def _stack(blocks: _Blocks) -> tuple[BlockGroup, ...]:
    """Blocks of equal kind and size in one group; free rows first, then by size."""
    keyed: dict[tuple[bool, int], _Blocks] = {}
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


def _products(group: BlockGroup, system: PolynomialSystem) -> Words:
    """Every monomial of every row of a group, one row a term."""
    block, term = system.terms_of(group.generator)
    words = system.words[term][:, None, :]
    joined = monomials.multiply(group.products()[block], words)
    return monomials.trim(joined.reshape(-1, joined.shape[-1]))


def _entries(
    groups: tuple[BlockGroup, ...], system: PolynomialSystem, dimension: int
) -> tuple[Words, sps.csr_array]:
    """Moments and the affine form of every conic row, by one merge of all monomials."""
    words, values, rows, offset = [], [], [], 0
    for group in groups:
        block, term = system.terms_of(group.generator)
        row = offset + block[:, None] * group.rows_each + np.arange(group.rows_each)
        words.append(_products(group, system))
        values.append(np.repeat(system.coefficients[term], group.rows_each))
        rows.append(row.ravel())
        offset += group.count * group.rows_each
    width = max(w.shape[1] for w in words)
    stacked = np.concatenate([monomials.widen(w, width) for w in words])
    stacked = np.concatenate([np.zeros((1, width), np.int32), stacked])
    distinct, number = monomials.collect(stacked, dimension)
    entries = sps.csr_array(
        (np.concatenate(values), (np.concatenate(rows), number[1:])),
        shape=(offset, distinct.shape[0]),
    )
    entries.sum_duplicates()
    return distinct[1:], entries
