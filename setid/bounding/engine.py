"""Bound parameters by the engine, all ends over one feasible set.

It minimises theta_i and -theta_i for all i over the problem on the box, in units, from points near
the ends where searches find some. It comes last: it closes what other methods leave open.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
from setid.bounding.long_records import is_long
from setid.feasible_points.search import coupled, search_ends
from setid.feasible_points.start import Repair, first_point
from setid.feasible_points.sums import ends_of_long_record
from setid.formulation.completion import place_slack
from setid.formulation.formulation import Formulation, count_equations, multiplied_out
from setid.formulation.lifting import LIFTED
from setid.formulation.units import InUnits, in_units
from setid.minimum_noise.conflicting_samples import conflicting_samples
from setid.proofs.existence import proved_point, solved_rows
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
from sparsepop_py.budget import EARLY, Deadline, spent

__all__ = ["by_engine", "first_points", "points_at_ends", "recheck_results"]

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
        deadline, options = (
            Deadline.before(context.until, most),
            context.settings.for_engine("absolute"),
        )
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
            find = partial(_ends, formulation, problem, scaled, start, fits)
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
    """Results that claim the best of known points where time ended before one was adopted."""
    made: list[sp.Result] = []
    for found in results:
        if found.attained is None and found.status is not sp.Status.INFEASIBLE:
            best = best_point(points, found.problem)
            found = replace(found, attained=best, upper_bound=best.value)
        made.append(found)
    return made


def first_points(
    formulation: Formulation, problem: sp.Problem, scaled: InUnits, context: BoundingContext
) -> tuple[NDArray[np.float64] | None, list[sp.ProvedPoint]]:
    """Find a nearly feasible vector, proved where a point was known before all stages.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a box of the parameters.
    scaled : InUnits
        The problem that a point is proved to be consistent with.
    context : BoundingContext
    """
    find = partial(first_point, formulation, problem, context.known)
    if context.known is None:
        return context.kept("start", find, None), []
    if context.deadline.stopped:
        return None, []
    try:  # late too: there is a proof already, of a problem without this box and these units
        start = context.timed("start", find)
        return start, [] if start is None else _proved(
            formulation, scaled, [start], context.deadline
        )
    except EARLY as cause:
        context.deadline.ended(cause)
        return None, []


def _ends(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    start: NDArray[np.float64],
    deadline: Deadline,
) -> tuple[list[sp.ProvedPoint], bool]:
    """Find proved points where the engine would find none, and say whether all ends have some.

    Those are ends where rows couple samples or long records have sums of products, and any point
    of another long record, whose equations are solved one after the other for their newest samples.
    """
    long, found = is_long(formulation), list[NDArray[np.float64]]()
    if coupled(formulation):
        found = [end.x for end in search_ends(formulation, problem, start)]
    elif long and formulation.sums:
        found = ends_of_long_record(formulation, problem, start, deadline)
    at_ends = long and bool(found)
    if not found and _many_sums(formulation) and not coupled(formulation):
        found = _ends_without_sums(formulation, problem, start)
    if not found and long:
        found = [start]
    return _proved(formulation, scaled, found, deadline), at_ends


def points_at_ends(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    start: NDArray[np.float64],
    deadline: Deadline,
) -> list[sp.ProvedPoint]:
    """Search for the ends of all parameters, and prove the points that are found.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a finite box of the parameters, where to search.
    scaled : InUnits
        The problem that the points are proved to be consistent with.
    start : (n,) float
        A nearly feasible vector.
    deadline : Deadline
    """
    if is_long(formulation) and not coupled(formulation):
        found = ends_of_long_record(formulation, problem, start, deadline)
    elif _many_sums(formulation) and not coupled(formulation):
        found = _ends_without_sums(formulation, problem, start)
    else:
        found = [end.x for end in search_ends(formulation, problem, start)]
    return _proved(formulation, scaled, found, deadline)


def _proved(
    formulation: Formulation,
    scaled: InUnits,
    found: Iterable[NDArray[np.float64]],
    deadline: Deadline,
) -> list[sp.ProvedPoint]:
    """Keep the vectors that are proved to be consistent in time, as points in units."""
    known, points = solved_rows(formulation, scaled.problem), list[sp.ProvedPoint]()
    try:
        for x in found:
            point = proved_point(formulation, scaled.problem, x / scaled.units, known)
            points += [] if point is None else [point]
    except EARLY as cause:
        if not points:
            raise
        deadline.ended(cause)
    return points


def _many_sums(formulation: Formulation) -> bool:
    """Check for sums of three products or more: local searches that hold their unknowns creep."""
    numbers, rows = formulation.layout.group(LIFTED), formulation.problem.constraints
    pairs = zip(numbers.tolist(), rows, strict=False)
    return any(row.polynomial.terms > 3 for _, row in pairs)


def _ends_without_sums(
    formulation: Formulation, problem: sp.Problem, start: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Search for ends where the sums are no unknowns, and add these."""
    plain = multiplied_out(formulation)
    n, p = plain.layout.dimension, len(plain.parameters)
    lower, upper = plain.problem.lower.copy(), plain.problem.upper.copy()
    lower[:p], upper[:p] = problem.lower[:p], problem.upper[:p]
    about = sp.Problem(plain.problem.objective, plain.problem.constraints, lower, upper)
    found = []
    for end in search_ends(plain, about, start[:n]):
        x = np.append(end.x, np.zeros(formulation.layout.group(LIFTED).size))
        place_slack(x, formulation, x[:p])
        found.append(x)
    return found
