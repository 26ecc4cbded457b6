"""Run many tasks on an executor and submit those again whose worker was lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sparsepop_py.errors import ProblemError, SparsePOPError
from sparsepop_py.executors.processes import Processes

__all__ = ["Done", "completed", "is_within", "map_in_order", "opened", "workers_of"]

Key = TypeVar("Key")
T = TypeVar("T")

_ATTEMPTS = 3  # of a task before it is given up
_GUESSED_WORKERS = 8  # of an executor that does not say how many it has
_LOST_MODULES = ("distributed", "mpi4py")  # whose own exceptions mean lost workers


@dataclass(frozen=True, slots=True)
class Done(Generic[Key, T]):
    """A task that is done or given up.

    Parameters
    ----------
    key : object
    value : object
        What the function returned; None where the task was given up.
    lost : str
        Why it was given up; empty where it is done.
    """

    key: Key
    value: T | None
    lost: str = ""


@contextmanager
def opened(workers: int | None, executor: Executor | None) -> Iterator[Executor | None]:
    """Provide the executor that ``workers=`` and ``executor=`` ask for, for a with statement.

    Parameters
    ----------
    workers : int or None
        None and 1: none, the work is done in this process. More: :class:`Processes`.
    executor : Executor or None
        Used as it is and left open.

    Raises
    ------
    ProblemError
        If both are given, or one has the wrong type.
    """
    if executor is not None:
        if workers is not None:
            raise ProblemError("workers, executor: found both, expected one of them")
        if not isinstance(executor, Executor):
            raise ProblemError(
                f"executor: found {type(executor).__name__}, expected a "
                "concurrent.futures.Executor (of a Dask client: client.get_executor())"
            )
        yield executor
    elif workers is None or (workers == 1 and not isinstance(workers, bool)):
        yield None
    else:
        with Processes(workers) as pool:
            yield pool


def is_within(executor: Executor) -> bool:
    """Check whether this thread is one of an executor's own.

    Tasks of a ``ThreadPoolExecutor`` that wait for others of it would wait forever once they have
    all its threads: what they ask for is done where they are.

    Parameters
    ----------
    executor : Executor

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(1) as pool:
    ...     is_within(pool), pool.submit(is_within, pool).result()
    (False, True)
    """
    if not isinstance(executor, ThreadPoolExecutor):
        return False
    with executor._shutdown_lock:  # a thread may begin before it is listed
        return threading.current_thread() in executor._threads


def workers_of(executor: Executor | None) -> int:
    """Return the number of workers of an executor, a guess where it does not say.

    Parameters
    ----------
    executor : Executor or None
        None: no workers. Nor has the one whose task this is: see :func:`is_within`.
    """
    if executor is None or is_within(executor):
        return 0
    for name in ("workers", "_max_workers"):
        count = getattr(executor, name, None)
        if isinstance(count, int):
            return count
    return _GUESSED_WORKERS


def map_in_order(
    executor: Executor | None,
    function: Callable[[Any], T],
    arguments: Iterable[Any],
) -> list[T]:
    """Apply a function to many arguments; results come in their order.

    Parameters
    ----------
    executor : Executor or None
        None: in this process, one after the other.
    function : callable
        Of an importable module, without effects: a task whose worker was lost runs again.
    arguments : iterable

    Returns
    -------
    list

    Raises
    ------
    SparsePOPError
        If a task loses its worker three times, or the executor can do nothing more.

    Examples
    --------
    >>> from math import sqrt
    >>> from sparsepop_py.executors.processes import Processes
    >>> with Processes(2) as pool:
    ...     map_in_order(pool, sqrt, [4.0, 9.0]), map_in_order(None, sqrt, [4.0, 9.0])
    ([2.0, 3.0], [2.0, 3.0])
    """
    if executor is None:
        return [function(argument) for argument in arguments]
    found: dict[int, T] = {}
    for done in completed(executor, function, enumerate(arguments)):
        if done.lost:
            raise SparsePOPError(f"executor: task {done.key} was given up: {done.lost}")
        found[done.key] = done.value  # type: ignore[assignment]
    return [found[place] for place in range(len(found))]


def completed(
    executor: Executor,
    function: Callable[[Any], T],
    tasks: Iterable[tuple[Key, Any]],
    ahead: int = 64,
    patience: float | None = None,
) -> Generator[Done[Key, T], None, None]:
    """Run tasks on an executor and yield them as they are done.

    A task whose worker was lost is submitted again, twice at most. Where a
    ``ProcessPoolExecutor`` broke, :class:`Processes` of our own take over. Tasks of a task of the
    same threads are done here (:func:`is_within`). Exceptions of the function itself are raised.
    The tasks that are still waiting are cancelled when the iterator is closed.

    Parameters
    ----------
    executor : Executor
    function : callable
        Of one argument.
    tasks : iterable of (key, argument)
    ahead : int
        Most tasks that are submitted and not done; their arguments are in memory.
    patience : float, optional
        Seconds for all of them.

    Yields
    ------
    Done

    Raises
    ------
    SparsePOPError
        If the executor takes no tasks any more, or keeps them for longer than ``patience``.

    Examples
    --------
    >>> from math import sqrt
    >>> with Processes(1) as pool:
    ...     sorted((done.key, done.value) for done in completed(pool, sqrt, [("a", 4.0)]))
    [('a', 2.0)]
    """
    run: _Run[Key, T] = _Run(executor, function)
    rest = iter(tasks)
    end = None if patience is None else time.monotonic() + patience
    refused: SparsePOPError | None = None  # what was taken before is waited for
    try:
        while True:
            while refused is None and len(run.waiting) < ahead:
                if (task := next(rest, None)) is None:
                    break
                try:
                    run.submit(*task, 1)
                except SparsePOPError as error:
                    refused = error
            if not run.waiting and refused is not None:
                raise refused
            if not run.waiting:
                return
            left = None if end is None else max(0.0, end - time.monotonic())
            ready, _ = wait(run.waiting, left, FIRST_COMPLETED)
            if not ready:
                raise SparsePOPError(f"executor: no task ended within {patience:.3g} s")
            for future in ready:
                done = run.settle(future)
                if done is not None:
                    yield done
    finally:
        run.close()


class _Run(Generic[Key, T]):
    """The tasks that an executor has at the moment. Mutable."""

    def __init__(self, executor: Executor, function: Callable[[Any], T]) -> None:
        self._executor, self._function = executor, function
        self._own: Processes | None = None
        self.waiting: dict[Future[T], tuple[Key, Any, int]] = {}

    def submit(self, key: Key, argument: Any, attempt: int) -> None:
        """Submit a task, to a pool of our own where the executor's is broken."""
        try:
            if is_within(self._executor):
                future = _done_here(self._function, argument)
            else:
                future = self._executor.submit(self._function, argument)
        except ProblemError:  # the task, not the executor
            raise
        except Exception as error:  # those of other packages share no base
            self._replace(error)
            future = self._executor.submit(self._function, argument)
        self.waiting[future] = key, argument, attempt

    def _replace(self, error: Exception) -> None:
        broken = self._executor
        if not isinstance(broken, ProcessPoolExecutor) or not isinstance(error, BrokenExecutor):
            raise SparsePOPError(
                f"executor: it takes no tasks any more ({error}); give a new one"
            ) from error
        self._executor = self._own = Processes(getattr(broken, "_max_workers", None))

    def settle(self, future: Future[T]) -> Done[Key, T] | None:
        """Take what a future holds; None where its task is submitted again."""
        key, argument, attempt = self.waiting.pop(future)
        error = CancelledError() if future.cancelled() else future.exception()
        if error is None:
            return Done(key, future.result())
        if not _means_lost(error):
            if not isinstance(error, SparsePOPError):
                error.add_note(f"executor: a task on {type(self._executor).__name__} raised this")
            raise error
        if attempt < _ATTEMPTS:
            self.submit(key, argument, attempt + 1)
            return None
        return Done(key, None, f"its worker was lost {attempt} times ({error})".strip())

    def close(self) -> None:
        """Cancel what is waiting; end the processes that were started here."""
        for future in self.waiting:
            future.cancel()
        if self._own is not None:
            self._own.stop()


def _done_here(function: Callable[[Any], T], argument: Any) -> Future[T]:
    future: Future[T] = Future()
    try:
        future.set_result(function(argument))
    except Exception as error:  # whatever the task raises, as in a worker
        future.set_exception(error)
    return future


def _means_lost(error: BaseException) -> bool:
    module = type(error).__module__.partition(".")[0]
    return isinstance(error, (BrokenExecutor, CancelledError)) or module in _LOST_MODULES
