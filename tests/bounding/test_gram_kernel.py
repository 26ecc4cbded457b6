"""Gram matrices from a minimiser: they prove the minimum, and no solver is asked."""

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.bounding import unconstrained
from sparsepop_py.bounding.gram_kernel import grams_with_kernel
from sparsepop_py.bounding.gram_rounding import estimate, open_entries
from sparsepop_py.local_search import multistart
from sparsepop_py.local_search.solvers import local_search
from sparsepop_py.verified.certificate.rational_gram import ExactGram

# least values at (1, ..., 1): Rosenbrock (1960); Colville (1968)
RATIONAL = [(problems.rosenbrock, 1.0), (problems.chained_wood, 1.0)]


def relaxation(objective):
    return sp.relax(sp.Problem(objective), objective.degree // 2, terms="sign")


@pytest.mark.parametrize(("make", "least"), RATIONAL, ids=lambda v: getattr(v, "__name__", ""))
def test_the_minimiser_of_a_chain_gives_its_exact_bound(make, least):
    f = make(24).objective
    expected, gram = next(grams_with_kernel(f, relaxation(f), np.ones(24)))
    assert gram.bound(f) == least
    assert expected == pytest.approx(least, abs=1e-5)


def test_a_point_that_is_no_minimiser_gives_no_better_bound():
    f = problems.rosenbrock(24).objective
    for seed in range(5):
        x = np.random.default_rng(seed).normal(size=24)
        assert all(gram.bound(f) <= 1.0 for _, gram in grams_with_kernel(f, relaxation(f), x))


def test_matrices_with_a_negative_eigenvalue_are_left_out():
    x, y = sp.variables(2)
    f = x**4 + y**4 - 3 * x**2 * y**2  # negative at (1, 1)
    assert not list(grams_with_kernel(f, relaxation(f), np.zeros(2)))


def test_open_entries_complete_the_objective():
    """x^4 + 2 x^2 + 1 = (x^2 + 1)^2: what the product x^2 takes, the square of x leaves."""
    (x,) = sp.variables(1)
    f = x**4 + 2 * x**2 + 1
    basis = np.array([[0, 0], [0, 1], [1, 1]], np.int32)
    first, second = np.array([0, 1, 2, 0]), np.array([0, 1, 2, 2])
    gram = ExactGram(basis, first, second, np.zeros(4))
    entries, change, free = open_entries(gram, f)
    assert free.tolist() == [3]
    assert (entries + change @ [1.0]).tolist() == [1.0, 0.0, 1.0, 1.0]
    full = ExactGram(basis, first, second, np.array([1.0, 0.0, 1.0, 1.0]))
    assert estimate(full, f) == pytest.approx(0.0, abs=1e-9)
    assert full.bound(f) == 0.0


@pytest.fixture()
def no_program(monkeypatch):
    def refused(*_):
        raise AssertionError("a relaxation was solved")

    monkeypatch.setattr(unconstrained, "exact_grams", refused)
    monkeypatch.setattr(unconstrained, "solve_conic", refused)


@pytest.mark.usefixtures("no_program")
def test_no_program_is_solved_where_the_incumbent_is_the_minimiser():
    """Zeros of Broyden's function exist, and all but the ends are near irrational numbers."""
    problem = sp.Problem(problems.broyden_tridiagonal(400).objective)
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound == 0.0 <= result.upper_bound <= 1e-6
    assert isinstance(result.certificate.root.argument, ExactGram)
    assert result.certificate.verify(problem).ok


@pytest.mark.usefixtures("no_program")
def test_points_are_searched_on_while_each_is_far_better_than_the_last(monkeypatch):
    """Those from 0 and from (1, ..., 1) are made to end poorly, so that three are needed."""
    found = {0.0: 0.505, 1.0: 0.601, -1.0: -0.7}  # values 99, 34; the zero is near -0.7

    def ends(problem, start, *_):
        x = np.full(start.size, found[float(start[0])])
        return x if start[0] >= 0.0 else local_search(problem, x)

    monkeypatch.setattr(multistart, "local_search", ends)
    problem = sp.Problem(problems.broyden_tridiagonal(400).objective)
    result = sp.solve(problem)
    assert result.lower_bound == 0.0 <= result.upper_bound <= 1e-6
    assert result.certificate.verify(problem).ok
