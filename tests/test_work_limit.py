"""Work limits: runs that no clock can change, and that extend each other."""

import itertools
import pickle
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py import budget, solvers
from sparsepop_py.budget import Deadline, spend, spent
from sparsepop_py.lp.highs import LinearModel
from sparsepop_py.solvers import WITHOUT_WORK
from sparsepop_py.strategy import adaptive

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


def test_costs_leave_out_imports_and_imports_within_them() -> None:
    """CPU time is that of this process alone, so other work on the machine changes nothing."""

    def work() -> None:
        end = time.process_time() + 0.02
        while time.process_time() < end:
            pass

    clock = Deadline(None)
    before, cpu = clock.now(), time.process_time()
    for _ in range(3):
        with budget.importing():
            work()
            with budget.importing():
                work()
    left_out = time.process_time() - cpu
    assert left_out > 0.12 and abs(clock.now() - before) < 0.01
    work()
    assert clock.now() - before > 0.02


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


# ---- single solves within a limit -----------------------------------------------------------


def assignment(n: int = 12) -> tuple[LinearModel, np.ndarray]:
    """A linear program of n^2 variables, whose simplex methods need more than 20 pivots."""
    sides = np.vstack([np.kron(np.eye(n), np.ones(n)), np.kron(np.ones(n), np.eye(n))])
    one, free = np.ones(2 * n), np.ones(n * n)
    model = LinearModel(sps.csr_array(sides), (one, one), (0 * free, free))
    return model, np.random.default_rng(3).normal(size=n * n)


def test_a_linear_program_ends_within_the_work_left() -> None:
    model, cost = assignment()
    begin = spent()
    with Deadline(None, work_limit=1e-6).kept():
        found = model.solve(cost)
    cut = spent() - begin
    assert found.status == "stopped" and np.all(np.isfinite(found.dual))
    whole = assignment()[0].solve(cost)
    assert whole.status == "solved" and spent() - begin - cut > 1.5 * (cut - 2e-4)
    again = model.solve(cost)  # the limit on pivots is that of one solve
    assert again.status == "solved" and again.value == pytest.approx(whole.value)


def test_a_cut_program_is_not_called_infeasible() -> None:
    model, cost = assignment()
    model.add(np.ones((1, cost.size)), np.array([11.0]))  # all are 12 in sum
    with Deadline(None, work_limit=1e-6).kept():
        assert model.solve(cost).status == "stopped"
    assert model.solve(cost).status == "infeasible"


def test_a_conic_program_has_the_iterations_that_work_allows(monkeypatch) -> None:
    x = sp.variables(4)
    f = sp.total(x[i] * x[j] ** 3 - x[i] ** 2 for i in range(4) for j in range(4))
    program = sp.assemble(sp.relax(sp.Problem(f, lower=-1, upper=1), 2), f)
    begin = spent()
    whole = sp.solve_conic(program)
    each = (spent() - begin) / whole.iterations
    assert whole.status == "solved" and whole.iterations > 4
    monkeypatch.setattr(solvers, "_ITERATIONS", 4)
    monkeypatch.setattr(budget, "_LEAST_WORK", 0.0)
    with Deadline(None, work_limit=2.5 * each).kept():
        cut = sp.solve_conic(program)
    assert cut.status == "failed" and cut.iterations == 4
    deadline = Deadline(None, work_limit=1.5 * each)
    with deadline.kept():
        found = sp.solve_conic(program)
    assert (found.iterations, found.detail) == (0, WITHOUT_WORK) and deadline.over


def test_a_relaxation_that_needs_too_much_ends_the_search(monkeypatch) -> None:
    monkeypatch.setattr(adaptive, "_CHAIN_WORK", 1.0)  # as if it were far larger
    x, y = sp.variables(2)
    problem = sp.Problem(x**3 * y - x * y**2 + x, lower=-1, upper=1)
    result = sp.solve(problem, sp.Options(effort="auto", work_limit=1.0))
    assert result.status is sp.Status.LIMIT and not result.history
    assert any(budget.TOO_MUCH in note for note in result.notes)
    assert "too short" in result.message
    assert -3.0 - 1e-6 <= result.lower_bound <= result.upper_bound  # three terms of at most 1
    assert sp.solve(problem, sp.Options(effort="auto", work_limit=np.inf)).history


@pytest.mark.parametrize("before", [0.0, 0.1, 1 / 3, 1e3])
def test_what_is_left_does_not_depend_on_earlier_work(before) -> None:
    spend(before)
    with Deadline(None, work_limit=0.3).kept():
        assert budget.iterations_left(0.1) == 4  # of doubles, 0.3 is a little less than 3 * 0.1
        spend(0.1)
        spend(0.1)
        assert budget.iterations_left(0.125) == 1


def test_tasks_in_threads_have_what_was_left_at_their_start() -> None:
    spend(5.0)
    deadline = Deadline(None, work_limit=1.0)
    spend(0.25)

    def left(other: Deadline) -> tuple[float, bool]:
        spend(2.0)
        with other.kept():
            return budget.iterations_left(0.125), other.over

    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(left, deadline).result() == (6, False)
        stored = threads.submit(pickle.dumps, deadline).result()  # as executors do
    assert left(pickle.loads(stored)) == (1, True)
