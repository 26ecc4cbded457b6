"""Branch and bound: smaller boxes where no relaxation of the whole box closes the gap.

The part with the least bound is taken next, and bounded (:mod:`~sparsepop_py.branch_and_bound.node`). Parts that
are empty or bounded above the cut-off are done, others are cut in two across the variable whose
products are least true, between its middle and its value in the relaxation. The tree of parts is
the certificate: every part keeps the argument that gave its bound, one that was never looked at
its parent's, so the search can end at any moment.

References
----------
R. Horst, H. Tuy, Global Optimization, Springer, 1996 (convergence of best-first search).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.branch_and_bound.node import Explored, Plan, explore
from sparsepop_py.context import Task
from sparsepop_py.progress import Stages
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import (
    Argument,
    Certificate,
    Node,
    Proved,
    certify,
    claim,
    halves,
)
from sparsepop_py.verified.certificate.steps import BoxProof, Replay, Step

__all__ = ["Search"]

_MIDDLE = 0.4  # share of the middle of the box in the place of a cut
_HOPE = 0.8  # what tightening is expected to leave of the widths, before it was seen
_USELESS = 0.93  # tightening that leaves this share of the widths on average is given up
_LOOSE = 0.85  # ... by relaxations, which take longer than linear programs
_EDGE = 0.2  # a cut keeps this share of the width from both ends


@dataclass(eq=False)
class _Part:
    """A part of the tree while it grows."""

    box: Interval
    proved: Proved
    argument: Argument | None = None
    empty: bool = False
    steps: tuple[Step, ...] = ()
    cut: tuple[int, float] | None = None
    children: list[_Part] = field(default_factory=list)
    depth: int = 0


@dataclass(eq=False)
class Search:
    """A tree of parts that can be grown further at any time.

    Parameters
    ----------
    task : Task
        Its attained point may improve while the search runs.
    plan : Plan
    proof : BoxProof
        How the box of the root followed from the problem's bounds.
    box : Interval
    attain : callable
        Given candidate vectors, the task with a better attained point if one was proved.
    """

    task: Task
    plan: Plan
    proof: BoxProof
    box: Interval
    attain: Callable[[Task, list[NDArray]], Task]
    start: tuple[Proved, Argument | None, bool] = (Proved(-np.inf, 0.0, ""), None, False)
    count: int = 0
    seen: int = 0
    left: float = _HOPE
    _closed: float = np.inf
    _heap: list[tuple[float, int, _Part]] = field(default_factory=list)
    _root: _Part = field(init=False)

    def __post_init__(self) -> None:
        proved, argument, empty = self.start
        self._root = _Part(self.box, proved, argument, empty)
        self._push(self._root)

    def _push(self, part: _Part) -> None:
        self.count += 1
        heapq.heappush(self._heap, (part.proved.bound, self.count, part))

    @property
    def level(self) -> float | None:
        """The cut-off: a little below the attained value."""
        return self.task.replay(below=True).level

    @property
    def bound(self) -> float:
        """What is proved so far."""
        least = min(self._closed, claim(self._heap[0][2].proved) if self._heap else np.inf)
        return least if self.level is None else min(least, self.level)

    @property
    def done(self) -> bool:
        """Whether nothing is left to look at."""
        return not self._heap or (self.level is not None and self._heap[0][0] >= self.level)

    def tell(self, task: Task) -> bool:
        """Go on with a better point; False where parts were shrunk by a lower cut-off."""
        old, self.task = self.level, task
        return old is None or (self.level is not None and self.level <= old)

    def grow(self, nodes: int, stop: Callable[[], bool], executor: Executor | None = None) -> int:
        """Look at up to ``nodes`` parts while ``stop()`` is false; how many were looked at."""
        seen = 0
        while seen < nodes and not self.done and not stop():
            parts = [heapq.heappop(self._heap)[2]]
            while executor is not None and self._heap and len(parts) < min(8, nodes - seen):
                parts.append(heapq.heappop(self._heap)[2])
            try:
                found = self._explored(parts, executor)
            except BaseException:
                for part in parts:  # interrupted: nothing is lost
                    self._push(part)
                raise
            for part, explored in zip(parts, found, strict=True):
                self._take(part, explored)
            seen += len(parts)
            self.seen += len(parts)
        return seen

    def _explored(self, parts: Sequence[_Part], executor: Executor | None) -> list[Explored]:
        if executor is None:
            return [explore(self.task, self.plan, part.box, self.level) for part in parts]
        options = replace(self.task.options, executor=None)  # so that the task can travel
        lone = replace(self.task, stages=Stages(), options=options, repair=None)
        jobs = [executor.submit(explore, lone, self.plan, p.box, self.level) for p in parts]
        return [job.result() for job in jobs]

    def _take(self, part: _Part, found: Explored) -> None:
        """Enter what was found, look for a better point, cut what is still open."""
        part.steps, part.box = found.steps, found.box
        if np.isfinite(found.left):
            self.left += 0.2 * (found.left - self.left)
            if self.plan.squeeze is not None and self.left > _LOOSE:
                self.plan, self.left = replace(self.plan, squeeze=None), _HOPE
            elif self.left > _USELESS:
                self.plan = replace(self.plan, narrow=False)
        if found.proved.bound >= part.proved.bound or is_empty(found.box):
            part.proved, part.argument, part.empty = found.proved, found.argument, found.empty
        if is_empty(part.box):
            part.proved = Proved(np.inf, 0.0, "")
        if self._settled(part):
            return
        if found.point is not None and self._worth_a_search(part):
            self.task = self.attain(self.task, [found.point])
            if self._settled(part):
                return
        cut = self._cut(part.box, found)
        if cut is None:
            self._closed = min(self._closed, claim(part.proved))  # too small to be cut
            return
        part.cut = cut
        low, high = (self._half(part, side) for side in (0, 1))
        part.children = [low, high]
        self._push(low)
        self._push(high)

    def _settled(self, part: _Part) -> bool:
        """Whether no point of a part is worth finding."""
        return part.proved.bound >= (np.inf if self.level is None else self.level)

    def _half(self, part: _Part, side: int) -> _Part:
        assert part.cut is not None
        box = halves(part.box, part.cut)[side]
        return _Part(box, part.proved, part.argument, part.empty, depth=part.depth + 1)

    def _worth_a_search(self, part: _Part) -> bool:
        return part.depth < 2 or self.count % 10 < 2

    def _cut(self, box: Interval, found: Explored) -> tuple[int, float] | None:
        """Where to cut: the variable whose products are least true, wide ones first."""
        chosen = np.array(self.plan.variables, np.int64)
        width = (box.hi - box.lo)[chosen]
        start = (self.box.hi - self.box.lo)[chosen]
        relative = np.where(start > 0, width / np.where(start > 0, start, 1.0), 0.0)
        score = relative.copy()
        if found.error is not None:
            score = (found.error[chosen] + 1e-6) * np.sqrt(relative)
        score = np.where(width > 1e-9 * (1.0 + np.abs(box.lo[chosen])), score, -1.0)
        if not chosen.size or score.max() < 0:
            return None
        v = int(chosen[np.argmax(score)])
        place = middle = 0.5 * box.lo[v] + 0.5 * box.hi[v]
        if found.point is not None:
            place = _MIDDLE * middle + (1.0 - _MIDDLE) * float(found.point[v])
        edge = _EDGE * (box.hi[v] - box.lo[v])
        return v, float(np.clip(place, box.lo[v] + edge, box.hi[v] - edge))

    def certificate(self) -> Certificate | None:
        """The certificate of the tree as it is now."""
        least = min((p.proved for p in _leaves_of(self._root)), key=lambda proved: proved.bound)
        replay = Replay(self.task.problem, self.level)
        root = _frozen(self._root)
        root = replace(root, box=BoxProof((*self.proof.steps, *root.box.steps)))
        return certify(replay, root, least)


def _leaves_of(root: _Part) -> list[_Part]:
    leaves, stack = [], [root]
    while stack:
        part = stack.pop()
        if part.children:
            stack.extend(part.children)
        else:
            leaves.append(part)
    return leaves


def _frozen(root: _Part) -> Node:
    """The tree as nodes, children first."""
    order, stack = [], [root]
    while stack:
        part = stack.pop()
        order.append(part)
        stack.extend(part.children)
    made: dict[int, Node] = {}
    for part in reversed(order):
        children: Any = tuple(made[id(child)] for child in part.children)
        leaf = not part.children
        made[id(part)] = Node(
            BoxProof(part.steps),
            part.argument if leaf else None,
            part.empty and leaf,
            part.cut,
            children,
        )
    return made[id(root)]
