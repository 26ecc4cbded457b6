"""Values of relaxations: known optima, reduction, relabelling."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from relaxed import value

import sparsepop_py as sp
from sparsepop_py import Kind, Problem, assemble, relax, solve_conic
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.sparsity.correlative import find_cliques

INF = np.inf


# ---- values ------------------------------------------------------------------------------


def test_facial_reduction_keeps_the_value_of_a_circle():
    """min x y on the unit circle is -1/2, attained at (1, -1) / sqrt 2."""
    x, y = sp.variables(2)
    problem = Problem(x * y, [x**2 + y**2 == 1], -1, 1)
    reduced = value(problem, 2, reduce=True)
    assert reduced == pytest.approx(-0.5, abs=1e-6)
    assert reduced == pytest.approx(value(problem, 2, reduce=False), abs=1e-6)


@pytest.mark.parametrize(("order", "expected"), [(1, -1.5), (2, -1.0)])
def test_facial_reduction_keeps_the_values_of_the_triangle(order, expected):
    """Max-cut of a triangle: -3/2 at order 1 (three vectors at 120 degrees), -1 at order 2."""
    x, y, z = sp.variables(3)
    problem = Problem(x * y + y * z + x * z, [v**2 == 1 for v in (x, y, z)], -1, 1)
    reduced = relax(problem, order)
    full = relax(problem, order, reduce=False)
    assert order == 1 or max(reduced.block_sizes) < max(full.block_sizes)
    for relaxation in (reduced, full):
        solution = solve_conic(assemble(relaxation, problem.objective))
        assert solution.dual == pytest.approx(expected, abs=1e-5)


def test_an_equation_that_is_no_product_keeps_the_value():
    """min x + y + z with x + 2y = 1, x y = z in the unit box: the grid on y gives the optimum."""
    x, y, z = sp.variables(3)
    problem = Problem(x + y + z, [x + 2 * y == 1, x * y == z], -1, 1)
    t = np.linspace(0, 1, 10001)  # x = 1 - 2t in [-1, 1]
    best = float(np.min(1 - 2 * t + t + (1 - 2 * t) * t))
    assert value(problem, 2) == pytest.approx(best, abs=1e-5)
    assert value(problem, 2, reduce=False) == pytest.approx(best, abs=1e-5)


def chain(n, seed):
    rng = np.random.default_rng(seed)
    x = sp.variables(n)
    terms = [c * v for c, v in zip(rng.normal(size=n), x, strict=True)]
    terms += [c * x[k] * x[k + 1] for k, c in enumerate(rng.normal(size=n - 1))]
    terms += [c * x[k] ** 2 * x[k + 1] ** 2 for k, c in enumerate(rng.normal(size=n - 1))]
    return Problem(sp.total(terms), lower=-1, upper=1)


def relabelled(problem, permutation):
    table = np.concatenate([[0], np.array(permutation) + 1]).astype(np.int32)

    def move(p):
        words = np.sort(table[p.words], axis=1)
        return Polynomial.from_words(words, p.coefficients, p.dimension)

    rows = [
        move(c.polynomial) >= 0 if c.kind is Kind.NONNEGATIVE else move(c.polynomial) == 0
        for c in problem.constraints
    ]
    low, high = np.zeros(problem.dimension), np.zeros(problem.dimension)
    low[list(permutation)], high[list(permutation)] = problem.lower, problem.upper
    return Problem(move(problem.objective), rows, low, high)


@given(st.permutations(range(4)), st.integers(0, 10**6))
@settings(max_examples=8, deadline=None)
def test_relabelling_variables_does_not_change_the_dense_value(permutation, seed):
    x = sp.variables(4)
    rows = [x[0] * x[1] == 0.25, x[2] + x[3] <= 1]
    problem = Problem(chain(4, seed).objective, rows, [-1, -1, -1, 0], 1)
    moved = relabelled(problem, permutation)
    dense = [value(p, 2, cliques=find_cliques(p, sparse=False)) for p in (problem, moved)]
    assert dense[0] == pytest.approx(dense[1], abs=1e-5)


@given(st.permutations(range(5)), st.integers(0, 10**6))
@settings(max_examples=6, deadline=None)
def test_relabelling_variables_does_not_change_the_sparse_value_where_rows_have_one_home(
    permutation, seed
):
    """Each pair of neighbours on a disc: every constraint fits one clique only."""
    x = sp.variables(5)
    discs = [x[k] ** 2 + x[k + 1] ** 2 <= 1 for k in range(4)]
    problem = Problem(chain(5, seed).objective, discs)
    moved = relabelled(problem, permutation)
    assert value(moved, 2) == pytest.approx(value(problem, 2), abs=1e-5)


def test_relabelling_variables_does_not_change_the_sparse_value_of_a_boxed_problem():
    x, y, z = sp.variables(3)
    f = -3 * x - 3 * y + 3 * z - x * y - 3 * y * z - (y * z) ** 2
    problem = Problem(f, lower=-1, upper=1)
    moved = relabelled(problem, (2, 1, 0))
    assert value(moved, 2) == pytest.approx(value(problem, 2), abs=1e-5)


@given(st.integers(0, 10**6))
@settings(max_examples=6, deadline=None)
def test_sparse_is_at_most_dense_is_at_most_attained(seed):
    problem = chain(3, seed)
    sparse = value(problem, 2)
    dense = value(problem, 2, cliques=find_cliques(problem, sparse=False))
    grid = np.array(list(product(np.linspace(-1, 1, 21), repeat=3)))
    attained = float(problem.objective(grid).min())
    assert sparse <= dense + 1e-6
    assert dense <= attained + 1e-6


@given(st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_lean_is_weaker_and_a_higher_order_is_stronger(seed):
    rng = np.random.default_rng(seed)
    x = sp.variables(3)
    terms = [c * v for c, v in zip(rng.normal(size=3), x, strict=True)]
    terms += [
        c * x[i] * x[j] for c, i, j in zip(rng.normal(size=3), (0, 1, 0), (1, 2, 2), strict=True)
    ]
    problem = Problem(sp.total(terms), [x[0] + x[1] + x[2] <= 1], -1, 1)
    first, second, third = (value(problem, order) for order in (1, 2, 3))
    assert value(problem, 2, lean=True) <= second + 1e-6
    assert first <= second + 1e-6
    assert second <= third + 1e-6
    grid = np.array(list(product(np.linspace(-1, 1, 21), repeat=3)))
    grid = grid[grid.sum(axis=1) <= 1]
    assert third <= problem.objective(grid).min() + 1e-6


def test_products_tighten_a_bilinear_problem():
    """min -x y with x + y <= 1 on [0, 1]^2: McCormick gives -1/2 at order 1, the truth is -1/4.

    Order 1 with the box as products alone allows x y = x = y = 1/2; the product of the row
    with x gives x y <= x - x^2, and the diagonal of the moment matrix the rest.
    """
    x, y = sp.variables(2)
    problem = Problem(-1 * x * y, [x + y <= 1], 0, 1)
    plain, tight = value(problem, 1), value(problem, 1, products=True)
    assert tight >= plain - 1e-6
    assert tight <= -0.25 + 1e-6
    assert tight == pytest.approx(-0.25, abs=1e-5)


def test_one_relaxation_serves_many_objectives():
    """Bounds of each variable on the disc of radius 1/2 around (0.2, -0.1)."""
    x, y = sp.variables(2)
    problem = Problem(x, [(x - 0.2) ** 2 + (y + 0.1) ** 2 <= 0.25, x * y <= 9], -1, 1)
    relaxation = relax(problem, 1)
    for f, expected in [(x, -0.3), (-1 * x, -0.7), (y, -0.6), (-1 * y, -0.4)]:
        solution = solve_conic(assemble(relaxation, f))
        assert solution.dual == pytest.approx(expected, abs=1e-6)
