"""Forged left inverses: a box that loses a feasible point is refused.

Each case has a closed form: p (4 + e) = 1 with |e| <= 1 gives p in [1/5, 1/3] and no less.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.left_inverse import LeftInverse

INF = float("inf")
p, e = sp.variables(2)
LINE = p * (4 + e) == 1


def problem_of(*rows, width=1.0):
    return sp.Problem(p, list(rows), [-INF, -width], [INF, width])


def step_of(rows, inverse, centre, radius, variables=(0,)):
    return LeftInverse(
        np.array(rows),
        np.array(variables),
        np.array(inverse, float),
        np.array(centre, float),
        np.array(radius, float),
    )


def shrunk(problem, step):
    box = step.shrink(problem, Interval(problem.lower, problem.upper))
    return float(box.lo[0]), float(box.hi[0])


EVERYTHING = (-INF, INF)


def test_the_radius_of_the_closed_form_is_enough_and_less_is_not():
    """With M = 1/4 and centre 1/4: G = 1/4, d = 1/16, so that v must exceed 1/12."""
    for radius in (0.01, 0.06, 0.07, 1 / 12):
        assert shrunk(problem_of(LINE), step_of([0], [[0.25]], [0.25], [radius])) == EVERYTHING
    low, high = shrunk(problem_of(LINE), step_of([0], [[0.25]], [0.25], [1 / 12 + 1e-12]))
    assert low <= 1 / 5 and high >= 1 / 3 and high < 0.34


@pytest.mark.parametrize("radius", [-1e-3, -1.0, -1e6, 0.0])
def test_negative_radii_are_no_boxes(radius):
    """With M = -1/2 is G >= 3, so that G v + d < v holds for v = -1: an empty box."""
    assert shrunk(problem_of(LINE), step_of([0], [[-0.5]], [0.25], [radius])) == EVERYTHING


def test_one_positive_radius_is_not_enough():
    """Two parameters, one of them with G = 3 and radius -1."""
    q, r, f = sp.variables(3)
    problem = sp.Problem(q, [q == 1 + f, 4 * r == 1 + f], [-INF, -INF, 0], [INF, INF, 0])
    good = np.diag([1.0, 0.25])
    step = LeftInverse(
        np.array([0, 1]), np.array([0, 1]), good, np.array([1.0, 0.25]), np.full(2, 1e-9)
    )
    box = step.shrink(problem, Interval(problem.lower, problem.upper))
    assert np.all(np.isfinite(box.lo[:2]))
    forged = LeftInverse(
        step.rows, step.variables, np.diag([1.0, -0.5]), step.centre, np.array([1e-9, -1.0])
    )
    box = forged.shrink(problem, Interval(problem.lower, problem.upper))
    assert box.lo.tolist() == [-INF, -INF, 0.0] and box.hi.tolist() == [INF, INF, 0.0]


def test_one_parameter_that_contracts_is_not_enough():
    """The first is known to be 1; nothing is known of the second, which M leaves alone."""
    q, r, f = sp.variables(3)
    problem = sp.Problem(q, [q == 1 + f, f * r == 0], [-INF, -INF, 0], [INF, INF, 0])
    step = LeftInverse(
        np.array([0, 1]), np.array([0, 1]), np.eye(2), np.array([1.0, 5.0]), np.array([1e-9, 0.1])
    )
    box = step.shrink(problem, Interval(problem.lower, problem.upper))
    assert box.lo[1] <= -100.0 and box.hi[1] >= 100.0  # (1, r, 0) is feasible for every r


def test_an_equation_among_the_rows_does_not_make_equations_of_the_others():
    """0 = e - e^2 is one; p (4 + e) >= 1 leaves p unbounded above."""
    problem = problem_of(e - e * e == 0, p * (4 + e) >= 1)
    step = step_of([0, 1], [[0.0, 0.25]], [0.25], [0.2])
    assert shrunk(problem, step)[1] == INF
    equations = problem_of(e - e * e == 0, LINE)
    assert shrunk(equations, step)[1] < 0.5


@pytest.mark.parametrize(
    "row, inverse",
    [
        (p * p * (4 + e) == 1, 1 / 2),  # p = +-1/2 for e = 0
        (p * p + p == 2, 1.0),  # p = 1 or -2
        (p * p * p == p, -1.0),  # p = 0, 1 or -1
    ],
)
def test_powers_of_a_parameter_are_not_linear(row, inverse):
    """Read as linear each would have one solution."""
    for centre in (0.5, 1.0, 0.0):
        for radius in (0.2, 0.5):
            assert shrunk(problem_of(row), step_of([0], [[inverse]], [centre], [radius])) == (
                EVERYTHING
            )


@pytest.mark.parametrize("third", [0, 1, 2])
def test_products_of_two_parameters_are_not_linear(third):
    """q r = 1 and q - r = 0 have the solutions (1, 1) and (-1, -1)."""
    q, r, f = sp.variables(3)
    rows = [q * r == 1 + f, q - r == 0]
    problem = sp.Problem(q, rows, [-INF, -INF, 0], [INF, INF, 0])
    chosen = np.array([[0, 1], [1, 0], [0, 1]][third])
    for inverse in (np.eye(2), np.array([[1.0, 0.0], [1.0, -1.0]]), np.array([[0.0, 1.0], [1, 1]])):
        for sign in (1.0, -1.0):
            for radius in (0.5, 1e-3, 1.9):
                step = LeftInverse(
                    np.array([0, 1]), chosen, inverse, np.full(2, sign), np.full(2, radius)
                )
                box = step.shrink(problem, Interval(problem.lower, problem.upper))
                for point in (1.0, -1.0):
                    assert box.lo[0] <= point <= box.hi[0] and box.lo[1] <= point <= box.hi[1]


def test_rows_without_a_finite_range_say_nothing():
    """p + p g = 1 with g unbounded: p = 1 / (1 + g)."""
    q, g = sp.variables(2)
    for row in (q + q * g == 1, q + g == 1):
        problem = sp.Problem(q, [row], [-INF, -INF], [INF, INF])
        for centre in (1.0, 0.0):
            box = step_of([0], [[1.0]], [centre], [0.5]).shrink(
                problem, Interval(problem.lower, problem.upper)
            )
            assert box.lo.tolist() == [-INF, -INF] and box.hi.tolist() == [INF, INF]


@pytest.mark.parametrize("field", ["inverse", "centre", "radius"])
@pytest.mark.parametrize("kind", [np.longdouble, object, complex])
def test_numbers_that_are_rounded_when_read_are_refused(field, kind):
    good = step_of([0], [[0.25]], [0.25], [0.1])
    assert shrunk(problem_of(LINE), good) != EVERYTHING
    fields = {name: getattr(good, name) for name in ("inverse", "centre", "radius")}
    fields[field] = fields[field].astype(kind)
    forged = LeftInverse(good.rows, good.variables, **fields)
    assert shrunk(problem_of(LINE), forged) == EVERYTHING


def test_malformed_steps_change_nothing_and_raise_nothing():
    problem, good = problem_of(LINE), step_of([0], [[0.25]], [0.25], [0.1])
    for fields in (
        {"rows": np.array([1])},
        {"rows": np.array([-1])},
        {"rows": np.array([[0]])},
        {"rows": np.array(0)},
        {"rows": np.array([0], np.int8)},
        {"variables": np.array([2])},
        {"variables": np.array([-2])},
        {"variables": np.array([[0]])},
        {"inverse": np.array([0.25])},
        {"inverse": np.array([[0.25, 0.25]])},
        {"centre": np.array(0.25)},
        {"radius": np.array([0.1, 0.1])},
        {"radius": np.array([np.inf])},
        {"centre": np.array([np.nan])},
    ):
        given = {
            name: getattr(good, name)
            for name in ("rows", "variables", "inverse", "centre", "radius")
        }
        forged = LeftInverse(**{**given, **fields})
        assert shrunk(problem, forged) == EVERYTHING, fields


def test_the_box_reaches_the_radius_on_both_sides_exactly():
    """|p - centre| <= radius is what is proved: the doubles of the box are not nearer."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        centre, radius = 0.25 + rng.uniform(-1e-3, 1e-3), 0.1 + rng.uniform(0, 1e-3)
        low, high = shrunk(problem_of(LINE), step_of([0], [[0.25]], [centre], [radius]))
        assert Fraction(low) <= Fraction(centre) - Fraction(radius)
        assert Fraction(high) >= Fraction(centre) + Fraction(radius)
