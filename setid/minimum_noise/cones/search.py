"""Search with multipliers that vary over a cone of denominators.

Best first, as in ``best_first.py``. Each vector of a cone has its own multiplier; together they
are a family, which follows the dual solution through the cone. What a family refutes falls short
by second order in the width of the cone. The best family of a cone is the solution of a linear
program, see ``linear_programs.py``. Where it does not reach the target, its dual solution tells
which pair of vectors to split. A target that takes too long is approached from below.
"""

from __future__ import annotations

import copy
import heapq
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from setid.minimum_noise.attained_noise import AttainedNoise
from setid.minimum_noise.claims import FoundDenominators, claimed
from setid.minimum_noise.cones.crew import MOST_BYTES, Crew
from setid.minimum_noise.cones.edges import changing_edge
from setid.minimum_noise.cones.limits import orthogonal
from setid.minimum_noise.cones.linear_programs import ConePrograms
from setid.minimum_noise.cones.nodes import OPEN_LEAF, ConeNode, Examined, examined, first_node
from setid.minimum_noise.programs import Programs
from setid.proofs.denominators.cones import first_cones, split_cone
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows
from setid.proofs.denominators.varying_multipliers import VaryingCells
from sparsepop_py.budget import EARLY, Deadline

__all__ = ["follow_denominators"]

Reals = NDArray[np.float64]
_DIRECT_TIME = 0.15  # of the time: for an attempt at the last target without lower ones
_FIRST_SHARE = 0.5  # of the level, which the lowest target leaves
_LEAST_RATIO = 0.5  # of the next share to the present one
_LARGEST_RATIO = 0.9  # of the next share to the present one
_LEAST_GROWTH = 3.5  # a share that is smaller by 2 takes at least 2 to this power as long
_NEXT_TARGET_TIME = 0.5  # of the time left: for the next target
_BRIEF_SECONDS = 0.2  # seconds that tell nothing of the growth
_NEAR_TOL = 1.5  # times the tolerance: from a share this small on the tolerance comes next
_AS_HARD = 1.02  # times what refutes the whole: splitting did nothing for a half below it
_IDLE_EDGE = 0.5  # of the weight of an edge that was split without avail


def follow_denominators(
    rows: OutputRows,
    programs: Programs,
    output: int,
    tol: float,
    deadline: Deadline,
    best: Sequence[Reals] = (),
    executor: Executor | None = None,
) -> FoundDenominators:
    """Bound the least factor on the noise bounds of one output from below.

    Parameters
    ----------
    rows : OutputRows
        With the noise bounds of factor 1.
    programs : Programs
    output : int
    tol : float
        Of the factor.
    deadline : Deadline
    best : sequence of (n,) float
        Coefficients of denominators to begin from, beside random ones.
    executor : concurrent.futures.Executor, optional
        Solves the linear programs of several cones at once. Compiled programs leave Python's lock
        alone, so that threads do.
    """
    attained = AttainedNoise(programs, rows.stable)
    for coefficients in best:
        attained.try_denominator(np.concatenate([[1.0], coefficients]))
    attained.explore(deadline)
    if not np.isfinite(attained.level):
        return FoundDenominators(0.0, None, ())
    return _Search(rows, programs, attained, tol, deadline, executor).run(output)


