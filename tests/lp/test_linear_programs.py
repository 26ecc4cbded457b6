"""Linear models that are solved again and again, against SciPy's own linear programming."""

from __future__ import annotations

from dataclasses import replace

import highspy
import numpy as np
import pytest
import scipy.sparse as sps
from hypothesis import given, settings
from random_cases import SEEDS
from scipy.optimize import linprog

from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.lp import highs
from sparsepop_py.lp.highs import LinearModel, solve_lp

INF = np.inf


class Program:
    """A random program with sparse integer data; feasible at a planted point if asked."""

    def __init__(self, rng, m=6, n=5, feasible=True):
        self.matrix = rng.integers(-3, 4, (m, n)) * (rng.random((m, n)) < 0.7)
        planted = rng.integers(-2, 3, n)
        middle = self.matrix @ planted if feasible else rng.integers(-9, 10, m)
        self.low = np.where(rng.random(m) < 0.3, -INF, middle - rng.integers(0, 3, m))
        self.high = np.where(rng.random(m) < 0.3, INF, middle + rng.integers(0, 3, m))
        self.columns = np.minimum(planted, -1.0 * rng.integers(0, 4, n)), np.full(n, 4.0)

    @property
    def model(self):
        return LinearModel(sps.csr_array(self.matrix * 1.0), (self.low, self.high), self.columns)

    def load_into(self, model):
        model.load(sps.csr_array(self.matrix * 1.0), (self.low, self.high), self.columns)

    def reference(self, cost):
        """linprog's answer, by its dual simplex method with presolve."""
        top, bottom = np.isfinite(self.high), np.isfinite(self.low)
        rows = np.concatenate([self.matrix[top], -self.matrix[bottom]])
        right = np.concatenate([self.high[top], -self.low[bottom]])
        bounds = np.stack(self.columns, axis=1)
        return linprog(cost, A_ub=rows, b_ub=right, bounds=bounds, method="highs-ds")

    def check(self, solution, cost):
        """Same value as the reference; feasible, and prices that prove the value."""
        expected = self.reference(cost)
        if expected.status == 2:
            assert solution.status == "infeasible"
            return
        assert expected.status == 0
        assert solution.status == "solved"
        assert solution.value == pytest.approx(expected.fun, abs=1e-7)
        assert cost @ solution.x == pytest.approx(expected.fun, abs=1e-7)
        rows = self.matrix @ solution.x
        assert np.all((rows >= self.low - 1e-7) & (rows <= self.high + 1e-7))
        assert np.all(solution.x >= self.columns[0] - 1e-7)
        assert np.all(solution.x <= self.columns[1] + 1e-7)
        assert self.dual_value(cost, solution.dual) == pytest.approx(expected.fun, abs=1e-6)

    def dual_value(self, cost, price):
        """What row prices prove: the least of price'r + (cost - A'price)'x over all bounds."""
        reduced = cost - self.matrix.T @ price
        reduced[np.abs(reduced) < 1e-9] = 0.0
        rows = np.where(price > 0, self.low, self.high)
        rows = np.where(np.abs(price) < 1e-9, 0.0, rows)
        columns = np.where(reduced > 0, self.columns[0], self.columns[1])
        return float(price @ rows + reduced @ np.where(reduced == 0.0, 0.0, columns))


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_many_objectives_on_one_model(seed):
    rng = np.random.default_rng(seed)
    program = Program(rng)
    model = program.model
    for _ in range(5):
        cost = rng.integers(-4, 5, 5).astype(float)
        program.check(model.solve(cost), cost)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_other_numbers_in_the_same_shape(seed):
    rng = np.random.default_rng(seed)
    cost = rng.integers(-4, 5, 5).astype(float)
    model = Program(rng).model
    for _ in range(5):
        program = Program(rng, feasible=bool(rng.random() < 0.7))
        program.load_into(model)
        program.check(model.solve(cost), cost)


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_another_shape_on_the_same_model(seed):
    rng = np.random.default_rng(seed)
    model = Program(rng).model
    model.solve(np.ones(5))
    for m, n in ((2, 7), (9, 3), (6, 5)):
        program = Program(rng, m, n)
        program.load_into(model)
        cost = rng.integers(-4, 5, n).astype(float)
        program.check(model.solve(cost), cost)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_bounds_of_some_columns_are_swapped_and_swapped_back(seed):
    rng = np.random.default_rng(seed)
    program = Program(rng)
    model, cost = program.model, rng.integers(-4, 5, 5).astype(float)
    before = model.solve(cost)
    program.check(before, cost)
    whole = program.columns
    chosen = rng.choice(5, 2, replace=False)
    low, high = whole[0].copy(), whole[1].copy()
    low[chosen] = high[chosen] = rng.integers(-1, 3, 2)
    program.columns = low, high
    model.bound(chosen, low[chosen], high[chosen])
    program.check(model.solve(cost), cost)
    program.columns = whole
    model.bound(chosen, whole[0][chosen], whole[1][chosen])
    after = model.solve(cost)
    program.check(after, cost)
    assert after.value == pytest.approx(before.value, abs=1e-8)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_the_ray_of_an_infeasible_program_proves_it(seed):
    rng = np.random.default_rng(seed)
    program = Program(rng, m=8, n=3, feasible=False)
    solution = program.model.solve(np.zeros(3))
    if program.reference(np.zeros(3)).status != 2:
        assert solution.status == "solved"
        return
    assert solution.status == "infeasible"
    assert solution.value == INF
    # price'(A x) >= price'r for all allowed rows r, yet price'(A x) stays below it: one sign does
    proofs = [program.dual_value(np.zeros(3), side * solution.dual) for side in (1.0, -1.0)]
    assert max(proofs) > 0


