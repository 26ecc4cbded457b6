"""Cliques: counts known from the literature, and the properties that proofs rely on."""

from collections import Counter

import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sps
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import problems
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem
from sparsepop_py.sparsity import chordal
from sparsepop_py.sparsity.correlative import (
    Cliques,
    chordal_extension,
    csp_graph,
    find_cliques,
    satisfies_running_intersection,
)


def as_networkx(graph):
    row, column = sps.coo_array(graph).coords
    plain = nx.Graph()
    plain.add_nodes_from(range(graph.shape[0]))
    plain.add_edges_from(zip(row.tolist(), column.tolist(), strict=True))
    return plain


def errors_in_variables(samples):
    """Row k: 5 shared variables and eta, xi at k, k-1, k-2 (a second order model)."""
    n = 5 + 2 * samples
    rows = []
    for k in range(2, samples):
        eta, xi = 6 + k, 6 + samples + k
        words = [(0, eta), (1, eta - 1), (2, eta - 2), (3, xi), (4, xi - 1), (5, xi - 2)]
        polynomial = Polynomial.from_words(np.array(words, np.int32), np.ones(6), n)
        rows.append(Constraint(polynomial, Kind.ZERO))
    return Problem(sp.variables(n)[0], rows, lower=-1, upper=1)


def relabelled(problem, permutation):
    def move(polynomial):
        table = np.concatenate([[0], permutation + 1]).astype(np.int32)
        words = np.sort(table[polynomial.words], axis=1)
        return Polynomial.from_words(words, polynomial.coefficients, polynomial.dimension)

    rows = [Constraint(move(c.polynomial), c.kind) for c in problem.constraints]
    return Problem(move(problem.objective), rows)


def check(cliques, problem):
    """Everything that holds for the cliques of any problem."""
    graph = as_networkx(cliques.graph)
    assert nx.is_chordal(graph)
    edges = {frozenset(edge) for edge in as_networkx(csp_graph(problem)).edges}
    assert edges <= {frozenset(edge) for edge in graph.edges}
    assert sorted(cliques.members) == sorted(tuple(sorted(c)) for c in nx.find_cliques(graph))
    assert satisfies_running_intersection(cliques)
    assert np.count_nonzero(cliques.tree < 0) == nx.number_connected_components(graph)
    assert sorted(cliques.order.tolist()) == list(range(problem.dimension))
    left = graph.copy()
    for vertex in cliques.order.tolist():
        neighbours = list(left[vertex])
        assert all(left.has_edge(a, b) for a in neighbours for b in neighbours if a != b)
        left.remove_node(vertex)
    sets = [set(clique) for clique in cliques.members]
    for home, row in zip(cliques.home, problem.constraints, strict=True):
        assert home == largest(sets, set(row.polynomial.support.tolist()))
    assert cliques.home_of_variable.tolist() == [
        largest(sets, {v}) for v in range(problem.dimension)
    ]


def largest(sets, wanted):
    """Brute force: the largest clique containing the wanted variables, first on ties."""
    if not wanted:
        return 0
    return max((len(s), -k) for k, s in enumerate(sets) if wanted <= s)[1] * -1


CHAINS = [
    (problems.broyden_tridiagonal, 20, {3: 18}),
    (problems.broyden_tridiagonal, 1000, {3: 998}),
    (problems.broyden_banded, 20, {7: 14}),
    (problems.rosenbrock, 20, {2: 19}),
    (problems.rosenbrock, 1000, {2: 999}),
    (problems.chained_wood, 20, {2: 19}),
    (problems.chained_wood, 200, {2: 199}),
    (problems.chained_singular, 20, {3: 18}),
    (problems.chained_singular, 200, {3: 198}),
]


@pytest.mark.parametrize(("generator", "n", "expected"), CHAINS)
def test_clique_counts_of_the_literature(generator, n, expected):
    problem = generator(n)
    cliques = find_cliques(problem)
    assert Counter(cliques.sizes.tolist()) == expected
    if n <= 20:
        check(cliques, problem)
    assert satisfies_running_intersection(cliques)


