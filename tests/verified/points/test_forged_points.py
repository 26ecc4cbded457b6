"""Forged points: a proof of a point that is not feasible, or not there, is refused."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.points.feasible_point import ProvedPoint, prove_point

INF = np.inf
x, y = sp.variables(2)
(z,) = sp.variables(1)
NONE = np.zeros(0, np.int64)
ROW = np.zeros(1, np.int64)


def exact(problem, at, rows=NONE, solved=NONE):
    return prove_point(problem, np.array(at, float), rows, solved, "exact")


def krawczyk(problem, at, rows=ROW, solved=ROW):
    return prove_point(problem, np.array(at, float), rows, solved, "krawczyk")


# ---- exact points -----------------------------------------------------------------------------


@pytest.mark.parametrize("solved", [[0, 1], [1, 0], []])
def test_there_are_as_many_rows_as_variables_that_they_are_solved_for(solved):
    """One equation and two variables leave one of them open."""
    problem = sp.Problem(x, [x + y == 1])
    assert exact(problem, [0.5, 0.5], ROW, ROW) is not None
    assert exact(problem, [0.5, 0.5], ROW, np.array(solved, np.int64)) is None


def test_points_beyond_all_doubles_are_none():
    assert exact(sp.Problem(z, [1e-300 * z - 1e300 == 0]), [0.0], ROW, ROW) is None


@pytest.mark.parametrize(
    "rows",
    [
        [x >= 0.5],
        [x == 0.5],
        [x == float(np.nextafter(0.25, 1))],
        [y - x >= 0.5, x >= 0.5],
        [x >= 0.5, y - x >= 0.25],
        [x + y == 1, x >= 0.5],
        [x + y <= 1, x + y >= 1 + 2.0**-52],
        [x * y == 0.25],
        [0 * x - 1 >= 0],
    ],
)
def test_points_that_violate_a_row_are_refused(rows):
    """(1/4, 3/4) violates each of these, now and then by a last digit."""
    assert exact(sp.Problem(x + y, rows), [0.25, 0.75]) is None
    assert exact(sp.Problem(x + y, rows, 0, 1), [0.25, 0.75]) is None


@pytest.mark.parametrize(
    "low, high",
    [
        ([0.5, 0], [1, 1]),
        ([0, 0], [0.125, 1]),
        ([0, 0.875], [1, 1]),
        ([0, 0], [1, 0.5]),
        ([np.nextafter(0.25, 1), 0], [1, 1]),
        ([0, 0], [1, np.nextafter(0.75, 0)]),
        ([-INF, 0], [0.125, INF]),
        ([0.5, -INF], [INF, INF]),
    ],
)
def test_points_outside_the_bounds_are_refused(low, high):
    assert exact(sp.Problem(x + y, (), low, high), [0.25, 0.75]) is None
    solved = sp.Problem(x + y, [x + y == 1], low, high)
    for variable in (0, 1):
        start = [0.25, 0.75]
        start[variable] = 9.0
        assert exact(solved, start, ROW, np.array([variable])) is None


def test_points_of_matrices_are_checked():
    psd = sp.Problem(x, [sp.psd([[1, x], [x, y]])])
    assert exact(psd, [0.5, 0.25]) is not None
    assert exact(psd, [0.5, np.nextafter(0.25, 0)]) is None
    cone = sp.Problem(x, [sp.second_order(1, x, y)])
    assert exact(cone, [0.6, 0.7]) is not None
    assert exact(cone, [0.75, 0.75]) is None


def test_values_and_radii_are_rounded_up():
    """x = 1/3 from 3 x = 1: the value 1/3 and its distance to the double below."""
    problem = sp.Problem(z, [3 * z == 1])
    found = exact(problem, [0.5], ROW, ROW)
    assert found.x[0] == 1 / 3
    assert Fraction(found.value) > Fraction(1, 3)
    assert Fraction(found.radius) >= Fraction(1, 3) - Fraction(1 / 3) > 0
    many = sp.Problem(sp.total([0.1 * x, 0.7 * y]))
    point = [1 / 3, 1 / 7]
    value = Fraction(0.1) * Fraction(point[0]) + Fraction(0.7) * Fraction(point[1])
    assert Fraction(exact(many, point).value) >= value
    assert exact(many, point).radius == 0.0


@pytest.mark.parametrize("start", [0.0, 0.5, 99.0])
def test_the_point_is_the_solved_one(start):
    """Wherever the solved variable started, the point is within the radius of what is said."""
    problem = sp.Problem(x, [3 * x + y == 1], [0, 0], [1, 1])
    found = exact(problem, [start, 0.25], ROW, ROW)
    true = (1 - Fraction(0.25)) / 3
    assert abs(Fraction(found.x[0]) - true) <= Fraction(found.radius)
    assert found.radius <= 1e-16 and found.x[1] == 0.25


# ---- Krawczyk ---------------------------------------------------------------------------------

ROOT = float(np.sqrt(2.0))  # 1.41421356...


def root(*rows, low=-INF, high=INF, objective=z):
    return sp.Problem(objective, [z * z == 2, *rows], low, high)


def test_the_root_of_two_is_a_point():
    found = krawczyk(root(), [1.4142])
    assert Fraction(found.value) ** 2 > 2
    assert (Fraction(found.x[0]) + Fraction(found.radius)) ** 2 > 2
    assert (Fraction(found.x[0]) - Fraction(found.radius)) ** 2 < 2


@pytest.mark.parametrize(
    "problem",
    [
        root(z >= 1.5),
        root(z <= 1.4),
        root(z == 1.4),
        root(z - 1.5 == 0),
        root(z <= 1.4, z >= 0),
        root(z >= 0, z <= 1.4),
        root(z >= 0, z == 1.4, z <= 2),
        root(low=1.5),
        root(high=1.4),
        root(low=-2.0, high=1.4),
        root(low=1.5, high=2.0),
        root(sp.psd([[1, z], [z, 1]])),
        root(sp.second_order(1, z)),
        root(sp.psd([[z, 2], [2, z]])),
    ],
    ids=range(14),
)
def test_the_root_of_two_violates_these(problem):
    assert krawczyk(problem, [ROOT]) is None


def test_a_box_that_only_touches_the_feasible_set_is_no_point():
    """Whether the root satisfies z >= its own double is not for doubles to say."""
    for end in (ROOT, float(np.nextafter(ROOT, 0.0)), float(np.nextafter(ROOT, 9.0))):
        above = Fraction(end) ** 2 > 2
        found = krawczyk(root(low=end), [ROOT])
        assert found is None or not above
        found = krawczyk(root(high=end), [ROOT])
        assert found is None or above
        assert krawczyk(root(z >= end), [ROOT]) is None or not above
        assert krawczyk(root(z <= end), [ROOT]) is None or above
        assert krawczyk(root(z == end), [ROOT]) is None


def test_the_value_is_that_of_the_worst_point_of_the_box():
    """-z^3 + z at the root of two is -sqrt 2: the value is no less."""
    for objective in (z, -1.0 * z, z - z**3, 1e9 * z, z**5 - 4 * z):
        found = krawczyk(root(objective=objective), [ROOT])
        true = objective(np.array([ROOT]))
        assert found.value >= true - 1e-6
        low, high = found.x[0] - found.radius, found.x[0] + found.radius
        assert found.value >= max(objective(np.array([low])), objective(np.array([high]))) - 1e-6
        near = krawczyk(root(objective=objective), [ROOT]).value
        assert near == pytest.approx(float(true), rel=1e-6)
    linear = krawczyk(root(objective=z), [ROOT])
    assert Fraction(linear.value) ** 2 > 2
    falling = krawczyk(root(objective=-1.0 * z), [ROOT])
    assert Fraction(falling.value) ** 2 < 2 and falling.value < 0


def test_values_that_overflow_are_refused():
    found = krawczyk(root(objective=1e308 * z**5), [ROOT])
    assert found is None


@pytest.mark.parametrize(
    "rows, solved",
    [
        ([0, 1], [0]),
        ([0], [0, 1]),
        ([], []),
        ([0, 0], [0, 1]),
        ([0, 1], [0, 0]),
        ([1, 1], [0, 1]),
    ],
)
def test_as_many_equations_as_unknowns_and_each_once(rows, solved):
    """x^2 = 2 and y^2 = 3 have a solution; half of the system, or one row twice, proves none."""
    good = sp.Problem(x, [x * x == 2, y * y == 3])
    at = [np.sqrt(2.0), np.sqrt(3.0)]
    assert krawczyk(good, at, np.array([0, 1]), np.array([0, 1])) is not None
    none = sp.Problem(x, [x * x == 2, y * y == 3, x * y == 2])
    for problem in (good, none):
        found = krawczyk(problem, at, np.array(rows, int), np.array(solved, int))
        assert found is None


@pytest.mark.parametrize("variable", [0, 1])
def test_the_radius_reaches_the_far_end_of_the_box(variable):
    """The zero lies left or right of the point that Newton's method ends at."""
    rng = np.random.default_rng(variable)
    for _ in range(40):
        a = float(rng.uniform(1, 3))
        problem = sp.Problem(x, [x * x == a, y * y == a + 1])
        found = krawczyk(problem, np.sqrt([a, a + 1]), np.array([0, 1]), np.array([0, 1]))
        square = Fraction(a) + variable
        centre, radius = Fraction(found.x[variable]), Fraction(found.radius)
        assert (centre - radius) ** 2 <= square <= (centre + radius) ** 2


