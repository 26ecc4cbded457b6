"""The elimination tree front by front, for the compiled kernels.

Fronts are numbered so that children come right before their parent, and hold their columns
in the order of elimination. Of each only the columns of its pivots are stored, (e + u, e) by
rows; updates live on a stack until the parent takes them in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .elimination import Front, parents
from .kernels import check, compiled_kernels

__all__ = ["FrontFactor", "Fronts", "line_up"]

Indices = NDArray[np.int64]
Reals = NDArray[np.float64]
_LEAST_PIVOT = 1e-14
_WORK = 1e9  # multiplications between two looks at the clock


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
        """Entries of all fronts and one more, which takes what belongs nowhere."""
        return int(((self.pivots + self.updates) * self.pivots).sum()) + 1

    @property
    def sizes(self) -> Indices:
        """(F, 2) Pivots and updates of each front."""
        return np.column_stack([self.pivots, self.updates])

    @property
    def operations(self) -> int:
        """Floating-point operations of one factorization."""
        e, u = self.pivots, self.updates
        return int((e**3 // 3 + e * e * u + e * u * u).sum())

    @cached_property
    def stops(self) -> Indices:
        """Numbers of fronts between which to look at the clock, from 0 to F."""
        e, u = self.pivots.astype(float), self.updates.astype(float)
        work = np.cumsum(e**3 / 3 + e * e * u + e * u * u)
        cuts = np.searchsorted(work, np.arange(_WORK, work[-1] if work.size else 0.0, _WORK))
        return np.unique(np.concatenate([[0], cuts, [e.size]])).astype(np.int64)

    @cached_property
    def levels(self) -> int:
        """Length of the longest path from a leaf to a root."""
        level = np.zeros(self.pivots.size, np.int64)
        for number, parent in enumerate(self.parent.tolist()):
            if parent >= 0:
                level[parent] = max(level[parent], level[number] + 1)
        return int(level.max(initial=-1)) + 1

    @cached_property
    def _home(self) -> tuple[Indices, Indices]:
        """The front of each rank and the key front * M + rank of each column of each front."""
        number = np.arange(self.pivots.size)
        width = max(self.rank.size, 1)
        key = np.repeat(number, self.pivots + self.updates) * width + self.rank[self.columns]
        return np.repeat(number, self.pivots), key

    def locate(self, owner: Indices, member: Indices, first: Indices) -> Indices:
        """What ``pairs`` needs to know of each column."""
        return self.rank[member]

    def pairs(self, spot: Indices, inside: NDArray[np.bool_]) -> Indices:
        """Entries (K, C, C) of pairs of columns given by ascending ranks (K, C).

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
        """What the kernel asks for: child, children, slot, slots, home; and the stack's size."""
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
        home, top = np.zeros(parent.size, np.int64), 0
        held = np.zeros(parent.size, np.int64)
        largest = 0
        for number, (above_it, size) in enumerate(zip(parent.tolist(), updates, strict=True)):
            top -= int(held[number])
            home[number] = top
            top += int(size) ** 2
            largest = max(largest, top)
            if above_it >= 0:
                held[above_it] += int(size) ** 2
        return child, children, _starts(updates), slots, home, np.array([largest])


class FrontFactor:
    """A factorization on fronts; ``entries`` is filled, factorized in place, and filled again.

    Parameters
    ----------
    fronts : Fronts
    """

    def __init__(self, fronts: Fronts) -> None:
        self.tree = fronts
        self.entries = np.zeros(fronts.entries)
        self._stack = np.zeros(int(fronts.plan[-1][0]))

    def refactor(self, regularisation: float, deadline: float | None = None) -> None:
        """Factorize what is in ``entries``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a pivot block is not positive definite.
        OutOfTime
            If the CPU time ``deadline`` passes.
        """
        t = self.tree
        for low, high in zip(t.stops[:-1], t.stops[1:], strict=True):
            check(deadline)
            failed = compiled_kernels().factorize(
                self.entries,
                regularisation,
                _LEAST_PIVOT,
                low,
                high,
                t.pivots,
                t.updates,
                t.base,
                *t.plan[:-1],
                self._stack,
            )
            if failed >= 0:
                raise np.linalg.LinAlgError(f"front {failed} is not positive definite")

    def solve(self, right: Reals) -> Reals:
        """The solution of the factorized system for one right-hand side (M,)."""
        x, t = right.copy(), self.tree
        compiled_kernels().solve(self.entries, x, t.pivots, t.updates, t.base, t.first, t.columns)
        return x


def line_up(fronts: list[Front], columns: int) -> Fronts:
    """Number the fronts of an elimination order so that children come right before parents.

    Parameters
    ----------
    fronts : list of Front
        Each after all that update it.
    columns : int
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
