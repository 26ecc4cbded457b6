"""Exact bounds of linear and convex quadratic objectives over unbounded polyhedra.

Without finite bounds there is no box that pays for rounding. HiGHS proposes multipliers of the
rows; they are moved in rationals onto the equations that make the gradient of the Lagrangian
vanish somewhere, so that all that multiplies a variable without bounds cancels
(:class:`~sparsepop_py.verified.certificate.exact_dual.ExactDual`). Where there is no bound, a
direction along which the objective falls without limit is sought.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from math import lcm

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.bounding.exact_linear import linear_bounds
from sparsepop_py.bounding.order_bound import CertifiedBound, Model, certified_bound
from sparsepop_py.bounding.relaxation_bound import BoxBound
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.budget import Deadline, LimitReached, check
from sparsepop_py.context import SolveContext
from sparsepop_py.lp.rational_projection import Row, near_fraction, projected
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import Status
from sparsepop_py.solvers.interface import SolverSettings
from sparsepop_py.solvers.quadratic import QuadraticSolution, solve_convex_qp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Node, prove
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.polyhedron import Polyhedron
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.steps import BoxProof

__all__ = ["exact_convex_bound", "falling_direction", "has_linear_rows"]

_DEFINITE = 1e-8  # least eigenvalue with a diagonal of 1; less may be rounding
_SYMMETRIC = {"SymmetricMode": True}
_SHARE = 0.7  # of the time left that exact proofs take at most: relaxations may prove more
_TRIES = 4  # times that multipliers with the wrong sign are left out


def has_linear_rows(problem: Problem) -> bool:
    """Check for linear constraints and an objective of degree 1 or 2."""
    rows = all(
        c.kind in (Kind.NONNEGATIVE, Kind.ZERO) and c.polynomial.degree <= 1
        for c in problem.constraints
    )
    size = (len(problem.constraints) + 1) * problem.dimension
    return rows and 1 <= problem.objective.degree <= 2 and size <= BOUNDING.linear_entries


def exact_convex_bound(
    context: SolveContext,
) -> tuple[CertifiedBound, list[NDArray[np.float64]]] | None:
    """Bound a linear or convex quadratic objective over a polyhedron by exact multipliers.

    Parameters
    ----------
    context : SolveContext

    Returns
    -------
    bound : CertifiedBound
    starts : list of (n,) float
        Points to start local searches from.
        None in place of both where the problem is of another kind.
    """
    problem = context.problem
    if not has_linear_rows(problem):
        return None
    program = _Program.of(problem)
    if not program.convex():
        return None
    with context.stages.stage("solve"):
        settings = SolverSettings(context.deadline.left, BOUNDING.convex_accuracy)
        found = solve_convex_qp(program.rows, program.cost, program.hessian, settings)
        if found.status == "unbounded":  # the point of least norm, to start a ray from
            unit = sps.eye_array(program.cost.size, format="csc")
            nearest = solve_convex_qp(program.rows, 0.0 * program.cost, unit, settings)
    model = Model(BoxProof(), Interval(problem.lower, problem.upper))
    replay = context.at_cutoff()
    best = BoxBound(prove(replay, model.box, None, False), Node())
    solved = found.status in ("solved", "almost")
    with context.stages.stage("certify"), _within(context.deadline.part(_SHARE)):
        duals = program.duals(problem, found) if solved else iter(())
        for dual, empty in chain(duals, program.by_pivots(problem)):
            proved = prove(replay, model.box, dual, empty)
            if proved.bound > best.proved.bound:
                best = BoxBound(proved, Node(argument=dual, empty=empty))
                break
    starts = [found.x] if solved else [nearest.x] if found.status == "unbounded" else []
    return certified_bound(replay, model, best), starts


@contextmanager
def _within(part: Deadline) -> Iterator[None]:
    """End the body after a part of the time; no exception while time is left."""
    try:
        with part.kept(0.0):
            yield
    except LimitReached:
        check()


@dataclass(frozen=True, eq=False)
class _Program:
    """Minimise cost'x + x' hessian x / 2 over a polyhedron."""

    rows: Polyhedron
    cost: NDArray[np.float64]
    hessian: sps.csc_array

    @staticmethod
    def of(problem: Problem) -> _Program:
        n = problem.dimension
        zero = np.zeros(n)
        cost = problem.objective_row.gradient(zero)
        hessian = sps.csc_array(problem.objective_row.gradient_system.jacobian(zero))
        return _Program(Polyhedron.of(problem), cost, hessian)

    def convex(self) -> bool:
        """Check in floating point that no eigenvalue is clearly negative."""
        if not self.hessian.nnz:
            return True
        used = np.unique(self.hessian.indices)
        if self.hessian.nnz > BOUNDING.convex_entries:
            return False
        return _is_definite(self.hessian[used][:, used], -1e-9)

    def duals(self, problem: Problem, found: QuadraticSolution) -> Iterator[tuple[ExactDual, bool]]:
        """Yield multipliers with which the gradient of the Lagrangian vanishes somewhere.

        At a point on the active rows, where the bound is the optimum, or anywhere, which loses
        the square of what multipliers are off. That comes first where elimination takes time.
        """
        equality, near = self.rows.equality, found.multipliers
        few = self.rows.dimension <= BOUNDING.few_monomials
        for vertex in (few, not few):
            chosen = equality | (near > found.slack)
            for _ in range(_TRIES):
                values = self._projected(np.flatnonzero(chosen), found, vertex)
                wrong = [k for k, v in (values or {}).items() if v < 0 and not equality[k]]
                if not wrong:
                    break
                chosen[wrong] = False
            if values is not None and not wrong:
                yield self._dual(problem, values), False
            if not self.hessian.nnz:
                break  # the multipliers of a linear program are the same anywhere

    def _projected(
        self, chosen: NDArray[np.int64], found: QuadraticSolution, vertex: bool
    ) -> dict[int, Fraction] | None:
        """Solve hessian u + cost = A' multipliers in rationals for u and the multipliers.

        With ``vertex`` the chosen rows vanish at u. Else equations are left out that some u
        solves whatever the multipliers are.
        """
        n, rows = self.rows.dimension, self.rows
        table: list[Row] = [{} for _ in range(n)]
        entries = sps.coo_array(self.hessian)
        for i, j, value in zip(*entries.coords, entries.data.tolist(), strict=True):
            table[int(i)][int(j)] = Fraction(value)
        right = [-Fraction(float(c)) for c in self.cost]
        for k in chosen.tolist():
            slope = [
                (j, Fraction(float(rows.matrix[k, j]))) for j in np.flatnonzero(rows.matrix[k])
            ]
            for j, value in slope:
                table[j][n + k] = -value
            if vertex and self.hessian.nnz:
                table.append({int(j): value for j, value in slope})
                right.append(-Fraction(float(rows.constant[k])))
        if not vertex:
            kept = np.flatnonzero(~self._definite()).tolist()
            table, right = [table[j] for j in kept], [right[j] for j in kept]
        free = rows.equality[chosen]
        others = chosen[~free]
        near = found.multipliers
        order = [
            *range(n),
            *(n + chosen[free]).tolist(),
            *(n + others[np.argsort(-near[others], kind="stable")]).tolist(),
        ]
        start = [near_fraction(v) for v in [*found.x.tolist(), *near.tolist()]]
        values = projected(table, right, order, start)
        return None if values is None else {k: values[n + k] for k in chosen.tolist()}

    def _definite(self) -> NDArray[np.bool_]:
        """Mark the variables of parts of the Hessian that are clearly definite."""
        count, part = connected_components(self.hessian, directed=False)
        size = self.hessian.diagonal()
        definite = size > 0.0
        for k in np.unique(part[definite]).tolist() if count else []:
            inside = np.flatnonzero(part == k)
            scale = 1.0 / np.sqrt(np.where(definite[inside], size[inside], np.inf))
            weights = sps.diags_array(scale)
            matrix = weights @ self.hessian[inside][:, inside] @ weights
            definite[inside] &= _is_definite(sps.csc_array(matrix), _DEFINITE)
        return definite

    def _dual(self, problem: Problem, values: dict[int, Fraction]) -> ExactDual:
        kept = {k: v for k, v in values.items() if v}
        return ExactDual(
            problem.lower,
            problem.upper,
            np.array(list(kept), np.int64),
            np.zeros((len(kept), 1), np.int32),
            tuple(kept.values()),
            _quadratic_gram(self.hessian) if self.hessian.nnz else None,
        )

    def by_pivots(self, problem: Problem) -> Iterator[tuple[ExactDual, bool]]:
        """Yield the outcome of the simplex method in integers, with few variables."""
        if problem.dimension > BOUNDING.exact_variables:
            return
        linear = not self.hessian.nnz
        (found,) = linear_bounds(problem, [problem.objective if linear else self.nothing(problem)])
        empty = found.status == Status.INFEASIBLE
        if empty or (linear and found.status == Status.OPTIMAL):
            flat = _Program(self.rows, self.cost, sps.csc_array(self.hessian.shape))
            yield flat._dual(problem, dict(found.multipliers)), empty

    @staticmethod
    def nothing(problem: Problem) -> Polynomial:
        """Return the objective 0."""
        return problem.objective * 0.0


def _is_definite(matrix: sps.csc_array, least: float) -> bool:
    """Check in floating point that no eigenvalue is below a share of the largest entry.

    Large matrices are factorized with pivots on the diagonal, which are all positive then.
    """
    least *= float(np.abs(matrix.data).max(initial=0.0))
    if matrix.shape[0] <= BOUNDING.convex_variables:
        return bool(np.linalg.eigvalsh(matrix.toarray())[0] >= least)
    shifted = sps.csc_array(matrix - least * sps.eye_array(matrix.shape[0]))
    try:
        factors = splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=_SYMMETRIC)
    except RuntimeError:  # singular
        return False
    on_diagonal = np.array_equal(factors.perm_r, factors.perm_c)
    return on_diagonal and bool(np.all(factors.U.diagonal() > 0.0))


def _quadratic_gram(hessian: sps.csc_array) -> ExactGram:
    """Build the Gram matrix of a quadratic polynomial, which its coefficients determine."""
    used = np.unique(hessian.indices)
    i, j = sps.coo_array(sps.triu(hessian)).coords
    number = np.zeros(hessian.shape[0], np.int64)
    number[used] = np.arange(1, used.size + 1)
    own = number[used]
    off = i != j
    first = np.concatenate([own, number[i[off]], np.zeros(used.size, np.int64)])
    second = np.concatenate([own, number[j[off]], own])
    basis = np.concatenate([[0], used + 1]).astype(np.int32)[:, None]
    return ExactGram(basis, first, second, np.zeros(first.size))


def falling_direction(problem: Problem) -> NDArray[np.float64] | None:
    """Find a direction along which a convex objective falls without leaving a polyhedron.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    (n,) float or None
        None where there is none, or the problem is of another kind.
    """
    n = problem.dimension
    if not has_linear_rows(problem) or n > BOUNDING.exact_variables:
        return None
    program = _Program.of(problem)
    linear = _direction_row(program.cost)
    rows = [
        Constraint(_direction_row(slope), c.kind)
        for c, slope in zip(problem.constraints, program.rows.matrix, strict=False)
        if np.any(slope)
    ]
    flat = program.hessian.toarray()
    rows += [Constraint(_direction_row(row), Kind.ZERO) for row in flat if np.any(row)]
    low = np.where(np.isfinite(problem.lower), 0.0, -1.0)
    high = np.where(np.isfinite(problem.upper), 0.0, 1.0)
    if not np.any(program.cost):
        return None
    (found,) = linear_bounds(Problem(linear, rows, low, high), [linear])
    if found.vertex is None or not found.value:
        return None
    total = lcm(*(v.denominator for v in found.vertex))
    whole = [v * total for v in found.vertex]
    direction = np.array([float(v) for v in whole])
    exact = all(Fraction(d) == v for d, v in zip(direction.tolist(), whole, strict=True))
    return direction if exact else None


def _direction_row(slope: NDArray[np.float64]) -> Polynomial:
    used = np.flatnonzero(slope)
    words = (used + 1).astype(np.int32)[:, None]
    return Polynomial.from_words(words, slope[used], slope.size)