# ---- rechecking -------------------------------------------------------------------------------


def test_stored_points_that_make_no_sense_are_refused_without_an_exception():
    problem = sp.Problem(x + y, [x + y == 1, x >= 0.25], 0, 1)
    good = exact(problem, [0.25, 0.75], ROW, ROW)
    assert good.recheck(problem) is not None
    for fields in (
        {"x": np.array([0.25])},
        {"x": np.array([0.25, 0.75, 0.0])},
        {"x": np.array([np.nan, 0.75])},
        {"x": np.array([0.25, INF])},
        {"rows": np.array([2])},
        {"rows": np.array([-1])},
        {"rows": np.array([-2])},
        {"solved": np.array([2])},
        {"solved": np.array([-1])},
        {"solved": np.array([-2])},
        {"rows": np.array([0, 5])},
        {"solved": np.array([0, 5])},
    ):
        for proof in ("exact", "krawczyk", "substitution"):
            assert replace(good, proof=proof, **fields).recheck(problem) is None, fields
    with pytest.raises(sp.ProblemError, match="x: found"):  # no point can be made of it
        replace(good, x=np.array([[0.25, 0.75]]))


def test_what_a_stored_point_says_of_itself_is_not_read():
    problem = sp.Problem(x + y, [x + y == 1], 0, 1)
    liar = ProvedPoint(np.array([0.25, 0.5]), -7.0, 0.0, "exact", ROW, ROW)
    again = liar.recheck(problem)
    assert again.value >= 1.0 and again.x.tolist() == [0.5, 0.5]
    outside = ProvedPoint(np.array([0.25, 3.5]), -7.0, 0.0, "exact", ROW, ROW)
    assert outside.recheck(problem) is None
    unsolved = ProvedPoint(np.array([0.25, 0.5]), -7.0, 0.0, "exact", NONE, NONE)
    assert unsolved.recheck(problem) is None


