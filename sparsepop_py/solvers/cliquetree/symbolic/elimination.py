"""Fill-reducing elimination on a union of cliques: which columns leave together, and when.

The graph is never formed. It is held as its cliques (elements of the quotient graph), and
eliminating a column joins the cliques that hold it into one. Columns that lie in the same
cliques leave together, and columns of nearly least degree that do not touch each other leave
in one round, so that the tree of a chain has the depth of a bisection and not the length of
the chain.

References
----------
A. George, J. W. H. Liu, The evolution of the minimum degree ordering algorithm, SIAM Review
31, 1989 (quotient graph, mass elimination, indistinguishable nodes).
J. W. H. Liu, Modification of the minimum-degree algorithm by multiple elimination, ACM
Trans. Math. Softw. 11, 1985.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import check

__all__ = ["Front", "amalgamate", "eliminate", "front_seconds", "levels_of", "maximal", "parents"]

_CROWDED = 16  # a column in more cliques than this, and in a quarter of all, is a global one

_RATE = 2e10  # operations a second in products of small matrices; these four are rough, to
_TOUCH, _ADD = 1e-9, 3e-9  # compare orders by: seconds to clear an entry, to add one to a parent
_FRONT = 2e-6  # seconds of calls a front

Columns = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Columns that are eliminated together.

    Parameters
    ----------
    pivots : (E,) int
        The columns eliminated here.
    update : (U,) int
        The columns that these reach and that are eliminated later.
    """

    pivots: Columns
    update: Columns


def maximal(cliques: list[Columns], columns: int) -> list[Columns]:
    """Select cliques that are no subset of another one, largest first.

    Parameters
    ----------
    cliques : list of (C,) int
        Distinct column numbers each.
    columns : int
        Number of columns.

    Returns
    -------
    list of (C,) int
    """
    kept: list[Columns] = []
    sets: list[set[int]] = []
    holders: list[list[int]] = [[] for _ in range(columns)]
    for index in sorted(range(len(cliques)), key=lambda k: -cliques[k].size):
        members = cliques[index].tolist()
        if not members:
            continue
        rarest = min(members, key=lambda c: len(holders[c]))
        if any(sets[k].issuperset(members) for k in holders[rarest]):
            continue
        for column in members:
            holders[column].append(len(kept))
        kept.append(cliques[index])
        sets.append(set(members))
    return kept


def eliminate(cliques: list[Columns], columns: int, slack: float) -> list[Front]:
    """Build fronts in an order in which each comes after those that update it.

    Parameters
    ----------
    cliques : list of (C,) int
        Maximal cliques of column numbers.
    columns : int
        Number of columns; those in no clique become fronts of their own.
    slack : float
        In each round, columns of up to ``slack`` times the least degree may leave. One is the
        minimum-degree order, two makes shallow trees of chains at up to 2.7 times the work.
    """
    groups, held = _alike(cliques, columns)
    crowd = max(_CROWDED, len(cliques) // 4)
    crowded = {v for v, cs in enumerate(held) if len(cs) > crowd}
    graph = _Quotient(
        [set(cs) for cs in held],
        [int(g.size) for g in groups],
        crowded,
        len(cliques),
    )
    order = graph.run(slack)
    return [_front(pivots, update, groups) for pivots, update in order]


def _front(pivots: list[int], update: list[int], groups: list[Columns]) -> Front:
    def joined(nodes: list[int]) -> Columns:
        parts = [groups[v] for v in nodes]
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)

    return Front(joined(pivots), joined(update))


def _alike(cliques: list[Columns], columns: int) -> tuple[list[Columns], list[tuple[int, ...]]]:
    """Columns grouped by the cliques that hold them, and these cliques."""
    held: list[list[int]] = [[] for _ in range(columns)]
    for number, clique in enumerate(cliques):
        for column in clique.tolist():
            held[column].append(number)
    found: dict[tuple[int, ...], list[int]] = {}
    for column, numbers in enumerate(held):
        found.setdefault(tuple(numbers), []).append(column)
    return [np.array(g, np.int64) for g in found.values()], list(found)


