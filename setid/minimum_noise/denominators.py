"""Search for denominators with little noise, and for what refutes all others.

A best-first search over cones of denominators. For one denominator the least noise is a linear
program in few unknowns, the numerator and the first samples; its dual solution is a multiplier
of the rows. Multipliers of a cone and of those around it are weighted by a matrix game, so that
together they exclude as much noise as they can.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.signal import lfilter

from setid.proofs.least_noise.denominator_cells import (
    Cell,
    Cone,
    DenominatorCells,
    OutputRows,
    first_cones,
    parted_cone,
)
from sparsepop_py.budget import Deadline

__all__ = ["FoundDenominators", "least_output_noise"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_PROGRAMS = 2  # a cone before it is parted
_POOL = 10  # multipliers that a cone hands on
_EXCHANGES = 120
_ALMOST = 1e-3  # of a level: where an exchange ends
_UNEVEN = 24  # largest power of two between the weights of an edge
_LOSSES = (1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 5e-2)  # of a factor: what may be left to rounding
_OVER = 1.0 + 1e-12
_INSIDE = 1.0 - 1e-5  # largest modulus of a pole to begin from
_TRIES = 4  # denominators in a cone, where there is no multiplier for its centre
_MEMORY = 2.0**28  # bytes of multipliers


@dataclass(frozen=True, slots=True, eq=False)
class FoundDenominators:
    """A proved factor on the noise bounds, and denominators near the least one.

    Parameters
    ----------
    factor : float
        Refuted; 0 for none.
    cells : DenominatorCells or None
        What refutes it.
    best : tuple of (n,) float
        Coefficients a_1, ..., a_n that need little noise, the best one first.
    """

    factor: float
    cells: DenominatorCells | None
    best: tuple[Reals, ...]


class _Grown(NamedTuple):
    """A cone in the search."""

    number: int
    cone: Cone
    used: list[int]
    values: Reals  # (m, K)
    noises: Reals  # (m, K)
    reference: Integers | None
    sizes: Reals  # (K,): of its vectors in the multiplier at the centre
    centre: int


def least_output_noise(
    rows: OutputRows, output: int, tol: float, deadline: Deadline
) -> FoundDenominators:
    """Bound the least factor on the noise bounds of one output from below.

    Parameters
    ----------
    rows : OutputRows
        With the noise bounds of factor 1.
    output : int
    tol : float
        Of the factor.
    deadline : Deadline
    """
    section = _longest(rows.row)
    if section.size <= rows.order + rows.known.shape[1] + 1 or not np.any(rows.bound > 0):
        return FoundDenominators(0.0, None, ())
    programs = _Programs(rows, section)
    if programs.free is None:
        return FoundDenominators(0.0, None, ())
    return _Search(rows, programs, output, tol, deadline).run()


def _longest(row: NDArray[np.bool_]) -> Integers:
    """The longest stretch of rows without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    if not edges.size:
        return np.zeros(0, np.int64)
    begins, ends = edges[::2], edges[1::2]
    place = int(np.argmax(ends - begins))
    return np.arange(begins[place], ends[place])


# ---- one denominator ----------------------------------------------------------------------


