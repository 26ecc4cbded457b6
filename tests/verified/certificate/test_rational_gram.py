"""Exact Gram matrices: against minima that FLINT gives in rationals, and against forgeries."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq_mat
from flint_oracle import fraction, rational
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.verified.certificate.rational_gram import ExactGram

INF = np.inf
SEEDS = st.integers(0, 2**32 - 1)


def gram_of(basis, entries):
    """Entries as (i, j): value; the first of each monomial takes what the others leave."""
    words = np.array(basis, np.int32)
    first, second = np.array(list(entries), int).reshape(-1, 2).T
    return ExactGram(words, first, second, np.array(list(entries.values()), float))


@settings(max_examples=80, deadline=None)
@given(SEEDS, st.integers(1, 5))
def test_convex_quadratics_have_their_minimum_in_rationals(seed, n):
    """c + 2 q' x + x' A x: the minimum is c - q' A^-1 q where A is definite."""
    rng = np.random.default_rng(seed)
    matrix = np.round(8 * rng.normal(size=(n, n))) / 8
    matrix = matrix + matrix.T + rng.integers(0, 3 * n) * np.eye(n)
    q, c = np.round(8 * rng.normal(size=n)) / 8, float(rng.integers(-9, 9)) / 3
    x = sp.variables(n)
    parts = [c + 0 * x[0]] + [2 * float(v) * u for v, u in zip(q, x, strict=True)]
    parts += [float(matrix[i, j]) * x[i] * x[j] for i in range(n) for j in range(n)]
    basis = np.arange(n + 1, dtype=np.int32)[:, None]
    first, second = np.triu_indices(n + 1)
    found = ExactGram(basis, first, second, np.zeros(first.size)).bound(sp.total(parts))
    exact = fmpq_mat([[rational(v) for v in row] for row in matrix])
    signs = [c_ * (-1) ** k for k, c_ in enumerate(reversed(exact.charpoly().coeffs()))]
    if min(signs) < 0:
        assert found == -INF
    elif exact.det() != 0:
        vector = fmpq_mat([[rational(v)] for v in q])
        least = fraction(rational(c) - (vector.transpose() * exact.solve(vector))[0, 0])
        assert Fraction(found) <= least < Fraction(float(np.nextafter(found, INF)))


@pytest.mark.parametrize("third", [1 / 3, 0.1, 2.0**-60 / 3])
def test_minima_that_are_no_doubles_are_rounded_down(third):
    """(x - a)^2 - a^2 with a double a: its minimum -a^2 is no double."""
    (x,) = sp.variables(1)
    gram = gram_of([[0], [1]], {(0, 1): 0.0, (1, 1): 0.0})
    exact = -(Fraction(third) ** 2)
    found = gram.bound(x * x - 2 * third * x)
    assert Fraction(found) < exact < Fraction(float(np.nextafter(found, INF)))


def test_the_monomials_of_long_bases_share_their_coefficients():
    """x^2 y^2 is (x y)(x y) and (x^2)(y^2): what one entry takes the other leaves, twice."""
    x, y = sp.variables(2)
    f = x**4 + y**4 + 2 * x**2 * y**2  # (x^2 + y^2)^2
    basis = [[0, 0], [1, 1], [1, 2], [2, 2]]
    for value, holds in ((0.0, True), (1.0, True), (-1.0, True), (1.25, False), (-1.25, False)):
        entries = {(2, 2): 0.0, (1, 3): value, (1, 1): 0.0, (3, 3): 0.0}
        # Q(xy, xy) = 2 - 2 value >= 0 and |value| <= 1
        assert (gram_of(basis, entries).bound(f) == 0.0) == holds
    entries = {(1, 3): 0.0, (2, 2): 4.0, (1, 1): 0.0, (3, 3): 0.0}  # Q(x^2, y^2) = 1 - 2
    assert gram_of(basis, entries).bound(f) == 0.0
    entries = {(1, 3): 0.0, (2, 2): 4.5, (1, 1): 0.0, (3, 3): 0.0}  # 1 - 9/4 < -1
    assert gram_of(basis, entries).bound(f) == -INF


@pytest.mark.parametrize("above", [1e-9, 1.0, 100.0])
def test_negative_forms_are_no_squares(above):
    x, y = sp.variables(2)
    basis, entries = [[0], [1], [2]], {(1, 1): 0.0, (1, 2): 0.0, (2, 2): 0.0}
    assert gram_of(basis, entries).bound(x * x + y * y + 2 * x * y + 3) == 3.0
    for f in (
        -above * x * x + y * y,
        x * x - above * y * y,
        x * x + y * y + (2 + above) * x * y,
        -above * x * x - y * y,
        0 * x * x + above * x * y,
    ):
        assert gram_of(basis, entries).bound(f) == -INF


