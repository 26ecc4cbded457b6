"""What rows refuse, what they say of parameters, and when bounds are empty."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from sparsepop_py.errors import ProblemError
from sparsepop_py.verified.uncertain_rows.box import Bounds
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows

GOOD = {
    "target": [-2.0, 1.0],
    "regressors": [[1.0], [-3.0]],
    "radius": [0.25, 0.0],
    "radii": [[0.5], [0.0]],
}


@pytest.mark.parametrize("field", GOOD)
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_numbers_that_are_not_finite_are_refused(field: str, value: float) -> None:
    wrong = np.array(GOOD[field])
    wrong.flat[-1] = value
    with pytest.raises(ProblemError, match=f"{field}: found"):
        UncertainRows(("m",), **(GOOD | {field: wrong}))


@pytest.mark.parametrize("field", ["radius", "radii"])
def test_negative_uncertainties_are_refused(field: str) -> None:
    wrong = np.array(GOOD[field])
    wrong.flat[-1] = -1e-300
    with pytest.raises(ProblemError, match=f"{field}: found a negative"):
        UncertainRows(("m",), **(GOOD | {field: wrong}))


@pytest.mark.parametrize("field", GOOD)
def test_shapes_that_do_not_fit_are_refused(field: str) -> None:
    with pytest.raises(ProblemError, match=r"found shape"):
        UncertainRows(("m",), **(GOOD | {field: np.array(GOOD[field])[:1]}))


def test_rows_are_copies_that_nobody_changes() -> None:
    target = np.array(GOOD["target"])
    rows = UncertainRows(("m",), **(GOOD | {"target": target}))
    target[0] = 7.0
    assert rows.target.tolist() == [-2.0, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        rows.target[0] = 7.0


def test_bounds_follow_from_a_box_inside():
    wide = Bounds(("a", "b"), np.array([-1.0, -inf]), np.array([2.0, 0.0]))
    assert wide.follow(np.array([-1.0, -5.0]), np.array([2.0, 0.0]))
    assert not wide.follow(np.array([-1.0, -5.0]), np.array([2.0, 0.1]))
    assert not wide.follow(np.array([-1.1, -5.0]), np.array([2.0, 0.0]))
    none = Bounds(("a", "b"), np.zeros((0, 2)), np.zeros((0, 2)))
    assert not none.follow(np.array([-1.0, -5.0]), np.array([2.0, 0.0]))


def test_margins_by_hand() -> None:
    """|-2 + m| <= 1/4 + |m| / 2 and |1 - 3 m| <= 0, at m = -2 and m = 2."""
    rows = UncertainRows(("m",), **GOOD)
    assert rows.margin(np.array([-2.0])).tolist() == [1.25 - 4.0, -7.0]
    assert rows.margin(np.array([2.0])).tolist() == [1.25, -5.0]


def test_one_contradiction_empties_bounds() -> None:
    names = ("a", "b")
    for low, high, empty in (
        ([0.0, 1.0], [1.0, 0.5], True),
        ([0.0, 0.5], [1.0, 0.5], False),
        ([2.0, 1.0], [1.0, 0.5], True),
        ([-inf, 0.0], [inf, 1.0], False),
    ):
        assert Bounds(names, np.array(low), np.array(high)).empty == empty
