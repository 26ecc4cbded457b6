"""Triangular systems solved row by row: enclosures hold the rational solution."""

from __future__ import annotations

from fractions import Fraction
from math import inf, nextafter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic import substitution
from sparsepop_py.verified.arithmetic.substitution import substituted


def system(problem: sp.Problem):
    return problem.rows


def holds(box, variable: int, value: Fraction) -> bool:
    return Fraction(float(box.lo[variable])) <= value <= Fraction(float(box.hi[variable]))


def recursion(count: int, slopes: tuple[float, ...], drive: np.ndarray) -> sp.Problem:
    """x_k = sum_i slopes[i] x_{k-1-i} + drive[k], as rows."""
    x = sp.variables(count)
    rows = []
    for k in range(count):
        past = sum(a * x[k - 1 - i] for i, a in enumerate(slopes) if k - 1 - i >= 0)
        rows.append(x[k] - past - float(drive[k]) == 0)
    return sp.Problem(x[0], rows)


def solved_in_rationals(slopes, drive) -> list[Fraction]:
    found: list[Fraction] = []
    for k, value in enumerate(drive):
        past = [Fraction(a) * found[k - 1 - i] for i, a in enumerate(slopes) if k - 1 - i >= 0]
        found.append(Fraction(value) + sum(past, Fraction(0)))
    return found


@pytest.mark.parametrize("slopes", [(1.5, -0.7), (0.9, 0.0, -0.3), (-2.0, -1.0), (1.1,)])
def test_enclosures_hold_the_solution_of_a_recursion(slopes):
    drive = np.random.default_rng(0).uniform(-1, 1, 60)
    box = substituted(system(recursion(60, slopes, drive)), np.zeros(60), np.arange(60))
    exact = solved_in_rationals(slopes, drive)
    assert all(holds(box, k, exact[k]) for k in range(60))
    assert np.all(box.hi - box.lo <= 4e-16 * (1 + np.abs(box.hi)))


def test_a_recursion_longer_than_its_first_bits_stays_narrow():
    """Intervals of x_k = 1.5 x_{k-1} - .7 x_{k-2} widen by 1.87 a row: 270 bits in 300 rows."""
    drive = np.random.default_rng(1).uniform(-1, 1, 400)
    box = substituted(system(recursion(400, (1.5, -0.7), drive)), np.zeros(400), np.arange(400))
    exact = solved_in_rationals((1.5, -0.7), drive)
    assert holds(box, 399, exact[399])
    assert np.all(box.hi - box.lo <= 4e-16 * (1 + np.abs(box.hi)))


def test_ends_keep_the_bits_that_their_width_leaves_a_meaning():
    """Each row of x_k = 3 x_{k-1} - x_{k-2} + d_k widens by 2.62 or more, 1.39 bits; 3 x_0 = 1.

    The last rows are products of an early and a late variable, in both orders.
    """
    slopes, drive = (3.0, -1.0), [Fraction(1, 3), *map(Fraction, range(-20, 277))]
    x = sp.variables(300)
    rows = [3 * x[0] == 1, x[1] - 3 * x[0] == float(drive[1])]
    rows += [x[k] - 3 * x[k - 1] + x[k - 2] == float(drive[k]) for k in range(2, 298)]
    rows += [x[298] == x[0] * x[297] - x[1], (x[297] + x[0]) * x[299] == x[290]]
    place = np.arange(-1, 300).tolist()
    terms = substitution._terms(system(sp.Problem(x[0], rows)), np.zeros(300), place, 0)
    found, exact = substitution._enclosures([], terms, 600), solved_in_rationals(slopes, drive)
    exact += [exact[0] * exact[297] - exact[1], exact[290] / (exact[297] + exact[0])]
    assert len(found) == 300
    for (low, high, bits), value in zip(found, exact, strict=True):
        assert low <= value * Fraction(2) ** bits <= high
        assert high - low < 2**35  # 32 bits, and what rounding and the last row add
    assert found[0].bits == 600
    assert found[297].bits < 600 - 1.3 * 250


@given(st.integers(-(2**90), 2**90), st.integers(0, 2**80), st.integers(0, 200))
@example(1, 2**33 - 1, 100)
def test_rounded_ends_lie_outside(low, width, bits):
    found, high = substitution._rounded(low, low + width, bits), low + width
    unit = 1 << bits - found.bits
    assert unit * found.low <= low
    assert high <= unit * found.high
    assert found.high - found.low <= min(width, 2**32 + 1)


