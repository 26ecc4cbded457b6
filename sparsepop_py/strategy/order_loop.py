"""Loop over relaxations for one objective, with local searches between them.

A round ends with a certificate and with candidate minimisers. When these improve the
attained value, the cutoff tightens the box and another round may gain. With effort "auto" and
a finite box the adaptive search of :mod:`sparsepop_py.strategy.adaptive` follows; without a
finite box, relaxation orders follow one another. The loop ends when the gap is closed, time is
over or nothing is left to try.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.exact_convex import exact_convex_bound, falling_direction
from sparsepop_py.bounding.gram_box import gram_box
from sparsepop_py.bounding.relaxation_bound import (
    BoxBound,
    CertifiedBound,
    Model,
    better,
    bound_order,
    build_relaxations,
    certified_bound,
    closed_without_relaxation,
    lower_bound,
)
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.bounding.unconstrained import good_enough, may_be_squares, unconstrained_bound
from sparsepop_py.budget import EARLY
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import candidates_from_moments, update_incumbent
from sparsepop_py.local_search.solvers import local_search
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.presolve.size_limits import LEAN, affordable
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.relaxation.sparsepop.relaxation import Switches
from sparsepop_py.result import HistoryEntry
from sparsepop_py.solvers import least_seconds
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.linear_tree import (
    LinearTreeResult,
    bound_by_box,
    by_linear_tree,
)
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import Node, prove
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.steps import BoxProof, Replay
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["SearchState", "run_orders", "unstarted_state"]


@dataclass(frozen=True, eq=False)
class SearchState:
    """State at the end of a search for one objective.

    Parameters
    ----------
    context : SolveContext
        With the incumbent.
    outcome : CertifiedBound
        The best proved bound.
    candidates : list of (n,) float
        Nearly feasible vectors seen.
    history : tuple of HistoryEntry
    notes : tuple of str
        Sentences for the user.
    known : dict
        What verification of certificates found on the way.
    """

    context: SolveContext
    outcome: CertifiedBound
    candidates: list[NDArray[np.float64]]
    history: tuple[HistoryEntry, ...]
    notes: tuple[str, ...] = ()
    known: dict[Any, Any] = field(default_factory=dict)


def unstarted_state(context: SolveContext, candidates: list[NDArray[Any]]) -> SearchState:
    """Return the state of a search that ended before any relaxation was solved."""
    box = Interval(context.problem.lower, context.problem.upper)
    model = Model(BoxProof(), box)
    replay = Replay(context.problem, None)
    outcome = certified_bound(replay, model, BoxBound(prove(replay, box, None, False), Node()))
    return SearchState(context, outcome, candidates, ())


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
        early = shared is not None or context.options.effort == "auto"
        return state if early else _without_box(state)
    if context.options.effort == "plain":  # the relaxation is asked for whatever it proves
        state = _by_relaxations(context, candidates, shared, more_starts)
        return _proved_otherwise(state)
    exact = _by_exact_multipliers(context, candidates)
    if exact is None:
        state = _by_relaxations(context, candidates, shared, more_starts)
        early = context.options.effort == "auto" or not _restricted(context.problem)
        return state if early else _without_box(state)
    proved = lower_bound(exact.outcome.certificate)
    if exact.context.closed(proved) or exact.context.deadline.over or _falls(exact):
        return exact
    return _added(_by_relaxations(exact.context, exact.candidates, shared, more_starts), exact)


def _by_relaxations(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> SearchState:
    """Bound the objective on the whole space and by relaxations, as far as each applies."""
    free = shared is None and context.options.effort != "plain" and not _restricted(context.problem)
    if free:
        return _after_unconstrained(
            context,
            candidates,
            more_starts,
            partial(_run_orders, shared=None, more_starts=more_starts),
        )
    state = _run_orders(context, candidates, shared, more_starts)
    if context.options.effort == "presolve" and lower_bound(state.outcome.certificate) == -np.inf:
        return _on_gram_box(_with_unconstrained(state), more_starts)
    return state


def _without_box(state: SearchState) -> SearchState:
    """Bound the objective without a box, where a gap is left on one.

    Such are rational multipliers of convex quadratic problems, and Gram matrices of objectives that
    may be sums of squares. They know none of the sizes that wide bounds give to powers.
    """
    context, f = state.context, state.context.problem.objective
    if context.deadline.over or context.closed(lower_bound(state.outcome.certificate)):
        return state
    if context.problem.degree <= 2:
        return _added(state, _by_exact_multipliers(context, state.candidates))
    if f.degree < 4 or not may_be_squares(f):
        return state
    options = replace(context.options, effort="presolve", order=None, switches=None)
    found = _by_gram_matrices(replace(context, options=options), state.candidates, iter(()))
    return _added(state, found)


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


def _proved_otherwise(state: SearchState) -> SearchState:
    """Prove what a plain relaxation has by exact arguments, where its own proof loses much."""
    if _keeps_its_value(state):
        return state
    state = _added(state, _by_exact_multipliers(state.context, state.candidates))
    if _keeps_its_value(state) or state.context.deadline.over:
        return state
    options = replace(state.context.options, effort="presolve", switches=None)
    context = replace(state.context, options=options)
    return _added(state, _by_gram_matrices(context, state.candidates, iter(())))


def _keeps_its_value(state: SearchState) -> bool:
    """Check that the bound is the attained value, or nearly that of the relaxation."""
    bound, value = lower_bound(state.outcome.certificate), state.outcome.value
    near = value - bound <= BOUNDING.lost * (1.0 + abs(value))
    return bool(near) or state.context.closed(bound)


def _by_exact_multipliers(
    context: SolveContext, candidates: list[NDArray[Any]]
) -> SearchState | None:
    """Bound a convex quadratic objective over a polyhedron by rational multipliers."""
    start = time.process_time()
    try:
        found = exact_convex_bound(context)
    except KeyboardInterrupt:
        return unstarted_state(context, candidates)
    if found is None:
        return None
    bound, starts = found
    proved = lower_bound(bound.certificate)
    if not context.closed(proved):
        context, more = update_incumbent(context, starts, proved)
        candidates = candidates + more
    entry = _history_entry(context, bound, bound, time.process_time() - start)
    return SearchState(context, bound, candidates, (replace(entry, name="exact multipliers"),))


def _falls(state: SearchState) -> bool:
    """Check whether the objective provably falls without limit, so that no order proves any."""
    best, problem = state.context.best, state.context.problem
    if best is None or lower_bound(state.outcome.certificate) > -np.inf:
        return False
    direction = falling_direction(problem)
    return direction is not None and falling_ray(problem, best, direction) is not None


def _added(state: SearchState, exact: SearchState | None) -> SearchState:
    """Add a bound by exact multipliers where it is larger."""
    if exact is None:
        return state
    best = exact.context.best if exact.context.upper < state.context.upper else state.context.best
    state = replace(state, context=replace(state.context, best=best))
    if lower_bound(exact.outcome.certificate) <= lower_bound(state.outcome.certificate):
        return state
    outcome = better(exact.outcome, state.outcome)  # with the output of the relaxation
    return replace(state, outcome=outcome, history=state.history + exact.history)


def _restricted(problem: Problem) -> bool:
    """Check for constraints or bounds."""
    bounded = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    return bool(problem.constraints) or bool(bounded.any())


def _after_unconstrained(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    more_starts: Iterator[NDArray[Any]],
    go_on: Callable[[SolveContext, list[NDArray[Any]]], SearchState],
) -> SearchState:
    """Bound the objective on the whole space; continue where that is not enough."""
    free = _by_gram_matrices(context, candidates, more_starts)
    if free is None:
        return go_on(context, candidates)
    if (
        good_enough(free.context, lower_bound(free.outcome.certificate))
        or free.context.deadline.over
    ):
        return free
    boxed = _on_gram_box(free, more_starts) if context.options.effort == "auto" else free
    if boxed is not free:
        return boxed
    state = go_on(free.context, free.candidates)
    unproved = state.outcome.certificate is None
    outcome = better(free.outcome, state.outcome)
    state = replace(state, outcome=outcome, history=free.history + state.history)
    return _on_gram_box(state, more_starts) if unproved else state


def _with_unconstrained(state: SearchState) -> SearchState:
    """Add a bound of the objective on the whole space where a relaxation proved nothing."""
    free = _by_gram_matrices(state.context, state.candidates, iter(()))
    if free is None:
        return state
    outcome = better(free.outcome, state.outcome)  # with the output of the relaxation
    history, notes = state.history + free.history, state.notes + free.notes
    return replace(free, outcome=outcome, history=history, notes=notes)


def _by_gram_matrices(
    context: SolveContext, candidates: list[NDArray[Any]], more_starts: Iterator[NDArray[Any]]
) -> SearchState | None:
    """Bound the objective by Gram matrices without a box, searching points between rounds."""
    start, bound, starts_left = time.process_time(), None, list[NDArray[Any]]()

    def search(expected: float, found: CertifiedBound | None) -> SolveContext:
        nonlocal context, candidates
        starts_left.extend(more_starts)
        starts = starts_left if found is None else list(_candidates_from_moments(found))
        context, more = update_incumbent(context, starts, expected)
        candidates = candidates + more
        return context

    while True:
        try:
            found = unconstrained_bound(context, search)
        except EARLY as cause:
            context.deadline.ended(cause)
            return unstarted_state(context, candidates)
        if found is None:
            return None
        bound, old = better(bound, found), context.best
        context = _searched_about_the_origin(context, bound)
        for starts in (_candidates_from_moments(bound), more_starts):
            if not context.closed(lower_bound(bound.certificate)):
                context, more = update_incumbent(
                    context, list(starts), lower_bound(bound.certificate)
                )
                candidates = candidates + more
        if (
            context.best is old
            or context.closed(lower_bound(bound.certificate))
            or context.deadline.over
        ):
            break
    entry = _history_entry(context, bound, bound, time.process_time() - start)
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
        if _restricted(context.problem):
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
        if _worth_without_box(search.context.problem):
            if search.next_seconds <= max(STRATEGY.long_first, _seconds_without_box(search)):
                search.run(STRATEGY.before_squares)
            if (
                search.context.problem.degree > 2
            ):  # else a bound without a box costs less than points
                search.search_more_starts()
            if not search.over:
                state = _without_box(_state_of(search))
                search.outcome, search.history = state.outcome, list(state.history)
                search.context = replace(search.context, best=state.context.best)
        search.run()
    except EARLY as cause:
        search.context.deadline.ended(cause)
    return _state_of(search)


def _worth_without_box(problem: Problem) -> bool:
    """Check that a bound without a box has not been tried yet.

    Free objectives, and convex ones without a finite box, begin with it.
    """
    if finite(Interval(problem.lower, problem.upper)):
        return True
    return problem.degree > 2 and _restricted(problem)


def _seconds_without_box(search: AdaptiveSearch) -> float:
    """Estimate the least seconds of an exact Gram matrix of all variables.

    Its monomials are 1 and those whose squares occur. With several cliques blocks are small: 0.
    """
    if search.shared_state.cliques["constraints"].sizes.size > 1:
        return 0.0
    words = np.sort(search.context.problem.objective.words, axis=1)[:, ::-1]
    paired = words[:, 0::2][:, : words.shape[1] // 2] == words[:, 1::2]
    return least_seconds([1 + int((paired.all(axis=1) & words.any(axis=1)).sum())])


def _state_of(search: AdaptiveSearch) -> SearchState:
    return SearchState(search.context, search.outcome, search.candidates, tuple(search.history))


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
        start = time.process_time()
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
        history.append(_history_entry(context, outcome, bound, time.process_time() - start))
        if context.closed(lower_bound(outcome.certificate)) or context.deadline.over:
            break
        if outcome.certificate is None and context.best is not None:
            if falling_ray(context.problem, context.best) is not None:
                break  # no order proves anything
        shared = None
    assert outcome is not None
    if own and context.options.effort != "auto":
        outcome, entries = _by_third_form(context, outcome)
        history += entries
        outcome = _by_lower_orders(context, outcome)
    return SearchState(context, outcome, candidates, tuple(history))


def _by_third_form(
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
    start = time.process_time()
    order = None if options.order is None else float(options.order)
    options = replace(_timed(context), effort="plain", switches=Switches(order=order))
    with context.stages.stage("relax"):
        bare = Model(model.proof, model.box)
        third = build_relaxations(problem, (problem.objective,), bare, options)
    if not all(affordable(each, options.memory_limit) for each in third.relaxations):
        return outcome, []
    try:
        bound = bound_order(replace(context, options=options), third)
    except EARLY as cause:
        context.deadline.ended(cause)
        return outcome, []
    outcome = better(outcome, bound)
    return outcome, [_history_entry(context, outcome, bound, time.process_time() - start)]


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
        bound = bound_order(replace(context, options=lower), None)
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


def _history_entry(
    context: SolveContext, outcome: CertifiedBound, bound: CertifiedBound, seconds: float
) -> HistoryEntry:
    relaxation = bound.relaxation
    order = relaxation.order if relaxation is not None else 0
    return HistoryEntry(
        name=f"order {order}" if order else "box",
        order=order,
        lower_bound=lower_bound(outcome.certificate),
        upper_bound=context.upper,
        seconds=seconds,
        largest_block=max(relaxation.block_sizes, default=0) if relaxation is not None else 0,
        moments=relaxation.moments.shape[0] if relaxation is not None else 0,
    )


def _rounds(
    context: SolveContext,
    candidates: list[NDArray[Any]],
    shared: Model | None,
    more_starts: Iterator[NDArray[Any]],
) -> tuple[SolveContext, CertifiedBound, list[NDArray[Any]]]:
    """Repeat one order while the attained value improves."""
    outcome: CertifiedBound | None = None
    last: CertifiedBound | None = None
    for _ in range(1 if shared else STRATEGY.order_rounds):
        try:
            bound = bound_order(context, shared, last)
        except EARLY as cause:
            if outcome is None:
                raise
            context.deadline.ended(cause)
            break
        if bound is last:
            break
        outcome, last = better(outcome, bound), bound
        proved, old = lower_bound(outcome.certificate), context.best
        context.report(proved)
        if context.closed(proved) and context.problem.dimension > STRATEGY.many_variables:
            break  # reading further minimisers out of the moments would take the longest
        context, more = update_incumbent(context, _candidates_from_moments(bound), proved)
        candidates = candidates + more
        if not context.closed(proved) and not context.deadline.over:
            context, more = update_incumbent(context, list(more_starts), proved)
            candidates = candidates + more
        if context.closed(proved) or context.deadline.over or context.options.effort == "plain":
            break
        if context.best is old or not _worth_another(old, context.best, bound):
            break
    assert outcome is not None
    return context, outcome, candidates


def _candidates_from_moments(bound: CertifiedBound) -> list[NDArray[np.float64]]:
    if bound.relaxation is None or bound.model.scaled is None:
        return []
    return candidates_from_moments(bound.relaxation, bound.solution, bound.model.scaled.scaling)


def _worth_another(old: ProvedPoint | None, new: ProvedPoint | None, bound: CertifiedBound) -> bool:
    """Check that the attained value improved by a good part of the open gap."""
    if new is None:
        return False
    if old is None or bound.certificate is None:
        return True
    return old.value - new.value > 0.05 * (new.value - bound.certificate.bound)
