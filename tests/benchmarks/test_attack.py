"""The random attack: planted points are feasible, and false claims are noticed."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks.problems.attack import KINDS, Planted, _at, _is_feasible, contradictions, planted


def test_there_are_twenty_kinds_in_turn():
    assert len(KINDS) == 20
    assert [planted(seed)[0] for seed in range(20)] == list(KINDS)


@pytest.mark.parametrize("seed", range(40))
def test_what_is_planted_is_feasible_and_least(seed):
    kind, made = planted(seed)
    assert bool(made.points) == (kind not in ("no ball", "no root", "falling"))
    for point in made.points:
        assert _is_feasible(made.problem, point)
        if made.least is not None:
            assert _at(made.problem.objective, point) >= made.least
    if made.least is not None:
        assert _at(made.problem.objective, made.points[0]) == made.least


def test_false_claims_are_noticed():
    (x,) = sp.variables(1)
    problem = sp.Problem(x, lower=0, upper=1)
    result = sp.solve(problem)
    made = Planted(problem, ((Fraction(0),),), Fraction(0))
    assert list(contradictions(made, result)) == []
    empty, falls = Planted(problem), Planted(problem, falls=True)
    assert list(contradictions(empty, result)) == ["0.0 is attained, but no point is feasible"]
    assert list(contradictions(falls, result)) == [
        "the bound 0.0 of an objective that falls without limit"
    ]
    other = Planted(sp.Problem(x, lower=-1, upper=1), ((Fraction(-1),),), Fraction(-1))
    found = list(contradictions(other, replace(result, lower_bound=0.0)))
    assert found[0] == "the bound 0.0 is above the value -1.0 of a planted point"
    assert found[1] == f"[0.0, {result.upper_bound!r}] leaves out the least value -1.0"
    assert "its certificate does not verify" in found
    assert np.isfinite(result.upper_bound)
