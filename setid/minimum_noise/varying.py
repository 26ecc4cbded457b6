"""Search with multipliers that vary over a cone of denominators.

Best first, as in ``denominators.py``. At a denominator the dual solution rests on a few samples,
its reference. Each vector of a cone has its own multiplier with errors at these samples alone;
together they are a family, which follows the dual solution through the cone. What a family
refutes falls short by second order in the width of the cone. Families of a cone and of those
around it are weighted by a matrix game over the pairs of its vectors, with the minors of the
Hurwitz matrix as further rows.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.optimize import minimize

from setid.minimum_noise.claims import FoundDenominators, claimed
from setid.minimum_noise.cones import changing_edge, handed_on, monic
from setid.minimum_noise.games import matrix_game
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

__all__ = ["follow_denominators"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_PROGRAMS = 2  # a cone before it is parted
_MEMORY = 2.0**29  # bytes of multipliers and of bases
_RATIOS, _GROWN = 10, 1e-2  # steps to the largest ratio of a cone, and the least of them
_DESCENT, _STEP = 150, 0.3  # evaluations of a descent for each unknown, and its first step
_TINY, _ALMOST = 1e-7, 1e-4
_LOWER = 0.01  # of a level: where a descent is worth it
_ALMOST_STABLE = 1.0 + 1e-4


class _Family(NamedTuple):
    """Errors at a reference, and the one multiplier of all vectors, if it does not vary."""

    reference: Integers
    shares: Reals
    constant: int


class _Node(NamedTuple):
    """A cone in the search."""

    number: int
    cone: Cone
    families: list[int]
    reference: Integers | None
    centre: int  # number of a multiplier, -1 for none


class _Weighed(NamedTuple):
    """Collect what families refute in a cone."""

    factor: float
    leaf: VaryingLeaf
    own: Reals  # (m,) sizes of the shares
    mixture: Reals  # (K,) of vectors, at which they say least


def follow_denominators(
    rows: OutputRows,
    programs: Programs,
    output: int,
    tol: float,
    deadline: Deadline,
    best: Sequence[Reals] = (),
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
        Coefficients of denominators to begin from; none begins nowhere.
    """
    search = _Search(rows, programs, tol, deadline)
    for coefficients in best:
        search.try_denominator(np.concatenate([[1.0], coefficients]))
    if not np.isfinite(search.level):
        return FoundDenominators(0.0, None, tuple(best))
    search.improve()
    search.run()
    return search.found(output)


