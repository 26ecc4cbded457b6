"""Half the Newton polytope, by linear programs, and the value that the dense basis has."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py.algebra import monomials
from sparsepop_py.relaxation.newton_polytope import consistent_bases

settings.register_profile("newton", deadline=None, derandomize=True)
settings.load_profile("newton")


def exponents(words, n):
    return {tuple(e) for e in monomials.to_exponents(words, n).toarray().tolist()}


def in_hull(point, corners):
    """Whether a point is a convex combination of the corners, by a linear program."""
    corners = np.array(corners, float)
    rows = np.vstack([corners.T, np.ones(len(corners))])
    right = np.append(np.array(point, float), 1.0)
    found = linprog(np.zeros(len(corners)), A_eq=rows, b_eq=right, method="highs")
    return found.status == 0


def kept_of(f, degree):
    n = f.dimension
    full = [(np.array([0]), monomials.full_basis(n, degree)[None])]
    result = consistent_bases(full, [f.words], n)
    return set().union(*(exponents(b.reshape(-1, b.shape[2]), n) for _, b in result))


@st.composite
def sparse_polynomials(draw):
    n, half = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    letters = st.lists(st.integers(0, n), min_size=2 * half, max_size=2 * half).map(sorted)
    words = draw(st.lists(letters, min_size=1, max_size=7))
    values = draw(st.lists(st.integers(-4, 4), min_size=len(words), max_size=len(words)))
    f = sp.Polynomial.from_words(np.array(words, np.int32), np.array(values, float), n)
    return f, half


@given(sparse_polynomials())
@settings(max_examples=60)
def test_nothing_is_kept_outside_half_the_newton_polytope(case):
    f, half = case
    corners = sorted(exponents(f.words, f.dimension) | {(0,) * f.dimension})
    for exponent in kept_of(f, half):
        assert in_hull([2 * e for e in exponent], corners)


@given(st.integers(0, 10**6))
@settings(max_examples=40)
def test_everything_that_some_square_needs_is_kept(seed):
    """Monomials of r_1, ..., r_k stay in the basis of sum r_k^2, for generic r_k."""
    rng = np.random.default_rng(seed)
    n, half = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    basis = monomials.full_basis(n, half)
    chosen = rng.random((2, basis.shape[0])) < 0.4
    parts = [
        sp.Polynomial.from_words(basis[c], rng.integers(1, 9, c.sum()).astype(float), n)
        for c in chosen
    ]
    f = sp.total([r**2 for r in parts])
    for r in parts:
        if r.terms:
            assert exponents(r.words, n) <= kept_of(f, half)


@pytest.mark.parametrize("seed", range(12))
def test_the_value_is_that_of_the_dense_basis(seed):
    """max c with f - c a sum of squares, in the reduced and in the full basis (oracle).

    f is even in each variable or not, has x_v^4 for some variables only, and is coercive.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    x = sp.variables(n)
    terms = [x[v] ** (4 if rng.random() < 0.6 else 2) for v in range(n)]
    for exponent in product(range(3), repeat=n):
        if 0 < sum(exponent) <= 2 and rng.random() < 0.4:
            factors = [x[v] ** e for v, e in enumerate(exponent) if e]
            term = factors[0]
            for factor in factors[1:]:
                term = term * factor
            terms.append(float(rng.integers(-2, 3)) / 4 * term)
    f = sp.total(terms)
    order = (f.degree + 1) // 2
    free = sp.relax(sp.Problem(f), order, terms="sign")
    reduced = sp.solve_conic(sp.assemble(free, f))
    assert reduced.status in ("solved", "almost")
    assert reduced.primal == pytest.approx(dense_value(f, order), abs=2e-5)


def dense_value(f, order):
    """The moment relaxation written out in cvxpy's language, in the full basis."""
    import cvxpy as cp

    basis = monomials.full_basis(f.dimension, order)
    i, j = np.tril_indices(basis.shape[0])
    products = monomials.multiply(basis[i], basis[j])
    table, number = monomials.collect(products, f.dimension)
    gram = cp.Variable((basis.shape[0],) * 2, PSD=True)
    rows = []
    for k in range(table.shape[0]):
        at = np.flatnonzero(number == k)
        entry = sum((1 if i[a] == j[a] else 2) * gram[i[a], j[a]] for a in at)
        found = monomials.lookup(table[k : k + 1], f.words, f.dimension)[0]
        rows.append((entry, float(f.coefficients[found]) if found >= 0 else 0.0, k))
    level = cp.Variable()
    constraints = [e == c - (level if k == 0 else 0) for e, c, k in rows]
    cp.Problem(cp.Maximize(level), constraints).solve(solver=cp.CLARABEL)
    return float(level.value)
