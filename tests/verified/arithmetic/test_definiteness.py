"""Semidefinite or not: floating-point proofs and rational decisions against exact minors."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_matrices import exactly_semidefinite, holds, random_problem

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.definiteness import (
    hold_at,
    hold_over,
    is_semidefinite,
    surely_semidefinite,
)
from sparsepop_py.verified.arithmetic.interval import Interval

SEEDS = st.integers(0, 2**32 - 1)


def rational(matrix):
    return [[Fraction(float(v)) for v in row] for row in matrix]


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 4), st.integers(1, 4))
def test_small_integers_against_all_principal_minors(seed, side, rank):
    """Matrices B B' of every rank, whole or with one entry changed by one."""
    rng = np.random.default_rng(seed)
    factor = rng.integers(-3, 4, (side, rank))
    matrix = factor @ factor.T
    i, j = rng.integers(0, side, 2)
    for change in (0, -1, 1):
        changed = matrix.copy()
        changed[i, j] += change
        changed[j, i] = changed[i, j]
        expected = exactly_semidefinite(rational(changed))
        assert is_semidefinite(rational(changed)) == expected
        assert expected or not surely_semidefinite(Interval.point(changed.astype(float)))
    assert is_semidefinite(rational(matrix))


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(2, 5))
def test_an_interval_matrix_is_judged_by_its_worst_member(seed, side):
    """Radii up to the least eigenvalue / side pass; the worst corner refutes larger ones."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(side, side))
    matrix = factor @ factor.T + np.eye(side)
    size, vectors = np.linalg.eigh(matrix)
    small = 0.2 * size[0] / side**2
    assert surely_semidefinite(Interval(matrix - small, matrix + small))
    large = 1.01 * size[0] / np.abs(vectors[:, 0]).sum() ** 2
    assert not surely_semidefinite(Interval(matrix - large, matrix + large))


def test_a_last_digit_decides():
    """[1 a; a b] with a = 1 + 2^-52 needs b >= a^2, which is no double."""
    a = 1.0 + 2.0**-52
    low, high = a * a, float(np.nextafter(a * a, 2.0))
    assert Fraction(low) < Fraction(a) ** 2 < Fraction(high)
    assert not is_semidefinite(rational([[1.0, a], [a, low]]))
    assert is_semidefinite(rational([[1.0, a], [a, high]]))


def test_what_is_no_number_is_not_semidefinite():
    for bad in (np.nan, np.inf):
        matrix = np.array([[1.0, 0.0], [0.0, bad]])
        assert not surely_semidefinite(Interval.point(matrix))
    unbounded = Interval(np.array([[-np.inf]]), np.array([[np.inf]]))
    assert not surely_semidefinite(unbounded)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_points_and_boxes_of_problems(seed):
    """At points the answer is that of the minors; a box passes only if its corners do."""
    problem = random_problem(seed)
    rng = np.random.default_rng(seed)
    for centre in rng.integers(-8, 9, (5, 2)) / 8:
        x = [Fraction(v) for v in centre.tolist()]
        expected = holds(problem.constraints[0], x)
        assert hold_at(problem.matrices, x) == expected
        radius = float(rng.choice([0.0, 1e-3, 0.1]))
        if hold_over(problem.matrices, Interval(centre - radius, centre + radius)):
            for corner in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 0)):
                moved = [v + Fraction(radius) * s for v, s in zip(x, corner, strict=True)]
                assert holds(problem.constraints[0], moved)


def test_boxes_inside_a_cone_pass():
    """|(x, y)| <= 2 holds over [1, 1.4]^2, whose corner has norm 1.98, not over [1, 1.42]^2."""
    x, y = sp.variables(2)
    matrices = sp.Problem(x, [sp.second_order(2, x, y)]).matrices
    assert hold_over(matrices, Interval(np.ones(2), np.full(2, 1.4)))
    assert not hold_over(matrices, Interval(np.ones(2), np.full(2, 1.42)))
    half = sp.Problem(x, [sp.psd([[x, y], [y, 1]])]).matrices
    assert hold_over(half, Interval(np.array([1.5, -0.4]), np.array([2.0, 0.4])))
    assert not hold_over(half, Interval(np.array([0.15, -0.4]), np.array([2.0, 0.4])))


@pytest.mark.parametrize("axis", [-5.0, -0.1])
def test_the_other_half_of_a_cone_is_not_in_it(axis):
    """f1^2 >= |f|^2 holds for f1 = -5 and f = (3, 4), and f1 >= 0 does not."""
    x, y = sp.variables(2)
    matrices = sp.Problem(x, [sp.second_order(axis, 0.01 * x, 0.01 * y)]).matrices
    assert not hold_at(matrices, [Fraction(0), Fraction(0)])
    assert not hold_over(matrices, Interval(np.zeros(2), np.zeros(2)))
