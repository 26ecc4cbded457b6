"""Which relaxations a problem admits, what each may cost, and how far it gets as a rule.

Progress from a gap g to the gap t that counts as closed is measured on a logarithmic
scale: 0 at g, 1 at t. The progress that a relaxation is expected to make is first a rule
of thumb from pooling, bilinear, polynomial and identification problems, then what it made
on the objectives before; both only decide what is tried first. Seconds of an
interior-point solve are estimated from the r = s (s + 1) / 2 entries of each block, those
of a linear program from its rows, until they have been measured.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import comb
from typing import Protocol

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem
from sparsepop_py.registry import Registry
from sparsepop_py.relaxation.moment import Relaxation, least_order, relax
from sparsepop_py.relaxation.shapes import Products
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
    "families",
    "hashed",
    "progress",
    "relaxation_specs",
]

Families = dict[Joined, Cliques]

_CLOSED = 0.9  # what closing a gap is worth, against coming near it
_TIGHTER = 0.02  # share that a tightened box adds
_SELDOM = 4  # a rung that makes a share s of the progress closes the gap about s**4 of the time
_HOPE = 0.77  # ... of a rung that was not tried yet: it closes two gaps of three
_ITERATIONS = 25
_MOST_BASIS = 1500  # monomials of one clique
_WORTH_CUTTING = 30  # monomials of a clique from which chordal term sparsity is tried
_CHORDAL = 0.1  # time with blocks from chordal terms, as a rule
_SMALL = 60  # variables up to which whole cliques are tried where stars would do
_ORDERS = 3  # orders beyond the least


@dataclass(frozen=True)
class RelaxationSpec:
    """One kind of relaxation.

    Parameters
    ----------
    name : str
    share : float
        Progress towards a closed gap after it, as a rule.
    shape : {"full", "linear", "mixed", "star", "split"}
    order : int or None
        Relaxation order of the full shape.
    lean, products : bool
    terms : {"none", "components", "chordal"}
        As in :func:`sparsepop_py.relax`.
    joined : {"constraints", "monomials", "partners"}
        As in :func:`sparsepop_py.find_cliques`.
    plain : RelaxationSpec or None
        Linear programs with the cut-off tighten the box before this one is solved on it.
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
    plain: RelaxationSpec | None = None
    memory: float = np.inf

    @property
    def tightened(self) -> RelaxationSpec:
        """The same relaxation on a box that linear programs have tightened."""
        return replace(self, name=f"tightened {self.name}", share=self.share + _TIGHTER, plain=self)

    def build(self, scaled: Scaled, cliques: Families) -> Relaxation:
        """The relaxation of a scaled problem that carries all its objectives."""
        return relax(
            scaled.problem,
            self.order,
            cliques=cliques[self.joined],
            objectives=scaled.objectives,
            lean=self.lean,
            products=self.products,
            shape=self.shape,
            terms=self.terms,
        )

    def seconds(self, scaled: Scaled, cliques: Families) -> float:
        """About how long it takes to solve."""
        if self.shape == "full":
            sizes = _full_sizes(self, scaled.problem, cliques[self.joined])
            rows = sum(s * (s + 1) / 2 * k for s, k in sizes.items())
            return (_CHORDAL if self.terms == "chordal" else 1.0) * self._expected(sizes, rows)
        relaxation = self.build(scaled, cliques)
        return self._expected(dict(relaxation.block_sizes), relaxation.rows)

    def _expected(self, sizes: dict[int, float], rows: float) -> float:
        return expected_seconds(sizes, rows, self.memory)

    def fits(self, cliques: Families) -> bool:
        """Whether the relaxation is small enough to be built at all."""
        members = [len(clique) for clique in cliques[self.joined].members]
        if self.shape == "full" and self.order is not None:
            return comb(max(members, default=0) + self.order, self.order) <= _MOST_BASIS
        if self.shape == "mixed":  # 1, the variables, and products that are not counted here
            sizes = Counter(1 + count for count in members)
            return bool(np.isfinite(self._expected(dict(sizes), 0.0)))
        return True


def families(
    problem: Problem, objectives: Sequence[Polynomial], sparse: bool, method: Method
) -> Families:
    """Cliques for each way of joining variables; the same ones where nothing is sparse."""
    usual = find_cliques(problem, sparse, method, objectives)
    found: Families = {"constraints": usual, "monomials": usual, "partners": usual}
    if sparse and problem.constraints:
        for joined in ("monomials", "partners"):
            found[joined] = find_cliques(problem, sparse, method, objectives, joined)
    return found


def _differ(one: Cliques, other: Cliques) -> bool:
    return one.members != other.members


