"""Best-first branch and bound over a box.

The open node with the least bound is processed next
(:mod:`~sparsepop_py.branch_and_bound.node`). A node that is empty or bounded above the cutoff is
fathomed. Any other is branched on the variable with the largest violation of products, at a
point between the middle of its interval and its value in the relaxation. The tree is the
certificate: every leaf keeps the argument that gave its bound, and an unprocessed leaf that of
its parent, so the search can end at any moment.

References
----------
R. Horst, H. Tuy, Global Optimization, Springer, 1996 (convergence of best-first search).
"""

from __future__ import annotations

import heapq
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.branch_and_bound.node import NodeSettings, ProcessedNode, process_node
from sparsepop_py.branch_and_bound.open_node import OpenNode, branching_point, certificate_node
from sparsepop_py.branch_and_bound.settings import BRANCHING
from sparsepop_py.budget import spend
from sparsepop_py.context import SolveContext
from sparsepop_py.executors.within_limits import run_on
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import (
    Argument,
    Certificate,
    Proved,
    certify,
    claim,
    split_box,
)
from sparsepop_py.verified.certificate.steps import BoxProof, Replay, Step

__all__ = ["SearchTree"]


@dataclass(eq=False)
class _Open(OpenNode):
    """A node with its box and bound. Mutable."""

    box: Interval
    proved: Proved


