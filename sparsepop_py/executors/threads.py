"""State of the process during a solve: one BLAS thread, no warnings of overflow.

Many small matrices are multiplied faster with one thread.
Threads that OpenBLAS keeps waiting for the next product count as CPU time and take cores from
other processes: a problem of 8 variables costs up to ten times as much with two of them.

The number of BLAS threads and the filters of warnings belong to the whole process. Where several
Python threads solve at once, the first one changes them and the last one gives them back,
whatever the order in which they end.

A search tries numbers beyond all doubles where those of a problem are near their ends. What becomes
infinite or NaN there proves nothing and is dropped, so NumPy's warnings would only alarm.
"""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
import threadpoolctl

__all__ = ["silent", "while_solving"]

P = ParamSpec("P")
T = TypeVar("T")


class _Changed:
    """Keep what solves under way have changed in this process. Mutable."""

    def __init__(self) -> None:
        self.silent = ExitStack()
        self.begin()

    def begin(self) -> None:
        """Begin anew, in a forked process too, which has no solve under way."""
        self.silent.close()
        self.lock = threading.Lock()  # another thread may have held that of the process before
        self.blas: dict[tuple[str, int], tuple[int, int]] = {}  # solves, and threads before them
        self.silent, self.searches = ExitStack(), 0
        self.ignored: set[type[Warning]] = set()


_changed = _Changed()


if hasattr(os, "register_at_fork"):  # the number of BLAS threads stays: workers have one
    os.register_at_fork(after_in_child=_changed.begin)


def while_solving(function: Callable[P, T]) -> Callable[P, T]:
    """Limit BLAS to one thread and let doubles overflow silently while a function runs.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable

    Examples
    --------
    >>> from threadpoolctl import threadpool_info
    >>> @while_solving
    ... def threads() -> set[int]:
    ...     return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}
    >>> threads() <= {1}
    True
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        with _one_thread(), np.errstate(over="ignore", invalid="ignore"):
            return function(*args, **kwargs)

    return limited


@contextmanager
def _one_thread() -> Iterator[None]:
    libraries = _libraries(len(sys.modules))
    _count(libraries, 1)
    try:
        yield
    finally:
        _count(libraries, -1)


def _count(libraries: list[Any], more: int) -> None:
    """Count a solve; the first one limits each library, the last one gives it back."""
    with _changed.lock:
        for library in libraries:
            # OpenMP has a number for each thread, other libraries one for the process
            own = getattr(library, "threading_layer", "") == "openmp"
            key = library.filepath, threading.get_ident() if own else 0
            count, before = _changed.blas.pop(key, (0, library.num_threads))
            count += more
            if count > 0:
                _changed.blas[key] = count, before
            if count == more == 1:
                library.set_num_threads(1)
            elif count == 0:
                library.set_num_threads(before)
        _release()


def _release() -> None:
    """Let other threads set numbers too, which newer threadpoolctl refuses."""
    release = getattr(threadpoolctl.OpenBLASController, "clear_controlling_thread", None)
    if release is not None:
        release()


@lru_cache(maxsize=1)
def _libraries(modules: int) -> list[Any]:
    """Find the BLAS libraries of this process, again where it has loaded another module.

    That takes 2 ms, as long as a small problem.

    Parameters
    ----------
    modules : int
        Number of modules that are loaded.
    """
    found = threadpoolctl.ThreadpoolController().lib_controllers
    return [library for library in found if library.user_api == "blas"]


@contextmanager
def silent(category: type[Warning] = Warning) -> Iterator[None]:
    """Ignore warnings within the body of a with statement, which several threads may enter.

    ``warnings.catch_warnings`` puts filters back that another thread has set meanwhile. Here
    filters are as they were when the last thread leaves.

    Parameters
    ----------
    category : type

    Examples
    --------
    >>> import warnings
    >>> with silent():
    ...     warnings.warn("nobody reads this")
    """
    if getattr(sys.flags, "context_aware_warnings", False):  # then each thread has its filters
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", category)
            yield
        return
    with _changed.lock:
        if category not in _changed.ignored:
            _changed.silent.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore", category)
            _changed.ignored.add(category)
        _changed.searches += 1
    try:
        yield
    finally:
        with _changed.lock:
            _changed.searches = max(0, _changed.searches - 1)
            if not _changed.searches:
                _changed.silent.close()
                _changed.ignored.clear()
