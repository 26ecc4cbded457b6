"""Generators: the numbering that relaxations and certificates share, judged by values."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.algebra import monomials
from sparsepop_py.problem import generators
from sparsepop_py.sparsity.correlative import find_cliques

INF = np.inf
NOTHING = np.zeros((0, 2), int)


def values(system, x):
    """Values of every generator at x, with plain numpy."""
    terms = system.coefficients * monomials.evaluate(system.words, np.asarray(x, float))
    result = np.zeros(system.size)
    np.add.at(result, system.row, terms)
    return result


def expected(problem, x):
    """The definition: 1, the constraints, then box, lower and upper of each variable."""
    low, high, x = problem.lower, problem.upper, np.asarray(x, float)
    families = np.zeros((3, problem.dimension))
    for v, (a, b) in enumerate(zip(low, high, strict=True)):
        if a == b:
            continue
        if np.isfinite(a) and np.isfinite(b):
            families[0, v] = (b - x[v]) * (x[v] - a)
        if np.isfinite(a):
            families[1, v] = x[v] - a
        if np.isfinite(b):
            families[2, v] = b - x[v]
    rows = [c.polynomial(x) for c in problem.constraints]
    return np.concatenate([[1.0], rows, families.ravel()])


ends = st.sampled_from([(-1.0, 1.0), (0.0, INF), (-INF, 0.0), (-INF, INF), (2.0, 2.0), (-0.5, 3.0)])


@given(st.tuples(ends, ends, ends), st.tuples(*[st.integers(-8, 8)] * 3))
@settings(max_examples=60, deadline=None)
def test_generators_are_one_the_rows_and_the_three_families(pairs, numerators):
    """Quarters: all values are exact."""
    x = sp.variables(3)
    lower, upper = np.array(pairs).T
    problem = Problem(x[0], [x[0] * x[1] >= 0.5, x[2] ** 3 == x[0]], lower, upper)
    where = np.array(numerators) / 4
    system = generators.stacked(problem, NOTHING)
    assert system.size == generators.count(2, 3) == 12
    assert np.array_equal(values(system, where), expected(problem, where))


def test_families_stand_one_after_the_other():
    box, lower, upper = generators.bound_family(4, 3)
    assert (box.start, box.stop) == (5, 8)
    assert (lower.start, lower.stop) == (8, 11)
    assert (upper.start, upper.stop) == (11, 14)
    assert generators.count(4, 3) == 14


def test_terms_come_with_ascending_rows_and_no_zero_coefficients():
    words, coefficients, index = generators.bound_terms(
        np.array([-1.0, 0.0, -INF, 3.0]), np.array([1.0, INF, INF, 3.0]), 2
    )
    assert np.all(np.diff(index) >= 0)
    assert np.all(coefficients != 0)
    assert words.shape == (index.size, 2)
    assert not np.any(words == 3)  # free
    assert not np.any(words == 4)  # fixed


def test_scaled_bounds_have_exact_unit_coefficients():
    _, coefficients, _ = generators.bound_terms(
        np.array([-1.0, 0.0, -INF]), np.array([1.0, INF, 0.0]), 0
    )
    assert set(np.abs(coefficients).tolist()) == {1.0}


def test_single_letters_name_the_generators_that_are_a_variable():
    lower = np.array([-1.0, 0.0, -INF, -INF, 0.0, -3.0])  # with two bounds it is 1 + t, not x
    upper = np.array([1.0, INF, 0.0, INF, 2.0, 0.0])
    numbers = np.arange(generators.count(1, 6) + 2)  # two products at the end
    letters = generators.single_letters(lower, upper, 1, numbers)
    _, low, high = generators.bound_family(1, 6)
    wanted = np.full(numbers.size, -1)
    wanted[0] = 0
    wanted[low.start + 1] = 2
    wanted[high.start + 2] = 3
    assert letters.tolist() == wanted.tolist()


@pytest.mark.parametrize("products", [[[-1, 0]], [[0, -1]], [[4, 0]], [[0, 0], [0, 5]]])
def test_products_name_generators_before_them(products: list[list[int]]) -> None:
    """Of four generators; -1 would mean the last one, itself a product."""
    assert generators.are_products(np.array([[0, 3], [4, 4]]), 4)
    assert not generators.are_products(np.array(products), 4)


@given(
    st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), min_size=1, max_size=6),
    st.tuples(*[st.integers(-4, 4)] * 3),
)
@settings(max_examples=60, deadline=None)
def test_products_have_the_product_of_the_values(pairs, numerators):
    x = sp.variables(3)
    problem = Problem(x[0], [x[0] * x[1] + x[2] >= 1, x[2] == 0.5], [-1, 0, 0], [1, INF, 2])
    where = np.array(numerators) / 2
    system = generators.stacked(problem, np.array(pairs))
    single = expected(problem, where)
    wanted = [single[a] * single[b] for a, b in pairs]
    assert np.array_equal(values(system, where), np.concatenate([single, wanted]))


def test_useful_products_are_bounds_of_partners_and_rows_with_them():
    """x1 x2 is the only product: 4 pairs of bounds; the row meets both of its variables."""
    x = sp.variables(3)
    problem = Problem(x[0] * x[1] + x[2], [x[0] + x[1] <= 1.5, x[0] * x[1] >= 0.1], 0, 1)
    cliques = find_cliques(problem)
    pairs = generators.useful_products(problem, cliques.members, cliques.home, ())
    _, low, high = generators.bound_family(2, 3)
    bounds = {(a, b) for a in (low.start, high.start) for b in (low.start + 1, high.start + 1)}
    rows = {(1, v + side) for v in (0, 1) for side in (low.start, high.start)}
    assert sorted(map(tuple, pairs.tolist())) == sorted(bounds | rows)


@pytest.mark.parametrize(("rows", "count"), [(40, 40 * 39 // 2), (41, 0), (5000, 0)])
def test_many_inequalities_are_not_multiplied_with_each_other(rows, count):
    """Their products are quadratic in number: 12 million for 5000 rows."""
    x = sp.variables(2)
    problem = Problem(x[0] * x[1], [x[0] + k * x[1] >= -k for k in range(1, rows + 1)], -1, 1)
    cliques = find_cliques(problem)
    pairs = generators.useful_products(problem, cliques.members, cliques.home, ())
    assert np.sum(np.all((pairs >= 1) & (pairs <= rows), axis=1)) == count
    assert len(pairs) == 4 + 4 * rows + count  # with the bounds of both variables


@given(st.lists(st.sampled_from(list(combinations(range(4), 2))), unique=True), st.booleans())
@settings(max_examples=40, deadline=None)
def test_products_of_random_problems_are_nonnegative_where_the_problem_is_feasible(edges, boxed):
    x = sp.variables(4)
    f = sp.total([x[0], *(x[i] * x[j] for i, j in edges)])
    upper = [1, 1, 1, 1 if boxed else INF]
    problem = Problem(f, [sp.total(x) <= 2, x[0] - x[1] >= -0.5, x[2] == x[3]], 0, upper)
    cliques = find_cliques(problem)
    pairs = generators.useful_products(problem, cliques.members, cliques.home, ())
    assert not np.any(problem.equality[pairs[(pairs > 0) & (pairs <= 3)] - 1])
    system = generators.stacked(problem, pairs)
    assert set(pairs.ravel().tolist()) <= set(system.row.tolist())  # no factor is missing
    grid = np.array(list(np.ndindex(3, 3, 3, 3))) / 2
    feasible = [p for p in grid if problem.violation(p) == 0]
    assert feasible
    for point in feasible:
        assert np.all(values(system, point)[system.size - len(pairs) :] >= 0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(0, 30))
def test_layers_are_the_longest_runs_whose_factors_come_before_them(seed, single, count):
    rng = np.random.default_rng(seed)
    products = np.array([rng.integers(0, single + k, 2) for k in range(count)]).reshape(-1, 2)
    found = generators.layers(products, single)
    assert [k for run in found for k in run] == list(range(count))
    for run in found:
        assert len(run) and products[run].max() < single + run.start
        if run.stop < count:
            assert products[run.stop].max() >= single + run.start
