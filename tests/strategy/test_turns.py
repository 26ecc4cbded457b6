"""Turns of objectives on executors: what is proved does not depend on them."""

from __future__ import annotations

import pickle
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from math import sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from loop_cases import ALL_SPECS
from search_cases import bilinear
from star_record import ENDS as ENDS_OF_RECORD
from star_record import least, record

import sparsepop_py as sp
from sparsepop_py import Options, Status
from sparsepop_py.branch_and_bound.tree import SearchTree
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.executors.dispatch import workers_of
from sparsepop_py.executors.processes import Processes
from sparsepop_py.relaxation.hierarchy import CostModel
from sparsepop_py.strategy import multi_objective
from sparsepop_py.strategy.multi_objective import MultiObjectiveSearch, _RepairOnce
from sparsepop_py.strategy.turns import FirstSearch, Turn, TurnsApart

ENDS = ((sqrt(3) - 1) / 2, (sqrt(3) + 1) / 2)  # by hand, in docs/many_objectives.md


def bounded(executor, **given):
    """Results for the four ends of a region whose ends are known."""
    x1, x2 = sp.variables(2)
    region = sp.Problem(x1, [x1**2 + x2**2 <= 2, x1 * x2 >= 0.5], lower=0, upper=2)
    options = Options(effort="auto", gap_kind="width", gap=1e-3)
    return sp.solve_each(region, [x1, -x1, x2, -x2], options, executor=executor, **given)


def checked(results):
    """All ends are proved to the gap, and hold."""
    known: dict = {}
    for number, result in enumerate(results):
        assert result.status is Status.OPTIMAL
        assert result.certificate.verify(result.problem, known).ok
        end = ENDS[0] if number % 2 == 0 else -ENDS[1]
        assert end - 1e-3 <= result.lower_bound <= end


class Here(Executor):
    """Does tasks at once, as another process would: through pickles."""

    workers = 2

    def __init__(self, tasks: int = 10**9) -> None:
        self.left, self.names = tasks, []

    def submit(self, fn, /, *args, **kwargs) -> Future:
        if not self.left:
            raise RuntimeError("closed")
        self.left -= 1
        self.names.append(getattr(args[0], "__name__", ""))
        job: Future = Future()
        call = pickle.loads(pickle.dumps((fn, args, kwargs)))
        job.set_result(pickle.loads(pickle.dumps(call[0](*call[1], **call[2]))))
        return job


def test_turns_in_processes():
    with Processes(2) as pool:
        checked(bounded(pool))


def test_turns_in_threads():
    with ThreadPoolExecutor(2) as pool:
        checked(bounded(pool))


def test_objectives_go_to_the_workers_and_come_back_whole():
    executor, steps = Here(), []
    results = bounded(executor, on_progress=lambda *bounds: steps.append(bounds))
    checked(results)
    assert executor.names.count("_in_worker") >= 2
    assert {number for number, *_ in steps} == {0, 1, 2, 3}
    for result in results:
        assert result.options.executor is executor
        assert result.timings


class Lost(Here):
    """Loses a worker in each turn."""

    def submit(self, fn, /, *args, **kwargs) -> Future:
        job: Future = Future()
        job.set_exception(RuntimeError("lost"))
        return job


def test_lost_turns_are_taken_here():
    checked(bounded(Lost()))


class Limited(Here):
    """Does turns within limits of its own, which have passed."""

    def submit(self, fn, /, *args, **kwargs) -> Future:
        with Deadline(1e-9).kept():
            return super().submit(fn, *args, **kwargs)


def test_turns_that_end_before_their_limit_are_taken_here():
    executor = Limited(40)
    results = bounded(executor)
    checked(results)
    assert any("the executor failed (LimitReached)" in note for r in results for note in r.notes)
    assert executor.left


def test_an_interrupt_in_a_worker_keeps_what_its_turn_has_proved(monkeypatch):
    """Ctrl-C reaches all processes; the one that began the work ends it."""
    take, taken = Turn.take, []

    def interrupted(turn):
        take(turn)
        taken.append(turn)
        raise KeyboardInterrupt

    monkeypatch.setattr(Turn, "take", interrupted)
    results = bounded(Here())
    checked(results)
    assert taken and not any("executor failed" in note for r in results for note in r.notes)


class Hanging(Here):
    """Never brings a turn back."""

    def submit(self, fn, /, *args, **kwargs) -> Future:
        return Future()


def closed(results):
    """Number of ends that are proved to the gap; all that is proved holds."""
    assert all(result.certificate.verify(result.problem).ok for result in results)
    return sum(result.upper_bound - result.lower_bound <= 1e-3 for result in results)


@pytest.mark.parametrize("cause", [KeyboardInterrupt, LimitReached])
def test_turns_that_are_done_when_the_work_ends_are_kept(cause, monkeypatch):
    def ended(apart, waits):
        raise cause

    monkeypatch.setattr(TurnsApart, "finished", ended)
    monkeypatch.setattr(MultiObjectiveSearch, "_run", lambda *_: pytest.fail("went on"))
    assert closed(bounded(Here())) == 4


