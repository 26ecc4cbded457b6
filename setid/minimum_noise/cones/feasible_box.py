"""Search for a box of the parameters: cones of denominators, split until none reaches far.

Best first: the cone that reaches farthest beyond the ends that consistent parameters attain is
refuted, or split at its longest edge. Where the denominators of all cones that are left lie near
those ends, so do, by programs of their own, the gains on each cone. First all ends are brought
near, then as near as is asked; of orders from 3 on without a prior only the gains, since the engine
closes denominators sooner within a box that is near.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.feasible_points.fits.stable_poles import monic
from setid.formulation.formulation import Formulation
from setid.minimum_noise.cones.crew import MOST_BYTES, Crew
from setid.minimum_noise.cones.edges import changing_edge, edge_weights, long_edge
from setid.minimum_noise.cones.limits import FoundLimit, LimitTask, limited, orthogonal
from setid.minimum_noise.cones.linear_programs import EXACT, ConePrograms
from setid.minimum_noise.cones.nodes import OPEN_LEAF, ConeNode, Examined, examined, first_node
from setid.minimum_noise.programs import Programs, programs_of
from setid.proofs.denominators.cones import first_cones, split_cone
from setid.proofs.denominators.denominator_box import (
    DenominatorBox,
    Limit,
    limit_holds,
    ratio_ends,
    upright,
)
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf, correction_bounds
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.denominators.varying_multipliers import VaryingCells, family_refutes
from setid.proofs.parameter_box import start_of
from setid.proofs.row_boxes import RowBox
from sparsepop_py.budget import EARLY, Deadline, spend

__all__ = ["denominator_box", "settles"]

Reals = NDArray[np.float64]
Ends = tuple[Reals, Reals]
_Order = tuple[int, float]  # denominators (0) or gains (1), and how far they reach, negated
_TARGETS = (1.0, 0.1)  # of the attained widths: all ends are brought as near before any is nearer
_DENOMINATOR_TARGET = 0.1  # the least of denominators that the engine closes sooner
_AIM = 0.9  # of what an end may reach beyond: what programs aim at
_REFUTED_FACTOR = 1.0 + 1e-7  # of the noise bounds: what is refuted, rounding included
_THIN = 0.01  # of what ends may reach beyond: a smaller cone is left, as it is nearly consistent
_ROUNDING_LOSS = 1e-6  # of a width: what rounding may take of the end of a gain
_VECTOR_BITS = 34  # binary digits of multipliers of vectors, from the largest one on
_LIMIT_BITS = 44  # binary digits of multipliers that bound a gain
_DEFAULT_WORK = 120.0  # units, where no limit is given
_TINY = 1e-300  # in place of zero in quotients and logarithms


@dataclass(slots=True)
class _OpenCone:
    """A cone that is left, the ends of the parameters on it, and whether it was examined."""

    node: ConeNode
    number: int
    low: Reals
    high: Reals
    examined: bool = False


def denominator_box(
    formulation: Formulation,
    first: RowBox | None,
    attained: Ends,
    tol: float,
    deadline: Deadline,
    executor: Executor | None = None,
) -> DenominatorBox | None:
    """Prove a box near the ends that are attained; None where outputs have other rows.

    Parameters
    ----------
    formulation : Formulation
    first : ParameterBox, DirectionBox, LiftedBox or None
        A box that is known.
    attained : (lower, upper), each (p,) float
        Ends that consistent parameters reach.
    tol : float
        Of the attained widths: cones that reach less far beyond are not split.
    deadline : Deadline
    executor : concurrent.futures.Executor, optional
        Examines several cones at once.
    """
    start = start_of(formulation)
    inside = start[0], start[1]
    if first is not None:
        inside = np.maximum(start[0], first.lower), np.minimum(start[1], first.upper)
    trees, limits, complete = list[VaryingCells](), list[tuple[Limit, ...]](), True
    outputs = formulation.model.outputs
    for output in range(outputs):
        rows = _rows(formulation, output)
        programs = None if rows is None else programs_of(rows)
        if rows is None or programs is None or programs.free is None:
            continue
        parts = 1.0 / (outputs - output)
        until = deadline.part(parts, otherwise=parts * _DEFAULT_WORK)
        search = _Search(formulation, rows, programs, inside, attained, until, executor)
        complete &= search.run(tol, tol if _is_fast(rows) else max(tol, _DENOMINATOR_TARGET))
        tree, own = search.proved(output)
        trees.append(tree)
        limits.append(own)
    if not trees:
        return None
    unknown = frozen(np.full(len(start[0]), -inf)), frozen(np.full(len(start[0]), inf))
    found = DenominatorBox(
        formulation.parameters, *unknown, first, tuple(trees), tuple(limits), complete
    )
    hull = found.hull(formulation, start)
    return None if hull is None else replace(found, lower=frozen(hull[0]), upper=frozen(hull[1]))


def settles(formulation: Formulation) -> bool:
    """Check that cones bring the ends of all outputs as near as is asked, given time.

    Parameters
    ----------
    formulation : Formulation
    """
    every = (_rows(formulation, output) for output in range(formulation.model.outputs))
    return all(rows is not None and _is_fast(rows) for rows in every)


def _rows(formulation: Formulation, output: int) -> OutputRows | None:
    """State the rows of an output whose denominator's coefficients are parameters."""
    rows = output_rows(formulation, output)
    return rows if rows is not None and {*rows.own} <= {"", *formulation.parameters} else None


