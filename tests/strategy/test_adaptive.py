"""The adaptive search ends where neither a limit nor a closed gap can end it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation import hierarchy
from sparsepop_py.strategy import adaptive, relaxation_queue
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.steps import BoxProof

FEW = 20  # nodes
LINEAR = ("star", "split", "mixed", "full", "monomials", "cutoff", "linear_tree")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "advice"),
    [
        ({"refine": "none"}, "a local search (refine) for an attained point"),
        ({"search_limit": 0.0}, "a larger search_limit or another starting point"),
        ({"gap": 0.0}, "a larger gap, as rounding is all that is left of it"),
        ({"refine": "none", "work_limit": float("inf")}, "a local search (refine)"),
    ],
)
def test_a_tree_ends_where_its_gap_cannot_close(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], advice: str
) -> None:
    monkeypatch.setattr(adaptive, "TREE", replace(adaptive.TREE, idle_nodes=FEW))
    x, y = sp.variables(2)
    line = sp.Problem(-x * y, [x + 3 * y == 1], lower=0, upper=1)  # -1/12 at (1/2, 1/6)
    result = sp.solve(line, sp.Options(effort="auto", skip=LINEAR, **options))
    assert result.status is sp.Status.BOUNDED
    assert -1 / 12 - 1e-6 < result.lower_bound <= -1 / 12
    assert advice in result.message


def test_a_limit_is_used_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive, "TREE", replace(adaptive.TREE, idle_nodes=FEW))
    x, y = sp.variables(2)
    line = sp.Problem(-x * y, [x + 3 * y == 1], lower=0, upper=1)
    options = sp.Options(effort="auto", skip=LINEAR, refine="none", node_limit=150)
    result = sp.solve(line, options)
    assert result.history[-1].nodes == 150
    assert "a larger node_limit" in result.message


def test_a_long_relaxation_comes_after_a_tree_that_has_gained_nothing_yet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A slice without gain, of one objective, does not leave the others to long relaxations."""
    model, queue = hierarchy.CostModel, relaxation_queue.RelaxationQueue
    before, seconds = model.learn, queue.seconds

    def learn(self: Any, name: str, progress: float, *rest: Any, **more: Any) -> None:
        before(self, name, 0.0 if name == "branch" else progress, *rest, **more)

    def long(self: Any, spec: Any) -> float:
        return seconds(self, spec) if spec.name == "linear" else 500.0

    monkeypatch.setattr(model, "learn", learn)
    monkeypatch.setattr(queue, "seconds", long)
    x = sp.variables(6)
    pairs = [(i, j) for i in range(6) for j in range(i)]
    sums = [
        sp.total((7 * i * j + 5 * k * i + j) % 11 * x[i] * x[j] - 5 * x[i] * x[j] for i, j in pairs)
        for k in (1, 2)
    ]
    problem = sp.Problem(sums[0], [sp.total(x) <= 3.5], lower=0, upper=1)
    options = sp.Options(effort="auto", skip=("linear_tree", "star", "split", "mixed"), gap=1e-4)
    results = sp.solve_each(problem, sums, options)
    for result in results:
        assert result.status is sp.Status.OPTIMAL
        assert {entry.name for entry in result.history} <= {"linear", "branch"}
    assert any(entry.name == "branch" for result in results for entry in result.history)


@pytest.mark.parametrize(
    ("expected", "spent", "early"),
    [(0.9, 0.0, False), (9.8, 0.2, True), (140.0, 13.9, True), (140.0, 14.1, False)],
)
def test_a_tree_has_a_tenth_of_a_long_relaxation(
    expected: float, spent: float, early: bool
) -> None:
    """Below a second rates alone decide, and a tree that had its share ends its turn."""
    search: Any = SimpleNamespace(queue=SimpleNamespace(seconds=float), _branched=spent)
    spec: Any = expected
    assert adaptive.AdaptiveSearch._is_early(search, spec) is early


def room(objective: Any, problem: sp.Problem, width: float) -> list[float]:
    """Beyond the bounds of each variable, in semidefinite relaxations, for a gap of ``width``."""
    options = sp.Options(effort="auto", gap=width, gap_kind="absolute")
    problem = problem.with_objective(objective)
    context = SolveContext(problem, options, Stages(), Deadline())
    model = Model(BoxProof(), Interval(problem.lower, problem.upper))
    state = SharedState.of(problem, (problem.objective,), options)
    search = adaptive.AdaptiveSearch(context, model, [], state)
    plan, scaling = search._plan(), Scaling.of_box(model.box, slack=search._room)
    assert np.array_equal(plan.slack, search._slack) and np.array_equal(plan.room, search._room)
    assert np.array_equal(scaling.scale, search._scaled().scaling.scale)
    inside = model.box.width() / 2
    return (search._scaled().scaling.scale - inside).tolist()


def test_an_objective_that_is_a_variable_has_room_beyond_a_flat_box() -> None:
    """Five gaps each way; rounding alone for other variables, for sums, and on wider boxes."""
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x * y >= -1], [0.5, -1], [0.5 + 1e-6, 1])
    for objective in (x, -2 * x + 3):
        of_x, of_y = room(objective, problem, 1e-5)
        gap = 1e-5 / abs(float(objective.coefficients[-1]))
        assert of_x == pytest.approx(5 * gap, rel=1e-3) and of_y < 1e-8
    assert max(room(x, problem, 1e-7)) < 1e-8
    assert max(room(x + y, problem, 1e-5)) < 1e-8
    assert max(room(x * x, problem, 1e-5)) < 1e-8
