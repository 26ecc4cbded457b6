"""Bound parameters by linear programs: exact ones, and at the ends that rows of data give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.attained import attained_result
from setid.bounding.context import BoundingContext
from setid.bounding.ends import intervals_of
from setid.feasible_points.linear_ends import linear_ends
from setid.formulation.formulation import Formulation
from setid.formulation.units import InUnits, in_units
from setid.proofs.existence import proved_point, rows_say_all, solved_rows
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import objectives
from setid.result.assembling import (
    Outcome,
    stated_problem,
)
from setid.result.identification import Identification

__all__ = ["at_linear_ends", "by_linear_programs"]

_FEW = 60  # unknowns up to which linear problems are solved in rationals


def by_linear_programs(formulation: Formulation, context: BoundingContext) -> Identification | None:
    """Bound all parameters without rounding, where a problem of few unknowns is linear.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext

    Returns
    -------
    Identification or None
        None where the problem is another one, a prior means more than rows say, or time is over.
    """
    problem = formulation.problem
    if problem.degree > 1 or problem.dimension > _FEW or not rows_say_all(formulation):
        return None
    work = partial(sp.linear_bounds, problem, objectives(formulation))
    found = context.kept("linear programs", work, None)
    return None if found is None else _read(formulation, context, tuple(found))


def _read(
    formulation: Formulation, context: BoundingContext, bounds: tuple[sp.LinearBound, ...]
) -> Identification:
    """Read the intervals off the exact bounds of all ends."""
    problem = formulation.problem
    if bounds[0].status is sp.Status.INFEASIBLE:
        rows = formulation.rows
        used = [number for number, _ in bounds[0].multipliers if number < len(rows.origin)]
        samples = {(int(rows.record[r]), int(rows.sample[r])) for r in used if rows.sample[r]}
        return context.empty(formulation, Outcome(bounds=bounds, samples=tuple(sorted(samples))))
    items = []
    for place, name in enumerate(formulation.parameters):
        low, high = bounds[2 * place], bounds[2 * place + 1]
        status = IntervalStatus.CERTIFIED
        if sp.Status.UNBOUNDED in (low.status, high.status):
            status = IntervalStatus.UNBOUNDED
        if low.status is high.status is sp.Status.UNBOUNDED and _is_line(problem, low):
            status = IntervalStatus.UNIDENTIFIABLE
        outer, inner = (low.lower, -high.lower), (low.upper, -high.upper)
        items.append(ParameterInterval(name, outer, inner, status, (low.x, high.x)))
    return context.result(formulation, items, Outcome(bounds=bounds))


def _is_line(problem: sp.Problem, bound: sp.LinearBound) -> bool:
    """Check that no row changes along the ray, so that the whole line is feasible."""
    if bound.ray is None:
        return False
    along = [i for i, step in enumerate(bound.ray) if step]
    if np.any(np.isfinite(problem.lower[along])) or np.any(np.isfinite(problem.upper[along])):
        return False
    for row in problem.constraints:
        polynomial = row.polynomial
        pairs = zip(polynomial.words[:, -1].tolist(), polynomial.coefficients, strict=True)
        if sum(Fraction(float(c)) * bound.ray[letter - 1] for letter, c in pairs if letter):
            return False
    return True


def at_linear_ends(
    formulation: Formulation, context: BoundingContext, outcome: Outcome
) -> Identification | None:
    """Attain all ends of the box where rows of data are linear.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    outcome : Outcome
        With the problem on the box.

    Returns
    -------
    Identification or None
        None where rows are not linear. It is open where points near the ends fail a prior.
    """
    ends = context.kept("points", partial(linear_ends, formulation), [])
    if not ends:
        return None
    scaled = in_units(stated_problem(outcome), formulation)
    attain = partial(_attained_at, formulation, scaled, ends)
    results = context.kept("points", attain, ())
    items = intervals_of(formulation, scaled, results, context.settings.tol)
    return context.result(formulation, items, replace(outcome, results=results))


def _attained_at(
    formulation: Formulation, scaled: InUnits, ends: Sequence[NDArray[np.float64]]
) -> tuple[sp.Result, ...]:
    """Prove points near some vectors, and claim them."""
    made, known = [], solved_rows(formulation, scaled.problem)
    for objective, x in zip(objectives(formulation), ends, strict=True):
        about = scaled.problem.with_objective(scaled.asked(objective)[0])
        point = proved_point(formulation, about, x / scaled.units, known)
        made.append(attained_result(about, point))
    return tuple(made)
