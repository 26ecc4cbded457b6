"""Work limits: runs that no clock can change, and that extend each other."""

import itertools
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


def leaping_clocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each reading of a clock be half a minute after the one before."""
    clock = itertools.count(time.monotonic(), 30.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(time, "process_time", lambda: next(clock))


def test_ratios_do_not_depend_on_clocks(monkeypatch) -> None:
    # x / (1 + x^2 + x y + y^2) is least at y = -x / 2, where it is x / (1 + 3 x^2 / 4): -1 / sqrt 3
    x, y = sp.variables(2)
    problem = sp.RationalProblem(x / (1 + x**2 + x * y + y**2), lower=-2, upper=2)
    options = sp.Options(work_limit=3.0)
    first = sp.solve(problem, options)
    leaping_clocks(monkeypatch)
    again = sp.solve(problem, options)
    assert (first.lower_bound, first.upper_bound) == (again.lower_bound, again.upper_bound)
    assert again.lower_bound <= -(3**-0.5) <= again.upper_bound + 1e-9


def test_a_rational_problem_spends_its_work_limit_once() -> None:
    # a cubic over a quartic in three variables, whose polynomial problems do not close in this work
    x = sp.variables(3)
    ratio = (x[0] * x[1] * x[2] - x[0]) / (1 + sp.total([v**4 for v in x]) + x[0] * x[1])
    begin = spent()
    result = sp.solve(
        sp.RationalProblem(ratio, lower=-2, upper=2),
        sp.Options(effort="auto", work_limit=0.2, gap=1e-12),
    )
    assert np.isfinite(result.lower_bound)
    assert spent() - begin < 0.6  # 0.2, and the last step


def test_a_stage_counts_work_where_no_moment_ends_it(monkeypatch) -> None:
    whole = Deadline.before(np.inf, 5.0, 0.5)
    assert whole.counts_work and whole.limits == {"work_limit": pytest.approx(5.0)}
    part = Deadline(None).part(0.1, 3.0)
    leaping_clocks(monkeypatch)
    assert not whole.over and not part.over and whole.end == np.inf
    spend(3.5)
    assert part.over and not whole.over
    spend(2.0)
    assert whole.over and whole.limits == {"work_limit": 1e-3}


def test_a_stage_takes_seconds_where_a_moment_ends_it(monkeypatch) -> None:
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    assert Deadline.before(160.0, 50.0, 0.5).limits == {"time_limit": 30.0}
    assert Deadline.before(160.0, 20.0, 0.5).limits == {"time_limit": 20.0}
    assert Deadline.before(90.0, 20.0).over
    assert Deadline(None, None, 7.0).limits == {"cpu_limit": pytest.approx(7.0, abs=0.5)}


@pytest.mark.parametrize("limits", [{"work_limit": 0.01}, {"work_limit": 9, "search_limit": 0.01}])
def test_searches_end_with_the_start_at_which_the_limit_passes(limits) -> None:
    """No point is feasible, so that searches from a dozen starts would take 2.6 units."""
    x, y = sp.variables(2)
    problem = sp.Problem(2 * x - x * y, [(x - y) ** 2 <= -1e-16])
    begin = spent()
    sp.solve(problem, sp.Options(order=3, node_limit=0, **limits))
    assert spent() - begin < 0.5
