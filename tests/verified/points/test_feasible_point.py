"""Attained points: every proved point is proved once more here, by rationals or by mpmath."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from exact_polynomials import value_at

import sparsepop_py as sp
from sparsepop_py.local_search.feasibility import _pivots, prove_feasible
from sparsepop_py.verified.arithmetic.krawczyk import zero_near
from sparsepop_py.verified.points.feasible_point import prove_point, valued

# ---- independent checks -----------------------------------------------------------------------


def gauss(matrix, right):
    """Solve a square rational system; None if it is singular."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    n = len(rows)
    for k in range(n):
        pivot = next((r for r in range(k, n) if rows[r][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for r in range(n):
            if r != k and rows[r][k]:
                rows[r] = [a - rows[r][k] * b for a, b in zip(rows[r], rows[k], strict=True)]
    return [row[-1] for row in rows]


def exact_point(problem, proved):
    """The rational point that an exact proof speaks of: the solved variables by elimination."""
    point = [Fraction(v) for v in proved.x.tolist()]
    rows, solved = proved.rows.tolist(), proved.solved.tolist()
    if rows:
        polynomials = [problem.constraints[r].polynomial for r in rows]

        def at(values):
            trial = list(point)
            for v, value in zip(solved, values, strict=True):
                trial[v] = value
            return [value_at(p, trial, Fraction) for p in polynomials]

        zero = [Fraction(0)] * len(solved)
        base = at(zero)
        columns = []
        for k in range(len(solved)):
            unit = list(zero)
            unit[k] = Fraction(1)
            columns.append([a - b for a, b in zip(at(unit), base, strict=True)])
        matrix = [list(row) for row in zip(*columns, strict=True)]
        for v, value in zip(solved, gauss(matrix, [-b for b in base]), strict=True):
            point[v] = value
    return point


def check_exact(problem, proved):
    point = exact_point(problem, proved)
    for value, low, high in zip(point, problem.lower, problem.upper, strict=True):
        assert low == -np.inf or value >= Fraction(float(low))
        assert high == np.inf or value <= Fraction(float(high))
    for constraint in problem.constraints:
        value = value_at(constraint.polynomial, point, Fraction)
        assert value == 0 if constraint.kind is sp.Kind.ZERO else value >= 0
    for value, near in zip(point, proved.x.tolist(), strict=True):
        assert abs(value - Fraction(near)) <= Fraction(proved.radius)
    assert value_at(problem.objective, point, Fraction) <= Fraction(proved.value)


def check_krawczyk(problem, proved):
    """Newton's method in 60 digits finds the zero within the radius, and it is feasible."""
    with mpmath.workdps(60):
        x = [mpmath.mpf(v) for v in proved.x.tolist()]
        rows, solved = proved.rows.tolist(), proved.solved.tolist()
        polynomials = [problem.constraints[r].polynomial for r in rows]
        for _ in range(12):
            values = mpmath.matrix([value_at(p, x, mpmath.mpf) for p in polynomials])
            slopes = mpmath.matrix(len(rows), len(solved))
            for i, p in enumerate(polynomials):
                for j, v in enumerate(solved):
                    slopes[i, j] = value_at(p.derivative(v), x, mpmath.mpf)
            step = mpmath.lu_solve(slopes, values)
            for j, v in enumerate(solved):
                x[v] -= step[j]
        tiny = mpmath.mpf(10) ** -45
        for value, near in zip(x, proved.x.tolist(), strict=True):
            assert abs(value - near) <= proved.radius
        for value, low, high in zip(x, problem.lower, problem.upper, strict=True):
            assert low - tiny <= value <= high + tiny
        for constraint in problem.constraints:
            value = value_at(constraint.polynomial, x, mpmath.mpf)
            assert abs(value) <= tiny if constraint.kind is sp.Kind.ZERO else value >= -tiny
        assert value_at(problem.objective, x, mpmath.mpf) <= mpmath.mpf(proved.value) + tiny


def check(problem, proved):
    (check_exact if proved.proof == "exact" else check_krawczyk)(problem, proved)
    again = proved.recheck(problem)
    assert again is not None
    assert again.value <= proved.value + 1e-12 * (1 + abs(proved.value))
    return proved


# ---- cases ------------------------------------------------------------------------------------


def test_a_circle_needs_krawczyk():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 == 1])
    proved = check(problem, prove_feasible(problem, np.array([-0.7071, -0.7071])))
    assert proved.proof == "krawczyk"
    assert proved.radius < 1e-12
    assert -np.sqrt(2) - 1e-15 <= proved.value <= -np.sqrt(2) + 1e-8


def test_linear_equalities_with_decimal_coefficients_are_solved_exactly():
    x = sp.variables(4)
    rows = [
        0.1 * x[0] + 0.2 * x[1] == 0.3,
        0.7 * x[1] - 0.1 * x[2] + 0.3 * x[3] == 0.9,
        x[0] + x[3] >= 0.1,
    ]
    problem = sp.Problem(x[0] - 0.1 * x[2], rows, lower=0, upper=10)
    proved = check(problem, prove_feasible(problem, np.array([1.0, 1.0, 0.1, 0.7])))
    assert proved.proof == "exact"
    assert proved.radius < 1e-14


def test_redundant_linear_equalities_are_consistent_exactly():
    x, y, z = sp.variables(3)
    rows = [x + y + z == 1, 2 * x + 2 * y + 2 * z == 2, x - y == 0.25, x + z + y == 1]
    problem = sp.Problem(z, rows, lower=0, upper=1)
    proved = check(problem, prove_feasible(problem, np.array([0.5, 0.25, 0.25])))
    assert proved.proof == "exact"
    assert proved.rows.size == 2


def test_redundant_equalities_that_differ_in_the_last_bit_have_no_point():
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x + y == 0.3, x + y == np.nextafter(0.3, 1.0)], lower=0, upper=1)
    assert prove_feasible(problem, np.array([0.1, 0.2])) is None


