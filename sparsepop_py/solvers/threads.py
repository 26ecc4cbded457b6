"""State of the process during a solve: one BLAS thread, no warnings of overflow.

Many small matrices are multiplied faster with one thread.
Threads that OpenBLAS keeps waiting for the next product count as CPU time and take cores from
other processes: a problem of 8 variables costs up to ten times as much with two of them. Of
several Python threads that solve at once, threadpoolctl lets the first one set the number.

A search tries numbers beyond all doubles where those of a problem are near their ends. What becomes
infinite or NaN there proves nothing and is dropped, so NumPy's warnings would only alarm.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

__all__ = ["while_solving"]

P = ParamSpec("P")
T = TypeVar("T")


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
        one = _libraries(len(sys.modules)).limit(limits=1, user_api="blas")
        with one, np.errstate(over="ignore", invalid="ignore"):
            return function(*args, **kwargs)

    return limited


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Find the BLAS libraries of this process, again where it has loaded another module.

    That takes 2 ms, as long as a small problem.

    Parameters
    ----------
    modules : int
        Number of modules that are loaded.
    """
    return ThreadpoolController()
