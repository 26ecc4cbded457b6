"""Shapes between order 1 and order 2: Dirac measures, covers, closed forms, grids, new names.

A feasible point x gives the moments y_a = x^a; row by row they must reproduce g(x) b(x) b(x)'
for the generator g and the basis b of the block. Bounds are held against closed forms,
McCormick's envelopes by linprog and grids.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from bilinear_problem import Bilinear
from hypothesis import given, settings
from hypothesis import strategies as st
from moment_cases import generator_values, monomial_values, planted
from random_cases import SEEDS, random_case
from relaxed import value
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py import Problem, assemble, relax, solve_conic
from sparsepop_py.problem.generators import stacked
from sparsepop_py.relaxation import hierarchy
from sparsepop_py.relaxation.shapes import Products, _Codes, mixed_sizes, shaped_blocks
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling

INF = np.inf
SHAPES = ("linear", "star", "split", "mixed")
JOINED = ("constraints", "monomials", "partners")


# ---- Dirac measures ----------------------------------------------------------------------


def check_dirac(problem, relaxation, x):
    """Every row is its definition, every equality row zero, every block semidefinite."""
    y = np.concatenate([[1.0], monomial_values(relaxation.moments, x)])
    rows = relaxation.entries @ y
    g = list(generator_values(problem, relaxation.products[:0], x))
    for first, second in relaxation.products.tolist():  # factors may be products themselves
        g.append(g[first] * g[second])
    g, offset = np.array(g), 0
    for group in relaxation.groups:
        total = group.count * group.rows_each
        part = rows[offset : offset + total].reshape(group.count, group.rows_each)
        offset += total
        b, own = monomial_values(group.basis, x), g[group.generator][:, None]
        if group.free:
            assert np.all(problem.equality[group.generator - 1])
            assert np.allclose(part, 0.0, atol=1e-9)
            continue
        i, j = group.pairs
        assert np.allclose(part, own * b[:, i] * b[:, j], rtol=1e-9, atol=1e-9)
        matrix = np.zeros((group.count, group.size, group.size))
        matrix[:, i, j] = matrix[:, j, i] = part
        scale = 1.0 + np.abs(matrix).max(initial=0.0)
        assert np.linalg.eigvalsh(matrix).min(initial=0.0) >= -1e-9 * scale
    assert offset == relaxation.rows == rows.size
    f, constant = relaxation.objective_vector(problem.objective)
    assert np.isclose(f @ y[1:] + constant, problem.objective(x), rtol=1e-9, atol=1e-9)


def quadratic(problem):
    """The same problem without rows and objective of degree above two."""
    rows = [c for c in problem.constraints if c.polynomial.degree <= 2]
    return Problem(problem.objective, rows, problem.lower, problem.upper)


@pytest.mark.parametrize("shape", SHAPES)
@given(planted(), st.sampled_from(JOINED), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_dirac_measure_satisfies_every_shape(shape, case, joined, products):
    problem, point = quadratic(case[0]), case[1]
    cliques = find_cliques(problem, joined=joined)
    check_dirac(problem, relax(problem, cliques=cliques, shape=shape, products=products), point)


@given(planted(), st.sampled_from(JOINED[1:]), st.integers(1, 2), st.booleans(), st.booleans())
@settings(max_examples=40, deadline=None)
def test_a_dirac_measure_satisfies_full_orders_on_other_cliques(
    case, joined, order, lean, products
):
    problem, point = case
    lower, upper = np.where(problem.lower > -INF, problem.lower, -1.0), problem.upper
    problem = replace(problem, lower=lower, upper=np.where(upper < INF, upper, 1.0))
    cliques = find_cliques(problem, joined=joined)
    fixed = np.any(problem.lower == problem.upper)
    relaxation = relax(
        problem, order, cliques=cliques, lean=lean, products=products, reduce=not fixed
    )
    check_dirac(problem, relaxation, point)


@pytest.mark.parametrize("joined", JOINED)
@pytest.mark.parametrize("shape", ["linear", "full"])
@pytest.mark.parametrize("seed", range(8))
def test_points_of_problems_of_any_degree(seed, shape, joined):
    case = random_case(seed)
    cliques = find_cliques(case.problem, joined=joined)
    relaxation = relax(case.problem, cliques=cliques, shape=shape, products=True)
    for point in case.points[:: max(1, len(case.points) // 5)]:
        check_dirac(case.problem, relaxation, point)


def identification(seed, centre=2, samples=5, low=-1.0):
    """Rows e_k a + f_k b = d_k with own e_k, f_k of each row, through a planted point."""
    rng = np.random.default_rng(seed)
    n = centre + centre * samples
    x = sp.variables(n)
    point = rng.integers(-3, 4, n) / 4
    rows = []
    for k in range(samples):
        own = centre + centre * k + np.arange(centre)
        p = sp.total([x[c] * x[int(v)] for c, v in enumerate(own)])
        p = p + float(rng.integers(1, 4)) * x[int(own[0])] + 0.5 * x[int(own[-1])]
        rows.append(p == p(point))
    weights = rng.integers(1, 4, n)
    objective = sp.total([float(w) * v for w, v in zip(weights, x, strict=True)])
    return Problem(objective, rows, low, 1.0), point


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(4))
def test_points_of_equations_around_a_centre(seed, shape):
    problem, point = identification(seed)
    relaxation = relax(problem, shape=shape, products=True)
    assert relaxation.equality_rows >= len(problem.constraints)
    check_dirac(problem, relaxation, point)
    wrong = point.copy()
    wrong[2] += 0.25 / (abs(point[0]) + 1.0)  # the first row is untrue there
    with pytest.raises(AssertionError):
        check_dirac(problem, relaxation, wrong)


# ---- which variables cover the products ----------------------------------------------------


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_the_cover_leaves_linear_terms(seed):
    problem = random_case(seed).problem
    rng = np.random.default_rng(seed)
    chosen = np.array(Products.of(problem).complicating, int)
    step = rng.integers(-4, 5, problem.dimension) / 4.0
    step[chosen] = 0.0
    at = rng.integers(-4, 5, problem.dimension) / 4.0
    for f in (problem.objective, *(c.polynomial for c in problem.constraints)):
        assert f(at + step) - f(at) == pytest.approx(f(at) - f(at - step), abs=1e-9)


def test_covers_known_by_hand():
    x = sp.variables(6)
    cases = [
        (x[0] + x[5], ()),
        (x[2] ** 2 + x[0], (2,)),
        (sp.total([x[3] * v for v in x[:3]]), (3,)),
        (x[0] * x[1] + x[1] * x[2] + x[2] * x[3] + x[3] * x[4], (1, 3)),
        (x[0] * x[1] * x[2], None),  # any two of the three
        (x[4] * x[4] * x[1], (4,)),
    ]
    for objective, expected in cases:
        found = Products.of(Problem(objective)).complicating
        assert len(found) == 2 if expected is None else found == expected
    # products of the rows and of further objectives count as well
    both = Products.of(Problem(x[0], [x[1] * x[2] + x[1] * x[3] <= 1]), [x[5] * x[4] + x[5] * x[0]])
    assert both.complicating == (1, 5)
    assert both.partners == {0: [5], 1: [2, 3], 2: [1], 3: [1], 4: [5], 5: [0, 4]}


@pytest.mark.parametrize("centre", [1, 2, 3])
def test_few_variables_that_face_many_make_a_star(centre):
    problem, _ = identification(0, centre, 6)
    products = Products.of(problem)
    assert products.complicating == tuple(range(centre))
    assert products.has_star
    x = sp.variables(4)
    assert not Products.of(Problem(x[0] * x[1] + x[2] * x[3])).has_star
    assert not Products.of(Problem(sp.total(x))).has_star


# ---- values --------------------------------------------------------------------------------


def bound(problem, shape, **options):
    """A solver's value of a shape with products of bounds."""
    return value(problem, None, shape=shape, products=True, **options)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(5))