class _Search:
    def __init__(
        self, rows: OutputRows, programs: Programs, tol: float, deadline: Deadline
    ) -> None:
        self._rows, self._programs, self._tol, self._deadline = rows, programs, tol, deadline
        self.level, self.best = np.inf, list[Reals]()
        self._descended = np.inf  # the level from which there was a descent
        self._ahead: list[Reals] = []  # (n + 1, S) each: a multiplier i samples ahead
        self._leaves: list[VaryingLeaf | None] = []  # what refutes each cone as a whole
        self._proved: list[float] = []
        self._parted: list[Cell | None] = []
        self._moments: list[Reals] = []  # (n + 1,) each
        self._families: list[_Family] = []
        self._members: dict[tuple[int, tuple[int, ...]], int] = {}
        self._outputs: dict[tuple[int, ...], Reals | None] = {}
        self._waiting: list[tuple[float, int, _Node]] = []
        self._pairs = np.array(pairs(rows.order + 1)).T

    @property
    def target(self) -> float:
        """The factor that is to be refuted."""
        return (1.0 - self._tol) * self.level

    @property
    def _is_full(self) -> bool:
        """Check that multipliers and bases take as much memory as they may."""
        columns = self._rows.order + self._programs.known.shape[1]
        held = len(self._ahead) + columns * len(self._outputs)
        return held * 8.0 * self._programs.y.size > _MEMORY

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

    def improve(self) -> None:
        """Descend from the best denominator (J. A. Nelder, R. Mead, 1965).

        The unknowns are logarithms of the coefficients in (z - 1) / (z + 1), positive for stable
        denominators; these are as fine near poles at 1 and -1 as elsewhere.
        """
        self._descended, n = self.level, self._rows.order
        basis = first_cones(n, True)[0].astype(np.float64)
        start = np.append(1.0, self.best[0]) @ basis / 2.0**n
        sign, size = np.where(start < 0.0, -1.0, 1.0), np.abs(start)
        begin = np.log(np.maximum(size, _TINY * size.max()))

        def noise(x: Reals) -> float:
            if self._deadline.over:
                return 1e3 * self.level
            return min(self.try_denominator((sign * np.exp(x)) @ basis), 1e3 * self.level)

        minimize(
            noise,
            begin,
            method="Nelder-Mead",
            options={
                "maxfev": _DESCENT * n,
                "fatol": _ALMOST * self.level,
                "initial_simplex": begin + _STEP * np.vstack([np.zeros(n + 1), np.eye(n + 1)]),
            },
        )

    def _is_stable(self, a: Reals) -> bool:
        return not self._rows.stable or bool(np.abs(np.roots(a)).max(initial=0.0) < _ALMOST_STABLE)

    # ---- multipliers ----

    def _new_multiplier(self, a: Reals, reference: Integers, shares: Reals) -> int:
        """Make the multiplier of a denominator with errors at a reference."""
        programs = self._programs
        found = programs.multiplier(a, reference, shares)
        if found is None:
            return -1
        n, length = self._rows.order, programs.y.size
        padded = np.concatenate([np.zeros(n), found, np.zeros(n)])
        self._ahead.append(sliding_window_view(padded, length))
        self._moments.append(self._ahead[-1] @ programs.y)
        return len(self._ahead) - 1

    def _member(self, family: int, vector: tuple[int, ...]) -> int:
        """The number of a family's multiplier at a vector; -1 where it cannot be computed."""
        known = self._families[family]
        if known.constant >= 0:
            return known.constant
        key = family, vector
        if key not in self._members:
            a = np.array([float(entry) for entry in vector])
            a /= np.abs(a).max()
            if vector not in self._outputs:
                self._outputs[vector] = self._programs.orthonormal(a)
            basis, number = self._outputs[vector], -1
            if basis is not None:
                shares = _null(basis[known.reference], known.shares)
                number = self._new_multiplier(a, known.reference, shares)
            self._members[key] = number
        return self._members[key]

    def _new_families(self, a: Reals, node: _Node) -> _Node | None:
        """Add the families of one denominator in a cone: one that varies, one that does not."""
        solved = self._programs.solve(a, node.reference)
        basis = None if solved is None else self._programs.orthonormal(a)
        if solved is None or basis is None:
            return None
        level, _, reference = solved
        if level < self.level and self._is_stable(a):
            self.try_denominator(a)
        target = (self._programs.y / self._programs.bound)[reference]
        shares = _null(basis[reference], target)
        number = self._new_multiplier(a, reference, shares)
        if number < 0:
            return None
        self._families += [_Family(reference, shares, -1), _Family(reference, shares, number)]
        own = [*node.families, len(self._families) - 2, len(self._families) - 1]
        return node._replace(families=own, reference=reference, centre=number)

    # ---- cones ----

    def _weighed(self, node: _Node, powers: tuple[int, ...]) -> tuple[list[int], _Weighed | None]:
        """Weight the families of a cone; those that exist at all vectors, and the result."""
        vectors = np.ldexp(node.cone.astype(np.float64), -np.array(powers)[:, None])
        keys = [tuple(vector) for vector in node.cone.tolist()]
        families, used, needed, noise = [], [], [], []
        one, two = self._pairs
        for family in node.families:
            members = [self._member(family, key) for key in keys]
            if min(members) < 0:
                continue
            value = vectors @ np.array([self._moments[m] for m in members]).T
            needed.append(value[one, two] + value[two, one])
            filtered = np.array([vectors @ self._ahead[m] for m in members])  # [k, j]
            sums = filtered[one, two] + filtered[two, one]
            noise.append(np.abs(sums) @ self._programs.bound)
            families.append(family)
            used.append(tuple(members))
        if not families:
            return [], None
        minors = np.zeros((0, one.size))
        if self._rows.stable and self._rows.order > 2:
            minors = hurwitz_minors(node.cone, powers)
            size = np.maximum(np.abs(minors).max(axis=1, keepdims=True), 1e-300)
            scale = float(np.max(noise)) / size
        else:
            scale = np.zeros((0, 1))
        factor, weights, mixture = _shared(
            np.array(needed), np.array(noise), -minors * scale, self.target
        )
        count = len(families)
        shares = weights[:count] - weights[count : 2 * count]
        kept = np.flatnonzero(shares)
        leaf = VaryingLeaf(
            tuple(used[i] for i in kept),
            tuple(shares[kept].tolist()),
            powers,
            tuple((weights[2 * count :] * scale[:, 0]).tolist()),
        )
        vectors_mixed = np.zeros(len(node.cone))
        np.add.at(vectors_mixed, one, 0.5 * mixture)
        np.add.at(vectors_mixed, two, 0.5 * mixture)
        return families, _Weighed(factor, leaf, np.abs(shares), vectors_mixed)

    def _powers(self, node: _Node) -> tuple[int, ...]:
        """Powers of two near the sizes of the vectors of a cone, in its centre's multiplier."""
        vectors = node.cone.astype(np.float64)
        sizes = np.abs(vectors).max(axis=1)
        if node.centre >= 0:
            sizes = np.abs(vectors @ self._ahead[node.centre]) @ self._programs.bound
        return tuple(int(p) for p in np.round(np.log2(np.maximum(sizes, 1e-100))))

    def _is_unstable(self, node: _Node) -> VaryingLeaf | None:
        """The leaf of a cone whose members are all unstable by one minor; None for others."""
        if not self._rows.stable or self._rows.order < 3:
            return None
        powers = self._powers(node)
        minors = hurwitz_minors(node.cone, powers)
        which = np.flatnonzero(np.all(minors < 0.0, axis=1))
        if not which.size:
            return None
        weights = np.zeros(len(minors))
        weights[which[0]] = 1.0
        return VaryingLeaf((), (), powers, tuple(weights.tolist()))

    def _add(self, node: _Node, least: float = 0.0) -> None:
        """File a cone with what refutes it."""
        number = len(self._leaves)
        self._leaves.append(None)
        self._proved.append(0.0)
        self._parted.append(None)
        unstable = self._is_unstable(node)
        if unstable is not None:
            self._leaves[number], self._proved[number] = unstable, np.inf
            return
        node, weighed = self._worked(node)
        kept = node.families
        if weighed is not None:
            self._leaves[number], self._proved[number] = weighed.leaf, weighed.factor
            kept = [kept[i] for i in handed_on(weighed.own)]
        if self._proved[number] < self.target:
            node = node._replace(number=number, families=kept)
            heapq.heappush(self._waiting, (max(least, self._proved[number]), number, node))

    def _worked(self, node: _Node) -> tuple[_Node, _Weighed | None]:
        """Add families until they refute the target in a cone, or enough of them failed."""
        powers, weighed = self._powers(node), None
        mixture = np.full(len(node.cone), 1.0 / len(node.cone))
        for program in range(_PROGRAMS + 1):
            if program or not node.families:
                vectors = np.ldexp(node.cone.astype(np.float64), -np.array(powers)[:, None])
                a = mixture @ vectors
                more = self._new_families(a / np.abs(a).max(), node)
                if more is None:
                    break
                node = more
                powers = self._powers(node)
            families, weighed = self._weighed(node, powers)
            if weighed is None:
                break
            node = node._replace(families=families)
            if weighed.factor >= self.target:
                break
            mixture = weighed.mixture
        return node, weighed

    def run(self) -> None:
        """Part cones until all are refuted, or time or memory ends."""
        for cone in first_cones(self._rows.order, self._rows.stable):
            self._add(_Node(-1, cone, [], None, -1))
        while self._waiting:
            low, _, node = heapq.heappop(self._waiting)
            if low >= self.target or self._deadline.over or self._is_full:
                break
            self._part(node, low)
            if self.level < (1.0 - _LOWER) * self._descended:
                self.improve()

    def _part(self, node: _Node, low: float) -> None:
        """Part a cone at the edge along which its multiplier changes most."""
        edge: tuple[int, int, tuple[int, int]] | None = (0, 1, (1, 1))
        if node.centre >= 0:
            filtered = node.cone.astype(np.float64) @ self._ahead[node.centre]
            sizes = np.maximum(np.abs(filtered) @ self._programs.bound, 1e-100)
            edge = changing_edge(filtered, sizes, self._programs.bound)
        if edge is None:
            return
        i, j, weights = edge
        parts = parted_cone(node.cone, (i, j), weights)
        if parts is None:  # too thin: it stays a leaf
            return
        first = len(self._leaves)
        self._parted[node.number] = Cell((first, first + 1), (i, j), weights)
        for part in parts:
            self._add(node._replace(number=-1, cone=part), low)

    def found(self, output: int) -> FoundDenominators:
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
                cells.append(Cell() if leaf is None else leaf)
            proved.append(low[number])
        assert self._programs.free is not None
        none, free = np.zeros((0, self._rows.y.size)), self._programs.free
        claim = VaryingCells(output, free, none, tuple(cells))
        return claimed(self._rows, claim, self._multiplier, proved, self.best)

    def _multiplier(self, number: int) -> Reals:
        """A multiplier over the whole record, (N,)."""
        whole = np.zeros(self._rows.y.size)
        whole[self._programs.section] = self._ahead[number][0, self._rows.order :]
        return whole


