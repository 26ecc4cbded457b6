"""Problems with cones and matrices from end to end: bounds, points, boxes, local searches."""

from fractions import Fraction

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_matrices import feasible_grid, holds, random_problem
from solved import check

import sparsepop_py as sp
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.matrix_rows import RowForm
from sparsepop_py.local_search.solvers import local_search
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty, propagate
from sparsepop_py.verified.certificate.steps import box_rows
from sparsepop_py.verified.points.unbounded_ray import falling_ray

INF = np.inf
SEEDS = st.integers(0, 2**32 - 1)
x, y = sp.variables(2)
EFFORTS = ["plain", "presolve", "auto"]


def solve(problem, effort="presolve", order=None):
    """With the point checked against the matrices in rationals."""
    result = sp.solve(problem, sp.Options(effort=effort, order=order, time_limit=20))
    if result.attained is not None and result.attained.radius == 0:
        at = [Fraction(v) for v in result.attained.x.tolist()]
        assert all(holds(c, at) for c in problem.constraints if 0 < c.side <= 4)
    return result


# ---- known values -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        # both from SparsePOP 3.03, run with SeDuMi; closed forms
        (sp.Problem(x, [sp.psd([[1, x], [x, 1]])]), -1.0),
        (sp.Problem(x + y, [sp.second_order(2, x, y)]), -2 * 2**0.5),
        # x y >= 1 for x, y >= 0
        (sp.Problem(x + y, [sp.psd([[x, 1], [1, y]])]), 2.0),
        # y >= (x^2 + 4)^(1/2), at x = 2 / 3^(1/2)
        (sp.Problem(y - 0.5 * x, [sp.second_order(y, x, 2)]), 3**0.5),
        # |(x, y)| <= 1 + x says y^2 <= 1 + 2 x, at most 9 for x <= 4
        (sp.Problem(y, [sp.second_order(1 + x, x, y), x <= 4]), -3.0),
        # x^2 y^2 >= 1, a set that is not convex
        (sp.Problem(x + y, [sp.psd([[x**2, 1], [1, y**2]])], 0, 4), 2.0),
        # correlations: y >= 0.5 x - (3/4)^(1/2) (1 - x^2)^(1/2), least at x = -1/2 with y = -1
        (sp.Problem(y, [sp.psd([[1, x, y], [x, 1, 0.5], [y, 0.5, 1]])]), -1.0),
        # a concave objective on half a disc, least at its corners (+-2, 0)
        (sp.Problem(y - x**2, [sp.second_order(2, x, y), y >= 0]), -4.0),
    ],
)
def test_known_optima(problem, optimum):
    check(problem, solve(problem, "auto"), optimum, 1e-5)
    if problem.degree == 1:
        check(problem, solve(problem), optimum, 1e-5)


@pytest.mark.parametrize("effort", EFFORTS)
def test_linear_matrix_inequalities_against_cvxpy(effort):
    """min c'x with A0 + sum x_i A_i semidefinite of four rows, x in [-2, 2]^3: convex, so tight."""
    rng = np.random.default_rng(4)
    parts = [b + b.T for b in rng.normal(size=(3, 4, 4))]
    cost = rng.normal(size=3)
    z = cp.Variable(3)
    asked = 2 * np.eye(4) + sum(z[k] * parts[k] for k in range(3))
    expected = cp.Problem(cp.Minimize(cost @ z), [asked >> 0, cp.abs(z) <= 2]).solve()
    v = sp.variables(3)
    table = [
        [2.0 * (i == j) + sum(float(p[i, j]) * w for p, w in zip(parts, v, strict=True))
         for j in range(4)] for i in range(4)
    ]  # fmt: skip
    objective = sp.total(float(c) * w for c, w in zip(cost, v, strict=True))
    problem = sp.Problem(objective, [sp.psd(table)], -2, 2)
    result = check(problem, solve(problem, effort))
    assert result.lower_bound == pytest.approx(expected, abs=1e-5)
    assert result.upper_bound == pytest.approx(expected, abs=1e-5)


