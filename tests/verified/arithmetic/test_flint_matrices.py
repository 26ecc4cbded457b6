"""Definite or not: against characteristic polynomials of FLINT, at singular and badly scaled ones.

A symmetric matrix is positive semidefinite if and only if all elementary symmetric functions of
its eigenvalues are non-negative; they are the coefficients of its characteristic polynomial but
for signs, which rationals give exactly.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq, fmpq_mat
from flint_oracle import rational
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic import definiteness
from sparsepop_py.verified.arithmetic.definiteness import (
    hold_at,
    hold_over,
    is_semidefinite,
    surely_semidefinite,
)
from sparsepop_py.verified.arithmetic.interval import Interval

SEEDS = st.integers(0, 2**32 - 1)
x, y = sp.variables(2)


def semidefinite(matrix):
    """Whether a symmetric matrix of doubles is positive semidefinite, exactly."""
    rows = [[rational(v) for v in row] for row in matrix]
    coefficients = fmpq_mat(rows).charpoly().coeffs()
    return all(c * (-1) ** k >= 0 for k, c in enumerate(reversed(coefficients)))


def fractions(matrix):
    return [[Fraction(float(v)) for v in row] for row in matrix]


def scaled(rng, side, rank):
    """D B B' D with whole numbers B and powers of two D of all sizes: exact in doubles."""
    factor = rng.integers(-9, 10, (side, rank))
    exponent = rng.integers(-400, 400, side)
    return np.ldexp((factor @ factor.T).astype(float), exponent[:, None] + exponent)


@settings(max_examples=80, deadline=None)
@given(SEEDS, st.integers(1, 5), st.integers(1, 5))
def test_singular_and_badly_scaled_matrices(seed, side, rank):
    """Exact products of every rank, and one entry moved by one double."""
    rng = np.random.default_rng(seed)
    matrix = scaled(rng, side, rank)
    assert semidefinite(matrix) and is_semidefinite(fractions(matrix))
    i, j = rng.integers(0, side, 2)
    for towards in (-np.inf, np.inf):
        moved = matrix.copy()
        moved[i, j] = moved[j, i] = np.nextafter(matrix[i, j], towards)
        expected = semidefinite(moved)
        assert is_semidefinite(fractions(moved)) == expected
        assert expected or not surely_semidefinite(Interval.point(moved))


@settings(max_examples=80, deadline=None)
@given(SEEDS, st.integers(2, 5), st.floats(-18, -8))
def test_no_member_of_a_certain_interval_matrix_is_indefinite(seed, side, size):
    """Nearly singular matrices with entries of all digits; corners of the interval matrix."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(side, side - 1))
    matrix = factor @ factor.T + 10.0**size * np.eye(side)
    radius = 10.0 ** rng.uniform(-18, size) * rng.uniform(size=(side, side))
    radius = np.maximum(radius, radius.T)
    low, high = matrix - radius, matrix + radius
    if surely_semidefinite(Interval(low, high)):
        for _ in range(4):
            pick = rng.integers(0, 2, (side, side))
            pick = np.triu(pick) + np.triu(pick, 1).T
            assert semidefinite(np.where(pick, low, high))
        vector = np.linalg.eigh(matrix)[1][:, 0]
        worst = np.where(np.outer(vector, vector) > 0, low, high)
        assert semidefinite(worst)


@pytest.mark.parametrize("size", [1e-150, 1.0, 1e150])
def test_margins_larger_than_rounding_are_seen(size):
    assert surely_semidefinite(Interval.point(size * np.array([[2.0, 1.0], [1.0, 2.0]])))


# ---- whatever Cholesky says -------------------------------------------------------------------


@pytest.fixture
def no_factor(monkeypatch):
    """Cholesky's factor is 0: what is left to see is diagonal dominance."""
    monkeypatch.setattr(definiteness.np.linalg, "cholesky", lambda matrix: 0.0 * matrix)


def test_the_factor_of_cholesky_is_not_believed(no_factor):
    """[1 2; 2 1] has the eigenvalue -1."""
    assert surely_semidefinite(Interval.point(np.array([[2.0, 1.0], [1.0, 2.0]])))
    for matrix in ([[1.0, 2.0], [2.0, 1.0]], [[2.0, -3.0], [-3.0, 9.0]], [[-1.0]]):
        assert not surely_semidefinite(Interval.point(np.array(matrix)))


def test_one_dominant_row_and_one_good_end_are_not_enough(no_factor):
    assert not surely_semidefinite(Interval.point(np.array([[9.0, 2.0], [2.0, 1.0]])))
    low = np.array([[1.0, 2.0], [2.0, 9.0]])
    wide = Interval(low, low + np.diag([8.0, 0.0]))
    assert not surely_semidefinite(wide)
    three = np.full((3, 3), -1.0) + np.diag([2.5, 2.5, 2.5])  # 1.5 < 1 + 1, eigenvalue -1/2
    assert not surely_semidefinite(Interval.point(three))
    beside = Interval(np.array([[1.0, -3.0], [-3.0, 1.0]]), np.array([[1.0, 0.5], [0.5, 1.0]]))
    assert not surely_semidefinite(beside)


def test_sums_of_rows_are_rounded_upwards(no_factor):
    """d I - b (1 1' - I) has the eigenvalue d - 59 b on (1, ..., 1).

    Doubles lose a little of each b, always downwards: together a dozen last digits.
    """
    side, near = 60, 1.0 + 15 * 2.0**-52
    total = 0.0
    for _ in range(side - 1):
        total += near
    diagonal = float(np.nextafter(np.nextafter(np.nextafter(total, 99.0), 99.0), 99.0))
    assert Fraction(diagonal) < 59 * Fraction(near)
    matrix = np.full((side, side), -near) + np.diag(np.full(side, diagonal + near))
    np.fill_diagonal(matrix, diagonal)
    assert not surely_semidefinite(Interval.point(matrix))


