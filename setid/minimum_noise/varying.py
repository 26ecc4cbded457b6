"""Search with multipliers that vary over a cone of denominators.

Best first, as in ``denominators.py``. Each vector of a cone has its own multiplier; together they
are a family, which follows the dual solution through the cone. What a family refutes falls short
by second order in the width of the cone. The best family of a cone is the solution of a linear
program, see ``cone_programs.py``. Where it does not reach the target, its dual solution tells
which pair of vectors to part. A target that takes too long is approached from below.
"""

from __future__ import annotations

import copy
import heapq
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.optimize import minimize

from setid.minimum_noise.claims import FoundDenominators, claimed
from setid.minimum_noise.cone_programs import ConeBound, ConePrograms, solved_cone
from setid.minimum_noise.cones import changing_edge, monic
from setid.minimum_noise.programs import Programs
from setid.proofs.least_noise.denominator_cells import (
    Cell,
    Cone,
    OutputRows,
    VaryingLeaf,
    first_cones,
    parted_cone,
)
from setid.proofs.least_noise.varying_multipliers import VaryingCells, hurwitz_minors, pairs
from sparsepop_py.budget import Deadline
from sparsepop_py.errors import SparsePOPError
from sparsepop_py.executors.dispatch import map_in_order, workers_of

__all__ = ["follow_denominators"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_MEMORY = 2.0**29  # bytes of multipliers
_LEAST = 1e-200  # size of a vector
_SEED = 5
_PATIENCE = 8.0  # steps of a linear program: where parting a cone is cheaper
_RANDOM, _STARTS, _AGAIN = 200, 5, 5  # denominators and descents for each unknown; repetitions
_SLOW = 3e-3  # least distance of a random pole from the unit circle
_DESCENT, _STEP = 150, 0.3  # evaluations of a descent for each unknown, and its first step
_FAR = 1e100
_DRAWING, _EXPLORING = 0.06, 0.12  # of the time: for random denominators, and with descents
_TINY, _ALMOST = 1e-7, 1e-4
_NOTHING = VaryingLeaf((), (), ())
_AT_ONCE = 0.25  # of the time: for cones that are refuted at the last target
_AHEAD = 4  # cones for each worker of an executor
_SHARES, _NEAR = (0.5, 0.25, 0.125, 0.08), 1.5  # of a level, to be left; of a tolerance
_LOWER = 0.01  # of a level: where a descent is worth it
_ALMOST_STABLE = 1.0 + 1e-4


class _Node(NamedTuple):
    """A cone in the search."""

    number: int
    cone: Cone
    reference: Integers | None
    centre: Reals | None  # (n + 1, S) multiplier of one denominator, i samples ahead
    products: Reals  # (K, K) weights of pairs that are hard to refute


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
        Solves the linear programs of several cones at once.
    """
    search = _Search(rows, programs, tol, deadline, executor)
    for coefficients in best:
        search.try_denominator(np.concatenate([[1.0], coefficients]))
    search.explore()
    if not np.isfinite(search.level):
        return FoundDenominators(0.0, None, ())
    return search.run(output)


class _Search:
    def __init__(
        self,
        rows: OutputRows,
        programs: Programs,
        tol: float,
        deadline: Deadline,
        executor: Executor | None = None,
    ) -> None:
        self._rows, self._programs, self._tol, self._deadline = rows, programs, tol, deadline
        self._executor = executor
        self._ahead = _AHEAD * workers_of(executor) or 1  # cones that are parted together
        self.level, self.best = np.inf, list[Reals]()
        self._explored = np.inf  # the level from which there was a descent
        self._share = tol  # of the level: what may be left now
        self._until = deadline
        self._cones = ConePrograms(programs, rows.stable)
        self._begin()

    def _begin(self) -> None:
        """File the first cones alone."""
        self._multipliers: list[Reals] = []
        self._nodes: list[_Node] = []  # by number, as what follows
        self._leaves: list[VaryingLeaf] = []  # what refutes each cone as a whole
        self._proved: list[float] = []
        self._failed: list[float] = []  # least target that was not refuted
        self._parted: list[Cell | None] = []
        self._waiting: list[tuple[float, int]] = []
        for cone in first_cones(self._rows.order, self._rows.stable):
            self._file(_Node(0, cone, None, None, np.ones((len(cone), len(cone)))))

    @property
    def target(self) -> float:
        """The factor that is to be refuted now."""
        return (1.0 - self._share) * self.level

    @property
    def _ended(self) -> bool:
        """Check that the time is over, or multipliers take as much memory as they may."""
        full = len(self._multipliers) * 8.0 * self._programs.y.size > _MEMORY
        return full or self._until.over

    # ---- denominators ----

    def try_denominator(self, a: Reals) -> float:
        """Return the noise that a denominator needs, made stable; remember it if it is the best."""
        tried = monic(a, self._rows.stable)
        if tried is None:
            return np.inf
        solved = self._programs.solve(tried / np.abs(tried).max(), None)
        if solved is None:
            return np.inf
        if solved[0] < self.level:
            self.level, self.best = solved[0], [tried[1:], *self.best[:4]]
        return solved[0]

    def explore(self) -> None:
        """Descend from the best of random stable denominators, and again from what was found.

        A part of the time is for it, lest cones get none where a record is long.
        """
        left = self._deadline.left
        drawing, descending = (
            Deadline(None if left is None else part * left) for part in (_DRAWING, _EXPLORING)
        )
        random, n = np.random.default_rng(_SEED), self._rows.order
        tried = []
        for _ in range(_RANDOM * n):
            if drawing.over:
                break
            a = np.real(np.poly(_random_poles(random, n)))
            tried.append((self.try_denominator(a), a))
        tried.sort(key=lambda pair: pair[0])
        starts = (self._descended(a, descending) for _, a in tried[: _STARTS * n])
        found = sorted(starts, key=lambda x: x[0])
        for level, a in found[:n]:
            for _ in range(_AGAIN):
                before = level
                level, a = self._descended(a, descending)
                if level > (1.0 - _ALMOST) * before:
                    break
        self._explored = self.level

    def _descended(self, a: Reals, deadline: Deadline) -> tuple[float, Reals]:
        """Descend from a denominator (J. A. Nelder, R. Mead, 1965).

        The unknowns are logarithms of the coefficients in (z - 1) / (z + 1), positive for stable
        denominators; these are as fine near poles at 1 and -1 as elsewhere.
        """
        n = self._rows.order
        basis = first_cones(n, True)[0].astype(np.float64)
        start = a @ basis / 2.0**n
        sign, size = np.where(start < 0.0, -1.0, 1.0), np.abs(start)
        begin = np.log(np.maximum(size, _TINY * size.max()))

        def noise(x: Reals) -> float:
            if deadline.over:
                return _FAR
            return min(self.try_denominator((sign * np.exp(x)) @ basis), _FAR)

        found = minimize(
            noise,
            begin,
            method="Nelder-Mead",
            options={
                "maxfev": _DESCENT * n,
                "fatol": _ALMOST * min(self.level, _FAR),
                "initial_simplex": begin + _STEP * np.vstack([np.zeros(n + 1), np.eye(n + 1)]),
            },
        )
        return float(found.fun), np.asarray((sign * np.exp(found.x)) @ basis, np.float64)

    def _is_stable(self, a: Reals) -> bool:
        return not self._rows.stable or bool(np.abs(np.roots(a)).max(initial=0.0) < _ALMOST_STABLE)

    # ---- cones ----

    def _centred(self, node: _Node) -> _Node:
        """Solve for the multiplier of one denominator in the cone; the cone as it was if none."""
        a = (1.0 / self._sizes(node)) @ node.cone.astype(np.float64)
        solved = self._programs.solve(a / np.abs(a).max(), node.reference)
        if solved is None:
            return node
        level, multiplier, reference = solved
        if level < self.level and self._is_stable(a):
            self.try_denominator(a)
        n, length = self._rows.order, self._programs.y.size
        padded = np.concatenate([np.zeros(n), multiplier[self._programs.section], np.zeros(n)])
        return node._replace(reference=reference, centre=sliding_window_view(padded, length))

    def _sizes(self, node: _Node) -> Reals:
        """Sizes of the vectors (K,), in the noise that the multiplier of a cone lets through."""
        cone = node.cone.astype(np.float64)
        if node.centre is None:
            return np.abs(cone).max(axis=1)
        return np.maximum(np.abs(cone @ node.centre) @ self._programs.bound, _LEAST)

    def _unstable(self, cone: Cone, powers: tuple[int, ...]) -> VaryingLeaf | None:
        """The leaf of a cone whose members are all unstable by one minor; None for others."""
        if not self._rows.stable or self._rows.order < 3:
            return None
        minors = hurwitz_minors(cone, powers)
        which = np.flatnonzero(np.all(minors < 0.0, axis=1))
        if not which.size:
            return None
        weights = np.zeros(len(minors))
        weights[which[0]] = 1.0
        return VaryingLeaf((), (), powers, tuple(weights.tolist()))

    def _file(self, node: _Node) -> None:
        """File a cone that nothing refutes yet."""
        self._nodes.append(self._centred(node._replace(number=len(self._nodes))))
        self._leaves.append(_NOTHING)
        self._proved.append(0.0)
        self._failed.append(np.inf)
        self._parted.append(None)

    def _refute(self, cones: Sequence[tuple[int, float]]) -> None:
        """Refute the target in cones; put others in the queue, each with its whole's factor."""
        if not self._ended:
            self._solve([n for n, _ in cones if self._proved[n] < self.target < self._failed[n]])
        for number, least in cones:
            low = max(least, self._proved[number])
            if low < self.target and self._parted[number] is None:
                heapq.heappush(self._waiting, (low, number))

    def _solve(self, numbers: Sequence[int]) -> None:
        """Solve for what refutes the target in cones; what refuted more before stays."""
        open_, tasks = list[int](), []
        for number in numbers:
            node = self._nodes[number]
            powers = tuple(int(p) for p in np.round(np.log2(self._sizes(node))))
            leaf = self._unstable(node.cone, powers)
            if leaf is None:
                open_.append(number)
                tasks.append((self._cones, node.cone, powers, self.target, _PATIENCE))
            else:
                self._leaves[number], self._proved[number] = leaf, np.inf
        try:
            bounds = map_in_order(self._executor, solved_cone, tasks)
        except SparsePOPError:  # the executor takes no tasks any more
            self._executor, self._ahead = None, 1
            bounds = [solved_cone(task) for task in tasks]
        for number, task, bound in zip(open_, tasks, bounds, strict=True):
            self._keep(number, task[2], bound)

    def _keep(self, number: int, powers: tuple[int, ...], bound: ConeBound) -> None:
        """Keep what refutes a cone, if it is more than before, and where it is hard to refute."""
        node, size = self._nodes[number], len(self._nodes[number].cone)
        if bound.factor > self._proved[number]:
            first = len(self._multipliers)
            self._multipliers += list(self._orthogonal(bound.multipliers))
            family = tuple(range(first, first + size))
            minors = tuple(bound.minors.tolist())
            self._leaves[number] = VaryingLeaf((family,), (1.0,), powers, minors)
            self._proved[number] = bound.factor
        if self._proved[number] < self.target:
            self._failed[number] = self.target
        products = np.zeros((size, size))
        products[tuple(np.array(pairs(size)).T)] = bound.weights
        self._nodes[number] = node._replace(products=products + products.T)

    def _orthogonal(self, multipliers: Reals) -> Reals:
        """Take rounding out of the products with the columns."""
        basis = self._programs.basis
        for _ in range(2):
            multipliers = multipliers - (multipliers @ basis) @ basis.T
        return multipliers

    def run(self, output: int) -> FoundDenominators:
        """Part cones until all are refuted, or time or memory ends; state what is refuted.

        Where that takes too long, the search begins again with a low target, which rises. Each time
        all cones are refuted before any is refuted further: the worst one is near the others.
        """
        left = self._deadline.left
        if left is not None:
            self._until = Deadline(_AT_ONCE * left)
        self._reach(self._tol)
        closed, self._until = not self._ended, self._deadline
        if closed or self._ended:
            return self._found(output)
        before = copy.copy(self)  # keeps its lists
        self._begin()
        for share in (*(share for share in _SHARES if share > _NEAR * self._tol), self._tol):
            if not self._ended:
                self._reach(share)
        found = max((self._found(output), before._found(output)), key=lambda one: one.factor)
        return replace(found, best=tuple(self.best))

    def _reach(self, share: float) -> None:
        """Refute a target in all cones while time allows, in parts only where their whole fails."""
        self._share, self._waiting = share, []
        layer = list(range(len(first_cones(self._rows.order, self._rows.stable))))
        while layer and not self._ended:
            parts: list[int] = []
            for begin in range(0, len(layer), self._ahead):
                self._refute([(number, 0.0) for number in layer[begin : begin + self._ahead]])
            for number in layer:
                cell = self._parted[number]
                if cell is not None and self._proved[number] < self.target:
                    parts += cell.children
            layer = parts
        self._part_all()

    def _part_all(self) -> None:
        """Part the cones that are open at the present target, the worst ones first."""
        while not self._ended:
            parts: list[tuple[int, float]] = []
            while self._waiting and self._waiting[0][0] < self.target and len(parts) < self._ahead:
                low, number = heapq.heappop(self._waiting)
                parts += [(part, low) for part in self._parts(self._nodes[number])]
            if not parts:
                break
            self._refute(parts)
            if self.level < (1.0 - _LOWER) * self._explored:
                self._descended(np.append(1.0, self.best[0]), self._deadline)
                self._explored = self.level

    def _parts(self, node: _Node) -> tuple[int, ...]:
        """Part a cone at an edge between vectors that are hard to refute together."""
        edge: tuple[int, int, tuple[int, int]] | None = (0, 1, (1, 1))
        if node.centre is not None:
            filtered = node.cone.astype(np.float64) @ node.centre
            bound, sizes = self._programs.bound, self._sizes(node)
            edge = changing_edge(filtered, sizes, bound, node.products)
        if edge is None:
            return ()
        i, j, weights = edge
        parts = parted_cone(node.cone, (i, j), weights)
        if parts is None:  # too thin: it stays a leaf
            return ()
        first = len(self._nodes)
        self._parted[node.number] = Cell((first, first + 1), (i, j), weights)
        for part in parts:
            self._file(node._replace(cone=part))
        return first, first + 1

    def _found(self, output: int) -> FoundDenominators:
        """State what the tree refutes; parts that refute less than their whole are left out."""
        low = self._proved.copy()
        for number in reversed(range(len(low))):
            cell = self._parted[number]
            if cell is not None:
                parts = min(low[child] for child in cell.children)
                if parts > low[number]:
                    low[number] = parts
                else:
                    self._parted[number] = None
        cells, proved = list[Cell | VaryingLeaf](), list[float]()
        order = list(range(len(first_cones(self._rows.order, self._rows.stable))))
        for number in order:  # grows
            cell, leaf = self._parted[number], self._leaves[number]
            if cell is not None:
                cells.append(cell._replace(children=(len(order), len(order) + 1)))
                order += cell.children
            else:
                cells.append(leaf)
            proved.append(low[number])
        assert self._programs.free is not None
        none, free = np.zeros((0, self._rows.y.size)), self._programs.free
        claim = VaryingCells(output, free, none, tuple(cells))
        return claimed(self._rows, claim, self._multiplier, proved, self.best)

    def _multiplier(self, number: int) -> Reals:
        """A multiplier over the whole record, (N,)."""
        whole = np.zeros(self._rows.y.size)
        whole[self._programs.section] = self._multipliers[number]
        return whole


def _random_poles(random: np.random.Generator, n: int) -> list[complex]:
    """Draw stable poles, as often slow as fast, in pairs or real."""
    found: list[complex] = []
    while len(found) < n:
        size = 1.0 - np.exp(random.uniform(np.log(_SLOW), 0.0))
        if n - len(found) > 1 and random.random() < 0.5:
            pole = size * np.exp(1j * np.pi * np.exp(random.uniform(np.log(_SLOW), 0.0)))
            found += [pole, pole.conjugate()]
        else:
            found.append(size if random.random() < 0.9 else -size)
    return found
