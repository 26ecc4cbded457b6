"""The benchmark that puts auto beside plain orders: what it counts and what it leaves out."""

from __future__ import annotations

import pytest

import sparsepop_py as sp
from benchmarks.problems.families import REGISTRY
from benchmarks.tables import auto_beside_plain as tables
from benchmarks.tables.auto_beside_plain import (
    Beside,
    auto_beside_plain,
    beside_table,
    members_of,
)


def test_a_bound_below_the_plain_one_is_not_reached() -> None:
    low = Beside("p", 2, 1.0, 0.999, 0.1, 0.2, "LIMIT")
    near = Beside("p", 2, 1.0, 1.0 - 1e-7, 0.1, 0.2, "OPTIMAL")
    assert (low.reached, near.reached) == (False, True)
    assert beside_table([low, near]).endswith("reached in 1 of 2 rows")


def test_orders_below_the_least_are_left_out() -> None:
    """min x^4 - 2 x^2 = -1 at x = 1: its least order is 2."""
    (x,) = sp.variables(1)
    problem = sp.Problem(x**4 - 2 * x**2, [], -2.0, 2.0)
    [row] = auto_beside_plain([("quartic", problem)], [1, 2], 30.0)
    assert row.order == 2 and row.plain <= -1.0 <= row.plain + 1e-4 and row.auto <= -1.0


def test_members_of_a_family_are_measured_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """min x1^2 x2^2 (x1^2 + x2^2 - 1) on the unit ball is -1/27 (Lasserre 2001, Example 3)."""
    monkeypatch.setattr(tables, "EXTRA", 30.0)  # seconds of auto, however fast the plain order was
    problems = members_of(REGISTRY["zoo"], ["lasserre01_ex3_ball"])
    [row] = auto_beside_plain(problems, [3], 30.0, repeat=2)
    assert row.name == "lasserre01_ex3_ball"
    assert -1.0 / 27.0 - 1e-4 <= row.auto <= -1.0 / 27.0
