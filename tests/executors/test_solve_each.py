"""Objectives as tasks of an executor: limits, refusals and executors that never answer."""

from __future__ import annotations

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import pytest

import sparsepop_py as sp

X, Y = sp.variables(2)
DISC = sp.Problem(X, [X**2 + Y**2 <= 1])
OBJECTIVES = [X, -X, Y]


class Counting(Executor):
    """Does tasks at once and counts them, up to a number of them."""

    def __init__(self, most: int, error: Exception) -> None:
        self.most, self.error, self.options = most, error, list[sp.Options]()

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if len(self.options) >= self.most:
            raise self.error
        self.options.append(args[0][1])
        job: Future[Any] = Future()
        job.set_result(fn(*args, **kwargs))
        return job


class Silent(Executor):
    """Takes every task and does none."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        return Future()


def check(results: list[sp.Result]) -> None:
    for result in results:
        assert result.status is sp.Status.OPTIMAL
        assert result.lower_bound == pytest.approx(-1.0, abs=1e-5)
        assert result.lower_bound <= -1.0 <= result.upper_bound + 1e-9


@pytest.mark.parametrize("given", [True, False])
def test_each_objective_is_a_task_with_its_part_of_the_limits(given: bool) -> None:
    pool = Counting(9, ValueError())
    options = sp.Options(cpu_limit=30.0, executor=None if given else pool)
    check(sp.solve_each(DISC, OBJECTIVES, options, executor=pool if given else None))
    assert [own.cpu_limit for own in pool.options] == [10.0] * 3
    assert all(own.executor is None for own in pool.options)


@pytest.mark.parametrize("error", [RuntimeError("it is shut down"), ValueError("no"), TypeError()])
def test_an_executor_that_refuses_is_replaced_by_this_process(error: Exception) -> None:
    found = sp.solve_each(DISC, OBJECTIVES, executor=Counting(1, error))
    check(found)
    for result in found[1:]:  # the first was brought
        assert any("the executor failed" in note for note in result.notes)


def test_results_that_were_brought_before_a_failure_are_kept() -> None:
    found = sp.solve_each(DISC, OBJECTIVES, executor=Counting(2, RuntimeError("it is shut down")))
    check(found)
    assert [bool(result.notes) for result in found] == [False, False, True]


def test_an_executor_that_was_shut_down() -> None:
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    check(sp.solve_each(DISC, OBJECTIVES, executor=pool))


def test_an_executor_that_never_answers_is_given_up_after_the_limit() -> None:
    found = sp.solve_each(DISC, OBJECTIVES, sp.Options(time_limit=0.01), executor=Silent())
    assert len(found) == 3
    assert all("no task ended within" in " ".join(result.notes) for result in found)


def test_errors_of_tasks_are_raised() -> None:
    """They are those of the problem, not of the executor."""
    pool = Counting(9, ValueError())
    with pytest.raises(sp.ProblemError, match=r"start: found shape \(3,\)"):
        sp.solve_each(DISC, OBJECTIVES, start=[1.0, 2.0, 3.0], executor=pool)


class Pressed(Counting):
    """The user presses Ctrl-C while the executor is given the next task."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if len(self.options) >= self.most:
            raise KeyboardInterrupt
        return super().submit(fn, *args, **kwargs)


def check_interrupted(found: list[sp.Result], done: list[bool]) -> None:
    for result, complete in zip(found, done, strict=True):
        expected = sp.Status.OPTIMAL if complete else sp.Status.INTERRUPTED
        assert result.status is expected
        assert result.lower_bound <= -1.0  # the minimum over the disc
        assert complete or result.lower_bound == -float("inf")


def test_an_interrupt_keeps_the_objectives_that_are_done() -> None:
    """It was raised through, and all results were lost."""

    def stop(number: int, lower: float, upper: float) -> None:
        seen.append(number)
        if len(seen) == 2:
            raise KeyboardInterrupt

    seen: list[int] = []
    pool = Counting(9, ValueError())
    check_interrupted(
        sp.solve_each(DISC, OBJECTIVES, executor=pool, on_progress=stop),
        [number in seen for number in range(3)],
    )
    check_interrupted(sp.solve_each(DISC, OBJECTIVES, executor=Pressed(0, OSError())), [False] * 3)


def test_an_interrupt_in_this_process_ends_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the executor failed, Ctrl-C ended one objective, and the next began."""
    begun: list[int] = []

    def pressed(*_: Any) -> Any:
        begun.append(1)
        raise KeyboardInterrupt

    monkeypatch.setattr("sparsepop_py.pipeline.one_objective.first_incumbent", pressed)
    found = sp.solve_each(DISC, OBJECTIVES, executor=Counting(0, RuntimeError("shut down")))
    check_interrupted(found, [False] * 3)
    assert len(begun) == 1


class Broken(Counting):
    """Brings an exception of its own, or what is no result."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        job: Future[Any] = Future()
        if isinstance(self.error, MemoryError):
            job.set_exception(self.error)
        else:
            job.set_result(17)
        return job


@pytest.mark.parametrize("error", [MemoryError("of a worker"), ValueError()])
def test_what_is_no_result_is_made_in_this_process(error: Exception) -> None:
    found = sp.solve_each(DISC, OBJECTIVES, executor=Broken(9, error))
    check(found)
    assert all("the executor failed" in " ".join(result.notes) for result in found)
