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
    Argued,
    Bound,
    Model,
    better,
    bound_of,
    level,
    one_round,
    trivially,
)
from sparsepop_py.bounding.unconstrained import free_round, good_enough
from sparsepop_py.context import Task
from sparsepop_py.local_search.incumbents import attained, extracted
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.result import Rung
from sparsepop_py.strategy.adaptive import Auto
from sparsepop_py.strategy.shared_state import Ground
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Node, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Replay
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["INTERRUPTED", "Climbed", "climb", "nothing_yet"]

_ROUNDS = 3
_MANY = 300  # variables from which a closed gap ends the work at once
_ORDERS = 6  # orders above the first that "auto" tries at most without a box


@dataclass(frozen=True, eq=False)
class Climbed:
    """Where the ladder ended: the task with its best point, the best bound, and the way there."""

    task: Task
    outcome: Bound
    near: list[NDArray[np.float64]]
    history: tuple[Rung, ...]
    notes: tuple[str, ...] = ()


INTERRUPTED = "interrupted: what is proved so far is kept"


def nothing_yet(task: Task, near: list[NDArray]) -> Climbed:
    """Where an interrupted search stands before any relaxation was solved."""
    box = Interval(task.problem.lower, task.problem.upper)
    model = Model(BoxProof(), box)
    replay = Replay(task.problem, None)
    outcome = bound_of(replay, model, Argued(prove(replay, box, None, False), Node()))
    return Climbed(task, outcome, near, (), (INTERRUPTED,))


