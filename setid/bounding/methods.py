"""Choose the methods that bound all parameters of a problem.

    linear in few unknowns            exact linear programs                  linear.py
    else: a box from the data, then
      cascades, long noisy outputs    simulations, cones of denominators     simulations.py
      linear rows beside a prior      linear programs, points at their ends  linear.py
      all else, and what stays open   the engine, all ends over one set      engine.py

The box of the parameters comes from the data alone and is part of the proof.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

import sparsepop_py as sp
from setid.bounding.context import BoundingContext
from setid.bounding.driven_rows import by_driven_rows
from setid.bounding.ends import is_closed, is_open
from setid.bounding.engine import by_engine
from setid.bounding.linear import at_linear_ends, by_linear_programs
from setid.bounding.long_records import long_record
from setid.bounding.simulations import by_simulation
from setid.bounding.without_box import NO_BOX, STOPPED, without_box
from setid.data.checks import FrozenMapping
from setid.feasible_points.cascades import (
    cascade_of,
    is_cascade,
)
from setid.feasible_points.start import consistent_apart
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation, formulate, lifted, without_partial_outputs
from setid.minimum_noise.cones.feasible_box import settles
from setid.minimum_noise.conflicting_samples import conflicting_rows, conflicting_samples
from setid.models.block import BlockStructured
from setid.priors.base import Prior
from setid.priors.checked_priors import unknowns_of
from setid.proofs.intervals import IntervalStatus
from setid.proofs.parameter_box import ProvedBox, problem_on_box
from setid.result.assembling import Outcome, stated_problem
from setid.result.identification import Identification
from setid.result.reports import NOT_CLAIMED
from sparsepop_py.budget import Deadline

__all__ = ["bound_parameters"]

_DIRECT = (
    "partial outputs have no bounds from the data: the denominators are multiplied out, which "
    "keeps every consistent parameter vector (and may keep more)"
)
_NOT_AT_REST = (
    "with an offset the first samples of a system at rest say nothing of products of "
    f"denominators: {NOT_CLAIMED}"
)
_SHARE = 0.7  # of the time, for the problem with all priors, where fewer make an easier one
_FIT = 0.5  # of the time, for consistent parameters of several denominators
_BOX = 0.8  # of the time left, for a box where such are known: ends are searched from them
_SEARCH = 10.0  # seconds, or units of work, to find samples that contradict each other


def bound_parameters(formulation: Formulation, context: BoundingContext) -> Identification:
    """Bound all parameters; what stays open is also bounded without priors that cost bounds.

    Such a prior adds unknowns or products of parameters. That makes a larger problem, or one of
    another kind, whose bounds can be weaker when time or work runs out. What is proved without it
    holds with it. Cones of denominators do not see what such a prior adds.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    """
    context = replace(context, known=_known(formulation, context))
    kept = _linear_priors(formulation)
    by_cones = long_record(formulation) is not None and settles(formulation)
    if len(kept) == len(formulation.priors) or by_cones:
        return _by_methods(formulation, context)
    first = replace(context, deadline=context.deadline.part(_SHARE))
    found = _by_methods(formulation, first)
    if is_closed(found) or first.deadline.stopped:
        return found
    # of the form that `found` speaks of: denominators may be multiplied out there
    model = found.formulation.model
    fewer = formulate(formulation.data, model, formulation.noise, kept)
    return _intersect(found, _by_methods(fewer, context), context.settings.tol)


def _known(formulation: Formulation, context: BoundingContext) -> Mapping[str, float] | None:
    """Search consistent parameters of several denominators, whose boxes take all time there is.

    Where no time is given, the box comes first: searches that begin in it take less.
    """
    if context.deadline.unlimited:
        return None
    direct, until = without_partial_outputs(formulation), context.deadline.part(_FIT).end
    if direct.model.initial != formulation.model.initial:
        return None  # nothing attained is claimed there
    found: Mapping[str, float] | None = context.kept(
        "known point", partial(consistent_apart, direct, until), None
    )
    return found


def _linear_priors(formulation: Formulation) -> list[Prior]:
    """List the priors that add no unknowns and linear rows alone, whatever priors are left out."""
    kept: list[Prior] = []
    while True:
        rows, constraints = formulation.rows, formulation.problem.constraints
        priors = list(enumerate(formulation.priors))
        kept = [
            prior
            for place, prior in priors
            if not unknowns_of(prior, formulation.model)
            and all(constraints[row].polynomial.degree <= 1 for row in rows.of_prior(place))
        ]
        if not kept or len(kept) == len(priors):
            return kept
        # rows may rest on a prior that is left out, as a static gain's on stability
        formulation = formulate(formulation.data, formulation.model, formulation.noise, kept)
        if len(formulation.priors) == len(priors):  # what the structure itself asks for
            return kept


def _by_methods(formulation: Formulation, context: BoundingContext) -> Identification:
    """Bound all parameters of one formulation."""
    exact = by_linear_programs(formulation, context)
    if exact is not None:
        return exact
    direct = without_partial_outputs(formulation)
    if direct is formulation:
        return _on_box(formulation, context, ())
    if direct.model.initial == formulation.model.initial:
        return _on_box(direct, context, (_DIRECT,))
    return _without_attained(_on_box(direct, context, (_DIRECT, _NOT_AT_REST)))


def _without_attained(found: Identification) -> Identification:
    """Claim outer ends alone: what is attained need not belong to the structure that was given."""
    items = {
        name: item
        if item.status is IntervalStatus.EMPTY
        else replace(item, inner=None, witnesses=(None, None), status=IntervalStatus.PARTIAL)
        for name, item in found.intervals.items()
    }
    return replace(found, intervals=FrozenMapping(items))


def _intersect(found: Identification, other: Identification, tol: float) -> Identification:
    """Intersect the intervals of a result with those of a result with fewer priors."""
    if other.empty:
        items = {
            name: replace(
                item,
                outer=(inf, -inf),
                inner=None,
                witnesses=(None, None),
                status=IntervalStatus.EMPTY,
            )
            for name, item in found.intervals.items()
        }
        return replace(found, intervals=FrozenMapping(items), fewer_priors=other)
    items = {}
    for name, item in found.intervals.items():
        low, high = other.intervals[name].outer
        within = replace(item, outer=(max(low, item.outer[0]), min(high, item.outer[1])))
        closed = is_open(item) and (within.gap <= tol * (1.0 + 1e-9))
        items[name] = replace(within, status=IntervalStatus.CERTIFIED) if closed else within
    if all(items[name].outer == item.outer for name, item in found.intervals.items()):
        return found
    note = "some ends are proved without the priors that add unknowns or products, in less time"
    return replace(
        found, intervals=FrozenMapping(items), fewer_priors=other, notes=(*found.notes, note)
    )


def _on_box(
    formulation: Formulation, context: BoundingContext, notes: tuple[str, ...]
) -> Identification:
    """Find a box from the data, then bound the parameters on it."""
    late, until = object(), context.until
    within = until if context.known is None else context.deadline.part(_BOX).end
    box = context.kept("box", lambda: find_box(formulation, within), late)
    over = time.monotonic() >= within
    if box is late:
        box, notes = None, (*notes, STOPPED if context.deadline.stopped else NO_BOX)
    if box is not None and box.empty:
        found = conflicting_rows(formulation, box)
        search = Deadline.before(until, _SEARCH)
        keys = found or conflicting_samples(formulation, None, search)
        return context.empty(formulation, Outcome(box=box, samples=keys, notes=notes))
    if box is not None and (box.cut_short or (over and _is_loose(box))):
        notes = (*notes, STOPPED if context.deadline.stopped else NO_BOX)
    recursion, settled = cascade_of(formulation, box) or long_record(formulation), None
    if recursion is not None:
        settled = by_simulation(formulation, context, recursion, box, notes)
    if settled is not None and (is_cascade(formulation) or is_closed(settled)):
        return settled
    points: list[sp.ProvedPoint] = []
    if settled is not None:
        box = settled.evidence.box
        points = [end.attained for end in settled.evidence.ends if end.attained is not None]
    problem = problem_on_box(formulation, box)
    outcome = Outcome(problem=problem, box=box, notes=notes)
    at_ends = None if settled is not None else at_linear_ends(formulation, context, outcome)
    if at_ends is not None and is_closed(at_ends):
        return at_ends
    bilinear = formulation if settled is not None else lifted(formulation)
    if bilinear is not formulation:
        formulation = bilinear
        outcome = replace(outcome, problem=problem_on_box(formulation, box))
    return _on_loose_box(formulation, context, outcome, points)


def _is_loose(box: ProvedBox) -> bool:
    return bool(np.any(np.isinf(box.lower)) or np.any(np.isinf(box.upper)))


def _on_loose_box(
    formulation: Formulation,
    context: BoundingContext,
    outcome: Outcome,
    points: list[sp.ProvedPoint],
) -> Identification:
    """Bound the parameters on a box that may be infinite in some."""
    problem, p = stated_problem(outcome), len(formulation.parameters)
    loose = np.flatnonzero(np.isinf(problem.lower[:p]) | np.isinf(problem.upper[:p]))
    found = None
    if loose.size and outcome.box is not None:
        found = by_driven_rows(formulation, context, outcome, loose, _on_box)
    if found is not None:
        return found
    if loose.size and (outcome.box is not None or isinstance(formulation.model, BlockStructured)):
        return without_box(formulation, context, outcome, loose)
    return by_engine(formulation, context, outcome, bool(loose.size), points)