@pytest.mark.parametrize(
    ("near", "side"), [([1e-9, 0.7], 0), ([0.7, -1e-9], 1), ([0.0, 0.0], None), ([1e-8, 1e-9], 0)]
)
def test_complementarity(near, side):
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x * y == 0, x + y <= 1], lower=0, upper=1)
    proved = check(problem, prove_feasible(problem, np.array(near)))
    if side is not None:
        assert abs(proved.x[side]) <= 1e-6
    assert proved.value <= sum(near) + 1e-5


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9, 1e-7])
def test_a_degenerate_vertex(noise):
    """Five planes through one vertex of a polytope in three dimensions."""
    x, y, z = sp.variables(3)
    rows = [x + y <= 2, x + z <= 2, y + z <= 2, x + y + z <= 3, x + 2 * y + z <= 4]
    problem = sp.Problem(-x - y - z, rows, lower=0)
    start = np.ones(3) + noise * np.array([1.0, -0.5, 0.7])
    proved = check(problem, prove_feasible(problem, start))
    assert -3.0 <= proved.value <= -3.0 + 1e-5


@pytest.mark.parametrize("bits", range(8))
def test_binary_points_snap(bits):
    x = sp.variables(3)
    corner = np.array([bits >> k & 1 for k in range(3)], float)
    problem = sp.Problem(sp.total(x), [v**2 == v for v in x], lower=0, upper=1)
    noise = 1e-8 * np.array([1.0, -1.0, 0.5])
    proved = check(problem, prove_feasible(problem, corner + noise))
    assert proved.value == pytest.approx(corner.sum(), abs=1e-9)
    assert proved.value >= corner.sum()


def test_signs_from_a_quadratic_equality():
    x, y = sp.variables(2)
    problem = sp.Problem(x * y, [x**2 == 1, y**2 == 1])
    proved = check(problem, prove_feasible(problem, np.array([1 + 1e-9, -1 - 1e-8])))
    assert -1.0 <= proved.value <= -1.0 + 1e-9


def test_a_curved_inequality_is_entered():
    """The nearest doubles of the disc's lowest point lie outside or inside; never outside here."""
    x, y = sp.variables(2)
    problem = sp.Problem(x + 0.3 * y, [x**2 + y**2 <= 1])
    best = -np.hypot(1, 0.3)
    for scale in (1.0, 1.0 + 1e-12, 1.0 + 1e-9, 1.0 + 1e-8):
        start = scale * np.array([1.0, 0.3]) / best
        proved = check(problem, prove_feasible(problem, start))
        assert best - 1e-15 <= proved.value <= best + 1e-5


def test_equality_and_active_inequality_together():
    x, y, z = sp.variables(3)
    problem = sp.Problem(
        z, [x**2 + y**2 + z**2 == 1, x * y >= 0.25, x + y + z >= 0.1], lower=-1, upper=1
    )
    start = np.array([0.5, 0.5, -np.sqrt(0.5)])
    proved = check(problem, prove_feasible(problem, start))
    assert proved.proof == "krawczyk"
    assert proved.value <= -np.sqrt(0.5) + 1e-4