@pytest.mark.parametrize("generator", [problems.broyden_tridiagonal, problems.chained_singular])
def test_mcs_m_agrees(generator):
    problem = generator(20)
    cliques = find_cliques(problem, method="mcs-m")
    check(cliques, problem)
    assert Counter(cliques.sizes.tolist()) == {3: 18}


@given(st.permutations(range(16)))
@settings(max_examples=20, deadline=None)
def test_relabelling_keeps_the_sizes_of_chains(permutation):
    for generator in (problems.broyden_tridiagonal, problems.rosenbrock, problems.chained_singular):
        problem = generator(16)
        moved = relabelled(problem, np.array(permutation))
        cliques = find_cliques(moved)
        assert sorted(cliques.sizes) == sorted(find_cliques(problem).sizes)
        check(cliques, moved)


@given(st.integers(0, 10**6), st.integers(1, 14), st.integers(0, 12))
@settings(max_examples=60, deadline=None)
def test_random_problems(seed, n, m):
    rng = np.random.default_rng(seed)
    x = sp.variables(n)

    def random_polynomial():
        chosen = rng.choice(n, min(n, int(rng.integers(1, 4))))
        return sp.total([x[0] * 0.0, 1.0, *(x[v] ** 2 for v in chosen)])

    objective = x[int(rng.integers(n))] * x[int(rng.integers(n))]
    problem = Problem(objective, [random_polynomial() >= 0 for _ in range(m)])
    for method in ("min-degree", "mcs-m"):
        check(find_cliques(problem, method=method), problem)


def test_errors_in_variables_has_cliques_of_eleven():
    cliques = find_cliques(errors_in_variables(1000))
    assert cliques.graph.shape == (2005, 2005)
    assert Counter(cliques.sizes.tolist()) == {11: 998}
    assert sorted(cliques.home.tolist()) == list(range(998))
    assert satisfies_running_intersection(cliques)
    small = errors_in_variables(12)
    check(find_cliques(small), small)


def test_chains_are_listed_in_natural_order():
    cliques = find_cliques(problems.rosenbrock(6))
    assert cliques.members == tuple((k, k + 1) for k in range(5))
    assert cliques.tree.tolist() == [-1, 0, 1, 2, 3]


def test_dense():
    problem = problems.rosenbrock(5)
    cliques = find_cliques(problem, sparse=False)
    assert cliques.members == ((0, 1, 2, 3, 4),)
    assert cliques.graph.nnz == 20
    assert cliques.tree.tolist() == [-1]
    assert cliques.home_of_variable.tolist() == [0] * 5
    one_row = Problem(sp.total([v * v for v in sp.variables(5)]), [sp.total(sp.variables(5)) >= 1])
    assert find_cliques(one_row).members == cliques.members


def test_isolated_and_absent_variables_are_cliques_of_one():
    x = sp.variables(4)
    problem = Problem(x[0] * x[2], [x[3] >= 0, x[0] * 0.0 + 1.0 >= 0])
    cliques = find_cliques(problem)
    assert cliques.members == ((0, 2), (1,), (3,))
    assert cliques.home.tolist() == [2, 0]
    check(cliques, problem)


def test_extra_objectives_join_the_pattern():
    x = sp.variables(3)
    problem = Problem(x[0] + x[1] + x[2])
    assert csp_graph(problem).nnz == 0
    assert find_cliques(problem, objectives=[x[0] * x[2]]).members == ((0, 2), (1,))
    with pytest.raises(ProblemError, match="objectives"):
        csp_graph(problem, [sp.variables(2)[0]])


def test_zero_objective_and_no_variables_in_rows():
    x = sp.variables(2)
    assert find_cliques(Problem(x[0] * 0.0)).members == ((0,), (1,))


def test_unknown_method_is_named():
    with pytest.raises(ProblemError, match="method: found 'amd'"):
        chordal_extension(csp_graph(problems.rosenbrock(3)), "amd")


def test_running_intersection_is_judged():
    good = find_cliques(problems.rosenbrock(4))
    orphans = np.full(3, -1)
    bad = Cliques(good.members, good.home, good.home_of_variable, orphans, good.graph, good.order)
    assert not satisfies_running_intersection(bad)
    late = Cliques(
        good.members[::-1], good.home, good.home_of_variable, good.tree, good.graph, good.order
    )
    assert satisfies_running_intersection(late)
    mixed = tuple(good.members[k] for k in (0, 2, 1))
    assert not satisfies_running_intersection(
        Cliques(mixed, good.home, good.home_of_variable, good.tree, good.graph, good.order)
    )


