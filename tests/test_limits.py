"""Limits of time and CPU time, interrupts, advice, progress: what a run says and keeps."""

from __future__ import annotations

import io
import logging
import os
import pickle
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from loop_cases import ALL_SPECS
from search_cases import bilinear, least_on_a_grid
from solved import INF, check

import sparsepop_py as sp
from sparsepop_py import Options, Status, budget, progress, solvers
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.branch_and_bound import tree
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.local_search import incumbents, multistart
from sparsepop_py.lp import highs
from sparsepop_py.pipeline import separate_tasks
from sparsepop_py.problem import generators
from sparsepop_py.relaxation.moment import conic_rows
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, prove
from sparsepop_py.verified.certificate.steps import Replay

# ---- deadlines ------------------------------------------------------------------------------


@pytest.fixture
def clocks(monkeypatch):
    """Stand still until they are moved."""
    now = SimpleNamespace(wall=100.0, cpu=10.0)
    fake = SimpleNamespace(monotonic=lambda: now.wall, process_time=lambda: now.cpu)
    monkeypatch.setattr(budget, "time", fake)
    return now


def test_cpu_time_ends_a_deadline_and_wall_time_does_not(clocks):
    deadline = Deadline(cpu_limit=4.0)
    clocks.wall += 50.0
    assert not deadline.over
    assert deadline.cpu_left == 4.0
    clocks.cpu += 2.0
    assert deadline.left == pytest.approx(2.0 * 25.0)  # 50 wall seconds went to 2 CPU seconds
    clocks.cpu += 2.0
    assert deadline.over
    assert deadline.late


def test_the_first_of_two_limits_counts(clocks):
    deadline = Deadline(10.0, None, 4.0)
    assert deadline.left == 4.0
    clocks.wall += 9.0
    clocks.cpu += 1.0
    assert deadline.left == 1.0
    assert deadline.expected == pytest.approx(1.0 / 9.0)
    clocks.wall += 1.0
    assert deadline.over
    assert Deadline(None, 5.0).expected is None


def test_a_look_at_the_clock_raises_after_the_grace_and_only_inside(clocks):
    deadline = Deadline(10.0)
    clocks.wall += 11.9
    with deadline.kept():
        budget.check()
        clocks.wall += 0.2
        with pytest.raises(LimitReached):
            budget.check()
        with Deadline(100.0).kept(), pytest.raises(LimitReached):
            budget.check()  # the outer one still holds
        clocks.wall -= 0.2
    clocks.wall += 50.0
    budget.check()


def test_a_look_at_the_clock_counts_cpu_time_too(clocks):
    with Deadline(cpu_limit=1.0).kept():
        clocks.cpu += 1.1
        budget.check()
        clocks.cpu += 0.2
        with pytest.raises(LimitReached):
            budget.check()


def test_a_part_of_what_is_left(clocks):
    deadline = Deadline(10.0, None, 8.0)
    clocks.wall += 5.0
    clocks.cpu += 4.0
    part = deadline.part(0.5)
    assert part.wall_end == clocks.wall + 2.5
    assert part.cpu_left == 2.0
    assert Deadline().part(0.5).left is None
    counted = Deadline().part(0.5, otherwise=2.0)
    assert counted.counts_work and counted.left is None
    assert deadline.part(0.5, otherwise=1e9).left < 1e8


def test_a_part_knows_how_fast_cpu_time_passes(clocks):
    deadline = Deadline(cpu_limit=8.0)
    clocks.wall += 20.0
    clocks.cpu += 4.0
    assert deadline.part(0.5).left == pytest.approx(2.0 * 5.0)


def test_parts_share_work_and_pass_on_what_other_processes_spent(clocks):
    deadline = Deadline(None, work_limit=8.0)
    part = deadline.part(0.5, otherwise=2.0)
    assert part.counts_work and not part.unlimited and part.left is None
    budget.spend(3.9)
    assert not part.over
    budget.spend(0.2)
    assert part.over and not deadline.over
    whole = Deadline(None, None, 8.0)
    inner = whole.part(0.5)
    inner.charge(3.0)
    assert (inner.cpu_left, whole.cpu_left) == (1.0, 5.0)