class _Programs:
    """Least noise for one denominator after the other, on a stretch of rows."""

    def __init__(self, rows: OutputRows, section: Integers) -> None:
        self.order, self.section = rows.order, section
        self.samples = slice(int(section[0]) - rows.order, int(section[-1]) + 1)
        self.y = rows.y[self.samples]
        bound = rows.bound[self.samples]
        self.bound = np.maximum(bound, 1e-9 * float(bound.max()))
        self.known = rows.known[section]
        self.length = rows.y.size
        self.free = self._free()
        self.basis = np.linalg.qr(self.known)[0]

    def _free(self) -> Integers | None:
        count = self.known.shape[1]
        _, triangle, order = qr(self.known.T, mode="economic", pivoting=True)
        size = np.abs(np.diag(triangle))
        if count and (size.size < count or size[-1] <= 1e-10 * size[0]):
            return None
        return np.sort(self.section[order[:count]])

    def solve(self, a: Reals, reference: Integers | None) -> tuple[float, Reals, Integers] | None:
        """Noise that is needed, and the multiplier (N,); None where it cannot be computed."""
        with np.errstate(all="ignore"):
            outputs = self._outputs(a)
            if outputs is None:
                return None
            basis = np.linalg.qr(outputs / self.bound[:, None])[0]
            target = self.y / self.bound
            if reference is None:
                reference = np.linspace(0, target.size - 1, basis.shape[1] + 1).astype(np.int64)
            found = _exchanged(basis, target, reference)
            if found is None:
                return None
            level, shares, reference = found
            errors = np.zeros(target.size)
            np.add.at(errors, reference, shares)
            multiplier = self._adjoint(a, errors / self.bound)
            for _ in range(2):
                multiplier = multiplier - self.basis @ (self.basis.T @ multiplier)
        if not np.all(np.isfinite(multiplier)):
            return None
        whole = np.zeros(self.length)
        whole[self.section] = multiplier
        return level, whole, reference

    def _outputs(self, a: Reals) -> Reals | None:
        """Outputs without noise, (S, n + c): of each column and each first or last sample."""
        n, count = self.order, self.y.size
        inside, outside = _factored(a)
        ahead, back = inside.size - 1, outside.size - 1
        columns = [
            _forward(inside, np.zeros(ahead), _backward(outside, np.zeros(back), column))
            for column in self.known.T
        ]
        for end in np.eye(back):
            columns.append(
                _forward(inside, np.zeros(ahead), _backward(outside, end, np.zeros(count - n)))
            )
        for start in np.eye(ahead):
            columns.append(_forward(inside, start, np.zeros(count - ahead)))
        found = np.array(columns).reshape(len(columns), count).T
        size = np.abs(found).max(axis=0, initial=0.0)
        if not np.all(np.isfinite(size)) or np.any(size == 0.0):
            return None
        return np.asarray(found / size, np.float64)

    def _adjoint(self, a: Reals, errors: Reals) -> Reals:
        """Multipliers (S - n,) with sum_i a_i lambda(k + i) = errors(k)."""
        inside, outside = _factored(a)
        ahead, back = inside.size - 1, outside.size - 1
        inner = lfilter([1.0], inside, errors[::-1])[::-1][ahead:]
        if not back:
            return np.asarray(inner / outside[0], np.float64)
        turned = outside[::-1] / outside[-1]
        return np.asarray(
            lfilter([1.0], turned, inner / outside[-1])[: self.y.size - self.order], np.float64
        )


def _factored(a: Reals) -> tuple[Reals, Reals]:
    """Factors of a polynomial with the zeros in the unit disc, monic, and with the others."""
    begin = int(np.flatnonzero(a)[0])
    roots = np.roots(a)
    within = np.abs(roots) <= 1.0
    inside = np.real(np.poly(roots[within])) if np.any(within) else np.ones(1)
    outside = np.real(np.poly(roots[~within])) if np.any(~within) else np.ones(1)
    outside = np.concatenate([np.zeros(begin), np.atleast_1d(outside)]) * a[begin]
    return np.atleast_1d(inside), outside


def _forward(factor: Reals, start: Reals, drive: Reals) -> Reals:
    return np.asarray(lfilter([1.0], factor, np.concatenate([start, drive])), np.float64)


def _backward(factor: Reals, end: Reals, drive: Reals) -> Reals:
    """Solve for a signal backwards in time, from its last samples."""
    if factor.size == 1:
        return drive / factor[0]
    turned = factor[::-1] / factor[-1]
    return np.asarray(
        lfilter([1.0], turned, np.concatenate([end, drive[::-1] / factor[-1]]))[::-1], np.float64
    )


def _exchanged(
    basis: Reals, target: Reals, reference: Integers
) -> tuple[float, Reals, Integers] | None:
    """Approximate a target in the largest error by single exchanges (E. Stiefel, 1960).

    Returns
    -------
    level : float
        The largest error that is left.
    shares : (c + 1,) float
        Dual solution at the reference, sizes of which sum up to 1.
    reference : (c + 1,) int
    """
    count, reference = basis.shape[1], reference.copy()
    weights = np.linalg.svd(basis[reference].T)[2][-1]
    signs = np.where(weights * np.sign(weights @ target[reference] or 1.0) >= 0, 1.0, -1.0)
    try:
        inverse = np.linalg.inv(_columns(basis, reference, signs))
        level = np.inf
        for step in range(_EXCHANGES):
            solved = (signs * target[reference]) @ inverse
            errors = target - basis @ solved[:count]
            worst = int(np.argmax(np.abs(errors)))
            level = abs(float(errors[worst]))
            if level <= solved[count] * (1.0 + _ALMOST) + 1e-14:
                break
            sign = 1.0 if errors[worst] > 0 else -1.0
            along = inverse @ np.append(sign * basis[worst], 1.0)
            usable = along > 1e-11
            if not np.any(usable):
                break
            ratios = np.where(usable, inverse[:, -1] / np.where(usable, along, 1.0), np.inf)
            place = int(np.argmin(ratios))
            reference[place], signs[place] = worst, sign
            row = inverse[place] / along[place]
            inverse = inverse - np.outer(along, row)
            inverse[place] = row
            if step % 30 == 29:
                inverse = np.linalg.inv(_columns(basis, reference, signs))
    except np.linalg.LinAlgError:
        return None
    return level, np.asarray(inverse[:, -1] * signs, np.float64), reference


