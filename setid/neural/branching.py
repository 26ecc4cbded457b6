"""Best-first branch and bound whose leaves multipliers of linear programs bound."""

from __future__ import annotations

import heapq
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from setid.neural.arithmetic import Interval

__all__ = ["BestFirst", "DualNode", "halves"]

Reals = NDArray[np.float64]
Part = TypeVar("Part")


@dataclass(frozen=True, slots=True, eq=False)
class DualNode:
    """A node that is split in two, or a leaf that multipliers bound.

    Parameters
    ----------
    split : int
        What is decided or bisected; -1 at a leaf.
    children : tuple of DualNode
        Two, or none at a leaf.
    dual : (rows,) float
        Multipliers; none where the node is split.
    infeasible : bool
        Whether ``dual`` proves that nothing in the node stays below the cap.
    """

    split: int
    children: tuple[DualNode, ...]
    dual: Reals
    infeasible: bool = False


def halves(box: Interval, entry: int, at: float | None = None) -> tuple[Interval, Interval]:
    """Split a box on both sides of a value; of the middle where none is given.

    Parameters
    ----------
    box : Interval
    entry : int
    at : float, optional
        Is moved into the box.

    Examples
    --------
    >>> low, high = halves(Interval(np.zeros(2), np.ones(2)), 1)
    >>> low.hi.tolist(), high.lo.tolist()
    ([1.0, 0.5], [0.0, 0.5])
    """
    if at is None:
        at = 0.5 * box.lo[entry] + 0.5 * box.hi[entry]
    at = min(max(at, float(box.lo[entry])), float(box.hi[entry]))
    low, high = box.lo.copy(), box.hi.copy()
    low[entry], high[entry] = at, at
    return Interval(box.lo, high), Interval(low, box.hi)


class BestFirst(ABC, Generic[Part]):
    """A tree whose weakest node is split next. Mutable.

    ``known`` holds of each node its part, multipliers, whether these prove it empty, where to
    split it (-1 where its program is exact), and a point that its program proposes.
    """

    def __init__(self) -> None:
        self.known: list[tuple[Part, Reals, bool, int, Reals | None]] = []
        self._children: dict[int, tuple[int, int]] = {}
        self._queue: list[tuple[float, int]] = []

    @abstractmethod
    def add(self, part: Part) -> None:
        """Bound a part, and file it."""

    @abstractmethod
    def parts(self, part: Part, split: int) -> Iterable[Part]:
        """Split a part in two."""

    def file(
        self, value: float, part: Part, dual: Reals, infeasible: bool, split: int, x: Reals | None
    ) -> None:
        """Keep a node with its bound."""
        heapq.heappush(self._queue, (value, len(self.known)))
        self.known.append((part, dual, infeasible, split, x))

    @property
    def bound(self) -> float:
        """Bound that all leaves prove together: that of the weakest."""
        return self._queue[0][0]

    def branch(self) -> bool:
        """Split the weakest leaf; False where there is nothing to split."""
        value, number = self._queue[0]
        part, _, _, split, _ = self.known[number]
        if split < 0:
            return False
        before = len(self.known)
        try:
            heapq.heappop(self._queue)
            for half in self.parts(part, split):
                self.add(half)
            self._children[number] = before, before + 1
        except KeyboardInterrupt:  # the leaf stays whole
            self._children.pop(number, None)
            self._queue = [item for item in self._queue if item[1] < before and item[1] != number]
            heapq.heapify(self._queue)
            heapq.heappush(self._queue, (value, number))
            del self.known[before:]
            raise
        return True

    def run(self, cutoff: float, until: float, most: int) -> float:
        """Branch until the bound reaches the cutoff or limits are met; return the bound.

        Parameters
        ----------
        cutoff : float
        until : float
            Reading of ``time.monotonic``.
        most : int
            Nodes.
        """
        while len(self.known) < most and time.monotonic() < until and self.bound < cutoff:
            if not self.branch():
                break
        return self.bound

    def tree(self, number: int = 0) -> DualNode:
        """Build the nodes with their multipliers."""
        _, dual, infeasible, split, _ = self.known[number]
        if number not in self._children:
            return DualNode(-1, (), dual, infeasible)
        one, other = self._children[number]
        return DualNode(split, (self.tree(one), self.tree(other)), np.zeros(0))
