"""Relaxation of Waki, Kim, Kojima and Muramatsu with the switches of SparsePOP.

With cliques C_1, ..., C_p and an order d, the sum-of-squares side is

    f - gamma = sum_l sigma_l + sum_k sigma_k g_k + sum_j lambda_j h_j,

sigma_l a sum of squares of polynomials of degree d in the variables of C_l; sigma_k one of
degree d - ceil(deg g_k / 2) and lambda_j a polynomial of degree 2 (d - ceil(deg h_j / 2)), in
the variables of the cliques that cover the constraint, merged as far as is allowed. Each
finite bound of a variable is such a g_k. Bounds of the moments themselves may be added.
Equations with at most two terms, of the kinds that are chosen, are not multiplied but
substituted: their monomials leave all bases, and
:mod:`sparsepop_py.relaxation.sparsepop.reduction` solves the rows that remain of them. A
fractional order gives matrices of the whole order below it, and equations multipliers up to
the degree floor(2 (d - ceil(deg h / 2))).

The multipliers of constraints may have fewer monomials: sums of squares of polynomials whose
monomials are products of at most floor(d / deg g - 1/2) terms of g, and for an equation products
of twice as many. With a perturbation as small as rounding errors that is enough for convergence.

References
----------
H. Waki, S. Kim, M. Kojima, M. Muramatsu, Sums of squares and semidefinite program
relaxations for polynomial optimization problems with structured sparsity, SIAM J. Optim.
17 (2006) 218-242.
M. Muramatsu, H. Waki, L. Tuncel, A perturbed sums of squares theorem for polynomial
optimization and its applications, Optim. Methods Softw. 31 (2016) 134-156 (multipliers of
few monomials).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import LimitReached, before_check
from sparsepop_py.errors import (
    ProblemError,
    check_choice,
    check_number,
    check_switch,
    check_whole,
    entries_of,
)
from sparsepop_py.problem import generators
from sparsepop_py.problem.generators import Generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.basis import clique_bases
from sparsepop_py.relaxation.blocks import (
    BlockGroup,
    Blocks,
    matrix_blocks,
    ragged,
    row_monomials,
    stacked_groups,
)
from sparsepop_py.relaxation.moment import Relaxation, conic_rows, least_order
from sparsepop_py.relaxation.newton_polytope import consistent_bases
from sparsepop_py.relaxation.sparsepop.moment_bounds import moment_bounds
from sparsepop_py.relaxation.sparsepop.substitution import KINDS, Rules
from sparsepop_py.relaxation.sparsepop.unreachable_monomials import eliminated
from sparsepop_py.sparsity.correlative import Cliques

__all__ = ["Switches", "plain_relaxation"]

_SECONDS_OF_PAIR = 5e-7  # at least, for one product of two monomials of a basis


@dataclass(frozen=True)
class Switches:
    """Switches of SparsePOP's relaxation; the defaults are SparsePOP's.

    Parameters
    ----------
    order : float, optional
        Relaxation order, raised to the least legal one.
    merge : float
        Cliques that cover a constraint are merged while the union has at most this many
        times the variables of the largest clique (``multiCliquesFactor``).
    scaled : bool
        Solve the program in scaled variables and rows (``scalingSW``).
    moment_bounds : {0, 1, 2}
        No bounds of moments of degree two and more, all, or those that are not redundant
        (``boundSW``).
    consistent : {0, 1, 2}
        Keep all monomials, or drop those of moment matrices whose squares nothing can match;
        2: those of the constraints' multipliers too (``reduceMomentMatSW``).
    aggressive : bool
        Drop variables as well: moments of degree one may then be missing (``aggressiveSW``).
    substituted : tuple of str
        Equations to substitute: ``"square"`` x^2 = c, ``"binary"`` x^2 = c x, ``"fixed"``
        x = c, ``"zero"`` x y = 0.
    independent : bool
        Drop equations of the program that have become empty (``reduceAMatSW``).
    narrow : bool
        Multipliers of constraints made of their own terms (``sparseSW`` 2 and 3).
    perturbation : float
        Largest random change of each linear coefficient of the scaled objective. The
        multipliers found are certified for the objective as given.

    Raises
    ------
    ProblemError
        If a value is outside its range.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> options = sp.Options(effort="plain", switches=sp.Switches(order=1, scaled=False))
    >>> abs(sp.solve(problem, options).lower_bound + 0.5) < 1e-6
    True
    """

    order: float | None = None
    merge: float = 1.0
    scaled: bool = True
    moment_bounds: int = 2
    consistent: int = 1
    aggressive: bool = False
    substituted: tuple[str, ...] = ("square", "binary", "fixed")
    independent: bool = True
    narrow: bool = False
    perturbation: float = 0.0

    def __post_init__(self) -> None:
        expected = "some of " + ", ".join(KINDS)
        substituted = tuple(entries_of(self.substituted, "Switches.substituted", expected))
        for kind in substituted:
            check_choice(kind, "Switches.substituted", KINDS)
        object.__setattr__(self, "substituted", substituted)
        for name in ("moment_bounds", "consistent"):
            check_whole(getattr(self, name), f"Switches.{name}", 0, 2)
        for name in ("merge", "perturbation"):
            check_number(getattr(self, name), f"Switches.{name}", 0.0)
        for name in ("scaled", "aggressive", "independent", "narrow"):
            check_switch(getattr(self, name), f"Switches.{name}")
        order = 1.0 if self.order is None else check_number(self.order, "Switches.order", 0.0)
        if order >= 2**31:
            raise ProblemError(f"Switches.order: found {order:g}, expected a number below 2^31")

    def perturbed(self, objective: Polynomial, relaxation: Relaxation) -> Polynomial:
        """Add the random linear part to an objective; it is the same in every run.

        Parameters
        ----------
        objective : Polynomial
        relaxation : Relaxation
            Variables that are no moments of it (fixed ones) are left out.

        Returns
        -------
        Polynomial
        """
        if not self.perturbation:
            return objective
        n = objective.dimension
        change = self.perturbation * (2.0 * np.random.RandomState(2008).random_sample(n) - 1.0)
        letters = np.arange(1, n + 1, dtype=np.int32)[:, None]
        held = relaxation.moment_numbers(letters) >= 0
        return objective + Polynomial._merged(letters[held], change[held], n)


def plain_relaxation(
    problem: Problem,
    cliques: Cliques,
    objectives: Sequence[Polynomial],
    switches: Switches,
) -> Relaxation:
    """Build SparsePOP's relaxation of a problem.

    Parameters
    ----------
    problem : Problem
        Scaled without a shift; rows that repeat bounds included.
    cliques : Cliques
    objectives : sequence of Polynomial
        All objectives that the relaxation must be able to carry.
    switches : Switches

    Returns
    -------
    Relaxation

    Raises
    ------
    LimitReached
        Within ``Deadline.kept()``, where products of monomials are expected to outlast the limit.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y - x - y, [x + y <= 1.5], 0, 1)
    >>> relaxation = plain_relaxation(problem, sp.find_cliques(problem), (), Switches(order=2))
    >>> dict(relaxation.block_sizes), relaxation.moments.shape[0]
    ({1: 3, 3: 6}, 9)
    """
    n = problem.dimension
    least = least_order(problem, objectives)
    order = max(float(switches.order or least), float(least))
    fixed = problem.lower == problem.upper
    rules = Rules.of(problem, switches.substituted)
    system = generators.stacked(problem, np.zeros((0, 2), np.int64))
    binary = rules.binary(problem)
    blocks = _multiplied(problem, cliques, system, rules, order, switches)
    asked = [f.words for f in (problem.objective, *objectives)]
    members = [tuple(v for v in clique if not fixed[v]) for clique in cliques.members]
    alive = np.array([k for k, clique in enumerate(members) if clique] or [0])
    moment = [(alive[k], basis) for k, basis in clique_bases(members, alive, int(order))]
    plain = [BlockGroup(False, place * 0, place, basis) for place, basis in moment]
    moment = [(block.clique, block.basis) for block in rules.normal(plain)]
    pairs = sum(block.count * block.rows_each for block in plain)
    if pairs * _SECONDS_OF_PAIR > before_check():
        raise LimitReached
    least_degree = 0 if switches.aggressive else 2  # first moments of every solution
    if switches.consistent:
        held = [row_monomials(group, system) for group in stacked_groups(blocks)] + asked
        moment = consistent_bases(moment, held, n, rules.rewritten, least_degree)
    blocks += [BlockGroup(False, place * 0, place, basis) for place, basis in moment]
    if switches.consistent == 2:
        blocks = eliminated(blocks, system, asked, rules, least_degree)
    groups = stacked_groups([block for block in blocks if block.size])
    words, _ = conic_rows(groups, system, asked, n)
    blocks += rules.rows(words, n)
    groups = stacked_groups([block for block in blocks if block.size])
    words, _ = conic_rows(groups, system, asked, n)
    normal = words[~rules.divides(words) & (monomials.degrees(words) > 1)]
    ends = np.where(binary, -np.inf, problem.lower), np.where(binary, np.inf, problem.upper)
    rows = moment_bounds(problem, ends, normal, groups, switches.moment_bounds)
    if rows.size:
        number, alone = np.arange(rows.size), np.zeros((rows.size, 1, 1), np.int32)
        extra = BlockGroup(False, system.size + number, number * 0, alone)
        free = [g for g in groups if g.free]
        groups = (*free, extra, *(g for g in groups if not g.free))
        system = _joined(system, rows)
    moments, entries = conic_rows(groups, system, asked, n)
    none = np.zeros((0, 2), np.int64)
    notes: tuple[str, ...] = ()
    if switches.order is not None and switches.order < least:
        notes = (f"order {switches.order:g} raised to {least}, the least for these degrees",)
    return Relaxation(
        problem,
        cliques,
        int(order),
        groups,
        moments,
        entries,
        none,
        notes,
        rows if rows.size else None,
    )


def _multiplied(
    problem: Problem,
    cliques: Cliques,
    system: Generators,
    rules: Rules,
    order: float,
    switches: Switches,
) -> Blocks:
    """Build the blocks of constraints and bounds that are not substituted."""
    m, n = len(problem.constraints), problem.dimension
    fixed = problem.lower == problem.upper
    degree = np.zeros(system.size, int)
    np.maximum.at(degree, system.row, monomials.degrees(system.words))
    box, low, high = generators.bound_family(m, n)
    degree[box] = 0
    known = fixed | rules.binary(problem)  # x = x^2 >= 0 and 1 - x = (1 - x)^2 >= 0 already
    degree[low][known] = degree[high][known] = 0
    degree[1 + system.matrices.constraints] = 0  # the block of the matrix says more
    free = np.zeros(system.size, bool)
    free[1 : m + 1] = problem.equality
    number = np.flatnonzero(degree > 0)
    number = number[~np.isin(number, rules.generator)]
    blocks: Blocks = []
    supports = {k + 1: c.polynomial.support for k, c in enumerate(problem.constraints)}
    unions = _Unions(cliques, switches.merge)
    by_degree: dict[tuple[bool, int], list[tuple[int, int, tuple[int, ...]]]] = {}
    for k in number.tolist():
        support = supports.get(k, np.array([(k - 1 - m) % n]))
        home, union = unions.of(support)
        half = order - (int(degree[k]) + 1) // 2
        reach = int(2 * half) if free[k] else int(half)
        inside = tuple(v for v in union if not fixed[v])
        if switches.narrow:
            times = int(order / int(degree[k]) - 0.5) * (2 if free[k] else 1)
            place, basis = np.array([k]), _powers(system, k, times, fixed)
            blocks.append(BlockGroup(bool(free[k]), place, np.array([home]), basis[None]))
            continue
        by_degree.setdefault((bool(free[k]), reach), []).append((k, home, inside))
    for (is_free, reach), items in sorted(by_degree.items()):
        index = np.array([k for k, _, _ in items])
        home_of = np.array([home for _, home, _ in items])
        places = [inside for _, _, inside in items]
        for part, basis in clique_bases(places, np.arange(len(items)), reach):
            blocks.append(BlockGroup(is_free, index[part], home_of[part], basis))
    members = [tuple(v for v in clique if not fixed[v]) for clique in cliques.members]
    blocks = [part for block in rules.normal(blocks) for part in _alive(block, system, rules)]
    return blocks + rules.normal(matrix_blocks(system, cliques, members, int(order)))


def _powers(system: Generators, number: int, times: int, fixed: NDArray[np.bool_]) -> Words:
    """Multiply at most so many terms of a polynomial, in open variables; shape (s, D)."""
    _, term = system.terms_of(np.array([number]))
    words = system.words[term]
    words = words[~np.append(False, fixed)[words].any(axis=1)]
    found = np.zeros((1, 1), np.int32)
    for _ in range(times):
        products = monomials.multiply(found[:, None, :], words[None])
        products = products.reshape(-1, products.shape[-1])
        both = monomials.stack((found, products))
        found, _ = monomials.collect(monomials.trim(both), system.dimension)
    return found


def _alive(block: BlockGroup, system: Generators, rules: Rules) -> Blocks:
    """Drop monomials b for which every term of g b^2 is substituted by 0."""
    basis = block.basis
    if block.free or not rules.vanishes.any():
        return [block]
    place, term = system.terms_of(block.generator)
    squares = monomials.multiply(basis, basis)[place]
    words = monomials.multiply(squares, system.words[term][:, None, :])
    left = ~rules.vanish(words)
    count = np.zeros(basis.shape[:2], int)
    np.add.at(count, place, left)
    return ragged(block, count > 0)


class _Unions:
    """Variables that the multiplier of a constraint may have.

    Cliques are met in the order in which they arise when variables are eliminated.
    """

    def __init__(self, cliques: Cliques, merge: float) -> None:
        self.sets = [frozenset(c) for c in cliques.members]
        self.most = merge * max(len(c) for c in cliques.members)
        step = np.argsort(cliques.order)
        first = [int(step[list(c)].min(initial=step.size)) for c in cliques.members]
        self.holding: dict[int, list[int]] = {}
        for k in sorted(range(len(first)), key=first.__getitem__):
            for v in cliques.members[k]:
                self.holding.setdefault(v, []).append(k)

    def of(self, support: NDArray[Any]) -> tuple[int, tuple[int, ...]]:
        """Find the first clique covering a support, and the variables after merging others."""
        wanted = support.tolist()
        rare = min(wanted, key=lambda v: len(self.holding[v]))
        covering = [k for k in self.holding[rare] if self.sets[k].issuperset(wanted)]
        union: set[int] = set(self.sets[covering[0]])
        for k in covering[1:]:
            if len(union | self.sets[k]) <= self.most:
                union |= self.sets[k]
        return covering[0], tuple(sorted(union))


def _joined(first: Generators, second: PolynomialSystem) -> Generators:
    return Generators(
        monomials.stack((first.words, second.words)),
        np.append(first.coefficients, second.coefficients),
        np.append(first.row, second.row + first.size),
        first.size + second.size,
        first.dimension,
        first.matrices,
    )
