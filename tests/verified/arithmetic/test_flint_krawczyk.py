"""Krawczyk's test: boxes hold a zero that FLINT encloses, and nothing is found where none is."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, fmpq, fmpq_mat
from flint_oracle import at_most, inside, rational, real
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.krawczyk import _left_over, zero_near

SEEDS = st.integers(0, 2**32 - 1)


def system_of(rows):
    return PolynomialSystem.stack(rows, rows[0].dimension)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 4), st.sampled_from([0, -20, 12]), st.floats(-16, -8.5))
def test_squares_coupled_linearly(seed, n, size, error):
    """A (v_1^2, ..., v_n^2)' = b: the squares are rationals, and arb takes their roots."""
    rng = np.random.default_rng(seed)
    v = sp.variables(n)
    matrix = rng.normal(size=(n, n)) + 3 * np.eye(n)
    start = np.ldexp(rng.uniform(0.5, 2, n) * rng.choice([-1, 1], n), size)
    right = matrix @ start**2
    rows = [
        sp.total([float(a) * s**2 for a, s in zip(line, v, strict=True)]) - float(b)
        for line, b in zip(matrix, right, strict=True)
    ]
    exact = fmpq_mat([[rational(a) for a in line] for line in matrix])
    squares = exact.solve(fmpq_mat([[rational(b)] for b in right]))
    near = start * (1 + 10.0**error * rng.uniform(-1, 1, n))
    box = zero_near(system_of(rows), near, np.arange(n))
    if box is None:
        assert np.ldexp(1.0, size) > 100 or error > -10  # else it must be found
        return
    for k in range(n):
        root = real(squares[k, 0]).sqrt() * (1 if start[k] > 0 else -1)
        assert inside(root, box.lo[k], box.hi[k])


@pytest.mark.parametrize("error", [0.0, 1e-12, 1e-9, -3e-9])
@pytest.mark.parametrize("bend", [1.0, 1e4, 1e6, -1e6])
def test_the_curvature_over_the_box_counts(bend, error):
    """v + bend v^2 = 0 has the zero 0; one Newton step from 1e-9 misses it by bend 1e-18."""
    (v,) = sp.variables(1)
    box = zero_near(system_of([v + bend * v**2]), np.array([error]), np.array([0]))
    assert box is None or box.lo[0] <= 0.0 <= box.hi[0]
    assert box is not None or abs(bend * error) > 1e-4


@pytest.mark.parametrize("gap", [1e-18, 1e-17, 3e-17, 1e-20])
@pytest.mark.parametrize("place", [1e-8, 3e-9, 2e-8, -1e-8])
def test_a_parabola_above_its_axis_has_no_zero(gap, place):
    """v^2 + gap > 0, although a Newton step from 1e-8 stays within 1e-8."""
    (v,) = sp.variables(1)
    assert zero_near(system_of([v**2 + gap]), np.array([place]), np.array([0])) is None


def test_every_coordinate_needs_its_zero():
    """The first equation has one, the second has none; in either order."""
    v, w = sp.variables(2)
    rows = [v - 1.0, w**2 + 1e-18]
    for order, x in ((rows, [1.0, 1e-8]), (rows[::-1], [1.0, 1e-8])):
        assert zero_near(system_of(order), np.array(x), np.array([0, 1])) is None
    mixed = [v - 1.0 + w, w**2 + 1e-18]
    assert zero_near(system_of(mixed), np.array([1.0, 1e-8]), np.array([0, 1])) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("distance", [1e-3, 3e-8, 1.3e-8])
