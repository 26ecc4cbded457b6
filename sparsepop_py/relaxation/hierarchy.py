"""Hierarchy of the relaxations that a problem admits, with a model of cost and progress.

Progress from a gap g to the gap t that counts as closed is measured on a logarithmic
scale: 0 at g, 1 at t. The expected progress of a relaxation is first a rule of thumb from
pooling, bilinear, polynomial and identification problems, then its progress on the objectives
before; both only decide the order of trying. Seconds of an interior-point solve are estimated
from the r = s (s + 1) / 2 entries of each block, those of a linear program from its rows, until
they have been measured.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from math import comb
from typing import Any, Protocol, get_args

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.plugins.registry import Registry
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import (
    Relaxation,
    least_order,
    objective_order,
    relax,
    shape_sizes,
)
from sparsepop_py.relaxation.shapes import SHAPES, Products, mixed_sizes
from sparsepop_py.relaxation.term_sparsity import Terms
from sparsepop_py.sparsity.correlative import Cliques, Joined, Method, find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled

__all__ = [
    "SPECS",
    "CostModel",
    "Families",
    "RelaxationSpec",
    "SpecSource",
    "expected_seconds",
    "hashed",
    "progress",
    "relaxation_specs",
    "worth_of",
]


class Families(dict[Joined, Cliques]):
    """Cliques for each way of joining variables, found when asked for.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    sparse : bool
    method : {"auto", "min-degree", "min-fill", "mcs-m"}
        As in :func:`sparsepop_py.find_cliques`.
    """

    def __init__(
        self, problem: Problem, objectives: Sequence[Polynomial], sparse: bool, method: Method
    ) -> None:
        self._given = problem, sparse, method, objectives
        self._alike = not (sparse and problem.constraints)

    def __missing__(self, joined: Joined) -> Cliques:
        """Find cliques; all are equal where nothing is sparse."""
        usual = joined == "constraints" or self._alike
        found = find_cliques(*self._given) if usual else find_cliques(*self._given, joined)
        for name in ("constraints", "monomials", "partners") if self._alike else (joined,):
            self[name] = found
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Take what was found to another process."""
        problem, sparse, method, objectives = self._given
        return Families, (problem, objectives, sparse, method), None, None, iter(self.items())


@dataclass(frozen=True)
class HierarchySettings:
    """Settings of the hierarchy and of its cost model.

    They decide what is tried first, never whether a bound is valid. Numbers without another
    source are rules of thumb, chosen on the benchmark families (pooling, bilinear, polynomial and
    identification problems).

    Parameters
    ----------
    closed : float
        Worth of closing a gap; the rest is that of progress towards it.
    tighter : float
        Expected progress that a tightened box adds.
    seldom : int
        A relaxation of expected progress s closes the gap about s**4 of the time.
    prior : float
        Worth of an untried relaxation: as if it closed about two gaps of three.
    iterations : int
        Iterations of an interior-point solve, about.
    most_basis : int
        Monomials of one clique, at most, for a relaxation to be built.
    worth_splitting : int
        Monomials of a clique from which chordal term sparsity is tried.
    chordal_time : float
        Usual share of the time with blocks from chordal terms.
    small_problem : int
        Variables up to which whole cliques are tried where stars would do.
    family : int
        Objectives from which stars alone are tried: their analysis is shared.
    more_orders : int
        Orders beyond the least.
    """

    closed: float = 0.9
    tighter: float = 0.02
    seldom: int = 4
    prior: float = 0.77
    iterations: int = 25
    most_basis: int = 1500
    worth_splitting: int = 30
    chordal_time: float = 0.1
    small_problem: int = 60
    family: int = 4
    more_orders: int = 3


HIERARCHY = HierarchySettings()


