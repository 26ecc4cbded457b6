"""Local searches from several starts: what is proved, and what is left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.local_search import multistart
from sparsepop_py.local_search.multistart import Aim, best_attained


def test_equal_vectors_are_proved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Least x + y with x y >= 1 on [1/2, 2]^2 is 2, at (1, 1)."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x * y >= 1], 0.5, 2.0)
    tried: list[Any] = []
    own = multistart.prove_feasible
    monkeypatch.setattr(
        multistart, "prove_feasible", lambda problem, x: tried.append(x) or own(problem, x)
    )
    start = np.array([1.0, 1.0 + 1e-12])
    point, vectors = best_attained(problem, [start, start.copy()], Aim(1e-6), "prove")
    assert len(vectors) == 2 and len(tried) == 1
    assert point is not None and point.value == pytest.approx(2.0)


def test_a_search_that_finds_the_incumbent_again_is_the_last_of_its_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a bound near the incumbent's value other methods from there are left out."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x * y >= 1], 0.5, 2.0)
    ends: list[Any] = []

    def tries(rows: Any, start: Any, *_: Any) -> Any:
        for end in (start, np.ones(2), np.array([1.0, 1.0 + 1e-3])):
            ends.append(end)
            yield end

    monkeypatch.setattr(multistart, "_tries", tries)
    start = np.array([2.0, 2.0])
    best_attained(problem, [start], Aim(1e-6, enough=1.999, known=2.0))
    assert len(ends) == 2
    best_attained(problem, [start], Aim(1e-6, enough=1.5, known=2.0))  # the bound is far
    assert len(ends) == 5
    best_attained(problem, [start], Aim(1e-6, enough=1.5, known=2.0, brief=True))
    assert len(ends) == 7
    best_attained(problem, [start], Aim(1e-6, brief=True))  # nothing was found before
    assert len(ends) == 10


def test_linear_programs_follow_where_others_fail_on_curved_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """|x| + |y| is at most 2 where x^4 + y^4 = 2, by the power mean inequality."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**4 + y**4 == 2], -2.0, 2.0)
    monkeypatch.setattr(multistart, "local_search", lambda problem, start, *_: start)
    point, _ = best_attained(problem, [np.array([-0.3, -0.7])], Aim(1e-6))
    assert point is not None and point.value == pytest.approx(-2.0, abs=1e-4)


def test_points_may_be_as_far_away_as_bounds() -> None:
    """On [2^45, 2^45 + 4] x [0, 2^45] the difference x - y is at least 0, and at most 4 there."""
    x, y = sp.variables(2)
    far = 2.0**45
    problem = sp.Problem(x - y, [], [far, 0.0], [far + 4.0, far])
    point, _ = best_attained(problem, [np.array([far, far])], Aim(1e-6))
    assert point is not None
    assert 0.0 <= point.value <= 4.0
