"""BLAS has one thread while something is solved, and its own number before and after."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import sparsepop_py as sp
from sparsepop_py.solvers.threads import while_solving


def blas() -> set[int]:
    """Threads of every BLAS that can have more than one (that of SCS was built without)."""
    return {
        pool["num_threads"]
        for pool in threadpool_info()
        if pool["user_api"] == "blas" and pool.get("threading_layer") != "disabled"
    }


def test_overlapping_calls_give_back_what_the_first_one_found() -> None:
    """Two Python threads, of which the one that began later ends later."""
    began, may_end = Event(), Event()

    @while_solving
    def later() -> set[int]:
        began.set()
        assert may_end.wait(30)
        return blas()

    @while_solving
    def first(pool: ThreadPoolExecutor):
        started = pool.submit(later)
        assert began.wait(30) and blas() == {1}
        return started

    with threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(1) as pool:
        started = first(pool)
        may_end.set()
        started.result()
        assert blas() == {2}


def test_an_error_gives_the_threads_back() -> None:
    x, y = sp.variables(2)
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(sp.ProblemError):
            sp.solve_each(sp.Problem(x), [y * 1.0, 3])
        sp.solve(sp.Problem((x - y) ** 2 + y**2))
        assert blas() == {2}
