"""Monomials as words: against exponent matrices, numpy, and sorting in plain Python."""

from math import comb

import numpy as np
import pytest
import scipy.sparse as sps
from hypothesis import given, settings
from hypothesis import strategies as st

from sparsepop_py.algebra import monomials


@st.composite
def exponent_tables(draw, rows=6, variables=5, power=3):
    n = draw(st.integers(1, variables))
    row = st.lists(st.integers(0, power), min_size=n, max_size=n)
    return np.array(draw(st.lists(row, min_size=1, max_size=rows)))


def words_of(table):
    return monomials.from_exponents(sps.csr_array(np.asarray(table)))


def letters(row):
    """Word of an exponent row by hand, without padding."""
    return [v + 1 for v, power in enumerate(row) for _ in range(power)]


def graded(row):
    """The graded order by its definition: degree first, then the letters."""
    return (len(letters(row)), letters(row))


@given(exponent_tables())
@settings(deadline=None)
def test_words_hold_the_letters_in_order_padded_on_the_left(table):
    words = words_of(table)
    width = max(1, int(table.sum(axis=1).max()))
    expected = [[0] * (width - sum(row)) + letters(row) for row in table.tolist()]
    assert words.dtype == np.int32
    assert words.tolist() == expected


@given(exponent_tables())
@settings(deadline=None)
def test_exponents_survive_the_round_trip(table):
    back = monomials.to_exponents(words_of(table), table.shape[1])
    assert back.shape == table.shape
    assert np.array_equal(back.toarray(), table)


@given(exponent_tables())
@settings(deadline=None)
def test_degrees_are_row_sums(table):
    assert monomials.degrees(words_of(table)).tolist() == table.sum(axis=1).tolist()


@given(exponent_tables(), st.integers(0, 4))
@settings(deadline=None)
def test_widen_and_trim_are_inverse_and_keep_the_monomials(table, extra):
    words = words_of(table)
    wide = monomials.widen(words, words.shape[1] + extra)
    assert wide.shape[1] == words.shape[1] + extra
    assert np.array_equal(monomials.to_exponents(wide, table.shape[1]).toarray(), table)
    assert np.array_equal(monomials.trim(wide), words)


def test_trim_keeps_one_column():
    assert monomials.trim(np.zeros((2, 3), np.int32)).tolist() == [[0], [0]]
    assert monomials.trim(np.zeros((0, 3), np.int32)).shape == (0, 1)


@pytest.mark.parametrize(("dimension", "kind"), [(5, "i"), (2**16, "S"), (2**30, "S")])
@given(table=exponent_tables(rows=8, power=2))
@settings(max_examples=30, deadline=None)
def test_pack_orders_like_the_graded_order(dimension, kind, table):
    words = words_of(table)
    wide = monomials.widen(words, 10)
    shifted = np.where(wide > 0, wide + dimension - 5, 0).astype(np.int32)
    keys = monomials.pack(shifted, dimension)
    assert keys.dtype.kind == kind
    rows = table.tolist()
    for a, key_a in zip(rows, keys, strict=True):
        for b, key_b in zip(rows, keys, strict=True):
            assert (key_a < key_b) == (graded(a) < graded(b))
            assert (key_a == key_b) == (a == b)


def test_pack_tells_letters_apart_whose_last_bytes_are_zero():
    """Fixed-width strings ignore trailing zero bytes; letters 256 and 65536 end in them."""
    values = [0, 1, 255, 256, 257, 65535, 65536, 2**24]
    words = np.array([[0] * 5 + [v] for v in values], np.int32)
    keys = monomials.pack(words, 2**24)
    assert keys.dtype.kind == "S"
    assert np.array_equal(np.argsort(keys, kind="stable"), np.arange(len(values)))
    assert np.unique(keys).size == len(values)


