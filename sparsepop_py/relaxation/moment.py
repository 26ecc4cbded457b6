"""Moment relaxations: problem, cliques and order make blocks.

For a clique C and the vector v_d(C) of its monomials of degree at most d, the
relaxation of order d asks of the moments y_a = L(x^a) that

    M_d(y; C)                 = L(v_d v_d')              be positive semidefinite,
    M_{d - ceil(deg g / 2)}(g y; C) = L(g v v')          likewise, for each g(x) >= 0,
    L(h x^a)                  = 0                        for each h(x) == 0 and
                                                         deg h + |a| <= 2d,

with each constraint in one clique that holds its variables; a matrix G >= 0 of polynomials
likewise has a localizing matrix L(G (x) v v'). A variable between finite
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

import numbers
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial, polynomials_of
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.budget import check
from sparsepop_py.errors import ProblemError, check_kind, check_switch, shown
from sparsepop_py.problem import generators
from sparsepop_py.problem.generators import Generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.basis import MOST_BYTES, building_bytes
from sparsepop_py.relaxation.blocks import BlockGroup, block_groups, stacked_groups
from sparsepop_py.relaxation.shapes import shaped_blocks
from sparsepop_py.relaxation.term_sparsity import Terms, term_sparse
from sparsepop_py.sparsity.correlative import Cliques, find_cliques
from sparsepop_py.verified.arithmetic.array_checks import read_only

__all__ = [
    "BlockGroup",
    "Relaxation",
    "conic_rows",
    "least_order",
    "objective_order",
    "on_groups",
    "relax",
    "shape_sizes",
]


@dataclass(frozen=True, eq=False)
class Relaxation(ReadOnly):
    """Moment relaxation without objective.

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
        Sentences on what was changed, such as a raised order.
    moment_bounds : PolynomialSystem or None
        Bounds of single moments, +-(x^a - value) >= 0: generators behind all others, in
        one group of their own.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> relaxation = sp.relax(sp.Problem(x * y, [x**2 + y**2 <= 1]))
    >>> relaxation.order, relaxation.rows, dict(relaxation.block_sizes)
    (1, 7, {1: 1, 3: 1})
    """

    problem: Problem
    cliques: Cliques
    order: int
    groups: tuple[BlockGroup, ...]
    moments: Words
    entries: sps.csr_array
    products: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    notes: tuple[str, ...] = ()
    moment_bounds: PolynomialSystem | None = None

    def __post_init__(self) -> None:
        self.__dict__["moments"] = read_only(self.moments, "i", "moments", 2)
        self.__dict__["products"] = read_only(self.products, "i", "products", 2)
        self.__dict__["groups"], self.__dict__["notes"] = tuple(self.groups), tuple(self.notes)

    @property
    def rows(self) -> int:
        """Number of conic rows R."""
        return self.entries.shape[0]

    @cached_property
    def block_sizes(self) -> Counter[int]:
        """Number of positive semidefinite blocks by size (1: linear rows)."""
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
        """Find the column of each word in ``entries``.

        Parameters
        ----------
        words : (T, D) int32
            Monomials; see :mod:`sparsepop_py.algebra.monomials`.

        Returns
        -------
        (T,) int
            0 for the constant, -1 for a monomial that is no moment here.
        """
        number = monomials.lookup(words, self.moments, self.problem.dimension)
        return np.where(words.any(axis=1), np.where(number < 0, -1, number + 1), 0)

    @cached_property
    def variable_numbers(self) -> NDArray[np.int64]:
        """Column of each variable in ``entries``, shape (n,); -1 where it is no moment here."""
        letters = np.arange(1, self.problem.dimension + 1, dtype=np.int32)[:, None]
        return self.moment_numbers(letters)

    @cached_property
    def scaled_rows(self) -> tuple[sps.csc_array, NDArray[np.float64]]:
        """Matrix A and vector b of the conic rows A y + s = b.

        Semidefinite rows off diagonals are times sqrt 2.
        """
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
        """Express an objective in the moments.

        Parameters
        ----------
        objective : Polynomial

        Returns
        -------
        vector : (M,) float
            Coefficients of L(objective).
        constant : float

        Raises
        ------
        ProblemError
            If the objective has a monomial that the relaxation does not hold.
        """
        check_kind(objective, Polynomial, "objective")
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
    shape: str = "full",
    terms: Terms = "none",
    partial: bool = False,
) -> Relaxation:
    """Build the moment relaxation of a problem.

    Parameters
    ----------
    problem : Problem
        Variables with finite bounds should have been scaled to [-1, 1].
    order : int, optional
        Relaxation order d, at least 1; raised to the least legal one (with a note) when smaller.
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
    shape : {"full", "linear", "mixed", "star", "split"}, or a registered one
        ``"linear"``: rows only, with products of bounds up to the degree of the problem.
        The others: bases of problems of degree two between order 1 and order 2, see
        :mod:`sparsepop_py.relaxation.shapes`. ``order``, ``reduce`` and ``lean`` mean nothing then.
    terms : {"none", "components", "chordal", "sign"}
        Split the blocks by the monomials that occur in the problem and in ``objectives``:
        to connected components of the term graph, to the cliques of its chordal extension,
        or by sign symmetries. Components and signs keep the value of the relaxation,
        chordal cliques are smaller and may lower it; see
        :mod:`sparsepop_py.relaxation.term_sparsity`. Only objectives whose monomials were named
        fit such a relaxation.
    partial : bool
        Leave constraints out whose degree is above 2d, in place of raising the order for them.
        A bound without some constraints is a bound.

    Returns
    -------
    Relaxation

    Raises
    ------
    ProblemError
        If ``terms`` is unknown, ``order`` is no positive integer, or the relaxation is far too
        large for any solver.

    References
    ----------
    J. Wang, V. Magron, J.-B. Lasserre, SIAM J. Optim. 31 (2021) 30-58 (components) and
    114-141 (chordal).

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2, x3 = sp.variables(3)
    >>> problem = sp.Problem(x1 * x2 + x2 * x3, lower=-1, upper=1)
    >>> print(sp.relax(problem, 2))
    moment relaxation of order 2: 3 variables, 2 cliques
      clique sizes   2 x 2
      block sizes    3 x 4, 6 x 2
      moments M = 24, conic rows R = 66 (0 equalities), 90 nonzeros
    """
    check_kind(problem, Problem, "problem")
    whole = isinstance(order, numbers.Integral) and not isinstance(order, bool)
    if order is not None and (not whole or not 1 <= order < 2**31):
        raise ProblemError(f"order: found {shown(order)}, expected a positive integer below 2^31")
    for name, given in (
        *(("reduce", reduce), ("lean", lean), ("products", products), ("partial", partial)),
    ):
        check_switch(given, name)
    for name, word in (("shape", shape), ("terms", terms)):
        check_kind(word, str, name)
    others = polynomials_of(objectives, "objectives", problem.dimension)
    objectives = [f for f in others if f is not problem.objective]
    cliques = find_cliques(problem, objectives=objectives) if cliques is None else cliques
    check_kind(cliques, Cliques, "cliques")
    least = objective_order(problem, objectives) if partial else least_order(problem, objectives)
    notes: tuple[str, ...] = ()
    if order is not None and order < least:
        notes = (f"order {order} raised to {least}, the least for these degrees",)
    order = max(order or least, least)
    if shape == "full":
        _check_size(problem, cliques, order)
    pairs = _products(problem, cliques, objectives, shape, products)
    system = generators.stacked(problem, pairs)
    if shape == "full":
        groups = block_groups(problem, cliques, order, system, objectives, reduce, lean)
    else:
        groups = stacked_groups(shaped_blocks(shape, problem, cliques, system, objectives))
    asked = [f.words for f in (problem.objective, *objectives)]
    if terms != "none":
        groups = term_sparse(groups, system, monomials.stack(asked), problem.dimension, terms)
    moments, entries = conic_rows(groups, system, asked, problem.dimension)
    return Relaxation(problem, cliques, order, groups, moments, entries, pairs, notes)


def _check_size(problem: Problem, cliques: Cliques, order: int) -> None:
    """Check before any work that a relaxation is not too large to be built."""
    needed = building_bytes(problem, cliques, order)
    if needed > MOST_BYTES:
        raise ProblemError(
            f"order: found {order}, whose relaxation takes about {needed / 1e9:.2g} GB to build, "
            f"expected at most {MOST_BYTES / 1e9:g} GB"
        )


def shape_sizes(
    problem: Problem,
    shape: str,
    cliques: Cliques,
    objectives: Sequence[Polynomial] = (),
    products: bool = True,
) -> tuple[dict[int, float], int]:
    """Count blocks by size and conic rows of a shape, without its moments.

    Parameters
    ----------
    problem, shape, cliques, objectives, products
        As of :func:`relax`; any registered shape.

    Returns
    -------
    sizes : dict
        Number of positive semidefinite blocks of each size (1: linear rows).
    rows : int

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x + y <= 1], lower=-1, upper=1)
    >>> cliques = sp.find_cliques(problem)
    >>> sizes, rows = shape_sizes(problem, "mixed", cliques)
    >>> relaxation = sp.relax(problem, cliques=cliques, products=True, shape="mixed")
    >>> sizes == dict(relaxation.block_sizes), rows == relaxation.rows
    (True, True)
    """
    pairs = _products(problem, cliques, objectives, shape, products)
    system = generators.stacked(problem, pairs)
    sizes, rows = Counter[int](), 0
    for block in shaped_blocks(shape, problem, cliques, system, objectives):
        rows += block.count * block.rows_each
        if not block.free:
            sizes[block.size] += block.count
    return dict(sizes), rows


def _products(
    problem: Problem,
    cliques: Cliques,
    objectives: Sequence[Polynomial],
    shape: str,
    products: bool,
) -> NDArray[np.int64]:
    """Pairs of generators that a relaxation multiplies, shape (P, 2)."""
    if shape == "linear":
        return generators.bound_products(problem, cliques.members, cliques.home, objectives)
    if products:
        return generators.useful_products(problem, cliques.members, cliques.home, objectives)
    return np.zeros((0, 2), np.int64)


def on_groups(relaxation: Relaxation, groups: tuple[BlockGroup, ...]) -> Relaxation:
    """Rebuild the relaxation of the same problem with other blocks."""
    problem = relaxation.problem
    system = generators.stacked(problem, relaxation.products)
    moments, entries = conic_rows(groups, system, [problem.objective.words], problem.dimension)
    return replace(relaxation, groups=groups, moments=moments, entries=entries)


def least_order(problem: Problem, objectives: Sequence[Polynomial] = ()) -> int:
    """Return the least legal relaxation order: half the largest degree, rounded up."""
    return (max([problem.degree, 1, *(f.degree for f in objectives)]) + 1) // 2


def objective_order(problem: Problem, objectives: Sequence[Polynomial] = ()) -> int:
    """Return the least order that carries the objectives, whatever the constraints."""
    return (max([1, problem.objective.degree, *(f.degree for f in objectives)]) + 1) // 2


def conic_rows(
    groups: tuple[BlockGroup, ...],
    system: Generators,
    asked: list[Words],
    dimension: int,
) -> tuple[Words, sps.csr_array]:
    """Merge all monomials to moments, and express every conic row in them.

    The monomials of objectives are moments even if no row holds them.
    """
    words, values, rows, offset = [], [], [], 0
    for group in groups:
        check()
        row, word, value = group.terms(system)
        words.append(word)
        values.append(value)
        rows.append(offset + row)
        offset += group.count * group.rows_each
    check()
    used = sum(w.shape[0] for w in words)
    words += [np.zeros((1, 1), np.int32), *asked]
    distinct, number = monomials.collect(monomials.stack(words), dimension)
    entries = sps.csr_array(
        (np.concatenate(values), (np.concatenate(rows), number[:used])),
        shape=(offset, distinct.shape[0]),
    )
    entries.sum_duplicates()
    return distinct[1:], entries
