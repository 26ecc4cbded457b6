"""Interval propagation: no feasible point is ever lost, and closed forms are reached."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Kind, Problem
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import Rows, is_empty, propagate, sweep

INF = np.inf


def rows_of(constraints, n):
    system = PolynomialSystem.stack([c.polynomial for c in constraints], n)
    high = np.array([0.0 if c.kind is Kind.ZERO else INF for c in constraints])
    return Rows(system, Interval(np.zeros(len(constraints)), high))


def tightened(constraints, lower, upper):
    n = constraints[0].polynomial.dimension
    box = Interval(np.broadcast_to(lower, n).astype(float), np.broadcast_to(upper, n).astype(float))
    return propagate(rows_of(constraints, n), box)[0]


def in_box(x, box):
    """Exact membership of a point of Fractions or doubles."""
    return all(
        (low == -INF or Fraction(low) <= Fraction(v))
        and (high == INF or Fraction(v) <= Fraction(high))
        for v, low, high in zip(x, box.lo.tolist(), box.hi.tolist(), strict=True)
    )


def near(box, lower, upper, tolerance=1e-9):
    """The box holds [lower, upper] exactly and is hardly larger."""
    assert np.all(box.lo <= lower)
    assert np.all(box.hi >= upper)
    assert np.allclose(box.lo, lower, rtol=0, atol=tolerance)
    assert np.allclose(box.hi, upper, rtol=0, atol=tolerance)


# ---- nothing is lost ---------------------------------------------------------------------

GRID = np.array(list(product(np.arange(-12, 13) / 4, repeat=2)))
powers = st.tuples(st.integers(0, 3), st.integers(0, 2)).filter(any)
tables = st.dictionaries(powers, st.integers(-4, 4).filter(bool), min_size=1, max_size=4)
ends = st.sampled_from([-INF, -3.0, -1.75, -1.0, 0.0, 0.5, 1.0, 2.25, 3.0, INF])


@st.composite
def planted(draw):
    """Rows that hold at a chosen grid point, and a box around it."""
    point = GRID[draw(st.integers(0, len(GRID) - 1))]
    rows, relations = [], []
    for table in draw(st.lists(tables, min_size=1, max_size=3)):
        p = Polynomial.from_terms(np.array(list(table)), list(table.values()))
        equal = draw(st.booleans())
        slack = 0 if equal else draw(st.integers(0, 8)) / 4
        rows.append(p - p(point) + slack)
        relations.append(equal)
    pairs = [draw(st.tuples(ends, ends)) for _ in range(2)]
    lower = np.array(
        [min(-INF if a == INF else a, v) for (a, _), v in zip(pairs, point, strict=True)]
    )
    upper = np.array(
        [max(INF if b == -INF else b, v) for (_, b), v in zip(pairs, point, strict=True)]
    )
    return [r == 0 if e else r >= 0 for r, e in zip(rows, relations, strict=True)], lower, upper


@given(planted())
@settings(max_examples=150, deadline=None)
def test_every_feasible_grid_point_stays(problem):
    """Quarters, small coefficients, degree 5 at most: evaluation in doubles is exact."""
    constraints, lower, upper = problem
    box = tightened(constraints, lower, upper)
    feasible = np.all((lower <= GRID) & (upper >= GRID), axis=1)
    for c in constraints:
        values = c.polynomial(GRID)
        feasible &= values == 0 if c.kind is Kind.ZERO else values >= 0
    assert feasible.any()
    assert np.all(GRID[feasible] >= box.lo)
    assert np.all(GRID[feasible] <= box.hi)
    assert np.all(box.lo >= lower)
    assert np.all(box.hi <= upper)


floats = st.one_of(
    st.floats(-4, 4), st.sampled_from([0.0, 1e-8, -1e-30, 1e8, 0.1, -3.0, 1e-160, 1e100])
)


@given(
    st.lists(
        st.dictionaries(powers, floats.filter(bool), min_size=1, max_size=4), min_size=1, max_size=3
    ),
    st.tuples(floats, floats),
    st.tuples(st.floats(0, 2), st.floats(0, 2)),
    st.integers(0, 8),
)
@settings(max_examples=150, deadline=None)
def test_a_point_at_the_edge_of_every_row_stays(rows, point, width, shape):
    """t_low <= p(x) <= t_high with neighbouring doubles around the exact value at the point."""
    constraints = []
    for table in rows:
        value = sum(
            Fraction(c) * Fraction(point[0]) ** i * Fraction(point[1]) ** j
            for (i, j), c in table.items()
        )
        assume(abs(value) < 10**300)
        around = Interval.of_fraction(value)
        p = Polynomial.from_terms(np.array(list(table)), list(table.values()))
        constraints += [p >= float(around.lo), p <= float(around.hi)]
    first, second = divmod(shape, 3)  # the point lies left, in the middle or right
    low = [x - w if s else x for x, w, s in zip(point, width, (first, second), strict=True)]
    high = [x + w if s < 2 else x for x, w, s in zip(point, width, (first, second), strict=True)]
    with np.errstate(over="ignore"):
        box = tightened(constraints, np.array(low), np.array(high))
    assert in_box(point, box)
    assert np.all(box.lo >= low)
    assert np.all(box.hi <= high)


@given(planted())
@settings(max_examples=50, deadline=None)
def test_every_sweep_stays_inside_the_last_box(problem):
    constraints, lower, upper = problem
    rows, box = rows_of(constraints, 2), Interval(lower, upper)
    for _ in range(4):
        tighter = sweep(rows, box)
        assert np.all(tighter.lo >= box.lo)
        assert np.all(tighter.hi <= box.hi)
        box = tighter


def test_the_box_that_is_given_is_not_modified():
    x, _ = sp.variables(2)
    box = Interval(np.array([-5.0, 0.0]), np.array([5.0, 1.0]))
    propagate(rows_of([x**2 <= 4], 2), box)
    assert box.lo.tolist() == [-5.0, 0.0]
    assert box.hi.tolist() == [5.0, 1.0]


# ---- closed forms ------------------------------------------------------------------------


def test_a_square_gives_both_roots():
    x = sp.variables(1)[0]
    near(tightened([x**2 == 4], -INF, INF), [-2.0], [2.0])
    near(tightened([x**2 == 4], -1.0, INF), [2.0], [2.0])
    near(tightened([x**2 == 4], -INF, 1.5), [-2.0], [-2.0])


def test_odd_and_even_roots():
    x = sp.variables(1)[0]
    near(tightened([x**3 == -8], -INF, INF), [-2.0], [-2.0])
    near(tightened([x**5 <= 32, x**3 >= 1], -INF, INF), [1.0], [2.0])
    near(tightened([x**4 >= 16], -1.0, 5.0), [2.0], [5.0])
    near(tightened([x**4 >= 16], -5.0, 5.0), [-5.0], [5.0])
    near(tightened([-2 * x**4 >= -32], -INF, INF), [-2.0], [2.0])


def test_a_circle_gives_its_square():
    x, y = sp.variables(2)
    near(tightened([x**2 + y**2 == 1], -INF, INF), [-1.0, -1.0], [1.0, 1.0])


def test_a_hyperbola_gives_the_reciprocal_range():
    x, y = sp.variables(2)
    box = tightened([x * y == 1], [0.1, -INF], [0.5, INF])
    near(box, [0.1, 1 / 0.5], [0.5, 1 / 0.1])
    negative = tightened([x * y == -1], [0.1, -INF], [0.5, INF])
    near(negative, [0.1, -10.0], [0.5, -2.0])


@pytest.mark.parametrize("level", [1e-6, 0.25, 4.0, 46.7066065447, 1e6])
def test_completing_the_square_bounds_from_nothing(level):
    """x1^2 + x2^2 - 4 x1 - 6 x2 + 13 <= c is the ball of radius sqrt(c) around (2, 3)."""
    x1, x2 = sp.variables(2)
    box = tightened([x1**2 + x2**2 - 4 * x1 - 6 * x2 + 13 <= level], -INF, INF)
    centre, radius = np.array([2.0, 3.0]), np.sqrt(level)
    near(box, centre - radius * (1 - 1e-9), centre + radius * (1 - 1e-9), 1e-8 * (1 + radius))


def test_the_lab_problem_below_a_feasible_value_lies_in_a_finite_box():
    x1, x2 = sp.variables(2)
    f = x1**2 + x2**2 - 4 * x1 - 6 * x2 + 13
    best = np.array([8.8605284, 5.3748171])  # the minimiser; value 52.7066
    box = tightened([f <= 53.0, x1 * x2 - 7 * x2 == 10, x2 + 0.5 * x1 >= 1], -1e10, 1e10)
    assert np.all(box.lo <= best)
    assert np.all(best <= box.hi)
    assert np.all(box.hi - box.lo <= 2 * np.sqrt(53.0) + 1e-6)


def test_the_outside_of_a_parabola_gap():
    x = sp.variables(1)[0]
    near(tightened([(x - 1) ** 2 >= 4], 0.0, 5.0), [3.0], [5.0])
    near(tightened([(x - 1) ** 2 >= 4], -5.0, 2.0), [-5.0], [-1.0])
    near(tightened([(x - 1) ** 2 >= 4], -5.0, 5.0), [-5.0], [5.0])
    near(tightened([3 + 2 * x - x**2 >= 0], -INF, INF), [-1.0], [3.0])


def test_linear_rows():
    x, y = sp.variables(2)
    near(tightened([x + 2 * y <= 4], 0.0, INF), [0.0, 0.0], [4.0, 2.0])
    near(tightened([x - y == 1, x + y <= 3], 0.0, INF), [1.0, 0.0], [3.0, 2.0])


def test_a_chain_is_followed_to_its_end():
    x = sp.variables(6)
    rows = [x[0] <= 1, x[0] >= 0.5] + [x[k + 1] == 2 * x[k] for k in range(5)]
    box = tightened(rows, -INF, INF)
    near(box, 0.5 * 2.0 ** np.arange(6), 2.0 ** np.arange(6))


def test_one_unbounded_atom_is_bounded_by_the_others_and_two_are_not():
    x, y, z = sp.variables(3)
    box = tightened([z == x + y], [0, 0, -INF], [1, 2, INF])
    near(box, [0.0, 0.0, 0.0], [1.0, 2.0, 3.0])
    box = tightened([z == x + y], [0, -INF, -INF], [1, INF, INF])
    assert box.lo.tolist() == [0.0, -INF, -INF]
    assert box.hi.tolist() == [1.0, INF, INF]


def test_products_with_a_factor_around_zero_say_nothing():
    x, y = sp.variables(2)
    box = tightened([x * y == 1], [-1.0, -INF], [1.0, INF])
    assert box.lo.tolist() == [-1.0, -INF]
    assert box.hi.tolist() == [1.0, INF]


# ---- emptiness ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rows",
    [
        lambda x, y: [x**2 + 1 <= 0],
        lambda x, y: [x**2 == -1e-12],
        lambda x, y: [x + y == 3],
        lambda x, y: [x * y >= 1.0 + 1e-9],
        lambda x, y: [x**2 + y**2 <= 1, x + y >= 1.99],
        lambda x, y: [x * 0.0 - 1.0 >= 0],
        lambda x, y: [x * 0.0 + 1e-300 == 0],
        lambda x, y: [x**2 - 4 * x + 5 <= 0],
        lambda x, y: [x >= 0.6, x <= 0.4],
        lambda x, y: [x == 0.25, x * y >= 0.5],
    ],
)
def test_infeasible_rows_over_the_unit_box_are_proved_empty(rows):
    x, y = sp.variables(2)
    assert is_empty(tightened(rows(x, y), 0.0, 1.0))


@pytest.mark.parametrize(
    "rows",
    [
        lambda x, y: [x + y == 2],
        lambda x, y: [x * y >= 1],
        lambda x, y: [x**2 + y**2 <= 0],
        lambda x, y: [x * 0.0 >= 0],
        lambda x, y: [x * 0.0 == 0],
        lambda x, y: [x**2 - 2 * x + 1 <= 0],
        lambda x, y: [3 * x == 1],
    ],
)
def test_rows_with_a_single_solution_are_not_declared_empty(rows):
    x, y = sp.variables(2)
    assert not is_empty(tightened(rows(x, y), 0.0, 1.0))


def test_a_fixed_variable_that_breaks_a_row_is_proved_empty():
    x, y = sp.variables(2)
    assert is_empty(tightened([x * y == 1], [0.0, -INF], [0.0, INF]))
    assert not is_empty(tightened([x * y == 0], [0.0, -INF], [0.0, INF]))


def test_empty_boxes_differ_from_points():
    assert is_empty(Interval(np.array([0.0, 1.0]), np.array([1.0, 0.5])))
    assert not is_empty(Interval(np.array([0.0, 1.0]), np.array([0.0, 1.0])))


def test_propagated_boxes_of_a_problem_hold_its_minimisers():
    """Rosenbrock below 1e-6: all minimisers are (1, ..., 1)."""
    problem = sp.problems.rosenbrock(5)
    assert isinstance(problem, Problem)
    box = tightened([problem.objective <= problem.objective(np.ones(5)) + 1e-6], -10.0, 10.0)
    assert in_box([1.0] * 5, box)