def test_squares_and_quotients_of_earlier_variables():
    """3 v = 1, (v + 2) w = v^2 + y: v = 1/3, w = (1/9 + y) / (7/3) for the y that is kept."""
    v, w, y = sp.variables(3)
    problem = sp.Problem(v, [3 * v == 1, (v + 2) * w == v**2 + y])
    for kept in (0.75, -0.75):
        x = np.array([9.0, 9.0, kept])
        box = substituted(system(problem), x, np.array([0, 1]))
        assert holds(box, 0, Fraction(1, 3))
        assert holds(box, 1, (Fraction(1, 9) + Fraction(kept)) / Fraction(7, 3))
        assert box.lo[2] == box.hi[2] == kept
        assert np.all(box.hi - box.lo <= 1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slopes_and_values_of_both_signs(sign):
    """-(v + 2) w = 5 v with v = s/3: w = -5 v / (v + 2)."""
    v, w = sp.variables(2)
    problem = sp.Problem(v, [3 * v == sign, -(v + 2) * w == 5 * v])
    box = substituted(system(problem), np.zeros(2), np.array([0, 1]))
    third = Fraction(int(sign), 3)
    assert holds(box, 1, -5 * third / (third + 2))
    assert box.hi[1] - box.lo[1] <= 1e-15


def test_systems_that_are_not_triangular_prove_nothing():
    v, w = sp.variables(2)
    both = np.array([0, 1])
    for rows in (
        [v * w == 2, w == 2],  # a later variable, in a product
        [v**2 == 1, w == 2],  # not linear
        [v + w == 1, v + w == 2],  # no solution
        [v + w == 1, 2 * v + 2 * w == 2],  # more than one
        [w == 1, w + 0 * v == 2],  # a variable that no row has
        [v == 0, v * w == 1],  # a slope that is zero
        [v == 0, v * w == 0],
        [3 * v == 1, (3 * v - 1) * w == 0],  # zero, and enclosed by an interval around it
    ):
        assert substituted(system(sp.Problem(v, rows)), np.zeros(2), both) is None


@pytest.mark.parametrize("kept", [0.5, -0.75])
def test_first_rows_are_solved_together(kept):
    """v + y w = 1 and w + y v = 2 have v = (1 - 2 y) / (1 - y^2) and w = (2 - y) / (1 - y^2)."""
    v, w, z, y = sp.variables(4)
    rows = [v + y * w == 1, w + y * v == 2, (w + 3) * z == v - y]
    box = substituted(system(sp.Problem(v, rows)), np.array([9.0, 9.0, 9.0, kept]), np.arange(3))
    a = Fraction(kept)
    exact = [(1 - 2 * a) / (1 - a**2), (2 - a) / (1 - a**2)]
    exact.append((exact[0] - a) / (exact[1] + 3))
    assert all(holds(box, k, exact[k]) for k in range(3))
    assert np.all(box.hi - box.lo <= 1e-15)
    assert box.lo[3] == box.hi[3] == kept
    turned = [rows[1], rows[0], rows[2]]
    again = substituted(system(sp.Problem(v, turned)), np.array([0.0, 0, 0, kept]), np.arange(3))
    assert np.array_equal(again.lo, box.lo) and np.array_equal(again.hi, box.hi)


def test_blocks_follow_each_other():
    """p + q = 1 and p - q = s, then q r = 1 + t and t + r = 0: each block is linear, not all."""
    p, q, r, t, s = sp.variables(5)
    rows = [p + q == 1, p - q == s, q * r == 1 + t, t + r == 0]
    kept = np.array([0.0, 0.0, 0.0, 0.0, 0.3])
    box = substituted(system(sp.Problem(p, rows)), kept, np.arange(4))
    a = Fraction(0.3)
    third = 1 / ((1 - a) / 2 + 1)
    assert all(holds(box, k, v) for k, v in enumerate([(1 + a) / 2, (1 - a) / 2, third, -third]))
    order = [rows[0], rows[2], rows[1], rows[3]]  # one block, in which q r is a product
    assert substituted(system(sp.Problem(p, order)), kept, np.array([0, 2, 1, 3])) is None


def test_first_rows_are_enclosed_by_few_bits(monkeypatch):
    """Two thirds lies between 10 and 11 sixteenths, one third between 5 and 6."""
    few_bits(monkeypatch, 4)
    v, w = sp.variables(2)
    rows = system(sp.Problem(v, [v + w == 1, v - 2 * w == 0]))
    box = substituted(rows, np.zeros(2), np.array([0, 1]))
    assert (16 * box.lo).tolist() == [10, 5] and (16 * box.hi).tolist() == [11, 6]


def test_a_wrong_solution_of_the_first_rows_proves_nothing(monkeypatch):
    v, w = sp.variables(2)
    rows = system(sp.Problem(v, [v + w == 1, v - w == 3]))
    both = np.array([0, 1])
    assert holds(substituted(rows, np.zeros(2), both), 0, Fraction(2))
    for wrong in ((2, 3), (1, 0)):  # each satisfies one row
        found = dict(enumerate(map(Fraction, wrong)))
        monkeypatch.setattr(substitution, "solve_rationally", lambda *_, found=found: found)
        assert substituted(rows, np.zeros(2), both) is None


def test_sizes_that_doubles_hardly_hold():
    v, w = sp.variables(2)
    problem = sp.Problem(v, [3 * v == 1e300, 3e300 * w == 1.0])
    box = substituted(system(problem), np.zeros(2), np.array([0, 1]))
    assert holds(box, 0, Fraction(1e300) / 3)
    assert holds(box, 1, 1 / Fraction(3e300))


def test_growth_beyond_all_bits_proves_nothing():
    """3 x_0 = 1, x_k = 2^20 x_{k-1}: 20 bits a row, more than there are in 3 500 rows."""
    count = 3500
    x = sp.variables(count)
    rows = [3 * x[0] == 1, *(x[k] - 2.0**20 * x[k - 1] == 0 for k in range(1, count))]
    problem = sp.Problem(x[0], rows)
    assert substituted(system(problem), np.zeros(count), np.arange(count)) is None


def few_bits(monkeypatch, bits: int) -> None:
    for name in ("_BITS", "_MOST_BITS"):
        monkeypatch.setattr(substitution, name, bits)


def random_triangle(rng) -> tuple[sp.Problem, np.ndarray, list[Fraction]]:
    """Rows (a + b v_j + c v_j v_k + x) v_i = d v_j + e v_j v_k v_l + f, and their solution."""
    count = 5
    v = sp.variables(count + 1)
    kept, exact, rows = Fraction(float(np.round(rng.uniform(-1, 1), 2))), [], []
    for i in range(count):
        a, b, c, d, e, f = np.round(rng.uniform(-1, 1, 6), 2).tolist()
        a += 4.0 if rng.uniform() < 0.5 else -4.0
        j, k, m = rng.integers(0, max(i, 1), 3).tolist()
        if not i:
            b = c = d = e = 0.0
        slope, right = a + v[count], f + 0 * v[i]
        below, value = Fraction(a) + kept, Fraction(f)
        if i:
            slope, right = slope + b * v[j] + c * v[j] * v[k], right + d * v[j]
            right = right + e * v[j] * v[k] * v[m]
            below += Fraction(b) * exact[j] + Fraction(c) * exact[j] * exact[k]
            value += Fraction(d) * exact[j] + Fraction(e) * exact[j] * exact[k] * exact[m]
        rows.append(slope * v[i] == right)
        exact.append(value / below)
    return sp.Problem(v[0], rows), np.append(np.zeros(count), float(kept)), exact


@pytest.mark.parametrize("bits", slow_after(2, [4, 12, 7]))
def test_enclosures_of_few_bits_hold_the_solution(monkeypatch, bits):
    """With few bits each rounding moves an end by much of the width."""
    few_bits(monkeypatch, bits)
    monkeypatch.setattr(substitution, "_NARROW", -100)
    rng, wide = np.random.default_rng(bits), 0
    for _ in range(150):
        problem, x, exact = random_triangle(rng)
        box = substituted(system(problem), x, np.arange(5))
        if box is not None:
            assert all(holds(box, k, exact[k]) for k in range(5))
            wide += box.hi[4] - box.lo[4] > 2.0**-bits
    assert wide > 20


@pytest.mark.parametrize("sign", [1, -1])
def test_products_of_wide_enclosures_of_both_signs(monkeypatch, sign):
    """With 4 bits 1024/3 lies in [320, 384]; minus its square is less than -320 * 384."""
    few_bits(monkeypatch, 4)
    monkeypatch.setattr(substitution, "_NARROW", -100)
    t, v, w, z = sp.variables(4)
    rows = [3 * t == 1, v == 1024 * t, w == sign * 1024 * t, z == v * w]
    box = substituted(system(sp.Problem(t, rows)), np.zeros(4), np.arange(4))
    assert (box.lo[1], box.hi[1]) == (320.0, 384.0)
    assert holds(box, 3, sign * Fraction(1024, 3) ** 2)


@given(st.integers(-(2**1400), 2**1400), st.integers(0, 2600))
@example(2**54 + 1, 0)
@example(-(2**54) - 1, 0)
@example(3, 1075)  # between two subnormal doubles
@example(-3, 1075)
@example(2**1024, 0)
@example(-(2**1024), 0)
def test_ends_become_the_largest_double_below_them(value, bits):
    found, exact = substitution._double_below(value, bits), Fraction(value, 1 << bits)
    above = nextafter(found, inf)
    assert found < inf and (found == -inf or Fraction(found) <= exact)
    assert above == inf or Fraction(above) > exact