def test_linear_terms_need_their_squares():
    """x alone, x with y^2 and x + y^2 + x^2 / 4: only the last is bounded."""
    x, y = sp.variables(2)
    basis = [[0], [1], [2]]
    entries = {(0, 1): 0.0, (0, 2): 0.0, (1, 1): 0.0, (1, 2): 0.0, (2, 2): 0.0}
    gram = gram_of(basis, entries)
    assert gram.bound(x + 0 * y) == -INF
    assert gram.bound(x + y * y) == -INF
    assert gram.bound(x + y * y + 0.25 * x * x + 7) == 6.0
    assert gram.bound(x * y) == -INF


def test_monomials_that_no_entry_makes_are_refused():
    x, y = sp.variables(2)
    gram = gram_of([[0], [1]], {(1, 1): 0.0})
    assert gram.bound(x * x + 0 * y) == 0.0
    for f in (x * x + y, x * x + x, x * x - y * y, x * x + 1e-300 * x**3):
        assert gram.bound(f) == -INF
    assert gram_of([[0], [1]], {(0, 1): 0.0, (1, 1): 0.0}).bound(x * x + y * y) == -INF


def test_all_of_the_constant_stands_in_front():
    """x^2 + 2 x has the minimum -1; a second constant with a square of its own would give 0."""
    (x,) = sp.variables(1)
    f = x * x + 2 * x
    basis, words = [[0], [0], [1]], np.array([[0], [0], [1]], np.int32)
    first, second = np.array([0, 1, 1, 1, 2]), np.array([2, 1, 1, 2, 2])
    for order in (slice(None), slice(None, None, -1)):
        values = np.array([0.0, 0.0, 1.0, 1.0, 0.0])[order]
        assert ExactGram(words, first[order], second[order], values).bound(f) <= -1.0
    assert gram_of(basis[:2], {(0, 1): 0.0, (1, 1): 0.0}).bound(0 * x + 3) <= 3.0


def test_the_first_monomial_is_the_constant():
    """-x^2 would hide in the row that is not eliminated."""
    x, y = sp.variables(2)
    for basis in ([[1], [2]], [[1]], [[1], [0]], [[1, 1], [0, 1]]):
        for entries in ({(0, 0): 0.0}, {(0, 0): 0.0, (len(basis) - 1,) * 2: 0.0}):
            assert gram_of(basis, entries).bound(-1.0 * x * x + 0 * y) == -INF


MALFORMED = {
    "basis flat": {"basis": np.zeros(3, np.int32)},
    "basis empty": {"basis": np.zeros((0, 1), np.int32)},
    "basis of empty words": {"basis": np.zeros((3, 0), np.int32)},
    "basis of unknown variables": {"basis": np.array([[0], [1], [3]], np.int32)},
    "basis of negative variables": {"basis": np.array([[0], [1], [-2]], np.int32)},
    "basis of bytes": {"basis": np.array([[0], [1], [2]], np.int8)},
    "entries beyond": {"second": np.array([1, 2, 3])},
    "entries before": {"first": np.array([1, 1, -1])},
    "entries before, second": {"second": np.array([1, 2, -1])},
    "entries of floats": {"first": np.array([1.0, 1.0, 2.0])},
    "entries in rows": {"first": np.zeros((3, 1), int)},
    "values missing": {"value": np.zeros(2)},
    "values none": {"value": np.array([0.0, np.nan, 0.0])},
    "values infinite": {"value": np.array([0.0, INF, 0.0])},
    "values rounded when read": {"value": np.zeros(3, np.longdouble)},
    "values of objects": {"value": np.zeros(3, object)},
}


@pytest.mark.parametrize("what", MALFORMED)
def test_malformed_matrices_prove_nothing_and_raise_nothing(what):
    x, y = sp.variables(2)
    good = gram_of([[0], [1], [2]], {(1, 1): 0.0, (1, 2): 0.0, (2, 2): 0.0})
    assert good.bound((x - y) ** 2) == 0.0
    assert replace(good, **MALFORMED[what]).bound((x - y) ** 2) == -INF


