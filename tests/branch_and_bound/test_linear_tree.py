"""Trees of linear programs: known minima, proofs that stand alone, and when they are left out."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from scipy.optimize import linprog
from search_cases import bilinear, least_on_a_grid
from slow_values import slow_after, slow_unless
from solved import check

import sparsepop_py as sp
from sparsepop_py import Options, Problem, Status
from sparsepop_py.branch_and_bound import linear_tree
from sparsepop_py.branch_and_bound.linear_tree import LinearTree, suits_linear_tree
from sparsepop_py.branch_and_bound.product_model import ProductModel
from sparsepop_py.branch_and_bound.settings import LINEAR_TREE
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.progress import Stages
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.steps import BoxProof

AUTO = Options(effort="auto")


def names(result):
    return [entry.name for entry in result.history]


def concave():
    """min -(x - y)^2 - (y - z)^2 - x on [-1, 1]^3 with x + y + z <= 2: at a vertex."""
    x, y, z = sp.variables(3)
    return Problem(-((x - y) ** 2) - (y - z) ** 2 - x, [x + y + z <= 2], -1, 1)


def pooling():
    """Haverly's first pooling problem in Ben-Tal's form; the optimum is -400.

    C. A. Haverly, Studies of the behavior of recursion for the pooling problem, ACM SIGMAP
    Bulletin 25, 1978. A has 3 % sulphur, B 1 %, C 2 %; costs 6, 16, 10; prices 9, 15.
    """
    a, b, px, py, cx, cy, s = sp.variables(7)
    rows = [
        a + b == px + py,
        3 * a + b == s * (px + py),
        s * px + 2 * cx <= 2.5 * (px + cx),
        s * py + 2 * cy <= 1.5 * (py + cy),
        px + cx <= 100,
        py + cy <= 200,
    ]
    profit = 9 * (px + cx) + 15 * (py + cy) - 6 * a - 16 * b - 10 * (cx + cy)
    return Problem(-1 * profit, rows, [0.0] * 6 + [1.0], [300.0] * 6 + [3.0])


def test_a_bilinear_problem_against_a_grid():
    problem = bilinear()
    result = check(problem, sp.solve(problem, Options(effort="auto", gap=1e-3)))
    assert names(result) == ["linear tree"] and result.status is Status.OPTIMAL
    assert result.certificate.leaves > 1
    assert result.lower_bound <= least_on_a_grid(problem, 21)


def test_a_concave_objective_against_all_vertices():
    """Vertices of the box in x + y + z <= 2, and those of the cut corner (1, 1, 0)."""
    problem = concave()
    corners = [c for c in product((-1.0, 1.0), repeat=3) if sum(c) <= 2]
    corners += [(1.0, 1.0, 0.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0)]
    least = min(problem.objective(np.array(c)) for c in corners)
    result = check(problem, sp.solve(problem, AUTO), least, 2e-6)
    assert result.status is Status.OPTIMAL


def test_haverlys_pooling_problem():
    result = check(pooling(), sp.solve(pooling(), AUTO), -400.0, 2e-6)
    assert result.status is Status.OPTIMAL and names(result) == ["linear tree"]


def test_a_convex_program_is_closed_by_cuts():
    """min (x - 2)^2 + (y - 1)^2 + x y with x + y <= 1: 2x + y = 4, x + 2y = 2 lies outside.

    On x + y = 1 the objective is x^2 - 3 x + 4, so at x = 1 on [0, 1]: it is 2 (Lagrange).
    """
    x, y = sp.variables(2)
    problem = Problem((x - 2) ** 2 + (y - 1) ** 2 + x * y, [x + y <= 1], 0, 1)
    result = check(problem, sp.solve(problem, AUTO), 2.0, 2e-6)
    assert result.status is Status.OPTIMAL and result.certificate.leaves == 1


def test_a_convex_objective_with_binaries():
    """min (x - 0.4)^2 + (y - 0.7)^2 over binaries with x + y >= 1: (0, 1) has 0.16 + 0.09."""
    x, y = sp.variables(2)
    rows = [x * x - x == 0, y * y - y == 0, x + y >= 1]
    problem = Problem((x - 0.4) ** 2 + (y - 0.7) ** 2, rows, 0, 1)
    result = check(problem, sp.solve(problem, AUTO), 0.25, 2e-6)
    assert result.status is Status.OPTIMAL


def test_an_infeasible_problem():
    """On the unit circle x + y is at most sqrt(2) < 1.45."""
    x, y = sp.variables(2)
    problem = Problem(x * y, [x * x + y * y == 1, x + y >= 1.45], -2, 2)
    result = check(problem, sp.solve(problem, AUTO))
    assert result.status is Status.INFEASIBLE


@pytest.mark.parametrize("seed", slow_after(5, range(12)))
def test_random_problems_against_samples(seed):
    rng = np.random.default_rng(seed)
    x = sp.variables(3)
    pairs = [(0, 1), (1, 2), (0, 2), (0, 0), (2, 2)]
    some = [
        sum(float(c) * x[i] * x[j] for c, (i, j) in zip(rng.normal(size=5), pairs, strict=True))
    ]
    some += [
        sum(float(c) * v for c, v in zip(rng.normal(size=3), x, strict=True)) for _ in range(2)
    ]
    problem = Problem(some[0] + some[1], [some[2] >= -0.2, x[0] * x[1] + some[2] <= 0.5], -1, 1)
    result = check(problem, sp.solve(problem, AUTO))
    points = rng.uniform(-1, 1, (4000, 3))
    feasible = [p for p in points if problem.violation(p) == 0]
    assert result.lower_bound <= min(map(problem.objective, feasible))
    assert result.status is Status.OPTIMAL


def test_an_unfinished_tree_proves_what_it_has():
    problem = pooling()
    context = SolveContext(problem, AUTO, Stages(), Deadline(None))
    tree = LinearTree(
        context, Interval(problem.lower, problem.upper), lambda now, starts, proof, bound: now
    )
    tree._process(tree.root)
    certificate = tree.certificate(BoxProof()).settled(problem)
    assert -np.inf < certificate.bound <= -400.0
    assert certificate.verify(problem).ok


def test_the_certificate_goes_through_json():
    problem = bilinear()
    result = sp.solve(problem, Options(effort="auto", gap=1e-3))
    again = sp.from_json(sp.to_json(result))
    assert again.certificate.verify(problem).ok
    assert again.certificate.bound == result.lower_bound


@pytest.mark.parametrize("left_out", ["linear_tree", "linear", "branch", "cutoff", "obbt_lp"])
def test_whoever_leaves_out_a_part_gets_other_ways(left_out):
    problem = concave()
    result = check(problem, sp.solve(problem, Options(effort="auto", skip=(left_out,))))
    assert "linear tree" not in names(result)


def test_runs_with_a_work_limit_repeat():
    runs = [sp.solve(pooling(), Options(effort="auto", work_limit=0.02)) for _ in range(2)]
    assert runs[0].lower_bound == runs[1].lower_bound
    assert runs[0].upper_bound == runs[1].upper_bound
    for run in runs:
        check(pooling(), run)


def test_only_small_problems_of_degree_two_without_matrices_suit():
    x, y = sp.variables(2)
    assert suits_linear_tree(concave())
    assert not suits_linear_tree(Problem(x**3 + y, lower=-1, upper=1))
    assert not suits_linear_tree(Problem(x + y, [sp.psd([[1, x], [x, 1 + y]])], -1, 1))
    many = sp.variables(200)
    assert not suits_linear_tree(Problem(sp.total(many), lower=-1, upper=1))


def complementarity(seed, pairs, free=2):
    """Linear problem with x_i y_i = 0, and its data: objective c, rows a v <= b, v in [0, 4]."""
    rng = np.random.default_rng(seed)
    n = 2 * pairs + free
    c, a = -rng.uniform(0, 1, n).round(2), rng.normal(size=(pairs + 2, n)).round(2)
    inside = rng.uniform(0, 2, n) * np.append(np.tile([1.0, 0.0], pairs), np.ones(free))
    b = (a @ inside + 0.3).round(2)
    v = sp.variables(n)
    forms = [sum(float(w) * x for w, x in zip(row, v, strict=True)) for row in (c, *a)]
    rows = [form <= float(right) for form, right in zip(forms[1:], b, strict=True)]
    rows += [v[2 * k] * v[2 * k + 1] == 0 for k in range(pairs)]
    return Problem(forms[0], rows, 0, 4), (c, a, b)


def least_of_all_choices(data, pairs):
    """Minimum of the linear programs in which one variable of each pair is zero."""
    c, a, b = data
    best = np.inf
    for choice in product((0, 1), repeat=pairs):
        high = np.full(c.size, 4.0)
        high[[2 * k + side for k, side in enumerate(choice)]] = 0.0
        found = linprog(c, a, b, bounds=np.column_stack([np.zeros(c.size), high]))
        best = min(best, found.fun) if found.status == 0 else best
    return best


@pytest.mark.parametrize("seed", [0, 3])
def test_complementarity_against_all_choices(seed):
    problem, data = complementarity(seed, 6)
    result = check(problem, sp.solve(problem, AUTO), least_of_all_choices(data, 6), 3e-6)
    assert result.status is Status.OPTIMAL and names(result) == ["linear tree"]
    assert result.certificate.leaves > 1  # branches at nearly zero
    assert any(node.branch and node.branch[1] < 1e-50 for node in result.certificate.root)


def rectified(seed, samples, equal=True):
    """Least D with |y - c - a| <= D and a (a - z) = 0, a >= z: a = max(0, z), z = w u + b.

    The product may also be at most zero, since both factors are at least zero.
    """
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, samples).round(2), rng.uniform(0, 1, samples).round(2)
    w, b, c, d, *a = sp.variables(4 + samples)
    rows = []
    for left, right, out in zip(u.tolist(), y.tolist(), a, strict=True):
        z = left * w + b
        rows += [2 * out * (z - out) == 0 if equal else out * (out - z) <= 0]
        rows += [out - z >= 0, d >= c + out - right, d >= right - c - out]
    lower = [-3.0, -3.0, -3.0, 0.0] + [0.0] * samples
    return Problem(d, rows, lower, [3.0, 3.0, 3.0, 2.0] + [6.0] * samples), (u, y)


def least_of_all_patterns(data):
    """Minimum over all sets of samples with z >= 0, each a linear program in w, b, c, d."""
    (u, y), best = data, np.inf
    for on in product((0.0, 1.0), repeat=u.size):
        on = np.array(on)
        one = np.ones_like(u)
        rows = [np.c_[on * u, on, one, -one], np.c_[-on * u, -on, -one, -one]]
        rows += [np.c_[(1 - 2 * on) * u, 1 - 2 * on, 0 * u, 0 * u]]
        right = np.concatenate([y, -y, 0 * y])
        bounds = [(-3, 3)] * 3 + [(0, 2)]
        found = linprog([0, 0, 0, 1], np.vstack(rows), right, bounds=bounds)
        best = min(best, found.fun) if found.status == 0 else best
    return best


@pytest.mark.parametrize(
    ("seed", "equal"), slow_unless(lambda seed, _: seed != 1, [(0, True), (1, True), (2, False)])
)
def test_a_variable_and_a_row_with_product_zero(seed, equal):
    problem, data = rectified(seed, 8, equal)
    result = check(problem, sp.solve(problem, AUTO), least_of_all_patterns(data), 2e-6)
    assert result.status is Status.OPTIMAL and names(result) == ["linear tree"]
    assert suits_linear_tree(rectified(0, 70)[0])  # 74 variables


@pytest.mark.parametrize("seed", range(20))
def test_multipliers_of_rows_that_are_equations_where_a_factor_is_positive(seed):
    """min -(a - z) with a (a - z) = 0: 0 for a > 0, from duals of the linear program alone."""
    rng = np.random.default_rng(seed)
    a, w, b = sp.variables(3)
    k = rng.uniform(-2, 2)
    size = float(rng.choice([-3.0, 1.0, 0.5]))
    rows = [a - k * w - b >= 0, size * a * (a - k * w - b) == 0]
    if size == 0.5:
        rows[1] = size * a * (a - k * w - b) <= 0
    problem = Problem(b - a + k * w, rows, [0, -1, -1], [4, 1, 1])
    model = ProductModel.of(problem)
    assert model.complements.variable.tolist() == [0] and model.disjunctive
    box = Interval(np.array([2.0 ** -rng.uniform(0, 15), -1, -1]), np.array([2.0, 1, 1]))
    data = model.on_box(Scaling.of_box(box))
    price = model.signed(data, np.where(np.arange(model.pattern[1].size - 1) == 0, -1.0, 0.0))
    dual = model.dual(data, [price * data.sizes[0]], [1.0])
    proved = dual.evaluate(problem.rows, problem.equality, problem.objective_row)
    assert -1e-9 < proved[0] <= 0
    zero = model.on_box(Scaling.of_box(Interval(np.array([0.0, -1, -1]), box.hi)))
    assert not zero.free[0] and data.free[0]


def test_larger_problems_suit_where_branches_decide_all_products():
    """With 40 pairs there are 82 variables, more than the 60 of other problems."""
    problem, _ = complementarity(0, 40)
    x = sp.variables(82)
    assert suits_linear_tree(problem)
    assert not suits_linear_tree(Problem(x[0] * x[1], [x[2] * x[3] == 0], 0, 1))
    assert not suits_linear_tree(Problem(x[0], [x[2] * x[3] <= 0.5], 0, 1))


def test_complementary_pairs_are_equations_of_one_product():
    x, y, z = sp.variables(3)
    rows = [x * y == 0, y * z == 1, x * z >= 0, z**2 == 0, x * z + y * z == 0]
    assert ProductModel.of(Problem(x, rows, 0, 1)).complementary.tolist() == [[0, 1]]
    least = Problem(x, [x * y <= 0, x * z >= 0], 0, 1)  # as good as an equation
    assert ProductModel.of(least).complementary.tolist() == [[0, 1]]


def few_regressors(seed: int, n: int = 7, most: int = 3) -> tuple[Problem, float]:
    """Least squares with few of n coefficients, and its optimum by all choices of them."""
    rng = np.random.default_rng(seed)
    X = rng.integers(-8, 9, (12, n)).astype(float)
    y = X[:, :most] @ np.ones(most) + rng.integers(-4, 5, 12)
    v = sp.variables(2 * n)
    a, b = v[:n], v[n:]
    squares = sum(float(q) * a[i] * a[j] for (i, j), q in np.ndenumerate(X.T @ X))
    objective = (
        squares - 2 * sum(float(c) * t for c, t in zip(X.T @ y, a, strict=True)) + float(y @ y)
    )
    rows = [sum(b) <= most, *(t**2 == t for t in b)]
    rows += [t <= 9 * u for t, u in zip(a, b, strict=True)] + [
        t >= -9 * u for t, u in zip(a, b, strict=True)
    ]
    least = np.inf
    for chosen in combinations(range(n), most):
        part = X[:, chosen]
        w = np.linalg.lstsq(part, y, rcond=None)[0]
        assert np.abs(w).max() < 9.0  # its bounds do not bind
        least = min(least, float(np.sum((part @ w - y) ** 2)))
    return Problem(objective, rows, [-9] * n + [0] * n, [9] * n + [1] * n), least


@pytest.mark.parametrize("seed", range(4))
def test_convex_objectives_with_binaries_against_all_choices(seed):
    problem, least = few_regressors(seed)
    assert ProductModel.of(problem).convex_but_values
    result = check(problem, sp.solve(problem, AUTO))
    assert names(result) == ["linear tree"] and result.status is Status.OPTIMAL
    assert result.lower_bound == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_nearest_binary_points_against_all_of_them(seed):
    """Exact: the squares are of whole numbers."""
    rng = np.random.default_rng(seed)
    A, y = rng.integers(-9, 10, (9, 8)), rng.integers(-20, 21, 9)
    b = sp.variables(8)
    G, c = A.T @ A, A.T @ y
    objective = sum(int(q) * b[i] * b[j] for (i, j), q in np.ndenumerate(G))
    objective = objective - 2 * sum(int(q) * t for q, t in zip(c, b, strict=True)) + int(y @ y)
    problem = Problem(objective, [t * (1 - t) == 0 for t in b], 0, 1)
    least = min(int(np.sum((A @ np.array(p) - y) ** 2)) for p in product((0, 1), repeat=8))
    result = check(problem, sp.solve(problem, AUTO))
    assert names(result) == ["linear tree"]
    assert result.lower_bound <= least <= result.lower_bound + 1e-6 * (1 + least)


@pytest.mark.parametrize("seed", range(3))
def test_signs_from_fewer_readings_against_all_of_them(seed):
    """Exact: the squares are of whole numbers. Six readings of ten signs."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-9, 10, (6, 10))
    y = A @ rng.choice([-1, 1], 10) + rng.integers(-20, 21, 6)
    x = sp.variables(10)
    residuals = [sum(int(q) * t for q, t in zip(row, x, strict=True)) for row in A]
    objective = sum((r - int(v)) ** 2 for r, v in zip(residuals, y, strict=True))
    problem = Problem(objective, [t**2 == 1 for t in x], -1, 1)
    least = min(int(np.sum((A @ np.array(p) - y) ** 2)) for p in product((-1, 1), repeat=10))
    result = check(problem, sp.solve(problem, AUTO))
    assert names(result) == ["linear tree"]
    assert result.lower_bound <= least <= result.lower_bound + 1e-6 * (1 + least)


