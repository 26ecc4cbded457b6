"""Say what is proved and what is attained where some parameters have no finite box.

Ends need a box to be proved, points do not: local searches in a wide box about an estimate reach
parameters that are consistent, and these are proved to be so.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.attained import best_results
from setid.bounding.context import BoundingContext
from setid.bounding.ends import intervals_of, with_unbounded
from setid.bounding.starts import first_points, points_at_ends
from setid.formulation.formulation import Formulation
from setid.formulation.units import InUnits, in_units
from setid.identifiability.common_factor import find_unbounded
from setid.proofs.uniqueness.free_parameters import free_parameters
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.result.assembling import (
    Outcome,
    free_text,
    simpler_text,
    stated_problem,
    unbounded_text,
)
from setid.result.identification import Identification

__all__ = ["NO_BOX", "STOPPED", "without_box"]

NO_BOX = "time ended in the search for a box from the data: give more time"
STOPPED = "interrupted in the search for a box from the data"
_ROOM = 4.0  # times an estimate, or 1: how far from it a search goes
_SHARE = 0.5  # of the time left, for a common factor, and then of what is left for searches


def without_box(
    formulation: Formulation, context: BoundingContext, outcome: Outcome, loose: NDArray[np.int64]
) -> Identification:
    """Say what is proved where some parameters have no finite box, and attain what is consistent.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    outcome : Outcome
        With the problem on the box.
    loose : (m,) int
        Places of these parameters.
    """
    free, alone = free_parameters(formulation)
    unbounded: Unbounded | None = None
    if not free:
        find = partial(find_unbounded, formulation, context.deadline.part(_SHARE).end)
        unbounded = context.kept("common factor", find, None)
    why: tuple[str, ...] = ()
    if unbounded is not None:
        why = simpler_text(unbounded)
    elif not {NO_BOX, STOPPED} & set(outcome.notes):  # more time may give a box
        why = (unbounded_text(formulation, loose),)
    notes = (*outcome.notes, *(free_text(free) or why))
    scaled, results = in_units(stated_problem(outcome), formulation), tuple[sp.Result, ...]()
    if unbounded is None and not free:
        results = _attained(formulation, stated_problem(outcome), scaled, context)
    items = intervals_of(formulation, scaled, results, context.settings.tol)
    items = [with_unbounded(item, unbounded, free, alone) for item in items]
    outcome = replace(outcome, notes=notes, unbounded=unbounded, results=results)
    return context.result(formulation, items, outcome)


def _attained(
    formulation: Formulation, problem: sp.Problem, scaled: InUnits, context: BoundingContext
) -> tuple[sp.Result, ...]:
    """Attain both ends of all parameters as far as searches come; nothing else is claimed."""
    start, points = first_points(formulation, problem, scaled, context)
    if start is None:
        return ()
    find = partial(_near_ends, formulation, problem, scaled, context, start)
    found = context.kept("points", find, [])
    return best_results(formulation, scaled, [*found, *points])


def _near_ends(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    context: BoundingContext,
    start: NDArray[np.float64],
) -> list[sp.ProvedPoint]:
    """Search for ends in a wide box about a start."""
    p = len(formulation.parameters)
    lower, upper = problem.lower.copy(), problem.upper.copy()
    room = _ROOM * np.maximum(np.abs(start[:p]), 1.0)
    lower[:p] = np.where(np.isfinite(lower[:p]), lower[:p], start[:p] - room)
    upper[:p] = np.where(np.isfinite(upper[:p]), upper[:p], start[:p] + room)
    near = sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)
    return points_at_ends(formulation, near, scaled, start, context.deadline.part(_SHARE))
