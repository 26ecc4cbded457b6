"""Boxes of starts of small problems: rounded, and only where a tree of linear programs fits."""

from __future__ import annotations

import pytest

import sparsepop_py as sp
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.progress import Stages
from sparsepop_py.strategy.linear_tree import box_of_starts


def context_of(problem: sp.Problem, **fields: str) -> SolveContext:
    return SolveContext(problem, sp.Options(**{"effort": "auto", **fields}), Stages(), Deadline())


def test_rows_are_propagated_to_a_box_of_starts() -> None:
    """x - x^2 >= 3/16 says x in [1/4, 3/4], and x + y == 1 the same of y."""
    x, y = sp.variables(2)
    rows = [x - x * x >= 0.1875, x + y == 1]
    box = box_of_starts(context_of(sp.Problem(x * y, rows, 0.0, 1.0)))
    assert box is not None
    assert box.lo == pytest.approx([0.25, 0.25]) and box.hi == pytest.approx([0.75, 0.75])
    unbounded = box_of_starts(context_of(sp.Problem(x * y, rows)))  # the row bounds x, this y
    assert unbounded is not None and unbounded.hi == pytest.approx([0.75, 0.75], abs=1e-6)


def test_no_box_of_starts_where_nothing_is_feasible_or_the_relaxation_is_asked_for() -> None:
    x, y = sp.variables(2)
    assert box_of_starts(context_of(sp.Problem(x, [x * y >= 2], 0.0, 1.0))) is None
    assert box_of_starts(context_of(sp.Problem(x * y, [], 0.0, 1.0), effort="plain")) is None
    assert box_of_starts(context_of(sp.Problem(x**3, [], 0.0, 1.0))) is None