class _Quotient:
    """The quotient graph during elimination: nodes, and elements that are sets of nodes.

    Degrees are bounds from above as in P. Amestoy, T. Davis, I. Duff, An approximate minimum
    degree ordering algorithm, SIAM J. Matrix Anal. Appl. 17, 1996, with their absorption of
    elements that a new one contains. Crowded nodes count for nothing and leave last.
    """

    def __init__(
        self, holder: list[set[int]], weight: list[int], crowded: set[int], elements: int
    ) -> None:
        self.holder = holder
        self.weight = weight
        self.element: dict[int, set[int]] = {e: set() for e in range(elements)}
        self.shared: dict[int, set[int]] = {e: set() for e in range(elements)}
        for node, numbers in enumerate(holder):
            for number in numbers:
                (self.shared if node in crowded else self.element)[number].add(node)
        self.size = {e: sum(weight[v] for v in vs) for e, vs in self.element.items()}
        self.joined = [[node] for node in range(len(holder))]
        self.crowded = crowded
        self.fresh = elements
        self.alive = set(range(len(holder))) - crowded
        self.degree = {
            v: sum(self.size[e] - weight[v] for e in holder[v]) for v in sorted(self.alive)
        }

    def run(self, slack: float) -> list[tuple[list[int], list[int]]]:
        """Eliminate all pivots; return them in order, with what they reach."""
        order: list[tuple[list[int], list[int]]] = []
        heap = sorted((d, v) for v, d in self.degree.items())
        while heap:
            if heap[0][1] not in self.alive or heap[0][0] != self.degree[heap[0][1]]:
                heappop(heap)
                continue
            limit = slack * max(heap[0][0], 1)
            touched: set[int] = set()
            self.fresh = len(self.size)
            check()
            while heap and heap[0][0] <= limit:
                degree, node = heappop(heap)
                if node not in self.alive or degree != self.degree[node] or node in touched:
                    continue
                pivots, reach, shared = self._leave(node)
                beyond = chain(sorted(reach), sorted(shared))
                order.append((self._members(pivots), self._members(beyond)))
                touched |= reach
            for node in touched & self.alive:
                heappush(heap, (self.degree[node], node))
        if self.crowded:
            order.append((sorted(self.crowded), []))
        return order

    def _leave(self, node: int) -> tuple[list[int], set[int], set[int]]:
        """Eliminate a node and all that now touch nothing but the clique it leaves."""
        gone = set(self.holder[node])
        reach: set[int] = set().union(*map(self.element.__getitem__, gone))
        reach.discard(node)
        for other in reach:
            self.holder[other] -= gone
        outside = self._outside(reach)
        within = [e for e, weight in outside.items() if weight == 0 and e < self.fresh]
        for number in within:  # absorbed, but for those made in this round
            for other in self.element[number]:
                self.holder[other].discard(number)
        gone.update(within)
        shared: set[int] = set().union(*map(self.shared.pop, gone))
        for number in gone:
            del self.element[number]
        pivots = [node, *sorted(other for other in reach if not self.holder[other])]
        reach.difference_update(pivots)
        self.alive.difference_update(pivots)
        if reach:
            reach = self._merge_alike(reach)
            self._join(reach, shared, outside)
        return pivots, reach, shared

    def _outside(self, reach: set[int]) -> dict[int, int]:
        """Weight that each element which meets ``reach`` has beyond it."""
        outside: dict[int, int] = {}
        for node in reach:
            weight = self.weight[node]
            for number in self.holder[node]:
                if number in outside:
                    outside[number] -= weight
                else:
                    outside[number] = self.size[number] - weight
        return outside

    def _merge_alike(self, reach: set[int]) -> set[int]:
        """Join nodes that became indistinguishable; what remains of ``reach``."""
        first: dict[frozenset[int], int] = {}
        kept = set(reach)
        for node in sorted(reach):
            chosen = first.setdefault(frozenset(self.holder[node]), node)
            if chosen == node:
                continue
            self.joined[chosen] += self.joined[node]
            self.weight[chosen] += self.weight[node]
            self.alive.discard(node)
            kept.discard(node)
            for number in self.holder[node]:
                self.element[number].discard(node)
        return kept

    def _join(self, reach: set[int], shared: set[int], outside: dict[int, int]) -> None:
        """Make a new element and bound the degrees of its nodes."""
        number = len(self.size)
        total = sum(map(self.weight.__getitem__, reach))
        for node in reach:
            beyond = sum(map(outside.__getitem__, self.holder[node]))
            self.degree[node] = total - self.weight[node] + beyond
        self.element[number], self.shared[number], self.size[number] = set(reach), shared, total
        for node in reach:
            self.holder[node].add(number)

    def _members(self, nodes: Iterable[int]) -> list[int]:
        """Nodes together with all that were joined to them."""
        return list(chain.from_iterable(map(self.joined.__getitem__, nodes)))