def test_zeros_outside_every_box_are_not_claimed(distance, sign):
    """v = distance from 0 on either side: the largest box reaches 1e-8."""
    v, w = sp.variables(2)
    for rows, x in (([v - sign * distance], [0.0, 0.0]), ([v - w], [0.0, sign * distance])):
        box = zero_near(system_of(rows), np.array(x), np.array([0]))
        assert box is None or inside(real(sign * distance), box.lo[0], box.hi[0])


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_residuals_that_cancel_in_doubles_are_enclosed(seed):
    """v + a b - c = 0 with c = a b rounded: the zero is what rounding lost, about 1e-17."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(1, 2, 2)
    c = a * b
    v, s, t, u = sp.variables(4)
    x = np.array([0.0, a, b, c])
    box = zero_near(system_of([v + s * t - u]), x, np.array([0]))
    exact = rational(c) - rational(a) * rational(b)
    assert box is not None
    assert inside(real(exact), box.lo[0], box.hi[0])
    assert box.lo[1:].tolist() == box.hi[1:].tolist() == [a, b, c]


@pytest.mark.parametrize("power", [3, 5, 7])
@pytest.mark.parametrize("value", [2.0, 1e6, 1e-6, 7.0])
def test_roots_of_numbers(power, value):
    (v,) = sp.variables(1)
    near = value ** (1.0 / power)
    box = zero_near(system_of([v**power - value]), np.array([near]), np.array([0]))
    if box is not None:
        assert inside(real(value).root(power), box.lo[0], box.hi[0])
        assert box.hi[0] - box.lo[0] <= 1e-7 * (1 + near)
    assert box is not None or near < 0.2  # slopes are too small there


def test_a_zero_between_two_doubles():
    """v^2 = 2 has no zero among doubles: the box holds both neighbours of the root."""
    (v,) = sp.variables(1)
    root = arb(2).sqrt()
    low = float(np.sqrt(2.0))
    while real(low) > root:
        low = float(np.nextafter(low, 0.0))
    for start in (low, float(np.nextafter(low, 2.0)), low + 1e-10):
        box = zero_near(system_of([v**2 - 2.0]), np.array([start]), np.array([0]))
        assert inside(root, box.lo[0], box.hi[0])
        assert fmpq(2) <= rational(box.hi[0]) ** 2 and rational(box.lo[0]) ** 2 <= fmpq(2)


# ---- what a matrix leaves over -----------------------------------------------------------------


def left_over(matrix, inverse, reach):
    """The bound of |I - C M| d for linear rows, whose slopes are numbers."""
    v = sp.variables(len(matrix))
    rows = [
        sp.total([float(a) * x for a, x in zip(line, v, strict=True) if a] or [0.0 * v[0]])
        for line in matrix
    ]
    box = Interval.point(np.ones(len(matrix)))
    places = np.arange(len(matrix))
    with np.errstate(all="ignore"):
        return _left_over(
            system_of(rows), box, places, np.array(inverse, float), np.array(reach, float)
        )


def exact_rest(matrix, inverse, reach):
    """|I - C M| d in rationals."""
    n, c = len(matrix), [[rational(v) for v in line] for line in inverse]
    m = [[rational(v) for v in line] for line in matrix]
    entries = [
        [fmpq(i == j) - sum((c[i][k] * m[k][j] for k in range(n)), fmpq(0)) for j in range(n)]
        for i in range(n)
    ]
    return [
        sum((abs(e) * rational(d) for e, d in zip(line, reach, strict=True)), fmpq(0))
        for line in entries
    ]


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from([1, 2, 5, 45]), st.sampled_from([0, 3, 30]))
def test_what_is_left_over_holds_the_exact_value(seed, n, spread):
    """Banded matrices with an approximate inverse, dense ones and those that are kept sparse."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(n) + np.diag(rng.normal(size=n - 1), -1) * 0.7
    matrix = np.ldexp(matrix, rng.integers(-spread, spread + 1, n))
    inverse = np.linalg.inv(matrix)
    inverse += rng.choice([0.0, 1e-15, 1e-9]) * rng.normal(size=(n, n)) * np.abs(inverse)
    reach = rng.uniform(0.0, 1e-8, n)
    bound = left_over(matrix, inverse, reach)
    for found, exact in zip(bound, exact_rest(matrix, inverse, reach), strict=True):
        assert at_most(real(exact), float(found))


def test_products_of_inverses_keep_their_rounding():
    """3 * (1 / 3) is 1 in doubles and 1 - 2^-54 in truth."""
    (bound,) = left_over([[3.0]], [[1.0 / 3.0]], [1.0])
    assert 2.0**-54 <= bound <= 1e-14


def test_long_products_of_inverses_keep_their_rounding():
    """Sixty terms of 2^-53 beside 1 are lost, and sixty of 2^-1075 are zero in doubles."""
    n = 61
    matrix, inverse, reach = np.eye(n), np.eye(n), np.zeros(n)
    matrix[1:, 0], inverse[0, 1:], reach[0] = 2.0**-27, 2.0**-26, 1.0
    assert 60 * 2.0**-53 <= left_over(matrix, inverse, reach)[0] <= 1e-13
    matrix, inverse, reach = np.eye(n), np.eye(n), np.zeros(n)
    matrix[2:, 1], inverse[0, 2:], reach[1] = 2.0**-475, 2.0**-600, 2.0**250
    assert 59 * 2.0**-825 <= left_over(matrix, inverse, reach)[0] <= 2.0**-700


@pytest.mark.parametrize("n", [1, 50])
def test_slopes_count_over_the_whole_box(n):
    """v^2 over [0, 2] has slopes in [0, 4]: with C = -1/2 they leave 3 d at the most, and 1 d."""
    v = sp.variables(n)
    box = Interval(np.zeros(n), np.full(n, 2.0))
    bound = _left_over(
        system_of([x**2 for x in v]), box, np.arange(n), -0.5 * np.eye(n), np.ones(n)
    )
    assert np.all((bound >= 3.0) & (bound <= 3.0 + 1e-12))


def test_long_chains_of_equations_have_a_zero():
    """v_k^2 = v_(k-1) from 2 on: v_k = 2^(1 / 2^k), enclosed in any precision by arb."""
    n = 60
    v = sp.variables(n)
    rows = [v[0] ** 2 - 2.0, *(v[k] ** 2 - v[k - 1] for k in range(1, n))]
    near = 2.0 ** (0.5 ** np.arange(1.0, n + 1))
    box = zero_near(system_of(rows), near, np.arange(n))
    root = arb(2)
    for low, high in zip(box.lo, box.hi, strict=True):
        root = root.sqrt()
        assert inside(root, low, high)
    wrong = near.copy()
    wrong[30] += 1e-6
    assert zero_near(system_of(rows), wrong, np.arange(n)) is None


@pytest.mark.parametrize("n", [2, 50])
def test_dependent_equations_have_no_proved_zero(n):
    """Two equal rows: there are zeros, but no box around one that has a single one."""
    v = sp.variables(n)
    rows = [v[0] - v[1], *(v[k] - 1.0 for k in range(2, n)), v[0] - v[1]]
    assert zero_near(system_of(rows), np.ones(n), np.arange(n)) is None