def test_what_is_convex_but_for_values():
    x, b, c = sp.variables(3)
    two = [b**2 == b, 2 * c**2 == 3 * c]

    def holds(objective, *rows):
        return ProductModel.of(Problem(objective, rows, [-1] * 3, [1] * 3)).convex_but_values

    assert holds(x**2 + b * c + b**2 + c**2, *two)
    assert holds(x + b, x <= b, *two)
    assert not holds(x**2 + b, x <= b)  # no variable of two values
    assert not holds(x * b, *two)  # not convex
    assert not holds(x, x * b <= 0.5, *two)  # a product in a row
    assert not holds(x, b**2 <= b)  # a row that leaves an interval
    assert not holds(x, x**2 <= 0.5, *two)  # a convex row, for which cuts are slow


def test_rows_that_vary_by_rounding_alone_are_left_out():
    """On a box where b + c <= 1 holds with equality up to 1e-13, its sign would be chance."""
    x, b, c = sp.variables(3)
    problem = Problem(x, [b + c <= 1, x >= b, b**2 == b], 0, 1)
    model = ProductModel.of(problem)
    box = Interval(np.array([0.0, 1 - 1e-13, 0.0]), np.array([1.0, 1.0, 1e-13]))
    data = model.on_box(Scaling.of_box(box))
    assert np.isneginf(data.low[[0, 2]]).all() and np.isfinite(data.low[1])
    assert not data.free[:3].any()
    whole = model.on_box(Scaling.of_box(Interval(np.zeros(3), np.ones(3))))
    assert np.isfinite(whole.low[:3]).all() and whole.free[2]