def test_a_program_without_a_least_value():
    free = np.array([-INF, -INF]), np.array([INF, INF])
    model = LinearModel(sps.csr_array([[1.0, 1.0]]), (np.array([0.0]), np.array([INF])), free)
    assert model.solve(np.array([1.0, -1.0])).status == "unbounded"
    assert model.solve(np.array([1.0, 1.0])).value == pytest.approx(0.0)


def test_no_rows_at_all():
    columns = np.array([-1.0, -2.0]), np.array([3.0, 5.0])
    model = LinearModel(sps.csr_array((0, 2)), (np.zeros(0), np.zeros(0)), columns)
    found = model.solve(np.array([1.0, -1.0]))
    assert found.status == "solved"
    assert found.x.tolist() == [-1.0, 5.0]


def test_a_time_limit_is_for_one_solve_only():
    rng = np.random.default_rng(0)
    program = Program(rng, 200, 150)
    model, cost = program.model, rng.integers(-4, 5, 150).astype(float)
    assert model.solve(cost, 1e-3).status == "stopped"  # it takes far longer
    program.check(model.solve(cost), cost)


def test_a_repeated_solve_takes_no_steps_of_its_own():
    rng = np.random.default_rng(1)
    program = Program(rng, 60, 50)
    model, cost = program.model, rng.integers(-4, 5, 50).astype(float)
    first = model.solve(cost)
    program.load_into(model)
    second = model.solve(cost)
    assert model._highs.getInfo().simplex_iteration_count == 0  # the basis was kept
    assert np.allclose(first.x, second.x, rtol=0.0, atol=1e-9)
    rows, columns = model.active()
    assert rows.size + columns.size == 50


def test_largest_margin_of_an_interval():
    # d >= t and 1 - d >= t: t = 1/2 at d = 1/2; with d = 1/4 fixed, t = 1/4
    cost = np.array([0.0, -1.0])
    rows = sps.csr_array([[1.0], [-1.0]]), np.ones(2), np.array([0.0, 1.0])
    bounds = np.full(2, -5.0), np.full(2, 5.0)
    nothing = sps.csr_array((0, 1)), np.zeros(0)
    assert solve_lp(cost, rows, nothing, bounds) == pytest.approx([0.5, 0.5])
    fixed = sps.csr_array([[1.0]]), np.array([0.25])
    assert solve_lp(cost, rows, fixed, bounds) == pytest.approx([0.25, 0.25])
    away = sps.csr_array([[1.0]]), np.array([7.0])
    assert solve_lp(cost, rows, away, bounds) is None


def test_a_program_that_fails_is_solved_again_without_perturbed_costs(monkeypatch):
    rows = sps.csr_array(np.array([[1.0, 1.0]]))
    ends = np.array([1.0]), np.array([np.inf])
    model = LinearModel(rows, ends, (np.zeros(2), np.full(2, 5.0)))
    name, solve = "dual_simplex_cost_perturbation_multiplier", LinearModel._solve
    usual, seen = model._highs.getOptionValue(name)[1], list[float]()

    def failing(self, cost, time_limit):
        found = solve(self, cost, time_limit)
        seen.append(self._highs.getOptionValue(name)[1])
        return replace(found, status="failed") if len(seen) == 1 else found

    monkeypatch.setattr(LinearModel, "_solve", failing)
    found = model.solve(np.array([1.0, 2.0]))
    assert found.status == "solved" and found.value == pytest.approx(1.0)  # at (1, 0)
    assert seen == [usual, 0.0] and usual > 0.0
    assert model._highs.getOptionValue(name)[1] == usual  # the next program begins as usual


def test_a_program_has_the_time_until_the_kept_limit(monkeypatch):
    model = LinearModel(
        sps.csr_array(np.eye(2)), (np.zeros(2), np.ones(2)), (np.zeros(2), np.ones(2))
    )
    monkeypatch.setattr(highs, "before_check", lambda: 5.0)
    model.solve(np.ones(2))
    most = model._highs.getOptionValue("time_limit")[1]
    assert 4.0 < most - model._highs.getRunTime() <= 5.0
    model.solve(np.ones(2), time_limit=1.0)
    assert model._highs.getOptionValue("time_limit")[1] - model._highs.getRunTime() <= 1.0


def test_a_program_that_the_kept_limit_stops_ends_the_work(monkeypatch):
    model = LinearModel(
        sps.csr_array(np.eye(2)), (np.zeros(2), np.ones(2)), (np.zeros(2), np.ones(2))
    )
    monkeypatch.setattr(model._highs, "getModelStatus", lambda: highspy.HighsModelStatus.kTimeLimit)
    assert model.solve(np.ones(2)).status == "stopped"
    with Deadline(1e-9).kept(), pytest.raises(LimitReached):
        model.solve(np.ones(2))