def test_an_interrupt_after_one_turn_keeps_the_others(monkeypatch):
    shared = []

    def interrupted(self, index):
        shared.append(index)
        raise KeyboardInterrupt

    monkeypatch.setattr(MultiObjectiveSearch, "_share", interrupted)
    assert closed(bounded(Here())) == 4
    assert len(shared) == 1


def test_hanging_turns_end_with_the_limit():
    x1, x2 = sp.variables(2)
    region = sp.Problem(x1, [x1**2 + x2**2 <= 2, x1 * x2 >= 0.5], lower=0, upper=2)
    options = Options(effort="auto", time_limit=0.5, executor=Hanging())
    results = sp.solve_each(region, [x1, -x1], options)
    assert all(result.lower_bound >= -2 for result in results)


def test_turns_end_where_nothing_is_left_to_try():
    """Gaps of rounding stay open without branching; incumbents come back as themselves."""
    x1, x2, x3 = sp.variables(3)
    rows = [x1**2 + x2**2 <= 2, x1 * x2 >= 0.5, x1 * x3 + x2 * x2 == 0.6]
    region = sp.Problem(x1, rows, lower=0, upper=2)
    executor = Here(60)
    options = Options(effort="auto", gap=1e-12, skip=("branch", "full"), executor=executor)
    results = sp.solve_each(region, [x1, -x1, x2, -x2], options)
    assert any(result.status is Status.BOUNDED for result in results)
    assert 4 <= executor.names.count("_in_worker") < 30
    assert not any("the executor failed" in note for result in results for note in result.notes)


def test_counted_work_stays_in_this_process():
    x1, x2 = sp.variables(2)
    region = sp.Problem(x1, [x1**2 + x2**2 <= 2, x1 * x2 >= 0.5], lower=0, upper=2)
    executor = Here()
    options = Options(effort="auto", gap=1e-3, work_limit=5.0, executor=executor)
    sp.solve_each(region, [x1, -x1, x2, -x2], options)
    assert "_in_worker" not in executor.names


def test_a_tree_comes_back_from_a_pickle(monkeypatch):
    """The tree is pickled after every third node."""
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
    grow = SearchTree.grow

    def through_a_pickle(self, nodes, stop, executor=None):
        search = self.search_incumbent
        self.search_incumbent = _no_search
        self.__dict__.update(pickle.loads(pickle.dumps(self)).__dict__)
        self.search_incumbent = search
        return grow(self, min(nodes, 3), stop, executor)

    monkeypatch.setattr(SearchTree, "grow", through_a_pickle)
    problem = bilinear()
    result = sp.solve(problem, Options(effort="auto", gap=5e-2, skip=("linear_tree",)))
    assert result.status is Status.OPTIMAL
    assert result.certificate.verify(problem).ok
    assert result.certificate.leaves > 3


def _no_search(context, vectors):
    return context


def test_a_repair_that_does_not_pickle_leaves_vectors_as_they_are():
    repair, x = _RepairOnce(lambda x: x + 1.0), np.array([1.0, 2.0])
    assert repair(x).tolist() == [2.0, 3.0]
    assert pickle.loads(pickle.dumps(repair))(x).tolist() == [1.0, 2.0]
    assert pickle.loads(pickle.dumps(_RepairOnce(np.negative)))(x).tolist() == [-1.0, -2.0]


def test_workers_of():
    assert workers_of(None) == 0
    assert workers_of(Processes(3)) == 3
    with ThreadPoolExecutor(5) as pool:
        assert workers_of(pool) == 5
    assert workers_of(Executor()) > 1


def test_cost_models_record_only_for_another_process(monkeypatch):
    models = []
    learn = CostModel.learn

    def watched(self, *record, **more):
        learn(self, *record, **more)
        models.append((self.learned is None, self.seconds[record[0]]))

    monkeypatch.setattr(CostModel, "learn", watched)
    bounded(None)
    assert models and all(silent for silent, _ in models)
    models.clear()
    checked(bounded(Here()))
    assert {silent for silent, _ in models} == {True, False}  # those of workers, and this one's


# ---- first searches and last trees --------------------------------------------------------------


def ends_of_record(executor, **how):
    """Search for the ends of a and b of the record of test_obbt_sdp, which has a star."""
    problem = record()
    objectives = [record(v, s).objective for v in (0, 1) for s in (1.0, -1.0)]
    options = Options(**{"effort": "auto", "gap_kind": "width", "gap": 1e-3} | how)
    return sp.solve_each(problem, objectives, options, executor=executor)


def checked_record(results):
    for result, (v, sign) in zip(results, ENDS_OF_RECORD, strict=True):
        assert result.status is Status.OPTIMAL
        assert result.certificate.verify(result.problem).ok
        least_known = least(record(v, sign))
        assert least_known - 0.01 <= result.lower_bound <= least_known + 1e-9


