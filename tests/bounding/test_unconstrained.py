"""Unconstrained problems without a box: exact Gram matrices, and those inside the cone."""

from collections import Counter
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.algebra import monomials
from sparsepop_py.bounding import unconstrained
from sparsepop_py.bounding.gram_rounding import exact_grams, restricted_to_terms
from sparsepop_py.local_search import multistart
from sparsepop_py.verified.arithmetic.sum_of_squares import constant_above
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity

# optima: Waki, Kim, Kojima, Muramatsu (2006), section 6.1; nondquar: Conn et al. (1988)
EXACT = [
    (problems.rosenbrock, 1.0),
    (problems.chained_wood, 1.0),
    (problems.chained_singular, 0.0),
    (problems.nondquar, 0.0),
]


def expanded(problem):
    return sp.Problem(problem.objective)


@pytest.mark.parametrize(("make", "optimum"), EXACT, ids=lambda v: getattr(v, "__name__", ""))
def test_expanded_chains_get_their_exact_optimum(make, optimum):
    problem = expanded(make(40))
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound == optimum
    assert isinstance(result.certificate.root.argument, ExactGram)
    assert result.certificate.verify(problem).ok


def test_minima_at_irrational_points_take_no_time_for_exact_matrices(monkeypatch):
    """Broyden's tridiagonal function is 0 where its ends are neither rational nor square roots."""

    def refused(*_):
        raise AssertionError("an exact Gram matrix was looked for")

    monkeypatch.setattr(unconstrained, "exact_grams", refused)
    problem = expanded(problems.broyden_tridiagonal(40))
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert isinstance(result.certificate.root.argument, Identity)
    assert -1e-6 < result.lower_bound <= 0.0 <= result.upper_bound


def test_no_start_is_searched_again_for_a_lower_aim(monkeypatch):
    """Only the first one is: it gave an incumbent before anything was aimed at."""
    x = sp.variables(14)
    wells = sp.total((v**2 - 2) ** 2 + v for v in x)
    starts, own = Counter(), multistart.local_search

    def counted(problem, start, *rest):
        starts[start.tobytes()] += 1
        return own(problem, start, *rest)

    monkeypatch.setattr(multistart, "local_search", counted)
    tilted = sp.Problem(wells + sp.total(v * w for v, w in pairwise(x)))
    assert sp.solve(tilted).status is sp.Status.OPTIMAL
    assert len(starts) > 5
    assert sum(starts.values()) <= len(starts) + 1


def test_gram_matrices_inside_the_cone_need_no_box():
    problem = expanded(problems.broyden_tridiagonal(40))
    result = sp.solve(problem)
    assert -1e-6 <= result.lower_bound <= 0.0  # zeros exist: More, Garbow, Hillstrom (1981)
    assert isinstance(result.certificate.root.argument, Identity)
    assert not result.certificate.root.box.steps
    assert result.certificate.verify(problem).ok


@pytest.mark.parametrize("effort", slow_after(1, ["auto", "presolve"]))
def test_a_wide_box_costs_an_expanded_chain_neither_its_bound_nor_its_point(effort):
    objective = problems.broyden_tridiagonal(60).objective
    problem = sp.Problem(objective, lower=-1000, upper=1000)
    result = sp.solve(problem, sp.Options(effort=effort, work_limit=60))
    assert result.status is sp.Status.OPTIMAL
    assert -1e-6 <= result.lower_bound <= result.upper_bound <= 1e-6  # zeros exist, as above
    assert result.certificate.verify(problem).ok


@pytest.mark.parametrize("effort", slow_after(1, ["auto", "presolve"]))
def test_one_bound_costs_an_expanded_chain_nothing(effort):
    objective = problems.broyden_tridiagonal(60).objective
    problem = sp.Problem(
        objective, upper=np.append(0.0, np.full(59, np.inf))
    )  # x1 of a zero is < 0
    result = sp.solve(problem, sp.Options(effort=effort, work_limit=60))
    assert result.status is sp.Status.OPTIMAL
    assert -1e-6 <= result.lower_bound <= result.upper_bound <= 1e-6
    assert result.certificate.verify(problem).ok


def test_a_certificate_does_not_fit_another_problem():
    result = sp.solve(expanded(problems.chained_singular(8)))
    gram = result.certificate.root.argument
    below = problems.chained_singular(8).objective - 1.0
    assert gram.bound(below) == -1.0
    x = sp.variables(8)
    assert gram.bound(below - 1e-9 * x[0] ** 4) == -np.inf  # negative along (10, .., 1, ..)