def _is_fast(rows: OutputRows) -> bool:
    """Check that cones are faster than the engine to the last: by the minors, or of low order."""
    return rows.stable or rows.order < 3


class _Search:
    """Best-first search over cones of one output, which brings ends of its parameters near."""

    def __init__(
        self,
        formulation: Formulation,
        rows: OutputRows,
        programs: Programs,
        inside: Ends,
        attained: Ends,
        deadline: Deadline,
        executor: Executor | None,
    ) -> None:
        self._rows, self._programs, self._deadline = rows, programs, deadline
        assert programs.free is not None
        self._free = programs.free
        self._crew = Crew(executor)
        at = {name: place for place, name in enumerate(formulation.parameters)}
        self._own = [(lag, at[name]) for lag, name in enumerate(rows.own) if name in at]
        self._gains = [(c, at[name], s) for c, (name, s) in enumerate(rows.gains) if name in at]
        self._low, self._high, self._inside = attained[0].copy(), attained[1].copy(), inside
        self._cones = ConePrograms(programs, rows.stable, deadline.left, EXACT)
        self._solvers = {
            column: ConePrograms(programs, rows.stable, deadline.left, EXACT, column)
            for column, _, _ in self._gains
        }
        self._multipliers: list[Reals] = []
        self._cells: list[Cell | VaryingLeaf] = []  # by number, as what follows
        self._wholes: list[int] = []  # -1 for the first ones
        self._limits: dict[tuple[int, int, int], Limit] = {}  # by cell, column and sign
        self._waiting: list[tuple[_Order, int, _OpenCone]] = []
        self._count, self._share, self._least = 0, _TARGETS[0], 0.0
        self._thin = False  # whether a cone was left as too thin
        for cone in first_cones(rows.order, rows.stable):
            self._file(first_node(cone), -1, inside)

    # ---- how far ends reach ----------------------------------------------------------------

    def _width(self) -> Reals:
        size = np.maximum(np.abs(self._low), np.abs(self._high))
        return np.maximum(self._high - self._low, 1e-12 * size + _TINY)

    def _beyond(self, open_cone: _OpenCone, places: Sequence[int]) -> float:
        """Distance of ends beyond the attained ones, the largest, in attained widths."""
        with np.errstate(invalid="ignore"):
            far = np.maximum(self._low - open_cone.low, open_cone.high - self._high) / self._width()
        return float(np.max(far[list(places)], initial=0.0))

    def _order(self, open_cone: _OpenCone) -> _Order:
        """Denominators first: of gains nothing is known before."""
        own = self._beyond(open_cone, [place for _, place in self._own])
        if own > max(self._share, self._least):
            return 0, -own
        return 1, -self._beyond(open_cone, [place for _, place, _ in self._gains])

    def _is_far(self, order: _Order) -> bool:
        return order[0] == 0 or -order[1] > self._share

    # ---- the search ------------------------------------------------------------------------

    def run(self, tol: float, least: float) -> bool:
        """Split cones until none reaches farther than is asked; tell if all came as near.

        Denominators need not be nearer than ``least``.
        """
        self._least = least
        try:
            near = all(self._reached(s) for s in (*(s for s in _TARGETS if s > tol), tol))
            return near and not self._thin
        except EARLY as cause:
            self._deadline.ended(cause)
            return False

    def _reached(self, share: float) -> bool:
        """Split cones until none reaches farther than a share of the widths, or time ends."""
        self._share = share
        again, self._waiting = [open_cone for _, _, open_cone in self._waiting], []
        for open_cone in again:
            self._push(open_cone)
        while self._waiting and self._is_far(self._waiting[0][0]):
            if self._ended:
                return False
            self._advance()
        return True

    @property
    def _ended(self) -> bool:
        size = len(self._multipliers) * 8.0 * self._rows.y.size
        return size > MOST_BYTES or self._deadline.over

    def _advance(self) -> None:
        """Refute, bound or split the cones that reach farthest."""
        batch: list[_OpenCone] = []
        while self._waiting and len(batch) < self._crew.cones and self._is_far(self._waiting[0][0]):
            batch.append(heapq.heappop(self._waiting)[2])
        new = [open_cone for open_cone in batch if not open_cone.examined]
        tasks = [(self._cones, open_cone.node, _REFUTED_FACTOR) for open_cone in new]
        spend(self._cones.work * len(tasks))
        refuted = set[int]()
        for open_cone, found in zip(new, self._crew.map(examined, tasks), strict=True):
            if self._refuted(open_cone, found):
                refuted.add(open_cone.number)
        batch = [open_cone for open_cone in batch if open_cone.number not in refuted]
        if not self._ended:
            self._limit([open_cone for open_cone in batch if self._order(open_cone)[0] == 1])
        for open_cone in batch:
            if self._is_far(self._order(open_cone)) and not self._ended:
                self._split(open_cone)
            else:
                self._push(open_cone)

    def _refuted(self, open_cone: _OpenCone, found: Examined) -> bool:
        """Keep what refutes a cone; else what is new of it."""
        open_cone.node, open_cone.examined = found.node, True
        if found.tried is not None and found.level < 1.0:
            self._attain(found.tried)
        if found.bound is None:
            assert found.unstable is not None
            self._cells[open_cone.number] = found.unstable
            return True
        if found.bound.factor < 1.0:
            return False
        table = self._table(orthogonal(found.bound.multipliers, self._programs.basis))
        numbers, minors = tuple(range(len(table))), tuple(found.bound.minors.tolist())
        leaf = VaryingLeaf((numbers,), (1.0,), found.powers, minors)
        corrections = correction_bounds(self._rows, self._free, table)
        if corrections is None or not family_refutes(
            self._rows, table, corrections, open_cone.node.cone, leaf
        ):
            return False
        self._cells[open_cone.number] = leaf._replace(used=(self._family(table),))
        return True

    def _table(self, multipliers: Reals, bits: int = _VECTOR_BITS) -> Reals:
        """Multipliers over the whole record, (K, N), in short binary fractions."""
        size = np.abs(multipliers).max(axis=1, keepdims=True)
        unit = np.exp2(np.ceil(np.log2(np.maximum(size, _TINY))) - bits)
        return np.array([self._programs.whole(m) for m in np.round(multipliers / unit) * unit])

    def _attain(self, a: Reals) -> None:
        """Note a consistent denominator, which no target may ask to be refuted."""
        found = monic(a, False)
        if found is None:
            return
        pairs = [(place, float(found[lag + 1])) for lag, place in self._own]
        if all(self._inside[0][place] <= v <= self._inside[1][place] for place, v in pairs):
            for place, value in pairs:
                self._low[place] = min(self._low[place], value)
                self._high[place] = max(self._high[place], value)

    def _family(self, multipliers: Reals) -> tuple[int, ...]:
        begin = len(self._multipliers)
        self._multipliers += list(multipliers)
        return tuple(range(begin, begin + len(multipliers)))

    def _limit(self, batch: Sequence[_OpenCone]) -> None:
        """Bound the gains that reach too far."""
        asked: list[tuple[_OpenCone, int, int, int]] = []
        tasks: list[LimitTask] = []
        for open_cone in batch:
            cone = upright(open_cone.node.cone)
            if cone is None:
                continue
            node = open_cone.node._replace(cone=cone)
            for column, place, own in self._gains:
                room = self._share * self._width()[place]
                for sign in (1, -1):
                    upper = sign * own > 0
                    end = self._high[place] if upper else -self._low[place]
                    now = open_cone.high[place] if upper else -open_cone.low[place]
                    if now - end > room:
                        asked.append((open_cone, column, place, sign))
                        aim = end + _AIM * room
                        solver = self._solvers[column]
                        tasks.append(LimitTask(solver, node, sign, aim, _REFUTED_FACTOR))
        found = self._crew.map(limited, tasks)
        spend(sum(task.solver.work for task in tasks))
        for (open_cone, column, place, sign), one in zip(asked, found, strict=True):
            self._keep_limit(open_cone, (column, place, sign), one)

    def _keep_limit(
        self, open_cone: _OpenCone, which: tuple[int, int, int], found: FoundLimit
    ) -> None:
        column, place, sign = which
        upper = sign * self._rows.gains[column][1] > 0
        ends, cone = open_cone.high if upper else -open_cone.low, open_cone.node.cone
        value = found.value + _ROUNDING_LOSS * float(self._width()[place])
        if not value < ends[place]:
            return
        table = self._table(found.multipliers, _LIMIT_BITS)
        numbers = tuple(range(len(table)))
        limit = Limit(open_cone.number, column, sign, value, numbers, found.powers, found.minors)
        if not limit_holds(self._rows, self._free, table, cone, limit):
            return
        limit = limit._replace(used=self._family(table))
        self._limits[open_cone.number, column, sign] = limit
        if upper:
            open_cone.high[place] = value
        else:
            open_cone.low[place] = -value

    def _split(self, open_cone: _OpenCone) -> None:
        """Split a cone; one that is too thin is left."""
        if self._is_thin(open_cone):
            self._thin = True
            return
        edge = self._edge(open_cone.node)
        halves = None if edge is None else split_cone(open_cone.node.cone, edge[:2], edge[2])
        if edge is None or halves is None:
            return
        first = len(self._cells)
        for half in halves:
            node = open_cone.node._replace(cone=half, centred=False)
            self._file(node, open_cone.number, (open_cone.low, open_cone.high))
        self._cells[open_cone.number] = Cell((first, first + 1), edge[:2], edge[2])

    def _is_thin(self, open_cone: _OpenCone) -> bool:
        """Check that all denominators of a cone are as good as one, which is not refuted."""
        places = [place for _, place in self._own]
        room = self._share * self._width()[places]
        return bool(places and np.all((open_cone.high - open_cone.low)[places] <= _THIN * room))

    def _edge(self, node: ConeNode) -> tuple[int, int, tuple[int, int]] | None:
        """Two vectors and the weights of the one between them."""
        if node.centre is None:
            return 0, 1, (1, 1)
        bound, turned = self._programs.bound, upright(node.cone)
        filtered, sizes = node.cone.astype(np.float64) @ node.centre, node.sizes(bound)
        if turned is None:
            return changing_edge(filtered, sizes, bound)
        vectors = turned.astype(np.float64)
        coefficients = vectors[:, 1:] / vectors[:, :1]
        for lag, place in self._own:
            coefficients[:, lag] /= self._width()[place]
        found = long_edge(coefficients, filtered, sizes, bound, node.products)
        if found is None:
            return None
        i, j = found
        return i, j, edge_weights(float(np.log2(vectors[j, 0] / vectors[i, 0])))

    def _file(self, node: ConeNode, whole: int, ends: Ends) -> None:
        """Number a cone; it is left out where it lies outside of what is known."""
        number = len(self._cells)
        self._cells.append(OPEN_LEAF)
        self._wholes.append(whole)
        low, high = ends[0].copy(), ends[1].copy()
        least, most = ratio_ends(node.cone)
        for lag, place in self._own:
            low[place], high[place] = max(low[place], least[lag]), min(high[place], most[lag])
        if np.all(low <= high):
            self._push(_OpenCone(node, number, low, high))

    def _push(self, open_cone: _OpenCone) -> None:
        self._count += 1
        heapq.heappush(self._waiting, (self._order(open_cone), self._count, open_cone))

    # ---- what is proved --------------------------------------------------------------------

    def proved(self, output: int) -> tuple[VaryingCells, tuple[Limit, ...]]:
        """List all cones, limits that bind on one that is left, and both's multipliers."""
        binding = self._binding()
        used = {m for limit in binding for m in limit.used}
        for cell in self._cells:
            if isinstance(cell, VaryingLeaf):
                used |= {m for family in cell.used for m in family}
        place = {m: number for number, m in enumerate(sorted(used))}
        cells = tuple(
            cell
            if isinstance(cell, Cell)
            else cell._replace(used=tuple(tuple(place[m] for m in one) for one in cell.used))
            for cell in self._cells
        )
        limits = (one._replace(used=tuple(place[m] for m in one.used)) for one in binding)
        inside, free = self._rows.inside, self._rows.numbers(self._free)
        table = np.array([self._multipliers[m][inside] for m in place])
        table = table.reshape(len(place), np.count_nonzero(inside))
        return VaryingCells(output, free, table, cells), tuple(limits)

    def _binding(self) -> list[Limit]:
        left = [number for number, cell in enumerate(self._cells) if cell is OPEN_LEAF]
        found = dict[tuple[int, int, int], Limit]()
        for number in left:
            best = dict[tuple[int, int], Limit]()
            while number >= 0:
                for column, _, _ in self._gains:
                    for sign in (1, -1):
                        limit = self._limits.get((number, column, sign))
                        held = best.get((column, sign))
                        if limit and not (held and held.value <= limit.value):
                            best[column, sign] = limit
                number = self._wholes[number]
            found.update({(one.cell, one.column, one.sign): one for one in best.values()})
        return list(found.values())
