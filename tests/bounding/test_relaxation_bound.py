"""Bounds on a box by one relaxation."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.bounding import relaxation_bound
from sparsepop_py.bounding.order_bound import Model, build_relaxations
from sparsepop_py.bounding.relaxation_bound import bound_box
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.progress import Stages


def test_a_closed_gap_is_proved_once_by_short_multipliers(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the unit disc x y >= -1/2, attained at (-1, 1) / sqrt 2; order 1 is tight."""
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 + y**2 <= 1], [-1, -1], [1, 1])
    options = sp.Options(effort="auto", gap=1e-3)
    start = Model(*find_box(problem, None, options))
    model = build_relaxations(problem, (problem.objective,), start, options)
    point = prove_feasible(problem, np.array([-0.70710678, 0.70710678]))
    context = SolveContext(problem, options, Stages(), Deadline(), best=point)
    proofs = []
    own = relaxation_bound.prove
    monkeypatch.setattr(
        relaxation_bound, "prove", lambda *given: proofs.append(given[2]) or own(*given)
    )
    assert model.scaled is not None
    found = bound_box(context, model.box, model.scaled, model.relaxations[-1])
    assert [argument is None for argument in proofs] == [True, False]  # the box, then multipliers
    assert found.node.argument is proofs[-1] and found.node.argument.short
    assert -0.5 - 1e-3 <= found.proved.bound <= -0.5 + 1e-9
