"""Problems with fewer constraints, and their certificates restated for the whole problem.

Constraints that are left out only enlarge the feasible set, so a lower bound of the smaller
problem is one of the whole. In a certificate everything goes by number: variables, constraints
and generators get the numbers of the whole problem, and variables that the smaller problem lacks
get the ranges of a box. Nothing proved rests on that: verification recomputes a restated
certificate from the whole problem, and propagation over more constraints gives smaller boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Constraint, Polynomial
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_cache import interned
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Argument, Certificate, Node
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Known,
    Propagation,
    Replay,
    Step,
    Tightening,
)

__all__ = ["Restatement", "Subproblem"]


@dataclass(frozen=True, eq=False)
class Subproblem:
    """Some constraints of a problem, in the variables that occur in them.

    Parameters
    ----------
    whole : Problem
    rows : (k,) int
        The constraints that are kept, in order.
    variables : (v,) int
        The variables that are kept, in order: all that occur in the objective and the constraints.
    problem : Problem
        The smaller problem.

    Examples
    --------
    >>> import numpy as np
    >>> import sparsepop_py as sp
    >>> from sparsepop_py.bounding.subproblem import Subproblem
    >>> x, y, z = sp.variables(3)
    >>> whole = sp.Problem(x, [x * z >= 1, y <= x], lower=0, upper=2)
    >>> small = Subproblem.of(whole, np.array([0]))
    >>> small.variables.tolist(), sp.solve(small.problem).lower_bound > 0.49
    ([0, 2], True)
    """

    whole: Problem
    rows: NDArray[np.int64]
    variables: NDArray[np.int64]
    problem: Problem

    @staticmethod
    def of(
        whole: Problem, rows: NDArray[np.int64], kept: NDArray[np.int64] | None = None
    ) -> Subproblem:
        """Keep some constraints, and variables beside those that occur.

        Parameters
        ----------
        whole : Problem
            Without squares or matrices that are to be kept.
        rows : (k,) int
        kept : (v,) int, optional
            Variables that are kept in any case.

        Returns
        -------
        Subproblem
        """
        given = [whole.constraints[row] for row in rows]
        words = [whole.objective.words, *(c.polynomial.words for c in given)]
        letters = [monomials.distinct(w) for w in words] + ([] if kept is None else [kept + 1])
        found = monomials.distinct(np.concatenate(letters))
        variables = (found[found > 0] - 1).astype(np.int64)
        names = tuple(whole.names[v] for v in variables)
        constraints = [Constraint(_in(variables, c.polynomial, names), c.kind) for c in given]
        bounds = whole.lower[variables], whole.upper[variables]
        objective = _in(variables, whole.objective, names)
        return Subproblem(whole, rows, variables, Problem(objective, constraints, *bounds, names))

    def fewer(self, polynomial: Polynomial) -> Polynomial:
        """State a polynomial in variables that are kept in these alone."""
        return _in(self.variables, polynomial, self.problem.names)

    def places(self, variables: Sequence[int]) -> list[int]:
        """Number those of some variables that are kept, in their order here."""
        kept = np.flatnonzero(np.isin(self.variables, np.array(variables, np.int64)))
        return kept.tolist()

    def box(self, box: Interval) -> Interval:
        """Restrict a box of the whole problem to the variables kept."""
        return Interval(box.lo[self.variables], box.hi[self.variables])

    def point(self, x: NDArray[np.float64], rest: NDArray[np.float64]) -> NDArray[np.float64]:
        """Put a vector (v,) into one of the whole problem, (n,)."""
        found = rest.copy()
        found[self.variables] = x
        return found

    def within(self, larger: Subproblem) -> Subproblem:
        """State this problem as one of a larger problem of the same whole.

        Parameters
        ----------
        larger : Subproblem
            It has all constraints and variables of this one.

        Returns
        -------
        Subproblem
            Its whole is the problem of the larger one.
        """
        rows = np.searchsorted(larger.rows, self.rows)
        variables = np.searchsorted(larger.variables, self.variables)
        return Subproblem(larger.problem, rows, variables, self.problem)

    def restated(
        self, certificate: Certificate, steps: tuple[Step, ...], box: Interval
    ) -> Certificate:
        """Restate a certificate of the smaller problem for the whole one.

        Parameters
        ----------
        certificate : Certificate
            Of the smaller problem, on a box within its bounds.
        steps : tuple
            Steps that prove this box for the whole problem.
        box : Interval
            The box of the whole problem.

        Returns
        -------
        Certificate
            Its claim is the old one, which verification may lower.
        """
        return Restatement(self, steps, box).certificate(certificate, self.whole)

    def restated_steps(self, steps: Iterable[Step], box: Interval) -> tuple[Step, ...]:
        """Restate steps for the whole problem; those that need another box are left out.

        Parameters
        ----------
        steps : iterable of Step
        box : Interval
            The box of the whole problem.
        """
        return Restatement(self, (), box).steps(steps)


@dataclass(frozen=True, eq=False)
class Restatement:
    """Certificates of a smaller problem, restated for the whole one. Remembers steps.

    What several certificates share is restated once, so that it is verified once.

    Parameters
    ----------
    small : Subproblem
    first : tuple of Step
        They prove the box for the whole problem.
    box : Interval
        The box of the whole problem.
    """

    small: Subproblem
    first: tuple[Step, ...]
    box: Interval
    _known: dict[int, tuple[object, Any]] = field(default_factory=dict)

    def certificate(self, certificate: Certificate, whole: Problem) -> Certificate:
        """Restate a certificate for the whole problem with its objective.

        Parameters
        ----------
        certificate : Certificate
        whole : Problem
        """
        made: dict[int, Node] = {}
        for node in reversed(list(certificate.root)):  # children come behind their parents
            children = tuple(made[id(child)] for child in node.children)
            made[id(node)] = self._node(node, children)
        root = made[id(certificate.root)]
        root = replace(root, box=BoxProof((*self.first, *root.box.steps)))
        return replace(certificate, fingerprint=whole.fingerprint, root=root, problem=whole)

    def steps(self, steps: Iterable[Step]) -> tuple[Step, ...]:
        """Restate steps; those that need another box are left out.

        Parameters
        ----------
        steps : iterable of Step
        """
        restated = (self._once(step, self._step) for step in steps)
        return tuple(step for step in restated if step is not None)

    def _once(self, given: Any, make: Callable[[Any], Any]) -> Any:
        if id(given) not in self._known:
            self._known[id(given)] = given, make(given)
        return self._known[id(given)][1]

    @cached_property
    def _outside(self) -> Scaling:
        return Scaling.of_box(self.box)

    def _node(self, node: Node, children: tuple[Node, ...]) -> Node:
        branch = node.branch and (int(self.small.variables[node.branch[0]]), node.branch[1])
        argument = self._argument(node.argument, 0)
        return Node(BoxProof(self.steps(node.box.steps)), argument, node.empty, branch, children)

    def _step(self, step: Step) -> Step | None:
        """Restate a step; None, which proves nothing, for kinds that need another box."""
        if isinstance(step, Propagation):
            return step
        if isinstance(step, Known):
            return Known(tuple(self._quoted(*bound) for bound in step.bounds))
        if not isinstance(step, Tightening):
            return None
        argument = self._argument(step.argument, int(step.uses_cutoff))
        if argument is None or isinstance(argument, ExactGram):
            return None
        return replace(step, variable=self.small.variables[step.variable], argument=argument)

    def _quoted(self, variable: int, side: int, proof: Any) -> tuple[int, int, Any]:
        """Restate the certificate of another objective, side * x_v."""
        place = int(self.small.variables[variable])
        about = Replay(self.small.whole, None).about(place, side)
        return place, side, self._once(proof, lambda given: self.certificate(given, about))

    def _argument(self, argument: Argument | None, cutoffs: int) -> Argument | None:
        """Restate multipliers; ``cutoffs`` rows stand behind the constraints."""
        if isinstance(argument, ExactDual):
            return self._exact(argument, cutoffs)
        if isinstance(argument, ExactGram):
            return replace(argument, basis=self._words(argument.basis))
        if argument is None:
            return None
        number = self._numbers[cutoffs]
        whole = self.small.whole
        single = generators.count(len(whole.constraints) + cutoffs, whole.dimension)
        products = _renumbered(argument.products, number, single)
        scaling = self._scaling(argument.scaling)
        if isinstance(argument, LinearDual):
            return replace(
                argument,
                scaling=scaling,
                generator=_renumbered(argument.generator, number, single),
                word=self._words(argument.word),
                products=products,
            )
        groups = tuple(self._multipliers(g, number, single) for g in argument.multipliers)
        priced = argument.priced
        if priced is not None:
            priced = replace(priced, words=self._words(priced.words))
        return Identity(scaling, groups, products, priced)

    def _exact(self, dual: ExactDual, cutoffs: int) -> ExactDual:
        """Restate rational multipliers: constraints, a cutoff, lower and upper bounds."""
        whole = self.small.whole
        m = len(whole.constraints) + cutoffs
        ends = (m + side * whole.dimension + self.small.variables for side in (0, 1))
        cutoff = np.arange(m - cutoffs, m)
        numbers = np.concatenate([self.small.rows, cutoff, *ends])
        free = np.full(whole.dimension, np.inf)
        gram = None if dual.gram is None else replace(dual.gram, basis=self._words(dual.gram.basis))
        return ExactDual(
            self.small.point(dual.lower, -free),
            self.small.point(dual.upper, free),
            numbers[dual.row],
            self._words(dual.word),
            dual.value,
            gram,
        )

    def _multipliers(
        self, group: Multipliers, number: NDArray[np.int64], single: int
    ) -> Multipliers:
        generator = _renumbered(group.generator, number, single)
        return replace(group, generator=generator, basis=self._words(group.basis))

    @cached_property
    def _numbers(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Generators of the whole problem by those of the smaller, without and with a cutoff."""
        small, found = self.small, []
        for cutoffs in (0, 1):
            sizes = small.rows.size + cutoffs, len(small.whole.constraints) + cutoffs
            number = np.zeros(generators.count(sizes[0], small.variables.size), np.int64)
            number[1 : small.rows.size + 1] = small.rows + 1
            number[small.rows.size + 1 : sizes[0] + 1] = sizes[1]
            ours = generators.bound_family(sizes[0], small.variables.size)
            theirs = generators.bound_family(sizes[1], small.whole.dimension)
            for own, other in zip(ours, theirs, strict=True):
                number[own] = other.start + small.variables
            found.append(number)
        return found[0], found[1]

    def _words(self, words: Words) -> Words:
        letter = np.append(0, self.small.variables + 1).astype(words.dtype)
        return letter[words]

    def _scaling(self, scaling: Scaling) -> Scaling:
        """Put the ranges of the variables left out around those of the variables kept."""

        def joined(rest: NDArray[Any], own: NDArray[Any]) -> NDArray[Any]:
            found = rest.copy()
            found[self.small.variables] = own
            return found

        outside, ends = self._outside, None
        if scaling.ends is not None:
            pairs = zip(outside.bounds, scaling.ends, strict=True)
            ends = tuple(joined(rest, own) for rest, own in pairs)
        return Scaling(
            joined(outside.centre, scaling.centre),
            joined(outside.scale, scaling.scale),
            interned(joined(outside.boxed, scaling.boxed)),
            interned(joined(outside.side, scaling.side)),
            None if ends is None else (ends[0], ends[1]),
        )


def _in(variables: NDArray[np.int64], p: Polynomial, names: Sequence[str]) -> Polynomial:
    """State a polynomial in some variables, numbered anew."""
    letter = np.zeros(p.dimension + 1, np.int32)
    letter[variables + 1] = np.arange(1, variables.size + 1)
    return Polynomial.from_words(letter[p.words], p.coefficients, variables.size, tuple(names))


def _renumbered(
    numbers: NDArray[np.integer], single: NDArray[np.int64], start: int
) -> NDArray[np.int64]:
    """Renumber generators: those without factors by a table, products from ``start`` on."""
    product = numbers >= single.size
    known = single[np.where(product, 0, numbers)]
    found: NDArray[np.int64] = np.where(product, numbers - single.size + start, known)
    return found