def test_forms_that_are_no_sums_of_squares_get_nothing():
    f = problems.motzkin().objective
    assert all(g.bound(f) == -np.inf for g in exact_grams(f, sp.relax(sp.Problem(f), 3)))


@pytest.mark.parametrize("n", [9, 10])
def test_cliques_of_nearly_all_products_are_not_split(n):
    """Squares of polynomials of few terms: overlapping cliques would hold twice the entries."""
    f = problems.random_quartic(n).objective
    found = restricted_to_terms(f, sp.relax(sp.Problem(f), 2), True)
    assert dict(found.block_sizes) == {(n + 1) * (n + 2) // 2: 1}


@st.composite
def damaged(draw):
    """A polynomial and entries that have nothing to do with its squares."""
    n = draw(st.integers(1, 3))
    letters = st.lists(st.integers(0, n), min_size=4, max_size=4).map(sorted)
    words = draw(st.lists(letters, min_size=1, max_size=6))
    numbers = st.integers(-8, 8)
    values = draw(st.lists(numbers, min_size=len(words), max_size=len(words)))
    f = sp.Polynomial.from_words(np.array(words, np.int32), np.array(values, float), n)
    f = f + sp.total(v**4 for v in sp.variables(n)) * float(draw(st.integers(0, 8)))
    basis = monomials.full_basis(n, 2)
    first, second = np.triu_indices(basis.shape[0])
    entries = draw(st.lists(numbers, min_size=first.size, max_size=first.size))
    return f, ExactGram(basis, first, second, np.array(entries) / 8)


@given(damaged(), st.integers(0, 10**6))
@settings(max_examples=150, deadline=None)
def test_whatever_the_entries_are_no_value_lies_below_the_bound(case, seed):
    f, gram = case
    bound = gram.bound(f)
    if bound == -np.inf:
        return
    points = np.random.default_rng(seed).integers(-24, 25, (50, f.dimension)) / 8
    assert f(points).min() >= bound - 1e-9 * (1 + abs(bound))


def test_malformed_matrices_prove_nothing():
    x, y = sp.variables(2)
    f = (x - y) ** 2
    basis = np.array([[0], [1], [2]], np.int32)
    first, second, zero = np.array([1, 1, 2]), np.array([1, 2, 2]), np.zeros(3)
    assert ExactGram(basis, first, second, zero).bound(f) == 0.0
    for wrong in (
        ExactGram(basis[1:], first - 1, second - 1, zero),  # no constant in front
        ExactGram(basis, first + 5, second, zero),
        ExactGram(basis, first, second, np.full(3, np.nan)),
        ExactGram(basis + 7 * (basis > 0), first, second, zero),
        ExactGram(basis, first[:2], second, zero),
    ):
        assert wrong.bound(f) == -np.inf


def test_a_second_constant_in_the_basis_hides_nothing():
    """x^2 - 2 x = (1, x) [1 -1; -1 1] (1, x)' - 1: its least value is -1, not 0."""
    (x,) = sp.variables(1)
    f = x**2 - 2 * x
    first, second = np.array([0, 1, 1, 2]), np.array([0, 1, 2, 2])
    basis = np.array([[0], [0], [1]], np.int32)
    assert ExactGram(basis, first, second, np.array([0.0, 1.0, 0.0, 0.0])).bound(f) <= -1.0
    plain = np.array([[0], [1]], np.int32)
    assert ExactGram(plain, np.array([0, 1]), np.array([1, 1]), np.zeros(2)).bound(f) == -1.0


@given(st.lists(st.integers(-9, 9), min_size=6, max_size=6), st.booleans())
@settings(max_examples=60, deadline=None)
def test_constants_above_squares_agree_with_rationals(values, thirds):
    """Integers take the path of 64 bits, thirds that of rationals; both are exact."""
    x, y = sp.variables(2)
    a, b, c, d, e, g = (v / 3 if thirds else v / 4 for v in values)
    squares = [(abs(a) + 0.5, b * x + c), (1.0, d * x * y + e)]
    constant = Fraction(0)
    f = sp.total([w * (r**2) for w, r in squares]) + g
    for w, r in squares:
        constant -= Fraction(w) * Fraction(r.constant_term) ** 2
    constant += Fraction(f.constant_term)
    found = constant_above(f, squares)
    if not thirds:
        assert found is not None
    if found is not None:
        assert Fraction(found) <= constant
        assert abs(found - constant) <= 1e-15 * (1 + abs(constant))


@pytest.mark.parametrize("n", [30, 50])
def test_banded_squares_end_at_their_zero(n):
    """Broyden (1971): a zero near -1; from most other points searches end at 3.07 and more."""
    result = sp.solve(problems.broyden_banded(n))
    assert result.lower_bound == 0.0 and 0.0 <= result.upper_bound <= 1e-8


@pytest.mark.slow
def test_what_no_memory_holds_is_not_tried_for_a_box_either():
    """Blocks of 120 in 23 cliques: some 15 GB. Those of monomials that occur are smaller."""
    problem = sp.Problem(problems.broyden_banded(30).objective)
    result = sp.solve(problem, sp.Options(memory_limit=1e7))
    assert result.status is sp.Status.UNPROVED
    assert "needs more than 0.01 GB" in result.notes[0]
    output = sp.sparsePOP("BroydenBand(30)", {"printLevel": 0, "tighten": 0, "SDPsolverSW": 0})
    assert output.SDPinfo.rowSizeA == 0
    assert not any("was built" in note for note in output.POP.result.notes)


@pytest.mark.parametrize(
    ("bound", "effort"),
    [
        (np.inf, "presolve"),
        (1000.0, "auto"),
        pytest.param(np.inf, "auto", marks=pytest.mark.slow),
        pytest.param(1000.0, "presolve", marks=pytest.mark.slow),
    ],
)
def test_wide_cliques_need_only_the_monomials_whose_squares_occur(effort, bound):
    """Cliques of 7 at degree 6: blocks of 120 were too large for memory or time."""
    objective = problems.broyden_banded(12).objective
    problem = sp.Problem(objective, lower=-bound, upper=bound)
    result = sp.solve(problem, sp.Options(effort=effort, work_limit=60))
    assert result.status is sp.Status.OPTIMAL
    assert -1e-6 <= result.lower_bound <= result.upper_bound <= 1e-6  # zeros exist, as above
    assert max(entry.largest_block for entry in result.history) < 60
    assert result.certificate.verify(problem).ok


X = sp.variables(1)[0]


def far_quartics(left, right):
    """Both factors are least at (100, -30); all coefficients are integers below 2^53."""
    x, y = sp.variables(2)
    return ((x - 100) ** 4 + left * (y + 30) ** 2 + 1) * (
        (y + 30) ** 4 + right * (x - 100) ** 2 + 2
    )


@pytest.mark.parametrize("effort", ["presolve", "auto"])
@pytest.mark.parametrize(
    ("objective", "optimum"),
    [
        (far_quartics(0.0, 0.0), 2.0),
        (far_quartics(1.0, 1.0), 2.0),
        (5.0 * (X - 1000) ** 4 + (X - 1000) ** 2, 0.0),
        ((X - 100) ** 6 + (X - 100) ** 2 - 7.0, -7.0),
    ],
)
def test_a_minimum_far_from_the_origin_is_proved_about_the_attained_point(
    effort, objective, optimum
):
    problem = sp.Problem(objective)
    result = sp.solve(problem, sp.Options(effort=effort, work_limit=30))
    assert result.status is sp.Status.OPTIMAL
    assert optimum - 2e-6 * max(1.0, optimum) <= result.lower_bound <= optimum
    assert optimum <= result.upper_bound <= optimum + 2e-6 * max(1.0, optimum)
    assert result.certificate.verify(problem).ok


@pytest.mark.parametrize(
    ("objective", "near", "below"),
    [((3 * X - 1) ** 40, Fraction(1, 3), 1e-5), ((X - 1000) ** 6 + (X - 1000) ** 2, 1000, 65.0)],
)
def test_coefficients_that_cancel_leave_what_their_rounding_leaves(objective, near, below):
    """The doubles of these coefficients fall below 0, as values in rationals show."""
    problem = sp.Problem(objective)
    result = sp.solve(problem, sp.Options(effort="auto", work_limit=30))
    assert result.status is sp.Status.OPTIMAL
    f = problem.objective
    powers = np.count_nonzero(f.words, axis=1).tolist()
    terms = [(Fraction(c), p) for c, p in zip(f.coefficients.tolist(), powers, strict=True)]
    points = [near + Fraction(k, 2**9) for k in range(-64, 65)]
    least = min(sum(c * x**p for c, p in terms) for x in points)
    assert -below < result.lower_bound <= least < 0
    assert result.certificate.verify(problem).ok
