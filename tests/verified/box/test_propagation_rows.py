"""What propagation works on: squares below a cutoff, minors of matrices, the cutoff row.

Oracles: rationals, and closed forms of single rows.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import (
    Rows,
    _checked_root,
    _within_minors,
    box_rows,
    is_empty,
    propagate,
    sweep,
    with_cutoff,
)

INF = np.inf
x, y = sp.variables(2)


def box_of(low, high):
    return Interval(np.array(low, float), np.array(high, float))


def swept(rows, low, high, target=None, times=3):
    """The box after a few sweeps of p(x) in target, [0, inf) by default."""
    system = PolynomialSystem.stack(list(rows), 2)
    low_, high_ = target or (np.zeros(len(rows)), np.full(len(rows), INF))
    given = Rows(system, Interval(np.array(low_, float), np.array(high_, float)))
    box = box_of(low, high)
    for _ in range(times):
        box = box if is_empty(box) else sweep(given, box)
    return box


# ---- squares ----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, -200, -1000, 400])
def test_the_radius_of_a_square_reaches_every_value_below_the_cutoff(size):
    """w r^2 <= cutoff - constant, in rationals: the radius may not be smaller than the root."""
    rng = np.random.default_rng(abs(size))
    for _ in range(200):
        weight = float(rng.uniform(0.5, 4) * 2.0 ** rng.integers(-90, 90))
        constant = float(np.ldexp(rng.normal(), size))
        cutoff = constant + abs(float(np.ldexp(rng.normal(), size)))
        if size == -1000:
            weight = float(np.ldexp(rng.uniform(0.5, 1), 300))  # the quotient underflows
        f = weight * x**2 + constant
        rows = box_rows(sp.Problem(f, squares=[(weight, x)]), cutoff)
        low, high = float(rows.target.lo[-1]), float(rows.target.hi[-1])
        assert low == -high
        room = max(Fraction(0), Fraction(cutoff) - Fraction(constant))
        assert Fraction(high) ** 2 * Fraction(weight) >= room


def test_the_double_above_the_cutoff_decides_about_a_square():
    """(x - 1)^2 + 1 <= 1 + 2^-52 holds at 1 + 2^-26, and the room is one last digit."""
    f = (x - 1) ** 2 + 1.0
    problem = sp.Problem(f, squares=[x - 1])
    for steps in (0, 1, 2, 3):
        cutoff = 1.0 + steps * 2.0**-52
        box, _ = propagate(box_rows(problem, cutoff), box_of([-9, 0], [9, 0]))
        reach = np.sqrt(float(steps)) * 2.0**-26
        assert box.lo[0] <= 1.0 - reach and box.hi[0] >= 1.0 + reach
        assert box.hi[0] <= 1.0 + 2 * reach + 1e-7


def test_squares_of_weight_zero_say_nothing():
    problem = sp.Problem(x**2 + 0.0 * y, squares=[(1.0, x), (0.0, y)])
    box, _ = propagate(box_rows(problem, 4.0), box_of([-INF, -INF], [INF, INF]))
    assert -2.0 - 1e-9 <= box.lo[0] <= -2.0 and 2.0 <= box.hi[0] <= 2.0 + 1e-9
    assert box.lo[1] == -INF and box.hi[1] == INF


def test_squares_that_are_not_the_objective_say_nothing():
    """The identity fails in the last digit: no constant is known."""
    objective = x**2 + (2.0**-60) * y
    problem = sp.Problem(objective, squares=[x])
    assert problem.squares_constant is None
    assert box_rows(problem, 4.0).system.size == 1


def test_equations_inequalities_and_the_cutoff_have_their_ranges():
    problem = sp.Problem(x * y, [x >= 1, y == 2, x + y >= 0])
    plain, cut = box_rows(problem, None), box_rows(problem, -3.5)
    assert plain.target.lo.tolist() == [0.0, 0.0, 0.0]
    assert plain.target.hi.tolist() == [INF, 0.0, INF]
    assert cut.target.lo.tolist() == [0.0, 0.0, 0.0, -INF]
    assert cut.target.hi.tolist() == [INF, 0.0, INF, -3.5]
    system, equal = with_cutoff(problem, -3.5)
    assert equal.tolist() == [False, True, False, False]
    at = np.array([2.0, -7.0])
    assert system.values(at).tolist() == [1.0, -9.0, -5.0, -3.5 + 14.0]


# ---- matrices ---------------------------------------------------------------------------------


def test_minors_bound_what_stands_beside_the_diagonal():
    """[[x, y], [y, 4]] >= 0 with x <= 9: |y| <= 6, and x >= 0. The objective's rows come first."""
    problem = sp.Problem((x - y) ** 2, [x <= 9, sp.psd([[x, y], [y, 4]])], squares=[x - y])
    for cutoff in (None, 1e6):
        box, _ = propagate(box_rows(problem, cutoff), box_of([-INF, -INF], [INF, INF]))
        assert -1e-9 <= box.lo[0] <= 0.0 and 9.0 <= box.hi[0] <= 9.0 + 1e-9
        assert -6.0 - 1e-9 <= box.lo[1] <= -6.0 and 6.0 <= box.hi[1] <= 6.0 + 1e-9


