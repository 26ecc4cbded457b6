"""Executors that break: what is proved is never lost."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest
from search_cases import bilinear, least_on_a_grid
from solved import check

import sparsepop_py as sp
from sparsepop_py import Options, Status
from sparsepop_py.budget import Deadline, LimitReached, spend, spent
from sparsepop_py.budget import check as check_limits
from sparsepop_py.executors.within_limits import run_on


class Refusing(Executor):
    """Takes some tasks and runs them here, then refuses."""

    def __init__(self, accepted: int, error: type[Exception] = RuntimeError) -> None:
        self.left, self.error, self.asked = accepted, error, 0

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self.asked += 1
        if not self.left:
            raise self.error("closed")
        self.left -= 1
        job: Future = Future()
        job.set_result(fn(*args, **kwargs))
        return job


@pytest.mark.parametrize(
    ("error", "accepted"),
    [
        (RuntimeError, 0),
        (TimeoutError, 5),
        pytest.param(RuntimeError, 5, marks=pytest.mark.slow),
        pytest.param(TimeoutError, 0, marks=pytest.mark.slow),
    ],
)
def test_a_refusing_executor_is_replaced_by_this_process(accepted, error, only_branch):
    problem, executor = bilinear(), Refusing(accepted, error)
    result = check(problem, sp.solve(problem, Options(effort="auto", gap=5e-2, executor=executor)))
    assert result.status is Status.OPTIMAL
    assert result.lower_bound <= least_on_a_grid(problem, 25)
    assert [note for note in result.notes if f"{error.__name__}: closed" in note]
    assert executor.asked == accepted + 1  # it is not asked again


def test_an_executor_that_was_shut_down(only_branch):
    problem, executor = bilinear(), ThreadPoolExecutor(1)
    executor.shutdown()
    result = check(problem, sp.solve(problem, Options(effort="auto", gap=5e-2, executor=executor)))
    assert result.status is Status.OPTIMAL
    assert any("the executor failed" in note for note in result.notes)


class Killed(ProcessPoolExecutor):
    """Kills its workers after a few tasks."""

    taken = 0

    def submit(self, fn, /, *args, **kwargs):
        self.taken += 1
        job = super().submit(fn, *args, **kwargs)
        if self.taken == 4:
            for process in list(self._processes.values()):
                os.kill(process.pid, signal.SIGKILL)
        return job


@pytest.mark.slow
def test_workers_killed_in_mid_solve(only_branch):
    problem = bilinear()
    with Killed(1, get_context("spawn")) as executor:
        options = Options(effort="auto", gap=5e-2, executor=executor)
        result = check(problem, sp.solve(problem, options))
        assert executor.taken >= 4
    assert result.status is Status.OPTIMAL
    assert result.lower_bound <= least_on_a_grid(problem, 25)
    assert any("BrokenProcessPool" in note for note in result.notes)


class Hanging(Executor):
    """Never brings a result."""

    def submit(self, fn, /, *args, **kwargs) -> Future:
        return Future()


def test_a_hanging_executor_ends_with_the_limit(only_branch):
    problem = bilinear()
    options = Options(effort="auto", gap=5e-2, executor=Hanging(), time_limit=1.0)
    result = check(problem, sp.solve(problem, options))
    assert result.status is Status.LIMIT
    assert result.lower_bound > -float("inf")


def test_results_of_other_tasks_are_kept():
    def half(value: int) -> float:
        if value == 2:
            raise ValueError("two")
        return value / 2

    with ThreadPoolExecutor(1) as executor:
        found, failure = run_on(executor, half, [(1,), (2,), (3,)], Deadline())
    assert found[0] == 0.5 and found[1] is None and failure == "ValueError: two"
    with pytest.raises(LimitReached):
        run_on(Hanging(), half, [(1,)], Deadline(0.01))


def test_results_with_an_executor_pickle_and_copy(only_branch):
    problem = bilinear()
    with ThreadPoolExecutor(1) as executor:
        result = sp.solve(problem, Options(effort="auto", gap=5e-2, executor=executor))
        again, copied = pickle.loads(pickle.dumps(result)), copy.deepcopy(result)
        assert result.options.executor is executor
    for other in (again, copied):
        assert other.lower_bound == result.lower_bound
        assert other.certificate.verify(problem).ok
        assert other.options.gap == 5e-2
        assert other.summary() == result.summary()
    assert again.options.executor is None


def test_a_deadline_goes_on_in_another_process():
    deadline = pickle.loads(pickle.dumps(Deadline(50.0, 3.0, 20.0)))
    assert 49.0 < deadline.wall_end - time.monotonic() <= 50.0
    assert 19.0 < deadline.cpu_left <= 20.0
    assert deadline.counts_work and not deadline.over


def test_a_task_of_threads_does_its_own_tasks():
    """Else it would wait for a thread, which is its own."""
    pool = ThreadPoolExecutor(1)
    try:
        tasks = pool.submit(run_on, pool, divmod, [(7, 2), (9, 4)], Deadline())
        assert tasks.result(5) == ([(3, 1), (2, 1)], "")
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class Elsewhere(Refusing):
    """Runs tasks as another process would: from a pickle, without limits of this thread."""

    def submit(self, fn, /, *args, **kwargs) -> Future:
        fn, args, kwargs = pickle.loads(pickle.dumps((fn, args, kwargs)))
        return super().submit(fn, *args, **kwargs)


@pytest.mark.parametrize("executor", [Refusing(1), Elsewhere(1)])
def test_a_task_is_within_the_limits(executor) -> None:
    with pytest.raises(LimitReached):
        run_on(executor, check_limits, [()], Deadline(1e-9))


def is_over(deadline: Deadline) -> bool:
    spend(0.25)
    return deadline.over


@pytest.mark.parametrize(("here", "there"), [(9.0, 0.0), (0.0, 99.0)])
def test_a_work_limit_is_that_of_the_thread_which_asks(here: float, there: float) -> None:
    """Threads have counted other work before, and so has the one that asks."""
    spend(here)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(spend, there).result()
        for limit, over in ((0.5, False), (0.2, True)):
            deadline = Deadline(None, work_limit=limit)
            assert run_on(pool, is_over, [(deadline,)], deadline) == ([over], "")


def test_work_of_tasks_within_a_pool_is_not_counted_twice() -> None:
    """Callers count what tasks tell of their work, as they do for other processes."""

    def within() -> tuple[list[bool | None], float]:
        begin, deadline = spent(), Deadline(None, work_limit=0.5)
        found, _ = run_on(pool, is_over, 3 * [(deadline,)], deadline)
        return found, spent() - begin

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(within).result(30) == ([False, False, False], 0.0)
