"""Exact bounds of linear objectives over linear constraints, and how they are checked.

Multipliers prove a bound or emptiness (Farkas), a rational vertex attains it, a rational ray
shows that the objective falls without limit. All checks are in rationals.
:mod:`sparsepop_py.bounding.exact_linear` finds them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Kind, Polynomial
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import read_only
from sparsepop_py.verified.arithmetic.interval import Interval, require_ieee
from sparsepop_py.verified.certificate.certificate import Verdict
from sparsepop_py.verified.certificate.polyhedron import Polyhedron

__all__ = ["LinearBound", "check_linear", "cost_of", "value_at"]

_LESS = "the multipliers prove less than is claimed"


@dataclass(frozen=True, eq=False)
class LinearBound(ReadOnly):
    """Exact optimum of a linear objective over linear constraints.

    Parameters
    ----------
    status : Status
        ``OPTIMAL``, ``INFEASIBLE`` or ``UNBOUNDED``; compares equal to its text.
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

    status: str
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
            Its coefficients count as they were given, before they are rounded.

        Returns
        -------
        Verdict
            With the bound that the multipliers prove.

        Raises
        ------
        ProblemError
            If the problem is none, or the objective or a constraint is not linear.
        """
        check_linear(problem, [objective])
        require_ieee()
        rows = Polyhedron.of(problem)
        bound, reason = self._bound(rows, objective)
        reason = reason or self._point_fails(rows, objective) or self._misstated()
        return Verdict(not reason, bound, reason)

    def _bound(self, rows: Polyhedron, objective: Polynomial) -> tuple[float, str]:
        """Compute the bound that the multipliers prove, and a reason if they fail."""
        if self.status == "UNBOUNDED":
            return -np.inf, "" if self.lower == -np.inf else _LESS
        if self.status not in ("OPTIMAL", "INFEASIBLE"):
            return -np.inf, "the status is none"
        total, rest = Fraction(0), [-c for c in cost_of(objective)]
        if self.status == "INFEASIBLE":
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
        if self.status == "INFEASIBLE":
            return (np.inf, "") if total < 0 else (-np.inf, "no contradiction follows")
        proved = _constant(objective) - total
        bound = float(Interval.of_fraction(proved).lo)
        least = self.lower <= bound and (self.value is None or self.value <= proved)
        return bound, "" if least else _LESS

    def _point_fails(self, rows: Polyhedron, objective: Polynomial) -> str:
        """Describe the fault of the attained point or ray, empty if there is none."""
        if self.status == "INFEASIBLE":
            attains = self.upper != np.inf or not self.lower <= np.inf
            return "nothing is feasible, and an end is stated" if attains else ""
        if self.vertex is None or len(self.vertex) != rows.dimension:
            return "there is no attained point"
        if not _holds(rows, self.vertex, 1):
            return "the attained point violates a row"
        if self.status == "OPTIMAL":
            value = value_at(objective, self.vertex)
            most = value <= self.upper and (self.value is None or value <= self.value)
            return "" if most else "the point attains more than claimed"
        if self.ray is None or len(self.ray) != rows.dimension or not _holds(rows, self.ray, 0):
            return "the ray leaves the set"
        falls = value_at(objective, self.ray) < _constant(objective)
        return "" if falls else "the objective does not fall along the ray"

    def _misstated(self) -> str:
        """Describe what the other fields say beside the point; empty if they agree."""
        if self.status != "OPTIMAL" and self.value is not None:
            return "there is no optimum"
        if self.status == "INFEASIBLE" and (self.vertex is not None or self.ray is not None):
            return "there is no feasible point"
        if self.x is None:
            return ""
        ends = [Interval.of_fraction(v) for v in self.vertex or ()]
        near = len(ends) == self.x.size and all(
            end.lo <= value <= end.hi for end, value in zip(ends, self.x.tolist(), strict=True)
        )
        return "" if near else "the point in doubles is another one"


def check_linear(problem: Problem, objectives: Sequence[Polynomial]) -> None:
    """Refuse constraints and objectives that are not linear."""
    check_kind(problem, Problem, "problem")
    for number, row in enumerate(problem.constraints):
        if row.polynomial.degree > 1 or row.kind not in (Kind.NONNEGATIVE, Kind.ZERO):
            raise ProblemError(f"constraints[{number}]: found {row}, expected a linear one")
    for number, p in enumerate(objectives):
        good = isinstance(p, Polynomial) and p.dimension == problem.dimension
        if not good or any(word.count(0) + 1 < len(word) for word, _ in _terms(p)):
            raise ProblemError(
                f"objectives[{number}]: expected a linear Polynomial in "
                f"{problem.dimension} variables"
            )


def cost_of(objective: Polynomial) -> list[Fraction]:
    """List the coefficients of the variables, before they are rounded."""
    cost = [Fraction(0)] * objective.dimension
    for word, value in _terms(objective):
        if word[-1]:
            cost[word[-1] - 1] = value
    return cost


def value_at(objective: Polynomial, point: Sequence[Fraction]) -> Fraction:
    """Evaluate a linear objective at a rational point."""
    terms = (c * v for c, v in zip(cost_of(objective), point, strict=True) if c)
    return sum(terms, _constant(objective))


def _constant(objective: Polynomial) -> Fraction:
    return sum((value for word, value in _terms(objective) if not word[-1]), Fraction(0))


def _terms(objective: Polynomial) -> Iterator[tuple[list[int], Fraction]]:
    """Yield monomials and coefficients as they were given."""
    words = objective.words if objective.exact is None else objective.exact.words
    return zip(words.tolist(), objective.fractions, strict=True)


def _holds(rows: Polyhedron, point: Sequence[Fraction], weight: int) -> bool:
    """Check all rows at a point (weight 1), or along a direction (weight 0)."""
    total = lcm(*(v.denominator for v in point))
    whole = [v.numerator * (total // v.denominator) for v in point]
    signs = rows.signs(whole, weight * total, total)
    return not (np.any(signs < 0) or np.any(signs[rows.equality]))
