"""Run tasks on a user's executor, which may break, hang or refuse."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

from sparsepop_py.budget import Deadline, LimitReached

__all__ = ["run_on"]

_PATIENCE = 0.2  # of what was left when the tasks began: they may end so much after the deadline

Result = TypeVar("Result")


def run_on(
    executor: Executor,
    work: Callable[..., Result],
    tasks: Sequence[tuple[Any, ...]],
    deadline: Deadline,
) -> tuple[list[Result | None], str]:
    """Run tasks on an executor and collect what it returns before it breaks.

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
    found: list[Result | None] = [None] * len(tasks)
    left, failure = deadline.left, ""
    end = None if left is None else time.monotonic() + (1.0 + _PATIENCE) * left
    jobs: list[Future[Result]] = []
    try:
        for task in tasks:
            jobs.append(executor.submit(work, *task))
        for place, job in enumerate(jobs):
            found[place] = job.result(None if end is None else max(0.0, end - time.monotonic()))
    except LimitReached:
        raise
    # Executors of other packages (Dask, Ray, MPI) raise exceptions that share no base below
    # Exception, and losing a worker is to cost time, never the result: the tasks are run here.
    except Exception as error:
        if isinstance(error, TimeoutError) and end is not None and time.monotonic() >= end:
            raise LimitReached from None
        failure = f"{type(error).__name__}: {error}".rstrip(": ")
        _collect(jobs, found)
    finally:
        for job in jobs:
            job.cancel()
    return found, failure


def _collect(jobs: list[Future[Result]], found: list[Result | None]) -> None:
    """Take the results that other jobs have brought already."""
    for place, job in enumerate(jobs):
        if job.done() and not job.cancelled() and job.exception() is None:
            found[place] = job.result()
