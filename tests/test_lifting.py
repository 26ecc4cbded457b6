"""Linear relaxations on boxes against McCormick's envelopes written down by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from random_cases import SEEDS, random_case
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py import Problem, Status
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.tightening.mccormick import Lifted, coordinate_of, tightened
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import prove
from sparsepop_py.verified.certificate.steps import BoxProof, Replay


class Bilinear:
    """min c'x + q'w, A x + B w <= b, w_k = x_i x_j, on a box, feasible at a planted point."""

    def __init__(self, seed, n=4, rows=3, feasible=True):
        rng = np.random.default_rng(seed)
        self.pairs = [(0, 1), (1, 2), (2, 3)]
        self.low = rng.integers(-2, 1, n).astype(float)
        self.high = self.low + rng.integers(1, 4, n)
        self.c, self.q = rng.integers(-3, 4, n) * 1.0, rng.integers(-3, 4, 3) * 1.0
        self.a = rng.integers(-2, 3, (rows, n)) * 1.0
        planted = rng.uniform(self.low, self.high)
        # a linear row and a product never stand in one row: no products of rows arise
        self.b = np.ceil(self.a @ planted) if feasible else self.a @ planted - 50.0
        x = sp.variables(n)
        objective = sp.total(
            [0.0 * x[0], *(c * v for c, v in zip(self.c, x, strict=True))]
            + [q * x[i] * x[j] for q, (i, j) in zip(self.q, self.pairs, strict=True)]
        )
        linear = [
            sp.total([0.0 * x[0], *(r * v for r, v in zip(row, x, strict=True))]) for row in self.a
        ]
        rows_ = [f <= b for f, b in zip(linear, self.b, strict=True)]
        self.problem = Problem(objective, rows_, self.low, self.high)

    def mccormick(self):
        """The least value over the envelopes of the three products, by linprog."""
        n, low, high = self.c.size, self.low, self.high
        rows, right = [np.append(r, np.zeros(3)) for r in self.a], list(self.b)
        for k, (i, j) in enumerate(self.pairs):
            for side_i, side_j in ((0, 0), (1, 1), (0, 1), (1, 0)):
                p, q = (low, high)[side_i][i], (low, high)[side_j][j]
                sign = 1.0 if side_i == side_j else -1.0  # sign (x_i - p)(x_j - q) >= 0
                row = np.zeros(n + 3)
                row[i], row[j], row[n + k] = sign * q, sign * p, -sign
                rows.append(row)
                right.append(sign * p * q)
        bounds = [*zip(low, high, strict=True), *[(None, None)] * 3]
        cost = np.append(self.c, self.q)
        return linprog(cost, A_ub=np.array(rows), b_ub=right, bounds=bounds, method="highs")


def lifted_of(problem):
    box = Interval(problem.lower, problem.upper)
    return Lifted.of(problem, box, find_cliques(problem)), box


def value_of(problem):
    lifted, _ = lifted_of(problem)
    solution = lifted.minimise()
    assert solution.status == "solved"
    proved = prove(
        Replay(problem, None),
        Interval(problem.lower, problem.upper),
        lifted.objective_dual(solution),
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


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_tightened_boxes_hold_all_feasible_points(seed):
    case = random_case(seed)
    lifted, box = lifted_of(case.problem)
    replay = Replay(case.problem, None)
    variables = range(case.problem.dimension)
    smaller, step, _ = tightened(replay, lifted, box, variables)
    assert np.all(case.points >= smaller.lo)
    assert np.all(case.points <= smaller.hi)
    assert np.all((smaller.lo >= box.lo) & (smaller.hi <= box.hi))
    if step is not None:
        again = BoxProof((step,)).replay(Replay(case.problem, None))
        assert np.array_equal(again.lo, smaller.lo)
        assert np.array_equal(again.hi, smaller.hi)


def test_tightening_finds_what_no_row_shows_alone():
    # x + y >= 3, x - y >= -1 and x <= 4: x >= 1 needs both rows
    x, y = sp.variables(2)
    problem = Problem(x, [x + y >= 3, x - y >= -1, x * y <= 100], [-9.0, -9.0], [4.0, 9.0])
    lifted, box = lifted_of(problem)
    smaller, step, _ = tightened(Replay(problem, None), lifted, box, (0, 1))
    assert step is not None
    assert smaller.lo == pytest.approx([1.0, -1.0], abs=1e-6)
    assert smaller.hi == pytest.approx([4.0, 5.0], abs=1e-6)


def test_variables_that_occur_nowhere_are_left_alone():
    x, y, z = sp.variables(3)
    problem = Problem(x, [x + y >= 1, x - y >= 0], -1.0, 1.0)
    lifted, box = lifted_of(problem)
    smaller, _, _ = tightened(Replay(problem, None), lifted, box, (0, 1, 2))
    assert smaller.lo[2] == -1.0
    assert smaller.hi[2] == 1.0
    assert smaller.lo[0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_infeasible_programs_give_proofs(seed):
    made = Bilinear(seed, feasible=False)
    if not np.all(np.abs(made.a).sum(axis=1) > 0) or not made.q.any():
        made.problem = Problem(made.problem.objective, [sp.variables(4)[0] >= 50], -2.0, 2.0)
    lifted, box = lifted_of(made.problem)
    solution = lifted.minimise()
    assert solution.status == "infeasible"
    dual = lifted.objective_dual(solution)
    assert prove(Replay(made.problem, None), box, dual, True).bound == np.inf
    result = sp.solve(made.problem, sp.Options(effort="auto"))
    assert result.status is Status.INFEASIBLE
    assert result.certificate.verify(made.problem).ok


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_a_model_of_another_box_starts_it_without_changing_the_value(seed):
    made = Bilinear(seed)
    lifted, box = lifted_of(made.problem)
    lifted.minimise()
    middle = 0.5 * (box.lo + box.hi)
    half = Interval(box.lo, np.where(np.arange(4) == 1, middle, box.hi))
    cliques = find_cliques(made.problem)
    cold = Lifted.of(made.problem, half, cliques).minimise()
    warm = Lifted.of(made.problem, half, cliques, lifted).minimise()
    assert warm.status == cold.status
    assert cold.status == "infeasible" or warm.value == pytest.approx(cold.value, abs=1e-7)


def test_objectives_that_are_coordinates():
    x, y = sp.variables(2)
    assert coordinate_of(1.0 * y) == (1, 1)
    assert coordinate_of(-x) == (0, -1)
    for other in (2.0 * x, x + y, x * x, x - 1.0, 0.0 * x):
        assert coordinate_of(other) is None