def _columns(basis: Reals, reference: Integers, signs: Reals) -> Reals:
    return np.vstack([(basis[reference] * signs[:, None]).T, np.ones(reference.size)])


# ---- all denominators ---------------------------------------------------------------------


class _Search:
    def __init__(
        self, rows: OutputRows, programs: _Programs, output: int, tol: float, deadline: Deadline
    ) -> None:
        self._rows, self._programs, self._output = rows, programs, output
        self._tol, self._deadline = tol, deadline
        self._multipliers: list[Reals] = []
        self._moments: list[Reals] = []
        self._cells: list[Cell] = []
        self._proved: list[float] = []
        self._waiting: list[tuple[float, int, _Grown]] = []
        self._level, self._cap, self._best = np.inf, np.inf, list[Reals]()
        self._random = np.random.default_rng(5)
        self._most = int(_MEMORY / (8.0 * rows.y.size))

    def run(self) -> FoundDenominators:
        for cone in first_cones(self._rows.order, self._rows.stable):
            sizes = np.abs(cone.astype(np.float64)).max(axis=1)
            nothing = np.zeros((0, len(cone)))
            self._add(_Grown(-1, cone, [], nothing, nothing, None, sizes, -1), 0.0, Cell())
        while self._waiting:
            low, _, grown = heapq.heappop(self._waiting)
            enough = low >= min(self._target, self._cap)
            if enough or self._deadline.over or len(self._multipliers) >= self._most:
                break
            self._part(grown, low)
        return self._found()

    @property
    def _target(self) -> float:
        return (1.0 - self._tol) * self._level if np.isfinite(self._level) else np.inf

    def _add(self, grown: _Grown, least: float, whole: Cell) -> None:
        """File a cone with what refutes it; what refutes a whole does so for its parts."""
        number = len(self._cells)
        self._cells.append(Cell())
        self._proved.append(0.0)
        low, shares = self._bound(grown)
        mixture = np.full(len(grown.cone), 1.0 / len(grown.cone))
        for program in range(_PROGRAMS if low < self._target or not grown.used else 0):
            found = self._tried(grown, mixture, program)
            if found is None:
                break
            grown = found
            low, shares = self._bound(grown)
            if low >= self._target:
                break
            mixture = self._worst(grown, low)
        used = np.flatnonzero(shares)
        self._cells[number] = whole
        if low > least:
            own = tuple(grown.used[i] for i in used)
            self._cells[number] = Cell(used=own, shares=tuple(shares[used].tolist()))
        self._proved[number] = low = max(low, least)
        if low < self._target and grown.centre >= 0:
            kept = self._kept(shares)
            grown = grown._replace(
                number=number,
                used=[grown.used[i] for i in kept],
                values=grown.values[kept],
                noises=grown.noises[kept],
            )
            heapq.heappush(self._waiting, (low, number, grown))

    def _kept(self, shares: Reals) -> Integers:
        """The multipliers that a cone hands on: the last ones, and those of the largest shares."""
        last = np.arange(max(0, shares.size - 4), shares.size)
        return np.unique(np.concatenate([last, np.argsort(-np.abs(shares))[: _POOL - 4]]))

    def _tried(self, grown: _Grown, mixture: Reals, program: int) -> _Grown | None:
        for _ in range(_TRIES):
            found = self._with_multiplier(grown, mixture, program)
            if found is not None:
                return found
            mixture = mixture * self._random.uniform(0.5, 1.5, mixture.size)
        return None

    def _with_multiplier(self, grown: _Grown, mixture: Reals, program: int) -> _Grown | None:
        """Add the multiplier of one denominator in a cone."""
        a = (mixture / grown.sizes) @ grown.cone.astype(np.float64)
        largest = float(np.abs(a).max())
        solved = None
        if np.isfinite(largest) and largest > 0.0:
            solved = self._programs.solve(a / largest, grown.reference)
        if solved is None:
            return None
        level, multiplier, reference = solved
        self._note(a, level)
        noise = self._noises(multiplier, a[None])[0]
        if not (np.isfinite(noise) and noise > 0.0):
            return None
        multiplier = multiplier / noise
        number = len(self._multipliers)
        self._multipliers.append(multiplier)
        self._moments.append(self._moment(multiplier))
        sizes = self._noises(multiplier, grown.cone.astype(np.float64))
        values = grown.cone.astype(np.float64) @ self._moments[number]
        first = program == 0
        return grown._replace(
            used=[*grown.used, number],
            values=np.vstack([grown.values, values]),
            noises=np.vstack([grown.noises, sizes]),
            reference=reference,
            sizes=np.maximum(sizes, 1e-300) if first else grown.sizes,
            centre=number if first else grown.centre,
        )

    def _note(self, a: Reals, level: float) -> None:
        """Remember a denominator that needs less noise; no more than that can be refuted."""
        if not level < self._level:
            return
        self._level = level
        if abs(a[0]) > 1e-6 * np.abs(a).max():
            monic = np.asarray(a / a[0], np.float64)
            if self._rows.stable:
                largest = float(np.abs(np.roots(monic)).max(initial=0.0))
                monic = monic * min(1.0, _INSIDE / max(largest, 1e-300)) ** np.arange(monic.size)
            self._best = [monic[1:], *self._best[:4]]

    def _noises(self, multiplier: Reals, vectors: Reals) -> Reals:
        """Noise that a multiplier lets through, (K,)."""
        shifted = self._shifted(multiplier)
        return np.asarray(np.abs(vectors @ shifted) @ self._rows.bound, np.float64)

    def _shifted(self, multiplier: Reals) -> Reals:
        n, length = self._rows.order, multiplier.size
        found = np.zeros((n + 1, length))
        for i in range(n + 1):
            found[i, : length - i] = multiplier[i:]
        return found

    def _moment(self, multiplier: Reals) -> Reals:
        y, length = self._rows.y, multiplier.size
        lags = range(self._rows.order + 1)
        return np.array([multiplier[i:] @ y[: length - i] for i in lags])

    def _bound(self, grown: _Grown) -> tuple[float, Reals]:
        """The factor that weighted multipliers refute in a cone, and their signed weights."""
        if not grown.used:
            return 0.0, np.zeros(0)
        values = np.vstack([grown.values, -grown.values]) / grown.sizes
        noises = np.vstack([grown.noises, grown.noises]) / grown.sizes
        best, shares, factor = 0.0, np.zeros(len(values)), self._target
        factor = factor if np.isfinite(factor) else 0.0
        for _ in range(6):  # W. Dinkelbach, 1967: the largest ratio
            weights, _ = _game(values - factor * noises)
            if weights is None:
                break
            low = float(np.min((weights @ values) / (weights @ noises)))
            if low > best:
                best, shares = low, weights
            if not low > factor * (1.0 + 1e-3):
                break
            factor = low
        if best < factor and best < self._target:
            best, shares = self._lower(values, noises, best, shares)
        half = len(grown.used)
        return best, shares[:half] - shares[half:]

    def _lower(
        self, values: Reals, noises: Reals, best: float, shares: Reals
    ) -> tuple[float, Reals]:
        """Go on from below where the target is out of reach."""
        factor = best
        for _ in range(4):
            weights, _ = _game(values - factor * noises)
            if weights is None:
                break
            low = float(np.min((weights @ values) / (weights @ noises)))
            if not low > best * (1.0 + 1e-3):
                break
            best, shares, factor = low, weights, low
        return best, shares

    def _worst(self, grown: _Grown, low: float) -> Reals:
        """The mixture of vectors (K,) at which multipliers say least."""
        values = np.vstack([grown.values, -grown.values]) / grown.sizes
        noises = np.vstack([grown.noises, grown.noises]) / grown.sizes
        target = self._target if np.isfinite(self._target) else low
        mixture = _game(values - max(low, target) * noises)[1]
        return np.full(len(grown.cone), 1.0 / len(grown.cone)) if mixture is None else mixture

    def _part(self, grown: _Grown, low: float) -> None:
        """Part a cone at the edge along which its multipliers change most."""
        cone = grown.cone.astype(np.float64)
        filtered = (cone / grown.sizes[:, None]) @ self._shifted(self._multipliers[grown.centre])
        lengths = np.array(
            [[np.abs(one - two) @ self._rows.bound for two in filtered] for one in filtered]
        )
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(lengths)), lengths.shape))
        uneven = int(np.clip(np.round(np.log2(grown.sizes[j] / grown.sizes[i])), -_UNEVEN, _UNEVEN))
        weights = 2 ** max(uneven, 0), 2 ** max(-uneven, 0)
        parts = parted_cone(grown.cone, (i, j), weights) if i != j else None
        if parts is None:  # too thin: it stays a leaf
            self._cap = min(self._cap, low)
            return
        first = len(self._cells)
        children = first, first + 1
        new = parts[0][i].astype(np.float64)
        values = np.array([new @ self._moments[m] for m in grown.used])
        noises = np.array([self._noises(self._multipliers[m], new[None])[0] for m in grown.used])
        size = float(self._noises(self._multipliers[grown.centre], new[None])[0])
        whole, self._cells[grown.number] = (
            self._cells[grown.number],
            Cell(children, (i, j), weights),
        )
        for place, part in zip((i, j), parts, strict=True):
            own, more, sizes = grown.values.copy(), grown.noises.copy(), grown.sizes.copy()
            own[:, place], more[:, place], sizes[place] = values, noises, max(size, 1e-300)
            child = grown._replace(number=-1, cone=part, values=own, noises=more, sizes=sizes)
            self._add(child, low, whole)

    def _found(self) -> FoundDenominators:
        leaves = [number for number, cell in enumerate(self._cells) if not cell.children]
        factor = min(self._proved[number] for number in leaves)
        if not factor > 0.0:
            return FoundDenominators(0.0, None, tuple(self._best))
        numbers = sorted({m for number in leaves for m in self._cells[number].used})
        place = {m: i for i, m in enumerate(numbers)}
        cells = tuple(
            cell._replace(used=tuple(place[m] for m in cell.used)) if not cell.children else cell
            for cell in self._cells
        )
        assert self._programs.free is not None
        table = np.array([self._multipliers[m] for m in numbers])
        proof = DenominatorCells(self._output, self._programs.free, table, cells)
        for loss in _LOSSES:
            least = factor * (1.0 - loss)
            if proof.follows(self._rows._replace(bound=self._rows.bound * (least * _OVER))):
                return FoundDenominators(least, proof, tuple(self._best))
        return FoundDenominators(0.0, None, tuple(self._best))


