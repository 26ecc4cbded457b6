"""Bounds by relaxations that are solved one after the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.bounding import order_bound
from sparsepop_py.bounding.order_bound import Model, bound_order, build_relaxations
from sparsepop_py.bounding.relaxation_bound import bound_box
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.progress import Stages
from sparsepop_py.verified.arithmetic.interval import Interval


def context_of(problem: sp.Problem, options: sp.Options) -> SolveContext:
    return SolveContext(problem, options, Stages(), Deadline())


def test_moments_belong_to_the_relaxation_that_was_solved_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where time ends before the second relaxation, the moments are those of the first."""
    x, y = sp.variables(2)
    problem = sp.Problem(x**2 * y - x * y, [x + y <= 1.5], [-1, -1], [1, 1])
    models = []
    for order in (2, 3):
        options = sp.Options(effort="presolve", order=order)
        start = Model(*find_box(problem, None, options))
        models.append(build_relaxations(problem, (problem.objective,), start, options))
    first, second = (model.relaxations[-1] for model in models)
    assert first.moments.shape[0] < second.moments.shape[0]
    both = Model(models[0].proof, models[0].box, models[0].scaled, (first, second))

    def late(context: Any, box: Any, scaled: Any, relaxation: Any, start: Any) -> Any:
        return start if relaxation is second else bound_box(context, box, scaled, first, start)

    monkeypatch.setattr(order_bound, "bound_box", late)
    found = bound_order(context_of(problem, sp.Options(effort="presolve", order=2)), both)
    assert found.relaxation is first and found.solution is not None
    assert found.solution.y.shape == (first.moments.shape[0],)
    assert np.isfinite(found.certificate.bound)


def test_a_better_incumbent_that_leaves_the_box_solves_no_program_again() -> None:
    """Both variables have bounds, which no value of x y makes tighter than the rows do."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1], [-1, -1], [1, 1])
    context = context_of(problem, sp.Options(order=1))
    last = bound_order(context, None)
    better = replace(context, best=prove_feasible(problem, np.array([0.6, -0.6])))
    assert bound_order(better, None, last) is last
    elsewhere = replace(last, model=replace(last.model, box=Interval.point(np.zeros(2))))
    assert bound_order(better, None, elsewhere).solution is not None


def test_free_variables_are_scaled_anew_by_a_better_incumbent() -> None:
    """The least value of (x - 3)^2 + y^2 is 0; no variable has a bound."""
    x, y = sp.variables(2)
    problem = sp.Problem((x - 3) ** 2 + y**2, [x * y <= 1])
    context = context_of(problem, sp.Options(effort="plain", order=1))
    last = bound_order(context, None)
    better = replace(context, best=prove_feasible(problem, np.array([3.0, 0.0])))
    assert bound_order(better, None, last) is not last
