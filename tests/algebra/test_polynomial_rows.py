"""Many polynomials at once are those that are made one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.algebra.polynomial_rows import polynomial_rows

VALUES = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.1, 0.2, -0.3, 1e300, -1e300, 5e-324])


@st.composite
def tables(draw):
    rows, terms, degree = (draw(st.integers(1, most)) for most in (4, 5, 3))
    dimension = draw(st.sampled_from([2, 5, 2**30]))
    letters = st.integers(0, 2) if draw(st.booleans()) else st.integers(0, dimension)
    words = np.array(
        [[sorted(draw(letters) for _ in range(degree)) for _ in range(terms)] for _ in range(rows)]
    )
    words = np.minimum(words, dimension)
    values = np.array([[draw(VALUES) for _ in range(terms)] for _ in range(rows)])
    return words, values, dimension


@given(tables())
@settings(deadline=None)
def test_rows_are_those_made_one_by_one(table):
    words, values, dimension = table
    found = polynomial_rows(words, values, dimension)
    assert len(found) == len(words)
    for one, word, value in zip(found, words, values, strict=True):
        other = sp.Polynomial.from_words(word, value, dimension)
        assert np.array_equal(one.words, other.words) and one.words.dtype == other.words.dtype
        assert np.array_equal(one.coefficients, other.coefficients)
        assert one.dimension == other.dimension and one.names == other.names
        for array in (one.words, one.coefficients):
            assert array.flags.c_contiguous and not array.flags.writeable
        sp.Polynomial(one.words, one.coefficients, dimension)  # what the class asks for


def test_sums_of_equal_monomials_are_exact():
    words, values = np.zeros((2, 3, 1), int), np.array([[1e16, 1.0, -1e16], [0.0, 3.0, 0.0]])
    assert [p.constant_term for p in polynomial_rows(words, values, 1)] == [1.0, 3.0]


def test_names_are_kept_and_arrays_are_copied():
    words, values = np.array([[[0], [1]]]), np.array([[2.0, 3.0]])
    (found,) = polynomial_rows(words, values, 1, ("a1",))
    values[:], words[:] = 7.0, 0
    assert str(found) == "2 + 3*a1"


@pytest.mark.parametrize(
    ("words", "values", "message"),
    [
        ([[[2, 1]]], [[1.0]], "descends"),
        ([[[0, 3]]], [[1.0]], "outside 1..2"),
        ([[[0, 1]]], [[np.nan]], "finite"),
        ([[[0.0, 1.0]]], [[1.0]], "integers"),
    ],
)
def test_other_arrays_are_refused(words, values, message):
    with pytest.raises(sp.ProblemError, match=message):
        polynomial_rows(np.array(words), np.array(values), 2)


def test_no_rows_make_no_polynomials():
    assert polynomial_rows(np.zeros((0, 3, 2), int), np.zeros((0, 3)), 2) == []
