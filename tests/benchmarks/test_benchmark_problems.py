"""The problems of the families have the optima that enumeration and publications say."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from slow_values import slow_after

import sparsepop_py as sp
from benchmarks.problems.power_flow import OPTIMUM, power_flow
from benchmarks.problems.quadratic import box_program, maximum_cut
from benchmarks.problems.sensors import localisation

AUTO = sp.Options(effort="auto", gap=1e-6, time_limit=60)


@pytest.mark.parametrize("ratings", slow_after(1, [True, False]))
def test_the_power_flow_of_14_buses_has_the_published_optimum(ratings: bool) -> None:
    """IPOPT's value is 6.2913e+03: Power Grid Library, release 17.08, baseline results."""
    task = power_flow(ratings)
    assert task.problem.dimension == 27
    result = sp.solve(task.problem, AUTO)
    assert result.status is sp.Status.OPTIMAL
    assert result.upper_bound == pytest.approx(OPTIMUM, abs=0.01)
    assert f"{result.lower_bound:.4e}" == f"{result.upper_bound:.4e}" == "6.2913e+03"


@pytest.mark.parametrize("seed", [0, 1])
def test_maximum_cuts_are_those_of_enumeration(seed: int) -> None:
    task = maximum_cut(10, 3, seed)
    signs = itertools.product((-1.0, 1.0), repeat=10)
    best = min(task.problem.objective(np.array(x)) for x in signs)
    result = sp.solve(task.problem, AUTO)
    assert result.upper_bound == best and result.lower_bound == pytest.approx(best, abs=1e-4)


@pytest.mark.parametrize("density", [0.4, 1.0])
def test_box_programs_are_bounded_by_their_vertices(density: float) -> None:
    objective = box_program(8, density, 3).problem.objective
    for _, value in zip(objective.words, objective.coefficients, strict=True):
        assert 2.0 * value == round(2.0 * value) and abs(value) <= 50.0
    best = min(objective(np.array(x)) for x in itertools.product((0.0, 1.0), repeat=8))
    result = sp.solve(box_program(8, density, 3).problem, AUTO)
    assert result.lower_bound <= result.upper_bound <= best
    assert result.status is sp.Status.OPTIMAL


def test_sensors_have_places_without_error() -> None:
    result = sp.solve(localisation(4, 0.6, 1).problem, AUTO)
    assert result.lower_bound == pytest.approx(0.0, abs=2e-6)
    assert abs(result.upper_bound) <= 1e-8
