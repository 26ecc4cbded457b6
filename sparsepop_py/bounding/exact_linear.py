"""Exact linear programs in few unknowns, without a box and without rounding.

HiGHS proposes the rows that are active at the optimum; exact pivots do the rest (see
:mod:`sparsepop_py.lp.exact_simplex`). The result is always decided: an optimal vertex,
multipliers that prove emptiness (Farkas), or a ray along which the objective falls.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import check_kind, entries_of
from sparsepop_py.lp.exact_simplex import Outcome, Simplex
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import Status
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.linear_bound import (
    LinearBound,
    check_linear,
    cost_of,
    value_at,
)
from sparsepop_py.verified.certificate.polyhedron import Polyhedron

__all__ = ["linear_bounds"]


def linear_bounds(problem: Problem, objectives: Sequence[Polynomial]) -> list[LinearBound]:
    """Minimise linear objectives subject to linear constraints, exactly.

    Variables may be unbounded. Meant for few variables (tens) and any number of rows: the
    work in rationals is about the cube of the number of variables for each objective.

    Parameters
    ----------
    problem : Problem
        Its own objective is ignored.
    objectives : sequence of Polynomial
        Their coefficients count as they were given, before they are rounded.

    Returns
    -------
    list of LinearBound
        One an objective.

    Raises
    ------
    ProblemError
        If an objective or a constraint is not linear, or an argument has another type.

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
    check_kind(problem, Problem, "problem")
    objectives = entries_of(objectives, "objectives", "a list of linear polynomials")
    check_linear(problem, objectives)
    simplex = Simplex(Polyhedron.of(problem))
    found: list[LinearBound] = []
    for p in objectives:
        if found and found[0].status is Status.INFEASIBLE:
            found.append(found[0])  # its multipliers speak of the rows alone
        else:
            found.append(_bound_of(simplex.minimise(cost_of(p)), p))
    return found


def _bound_of(outcome: Outcome, objective: Polynomial) -> LinearBound:
    multipliers = tuple(zip(outcome.rows, outcome.multipliers, strict=True))
    if outcome.vertex is None:
        return LinearBound(Status.INFEASIBLE, np.inf, np.inf, None, multipliers)
    near = [Interval.of_fraction(v) for v in outcome.vertex]  # middles lose tiny numbers
    x = np.array([np.clip(v.middle(), v.lo, v.hi) for v in near], float).reshape(len(near))
    if outcome.ray is not None:
        status, low = Status.UNBOUNDED, -np.inf
        return LinearBound(status, low, low, x, multipliers, None, outcome.vertex, outcome.ray)
    value = value_at(objective, outcome.vertex)
    ends = Interval.of_fraction(value)
    return LinearBound(
        Status.OPTIMAL, float(ends.lo), float(ends.hi), x, multipliers, value, outcome.vertex
    )