def test_second_order_cones_against_cvxpy():
    """Least sum of distances of a point to three others, with the lengths as variables."""
    anchors = np.array([[0.0, 0.0], [1.0, 0.25], [0.5, 1.5]])
    z = cp.Variable(2)
    lengths = cp.sum([cp.norm(z - a) for a in anchors])
    expected = cp.Problem(cp.Minimize(lengths)).solve()
    v = sp.variables(5)
    cones = [
        sp.second_order(t, v[0] - float(a[0]), v[1] - float(a[1]))
        for t, a in zip(v[2:], anchors, strict=True)
    ]
    problem = sp.Problem(v[2] + v[3] + v[4], cones, lower=-2, upper=2)
    result = check(problem, solve(problem))
    assert result.lower_bound == pytest.approx(expected, abs=1e-5)
    assert result.upper_bound == pytest.approx(expected, abs=1e-5)


# ---- against grids ------------------------------------------------------------------------------


@settings(max_examples=4, deadline=None)
@given(SEEDS, st.sampled_from(EFFORTS))
def test_no_grid_point_is_below_the_bound(seed, effort):
    problem = random_problem(seed, side=2)
    _, values = feasible_grid(problem)
    result = check(problem, solve(problem, effort, 2 if effort == "plain" else None))
    assert np.all(values >= result.lower_bound)
    if values.size:
        assert result.status is not sp.Status.INFEASIBLE
        assert result.upper_bound <= values.min() + 1e-3 or effort == "plain"


@pytest.mark.parametrize("seed", [3, 5, 8])
def test_matrices_that_are_not_convex(seed):
    """The bound meets a proved point, and both lie near the best of a fine grid."""
    problem = random_problem(seed)
    result = check(problem, solve(problem, "auto"))
    assert result.status is sp.Status.OPTIMAL
    ends = np.linspace(-1, 1, 201)
    points = np.stack(np.meshgrid(ends, ends), axis=-1).reshape(-1, 2)
    inside = problem.matrices.least_eigenvalue(points) >= 0
    best = problem.objective(points[inside]).min()
    assert result.upper_bound <= best
    assert best <= result.lower_bound + 0.1


# ---- statuses -----------------------------------------------------------------------------------


def test_nothing_feasible():
    result = solve(sp.Problem(x, [sp.psd([[1, x], [x, 1]]), x >= 1.5]))
    assert result.status is sp.Status.INFEASIBLE
    assert result.certificate.verify(result.problem).ok


def test_a_ray_has_to_keep_the_matrix():
    """-x falls along x for trace and axis alone; [1 x; x 1] and |(x, y)| <= 2 stop it."""
    free = sp.Problem(-x, [sp.psd([[x, 1], [1, x + 3]]), sp.second_order(x + y, 2, x)])
    inside = prove_feasible(free, np.array([2.0, 1.0]))
    assert inside is not None
    assert falling_ray(free, inside) is not None
    for row in (sp.psd([[1, x], [x, 1]]), sp.second_order(2, x, y), sp.second_order(x, 2 * x, y)):
        problem = sp.Problem(-x, [row])
        start = prove_feasible(problem, np.zeros(2))
        assert start is not None
        assert falling_ray(problem, start) is None
        scalar = sp.Problem(-x, [sp.Constraint(row.polynomial, sp.Kind.NONNEGATIVE)])
        assert falling_ray(scalar, start) is not None


# ---- points -------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [3, 5])
def test_points_on_the_boundary_are_pulled_inside(size):
    """Rank one: every eigenvalue but one is zero, and the vector lies a little outside."""
    rng = np.random.default_rng(size)
    v = sp.variables(size)
    table = [[1 if i == j else v[0] * 0 + v[max(i, j)] * v[min(i, j)] for j in range(size)]
             for i in range(size)]  # fmt: skip
    problem = sp.Problem(-sp.total(v), [sp.psd(table)], -1, 1)
    start = np.ones(size) + rng.uniform(0, 1e-9, size)
    point = prove_feasible(problem, start)
    assert point is not None
    assert point.value <= -size + 1e-4
    assert holds(problem.constraints[0], [Fraction(p) for p in point.x.tolist()])


def test_a_point_on_an_equation_and_a_cone():
    """Krawczyk's test finds the point on x^2 + y^3 == 1, the cone is checked over its box."""
    problem = sp.Problem(x, [x**2 + y**3 == 1, sp.second_order(2 * y, x, 0.1)])
    point = prove_feasible(problem, np.array([-0.85, (1 - 0.85**2) ** (1 / 3)]))
    assert point is not None
    assert point.proof == "krawczyk"
    assert point.recheck(problem) is not None
    outside = sp.Problem(x, [x**2 + y**3 == 1, sp.second_order(0.5 * y, x, 0.1)])
    assert point.recheck(outside) is None
    assert prove_feasible(outside, point.x) is None