def test_histogram():
    assert str(find_cliques(problems.rosenbrock(5))).splitlines() == [
        "4 cliques of 5 variables",
        "       4 of size 2",
        "running intersection property: holds",
        "clique tree (shared with parent):",
        "  x1 x2",
        "    x2 x3  (x2)",
        "      x3 x4  (x3)",
        "        x4 x5  (x4)",
    ]


def test_a_long_clique_tree_is_cut_short_when_printed():
    lines = str(find_cliques(problems.rosenbrock(40))).splitlines()
    assert lines[-1].strip() == "... 27 more"  # 39 cliques, 12 shown


def near_points(seed, count=200, reach=0.0115):
    """Graph of random points of the unit square that are near each other."""
    points = np.random.default_rng(seed).random((count, 2))
    square = ((points[:, None] - points[None]) ** 2).sum(axis=-1)
    return sps.csr_array((square < reach) & ~np.eye(count, dtype=bool))


def largest_clique(extended):
    return max(map(len, nx.chordal_graph_cliques(as_networkx(extended))))


METHODS = ("min-degree", "min-fill", "mcs-m")


@pytest.mark.parametrize("seed", [3, 4, 9])
def test_auto_takes_the_smallest_largest_clique(seed):
    graph = near_points(seed)
    sizes = {method: largest_clique(chordal_extension(graph, method)[0]) for method in METHODS}
    assert len(set(sizes.values())) > 1  # the choice matters
    assert largest_clique(chordal_extension(graph)[0]) == min(sizes.values())


def test_auto_ends_at_triangles(monkeypatch):
    """Any extension of a ring has triangles: no other heuristic makes smaller cliques."""

    def refused(graph):
        raise AssertionError("a heuristic was run that can gain nothing")

    for method in METHODS[1:]:
        monkeypatch.setitem(chordal._METHODS, method, refused)
    ring = sps.csr_array(np.roll(np.eye(12), 1, axis=0) + np.roll(np.eye(12), -1, axis=0))
    extended, _ = chordal_extension(ring)
    assert largest_clique(extended) == 3
    assert extended.nnz // 2 == 12 + 9  # a triangulated polygon of 12 corners has 9 chords


@pytest.mark.parametrize("method", ["auto", *METHODS])
@pytest.mark.parametrize("seed", range(4))
def test_every_heuristic_returns_a_chordal_graph_and_a_perfect_order(method, seed):
    graph = near_points(seed, 60, 0.04)
    extended, order = chordal_extension(graph, method)
    plain = as_networkx(extended)
    assert nx.is_chordal(plain)
    assert all(plain.has_edge(*edge) for edge in as_networkx(graph).edges)
    place = {vertex: k for k, vertex in enumerate(order.tolist())}
    assert sorted(place) == list(range(60))
    for vertex in plain:
        later = [u for u in plain[vertex] if place[u] > place[vertex]]
        assert all(plain.has_edge(a, b) for a in later for b in later if a != b)


@pytest.mark.parametrize("seed", range(12))
def test_mcs_m_adds_the_edges_that_networkx_adds(seed):
    graph = near_points(seed, 40, 0.06)
    filled, _ = nx.complete_to_chordal_graph(as_networkx(graph))
    extended, _ = chordal_extension(graph, "mcs-m")
    assert {frozenset(edge) for edge in as_networkx(extended).edges} == {
        frozenset(edge) for edge in filled.edges
    }


def test_mcs_m_looks_at_the_clock_at_each_vertex(monkeypatch):
    looks = []
    monkeypatch.setattr(chordal, "check", lambda: looks.append(1))
    chordal_extension(near_points(0, 40, 0.06), "mcs-m")
    assert len(looks) >= 40


def test_an_unknown_heuristic_is_refused():
    with pytest.raises(ProblemError, match="method: found 'metis', expected one of 'auto'"):
        chordal_extension(near_points(0, 10), "metis")
