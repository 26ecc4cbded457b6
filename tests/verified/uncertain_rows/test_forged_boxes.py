"""Forged boxes of parameters from uncertain rows: each would lose a consistent parameter.

Closed forms: one row (r +- W) m = -Y +- w, whose solutions are an interval by hand.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.uncertain_rows import UncertainRows
from sparsepop_py.verified.certificate.linear_bound import LinearBound
from sparsepop_py.verified.uncertain_rows.sign_tree import (
    LeftInverse,
    ParameterBox,
    SignTree,
    linear_rows,
)

INF = np.inf
F = Fraction
ANY = np.array([[-INF], [INF]])


def test_numbers_beside_an_unbounded_program_are_no_bounds():
    """0 m = 0 within 1 says nothing of m, whatever is written beside the ray."""
    rows = UncertainRows(("m",), [0.0], [[0.0]], [1.0], [[0.0]])
    for low, high in ((5.0, 5.0), (-1.0, 1.0), (-INF, 3.0), (2.0, INF)):
        bounds = tuple(
            LinearBound("UNBOUNDED", lower, -INF, None, (), None, (F(0),), (F(-side),))
            for lower, side in ((low, 1), (-high, -1))
        )
        tree = SignTree(-1, (), bounds)
        box = ParameterBox(("m",), np.array([low]), np.array([high]), ANY, (tree,))
        assert not box.verify(rows, ANY)


# ---- left inverses ----------------------------------------------------------------------------


def one_row(target, slope, radius=0.0, radii=0.0):
    return UncertainRows(("m",), [target], [[slope]], [radius], [[radii]])


def inverse(value, centre, radius):
    return LeftInverse(np.array([[value]]), np.array([centre]), np.array([radius]))


def test_the_radius_of_the_closed_form_is_enough_and_less_is_not():
    """|2 m - 4| <= 1/2 + |m| / 4: m in [14/9, 18/7]; with M = 1/2 is d = 1/2, G = 1/8, v > 4/7."""
    rows = one_row(-4.0, 2.0, 0.5, 0.25)
    assert inverse(0.5, 2.0, 4 / 7 + 1e-9).holds(rows)
    for radius in (4 / 7 - 1e-9, 0.5, 0.1, 1e-300, 0.0, -1.0, -1e9, np.nan):
        assert not inverse(0.5, 2.0, radius).holds(rows)
    low, high = inverse(0.5, 2.0, 4 / 7 + 1e-9).box()
    assert low[0] < F(14, 9) and high[0] > F(18, 7)


@pytest.mark.parametrize("value", [0.0, -0.5, -1.0, 2.0, np.inf, np.nan])
def test_other_inverses_prove_nothing(value):
    rows = one_row(-4.0, 2.0)
    for radius in (1e-9, 1.0, 1e9, -1.0, -1e9):
        with np.errstate(all="ignore"):
            assert not inverse(value, 2.0, radius).holds(rows)


def test_arrays_of_other_shapes_prove_nothing():
    rows = UncertainRows(("x", "y"), [-1.0, -2.0], np.eye(2), [0.0, 0.0], np.zeros((2, 2)))
    good = LeftInverse(np.eye(2), np.array([1.0, 2.0]), np.full(2, 1e-9))
    assert good.holds(rows)
    for fields in (
        {"centre": np.array([[1.0], [2.0]])},
        {"centre": np.array([1.0])},
        {"centre": np.array(1.0)},
        {"radius": np.full((2, 1), 1e-9)},
        {"radius": np.array(1e-9)},
        {"radius": np.full(3, 1e-9)},
        {"inverse": np.eye(3)},
        {"inverse": np.ones(2)},
    ):
        assert not replace(good, **fields).holds(rows)


def test_each_parameter_needs_its_radius():
    """x = 1, and y is in no row."""
    rows = UncertainRows(("x", "y"), [-1.0], [[1.0, 0.0]], [0.0], [[0.0, 0.0]])
    for radius in ([1e-9, 1.0], [1e-9, -1.0], [1e-9, 1e9]):
        step = LeftInverse(np.array([[1.0], [0.0]]), np.array([1.0, 0.0]), np.array(radius))
        assert not step.holds(rows)


@pytest.mark.parametrize("slope, value", [(1e-200, 1e200), (1e-160, 1e160), (1e-300, 1e300)])
@pytest.mark.parametrize("radius", [1e-250, 1e-220, 1e-310])
def test_products_that_underflow_are_no_zeros(slope, value, radius):
    """slope m = 0 has the solution 0 alone; around 1e-200 the products are 0 in doubles."""
    rows = one_row(0.0, slope)
    assert not inverse(value, 1e-200, radius).holds(rows)
    wide = one_row(0.0, slope, 0.0, slope * 2.0**-20)
    assert not inverse(value, 1e-200, radius).holds(wide)


@pytest.mark.parametrize("exponent", [0, -1000, -1060, 900])
def test_left_inverses_keep_every_solution(exponent):
    """Two parameters, three rows, rationals: what holds contains the planted parameters."""
    rng = np.random.default_rng(abs(exponent))
    kept = 0
    for _ in range(200):
        slope = rng.uniform(-1, 1, (3, 2))
        truth = np.ldexp(rng.uniform(-1, 1, 2), exponent)
        radii = 0.05 * rng.uniform(0, 1, (3, 2))
        target = -slope @ truth
        rows = UncertainRows(("a", "b"), target, slope, np.zeros(3), radii)
        exact = [
            abs(F(y) + sum(F(c) * F(v) for c, v in zip(line, truth, strict=True)))
            <= sum(F(w) * abs(F(v)) for w, v in zip(wide, truth, strict=True))
            for y, line, wide in zip(target, slope, radii, strict=True)
        ]
        if not all(exact):
            continue
        found = np.linalg.pinv(slope)
        centre = truth * rng.uniform(0.5, 1.5, 2)
        for size in (1e-3, 0.1, 0.5, 2.0):
            step = LeftInverse(found, centre, size * np.abs(truth) + 5e-324)
            if step.holds(rows):
                kept += 1
                low, high = step.box()
                assert np.all(low <= truth) and np.all(truth <= high)
    assert kept or exponent < -1000


# ---- linear rows ------------------------------------------------------------------------------


def holds(rows, k, theta):
    """|Y + R theta| <= w + W |theta| in rationals."""
    left = F(rows.target[k]) + sum(
        F(c) * F(v) for c, v in zip(rows.regressors[k], theta, strict=True)
    )
    right = F(rows.radius[k]) + sum(
        F(c) * abs(F(v)) for c, v in zip(rows.radii[k], theta, strict=True)
    )
    return abs(left) <= right


def value(polynomial, theta):
    total = F(polynomial.constant_term)
    for word, c in zip(polynomial.words.tolist(), polynomial.coefficients, strict=True):
        if word[-1]:
            total += F(c) * F(theta[word[-1] - 1])
    return total


def number(rng, low=-1070, high=200):
    return float(np.ldexp(rng.uniform(0.5, 1), int(rng.integers(low, high))))


@pytest.mark.parametrize("kind", ["ordinary", "any size", "subnormal bounds"])
@pytest.mark.parametrize("seed", slow_after(2, range(4)))
def test_linear_rows_hold_wherever_the_rows_do(kind, seed):
    """At the ends of the box and inside, with the constant that makes the row hold exactly."""
    rng = np.random.default_rng(seed)
    sizes = {"ordinary": (-3, 3), "any size": (-1070, 200), "subnormal bounds": (-1074, -1066)}
    checked = 0
    for _ in range(150):
        low = np.array([-number(rng, *sizes[kind]) for _ in range(2)])
        high = np.array([number(rng, *sizes[kind]) for _ in range(2)])
        one_sided = rng.integers(0, 4, 2)
        low, high = np.where(one_sided == 0, 0.0, low), np.where(one_sided == 1, 0.0, high)
        reach = sizes["any size"] if kind == "any size" else (-2, 3)
        if kind == "subnormal bounds":
            reach = (900, 1000)
        slope = np.array([[number(rng, *reach) * rng.choice([-1, 0, 1]) for _ in range(2)]])
        radii = np.array([[number(rng, *reach) * rng.choice([0, 1, 1]) for _ in range(2)]])
        for share in ((0, 0), (1, 1), (0, 1), (0.25, 0.5)):
            theta = low + np.array(share) * (high - low)
            for side in (1, -1):  # the nearest constant for which the row holds
                left = sum(F(c) * F(v) for c, v in zip(slope[0], theta, strict=True))
                right = sum(F(c) * abs(F(v)) for c, v in zip(radii[0], theta, strict=True))
                if not abs(left) + right < F(2) ** 1000:
                    continue
                target = float(side * right - left)
                for _ in range(2):
                    rows = UncertainRows(("a", "b"), [target], slope, [0.0], radii)
                    if not holds(rows, 0, theta):
                        target = float(np.nextafter(target, -np.sign(side) * INF))
                if not holds(rows, 0, theta):
                    continue
                checked += 1
                problem = linear_rows(rows, (low, high))
                for row in problem.constraints:
                    assert value(row.polynomial, theta) >= 0
    assert checked > 100


def test_linear_rows_are_polynomials_as_others():
    """Terms that vanish are left out, and numbers beyond the doubles are refused."""
    regressors = np.array([[0.0, 2.0], [0.0, 0.0], [3.0, 4.0]])
    rows = UncertainRows(("a", "b"), [0.0, -1.0, 0.0], regressors, [0, 0.5, 0.25], 0 * regressors)
    made = linear_rows(rows, (np.full(2, -1.0), np.full(2, 1.0)))
    for row in made.constraints:
        p = row.polynomial
        again = sp.Polynomial.from_words(p.words, p.coefficients, 2)
        assert np.array_equal(again.words, p.words)
        assert np.array_equal(again.coefficients, p.coefficients)
        assert not p.words.flags.writeable and not p.coefficients.flags.writeable
    huge = UncertainRows(("a",), [1.7e308], [[1.0]], [1.7e308], [[0.0]])
    error = pytest.raises(sp.ProblemError, match="beyond the largest double")
    with np.errstate(over="ignore"), error:
        linear_rows(huge, (np.full(1, -1.0), np.full(1, 1.0)))


def test_signs_that_are_known_leave_an_equality():
    """|2 m - 4| <= 1/2 + |m| / 4: for m >= 0 exactly [14/9, 18/7], across zero no less."""
    rows = one_row(-4.0, 2.0, 0.5, 0.25)
    for low, high in ((0.0, INF), (0.0, 9.0), (-1.0, 9.0), (-9.0, 9.0), (-INF, INF)):
        problem = linear_rows(rows, (np.array([low]), np.array([high])))
        for theta in (F(14, 9), F(2), F(18, 7)):
            for row in problem.constraints:
                assert value(row.polynomial, [theta]) >= 0
        if low == 0.0:
            for theta in (F(14, 9) - F(1, 10**9), F(18, 7) + F(1, 10**9)):
                assert any(value(row.polynomial, [theta]) < 0 for row in problem.constraints)


def test_rows_of_negative_parameters():
    """|m + 1| <= |m| / 2 for m <= 0: m in [-2, -2/3]."""
    rows = one_row(1.0, 1.0, 0.0, 0.5)
    for low, high in ((-INF, 0.0), (-9.0, 0.0), (-9.0, 9.0)):
        problem = linear_rows(rows, (np.array([low]), np.array([high])))
        for theta in (F(-2), F(-1), F(-2, 3)):
            assert all(value(row.polynomial, [theta]) >= 0 for row in problem.constraints)
        if high == 0.0:
            for theta in (F(-2) - F(1, 10**9), F(-2, 3) + F(1, 10**9)):
                assert any(value(row.polynomial, [theta]) < 0 for row in problem.constraints)


# ---- trees ------------------------------------------------------------------------------------


def box_of(names, lower, upper, start, *steps):
    return ParameterBox(names, np.array(lower, float), np.array(upper, float), start, steps)


def linear(rows, low, high):
    """Exact bounds at a leaf, found by the engine's linear programs."""
    problem = linear_rows(rows, (np.array(low, float), np.array(high, float)))
    x = sp.variables(len(rows.names))
    return tuple(sp.linear_bounds(problem, [side * v for v in x for side in (1.0, -1.0)]))


