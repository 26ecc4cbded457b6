"""Proved balls around minimisers (``errorBdIdx`` of SparsePOP).

Every feasible x with f(x) <= cutoff satisfies |x_I - centre_I|^2 <= zeta, where zeta is an upper
bound of the largest distance: the negative of a certified lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total, variables
from sparsepop_py.errors import ProblemError
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve_each
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rounding import above
from sparsepop_py.result import Result

__all__ = ["error_bounds", "index_sets"]


def index_sets(given: Any, n: int) -> list[list[int]]:
    """Read sets of variables (from 0) that ``errorBdIdx`` names.

    Raises
    ------
    ProblemError
        If an index is larger than the number of variables.
    """
    if isinstance(given, str):
        return [list(range(n))] if given == "a" else []
    items = list(given) if isinstance(given, (list, tuple)) else [given]
    if not any(isinstance(item, (list, tuple, str)) for item in items):
        items = [items]
    sets = []
    for item in items:
        inner = item if isinstance(item, (list, tuple)) else [item]
        chosen = list(range(n)) if item == "a" else [int(v) - 1 for v in inner]
        if any(v >= n for v in chosen):
            raise ProblemError(f"param.errorBdIdx: found {max(chosen) + 1}, expected at most {n}")
        sets.append(sorted(set(chosen)))
    return sets


def error_bounds(
    problem: Problem,
    centre: NDArray[np.float64],
    cutoff: float,
    sets: Sequence[Sequence[int]],
    options: Options,
) -> list[Result]:
    """Bound the largest distances from a centre where f <= cutoff, by sets.

    Parameters
    ----------
    problem : Problem
    centre : (n,) float
    cutoff : float
    sets : sequence of sequences of int
        Variables, from 0.
    options : Options
        With effort ``"presolve"`` or ``"auto"``.

    Returns
    -------
    list of Result
        About the problem of minimising -|x_I - centre_I|^2, so that zeta is
        ``-result.lower_bound``.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x + y, [x**2 + y**2 <= 1])
    >>> centre = np.full(2, -0.5**0.5)
    >>> [ball] = error_bounds(problem, centre, -1.0, [[0, 1]], sp.Options(order=2))
    >>> 2 - 2**0.5 < -ball.lower_bound < 2 - 2**0.5 + 1e-4
    True
    """
    below = Constraint(_below(problem.objective, cutoff), Kind.NONNEGATIVE, "f <= fValueUbd")
    rows = [*problem.constraints, below]
    inside = Problem(problem.objective, rows, problem.lower, problem.upper, problem.names)
    return solve_each(inside, [_distance(centre, chosen) for chosen in sets], options)


def _below(objective: Polynomial, cutoff: float) -> Polynomial:
    """Build the row cutoff - f, rounded up: non-negative wherever f <= cutoff."""
    constant = Fraction(cutoff) - Fraction(objective.constant_term)
    return total([-(objective - objective.constant_term), above(constant)])


def _distance(centre: NDArray[np.float64], chosen: Sequence[int]) -> Polynomial:
    """-|x_I - centre_I|^2, its constant rounded down: never above it."""
    x = variables(centre.size)
    rest = total((2.0 * float(centre[v])) * x[v] - x[v] ** 2 for v in chosen)
    return total(
        [rest, -above(sum((Fraction(float(centre[v])) ** 2 for v in chosen), Fraction(0)))]
    )
