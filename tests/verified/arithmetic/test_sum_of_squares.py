"""Objectives as a constant and weighted squares: the identity holds exactly or not at all."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import plus, times
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.sum_of_squares import constant_above

SEEDS = st.integers(0, 2**32 - 1)
x, y = sp.variables(2)


def table(polynomial):
    """The polynomial as a dictionary of rationals."""
    words, values = polynomial.words.tolist(), polynomial.coefficients.tolist()
    return {tuple(v for v in w if v): Fraction(c) for w, c in zip(words, values, strict=True) if c}


def rest_of(objective, squares):
    """objective - sum weight * p^2, in rationals."""
    rest = table(objective)
    for weight, p in squares:
        rest = plus(rest, times(table(p), table(p)), -Fraction(weight))
    return {word: value for word, value in rest.items() if value}


def polynomial_of(values):
    """The polynomial of a dictionary of rationals that are doubles."""
    parts = [0.0 * x]
    for word, value in values.items():
        assert Fraction(float(value)) == value
        term = float(value) + 0.0 * x
        for letter in word:
            term = term * (x, y)[letter - 1]
        parts.append(term)
    return sp.total(parts)


def some_squares(rng, size):
    terms = [1.0 + 0.0 * x, x, y, x * y, x**2]
    squares = []
    for _ in range(int(rng.integers(1, 5))):
        chosen = rng.choice(5, int(rng.integers(1, 4)), replace=False)
        p = sp.total(float(rng.integers(-9, 10)) * 2.0 ** float(size) * terms[k] for k in chosen)
        squares.append((float(rng.integers(0, 9)) / 4, p))
    return squares


@given(SEEDS, st.sampled_from([0, -3, 20, -300, 150]))
@settings(max_examples=80, deadline=None)
def test_the_constant_is_what_the_squares_leave(seed, size):
    """Numbers with few digits, whose sums are doubles, of all sizes."""
    rng = np.random.default_rng(seed)
    squares = some_squares(rng, size)
    constant = Fraction(int(rng.integers(-99, 100)), 8)
    given_ = {k: -v for k, v in rest_of(0.0 * x, squares).items()}
    given_[()] = given_.get((), Fraction(0)) + constant
    if Fraction(float(given_[()])) != given_[()]:
        return
    objective = polynomial_of(given_)
    assert constant_above(objective, squares) == constant


@given(SEEDS, st.sampled_from([0, -3, 20, 26]))
@settings(max_examples=80, deadline=None)
def test_a_last_digit_in_any_monomial_breaks_the_identity(seed, size):
    rng = np.random.default_rng(seed)
    squares = some_squares(rng, size)
    exact = {k: -v for k, v in rest_of(0.0 * x, squares).items()}
    objective = polynomial_of({k: v for k, v in exact.items() if float(v) == v})
    whole = not rest_of(objective, squares)
    assert (constant_above(objective, squares) is not None) == whole
    for word in exact:
        if word and whole:
            moved = dict(exact)
            moved[word] = Fraction(float(np.nextafter(float(exact[word]), np.inf)))
            assert constant_above(polynomial_of(moved), squares) is None


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_rounded_products_are_no_identity(seed):
    """Coefficients with all their digits: the nearest doubles of the products are not them."""
    rng = np.random.default_rng(seed)
    p = sp.total(float(c) * t for c, t in zip(rng.normal(size=3), (x, y, x * y), strict=True))
    objective = p * p + 1.0
    squares = [(1.0, p)]
    rest = rest_of(objective, squares)
    assert (constant_above(objective, squares) is None) == any(word for word in rest)


def test_integers_beyond_the_doubles_are_not_rounded():
    """(2^27 + 1)^2 = 2^54 + 2^28 + 1 is no double; its neighbour is not the square."""
    odd = 2.0**27 + 1.0
    assert odd * odd == 2.0**54 + 2.0**28
    assert constant_above(odd * odd * x**2 + 7.0, [(1.0, odd * x)]) is None


@pytest.mark.parametrize("count", [4096, 2048, 1])
def test_sums_beyond_64_bits_do_not_wrap(count):
    """4096 squares (2^26 x)^2 are 2^64 x^2, which is 0 modulo 2^64."""
    squares = [(1.0, 2.0**26 * x)] * count
    assert constant_above(0.0 * x + 5.0, squares) is None
    assert constant_above(float(count) * 2.0**52 * x**2 + 5.0, squares) == 5.0


@pytest.mark.parametrize("weight, factor", [(0.25, 1.0), (0.5, 0.5), (1.0, 0.25), (2.0**-40, 1.0)])
def test_small_squares_are_not_lost(weight, factor):
    assert constant_above(0.0 * x + 3.0, [(weight, factor * x)]) is None
    assert constant_above(weight * factor**2 * x**2 + 3.0, [(weight, factor * x)]) == 3.0


def test_a_constant_that_is_no_double_is_rounded_down():
    """1/3 of doubles: 1 - (1 + 2^-52)^2 = -2^-51 - 2^-104."""
    near = 1.0 + 2.0**-52
    p = near + 0.0 * x
    exact = 1 - Fraction(near) ** 2
    found = constant_above(1.0 + 0.0 * x, [(1.0, p)])
    assert Fraction(found) <= exact < Fraction(float(np.nextafter(found, 1.0)))
    assert Fraction(found) != exact


def test_without_squares_of_a_constant_nothing_is_subtracted():
    assert constant_above(x**2 + 2.0, [(1.0, x)]) == 2.0
    assert constant_above(x**2 + 2.0, [(0.0, y), (1.0, x)]) == 2.0
    assert constant_above(x**2 + y + 2.0, [(1.0, x)]) is None
