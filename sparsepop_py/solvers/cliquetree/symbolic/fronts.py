"""The elimination tree front by front, for the compiled kernels.

Fronts are numbered so that children come right before their parent, and hold their columns
in the order of elimination. Of each only the columns of its pivots are stored, (e + u, e) by
rows; updates live on a stack until the parent takes them in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.kernels.batched import Workers, check, compiled_kernels
from sparsepop_py.solvers.cliquetree.symbolic.elimination import Front, levels_of, parents

__all__ = ["FrontFactor", "Fronts", "line_up"]

Indices = NDArray[np.int64]
Reals = NDArray[np.float64]
_LEAST_PIVOT = 1e-14  # in scaled units: smaller pivots are rounding errors
_MORE = 9  # entries behind the last front: as far as vectors reach, and one more
_WORK = 1e9  # multiplications between two looks at the clock
_SPLITS, _WORKERS = 64, 4  # of the tree into branches, and for how many at once


@dataclass(frozen=True, eq=False)
class Fronts:
    """Fronts in the order in which they are factorized.

    Parameters
    ----------
    pivots, updates : (F,) int
    columns : (sum of e + u,) int
        Columns of all fronts one after the other, those of one front in order of elimination.
    rank : (M,) int
        When each column is eliminated.
    parent : (F,) int
        -1 for roots.
    """

    pivots: Indices
    updates: Indices
    columns: Indices
    rank: Indices
    parent: Indices

    @cached_property
    def first(self) -> Indices:
        """(F + 1,) Where the columns of each front begin."""
        return _starts(self.pivots + self.updates)

    @cached_property
    def base(self) -> Indices:
        """(F,) Where the entries of each front begin."""
        return _starts((self.pivots + self.updates) * self.pivots)[:-1]

    @cached_property
    def entries(self) -> int:
        """Number of entries of all fronts, with spare ones; masked writes go to the last."""
        return int(((self.pivots + self.updates) * self.pivots).sum()) + _MORE

    @property
    def sizes(self) -> Indices:
        """(F, 2) Pivots and updates of each front."""
        return np.column_stack([self.pivots, self.updates])

    @property
    def operations(self) -> int:
        """Floating-point operations of one factorization."""
        return int(self._work.sum())

    @cached_property
    def _work(self) -> Reals:
        e, u = self.pivots.astype(float), self.updates.astype(float)
        return np.asarray(e**3 / 3 + e * e * u + e * u * u)

    @cached_property
    def stops(self) -> Indices:
        """Numbers of fronts between which to look at the clock, from 0 to F."""
        work = np.cumsum(self._work)
        cuts = np.searchsorted(work, np.arange(_WORK, work[-1] if work.size else 0.0, _WORK))
        return np.unique(np.concatenate([[0], cuts, [work.size]])).astype(np.int64)

    @cached_property
    def levels(self) -> int:
        """Length of the longest path from a leaf to a root."""
        return int(levels_of(self.parent).max(initial=-1)) + 1

    @cached_property
    def _home(self) -> tuple[Indices, Indices]:
        """Front of each rank, and key front * M + rank of each column."""
        number = np.arange(self.pivots.size)
        width = max(self.rank.size, 1)
        key = np.repeat(number, self.pivots + self.updates) * width + self.rank[self.columns]
        return np.repeat(number, self.pivots), key

    def locate(self, owner: Indices, member: Indices, first: Indices) -> Indices:
        """Compute the data of each column that ``pairs`` needs."""
        return self.rank[member]

    def pairs(self, spot: Indices, inside: NDArray[np.bool_]) -> Indices:
        """Find entries (K, C, C) of pairs of columns given by ascending ranks (K, C).

        Each pair has one entry, in the upper triangle; the others are the one that belongs
        nowhere.
        """
        home, keys = self._home
        front = home[spot]
        count, width = spot.shape
        change = np.zeros(spot.shape, np.int64)
        change[:, 1:] = (front[:, 1:] != front[:, :-1]) & inside[:, 1:]
        index = np.cumsum(change, axis=1)
        slot = np.zeros((count, int(index.max(initial=0)) + 1, width), np.int64)
        for number in range(slot.shape[1]):
            at = np.minimum((index < number).sum(axis=1), width - 1)
            chosen = front[np.arange(count), at][:, None]
            found = np.searchsorted(keys, chosen * max(self.rank.size, 1) + spot)
            slot[:, number] = found - self.first[chosen]
        own = spot - _starts(self.pivots)[front]
        lower = slot[np.arange(count)[:, None], index]
        place = (self.base[front] + own)[:, :, None] + lower * self.pivots[front][:, :, None]
        kept = np.triu(np.ones((width, width), bool))
        kept = kept & inside[:, :, None] & inside[:, None, :]
        return np.where(kept, place, self.entries - 1)

    @cached_property
    def plan(self) -> tuple[Indices, ...]:
        """Arguments of the kernel: child, children, slot, slots, home; stack size."""
        parent, updates = self.parent, self.updates
        children = np.flatnonzero(parent >= 0)
        children = children[np.argsort(parent[children], kind="stable")]
        child = np.searchsorted(parent[children], np.arange(parent.size + 1))
        _, keys = self._home
        width = max(self.rank.size, 1)
        beyond = np.arange(self.columns.size) - np.repeat(self.first[:-1], np.diff(self.first))
        moved = beyond >= np.repeat(self.pivots, np.diff(self.first))
        above = np.repeat(parent, updates)
        slots = np.searchsorted(keys, above * width + self.rank[self.columns[moved]])
        slots = slots - self.first[above]
        home, largest = self._homes()
        return child, children, _starts(updates), slots, home, np.array([largest])

    def _homes(self) -> tuple[Indices, int]:
        """Assign memory to the update of each front, and compute the total.

        Each branch has a stack of its own and each front of the trunk a place of its own, so
        that branches need not wait for each other.
        """
        parent, size = self.parent.tolist(), (self.updates**2).tolist()
        home, end = np.zeros(len(parent), np.int64), 0
        for low, high in self.branches:
            held, top = [0] * (high - low), end
            for number in range(low, high):
                top -= held[number - low]
                home[number] = top
                top += size[number]
                end = max(end, top)
                if number + 1 < high:
                    held[parent[number] - low] += size[number]
        for low, high in self.trunk:
            for number in range(low, high):
                home[number] = end
                end += size[number]
        return home, end

    @cached_property
    def branches(self) -> list[tuple[int, int]]:
        """Ranges of fronts, each a subtree, that may be factorized at the same time.

        The largest subtree is replaced by those of its children as long as that shortens what
        four workers would need, by their share and the largest subtree, and the trunk left over.
        """
        work = self._work
        below, first = work.copy(), np.arange(work.size)
        children: list[list[int]] = [[] for _ in work]
        for number, above in enumerate(self.parent.tolist()):
            if above >= 0:
                below[above] += below[number]
                first[above] = min(first[above], first[number])
                children[above].append(number)
        roots = np.flatnonzero(self.parent < 0)
        heap = [(-float(below[f]), int(f)) for f in roots]
        heapify(heap)
        trunk, best, chosen = 0.0, np.inf, list(heap)
        for _ in range(_SPLITS):
            if not heap:
                break
            need = trunk + max(-heap[0][0], -sum(w for w, _ in heap) / _WORKERS)
            if need < best:
                best, chosen = need, list(heap)
            _, largest = heappop(heap)
            trunk += float(work[largest])
            for child in children[largest]:
                heappush(heap, (-float(below[child]), child))
        return sorted((int(first[f]), f + 1) for _, f in chosen)

    @cached_property
    def trunk(self) -> list[tuple[int, int]]:
        """Ranges of the other fronts, which come after all branches."""
        ends = [0, *(end for part in self.branches for end in part), self.pivots.size]
        return [(low, high) for low, high in zip(ends[::2], ends[1::2], strict=True) if low < high]


class FrontFactor:
    """A factorization on fronts; ``entries`` is filled, factorized in place, and filled again.

    Parameters
    ----------
    fronts : Fronts
    workers : Workers, optional
        Who factorizes the branches.
    """

    def __init__(self, fronts: Fronts, workers: Workers | None = None) -> None:
        self.tree = fronts
        self._workers = workers or Workers()
        self.entries = np.zeros(fronts.entries)
        self._stack = np.zeros(int(fronts.plan[-1][0]))

    def refactor(self, regularisation: float, deadline: float | None = None) -> None:
        """Factorize what is in ``entries``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a pivot block is not positive definite.
        OutOfTime
            If ``deadline`` passes.
        """
        t, kernel = self.tree, compiled_kernels().factorize
        child, children, slot, slots, home, _ = t.plan
        shape = t.pivots, t.updates, t.base, child, children, slot, slots, home, self._stack

        def eliminate(part: tuple[int, int]) -> None:
            inside = t.stops[(t.stops > part[0]) & (t.stops < part[1])].tolist()
            for low, high in pairwise([part[0], *inside, part[1]]):
                check(deadline)
                failed = kernel(self.entries, regularisation, _LEAST_PIVOT, low, high, *shape)
                if failed >= 0:
                    raise np.linalg.LinAlgError(f"front {failed} is not positive definite")

        self._workers.each(eliminate, t.branches)
        for part in t.trunk:
            eliminate(part)

    def solve(self, right: Reals) -> Reals:
        """Solve the factorized system for one right-hand side (M,)."""
        x, t = right.copy(), self.tree
        compiled_kernels().solve(self.entries, x, t.pivots, t.updates, t.base, t.first, t.columns)
        return x


def line_up(fronts: list[Front], columns: int) -> Fronts:
    """Number the fronts of an elimination order, children right before parents.

    Parameters
    ----------
    fronts : list of Front
        Each after all that update it.
    columns : int

    Returns
    -------
    Fronts
    """
    parent = parents(fronts, columns)[1]
    children: list[list[int]] = [[] for _ in fronts]
    for number, above in enumerate(parent.tolist()):
        if above >= 0:
            children[above].append(number)
    order: list[int] = []  # parents before children, turned round at the end
    waiting = [number for number, above in enumerate(parent.tolist()) if above < 0]
    while waiting:
        order.append(waiting.pop())
        waiting += children[order[-1]]
    order.reverse()
    new = np.full(len(fronts) + 1, -1, np.int64)
    new[order] = np.arange(len(fronts))
    rank = np.zeros(columns, np.int64)
    taken = [fronts[number].pivots for number in order]
    rank[np.concatenate([np.zeros(0, np.int64), *taken])] = np.arange(columns)
    held = [
        part
        for number in order
        for part in (fronts[number].pivots, _sorted(fronts[number].update, rank))
    ]
    return Fronts(
        np.array([fronts[n].pivots.size for n in order], np.int64),
        np.array([fronts[n].update.size for n in order], np.int64),
        np.concatenate([np.zeros(0, np.int64), *held]),
        rank,
        new[parent[order]],
    )


def _sorted(columns: Indices, rank: Indices) -> Indices:
    return columns[np.argsort(rank[columns])]


def _starts(sizes: Indices) -> Indices:
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(sizes)])