def test_tasks_of_one_solve_share_its_time(monkeypatch):
    """Each task once had the whole limit: eight objectives took nine times as long."""
    x, y = sp.variables(2)
    problem, limits, now = sp.Problem(x + y, [x**2 + y**2 <= 1]), [], SimpleNamespace(wall=100.0)
    own = separate_tasks.solve

    def solve(problem, options, **rest):
        limits.append(options.time_limit)
        now.wall += 5.0
        return own(problem, replace(options, time_limit=None), **rest)

    monkeypatch.setattr(separate_tasks, "solve", solve)
    monkeypatch.setattr(separate_tasks, "time", SimpleNamespace(time=lambda: now.wall))
    options = Options(effort="presolve", time_limit=12.0)
    with ThreadPoolExecutor(1) as pool:
        found = sp.solve_each(problem, [x, y, x + y, x - y], options, executor=pool)
    assert [result.options.time_limit for result in found] == [None] * 4
    assert limits == [12.0, 7.0, 2.0, 1e-3]


def test_an_interrupt_of_a_part_ends_the_whole():
    whole = Deadline(100.0)
    part = whole.part(0.5).part(0.5)
    part.ended(LimitReached())
    assert not (part.stopped or whole.stopped)
    pickle.loads(pickle.dumps(part)).stop()
    assert not whole.stopped
    sibling = whole.part(0.9)
    part.ended(KeyboardInterrupt())
    assert part.stopped and whole.stopped and whole.over
    assert sibling.stopped and sibling.over and pickle.loads(pickle.dumps(sibling)).stopped


def test_threads_keep_their_own_limits():
    raised = []

    def look() -> None:
        budget.check()
        raised.append("nothing")

    with Deadline(1e-9).kept():
        other = threading.Thread(target=look)
        other.start()
        other.join()
    assert raised == ["nothing"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="workers are not forked here")
def test_workers_that_were_started_within_a_limit_go_on_after_it():
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as executor:
        with Deadline(1e-9).kept():
            executor.submit(abs, -1).result()
        assert executor.submit(budget.check).result() is None
        assert executor.submit(budget.before_check).result() == np.inf


@pytest.mark.parametrize("name", ["cpu_limit", "search_limit"])
@pytest.mark.parametrize("value", [-1.0, "1", True, float("nan")])
def test_wrong_limits_are_refused(name, value):
    with pytest.raises(sp.ProblemError, match=f"Options.{name}: found"):
        Options(**{name: value})


# ---- time that ends in the middle -----------------------------------------------------------


class Ending:
    """Calls something until the k-th call, at which time is over."""

    def __init__(self, call, number):
        self.call, self.number, self.calls = call, number, 0

    def __call__(self, *args, **kwargs):
        self.calls += 1
        if self.calls == self.number:
            raise LimitReached
        return self.call(*args, **kwargs)


@pytest.mark.parametrize("effort", ["auto", "presolve", "plain"])
@pytest.mark.parametrize("number", [1, 2])
def test_time_that_ends_in_a_solver_keeps_what_is_proved(effort, number, monkeypatch):
    problem = bilinear()
    monkeypatch.setattr(
        relaxation_bound, "solve_conic", Ending(relaxation_bound.solve_conic, number)
    )
    result = check(problem, sp.solve(problem, Options(effort=effort, order=1, gap=0.0)))
    assert -12.0 - 1e-9 <= result.lower_bound <= least_on_a_grid(problem, 25)


@pytest.mark.parametrize("effort", ["auto", "presolve"])
@pytest.mark.parametrize("number", [1, pytest.param(8, marks=pytest.mark.slow), 40])
def test_time_that_ends_at_any_look_at_the_clock(effort, number, monkeypatch):
    x = sp.variables(3)
    rows = [x[0] * x[2] + x[1] == 1, x[0] ** 2 + x[1] ** 2 <= 2]
    region = sp.Problem(x[0], rows, lower=-2, upper=2)
    ending = Ending(budget.check, number)
    for name, module in list(sys.modules.items()):
        if name.startswith("sparsepop_py.") and getattr(module, "check", None) is budget.check:
            monkeypatch.setattr(module, "check", ending)
    problem = region.with_objective(x[0] * x[1])
    options = Options(effort=effort, gap=0.0, node_limit=3, skip=["full"])
    one = sp.solve(problem, options)
    ending.calls = 0
    ends = [x[0], -x[0], x[1]]
    several = sp.solve_each(region, ends, options)
    point = np.array([1.0, 0.0, 1.0])  # feasible by hand
    for objective, result in zip([x[0] * x[1], *ends], [one, *several], strict=True):
        check(region.with_objective(objective), result)
        assert -4.0 - 1e-9 <= result.lower_bound <= objective(point)