@pytest.mark.parametrize(
    "start",
    [[0.5, 0.5], [2.0, 2.0], [np.nan, 0.0], [np.inf, 0.0]],
)
def test_what_is_beyond_repair_is_not_proved(start):
    x, y = sp.variables(2)
    circle = sp.Problem(x, [x**2 + y**2 == 1, x + y >= 1.4])
    assert prove_feasible(circle, np.array(start)) is None


def test_an_empty_set_has_no_point():
    x, y = sp.variables(2)
    rng = np.random.default_rng(0)
    for rows in (
        [x**2 + y**2 <= -1e-14],
        [x**2 + y**2 <= 1, x * y >= 0.5 + 1e-14],
        [x**2 + y**2 == 0, x >= 1e-160],
        [x + y == 1, x + y == 1 + 2**-52],
        [x**2 == 2, x**2 == 2 + 2**-51],
    ):
        problem = sp.Problem(x, rows)
        for start in [np.zeros(2), np.full(2, np.sqrt(0.5)), np.array([np.sqrt(2), 0.0])]:
            assert prove_feasible(problem, start) is None
            assert prove_feasible(problem, start + 1e-9 * rng.normal(size=2)) is None


@pytest.mark.parametrize("seed", range(30))
def test_random_points_are_repaired_and_hold(seed):
    """A planted point, disturbed; whatever is proved survives the independent check."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    x = sp.variables(n)
    planted = rng.normal(size=n)
    rows = []
    for k in range(int(rng.integers(0, n))):
        terms = [float(c) * v for c, v in zip(rng.normal(size=n), x, strict=True)]
        if k % 2:
            terms.append(float(rng.normal()) * x[0] * x[1])
            terms.append(x[k % n] ** 2)
        h = sp.total(terms)
        rows.append(h == h(planted))  # holds at the planted point up to rounding only
    g = sp.total([x[0] ** 2, x[-1] * 0.1])
    rows.append(g <= g(planted) + 1e-3)
    problem = sp.Problem(sp.total(x), rows, lower=-10, upper=10)
    proved = prove_feasible(problem, planted + 1e-8 * rng.normal(size=n))
    assert proved is not None
    check(problem, proved)
    assert np.abs(proved.x - planted).max() <= 1e-2


# ---- rechecking -------------------------------------------------------------------------------


def test_a_proof_does_not_carry_over_to_another_problem():
    x, y = sp.variables(2)
    circle = sp.Problem(x + y, [x**2 + y**2 == 1], lower=-2, upper=2)
    proved = prove_feasible(circle, np.array([-0.7071, -0.7071]))
    for other in (
        sp.Problem(x + y, [x**2 + y**2 == 1.5], lower=-2, upper=2),
        sp.Problem(x + y, [x**2 + y**2 == 1, x * y <= 0.4], lower=-2, upper=2),
        sp.Problem(x + y, [x**2 + y**2 == 1], lower=-0.5, upper=2),
        sp.Problem(x + y, [x**2 + y**2 == -1], lower=-2, upper=2),
    ):
        assert proved.recheck(other) is None
    costlier = proved.recheck(sp.Problem(x + y + 5, circle.constraints, -2, 2))
    assert costlier.value == pytest.approx(proved.value + 5)
    exact = prove_feasible(sp.Problem(x, [x + y == 1], 0, 1), np.array([0.25, 0.75]))
    assert exact.proof == "exact"
    assert exact.recheck(sp.Problem(x, [x + y == 1, x >= 0.3], 0, 1)) is None
    assert exact.recheck(sp.Problem(x, [x + y == 3], 0, 1)) is None


def test_stored_claims_are_not_believed():
    x, y = sp.variables(2)
    problem = sp.Problem(x + y, [x**2 + y**2 == 1])
    proved = prove_feasible(problem, np.array([-0.7071, -0.7071]))
    liar = replace(proved, value=-100.0, radius=0.0)
    again = liar.recheck(problem)
    assert again.value == proved.recheck(problem).value
    assert again.radius > 0
    assert replace(proved, proof="exact").recheck(problem) is None


def test_krawczyk_refuses_singular_zeros_and_no_zeros():
    x, y = sp.variables(2)
    for rows, point in [
        ([x**2 == 0], [0.0, 0.0]),  # a double zero cannot be proved by slopes
        ([x**2 == -1e-30], [0.0, 0.0]),
        ([x**2 + y**2 == 0], [1e-9, 0.0]),
        ([x - 0.3 == 0], [0.4, 0.0]),  # the zero is far away
    ]:
        problem = sp.Problem(x, rows)
        assert zero_near(problem.rows, np.array(point), np.array([0])) is None
    none = np.zeros(0, np.int64)
    problem = sp.Problem(x, [x**2 + y**2 == 1])
    assert prove_point(problem, np.array([1.0, 0.0]), none, none, "krawczyk") is None
    assert prove_point(problem, np.array([1.0, 0.0]), none, none, "exact") is not None
    assert prove_point(problem, np.array([1.0, 1e-9]), none, none, "exact") is None


def test_a_krawczyk_box_holds_the_zero():
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x**2 == 2, y**3 == 5])
    start = np.array([np.sqrt(2), np.cbrt(5)])
    box = zero_near(problem.rows, start, np.array([0, 1]))
    with mpmath.workdps(50):
        for v, root in enumerate((mpmath.sqrt(2), mpmath.cbrt(5))):
            assert box.lo[v] <= root <= box.hi[v]
    assert np.all(box.hi - box.lo <= 1e-11)


def test_bounds_that_touch_the_point_are_kept():
    """The zero sqrt(2) lies a hair outside an upper bound: no point may be claimed."""
    (x,) = sp.variables(1)
    root = float(np.sqrt(2.0))  # the double above sqrt(2)
    assert Fraction(root) ** 2 > 2
    above = sp.Problem(x, [x**2 == 2], lower=0, upper=root)
    below = sp.Problem(x, [x**2 == 2], lower=0, upper=float(np.nextafter(root, 0)))
    assert prove_feasible(below, np.array([root])) is None
    proved = prove_feasible(above, np.array([root]))
    assert proved is None or proved.value >= float(np.nextafter(root, 0))


def sums(count, double=False):
    """x_i + y_i = 1 for many i, perhaps with twice the first one as another row."""
    x = sp.variables(2 * count)
    rows = [x[i] + x[count + i] == 1 for i in range(count)]
    more = [2 * x[0] + 2 * x[count] == 2] * double
    return sp.Problem(x[0], rows + more, lower=0, upper=1)


def test_rows_that_hold_already_need_no_variable_off_its_bounds():
    problem, x = sums(80), np.repeat([0.25, 0.75], 80)
    x[[0, 80]] = 0.0, 1.0
    found = prove_feasible(problem, x)
    assert found is not None and found.rows.size == 79 and found.value == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_pivots_are_those_of_whole_matrices(seed):
    """Full pivoting as books have it, with columns that exclude each other."""
    source = np.random.default_rng(seed)
    matrix = np.where(source.random((7, 11)) < 0.4, source.integers(-9, 10, (7, 11)), 0) / 4.0
    weight = source.integers(0, 4, 11) / 2.0
    pairs = {tuple(sorted(source.integers(0, 11, 2).tolist())) for _ in range(5)}
    for blocked in (None, pairs):
        allowed = np.array([(v, v) not in (blocked or ()) for v in range(11)])
        left, rest = np.ones(7, bool), matrix * weight
        expected = []
        while (size := np.abs(rest) * left[:, None] * allowed).max() > 1e-7:
            row, column = (int(k) for k in np.unravel_index(np.argmax(size), size.shape))
            expected.append((row, column))
            left[row] = allowed[column] = False
            for a, b in blocked or ():
                allowed[b if a == column else a] &= column not in (a, b)
            factor = rest[:, column] * left / rest[row, column]
            rest = rest - np.outer(factor, rest[row])
        rows, columns = _pivots(matrix, weight, blocked)
        assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == expected


def test_many_rows_that_depend_on_each_other_are_recognised():
    problem, x = sums(80, double=True), np.repeat([0.25, 0.75], 80)
    found = prove_feasible(problem, x)
    assert found is not None and found.rows.size == 80 and found.value == 0.25


def test_another_objective_at_a_proved_point_counts_its_radius():
    """On the diagonal of the unit circle x + y is sqrt(2)."""
    x, y = sp.variables(2)
    circle = sp.Problem(x, [x**2 + y**2 == 1, x - y == 0], 0.0, 1.0)
    point = prove_feasible(circle, np.array([0.7, 0.7]))
    other = valued(point, circle.with_objective(x + y))
    root = mpmath.sqrt(mpmath.mpf(2))
    assert root <= mpmath.mpf(other.value) <= root + 4 * point.radius + 1e-15
    assert other.x is point.x and other.proof == point.proof
    wide = replace(point, radius=0.125)
    assert valued(wide, circle.with_objective(x + y)).value >= 2 * (point.x[0] + 0.125) - 1e-15