def test_first_turns_begin_once_both_objectives_of_a_pair_were_searched(monkeypatch):
    begin, begun = TurnsApart.begin, []

    def noted(apart, number, turn):
        begun.append((number, type(turn).__name__))
        begin(apart, number, turn)

    monkeypatch.setattr(TurnsApart, "begin", noted)
    checked_record(ends_of_record(Here()))
    searched = [number for number, kind in begun if kind == "FirstSearch"]
    assert sorted(searched) == [0, 1, 2, 3]
    for number in range(4):
        first = begun.index((number, "Turn"))
        assert (number, "FirstSearch") in begun[:first]
        assert (number ^ 1, "FirstSearch") in begun[:first]


def test_searches_on_working_sets_come_back_with_those_of_the_whole(monkeypatch):
    """Else the whole would never hear of what its set has proved."""
    returned, known = MultiObjectiveSearch._returned, []

    def noted(self, index, turn, apart):
        returned(self, index, turn, apart)
        for each, whole in zip(self.working_sets, self.searches, strict=True):
            assert each.whole is whole
        known.append(type(turn).__name__)

    monkeypatch.setattr(MultiObjectiveSearch, "_returned", noted)
    monkeypatch.setattr(multi_objective, "suits", lambda search: True)
    checked_record(ends_of_record(Here()))
    assert set(known) == {"FirstSearch", "Turn"}


@pytest.mark.parametrize("tasks", [0, 1, 3])
@pytest.mark.parametrize(
    ("work", "holds"), [(bounded, checked), (ends_of_record, checked_record)], ids=["", "star"]
)
def test_what_an_executor_refuses_is_done_here(work, holds, tasks):
    """Turns, and where there is a star first searches."""
    results = work(Here(tasks))
    holds(results)
    assert any("the executor failed" in note for result in results for note in result.notes)


@pytest.mark.parametrize(
    ("unsearched", "over", "goes"),
    [(set(), False, True), ({0}, False, True), ({1}, False, False), ({1}, True, True)],
)
def test_a_turn_waits_for_the_search_of_the_other_objective_of_its_pair(unsearched, over, goes):
    """Unless that needs none any more."""
    searches = [SimpleNamespace(over=False, exhausted=False), SimpleNamespace(over=over)]
    several = SimpleNamespace(searches=searches, pairs={0: 1, 1: 0}, unsearched=unsearched)
    assert MultiObjectiveSearch._goes_on(several, 0, SimpleNamespace(objectives=set()), {}) is goes


def test_no_search_begins_once_time_is_over(monkeypatch):
    taken = []
    monkeypatch.setattr(FirstSearch, "take", lambda search: taken.append(search))
    monkeypatch.setattr(MultiObjectiveSearch, "_turns_apart", lambda self: self.deadline.stop())
    results = ends_of_record(Here())
    assert not taken and all(result.status is not Status.OPTIMAL for result in results)


@pytest.mark.parametrize(("others", "few"), [(2, True), (3, False)])
def test_a_tree_is_grown_here_where_few_objectives_are_left(others, few):
    searches = [SimpleNamespace(over=k > others, branches=True) for k in range(6)]
    options = SimpleNamespace(executor=Here())
    several = SimpleNamespace(searches=searches, options=options, working_sets=[])
    assert MultiObjectiveSearch._is_divided(several, 0) is few
    searches[0].branches = False
    assert not MultiObjectiveSearch._is_divided(several, 0)


def test_trees_of_the_last_objectives_are_grown_here(monkeypatch):
    """Workers have their nodes, and the relaxations that tighten these."""
    executor, here = Here(), []
    run = MultiObjectiveSearch._run

    def noted(self, index, most):
        here.append(sum(not search.over for search in self.searches))
        run(self, index, most)

    monkeypatch.setattr(MultiObjectiveSearch, "_run", noted)
    skipped = ("linear", "split", "mixed", "full", "obbt_lp")
    results = ends_of_record(executor, skip=skipped, gap=1e-6)
    checked_record(results)
    assert here and max(here) <= 1 + executor.workers


def test_a_turn_elsewhere_ends_before_a_tree_begins():
    steps = []
    search = SimpleNamespace(
        context=SimpleNamespace(upper=1.0),
        bound=0.0,
        gap_ratio=5.0,
        over=False,
        branches=False,
        restart=lambda model: None,
    )

    def run(most):
        steps.append(most)
        search.bound += 0.6 * (1.0 - search.bound)
        search.branches = len(steps) == 2

    search.run = run
    Turn(search, None, None, 5, returns=True).take()
    assert len(steps) == 2
    Turn(search, None, None, 2, returns=True).take()  # where it is the first step it is taken
    assert len(steps) == 4
    search.bound = 0.0
    Turn(search, None, None, 3).take()
    assert len(steps) == 7
