"""Linear and convex quadratic problems without a box: minima by hand, planted, and rays."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from random_cases import over_a_polyhedron

import sparsepop_py as sp
from sparsepop_py.bounding import exact_convex
from sparsepop_py.bounding.exact_convex import falling_direction
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.budget import Deadline, LimitReached, check
from sparsepop_py.verified.certificate import rational_gram
from sparsepop_py.verified.points.unbounded_ray import falling_ray

INF = np.inf
EFFORTS = ("plain", "presolve", "auto")


@pytest.mark.parametrize("effort", EFFORTS)
def test_the_sum_of_free_variables_under_an_equation(effort):
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem(x + y, [x + y == 1]), sp.Options(effort=effort, time_limit=20))
    assert result.status == "OPTIMAL"
    assert result.lower_bound == result.upper_bound == 1.0
    assert result.certificate.verify(result.problem).ok


@pytest.mark.parametrize("seed", range(30))
def test_planted_minima_are_proved(seed):
    problem, least = over_a_polyhedron(seed)
    result = sp.solve(problem)
    assert result.status == "OPTIMAL"
    assert Fraction(result.lower_bound) <= least <= Fraction(result.upper_bound)
    assert least - Fraction(result.lower_bound) <= Fraction(1, 10**12) * max(1, abs(least))
    again = sp.from_json(sp.to_json(result))
    assert again.lower_bound == result.lower_bound


def test_a_plain_relaxation_keeps_its_output():
    """The order-1 relaxation is solved as asked; the proof is by exact multipliers."""
    x, y, z = sp.variables(3)
    problem = sp.Problem(x + 2 * y + z, [x + y == 1, y + z == 2, y >= -3.5])
    result = sp.solve(problem, sp.Options(effort="plain", order=1))
    assert result.lower_bound == 3.0  # x + 2 y + z is the sum of both equations
    assert result.relaxation is not None and result.solution is not None


def test_convex_forms_with_one_flat_direction():
    """min (x - y)^2 + x with 3 x >= 1 is 1/3 at x = y = 1/3."""
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem((x - y) ** 2 + x, [3 * x >= 1]))
    assert Fraction(result.lower_bound) <= Fraction(1, 3) <= Fraction(result.upper_bound)
    assert result.upper_bound - result.lower_bound <= 1e-15


@pytest.mark.slow
def test_contradicting_rows_without_a_box():
    x, y, z = sp.variables(3)
    rows = [x + y + z >= 1, x - z <= -2, y + 2 * z <= 2]  # the sum: 0 >= 1
    result = sp.solve(sp.Problem(x, rows))
    assert result.status == "INFEASIBLE"
    assert result.certificate.verify(result.problem).ok


@pytest.mark.parametrize("effort", EFFORTS)
def test_rays_start_at_rational_points(effort):
    """3 x + y = 1, 3 z = 1: along (1, -3, 0) y falls; no feasible point has doubles for z."""
    x, y, z = sp.variables(3)
    problem = sp.Problem(y + z, [3 * x + y == 1, 3 * z == 1])
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=20))
    assert result.status == "UNBOUNDED" and result.lower_bound == result.upper_bound == -INF
    direction = result.ray / result.ray[0]
    assert result.ray[0] > 0 and np.allclose(direction, [1, -3, 0], rtol=0, atol=1e-12)
    again = sp.from_json(sp.to_json(result))
    assert again.status == "UNBOUNDED" and np.array_equal(again.ray, result.ray)


def test_a_convex_form_falls_along_its_flat_direction():
    """(x - 2 y)^2 - x falls along (2, 1) and nowhere else."""
    x, y = sp.variables(2)
    problem = sp.Problem((x - 2 * y) ** 2 - x, [x + y >= -7])
    assert np.array_equal(falling_direction(problem), [2.0, 1.0])
    result = sp.solve(problem)
    assert result.status == "UNBOUNDED"
    assert falling_ray(problem, result.attained, result.ray) is not None
    assert falling_ray(problem, result.attained, -result.ray) is None
    closed = sp.Problem((x - 2 * y) ** 2 - x, [x + y <= 7])
    assert falling_direction(closed) is None


def test_chains_of_many_variables_are_recognised_as_convex():
    """321 equal springs between 1 and -2 share a length of 3: each has 3 / 321."""
    x = sp.variables(320)
    ends = (x[0] - 1) ** 2 + (x[-1] + 2) ** 2
    springs = ends + sp.total((a - b) ** 2 for a, b in pairwise(x))
    result = sp.solve(sp.Problem(springs, [x[0] + x[-1] >= -2]))
    assert result.status is sp.Status.OPTIMAL
    assert 9 / 321 - 1e-9 <= result.lower_bound <= result.upper_bound <= 9 / 321 + 1e-6


def test_forms_that_are_not_convex_are_left_alone():
    x, y = sp.variables(2)
    result = sp.solve(sp.Problem(x * y, [x + y == 2], lower=[0, -INF]))
    assert result.lower_bound == -INF or result.status == "UNBOUNDED"  # x (2 - x) falls
    assert falling_direction(sp.Problem(x * y**2)) is None


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
def test_convex_problems_on_wide_boxes(effort):
    """(x - 10^6)^2 is 0 at 10^6; sizes of 10^12 on the box cost a bound on it the digits."""
    x, y = sp.variables(2)
    problem = sp.Problem((x - 1e6) ** 2 + y**2 / 1024, (), -2e6, 2e6)
    result = sp.solve(problem, sp.Options(effort=effort))
    assert result.status == "OPTIMAL"
    assert -1e-9 <= result.lower_bound <= 0.0
    assert result.certificate.verify(problem).ok


def test_a_false_row_without_variables_is_infeasible():
    x, y = sp.variables(2)
    for row in (0 * x - 1 >= 0, 0 * y + 2 == 0):
        assert sp.solve(sp.Problem(x**2 + y, [row])).status == "INFEASIBLE"


@pytest.mark.parametrize("rank", [30, 60])
def test_dense_forms_of_many_variables(monkeypatch, rank):
    """f = (x - p)' H (x - p) / 2 + 2 (a'x - b) with a'p = b is least at p over a'x >= b: 0."""
    monkeypatch.setattr(rational_gram, "_eliminated", lambda rows: pytest.fail("eliminated"))
    n, rng = 60, np.random.default_rng(rank)
    root = rng.integers(-3, 4, (n, rank))
    hessian, p, a = root @ root.T, rng.integers(-2, 3, n), root @ rng.integers(-1, 2, rank)
    i, j = np.triu_indices(n)
    words = [*zip(i + 1, j + 1, strict=True), *((0, k) for k in range(1, n + 1)), (0, 0)]
    linear = 2 * a - hessian @ p
    constant = p @ hessian @ p / 2 - 2 * a @ p
    values = [*(hessian[i, j] * np.where(i == j, 0.5, 1.0)), *linear, constant]
    objective = sp.Polynomial.from_words(np.array(words, np.int32), np.array(values, float), n)
    row = objective.from_words(np.array(words[-n - 1 :], np.int32), np.append(a, -a @ p) * 1.0, n)
    result = sp.solve(sp.Problem(objective, [row >= 0]), sp.Options(time_limit=20), start=p)
    assert -1e-9 <= result.lower_bound <= 0.0


def test_large_hessians_are_factorized(monkeypatch):
    """The path of 30 springs is semidefinite, and no longer so with one spring that pushes."""
    fewer = replace(BOUNDING, convex_variables=10)
    monkeypatch.setattr(exact_convex, "BOUNDING", fewer)
    x = sp.variables(30)
    springs = sp.total((a - b) ** 2 for a, b in pairwise(x))
    assert exact_convex._Program.of(sp.Problem(springs)).convex()
    pushing = springs - 1.5 * (x[3] - x[4]) ** 2
    assert not exact_convex._Program.of(sp.Problem(pushing)).convex()
    assert not exact_convex._Program.of(sp.Problem(springs - x[0] ** 2 / 1000)).convex()


def test_a_part_of_the_time_ends_without_an_exception():
    with exact_convex._within(Deadline(1e-9)):
        check()
        pytest.fail("not ended")
    with pytest.raises(LimitReached), Deadline(1e-9).kept(), exact_convex._within(Deadline(1.0)):
        check()