def test_a_tree_that_time_ends_keeps_its_bound():
    """Its proof needs a part of the time: without one, a thousand nodes would prove nothing."""
    problem, _ = few_regressors(0)
    context = SolveContext(problem, AUTO, Stages(), Deadline(100.0))
    box = Interval(problem.lower, problem.upper)
    tree = LinearTree(context, box, lambda now, *_: now)
    left = tree.context.deadline.left
    assert left is not None and 70.0 < left <= 80.0


def test_trees_that_branch_on_other_variables_decide_nothing():
    """Without branches on the binaries, nodes beyond the usual number would be in vain."""
    problem, _ = few_regressors(0)
    context = SolveContext(problem, AUTO, Stages(), Deadline(100.0))
    box = Interval(problem.lower, problem.upper)
    binaries = ProductModel.of(problem).two_valued
    other = np.setdiff1d(np.arange(problem.dimension), binaries)
    usual = LinearTree(context, box, lambda now, *_: now, other)
    assert usual.context.deadline is context.deadline
    assert usual._most_nodes <= LINEAR_TREE.most_nodes
    longer = LinearTree(context, box, lambda now, *_: now, binaries)
    assert longer._most_nodes == LINEAR_TREE.most_decisions


def test_the_oldest_cuts_make_room(monkeypatch):
    """With room for two cuts that stayed, later nodes would have none and leaves stay open."""
    few = replace(LINEAR_TREE, most_cuts=2)
    monkeypatch.setattr(linear_tree, "LINEAR_TREE", few)
    problem, least = few_regressors(1)
    result = check(problem, sp.solve(problem, AUTO))
    assert names(result) == ["linear tree"] and result.status is Status.OPTIMAL
    assert result.lower_bound == pytest.approx(least, rel=1e-6)


