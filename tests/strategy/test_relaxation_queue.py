"""Order of the relaxations, boxes that other objectives tighten, and values of cutoffs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from search_cases import heat_exchangers
from solved import check

import sparsepop_py as sp
from benchmarks.problems.identification import THETA
from benchmarks.problems.identification import task as identification_context
from sparsepop_py import Options, Problem
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.hierarchy import CostModel, Families, RelaxationSpec, progress
from sparsepop_py.strategy import adaptive, relaxation_queue
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.tightening.obbt_lp import apply_steps, tighten_bounds
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import Replay

INF = float("inf")


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [(100.0, 1.0, 1.0), (100.0, 10.0, 0.5), (100.0, 100.0, 0.0), (INF, 5.0, 0.5), (5.0, INF, 0.0)],
)
def test_progress_is_a_share_of_orders_of_magnitude(before, after, expected):
    assert progress(before, after, 1.0) == pytest.approx(expected)


def test_less_time_counts_at_once_and_more_time_slowly():
    seen = CostModel()
    for seconds in (3.0, 0.7):
        seen.learn("star", 1.0, seconds)
    assert seen.seconds["star"] == 0.7
    seen.learn("star", 1.0, 1.7)
    assert 0.7 < seen.seconds["star"] < 1.7


def test_progress_counts_in_full_where_the_work_goes_on():
    """A tree that left a tenth of the way goes on from there; a relaxation does not."""
    for share, worth in ((0.0, 0.0), (0.9, 0.9), (1.0, 1.0)):
        seen = CostModel()
        seen.learn("branch", share, 1.0, goes_on=True)
        seen.learn("star", share, 1.0)
        assert seen.progress["branch"] == pytest.approx(worth)
        assert seen.progress["star"] == pytest.approx(1.0 if share == 1.0 else 0.1 * share)


@pytest.mark.parametrize(("variables", "expected"), [(50, True), (500, False)])
def test_mixed_blocks_beyond_the_memory_are_not_built(variables, expected):
    """A block of 500 variables has 125 751 entries, and the square of that is stored."""
    x = sp.variables(variables)
    problem = Problem(x[0], [sum(x) == 1], lower=-1, upper=1)
    whole = Families(problem, (problem.objective,), True, "min-degree")
    spec = RelaxationSpec("mixed", 0.8, "mixed", memory=5e9)
    assert spec.fits(whole) == expected


def test_a_record_is_bounded_by_stars_alone():
    """Few parameters in all products: linear programs first would cost more than they save."""
    record = identification_context("oe", 30, seed=3)
    options = Options(effort="auto", gap=1e-3, gap_kind="width", time_limit=60)
    results = sp.solve_each(record.problem, record.objectives, options)
    for objective, result in zip(record.objectives, results, strict=True):
        check(record.problem.with_objective(objective), result)
        truth = objective(np.append(THETA, np.zeros(30)))  # any noise: objectives are parameters
        assert result.lower_bound <= truth
    assert results[0].history[0].name == "star"


def bilinear():
    x = sp.variables(3)
    rows = [x[0] * x[1] + x[2] == 1, x[0] + x[1] <= 1.5, x[0] * x[2] >= 0.3]
    return Problem(-x[1], rows, 0.0, 2.0)


def test_a_cutoff_below_the_attained_value():
    problem = bilinear()
    best = prove_feasible(problem, np.array([0.5, 0.5, 0.75]))
    assert best is not None
    lone = SolveContext(
        problem, Options(effort="auto", gap=0.1), Stages(False), Deadline(None), best
    )
    below = SolveContext(problem, lone.options, lone.stages, lone.deadline, best, below=True)
    assert lone.at_cutoff().cutoff == best.value
    assert below.at_cutoff().cutoff == pytest.approx(best.value - 0.09)
    assert lone.at_cutoff(below=True).cutoff == below.at_cutoff().cutoff
    assert below.at_cutoff(below=False).cutoff == best.value


@pytest.mark.parametrize("skip", [(), ("branch",), ("obbt_lp",)])
def test_a_box_made_with_a_lower_cutoff_is_left_where_the_cutoff_rises(skip):
    """Once the attained width is known, the allowed gap may be far smaller than before."""
    problem, options = bilinear(), Options(effort="auto", gap=0.1, skip=skip)
    best = prove_feasible(problem, np.array([0.5, 0.5, 0.75]))
    assert best is not None
    wide = SolveContext(problem, options, Stages(False), Deadline(None), best, unit=9.0, below=True)
    shared = Model(*find_box(problem, None, options))
    search = AdaptiveSearch(
        wide, shared, [], SharedState.of(problem, (problem.objective,), options)
    )
    search.restart(replace(shared))
    search.run(1)
    search.context = replace(search.context, unit=1e-4)
    search.restart(search.shared_model)
    search.run()
    certificate = search.outcome.certificate
    assert certificate is not None and certificate.verify(problem).ok
    x = np.random.default_rng(0).uniform(0.0, 2.0, (20000, 2))
    x = np.column_stack([x, 1.0 - x[:, 0] * x[:, 1]])
    held = (x[:, 2] >= 0) & (x[:, 0] + x[:, 1] <= 1.5) & (x[:, 0] * x[:, 2] >= 0.3)
    assert certificate.bound <= -x[held, 1].max()


@pytest.mark.parametrize(
    ("left", "share", "again"), [(1.2, 0.8, True), (3.0, 0.8, False), (3.0, 0.6, True)]
)
def test_a_relaxation_returns_where_the_box_shrank_by_what_its_gap_lacks(left, share, again):
    problem, options = bilinear(), Options(effort="auto", gap=0.1)
    best = prove_feasible(problem, np.array([0.5, 0.5, 0.75]))
    assert best is not None
    context = SolveContext(problem, options, Stages(False), Deadline(None), best, unit=1.0)
    shared = Model(*find_box(problem, None, options))
    state = SharedState.of(problem, (problem.objective,), options)
    search = AdaptiveSearch(context, shared, [], state)
    gap = search.context.upper - search.bound
    search.context = replace(search.context, unit=gap / (search.context.allowed * left))
    assert search.gap_ratio == pytest.approx(left)
    search.tried = [(state.specs[0], search.bound, 1.0)]
    wide = shared.box.width() * share
    smaller = Interval(shared.box.lo, np.where(shared.box.lo == 0, wide, shared.box.hi))
    search.restart(replace(shared, box=smaller))
    assert (search.tried == []) == again


def test_a_relaxation_on_a_smaller_box_is_worth_what_the_box_has_lost():
    """Half of the widths leave half of the gap: of 4 half the progress, of which a tenth counts."""
    problem, options = bilinear(), Options(effort="auto", gap=0.1)
    best = prove_feasible(problem, np.array([0.5, 0.5, 0.75]))
    context = SolveContext(problem, options, Stages(False), Deadline(None), best, unit=1.0)
    shared = Model(*find_box(problem, None, options))
    state = SharedState.of(problem, (problem.objective,), options)
    for left, worth in ((4.0, 0.1 * 0.5), (1.9, 1.0)):
        search = AdaptiveSearch(context, shared, [], state)
        gap = search.context.upper - search.bound
        search.context = replace(search.context, unit=gap / (search.context.allowed * left))
        [star] = [spec for spec in state.specs if spec.shape == "star"]
        search.tried = [(star, search.bound, 1.0)]
        high, own = shared.box.hi.copy(), list(state.variables)  # others, as noise, hardly move
        high[own] = 0.5 * (shared.box.lo + shared.box.hi)[own]
        half = Interval(shared.box.lo, high)
        assert 0 < len(own) < high.size
        search.restart(replace(shared, box=half))
        search.queue.specs = [star]
        state.cost_model.seconds[star.name] = 1.0
        assert search.queue.expected == {star.name: pytest.approx(worth)}
        alone = state.cost_model.rate(star, 0.0, 1.0)
        assert search.queue.best(None)[1] == pytest.approx(min(alone, worth))


def test_steps_taken_again_on_a_smaller_box_keep_its_points():
    problem = bilinear()
    replay, box = Replay(problem, None), Interval(problem.lower, problem.upper)
    usual = Families(problem, [problem.objective], True, "min-degree")["constraints"]
    smaller, step, empty = tighten_bounds(
        replay, LinearRelaxation.of(problem, box, usual), box, (0, 1, 2)
    )
    assert step is not None and not empty
    half = Interval(box.lo, np.array([2.0, 0.9, 2.0]))
    again = apply_steps(replay, [step], half)
    assert np.all(again.lo >= np.maximum(smaller.lo, half.lo) - 1e-9)
    assert np.all(again.hi <= np.minimum(smaller.hi, half.hi) + 1e-9)
    source = np.random.default_rng(0)
    for a, b in source.uniform([0.0, 0.0], [1.5, 0.9], (2000, 2)):
        x = np.array([a, b, 1.0 - a * b])
        if problem.violation(x) == 0.0 and np.all(x <= half.hi):
            assert np.all(again.lo <= x) and np.all(x <= again.hi)


@pytest.mark.parametrize(("cheap", "first"), [(0.1, []), (0.0, [True])])
def test_a_cheap_order_comes_before_more_searches_and_higher_orders(monkeypatch, cheap, first):
    """Order 2 closes the gap: starts that are left are searched from only where it is costly."""
    searched, own = [], AdaptiveSearch.search_more_starts

    def search_more_starts(self):
        searched.append(own(self))
        return searched[-1]

    monkeypatch.setattr(AdaptiveSearch, "search_more_starts", search_more_starts)
    for module in (adaptive, relaxation_queue):
        monkeypatch.setattr(module, "STRATEGY", replace(STRATEGY, cheap_seconds=cheap))
    problem = heat_exchangers()
    result = sp.solve(problem, Options(effort="auto", work_limit=10.0, skip=("linear_tree",)))
    check(problem, result, 7049.24802, tight=1e-6)
    assert searched[:1] == first
    if cheap > 0.0:
        assert [entry.order for entry in result.history] == [0, 2]


@pytest.mark.parametrize(
    ("expected", "left", "share", "first"),
    [
        (0.05, None, 0.8, True),  # cheap
        (0.05, 10.0, 0.8, True),
        (0.05, None, 0.0, False),  # nothing was solved yet
        (0.2, None, 0.8, False),
        (0.2, 10.0, 0.8, False),  # order 3 ends in time
        (0.2, 0.6, 0.8, True),  # order 3 may not, with 0.4 s expected, and order 2 does
        (0.2, 0.3, 0.8, False),  # order 2 may not either
    ],
)
def test_the_next_order_comes_first_where_it_is_cheap_or_alone_ends_in_time(
    expected, left, share, first
):
    problem = heat_exchangers()
    state = SharedState.of(problem, [problem.objective], Options(effort="auto"))
    spec = {each.name: each for each in state.specs}
    state.estimates.update({"order 2": expected, "order 3, chordal terms": 0.4})
    queue = relaxation_queue.RelaxationQueue(state, scaled=lambda: None, share=share)
    found = queue.next_order(spec["order 3, chordal terms"], left)
    assert found is (spec["order 2"] if first else None)


def test_nodes_without_linear_programs_of_any_cost_get_a_relaxation():
    """Under a work limit the linear programs of a problem without any count as nothing."""
    x, y, z = sp.variables(3)
    problem = Problem(x, [z <= 2], lower=-2, upper=2)
    options = Options(effort="auto", work_limit=5.0, order=5)
    found = sp.solve_each(problem, [0 * x + 1, x**2 + 2 * x * y * z], options)
    assert [each.lower_bound for each in found] == pytest.approx([1.0, -12.0], abs=1e-4)
