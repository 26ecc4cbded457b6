"""Prove that a feasible point exists near a vector of doubles.

A vector of doubles satisfies equations only nearly, so its value may lie below the true
minimum. A :class:`ProvedPoint` is more: a feasible point exists within ``radius`` of
``x``, and the objective there is at most ``value``. There are three proofs.

Exact repair. Some variables, as many as there are equalities and entering them jointly
linearly, are solved for in rationals while all others keep their doubles; then every
constraint and bound is checked exactly.

Krawczyk's test. As many variables as there are equalities are enclosed in a box that
provably contains a zero (:mod:`sparsepop_py.verified.arithmetic.krawczyk`); inequalities and
bounds are then checked over the box. Two opposite inequalities are an equality: one of them is
solved, and both are zero then. Matrices are checked by
:mod:`sparsepop_py.verified.arithmetic.definiteness`.

Substitution. Equalities that are triangular, as those of a recursion, are solved one after the
other in fixed point (:mod:`sparsepop_py.verified.arithmetic.substitution`), so that there may be
many; all else is checked over the enclosures as after Krawczyk's test.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import read_only
from sparsepop_py.verified.arithmetic.definiteness import hold_at, hold_over
from sparsepop_py.verified.arithmetic.interval import Interval, exact_values, require_ieee
from sparsepop_py.verified.arithmetic.krawczyk import polished, zero_near
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.arithmetic.rational import solve_rationally
from sparsepop_py.verified.arithmetic.substitution import substituted

__all__ = ["ProvedPoint", "exact_coordinates", "prove_point", "valued"]

_PROOFS = ("exact", "krawczyk", "substitution")
_LARGEST_SYSTEM = 1000  # equations that Krawczyk's test encloses with dense matrices


@dataclass(frozen=True, eq=False)
class ProvedPoint(ReadOnly):
    """Feasible point whose existence is proved.

    Parameters
    ----------
    x : (n,) float
        Approximation of the point.
    value : float
        Upper end of the objective at the point.
    radius : float
        The point lies within ``radius`` of ``x`` in every coordinate.
    proof : {"exact", "krawczyk", "substitution"}
    rows, solved : (r,) int
        Constraints that were solved as equations, and the variables they were solved for; in the
        order of the substitution, row by row, where that is the proof.

    Raises
    ------
    ProblemError
        If an array or the kind of the proof is something else.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x + y, [x**2 + y**2 == 1])
    >>> point = sp.solve(problem).attained
    >>> point.proof, point.recheck(problem).value == point.value
    ('krawczyk', True)
    """

    x: NDArray[np.float64]
    value: float
    radius: float
    proof: Literal["exact", "krawczyk", "substitution"]
    rows: NDArray[np.int64]
    solved: NDArray[np.int64]

    def __post_init__(self) -> None:
        fields = {
            "x": read_only(self.x, "f", "x"),
            "rows": read_only(self.rows, "i", "rows"),
            "solved": read_only(self.solved, "i", "solved"),
        }
        self.__dict__.update(fields)
        if self.proof not in _PROOFS:
            raise ProblemError(f"proof: found {self.proof!r}, expected one of {_PROOFS}")

    def recheck(self, problem: Problem) -> ProvedPoint | None:
        """Repeat the proof.

        Parameters
        ----------
        problem : Problem

        Returns
        -------
        ProvedPoint or None
            None if the proof fails or makes no sense for this problem.

        Raises
        ------
        ProblemError
            If it is no Problem.
        """
        check_kind(problem, Problem, "problem")
        n, m = problem.dimension, len(problem.constraints)
        sensible = (
            self.x.shape == (n,)
            and np.all(np.isfinite(self.x))
            and np.all((self.rows >= 0) & (self.rows < m))
            and np.all((self.solved >= 0) & (self.solved < n))
        )
        if not sensible:
            return None
        as_it_is = self.x, self.rows, self.solved, self.proof
        again = prove_point(problem, *as_it_is, polish=False)
        return prove_point(problem, *as_it_is) if again is None else again


def prove_point(
    problem: Problem,
    x: NDArray[np.float64],
    rows: NDArray[np.int64],
    solved: NDArray[np.int64],
    proof: str,
    polish: bool = True,
) -> ProvedPoint | None:
    """Solve ``rows`` for the variables ``solved`` and check all other constraints.

    Parameters
    ----------
    problem : Problem
    x : (n,) float
    rows, solved : (r,) int
    proof : {"exact", "krawczyk", "substitution"}
    polish : bool
        Whether Newton steps come first, for ``"krawczyk"``; a point that was polished is proved
        as it is without.

    Returns
    -------
    ProvedPoint or None
    """
    require_ieee()
    x = np.asarray(x, float)  # short floats would round enclosures inwards, short integers wrap
    rows, solved = np.asarray(rows, np.int64), np.asarray(solved, np.int64)
    distinct = np.unique(rows).size == rows.size and np.unique(solved).size == solved.size
    if not distinct or rows.size != solved.size:
        return None
    if proof == "exact":
        return _prove_exactly(problem, x, rows, solved)
    if not rows.size:
        return None
    if proof == "krawczyk":
        return _prove_by_krawczyk(problem, x, rows, solved, polish)
    return _prove_by_substitution(problem, x, rows, solved)


def valued(point: ProvedPoint, problem: Problem) -> ProvedPoint:
    """Bound another objective at a point, whose proof is not repeated.

    Parameters
    ----------
    point : ProvedPoint
        Proved for a problem with the same constraints and bounds.
    problem : Problem

    Returns
    -------
    ProvedPoint
        Its value is an upper end of this objective within the radius of the point.
    """
    reach = np.full(point.x.size, point.radius)
    ball = Interval.point(point.x) + Interval(-reach, reach)
    return replace(point, value=float(range_over(problem.objective_row, ball).hi[0]))


# ---- proofs ---------------------------------------------------------------------------------


def _prove_exactly(
    problem: Problem, x: NDArray[Any], rows: NDArray[Any], solved: NDArray[Any]
) -> ProvedPoint | None:
    exact = exact_coordinates(problem, x, rows, solved)
    if exact is None:
        return None
    objective = problem.objective_row
    value = exact_values(objective.words, objective.coefficients, objective.row, 1, exact)[0]
    try:
        near = [float(exact[v]) for v in solved.tolist()]
    except OverflowError:  # it lies beyond all doubles
        return None
    pairs = zip(solved.tolist(), near, strict=True)
    radius = max((abs(exact[v] - Fraction(float(m))) for v, m in pairs), default=Fraction(0))
    upper, reach = (float(Interval.of_fraction(v).hi) for v in (value, radius))
    kept = x.copy()
    kept[solved] = near
    return ProvedPoint(kept, upper, reach, "exact", rows, solved)


def exact_coordinates(
    problem: Problem, x: NDArray[Any], rows: NDArray[Any], solved: NDArray[Any]
) -> list[Fraction] | None:
    """Solve rows in rationals for some variables; None unless that point is feasible."""
    exact = [Fraction(value) for value in x.tolist()]
    if rows.size:
        solution = solve_rationally(problem.rows.take(rows), exact, solved.tolist())
        if solution is None:
            return None
        for variable, value in solution.items():
            exact[variable] = value
    return exact if _holds_exactly(problem, exact) else None


def _holds_exactly(problem: Problem, x: list[Fraction]) -> bool:
    for value, low, high in zip(x, problem.lower.tolist(), problem.upper.tolist(), strict=True):
        if (low != -np.inf and value < Fraction(low)) or (
            high != np.inf and value > Fraction(high)
        ):
            return False
    system = problem.rows
    values = exact_values(system.words, system.coefficients, system.row, system.size, x)
    rows = all(
        value == 0 if equal else value >= 0
        for value, equal in zip(values, problem.equality.tolist(), strict=True)
    )
    return rows and hold_at(problem.matrices, x)


def _prove_by_krawczyk(
    problem: Problem, x: NDArray[Any], rows: NDArray[Any], solved: NDArray[Any], polish: bool
) -> ProvedPoint | None:
    system, near = problem.rows.take(rows), None
    if rows.size <= _LARGEST_SYSTEM:
        near = polished(system, x, solved) if polish else x.copy()
    box = None if near is None else zero_near(system, near, solved)
    if near is None or box is None or not _holds_over(problem, box, rows):
        return None
    return _within(problem, near, box, "krawczyk", rows, solved)


def _prove_by_substitution(
    problem: Problem, x: NDArray[Any], rows: NDArray[Any], solved: NDArray[Any]
) -> ProvedPoint | None:
    box = substituted(problem.rows.take(rows), x, solved)
    if box is None or not np.all(np.isfinite([box.lo, box.hi])):
        return None
    if not _holds_over(problem, box, rows):
        return None
    near = x.copy()
    near[solved] = box.middle()[solved]
    return _within(problem, near, box, "substitution", rows, solved)


def _holds_over(problem: Problem, box: Interval, rows: NDArray[Any]) -> bool:
    """Check bounds, matrices, and all constraints but those that are zero, over a box.

    Zero are the rows that are solved, and those that are alike up to their sign.
    """
    if not (np.all(box.lo >= problem.lower) and np.all(box.hi <= problem.upper)):
        return False
    others = np.flatnonzero(~np.isin(problem.first_alike, problem.first_alike[rows]))
    values = range_over(problem.rows.take(others), box)
    equal = problem.equality[others]
    holds = (values.lo >= 0) & ((values.hi <= 0) | ~equal)
    kept = box.lo == box.hi
    failing = any(not _holds_at_kept(problem, row, box, kept) for row in others[~holds].tolist())
    return not failing and hold_over(problem.matrices, box)


def _holds_at_kept(problem: Problem, row: int, box: Interval, kept: NDArray[np.bool_]) -> bool:
    """Check a constraint exactly where its variables are points of the box."""
    system = problem.rows.take(np.array([row]))
    letters = np.unique(system.words)
    if not np.all(kept[letters[letters > 0] - 1]):
        return False
    x = [Fraction(value) for value in box.lo.tolist()]
    value = exact_values(system.words, system.coefficients, system.row, 1, x)[0]
    return value == 0 if problem.equality[row] else value >= 0


def _within(
    problem: Problem,
    x: NDArray[Any],
    box: Interval,
    proof: Literal["krawczyk", "substitution"],
    rows: NDArray[Any],
    solved: NDArray[Any],
) -> ProvedPoint | None:
    """The point near x, with the largest value of the objective over a box."""
    value = float(range_over(problem.objective_row, box).hi[0])
    if not np.isfinite(value):
        return None
    spread = float(np.max(np.maximum(box.hi - x, x - box.lo)))
    return ProvedPoint(x, value, float(np.nextafter(spread, np.inf)), proof, rows, solved)