@pytest.mark.parametrize("entry", [(4, 9), (9, 4), (0, 5), (1e-200, 1e-200)])
def test_each_minor_has_two_factors(entry):
    a, b = map(float, entry)
    problem = sp.Problem(x, [sp.psd([[a + 0.0 * x, x], [x, b]])])
    box, _ = propagate(box_rows(problem, None), box_of([-INF, 0], [INF, 0]))
    reach = np.sqrt(a) * np.sqrt(b)
    assert box.lo[0] <= -reach and reach <= box.hi[0] <= reach * (1 + 1e-12) + 1e-100


def test_the_root_of_a_minor_is_rounded_upwards():
    """a^2 <= b c in rationals, for b and c with all their digits."""
    rng = np.random.default_rng(1)
    rows = Rows(
        PolynomialSystem.stack([x, x, x], 2),
        Interval(np.full(3, -INF), np.full(3, INF)),
        np.array([[0, 1, 2]]),
    )
    for exponent in (0, -300, -530):
        for _ in range(300):
            b, c = np.ldexp(rng.uniform(1, 4, 2), exponent)
            found = _within_minors(rows, np.array([INF, b, c]))
            assert Fraction(float(found.hi[0])) ** 2 >= Fraction(b) * Fraction(c)
            assert found.lo[0] == -found.hi[0]
            assert found.hi.tolist()[1:] == [INF, INF] and found.lo.tolist()[1:] == [-INF, -INF]


# ---- single rows with closed forms ------------------------------------------------------------


def contains(box, *points):
    return all(np.all(box.lo <= p) and np.all(p <= box.hi) for p in points)


def test_a_factor_that_may_be_zero_leaves_the_other_alone():
    """x y >= 0 over [0, 2] x [-3, 3] and [-2, 0] x [-3, 3] holds wherever x = 0."""
    for low, high in (([0, -3], [2, 3]), ([-2, -3], [0, 3]), ([0, -3], [0, 3])):
        assert contains(swept([x * y], low, high), [0.0, -3.0], [0.0, 3.0])
        assert contains(swept([-1.0 * x * y], low, high), [0.0, -3.0], [0.0, 3.0])
        zero = ([0.0], [0.0])
        assert contains(swept([x * y], low, high, zero), [0.0, -3.0], [0.0, 3.0])


def test_a_target_that_ends_at_zero_divided_by_a_factor_that_does():
    """x y in [0, 1] and x y in [-1, 0] with x in [0, 2] allow x = 0 and any y."""
    for target in (([0.0], [1.0]), ([-1.0], [0.0]), ([-1.0], [1.0])):
        for low, high in (([0, -9], [2, 9]), ([-2, -9], [0, 9])):
            assert contains(swept([x * y], low, high, target), [0.0, -9.0], [0.0, 9.0])


def test_factors_that_reach_zero_from_one_side_bound_from_the_other():
    """x y >= 1 with x in (0, 2] needs y >= 1/2, and with x in [-2, 0) needs y <= -1/2."""
    box = swept([x * y - 1.0], [0, -9], [2, 9])
    assert box.lo[1] <= 0.5 and box.lo[1] >= 0.5 - 1e-12 and box.hi[1] == 9.0
    box = swept([x * y - 1.0], [-2, -9], [0, 9])
    assert box.hi[1] >= -0.5 and box.hi[1] <= -0.5 + 1e-12 and box.lo[1] == -9.0
    for far in (1e3, 1e300):  # y = 1 / x is large where x is small
        point = np.array([1.0 / far, far])
        box = swept([x * y - 1.0, 1.0 + 2.0**-40 - x * y], [0, -INF], [2, INF])
        assert box.hi[1] >= far and contains(box, point)


