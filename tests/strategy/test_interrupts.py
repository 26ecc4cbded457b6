"""A search ended early, by a time limit or an interrupt, returns what is proved so far."""

from __future__ import annotations

import time

import numpy as np
import pytest
from loop_cases import ALL_SPECS, CASES, hierarchy_options, least_of_bilinear, least_of_star, star
from search_cases import bilinear
from slow_values import slow_unless
from solved import INF, check

import sparsepop_py as sp
from sparsepop_py import Options, Status
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.branch_and_bound import tree
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.pipeline import final_result, one_objective
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.progress import Stages
from sparsepop_py.result import INTERRUPTED
from sparsepop_py.strategy import adaptive
from sparsepop_py.verified.certificate.steps import Replay

SOLVE_CONIC, EXPLORE, STAGE = relaxation_bound.solve_conic, tree.process_node, Stages.stage


@pytest.mark.parametrize("several", [False, True])
def test_a_time_limit_holds_on_large_relaxations(several):
    quartic = sp.problems.random_quartic(9, seed=2)  # dense: order 3 has a block of 220
    problem = quartic.with_objective(-quartic.objective)
    # nodes of a tree that tighten bounds by such programs take longer
    skip = () if several else ("obbt_lp",)
    options = Options(effort="auto", gap=0.0, time_limit=1.0, skip=skip)
    start = time.monotonic()
    if several:
        objectives = [problem.objective, quartic.objective]
        results = sp.solve_each(problem, objectives, options)
    else:
        objectives, results = [problem.objective], [sp.solve(problem, options)]
    assert time.monotonic() - start <= 1.0 + 2.0
    for objective, result in zip(objectives, results, strict=True):
        check(problem.with_objective(objective), result)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 9)).reshape(9, -1).T
    assert results[0].status is Status.LIMIT
    assert results[0].lower_bound <= min(problem.objective(x) for x in corners)


class Interrupting:
    """Calls something until the k-th call, which is interrupted."""

    def __init__(self, call, number):
        self.call, self.number, self.calls = call, number, 0

    def __call__(self, *args, **kwargs):
        self.calls += 1
        if self.calls == self.number:
            raise KeyboardInterrupt
        return self.call(*args, **kwargs)


@pytest.mark.parametrize("case", CASES)
def test_an_interrupt_keeps_what_is_proved(case, monkeypatch):
    problem, least = (made() for made in CASES[case])
    skip, numbers = ((), (1, 2, 3)) if case == "bilinear" else (("full",), (1,))
    bounds = []
    for number in numbers:
        interrupting = Interrupting(SOLVE_CONIC, number)
        monkeypatch.setattr(relaxation_bound, "solve_conic", interrupting)
        result = check(problem, sp.solve(problem, hierarchy_options(skip=skip)))
        assert interrupting.calls == number
        assert INTERRUPTED in result.notes
        assert result.status in (Status.INTERRUPTED, Status.OPTIMAL)
        assert -INF < result.lower_bound <= least + 1e-9
        if result.history:
            assert result.lower_bound == result.history[-1].lower_bound
        bounds.append(result.lower_bound)
    assert bounds == sorted(bounds)
    assert bounds[-1] > bounds[0] or case == "star"


@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_interrupt_of_one_order_keeps_the_box(number, monkeypatch):
    problem = bilinear()
    interrupting = Interrupting(SOLVE_CONIC, number)
    monkeypatch.setattr(relaxation_bound, "solve_conic", interrupting)
    result = check(problem, sp.solve(problem, Options(order=1, gap=0.0)))
    assert -12.0 <= result.lower_bound <= least_of_bilinear()  # 3 products of [-1, 2]^2
    assert (INTERRUPTED in result.notes) == (interrupting.calls >= number)
    assert result.status in (Status.INTERRUPTED, Status.BOUNDED)


def test_an_interrupt_of_one_order_keeps_its_first_relaxation(monkeypatch):
    problem = bilinear()
    lean, full = Interrupting(SOLVE_CONIC, 2), Interrupting(SOLVE_CONIC, 1)
    found = []
    for interrupting in (full, lean):
        monkeypatch.setattr(relaxation_bound, "solve_conic", interrupting)
        result = check(problem, sp.solve(problem, Options(order=2, gap=0.0)))
        assert INTERRUPTED in result.notes
        found.append(result.lower_bound)
    assert found[1] > found[0]


@pytest.mark.parametrize("number", [1, 3, 20])
def test_an_interrupt_in_branch_and_bound_keeps_the_tree(number, monkeypatch):
    def only_linear(*args):
        return tuple(r for r in ALL_SPECS(*args) if r.shape == "linear")

    problem = bilinear()
    monkeypatch.setattr("sparsepop_py.strategy.shared_state.relaxation_specs", only_linear)
    monkeypatch.setattr(tree, "process_node", Interrupting(EXPLORE, number))
    options = Options(effort="auto", skip=("linear_tree",))
    result = check(problem, sp.solve(problem, options))
    assert INTERRUPTED in result.notes
    assert result.status is Status.INTERRUPTED
    assert result.history[0].lower_bound <= result.lower_bound <= least_of_bilinear()
    assert result.certificate.leaves == 1 or number > 1
    assert result.certificate.leaves > 1 or number < 20


