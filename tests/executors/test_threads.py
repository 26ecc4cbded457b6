"""BLAS has one thread while something is solved, and its own number before and after.

So have the filters of warnings, and what is remembered holds for threads that solve at once.
"""

from __future__ import annotations

import os
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from math import sqrt
from multiprocessing import get_context
from threading import Event
from types import SimpleNamespace

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import sparsepop_py as sp
from sparsepop_py.executors import threads
from sparsepop_py.executors.threads import silent, while_solving
from sparsepop_py.executors.within_limits import run_timed
from sparsepop_py.solvers import cliquetree


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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="workers are not forked here")
def test_workers_that_are_forked_while_another_thread_counts_can_solve() -> None:
    """The lock that the other thread holds stays locked in the copy of this process."""
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:
        with threads._changed.lock:
            job = pool.submit(run_timed, sqrt, 4.0)
        processes = list(pool._processes.values())
        try:
            assert job.result(30).value == 2.0
        finally:
            for process in processes:  # else a test that fails would wait for it
                process.kill()


def test_an_error_gives_the_threads_back() -> None:
    x, y = sp.variables(2)
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(sp.ProblemError):
            sp.solve_each(sp.Problem(x), [y * 1.0, 3])
        sp.solve(sp.Problem((x - y) ** 2 + y**2))
        assert blas() == {2}


def test_a_solve_keeps_one_thread_when_another_ends_before_it() -> None:
    """Both in threads of a pool: none of them is that of the caller, who set two threads."""
    began, first_ended = Event(), Event()

    @while_solving
    def later() -> set[int]:
        began.set()
        assert first_ended.wait(30)
        return blas()

    @while_solving
    def first(pool: ThreadPoolExecutor):
        started = pool.submit(later)
        assert began.wait(30)
        return started

    before = max(blas())
    set_in_a_thread(2)
    try:
        with ThreadPoolExecutor(2) as pool:
            started = pool.submit(first, pool).result()
            first_ended.set()
            assert started.result() == {1}
        assert blas() == {2}
    finally:
        set_in_a_thread(before)


def set_in_a_thread(count: int) -> None:
    """Set the number of threads; newer threadpoolctl lets others set it when this thread ends."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(threadpool_limits, count, user_api="blas").result()


def test_overlapping_searches_give_back_the_filters_of_warnings() -> None:
    before, began, first_ended = list(warnings.filters), Event(), Event()

    def later() -> None:
        with silent(DeprecationWarning):
            began.set()
            assert first_ended.wait(30)

    with ThreadPoolExecutor(1) as pool:
        with silent():
            started = pool.submit(later)
            assert began.wait(30)
        first_ended.set()
        started.result()
    assert warnings.filters == before
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.warn("read this", DeprecationWarning, stacklevel=1)
        with silent():
            warnings.warn("not this", stacklevel=1)
    assert [str(each.message) for each in caught] == ["read this"]


def test_threads_share_the_analyses_of_patterns(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the shortest switches four threads met within 12 000 programs each time."""
    monkeypatch.setattr(cliquetree, "analyse", lambda program, compiled: object())
    monkeypatch.setattr(cliquetree, "_analysed", type(cliquetree._analysed)())
    program, before = SimpleNamespace(A=SimpleNamespace(nnz=1)), sys.getswitchinterval()

    def ask(thread: int) -> None:
        for number in range(3000):
            cliquetree._remembered(program, bytes([thread, number % 7]), False)

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(ask, range(4)))
    finally:
        sys.setswitchinterval(before)