BALANCE = one_row(-4.0, 2.0, 0.5, 0.25)  # [14/9, 18/7]
INSIDE = ([14 / 9 - 1e-9], [18 / 7 + 1e-9])


def test_both_signs_are_visited():
    """m^2-like: |m| in [1, 2] by two rows has solutions on either side of zero."""
    rows = UncertainRows(("m",), [0.0, 1.0], [[0.0], [0.0]], [2.0, 0.0], [[0.0], [1.0]])
    left, right = linear(rows, [-2.0], [0.0]), linear(rows, [0.0], [2.0])
    leaf = (SignTree(-1, (), left), SignTree(-1, (), right))
    start = np.array([[-2.0], [2.0]])
    whole = SignTree(0, leaf, ())
    assert box_of(("m",), [-2], [2], start, whole).verify(rows, start)
    for children in ((leaf[0],), (leaf[1],), (leaf[0], leaf[0]), (leaf[1], leaf[1]), ()):
        for ends in (([-2], [-1]), ([1], [2]), ([-1], [1])):
            tree = SignTree(0, children, ())
            assert not box_of(("m",), *ends, start, tree).verify(rows, start)
    for ends in (([-2], [1]), ([-1], [2]), ([-1], [1]), ([1], [2]), ([-2], [-1])):
        assert not box_of(("m",), *ends, start, whole).verify(rows, start)


