"""The adaptive search ends where neither a limit nor a closed gap can end it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import sparsepop_py as sp
from sparsepop_py.strategy import adaptive

FEW = 20  # nodes
LINEAR = ("star", "split", "mixed", "full", "monomials", "cutoff", "linear_tree")


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
    monkeypatch.setattr(adaptive, "STRATEGY", replace(adaptive.STRATEGY, idle_nodes=FEW))
    x, y = sp.variables(2)
    line = sp.Problem(-x * y, [x + 3 * y == 1], lower=0, upper=1)  # -1/12 at (1/2, 1/6)
    result = sp.solve(line, sp.Options(effort="auto", skip=LINEAR, **options))
    assert result.status is sp.Status.BOUNDED
    assert -1 / 12 - 1e-6 < result.lower_bound <= -1 / 12
    assert advice in result.message


def test_a_limit_is_used_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive, "STRATEGY", replace(adaptive.STRATEGY, idle_nodes=FEW))
    x, y = sp.variables(2)
    line = sp.Problem(-x * y, [x + 3 * y == 1], lower=0, upper=1)
    options = sp.Options(effort="auto", skip=LINEAR, refine="none", node_limit=300)
    result = sp.solve(line, options)
    assert result.history[-1].nodes == 300
    assert "a larger node_limit" in result.message