def test_a_point_found_in_the_tree_survives_an_interrupt(monkeypatch):
    problem = bilinear()
    monkeypatch.setattr(
        "sparsepop_py.strategy.shared_state.relaxation_specs",
        lambda *args: tuple(r for r in ALL_SPECS(*args) if r.shape == "linear"),
    )
    found = []

    def attained(context, starts, proved):
        """Finds nothing before the tree grows, then the best point."""
        if exploring.calls:
            context, vectors = honest(context, [np.array([-1.0, 2.0, 2.0, -1.0])])
            found.append(context.upper)
            return context, vectors
        return context, []

    honest, exploring = adaptive.update_incumbent, Interrupting(EXPLORE, 4)
    monkeypatch.setattr(adaptive, "update_incumbent", attained)
    monkeypatch.setattr(tree, "process_node", exploring)
    monkeypatch.setattr(one_objective, "first_incumbent", lambda context, starts: (context, []))
    result = check(problem, sp.solve(problem, Options(effort="auto", skip=["obbt_lp"])))
    assert INTERRUPTED in result.notes
    assert found
    assert result.upper_bound == min(found) < INF


@pytest.mark.parametrize("number", [1, 2, 5])
def test_an_interrupt_of_several_objectives(number, monkeypatch):
    problem = star()
    x = sp.variables(7)
    objectives = [problem.objective, -problem.objective, x[0], x[1] - x[2]]
    interrupting = Interrupting(SOLVE_CONIC, number)
    monkeypatch.setattr(relaxation_bound, "solve_conic", interrupting)
    results = sp.solve_each(problem, objectives, hierarchy_options())
    assert interrupting.calls == number
    for objective, result in zip(objectives, results, strict=True):
        check(problem.with_objective(objective), result)
        assert INTERRUPTED in result.notes
        assert result.status in (Status.INTERRUPTED, Status.OPTIMAL)
        assert result.lower_bound > -INF
    assert results[0].lower_bound <= least_of_star() + 1e-9


@pytest.mark.parametrize("name", ["motzkin", "laboratory"])
def test_a_lower_cutoff_makes_no_box_larger(name):
    # trees are proved with a cutoff a little below that of the box
    problem = getattr(sp.problems, name)()
    point = {"motzkin": [1.0, 1.0], "laboratory": [9.0, 5.0]}[name]
    best = prove_feasible(problem, np.array(point))
    proof, box = find_box(problem, best, Options(effort="auto"))
    for share in (0.0, 1e-9, 9e-7, 1e-3, 1e-2):
        lower = best.value - share * max(1.0, abs(best.value))
        again = proof.replay(Replay(problem, lower))
        assert np.all(again.lo >= box.lo)
        assert np.all(again.hi <= box.hi)


@pytest.mark.parametrize(
    ("number", "effort"),
    slow_unless(
        lambda number, effort: number < 8 or (number == 14) == (effort == "auto"),
        [(number, e) for number in (1, 2, 3, 4, 5, 6, 8, 11, 14) for e in ("auto", "presolve")],
    ),
)
def test_an_interrupt_at_the_start_of_any_phase(number, effort, monkeypatch):
    x = sp.variables(3)
    rows = [x[0] * x[2] + x[1] == 1, x[0] ** 2 + x[1] ** 2 <= 2]
    region = sp.Problem(x[0], rows, lower=-2, upper=2)
    ends, point = [x[0], -x[0], x[1]], np.array([1.0, 0.0, 1.0])  # feasible by hand
    entering = Interrupting(STAGE, number)
    monkeypatch.setattr(Stages, "stage", lambda stages, name: entering(stages, name))
    options = Options(effort=effort, gap=0.0, time_limit=20.0, node_limit=0)
    results = sp.solve_each(region, ends, options)
    assert entering.calls >= number
    for objective, result in zip(ends, results, strict=True):
        check(region.with_objective(objective), result)
        assert -2.0 - 1e-9 <= result.lower_bound <= objective(point)
    assert INTERRUPTED in results[-1].notes  # nothing goes on after it


@pytest.mark.parametrize("name", ["_verified", "_status", "_points"])
def test_interrupts_while_the_result_is_made_lose_nothing(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Of several objectives the others follow, too."""
    original, calls = getattr(final_result, name), []

    def interrupted(*given):
        calls.append(name)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return original(*given)

    monkeypatch.setattr(final_result, name, interrupted)
    x, y = sp.variables(2)
    disc = sp.Problem(x, [x**2 + y**2 <= 1])
    found = sp.solve(disc)
    calls.clear()
    for result in (found, *sp.solve_each(disc, [x, -y])):
        assert -1.0 - 1e-5 <= result.lower_bound <= -1.0
        assert result.certificate.verify(result.problem)
    assert len(calls) >= 3