def test_leaves_prove_their_own_bounds():
    start = np.array([[0.0], [9.0]])
    bounds = linear(BALANCE, [0.0], [9.0])
    good = SignTree(-1, (), bounds)
    assert box_of(("m",), *INSIDE, start, good).verify(BALANCE, start)
    for wrong in (
        (bounds[1], bounds[0]),
        (bounds[0], bounds[0]),
        (replace(bounds[0], lower=2.0), bounds[1]),
        (bounds[0], replace(bounds[1], lower=-2.0)),
        (),
        (bounds[0],),
        (*bounds, bounds[0]),
    ):
        tree = SignTree(-1, (), tuple(wrong))
        assert not box_of(("m",), [2.0], [2.0], start, tree).verify(BALANCE, start)
        assert not box_of(("m",), INSIDE[0], [1.6], start, tree).verify(BALANCE, start)
        assert not box_of(("m",), [2.0], INSIDE[1], start, tree).verify(BALANCE, start)
    assert not box_of(("m",), [2.0], [2.0], start, good).verify(BALANCE, start)
    assert not box_of(("m",), *INSIDE, start).verify(BALANCE, start)
    other = one_row(-3.0, 2.0, 0.5, 0.25)
    assert not box_of(("m",), *INSIDE, start, good).verify(other, start)


