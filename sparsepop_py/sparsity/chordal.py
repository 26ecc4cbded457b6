"""Chordal extensions and clique trees of sparse graphs.

Graphs are symmetric sparse boolean matrices with an empty diagonal.

References
----------
J. R. S. Blair, B. Peyton, An introduction to chordal graphs and clique trees, in: Graph
Theory and Sparse Matrix Computation, Springer (1993) 1-29.
A. Berry, J. R. S. Blair, P. Heggernes, B. W. Peyton, Algorithmica 39 (2004) 287-298.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.budget import check, importing
from sparsepop_py.errors import ProblemError

__all__ = ["Members", "Method", "chordal_extension", "clique_tree", "incidence", "join"]

Method = Literal["auto", "min-degree", "min-fill", "mcs-m"]

_FILL_VARIABLES = 1000  # up to which "auto" tries minimum fill: 0.02 s at 500 variables
_MCS_VARIABLES = 300  # ... and MCS-M, which is quadratic: 0.06 s at 200 variables
_SMALL_CLIQUE = 10  # largest clique up to which a smaller one gains too little for MCS-M
_CYCLE = 3  # largest clique of any extension of a graph that has a cycle, at least
Members = tuple[tuple[int, ...], ...]


def incidence(row: NDArray[Any], variable: NDArray[Any], shape: tuple[int, int]) -> sps.csr_array:
    """Build the incidence matrix of groups (rows) and variables (columns)."""
    return sps.csr_array((np.ones(row.size, np.int32), (row, variable)), shape=shape)


def join(groups: sps.csr_array) -> sps.csr_array:
    """Build the adjacency of variables that share a row of ``groups``."""
    product = sps.coo_array(groups.T @ groups)
    row, column = product.coords
    off = row != column
    data = np.ones(np.count_nonzero(off), bool)
    graph = sps.csr_array((data, (row[off], column[off])), shape=product.shape)
    graph.sort_indices()
    return graph


def chordal_extension(
    graph: sps.csr_array, method: Method = "auto"
) -> tuple[sps.csr_array, NDArray[np.int64]]:
    """Extend a graph to a chordal one, with a perfect elimination order.

    Parameters
    ----------
    graph : (n, n) sparse bool
        Symmetric adjacency; a diagonal is ignored.
    method : {"auto", "min-degree", "min-fill", "mcs-m"}
        ``"min-degree"``: greedy minimum degree elimination, nearly linear on sparse problems.
        ``"min-fill"``: networkx's elimination by least fill. ``"mcs-m"``: MCS-M,
        whose fill is minimal but which needs quadratic time. ``"auto"``: minimum degree, and
        where that adds edges, makes cliques of more than three and the graph is small enough for
        them, the two others too; the extension with the smallest largest clique is taken.

    Returns
    -------
    extended : (n, n) sparse bool
    order : (n,) int
        Vertices in elimination order.

    Raises
    ------
    ProblemError
        If ``method`` is unknown.

    References
    ----------
    A. Berry, J. R. S. Blair, P. Heggernes, B. W. Peyton, Algorithmica 39 (2004) 287-298.

    Examples
    --------
    A cycle of four variables gets one chord.

    >>> square = sps.csr_array(np.roll(np.eye(4), 1, axis=0) + np.roll(np.eye(4), -1, axis=0))
    >>> extended, order = chordal_extension(square)
    >>> extended.nnz // 2
    5
    """
    if method == "auto":
        return _smallest(graph)
    if method not in _METHODS:
        expected = ", ".join(map(repr, ("auto", *_METHODS)))
        raise ProblemError(f"method: found {method!r}, expected one of {expected}")
    return _METHODS[method](graph)


def _smallest(graph: sps.csr_array) -> tuple[sps.csr_array, NDArray[np.int64]]:
    """Take the extension with the smallest largest clique; ties by the cost of all cliques."""
    best = _min_degree(graph)
    n = graph.shape[0]
    if best[0].nnz == graph.nnz or n > _FILL_VARIABLES:  # chordal already, or large
        return best
    size = _cost(*best)
    if size[0] <= _CYCLE:
        return best
    for method, limit in (("min-fill", _FILL_VARIABLES), ("mcs-m", _MCS_VARIABLES)):
        if n > limit or (method == "mcs-m" and size[0] <= _SMALL_CLIQUE):
            continue
        other = _METHODS[method](graph)
        if _cost(*other) < size:
            best, size = other, _cost(*other)
    return best


def _cost(graph: sps.csr_array, order: NDArray[np.int64]) -> tuple[int, int]:
    """Count the largest clique, and the cubes of all fronts."""
    position = np.empty(order.size, np.int64)
    position[order] = np.arange(order.size)
    row, column = sps.coo_array(graph).coords
    later = position[row] < position[column]
    fronts = 1 + np.bincount(row[later], minlength=order.size)
    return int(fronts.max(initial=1)), int((fronts.astype(object) ** 3).sum())


def _min_degree(graph: sps.csr_array) -> tuple[sps.csr_array, NDArray[np.int64]]:
    order, rows = _eliminate(_neighbours(graph))
    return _filled(rows, graph.shape[0]), np.array(order, np.int64)


def _min_fill(graph: sps.csr_array) -> tuple[sps.csr_array, NDArray[np.int64]]:
    from networkx.algorithms.approximation import treewidth_min_fill_in

    _, bags = treewidth_min_fill_in(_networkx(graph))
    extended = _filled([list(bag) for bag in bags.nodes], graph.shape[0])
    return extended, _maximum_cardinality_order(_neighbours(extended))


def _mcs_m(graph: sps.csr_array) -> tuple[sps.csr_array, NDArray[np.int64]]:
    """Number vertices by largest weight; what is reached over smaller weights gains one.

    Weights of vertices between a vertex and what it reaches are smaller than that one's.
    """
    adjacent = [sorted(row) for row in _neighbours(graph)]
    weight, left = [0] * len(adjacent), list(range(len(adjacent)))
    edges: list[list[int]] = []
    while left:
        check()
        first = max(left, key=weight.__getitem__)
        left.remove(first)
        needed = _least_heights(adjacent, first, set(left), weight)
        for v in [v for v in left if needed.get(v, weight[v]) < weight[v]]:
            weight[v] += 1
            edges.append([first, v])
    extended = _filled(edges, graph.shape[0])
    return extended, _maximum_cardinality_order(_neighbours(extended))


def _least_heights(
    adjacent: list[list[int]], first: int, left: set[int], weight: list[int]
) -> dict[int, int]:
    """The least largest weight between a vertex and each that it reaches, -1 for neighbours."""
    height: dict[int, int] = {}
    queue = [(-1, v) for v in adjacent[first] if v in left]
    while queue:
        most, v = heapq.heappop(queue)
        if v in height:
            continue
        height[v] = most
        most = max(most, weight[v])
        for u in adjacent[v]:
            if u in left and u not in height:
                heapq.heappush(queue, (most, u))
    return height


_METHODS: dict[str, Callable[[sps.csr_array], tuple[sps.csr_array, NDArray[np.int64]]]] = {
    "min-degree": _min_degree,
    "min-fill": _min_fill,
    "mcs-m": _mcs_m,
}


def _filled(groups: list[list[int]], size: int) -> sps.csr_array:
    """Join the vertices of each group."""
    row = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    columns = np.array([v for group in groups for v in group], np.int64)
    return join(incidence(row, columns, (len(groups), size)))


def _networkx(graph: sps.csr_array) -> Any:
    with importing():
        import networkx as nx

    plain = nx.Graph()
    plain.add_nodes_from(range(graph.shape[0]))
    row, column = sps.coo_array(graph).coords
    off = row != column
    plain.add_edges_from(zip(row[off].tolist(), column[off].tolist(), strict=True))
    return plain


def _neighbours(graph: sps.csr_array) -> list[set[int]]:
    indices = graph.indices.tolist()
    rows = [set(indices[a:b]) for a, b in pairwise(graph.indptr.tolist())]
    for vertex, row in enumerate(rows):
        row.discard(vertex)
    return rows


# ---- elimination orders -----------------------------------------------------------------


def _eliminate(adjacent: list[set[int]]) -> tuple[list[int], list[list[int]]]:
    """Minimum degree elimination; consumes ``adjacent``.

    Returns the order and, for enough vertices to cover the filled graph, the vertex with
    its neighbours at the time of its elimination.
    """
    queue = [(len(row), v) for v, row in enumerate(adjacent)]
    heapq.heapify(queue)
    done = [False] * len(adjacent)
    order: list[int] = []
    rows: list[list[int]] = []
    while queue:
        size, v = heapq.heappop(queue)
        check()
        if done[v] or size != len(adjacent[v]):
            continue  # an entry that a later change of degree has replaced
        front = adjacent[v]
        rows.append([v, *front])
        for u in front:
            row = adjacent[u]
            row |= front
            row.discard(u)
            row.discard(v)
        # Vertices that now see nothing but the rest of the front have minimum degree and
        # make no fill: they go at once, which saves a cubic cost on large cliques.
        simplicial = sorted(u for u in front if len(adjacent[u]) == size - 1)
        for u in (v, *simplicial):
            done[u] = True
            order.append(u)
        for u in front.difference(simplicial):
            adjacent[u].difference_update(simplicial)
            heapq.heappush(queue, (len(adjacent[u]), u))
    return order, rows


def _maximum_cardinality_order(adjacent: list[set[int]]) -> NDArray[np.int64]:
    """Order a chordal graph for perfect elimination: maximum cardinality search, reversed."""
    weight = [0] * len(adjacent)
    queue = [(0, v) for v in range(len(adjacent))]
    done = [False] * len(adjacent)
    visited: list[int] = []
    while queue:
        _, v = heapq.heappop(queue)
        if done[v]:
            continue
        done[v] = True
        visited.append(v)
        for u in adjacent[v]:
            if not done[u]:
                weight[u] -= 1
                heapq.heappush(queue, (weight[u], u))
    return np.array(visited[::-1], np.int64)


# ---- cliques ----------------------------------------------------------------------------


def clique_tree(graph: sps.csr_array, order: NDArray[np.int64]) -> tuple[Members, NDArray[Any]]:
    """Build maximal cliques and clique tree of a chordal graph.

    A vertex with its later neighbours in the perfect elimination order is a clique; it is maximal
    unless a child in the elimination tree has exactly one later neighbour more (Blair, Peyton 1993,
    section 4.3).

    Parameters
    ----------
    graph : (n, n) sparse bool
    order : (n,) int
        A perfect elimination order.

    Returns
    -------
    members : tuple of sorted tuples of int
    tree : (K,) int
        Parent of each clique, -1 at roots.
    """
    n = graph.shape[0]
    position = np.empty(n, np.int64)
    position[order] = np.arange(n)
    later = sps.csr_array(sps.triu(graph[order][:, order], k=1))
    later.sort_indices()
    count = np.diff(later.indptr).tolist()
    starts, columns = later.indptr.tolist(), later.indices.tolist()
    owner = [-1] * n  # clique of each position
    first: list[int] = []
    links: list[tuple[int, int]] = []
    for p in range(n):
        if owner[p] < 0:
            owner[p] = len(first)
            first.append(p)
        if not count[p]:
            continue
        parent = columns[starts[p]]
        if owner[parent] < 0 and count[parent] == count[p] - 1:
            owner[parent] = owner[p]
        elif owner[parent] != owner[p]:
            links.append((owner[p], parent))
    names = order.tolist()
    members = [
        tuple(sorted([names[p], *(names[c] for c in columns[starts[p] : starts[p + 1]])]))
        for p in first
    ]
    return _root_tree(members, [(clique, owner[parent]) for clique, parent in links])


def _root_tree(
    members: list[tuple[int, ...]], links: list[tuple[int, int]]
) -> tuple[Members, NDArray[Any]]:
    """Order the cliques by their members as far as the running intersection allows.

    The elimination order would start a chain at its far end; the least clique of each
    component as root gives x1 x2, x2 x3, ... instead.
    """
    size = len(members)
    touching: list[list[int]] = [[] for _ in range(size)]
    for a, b in links:
        touching[a].append(b)
        touching[b].append(a)
    done = [False] * size
    number: list[int] = [-1] * size
    order: list[int] = []
    tree: list[int] = []
    queue: list[tuple[tuple[int, ...], int, int]] = []
    for root in sorted(range(size), key=members.__getitem__):
        if done[root]:
            continue
        heapq.heappush(queue, (members[root], root, -1))
        while queue:
            _, k, parent = heapq.heappop(queue)
            done[k], number[k] = True, len(order)
            order.append(k)
            tree.append(parent)
            for child in touching[k]:
                if not done[child]:
                    heapq.heappush(queue, (members[child], child, number[k]))
    return tuple(members[k] for k in order), np.array(tree, np.int64)
