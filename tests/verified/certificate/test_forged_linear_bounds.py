"""Forged bounds of linear programs: each claim exceeds an optimum that is known by hand."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint_oracle import LARGEST, SMALLEST
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.certificate.polyhedron import Polyhedron

INF = np.inf
F = Fraction
x, y = sp.variables(2)


def bound(status="OPTIMAL", lower=0.0, upper=INF, multipliers=(), vertex=None, ray=None):
    return LinearBound(status, lower, upper, None, tuple(multipliers), None, vertex, ray)


def point(*values):
    return tuple(F(v) for v in values)


# Rows: x + y >= 1, x - y == 0; then x >= 0, y >= 0, x <= 4, y <= 4. The minimum of x is 1/2.
PROBLEM = sp.Problem(x, [x + y >= 1, x - y == 0], lower=0, upper=4)
GOOD = bound(
    lower=0.5, upper=0.5, multipliers=[(0, F(1, 2)), (1, F(1, 2))], vertex=point("1/2", "1/2")
)


def test_the_optimum_by_hand_is_verified():
    verdict = GOOD.verify(PROBLEM, x)
    assert verdict.ok and verdict.bound == 0.5


@pytest.mark.parametrize(
    "fields",
    [
        {"lower": float(np.nextafter(0.5, 1))},
        {"lower": INF},
        {"lower": np.nan},
        {"upper": float(np.nextafter(0.5, 0))},
        {"upper": -INF},
        {"upper": np.nan},
        {"multipliers": ()},
        {"multipliers": ((0, F(1, 2)),)},
        {"multipliers": ((0, F(1, 2)), (1, F(1, 2)), (2, F(1)))},
        {"multipliers": ((0, F(1, 2)), (1, F(-1, 2)))},
        {"multipliers": ((0, F(1, 2)), (-5, F(1, 2)))},
        {"multipliers": ((0, F(1, 2)), (6, F(1, 2)))},
        {"multipliers": ((2, F(1)),)},  # x >= 0 proves 0 and not 1/2
        {"multipliers": ((4, F(-1)),)},  # x <= 4, turned around: x >= 4
        {"multipliers": ((0, F(-1)), (1, F(2)), (3, F(3)))},
        {"vertex": None},
        {"vertex": point("1/2")},
        {"vertex": point("1/2", "1/2", 0)},
        {"vertex": point("1/4", "1/4")},
        {"vertex": point("1/2", "3/4")},
        {"vertex": point("3/4", "1/4")},
        {"vertex": point(5, 5)},
        {"vertex": point(-1, 2)},
        {"status": "INFEASIBLE", "lower": INF},
        {"status": "INFEASIBLE", "lower": INF, "multipliers": ()},
        {"status": "INFEASIBLE", "lower": INF, "multipliers": ((0, F(1)),)},
        {"status": "UNBOUNDED", "lower": -INF},
        {"status": "UNBOUNDED", "lower": -INF, "ray": point(-1, -1)},
        {"status": "UNBOUNDED", "lower": -INF, "ray": point(0, 0)},
        {"status": "anything"},
    ],
)
def test_claims_that_do_not_follow_are_refused(fields):
    assert not replace(GOOD, **fields).verify(PROBLEM, x).ok


@pytest.mark.parametrize("objective", [x - 0.25, 2.0 * x, y + 0 * x, -1.0 * x, x + y - 1])
def test_a_bound_belongs_to_its_objective(objective):
    assert not replace(GOOD, upper=INF).verify(PROBLEM, objective).ok


FREE = sp.Problem(x, [y >= 1])
FALLS = bound("UNBOUNDED", -INF, -INF, vertex=point(0, 1), ray=point(-1, 0))


def test_an_objective_that_falls_has_no_lower_bound():
    """x is free: a ray proves that, and a number beside it is no bound of anything."""
    assert FALLS.verify(FREE, x).ok
    for lower in (5.0, -1e300, 0.0, INF, np.nan):
        assert not replace(FALLS, lower=lower).verify(FREE, x).ok


@pytest.mark.parametrize(
    "fields",
    [
        {"ray": None},
        {"ray": point(-1)},
        {"ray": point(1, 0)},
        {"ray": point(0, 0)},
        {"ray": point(0, 1)},
        {"ray": point(-1, -1)},
        {"vertex": None},
        {"vertex": point(0, "1/2")},
        {"vertex": point(0)},
    ],
)
def test_rays_fall_and_stay_in_the_set(fields):
    assert not replace(FALLS, **fields).verify(FREE, x).ok


def test_equations_stop_a_ray_on_both_sides():
    level = sp.Problem(x, [x - y == 0])
    for ray in (point(-1, 0), point(-1, "-1/2"), point(-1, -2)):
        assert not bound("UNBOUNDED", -INF, -INF, (), point(0, 0), ray).verify(level, x).ok
    assert bound("UNBOUNDED", -INF, -INF, (), point(0, 0), point(-1, -1)).verify(level, x).ok


EMPTY = sp.Problem(x, [x + y >= 1, -x - y >= -1 + 2.0**-52])
NOTHING = bound("INFEASIBLE", INF, INF, [(0, F(1)), (1, F(1))])


def test_emptiness_needs_a_contradiction():
    """x + y >= 1 and x + y <= 1 - 2^-52; with 1 instead nothing follows."""
    assert NOTHING.verify(EMPTY, x).ok and NOTHING.verify(EMPTY, x).bound == INF
    touching = sp.Problem(x, [x + y >= 1, -x - y >= -1])
    assert not NOTHING.verify(touching, x).ok
    for multipliers in (
        [(0, F(1))],
        [(0, F(1)), (1, F(2))],
        [(0, F(-1)), (1, F(-1))],
        [],
        [(0, F(1)), (1, F(1)), (2, F(1))],  # a bound that is not there
    ):
        assert not replace(NOTHING, multipliers=tuple(multipliers)).verify(EMPTY, x).ok


def test_bounds_that_are_not_there_prove_nothing():
    """Rows 2 to 5 are bounds; those of FREE are infinite."""
    for number in range(1, 5):
        forged = bound(lower=-9.0, multipliers=[(number, F(1))], vertex=point(0, 1))
        assert not forged.verify(FREE, x).ok
        zero = bound("INFEASIBLE", INF, INF, [(number, F(0)), (0, F(-1))])
        assert not zero.verify(FREE, x).ok


@pytest.mark.parametrize("status", ["OPTIMAL", "UNBOUNDED"])
def test_multipliers_of_equations_may_be_negative_and_others_not(status):
    problem = sp.Problem(x, [x == 1, y >= 0], lower=0)
    proved = bound(lower=-1.0, upper=-1.0, multipliers=[(0, F(-1))], vertex=point(1, 0))
    assert proved.verify(problem, -1.0 * x + 0 * y).ok
    wrong = sp.Problem(x, [x >= 1, y >= 0], lower=0)
    assert not replace(proved, status=status).verify(wrong, -1.0 * x + 0 * y).ok


def test_bounds_that_are_no_doubles_are_rounded_down():
    problem = sp.Problem(x, [3 * x >= 1, y == 0])
    good = bound(lower=1 / 3, upper=1.0, multipliers=[(0, F(1, 3))], vertex=point("1/3", 0))
    assert F(1 / 3) < F(1, 3)
    assert good.verify(problem, x).ok
    above = float(np.nextafter(1 / 3, 1))
    assert not replace(good, lower=above).verify(problem, x).ok
    assert replace(good, upper=above).verify(problem, x).ok
    assert not replace(good, upper=1 / 3).verify(problem, x).ok  # the vertex attains more


@pytest.mark.parametrize(
    "row", [sp.psd([[x, y], [y, 1]]), sp.second_order(x, y), x * y >= 1, x * x == 1]
)
def test_matrices_and_products_are_not_linear(row):
    """What follows from a matrix is linear, and says less than the matrix."""
    with pytest.raises(sp.ProblemError, match=r"constraints\[0\]"):
        GOOD.verify(sp.Problem(x, [row]), x)
    with pytest.raises(sp.ProblemError, match=r"objectives\[0\]"):
        GOOD.verify(PROBLEM, x * y)


# ---- signs of rows ----------------------------------------------------------------------------

numbers = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.1, 1e-300, -1e-300, SMALLEST, 1e300, LARGEST, 1e16, 3.0]),
    st.floats(-1e3, 1e3),
)
fractions = st.one_of(
    st.fractions(-9, 9, max_denominator=97),
    st.sampled_from([F(1, 10**320), F(10**320), F(-1, 3), F(0), F(1, 2**60), F(2**70 + 1)]),
)


@given(
    st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=3),
    st.tuples(fractions, fractions),
    st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_signs_are_those_of_rationals(rows, at, direction):
    """Also where a row nearly vanishes: its constant is the rounded opposite of the rest."""
    for a, b, _ in list(rows):
        exact = -(F(a) * at[0] + F(b) * at[1])
        if abs(exact) < F(LARGEST):
            rows.append((a, b, float(exact)))
    matrix = np.array([[a, b] for a, b, _ in rows])
    constant = np.array([c for *_, c in rows])
    count = len(rows)
    polyhedron = Polyhedron(matrix, constant, np.zeros(count, bool))
    total = int(np.lcm.reduce([v.denominator for v in at], dtype=object))
    whole = [v.numerator * (total // v.denominator) for v in at]
    found = polyhedron.signs(whole, 0 if direction else total, total)
    for k in range(count):
        exact = F(matrix[k, 0]) * at[0] + F(matrix[k, 1]) * at[1]
        exact += 0 if direction else F(constant[k])
        assert found[k] == (exact > 0) - (exact < 0)


def test_rows_of_a_problem_are_constraints_and_both_bounds():
    problem = sp.Problem(x, [2 * x - y >= 3, y == 0.5], lower=[-1, -INF], upper=[INF, 7])
    rows = Polyhedron.of(problem)
    assert rows.matrix.tolist() == [[2, -1], [0, 1], [1, 0], [0, 1], [-1, 0], [0, -1]]
    assert rows.constant.tolist() == [-3, -0.5, 1, INF, INF, 7]
    assert rows.equality.tolist() == [False, True, False, False, False, False]
    assert rows.present.tolist() == [True, True, True, False, False, True]
    assert rows.signs([1, 1], 1, 1).tolist() == [-1, 1, 1, 1, 1, 1]
    assert rows.signs([0, 0], 1, 1).tolist() == [-1, -1, 1, 1, 1, 1]
    assert rows.signs([1, 8], 1, 1).tolist()[5] == -1


# ---- what else is stated --------------------------------------------------------------------


NO_POINT = sp.Problem(x, [x - 2 >= 0], lower=0, upper=1)  # x >= 2 and x <= 1
CROSSED = bound("INFEASIBLE", INF, INF, [(0, F(1)), (3, F(1))])
DOWNWARDS = bound("UNBOUNDED", -INF, -INF, vertex=point(0, 0), ray=point(-1, 0))
HALF_PLANE = sp.Problem(x, [y >= 0])


def test_emptiness_and_falling_objectives_are_verified():
    assert CROSSED.verify(NO_POINT, x).ok
    assert DOWNWARDS.verify(HALF_PLANE, x).ok


@pytest.mark.parametrize(
    "fields",
    [
        {"upper": -INF},
        {"upper": 0.5},
        {"upper": np.nan},
        {"lower": np.nan},
        {"x": np.array([0.5, 0.5])},
        {"vertex": point(1, 0)},
        {"ray": point(-1, 0)},
        {"value": F(1)},
    ],
)
def test_where_nothing_is_feasible_nothing_is_attained(fields):
    assert not replace(CROSSED, **fields).verify(NO_POINT, x).ok


@pytest.mark.parametrize("fields", [{"value": F(-7)}, {"x": np.array([1.0, 0.0])}, {"status": "?"}])
def test_unbounded_objectives_have_no_optimum_and_one_point(fields):
    assert not replace(DOWNWARDS, **fields).verify(HALF_PLANE, x).ok


@pytest.mark.parametrize(
    "fields",
    [
        {"value": F(1, 2) + F(1, 10**30)},
        {"value": F(1, 2) - F(1, 10**30)},
        {"x": np.array([0.5, np.nextafter(0.5, 1)])},
        {"x": np.array([0.5])},
        {"x": np.array([np.nan, 0.5])},
    ],
)
def test_the_optimum_and_its_point_are_those_that_are_proved(fields):
    assert replace(GOOD, value=F(1, 2), x=np.array([0.5, 0.5])).verify(PROBLEM, x).ok
    assert not replace(GOOD, **fields).verify(PROBLEM, x).ok