def amalgamate(fronts: list[Front], columns: int) -> list[Front]:
    """Join fronts with their parents where one larger front is cheaper than two.

    Parameters
    ----------
    fronts : list of Front
        Each after all that update it.
    columns : int
    """
    home = np.zeros(columns, np.int64)
    for number, front in enumerate(fronts):
        home[front.pivots] = number
    pivots = [[front.pivots] for front in fronts]
    size = [[front.pivots.size, front.update.size] for front in fronts]
    children: list[list[int]] = [[] for _ in fronts]
    joined = [False] * len(fronts)
    for number, front in enumerate(fronts):
        stack = sorted(children[number], key=lambda k: (-size[k][1], k))
        kept: list[int] = []
        while stack:
            child = stack.pop(0)
            e, u = size[number]
            apart = front_seconds(*size[child]) + front_seconds(e, u)
            if front_seconds(e + size[child][0], u) > apart:
                kept.append(child)
                continue
            joined[child] = True
            size[number][0] += size[child][0]
            pivots[number] = pivots[child] + pivots[number]
            kept += children[child]
        children[number] = kept
        if front.update.size:
            children[int(home[front.update].min())].append(number)
    return [
        Front(np.concatenate(pivots[number]), front.update)
        for number, front in enumerate(fronts)
        if not joined[number]
    ]


def parents(fronts: list[Front], columns: int) -> tuple[Columns, Columns]:
    """Find the front that eliminates each column, and each front's parent or -1.

    Parameters
    ----------
    fronts : list of Front
        Each after all that update it.
    columns : int

    Returns
    -------
    front : (columns,) int
    parent : (F,) int
    """
    home = np.zeros(columns, np.int64)
    for number, front in enumerate(fronts):
        home[front.pivots] = number
    above = [int(home[f.update].min()) if f.update.size else -1 for f in fronts]
    return home, np.array(above, np.int64)


def levels_of(parent: Columns) -> Columns:
    """Count the fronts on the longest path from a leaf below each front, shape (F,).

    Parameters
    ----------
    parent : (F,) int
        Each after its children; -1 for a root.
    """
    level = np.zeros(parent.size, np.int64)
    for number, above in enumerate(parent.tolist()):
        if above >= 0:
            level[above] = max(level[above], level[number] + 1)
    return level


def front_seconds(pivots: int, updates: int) -> float:
    """Estimate seconds that a front costs: arithmetic, memory, extend-add and its own overhead."""
    e, u = pivots, updates
    work = e * e * (e + u) + 2 * e * u * u
    return work / _RATE + _TOUCH * (e + u) ** 2 + _ADD * u * u + _FRONT