@pytest.mark.parametrize("dimension", [4, 2**20])
@given(table=exponent_tables(rows=10, variables=3, power=1))
@settings(max_examples=30, deadline=None)
def test_collect_gives_distinct_words_in_graded_order(dimension, table):
    words = monomials.widen(words_of(table), 5)
    distinct, number = monomials.collect(words, dimension)
    assert np.array_equal(distinct[number], words)
    rows = monomials.to_exponents(distinct, table.shape[1]).toarray().tolist()
    assert rows == sorted({tuple(r): r for r in table.tolist()}.values(), key=graded)


def test_collect_of_nothing_is_nothing():
    distinct, number = monomials.collect(np.zeros((0, 2), np.int32), 3)
    assert distinct.shape == (0, 2)
    assert number.size == 0


@given(exponent_tables(), st.data())
@settings(deadline=None)
def test_products_add_exponents(table, data):
    n = table.shape[1]
    row = st.lists(st.integers(0, 3), min_size=n, max_size=n)
    other = np.array(data.draw(st.lists(row, min_size=1, max_size=4)))
    product = monomials.multiply(words_of(table)[:, None, :], words_of(other)[None, :, :])
    flat = product.reshape(-1, product.shape[-1])
    expected = (table[:, None, :] + other[None, :, :]).reshape(-1, n)
    assert np.array_equal(monomials.to_exponents(flat, n).toarray(), expected)


@given(exponent_tables(), st.integers(1, 4), st.data())
@settings(deadline=None)
def test_values_are_those_of_numpy_powers(table, count, data):
    n = table.shape[1]
    coordinate = st.integers(-4, 4)  # small integers: every product is exact
    point = st.lists(coordinate, min_size=n, max_size=n)
    points = np.array(data.draw(st.lists(point, min_size=count, max_size=count)), float)
    expected = np.prod(points[:, None, :] ** table[None, :, :], axis=2)
    words = words_of(table)
    assert np.array_equal(monomials.evaluate(words, points), expected)
    assert np.array_equal(monomials.evaluate(words, points[0]), expected[0])


@given(exponent_tables())
@settings(deadline=None)
def test_runs_are_the_nonzero_exponents(table):
    row, variable, power = monomials.runs(monomials.widen(words_of(table), 20))
    where = np.nonzero(table)
    assert np.array_equal(row, where[0])
    assert np.array_equal(variable, where[1])
    assert np.array_equal(power, table[where])


def test_runs_join_equal_letters_only_within_a_row():
    row, variable, power = monomials.runs(np.array([[0, 1, 1], [1, 1, 2], [0, 0, 0]], np.int32))
    assert row.tolist() == [0, 1, 1]
    assert variable.tolist() == [0, 0, 1]
    assert power.tolist() == [2, 2, 1]


def test_the_matrix_of_the_caller_is_not_modified():
    """Indices out of order and an explicit zero: both would be changed by sorting in place."""
    matrix = sps.csr_array(
        (np.array([1, 2, 0]), np.array([2, 0, 1]), np.array([0, 2, 3])), shape=(2, 3)
    )
    before = [matrix.data.copy(), matrix.indices.copy(), matrix.indptr.copy()]
    words = monomials.from_exponents(matrix)
    assert words.tolist() == [[1, 1, 3], [0, 0, 0]]
    for old, new in zip(before, [matrix.data, matrix.indices, matrix.indptr], strict=True):
        assert np.array_equal(old, new)


@pytest.mark.parametrize(("n", "degree"), [(1, 0), (1, 4), (2, 3), (3, 2), (4, 3), (6, 2)])
def test_full_basis_holds_every_monomial_once_in_graded_order(n, degree):
    basis = monomials.full_basis(n, degree)
    assert basis.shape[0] == comb(n + degree, degree)
    rows = monomials.to_exponents(basis, n).toarray().tolist()
    every = [list(e) for e in np.ndindex(*[degree + 1] * n) if sum(e) <= degree]
    assert rows == sorted(every, key=graded)


def test_full_basis_of_no_variables_is_the_constant():
    assert not monomials.full_basis(0, 2).any()
    assert monomials.full_basis(0, 2).shape[0] == 1
