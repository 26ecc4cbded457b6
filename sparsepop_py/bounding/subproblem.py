"""Problems with fewer constraints, and their certificates restated for the whole problem.

Constraints that are left out only enlarge the feasible set, so a lower bound of the smaller
problem is one of the whole. In a certificate everything goes by number: variables, constraints
and generators get the numbers of the whole problem, and variables that the smaller problem lacks
get the ranges of a box. Nothing proved rests on that: verification recomputes a restated
certificate from the whole problem, and propagation over more constraints gives smaller boxes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.multipliers import Multipliers
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Step, Tightening

__all__ = ["Subproblem"]


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
        letter = np.zeros(whole.dimension + 1, np.int32)
        letter[variables + 1] = np.arange(1, variables.size + 1)

        def fewer(p: Polynomial) -> Polynomial:
            words = letter[p.words]
            return Polynomial.from_words(words, p.coefficients, variables.size, names)

        constraints = [Constraint(fewer(c.polynomial), c.kind) for c in given]
        bounds = whole.lower[variables], whole.upper[variables]
        problem = Problem(fewer(whole.objective), constraints, *bounds, names)
        return Subproblem(whole, rows, variables, problem)

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

    # ---- certificates -------------------------------------------------------------------------

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
        outside = Scaling.of_box(box)
        made: dict[int, Node] = {}
        for node in reversed(list(certificate.root)):  # children come behind their parents
            children = tuple(made[id(child)] for child in node.children)
            made[id(node)] = self._node(node, children, outside)
        root = made[id(certificate.root)]
        root = replace(root, box=BoxProof((*steps, *root.box.steps)))
        return replace(
            certificate, fingerprint=self.whole.fingerprint, root=root, problem=self.whole
        )

    def restated_steps(self, steps: Iterable[Step], box: Interval) -> tuple[Step, ...]:
        """Restate steps for the whole problem; those that need another box are left out.

        Parameters
        ----------
        steps : iterable of Step
        box : Interval
            The box of the whole problem.
        """
        return self._steps(steps, Scaling.of_box(box))

    def _node(self, node: Node, children: tuple[Node, ...], outside: Scaling) -> Node:
        branch = node.branch and (int(self.variables[node.branch[0]]), node.branch[1])
        argument = self._argument(node.argument, outside, 0)
        proof = BoxProof(self._steps(node.box.steps, outside))
        return Node(proof, argument, node.empty, branch, children)

    def _steps(self, steps: Iterable[Step], outside: Scaling) -> tuple[Step, ...]:
        restated = (self._step(step, outside) for step in steps)
        return tuple(step for step in restated if step is not None)

    def _step(self, step: Step, outside: Scaling) -> Step | None:
        """Restate a step; None, which proves nothing, for kinds that need another box."""
        if isinstance(step, Propagation):
            return step
        if not isinstance(step, Tightening):
            return None
        argument = self._argument(step.argument, outside, int(step.uses_cutoff))
        if argument is None:
            return None
        return replace(step, variable=self.variables[step.variable], argument=argument)

    def _argument(
        self, argument: Argument | None, outside: Scaling, cutoffs: int
    ) -> Identity | LinearDual | None:
        """Restate multipliers; ``cutoffs`` rows stand behind the constraints."""
        if not isinstance(argument, (Identity, LinearDual)):
            return None
        number = self._numbers[cutoffs]
        single = generators.count(len(self.whole.constraints) + cutoffs, self.whole.dimension)
        products = number_of(argument.products, number, single)
        scaling = self._scaling(argument.scaling, outside)
        if isinstance(argument, LinearDual):
            return replace(
                argument,
                scaling=scaling,
                generator=number_of(argument.generator, number, single),
                word=self._words(argument.word),
                products=products,
            )
        groups = tuple(self._multipliers(g, number, single) for g in argument.multipliers)
        priced = argument.priced
        if priced is not None:
            priced = replace(priced, words=self._words(priced.words))
        return Identity(scaling, groups, products, priced)

    def _multipliers(
        self, group: Multipliers, number: NDArray[np.int64], single: int
    ) -> Multipliers:
        generator = number_of(group.generator, number, single)
        return replace(group, generator=generator, basis=self._words(group.basis))

    @cached_property
    def _numbers(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Generators of the whole problem by those of the smaller, without and with a cutoff."""
        found = []
        for cutoffs in (0, 1):
            sizes = self.rows.size + cutoffs, len(self.whole.constraints) + cutoffs
            number = np.zeros(generators.count(sizes[0], self.variables.size), np.int64)
            number[1 : self.rows.size + 1] = self.rows + 1
            number[self.rows.size + 1 : sizes[0] + 1] = sizes[1]
            ours = generators.bound_family(sizes[0], self.variables.size)
            theirs = generators.bound_family(sizes[1], self.whole.dimension)
            for own, other in zip(ours, theirs, strict=True):
                number[own] = other.start + self.variables
            found.append(number)
        return found[0], found[1]

    def _words(self, words: Words) -> Words:
        letter = np.append(0, self.variables + 1).astype(words.dtype)
        return letter[words]

    def _scaling(self, scaling: Scaling, outside: Scaling) -> Scaling:
        """Put the ranges of the variables left out around those of the variables kept."""

        def joined(rest: NDArray[Any], own: NDArray[Any]) -> NDArray[Any]:
            found = rest.copy()
            found[self.variables] = own
            return found

        ends = None
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


def number_of(
    numbers: NDArray[np.integer], single: NDArray[np.int64], start: int
) -> NDArray[np.int64]:
    """Renumber generators: those without factors by a table, products from ``start`` on."""
    product = numbers >= single.size
    known = single[np.where(product, 0, numbers)]
    found: NDArray[np.int64] = np.where(product, numbers - single.size + start, known)
    return found
