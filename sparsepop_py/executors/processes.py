"""Run tasks in processes that end with this one, each replaced when lost.

``concurrent.futures.ProcessPoolExecutor`` gives up all its tasks when one of its processes
dies, and leaves its processes behind when this one is killed. Here each process serves one
task at a time through its standard input and output. A lost process costs the task that it
had, and a process whose input ends stops. New processes import the package afresh: nothing is
forked, and the main module is not run again.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any, ParamSpec, TypeVar
from weakref import WeakSet

from sparsepop_py.errors import ProblemError

__all__ = ["Processes", "WorkerLost"]

P = ParamSpec("P")
T = TypeVar("T")

_BOOT = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from sparsepop_py.executors.worker import serve; serve()"
)
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


_POOLS: WeakSet[Processes] = WeakSet()


def _begin_anew() -> None:
    """Leave the processes to the process that forked this one: two cannot serve one pipe."""
    for pool in _POOLS:
        pool._begin()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


class WorkerLost(BrokenExecutor):
    """A process ended before its task was done; the task may be submitted again."""


class Processes(Executor):
    """Pool of processes that end with this one, each replaced when it is lost.

    Functions and arguments are pickled; functions of the main module cannot be found there.

    Parameters
    ----------
    workers : int, optional
        Number of processes; that of the processors when left out.

    Raises
    ------
    ProblemError
        If ``workers`` is no positive integer.

    Examples
    --------
    >>> import math
    >>> with Processes(1) as pool:
    ...     pool.submit(math.gcd, 12, 18).result()
    6
    """

    def __init__(self, workers: int | None = None) -> None:
        count = (os.cpu_count() or 1) if workers is None else workers
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise ProblemError(f"workers: found {workers!r}, expected an integer >= 1")
        self.workers = count
        self._closed = self._stopped = False
        self._begin()
        _POOLS.add(self)

    def _begin(self) -> None:
        """Begin without processes, in a forked process too, which has none of the threads."""
        self._tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._running: dict[int, subprocess.Popen[bytes]] = {}
        self._lock = threading.Lock()  # another thread may have held that of the process before
        self._threads: list[threading.Thread] = []

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Hand a task to the next process that is free.

        Parameters
        ----------
        fn : callable
            Of an importable module.
        *args, **kwargs
            Its arguments.

        Returns
        -------
        Future
            It raises :class:`WorkerLost` where the process ended before the task.

        Raises
        ------
        ProblemError
            If the function or an argument cannot be pickled.
        """
        future: Future[T] = Future()
        task = _Task(future, _pickled(fn, args, kwargs))
        with self._lock:
            if self._closed:
                raise RuntimeError("Processes: found a task after shutdown")
            if len(self._threads) < self.workers:
                thread = threading.Thread(target=self._serve, daemon=True)
                self._threads.append(thread)
                thread.start()
            self._tasks.put(task)  # before a shutdown that begins now
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when their tasks are done.

        Parameters
        ----------
        wait : bool
            Whether to return only then.
        cancel_futures : bool
            Whether tasks that have not begun are dropped.
        """
        with self._lock:
            self._closed = True
        if cancel_futures:
            self._drop()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def stop(self) -> None:
        """End the processes now; tasks that run are lost and those that wait are cancelled."""
        with self._lock:
            self._closed = self._stopped = True
            running = list(self._running.values())
        self._drop()
        for process in running:
            process.kill()
        self.shutdown()

    def __exit__(self, kind: Any, value: Any, trace: Any) -> bool | None:
        if kind is not None:
            self.stop()
        return super().__exit__(kind, value, trace)

    def _drop(self) -> None:
        while True:
            try:
                task = self._tasks.get_nowait()
            except queue.Empty:
                return
            if task is not None and task.future.cancel():
                task.future.set_running_or_notify_cancel()  # who waits for several hears of it

    def _serve(self) -> None:
        """Give one process its tasks; start a new one where it was lost."""
        process: subprocess.Popen[bytes] | None = None
        while (task := self._tasks.get()) is not None:
            if not task.future.set_running_or_notify_cancel():
                continue
            if process is not None and process.poll() is not None:  # it ended while it waited
                self._end(process)
                process = None
            try:
                process = process or self._start()
                task.settle(process)
            except Exception as error:  # the process ended, or its answer cannot be read
                if process is not None:
                    self._end(process)
                    process = None
                lost = isinstance(error, (OSError, EOFError, pickle.UnpicklingError))
                text = f"worker: {error or 'it ended'}"
                task.future.set_exception(WorkerLost(text) if lost else error)
        if process is not None:
            self._end(process)

    def _start(self) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._stopped:
                raise OSError("stopped")
            process = subprocess.Popen(
                [sys.executable, "-c", _BOOT],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**dict.fromkeys(_ONE_THREAD, "1"), **os.environ},
                start_new_session=True,  # Ctrl-C is for this process, which then ends that one
            )
            self._running[process.pid] = process
        _send(process, sys.path)
        return process

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        with self._lock:
            self._running.pop(process.pid, None)
        process.kill()
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            try:
                stream.close()
            except OSError:  # what was not read yet
                pass
        process.wait()


class _Task:
    """A future and the pickled call whose result it waits for."""

    def __init__(self, future: Future[Any], call: bytes) -> None:
        self.future, self._call = future, call

    def settle(self, process: subprocess.Popen[bytes]) -> None:
        """Have a process do it, and pass on what it returns or raises."""
        _send(process, self._call)
        assert process.stdout is not None
        done, content = pickle.load(process.stdout)
        if done:
            self.future.set_result(content)
        else:
            self.future.set_exception(content)


def _pickled(function: Callable[..., Any], arguments: Any, named: Any) -> bytes:
    try:
        return pickle.dumps((function, arguments, named), 5)
    except Exception as error:  # pickle has several for what it cannot store
        raise ProblemError(
            f"executor: found a task that cannot be pickled ({error}), expected functions of "
            "importable modules and data that pickle"
        ) from error


def _send(process: subprocess.Popen[bytes], value: Any) -> None:
    assert process.stdin is not None
    pickle.dump(value, process.stdin, 5)
    process.stdin.flush()
