"""Solve for each of several objectives as a task of its own, in an executor."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from typing import Any, TypeAlias

from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import SparsePOPError
from sparsepop_py.executors.dispatch import completed
from sparsepop_py.options import Options
from sparsepop_py.pipeline.arguments import deadline_of
from sparsepop_py.pipeline.final_result import final_result
from sparsepop_py.pipeline.one_objective import solve
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import OnProgress, Stages
from sparsepop_py.result import INTERRUPTED, Result
from sparsepop_py.strategy.search_state import unstarted_state

__all__ = ["solve_apart"]

_Task: TypeAlias = tuple[Problem, Options, NDArray[Any] | None, float | None]
_PATIENCE = 2.0  # times the time that is left, and a second, for an executor
_LEAST = 1e-3  # seconds for a task that begins when time is over


def solve_apart(
    problem: Problem,
    objectives: Sequence[Polynomial],
    options: Options,
    start: NDArray[Any] | None,
    on_progress: OnProgress | None,
) -> list[Result]:
    """Solve for each objective as a task; an interrupt keeps those that are done.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    options : Options
        With an executor. The time limit is for all tasks together, in any process.
    start : (n,) array_like or None
    on_progress : callable or None
        Called when a task is done.

    Returns
    -------
    list of Result
        Without relaxations and solutions, which stay in the workers.
    """
    assert options.executor is not None
    until = None if options.time_limit is None else time.time() + options.time_limit
    own = _shared_out(options, len(objectives))
    tasks = [(problem.with_objective(each), own, start, until) for each in objectives]
    found: dict[int, Result] = {}
    try:
        with closing(_results_apart(tasks, options.executor)) as results:
            for number, each in results:
                found[number] = each
                if on_progress is not None:
                    on_progress(number, each.lower_bound, each.upper_bound)
    except KeyboardInterrupt:
        for number, task in enumerate(tasks):
            if number not in found:
                found[number] = _interrupted(task)
    return [found[number] for number in range(len(tasks))]


def _shared_out(options: Options, count: int) -> Options:
    """Give each of several tasks its part of the limits on CPU time and work."""
    parts = {
        name: limit / count
        for name in ("cpu_limit", "work_limit")
        if (limit := getattr(options, name)) is not None
    }
    return replace(options, executor=None, **parts)


def _results_apart(
    tasks: list[_Task], executor: Executor
) -> Generator[tuple[int, Result], None, None]:
    """Yield numbers and results as tasks end, from this process where the executor fails."""
    until = tasks[0][-1]
    patience = None if until is None else _PATIENCE * (until - time.time()) + 1.0
    left = dict(enumerate(tasks))
    try:
        with closing(completed(executor, _solve_task, enumerate(tasks), patience=patience)) as all_:
            for done in all_:
                if not isinstance(done.value, Result):
                    raise SparsePOPError(f"executor: task {done.key} was given up: {done.lost}")
                del left[done.key]
                yield done.key, done.value
    except Exception as error:  # of a task, which this process meets again, or of the executor
        text = f"the executor failed ({error}): objectives are bounded in this process"
        for number, task in left.items():
            one = _solve_task(task)
            yield number, replace(one, notes=(*one.notes, text))
            if INTERRUPTED in one.notes:
                raise KeyboardInterrupt from None


def _solve_task(task: _Task) -> Result:
    """Solve a problem in a worker; relaxation and solution stay there, nothing rests on them."""
    problem, options, start, until = task
    if until is not None:
        options = replace(options, time_limit=max(until - time.time(), _LEAST))
    return replace(solve(problem, options, start=start), relaxation=None, solution=None)


def _interrupted(task: _Task) -> Result:
    """Make the result of a task that an interrupt left undone."""
    problem, options, _, _ = task
    deadline = deadline_of(options)
    deadline.stop()
    return final_result(unstarted_state(SolveContext(problem, options, Stages(), deadline), []), {})