@dataclass(frozen=True)
class RelaxationSpec:
    """Specification of a relaxation in the hierarchy.

    Parameters
    ----------
    name : str
        Name in the history.
    share : float
        Expected progress towards a closed gap after it.
    shape : {"full", "linear", "mixed", "star", "split"}
    order : int or None
        Relaxation order of the full shape.
    lean, products : bool
    terms : {"none", "components", "chordal"}
        As in :func:`sparsepop_py.relax`.
    joined : {"constraints", "monomials", "partners"}
        As in :func:`sparsepop_py.find_cliques`.
    partial : bool
        Whether constraints of a degree beyond the order are left out.
    plain : RelaxationSpec or None
        The relaxation itself, if this one stands for it on a box that linear programs with the
        cutoff have tightened.
    memory : float
        Bytes that a solver may take; larger relaxations are left out.
    """

    name: str
    share: float
    shape: str = "full"
    order: int | None = None
    lean: bool = False
    products: bool = False
    terms: Terms = "none"
    joined: Joined = "constraints"
    partial: bool = False
    plain: RelaxationSpec | None = None
    memory: float = np.inf

    @property
    def tightened(self) -> RelaxationSpec:
        """The same relaxation on a box that linear programs have tightened."""
        share = self.share + HIERARCHY.tighter
        return replace(self, name=f"tightened {self.name}", share=share, plain=self)

    @property
    def whole(self) -> bool:
        """True for a full order on the usual cliques: no chordal terms, nothing left out."""
        usual = self.joined == "constraints" and self.terms != "chordal"
        return self.shape == "full" and usual and not self.lean and not self.partial

    def build(self, scaled: Scaled, cliques: Families) -> Relaxation:
        """Build the relaxation of a scaled problem for all its objectives."""
        return relax(
            scaled.problem,
            self.order,
            cliques=cliques[self.joined],
            objectives=scaled.objectives,
            lean=self.lean,
            products=self.products,
            shape=self.shape,
            terms=self.terms,
            partial=self.partial,
        )

    def seconds(self, scaled: Scaled, cliques: Families) -> float:
        """Estimate the seconds of a solve."""
        if self.shape == "full":
            where = cliques[self.joined]
            sizes = _full_sizes(self, scaled.problem, where)
            rows = sum(s * (s + 1) / 2 * k for s, k in sizes.items())
            apart = self._expected(sizes, rows)
            if self.terms == "chordal":
                return HIERARCHY.chordal_time * apart
            assert self.order is not None
            return min(apart, _seconds_by_fronts(sizes, rows, where, self.order))
        where = cliques[self.joined]
        if self.shape == "mixed":  # where memory would not do, it is not built to be priced
            least = mixed_sizes(scaled.problem, where, scaled.objectives)
            if self._expected(dict(least), 0.0) == np.inf:
                return float(np.inf)
        sizes, rows = shape_sizes(
            scaled.problem, self.shape, where, scaled.objectives, self.products
        )
        return self._expected(sizes, rows)

    def _expected(self, sizes: dict[int, float], rows: float) -> float:
        return expected_seconds(sizes, rows, self.memory)

    def fits(self, cliques: Families) -> bool:
        """Check that the relaxation is small enough to be built."""
        members = [len(clique) for clique in cliques[self.joined].members]
        if self.shape == "full" and self.order is not None:
            return comb(max(members, default=0) + self.order, self.order) <= HIERARCHY.most_basis
        if self.shape == "mixed":  # 1, the variables, and products that are not counted here
            sizes = Counter(1 + count for count in members)
            return bool(np.isfinite(self._expected(dict(sizes), 0.0)))
        return True


def _differ(one: Cliques, other: Cliques) -> bool:
    return one.members != other.members


