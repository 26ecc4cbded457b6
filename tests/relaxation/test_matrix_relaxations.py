"""Relaxations of cones and matrices: Dirac measures, the definition, values, relabelling."""

from itertools import product

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import some_polynomial
from random_matrices import feasible_grid, matrix_at, random_matrix, random_problem

import sparsepop_py as sp
from sparsepop_py import assemble, relax, solve_conic
from sparsepop_py.algebra import monomials

SEEDS = st.integers(0, 2**32 - 1)
x, y = sp.variables(2)


def value(problem, order=None, solver="auto", **options):
    relaxation = relax(problem, order, **options)
    solution = solve_conic(assemble(relaxation, problem.objective), solver)
    assert solution.status in ("solved", "almost")
    return solution.dual


def blocks_at(relaxation, point):
    """Group, number, and matrix of every block of matrices, from the moments of a point."""
    exponents = monomials.to_exponents(relaxation.moments, point.size).toarray()
    moments = np.append(1.0, np.prod(point[None, :] ** exponents, axis=1))
    rows, offset = relaxation.entries @ moments, 0
    for group in relaxation.groups:
        part = rows[offset : offset + group.count * group.rows_each]
        offset += part.size
        if group.free:
            continue
        i, j = group.pairs
        for number, values in enumerate(part.reshape(group.count, -1)):
            matrix = np.zeros((group.size, group.size))
            matrix[i, j] = matrix[j, i] = values
            yield group, number, matrix


SHAPES = [
    {"order": 2},
    {"order": 3, "lean": True},
    {"order": 2, "terms": "sign"},
    {"order": 2, "terms": "components"},
    {"order": 2, "terms": "chordal"},
    {"order": 2, "products": True},
    {"shape": "linear"},
    {"shape": "mixed"},
    {"shape": "star"},
    {"shape": "split"},
]


@pytest.mark.parametrize("options", SHAPES, ids=str)
@settings(max_examples=8, deadline=None)
@given(seed=SEEDS)
def test_a_dirac_measure_satisfies_every_block(options, seed):
    """At x a block is G_pq(x) b(x) c(x), semidefinite where G(x) is."""
    problem = random_problem(seed)
    points, _ = feasible_grid(problem, 2)
    relaxation = relax(problem, **options)
    for point in [*points[:3], np.array([0.3, -0.9])]:
        feasible = problem.violation(point) == 0
        for group, number, matrix in blocks_at(relaxation, point):
            if group.place is not None:
                row = problem.constraints[group.generator[number] - 1]
                at = np.array(matrix_at(row, [p(point) for p in row.entries]), float)
                words = group.basis[number]
                basis = np.prod(np.append(1.0, point)[words], axis=1)
                place = group.place[number]
                expected = at[np.ix_(place, place)] * np.outer(basis, basis)
                assert matrix == pytest.approx(expected, abs=1e-12)
            if feasible:
                assert np.linalg.eigvalsh(matrix)[0] >= -1e-9


@pytest.mark.parametrize("options", SHAPES, ids=str)
def test_all_but_linear_relaxations_hold_the_matrix(options):
    v = sp.variables(3)
    rows = [sp.psd([[1, v[0] * v[1]], [v[0] * v[1], 1 + v[2]]]), sp.second_order(2, v[0], v[2])]
    problem = sp.Problem(v[0] + v[1] * v[2], rows, lower=-1, upper=1)
    relaxation = relax(problem, **options)
    held = [g.generator for g in relaxation.groups if g.place is not None]
    expected = set() if options == {"shape": "linear"} else {1, 2}
    assert set(np.concatenate([*held, np.zeros(0, int)]).tolist()) == expected


# ---- the same relaxation, written down with cvxpy -----------------------------------------------


def powers(n, degree):
    return [a for a in product(range(degree + 1), repeat=n) if sum(a) <= degree]


def added(a, b):
    return tuple(p + q for p, q in zip(a, b, strict=True))


