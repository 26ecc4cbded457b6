"""Monomial bases: sizes by formula, kernels of equalities, and the Newton polytope."""

from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.algebra import monomials
from sparsepop_py.relaxation.basis import clique_bases, reduced_bases
from sparsepop_py.relaxation.newton_polytope import consistent_bases
from sparsepop_py.sparsity.correlative import find_cliques


def exponents(basis, n):
    return [tuple(row) for row in monomials.to_exponents(basis, n).toarray().tolist()]


def of_degree(n, degree, members):
    """Every exponent of degree at most ``degree`` in the chosen variables, by brute force."""
    ranges = [range(degree + 1) if v in members else range(1) for v in range(n)]
    return {e for e in product(*ranges) if sum(e) <= degree}


@given(
    st.lists(st.sets(st.integers(0, 5), min_size=1, max_size=4), min_size=1, max_size=5),
    st.integers(0, 3),
    st.data(),
)
@settings(max_examples=50, deadline=None)
def test_clique_bases_hold_all_monomials_of_each_clique(cliques, degree, data):
    members = [tuple(sorted(c)) for c in cliques]
    count = data.draw(st.integers(1, 6))
    asked = np.array(
        data.draw(st.lists(st.integers(0, len(members) - 1), min_size=count, max_size=count))
    )
    seen = []
    for place, bases in clique_bases(members, asked, degree):
        for p, basis in zip(place.tolist(), bases, strict=True):
            seen.append(p)
            clique = members[asked[p]]
            assert basis.shape[0] == comb(len(clique) + degree, degree)
            assert set(exponents(basis, 6)) == of_degree(6, degree, clique)
    assert sorted(seen) == list(range(count))


# ---- facial reduction --------------------------------------------------------------------


def moment_basis(problem, order):
    cliques = find_cliques(problem, sparse=False)
    [(_, bases)] = reduced_bases(problem, cliques.members, cliques.home, order)
    return exponents(bases[0], problem.dimension)


def test_a_binary_variable_loses_its_square():
    x, y = sp.variables(2)
    problem = Problem(x * y, [x**2 == 1, y**2 == y])
    assert set(moment_basis(problem, 2)) == {(0, 0), (1, 0), (0, 1), (1, 1)}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_linear_equation_leaves_the_basis_of_the_others(order):
    """Modulo x + 2y + 3z = 1 the polynomials of degree d have the dimension of two variables."""
    x, y, z = sp.variables(3)
    problem = Problem(x * y, [x + 2 * y + 3 * z == 1])
    assert len(moment_basis(problem, order)) == comb(2 + order, order)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_a_quadric_leaves_the_hilbert_function_of_its_quotient(order):
    """dim R[x]_d - dim R[x]_(d-2) for one quadric in n variables."""
    x = sp.variables(3)
    problem = Problem(x[0], [sp.total(v * v for v in x) == 1])
    assert len(moment_basis(problem, order)) == comb(3 + order, 3) - comb(1 + order, 3)


def test_what_remains_is_independent_modulo_the_equations():
    """The kept monomials and the shifted equations together span all monomials."""
    x, y, z = sp.variables(3)
    rows = [x + y - z, x * y - z**2 + 1, x + y - z]  # one is redundant
    problem = Problem(x, [r == 0 for r in rows])
    order = 2
    kept = moment_basis(problem, order)
    every = sorted(of_degree(3, order, range(3)))
    place = {e: k for k, e in enumerate(every)}
    vectors = []
    for row in rows:
        for shift in of_degree(3, order - row.degree, range(3)):
            vector = np.zeros(len(every))
            table = zip(row.exponents.toarray().tolist(), row.coefficients, strict=True)
            for e, c in table:
                vector[place[tuple(a + b for a, b in zip(e, shift, strict=True))]] = c
            vectors.append(vector)
    rank = np.linalg.matrix_rank(np.array(vectors))
    assert len(kept) == len(every) - rank
    units = np.eye(len(every))[[place[e] for e in kept]]
    assert np.linalg.matrix_rank(np.vstack([vectors, units])) == len(every)
    assert (0, 0, 0) in kept


def test_inequalities_and_equations_of_higher_degree_drop_nothing():
    x, y = sp.variables(2)
    problem = Problem(x, [x + y >= 0, x**3 == y])
    assert len(moment_basis(problem, 2)) == 6
    assert len(moment_basis(problem, 3)) == 9


def test_only_the_home_of_an_equation_is_reduced():
    x = sp.variables(3)
    problem = Problem(x[0] * x[1] + x[1] * x[2], [x[0] ** 2 == 1])
    cliques = find_cliques(problem)
    bases = reduced_bases(problem, cliques.members, cliques.home, 2)
    sizes = {
        cliques.members[c]: b.shape[0] for place, s in bases for c, b in zip(place, s, strict=True)
    }
    assert sizes == {(0, 1): 5, (1, 2): 6}


# ---- diagonal consistency ----------------------------------------------------------------


def consistent(polynomial, order):
    n = polynomial.dimension
    full = clique_bases([tuple(range(n))], np.array([0]), order)
    [(_, bases)] = consistent_bases(full, [polynomial.words], n)
    return set(exponents(bases[0], n))


def test_motzkin_keeps_the_monomials_of_half_its_newton_polytope():
    """New(p) / 2 is the triangle (0,0), (2,1), (1,2): 1, xy, x^2 y, x y^2."""
    x, y = sp.variables(2)
    motzkin = x**4 * y**2 + x**2 * y**4 - 3 * x**2 * y**2 + 1
    assert consistent(motzkin, 3) == {(0, 0), (1, 1), (2, 1), (1, 2)}


def test_a_univariate_polynomial_keeps_half_of_its_degree():
    x = sp.variables(1)[0]
    assert consistent(x**4 - x, 3) == {(0,), (1,), (2,)}


def test_a_constant_keeps_the_constant():
    x, _ = sp.variables(2)
    assert consistent(x * 0.0 + 3.0, 2) == {(0, 0)}
    assert consistent(x * 0.0, 2) == {(0, 0)}


@given(
    st.lists(
        st.lists(
            st.tuples(st.integers(0, 2), st.integers(0, 2)).filter(lambda e: sum(e) <= 2),
            min_size=1,
            max_size=3,
            unique=True,
        ),
        min_size=1,
        max_size=3,
    ),
    st.integers(0, 10**6),
)
@settings(max_examples=60, deadline=None)
def test_the_monomials_of_squares_survive(squares, seed):
    """Random coefficients: in p = sum q_k^2 every monomial of every q_k must be kept."""
    rng = np.random.default_rng(seed)
    x, y = sp.variables(2)
    terms = [
        sp.total(float(rng.uniform(0.5, 2)) * x**i * y**j for i, j in support)
        for support in squares
    ]
    p = sp.total(q * q for q in terms)
    assert {e for support in squares for e in support} <= consistent(p, 2)


def test_blocks_of_different_sizes_are_stacked_by_what_remains():
    x = sp.variables(4)
    f = x[0] ** 2 + x[0] * x[1] + x[1] ** 2 + x[2] ** 2
    members = [(0, 1), (2, 3)]
    full = clique_bases(members, np.arange(2), 1)
    found = {}
    for place, bases in consistent_bases(full, [f.words], 4):
        for c, basis in zip(place.tolist(), bases, strict=True):
            found[c] = set(exponents(basis, 4))
    assert found == {
        0: {(0, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)},
        1: {(0, 0, 0, 0), (0, 0, 1, 0)},
    }