def test_two_endless_terms_of_a_row_bound_nothing_and_one_is_bounded():
    for row in (x + y, x - y, x * y + x, x**2 * y + y):
        box = swept([row, 1 - row], [-INF, -INF], [INF, INF])
        assert box.lo.tolist() == [-INF, -INF] and box.hi.tolist() == [INF, INF]
    box = swept([x * x + y, 4.0 - x * x - y], [-INF, 0], [INF, INF])
    assert box.hi.tolist()[1] >= 4.0 and box.hi[1] <= 4.0 + 1e-12
    assert contains(box, [0.0, 4.0], [2.0, 0.0], [-2.0, 0.0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_others_with_one_end_at_zero_still_count(sign):
    """x + y = 3 over y in [0, 2] leaves x in [1, 3]; y in [-2, 0] leaves [3, 5]."""
    row = x + sign * y - 3.0
    box = swept([row], [-9, 0], [9, 2], ([0.0], [0.0]))
    expected = (1.0, 3.0) if sign > 0 else (3.0, 5.0)
    assert box.lo[0] == pytest.approx(expected[0], abs=1e-12) and box.lo[0] <= expected[0]
    assert box.hi[0] == pytest.approx(expected[1], abs=1e-12) and box.hi[0] >= expected[1]


def test_parabolas_whose_vertex_is_an_end_of_the_box():
    """x^2 - 2 x over boxes that begin or end at 1, where it is -1; and its opposite."""
    for low, high in ((1.0, 4.0), (-2.0, 1.0), (1.0, 1.0), (0.0, 2.0)):
        for sign in (1.0, -1.0):
            row = sign * (x**2 - 2 * x + y)
            box = swept([row], [low, -9], [high, 9], ([0.0], [0.0]))
            for place in {low, high, 1.0}:
                assert box.lo[1] <= 2 * place - place**2 <= box.hi[1]


@pytest.mark.parametrize("numerator", [1.0, 1.5, 7.0])
@pytest.mark.parametrize("divisor", [3.0, 7.0, 49.0, 0.1])
def test_parabolas_whose_vertex_is_no_double(numerator, divisor):
    """a x^2 - b x near its vertex b / 2a, which the ends of the box enclose or nearly touch."""
    vertex = Fraction(numerator) / (2 * Fraction(divisor))
    depth = -(Fraction(numerator) ** 2) / (4 * Fraction(divisor))
    near = float(vertex)
    for low, high in (
        (near, near + 1.0),
        (near - 1.0, near),
        (near, np.nextafter(near, INF)),
        (np.nextafter(near, -INF), near),
    ):
        for sign in (1.0, -1.0):
            row = sign * (divisor * x**2 - numerator * x) - y
            box = swept([row], [low, -INF], [high, INF], ([0.0], [0.0]), times=1)
            for place in (Fraction(low), Fraction(high)):
                value = Fraction(sign) * (
                    Fraction(divisor) * place**2 - Fraction(numerator) * place
                )
                assert Fraction(float(box.lo[1])) <= value <= Fraction(float(box.hi[1]))
            if Fraction(low) <= vertex <= Fraction(high):
                value = Fraction(sign) * depth
                assert Fraction(float(box.lo[1])) <= value <= Fraction(float(box.hi[1]))


def test_the_gap_of_a_parabola_is_left_from_both_sides():
    """(x - 1)^2 >= 4: boxes that begin at -1, at 3, between and before."""
    row = (x - 1.0) ** 2 - 4.0
    for low, high, left, right in (
        (-1.0, 5.0, -1.0, 5.0),
        (-0.5, 5.0, 3.0, 5.0),
        (-5.0, 3.0, -5.0, 3.0),
        (-5.0, 2.5, -5.0, -1.0),
        (3.0, 3.0, 3.0, 3.0),
        (-1.0, -1.0, -1.0, -1.0),
        (-5.0, 5.0, -5.0, 5.0),
        (4.0, 5.0, 4.0, 5.0),
        (-5.0, -4.0, -5.0, -4.0),
    ):
        box = swept([row], [low, 0], [high, 0])
        assert box.lo[0] <= left and box.hi[0] >= right
        assert box.lo[0] == pytest.approx(left, abs=1e-9)
        assert box.hi[0] == pytest.approx(right, abs=1e-9)
    assert is_empty(swept([row], [-0.5, 0], [2.5, 0]))


def test_coefficients_whose_vertex_overflows_leave_the_box_alone():
    """No end becomes a number that is none."""
    for big, small in ((1e300, 1e-300), (1e308, -1e-308), (-1e200, 1e-200), (1e160, 1e160)):
        for target in (([0.0], [0.0]), ([-INF], [1.0]), ([-1e308], [1e308])):
            for low, high in (([-INF, 0], [INF, 0]), ([-1, 0], [INF, 0]), ([-1, 0], [1, 0])):
                with np.errstate(all="ignore"):
                    box = swept([big * x + small * x**2], low, high, target)
                assert not np.any(np.isnan(box.lo) | np.isnan(box.hi))
                if target[0][0] <= 0 <= target[1][0]:
                    assert box.lo[0] <= 0.0 <= box.hi[0]


@pytest.mark.parametrize("power", [2, 3, 4, 5, 6, 7])
def test_powers_keep_every_sign_and_end(power):
    """x^p in [low, high] over boxes that touch the roots."""
    for low, high in ((-32.0, 1.0), (1.0, 64.0), (-1.0, -1.0), (0.0, 0.0), (-8.0, 0.0), (0.0, 8.0)):
        grid = np.linspace(-4, 4, 257)
        inside = grid[(grid**power >= low) & (grid**power <= high)]
        for begin, end in ((-4.0, 4.0), (-1.0, 4.0), (-4.0, 1.0), (0.0, 4.0), (-4.0, 0.0)):
            kept = inside[(inside >= begin) & (inside <= end)]
            box = swept([x**power * 1.0 + 0.0 * y], [begin, 0], [end, 0], ([low], [high]))
            if kept.size:
                assert box.lo[0] <= kept.min() and box.hi[0] >= kept.max()
            if power % 2 == 0 and high < 0:
                assert is_empty(box)


def test_roots_are_checked_by_multiplication():
    """1 / 3 is no double: of 1e300 the root is wrong by more than its margin, and is refused."""
    for value in (1e300, 1e-300, 5e-324, 2.0, 1.7976931348623157e308):
        for power in (2, 3, 5, 7, 11):
            given, p = np.array([value]), np.array([power])
            above, below = _checked_root(given, p, 1.0)[0], _checked_root(given, p, -1.0)[0]
            assert above == INF or Fraction(above) ** power >= Fraction(value)
            assert Fraction(below) ** power <= Fraction(value)


class Bad(np.ndarray):
    """Numbers whose powers are slightly wrong, as a bad library would return them."""

    factor = 1.0

    def __pow__(self, exponent):
        return np.asarray(np.asarray(self) ** exponent * self.factor)


@pytest.mark.parametrize("factor", [1 - 1e-13, 1 + 1e-13, 0.5, 2.0])
@pytest.mark.parametrize("power", [2, 3, 4])
def test_roots_of_a_bad_library_are_not_believed(factor, power):
    value = np.array([3.0]).view(Bad)
    value.factor = factor
    above = _checked_root(value, np.array([power]), 1.0)[0]
    below = _checked_root(value, np.array([power]), -1.0)[0]
    assert above == INF or Fraction(float(above)) ** power >= 3
    assert Fraction(float(below)) ** power <= 3


@pytest.mark.parametrize("power", [2, 3, 5])
def test_roots_next_to_the_true_one_are_told_apart(power):
    """A root whose power, rounded, is the value: the exact power decides."""
    rng = np.random.default_rng(power)
    for side in (1.0, -1.0):
        for value in rng.uniform(1, 2, 200):
            near = value ** (1.0 / power)
            for steps in range(-3, 4):
                wanted = near + steps * np.spacing(near)
                given = np.array([value]).view(Bad)
                given.factor = wanted / (1.0 + side * 1e-15) / (value ** (1.0 / power))
                found = _checked_root(given, np.array([power]), side)[0]
                exact = Fraction(float(found)) ** power if np.isfinite(found) else None
                if side > 0:
                    assert exact is None or exact >= Fraction(value)
                else:
                    assert exact <= Fraction(value)