def _game(table: Reals) -> tuple[Reals | None, Reals | None]:
    """Solve a matrix game: weights of rows (M,) for the most, of columns (K,) for the least."""
    rows, columns = table.shape
    size = float(np.abs(table).max(initial=0.0))
    if not (np.isfinite(size) and size > 0.0):
        return None, None
    pivots = np.zeros((rows + 1, columns + rows + 1))
    pivots[:rows, :columns] = table - float(table.min()) + size
    pivots[:rows, columns:-1], pivots[:rows, -1] = np.eye(rows), 1.0
    pivots[rows, :columns] = -1.0
    basic = np.arange(columns, columns + rows)
    for _ in range(200):
        column = int(np.argmin(pivots[rows, :-1]))
        entries = pivots[:rows, column]
        usable = entries > 1e-12 * size
        if pivots[rows, column] >= -1e-12 or not np.any(usable):
            break
        ratios = np.where(usable, pivots[:rows, -1] / np.where(usable, entries, 1.0), np.inf)
        row = int(np.argmin(ratios))
        pivots[row] /= pivots[row, column]
        others = pivots[:, column].copy()
        others[row] = 0.0
        pivots -= np.outer(others, pivots[row])
        basic[row] = column
    weights = np.maximum(pivots[rows, columns:-1], 0.0)
    mixture = np.zeros(columns + rows)
    mixture[basic] = pivots[:rows, -1]
    mixture = np.maximum(mixture[:columns], 0.0)
    if not (weights.sum() > 0.0 and mixture.sum() > 0.0):
        return None, None
    return weights / weights.sum(), mixture / mixture.sum()
