"""Proved balls around minimisers: no rounding on the way to the problem may cut points off."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.compat.error_bounds import error_bounds
from sparsepop_py.verified.arithmetic.interval import exact_values

SIZES = st.sampled_from([1e-9, 1.0, 1e8, 1e16])


def exact(polynomial, x):
    """The value of a polynomial in rationals."""
    row = np.zeros(polynomial.terms, int)
    return exact_values(polynomial.words, polynomial.coefficients, row, 1, x)[0]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), SIZES, SIZES)
@pytest.mark.slow
def test_the_problem_of_a_ball_contains_all_points_below_the_cutoff(seed, far, high):
    """level - f >= its row, and -|x - c|^2 >= its objective, in rationals."""
    rng = np.random.default_rng(seed)
    centre = far * rng.uniform(-1, 1, 2)
    x, y = sp.variables(2)
    f = float(high * rng.uniform(-1, 1)) + x - 3 * y
    level = float(rng.uniform(-1, 1))
    point = [Fraction(float(v)) for v in centre + rng.uniform(-1, 1, 2)]
    problem = sp.Problem(f, lower=centre - 1, upper=centre + 1)
    [ball] = error_bounds(problem, centre, level, [[0, 1]], sp.Options(order=1))
    row = ball.problem.constraints[-1].polynomial
    assert exact(row, point) >= Fraction(level) - exact(f, point)
    squared = sum((p - Fraction(float(c))) ** 2 for p, c in zip(point, centre, strict=True))
    assert exact(ball.problem.objective, point) <= -squared
