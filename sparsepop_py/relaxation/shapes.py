"""Shapes of relaxations between order 1 and order 2 for problems of bilinear character.

Order 1 leaves a wide gap where variables multiply each other; order 2 on whole cliques is
expensive. In between stand bases that hold, beside 1 and the variables, only the products
that the problem itself contains (mixed order). Where few *complicating* variables C cover
all products, so that everything is linear once they are fixed, even one clique per
constraint is more than needed:

    star    one block {1} + C + {v} + {c v : the products of v} for every other variable v;
    split   one block {1} + C + {v, c v} over all v of the constraint that meet the same
            group of complicating variables.

Equalities are multiplied by {1} + C, finite bounds (1 - v^2) by {1} + the partners of v.
Every monomial that an equality creates lies in a block; one that lay in none would make its
row useless. All of it follows from the products of the problem, not from its origin.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.errors import ProblemError
from sparsepop_py.plugins.registry import Registry
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks, matrix_block
from sparsepop_py.relaxation.checked_blocks import checked_blocks
from sparsepop_py.sparsity.correlative import Cliques

__all__ = ["SHAPES", "Products", "ShapeBuilder", "mixed_sizes", "shaped_blocks"]

_GLOBAL = 0.25  # a variable in this share of all constraints is one that all of them share


@dataclass(frozen=True, eq=False)
class Products:
    """Products of variables in a problem, and the few variables that cover all products.

    Parameters
    ----------
    pairs : (P, 2) int
        Variables i <= j that occur together in a monomial (i = j: squares).
    meets : (n,) int
        Number of constraints in which each variable occurs.
    rows : int
        Number of constraints.
    """

    pairs: NDArray[np.int64]
    meets: NDArray[np.int64]
    rows: int

    @staticmethod
    def of(problem: Problem, objectives: Sequence[Polynomial] = ()) -> Products:
        """Find products in the constraints and objectives of a problem."""
        return _all_products(problem, objectives) if objectives else _products_of(problem)

    @cached_property
    def complicating(self) -> tuple[int, ...]:
        """Variables that cover all products, found greedily: fixing them leaves linear terms."""
        open_ = np.ones(self.pairs.shape[0], bool)
        square = self.pairs[:, 0] == self.pairs[:, 1]
        chosen = set(self.pairs[square, 0].tolist())
        open_ &= ~np.isin(self.pairs, list(chosen)).any(axis=1)
        while open_.any():
            check()
            count = np.bincount(self.pairs[open_].ravel(), minlength=self.meets.size)
            most = np.flatnonzero(count == count.max())
            best = int(most[np.argmax(self.meets[most])])
            chosen.add(best)
            open_ &= ~(self.pairs == best).any(axis=1)
        return tuple(sorted(chosen))

    @cached_property
    def partners(self) -> dict[int, list[int]]:
        """The variables that each variable multiplies."""
        found: dict[int, set[int]] = {}
        for i, j in self.pairs.tolist():
            if i != j:
                found.setdefault(i, set()).add(j)
                found.setdefault(j, set()).add(i)
        return {v: sorted(others) for v, others in found.items()}

    @property
    def shared(self) -> tuple[int, ...]:
        """The complicating variables and those that a good part of the constraints share."""
        often = np.flatnonzero(self.meets >= max(4, _GLOBAL * self.rows))
        return tuple(sorted({*self.complicating, *often.tolist()}))

    @property
    def has_star(self) -> bool:
        """True if few complicating variables face many others."""
        centre = len(self.complicating)
        return 0 < centre <= 12 and len(self.partners) - centre >= 2 * centre


@lru_cache(maxsize=2)  # a problem and the one sharpened: each local search asks for both
def _products_of(problem: Problem) -> Products:
    """Products of the constraints and the objective of a problem."""
    return _all_products(problem, ())


def _all_products(problem: Problem, objectives: Sequence[Polynomial]) -> Products:
    """Products of the constraints and objectives of a problem."""
    n = problem.dimension
    tables = [problem.rows.words, problem.matrices.system.words, problem.objective.words]
    tables += [f.words for f in objectives]
    mixed = generators.partners(tables, n)
    squares = []
    for table in tables:
        _, variable, power = monomials.runs(table)
        squares.append(variable[power > 1])
    own = monomials.distinct(np.concatenate(squares))
    pairs = np.concatenate([mixed, np.stack([own, own], axis=1)])
    term, variable, _ = monomials.runs(problem.rows.words)
    met = monomials.distinct(problem.rows.row[term] * n + variable) % max(n, 1)
    return Products(pairs, np.bincount(met, minlength=n), problem.rows.size)


class ShapeBuilder(Protocol):
    """Make the blocks of a shape.

    The blocks need not be good: a bound is proved from their multipliers, whatever they are.
    """

    def __call__(
        self,
        problem: Problem,
        cliques: Cliques,
        system: PolynomialSystem,
        objectives: Sequence[Polynomial],
    ) -> Blocks:
        """Return blocks of the scaled ``problem``, for all its objectives.

        ``system`` holds all generators, numbered as in :mod:`sparsepop_py.problem.generators`.
        """
        ...


def shaped_blocks(
    shape: str,
    problem: Problem,
    cliques: Cliques,
    system: PolynomialSystem,
    objectives: Sequence[Polynomial],
) -> Blocks:
    """Make the blocks of a registered shape; products of generators are rows.

    Parameters
    ----------
    shape : str
        A name in ``SHAPES``: ``"linear"``, ``"mixed"``, ``"star"``, ``"split"`` or one that was
        registered.
    problem : Problem
        Scaled, of degree two (of any degree where the shape is linear).
    cliques : Cliques
    system : PolynomialSystem
        All generators, numbered as in :mod:`sparsepop_py.problem.generators`.
    objectives : sequence of Polynomial

    Raises
    ------
    ProblemError
        If no shape has that name, or a registered one raises or returns something else than blocks.
    """
    blocks = SHAPES.ask(shape, SHAPES[shape], problem, cliques, system, objectives)
    if SHAPES.plugged(shape):
        blocks = checked_blocks(blocks, f"shape {shape!r}", problem, len(cliques.members), system)
    builder = _Builder(problem, cliques, blocks=blocks)
    single = generators.count(len(problem.constraints), problem.dimension)
    builder.rows(np.arange(single, system.size))
    if not builder.blocks:
        builder.add(False, 0, -1, [()])  # 1 >= 0: a relaxation has a row
    return builder.blocks


def mixed_sizes(
    problem: Problem, cliques: Cliques, objectives: Sequence[Polynomial]
) -> dict[int, int]:
    """Count the blocks of the cliques in the mixed shape, by size, without making them.

    Parameters
    ----------
    problem : Problem
    cliques : Cliques
    objectives : sequence of Polynomial

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x + y <= 1], lower=-1, upper=1)
    >>> mixed_sizes(problem, sp.find_cliques(problem), [problem.objective])
    {4: 1}
    """
    return dict(Counter(map(len, _Builder(problem, cliques, objectives).clique_bases())))


class _Builder:
    """Collector of blocks; letters are variable numbers from 1. Mutable."""

    def __init__(
        self,
        problem: Problem,
        cliques: Cliques,
        objectives: Sequence[Polynomial] = (),
        blocks: Blocks | None = None,
    ) -> None:
        self.problem, self.cliques, self.objectives = problem, cliques, objectives
        self.blocks: Blocks = [] if blocks is None else blocks
        fixed = problem.lower == problem.upper
        self.free = [v for v in range(problem.dimension) if not fixed[v]]

    @cached_property
    def products(self) -> Products:
        return Products.of(self.problem, self.objectives)

    @cached_property
    def centre(self) -> list[int]:
        chosen = set(self.free)
        return [c + 1 for c in self.products.complicating if c in chosen]

    def add(
        self, free: bool, generator: int, clique: int, basis: Sequence[tuple[int, ...]]
    ) -> None:
        """Add one block; its basis is a list of words of at most two letters."""
        words = _words(basis)[None]
        self.blocks.append(BlockGroup(free, np.array([generator]), np.array([clique]), words))

    def rows(self, numbers: NDArray[np.int64]) -> None:
        """Add generators with a constant multiplier each."""
        nothing = np.zeros((numbers.size, 1, 1), np.int32)
        if numbers.size:
            self.blocks.append(BlockGroup(False, numbers, np.zeros(numbers.size, int), nothing))

    def matrix(self, constraint: int, clique: int, basis: Sequence[tuple[int, ...]]) -> None:
        """Add the block of a varying matrix, with the monomials in each of its rows."""
        found = self.problem.constraints[constraint]
        if any(p.degree for p in found.entries):
            self.blocks.append(matrix_block(constraint, clique, _words(basis), found.side))

    def bounds(self, inside: dict[int, list[int]] | None = None) -> None:
        """Multiply (1 - v^2) by 1 and partners of v; add finite single bounds."""
        box, lower, upper = generators.bound_family(
            len(self.problem.constraints), self.problem.dimension
        )
        finite = np.isfinite(self.problem.lower), np.isfinite(self.problem.upper)
        centre, free = set(self.products.complicating), set(self.free)
        for v in self.free:
            clique = int(self.cliques.home_of_variable[v])
            if finite[0][v] and finite[1][v]:
                met = (inside or self.products.partners).get(v, [])
                if inside is None and v not in centre and not met:  # v^2 lies in no block
                    self.rows(np.array([lower.start, upper.start]) + v)
                    continue
                met = [] if inside is None and v in centre else met
                basis = [(), *((p + 1,) for p in met if p in free)]
                self.add(False, box.start + v, clique, basis)
            elif finite[0][v] or finite[1][v]:
                family = lower if finite[0][v] else upper
                self.add(False, family.start + v, clique, [()])

    def linear(self) -> None:
        """Add rows only: constraints, equalities times partners, 1 - v^2 of squared variables.

        A linear equality is multiplied by a variable where the problem holds all products
        that come of it.
        """
        pairs = {(i + 1, j + 1) for i, j in self.products.pairs.tolist()}
        partners = self.products.partners
        for number, constraint in enumerate(self.problem.constraints):
            polynomial = constraint.polynomial
            if polynomial.degree == 0:
                continue
            multipliers: list[tuple[int, ...]] = [()]
            equal = bool(self.problem.equality[number])
            if equal and polynomial.degree == 1:
                support = polynomial.support.tolist()
                shared = set.intersection(*(set(partners.get(v, ())) | {v} for v in support))
                multipliers += [
                    (p + 1,)
                    for p in sorted(shared)
                    if all((min(p, v) + 1, max(p, v) + 1) in pairs for v in support)
                ]
            self.add(equal, number + 1, 0, multipliers)
        box, lower, upper = generators.bound_family(
            len(self.problem.constraints), self.problem.dimension
        )
        squared = self.products.pairs[:, 0] == self.products.pairs[:, 1]
        free = set(self.free)
        own = [v for v in self.products.pairs[squared, 0].tolist() if v in free]
        self.rows(box.start + np.array(own, int))
        single = np.isfinite(self.problem.lower) ^ np.isfinite(self.problem.upper)
        sides = np.where(np.isfinite(self.problem.lower), lower.start, upper.start)
        self.rows(np.flatnonzero(single) + sides[single])

    def star(self, split: bool = False) -> None:
        """Add blocks around the complicating variables."""
        centre = [(c,) for c in self.centre]
        free = set(self.free)
        shared = [(v + 1,) for v in self.products.shared if v in free]
        base = [(), *centre]
        inside = {c - 1 for c in self.centre}
        partners = self.products.partners
        local = [v for v in self.free if v not in inside and v in partners]
        if split:
            self._split(base, local)
        else:
            for v in local:
                own = [(p + 1, v + 1) for p in partners[v] if p in inside]
                self.add(False, 0, -1, [*base, (v + 1,), *own])
        if len(shared) > len(centre) or not local:
            self.add(False, 0, -1, [(), *shared])
        self.constraints([(), *centre])
        self.bounds()

    def _split(self, base: list[tuple[int, ...]], local: list[int]) -> None:
        """Add one block for each constraint and each group of variables with equal partners."""
        system, seen = self.problem.rows, set()
        term, variable, _ = monomials.runs(system.words)
        partners, chosen = self.products.partners, set(local)
        members: dict[int, set[int]] = {}
        for row, v in zip(system.row[term].tolist(), variable.tolist(), strict=True):
            if v in chosen:
                members.setdefault(row, set()).add(v)
        present: dict[int, set[tuple[int, int]]] = {}
        words = monomials.widen(system.words, max(2, system.words.shape[1]))[:, -2:]
        for row, letters in zip(system.row.tolist(), words.tolist(), strict=True):
            present.setdefault(row, set()).add((letters[0], letters[1]))
        for row, variables in members.items():
            for group in self._groups(variables):
                products = [
                    (p + 1, v + 1)
                    for v in sorted(group)
                    for p in partners[v]
                    if (min(p, v) + 1, max(p, v) + 1) in present[row]
                ]
                basis = (*base, *((v + 1,) for v in sorted(group)), *products)
                if products and basis not in seen:
                    seen.add(basis)
                    self.add(False, 0, -1, list(basis))
        covered = {letters[0] for basis in seen for letters in basis if len(letters) == 1}
        for v in local:
            if v + 1 not in covered:
                self.add(False, 0, -1, [*base, (v + 1,)])

    def _groups(self, variables: set[int]) -> list[set[int]]:
        """Group variables by the complicating variables that they meet anywhere."""
        groups: dict[tuple[int, ...], set[int]] = {}
        inside = set(self.products.complicating)
        for v in variables:
            key = tuple(p for p in self.products.partners[v] if p in inside)
            for known in groups:
                if set(key) & set(known):
                    groups[known].add(v)
                    break
            else:
                groups[key] = {v}
        return list(groups.values())

    def constraints(self, multipliers: list[tuple[int, ...]]) -> None:
        """Add equalities times the multipliers, inequalities and matrices as they are."""
        for number, constraint in enumerate(self.problem.constraints):
            self.matrix(number, -1, [()])
            if constraint.polynomial.degree == 0 or constraint.entries:
                continue
            equal = bool(self.problem.equality[number])
            self.add(equal, number + 1, -1, multipliers if equal else [()])

    def mixed(self) -> None:
        """Add one block a clique: 1, its variables, and the products that occur in it."""
        bases = self.clique_bases()
        for k, basis in enumerate(bases):
            self.add(False, 0, k, basis)
        codes = _Codes(4 + self.problem.degree)
        coded, held = {}, {}  # bases of cliques, and their products
        for number, constraint in enumerate(self.problem.constraints):
            check()
            polynomial = constraint.polynomial
            home = int(self.cliques.home[number])
            basis = bases[home] if home >= 0 else [()]
            if home not in coded:
                own = coded[home] = [codes.of(word) for word in basis]
                held[home] = {a + b for a in own for b in own} if home >= 0 else set()
            held_there, own = held[home], coded[home]
            if constraint.entries:
                entries = [codes.of(t) for p in constraint.entries for t in _terms(p)]
                self.matrix(number, max(home, 0), _localized(basis, own, held_there, entries))
            if polynomial.degree == 0:
                continue
            terms = [codes.of(t) for t in _terms(polynomial)]
            equal = bool(self.problem.equality[number])
            if equal:
                kept = (all(c + t in held_there for t in terms) for c in own)
                multipliers = [b for b, keep in zip(basis, kept, strict=True) if keep] or [()]
            else:
                multipliers = _localized(basis, own, held_there, terms)
            self.add(equal, number + 1, max(home, 0), multipliers)
        inside: dict[int, list[int]] = {}
        for v, others in self.products.partners.items():
            clique = set(self.cliques.members[int(self.cliques.home_of_variable[v])])
            inside[v] = [p for p in others if p in clique]
        self.bounds(inside)

    def clique_bases(self) -> list[list[tuple[int, ...]]]:
        """List 1, the variables and the products that occur, for each clique."""
        held, free = self._products_by_clique(), set(self.free)
        return [
            [(), *((v + 1,) for v in members if v in free), *products]
            for members, products in zip(self.cliques.members, held, strict=True)
        ]

    def _products_by_clique(self) -> list[list[tuple[int, ...]]]:
        sets = [set(members) for members in self.cliques.members]
        of_variable: dict[int, list[int]] = {}
        for k, members in enumerate(self.cliques.members):
            for v in members:
                of_variable.setdefault(v, []).append(k)
        held: list[list[tuple[int, ...]]] = [[] for _ in sets]
        free = set(self.free)
        for i, j in self.products.pairs.tolist():
            if i in free and j in free:
                for k in of_variable.get(i, ()):
                    if j in sets[k]:
                        held[k].append((i + 1, j + 1))
        return held


def _words(basis: Sequence[tuple[int, ...]]) -> monomials.Words:
    """Convert tuples to words of at most two letters each, shape (s, 2)."""
    words = np.zeros((len(basis), 2), np.int32)
    for position, letters in enumerate(basis):
        if letters:
            words[position, 2 - len(letters) :] = sorted(letters)
    return words


def _terms(polynomial: Polynomial) -> list[tuple[int, ...]]:
    return [tuple(x for x in word if x) for word in polynomial.words.tolist()]


class _Codes:
    """Monomials as integers: the code of a product is the sum of the codes.

    Parameters
    ----------
    degree : int
        Largest degree of a product.
    """

    def __init__(self, degree: int) -> None:
        self.bits = degree.bit_length()  # of the exponent of each variable
        self.place: dict[int, int] = {}

    def of(self, letters: tuple[int, ...]) -> int:
        """Compute the code of a monomial; variables get places as they appear."""
        place = self.place
        return sum(1 << self.bits * place.setdefault(x, len(place)) for x in letters)


def _localized(
    basis: list[tuple[int, ...]], codes: list[int], held: set[int], terms: list[int]
) -> list[tuple[int, ...]]:
    """Select monomials that keep all entries of a localizing matrix among the moments."""
    grown, chosen = [0], [basis[0]]
    for b, code in zip(basis[1:], codes[1:], strict=True):
        if all(code + other + t in held for other in (*grown, code) for t in terms):
            grown.append(code)
            chosen.append(b)
    return chosen


# ---- the table of shapes ----------------------------------------------------------------


def _shaped(
    problem: Problem,
    cliques: Cliques,
    system: PolynomialSystem,
    objectives: Sequence[Polynomial],
    *,
    build: Callable[[_Builder], None],
) -> Blocks:
    builder = _Builder(problem, cliques, objectives)
    build(builder)
    return builder.blocks


SHAPES: Registry[ShapeBuilder] = Registry(
    "shape",
    {
        "linear": partial(_shaped, build=_Builder.linear),
        "mixed": partial(_shaped, build=_Builder.mixed),
        "star": partial(_shaped, build=_Builder.star),
        "split": partial(_shaped, build=partial(_Builder.star, split=True)),
    },
    ProblemError,
)