def test_a_tree_that_is_not_verified_in_time_gives_way_to_the_bound_before_it(monkeypatch):
    problem = bilinear()
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
    monkeypatch.setattr(Certificate, "recompute", Ending(Certificate.recompute, 1))
    recompute = Certificate.recompute
    monkeypatch.setattr(
        Certificate, "recompute", lambda self, *args, **kwargs: recompute(self, *args, **kwargs)
    )
    result = sp.solve(problem, Options(effort="auto", gap=5e-2, skip=["linear_tree"]))
    whole = sp.solve(problem, Options(effort="auto", gap=5e-2, skip=["linear_tree"]))
    assert whole.certificate.leaves > 1
    assert result.certificate.leaves == 1
    assert -INF < result.lower_bound < whole.lower_bound
    assert any("before the best bound was verified" in note for note in result.notes)
    assert result.certificate.verify(problem).ok


def test_a_cpu_limit_is_named():
    problem = bilinear()
    result = check(problem, sp.solve(problem, Options(effort="auto", gap=0.0, cpu_limit=1e-6)))
    assert result.status is Status.LIMIT
    assert result.message.startswith("The CPU limit of 1e-06 s ended the work")


def test_a_limit_that_leaves_no_time_to_begin_is_said() -> None:
    x = sp.variables(16)  # a basis of 153: ten steps with dense blocks take far over a second
    problem = sp.Problem(sp.total(x) ** 2 * x[0] * x[1], lower=-1, upper=1)
    result = check(problem, sp.solve(problem, Options(effort="plain", order=2, time_limit=1)))
    assert result.status is Status.LIMIT
    assert any("not begun" in note for note in result.notes)
    assert result.message.startswith("The time limit of 1 s is too short for what the notes name")