def by_definition(problem, order):
    """The relaxation of an order for boxes [-1, 1], entry by entry."""
    n = problem.dimension
    moments = {a: cp.Variable() if sum(a) else 1.0 for a in powers(n, 2 * order)}

    def functional(polynomial, shift):
        exponents = polynomial.exponents.toarray().tolist()
        return sum(
            float(c) * moments[added(tuple(a), shift)]
            for a, c in zip(exponents, polynomial.coefficients, strict=True)
        )

    def localized(rows, degree):
        """[L(G_pq b c)], by pairs (p, b)."""
        basis = powers(n, order - (degree + 1) // 2)
        pairs = [(p, b) for p in range(len(rows)) for b in basis]
        return cp.bmat([[functional(rows[p][q], added(b, c)) for q, c in pairs] for p, b in pairs])

    one = x * 0 + 1
    asked = [localized([[one]], 0) >> 0]
    asked += [localized([[1 - v**2]], 2) >> 0 for v in (x, y)]
    for row in problem.constraints:
        asked.append(localized(matrix_at(row, row.entries), row.degree) >> 0)
    found = cp.Problem(cp.Minimize(functional(problem.objective, (0,) * n)), asked)
    return found.solve(solver=cp.CLARABEL)


@pytest.mark.parametrize("seed", [3, 5, 8, 11, 15])
def test_plain_is_the_relaxation_and_nothing_else(seed):
    problem = random_problem(seed)
    expected = by_definition(problem, 2)
    assert value(problem, 2) == pytest.approx(expected, abs=1e-5)
    result = sp.solve(problem, sp.Options(order=2, effort="plain", refine="none"))
    assert result.solver_value == pytest.approx(expected, abs=1e-5)
    assert expected - 1e-5 <= result.lower_bound <= expected + 1e-6


def test_what_follows_from_a_matrix_adds_no_block():
    """2 >= |(x, y)|: sizes are those of the arrow alone, whatever the order."""
    problem = sp.Problem(x + y, [sp.second_order(2 + x, x, y)])
    for order, moments in ((1, 3), (2, 6), (3, 10)):
        sizes = relax(problem, order, reduce=False).block_sizes
        inner = (order + 1) * order // 2
        assert sum(sizes.values()) <= 2
        assert max(sizes) == 3 * inner or order == 1
        assert max(set(sizes) - {3 * inner}, default=0) <= moments


# ---- values -------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
def test_the_matrix_of_the_interval(order):
    """[1 x; x 1] is semidefinite for |x| <= 1 (SparsePOP 3.03, run with SeDuMi: -1)."""
    assert value(sp.Problem(x, [sp.psd([[1, x], [x, 1]])]), order) == pytest.approx(-1, abs=1e-6)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("terms", ["none", "sign", "components", "chordal"])
def test_the_cone_of_the_disc(order, terms):
    """2 >= |(x, y)|, min x + y (SparsePOP 3.03, run with SeDuMi: -2.8284271)."""
    problem = sp.Problem(x + y, [sp.second_order(2, x, y)])
    assert value(problem, order, terms=terms) == pytest.approx(-2 * 2**0.5, abs=1e-6)


@pytest.mark.parametrize("solver", ["clarabel", "clarabel-moment", "cliquetree", "cvxpy:CLARABEL"])
def test_every_solver_takes_the_blocks(solver):
    problem = random_problem(5)
    assert value(problem, 2, solver) == pytest.approx(value(problem, 2, "clarabel"), abs=1e-5)


@settings(max_examples=6, deadline=None)
@given(SEEDS)
def test_relabelling_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    v = sp.variables(3)
    order = rng.permutation(3)
    built = []
    for w in (v, [v[k] for k in order]):
        again = np.random.default_rng(seed)
        rows = [random_matrix(again, w, 2, bool(again.integers(2)))]
        built.append(sp.Problem(some_polynomial(again, w, 2), rows, lower=-1, upper=1))
    one, other = built
    assert value(one, 2) == pytest.approx(value(other, 2), abs=1e-5)


@settings(max_examples=6, deadline=None)
@given(SEEDS)
def test_rows_and_columns_of_a_matrix_may_change_places(seed):
    """P G P' is semidefinite where G is; so are the coordinates of a cone."""
    rng = np.random.default_rng(seed)
    row = random_matrix(rng, (x, y), 3, False)
    table = matrix_at(row, row.entries)
    order = rng.permutation(3)
    turned = sp.psd([[table[i][j] for j in order] for i in order])
    f = some_polynomial(rng, (x, y), 2)
    one, other = (sp.Problem(f, [r], lower=-1, upper=1) for r in (row, turned))
    assert value(one, 2) == pytest.approx(value(other, 2), abs=1e-5)


def test_sign_symmetry_splits_the_matrix_and_keeps_the_value():
    """[1 x y; x y 1] with even objective: both variables may change sign together."""
    problem = sp.Problem(
        x**4 - x * y + y**2, [sp.psd([[1, x * y], [x * y, 1.5 - x**2]])], lower=-1, upper=1
    )
    whole, split = relax(problem, 2), relax(problem, 2, terms="sign")
    assert max(split.block_sizes) < max(whole.block_sizes)
    assert value(problem, 2, terms="sign") == pytest.approx(value(problem, 2), abs=1e-6)
