"""Bounds from a working set of constraints: against linear programs, and against all of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import linprog
from solved import check

import sparsepop_py as sp
from sparsepop_py import Options, Problem, Status
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search import slp
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.hierarchy import CostModel
from sparsepop_py.strategy import settings, working_set
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.strategy.turns import Turn
from sparsepop_py.strategy.working_set import WorkingSetSearch
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import BoxProof, Tightening

WIDTH = Options(effort="auto", gap=1e-3, gap_kind="width", time_limit=60.0)
SAMPLES, NOISE, TRUTH = 81, 0.05, (0.6, 1.0)


def record(seed=3, samples=SAMPLES):
    """Input and output of y_k = .6 y_k-1 + u_k, the output with noise of at most .05."""
    random = np.random.default_rng(seed)
    u, y = random.uniform(-1, 1, samples), np.zeros(samples)
    for k in range(1, samples):
        y[k] = TRUTH[0] * y[k - 1] + TRUTH[1] * u[k]
    return u, y + random.uniform(-NOISE, NOISE, samples)


def problem_of(u, y):
    samples = u.size
    x = sp.variables(2 + samples)
    a, b, e = x[0], x[1], x[2:]
    rows = [y[k] - e[k] - a * (y[k - 1] - e[k - 1]) - b * u[k] == 0 for k in range(1, samples)]
    low = np.r_[-0.95, -5.0, np.full(samples, -NOISE)]
    return Problem(a, rows, low, np.r_[0.95, 5.0, np.full(samples, NOISE)])


def feasible(u, y, a):
    """Least and largest b for a given a, by a linear program in b and the noise; None if none."""
    samples = u.size
    matrix, right = np.zeros((samples - 1, 1 + samples)), np.zeros(samples - 1)
    for k in range(1, samples):
        matrix[k - 1, 0], matrix[k - 1, 1 + k], matrix[k - 1, k] = u[k], 1.0, -a
        right[k - 1] = y[k] - a * y[k - 1]
    bounds = [(-5, 5)] + [(-NOISE, NOISE)] * samples
    ends = []
    for sign in (1.0, -1.0):
        cost = np.zeros(1 + samples)
        cost[0] = sign
        found = linprog(cost, A_eq=matrix, b_eq=right, bounds=bounds)
        if found.status != 0:
            return None
        ends.append(sign * found.fun)
    return ends


def end_of(u, y, side):
    """The end of the feasible values of a on one side of the truth, by bisection."""
    inside, outside = TRUTH[0], side * 0.95
    assert feasible(u, y, inside) is not None and feasible(u, y, outside) is None
    for _ in range(30):
        middle = 0.5 * (inside + outside)
        if feasible(u, y, middle) is None:
            outside = middle
        else:
            inside = middle
    return inside


def both_ends(problem, options=WIDTH):
    x = sp.variables(problem.dimension)
    ends = [side * v for v in x[:2] for side in (1.0, -1.0)]
    results = sp.solve_each(problem, ends, options)
    for end, result in zip(ends, results, strict=True):
        check(problem.with_objective(end), result)
    return results


def sizes(results):
    """Constraints of the working sets that were used."""
    names = [entry.name for result in results for entry in result.history]
    return [int(name.split()[-2]) for name in names if name.endswith("constraints")]


def test_ends_agree_with_linear_programs_at_fixed_poles():
    u, y = record()
    results = both_ends(problem_of(u, y))
    assert all(result.status is Status.OPTIMAL for result in results)
    width = -results[1].upper_bound - results[0].upper_bound
    for result, side in zip(results[:2], (-1.0, 1.0), strict=True):
        end = -side * end_of(u, y, side)
        assert result.lower_bound <= end + 1e-7
        assert result.lower_bound >= end - 1.1e-3 * width - 1e-7
    assert sizes(results) and max(sizes(results)) <= 0.8 * (SAMPLES - 1)


def test_a_set_that_is_not_enough_grows(monkeypatch):
    """Three constraints are too few: those that contradict what they admit join them."""
    monkeypatch.setattr(working_set, "row_prices", lambda *_, **__: 1.0 * (np.arange(80) < 3))
    u, y = record()
    results = both_ends(problem_of(u, y))
    assert all(result.status is Status.OPTIMAL for result in results)
    assert sizes(results) and min(sizes(results)) > 4


@pytest.fixture(autouse=True)
def worth_it(monkeypatch):
    """Working sets also where a relaxation of all constraints takes no time."""
    chosen = settings.WorkingSetSettings(long_star_seconds=0.0)
    monkeypatch.setattr(working_set, "WORKING_SET", chosen)


@pytest.mark.slow
def test_a_set_that_would_become_too_large_stays(monkeypatch):
    """Where more constraints do not fit, the bound of the set there is comes first."""
    price = 1.0 * (np.arange(80) < 3)
    monkeypatch.setattr(working_set, "row_prices", lambda *_, **__: price)
    small = settings.WorkingSetSettings(largest_share=0.06, long_star_seconds=0.0)  # four of 80
    monkeypatch.setattr(working_set, "WORKING_SET", small)
    results = both_ends(problem_of(*record()))
    assert all(result.status is Status.OPTIMAL for result in results)
    assert sizes(results) and max(sizes(results)) <= 4


@pytest.mark.parametrize("case", ["none", "all", "quick", "skipped"])
def test_without_a_small_set_all_constraints_are_used(case, monkeypatch):
    options = WIDTH
    if case == "none":
        monkeypatch.setattr(working_set, "row_prices", lambda *_, **__: np.zeros(80))
    elif case == "all":
        least = settings.WorkingSetSettings(largest_share=0.0, long_star_seconds=0.0)
        monkeypatch.setattr(working_set, "WORKING_SET", least)
    elif case == "quick":
        monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    else:
        options = Options(
            effort="auto", gap=1e-3, gap_kind="width", time_limit=60.0, skip=["working_set"]
        )
    results = both_ends(problem_of(*record()), options)
    assert all(result.status is Status.OPTIMAL for result in results)
    assert not sizes(results)


@pytest.mark.parametrize(
    ("seconds", "samples", "worth"),
    [
        (0.7, 49, True),  # .015 s a constraint
        (0.7, 99, False),  # .007 s: linear programs over all cost as much as the star
        (1.2, 99, True),
        (0.5, 49, False),
        (2.6, 301, True),
        (0.7, 39, False),  # 38 constraints
    ],
)
def test_sets_are_worth_it_where_constraints_are_costly(seconds, samples, worth, monkeypatch):
    monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    monkeypatch.setattr(working_set, "_star_seconds", lambda _: seconds)
    assert working_set.suits(search_on(problem_of(*record(samples=samples)))) is worth


@pytest.mark.parametrize(
    ("long", "gained", "used"),
    [
        (False, (0.2,), False),
        (False, (0.8,), True),
        (False, (0.8, 0.2), False),  # .56 in the mean: what is new counts most
        (False, (), True),  # the first objective
        (True, (0.2,), True),
    ],
)
def test_sets_that_gain_little_leave_other_objectives_to_the_whole(long, gained, used, monkeypatch):
    monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    costs = CostModel()
    for progress in gained:
        costs.learn("first step", progress, 0.1, goes_on=True)
    own = WorkingSetSearch(whole_search(), costs, long)
    assert own.step() is used
    assert own.done is not used


def test_prices_of_a_small_problem():
    """x >= 1 binds at 1, x >= -5 does not; x = 3 contradicts x y = 6 with y <= 1."""
    x, y = sp.variables(2)
    problem = Problem(x, [x >= 1, x >= -5, x * y <= 100], lower=-10, upper=10)
    held = np.array([0])
    assert np.flatnonzero(slp.row_prices(problem, np.array([1.0, 0.0]), held)).tolist() == [0]
    other = Problem(x, [x * y == 6, x + y <= 4, y >= -9], lower=-10, upper=10)
    price = slp.conflict_prices(other, np.array([3.0, 0.0]), held)
    assert np.flatnonzero(price).tolist() == [0, 1]
    assert not slp.conflict_prices(other, np.array([-1.0, 0.0]), held).any()


def test_an_infeasible_record_is_proved_empty():
    u, y = record()
    y = y.copy()
    y[40] += 1.0  # no noise of .05 explains it
    results = both_ends(problem_of(u, y))
    assert all(result.status is Status.INFEASIBLE for result in results)


@pytest.mark.slow
def test_the_star_on_all_constraints_follows_a_set_that_took_longer(monkeypatch):
    monkeypatch.setattr(working_set, "row_prices", lambda *_, **__: 1.0 * (np.arange(80) < 3))
    monkeypatch.setattr(WorkingSetSearch, "_complete", lambda *_: None)  # the set stays too small
    names = {}
    counted = replace(WIDTH, time_limit=None, work_limit=2.0)  # this set closes nothing
    for share, options in ((0.0, WIDTH), (np.inf, counted)):
        chosen = settings.WorkingSetSettings(long_star_seconds=0.0, star_seconds_before_whole=share)
        monkeypatch.setattr(working_set, "WORKING_SET", chosen)
        results = both_ends(problem_of(*record()), options)
        if share == 0.0:
            assert all(result.status is Status.OPTIMAL for result in results)
        names[share] = [[entry.name for entry in result.history] for result in results]
    longer = [each for each in names[0.0] if len(each) > 1]
    assert longer and not any(each[1].endswith("constraints") for each in longer)
    assert any(len(each) > 1 and each[1].endswith("constraints") for each in names[np.inf])


@pytest.mark.parametrize(
    ("nodes", "gaps", "slow"),
    [
        ((1,), (100.0, 60.0), True),
        ((1,), (100.0, 40.0), False),
        ((1, 2), (100.0, 40.0, 40.0), False),  # the second of two children moves the bound
        ((1, 2, 3), (100.0, 40.0, 40.0, 19.0), False),
        ((1, 2, 3), (100.0, 40.0, 40.0, 21.0), True),
        ((9, 90), (100.0, 40.0, 39.0), True),
        ((0, 0), (100.0, 90.0, 80.0), False),  # relaxations are not judged
    ],
)
def test_a_tree_is_slow_where_two_nodes_leave_more_than_half_of_the_gap(nodes, gaps, slow):
    own = with_tree(0, gaps[0])
    for own.search.tree.seen, before, own.search.gap_ratio in zip(
        nodes, gaps[:-1], gaps[1:], strict=True
    ):
        found = own._slow(before)
    assert found == slow


def with_tree(nodes, left, whole=None):
    """A search on a working set whose tree has nodes and leaves a gap."""
    search = SimpleNamespace(tree=SimpleNamespace(seen=nodes), gap_ratio=left, point=np.zeros(1))
    return WorkingSetSearch(cast(Any, whole), CostModel(), search=cast(Any, search))


def test_a_tree_on_a_set_is_not_interrupted():
    star = SimpleNamespace(shape="star")
    whole = SimpleNamespace(queue=SimpleNamespace(specs=[star], seconds=lambda spec: 1.0))
    for nodes, interrupted in ((0, True), (1, False)):
        own = with_tree(nodes, 50.0, whole)
        own.spent = 1.1 * settings.WORKING_SET.star_seconds_before_whole
        assert own._whole_first() == interrupted


@pytest.mark.parametrize(
    "left", [share * settings.STRATEGY.small_gap_ratio for share in (0.9, 1.1)]
)
@pytest.mark.parametrize(("nodes", "slow"), [(0, False), (3, False), (3, True)])
def test_points_of_loose_relaxations_add_nothing_and_slow_trees_neighbours(
    left, nodes, slow, monkeypatch
):
    """Nor do points of trees that go on."""
    context = SimpleNamespace(best=SimpleNamespace(x=np.zeros(1)))
    own = with_tree(nodes, left, SimpleNamespace(context=context, over=False))
    own.small = cast(Any, SimpleNamespace(point=lambda point, x: point))
    own.rows, asked = np.array([4]), []
    monkeypatch.setattr(own, "_joined", lambda x: asked.append("relaxation's point"))
    monkeypatch.setattr(own, "_complete", lambda x: asked.append("minimiser"))
    monkeypatch.setattr(own, "_near", lambda rows: np.arange(rows[0] - 1, rows[-1] + 2))
    assert own._wider().tolist() == [2, 3, 4, 5, 6]
    monkeypatch.setattr(own, "_set", lambda rows: asked.append(rows.tolist()) is None)
    own._grow(slow)
    counts = left < settings.STRATEGY.small_gap_ratio and (slow or not nodes)
    tight = ["relaxation's point"] if counts else []
    assert asked == [*tight, "minimiser", *([[2, 3, 4, 5, 6]] if slow else [])]
    assert not own.done


def test_the_tree_of_another_set_is_judged_from_its_first_node(monkeypatch):
    problem = problem_of(*record())
    own = with_tree(0, 50.0, SimpleNamespace(context=SimpleNamespace(problem=problem)))
    monkeypatch.setattr(WorkingSetSearch, "_held", np.array([0, 1]))
    own.judged = 9
    assert own._set(np.arange(5, 15))
    own.search = with_tree(1, 40.0).search
    assert own._slow(50.0)


@pytest.mark.parametrize(("long", "most"), [(False, 64), (True, 48)])
def test_sets_may_be_larger_where_the_star_of_all_is_not_long(long, most, monkeypatch):
    monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    own = WorkingSetSearch(search_on(problem_of(*record())), CostModel(), long)
    assert own._set(np.arange(most)) and not own._set(np.arange(most + 1))


@pytest.mark.parametrize("long", [False, True])
def test_seconds_on_a_set_are_a_share_of_those_on_all(long, monkeypatch):
    monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    own = WorkingSetSearch(whole_search(), CostModel(), long)
    assert own._set(np.arange(10, 50))  # 40 of 80
    own._begin()
    assert own.search is not None
    found, whole = own.search.shared_state.estimates, own.whole.shared_state.estimates
    assert found == ({} if long else {name: 0.5 * whole[name] for name in found})
    assert ("star" in found) is not long


@pytest.mark.parametrize(("seconds", "long"), [(1.0, False), (3.0, True)])
def test_what_is_long_is_decided_before_anything_is_measured(seconds, long, monkeypatch):
    """A star of a long record that took little does not make the record short."""
    monkeypatch.setattr(working_set, "WORKING_SET", settings.WORKING_SET)
    monkeypatch.setattr(working_set, "_star_seconds", lambda _: seconds)
    made, own = [], WorkingSetSearch.__init__
    monkeypatch.setattr(
        WorkingSetSearch,
        "__init__",
        lambda self, *given: made.append(given[2]) or own(self, *given),
    )
    problem = problem_of(*record())
    x = sp.variables(problem.dimension)
    sp.solve_each(problem, [x[0], -x[0]], WIDTH)
    assert made == [long, long]


@pytest.mark.slow
def test_searches_on_a_set_tighten_no_box_and_learn_from_trees_in_full(monkeypatch):
    learned, learn = {}, CostModel.learn

    def watched(self, name, progress, seconds, goes_on=False):
        learned.setdefault(name, set()).add(goes_on)
        learn(self, name, progress, seconds, goes_on)

    monkeypatch.setattr(CostModel, "learn", watched)
    monkeypatch.setattr(working_set, "row_prices", lambda *_, **__: 1.0 * (np.arange(80) < 3))
    monkeypatch.setattr(WorkingSetSearch, "_complete", lambda *_: None)
    results = both_ends(problem_of(*record()), replace(WIDTH, time_limit=None, work_limit=2.0))
    assert learned.pop("branch") == learned.pop("first step") == {True}
    assert set.union(*learned.values()) == {False}
    names = [entry.name for result in results for entry in result.history]
    assert sizes(results)
    assert not any(n.startswith("tighten") and n.endswith("constraints") for n in names)


def search_on(problem):
    """The search on all constraints."""
    shared = SharedState.of(problem, (problem.objective,), WIDTH)
    context = SolveContext(problem, WIDTH, Stages(), Deadline(None))
    box = Interval(problem.lower, problem.upper)
    return AdaptiveSearch(context, Model(BoxProof(), box), [], shared)


def whole_search():
    """The search on all constraints, with an incumbent."""
    whole = search_on(problem_of(*record()))
    whole._search_incumbent([np.r_[TRUTH, np.zeros(SAMPLES)]])
    assert whole.context.best is not None
    return whole


def tightened_set():
    """A search on a small set, whose tree has tightened the box of its root."""
    own = WorkingSetSearch(whole_search(), CostModel())
    assert own._set(np.arange(10, 50))
    own._begin()
    assert own.search is not None
    own.search._run("branch")
    return own


def test_the_next_set_and_the_whole_begin_with_the_box_of_the_tree():
    """The cutoff and two constraints more: what the tree proved holds there."""
    own = tightened_set()
    tree = own.search.tree
    assert any(isinstance(step, Tightening) for step in tree.root_steps)
    width = tree._root.box.width()[0]
    assert width < own.whole.model.box.width()[0]
    own._hand_over()
    given = own.given
    assert isinstance(given, Tightening)
    assert own.whole.model.box.width()[0] <= width * (1 + 1e-9)
    adopted, own.whole.adopt = own.whole.adopt, None  # called again, it fails
    own._hand_over()
    own.whole.adopt = adopted
    assert own._set(np.arange(8, 55))
    own._begin()
    assert own.search.model.box.width()[0] <= width * (1 + 1e-9)
    assert own.before is None
    for search in (own.search, own.whole):
        replay = search.context.at_cutoff()
        again, box = search.model.proof.replay(replay), search.model.box
        assert np.all(again.lo >= box.lo - 1e-12) and np.all(again.hi <= box.hi + 1e-12)


@pytest.mark.parametrize(
    ("ends", "grown"), [((20, 29), (17, 32)), ((20, 23), (18, 25)), ((0, 39), (0, 39))]
)
def test_slow_trees_widen_sets_by_half(ends, grown, monkeypatch):
    """Neighbours join on both sides, as far as there are any of forty."""
    own = with_tree(3, 50.0)
    own.rows = np.arange(ends[0], ends[1] + 1)
    monkeypatch.setattr(
        own, "_near", lambda rows: np.arange(max(rows[0] - 1, 0), min(rows[-1] + 2, 40))
    )
    assert own._wider().tolist() == list(range(grown[0], grown[1] + 1))


def test_sets_begin_with_stars():
    specs = SharedState.of(problem_of(*record()), (), WIDTH).specs
    shapes = [spec.shape for spec in working_set._from_stars(specs)]
    assert {"linear", "split"} <= {spec.shape for spec in specs}
    assert shapes[0] == "star" and not {"linear", "split"} & set(shapes)


@pytest.mark.parametrize(
    ("left", "on_set", "steps"), [(9.0, True, 3), (11.0, True, 1), (9.0, False, 1)]
)
def test_a_turn_on_a_set_goes_on_where_little_is_left(left, on_set, steps):
    taken = []
    search = SimpleNamespace(
        context=SimpleNamespace(upper=1.0),
        bound=0.0,
        gap_ratio=left,
        over=False,
        restart=lambda model: None,
        run=taken.append,
    )
    own = SimpleNamespace(step=lambda: taken.append(1) is None) if on_set else None
    Turn(cast(Any, search), cast(Any, own), cast(Any, None), 3).take()
    assert len(taken) == steps


@pytest.mark.parametrize(("over", "exhausted"), [(True, False), (False, True), (False, False)])
def test_a_set_with_nothing_left_to_do_hands_over_to_the_whole(over, exhausted, monkeypatch):
    """Else turn after turn would end where it began."""
    u, y = record()
    whole = search_on(problem_of(u, y))
    whole.context, _ = update_incumbent(whole.context, [whole.model.box.middle()])
    own = WorkingSetSearch(whole, CostModel())
    assert own._ready()
    monkeypatch.setattr(AdaptiveSearch, "over", over)
    own.search.exhausted = exhausted
    assert own._ready() is not (over or exhausted)
