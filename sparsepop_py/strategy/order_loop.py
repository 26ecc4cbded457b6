"""Loop over relaxations for one objective, with local searches between them.

A round ends with a certificate and with candidate minimisers. When these improve the
attained value, the cutoff tightens the box and another round may gain. With effort "auto" and
a finite box the adaptive search of :mod:`sparsepop_py.strategy.adaptive` follows; without a
finite box, relaxation orders follow one another. The loop ends when the gap is closed, time is
over or nothing is left to try.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.gram_box import gram_box
from sparsepop_py.bounding.order_bound import (
    CertifiedBound,
    Model,
    better,
    bound_order,
    build_relaxations,
    closed_without_relaxation,
    lower_bound,
)
from sparsepop_py.bounding.unconstrained import good_enough, may_be_squares
from sparsepop_py.budget import EARLY, LimitReached, check, cpu_seconds
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.presolve.size_limits import LEAN, affordable
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.result import HistoryEntry
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.linear_tree import (
    LinearTreeResult,
    bound_by_box,
    by_linear_tree,
)
from sparsepop_py.strategy.search_state import (
    SearchState,
    further,
    history_entry,
    moment_candidates,
    state_of,
    unstarted_state,
    with_larger_bound,
)
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.strategy.without_box import (
    add_bound_without_box,
    add_exact_proof,
    add_unconstrained_bound,
    bound_by_exact_multipliers,
    bound_by_gram_matrices,
    falls_without_limit,
    is_restricted,
    is_untried_without_box,
    seconds_without_box,
)
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["run_adaptive", "run_orders"]


def run_orders(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    """Bound one objective by one relaxation order, or with effort "auto" by growing ones.

    Parameters
    ----------
    context : SolveContext
    candidates : list of (n,) float
        Nearly feasible vectors seen so far.
    shared : Model or None
        Box and relaxations that several objectives share, used in the first round; None: own ones.
    more_starts : iterator of (n,) float
        Starts of local searches for where the first relaxation leaves a gap.

    Returns
    -------
    SearchState
    """
    if finite(Interval(context.problem.lower, context.problem.upper)):
        state = _by_relaxations(context, candidates, shared, more_starts)
        tried = context.options.effort == "auto"  # by the adaptive search
        return state if tried or shared is not None else further(state, add_bound_without_box)
    if context.options.effort == "plain":  # the relaxation is asked for whatever it proves
        state = _by_relaxations(context, candidates, shared, more_starts)
        return further(state, add_exact_proof)
    exact = bound_by_exact_multipliers(context, candidates)
    if exact is None:
        state = _by_relaxations(context, candidates, shared, more_starts)
        already_tried = context.options.effort == "auto" or not is_restricted(context.problem)
        return state if already_tried else further(state, add_bound_without_box)
    proved = lower_bound(exact.outcome.certificate)
    if exact.context.closed(proved) or exact.context.deadline.over or falls_without_limit(exact):
        return exact

    def with_relaxations(exact: SearchState) -> SearchState:
        state = _by_relaxations(exact.context, exact.candidates, shared, more_starts)
        return with_larger_bound(state, exact)

    return further(exact, with_relaxations)


def _by_relaxations(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    """Bound the objective on the whole space and by relaxations, as far as each applies."""
    free = not is_restricted(context.problem)
    if free and shared is None and context.options.effort != "plain":
        return _after_unconstrained(
            context,
            candidates,
            more_starts,
            partial(_run_orders, shared=None, more_starts=more_starts),
        )
    run = _within_a_part if _may_need_squares(context) else _run_orders
    state = run(context, candidates, shared, more_starts)
    if context.options.effort == "presolve" and lower_bound(state.outcome.certificate) == -np.inf:
        state = further(state, add_unconstrained_bound)
        return further(state, partial(_on_gram_box, more_starts=more_starts))
    return state


def _may_need_squares(context: SolveContext) -> bool:
    """Check for an objective that a bound on the whole space may have to follow."""
    problem = context.problem
    if context.options.effort != "presolve" or context.deadline.unlimited:
        return False
    if finite(Interval(problem.lower, problem.upper)) or problem.objective.degree < 2:
        return False
    return may_be_squares(problem.objective)


def _within_a_part(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    """Solve relaxations in a part of the time, and keep what they found."""
    part = context.deadline.part(STRATEGY.share_before_squares)
    try:
        with part.kept():
            found = _run_orders(replace(context, deadline=part), candidates, shared, more_starts)
    except LimitReached:
        check()  # raises where all of the time is over
        found = unstarted_state(context, candidates)
    context.deadline.cut |= part.cut or part.over
    return replace(found, context=replace(found.context, deadline=context.deadline))


def _on_gram_box(state: SearchState, more_starts: Iterator[NDArray[Any]]) -> SearchState:
    """Solve relaxations on the box that an exact Gram matrix of the objective proves."""
    context, certificate = state.context, state.outcome.certificate
    gram = None if certificate is None else certificate.identity
    if not isinstance(gram, ExactGram) or context.closed(lower_bound(certificate)):
        return state
    with context.stages.stage("presolve"):
        found = gram_box(context, gram)
    if found is None or not finite(found[1]) or is_empty(found[1]) or context.deadline.over:
        return state
    model, objectives = Model(*found), (context.problem.objective,)
    if context.options.effort == "auto":
        shared_state = SharedState.of(context.problem, objectives, context.options)
        later = run_adaptive(
            AdaptiveSearch(context, model, state.candidates, shared_state, more_starts=more_starts)
        )
    else:
        with context.stages.stage("relax"):
            model = build_relaxations(context.problem, objectives, model, context.options)
        later = _orders(context, state.candidates, model, more_starts)
    outcome = better(state.outcome, later.outcome)
    return replace(later, outcome=outcome, history=state.history + later.history)


def _after_unconstrained(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    more_starts: Iterator[NDArray[Any]],
    go_on: Callable[[SolveContext, list[NDArray[Any]]], SearchState],
) -> SearchState:
    """Bound the objective on the whole space; continue where that is not enough."""
    free = bound_by_gram_matrices(context, candidates, more_starts)
    if free is None:
        return go_on(context, candidates)
    if (
        good_enough(free.context, lower_bound(free.outcome.certificate))
        or free.context.deadline.over
    ):
        return free
    on_box = partial(_on_gram_box, more_starts=more_starts)
    boxed = further(free, on_box) if context.options.effort == "auto" else free
    if boxed is not free or boxed.context.deadline.over:
        return boxed

    def joined(free: SearchState) -> SearchState:
        state = go_on(free.context, free.candidates)
        unproved = state.outcome.certificate is None
        outcome = better(free.outcome, state.outcome)
        state = replace(state, outcome=outcome, history=free.history + state.history)
        return further(state, on_box) if unproved else state

    return further(free, joined)


def _run_orders(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    if context.options.effort == "auto":
        found = by_linear_tree(context, candidates)
        if found.final:
            return _of_linear_tree(found)
        context, candidates = found.context, found.candidates
        with context.stages.stage("presolve"):
            replay = context.at_cutoff()
            proof, box = find_box(
                context.problem,
                context.best if replay.cutoff is not None else None,
                _timed(context),
                done=closed_without_relaxation(context) or context.deadline.over,
                cutoff=replay.cutoff,
            )
        if finite(box):
            found = bound_by_box(context, Model(proof, box), candidates)
            if found.final:
                return _of_linear_tree(found)
            shared_state = SharedState.of(
                context.problem, (context.problem.objective,), context.options
            )
            return run_adaptive(
                AdaptiveSearch(
                    context, Model(proof, box), candidates, shared_state, more_starts=more_starts
                )
            )
        if is_restricted(context.problem):
            orders = partial(_orders, shared=shared, more_starts=more_starts)
            return _after_unconstrained(context, candidates, iter(()), orders)
    return _orders(context, candidates, shared, more_starts)


def _of_linear_tree(found: LinearTreeResult) -> SearchState:
    """Return the state of a search that ended with a tree of linear programs."""
    assert found.outcome is not None
    return SearchState(
        found.context, found.outcome, found.candidates, found.history, known=found.known
    )


def run_adaptive(search: AdaptiveSearch) -> SearchState:
    """Run an adaptive search to its end and return its state."""
    try:
        if is_untried_without_box(search.context.problem):
            if search.next_seconds <= max(STRATEGY.long_first_seconds, seconds_without_box(search)):
                search.run(STRATEGY.steps_before_squares)
            if search.context.problem.degree > 2:
                # else a bound without a box costs less than points
                search.search_more_starts()
            if not search.over:
                state = add_bound_without_box(state_of(search))
                search.outcome, search.history = state.outcome, list(state.history)
                search.context = replace(search.context, best=state.context.best)
        search.run()
    except EARLY as cause:
        search.context.deadline.ended(cause)
    return state_of(search)


def _orders(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    """Solve one order, or with effort "auto" growing orders."""
    outcome: CertifiedBound | None = None
    history: list[HistoryEntry] = []
    own = shared is None
    for order in _order_numbers(context):
        start = cpu_seconds()
        options = replace(_timed(context), order=order)
        if options.effort == "auto" and outcome is None:
            options = replace(options, effort="presolve")  # the first order may step down
        try:
            step, bound, candidates = _rounds(
                replace(context, options=options), candidates, shared, more_starts
            )
        except EARLY as cause:
            context.deadline.ended(cause)
            if outcome is None:
                return unstarted_state(context, candidates)
            return SearchState(context, outcome, candidates, tuple(history))
        if outcome is not None and bound.relaxation is None:
            break  # this order would be too large
        outcome = better(outcome, bound)
        context = replace(context, best=step.best)
        history.append(history_entry(context, outcome, bound, cpu_seconds() - start))
        if context.closed(lower_bound(outcome.certificate)) or context.deadline.over:
            break
        if outcome.certificate is None and context.best is not None:
            if falling_ray(context.problem, context.best) is not None:
                break  # no order proves anything
        shared = None
    assert outcome is not None
    if own and context.options.effort != "auto":
        outcome, entries = _by_sparsepop_form(context, outcome)
        history += entries
        outcome = _by_lower_orders(context, outcome)
    return SearchState(context, outcome, candidates, tuple(history))


def _by_sparsepop_form(
    context: SolveContext, outcome: CertifiedBound
) -> tuple[CertifiedBound, list[HistoryEntry]]:
    """Solve the form of Waki et al. where only the lean one was small enough.

    Its bounds have multipliers of their own, but no products of bounds hold monomials of the full
    degree, so that its blocks are nearly as small as those of the lean form.
    """
    model, options, problem = outcome.model, context.options, context.problem
    if options.effort == "plain":
        return outcome, []
    lean = any(note.startswith(LEAN) for note in model.notes)
    if not lean or context.closed(lower_bound(outcome.certificate)) or context.deadline.over:
        return outcome, []
    start = cpu_seconds()
    order = None if options.order is None else float(options.order)
    options = replace(_timed(context), effort="plain", switches=Switches(order=order))
    try:
        with context.stages.stage("relax"):
            bare = Model(model.proof, model.box)
            sparsepop_form = build_relaxations(problem, (problem.objective,), bare, options)
        if not all(affordable(each, options.memory_limit) for each in sparsepop_form.relaxations):
            return outcome, []
        bound = bound_order(replace(context, options=options), sparsepop_form)
    except EARLY as cause:
        context.deadline.ended(cause)
        return outcome, []
    outcome = better(outcome, bound)
    return outcome, [history_entry(context, outcome, bound, cpu_seconds() - start)]


def _by_lower_orders(context: SolveContext, outcome: CertifiedBound) -> CertifiedBound:
    """Take a lower order's certificate where an order proves less, or nothing.

    Multipliers of a lower order are multipliers of the higher one. Without bounds on the variables
    the higher one may have no optimal ones of its own, and a solver finds none that prove what its
    value promises. The output of the solver stays that of the order that was asked for.
    """
    options, problem = context.options, context.problem
    least, asked = least_order(problem), options.order or 1
    boxed = finite(Interval(problem.lower, problem.upper))
    if boxed or outcome.relaxation is None or asked <= least or not _short(outcome):
        return outcome
    if options.effort != "plain" and lower_bound(outcome.certificate) > -np.inf:
        return outcome
    if context.best is not None and falling_ray(problem, context.best) is not None:
        return outcome  # no order proves anything
    best, taken = outcome.certificate, asked
    for order in range(asked - 1, least - 1, -1):
        if context.deadline.over:
            break
        switches = options.switches and replace(options.switches, order=order)
        lower = replace(_timed(context), order=order, switches=switches)
        try:
            bound = bound_order(replace(context, options=lower), None)
        except EARLY as cause:
            context.deadline.ended(cause)
            break
        if lower_bound(bound.certificate) > lower_bound(best):
            best, taken = bound.certificate, order
        if not _short(bound):
            break
    if taken == asked:
        return outcome
    note = f"order {asked} proves less by itself: the bound is that of order {taken}"
    model = replace(outcome.model, notes=(*outcome.model.notes, note))
    return replace(outcome, certificate=best, model=model)


def _short(bound: CertifiedBound) -> bool:
    """Check that a proved bound falls short of the solver's value by more than rounding."""
    proved = lower_bound(bound.certificate)
    return not proved > bound.value - 1e-3 * max(1.0, abs(bound.value))


