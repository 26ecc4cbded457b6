"""Polynomials: ring laws against dictionaries of Fractions, derivatives against sympy."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sps
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from polynomial_tables import (
    SYMBOLS,
    N,
    added,
    as_sympy,
    build,
    clean,
    from_sympy,
    multiplied,
    raised,
    read,
    read2,
)

import sparsepop_py as sp
from sparsepop_py import Polynomial, ProblemError

# Coefficients k/4 with small k: sums and products of a few are exact in doubles.
exact = st.integers(-12, 12).map(lambda k: k / 4)
powers = st.tuples(*[st.integers(0, 2)] * N)
tables = st.dictionaries(powers, exact.filter(bool), max_size=5)
points = st.tuples(*[st.integers(-6, 6).map(lambda k: k / 2)] * N)


# ---- ring laws ---------------------------------------------------------------------------


@given(tables)
@settings(deadline=None)
def test_arithmetic_builds_the_table(table):
    assert read(build(table)) == clean(table)


@given(tables, tables)
@settings(deadline=None)
def test_sums_and_differences_are_exact(left, right):
    p, q = build(left), build(right)
    assert read(p + q) == added(left, right)
    assert read(q + p) == added(left, right)
    assert read(p - q) == added(left, right, -1)
    assert read(-p) == added({}, left, -1)
    assert read(p - p) == {}


@given(tables, tables)
@settings(deadline=None)
def test_products_are_exact_and_commute(left, right):
    p, q = build(left), build(right)
    assert read(p * q) == multiplied(left, right) == read(q * p)


@given(tables, tables, tables)
@settings(max_examples=40, deadline=None)
def test_products_distribute_and_associate(a, b, c):
    p, q, r = build(a), build(b), build(c)
    assert read(p * (q + r)) == multiplied(a, added(b, c)) == read(p * q + p * r)
    assert read((p * q) * r) == read(p * (q * r))


@given(tables, st.integers(0, 4))
@settings(max_examples=50, deadline=None)
def test_powers_are_repeated_products(table, power):
    assert read(build(table) ** power) == raised(table, power)


@given(tables, exact)
@settings(deadline=None)
def test_numbers_act_on_both_sides(table, number):
    p, one = build(table), {(0,) * N: number}
    assert read(p + number) == added(table, one) == read(number + p)
    assert read(p - number) == added(table, one, -1)
    assert read(number - p) == added(one, table, -1)
    assert read(p * number) == multiplied(table, one) == read(number * p)


@given(tables, st.sampled_from([-4.0, 0.5, 2]))
@settings(deadline=None)
def test_division_by_a_power_of_two_is_exact(table, number):
    assert read(build(table) / number) == {e: c / Fraction(number) for e, c in clean(table).items()}


@given(tables, tables)
@settings(max_examples=30, deadline=None)
def test_sympy_agrees_on_products(left, right):
    expected = from_sympy(sympy.expand(as_sympy(left) * as_sympy(right)))
    assert read(build(left) * build(right)) == expected


@given(tables, st.integers(0, N - 1))
@settings(max_examples=50, deadline=None)
def test_derivatives_are_those_of_sympy(table, variable):
    expected = from_sympy(sympy.diff(as_sympy(table), SYMBOLS[variable]))
    assert read(build(table).derivative(variable)) == expected


@given(tables, st.lists(points, min_size=1, max_size=3))
@settings(deadline=None)
def test_values_are_exact_at_dyadic_points(table, where):
    p = build(table)
    expected = [
        sum(
            Fraction(c) * Fraction(x[0]) ** e[0] * Fraction(x[1]) ** e[1] * Fraction(x[2]) ** e[2]
            for e, c in table.items()
        )
        for x in where
    ]
    assert [Fraction(v) for v in p(np.array(where)).tolist()] == expected
    assert Fraction(p(where[0])) == expected[0]


@given(st.lists(tables, min_size=1, max_size=5), exact)
@settings(deadline=None)
def test_total_is_the_sum_of_its_terms(items, number):
    expected = {(0,) * N: Fraction(number)}
    for item in items:
        expected = added(expected, item)
    assert read(sp.total([*(build(item) for item in items), number])) == clean(expected)


@given(tables)
@settings(deadline=None)
def test_words_are_distinct_graded_and_coefficients_not_zero(table):
    p = build(table)
    order = [(len(w), w) for w in ([k for k in row if k] for row in p.words.tolist())]
    assert order == sorted(order)
    assert len({tuple(w) for _, w in order}) == p.terms
    assert np.all(p.coefficients != 0)


@given(tables)
@settings(deadline=None)
def test_degree_support_and_constant_term(table):
    p = build(table)
    assert p.degree == max((sum(e) for e in table), default=0)
    assert p.support.tolist() == [v for v in range(N) if any(e[v] for e in table)]
    assert p.constant_term == table.get((0,) * N, 0.0)
    assert p.terms == len(table)


# ---- construction ------------------------------------------------------------------------


@pytest.mark.parametrize("form", [np.array, sps.csr_array, sps.coo_matrix, sps.csc_array])
def test_from_terms_takes_dense_and_sparse_tables_and_merges_rows(form):
    table = form(np.array([[1, 0], [0, 2], [1, 0]]))
    assert read2(Polynomial.from_terms(table, [1.0, 2.0, 0.5])) == {(1, 0): 1.5, (0, 2): 2.0}


def test_from_terms_does_not_modify_or_share_what_it_is_given():
    table = sps.csr_array(
        (np.array([1, 2]), np.array([1, 0]), np.array([0, 2])), shape=(1, 2)
    )  # indices out of order
    values = np.array([3.0])
    p = Polynomial.from_terms(table, values)
    assert table.indices.tolist() == [1, 0]
    assert table.data.tolist() == [1, 2]
    values[0] = 7.0
    assert p([1.0, 1.0]) == 3.0
    assert values.flags.writeable


@pytest.mark.parametrize(
    ("exponents", "coefficients", "message"),
    [
        ([[-1]], [1.0], "exponents: found -1, expected non-negative integers"),
        ([[0.5]], [1.0], "exponents: found 0.5"),
        ([[1], [2]], [1.0], "coefficients: found 1, expected 2"),
        ([[1]], [np.nan], "coefficients: found nan, expected finite"),
        ([[1]], [-np.inf], "coefficients: found -inf, expected finite"),
        ([[1], [1]], [1.5e308, 1.5e308], "sum of equal monomials overflows"),
    ],
)
def test_malformed_terms_are_named(exponents, coefficients, message):
    with pytest.raises(ProblemError, match=message):
        Polynomial.from_terms(exponents, coefficients)


@pytest.mark.parametrize("n", [0, -1, 1.5, "3", None])
def test_variables_need_a_positive_integer(n):
    with pytest.raises(ProblemError, match="n: found"):
        sp.variables(n)


@pytest.mark.parametrize("names", [["a"], ["a", "a"], ["a", "b", "c"]])
def test_variables_need_distinct_names_of_the_right_number(names):
    with pytest.raises(ProblemError, match="names: found"):
        sp.variables(2, names)


def test_arrays_are_frozen():
    x, y = sp.variables(2)
    for p in (x, x + y, 2 * x * y, -x, x**0, x * 0, x.derivative(0), (x + 1) / 2):
        with pytest.raises(ValueError, match="read-only"):
            p.coefficients[...] = 5.0
        with pytest.raises(ValueError, match="read-only"):
            p.words[...] = 2
    with pytest.raises(AttributeError):
        x.dimension = 3


@pytest.mark.parametrize("names", [["a"], ["a", "a"], ["a", "b", "c"]])
def test_from_terms_needs_distinct_names_of_the_right_number(names):
    with pytest.raises(ProblemError, match="names: found"):
        Polynomial.from_terms([[1, 1]], [1.0], names)


@pytest.mark.parametrize("variable", [-1, 2])
def test_derivatives_with_respect_to_no_variable_are_refused(variable):
    x, y = sp.variables(2)
    with pytest.raises((ProblemError, IndexError)):
        (x**2 + y).derivative(variable)


@pytest.mark.parametrize(
    "act",
    [
        lambda x: (x * 1e200) * 1e200,
        lambda x: (x * 1e200) * (x * 1e200),
        lambda x: x / 1e-320,
    ],
)
def test_coefficients_that_overflow_are_named(act):
    with pytest.raises(ProblemError, match="coefficients"):
        act(sp.variables(1)[0])


def test_within_keeps_the_terms_and_what_was_rounded():
    x, y = sp.variables(2, ["x", "y"])
    p = (x - Fraction(1, 3)) * y
    wide = p.within(3, ["x", "y", "z"])
    assert wide.dimension == 3 and wide.names == ("x", "y", "z") and wide.fractions == p.fractions
    assert wide([2.0, 3.0, 7.0]) == p([2.0, 3.0])
    assert (x * x).within(1).dimension == 1 and p.within(4).names is None and p.dimension == 2


@pytest.mark.parametrize("dimension", [1, 0, -1, 2.0, True, "3", None])
def test_within_needs_room_for_all_variables(dimension):
    x, y = sp.variables(2)
    with pytest.raises(sp.ProblemError, match="dimension: found .*2 or more"):
        (x * y).within(dimension)
