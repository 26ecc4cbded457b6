"""The ladder: rounds on one order, and with effort "auto" one rung after the other.

A round ends with a certificate and with candidate minimisers. When these improve the
attained value, the cut-off shrinks the box and another round may gain. With effort "auto"
the rungs of :mod:`sparsepop_py.relaxation.hierarchy` follow, each time the one that promises to close
most of the gap per second, branch and bound among them; where no finite box is known,
orders follow one another. The ladder ends when the gap is closed, time is over, or nothing
is left to try.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.relaxation_bound import (
    BoxBound,
    CertifiedBound,
    Model,
    better,
    certified_bound,
    lower_bound,
    one_round,
    trivially,
)
from sparsepop_py.bounding.unconstrained import free_round, good_enough
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import candidates_from_moments, update_incumbent
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.result import HistoryEntry
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Node, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Replay
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["INTERRUPTED", "SearchState", "run_orders", "unstarted_state"]

_ROUNDS = 3
_MANY = 300  # variables from which a closed gap ends the work at once
_ORDERS = 6  # orders above the first that "auto" tries at most without a box


@dataclass(frozen=True, eq=False)
class SearchState:
    """Where the ladder ended: the task with its best point, the best bound, and the way there."""

    context: SolveContext
    outcome: CertifiedBound
    near: list[NDArray[np.float64]]
    history: tuple[HistoryEntry, ...]
    notes: tuple[str, ...] = ()


INTERRUPTED = "interrupted: what is proved so far is kept"


def unstarted_state(context: SolveContext, near: list[NDArray]) -> SearchState:
    """Where an interrupted search stands before any relaxation was solved."""
    box = Interval(context.problem.lower, context.problem.upper)
    model = Model(BoxProof(), box)
    replay = Replay(context.problem, None)
    outcome = certified_bound(replay, model, BoxBound(prove(replay, box, None, False), Node()))
    return SearchState(context, outcome, near, (), (INTERRUPTED,))


def run_orders(
    context: SolveContext, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> SearchState:
    """Bound the task on one order, or on one rung after the other while the gap is open.

    Parameters
    ----------
    task : Task
    near : list of (n,) float
        Nearly feasible vectors seen so far.
    shared : Model or None
        Box and relaxations that several objectives share; used on the first rung.
    later : iterator of (n,) float
        Starts of local searches for where the first relaxation leaves a gap.
    """
    free = shared is None and context.options.effort != "plain" and not _restricted(context.problem)
    if free:
        return _after_free(context, near, later, partial(_run_orders, shared=None, later=later))
    state = _run_orders(context, near, shared, later)
    if context.options.effort == "presolve" and lower_bound(state.outcome.certificate) == -np.inf:
        return _with_free(state)
    return state


def _restricted(problem: Problem) -> bool:
    """Whether there are constraints or bounds."""
    bounded = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    return bool(problem.constraints) or bool(bounded.any())


def _after_free(
    context: SolveContext,
    near: list[NDArray],
    later: Iterator[NDArray],
    go_on: Callable[[SolveContext, list[NDArray]], SearchState],
) -> SearchState:
    """What the objective on the whole space proves, and where that is not enough, what follows."""
    free = _by_gram_matrices(context, near, later)
    if free is None:
        return go_on(context, near)
    if (
        good_enough(free.context, lower_bound(free.outcome.certificate))
        or free.context.deadline.over
    ):
        return free
    state = go_on(free.context, free.near)
    outcome = better(free.outcome, state.outcome)
    return replace(state, outcome=outcome, history=free.history + state.history)


def _with_free(state: SearchState) -> SearchState:
    """What the objective on the whole space adds where a relaxation proved nothing."""
    free = _by_gram_matrices(state.context, state.near, iter(()))
    if free is None:
        return state
    outcome = better(free.outcome, state.outcome)  # with the output of the relaxation
    history, notes = state.history + free.history, state.notes + free.notes
    return replace(free, outcome=outcome, history=history, notes=notes)


def _by_gram_matrices(
    context: SolveContext, near: list[NDArray], later: Iterator[NDArray]
) -> SearchState | None:
    """What Gram matrices prove where there is no box, and the points behind them."""
    start, bound = time.process_time(), None
    while True:
        try:
            found = free_round(context)
        except KeyboardInterrupt:
            return unstarted_state(context, near)
        if found is None:
            return None
        bound, old = better(bound, found), context.best
        for starts in (_candidates_from_moments(bound), later):
            if not context.closed(lower_bound(bound.certificate)):
                context, more = update_incumbent(
                    context, list(starts), lower_bound(bound.certificate)
                )
                near = near + more
        if (
            context.best is old
            or context.closed(lower_bound(bound.certificate))
            or context.deadline.over
        ):
            break
    rung = _history_entry(context, bound, bound, time.process_time() - start)
    return SearchState(context, bound, near, (rung,))


def _run_orders(
    context: SolveContext, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> SearchState:
    if context.options.effort == "auto":
        with context.stages.stage("presolve"):
            replay = context.replay()
            proof, box = find_box(
                context.problem,
                context.best if replay.cutoff is not None else None,
                _timed(context),
                done=trivially(context) or context.deadline.over,
                cutoff=replay.cutoff,
            )
        if finite(box):
            shared_state = SharedState.of(
                context.problem, (context.problem.objective,), context.options
            )
            return run_adaptive(
                AdaptiveSearch(context, Model(proof, box), near, shared_state, later=later)
            )
        if _restricted(context.problem):
            orders = partial(_orders, shared=shared, later=later)
            return _after_free(context, near, iter(()), orders)
    return _orders(context, near, shared, later)


def run_adaptive(auto: AdaptiveSearch) -> SearchState:
    """Let a climber go as far as it must."""
    notes: tuple[str, ...] = ()
    try:
        auto.run()
    except KeyboardInterrupt:
        notes = (INTERRUPTED,)
    return SearchState(auto.context, auto.outcome, auto.near, tuple(auto.history), notes)


def _orders(
    context: SolveContext, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> SearchState:
    """One order, or with effort "auto" growing orders."""
    outcome: CertifiedBound | None = None
    history: list[HistoryEntry] = []
    for order in _order_numbers(context):
        start = time.process_time()
        options = replace(_timed(context), order=order)
        if options.effort == "auto" and outcome is None:
            options = replace(options, effort="presolve")  # the first order may step down
        try:
            step, bound, near = _rounds(replace(context, options=options), near, shared, later)
        except KeyboardInterrupt:
            if outcome is None:
                return unstarted_state(context, near)
            return SearchState(context, outcome, near, tuple(history), (INTERRUPTED,))
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
    return SearchState(context, outcome, near, tuple(history))


def _timed(context: SolveContext) -> Options:
    """The options with half of the time that is left: a box may take two solves."""
    left = context.deadline.left
    return replace(context.options, time_limit=None if left is None else 0.5 * left)


def _order_numbers(context: SolveContext) -> Iterator[int | None]:
    first = context.options.order
    if context.options.effort != "auto":
        yield first
        return
    first = max(first or 1, least_order(context.problem))
    yield from range(first, first + _ORDERS + 1)


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
    context: SolveContext, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> tuple[SolveContext, CertifiedBound, list[NDArray]]:
    """Rounds on one order while the attained value improves."""
    outcome: CertifiedBound | None = None
    for _ in range(1 if shared else _ROUNDS):
        try:
            bound = one_round(context, shared)
        except KeyboardInterrupt:
            if outcome is None:
                raise
            context.deadline.stop()
            break
        outcome = better(outcome, bound)
        proved, old = lower_bound(outcome.certificate), context.best
        if context.closed(proved) and context.problem.dimension > _MANY:
            break  # reading further minimisers out of the moments would take the longest
        context, more = update_incumbent(context, _candidates_from_moments(bound), proved)
        near = near + more
        if not context.closed(proved) and not context.deadline.over:
            context, more = update_incumbent(context, list(later), proved)
            near = near + more
        if context.closed(proved) or context.deadline.over or context.options.effort == "plain":
            break
        if context.best is old or not _worth_another(old, context.best, bound):
            break
    assert outcome is not None
    return context, outcome, near


def _candidates_from_moments(bound: CertifiedBound) -> list[NDArray[np.float64]]:
    if bound.relaxation is None or bound.model.scaled is None:
        return []
    return candidates_from_moments(bound.relaxation, bound.solution, bound.model.scaled.scaling)


def _worth_another(old: ProvedPoint | None, new: ProvedPoint | None, bound: CertifiedBound) -> bool:
    """Whether the improvement of the attained value is a good part of the open gap."""
    if new is None:
        return False
    if old is None or bound.certificate is None:
        return True
    return old.value - new.value > 0.05 * (new.value - bound.certificate.bound)