def test_sums_of_what_the_constant_hides_keep_every_term():
    """sum (x_k - k)^2 - k^2 over n variables hides 1 + 4 + ... + n^2."""
    for n in range(1, 9):
        x = sp.variables(n)
        f = sp.total([v * v - 2.0 * (k + 1) * v for k, v in enumerate(x)])
        basis = np.arange(n + 1, dtype=np.int32)[:, None]
        first, second = np.triu_indices(n + 1)
        gram = ExactGram(basis, first, second, np.zeros(first.size))
        assert gram.bound(f) == -n * (n + 1) * (2 * n + 1) / 6


_DOUBLE_WELLS = 120  # sum of (x_i^2 - 1)^2: its 241 monomials are enough to be remembered


def _double_wells():
    """The squares themselves: x_i^2 takes -1 with the constant, and nothing with itself."""
    n = _DOUBLE_WELLS
    words = [[0, 0], *([0, i] for i in range(1, n + 1)), *([i, i] for i in range(1, n + 1))]
    linear, square = np.arange(1, n + 1), np.arange(n + 1, 2 * n + 1)
    first = np.concatenate([square, linear, np.zeros(n, int)])
    second = np.concatenate([square, linear, square])
    gram = ExactGram(np.array(words, np.int32), first, second, np.repeat([0.0, 0.0, -1.0], n))
    x = sp.variables(n)
    return gram, sp.total([(v * v - 1) ** 2 for v in x]), x


def _swapped(array, i, j):
    found = array.copy()
    found[[i, j]] = array[[j, i]]
    return found


def test_what_was_eliminated_last_is_taken_for_the_same_numbers_alone():
    """By hand: -1.125 with the constant costs 1.125^2 and leaves x_n^2 a square of 0.25."""
    gram, f, x = _double_wells()
    n, last = _DOUBLE_WELLS, 2 * _DOUBLE_WELLS
    value = gram.value.copy()
    value[-1] = -1.125
    others = [
        (replace(gram, value=value), f, 1.0 - 1.125**2),
        (gram, f - x[0] ** 2, -INF),  # the same words
        (replace(gram, basis=_swapped(gram.basis, 1, last)), f, -INF),
        (replace(gram, first=_swapped(gram.first, 0, n)), f, -INF),
        (replace(gram, second=_swapped(gram.second, 0, n)), f, -INF),
        (gram, f + 3 * x[0] ** 2, 0.0),
    ]
    for other, objective, expected in others:
        assert gram.bound(f) == gram.bound(f) == 0.0
        assert other.bound(objective) == expected
    words = f.words.copy()
    place = np.flatnonzero((words == 1).sum(axis=1) == 2)[0]
    words[place] = np.sort(np.where(words[place] == 0, 0, [1, 1, 1, 2]))  # x_1 x_2, not x_1^2
    assert gram.bound(f) == 0.0
    assert gram.bound(replace(f, words=words)) == -INF
    assert gram.bound(f) == 0.0
    gram.value[-1] = -1.125
    assert gram.bound(f) == 1.0 - 1.125**2


@pytest.mark.parametrize("n", [5, 45, 220])
@pytest.mark.parametrize("value", [1e6, -1e6])
def test_the_entry_of_the_constant_is_open_however_often_it_is_listed(n, value):
    """(x_1 + ... + x_n)^2 has the minimum 0, by a Gram matrix full of ones."""
    basis = np.arange(n + 1, dtype=np.int32)[:, None]
    low, high = np.tril_indices(n)
    first, second = np.append([0, 0, 0], high + 1), np.append([0, 0, 0], low + 1)
    values = np.append([0.0, value, value], np.ones(low.size))
    words = np.stack([second, first], axis=1)[3:].astype(np.int32)
    square = sp.Polynomial.from_words(words[:, ::-1], np.where(low == high, 1.0, 2.0), n)
    assert ExactGram(basis, first, second, values).bound(square) == 0.0


@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_places_of_long_bases_do_not_wrap(kind):
    """2 x_1^2 - x_k^2 of 2^17 - 2 variables: places k 2^17 and 2^17 differ by 2^32."""
    n, k = 2**17 - 2, 2**15 + 1
    f = sp.Polynomial.from_words(np.array([[1, 1], [k, k]], np.int32), np.array([2.0, -1.0]), n)
    basis, place = np.arange(n + 1, dtype=np.int32)[:, None], np.array([1, k], kind)
    assert ExactGram(basis, place, place, np.zeros(2)).bound(f) == -INF
