"""Branch and bound: interrupted anywhere it proves its bound, and the bound only rises."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from random_cases import random_case
from search_cases import bilinear, branched_on, least_on_a_grid, processes, search_of, threads
from slow_values import slow_after
from solved import check

import sparsepop_py as sp
from sparsepop_py import Options, Problem, Status
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.branch_and_bound.node import process_node
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.presolve.initial_box import rounding_slack
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.hierarchy import RelaxationSpec
from sparsepop_py.strategy import adaptive
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.settings import TreeSettings
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import prove
from sparsepop_py.verified.certificate.steps import BoxProof, Replay

INF = np.inf


def never():
    return False


def test_slack_is_small_against_the_box_and_grows_with_its_first_widths():
    start = Interval(np.array([-1.0, -1.0, 0.0, -np.inf]), np.array([1.0, 1.0, 1e9, np.inf]))
    now = Interval(np.array([-1.0, 0.0, 0.0, 0.0]), np.array([1.0, 1e-6, 1.0, 1.0]))
    slack = rounding_slack(now, start)
    assert np.all(slack > 0) and np.all(slack <= 2.0**-20 * (now.hi - now.lo))
    assert slack[1] > 1e-13  # 1e-6 wide, from rows with numbers near 1
    assert slack[3] < 1e-9  # nothing is known of the start
    assert rounding_slack(start, start)[3] == 0.0


@pytest.mark.parametrize("spec", [None, RelaxationSpec("order 1", 0.5, "full", 1)])
def test_arguments_of_nodes_leave_slack_for_the_rounding_of_a_replay(spec):
    """Root and node of width 3 and 0.5: the same argument holds on a box larger by 2e-11."""
    problem = bilinear()
    root = Interval(problem.lower, problem.upper)
    search = search_of(problem, (0, 1, 2, 3), spec=spec, slack=rounding_slack(root, root))
    corner = np.array([-1.0, 0.5, 0.7, -0.2])
    processed = process_node(search.context, search.settings, Interval(corner, corner + 0.5), None)
    assert processed.argument is not None
    larger = Interval(processed.box.lo - 2e-11, processed.box.hi + 2e-11)
    again = prove(Replay(search.context.problem, None), larger, processed.argument, processed.empty)
    assert not again.reason
    assert abs(again.bound - processed.proved.bound) < 1e-10


@pytest.mark.parametrize(
    ("start", "obbt_lp"),
    [
        (None, True),
        ((1.0, 0.0, 0.0, 1.0), False),
        pytest.param(None, False, marks=pytest.mark.slow),
        pytest.param((1.0, 0.0, 0.0, 1.0), True, marks=pytest.mark.slow),
    ],
)
def test_interrupted_after_any_number_of_nodes(obbt_lp, start):
    problem = bilinear()
    least = least_on_a_grid(problem, 25)
    search = search_of(problem, (0, 1, 2, 3), start, obbt_lp=obbt_lp)
    bounds = []
    for seen in range(1, 26):
        if search.grow(1, never) == 0:
            break
        certificate = search.certificate()
        if certificate is None:
            continue
        verdict = certificate.verify(problem)
        assert verdict.ok, verdict.reason
        assert certificate.bound <= least
        assert certificate.bound >= search.bound - 1e-9
        assert search.seen == seen
        bounds.append(certificate.bound)
    assert np.all(np.diff(bounds) >= -1e-12)
    assert bounds[-1] > bounds[0]


def test_until_nothing_is_left():
    problem = bilinear()
    search = search_of(problem, (0, 1, 2, 3), options=Options(gap=1e-2), local=True)
    search.grow(2000, never)
    assert search.done
    certificate = search.certificate()
    assert certificate.verify(problem).ok
    assert certificate.leaves > 1
    upper = search.context.upper
    assert certificate.bound <= least_on_a_grid(problem, 25) + 1e-12
    assert upper - certificate.bound <= 1e-2 * max(1.0, abs(upper))


def test_a_raised_exception_loses_no_node():
    problem = bilinear()
    search = search_of(problem, (0, 1, 2, 3), (1.0, 0.0, 0.0, 1.0))
    search.grow(7, never)
    before, nodes = search.certificate().bound, len(search._heap)
    usual, search._processed = search._processed, None  # calling None raises
    with pytest.raises(TypeError):
        search.grow(5, never)
    assert len(search._heap) == nodes
    assert search.certificate().bound == before
    search._processed = usual
    search.grow(5, never)
    assert search.certificate().bound >= before
    assert search.certificate().verify(problem).ok


def test_only_chosen_variables_are_branched_on():
    problem = bilinear()
    for chosen in ((0,), (1, 2), (3,)):
        search = search_of(problem, chosen, (1.0, 0.0, 0.0, 1.0))
        search.grow(15, never)
        certificate = search.certificate()
        assert branched_on(certificate)
        assert branched_on(certificate) <= set(chosen)
        assert certificate.verify(problem).ok


def test_no_variable_to_branch_on():
    problem = bilinear()
    search = search_of(problem, (), (1.0, 0.0, 0.0, 1.0))
    search.grow(10, never)
    assert search.seen == 1
    assert search.done
    assert search.certificate().verify(problem).ok


def test_nodes_that_hold_nothing():
    # the circle of radius 1 and the curve x y = 1 are apart: |x y| <= 1/2 on the circle
    x, y = sp.variables(2)
    problem = Problem(x, [x**2 + y**2 == 1, x * y == 1], -2.0, 2.0)
    search = search_of(problem, (0, 1))
    search.grow(500, never)
    assert search.done
    certificate = search.certificate()
    assert certificate.bound == INF
    assert certificate.verify(problem).ok


@pytest.mark.parametrize("seed", slow_after(8, range(20)))
def test_random_problems_of_any_degree(seed):
    case = random_case(seed)
    variables = tuple(range(case.problem.dimension))
    for start in (None, case.points[int(np.argmax(case.values))]):
        search = search_of(case.problem, variables, start)
        search.grow(12, never)
        certificate = search.certificate()
        if certificate is not None:
            assert certificate.bound <= case.least
            assert certificate.verify(case.problem).ok


def test_a_lower_cutoff_is_taken_up_and_a_higher_one_refused():
    problem = bilinear()
    search = search_of(problem, (0, 1, 2, 3), (0.5, 0.0, 0.0, 0.5))
    search.grow(3, never)
    assert search.context.upper == -0.25
    worse = prove_feasible(problem, np.zeros(4))
    better = prove_feasible(problem, np.array([1.0, 0.0, 0.0, 1.0]))
    assert search.update_context(replace(search.context, best=better))
    assert search.context.upper == -1.0
    search.grow(3, never)
    assert search.certificate().verify(problem).ok
    assert not search.update_context(replace(search.context, best=worse))


@pytest.mark.parametrize("pool", [threads, pytest.param(processes, marks=pytest.mark.slow)])
def test_an_executor_leads_to_the_same_bound(pool):
    problem = bilinear()
    found = sp.solve(problem, Options(order=2)).x
    alone = search_of(problem, (0, 1, 2, 3), found, Options(gap=1e-2))
    alone.grow(5000, never)
    with pool() as executor:
        shared = search_of(problem, (0, 1, 2, 3), found, Options(gap=1e-2))
        shared.grow(5000, never, executor)
    assert alone.done
    assert shared.done
    bounds = [search.certificate().bound for search in (alone, shared)]
    assert bounds[0] == pytest.approx(bounds[1], abs=1e-9)
    assert shared.certificate().verify(problem).ok


def test_the_adaptive_search_branches_where_nothing_else_is_left(only_branch):
    problem = bilinear()
    options = Options(effort="auto", gap=5e-2, skip=("linear_tree",))
    result = check(problem, sp.solve(problem, options))
    assert result.status is Status.OPTIMAL
    assert [entry.name for entry in result.history][-1] == "branch"
    assert result.certificate.leaves > 1
    assert result.lower_bound <= least_on_a_grid(problem, 25)


def test_a_node_limit_of_zero_switches_it_off(only_branch):
    problem = bilinear()
    result = check(problem, sp.solve(problem, Options(effort="auto", node_limit=0)))
    assert result.history
    assert "branch" not in [entry.name for entry in result.history]
    assert result.certificate.leaves == 1
    assert result.status is Status.BOUNDED


@pytest.mark.parametrize("limit", [1, 2, 5])
def test_a_node_limit_is_held(only_branch, limit):
    problem = bilinear()
    result = check(problem, sp.solve(problem, Options(effort="auto", node_limit=limit)))
    assert result.history[-1].name == "branch"
    assert result.history[-1].nodes == limit
    assert result.lower_bound <= least_on_a_grid(problem, 25)


def test_branch_on_is_respected(only_branch):
    problem = bilinear()
    options = Options(effort="auto", branch_on=[1, 2], node_limit=20)
    result = check(problem, sp.solve(problem, options))
    assert branched_on(result.certificate) == {1, 2}


def test_an_executor_in_the_adaptive_search(only_branch):
    problem = bilinear()
    with ThreadPoolExecutor(2) as executor:
        options = Options(effort="auto", gap=5e-2, executor=executor)
        result = check(problem, sp.solve(problem, options))
    assert result.status is Status.OPTIMAL
    assert result.lower_bound <= least_on_a_grid(problem, 25)


def test_nodes_of_a_dropped_tree_stay_counted(only_branch):
    problem = bilinear()
    context = SolveContext(problem, Options(effort="auto", node_limit=3), Stages(), Deadline(None))
    shared_state = SharedState.of(problem, (problem.objective,), context.options)
    box = Interval(problem.lower, problem.upper)
    search = AdaptiveSearch(context, Model(BoxProof(), box), [], shared_state)
    search.run()
    assert [entry.nodes for entry in search.history] == [0, 3]
    search.context = replace(search.context, unit=1e-3)  # a smaller gap: its cutoff is a higher one
    search.queue.specs = list(shared_state.specs)
    search.run(1)
    assert [entry.name for entry in search.history] == ["linear", "branch", "linear"]
    assert search.history[-1].nodes == 3


@pytest.mark.parametrize("share", [0.1, 0.0])
def test_a_tree_that_proved_little_is_left_for_a_relaxation_of_the_root(
    only_branch, share, monkeypatch
):
    """Linear programs bound a convex form poorly, order 1 does not: its minimum is 0."""
    monkeypatch.setattr(adaptive, "TREE", TreeSettings(weak_gap_share=share))
    x = sp.variables(5)
    pairs = [(x[i] - 0.9 * x[j]) ** 2 for i in range(5) for j in range(i)]
    problem = Problem(sp.total(pairs), lower=-1, upper=1)
    context = SolveContext(problem, Options(effort="auto", node_limit=3), Stages(), Deadline(None))
    point = prove_feasible(problem, np.full(5, 1e-2))
    context = replace(context, best=point)
    shared_state = SharedState.of(problem, (problem.objective,), context.options)
    search = AdaptiveSearch(
        context, Model(BoxProof(), Interval(-np.ones(5), np.ones(5))), [], shared_state
    )
    search.run()
    assert search.tree is not None and search.bound < -1.0
    search.queue.specs = [RelaxationSpec("order 1", 0.5, "full", 1)]
    search.run(1)
    assert search.bound > -1e-3
    assert (search.tree is None) == (share > 0.0)
    assert search.at_nodes is None or search.at_nodes.name == "order 1"
    assert search.history[-1].nodes == 3


def test_what_was_proved_on_a_box_of_its_own_is_proved_anew_on_a_shared_one(only_branch):
    """Linear programs on [-1, 1/4]^4 bound nothing on the larger box that others share."""
    problem = bilinear()
    context = SolveContext(problem, Options(effort="auto", node_limit=3), Stages(), Deadline(None))
    shared_state = SharedState.of(problem, (problem.objective,), context.options)
    given = Interval(problem.lower, problem.upper)
    wide = Model(BoxProof(), given)
    search = AdaptiveSearch(
        context, Model(BoxProof(), Interval(given.lo, np.full(4, 0.25))), [], shared_state
    )
    search.run(1)
    assert search.best.proved.bound > -INF
    search.restart(wide)
    node = search.best.node
    again = prove(search.context.at_cutoff(), search.model.box, node.argument, node.empty)
    assert search.best.proved.bound <= again.bound
    search.outcome = replace(search.outcome, certificate=None)  # the smaller box has no proof here
    search.queue.specs = []
    search.run(1)
    assert search.outcome.certificate.verify(problem).ok
