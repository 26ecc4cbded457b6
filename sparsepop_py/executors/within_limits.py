"""Run tasks within limits on an executor, which may break, hang or refuse."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from sparsepop_py.budget import Deadline, LimitReached, counting_from, meter
from sparsepop_py.executors.dispatch import is_within
from sparsepop_py.executors.threads import while_solving

__all__ = ["Timed", "run_on", "run_timed"]

_PATIENCE = 0.2  # of what was left when the tasks began: they may end so much after the deadline

Result = TypeVar("Result")


def run_on(
    executor: Executor,
    work: Callable[..., Result],
    tasks: Sequence[tuple[Any, ...]],
    deadline: Deadline,
) -> tuple[list[Result | None], str]:
    """Run tasks on an executor, each within the limits, and collect what they return.

    What came before it broke is kept. Tasks of a task of the same threads are done here, since
    waiting for them might never end. Work that they spend is not counted in this thread, wherever
    they are done: what they return may tell it.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    work : callable
    tasks : sequence of tuples
        Arguments of each call.
    deadline : Deadline

    Returns
    -------
    found : list
        One result a task, None for those that were lost.
    failure : str
        What failed; empty if nothing did.

    Raises
    ------
    LimitReached
        If the deadline ends the work first.
    """
    work = _Limited(work, deadline)
    if is_within(executor):
        return [work(*task) for task in tasks], ""
    found: list[Result | None] = [None] * len(tasks)
    left, failure = deadline.left, ""
    end = None if left is None else time.monotonic() + (1.0 + _PATIENCE) * left
    jobs: list[Future[Timed[Result]]] = []
    try:
        for task in tasks:
            jobs.append(executor.submit(run_timed, work, *task))
        for place, job in enumerate(jobs):
            made = job.result(None if end is None else max(0.0, end - time.monotonic()))
            found[place] = made.counted(deadline)
    except LimitReached:
        raise
    # Executors of other packages (Dask, Ray, MPI) raise exceptions that share no base below
    # Exception, and losing a worker is to cost time, never the result: the tasks are run here.
    except Exception as error:
        if isinstance(error, TimeoutError) and end is not None and time.monotonic() >= end:
            raise LimitReached from None
        failure = f"{type(error).__name__}: {error}".rstrip(": ")
        _collect(jobs, found, deadline)
    finally:
        for job in jobs:
            job.cancel()
    return found, failure


@dataclass(frozen=True, eq=False)
class _Limited(Generic[Result]):
    """Task within limits that counts its work on from that of the asking thread."""

    work: Callable[..., Result]
    deadline: Deadline
    asked: Any = field(default_factory=meter)

    def __call__(self, *arguments: Any) -> Result:
        with counting_from(self.asked), self.deadline.kept():
            return self.work(*arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the meter out in another process: deadlines bring what is left of them."""
        return _Limited, (self.work, self.deadline)


@dataclass(frozen=True, eq=False)
class Timed(Generic[Result]):
    """Result of a task with the process that did it and its CPU seconds."""

    value: Result
    process: int
    seconds: float

    def counted(self, deadline: Deadline) -> Result:
        """Charge the seconds of another process to a deadline; return the result."""
        if self.process != os.getpid():
            deadline.charge(self.seconds)
        return self.value


@while_solving
def run_timed(work: Callable[..., Result], *arguments: Any) -> Timed[Result]:
    """Do a task with one BLAS thread, which leaves other workers their cores."""
    start = time.process_time()
    found = work(*arguments)
    return Timed(found, os.getpid(), time.process_time() - start)


def _collect(
    jobs: list[Future[Timed[Result]]], found: list[Result | None], deadline: Deadline
) -> None:
    """Take the results that other jobs have brought already."""
    for place, job in enumerate(jobs):
        new = found[place] is None and job.done() and not job.cancelled()
        if new and job.exception() is None:
            found[place] = job.result().counted(deadline)
