"""Bound parameters by the engine, all ends over one feasible set.

It minimises theta_i and -theta_i for all i over the problem on the box, in units, from points near
the ends where searches find some. It comes last: it closes what other methods leave open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.attained import best_point
from setid.bounding.context import BoundingContext
from setid.bounding.ends import intervals_of, with_unbounded
from setid.bounding.starts import first_points, starts_of_engine
from setid.feasible_points.search import coupled
from setid.feasible_points.start import Repair
from setid.formulation.formulation import Formulation, count_equations
from setid.formulation.units import InUnits, in_units
from setid.minimum_noise.conflicting_samples import conflicting_samples
from setid.proofs.intervals import IntervalStatus
from setid.proofs.parameter_box import objectives
from setid.proofs.uniqueness.free_parameters import free_parameters
from setid.result.assembling import (
    Outcome,
    signals_text,
    stated_problem,
)
from setid.result.identification import Identification
from setid.result.progress import Progress
from sparsepop_py.budget import Deadline, spent

__all__ = ["by_engine", "recheck_results"]

_SEARCH = 10.0  # units of work, and what the proof took, to find samples that contradict each other
_FITS = 0.25  # of the time left, for ends of long records by simulations
_LONG = 1000  # equations beyond which the engine solves no system at once


def by_engine(
    formulation: Formulation,
    context: BoundingContext,
    outcome: Outcome,
    loose: bool,
    points: Sequence[sp.ProvedPoint] = (),
    at_ends: bool = True,
) -> Identification:
    """Bound all parameters by the engine, in units: two ends each over one feasible set.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    outcome : Outcome
        With the problem on the box.
    loose : bool
        Whether some parameters have no finite box.
    points : sequence of sparsepop_py.ProvedPoint
        Points near the ends that are known.
    at_ends : bool
        Whether these are near all ends: the engine searches for none then.
    """
    scaled, begin = in_units(stated_problem(outcome), formulation), spent()
    free, alone = free_parameters(formulation) if loose else ((), None)
    results = context.timed(
        "engine",
        lambda: _solve(formulation, stated_problem(outcome), scaled, context, points, at_ends),
    )
    if any(found.status is sp.Status.INTERRUPTED for found in results):
        context.deadline.stop()
    notes = dict.fromkeys([*outcome.notes, *(note for found in results for note in found.notes)])
    for found in results:
        for stage, seconds in found.timings.items():
            key = f"engine: {stage}"
            context.timings[key] = context.timings.get(key, 0.0) + seconds
    outcome = replace(outcome, results=results, notes=tuple(notes))
    if any(r.status is sp.Status.INFEASIBLE for r in results):
        most = _SEARCH + spent() - begin if context.until == inf else inf
        deadline = Deadline.before(context.until, most)
        options = context.settings.for_engine("absolute")
        keys = context.timed(
            "conflicting samples", lambda: conflicting_samples(formulation, options, deadline)
        )
        return context.empty(formulation, replace(outcome, samples=keys))
    items = intervals_of(formulation, scaled, results, context.settings.tol)
    items = [with_unbounded(item, None, free, alone) for item in items]
    if any(item.status is IntervalStatus.PARTIAL for item in items):
        why = signals_text(formulation, stated_problem(outcome))
        outcome = replace(outcome, notes=(*outcome.notes, *why))
    return context.result(formulation, items, outcome)


def _solve(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    context: BoundingContext,
    known: Sequence[sp.ProvedPoint],
    at_ends: bool,
) -> tuple[sp.Result, ...]:
    """Bound and attain all ends over one feasible set, in units."""
    settings = context.settings
    units = scaled.units[: len(formulation.parameters)].tolist()
    progress = Progress(
        formulation.parameters, settings.tol, settings.progress, units, context.on_progress
    )
    branch_on = range(len(formulation.parameters)) if coupled(formulation) else None
    start: NDArray[np.float64] | None
    if known:
        start, points = known[0].x * scaled.units, list(known)
    else:
        fits = context.deadline.part(_FITS)
        start, points = first_points(formulation, problem, scaled, context)
        at_ends = False
        if start is not None:
            find = partial(starts_of_engine, formulation, problem, scaled, start, fits)
            found, at_ends = context.kept("start", find, ([], False))
            points = [*found, *points]
    engine = settings.for_engine(until=context.deadline.wall_end)
    if context.deadline.cpu_left is not None:
        engine = replace(engine, cpu_limit=context.deadline.cpu_left)
    at_ends = at_ends or coupled(formulation) or count_equations(formulation) > _LONG
    engine = replace(engine, refine="none") if points and at_ends else engine
    try:
        found = sp.solve_each(
            scaled.problem,
            [scaled.asked(objective)[0] for objective in objectives(formulation)],
            engine,
            start=None if start is None else start / scaled.units,
            repair=Repair(formulation, problem, scaled.units),
            points=points,
            branch_on=branch_on,
            on_progress=progress.report,
        )
        return recheck_results(scaled.problem, _attained(found, points)) if points else tuple(found)
    finally:
        progress.close()


def recheck_results(problem: sp.Problem, results: Sequence[sp.Result]) -> tuple[sp.Result, ...]:
    """Verify certificates again, and return results with what they prove then.

    Trees are made at several cutoffs and verified at the last of them: should rounding make a box
    larger than its argument allows, that part keeps what its box proves, here and not at the
    user's.
    """
    known: dict[int, Any] = {}
    return tuple(_rechecked(problem, found, known) for found in results)


def _rechecked(problem: sp.Problem, found: sp.Result, known: dict[int, Any]) -> sp.Result:
    proof = found.certificate
    if proof is None:
        return found
    about = problem.with_objective(found.problem.objective)
    verdict = proof.verify(about, known)
    if verdict.ok:
        return found
    weaker, bounded = replace(proof, bound=verdict.bound), sp.Status.BOUNDED
    if np.isfinite(verdict.bound) and weaker.verify(about, known).ok:
        return replace(found, certificate=weaker, lower_bound=verdict.bound, status=bounded)
    return replace(found, certificate=None, lower_bound=-inf, status=sp.Status.UNPROVED)


def _attained(results: Sequence[sp.Result], points: Sequence[sp.ProvedPoint]) -> list[sp.Result]:
    """Claim the best of known points where time ended before one was adopted."""
    made: list[sp.Result] = []
    for found in results:
        if found.attained is None and found.status is not sp.Status.INFEASIBLE:
            best = best_point(points, found.problem)
            found = replace(found, attained=best, x=best.x, upper_bound=best.value)
        made.append(found)
    return made
