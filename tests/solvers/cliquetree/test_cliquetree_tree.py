"""Elimination orders, the factorization on the tree and the dense kernels."""

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.solvers.cliquetree import analyse
from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.kernels.batched import largest_step, lower_inverse
from sparsepop_py.solvers.cliquetree.symbolic.elimination import amalgamate, eliminate, maximal
from sparsepop_py.solvers.cliquetree.symbolic.tree import Factor, plant


def some_cliques(kind, rng):
    """Cliques of column numbers, and how many columns there are."""
    if kind == "chain":
        return [np.arange(3 * k, 3 * k + 5) for k in range(20)], 62
    if kind == "tree":
        return [np.array([i, int(rng.integers(0, i))]) for i in range(1, 40)], 40
    if kind == "hub":
        return [np.array([0, 1, 2 + 2 * k, 3 + 2 * k]) for k in range(30)], 62
    if kind == "forest":
        return [np.arange(4 * k, 4 * k + 4) for k in range(5)], 22
    return [np.sort(rng.choice(30, 4, replace=False)) for _ in range(18)], 30


KINDS = ["chain", "tree", "hub", "forest", "random"]


def test_cliques_within_others_are_dropped():
    cliques = [np.array(c) for c in ([0, 1], [0, 1, 2], [2, 3], [3], [0, 1, 2], [])]
    assert [c.tolist() for c in maximal(cliques, 4)] == [[0, 1, 2], [2, 3]]


@pytest.mark.parametrize("slack", [1.0, 2.0])
@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_every_front_holds_what_it_receives(kind, joined, slack):
    cliques, columns = some_cliques(kind, np.random.default_rng(0))
    fronts = eliminate(cliques, columns, slack)
    if joined:
        fronts = amalgamate(fronts, columns)
    order = np.concatenate([f.pivots for f in fronts])
    assert sorted(order.tolist()) == list(range(columns))
    home = np.zeros(columns, int)
    for number, front in enumerate(fronts):
        home[front.pivots] = number
    sets = [set(f.pivots.tolist()) | set(f.update.tolist()) for f in fronts]
    for number, front in enumerate(fronts):
        if front.update.size:
            parent = int(home[front.update].min())
            assert parent > number
            assert set(front.update.tolist()) <= sets[parent]
    for clique in cliques:
        assert set(clique.tolist()) <= sets[int(home[clique].min())]


def test_a_chain_gets_a_shallow_tree_and_a_hub_is_the_root():
    cliques = [np.arange(3 * k, 3 * k + 5) for k in range(200)]
    assert plant(eliminate(cliques, 602, 2.0), 602).levels <= 10
    cliques, columns = some_cliques("hub", None)
    assert eliminate(cliques, columns, 2.0)[-1].pivots.tolist() == [0, 1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_factorization_solves_dense_sums_of_cliques(kind):
    rng = np.random.default_rng(1)
    cliques, columns = some_cliques(kind, rng)
    tree = plant(amalgamate(eliminate(maximal(cliques, columns), columns, 2.0), columns), columns)
    dense = np.eye(columns) * 1e-3
    factor = Factor(tree)
    owner = np.concatenate([np.full(c.size, k) for k, c in enumerate(cliques)])
    member = np.concatenate(cliques)
    first = np.concatenate([[0], np.cumsum([c.size for c in cliques])])
    spot = tree.locate(owner, member, first)
    for k, clique in enumerate(cliques):
        half = rng.normal(size=(clique.size, clique.size))
        dense[np.ix_(clique, clique)] += half @ half.T
        at = spot[first[k] : first[k + 1]][None, :]
        place = tree.pairs(at, np.ones(at.shape, bool))
        np.add.at(factor.entries, place.ravel(), (half @ half.T).ravel())
    alone = np.arange(columns)  # the diagonal
    spots = tree.locate(alone, alone, np.arange(columns + 1))[:, None]
    place = tree.pairs(spots, np.ones((columns, 1), bool)).ravel()
    np.add.at(factor.entries, place, np.full(columns, 1e-3))
    factor.refactor(0.0)
    right = rng.normal(size=columns)
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=1e-6)


def test_a_singular_sum_is_refused():
    tree = plant(eliminate([np.arange(3)], 3, 2.0), 3)
    factor = Factor(tree)
    factor.entries[:] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        factor.refactor(0.0)


def test_the_newton_matrix_is_that_of_the_definition():
    x = sp.variables(4)
    f = x[0] * x[1] + x[1] * x[2] + x[2] * x[3]
    problem = Problem(f, [x[0] + x[1] * x[2] == 0.25, x[1] - x[3] <= 0.5], -1, 1)
    program = sp.assemble(sp.relax(problem, 2, lean=True), f)
    numbers = Numbers.of(program, analyse(program))
    rng = np.random.default_rng(0)
    p, z = (numbers.cone.identity() for _ in range(2))
    for s in numbers.cone.stacks:
        for v in (p, z):
            half = rng.normal(size=s.shape)
            v[s.span] = (half @ half.swapaxes(1, 2)).ravel()
    p[numbers.cone.entries :] = rng.uniform(1, 2, numbers.cone.linear)
    columns = numbers.C.toarray().T
    weighed = np.array([numbers.cone.sandwich(p, c, z) for c in columns])
    expected = weighed @ columns.T + 3.0 * (numbers.Et @ numbers.E).toarray()
    factor = Factor(numbers.symbolic.tree)
    numbers.fill(factor.entries, numbers.fixed_entries(3.0), p, z)
    factor.refactor(0.0)
    right = rng.normal(size=program.q.size)
    again = expected @ factor.solve(right)
    np.testing.assert_allclose(again, right, atol=1e-6)


@pytest.mark.parametrize("count, size", [(1, 1), (3, 5), (40, 7), (2, 30), (2, 150)])
def test_triangular_inverses(count, size):
    rng = np.random.default_rng(size)
    lower = np.tril(rng.normal(size=(count, size, size))) + 4 * np.eye(size)
    found = np.ones_like(lower)
    lower_inverse(lower, found)
    np.testing.assert_allclose(found @ lower, np.tile(np.eye(size), (count, 1, 1)), atol=1e-9)
    assert not np.triu(found, 1).any()


@pytest.mark.parametrize("count", [1, 30, 200])
def test_the_largest_step_reaches_the_boundary(count):
    rng = np.random.default_rng(count)
    half = rng.normal(size=(count, 6, 6))
    start = half @ half.swapaxes(1, 2) + np.eye(6)
    direction = rng.normal(size=(count, 6, 6))
    direction = direction + direction.swapaxes(1, 2)
    inverse = np.linalg.inv(np.linalg.cholesky(start))
    step = largest_step(inverse, direction, 10.0)
    assert np.linalg.eigvalsh(start + step * direction).min() == pytest.approx(0.0, abs=1e-6)
    assert largest_step(inverse, start, 10.0) == 10.0
    assert largest_step(inverse, direction, 0.5 * step) == 0.5 * step
