"""The ladder: rounds on one order, and with effort "auto" one order after the other.

A round ends with a certificate and with candidate minimisers. When these improve the
attained value, the cut-off shrinks the box and another round may gain. An order ends
when rounds stop gaining; the ladder ends when the gap is closed, time is over, or the
next relaxation would be too large.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .extraction import candidates
from .feasibility import ProvedPoint
from .options import Options
from .problem import Problem
from .refinement import best_attained
from .relaxation import least_order
from .result import Rung
from .rungs import Bound, Model, Task, better, closed, level, one_round

__all__ = ["Climbed", "attain", "climb"]

_ROUNDS = 3
_ORDERS = 6  # orders above the first that "auto" tries at most


@dataclass(frozen=True, eq=False)
class Climbed:
    """Where the ladder ended: the task with its best point, the best bound, and the way there."""

    task: Task
    outcome: Bound
    near: list[NDArray[np.float64]]
    history: tuple[Rung, ...]


def climb(task: Task, near: list[NDArray], shared: Model | None) -> Climbed:
    """Bound the task on one order, or on growing orders while the gap is open.

    Parameters
    ----------
    task : Task
    near : list of (n,) float
        Nearly feasible vectors seen so far.
    shared : Model or None
        Box and relaxations that several objectives share; used on the first rung.
    """
    outcome: Bound | None = None
    history: list[Rung] = []
    for order in _orders(task):
        start = time.process_time()
        options = replace(task.options, order=order)
        if options.effort == "auto" and outcome is None:
            options = replace(options, effort="presolve")  # the first order may step down
        step, bound, near = _rounds(replace(task, options=options), near, shared)
        if outcome is not None and bound.relaxation is None:
            break  # this order would be too large
        outcome = better(outcome, bound)
        task = replace(task, best=step.best)
        history.append(_rung(task, outcome, bound, time.process_time() - start))
        if closed(task, outcome) or task.clock.over or level(outcome.certificate) == np.inf:
            break
        shared = None
    assert outcome is not None
    return Climbed(task, outcome, near, tuple(history))


def _orders(task: Task) -> Iterator[int | None]:
    first = task.options.order
    if task.options.effort != "auto":
        yield first
        return
    first = max(first or 1, least_order(task.problem))
    yield from range(first, first + _ORDERS + 1)


def _rung(task: Task, outcome: Bound, bound: Bound, seconds: float) -> Rung:
    relaxation = bound.relaxation
    return Rung(
        order=relaxation.order if relaxation is not None else 0,
        lower_bound=level(outcome.certificate),
        upper_bound=task.best.value if task.best is not None else np.inf,
        seconds=seconds,
        largest_block=max(relaxation.block_sizes, default=0) if relaxation is not None else 0,
        moments=relaxation.moments.shape[0] if relaxation is not None else 0,
    )


def _rounds(
    task: Task, near: list[NDArray], shared: Model | None
) -> tuple[Task, Bound, list[NDArray]]:
    """Rounds on one order while the attained value improves."""
    outcome: Bound | None = None
    for _ in range(1 if shared else _ROUNDS):
        bound = one_round(task, shared)
        outcome = better(outcome, bound)
        with task.stages.stage("extract"):
            found, more = attain(task.problem, _extracted(bound), task.options)
        near = near + more
        old, improved = task.best, _lower(found, task.best)
        if improved:
            task = replace(task, best=found)
        if closed(task, outcome) or task.clock.over or task.options.effort == "plain":
            break
        if not improved or not _worth_another(old, task.best, bound):
            break
    assert outcome is not None
    return task, outcome, near


def attain(
    problem: Problem, starts: list[NDArray], options: Options
) -> tuple[ProvedPoint | None, list[NDArray]]:
    """The best proved point that local searches from the starts lead to, and all they saw."""
    if options.refine == "none" or not starts:
        return None, []
    method = "ipopt" if options.refine == "ipopt" else None
    return best_attained(problem, starts, options.tolerance, method)


def _extracted(bound: Bound) -> list[NDArray[np.float64]]:
    model, solution = bound.model, bound.solution
    if solution is None or solution.status not in ("solved", "almost"):
        return []
    assert model.scaled is not None and bound.relaxation is not None
    scaling = model.scaled.scaling
    return [scaling.point(t) for t in candidates(bound.relaxation, solution.y)]


def _lower(new: ProvedPoint | None, old: ProvedPoint | None) -> bool:
    return new is not None and (old is None or new.value < old.value)


def _worth_another(old: ProvedPoint | None, new: ProvedPoint | None, bound: Bound) -> bool:
    """Whether the improvement of the attained value is a good part of the open gap."""
    if new is None:
        return False
    if old is None or bound.certificate is None:
        return True
    return old.value - new.value > 0.05 * (new.value - bound.certificate.bound)