@dataclass(eq=False)
class CostModel:
    """Measured seconds and progress of relaxations over one feasible set. Mutable.

    Parameters
    ----------
    seconds : dict of str to float
        Seconds by name.
    progress : dict of str to float
        Worth of the progress by name, between 0 and 1.
    pace : float
        Ratio of measured to estimated seconds.
    learned : list of (str, float, float, bool) or None
        What was recorded, for the same model in another process; None where none listens.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    progress: dict[str, float] = field(default_factory=dict)
    pace: float = 1.0
    learned: list[tuple[str, float, float, bool]] | None = None

    def learn(self, name: str, progress: float, seconds: float, goes_on: bool = False) -> None:
        """Record progress and seconds of a relaxation; older records fade.

        A closed gap counts more than progress: it saves the stronger relaxations. Where the work
        goes on from there, as that of a tree, progress counts in full. Less time than before counts
        at once, since what was analysed the first time is remembered.
        """
        if self.learned is not None:
            self.learned.append((name, progress, seconds, goes_on))
        worth = progress if goes_on else worth_of(progress)
        for table, value in ((self.progress, worth), (self.seconds, seconds)):
            table[name] = value if name not in table else 0.6 * table[name] + 0.4 * value
        self.seconds[name] = min(self.seconds[name], seconds)

    def closes(self, name: str) -> float:
        """Estimate the probability that a relaxation closes the gap, from its record."""
        worth = self.progress.get(name, HIERARCHY.prior)
        return max(0.0, worth + HIERARCHY.closed - 1.0) / HIERARCHY.closed

    def rate(self, spec: RelaxationSpec, share: float, seconds: float) -> float:
        """Estimate the worth of a relaxation per second.

        Parameters
        ----------
        spec : RelaxationSpec
        share : float
            Expected progress of the relaxations before it.
        seconds : float
            Its expected seconds.
        """
        progress = max(0.0, (spec.share - share) / (1.0 - share + 1e-9))
        worth = HIERARCHY.closed * progress**HIERARCHY.seldom + (1.0 - HIERARCHY.closed) * progress
        if spec.name in self.progress:
            worth = 0.3 * worth + 0.7 * self.progress[spec.name]
        return worth / max(1e-3, seconds)


def relaxation_specs(
    problem: Problem,
    cliques: Families,
    objectives: tuple[Polynomial, ...],
    first: int | None,
    skip: Sequence[str] = (),
) -> tuple[RelaxationSpec, ...]:
    """List the relaxations for a problem with a finite box, by growing expected progress.

    Parameters
    ----------
    problem : Problem
        Only its structure matters.
    cliques : dict
        Cliques for each way of joining variables.
    objectives : tuple of Polynomial
    first : int or None
        Relaxation order to start at; it leaves out everything below.
    skip : sequence of str
        Shapes, ways of joining and kinds of terms to leave out.

    Returns
    -------
    tuple of RelaxationSpec
    """
    specs = []
    if first is None or first == 1:
        specs = [r for source in SPECS for r in _offered(source, problem, cliques, objectives)]
        specs += _partial_orders(problem, objectives)
    specs += _orders(problem, cliques, least_order(problem, objectives), first or 1)
    if "components" in skip:
        specs = [replace(r, terms="none") if r.terms == "components" else r for r in specs]
    specs = [r for r in specs if not {r.shape, r.joined, r.terms} & set(skip)]
    fitting = [spec for spec in specs if spec.fits(cliques)]
    return tuple(sorted(fitting, key=lambda spec: spec.share))


def _below_orders(
    problem: Problem, cliques: Families, objectives: tuple[Polynomial, ...]
) -> list[RelaxationSpec]:
    """List the linear relaxation, and those between order 1 and order 2 for degree two."""
    products = Products.of(problem, objectives)
    star = problem.degree <= 2 and products.has_star  # far stronger at a similar price
    specs = [RelaxationSpec("linear", 0.1 if star else 0.25, "linear")]
    least = least_order(problem, objectives)
    if least > 1 and _differ(cliques["monomials"], cliques["constraints"]):
        name = f"order {least}, monomial cliques"
        specs.append(RelaxationSpec(name, 0.3, "full", least, True, True, joined="monomials"))
    if problem.degree > 2 or not products.pairs.size:
        return specs
    if products.has_star:
        specs.append(RelaxationSpec("star", 0.85, "star", products=True))
        specs.append(RelaxationSpec("split", 0.9, "split", products=True))
    single = len(objectives) < HIERARCHY.family
    if not products.has_star or (single and problem.dimension <= HIERARCHY.small_problem):
        mixed = RelaxationSpec("mixed", 0.8, "mixed", products=True)
        specs.append(mixed)  # cliques of partners are no smaller, and take long to find
        if mixed.fits(cliques) and _differ(cliques["partners"], cliques["constraints"]):
            name = "mixed, partner cliques"
            specs.append(RelaxationSpec(name, 0.83, "mixed", products=True, joined="partners"))
    return specs


class SpecSource(Protocol):
    """Offer relaxations of a registered shape to the adaptive search."""

    def __call__(
        self, problem: Problem, cliques: Families, objectives: tuple[Polynomial, ...]
    ) -> list[RelaxationSpec]:
        """Return the relaxations that suit the structure of a problem, perhaps none."""
        ...


SPECS: Registry[SpecSource] = Registry(
    "relaxations", {"below order 2": _below_orders}, ProblemError
)


def _offered(
    source: str, problem: Problem, cliques: Families, objectives: tuple[Polynomial, ...]
) -> list[RelaxationSpec]:
    """List what a source offers; what comes from outside is checked."""
    found = SPECS.ask(source, SPECS[source], problem, cliques, objectives)
    if SPECS.plugged(source):
        place = f"relaxations {source!r}"
        if not isinstance(found, (list, tuple)):
            kind = type(found).__name__
            raise ProblemError(f"{place}: found {kind}, expected a list of RelaxationSpec")
        for spec in found:
            _check_spec(spec, place)
    return list(found)


def _check_spec(spec: Any, place: str) -> None:
    """Check a relaxation that is offered from outside."""
    check_kind(spec, RelaxationSpec, place)
    shapes = ("full", *SHAPES)
    full = spec.shape == "full"
    order = isinstance(spec.order, int) and not isinstance(spec.order, bool) and spec.order > 0
    numbers = isinstance(spec.share, (int, float)) and isinstance(spec.memory, (int, float))
    checks = (
        ("name", isinstance(spec.name, str) and bool(spec.name), "a text"),
        ("share", numbers and 0.0 <= spec.share <= 1.0, "a number from 0 to 1"),
        ("plain", spec.plain is None or isinstance(spec.plain, RelaxationSpec), "a RelaxationSpec"),
        ("memory", numbers and spec.memory > 0.0, "a number > 0"),
        ("shape", spec.shape in shapes, f"one of {', '.join(shapes)}"),
        ("order", order if full else spec.order is None or order, "an integer > 0"),
        ("terms", spec.terms in get_args(Terms), f"one of {', '.join(get_args(Terms))}"),
        ("joined", spec.joined in get_args(Joined), f"one of {', '.join(get_args(Joined))}"),
    )
    for field_, good, expected in checks:
        if not good:
            found = getattr(spec, field_)
            raise ProblemError(f"{place}: found {field_}={found!r:.60}, expected {expected}")


def _partial_orders(problem: Problem, objectives: tuple[Polynomial, ...]) -> list[RelaxationSpec]:
    """List the orders that carry the objectives and not all constraints.

    Constraints of high degree often do not bind, and the orders that they ask for are large.
    """
    orders = range(objective_order(problem, objectives), least_order(problem, objectives))
    return [
        RelaxationSpec(
            f"order {order}, constraints of degree {2 * order} at most",
            0.3 + 0.01 * order,
            "full",
            order,
            products=True,
            terms="components" if order > 1 else "none",
            partial=True,
        )
        for order in orders
    ]


def _orders(problem: Problem, cliques: Families, least: int, first: int) -> list[RelaxationSpec]:
    """List full orders, lean and with small blocks from terms before whole ones."""
    largest = max((len(c) for c in cliques["constraints"].members), default=0)
    specs: list[RelaxationSpec] = []
    start = max(first, least)
    for order in range(start, start + HIERARCHY.more_orders + 1):
        above = order - least
        share = 1.0 - (0.3 if problem.degree > 2 else 0.65) * 0.25**above
        plain = RelaxationSpec(f"order {order}", share, "full", order, False, True)
        if order > 1:  # small blocks lose nothing that signs do not lose
            plain = replace(plain, terms="components")
        specs += [
            replace(plain, name=f"order {order} lean", share=0.97 * share, lean=True),
            plain,
        ]
        if order > 1 and comb(largest + order, order) > HIERARCHY.worth_splitting:
            name = f"order {order}, chordal terms"
            specs.append(replace(plain, name=name, share=0.95 * share, terms="chordal"))
    return specs


def expected_seconds(sizes: dict[int, float], rows: float, memory: float = np.inf) -> float:
    """Estimate the seconds of a solve, +inf where the memory would not do.

    Parameters
    ----------
    sizes : dict
        Number of semidefinite blocks of each size (1: linear rows).
    rows : float
        Number of conic rows.
    memory : float
        Bytes that a solver may take.

    Returns
    -------
    float
    """
    entries = np.array([s * (s + 1) / 2.0 for s in sizes])
    counts = np.array(list(sizes.values()), float)
    if np.sum(12.0 * counts * entries**2) > memory:
        return np.inf
    if entries.size == 0 or entries.max() <= 1:
        return 2e-3 + 1.5e-6 * rows**1.4
    step = float(np.sum(counts * 1.2e-7 * entries**2 / (1.0 + entries / 600.0)))
    return HIERARCHY.iterations * (step + 1e-6 * rows)


def _seconds_by_fronts(sizes: dict[int, float], rows: float, cliques: Cliques, order: int) -> float:
    """Estimate the seconds of a solve along the clique tree, +inf for one clique.

    A clique with m moments, of which its parent does not have k, takes about m^2 k
    multiplications a step. Where cliques overlap much, that is far less than blocks take apart.
    """
    if len(cliques.members) == 1:
        return float(np.inf)
    step = 1e-6 * rows
    step += sum(1e-9 * count * (side * (side + 1) / 2) ** 2 for side, count in sizes.items())
    for members, parent in zip(cliques.members, cliques.tree.tolist(), strict=True):
        shared = set(members).intersection(cliques.members[parent]) if parent >= 0 else ()
        own, known = (comb(len(v) + 2 * order, 2 * order) for v in (members, shared))
        step += 3e-11 * float(own) ** 2 * (own - known + 1)
    return HIERARCHY.iterations * step


def worth_of(progress: float) -> float:
    """Weigh progress by what follows: a closed gap counts more, it saves stronger relaxations."""
    return HIERARCHY.closed * float(progress >= 1.0) + (1.0 - HIERARCHY.closed) * progress


def progress(before: float, after: float, allowed: float) -> float:
    """Measure progress on a logarithmic scale: 0 without, 1 for a closed gap.

    Parameters
    ----------
    before, after : float
        Gap before and after a step.
    allowed : float
        The gap that counts as closed.
    """
    allowed = max(allowed, 1e-300)
    if not np.isfinite(after):
        return 0.0
    if not np.isfinite(before):
        return 0.5
    whole = np.log(max(before / allowed, 1.0 + 1e-9))
    return float(np.clip(np.log(max(before, allowed) / after) / whole, 0.0, 1.0))


def hashed(relaxation: Relaxation, box: Interval) -> bytes:
    """Hash a relaxation on a box: equal for equal relaxations, in any process.

    Chordal terms, for instance, need not make a relaxation smaller.
    """
    rows = relaxation.entries
    found = blake2b(digest_size=16)
    for array in (box.lo, box.hi, relaxation.moments, rows.indptr, rows.indices, rows.data):
        found.update(array.tobytes())
    return found.digest()


def _full_sizes(spec: RelaxationSpec, problem: Problem, cliques: Cliques) -> dict[int, float]:
    """Count the block sizes of a full shape without building it."""
    assert spec.order is not None
    order = spec.order
    members = np.array([len(c) for c in cliques.members], int)
    sizes: dict[int, float] = {}

    def add(clique: int, degree: int, count: float = 1.0, side: int = 1) -> None:
        size = comb(clique + degree, degree) * side
        sizes[size] = sizes.get(size, 0.0) + count

    for clique in members.tolist():
        add(clique, order)
        if not spec.lean:
            add(clique, order - 1, clique)
    for number, constraint in enumerate(problem.constraints):
        if not problem.equality[number] and (not spec.partial or constraint.degree <= 2 * order):
            half, side = (constraint.degree + 1) // 2, max(constraint.side, 1)
            home = int(members[max(int(cliques.home[number]), 0)])
            add(home, max(order - half, 0), side=side)
    return sizes