@dataclass(eq=False)
class SearchTree:
    """A branch-and-bound tree that can be grown further at any time. Mutable.

    Parameters
    ----------
    context : SolveContext
        Its incumbent may improve while the search runs.
    settings : NodeSettings
    proof : BoxProof
        Steps from the problem's bounds to the box of the root.
    box : Interval
        The box of the root.
    search_incumbent : callable
        Given a context and candidate vectors, the context with a better incumbent if one is proved.
    start : (Proved, Argument or None, bool)
        What is proved of the root, the argument, and whether it proves emptiness.
    count : int
        Nodes that were queued so far: the older of two with one bound comes first.
    seen : int
        Nodes that count as processed already.
    broken : bool
        Whether an executor failed: it is not asked again.
    left : float
        Share of the widths that OBBT leaves at a node, in the mean over the last ones.
    """

    context: SolveContext
    settings: NodeSettings
    proof: BoxProof
    box: Interval
    search_incumbent: Callable[[SolveContext, list[NDArray[Any]]], SolveContext]
    start: tuple[Proved, Argument | None, bool] = (Proved(-np.inf, 0.0, ""), None, False)
    count: int = 0
    seen: int = 0
    broken: bool = False
    left: float = BRANCHING.prior_left
    _closed: float = np.inf
    _heap: list[tuple[float, int, _Open]] = field(default_factory=list)
    _root: _Open = field(init=False)

    def __post_init__(self) -> None:
        proved, argument, empty = self.start
        self._root = _Open(self.box, proved, argument=argument, empty=empty)
        self._push(self._root)

    def __getstate__(self) -> dict[str, Any]:
        """List the nodes, so that pickling a deep tree does not recurse."""
        nodes, stack = list[_Open](), [self._root]
        while stack:
            nodes.append(stack.pop())
            stack.extend(nodes[-1].children)
        place = {id(node): k for k, node in enumerate(nodes)}
        rows = [
            (node.__dict__ | {"children": ()}, [place[id(child)] for child in node.children])
            for node in nodes
        ]
        heap = [(bound, count, place[id(node)]) for bound, count, node in self._heap]
        return self.__dict__ | {"_root": rows, "_heap": heap}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Rebuild the tree."""
        nodes = [_Open(**row) for row, _ in state["_root"]]
        for node, (_, children) in zip(nodes, state["_root"], strict=True):
            node.children = tuple(nodes[k] for k in children)
        heap = [(bound, count, nodes[k]) for bound, count, k in state["_heap"]]
        self.__dict__.update(state, _root=nodes[0], _heap=heap)

    def _push(self, node: _Open) -> None:
        self.count += 1
        heapq.heappush(self._heap, (node.proved.bound, self.count, node))

    @property
    def tree_cutoff(self) -> float | None:
        """The cutoff, a little below the attained value; None without an incumbent."""
        return self.context.at_cutoff(below=True).cutoff

    @property
    def bound(self) -> float:
        """The lower bound that the tree proves now."""
        least = min(self._closed, claim(self._heap[0][2].proved) if self._heap else np.inf)
        return least if self.tree_cutoff is None else min(least, self.tree_cutoff)

    @property
    def root_steps(self) -> tuple[Step, ...]:
        """Steps that tightened the box of the root, none before it was processed."""
        return tuple(self._root.steps)

    @property
    def done(self) -> bool:
        """True if no open node is left below the cutoff."""
        return not self._heap or (
            self.tree_cutoff is not None and self._heap[0][0] >= self.tree_cutoff
        )

    def update_context(self, context: SolveContext) -> bool:
        """Take a better incumbent; False if boxes were tightened with a lower cutoff."""
        old, self.context = self.tree_cutoff, context
        return old is None or (self.tree_cutoff is not None and self.tree_cutoff <= old)

    def grow(self, nodes: int, stop: Callable[[], bool], executor: Executor | None = None) -> int:
        """Process up to ``nodes`` nodes while ``stop()`` is false.

        Parameters
        ----------
        nodes : int
            Largest number of nodes.
        stop : callable
            Called before each node; True ends the call.
        executor : concurrent.futures.Executor, optional
            Processes up to eight nodes at once.

        Returns
        -------
        int
            The number of nodes processed.
        """
        seen = 0
        while seen < nodes and not self.done and not stop():
            executor = None if self.broken else executor
            taken = [heapq.heappop(self._heap)[2]]
            while executor is not None and self._heap and len(taken) < min(8, nodes - seen):
                taken.append(heapq.heappop(self._heap)[2])
            try:
                found = self._processed(taken, executor)
            except BaseException:
                for node in taken:  # interrupted: the nodes stay open
                    self._push(node)
                raise
            for node, processed in zip(taken, found, strict=True):
                self._take(node, processed)
            seen += len(taken)
            self.seen += len(taken)
        return seen

    def _processed(self, nodes: Sequence[_Open], executor: Executor | None) -> list[ProcessedNode]:
        if executor is None or len(nodes) == 1:  # the relaxations of one node are divided
            shared = None if self.context.deadline.counts_work else executor
            return [
                process_node(self.context, self.settings, node.box, self.tree_cutoff, shared)
                for node in nodes
            ]
        lone = self.context.for_worker()
        tasks = [(lone, self.settings, node.box, self.tree_cutoff) for node in nodes]
        found, broken = run_on(executor, process_node, tasks, self.context.deadline)
        spend(sum(each.work for each in found if each is not None))  # not counted here so far
        if broken:
            self.broken = True
            text = f"the executor failed ({broken}): nodes are processed in this process"
            self.context.stages.note(text, logging.WARNING)
        return [
            process_node(self.context, self.settings, node.box, self.tree_cutoff)
            if made is None
            else made
            for node, made in zip(nodes, found, strict=True)
        ]

    def _take(self, node: _Open, found: ProcessedNode) -> None:
        """Record a processed node, search the incumbent from its point, branch if it is open."""
        node.steps, node.box = list(found.steps), found.box
        if np.isfinite(found.left):
            self.left += 0.2 * (found.left - self.left)
            if self.settings.obbt_sdp is not None and self.left > BRANCHING.useless_sdp:
                self.settings = replace(self.settings, obbt_sdp=None)
                self.left = BRANCHING.prior_left
            elif self.left > BRANCHING.useless_lp:
                self.settings = replace(self.settings, obbt_lp=False)
        if found.proved.bound >= node.proved.bound or is_empty(found.box):
            node.proved, node.argument, node.empty = found.proved, found.argument, found.empty
        if is_empty(node.box):
            node.proved = Proved(np.inf, 0.0, "")
        if self._settled(node):
            return
        if found.point is not None and self._worth_a_search(node):
            self.context = self.search_incumbent(self.context, [found.point])
            if self._settled(node):
                return
        branch = self._branching_point(node.box, found)
        if branch is None:
            self._closed = min(self._closed, claim(node.proved))  # too small to be branched
            return
        node.branch = branch
        low, high = (self._child(node, side) for side in (0, 1))
        node.children = (low, high)
        self._push(low)
        self._push(high)

    def _settled(self, node: _Open) -> bool:
        """Check whether a node is fathomed."""
        return node.proved.bound >= (np.inf if self.tree_cutoff is None else self.tree_cutoff)

    def _child(self, node: _Open, side: int) -> _Open:
        assert node.branch is not None
        box = split_box(node.box, node.branch)[side]
        depth, argument = node.depth + 1, node.argument
        return _Open(box, node.proved, depth=depth, argument=argument, empty=node.empty)

    def _worth_a_search(self, node: _Open) -> bool:
        return node.depth < 2 or self.count % 10 < 2

    def _branching_point(self, box: Interval, found: ProcessedNode) -> tuple[int, float] | None:
        """Choose variable and point of branching.

        Variables with large violations of their products and wide intervals come first; None where
        no interval is wide enough.
        """
        chosen = np.array(self.settings.variables, np.int64)
        width = box.width()[chosen]
        start = self.box.width()[chosen]
        relative = np.where(start > 0, width / np.where(start > 0, start, 1.0), 0.0)
        score = relative.copy()
        if found.error is not None:
            score = (found.error[chosen] + 1e-6) * np.sqrt(relative)
        score = np.where(width > 1e-9 * (1.0 + np.abs(box.lo[chosen])), score, -1.0)
        if not chosen.size or score.max() < 0:
            return None
        v = int(chosen[np.argmax(score)])
        ends = float(box.lo[v]), float(box.hi[v])
        value = None if found.point is None else float(found.point[v])
        return v, branching_point(ends, value, BRANCHING.middle, BRANCHING.edge)

    def certificate(self) -> Certificate | None:
        """Build the certificate of the current tree, None where nothing is proved."""
        least = min((p.proved for p in _leaves_of(self._root)), key=lambda proved: proved.bound)
        replay = Replay(self.context.problem, self.tree_cutoff)
        root = certificate_node(self._root)
        root = replace(root, box=BoxProof((*self.proof.steps, *root.box.steps)))
        return certify(replay, root, least)


def _leaves_of(root: _Open) -> list[_Open]:
    leaves, stack = [], [root]
    while stack:
        node = stack.pop()
        if node.children:
            stack.extend(node.children)
        else:
            leaves.append(node)
    return leaves
