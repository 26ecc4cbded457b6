"""Points whose equations are solved one after the other."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.points.feasible_point import prove_point

x, v, w = sp.variables(3)
BOTH = np.array([0, 1])
# 3 v = 1 and (v + 2) w = v + x: v = 1/3, w = (1/3 + x) / (7/3) = (1 + 3 x) / 7
ROWS = [3 * v == 1, (v + 2) * w == v + x]


def point(*others, objective=w, at=0.75, low=-9.0, high=9.0, rows=BOTH, solved=(1, 2)):
    problem = sp.Problem(objective, [*ROWS, *others], low, high)
    kept = np.array([at, 5.0, -5.0])  # what is solved is not read
    return prove_point(problem, kept, rows, np.array(solved), "substitution")


@pytest.mark.parametrize("at", [0.75, -0.75, 0.1])
def test_the_point_is_near_and_its_value_is_above(at):
    found = point(at=at)
    exact = {0: Fraction(at), 1: Fraction(1, 3), 2: (1 + 3 * Fraction(at)) / 7}
    assert found.proof == "substitution"
    for variable, value in exact.items():
        assert abs(value - Fraction(found.x[variable])) <= Fraction(found.radius)
    assert exact[2] <= Fraction(found.value) <= exact[2] + Fraction(1, 2**50)
    assert found.radius <= 2.0**-50
    assert found.x[0] == at
    lowest = point(at=at, objective=-1.0 * w)
    assert -exact[2] <= Fraction(lowest.value)


def test_rows_and_bounds_hold_over_the_enclosures():
    """w = 13/28 for x = 3/4; 1/3 lies between two doubles."""
    near = float(np.nextafter(1 / 3, 1)), float(np.nextafter(1 / 3, 0))
    above = max(1 / 3, near[0])
    assert point(28 * w >= 12.999) is not None
    for other in (28 * w >= 13.001, 28 * w <= 12.999, v >= above, v <= near[1], w == 0.5):
        assert point(other) is None
    assert point(low=[-9.0, above, -9.0]) is None
    assert point(high=[9.0, near[1], 9.0]) is None
    assert point(low=[-9.0, 0.25, -9.0], high=[9.0, 0.5, 9.0]) is not None


def test_rows_of_kept_variables_hold_exactly():
    """x = 0.1 attains 10 x >= 10 * 0.1 as reals, which rounded products would not show."""
    tenth = Fraction(0.1) * 10
    assert tenth > 1
    assert point(10 * x >= 1, at=0.1) is not None
    assert point(3 * x == 2.25) is not None
    assert point(0.1 * x - 0.1 * x**2 >= 0.0, at=1.0) is not None
    assert point(10 * x <= 1, at=0.1) is None
    assert point(3 * x == 2.25, at=float(np.nextafter(0.75, 1))) is None
    assert point(x**3 >= 0.421875) is not None
    assert point(x**3 >= float(np.nextafter(0.421875, 1))) is None


def test_a_row_with_a_solved_variable_is_not_checked_at_one_end():
    """v = 1/3 is larger than the double below it, which encloses it from below."""
    below = min(
        1 / 3, float(np.nextafter(1 / 3, 0)), key=lambda end: Fraction(end) > Fraction(1, 3)
    )
    assert Fraction(below) < Fraction(1, 3) < Fraction(float(np.nextafter(below, 1)))
    assert point(below - v - x >= 0, at=0.0) is None
    assert point(below + 1e-15 - v - x >= 0, at=0.0) is not None


def test_matrices_hold_over_the_enclosures():
    """[[1, 2 w], [2 w, 1]] is semidefinite for abs(w) <= 1/2."""
    for size, good in ((2.0, True), (3.0, False)):
        matrix = sp.psd([[1.0 + 0 * w, size * w], [size * w, 1.0 + 0 * w]])
        assert (point(matrix) is not None) == good


@pytest.mark.parametrize(
    "rows, solved",
    [
        ([1, 0], [2, 1]),  # w before v
        ([0, 1], [2, 1]),
        ([0], [1, 2]),
        ([0, 1], [1]),
        ([], []),
        ([0, 0], [1, 2]),
        ([0, 1], [1, 1]),
        ([0], [1]),  # the other equation is left
    ],
)
def test_other_orders_and_parts_of_the_system_prove_nothing(rows, solved):
    assert point(rows=np.array(rows, int), solved=np.array(solved, int)) is None


def test_values_that_overflow_prove_nothing():
    problem = sp.Problem(1e308 * v**5, [v == 1e300])
    assert prove_point(problem, np.zeros(3), BOTH[:1], BOTH[1:], "substitution") is None


def test_a_stored_point_is_proved_again_and_goes_through_files():
    found = point()
    problem = sp.Problem(w, ROWS, -9.0, 9.0)
    assert found.recheck(problem).value == found.value
    assert found.recheck(sp.Problem(w, [*ROWS, w >= 0.5], -9.0, 9.0)) is None
