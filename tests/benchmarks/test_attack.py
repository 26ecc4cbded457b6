"""The random attack: planted points are feasible, and false claims are noticed."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks.problems.attack import contradictions
from benchmarks.problems.exact_points import is_feasible, value_at
from benchmarks.problems.planted_kinds import KINDS, Planted, planted


def test_there_are_25_kinds_in_turn():
    assert len(KINDS) == 25
    assert [planted(seed)[0] for seed in range(25)] == list(KINDS)


@pytest.mark.parametrize("seed", range(75))
def test_what_is_plantedis_feasible_and_least(seed):
    kind, made = planted(seed)
    if kind not in ("isolated", "partition", "weird rows"):  # irrational points, or none
        assert bool(made.points) == (kind not in ("no ball", "no root", "falling"))
    for point in made.points:
        assert is_feasible(made.problem, point)
        if made.least is not None:
            assert value_at(made.problem.objective, point) >= made.least
    if made.points and made.least is not None:
        assert value_at(made.problem.objective, made.points[0]) == made.least


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


@pytest.mark.parametrize("seed", [45, 146, 22, 23, 24])
def test_the_kinds_of_cones_ratios_grids_heaps_and_weird_rows_are_solved(seed):
    made = planted(seed)[1]
    result = sp.solve(made.problem, sp.Options(effort="plain", refine="prove", time_limit=4.0))
    assert list(contradictions(made, result)) == []


def test_an_empty_problem_and_one_whose_points_are_irrational_are_told_apart():
    (x,) = sp.variables(1)
    problem = sp.Problem(x**2, [x**2 == 2], 0, 2)
    result = sp.solve(problem)
    assert list(contradictions(Planted(problem, (), Fraction(2)), result)) == []
    assert len(list(contradictions(Planted(problem), result))) == 1


def test_points_are_judged_exactly():
    """The matrix has the determinant -2^-80 at 1/2 - 2^-80, and 1/2 is on the cone."""
    (x,) = sp.variables(1)
    matrix = sp.Problem(x, [sp.psd([[1, 0, 1], [0, 0, 0], [1, 0, 2 * x]])])
    cone = sp.Problem(x, [sp.second_order(x, 0.3 * x, 0.4 * x, 1.0 * (x - 0.5))])
    half, tiny = Fraction(1, 2), Fraction(1, 2**80)
    for problem in (matrix, cone):
        assert is_feasible(problem, (half,))
    assert not is_feasible(matrix, (half - tiny,))
    ratios = sp.RationalProblem(x / (1 + x**2), [x / (1 + x**2) + 1 / (2 + x) >= 0.8], 0, 1)
    assert value_at(ratios.objective, (half,)) == Fraction(2, 5)
    assert is_feasible(ratios, (half,)) == (Fraction(0.8) <= Fraction(4, 5))
    assert not is_feasible(ratios, (Fraction(1, 4),))