def _null(rows: Reals, like: Reals) -> Reals:
    """The vector orthogonal to the columns, sizes of which sum up to 1, on the side of another."""
    found = np.asarray(np.linalg.svd(rows.T)[2][-1], np.float64)
    if found @ like < 0.0:
        found = -found
    return np.asarray(found / np.abs(found).sum(), np.float64)


def _shared(
    needed: Reals, noise: Reals, minors: Reals, target: float
) -> tuple[float, Reals, Reals]:
    """Weight families for the largest factor that they refute (W. Dinkelbach, 1967).

    Returns
    -------
    factor : float
    weights : (2 m + r,) float
        Of families, of their negatives and of minors; they sum up to 1.
    mixture : (pairs,) float
        Where they say least.
    """
    values = np.vstack([needed, -needed, minors])
    noises = np.vstack([noise, noise, 0.0 * minors])
    best, weights, factor = 0.0, np.zeros(len(values)), target
    mixture = np.full(values.shape[1], 1.0 / values.shape[1])
    scale = np.ones(values.shape[1])
    for _ in range(_RATIOS):  # each pair in its own scale (J.-P. Crouzeix, J. A. Ferland, 1991)
        found, worst = matrix_game((values - factor * noises) / scale)
        if found is None or worst is None:
            break
        mixture = worst if factor == target else mixture
        low = _ratio(found @ values, found @ noises)
        grown = low > best * (1.0 + _GROWN)
        if low > best:
            best, weights = low, found
            scale = np.maximum(found @ noises, 1e-3 * noise.mean(axis=0))
        if best >= target or not (grown or factor == target):
            break
        factor = best
    return best, weights, mixture


def _ratio(value: Reals, noise: Reals) -> float:
    """The least ratio; where there is no noise any factor is refuted."""
    some = noise > 1e-300
    ratios = np.where(some, value / np.where(some, noise, 1.0), np.where(value > 0.0, 1e6, 0.0))
    return float(ratios.min())
