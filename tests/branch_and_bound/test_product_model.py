"""Arrays of products: the problem's own values, McCormick's envelopes and cuts by squares."""

from __future__ import annotations

import numpy as np
import pytest
from random_cases import on_grid

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.branch_and_bound.float_propagation import FloatPropagation
from sparsepop_py.branch_and_bound.product_model import ProductModel
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling


def quadratic():
    """An objective with a square, rows with products, an equation and a constant row."""
    x, y, z = sp.variables(3)
    rows = [x * y - 2 * z * z + 3 * x >= -4, x + y + z <= 5, x * z - y == 0.25, 0 * x + 1 >= 0]
    return Problem(x * x - x * y + 2 * z + 7, rows, [-1.0, 0.0, -2.0], [2.0, 3.0, 1.5])


def columns_at(model, scaling, x):
    t = (x - scaling.centre) / scaling.scale
    return np.append(t, t[model.first] * t[model.second])


def random_points(problem, count):
    rng = np.random.default_rng(0)
    return rng.uniform(problem.lower, problem.upper, (count, problem.dimension))


def test_rows_and_objective_have_the_values_of_the_problem():
    problem = quadratic()
    model = ProductModel.of(problem)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    data = model.on_box(scaling)
    assert model.number.tolist() == [0, 1, 2]
    for x in random_points(problem, 20):
        z = columns_at(model, scaling, x)
        rows = (model.matrix(data.values) @ z)[: model.rows] - data.low[: model.rows]
        expected = problem.rows.values(x)[model.number]
        assert np.allclose(rows * data.sizes[:-1], expected, rtol=1e-12, atol=1e-12)
        value = data.size * (data.constant + data.cost @ z)
        assert value == pytest.approx(problem.objective(x), rel=1e-12)


def test_envelopes_hold_at_true_products_and_touch_at_corners():
    problem = quadratic()
    model = ProductModel.of(problem)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    data = model.on_box(scaling)
    above = slice(model.rows + 1, model.rows + 1 + model.envelopes)
    for x in random_points(problem, 50):
        z = columns_at(model, scaling, x)
        assert np.all((model.matrix(data.values) @ z - data.low)[above] >= -1e-12)
    corner = np.append(np.ones(3), np.ones(model.first.size))  # t = 1: 1 - t vanishes
    assert np.sum(np.abs((model.matrix(data.values) @ corner - data.low)[above]) < 1e-12) > 0


def test_a_cut_is_the_square_of_the_distance():
    """f = x^2 - 2 x y + 2 y^2 = (x - y)^2 + y^2 has |V (x - p)|^2 = f at x - p."""
    x, y = sp.variables(2)
    problem = Problem(x * x - 2 * x * y + 2 * y * y + 3 * x, lower=-1, upper=2)
    model = ProductModel.of(problem)
    assert model.convex == (0,)
    point = np.array([0.5, -0.25])
    cut = model.cut(model.rows, point)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    row, right = cut.row(scaling)
    for x0 in random_points(problem, 10):
        z = columns_at(model, scaling, x0)
        a, b = x0 - point
        value = row @ z[np.append(cut.columns, cut.variables)] - right
        assert value == pytest.approx((a - b) ** 2 + b**2, abs=1e-12)


def test_forms_with_a_negative_eigenvalue_have_no_cut():
    x, y = sp.variables(2)
    saddle = Problem(x * x + 3 * x * y + y * y, [x * y >= 1, x * x + y * y <= 1], -1, 1)
    model = ProductModel.of(saddle)
    assert model.convex == (1,)  # the disc, by its negative
    assert model.cut(model.rows, np.zeros(2)) is None


