"""Work limits: runs that no clock can change, and that extend each other."""

import time

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.budget import Deadline, spend, spent

LIMITS = (0.05, 0.3, 2.0)


def quadratic(seed: int = 1, n: int = 8) -> sp.Problem:
    """An indefinite quadratic form on a simplex-like polytope."""
    x, entries = sp.variables(n), np.random.default_rng(seed).normal(size=(n, n)).tolist()
    form = sp.total([entries[i][j] * x[i] * x[j] for i in range(n) for j in range(n)])
    return sp.Problem(form, [sp.total(list(x)) <= 4], 0, 1)


def solved(limit: float) -> sp.Result:
    return sp.solve(quadratic(), sp.Options(effort="auto", work_limit=limit, gap=1e-9))


def steps(result: sp.Result) -> list[tuple]:
    return [(h.name, h.lower_bound, h.upper_bound, h.nodes) for h in result.history]


def test_two_runs_are_equal_although_clocks_differ(monkeypatch) -> None:
    first = solved(0.3)
    real = time.process_time
    monkeypatch.setattr(time, "process_time", lambda: 7.0 * real())  # a slower machine
    again = solved(0.3)
    assert steps(first) == steps(again)
    assert (first.lower_bound, first.upper_bound) == (again.lower_bound, again.upper_bound)
    assert first.lower_bound < first.upper_bound  # it did not simply close at once


def test_a_larger_limit_extends_a_smaller_one() -> None:
    runs = [solved(limit) for limit in LIMITS]
    for small, large in zip(runs, runs[1:], strict=False):
        whole = steps(small)[:-1]  # the last step may have been cut short
        assert steps(large)[: len(whole)] == whole
        assert large.lower_bound >= small.lower_bound
        assert large.upper_bound <= small.upper_bound


def test_work_is_counted_by_thread_and_ends_a_deadline() -> None:
    start, deadline = spent(), Deadline(None, work_limit=1.0)
    assert deadline.left is None and deadline.end == np.inf and deadline.counts_work
    spend(0.75)
    assert spent() - start == pytest.approx(0.75) and deadline.now() == spent()
    assert not deadline.over
    spend(0.5)
    assert deadline.over
    assert not Deadline(None).over and Deadline(None, 1.0).counts_work


@pytest.mark.parametrize("name", ["work_limit", "memory_limit"])
@pytest.mark.parametrize("value", [0, -1.0, "1", True, float("nan")])
def test_wrong_limits_are_refused(name: str, value: object) -> None:
    with pytest.raises(sp.ProblemError, match=f"Options.{name}: found"):
        sp.Options(**{name: value})


def test_relaxations_beyond_the_memory_limit_are_replaced_with_a_note() -> None:
    x = sp.variables(6)
    quartic = sp.Problem(sp.total(list(x)) ** 4 - x[0] * x[1] * x[2] * x[3], [x[0] >= 0.5], -1, 1)
    free = sp.solve(quartic, sp.Options(order=3))
    tight = sp.solve(quartic, sp.Options(order=3, memory_limit=2e7))
    assert max(free.relaxation.block_sizes) > max(tight.relaxation.block_sizes)
    assert any("it would be too large" in note for note in tight.notes)
    assert tight.lower_bound <= tight.upper_bound
