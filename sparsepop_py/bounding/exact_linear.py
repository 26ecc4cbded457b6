"""Exact linear programs in few unknowns, without a box and without rounding.

HiGHS proposes the rows that are active at the optimum; exact pivots do the rest (see
:mod:`sparsepop_py.lp.exact_simplex`). The result is always decided: an optimal vertex,
multipliers that prove emptiness (Farkas), or a ray along which the objective falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Kind, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.lp.exact_simplex import Outcome, Simplex
from sparsepop_py.lp.polyhedron import Polyhedron
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import Status
from sparsepop_py.verified.arithmetic.array_checks import read_only
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Verdict

__all__ = ["LinearBound", "linear_bounds"]


@dataclass(frozen=True, eq=False)
class LinearBound:
    """Exact optimum of a linear objective over linear constraints.

    Parameters
    ----------
    status : Status
        OPTIMAL, INFEASIBLE or UNBOUNDED.
    lower, upper : float
        The optimum, rounded down (proved) and up (attained by ``vertex``). Both are +inf
        where nothing is feasible, -inf where the objective falls without limit.
    x : (n,) float or None
        The vertex in doubles: an optimal point, or any feasible one where unbounded.
    multipliers : tuple of (int, Fraction)
        Row numbers with their multipliers, not negative for inequalities. Their sum is the
        objective minus its optimum; where nothing is feasible, a negative constant. Rows are
        the m constraints, lower bounds of the n variables, upper bounds.
    value : Fraction or None
        The optimum.
    vertex, ray : tuple of Fraction or None
        A feasible point; where unbounded, a direction along which the objective falls.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> (bound,) = sp.linear_bounds(sp.Problem(x, [3 * x >= 1, y >= x]), [x + y])
    >>> bound.value, bound.multipliers
    (Fraction(2, 3), ((0, Fraction(2, 3)), (1, Fraction(1, 1))))
    """

    status: Status
    lower: float
    upper: float
    x: NDArray[np.float64] | None
    multipliers: tuple[tuple[int, Fraction], ...]
    value: Fraction | None = None
    vertex: tuple[Fraction, ...] | None = None
    ray: tuple[Fraction, ...] | None = None

    def __post_init__(self) -> None:
        fields: dict[str, Any] = {
            "multipliers": tuple((int(k), Fraction(v)) for k, v in self.multipliers)
        }
        for name in ("vertex", "ray"):
            values = getattr(self, name)
            fields[name] = None if values is None else tuple(map(Fraction, values))
        if self.x is not None:
            fields["x"] = read_only(self.x, "f", "x")
        self.__dict__.update(fields)

    def verify(self, problem: Problem, objective: Polynomial) -> Verdict:
        """Check every claim in rationals, without any solver.

        Parameters
        ----------
        problem : Problem
        objective : Polynomial

        Returns
        -------
        Verdict
            With the bound that the multipliers prove.

        Raises
        ------
        ProblemError
            If the objective or a constraint is not linear.
        """
        _check(problem, [objective])
        rows = Polyhedron.of(problem)
        bound, reason = self._bound(rows, objective)
        point = reason or self._point_fails(rows, objective)
        return Verdict(not point, bound, point)

    def _bound(self, rows: Polyhedron, objective: Polynomial) -> tuple[float, str]:
        """Compute the bound that the multipliers prove, and a reason if they fail."""
        if self.status is Status.UNBOUNDED:
            return -np.inf, ""
        total, rest = Fraction(0), [-Fraction(c) for c in _cost(objective)]
        if self.status is Status.INFEASIBLE:
            rest = [Fraction(0)] * rows.dimension
        for number, multiplier in self.multipliers:
            if not 0 <= number < rows.constant.size or not rows.present[number]:
                return -np.inf, "a multiplier belongs to no row"
            if multiplier < 0 and not rows.equality[number]:
                return -np.inf, "a multiplier of an inequality is negative"
            total += multiplier * Fraction(float(rows.constant[number]))
            slope = rows.matrix[number]
            for j in np.flatnonzero(slope).tolist():
                rest[j] += multiplier * Fraction(float(slope[j]))
        if any(rest):
            return -np.inf, "the multipliers do not sum to the objective"
        if self.status is Status.INFEASIBLE:
            return (np.inf, "") if total < 0 else (-np.inf, "no contradiction follows")
        proved = Fraction(objective.constant_term) - total
        bound = float(Interval.of_fraction(proved).lo)
        return bound, "" if bound >= self.lower else "the multipliers prove less than is claimed"

    def _point_fails(self, rows: Polyhedron, objective: Polynomial) -> str:
        """Describe the fault of the attained point or ray, empty if there is none."""
        if self.status is Status.INFEASIBLE:
            return ""
        if self.vertex is None or len(self.vertex) != rows.dimension:
            return "there is no attained point"
        if not _holds(rows, self.vertex, 1):
            return "the attained point violates a row"
        if self.status is Status.OPTIMAL:
            value = _value(objective, self.vertex)
            return "" if value <= Fraction(self.upper) else "the point attains more than claimed"
        if self.ray is None or len(self.ray) != rows.dimension or not _holds(rows, self.ray, 0):
            return "the ray leaves the set"
        falls = _value(objective, self.ray) < Fraction(objective.constant_term)
        return "" if falls else "the objective does not fall along the ray"


def linear_bounds(problem: Problem, objectives: Sequence[Polynomial]) -> list[LinearBound]:
    """Minimise linear objectives subject to linear constraints, exactly.

    Variables may be unbounded. Meant for few variables (tens) and any number of rows: the
    work in rationals is about the cube of the number of variables for each objective.

    Parameters
    ----------
    problem : Problem
        Its own objective is ignored.
    objectives : sequence of Polynomial

    Returns
    -------
    list of LinearBound
        One an objective.

    Raises
    ------
    ProblemError
        If an objective or a constraint is not linear.

    References
    ----------
    D. Applegate, W. Cook, S. Dash, D. Espinoza, "Exact solutions to linear programming
    problems", Operations Research Letters 35 (2007) 693-699.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> cone = sp.Problem(x, [x + y >= 1, x - y >= 0])
    >>> low, high = sp.linear_bounds(cone, [x, -x])
    >>> low.value, high.status
    (Fraction(1, 2), <Status.UNBOUNDED: 'UNBOUNDED'>)
    >>> low.verify(cone, x).ok
    True
    """
    _check(problem, objectives)
    simplex = Simplex(Polyhedron.of(problem))
    found: list[LinearBound] = []
    for p in objectives:
        if found and found[0].status is Status.INFEASIBLE:
            found.append(found[0])  # its multipliers speak of the rows alone
        else:
            found.append(_bound_of(simplex.minimise(_cost(p)), p))
    return found


def _bound_of(outcome: Outcome, objective: Polynomial) -> LinearBound:
    multipliers = tuple(zip(outcome.rows, outcome.multipliers, strict=True))
    if outcome.vertex is None:
        return LinearBound(Status.INFEASIBLE, np.inf, np.inf, None, multipliers)
    x = np.concatenate([np.atleast_1d(Interval.of_fraction(v).middle()) for v in outcome.vertex])
    if outcome.ray is not None:
        status, low = Status.UNBOUNDED, -np.inf
        return LinearBound(status, low, low, x, multipliers, None, outcome.vertex, outcome.ray)
    value = _value(objective, outcome.vertex)
    ends = Interval.of_fraction(value)
    return LinearBound(
        Status.OPTIMAL, float(ends.lo), float(ends.hi), x, multipliers, value, outcome.vertex
    )


def _check(problem: Problem, objectives: Sequence[Polynomial]) -> None:
    for number, row in enumerate(problem.constraints):
        if row.polynomial.degree > 1 or row.kind not in (Kind.NONNEGATIVE, Kind.ZERO):
            raise ProblemError(f"constraints[{number}]: found {row}, expected a linear one")
    for number, p in enumerate(objectives):
        good = isinstance(p, Polynomial) and p.dimension == problem.dimension
        if not good or p.degree > 1:
            raise ProblemError(
                f"objectives[{number}]: expected a linear Polynomial in "
                f"{problem.dimension} variables"
            )


def _cost(objective: Polynomial) -> list[float]:
    """List the coefficients of the variables."""
    cost = np.zeros(objective.dimension)
    letter = objective.words[:, -1]
    cost[letter[letter > 0] - 1] = objective.coefficients[letter > 0]
    return cost.tolist()


def _value(objective: Polynomial, point: Sequence[Fraction]) -> Fraction:
    terms = (Fraction(c) * v for c, v in zip(_cost(objective), point, strict=True) if c)
    return sum(terms, Fraction(objective.constant_term))


def _holds(rows: Polyhedron, point: Sequence[Fraction], weight: int) -> bool:
    """Check all rows at a point (weight 1), or along a direction (weight 0)."""
    total = lcm(*(v.denominator for v in point))
    whole = [v.numerator * (total // v.denominator) for v in point]
    signs = rows.signs(whole, weight * total, total)
    return not (np.any(signs < 0) or np.any(signs[rows.equality]))