def test_a_leaf_is_empty_only_by_a_contradiction():
    """m >= 5 contradicts the row; m >= 2 does not."""
    far = np.array([[5.0], [9.0]])
    bounds = linear(BALANCE, *far)
    assert bounds[0].status == "INFEASIBLE"
    empty = SignTree(-1, (), bounds[:1])
    assert box_of(("m",), [INF], [-INF], far, empty).verify(BALANCE, far)
    near = np.array([[0.0], [9.0]])
    assert not box_of(("m",), [INF], [-INF], near, empty).verify(BALANCE, near)
    split = SignTree(0, (empty, SignTree(-1, (), linear(BALANCE, [0.0], [9.0]))), ())
    assert not box_of(("m",), *INSIDE, ANY, split).verify(BALANCE, ANY)


@pytest.mark.parametrize("split", [1, 7])
def test_splits_of_no_parameter_are_refused(split):
    leaf = SignTree(-1, (), linear(BALANCE, [0.0], [9.0]))
    start = np.array([[0.0], [9.0]])
    tree = SignTree(split, (leaf, leaf), ())
    assert not box_of(("m",), *INSIDE, start, tree).verify(BALANCE, start)


def test_a_left_inverse_that_fails_ends_the_proof():
    bad = inverse(0.5, 2.0, 1e-9)
    good = inverse(0.5, 2.0, 0.6)
    assert box_of(("m",), [1.39], [2.61], ANY, good).verify(BALANCE, ANY)
    assert not box_of(("m",), [1.9], [2.1], ANY, bad).verify(BALANCE, ANY)
    assert not box_of(("m",), [1.39], [2.61], ANY, good, bad).verify(BALANCE, ANY)
    assert not box_of(("m",), [1.41], [2.61], ANY, good).verify(BALANCE, ANY)
    assert not box_of(("m",), [1.39], [2.59], ANY, good).verify(BALANCE, ANY)


def test_half_of_a_box_that_holds_no_point_needs_no_proof():
    """m = 2 lies above zero: the half below is empty, whatever is written there."""
    rows, start = one_row(-2.0, 1.0), np.array([[1.0], [3.0]])
    none, kept = (
        SignTree(-1, (), (LinearBound("INFEASIBLE", INF, INF, None, ()),)),
        SignTree(-1, (), ()),
    )
    tree = SignTree(0, (none, kept), ())
    assert ParameterBox(("m",), start[0], start[1], start, (tree,)).verify(rows, start)
    swapped = SignTree(0, (kept, none), ())
    assert not ParameterBox(("m",), start[0], start[1], start, (swapped,)).verify(rows, start)
