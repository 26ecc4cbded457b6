"""Make the result of a search: verify its certificate, name the status, select points.

The bound of a result is what verification recomputes from the exact problem, at most what the
search claimed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.exact_convex import falling_direction
from sparsepop_py.bounding.order_bound import CertifiedBound, lower_bound
from sparsepop_py.budget import LimitReached
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import SparsePOPError
from sparsepop_py.local_search.extraction import means
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rounding import note as rounding_note
from sparsepop_py.result import INTERRUPTED, Point, Result, Status
from sparsepop_py.strategy.search_state import SearchState
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["closed_box", "falls", "final_result"]

_UNVERIFIED = "time ended before the best bound was verified: a simpler one is claimed"
_CANCELLING = 1e10  # relative to an attained value: coefficients that say why digits are lost
_LOST = 1e-3  # relative to a relaxation's value: what is worth a sentence
_VERIFIED = 0.45  # of a limit: the last verification may end so much later


def final_result(state: SearchState, known: dict[Any, Any]) -> Result:
    """Make the result of a search, once more where an interrupt ends that.

    By then all is proved, and the second time takes no search.

    Parameters
    ----------
    state : SearchState
    known : dict
        What verification found on the way; shared between objectives.

    Returns
    -------
    Result
    """
    try:
        return _made(state, known)
    except KeyboardInterrupt:
        state.context.deadline.stop()
        return _made(state, known)


def _made(state: SearchState, known: dict[Any, Any]) -> Result:
    """Make the result; its bound is what verification recomputes, with the shared ``known``."""
    state = _verified(state, known)
    context, bound = state.context, state.outcome
    problem, best = context.problem, context.best
    lower = lower_bound(bound.certificate)
    upper = best.value if best is not None else np.inf
    if lower > upper:
        raise SparsePOPError(
            f"contradiction: a bound of {lower!r} is proved and {upper!r} is attained; "
            "this is a defect of the program, please report the problem"
        )
    status, notes, ray = _status(state, lower)
    points = _points(problem, best, state.candidates)
    return Result(
        problem=problem,
        options=context.options,
        status=status,
        lower_bound=lower,
        upper_bound=upper if status is not Status.UNBOUNDED else -np.inf,
        x=points[0].x if points else None,
        certificate=bound.certificate,
        attained=best,
        points=points,
        relaxation=bound.relaxation,
        solution=bound.solution,
        solver_value=bound.value,
        history=state.history,
        timings=context.stages.seconds,
        notes=notes,
        moments=_moments(bound),
        ray=ray,
    )


def _verified(state: SearchState, known: dict[Any, Any]) -> SearchState:
    """Lower the claims of a state, also those on the way, to what verification confirms.

    An interrupt here asks for the result, which this is the last step to; a second one ends it.
    Where time ends before the verification of a tree does, the best bound without the tree is
    claimed.
    """
    context, outcome = state.context, state.outcome
    problem, certificate = context.problem, outcome.certificate
    if certificate is None:
        return state
    with context.stages.stage("verify"):
        try:
            with context.deadline.kept(_VERIFIED):
                settled = certificate.settled(problem, known)
        except KeyboardInterrupt:
            context.deadline.stop()
            settled = certificate.settled(problem, known)
        except LimitReached:
            simpler = outcome.simpler or certificate  # of one node, which takes little time
            settled = simpler.settled(problem, known)
            if outcome.simpler is not None:
                state = replace(state, notes=(*state.notes, _UNVERIFIED))
    if settled is certificate:
        return state
    most = lower_bound(settled)
    history = tuple(
        replace(entry, lower_bound=min(entry.lower_bound, most)) for entry in state.history
    )
    return replace(state, outcome=replace(outcome, certificate=settled), history=history)


def _moments(bound: CertifiedBound) -> NDArray[np.float64] | None:
    """Read the moments of degree one, whatever the solver's status; None if not finite."""
    scaled, solution = bound.model.scaled, bound.solution
    if bound.relaxation is None or scaled is None or solution is None:
        return None
    if not np.isfinite(solution.y).all():
        return None
    return scaled.scaling.point(means(bound.relaxation, solution.y))


_Status = tuple[Status, tuple[str, ...], NDArray[np.float64] | None]


