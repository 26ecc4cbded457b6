"""Sequential linear programming: known optima, variables that are held, bounds that hold."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from random_cases import SEEDS, random_case
from scipy.optimize import linprog
from search_cases import heat_exchangers

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.local_search import slp
from sparsepop_py.local_search.slp import sequential_search, violated_rows

INF = np.inf


def known():
    """Problems that few variables complicate, a start, and their least values by hand."""
    x, y, z = sp.variables(3)
    # at the best z the second row is tight: x + y + 1 / x, least at x = 1, y = 0.5
    yield Problem(x + y + z, [x * z >= 1, y >= 0.5], 0.1, 5.0), (3.0, 3.0, 3.0), (0,), 2.5
    # y + z = 2, x (y - z) with x <= 1 and y, z in [0, 2]: -2 at x = 1, y = 0, z = 2
    yield Problem(x * y - x * z, [y + z == 2], 0.0, [1.0, 2.0, 2.0]), (0.7, 0.5, 1.5), (0,), -2.0
    # without products: a linear program, least at a vertex
    yield Problem(-x - 2 * y - z, [x + y <= 1, y + z <= 1], 0.0, 1.0), (0.2, 0.2, 0.2), (), -2.0
    # y = 1 / x on [1/2, 2]: 2 x + y is least at x = 1 / sqrt 2
    yield Problem(2 * x + y, [x * y == 1], 0.5, 2.0), (1.0, 1.0, 1.0), (0,), 2 * np.sqrt(2)


@pytest.mark.parametrize("problem, start, held, least", list(known()))
def test_known_optima(problem, start, held, least):
    x = sequential_search(problem, np.array(start), held)
    assert problem.violation(x) <= 1e-7
    assert problem.objective(x) == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize("problem, start, held, least", list(known()))
def test_known_optima_of_many_rows(monkeypatch, problem, start, held, least):
    """Beyond some rows they are not restored after each step, and the optima are the same."""
    monkeypatch.setattr(slp, "_MANY", 0)
    monkeypatch.setattr(slp, "_restored", lambda search, x: pytest.fail("rows were restored"))
    test_known_optima(problem, start, held, least)


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_points_stay_within_the_bounds(seed):
    rng = np.random.default_rng(seed)
    problem = random_case(seed).problem
    start = rng.uniform(problem.lower - 1.0, problem.upper + 1.0)
    held = tuple(np.flatnonzero(rng.random(start.size) < 0.5).tolist())
    for x in (sequential_search(problem, start, held), sequential_search(problem, start)):
        assert np.all(np.isfinite(x))
        assert np.all((x >= problem.lower) & (x <= problem.upper))


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_a_feasible_start_is_not_made_worse(seed):
    case = random_case(seed)
    start = case.points[int(np.argmax(case.values))]
    x = sequential_search(case.problem, start)
    scale = 1e2 * (1.0 + np.abs(case.values).max())
    assert case.problem.objective(x) <= case.values.max() + scale * case.problem.violation(x) + 1e-9


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_rows_are_violated_where_held_variables_leave_no_choice(seed):
    # y_k = x u_k + e_k is linear once x is fixed
    rng = np.random.default_rng(seed)
    x, *e = sp.variables(5)
    u, truth = rng.uniform(-2, 2, 4), rng.uniform(0.2, 0.8)
    errors = rng.uniform(-0.1, 0.1, 4)
    y = truth * (u + errors)
    problem = Problem(x, [x * (u[k] + e[k]) == y[k] for k in range(4)], [0.1, *[-0.2] * 4], 1.0)
    start = np.array([truth, 0.0, 0.0, 0.0, 0.0])
    assert violated_rows(problem, start, np.array([0])).size == 0
    start[0] = truth / 2  # then e_k = u_k + 2 errors_k, within its bounds or not
    needed = u + 2 * errors
    off = np.abs(needed - np.clip(needed, -0.2, 1.0))
    found = set(violated_rows(problem, start, np.array([0])).tolist())
    assert set(np.flatnonzero(off > 1e-3)) <= found <= set(np.flatnonzero(off > 0.0))


def test_an_unbounded_direction_ends():
    x, y = sp.variables(2)
    problem = Problem(-x, [x * y >= 1], lower=0.0)
    found = sequential_search(problem, np.array([1.0, 1.0]))
    assert np.all(np.isfinite(found))
    assert problem.objective(found) <= -1.0


@pytest.mark.parametrize("curvature", [1.0, 50.0])
def test_searches_follow_curved_rows_to_their_end(curvature):
    # the parabola y = c x^2 within its bounds ends at x = 2; steps of one linearisation creep
    x, y = sp.variables(2)
    problem = Problem(-x, [y == curvature * x**2], [-3.0, 0.0], [2.0, 9.0 * curvature])
    found = sequential_search(problem, np.array([-2.0, 4.0 * curvature]))
    assert found == pytest.approx([2.0, 4.0 * curvature])


def test_a_search_without_time_ends_at_once():
    x, y = sp.variables(2)
    problem = Problem(-x, [y == 50 * x**2], [-3.0, 0.0], [2.0, 450.0])
    found = sequential_search(problem, np.array([-2.0, 200.0]), end=time.monotonic())
    assert found == pytest.approx([-2.0, 200.0])  # with time it comes to x = 2, see above


def test_a_search_ends_where_rounding_is_all_that_is_left(monkeypatch):
    """A step that promises less than 1e-9 of the value is the last one."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x * y >= 1], 0.5, 2.0)
    steps = []
    own = slp._Search.ahead

    def ahead(self, at, penalty, bounds):
        steps.append(at)
        return 2e-10, own(self, at, penalty, bounds)[1]

    monkeypatch.setattr(slp._Search, "ahead", ahead)
    found = sequential_search(problem, np.array([2.0, 0.5]), (0,))
    assert len(steps) == 1
    assert found.sum() < 2.5  # the better of both ends of the step