def climb(
    task: Task, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> Climbed:
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
    free = shared is None and task.options.effort != "plain" and not _restricted(task.problem)
    if free:
        return _after_free(task, near, later, partial(_climbed, shared=None, later=later))
    climbed = _climbed(task, near, shared, later)
    if task.options.effort == "presolve" and level(climbed.outcome.certificate) == -np.inf:
        return _with_free(climbed)
    return climbed


def _restricted(problem: Problem) -> bool:
    """Whether there are constraints or bounds."""
    bounded = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    return bool(problem.constraints) or bool(bounded.any())


def _after_free(
    task: Task,
    near: list[NDArray],
    later: Iterator[NDArray],
    go_on: Callable[[Task, list[NDArray]], Climbed],
) -> Climbed:
    """What the objective on the whole space proves, and where that is not enough, what follows."""
    free = _freely(task, near, later)
    if free is None:
        return go_on(task, near)
    if good_enough(free.task, level(free.outcome.certificate)) or free.task.clock.over:
        return free
    climbed = go_on(free.task, free.near)
    outcome = better(free.outcome, climbed.outcome)
    return replace(climbed, outcome=outcome, history=free.history + climbed.history)


def _with_free(climbed: Climbed) -> Climbed:
    """What the objective on the whole space adds where a relaxation proved nothing."""
    free = _freely(climbed.task, climbed.near, iter(()))
    if free is None:
        return climbed
    outcome = better(free.outcome, climbed.outcome)  # with the output of the relaxation
    history, notes = climbed.history + free.history, climbed.notes + free.notes
    return replace(free, outcome=outcome, history=history, notes=notes)


def _freely(task: Task, near: list[NDArray], later: Iterator[NDArray]) -> Climbed | None:
    """What Gram matrices prove where there is no box, and the points behind them."""
    start, bound = time.process_time(), None
    while True:
        try:
            found = free_round(task)
        except KeyboardInterrupt:
            return nothing_yet(task, near)
        if found is None:
            return None
        bound, old = better(bound, found), task.best
        for starts in (_extracted(bound), later):
            if not task.closed(level(bound.certificate)):
                task, more = attained(task, list(starts), level(bound.certificate))
                near = near + more
        if task.best is old or task.closed(level(bound.certificate)) or task.clock.over:
            break
    rung = _rung(task, bound, bound, time.process_time() - start)
    return Climbed(task, bound, near, (rung,))


def _climbed(
    task: Task, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> Climbed:
    if task.options.effort == "auto":
        with task.stages.stage("presolve"):
            replay = task.replay()
            proof, box = find_box(
                task.problem,
                task.best if replay.level is not None else None,
                _timed(task),
                done=trivially(task) or task.clock.over,
                level=replay.level,
            )
        if finite(box):
            ground = Ground.of(task.problem, (task.problem.objective,), task.options)
            return climbed_by(Auto(task, Model(proof, box), near, ground, later=later))
        if _restricted(task.problem):
            orders = partial(_orders, shared=shared, later=later)
            return _after_free(task, near, iter(()), orders)
    return _orders(task, near, shared, later)


def climbed_by(auto: Auto) -> Climbed:
    """Let a climber go as far as it must."""
    notes: tuple[str, ...] = ()
    try:
        auto.run()
    except KeyboardInterrupt:
        notes = (INTERRUPTED,)
    return Climbed(auto.task, auto.outcome, auto.near, tuple(auto.history), notes)


def _orders(
    task: Task, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> Climbed:
    """One order, or with effort "auto" growing orders."""
    outcome: Bound | None = None
    history: list[Rung] = []
    for order in _order_numbers(task):
        start = time.process_time()
        options = replace(_timed(task), order=order)
        if options.effort == "auto" and outcome is None:
            options = replace(options, effort="presolve")  # the first order may step down
        try:
            step, bound, near = _rounds(replace(task, options=options), near, shared, later)
        except KeyboardInterrupt:
            if outcome is None:
                return nothing_yet(task, near)
            return Climbed(task, outcome, near, tuple(history), (INTERRUPTED,))
        if outcome is not None and bound.relaxation is None:
            break  # this order would be too large
        outcome = better(outcome, bound)
        task = replace(task, best=step.best)
        history.append(_rung(task, outcome, bound, time.process_time() - start))
        if task.closed(level(outcome.certificate)) or task.clock.over:
            break
        if outcome.certificate is None and task.best is not None:
            if falling_ray(task.problem, task.best) is not None:
                break  # no order proves anything
        shared = None
    assert outcome is not None
    return Climbed(task, outcome, near, tuple(history))


def _timed(task: Task) -> Options:
    """The options with half of the time that is left: a box may take two solves."""
    left = task.clock.left
    return replace(task.options, time_limit=None if left is None else 0.5 * left)


def _order_numbers(task: Task) -> Iterator[int | None]:
    first = task.options.order
    if task.options.effort != "auto":
        yield first
        return
    first = max(first or 1, least_order(task.problem))
    yield from range(first, first + _ORDERS + 1)


def _rung(task: Task, outcome: Bound, bound: Bound, seconds: float) -> Rung:
    relaxation = bound.relaxation
    order = relaxation.order if relaxation is not None else 0
    return Rung(
        name=f"order {order}" if order else "box",
        order=order,
        lower_bound=level(outcome.certificate),
        upper_bound=task.upper,
        seconds=seconds,
        largest_block=max(relaxation.block_sizes, default=0) if relaxation is not None else 0,
        moments=relaxation.moments.shape[0] if relaxation is not None else 0,
    )


def _rounds(
    task: Task, near: list[NDArray], shared: Model | None, later: Iterator[NDArray]
) -> tuple[Task, Bound, list[NDArray]]:
    """Rounds on one order while the attained value improves."""
    outcome: Bound | None = None
    for _ in range(1 if shared else _ROUNDS):
        try:
            bound = one_round(task, shared)
        except KeyboardInterrupt:
            if outcome is None:
                raise
            task.clock.stop()
            break
        outcome = better(outcome, bound)
        proved, old = level(outcome.certificate), task.best
        if task.closed(proved) and task.problem.dimension > _MANY:
            break  # reading further minimisers out of the moments would take the longest
        task, more = attained(task, _extracted(bound), proved)
        near = near + more
        if not task.closed(proved) and not task.clock.over:
            task, more = attained(task, list(later), proved)
            near = near + more
        if task.closed(proved) or task.clock.over or task.options.effort == "plain":
            break
        if task.best is old or not _worth_another(old, task.best, bound):
            break
    assert outcome is not None
    return task, outcome, near


def _extracted(bound: Bound) -> list[NDArray[np.float64]]:
    if bound.relaxation is None or bound.model.scaled is None:
        return []
    return extracted(bound.relaxation, bound.solution, bound.model.scaled.scaling)


def _worth_another(old: ProvedPoint | None, new: ProvedPoint | None, bound: Bound) -> bool:
    """Whether the improvement of the attained value is a good part of the open gap."""
    if new is None:
        return False
    if old is None or bound.certificate is None:
        return True
    return old.value - new.value > 0.05 * (new.value - bound.certificate.bound)