@pytest.mark.parametrize("seed", range(8))
def test_propagation_in_doubles_loses_no_feasible_point(seed):
    rng = np.random.default_rng(seed)
    x = sp.variables(3)
    point = rng.uniform(-1.0, 1.0, 3)
    rows = []
    for _ in range(4):
        p = sum(
            float(c) * v * w for c, v, w in zip(rng.normal(size=3), x, x[1:] + x[:1], strict=True)
        )
        p = p + float(rng.normal()) * x[0] * x[0] + float(rng.normal()) * x[1]
        rows.append(p >= p(point) - 0.05)
    problem = Problem(x[0] * x[1] - x[2], rows, -1.5, 1.5)
    cutoff = problem.objective(point) + 0.1
    sweeps = FloatPropagation(ProductModel.of(problem)).sweeps
    low, high, count, empty = sweeps(problem.lower, problem.upper, cutoff, 10)
    assert not empty and 0 <= count <= 10
    samples = rng.uniform(-1.5, 1.5, (20000, 3))
    samples = np.concatenate([samples, point + 0.05 * rng.normal(size=(2000, 3)), [point]])
    holds = np.all([on_grid(row.polynomial, samples) >= 0 for row in problem.constraints], axis=0)
    holds &= np.all(np.abs(samples) <= 1.5, axis=1)
    holds &= on_grid(problem.objective, samples) <= cutoff
    assert holds[-1]
    inside = np.all((samples[holds] >= low - 1e-9) & (samples[holds] <= high + 1e-9), axis=1)
    assert inside.all()


def test_propagation_in_doubles_narrows_and_empties():
    """x y == 1 on [0.1, 2]^2: both at least 1/2. With x + y <= 0.9 none is left."""
    x, y = sp.variables(2)
    low, high = np.full(2, 0.1), np.full(2, 2.0)
    sweeps = FloatPropagation(ProductModel.of(Problem(x, [x * y == 1]))).sweeps
    low_now, high_now, count, empty = sweeps(low, high, np.inf, 5)
    assert not empty and count > 0
    assert low_now == pytest.approx([0.5, 0.5]) and high_now == pytest.approx([2.0, 2.0])
    sweeps = FloatPropagation(ProductModel.of(Problem(x, [x * y == 1, x + y <= 0.9]))).sweeps
    assert sweeps(low, high, np.inf, 5)[3]


def test_propagation_in_doubles_solves_for_x_and_its_square_together():
    """x - x^2 >= 3/16 on [0, 1] says x in [1/4, 3/4]; apart, both terms say nothing."""
    x, y = sp.variables(2)
    sweeps = FloatPropagation(ProductModel.of(Problem(y, [x - x * x >= 0.1875]))).sweeps
    low, high, count, empty = sweeps(np.zeros(2), np.ones(2), np.inf, 1)
    assert count == 1 and not empty
    assert low == pytest.approx([0.25, 0.0]) and high == pytest.approx([0.75, 1.0])
    sweeps = FloatPropagation(ProductModel.of(Problem(y, [x - x * x >= 0.26]))).sweeps
    assert sweeps(np.zeros(2), np.ones(2), np.inf, 1)[3]  # the largest value is 1/4


def test_propagation_in_doubles_decides_a_variable_of_two_values():
    x, y = sp.variables(2)
    problem = Problem(y, [x * x - x == 0, y * y - y >= 0, x * y + x * x == 0, y * y - 3.0 * y == 0])
    model = ProductModel.of(problem)
    assert model.two_valued.tolist() == [0, 1]
    assert ProductModel.of(Problem(y, problem.constraints[1:3])).two_valued.size == 0
    signs = [x * x == 1, y * y <= 1, x * y == 1, y * y + x == 1]
    assert ProductModel.of(Problem(y, signs)).two_valued.tolist() == [0]
    sweeps = FloatPropagation(ProductModel.of(Problem(y, [x * x - x == 0]))).sweeps
    low, high, _, _ = sweeps(np.array([0.4, 0.0]), np.ones(2), np.inf, 1)
    assert low == pytest.approx([1.0, 0.0]) and high == pytest.approx([1.0, 1.0])


def test_rows_of_nearly_fixed_variables_are_not_scaled_to_their_rounding():
    """With x within 1e-12 of 1, what is left of 1 - x is no size to divide rounding by."""
    x, y = sp.variables(2)
    model = ProductModel.of(Problem(y, [1.0 - x + 0.0 * y >= 0]))
    box = Interval(np.array([1.0 - 1e-12, 0.0]), np.ones(2))
    data = model.on_box(Scaling.of_box(box))
    assert data.sizes[0] == pytest.approx(1e-7)
