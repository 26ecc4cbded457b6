"""Rays that prove nothing: problems with a known minimum, and starts that are not feasible."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.points import unbounded_ray
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import _along, _proves, falling_ray

INF = np.inf
x, y = sp.variables(2)
NONE = np.zeros(0, np.int64)


def at(*point):
    return ProvedPoint(np.array(point, float), 0.0, 0.0, "exact", NONE, NONE)


def proves(problem, origin, direction):
    return _proves(problem, [Fraction(v) for v in origin], np.array(direction, float))


@pytest.fixture(autouse=True)
def promise(monkeypatch):
    """Floating point promises everything: the proof has to decide."""
    monkeypatch.setattr(unbounded_ray, "_promises", lambda *_: True)


BOUNDED = {
    "constant": (0 * x - 5, []),
    "growing": (x * x - 9 * x, []),
    "lower bound of x": (x + 0 * y, [x >= -1]),
    "line": (x + 0 * y, [x == 0]),
    "parabola": (x + y * y, [x == 0.0 * y]),
    "disc": (x + y, [1 - x * x - y * y >= 0]),
    "wedge": (x + 0 * y, [x + y >= 0, x - y >= 0]),
    "quartic": (x**4 - 100 * x**3, []),
    "hyperbola": (x + y, [x * y == 1, x >= 0]),
    "curve": (y + 0 * x, [y == x * x]),
    "below": (y - x, [y - x * x >= 0]),
    "matrix": (x + 0 * y, [sp.psd([[1, x], [x, 1]])]),
    "cone": (x + 0 * y, [sp.second_order(2, x, y)]),
    "half matrix": (-1.0 * x, [sp.psd([[1 + y, 0.5 * x], [0.5 * x, 1 - y]])]),
}


@pytest.mark.parametrize("name", BOUNDED)
def test_bounded_problems_have_no_ray_in_any_direction(name):
    objective, rows = BOUNDED[name]
    problem = sp.Problem(objective, rows)
    for origin in ((0, 0), (1, 1), (0, 1), (0.5, 0.25), (1, 0)):
        if problem.violation(np.array(origin, float)) == 0:
            for a in (-2, -1, 0, 1, 2):
                for b in (-2, -1, 0, 1, 2):
                    assert not proves(problem, origin, (a, b)), (origin, a, b)
            assert falling_ray(problem, at(*origin)) is None


@pytest.mark.parametrize(
    "low, high, direction",
    [
        ([-5, -INF], [INF, INF], (-1, 0)),
        ([-INF, -5], [INF, INF], (-1, -1)),
        ([-INF, -INF], [INF, 5], (-1, 1)),
        ([-INF, -INF], [5, INF], (1, -3)),
    ],
)
def test_bounds_stop_a_ray_on_their_side(low, high, direction):
    problem = sp.Problem(x + y, (), low, high)
    objective = sp.Problem(x + 2 * y if direction[1] < 0 else 2 * x + y, (), low, high)
    for each in (problem, objective):
        assert not proves(each, (0, 0), direction)
    free = sp.Problem(objective.objective)
    assert proves(free, (0, 0), direction) == (sum(direction) < 0 or direction[0] < 0)
    away = sp.Problem(-1.0 * x - y, (), low, high)
    turned = tuple(-d for d in direction)
    assert proves(away, (0, 0), turned) == proves(sp.Problem(-1.0 * x - y), (0, 0), turned)


def test_the_leading_coefficient_decides():
    """x^2 - 9 x falls at first and grows in the end; -x^2 + 9 x the other way round."""
    assert not proves(sp.Problem(x * x - 9 * x), (0, 0), (1, 0))
    assert proves(sp.Problem(9 * x - x * x), (0, 0), (1, 0))
    assert proves(sp.Problem(9 * x - x * x + 100), (0, 0), (1, 0))
    assert not proves(sp.Problem(x * x - 9 * x - 100), (0, 0), (1, 0))


def test_every_coefficient_of_a_constraint_counts():
    """1 + s - s^2 / 100 is negative far out, and 1 - 3 s + s^2 in between."""
    for row in (1 + x - 0.01 * x * x, 1 - 3 * x + x * x, 1 - x):
        assert not proves(sp.Problem(-1.0 * x, [row >= 0]), (0, 0), (1, 0))
    assert proves(sp.Problem(-1.0 * x, [1 + x + x * x >= 0]), (0, 0), (1, 0))
    for row in (x * x - y, x - y):
        assert not proves(sp.Problem(-1.0 * x, [row == 0]), (0, 0), (1, 0))
    assert proves(sp.Problem(-1.0 * x, [x - y == 0]), (0, 0), (1, 1))
    two = sp.Problem(-1.0 * x, [1 + x >= 0, 1 - x >= 0])
    assert not proves(two, (0, 0), (1, 0))


def test_matrices_are_semidefinite_all_along():
    """[1 s; s 1] is not, [1 + s, s; s, 1 + s] is."""
    problem = sp.Problem(-1.0 * x, [sp.psd([[1 + x, y], [y, 1 + x]])])
    assert proves(problem, (0, 0), (1, 1))
    assert proves(problem, (0, 0), (1, 0))
    assert not proves(problem, (0, 0), (1, 2))
    assert not proves(sp.Problem(-1.0 * y, problem.constraints), (0, 0), (0, 1))


def test_polynomials_along_a_ray():
    """(1 + 2 s)^2 (3 - s) + 5 (3 - s) = 18 + 6 s + 8 s^2 - 4 s^3."""
    p = x * x * y + 5 * y
    found = _along(p, [Fraction(1), Fraction(3)], [Fraction(2), Fraction(-1)])
    assert found == [18, 6, 8, -4]
    assert _along(x - x, [Fraction(1), Fraction(1)], [Fraction(1), Fraction(1)]) == []


def test_only_points_that_are_feasible_themselves_start_a_ray():
    """x = sqrt 2 with min y: the point is near, and the ray from its double leaves the line."""
    problem = sp.Problem(y + 0 * x)
    good = at(0, 0)
    assert falling_ray(problem, good) is not None
    assert falling_ray(problem, replace(good, proof="krawczyk")) is None
    assert falling_ray(problem, replace(good, proof="krawczyk", radius=1e-16)) is None


def test_rays_start_where_the_rows_put_the_point():
    """3 x = 1 has no double; from there y falls, and from a point that is not feasible nothing."""
    problem = sp.Problem(y + 0 * x, [3 * x == 1])
    near, first = at(0, 0), np.zeros(1, np.int64)
    assert falling_ray(problem, near) is None
    assert falling_ray(problem, replace(near, rows=first, solved=first)) is not None
    assert falling_ray(problem, replace(near, rows=first, solved=first + 1)) is None
    above = sp.Problem(y + 0 * x, [3 * x == 1], lower=[0.5, -np.inf])
    assert falling_ray(above, replace(near, rows=first, solved=first)) is None
    crossed = sp.Problem(y + 0 * x, [3 * x == 1, 3 * y * x == y])
    assert falling_ray(crossed, replace(near, rows=first, solved=first)) is not None
    assert falling_ray(sp.Problem(y, [3 * x == 1, 2 * x * y == 0]), near) is None


def test_a_known_direction_is_the_only_one_tried():
    problem = sp.Problem(y + 0 * x)
    assert falling_ray(problem, at(0, 0), np.array([0.0, 1.0])) is None
    assert falling_ray(problem, at(0, 0), np.array([3.0, -1.0])) is not None
    for wrong in (np.array([-1.0]), np.array([0.0, -np.inf]), np.array([np.nan, -1.0])):
        assert falling_ray(problem, at(0, 0), wrong) is None
