"""Ray as an executor; ray is imported when one is made."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from typing import Any, ParamSpec, TypeVar

from sparsepop_py.errors import SolverNotFound
from sparsepop_py.executors.processes import WorkerLost

__all__ = ["RayExecutor"]

P = ParamSpec("P")
T = TypeVar("T")


class RayExecutor(Executor):
    """Executor of a Ray cluster, or of this machine where no cluster is connected.

    Parameters
    ----------
    **resources
        Of each task, as of ``ray.remote``, such as ``num_cpus=2``; one processor when left out.

    Raises
    ------
    SolverNotFound
        If ray is not installed.

    Notes
    -----
    Where ``ray.init(...)`` was not called before, it is called without arguments, and
    :meth:`shutdown` ends what it started. A task whose worker is lost raises WorkerLost, so that
    a study submits it again.
    """

    def __init__(self, **resources: Any) -> None:
        try:
            import ray
        except ImportError as error:
            raise SolverNotFound(
                "executor: ray is missing; install it with: pip install ray"
            ) from error
        self._ray, self._own = ray, not ray.is_initialized()
        if self._own:
            ray.init(include_dashboard=False)
        options = {"num_cpus": 1, "max_retries": 0, **resources}
        self._remote = ray.remote(**options)(_caught)
        self._waiting: dict[Future[Any], Any] = {}
        self._lock = threading.Lock()
        self._closed = False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Hand a task to the cluster.

        Parameters
        ----------
        fn : callable
        *args, **kwargs
            Its arguments.

        Returns
        -------
        Future
            It raises WorkerLost where the worker ended before the task.
        """
        if self._closed:
            raise RuntimeError("RayExecutor: found a task after shutdown")
        future: Future[T] = Future()
        future.set_running_or_notify_cancel()
        reference = self._remote.remote(fn, args, kwargs)
        with self._lock:
            self._waiting[future] = reference
        reference.future().add_done_callback(lambda inner: self._settle(future, inner))
        return future

    def _settle(self, future: Future[Any], inner: Future[Any]) -> None:
        with self._lock:
            self._waiting.pop(future, None)
        error = CancelledError() if inner.cancelled() else inner.exception()
        if error is not None:
            future.set_exception(WorkerLost(f"ray: {type(error).__name__}: {error}"))
            return
        done, content = inner.result()
        if done:
            future.set_result(content)
        else:
            future.set_exception(content)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; end the cluster that was started here.

        Parameters
        ----------
        wait : bool
            Whether to wait for the tasks.
        cancel_futures : bool
            Whether to end the tasks at once.
        """
        self._closed = True
        with self._lock:
            waiting = list(self._waiting.items())
        for future, reference in waiting:
            if cancel_futures:
                self._ray.cancel(reference, force=True)
            if wait or cancel_futures:
                future.exception()
        if self._own:
            self._own = False
            self._ray.shutdown()


def _caught(function: Callable[..., Any], arguments: Any, named: Any) -> tuple[bool, Any]:
    """Return an exception of the function, so that all others are those of Ray."""
    try:
        return True, function(*arguments, **named)
    except Exception as error:  # whatever the task raises: its future raises it
        return False, error