def _timed(context: SolveContext) -> Options:
    """Limit the options to half of the time left: a box may take two solves."""
    left = context.deadline.left
    return replace(context.options, time_limit=None if left is None else 0.5 * left)


def _order_numbers(context: SolveContext) -> Iterator[int | None]:
    first = context.options.order
    if context.options.effort != "auto":
        yield first
        return
    first = max(first or 1, least_order(context.problem))
    yield from range(first, first + STRATEGY.more_orders + 1)


def _rounds(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> tuple[SolveContext, CertifiedBound, list[NDArray[Any]]]:
    """Repeat one order while the attained value improves."""
    outcome: CertifiedBound | None = None
    last: CertifiedBound | None = None
    try:
        for _ in range(1 if shared else STRATEGY.order_rounds):
            bound = bound_order(context, shared, last)
            if bound is last:
                break
            outcome, last = better(outcome, bound), bound
            proved, old = lower_bound(outcome.certificate), context.best
            context.report(proved)
            if context.closed(proved) and context.problem.dimension > STRATEGY.many_variables:
                break  # reading further minimisers out of the moments would take the longest
            context, more = update_incumbent(context, moment_candidates(bound), proved)
            candidates = candidates + more
            if not context.closed(proved) and not context.deadline.over:
                context, more = update_incumbent(context, list(more_starts), proved)
                candidates = candidates + more
            if context.closed(proved) or context.deadline.over or context.options.effort == "plain":
                break
            if context.best is old or not _worth_another(old, context.best, bound):
                break
    except EARLY as cause:
        if outcome is None:
            raise
        context.deadline.ended(cause)
    assert outcome is not None
    return context, outcome, candidates


def _worth_another(old: ProvedPoint | None, new: ProvedPoint | None, bound: CertifiedBound) -> bool:
    """Check that the attained value improved by a good part of the open gap."""
    if new is None:
        return False
    if old is None or bound.certificate is None:
        return True
    return old.value - new.value > 0.05 * (new.value - bound.certificate.bound)