@dataclass(eq=False)
class CostModel:
    """What the rungs were seen to do, shared by all objectives over one feasible set."""

    seconds: dict[str, float] = field(default_factory=dict)
    progress: dict[str, float] = field(default_factory=dict)
    pace: float = 1.0

    def learn(self, name: str, progress: float, seconds: float) -> None:
        """Enter what one rung did; older experience fades.

        A gap that is closed counts more than progress: it saves the rungs above. Less time
        than before counts at once, since what was analysed the first time is remembered.
        """
        worth = _CLOSED * (progress >= 1.0) + (1.0 - _CLOSED) * progress
        for table, value in ((self.progress, worth), (self.seconds, seconds)):
            table[name] = value if name not in table else 0.6 * table[name] + 0.4 * value
        self.seconds[name] = min(self.seconds[name], seconds)

    def closes(self, name: str) -> float:
        """How likely a rung is to close the gap, from what it did so far."""
        worth = self.progress.get(name, _HOPE)
        return max(0.0, worth + _CLOSED - 1.0) / _CLOSED

    def rate(self, spec: RelaxationSpec, share: float, seconds: float) -> float:
        """What a rung is expected to be worth in a second, after rungs of that share."""
        progress = max(0.0, (spec.share - share) / (1.0 - share + 1e-9))
        worth = _CLOSED * progress**_SELDOM + (1.0 - _CLOSED) * progress
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
    """The rungs of the ladder for a problem with a finite box, by growing share.

    Parameters
    ----------
    problem : Problem
        Only its structure is looked at.
    cliques : dict
        A family of cliques for each way of joining variables.
    objectives : tuple of Polynomial
    first : int or None
        Relaxation order to start at; it leaves out everything below.
    skip : sequence of str
        Shapes, ways of joining and kinds of terms to leave out.
    """
    specs = []
    if first is None or first == 1:
        specs = [r for source in SPECS for r in SPECS[source](problem, cliques, objectives)]
    specs += _orders(problem, cliques, least_order(problem, objectives), first or 1)
    if "components" in skip:
        specs = [replace(r, terms="none") if r.terms == "components" else r for r in specs]
    specs = [r for r in specs if not {r.shape, r.joined, r.terms} & set(skip)]
    fitting = [spec for spec in specs if spec.fits(cliques)]
    return tuple(sorted(fitting, key=lambda rung: rung.share))


def _below_orders(
    problem: Problem, cliques: Families, objectives: tuple[Polynomial, ...]
) -> list[RelaxationSpec]:
    """The linear relaxation, and what lies between order 1 and order 2 for degree two."""
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
    if not products.has_star or problem.dimension <= _SMALL:
        specs.append(RelaxationSpec("mixed", 0.8, "mixed", products=True))
        if _differ(cliques["partners"], cliques["constraints"]):
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


def _orders(problem: Problem, cliques: Families, least: int, first: int) -> list[RelaxationSpec]:
    """Full orders, lean and with small blocks from terms before whole ones."""
    largest = max((len(c) for c in cliques["constraints"].members), default=0)
    specs: list[RelaxationSpec] = []
    start = max(first, least)
    for order in range(start, start + _ORDERS + 1):
        above = order - least
        share = 1.0 - (0.3 if problem.degree > 2 else 0.65) * 0.25**above
        plain = RelaxationSpec(f"order {order}", share, "full", order, False, True)
        if order > 1:  # small blocks lose nothing that signs do not lose
            plain = replace(plain, terms="components")
        specs += [
            replace(plain, name=f"order {order} lean", share=0.97 * share, lean=True),
            plain,
        ]
        if order > 1 and comb(largest + order, order) > _WORTH_CUTTING:
            name = f"order {order}, chordal terms"
            specs.append(replace(plain, name=name, share=0.95 * share, terms="chordal"))
    return specs


def expected_seconds(sizes: dict[int, float], rows: float, memory: float = np.inf) -> float:
    """About how long a solve takes, +inf where the memory would not do.

    Parameters
    ----------
    sizes : dict
        How many semidefinite blocks there are of each size (1: linear rows).
    rows : float
        Number of conic rows.
    memory : float
        Bytes that a solver may take.
    """
    entries = np.array([s * (s + 1) / 2.0 for s in sizes])
    counts = np.array(list(sizes.values()), float)
    if np.sum(12.0 * counts * entries**2) > memory:
        return np.inf
    if entries.size == 0 or entries.max() <= 1:
        return 2e-3 + 1.5e-6 * rows**1.4
    step = float(np.sum(counts * 1.2e-7 * entries**2 / (1.0 + entries / 600.0)))
    return _ITERATIONS * (step + 1e-6 * rows)


def progress(before: float, after: float, allowed: float) -> float:
    """From the gap before (0) to the gap that counts as closed (1), on a logarithmic scale."""
    allowed = max(allowed, 1e-300)
    if not np.isfinite(after):
        return 0.0
    if not np.isfinite(before):
        return 0.5
    whole = np.log(max(before / allowed, 1.0 + 1e-9))
    return float(np.clip(np.log(max(before, allowed) / after) / whole, 0.0, 1.0))


def hashed(relaxation: Relaxation, box: Interval) -> int:
    """Equal for equal relaxations on one box: chordal terms, say, need not make one smaller."""
    rows = relaxation.entries
    arrays = (box.lo, box.hi, relaxation.moments, rows.indptr, rows.indices, rows.data)
    return hash(tuple(array.tobytes() for array in arrays))


def _full_sizes(spec: RelaxationSpec, problem: Problem, cliques: Cliques) -> dict[int, float]:
    """Block sizes of a full shape, counted without building it."""
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
        if not problem.equality[number]:
            half, side = (constraint.degree + 1) // 2, max(constraint.side, 1)
            home = int(members[max(int(cliques.home[number]), 0)])
            add(home, max(order - half, 0), side=side)
    return sizes