def test_one_centre_in_a_box_is_solved_exactly(seed, shape):
    # min over c and all v of sum (a_i c + b_i) v_i = min over c of -sum |a_i c + b_i|, concave
    rng = np.random.default_rng(seed)
    a, b = rng.integers(1, 4, 5) * rng.choice([-1, 1], 5), rng.integers(-3, 4, 5)
    if shape != "linear":  # where bounds belong to columns, not to rows
        a[1] = 0
    c, *v = sp.variables(6)
    terms = [(float(p) * c + float(q)) * w for p, q, w in zip(a, b, v, strict=True)]
    exact = -max(np.abs(a + b).sum(), np.abs(b - a).sum())
    assert bound(Problem(sp.total(terms), [], -1, 1), shape) == pytest.approx(exact, abs=1e-5)


def least_in_square(h, g):
    """Least of x'hx + g'x on [-1, 1]^2: the inside, four edges, four corners."""
    points = [np.array(p, float) for p in itertools.product((-1, 1), (-1, 1))]
    if abs(np.linalg.det(h)) > 1e-9:
        points.append(np.linalg.solve(2 * h, -g))
    for fixed, side in itertools.product((0, 1), (-1.0, 1.0)):
        if h[1 - fixed, 1 - fixed] > 0:
            x = np.full(2, side)
            x[1 - fixed] = -(g[1 - fixed] + 2 * h[0, 1] * side) / (2 * h[1 - fixed, 1 - fixed])
            points.append(x)
    inside = [x for x in points if np.all(np.abs(x) <= 1)]
    return min(x @ h @ x + g @ x for x in inside)


