"""Linear relaxations on boxes against McCormick's envelopes written down by hand."""

from __future__ import annotations

import numpy as np
import pytest
from bilinear_problem import Bilinear
from hypothesis import given, settings
from random_cases import SEEDS

import sparsepop_py as sp
from sparsepop_py import Problem, Status
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import (
    LinearRelaxation,
    coordinate_of,
    first_moments,
    products_error,
)
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import prove
from sparsepop_py.verified.certificate.steps import Replay, Tightening


def relaxation_of(problem):
    box = Interval(problem.lower, problem.upper)
    return LinearRelaxation.of(problem, box, find_cliques(problem)), box


def value_of(problem):
    mccormick, _ = relaxation_of(problem)
    solution = mccormick.minimise()
    assert solution.status == "solved"
    proved = prove(
        Replay(problem, None),
        Interval(problem.lower, problem.upper),
        mccormick.objective_dual(solution),
        False,
    )
    return proved.bound


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_without_rows_the_bound_is_that_of_the_envelopes(seed):
    made = Bilinear(seed, rows=0)
    if not made.q.any():
        return
    expected = made.mccormick()
    assert expected.status == 0
    assert value_of(made.problem) == pytest.approx(expected.fun, abs=1e-6)


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_rows_and_their_products_only_add_to_the_envelopes(seed):
    made = Bilinear(seed)
    if not made.q.any():
        return
    rng = np.random.default_rng(seed)
    x = rng.uniform(made.low, made.high, (20000, 4))
    x = x[np.all(x @ made.a.T <= made.b, axis=1)]
    expected, bound = made.mccormick(), value_of(made.problem)
    assert bound >= expected.fun - 1e-6
    if x.size:
        products = np.stack([x[:, i] * x[:, j] for i, j in made.pairs], axis=1)
        assert bound <= (x @ made.c + products @ made.q).min() + 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_infeasible_programs_give_proofs(seed):
    made = Bilinear(seed, feasible=False)
    if not np.all(np.abs(made.a).sum(axis=1) > 0) or not made.q.any():
        made.problem = Problem(made.problem.objective, [sp.variables(4)[0] >= 50], -2.0, 2.0)
    mccormick, box = relaxation_of(made.problem)
    solution = mccormick.minimise()
    assert solution.status == "infeasible"
    dual = mccormick.objective_dual(solution)
    assert prove(Replay(made.problem, None), box, dual, True).bound == np.inf
    result = sp.solve(made.problem, sp.Options(effort="auto"))
    assert result.status is Status.INFEASIBLE
    assert result.certificate.verify(made.problem).ok


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_a_model_of_another_box_starts_it_without_changing_the_value(seed):
    made = Bilinear(seed)
    mccormick, box = relaxation_of(made.problem)
    mccormick.minimise()
    middle = 0.5 * (box.lo + box.hi)
    half = Interval(box.lo, np.where(np.arange(4) == 1, middle, box.hi))
    cliques = find_cliques(made.problem)
    cold = LinearRelaxation.of(made.problem, half, cliques).minimise()
    warm = LinearRelaxation.of(made.problem, half, cliques, mccormick).minimise()
    assert warm.status == cold.status
    assert cold.status == "infeasible" or warm.value == pytest.approx(cold.value, abs=1e-7)


def test_objectives_that_are_coordinates():
    x, y = sp.variables(2)
    assert coordinate_of(1.0 * y) == (1, 1)
    assert coordinate_of(-x) == (0, -1)
    for other in (2.0 * x, x + y, x * x, x - 1.0, 0.0 * x):
        assert coordinate_of(other) is None


def test_points_of_relaxations_without_moments_are_those_of_the_box():
    problem = Problem(sp.variables(1)[0] ** 2, lower=3, upper=3)
    mccormick, _ = relaxation_of(problem)
    scaled, relaxation = mccormick.scaled, mccormick.relaxation
    assert relaxation.moments.shape[0] == 0
    assert first_moments(scaled, relaxation, np.zeros(0)).tolist() == [3.0]
    assert products_error(relaxation, np.zeros(0)).tolist() == [0.0]


def test_multipliers_that_32_bits_do_not_hold_keep_64():
    """On [-1e100, 1e100]^2 row prices of order one are multipliers of order 1e100."""
    x, y = sp.variables(2)
    problem = Problem(x * y, [x + y >= 1], -1e100, 1e100)
    mccormick, _ = relaxation_of(problem)
    price = np.full(mccormick.program.b.size, -1.0)
    for size in (1.0, 1e100, 1e300):
        value = mccormick.dual([price], [size], short=True).value
        assert value.size and np.isfinite(value).all()
        assert value.dtype == (np.float32 if size == 1.0 else np.float64)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_certificates_over_huge_boxes_hold_finite_multipliers():
    x, y = sp.variables(2)
    rows = [-0.5 - x * y**2 >= 0, 10.5 - 2 * y - 2 * x**2 + 5 * y**3 >= 0]
    problem = Problem(x**3 + 8 * x**2 * y, rows, -1e100, 1e100)
    result = sp.solve(problem, sp.Options(effort="auto", work_limit=0.3))
    duals = [
        step.argument
        for node in result.certificate.root
        for step in node.box.steps
        if isinstance(step, Tightening)
    ]
    assert duals and all(np.isfinite(dual.value).all() for dual in duals)