def test_a_point_outside_is_not_proved():
    problem = sp.Problem(x, [sp.psd([[1, x], [x, 1]])])
    assert prove_feasible(problem, np.array([-1.0, 0.0])).value == -1.0  # a singular matrix
    assert prove_feasible(problem, np.array([-1.1, 0.0])) is None


# ---- local searches -----------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_rows_mean_the_same_as_matrices(seed):
    """A start that is feasible becomes one of the rows; rows that hold make matrices that do."""
    problem = random_problem(seed)
    form = RowForm.of(problem)
    assert not any(c.entries for c in form.problem.constraints)
    rng = np.random.default_rng(seed)
    for point in rng.uniform(-1, 1, (4, 2)):
        start = form.start(point)
        assert np.array_equal(form.point(start), point)
        off = form.problem.violation(start)
        if problem.violation(point) == 0:
            assert off <= 1e-9
        elif problem.violation(point) > 1e-3:
            assert off > 1e-9


@pytest.mark.parametrize("side", [2, 3, 4, 11])
def test_local_search_among_matrices(side):
    """All off-diagonal entries equal x: the least x is -1 / (side - 1)."""
    table = [[1 if i == j else x for j in range(side)] for i in range(side)]
    problem = sp.Problem(x, [sp.psd(table)], -1, 1)
    form = RowForm.of(problem)
    found = form.point(local_search(form.problem, form.start(np.array([0.3, 0.0]))))
    if side <= 10:  # larger ones enter by their diagonal
        assert found[0] == pytest.approx(-1 / (side - 1), abs=1e-6)
    check(problem, solve(problem), -1 / (side - 1), 1e-5)


# ---- boxes --------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_propagation_keeps_every_feasible_point(seed):
    problem = random_problem(seed)
    box, _ = propagate(box_rows(problem, None), Interval(problem.lower, problem.upper))
    points, _ = feasible_grid(problem, 4)
    assert np.all((points >= box.lo) & (points <= box.hi))


def test_minors_and_axes_bound_their_entries():
    unbounded = Interval(np.full(2, -INF), np.full(2, INF))

    def box(*rows):
        return propagate(box_rows(sp.Problem(x, rows), None), unbounded)[0]

    found = box(sp.psd([[4, x], [x, 9]]), sp.second_order(3, y, 1))
    assert np.all(found.lo <= [-6, -3]) and np.all(found.hi >= [6, 3])
    assert found.lo == pytest.approx([-6, -3], rel=1e-12)
    assert found.hi == pytest.approx([6, 3], rel=1e-12)
    assert is_empty(box(sp.psd([[4, x], [x, 9]]), x >= 6.1))
    assert is_empty(box(sp.psd([[0, 1], [1, x]])))
    assert is_empty(box(sp.second_order(1, 2, x)))
    zero = box(sp.psd([[0, x], [x, y]]))
    assert abs(zero.lo[0]) + abs(zero.hi[0]) <= 1e-150


# ---- the MATLAB face ----------------------------------------------------------------------------


def test_scripts_of_sparsepop():
    """The two problems of the user's guide, as structs."""
    line = {"typeCone": 1, "sizeCone": 1, "dimVar": 2, "degree": 1, "noTerms": 2,
            "supports": np.eye(2), "coef": np.ones((2, 1))}  # fmt: skip
    cone = {"typeCone": 2, "sizeCone": 3, "dimVar": 2, "degree": 1, "noTerms": 3,
            "supports": np.array([[0, 0], [1, 0], [0, 1]]),
            "coef": np.diag([2.0, 1.0, 1.0])}  # fmt: skip
    out = sp.sparsePOP(line, [cone], [-1e10, -1e10], [1e10, 1e10], {"printLevel": 0})
    assert -2.8284271 - 1e-6 <= out.POP.objValue
    assert out.POP.lowerBound == pytest.approx(-2.8284271, abs=1e-6)
    assert out.POP.absError >= -1e-8