def test_a_search_that_creeps_ends_near_the_minimum(monkeypatch):
    problem, programs = heat_exchangers(), []
    own = slp._Search.step

    def step(self, *args):
        programs[-1] += 1
        return own(self, *args)

    monkeypatch.setattr(slp._Search, "step", step)
    for creeping in (0.0, 1e-4):
        programs.append(0)
        middle = 0.5 * (problem.lower + problem.upper)
        found = sequential_search(problem, middle, (1, 2, 5), creeping=creeping)
        assert problem.violation(found) < 1e-3
        assert problem.objective(found) == pytest.approx(7049.248, rel=1e-4)
    assert programs[1] < 0.3 * programs[0]


@pytest.mark.parametrize("end", [1.0, 1e6])
def test_a_start_where_the_objective_is_flat_is_left(end: float) -> None:
    """At x = 0 the slope of -x^2 y vanishes, which says nothing of the objective's size."""
    x, y = sp.variables(2)
    problem = sp.Problem(-y * x**2, [y <= 2 * x, y * y <= end * end], -end, end)
    found = sequential_search(problem, np.zeros(2))
    assert np.isfinite(problem.objective(found))
    assert slp.row_prices(problem, np.zeros(2), np.zeros(0, np.int64)).max() < 1e3


def test_objectives_over_subnormal_widths_are_scaled_within_doubles() -> None:
    """Warnings are errors here: a gradient of 16 over a slope of 2^-1050 is no double."""
    x, y = sp.variables(2)
    problem = Problem(16 * x + y, [x == y], 0.0, 2.0**-1054)
    found = sequential_search(problem, np.full(2, 2.0**-1055))
    assert np.all((found >= 0) & (found <= 2.0**-1054))


@pytest.mark.parametrize("bound", [1e-2, 1e-6, 1e-9])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_tiny_bounds_are_kept(bound: float, sign: float) -> None:
    """Errors of readings, in units of which scipy's linear program is the oracle.

    Readings are those of y(k+1) = .7 y(k) + .5 u(k), rounded; a and b are within 100 bounds.
    Products of changes move the end by some 100 bounds of itself.
    """
    u = np.random.default_rng(0).uniform(-1, 1, 24)
    y = np.full(25, 0.5)
    for k in range(24):
        y[k + 1] = 0.7 * y[k] + 0.5 * u[k]
    a, b, *e = sp.variables(27)
    rows = [(y[k + 1] - e[k + 1]) - a * (y[k] - e[k]) - b * u[k] == 0 for k in range(24)]
    middle = np.array([0.7, 0.5] + [0.0] * 25)
    reach = bound * np.array([100.0, 100.0] + [1.0] * 25)
    problem = Problem(sign * a, rows, middle - reach, middle + reach)
    found = sequential_search(problem, middle, (0, 1))
    assert problem.violation(found) <= 1e-5 * bound

    table = np.zeros((24, 27))
    table[:, 0], table[:, 1] = -y[:-1], -u
    table[np.arange(24), 2 + np.arange(24)], table[np.arange(24), 3 + np.arange(24)] = 0.7, -1.0
    limits = [(-100.0, 100.0)] * 2 + [(-1.0, 1.0)] * 25
    least = linprog(sign * np.eye(27)[0], A_eq=table, b_eq=np.zeros(24), bounds=limits).x[0]
    assert abs((found[0] - 0.7) / bound - least) <= 300 * bound + 1e-5