class _Search:
    """Search over cones that refutes one target after the other, by families of multipliers."""

    def __init__(
        self,
        rows: OutputRows,
        programs: Programs,
        attained: AttainedNoise,
        tol: float,
        deadline: Deadline,
        executor: Executor | None = None,
    ) -> None:
        self._rows, self._programs, self._tol, self._deadline = rows, programs, tol, deadline
        self._attained, self._crew = attained, Crew(executor)
        self._share = tol  # of the level: what may be left now
        self._until = deadline
        self._cones = ConePrograms(programs, rows.stable, deadline.left)
        self._begin()

    def _begin(self) -> None:
        """File the first cones alone."""
        self._multipliers: list[Reals] = []
        self._nodes: list[ConeNode] = []  # by number, as what follows
        self._leaves: list[VaryingLeaf] = []  # what refutes each cone as a whole
        self._proved: list[float] = []
        self._failed: list[float] = []  # least target that was not refuted
        self._splits: list[Cell | None] = []
        self._waiting: list[tuple[float, int]] = []
        self._wholes: list[int] = []  # -1 for the first ones
        for cone in first_cones(self._rows.order, self._rows.stable):
            self._file(first_node(cone), -1)

    @property
    def target(self) -> float:
        """The factor that is to be refuted now."""
        return (1.0 - self._share) * self._attained.level

    @property
    def _ended(self) -> bool:
        """Check that the time is over, or multipliers take as much memory as they may."""
        full = len(self._multipliers) * 8.0 * self._programs.y.size > MOST_BYTES
        return full or self._until.over

    def _file(self, node: ConeNode, whole: int) -> None:
        """File a cone that nothing refutes yet."""
        self._nodes.append(node)
        self._wholes.append(whole)
        self._leaves.append(OPEN_LEAF)
        self._failed.append(np.inf)
        self._splits.append(None)
        self._proved.append(0.0)  # last: what is stated are the cones that have it

    def _refute(self, cones: Sequence[tuple[int, float]]) -> None:
        """Refute the target in cones; put others in the queue, each with its whole's factor."""
        if not self._ended:
            self._solve([n for n, _ in cones if self._proved[n] < self.target < self._failed[n]])
        for number, least in cones:
            low = max(least, self._proved[number])
            if low < self.target and self._splits[number] is None:
                heapq.heappush(self._waiting, (low, number))

    def _solve(self, numbers: Sequence[int]) -> None:
        """Solve for what refutes the target in cones; what refuted more before stays."""
        target = self.target
        tasks = [(self._cones, self._nodes[number], target) for number in numbers]
        for number, one in zip(numbers, self._crew.map(examined, tasks), strict=True):
            self._keep(number, one, target)

    def _keep(self, number: int, one: Examined, target: float) -> None:
        """Keep what refutes a cone, if it is more than before, and where it is hard to refute."""
        self._nodes[number] = one.node
        if one.tried is not None and one.level < self._attained.level:
            self._attained.try_denominator(one.tried)
        if one.bound is None:
            assert one.unstable is not None
            self._leaves[number], self._proved[number] = one.unstable, np.inf
            return
        if one.bound.factor > self._proved[number]:
            first, size = len(self._multipliers), len(one.node.cone)
            self._multipliers += list(orthogonal(one.bound.multipliers, self._programs.basis))
            family = tuple(range(first, first + size))
            minors = tuple(one.bound.minors.tolist())
            self._leaves[number] = VaryingLeaf((family,), (1.0,), one.powers, minors)
            self._proved[number] = one.bound.factor
        if self._proved[number] < target:
            self._failed[number] = target

    def run(self, output: int) -> FoundDenominators:
        """Split cones until all are refuted, or time or memory ends; state what is refuted.

        Where that takes too long, the search begins again with a low target, which rises as fast as
        the time allows. Each time all cones are refuted before any is refuted further: the worst
        one is near the others. An interrupt by the user or a limit keeps what was refuted before.
        """
        first: list[_Search] = []
        try:
            self._approach(first)
        except EARLY as cause:
            self._deadline.ended(cause)
        found = max((each._found(output) for each in (self, *first)), key=lambda one: one.factor)
        return replace(found, best=tuple(self._attained.best))

    def _approach(self, first: list[_Search]) -> None:
        """Reach the last target at once, or by lower ones after a first attempt, which is kept."""
        if self._deadline.left is not None:
            self._until = self._deadline.part(_DIRECT_TIME)
        self._reach(self._tol)
        closed, self._until = not self._ended, self._deadline
        if closed or self._ended:
            return
        first.append(copy.copy(self))  # keeps its lists
        self._begin()
        share, wider = max(_FIRST_SHARE, self._tol), 1.0
        spent, growth = 0.0, _LEAST_GROWTH
        while not self._ended:
            begun, earlier = time.monotonic(), spent
            self._reach(share)
            if share <= self._tol:
                break
            spent = time.monotonic() - begun
            if min(earlier, spent) > _BRIEF_SECONDS:
                growth = max(_LEAST_GROWTH, np.log(spent / earlier) / np.log(wider / share))
            wider, share = share, self._following(share, spent, growth)

    def _following(self, share: float, spent: float, growth: float) -> float:
        """Choose what the next target leaves of the level, for a part of the time that is left."""
        left = self._deadline.left
        fall = _LEAST_RATIO
        if left is not None:
            fall = (spent / max(_NEXT_TARGET_TIME * left, spent, _BRIEF_SECONDS)) ** (1.0 / growth)
        share *= min(max(fall, _LEAST_RATIO), _LARGEST_RATIO)
        return share if share > _NEAR_TOL * self._tol else self._tol

    def _reach(self, share: float) -> None:
        """Refute a target in all cones while time allows, in halves where their whole fails."""
        self._share, self._waiting = share, []
        layer = list(range(len(first_cones(self._rows.order, self._rows.stable))))
        while layer and not self._ended:
            children: list[int] = []
            for begin in range(0, len(layer), self._crew.cones):
                self._refute([(number, 0.0) for number in layer[begin : begin + self._crew.cones]])
            for number in layer:
                cell = self._splits[number]
                if cell is not None and self._proved[number] < self.target:
                    children += cell.children
            layer = children
        self._split_all()

    def _split_all(self) -> None:
        """Split the cones that are open at the present target, the worst ones first."""
        while not self._ended:
            halves: list[tuple[int, float]] = []
            while (
                self._waiting
                and self._waiting[0][0] < self.target
                and len(halves) < self._crew.cones
            ):
                low, number = heapq.heappop(self._waiting)
                halves += [(half, low) for half in self._split(number)]
            if not halves:
                break
            self._refute(halves)
            self._attained.descend(self._deadline)

    def _split(self, number: int) -> tuple[int, ...]:
        """Split a cone at an edge between vectors that are hard to refute together."""
        node, edge, edges = self._nodes[number], (0, 1, (1, 1)), self._edges(number)
        if node.centre is not None:
            filtered, bound = node.cone.astype(np.float64) @ node.centre, self._programs.bound
            changing = changing_edge(filtered, node.sizes(bound), bound, node.products * edges)
            if changing is None:
                return ()
            edge = changing
        i, j, weights = edge
        halves = split_cone(node.cone, (i, j), weights)
        if halves is None:  # too thin: it stays a leaf
            return ()
        first = len(self._nodes)
        for half in halves:
            self._file(node._replace(cone=half, centred=False, edges=edges), number)
        self._splits[number] = Cell((first, first + 1), (i, j), weights)
        return first, first + 1

    def _edges(self, number: int) -> Reals:
        """Weigh the edges of a cone (K, K).

        Where its whole was split into one that is refuted and this one, which is as hard as the
        whole, that edge is long: slice after slice would be cut off.
        """
        weights, whole = self._nodes[number].edges, self._wholes[number]
        cell = None if whole < 0 else self._splits[whole]
        if cell is None:
            return weights
        other = sum(cell.children) - number
        harder = self._proved[number] < _AS_HARD * self._proved[whole]
        if self._proved[other] < self.target or not harder:
            return np.asarray(np.sqrt(weights), np.float64)
        i, j = cell.edge
        weights = weights.copy()
        weights[[i, j], [j, i]] *= _IDLE_EDGE
        return weights

    def _found(self, output: int) -> FoundDenominators:
        """State what the tree refutes; halves that refute less than their whole are left out."""
        low = self._proved.copy()
        for number in reversed(range(len(low))):
            cell = self._splits[number]
            if cell is not None:
                least = min(low[child] for child in cell.children)
                if least > low[number]:
                    low[number] = least
                else:
                    self._splits[number] = None
        cells, proved = list[Cell | VaryingLeaf](), list[float]()
        order = list(range(len(first_cones(self._rows.order, self._rows.stable))))
        for number in order:  # grows
            cell, leaf = self._splits[number], self._leaves[number]
            if cell is not None:
                cells.append(cell._replace(children=(len(order), len(order) + 1)))
                order += cell.children
            else:
                cells.append(leaf)
            proved.append(low[number])
        assert self._programs.free is not None
        none, free = np.zeros((0, self._rows.y.size)), self._programs.free
        claim = VaryingCells(output, free, none, tuple(cells))
        return claimed(self._rows, claim, self._multiplier, proved, self._attained.best)

    def _multiplier(self, number: int) -> Reals:
        """A multiplier over the whole record, (N,)."""
        return self._programs.whole(self._multipliers[number])
