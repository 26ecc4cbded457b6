"""Branch and bound: smaller boxes where no relaxation of the whole box closes the gap.

The part with the least bound is taken next. Its box is propagated with the cut-off, then bounded
by a linear program, and where that leaves it open by a semidefinite relaxation, if one was worth
its time at the root. Parts that are empty or bounded above the cut-off are done, others are cut
in two across the variable whose products are least true, between its middle and its value in the
relaxation. The tree of parts is the certificate: every part keeps the argument that gave its
bound, one that was never looked at its parent's, so the search can end at any moment.

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

from .boxes import shrinks
from .catalogue import Families, Recipe
from .certificate.box import BoxProof, Replay, Step, tighten
from .certificate.certificate import (
    Argument,
    Certificate,
    Node,
    Proved,
    certify,
    claim,
    halves,
    prove,
)
from .lifting import Lifted, products_error, tightened
from .presolve.propagation import is_empty
from .presolve.scaling import Scaled, Scaling
from .progress import Stages
from .relaxation import Relaxation
from .rounding import Interval
from .rungs import argue, short_if
from .task import Task

__all__ = ["Explored", "Plan", "Search", "explore", "first_moments"]

_SWEEPS = 6
_MIDDLE = 0.4  # share of the middle of the box in the place of a cut
_USELESS = 0.93  # tightening that leaves this share of the widths on average is given up
_EDGE = 0.2  # a cut keeps this share of the width from both ends


@dataclass(frozen=True, eq=False)
class Plan:
    """How the parts of one search are bounded.

    Parameters
    ----------
    cliques : dict
        A family for each way of joining variables.
    variables : tuple of int
        Which variables may be cut.
    linear : bool
        Solve the linear relaxation of a part.
    recipe : Recipe or None
        The semidefinite relaxation of a part that the linear one leaves open.
    narrow : bool
        Tighten the bounds of the variables by linear programs.
    room : (n,) float
        Arguments hold on boxes larger by this: rounding, where parts are replayed at a later level.
    """

    cliques: Families
    variables: tuple[int, ...]
    linear: bool = True
    recipe: Recipe | None = None
    narrow: bool = False
    room: NDArray[np.float64] | float = 0.0


@dataclass(frozen=True, eq=False)
class Explored:
    """What one part turned out to be.

    Parameters
    ----------
    steps : tuple
        How its box shrank.
    box : Interval
    proved : Proved
    argument : Identity or LinearDual or None
    empty : bool
        Whether the argument proves emptiness.
    point : (n,) float or None
        First moments: a candidate.
    error : (n,) float
        By how much the products of each variable are untrue there.
    left : float
        Mean share of the widths that tightening by linear programs left; NaN without it.
    """

    steps: tuple[Step, ...]
    box: Interval
    proved: Proved
    argument: Argument | None
    empty: bool = False
    point: NDArray[np.float64] | None = None
    error: NDArray[np.float64] | None = None
    left: float = np.nan


def explore(task: Task, plan: Plan, box: Interval, level: float | None) -> Explored:
    """Shrink and bound one part. Depends on nothing else, so it can run in any process.

    Parameters
    ----------
    task : Task
    plan : Plan
    box : Interval
    level : float or None
        The cut-off.
    """
    replay = Replay(task.problem, level)
    steps: tuple[Step, ...] = ()
    with task.stages.stage("branch"):
        smaller, step = tighten(replay, box, _SWEEPS)
        if shrinks(box, smaller):
            box, steps = smaller, (step,)
    found = Explored(steps, box, prove(replay, box, None, False), None)
    if plan.linear and not _done(found, level):
        with task.stages.stage("branch"):
            found = _linear(task, plan, replay, found)
    if plan.recipe is not None and not _done(found, level):
        found = _semidefinite(task, plan, plan.recipe, replay, found)
    return found


def _done(found: Explored, level: float | None) -> bool:
    return found.proved.bound == np.inf or (level is not None and claim(found.proved) >= level)


def _linear(task: Task, plan: Plan, replay: Replay, found: Explored) -> Explored:
    """The bound of the linear relaxation, and if asked a tighter box by others like it."""
    problem, left = task.problem, task.clock.left
    lifted = Lifted.of(problem, found.box, plan.cliques["constraints"], room=plan.room)
    solution = lifted.minimise(left)
    if solution.status not in ("solved", "infeasible"):
        return found
    empty = solution.status == "infeasible"
    dual = lifted.objective_dual(solution)
    proved = prove(replay, found.box, dual, empty)
    if proved.bound > found.proved.bound:
        found = replace(found, proved=proved, argument=dual, empty=empty)
    if empty:
        return found
    found = replace(found, point=lifted.point(solution), error=lifted.products_error(solution))
    if not plan.narrow or _done(found, replay.level):
        return found
    open_ = [v for v in plan.variables if found.box.hi[v] > found.box.lo[v]]
    box, step, _ = tightened(replay, lifted, found.box, open_, left)
    if step is None or not open_:
        return replace(found, left=1.0)
    left_over = np.mean((box.hi - box.lo)[open_] / (found.box.hi - found.box.lo)[open_])
    return replace(found, steps=(*found.steps, step), box=box, left=float(left_over))


def _semidefinite(
    task: Task, plan: Plan, recipe: Recipe, replay: Replay, found: Explored
) -> Explored:
    """The bound of a semidefinite relaxation, if it is better."""
    problem = task.problem
    with task.stages.stage("relax"):
        scaling = Scaling.of_box(found.box, room=plan.room)
        scaled = Scaled.of(problem, scaling, (problem.objective,))
        relaxation = recipe.build(scaled, plan.cliques)
    argued = argue(task, found.box, scaled, relaxation)
    if replay.level is not None:
        argued = short_if(replay.level, replay, found.box, argued)
    if argued.proved.bound > found.proved.bound:
        node = argued.node
        found = replace(found, proved=argued.proved, argument=node.argument, empty=node.empty)
    solution = argued.solution
    if solution is None or solution.status not in ("solved", "almost"):
        return found
    return replace(
        found,
        point=first_moments(scaled, relaxation, solution.y),
        error=products_error(relaxation, solution.y),
    )


def first_moments(
    scaled: Scaled, relaxation: Relaxation, y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The x whose scaled form has the moments of degree one."""
    letters = np.arange(1, scaled.problem.dimension + 1, dtype=np.int32)[:, None]
    column = relaxation.moment_numbers(letters) - 1
    t = np.where(column >= 0, y[np.maximum(column, 0)], 0.0)
    return scaled.scaling.point(np.clip(t, -1.0, 1.0))


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
    left: float = 0.8
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
        if self.plan.narrow and np.isfinite(found.left):
            self.left += 0.2 * (found.left - self.left)
            if self.left > _USELESS:
                self.plan = replace(self.plan, narrow=False)
        if found.proved.bound >= part.proved.bound or is_empty(found.box):
            part.proved, part.argument, part.empty = found.proved, found.argument, found.empty
        if is_empty(part.box):
            part.proved = Proved(np.inf, 0.0, "")
        if found.point is not None and part.proved.bound < np.inf and self._worth_a_search(part):
            self.task = self.attain(self.task, [found.point])
        level = self.level
        if part.proved.bound == np.inf or (level is not None and part.proved.bound >= level):
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