# ---- constraints that are zero with the rows ----------------------------------------------------

CIRCLE = x**2 + y**2 - 2


@pytest.mark.parametrize(
    ("rows", "feasible"),
    [
        ([CIRCLE >= 0, CIRCLE <= 0], True),  # an equation
        ([CIRCLE == 0, CIRCLE == 0, CIRCLE <= 0], True),
        ([CIRCLE <= 0], True),  # zero where an inequality allows it
        ([CIRCLE >= 0, x**2 + y**2 <= 2 - 2.0**-40], False),  # the same monomials
        ([CIRCLE >= 0, x**2 - y**2 - 2 >= 0], False),  # signs of some terms
        ([CIRCLE >= 0, x**2 + x * y - 2 <= 0], False),  # the same coefficients
        ([CIRCLE >= 0, CIRCLE + x <= 0], False),
        ([CIRCLE == 0, x * y >= 1], False),  # an unsolved row that may fail
    ],
)
def test_constraints_alike_a_row_are_zero_with_it(rows, feasible):
    """(1, 1) lies on the circle; the others exclude every point near it, or do not show it."""
    problem = sp.Problem(x + y, rows, -3, 3)
    found = krawczyk(problem, [1.0, 1.0 + 1e-9], ROW, np.ones(1, np.int64))
    assert (found is not None) == feasible
    if found is not None:
        assert abs(found.x[1] - 1.0) <= 2e-9 and found.recheck(problem) is not None


# ---- short numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("proof", ["krawczyk", "substitution"])
@pytest.mark.parametrize("third", [1 / 3, -1 / 3])
def test_short_floats_do_not_round_enclosures_inwards(proof, third):
    """The zero is a third; the float of 32 bits next to it is 1e-8 larger in size."""
    short = np.array([third, third], np.float32)
    inner, outer = sorted([1.000000001 * third, 1.1 * third])
    problem = sp.Problem(x, [3 * x == np.sign(third), y - x == 0], inner, outer)
    pair = np.array([0, 1])
    assert prove_point(problem, short, pair, pair, proof) is None
    assert ProvedPoint(short, 0.0, 0.0, proof, pair, pair).recheck(problem) is None
    wider = sp.Problem(x, problem.constraints, -1.0, 1.0)
    good = ProvedPoint(short, 0.0, 0.0, proof, pair, pair).recheck(wider)
    assert good is not None and Fraction(good.value) >= Fraction(int(np.sign(third)), 3)


def test_the_radius_of_a_point_of_short_floats_reaches_it():
    problem = sp.Problem(z, [3 * z == 1])
    found = prove_point(problem, np.zeros(1, np.float32), ROW, ROW, "exact")
    assert abs(Fraction(float(found.x[0])) - Fraction(1, 3)) <= Fraction(found.radius)


@pytest.mark.parametrize("kind", [np.int8, np.int16, np.int32])
def test_short_integers_do_not_wrap(kind):
    """The letter of variable 127, from 0, is 128."""
    unknowns = sp.variables(128)
    problem = sp.Problem(unknowns[0], [2 * unknowns[127] == 1], 0, 1)
    row, solved = np.array([0], kind), np.array([127], kind)
    found = prove_point(problem, np.zeros(128), row, solved, "substitution")
    assert found is not None and found.x[127] == 0.5
