"""Bound one objective without a box of the variables.

Such bounds are rational multipliers of convex quadratic problems, and Gram matrices of objectives
that may be sums of squares. They know none of the sizes that wide bounds give to powers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.exact_convex import exact_convex_bound, falling_direction
from sparsepop_py.bounding.order_bound import CertifiedBound, better, lower_bound
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.bounding.unconstrained import may_be_squares, unconstrained_bound
from sparsepop_py.budget import EARLY, cpu_seconds
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.local_search.solvers import local_search
from sparsepop_py.presolve.initial_box import finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.solvers import least_seconds
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.search_state import (
    SearchState,
    history_entry,
    moment_candidates,
    unstarted_state,
    with_larger_bound,
)
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = [
    "add_bound_without_box",
    "add_exact_proof",
    "add_unconstrained_bound",
    "bound_by_exact_multipliers",
    "bound_by_gram_matrices",
    "falls_without_limit",
    "is_restricted",
    "is_untried_without_box",
    "seconds_without_box",
]


def add_bound_without_box(state: SearchState) -> SearchState:
    """Add a bound without a box, where a gap is left on one."""
    context, f = state.context, state.context.problem.objective
    if context.deadline.over or context.closed(lower_bound(state.outcome.certificate)):
        return state
    if context.problem.degree <= 2:
        return with_larger_bound(state, bound_by_exact_multipliers(context, state.candidates))
    if f.degree < 4 or not may_be_squares(f):
        return state
    options = replace(context.options, effort="presolve", order=None, switches=None)
    found = bound_by_gram_matrices(replace(context, options=options), state.candidates, iter(()))
    return with_larger_bound(state, found)


def add_unconstrained_bound(state: SearchState) -> SearchState:
    """Add a bound of the objective on the whole space where a relaxation proved nothing."""
    free = bound_by_gram_matrices(state.context, state.candidates, iter(()))
    if free is None:
        return state
    outcome = better(free.outcome, state.outcome)  # with the output of the relaxation
    history, notes = state.history + free.history, state.notes + free.notes
    return replace(free, outcome=outcome, history=history, notes=notes)


def add_exact_proof(state: SearchState) -> SearchState:
    """Prove what a plain relaxation has by exact arguments, where its own proof loses much."""
    if _keeps_its_value(state):
        return state
    state = with_larger_bound(state, bound_by_exact_multipliers(state.context, state.candidates))
    if _keeps_its_value(state) or state.context.deadline.over:
        return state
    options = replace(state.context.options, effort="presolve", switches=None)
    context = replace(state.context, options=options)
    return with_larger_bound(state, bound_by_gram_matrices(context, state.candidates, iter(())))


def _keeps_its_value(state: SearchState) -> bool:
    """Check that the bound is the attained value, or nearly that of the relaxation."""
    bound, value = lower_bound(state.outcome.certificate), state.outcome.value
    near = value - bound <= BOUNDING.lost * (1.0 + abs(value))
    return bool(near) or state.context.closed(bound)


def bound_by_exact_multipliers(
    context: SolveContext, candidates: list[NDArray[Any]]
) -> SearchState | None:
    """Bound a convex quadratic objective over a polyhedron by rational multipliers."""
    start = cpu_seconds()
    try:
        found = exact_convex_bound(context)
    except EARLY as cause:
        context.deadline.ended(cause)
        return unstarted_state(context, candidates)
    if found is None:
        return None
    bound, starts = found
    proved = lower_bound(bound.certificate)
    try:
        if not context.closed(proved):
            context, more = update_incumbent(context, starts, proved)
            candidates = candidates + more
    except EARLY as cause:
        context.deadline.ended(cause)
    entry = history_entry(context, bound, bound, cpu_seconds() - start)
    return SearchState(context, bound, candidates, (replace(entry, name="exact multipliers"),))


def falls_without_limit(state: SearchState) -> bool:
    """Check whether the objective provably falls without limit, so that no order proves any."""
    best, problem = state.context.best, state.context.problem
    if best is None or lower_bound(state.outcome.certificate) > -np.inf:
        return False
    direction = falling_direction(problem)
    return direction is not None and falling_ray(problem, best, direction) is not None


def bound_by_gram_matrices(
    context: SolveContext, candidates: list[NDArray[Any]], more_starts: Iterator[NDArray[Any]]
) -> SearchState | None:
    """Bound the objective by Gram matrices without a box, searching points between rounds."""
    start, bound = cpu_seconds(), None

    def search(expected: float, found: CertifiedBound | None) -> SolveContext:
        nonlocal context, candidates
        starts = more_starts if found is None else moment_candidates(found)
        context, more = update_incumbent(context, starts, expected)
        candidates = candidates + more
        return context

    try:
        while True:
            found = unconstrained_bound(context, search)
            if found is None:
                return None
            bound, old = better(bound, found), context.best
            context = _searched_about_the_origin(context, bound)
            proved = lower_bound(bound.certificate)
            for starts in (moment_candidates(bound), more_starts):
                if not context.closed(proved):
                    context, more = update_incumbent(context, starts, proved)
                    candidates = candidates + more
            if context.best is old or context.closed(proved) or context.deadline.over:
                break
    except EARLY as cause:
        context.deadline.ended(cause)
        if bound is None:
            return unstarted_state(context, candidates)
    entry = history_entry(context, bound, bound, cpu_seconds() - start)
    return SearchState(context, bound, candidates, (entry,))


def _searched_about_the_origin(context: SolveContext, bound: CertifiedBound) -> SolveContext:
    """Search once more where the origin was moved: terms that cancel hide values otherwise."""
    scaled = bound.model.scaled
    if scaled is None or not scaled.scaling.translated or context.options.refine == "none":
        return context
    if context.closed(lower_bound(bound.certificate)):
        return context
    with context.stages.stage("refine"):
        start = np.zeros(context.problem.dimension)
        end = local_search(scaled.problem, start, None, context.deadline.end)
        proved = prove_feasible(context.problem, scaled.scaling.point(end))
    if proved is not None and proved.value < context.upper:
        context = replace(context, best=proved)
    return context


def is_untried_without_box(problem: Problem) -> bool:
    """Check that a bound without a box has not been tried yet.

    Free objectives, and convex ones without a finite box, begin with it.
    """
    if finite(Interval(problem.lower, problem.upper)):
        return True
    return problem.degree > 2 and is_restricted(problem)


def seconds_without_box(search: AdaptiveSearch) -> float:
    """Estimate the least seconds of an exact Gram matrix of all variables.

    Its monomials are 1 and those whose squares occur. With several cliques blocks are small: 0.
    """
    if search.shared_state.cliques["constraints"].sizes.size > 1:
        return 0.0
    words = np.sort(search.context.problem.objective.words, axis=1)[:, ::-1]
    paired = words[:, 0::2][:, : words.shape[1] // 2] == words[:, 1::2]
    return least_seconds([1 + int((paired.all(axis=1) & words.any(axis=1)).sum())])


def is_restricted(problem: Problem) -> bool:
    """Check for constraints or bounds."""
    bounded = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    return bool(problem.constraints) or bool(bounded.any())