def test_a_stopped_linear_program_proves_something():
    rng, x = np.random.default_rng(1), [1.0, *sp.variables(9)]
    triples = [(i, j, k) for i in range(10) for j in range(i + 1) for k in range(j + 1)]
    f = sp.total(float(rng.normal()) * x[i] * x[j] * x[k] for i, j, k in triples if i)
    problem = sp.Problem(f, lower=-1, upper=1)
    box = Interval(problem.lower, problem.upper)
    program = LinearRelaxation.of(problem, box, find_cliques(problem))
    whole = program.minimise().value * program.size
    program = LinearRelaxation.of(problem, box, find_cliques(problem))
    program.model._highs.setOptionValue("simplex_iteration_limit", 30)
    stopped = {highs.highspy.HighsModelStatus.kIterationLimit: "stopped"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(highs, "_STATUS", {**highs._STATUS, **stopped})
        solution = program.minimise()
    assert solution.status == "stopped"
    assert not solution.x.any()
    proved = prove(Replay(problem, None), box, program.objective_dual(solution), False)
    alone = -np.abs(f.coefficients).sum()  # what the box proves
    assert alone + 1.0 < proved.bound <= whole + 1e-6 <= f(np.sign(rng.normal(size=9)))


def test_a_dense_problem_under_a_short_limit_does_something_or_says_why(monkeypatch):
    rng, x = np.random.default_rng(0), sp.variables(6)
    f = sp.total(
        float(rng.normal()) * x[i] * x[j] * x[k]
        for i in range(6)
        for j in range(i + 1)
        for k in range(j + 1)
    )
    problem = sp.Problem(f, lower=-1, upper=1)
    # as on a machine on which all but linear programs take too long
    monkeypatch.setattr(
        "sparsepop_py.strategy.relaxation_queue.RelaxationQueue.seconds",
        lambda queue, spec: 1e9,
    )
    result = check(problem, sp.solve(problem, Options(effort="auto", time_limit=30.0)))
    assert [entry.name for entry in result.history][0] == "linear"
    assert result.lower_bound > -np.abs(f.coefficients).sum()  # what the box alone proves
    if result.status is not Status.OPTIMAL:
        assert any("too long for the time left: order 2" in note for note in result.notes)
    assert "effort 'auto'" not in result.message


def test_building_a_relaxation_looks_at_the_clock():
    problem = bilinear()
    relaxation = sp.relax(problem, 2)
    system = generators.stacked(problem, relaxation.products)
    given = relaxation.groups, system, [problem.objective.words], problem.dimension
    with Deadline(1e-9).kept(), pytest.raises(LimitReached):
        conic_rows(*given)
    moments, entries = conic_rows(*given)
    assert moments.tolist() == relaxation.moments.tolist()
    assert entries.shape == (relaxation.rows, moments.shape[0] + 1)


# ---- messages -------------------------------------------------------------------------------


def test_advice_names_nothing_that_was_used():
    problem = bilinear()
    plain = sp.solve(problem, Options(effort="plain", order=1, gap=0.0))
    assert "effort 'presolve', effort 'auto', order 2" in plain.message
    presolve = sp.solve(problem, Options(order=1, gap=0.0))
    assert "effort 'presolve'" not in presolve.message
    assert "effort 'auto'" in presolve.message
    few = sp.solve(
        problem, Options(effort="auto", gap=0.0, node_limit=1, skip=["full", "star", "mixed"])
    )
    assert few.status is Status.BOUNDED
    assert "effort" not in few.message
    assert "a larger node_limit" in few.message
    assert "skip" in few.message
    for result in (plain, presolve, few):
        assert result.message in result.summary()


def test_messages_name_the_cause_of_a_missing_bound():
    x, y = sp.variables(2)
    disc = sp.Problem(x * y, [x**2 + y**2 <= 1])
    large = sp.solve(disc, Options(effort="plain", order=2, memory_limit=1.0))
    assert large.status is Status.UNPROVED
    assert "the relaxation is too large, as the notes say. Try" in large.message
    assert "a lower order" in large.message
    assert large.notes[0].startswith("the relaxation of order 2 needs more than")
    two = {"typeCone": 1, "dimVar": 1, "noTerms": 1, "supports": [[2]], "coef": [1]}
    param = {"SDPsolverSW": 0, "printLevel": 0}
    built = sp.sparsePOP(two, [], [-1], [1], param).POP.result
    assert built.message.startswith("Nothing is proved, since no relaxation was solved. Try")
    assert "tighter bounds of all variables" in built.message  # they have bounds
    free = sp.solve(sp.Problem(x**3 - y, [y <= x]), Options(effort="plain"))
    assert free.status in (Status.UNPROVED, Status.UNBOUNDED)
    assert "none follow" not in free.message
    with pytest.raises(sp.ProblemError, match=r"Options.seed: .* expected an integer >= 0 below"):
        Options(seed=2**70)


def test_unbounded_problems_need_no_search(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("a local search ran")

    monkeypatch.setattr(incumbents, "best_attained", never)
    x = sp.variables(2, ["x1", "x2"])
    for effort in ("presolve", "auto"):
        result = sp.solve(sp.Problem(-x[0]), Options(effort=effort))
        assert result.status is Status.UNBOUNDED
        assert result.ray.tolist() == [1.0, 0.0]
        assert result.message.endswith("along the ray from x that changes x1 by +1.")


# ---- local search ---------------------------------------------------------------------------


def test_local_searches_keep_their_budget(monkeypatch):
    searched = []
    original = multistart.local_search
    monkeypatch.setattr(
        multistart, "local_search", lambda *args: searched.append(1) or original(*args)
    )
    problem = bilinear()
    for options in (Options(search_limit=0.0), Options(refine="none")):
        result = check(problem, sp.solve(problem, options))
        assert not searched
        assert result.attained is None
        assert result.lower_bound > -INF
    # min -x*y on [0, 1]^2 is at a corner that the moments name
    u, v = sp.variables(2)
    simple = sp.Problem(-u * v + u**2 / 2, lower=0, upper=1)
    result = check(simple, sp.solve(simple, Options(refine="prove")))
    assert not searched
    assert result.status is Status.OPTIMAL
    assert result.upper_bound == pytest.approx(-0.5, abs=1e-6)
    sp.solve(problem, Options(search_limit=100.0))
    assert searched


# ---- work limits ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "effort"),
    [
        ("bilinear", "presolve"),
        ("laboratory", "auto"),
        ("free", "auto"),
        ("free", "presolve"),
        pytest.param("bilinear", "auto", marks=pytest.mark.slow),
        pytest.param("laboratory", "presolve", marks=pytest.mark.slow),
    ],
)
def test_more_work_never_proves_or_attains_less(name, effort):
    x = sp.variables(4)
    free = sp.Problem(sp.total((x[i] ** 2 - x[i + 1]) ** 2 + x[i] ** 4 - x[i] for i in range(3)))
    problem = {"bilinear": bilinear(), "laboratory": sp.problems.laboratory(), "free": free}[name]
    low, high = -INF, INF
    for limit in (0.003, 0.02, 0.1, 0.5):
        result = check(problem, sp.solve(problem, Options(effort=effort, work_limit=limit)))
        assert result.lower_bound >= low
        assert result.upper_bound <= high
        low, high = result.lower_bound, result.upper_bound
    assert low > -INF


# ---- progress -------------------------------------------------------------------------------


@pytest.mark.parametrize("effort", ["auto", "presolve"])
def test_progress_brackets_the_minimum_and_only_improves(effort):
    problem, seen = bilinear(), []
    options = Options(effort=effort, gap=1e-3)
    result = sp.solve(problem, options, on_progress=lambda *state: seen.append(state))
    assert {number for number, _, _ in seen} == {0}
    lows, highs_ = [low for _, low, _ in seen], [high for _, _, high in seen]
    assert lows == sorted(lows)
    assert highs_ == sorted(highs_, reverse=True)
    assert lows[-1] <= least_on_a_grid(problem, 25)
    assert highs_[-1] == result.upper_bound
    assert len(set(seen)) > 1


def test_an_interrupt_in_a_callback_ends_the_search():
    problem, calls = bilinear(), []

    def stop(number: int, low: float, high: float) -> None:
        calls.append(low)
        if low > -INF:
            raise KeyboardInterrupt

    result = check(problem, sp.solve(problem, Options(effort="auto", gap=0.0), on_progress=stop))
    assert result.status is Status.INTERRUPTED
    assert result.message == Status.INTERRUPTED.message
    assert "user" in result.message
    assert result.lower_bound >= calls[-1] > -INF


def test_bounds_are_reported_again_although_they_do_not_change(monkeypatch):
    monkeypatch.setattr(progress, "_REPORTED", -1.0)
    seen = []
    stages = progress.Stages(False, lambda *state: seen.append(state))
    with stages.stage("solve"):
        pass
    assert not seen  # nothing is known yet
    stages.bounds(1.0, 2.0)
    stages.bounds(1.0, 2.0)
    with stages.of_objective(3).stage("solve"):
        pass
    with stages.stage("solve"):
        pass
    assert seen == [(0, 1.0, 2.0), (0, 1.0, 2.0)]


class Terminal:
    """Standard error that says it is a terminal, or not."""

    def __init__(self, terminal: bool) -> None:
        self.terminal, self.text = terminal, ""

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


@pytest.fixture
def no_tqdm(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)


def test_a_terminal_shows_bounds_rounded_outwards(monkeypatch, no_tqdm):
    terminal = Terminal(True)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(progress, "_REDRAWN", 0.01)
    stages = progress.Stages(True)
    stages.bounds(-1.0 / 3.0, 2.0 / 3.0)
    with stages.stage("solve"):
        for _ in range(1000):
            if terminal.text.count("solve ...") > 3:  # drawn anew while nothing happens
                break
            time.sleep(0.01)
    stages.close()
    assert terminal.text.count("solve ...") > 3
    assert "-0.33333334 <= minimum <= 0.66666667  solve ..." in terminal.text
    assert terminal.text.endswith("\r\x1b[K")
    assert not [t for t in threading.enumerate() if t.name == "progress line"]


@pytest.mark.parametrize("stream", [None, "closed"])
def test_progress_without_standard_error_is_silent(
    stream: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Services have none."""
    found = None
    if stream:
        found = io.StringIO()
        found.close()
    monkeypatch.setattr("sys.stderr", found)
    line = progress.Line(True)
    line.draw("solve ...")
    line.close()


def test_files_see_nothing_and_notebooks_do(monkeypatch, no_tqdm):
    terminal = Terminal(False)
    monkeypatch.setattr(sys, "stderr", terminal)
    line = progress.Line(True)
    line.draw("nothing")
    line.close()
    assert not terminal.text
    kernel = ModuleType("IPython")
    kernel.get_ipython = lambda: SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    line = progress.Line(True)
    line.draw("something")
    line.close()
    assert "something" in terminal.text


def test_tqdm_draws_where_it_is_installed(monkeypatch):
    shown = []

    class Bar:
        def __init__(self, **options):
            shown.append(options["bar_format"])

        def set_description_str(self, text):
            shown.append(text)

        def close(self):
            shown.append("closed")

    module = ModuleType("tqdm.auto")
    module.tqdm = Bar
    monkeypatch.setitem(sys.modules, "tqdm", ModuleType("tqdm"))
    monkeypatch.setitem(sys.modules, "tqdm.auto", module)
    monkeypatch.setattr(sys, "stderr", Terminal(True))
    line = progress.Line(True)
    line.draw("solve ...")
    line.close()
    assert shown[0] == "{desc}"
    assert "solve ..." in shown[1]
    assert shown[-1] == "closed"


def test_the_log_has_the_names_of_the_package(caplog):
    with caplog.at_level(logging.DEBUG, "sparsepop_py"):
        sp.solve(bilinear(), Options(order=1))
    assert {record.name.split(".")[0] for record in caplog.records} == {"sparsepop_py"}
    levels = {record.levelno for record in caplog.records}
    assert levels == {logging.DEBUG, logging.INFO}
    assert any("proved" in r.getMessage() for r in caplog.records if r.levelno == logging.INFO)


def test_nothing_is_printed_without_a_handler(capfd):
    sp.solve(bilinear(), Options(effort="auto", order=1, progress=True))
    assert capfd.readouterr() == ("", "")


assert tree  # loaded, so that looks at the clock in it are replaced above


def test_a_solver_that_cannot_be_stopped_is_not_begun_without_time(monkeypatch):
    x = sp.variables(4)
    f = sp.total(x[i] * x[j] ** 3 - x[i] ** 2 for i in range(4) for j in range(4))
    problem = sp.Problem(f, [sp.total(v**2 for v in x) <= 2], -1, 1)
    program = sp.assemble(sp.relax(problem, 2), f)
    assert sp.solve_conic(program, "clarabel", 10.0).status == "solved"
    monkeypatch.setattr(solvers, "_RATE", 1e3)  # a very slow machine
    assert sp.solve_conic(program, "clarabel", 10.0).detail == solvers.NOT_BEGUN
    assert sp.solve_conic(program, "clarabel", 1e9).status == "solved"
    assert sp.solve_conic(program, "cliquetree", 10.0).status == "solved"
    result = check(problem, sp.solve(problem, Options(solver="clarabel", time_limit=30.0)))
    assert result.status is Status.LIMIT
    assert any(solvers.NOT_BEGUN in note for note in result.notes)
    assert result.lower_bound >= -32.0  # 16 products of |x| <= 1 and 4 * 4 squares


@pytest.mark.parametrize("size", [pytest.param(1e100, marks=pytest.mark.slow), 1e155, 1e200])
@pytest.mark.parametrize("effort", ["presolve", "auto"])
def test_huge_boxes_give_no_warnings(size, effort):
    """Warnings are errors here: values beyond all doubles prove nothing, and that is all.

    x = y = 0 is feasible in the last problem and has the value 0.
    """
    x, y = sp.variables(2)
    rows = [-0.5 - x * y**2 >= 0, 10.5 - 2 * y - 2 * x**2 + 5 * y**3 >= 0]
    for problem in (
        sp.Problem(x**3 + 8 * x**2 * y, rows, -size, size),
        sp.Problem(x * y + x, [x * y >= 1], -size, size),
        sp.Problem(x**4 - 3 * x * y, [x**2 + y**2 <= 4], -size, size),
    ):
        result = sp.solve(problem, sp.Options(effort=effort, work_limit=0.3))
        assert result.certificate is None or result.certificate.verify(problem).ok
    assert result.lower_bound <= 0.0
    assert np.isnan((x**2 - y**2)([1e200, 1e200]))