@pytest.mark.parametrize("shape", ["star", "split", "mixed"])
@pytest.mark.parametrize("seed", range(6))
def test_quadratics_in_a_square_are_solved_exactly(seed, shape):
    # Anstreicher and Burer (2010): products of bounds and order 1 give the convex hull
    rng = np.random.default_rng(seed)
    h = rng.integers(-3, 4, (2, 2)) * 1.0
    h[0, 1] = h[1, 0] = rng.choice([-2.5, -1.0, 1.5])
    g = rng.integers(-4, 5, 2) * 1.0
    x, y = sp.variables(2)
    f = h[0, 0] * x**2 + 2 * h[0, 1] * x * y + h[1, 1] * y**2 + g[0] * x + g[1] * y
    found = bound(Problem(f, [], -1, 1), shape)
    assert found == pytest.approx(least_in_square(h, g), abs=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(8))
def test_between_the_envelopes_and_a_grid(seed, shape):
    made = Bilinear(seed, rows=2)
    axes = [np.arange(a, b + 0.1, 0.25) for a, b in zip(made.low, made.high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    x = x[np.all(x @ made.a.T <= made.b, axis=1)]
    products = np.stack([x[:, i] * x[:, j] for i, j in made.pairs], axis=1)
    found = bound(made.problem, shape)
    assert x.size
    assert found <= (x @ made.c + products @ made.q).min() + 1e-5
    assert found >= made.mccormick().fun - 1e-5


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", slow_after(1, range(3)))
def test_equations_around_a_centre_against_their_solutions(seed, shape):
    # for each (a, b) of a grid every row leaves an interval of its own two variables
    problem, point = identification(seed)
    found = bound(problem, shape)
    cost, least = problem.objective, INF
    for a, b in itertools.product(np.linspace(-1, 1, 17), repeat=2):
        total = cost(np.array([a, b, *np.zeros(problem.dimension - 2)]))
        for k, row in enumerate(problem.constraints):
            own = [2 + 2 * k, 3 + 2 * k]
            x = np.array([a, b, *np.zeros(problem.dimension - 2)])
            slope, weight = np.zeros(2), np.zeros(2)
            for position, v in enumerate(own):
                unit = x.copy()
                unit[v] = 1.0
                slope[position] = row.polynomial(unit) - row.polynomial(x)
                weight[position] = cost(unit) - cost(x)
            total += least_on_a_line(slope, -row.polynomial(x), weight)
        least = min(least, total)
    assert least <= cost(point) + 1e-9  # the planted point is on the grid
    assert found <= least + 1e-5


def least_on_a_line(slope, right, weight):
    """Least of weight'e with slope'e = right and -1 <= e <= 1: at an end, one e_i = +-1."""
    values = [INF]
    for i, side in itertools.product((0, 1), (-1.0, 1.0)):
        if abs(slope[1 - i]) > 1e-12:
            e = np.full(2, side)
            e[1 - i] = (right - slope[i] * side) / slope[1 - i]
            if abs(e[1 - i]) <= 1 + 1e-12:
                values.append(weight @ e)
    return min(values)


def test_one_row_of_products_with_a_known_answer():
    # c v_i = d_i, 1/2 <= v_i <= 1: c lies between the largest d_i and twice the smallest
    c, *v = sp.variables(5)
    d = [0.7, 0.6, 0.5, 0.65]
    rows = [c * w == right for w, right in zip(v, d, strict=True)]
    lower, upper = [0.0] + [0.5] * 4, [2.0] + [1.0] * 4
    for shape, (objective, exact) in itertools.product(SHAPES, [(c, 0.7), (-c, -1.0)]):
        found = bound(Problem(objective, rows, lower, upper), shape)
        assert found == pytest.approx(exact, abs=1e-5)


# ---- other names of the variables ----------------------------------------------------------


def relabelled_polynomial(f, order, x):
    """Variable v becomes x[order[v]]."""
    terms = [0.0 * x[0]]
    for word, coefficient in zip(f.words.tolist(), f.coefficients.tolist(), strict=True):
        term = coefficient * x[0] ** 0
        for letter in word:
            term = term * x[order[letter - 1]] if letter else term
        terms.append(term)
    return sp.total(terms)


def relabelled(problem, order):
    """Variable v becomes order[v]."""
    x, rows = sp.variables(problem.dimension), []
    for c in problem.constraints:
        f = relabelled_polynomial(c.polynomial, order, x)
        rows.append(f == 0 if c.kind is sp.Kind.ZERO else f >= 0)
    lower, upper = np.empty(problem.dimension), np.empty(problem.dimension)
    lower[order], upper[order] = problem.lower, problem.upper
    objective = relabelled_polynomial(problem.objective, order, x)
    return Problem(objective, rows, lower, upper)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_names_of_variables_do_not_matter(seed, shape):
    # one row has a variable more than the others: the largest clique is unique, as is the
    # home of each row and variable, which may depend on numbers else
    problem, point = identification(seed, samples=4, low=[-1.0] * 2 + [-0.75] * 8)
    x = [*sp.variables(problem.dimension + 1)]
    point = np.append(point, 0.25)
    rows = [c.polynomial for c in problem.constraints]
    rows = [relabelled_polynomial(f, range(point.size), x) for f in rows]
    rows[1] = rows[1] + x[-1] * x[0] - 0.25 * point[0]
    f = relabelled_polynomial(problem.objective, range(point.size), x)
    f = f - 2.0 * x[0] * x[2] + 1.5 * x[1] * x[5]
    rows = [*(g == 0 for g in rows), x[0] + x[1] <= 1.5]
    problem = Problem(f, rows, np.append(problem.lower, -1.0), 1.0)
    assert problem.violation(point) <= 1e-12
    order = np.random.default_rng(seed).permutation(problem.dimension)
    other, moved = relabelled(problem, order), np.empty(point.size)
    moved[order] = point
    assert other.objective(moved) == pytest.approx(problem.objective(point), abs=1e-12)
    assert sorted(order[:2].tolist()) == list(Products.of(other).complicating)
    assert bound(other, shape) == pytest.approx(bound(problem, shape), abs=1e-6)


# ---- constraints outside all cliques --------------------------------------------------------


def outside():
    """Two products with cliques of their own, and rows across them."""
    x = sp.variables(4)
    rows = [sp.total(x) >= -1, x[0] + x[2] == 0.25, x[0] * x[1] <= 0.5, x[2] * x[3] == 0.0]
    return Problem(x[0] * x[1] + x[2] * x[3] + x[3], rows, -1, 1)


@pytest.mark.parametrize("options", [{"order": 1}, {"order": 2}, {"shape": "mixed"}])
@pytest.mark.parametrize("products", [False, True])
def test_rows_outside_monomial_cliques_keep_constant_multipliers(options, products):
    problem = outside()
    cliques = find_cliques(problem, joined="monomials")
    assert sorted(cliques.members) == [(0, 1), (2, 3)]
    held = [set(cliques.members[k]) for k in cliques.home[2:]]
    assert cliques.home.tolist()[:2] == [-1, -1]
    assert held == [{0, 1}, {2, 3}]
    relaxation = relax(problem, **options, cliques=cliques, products=products)
    bases = {number: [] for number in (1, 2)}
    for group in relaxation.groups:
        for number, basis in zip(group.generator.tolist(), group.basis, strict=True):
            if number in bases:
                bases[number].append(basis)
    for found in bases.values():
        assert len(found) == 1  # each row is there, once
        assert not np.any(found[0])  # the constant alone
    assert not np.isin(relaxation.products, (1, 2)).any()
    check_dirac(problem, relaxation, np.array([0.25, 1.0, 0.0, -1.0]))
    # what these rows say is not lost: without the first one, (0.25, -1, 0, -1) is allowed
    solution = solve_conic(assemble(relaxation, problem.objective))
    assert solution.dual <= -0.75 + 1e-6  # x0 x1 + x3 at (0.25, 1, 0, -1) or at a better point


@pytest.mark.parametrize("seed", range(6))
def test_partner_cliques_hold_each_row_with_its_partners(seed):
    problem, _ = identification(seed, samples=3)
    x = sp.variables(problem.dimension)
    rows = [*problem.constraints, x[2] + x[4] <= 1.0]
    problem = Problem(problem.objective, rows, -1, 1)
    cliques = find_cliques(problem, joined="partners")
    assert np.all(cliques.home >= 0)
    met = {2: {0}, 4: {0}}
    assert any({2, 4} | met[2] | met[4] <= set(c) for c in cliques.members)
    for row, home in zip(problem.constraints, cliques.home.tolist(), strict=True):
        assert set(row.polynomial.support.tolist()) <= set(cliques.members[home])


def test_partners_may_stem_from_an_objective_alone():
    x, y, z = sp.variables(3)
    row = y + z >= 0.5  # y meets x in the objective only
    for problem, others in (
        (Problem(x * y, [row], -1, 1), ()),
        (Problem(z, [row], -1, 1), [x * y]),
    ):
        cliques = find_cliques(problem, objectives=others, joined="partners")
        assert cliques.members == ((0, 1, 2),)


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_mixed_blocks_are_counted_without_being_made(seed):
    rng = np.random.default_rng(seed)
    x = sp.variables(6)
    i, j = rng.integers(0, 6, (2, 5))
    rows = [x[a] * x[b] >= -1 for a, b in zip(i[:3].tolist(), j[:3].tolist(), strict=True)]
    problem = Problem(sp.total(x[a] * x[b] for a, b in zip(i, j, strict=True)), rows, -1, 1)
    cliques, objectives = find_cliques(problem), [problem.objective]
    system = stacked(problem, np.zeros((0, 2), np.int64))
    made = shaped_blocks("mixed", problem, cliques, system, objectives)
    counts = Counter[int]()
    for block in made:
        if not block.free and np.all(block.generator == 0):
            counts[block.size] += block.count
    assert mixed_sizes(problem, cliques, objectives) == counts


def test_dense_quadratics_are_too_large_without_being_built(monkeypatch):
    """All products of 125 variables: a block of 8001, whose system is beyond 5 GB."""

    def refused(*_):
        raise AssertionError("the blocks were made")

    monkeypatch.setattr(hierarchy, "shape_sizes", refused)
    x = sp.variables(125)
    problem = Problem(sp.total(x) ** 2, lower=-1.0, upper=1.0)
    box = Interval(problem.lower, problem.upper)
    scaled = Scaled.of(problem, Scaling.of_box(box), (problem.objective,))
    families = hierarchy.Families(problem, (problem.objective,), True, "auto")
    spec = hierarchy.RelaxationSpec("mixed", 0.8, "mixed", memory=5e9)
    assert spec.seconds(scaled, families) == INF


def test_codes_of_monomials_are_distinct_and_those_of_products_are_sums():
    """All monomials of degree 6 at most in four variables, against their sorted letters."""
    codes = _Codes(6)
    words = [w for d in range(7) for w in itertools.combinations_with_replacement((7, 2, 9, 4), d)]
    assert len({codes.of(word) for word in words}) == math.comb(4 + 6, 6)
    for left, right in itertools.product(words[:35], repeat=2):  # of degree 3 at most
        assert codes.of(left) + codes.of(right) == codes.of(tuple(sorted(left + right)))


def test_mixed_blocks_make_no_moments_beyond_those_of_their_bases():
    """Squares in the basis and in a row: x^2 x^2 x^2 is no product of two monomials of it."""
    x, y = sp.variables(2)
    problem = Problem(x**2 + x * y + y**2, [1 - x**2 - y >= 0], lower=-1, upper=1)
    made = relax(problem, cliques=find_cliques(problem), products=True, shape="mixed")
    assert max(np.count_nonzero(made.moments, axis=1)) == 4
