"""Bound parameters by simulations over regions, and by cones of denominators.

Fits attain ends of the parameters. Then regions of parameters are tightened by what simulations say
of the readings, and split, and cones of denominators are refuted, until the box is near these ends.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import partial
from math import inf

import numpy as np

import sparsepop_py as sp
from setid.bounding.attained import attained_result
from setid.bounding.context import BoundingContext
from setid.bounding.ends import intervals_of, is_open, report_ends
from setid.feasible_points.cascades import (
    SimulatedEnds,
    box_near_ends,
    is_cascade,
    on_box,
    point_of,
    simulated_ends,
)
from setid.formulation.formulation import Formulation, count_equations
from setid.formulation.units import in_units
from setid.minimum_noise.cones.feasible_box import denominator_box
from setid.proofs.denominators.output_rows import output_rows
from setid.proofs.existence import proved_point, solved_rows
from setid.proofs.parameter_box import ProvedBox, objectives, problem_on_box
from setid.proofs.row_boxes import RowBox
from setid.proofs.simulated.outputs import Recursion
from setid.result.assembling import Outcome
from setid.result.identification import Identification
from sparsepop_py.budget import EARLY, Deadline

__all__ = ["by_simulation"]

_CASCADE_FITS = 0.25  # of the time left, for fits of a cascade from many starts
_RECORD_FIT = 0.6  # of the time left, for the fit of a long record from one start
_POINT_RESERVE = 1.5  # times what the proof of one point took: what is kept for each
_OUT_OF_TIME = "time ended before all regions of the parameters were small: give more time"
_LEAST_TIME = 1e-3  # of the time, and seconds: what is given when the time is over
_MOST_REGIONS = 2000  # regions that are split at most
_MANY_EQUATIONS = 1000  # equations beyond which regions are split before the engine is asked
_NEAR_ENDS = 0.01  # attained widths that the first region of a long record may reach beyond
_CONES_SHARE = 0.9  # of the time, for cones of denominators
_WIDE_BOX = 150.0  # attained widths: from a box this wide on cones are faster than the engine
_CONES_TOL = 0.7  # of the tolerance: what cones may leave beyond attained ends


def by_simulation(
    formulation: Formulation,
    context: BoundingContext,
    recursion: Recursion,
    box: ProvedBox | None,
    notes: tuple[str, ...],
) -> Identification | None:
    """Bound all parameters by simulations over regions.

    Regions are split where the engine has no better way: for cascades, and for long records whose
    first region is near the attained ends.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    recursion : Recursion
        The record as a simulation.
    box : ProvedBox or None
        Of the data.
    notes : tuple of str

    Returns
    -------
    Identification or None
        None where no box to begin with is finite.
    """
    fits = context.deadline.part(_CASCADE_FITS if is_cascade(formulation) else _RECORD_FIT)
    found = context.kept("start", lambda: simulated_ends(formulation, recursion, box, fits), None)
    if found is None:
        return None
    begin, number = time.monotonic(), 2 * len(formulation.parameters)
    context.timed("points", lambda: _attained_ends(formulation, box, found, [0], context.deadline))
    reserve = _POINT_RESERVE * number * (time.monotonic() - begin)  # points on the final box
    share = 1.0
    if context.until < inf:
        share = max(_LEAST_TIME, 1.0 - reserve / max(context.left, _LEAST_TIME))
    many = is_cascade(formulation) or count_equations(formulation) > _MANY_EQUATIONS
    splits = _MOST_REGIONS if many else 0
    near = inf if is_cascade(formulation) else _NEAR_ENDS
    deadline, tol = context.deadline.part(share), context.settings.tol
    tighten = partial(box_near_ends, found, box, tol, deadline, splits, near)
    tightened: ProvedBox | None = context.kept("cells", tighten, None)
    left = found.ends and (tightened is None or tightened.cut_short)
    if (
        not is_cascade(formulation)
        and left
        and not _engine_is_faster(formulation, found, tightened or box)
    ):
        part = deadline.part(_CONES_SHARE)
        cones = partial(_by_denominators, formulation, context, found, box, part)
        tightened = context.kept("cones", cones, None) or tightened
    if tightened is not None and tightened.empty:
        return context.empty(formulation, Outcome(box=tightened, notes=notes))
    cut_short = tightened is None or tightened.cut_short
    box = box if tightened is None else tightened
    problem = problem_on_box(formulation, box)
    every = range(number)
    results = context.timed(
        "points", lambda: _attained_ends(formulation, box, found, every, context.deadline)
    )
    items = intervals_of(formulation, in_units(problem, formulation), results, context.settings.tol)
    context.kept("report", lambda: report_ends(formulation, context, items), None)
    if cut_short and any(map(is_open, items)) and not context.deadline.stopped:
        notes = (*notes, _OUT_OF_TIME)
    return context.result(
        formulation, items, Outcome(problem=problem, box=box, results=results, notes=notes)
    )


def _engine_is_faster(
    formulation: Formulation, found: SimulatedEnds, box: ProvedBox | None
) -> bool:
    """Check that cones take longer: on short records of low order whose box is not very wide."""
    if box is None or count_equations(formulation) > _MANY_EQUATIONS:
        return False
    points = np.array(found.ends)[:, : len(formulation.parameters)]
    if np.any(box.upper - box.lower > _WIDE_BOX * (points.max(axis=0) - points.min(axis=0))):
        return False
    every = (output_rows(formulation, output) for output in range(formulation.model.outputs))
    return all(rows is not None and rows.order < 3 and not rows.stable for rows in every)


def _by_denominators(
    formulation: Formulation,
    context: BoundingContext,
    found: SimulatedEnds,
    box: ProvedBox | None,
    deadline: Deadline,
) -> ProvedBox | None:
    """Bound by cones of denominators, then by one region where gains had no time."""
    if not isinstance(box, RowBox | None):
        return None
    points = np.array(found.ends)[:, : len(formulation.parameters)]
    attained, tol = (points.min(axis=0), points.max(axis=0)), _CONES_TOL * context.settings.tol
    executor = context.settings.for_engine().executor
    cones = denominator_box(formulation, box, attained, tol, deadline, executor)
    if cones is None or cones.empty or not cones.cut_short:
        return cones
    return box_near_ends(on_box(found, cones), cones, tol, context.deadline, 0) or cones


def _attained_ends(
    formulation: Formulation,
    box: ProvedBox | None,
    found: SimulatedEnds,
    ends: Iterable[int],
    deadline: Deadline,
) -> tuple[sp.Result, ...]:
    """Prove the points at which simulations reach ends; nothing else is claimed of them.

    When time is over only the first is proved.
    """
    scaled, asked = in_units(problem_on_box(formulation, box), formulation), objectives(formulation)
    known, made = solved_rows(formulation, scaled.problem), list[sp.Result]()
    for number in ends:
        about, point = scaled.problem.with_objective(scaled.asked(asked[number])[0]), None
        if found.ends and not (made and deadline.over):
            x = point_of(formulation, found.fitting, found.ends[number])
            try:
                point = proved_point(formulation, about, x / scaled.units, known)
            except EARLY as cause:
                deadline.ended(cause)
        made.append(attained_result(about, point))
    return tuple(made)