def _status(state: SearchState, lower: float) -> _Status:
    context, bound, deadline = state.context, state.outcome, state.context.deadline
    notes = [*bound.model.notes, *state.notes, *context.notes]
    notes += rounding_note(context.problem.rounding)
    notes += _lost_by_the_proof(context, bound, lower)
    if deadline.stopped:
        notes.append(INTERRUPTED)
    status, ray = Status.BOUNDED, None
    if lower == np.inf:
        status = Status.INFEASIBLE
    elif context.closed(lower):
        status = Status.OPTIMAL
    elif lower == -np.inf and (ray := _ray(context)) is not None:
        status = Status.UNBOUNDED
    elif deadline.stopped:
        status = Status.INTERRUPTED
    elif deadline.over or deadline.cut:
        status = Status.LIMIT
    elif lower == -np.inf:
        status, note = _unproved(context.problem, bound)
        notes += note
    return status, tuple(notes), ray


def _lost_by_the_proof(context: SolveContext, bound: CertifiedBound, lower: float) -> list[str]:
    """Say that the proof and not the relaxation lost the value, and where."""
    solution, value, box = bound.solution, bound.value, bound.model.box
    single = context.options.effort != "auto"  # else the last relaxation may be of one node
    if not single or solution is None or solution.status not in ("solved", "almost"):
        return []
    if context.closed(lower) or not value - lower > _LOST * (1.0 + abs(value)):
        return []
    reach = np.maximum(np.abs(box.lo), np.abs(box.hi))
    open_ = np.flatnonzero(np.isinf(reach))
    where = f"no finite bounds are known for {_listed(context.problem, open_)}"
    if not open_.size:
        widest = context.problem.names[int(np.argmax(reach))]
        where = f"rounding costs much where bounds are wide, such as those of {widest}"
    largest = float(np.abs(context.problem.objective.coefficients).max(initial=0.0))
    if largest > _CANCELLING * (1.0 + abs(context.upper)) and np.isfinite(context.upper):
        where = f"it is what is left of coefficients up to {largest:.2g}, whose rounding is larger"
    return [f"the relaxation's value is {value:.8g}, the proof loses the rest: {where}"]


def _unproved(problem: Problem, bound: CertifiedBound) -> tuple[Status, list[str]]:
    box = bound.model.box
    unbounded = np.flatnonzero(np.isinf(box.lo) | np.isinf(box.hi))
    if unbounded.size:
        return Status.UNPROVED, [f"no finite bounds are known for {_listed(problem, unbounded)}"]
    return Status.FAILED, []


def _listed(problem: Problem, variables: NDArray[Any]) -> str:
    """Names of variables, the first eight."""
    names = ", ".join(problem.names[v] for v in variables[:8])
    return names + (f" and {variables.size - 8} more" if variables.size > 8 else "")


def falls(context: SolveContext) -> bool:
    """Check for a proved ray from the attained point, without a search for its direction."""
    problem, best = context.problem, context.best
    return best is not None and not closed_box(problem) and falling_ray(problem, best) is not None


def _ray(context: SolveContext) -> NDArray[np.float64] | None:
    """Find a direction along which the objective provably falls without limit."""
    problem, best = context.problem, context.best
    if best is None or closed_box(problem):
        return None
    ray = falling_ray(problem, best)
    direction = falling_direction(problem) if ray is None else None
    return ray if direction is None else falling_ray(problem, best, direction)


def closed_box(problem: Problem) -> bool:
    """Check that the problem itself gives each variable two finite bounds."""
    return bool(np.all(np.isfinite(problem.lower) & np.isfinite(problem.upper)))


def _points(
    problem: Problem, best: ProvedPoint | None, candidates: list[NDArray[Any]]
) -> tuple[Point, ...]:
    """Select distinct candidates, the attained one first, then by value."""
    vectors = [best.x] if best is not None else []
    least = min([problem.objective(x) for x in vectors + candidates], default=np.inf)
    candidates = [
        x for x in candidates if problem.objective(x) <= least + 1e-3 * (1.0 + abs(least))
    ]
    rated = sorted(candidates, key=problem.objective)
    for x in rated:
        if all(np.abs(x - kept).max() > 1e-4 * (1.0 + np.abs(kept).max()) for kept in vectors):
            vectors.append(x)
        if len(vectors) >= 16:
            break
    return tuple(Point(x, problem.objective(x), problem.violation(x)) for x in vectors)
