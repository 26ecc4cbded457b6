"""Relaxations: what every feasible point must satisfy, sizes by formula, and values.

A feasible point x gives the moments y_a = x^a. Row by row they must reproduce the
definition: an equality h times a monomial is 0, and the block of a generator g over the
basis b is g(x) b(x) b(x)', which is positive semidefinite.
"""

from collections import Counter
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moment_cases import generator_values, monomial_values, planted

import sparsepop_py as sp
from sparsepop_py import Kind, Problem, ProblemError, assemble, relax, solve_conic
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.sparsity.correlative import find_cliques

INF = np.inf


# ---- Dirac measures ----------------------------------------------------------------------


def check_dirac(problem, relaxation, x):
    y = np.concatenate([[1.0], monomial_values(relaxation.moments, x)])
    rows = relaxation.entries @ y
    g = generator_values(problem, relaxation.products, x)
    offset = 0
    for group in relaxation.groups:
        total = group.count * group.rows_each
        part = rows[offset : offset + total].reshape(group.count, group.rows_each)
        offset += total
        b = monomial_values(group.basis, x)
        if group.free:
            expected = g[group.generator][:, None] * b
            assert np.allclose(expected, 0.0)
            assert np.all(problem.equality[group.generator - 1])
        else:
            i, j = group.pairs
            expected = g[group.generator][:, None] * b[:, i] * b[:, j]
            matrix = np.zeros((group.count, group.size, group.size))
            matrix[:, i, j] = matrix[:, j, i] = part
            scale = 1.0 + np.abs(matrix).max(initial=0.0)
            assert np.linalg.eigvalsh(matrix).min(initial=0.0) >= -1e-9 * scale
        assert np.allclose(part, expected, rtol=1e-9, atol=1e-9)
    assert offset == relaxation.rows == rows.size
    if np.all(relaxation.moment_numbers(problem.objective.words) >= 0):
        f, constant = relaxation.objective_vector(problem.objective)
        assert np.isclose(f @ y[1:] + constant, problem.objective(x), rtol=1e-9, atol=1e-9)
    else:  # monomials leave only where a variable lacks bounds or is fixed
        assert np.any(np.isinf(problem.upper - problem.lower) | (problem.upper == problem.lower))


