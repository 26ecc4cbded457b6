"""Enclosures of polynomials against exact values in Fractions and derivatives by sympy."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from jacobians import dense_jacobian_range

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import (
    expand_affine,
    expand_exactly,
    range_over,
)

N = 3
SYMBOLS = sympy.symbols("x:3")

coefficients = st.one_of(st.floats(-5, 5), st.sampled_from([0.1, -1e8, 1e-9])).filter(bool)
powers = st.tuples(st.integers(0, 4), st.integers(0, 2), st.integers(0, 3))
tables = st.dictionaries(powers, coefficients, max_size=5)
systems = st.lists(tables, min_size=1, max_size=3)
ends = st.one_of(st.floats(-3, 3), st.sampled_from([0.0, 1.0, -1.0, 1e-12, 100.0]))
boxes = st.lists(st.tuples(ends, ends), min_size=N, max_size=N)
shares = st.lists(st.fractions(0, 1, max_denominator=9), min_size=N, max_size=N)


def stack(rows):
    polynomials = []
    for table in rows:
        exponents = np.array([*table, (0,) * N])
        values = [*table.values(), 0.0]
        polynomials.append(Polynomial.from_terms(exponents, values))
    return PolynomialSystem.stack(polynomials, N)


def interval_box(pairs):
    low = np.array([min(p) for p in pairs], float)
    high = np.array([max(p) for p in pairs], float)
    return Interval(low, high)


def point_in(box, weights):
    ends_ = zip(map(Fraction, box.lo.tolist()), map(Fraction, box.hi.tolist()), strict=True)
    return [a + t * (b - a) for (a, b), t in zip(ends_, weights, strict=True)]


def value_of(table, x):
    total = Fraction(0)
    for e, c in table.items():
        term = Fraction(c)
        for base, power in zip(x, e, strict=True):
            term *= base**power
        total += term
    return total


def inside(value, low, high):
    above = low == -np.inf or Fraction(float(low)) <= value
    return above and (high == np.inf or value <= Fraction(float(high)))


def holds(interval, value, index):
    return inside(value, interval.lo[index], interval.hi[index])


@given(systems, boxes, st.lists(shares, min_size=1, max_size=4))
@settings(max_examples=60, deadline=None)
def test_ranges_hold_the_exact_values_in_the_box(rows, pairs, weights):
    box = interval_box(pairs)
    found = range_over(stack(rows), box)
    for weight in weights:
        x = point_in(box, weight)
        for number, table in enumerate(rows):
            assert holds(found, value_of(table, x), number)


@given(tables.filter(bool), st.integers(0, N - 1), boxes, st.integers(-(10**6), 10**6))
@settings(max_examples=50, deadline=None)
def test_ranges_over_unbounded_boxes_hold_values_far_away(table, variable, pairs, far):
    box = interval_box(pairs)
    box.lo[variable], box.hi[variable] = -np.inf, np.inf
    x = point_in(interval_box(pairs), [Fraction(1, 3)] * N)
    x[variable] = Fraction(far)
    assert holds(range_over(stack([table]), box), value_of(table, x), 0)


def test_the_range_of_a_monomial_is_tight():
    x, y = sp.variables(2)
    system = PolynomialSystem.stack([x**2 * y, x * y**3, x**0 * 5.0], 2)
    found = range_over(system, Interval(np.array([-2.0, -1.0]), np.array([1.0, 3.0])))
    assert np.allclose(found.lo, [-4.0, -54.0, 5.0], rtol=1e-14)
    assert np.allclose(found.hi, [12.0, 27.0, 5.0], rtol=1e-14)


def test_the_range_of_the_zero_polynomial_is_zero():
    x, _ = sp.variables(2)
    found = range_over(PolynomialSystem.stack([x * 0.0], 2), Interval.point([1.0, 2.0]))
    assert found.lo.tolist() == found.hi.tolist() == [0.0]


@given(systems, boxes, shares)
@settings(max_examples=30, deadline=None)
def test_jacobian_ranges_hold_the_derivatives_of_sympy(rows, pairs, weights):
    box = interval_box(pairs)
    found = dense_jacobian_range(stack(rows), box)
    assert found.lo.shape == found.hi.shape == (len(rows), N)
    x = point_in(box, weights)
    for number, table in enumerate(rows):
        terms = (
            sympy.Rational(Fraction(c)) * sympy.prod(s**k for s, k in zip(SYMBOLS, e, strict=True))
            for e, c in table.items()
        )
        f = sympy.Add(*terms)
        for v, symbol in enumerate(SYMBOLS):
            slope = sympy.Poly(sympy.diff(f, symbol), *SYMBOLS)
            exact = value_of({e: Fraction(int(c.p), int(c.q)) for e, c in slope.terms()}, x)
            assert holds(found, exact, (number, v))


# ---- affine expansion --------------------------------------------------------------------

centres = st.lists(st.one_of(st.just(0.0), st.floats(-3, 3), st.just(1e6)), min_size=N, max_size=N)
scales = st.lists(
    st.one_of(st.sampled_from([0.0, 1.0, 0.5, 1e-3]), st.floats(0, 2)), min_size=N, max_size=N
)


def substituted(table, centre, scale):
    """Coefficients of p(centre + scale t) in Fractions, by the binomial theorem."""
    result = {}
    for e, value in table.items():
        partial = {(): Fraction(value)}
        for power, c, w in zip(e, map(Fraction, centre), map(Fraction, scale), strict=True):
            partial = {
                (*key, j): v * comb(power, j) * w**j * c ** (power - j)
                for key, v in partial.items()
                for j in range(power + 1)
            }
        for key, v in partial.items():
            result[key] = result.get(key, Fraction(0)) + v
    return {key: v for key, v in result.items() if v}


@pytest.mark.parametrize("expand", [expand_affine, expand_exactly])
@given(systems, centres, scales)
@settings(max_examples=80, deadline=None)
def test_expansion_holds_the_exact_coefficients(expand, rows, centre, scale):
    system = stack(rows)
    words, row, value = expand(system, np.array(centre), np.array(scale))
    letters = [tuple(np.bincount(w, minlength=N + 1)[1:].tolist()) for w in words]
    keys = list(zip(row.tolist(), letters, strict=True))
    assert len(set(keys)) == len(keys)
    assert row.tolist() == sorted(row.tolist())
    found = {key: k for k, key in enumerate(keys)}
    for number, table in enumerate(rows):
        expected = substituted(table, centre, scale)
        for letter, exact in expected.items():
            assert holds(value, exact, found[number, letter])
        for (r, letter), k in found.items():
            if r == number and letter not in expected:
                assert holds(value, Fraction(0), k)


@given(systems, centres, scales, st.integers(0, N - 1))
@settings(max_examples=40, deadline=None)
def test_fixed_variables_vanish(rows, centre, scale, fixed):
    scale[fixed] = 0.0
    words, _, _ = expand_affine(stack(rows), np.array(centre), np.array(scale))
    assert not np.any(words == fixed + 1)


@given(systems)
@settings(max_examples=30, deadline=None)
def test_the_identity_changes_nothing(rows):
    system = stack(rows)
    words, row, value = expand_affine(system, np.zeros(N), np.ones(N))
    assert np.array_equal(words, system.words)
    assert np.array_equal(row, system.row)
    assert np.array_equal(value.lo, system.coefficients)
    assert np.array_equal(value.hi, system.coefficients)


@given(systems, centres, scales)
@settings(max_examples=40, deadline=None)
def test_exact_expansions_are_the_tightest_doubles(rows, centre, scale):
    words, row, value = expand_exactly(stack(rows), np.array(centre), np.array(scale))
    for k, (w, number) in enumerate(zip(words, row.tolist(), strict=True)):
        letter = tuple(np.bincount(w, minlength=N + 1)[1:].tolist())
        exact = substituted(rows[number], centre, scale)[letter]
        assert holds(value, exact, k)
        assert value.lo[k] == value.hi[k] or value.hi[k] == np.nextafter(value.lo[k], np.inf)


def test_powers_of_a_far_centre_cancel_exactly():
    """(x - 100)^8 is t^8 about 100, where rounding leaves intervals of width 2 and more."""
    x = sp.variables(1)[0]
    system = PolynomialSystem.stack([(x - 100) ** 8], 1)
    words, _, value = expand_exactly(system, np.array([100.0]), np.array([2.0]))
    assert words.tolist() == [[1] * 8]
    assert value.lo.tolist() == value.hi.tolist() == [256.0]
    rounded = expand_affine(system, np.array([100.0]), np.array([2.0]))[2]
    assert rounded.width().max() > 2.0


def test_everything_fixed_leaves_the_value():
    x, y, z = sp.variables(3)
    system = PolynomialSystem.stack([x * y**2 + z, z - 3.0], 3)
    words, row, value = expand_affine(system, np.array([2.0, 0.5, 3.0]), np.zeros(3))
    assert not words.any()
    assert row.tolist()[0] == 0
    assert holds(value, Fraction(7, 2), 0)
    if row.size == 2:  # 3 - 3 may stay as an interval around zero
        assert holds(value, Fraction(0), 1)


@pytest.mark.parametrize("power", [31, 40, 64])
def test_binomials_beyond_the_doubles_are_enclosed(power):
    """C(64, 32) has no double: its enclosure must hold it nevertheless."""
    x = sp.variables(1)[0]
    system = PolynomialSystem.stack([x**power], 1)
    words, _, value = expand_affine(system, np.ones(1), np.ones(1))
    for k, degree in enumerate(np.count_nonzero(words, axis=1).tolist()):
        assert holds(value, Fraction(comb(power, degree)), k)