def test_a_tree_that_a_limit_ends_says_so(monkeypatch):
    """Its share of the work is over, and the rest is left for its proof."""
    monkeypatch.setattr(linear_tree, "LINEAR_TREE", replace(LINEAR_TREE, time_share=0.05))
    problem, least = few_regressors(0)
    result = check(problem, sp.solve(problem, Options(effort="auto", work_limit=1.0)))
    assert names(result) == ["linear tree"] and result.status is Status.LIMIT
    assert 0.0 < result.lower_bound <= least  # more than the range over the box proves


@pytest.mark.parametrize("seed", [4, 5])
def test_portfolios_of_two_assets_against_all_pairs(seed):
    """On a pair the objective is a parabola in one share; no point of a leaf is found otherwise."""
    rng, n = np.random.default_rng(seed), 6
    v = sp.variables(2 * n)
    x, b = v[:n], v[n:]
    F, gain = np.round(rng.normal(size=(n, 5)), 2), np.round(rng.uniform(0, 0.2, n), 3)
    risk = F @ F.T + 0.1 * np.eye(n)
    squares = sum(sum(float(F[i, j]) * x[i] for i in range(n)) ** 2 for j in range(5))
    objective = squares + 0.1 * sum(t**2 for t in x)
    objective = objective - sum(float(g) * t for g, t in zip(gain, x, strict=True))
    rows = [sum(x) == 1, sum(b) <= 2, *(t <= u for t, u in zip(x, b, strict=True))]
    problem = Problem(objective, [*rows, *(u * (1 - u) == 0 for u in b)], 0, 1)
    least = np.inf
    for i, j in combinations(range(n), 2):
        square = risk[i, i] - 2 * risk[i, j] + risk[j, j]
        slope = 2 * (risk[i, j] - risk[j, j]) - gain[i] + gain[j]
        t = np.clip(-slope / (2 * square), 0.0, 1.0)
        least = min(least, square * t**2 + slope * t + risk[j, j] - gain[j])
    result = check(problem, sp.solve(problem, AUTO))
    assert names(result) == ["linear tree"] and result.status is Status.OPTIMAL
    assert result.lower_bound == pytest.approx(least, abs=2e-6)
