"""Unboundedness: a feasible ray along which the objective falls without limit.

From an exactly feasible point x and a rational direction d, every polynomial becomes a
polynomial in s >= 0 with rational coefficients. If those of each inequality are all
non-negative, those of each equality all zero, and the leading one of the objective is
negative, the ray proves that there is no lower bound. Matrices are semidefinite along the
ray if all their coefficients in s are.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.budget import check
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.definiteness import entries_hold
from sparsepop_py.verified.arithmetic.interval import require_ieee
from sparsepop_py.verified.points.feasible_point import ProvedPoint, exact_coordinates

__all__ = ["falling_ray"]

_ROUNDING = 1e-4  # share of its terms that a constraint is off where rounding is no cause
_LIMIT = 200  # variables; the search tries 2n + a few directions exactly


def falling_ray(
    problem: Problem, start: ProvedPoint, known: NDArray[np.float64] | None = None
) -> NDArray[np.float64] | None:
    """Find a direction that proves the objective unbounded from an exact point.

    Parameters
    ----------
    problem : Problem
    start : ProvedPoint
        Only a point with rational coordinates can start a ray.
    known : (n,) float, optional
        The only direction to be tried.

    Returns
    -------
    (n,) float or None
    """
    require_ieee()
    fits = known is None or (known.shape == start.x.shape and np.all(np.isfinite(known)))
    if start.proof != "exact" or problem.dimension > _LIMIT or not fits:
        return None
    origin = exact_coordinates(problem, start.x, start.rows, start.solved)
    if origin is None:
        return None
    for direction in _directions(problem, start.x) if known is None else (known,):
        check()
        if _promises(problem, start.x, direction) and _proves(problem, origin, direction):
            return direction
    return None


def _directions(problem: Problem, x: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    """Yield directions to try, without those that bounds or linear constraints soon end."""
    tried = np.array([*_all_directions(problem, x)])
    yield from tried[_recede(problem, tried)]


def _all_directions(problem: Problem, x: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    gradient = problem.objective_row.gradient(x)
    yield -np.sign(np.where(np.abs(gradient) > 1e-9 * np.abs(gradient).max(initial=0), gradient, 0))
    for unit in np.eye(problem.dimension):
        yield unit
        yield -unit
    if problem.dimension <= 12:
        for signs in range(3**problem.dimension if problem.dimension <= 5 else 0):
            digits = [(signs // 3**k) % 3 - 1 for k in range(problem.dimension)]
            yield np.array(digits, float)


def _recede(problem: Problem, directions: NDArray[Any]) -> NDArray[np.bool_]:
    """Mark directions (K, n) that bounds and linear constraints may allow without end."""
    down, up = np.isfinite(problem.lower), np.isfinite(problem.upper)
    holds = ~np.any((directions < 0) & down | (directions > 0) & up, axis=1)
    system = problem.rows
    degree = monomials.degrees(system.words)
    linear = np.bincount(system.row, degree > 1, minlength=system.size) == 0
    slopes = np.zeros((system.size, problem.dimension))
    terms = np.flatnonzero((degree == 1) & linear[system.row])
    slopes[system.row[terms], system.words[terms, -1] - 1] = system.coefficients[terms]
    with np.errstate(all="ignore"):
        step = directions @ slopes.T
        rounding = 1e-9 * (np.abs(directions) @ np.abs(slopes).T)
        falls = (step < -rounding) | ((step > rounding) & problem.equality)
    return holds & ~np.any(falls, axis=1)


def _promises(problem: Problem, x: NDArray[Any], direction: NDArray[Any]) -> bool:
    """Check in floating point that the objective falls and constraints nearly hold far out."""
    if not np.any(direction):
        return False
    system = problem.rows
    with np.errstate(all="ignore"):
        values = [problem.objective(x + s * direction) for s in (0.0, 1e4, 1e6)]
        if not values[2] < values[1] < values[0]:
            return False
        there = x + 1e6 * direction
        terms = system.coefficients * monomials.evaluate(system.words, there)
        value, size = (np.bincount(system.row, v, system.size) for v in (terms, np.abs(terms)))
        off = np.where(problem.equality, -np.abs(value), value) < -_ROUNDING * size
    return not np.any(off)


def _proves(problem: Problem, origin: list[Fraction], direction: NDArray[Any]) -> bool:
    if np.any((direction < 0) & np.isfinite(problem.lower)) or np.any(
        (direction > 0) & np.isfinite(problem.upper)
    ):
        return False
    step = [Fraction(v) for v in direction.tolist()]
    falling = _along(problem.objective, origin, step)
    if len(falling) < 2 or falling[-1] >= 0:
        return False
    for constraint, equal in zip(problem.constraints, problem.equality, strict=True):
        values = _along(constraint.polynomial, origin, step)
        if any(v != 0 for v in values) if equal else any(v < 0 for v in values):
            return False
    return _matrices_hold(problem, origin, step)


def _matrices_hold(problem: Problem, origin: list[Fraction], step: list[Fraction]) -> bool:
    """Prove every coefficient in s of every matrix positive semidefinite."""
    entries = [_along(p, origin, step) for c in problem.constraints for p in c.entries]
    for power in range(max(map(len, entries), default=0)):
        values = [p[power] if power < len(p) else Fraction(0) for p in entries]
        if not entries_hold(problem.matrices, [*values, Fraction(0)]):
            return False
    return True


def _along(polynomial: Polynomial, origin: list[Fraction], step: list[Fraction]) -> list[Fraction]:
    """Coefficients in s of p(origin + s * step), without trailing zeros."""
    total = [Fraction(0)] * (polynomial.degree + 1)
    for letters, coefficient in zip(
        polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True
    ):
        term = [Fraction(coefficient)]
        for letter in letters:
            if letter:
                base, slope = origin[letter - 1], step[letter - 1]
                shifted = [c * slope for c in term]
                term = [c * base for c in term] + [Fraction(0)]
                for k, value in enumerate(shifted):
                    term[k + 1] += value
        for k, value in enumerate(term):
            total[k] += value
    while total and total[-1] == 0:
        total.pop()
    return total