# ---- elimination ------------------------------------------------------------------------------


def test_larger_matrices_that_elimination_does_not_take_are_unknown():
    """Rank one and 61 rows: singular, so that floating point cannot tell."""
    ones = [[Fraction(1)] * 61 for _ in range(61)]
    assert not is_semidefinite(ones)
    assert is_semidefinite([row[:60] for row in ones[:60]])
    ones[60][60] = Fraction(1, 2)
    assert not is_semidefinite(ones)


@pytest.mark.parametrize("tiny", [Fraction(1, 10**400), Fraction(-1, 10**400), Fraction(0)])
def test_rationals_that_no_double_holds_decide(tiny):
    """[1 1; 1 1 + e] is semidefinite for e >= 0; [e 1; 1 1] for no small e."""
    one = Fraction(1)
    assert is_semidefinite([[one, one], [one, one + tiny]]) == (tiny >= 0)
    assert not is_semidefinite([[tiny, one], [one, one]])
    assert is_semidefinite([[tiny]]) == (tiny >= 0)


def test_rationals_between_doubles_are_not_taken_at_their_lower_ends():
    """[1 a; a a^2 - e] is indefinite for any e > 0."""
    a = Fraction(10**400 + 1, 10**400)
    assert is_semidefinite([[Fraction(1), a], [a, a * a]])
    assert not is_semidefinite([[Fraction(1), a], [a, Fraction(1)]])


# ---- cones ------------------------------------------------------------------------------------


def cone_at(axis, rest):
    constants = [0.0 * x + float(v) for v in (axis, *rest)]
    return sp.Problem(x, [sp.second_order(*constants)]).matrices


@settings(max_examples=100, deadline=None)
@given(SEEDS, st.integers(1, 6), st.integers(-3, 3), st.sampled_from([0, -600, -530, 300]))
def test_cones_near_their_boundary(seed, count, steps, size):
    """The axis is within a few doubles of the norm of the rest, at any size."""
    rng = np.random.default_rng(seed)
    rest = np.ldexp(rng.uniform(-2, 2, count), size)
    axis = float(np.ldexp(np.linalg.norm(np.ldexp(rest, -size)), size))
    for _ in range(abs(steps)):
        axis = float(np.nextafter(axis, np.inf if steps > 0 else 0.0))
    matrices = cone_at(axis, rest)
    expected = rational(axis) ** 2 >= sum((rational(v) ** 2 for v in rest), fmpq(0))
    point, origin = [Fraction(0), Fraction(0)], Interval(np.zeros(2), np.zeros(2))
    assert hold_at(matrices, point) == expected
    assert expected or not hold_over(matrices, origin)


@pytest.mark.parametrize("digits", range(1, 16))
def test_many_squares_are_added_upwards(digits):
    """60 equal entries, whose squares doubles add too low by several last digits."""
    near = 1.0 + digits * 2.0**-52
    exact = 60 * rational(near) ** 2
    axis = float(np.sqrt(60.0)) * near
    while rational(axis) ** 2 < exact:
        axis = float(np.nextafter(axis, 99.0))
    below = float(np.nextafter(axis, 0.0))
    assert rational(below) ** 2 < exact
    for value in (below, float(np.nextafter(below, 0.0))):
        assert not hold_over(cone_at(value, [near] * 60), Interval(np.zeros(2), np.zeros(2)))
        assert not hold_at(cone_at(value, [near] * 60), [Fraction(0), Fraction(0)])


def test_a_negative_axis_with_no_rest_to_speak_of():
    """-1 >= |0| is false although 1 >= 0: also where the square of the axis is large enough."""
    for axis in (-1.0, -1e-300):
        matrices = cone_at(axis, [0.0, 0.0])
        assert not hold_at(matrices, [Fraction(0), Fraction(0)])
        assert not hold_over(matrices, Interval(np.zeros(2), np.zeros(2)))


def test_the_rest_of_a_cone_is_taken_at_its_larger_end():
    """1 >= |(x, x - 2)| fails at x = 0, the end of [0, 1/2] where the second is -2."""
    matrices = sp.Problem(x, [sp.second_order(1, x, x - 2)]).matrices
    assert not hold_over(matrices, Interval(np.array([0.0, 0.0]), np.array([2.0, 0.0])))
    wide = sp.Problem(x, [sp.second_order(x, 1)]).matrices
    assert not hold_over(wide, Interval(np.array([0.5, 0.0]), np.array([2.0, 0.0])))


def test_every_matrix_of_a_problem_counts():
    """The first holds and the second does not, of each kind."""
    good, bad = sp.psd([[1, 0.0 * x], [0.0 * x, 1]]), sp.psd([[x, 1], [1, x]])
    cone, none = sp.second_order(2, x), sp.second_order(x, 1)
    origin = Interval(np.zeros(2), np.zeros(2))
    for rows in ([good, bad], [cone, none], [good, none], [cone, bad]):
        for order in (rows, rows[::-1]):
            matrices = sp.Problem(x, order).matrices
            assert not hold_at(matrices, [Fraction(0), Fraction(0)])
            assert not hold_over(matrices, origin)
    both = sp.Problem(x, [good, cone]).matrices
    assert hold_at(both, [Fraction(0), Fraction(0)]) and hold_over(both, origin)
