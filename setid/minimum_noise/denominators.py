"""Search for denominators with little noise, and for what refutes all others.

A best-first search over cones of denominators. For one denominator the least noise is a linear
program in few unknowns, the numerator and the first samples; its dual solution is a multiplier
of the rows. Multipliers of a cone and of those around it are weighted by a matrix game, so that
together they exclude as much noise as they can.
"""

from __future__ import annotations

import heapq
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.minimum_noise.attained_noise import AttainedNoise
from setid.minimum_noise.claims import FoundDenominators
from setid.minimum_noise.cones.best_first import BestFirst
from setid.minimum_noise.cones.edges import changing_edge, handed_on
from setid.minimum_noise.cones.search import follow_denominators
from setid.minimum_noise.corners import by_corners
from setid.minimum_noise.games import matrix_game
from setid.minimum_noise.programs import Programs, programs_of, shifted
from setid.proofs.denominators.cones import Cone, split_cone
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf, dual_norm
from setid.proofs.denominators.output_rows import OutputRows
from sparsepop_py.budget import EARLY, Deadline, spend

__all__ = ["least_output_noise"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_FIRST = 0.03  # of the time: for multipliers that do not vary
_LEAST, _MOST = 2.0, 0.25  # CPU seconds that they have at least, of at most a share of the time
_ALONE = 120.0  # units of work, where no time is given
_PROGRAM_WORK, _SAMPLE_WORK = 1e-3, 1e-6  # of the program of one denominator
_ENOUGH = 2e-3  # of a factor
_PROGRAMS = 2  # a cone before it is split
_TRIES = 4  # denominators in a cone, where there is no multiplier for its centre


class _OpenCone(NamedTuple):
    """A cone that nothing refutes yet, and what multipliers say at its vectors."""

    cone: Cone
    used: list[int]
    values: Reals  # (m, K)
    noises: Reals  # (m, K)
    reference: Integers | None
    sizes: Reals  # (K,): of its vectors in the multiplier at the centre
    centre: int


def least_output_noise(
    rows: OutputRows,
    output: int,
    tol: float,
    deadline: Deadline,
    executor: Executor | None = None,
) -> FoundDenominators:
    """Bound the least factor on the noise bounds of one output from below.

    Parameters
    ----------
    rows : OutputRows
        With the noise bounds of factor 1, and the norm of the noise.
    output : int
    tol : float
        Of the factor.
    deadline : Deadline
    executor : concurrent.futures.Executor, optional
        Refutes several cones at once, where multipliers vary within each.
    """
    programs = programs_of(rows)
    if programs is None:
        return FoundDenominators(0.0, None, ())
    if programs.free is None:  # columns depend on each other: attained noise alone
        attained = AttainedNoise(programs, rows.stable)
        attained.explore(deadline)
        return FoundDenominators(0.0, None, tuple(attained.best))
    if rows.norm == "l1":
        return by_corners(rows, programs, output, tol, deadline)
    if rows.norm == "l2":  # its multipliers change smoothly: a few for each cone are enough
        return _Search(rows, programs, output, tol, deadline).run()
    first = _Search(rows, programs, output, tol, _alone(deadline))
    found = first.run()
    if found.factor >= first.target * (1.0 - _ENOUGH) or not found.best or deadline.stopped:
        return found
    try:
        more = follow_denominators(rows, programs, output, tol, deadline, found.best, executor)
    except EARLY as cause:
        deadline.ended(cause)
        return found
    best = more.best or found.best
    larger = max(found, more, key=lambda one: one.factor)
    return replace(larger, best=best)


def _alone(deadline: Deadline) -> Deadline:
    """Give multipliers that do not vary their time; they end small searches on a busy machine."""
    left = deadline.left
    if left is None:
        return deadline.part(_FIRST, _FIRST * _ALONE)
    return deadline.part(max(_FIRST, min(_LEAST * deadline.pace / left, _MOST)))


class _Search(BestFirst[_OpenCone]):
    """Best-first search over cones, with weighted multipliers for each cone."""

    def __init__(
        self, rows: OutputRows, programs: Programs, output: int, tol: float, deadline: Deadline
    ) -> None:
        super().__init__(rows, programs, output, tol, deadline)
        self._moments: list[Reals] = []
        self._random = np.random.default_rng(5)

    def _begin(self, cone: Cone) -> None:
        sizes = np.abs(cone.astype(np.float64)).max(axis=1)
        nothing = np.zeros((0, len(cone)))
        self._add(_OpenCone(cone, [], nothing, nothing, None, sizes, -1), 0.0, Cell())

    def _add(self, node: _OpenCone, least: float, whole: Cell | VaryingLeaf) -> None:
        """File a cone with what refutes it; what refutes a whole does so for its halves."""
        number = len(self._cells)
        self._cells.append(Cell())
        self._proved.append(0.0)
        low, shares = self._bound(node)
        mixture = np.full(len(node.cone), 1.0 / len(node.cone))
        for program in range(_PROGRAMS if low < self.target or not node.used else 0):
            found = self._tried(node, mixture, program)
            if found is None:
                break
            node = found
            low, shares = self._bound(node)
            if low >= self.target:
                break
            mixture = self._worst(node, low)
        used = np.flatnonzero(shares)
        self._cells[number] = whole
        if low > least:
            own = tuple(node.used[i] for i in used)
            self._cells[number] = Cell(used=own, shares=tuple(shares[used].tolist()))
        self._proved[number] = low = max(low, least)
        if low < self.target and node.centre >= 0:
            kept = handed_on(shares)
            node = node._replace(
                used=[node.used[i] for i in kept],
                values=node.values[kept],
                noises=node.noises[kept],
            )
            heapq.heappush(self._waiting, (low, number, node))

    def _tried(self, node: _OpenCone, mixture: Reals, program: int) -> _OpenCone | None:
        for _ in range(_TRIES):
            found = self._with_multiplier(node, mixture, program)
            if found is not None:
                return found
            mixture = mixture * self._random.uniform(0.5, 1.5, mixture.size)
        return None

    def _with_multiplier(self, node: _OpenCone, mixture: Reals, program: int) -> _OpenCone | None:
        """Add the multiplier of one denominator in a cone."""
        a = (mixture / node.sizes) @ node.cone.astype(np.float64)
        largest = float(np.abs(a).max())
        if not (np.isfinite(largest) and largest > 0.0):
            return None
        a = a / largest
        programs = self._programs_for(a)
        own = programs is self._programs
        solved = programs.solve(a, node.reference if own else None)
        spend(_PROGRAM_WORK + _SAMPLE_WORK * programs.y.size)
        if solved is None:
            return None
        level, multiplier, reference = solved
        if own:
            self._note(a, level)
        noise = self._noises(multiplier, a[None])[0]
        if not (np.isfinite(noise) and noise > 0.0):
            return None
        multiplier = multiplier / noise
        number = len(self._multipliers)
        self._multipliers.append(multiplier)
        self._moments.append(shifted(multiplier, self._rows.order) @ self._rows.y)
        sizes = self._noises(multiplier, node.cone.astype(np.float64))
        values = node.cone.astype(np.float64) @ self._moments[number]
        first = program == 0
        return node._replace(
            used=[*node.used, number],
            values=np.vstack([node.values, values]),
            noises=np.vstack([node.noises, sizes]),
            reference=reference if own else node.reference,
            sizes=np.maximum(sizes, 1e-300) if first else node.sizes,
            centre=number if first else node.centre,
        )

    def _noises(self, multiplier: Reals, vectors: Reals) -> Reals:
        """Noise that a multiplier lets through, (K,)."""
        return dual_norm(self._rows, vectors @ shifted(multiplier, self._rows.order))

    def _bound(self, node: _OpenCone) -> tuple[float, Reals]:
        """The factor that weighted multipliers refute in a cone, and their signed weights."""
        if not node.used:
            return 0.0, np.zeros(0)
        values = np.vstack([node.values, -node.values]) / node.sizes
        noises = np.vstack([node.noises, node.noises]) / node.sizes
        best, shares, factor = 0.0, np.zeros(len(values)), self.target
        factor = factor if np.isfinite(factor) else 0.0
        for _ in range(6):  # W. Dinkelbach, 1967: the largest ratio
            weights, _ = matrix_game(values - factor * noises)
            if weights is None:
                break
            low = float(np.min((weights @ values) / (weights @ noises)))
            if low > best:
                best, shares = low, weights
            if not low > factor * (1.0 + 1e-3):
                break
            factor = low
        if best < factor and best < self.target:
            best, shares = self._lower(values, noises, best, shares)
        half = len(node.used)
        return best, shares[:half] - shares[half:]

    def _lower(
        self, values: Reals, noises: Reals, best: float, shares: Reals
    ) -> tuple[float, Reals]:
        """Go on from below where the target is out of reach."""
        factor = best
        for _ in range(4):
            weights, _ = matrix_game(values - factor * noises)
            if weights is None:
                break
            low = float(np.min((weights @ values) / (weights @ noises)))
            if not low > best * (1.0 + 1e-3):
                break
            best, shares, factor = low, weights, low
        return best, shares

    def _worst(self, node: _OpenCone, low: float) -> Reals:
        """The mixture of vectors (K,) at which multipliers say least."""
        values = np.vstack([node.values, -node.values]) / node.sizes
        noises = np.vstack([node.noises, node.noises]) / node.sizes
        target = self.target if np.isfinite(self.target) else low
        mixture = matrix_game(values - max(low, target) * noises)[1]
        return np.full(len(node.cone), 1.0 / len(node.cone)) if mixture is None else mixture

    def _split(self, low: float, number: int, node: _OpenCone) -> None:
        """Split a cone at the edge along which its multipliers change most."""
        cone = node.cone.astype(np.float64)
        filtered = cone @ shifted(self._multipliers[node.centre], self._rows.order)
        edge = changing_edge(filtered, node.sizes, self._rows.bound)
        halves = None if edge is None else split_cone(node.cone, edge[:2], edge[2])
        if edge is None or halves is None:  # too thin: it stays a leaf
            self._cap = min(self._cap, low)
            return
        i, j, weights = edge
        first = len(self._cells)
        children = first, first + 1
        new = halves[0][i].astype(np.float64)
        values = np.array([new @ self._moments[m] for m in node.used])
        noises = np.array([self._noises(self._multipliers[m], new[None])[0] for m in node.used])
        size = float(self._noises(self._multipliers[node.centre], new[None])[0])
        whole, self._cells[number] = self._cells[number], Cell(children, (i, j), weights)
        for place, half in zip((i, j), halves, strict=True):
            own, more, sizes = node.values.copy(), node.noises.copy(), node.sizes.copy()
            own[:, place], more[:, place], sizes[place] = values, noises, max(size, 1e-300)
            child = node._replace(cone=half, values=own, noises=more, sizes=sizes)
            self._add(child, low, whole)
