"""State at the end of a search for one objective."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import (
    CertifiedBound,
    Model,
    better,
    certified_bound,
    lower_bound,
)
from sparsepop_py.bounding.relaxation_bound import BoxBound
from sparsepop_py.budget import EARLY
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import candidates_from_moments
from sparsepop_py.result import HistoryEntry
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Node, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Replay

__all__ = [
    "SearchState",
    "further",
    "history_entry",
    "moment_candidates",
    "state_of",
    "unstarted_state",
    "with_larger_bound",
]


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


def further(state: SearchState, step: Callable[[SearchState], SearchState]) -> SearchState:
    """Take a step from a state, which is kept where the step ends early."""
    try:
        return step(state)
    except EARLY as cause:
        state.context.deadline.ended(cause)
        return state


def state_of(search: AdaptiveSearch) -> SearchState:
    """Return what an adaptive search has found so far."""
    return SearchState(search.context, search.outcome, search.candidates, tuple(search.history))


def with_larger_bound(state: SearchState, other: SearchState | None) -> SearchState:
    """Take over the bound and the incumbent of another state where better."""
    if other is None:
        return state
    best = other.context.best if other.context.upper < state.context.upper else state.context.best
    state = replace(state, context=replace(state.context, best=best))
    if lower_bound(other.outcome.certificate) <= lower_bound(state.outcome.certificate):
        return state
    outcome = better(other.outcome, state.outcome)  # with the output of the relaxation
    return replace(state, outcome=outcome, history=state.history + other.history)


def history_entry(
    context: SolveContext, outcome: CertifiedBound, bound: CertifiedBound, seconds: float
) -> HistoryEntry:
    """Record one step: the best outcome after it, and the relaxation that it solved."""
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


def moment_candidates(bound: CertifiedBound) -> list[NDArray[np.float64]]:
    """Read candidate minimisers out of the moments of a relaxation, none without one."""
    if bound.relaxation is None or bound.model.scaled is None:
        return []
    return candidates_from_moments(bound.relaxation, bound.solution, bound.model.scaled.scaling)