@given(planted(), st.integers(1, 3), st.booleans(), st.booleans(), st.booleans(), st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_dirac_measure_satisfies_every_block(planted_, order, sparse, lean, products, reduce):
    problem, point = planted_
    fixed = problem.lower == problem.upper
    reduce &= not any(  # see the next test
        np.any(fixed[c.polynomial.support]) for c in problem.constraints if c.kind is Kind.ZERO
    )
    cliques = find_cliques(problem, sparse=sparse)
    relaxation = relax(problem, order, cliques=cliques, lean=lean, products=products, reduce=reduce)
    check_dirac(problem, relaxation, point)


def test_a_fixed_variable_in_an_equality_can_be_reduced():
    x, y = sp.variables(2)
    problem = Problem(y, [x == 0], [0, -1], [0, 1])
    check_dirac(problem, relax(problem, 1), np.array([0.0, 0.5]))


@pytest.mark.parametrize("lean", [False, True])
@pytest.mark.parametrize(
    "problem",
    [sp.problems.broyden_tridiagonal(6), sp.problems.rosenbrock(6), sp.problems.chained_wood(8)],
)
def test_a_dirac_measure_satisfies_the_relaxations_of_the_literature(problem, lean):
    boxed = Problem(problem.objective, problem.constraints, -2, 2)
    check_dirac(boxed, relax(boxed, 2, lean=lean), np.linspace(-1, 1, problem.dimension))


def test_rows_are_normalised_to_svec_in_the_conic_program():
    """Off-diagonal rows of blocks carry sqrt 2: |s|^2 is the squared Frobenius norm."""
    x, y = sp.variables(2)
    problem = Problem(x * y, [x**2 + y**2 == 1, x >= y], -1, 1)
    relaxation = relax(problem, 2)
    A, b = relaxation.scaled_rows
    point = np.array([0.8, 0.6])
    s = b - A @ monomial_values(relaxation.moments, point)
    g = generator_values(problem, relaxation.products, point)
    offset = 0
    for group in relaxation.groups:
        for generator, basis in zip(group.generator, group.basis, strict=True):
            part = s[offset : offset + group.rows_each]
            offset += group.rows_each
            norm = np.sum(monomial_values(basis, point) ** 2)
            expected = g[generator] ** 2 * norm * (1 if group.free else norm)
            assert np.isclose(part @ part, expected, atol=1e-12)


# ---- sizes -------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "order"), [(1, 1), (1, 3), (2, 2), (3, 1), (3, 2), (4, 2), (2, 4)])
def test_sizes_of_dense_boxed_problems_are_binomials(n, order):
    x = sp.variables(n)
    problem = Problem(sp.total(x) ** 2, [sp.total(x) >= -0.5], -1, 1)
    relaxation = relax(problem, order, cliques=find_cliques(problem, sparse=False))
    main, side = comb(n + order, order), comb(n + order - 1, order - 1)
    expected = Counter({main: 1})
    expected[side] += n + 1
    assert relaxation.block_sizes == expected
    assert relaxation.moments.shape[0] == comb(n + 2 * order, 2 * order) - 1
    rows = main * (main + 1) // 2 + (n + 1) * side * (side + 1) // 2
    assert relaxation.rows == rows
    assert relaxation.equality_rows == 0


@pytest.mark.parametrize(("degree", "order"), [(1, 1), (1, 2), (2, 2), (3, 2), (3, 3), (4, 2)])
def test_equalities_and_inequalities_of_each_degree_get_their_share(degree, order):
    n = 3
    x = sp.variables(n)
    row = x[0] ** degree + x[1] * 0.5
    cases = {
        "ge": Problem(sp.total(x), [row >= -2], -1, 1),
        "eq": Problem(sp.total(x), [row == 0], -1, 1),
    }
    built = {
        key: relax(p, order, cliques=find_cliques(p, sparse=False), reduce=False)
        for key, p in cases.items()
    }
    side = comb(n + order - (degree + 1) // 2, n)
    box = comb(n + order - 1, n)
    expected = Counter({comb(n + order, n): 1})
    expected[box] += n
    assert built["eq"].block_sizes == expected
    expected[side] += 1
    assert built["ge"].block_sizes == expected
    assert built["eq"].equality_rows == comb(n + 2 * order - degree, n)


def test_lean_bounds_are_two_linear_blocks_each():
    """Order 2: x - l and u - x times the squares of degree 1; the squares of x^2 leave."""
    x, y = sp.variables(2)
    relaxation = relax(Problem(x * y, lower=-1, upper=1), 2, lean=True)
    blocks = [
        (int(generator), group.size) for group in relaxation.groups for generator in group.generator
    ]
    # one clique; 0 is the moment matrix, then box (1, 2), lower (3, 4) and upper (5, 6)
    assert sorted(blocks) == [(0, 3), (3, 3), (4, 3), (5, 3), (6, 3)]


def test_sparse_blocks_have_the_size_of_their_cliques():
    problem = Problem(sp.problems.rosenbrock(6).objective, lower=-1, upper=1)
    relaxation = relax(problem, 2)
    # 5 cliques of 2 variables, each with the bounds of both
    assert relaxation.block_sizes == Counter({6: 5, 3: 10})
    assert all(
        np.all(np.diff(g.basis[:, :, -1].max(axis=1)) >= 0) or g.count for g in relaxation.groups
    )


def test_groups_come_in_the_order_of_the_cones():
    x, y = sp.variables(2)
    problem = Problem(x * y, [x**2 == y, x + y >= 0], -1, 1)
    relaxation = relax(problem, 1)
    order = [(not g.free, g.size) for g in relaxation.groups]
    assert order == sorted(order)
    assert len(set(order)) == len(order)
    program = assemble(relaxation, problem.objective)
    assert program.cones.rows == program.b.size == relaxation.rows
    assert program.cones.zero == relaxation.equality_rows


def test_no_moment_is_repeated_or_constant():
    problem = Problem(sp.problems.broyden_tridiagonal(8).objective, lower=-1, upper=1)
    relaxation = relax(problem, 2)
    assert np.unique(relaxation.moments, axis=0).shape == relaxation.moments.shape
    assert relaxation.moments.any(axis=1).all()
    assert np.array_equal(
        relaxation.moment_numbers(relaxation.moments),
        1 + np.arange(relaxation.moments.shape[0]),
    )


def test_fixed_variables_stay_out_of_the_bases():
    x, _, z = sp.variables(3)
    problem = Problem(x * z, [x + z >= 0], [-1, 0, -1], [1, 0, 1])
    relaxation = relax(problem, 2, cliques=find_cliques(problem, sparse=False))
    for group in relaxation.groups:
        assert not np.any(group.basis == 2)
    assert max(relaxation.block_sizes) == comb(2 + 2, 2)


# ---- orders, messages --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degree", "least"), [(1, 1), (2, 1), (3, 2), (4, 2), (5, 3), (6, 3), (7, 4)]
)
def test_the_order_is_raised_with_a_note(degree, least):
    x = sp.variables(1)[0]
    for problem in (
        Problem(x**degree, lower=-1, upper=1),
        Problem(x, [x**degree == 0], lower=-1, upper=1),
    ):
        assert least_order(problem) == least
        assert relax(problem).order == least
        assert relax(problem).notes == ()
        assert relax(problem, least).notes == ()
        assert relax(problem, least + 1).order == least + 1
        if least > 1:
            raised = relax(problem, least - 1)
            assert raised.order == least
            assert raised.notes == (
                f"order {least - 1} raised to {least}, the least for these degrees",
            )
            assert "note: order" in str(raised)


def test_a_partial_order_leaves_out_what_it_does_not_reach():
    """x + y is at least -sqrt 2 on the disc, whatever the constraints of degree four say."""
    x, y, z = sp.variables(3)
    disc, matrix = x**2 + y**2 <= 1, sp.psd([[2 + x**4, y], [y, 2]])
    rows = [disc, x**4 + y**4 <= 0.1, matrix, x**3 * y == z]
    problem = Problem(x + y, rows, -1, 1)
    assert relax(problem, 1).order == 2
    partial = relax(problem, 1, partial=True)
    assert partial.order == 1 and partial.notes == ()
    used = {int(g) for group in partial.groups for g in group.generator}
    assert {0, 1} <= used and not {2, 3, 4} & used
    assert {2, 3, 4} <= {int(g) for group in relax(problem, 2).groups for g in group.generator}
    solution = solve_conic(assemble(partial, problem.objective))
    assert float(np.sum(solution.y[:2])) == pytest.approx(-np.sqrt(2.0), abs=1e-5)


def test_further_objectives_raise_the_order_and_find_their_moments():
    x, y = sp.variables(2)
    problem = Problem(x + y, lower=-1, upper=1)
    extra = x**3 * y
    relaxation = relax(problem, 1, objectives=[extra])
    assert relaxation.order == 2
    vector, constant = relaxation.objective_vector(extra + 2.0)
    assert constant == 2.0
    assert vector.sum() == 1.0
    assert relaxation.moments[np.flatnonzero(vector)].tolist() == [[1, 1, 1, 2]]


def test_an_objective_outside_the_relaxation_is_named():
    x, y, z = sp.variables(3, ["a", "b", "c"])
    relaxation = relax(Problem(x * y + z, lower=-1, upper=1), 1)
    with pytest.raises(ProblemError, match=r"the monomial b\*c is not among the moments"):
        relaxation.objective_vector(y * z)
    with pytest.raises(ProblemError, match=r"the monomial a\^5"):
        relaxation.objective_vector(x**5 + y)


def test_an_unbounded_problem_can_be_put_on_its_own_relaxation():
    x, y = sp.variables(2)
    problem = Problem(x * y, [x + y >= 0])
    program = assemble(relax(problem, 1), problem.objective)
    assert solve_conic(program).status == "unbounded"


def test_printing_shows_cliques_blocks_and_sizes():
    problem = Problem(sp.problems.rosenbrock(4).objective, lower=-1, upper=1)
    relaxation = relax(problem, 2)
    text = str(relaxation)
    assert "order 2: 4 variables, 3 cliques" in text
    assert "clique sizes   2 x 3" in text
    assert "block sizes    3 x 6, 6 x 3" in text
    # moments of degree <= 4 in {k, k+1}: three cliques less the two shared variables
    count = 3 * (comb(6, 2) - 1) - 2 * 4
    assert f"moments M = {count}, conic rows R = {6 * 6 + 3 * 21} (0 equalities)" in text
