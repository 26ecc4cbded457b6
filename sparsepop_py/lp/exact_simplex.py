"""The simplex method in integers, for polyhedra with few unknowns and many rows.

A basis is a set of n rows with an integer inverse: A_B^-1 = adjugate / determinant, both
integer because every row of doubles is an integer row times a power of two. A pivot
exchanges one row and divides without remainder (Edmonds 1967; Bareiss 1968). HiGHS proposes
the rows that are active at the optimum; where its proposal is not optimal (tolerances,
degeneracy), or there is no optimum, exact pivots go on from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.budget import check, spend
from sparsepop_py.lp.highs import LinearModel
from sparsepop_py.verified.certificate.polyhedron import Polyhedron, doubles, integers

__all__ = ["Outcome", "Simplex"]

_UNIT = 2.0**-53  # relative rounding error of doubles (IEEE 754)
_ENTRY_WORK = 2e-6  # of an integer that a pivot divides: they have some hundred digits
_GREEDY = 60  # pivots by largest violation before Bland's rule, which cannot cycle


@dataclass(frozen=True, eq=False)
class Outcome:
    """Exact result for one linear objective.

    Parameters
    ----------
    status : {"optimal", "empty", "unbounded"}
    rows : tuple of int
    multipliers : tuple of Fraction
        Of these rows; they sum to the objective, or to a negative constant where empty.
    vertex : tuple of Fraction or None
        A feasible point, optimal where there is an optimum.
    ray : tuple of Fraction or None
        A feasible direction along which the objective falls.
    """

    status: str
    rows: tuple[int, ...] = ()
    multipliers: tuple[Fraction, ...] = ()
    vertex: tuple[Fraction, ...] | None = None
    ray: tuple[Fraction, ...] | None = None


class Simplex:
    """An exact basis of a polyhedron that moves from objective to objective.

    Parameters
    ----------
    polyhedron : Polyhedron
    """

    def __init__(self, polyhedron: Polyhedron) -> None:
        n = polyhedron.dimension
        self._set = polyhedron
        self._rows = [-1 - i for i in range(n)]  # -1 - i stands for the row x_i == 0
        self._adjugate = [[int(i == j) for j in range(n)] for i in range(n)]
        self._determinant = 1
        self._completed = False
        self._model: LinearModel | None = None

    def minimise(self, cost: list[Fraction]) -> Outcome:
        """Settle one objective.

        Parameters
        ----------
        cost : list of Fraction, length n
        """
        whole = integers(cost)
        scale = next((w / c for w, c in zip(whole, cost, strict=True) if c), 1)
        self._propose(np.array(cost, float))
        empty = self._reach_feasibility(whole)
        if empty is not None:
            return empty
        return self._descend(whole, Fraction(scale))

    # ---- the starting basis -----------------------------------------------------------------

    def _propose(self, cost: NDArray[np.float64]) -> None:
        """Start from the basis that HiGHS found in doubles."""
        if self._model is None:
            self._model = _model_of(self._set)
        model, n = self._model, self._set.dimension
        m = self._set.constant.size - 2 * n
        size = np.abs(cost).max(initial=0.0)
        found = model.solve(cost / size if size else cost)
        wanted: list[int] = []
        if found.status == "solved":
            rows, columns = model.active()
            wanted = [int(r) for r in rows]
            for j in columns.tolist():
                low, high = self._set.present[m + j], self._set.present[m + n + j]
                near_low = abs(found.x[j] + self._set.constant[m + j]) if low else np.inf
                near_high = abs(found.x[j] - self._set.constant[m + n + j]) if high else np.inf
                if low or high:
                    wanted.append(m + j if near_low <= near_high else m + n + j)
        for number in wanted:
            self._bring_in(number, keep=set(wanted))
        if not self._completed:
            self._complete()

    def _bring_in(self, number: int, keep: set[int]) -> None:
        """Exchange one row for another outside ``keep``, where that leaves the basis regular."""
        if number in self._rows:
            return
        weights = self._weights(number)
        equal = self._set.equality
        open_ = [
            (row >= 0, -abs(weights[place]), place)
            for place, row in enumerate(self._rows)
            if weights[place] and row not in keep and not (row >= 0 and equal[row])
        ]
        if open_:
            self._pivot(min(open_)[2], number, weights)

    def _complete(self) -> None:
        """Replace artificial rows of the basis by rows, as far as the rank allows."""
        self._completed = True
        equal = np.flatnonzero(self._set.equality).tolist()
        for number in equal:
            self._bring_in(number, keep=set(equal))
        for place in range(len(self._rows)):
            if self._rows[place] >= 0:
                continue
            along = self._column(place)
            signs = self._set.signs(along, 0, abs(self._determinant))
            useful = np.flatnonzero((signs != 0) & self._set.present)
            if useful.size:
                number = int(useful[0])
                self._pivot(place, number, self._weights(number))

    # ---- integer linear algebra -------------------------------------------------------------

    def _weights(self, number: int) -> list[int]:
        """Express a row in the basis, times the determinant."""
        slope = self._set.row(number)[0]
        used = [(a, self._adjugate[i]) for i, a in enumerate(slope) if a]
        return [sum(a * row[j] for a, row in used) for j in range(len(slope))]

    def _pivot(self, place: int, number: int, weights: list[int]) -> None:
        """Exchange a row of the basis; integers divide without remainder (Bareiss)."""
        pivot, old = weights[place], self._determinant
        check()
        spend(_ENTRY_WORK * len(weights) ** 2)
        for row in self._adjugate:
            leaving = row[place]
            for j, weight in enumerate(weights):
                if j != place:
                    row[j] = (pivot * row[j] - weight * leaving) // old
        self._determinant = pivot
        self._rows[place] = number

    def _column(self, place: int) -> list[int]:
        """Direction that leaves one row of the basis upwards and stays on the others."""
        sign = 1 if self._determinant > 0 else -1
        return [sign * row[place] for row in self._adjugate]

    def _point(self) -> tuple[list[int], int]:
        """Compute the vertex of the basis: numerators and their positive denominator."""
        right = [-self._set.row(r)[1] if r >= 0 else 0 for r in self._rows]
        sign = 1 if self._determinant > 0 else -1
        point = [
            sign * sum(a * b for a, b in zip(row, right, strict=True)) for row in self._adjugate
        ]
        return point, abs(self._determinant)

    def _prices(self, cost: list[int]) -> list[int]:
        """Multipliers of the basis rows for a cost, times abs(determinant)."""
        sign = 1 if self._determinant > 0 else -1
        used = [(sign * c, self._adjugate[i]) for i, c in enumerate(cost) if c]
        return [sum(c * row[j] for c, row in used) for j in range(len(cost))]

    def _free(self, row: int) -> bool:
        """Check that a row's multiplier may have any sign."""
        return row < 0 or bool(self._set.equality[row])

    # ---- dual pivots: to a feasible vertex, or to a proof that there is none ----------------

    def _reach_feasibility(self, cost: list[int]) -> Outcome | None:
        """Dual simplex for a cost that makes the basis dual feasible."""
        prices = self._prices(cost)
        signs = [
            1 if p >= 0 or self._free(r) else -1 for p, r in zip(prices, self._rows, strict=True)
        ]
        shifted = list(cost)
        if min(signs) < 0:  # sum abs(price) row instead
            shifted = [0] * len(cost)
            for sign, price, row in zip(signs, prices, self._rows, strict=True):
                if row >= 0:
                    slope = self._set.row(row)[0]
                    weight = sign * price
                    shifted = [s + weight * a for s, a in zip(shifted, slope, strict=True)]
        step = 0
        while True:
            point, total = self._point()
            found = self._set.signs(point, total, total)
            wrong = np.flatnonzero((found < 0) | (self._set.equality & (found != 0)))
            if not wrong.size:
                return None
            number = int(wrong[0])
            if step < _GREEDY:
                number = self._worst(wrong, point, total)
            outcome = self._exchange(number, -1 if found[number] > 0 else 1, shifted)
            if outcome is not None:
                return outcome
            step += 1

    def _worst(self, wrong: NDArray[np.int64], point: list[int], total: int) -> int:
        """Find the row violated most for the size of its entries, in doubles."""
        x, _ = doubles(point, total)
        value = np.abs(self._set.matrix[wrong] @ x + self._set.constant[wrong])
        size = np.abs(self._set.matrix[wrong]).max(axis=1) + 1e-300
        return int(wrong[np.argmax(np.nan_to_num(value / size))])

    def _exchange(self, number: int, side: int, cost: list[int]) -> Outcome | None:
        """Pivot dually with a violated row, or complete Farkas multipliers."""
        sign = 1 if self._determinant > 0 else -1
        weights = self._weights(number)
        prices = self._prices(cost)
        best: tuple[Fraction, int, int] | None = None
        for place, row in enumerate(self._rows):
            weight = side * sign * weights[place]
            if row < 0 and weight:
                best = (Fraction(-1), row, place)  # artificial rows leave first
                break
            if weight <= 0 or self._free(row):
                continue
            candidate = (Fraction(prices[place], weight), row, place)
            best = candidate if best is None else min(best, candidate)
        if best is not None:
            self._pivot(best[2], number, weights)
            return None
        total = abs(self._determinant)
        rows, multipliers = [number], [Fraction(side * total)]
        for place, row in enumerate(self._rows):
            if weights[place]:
                rows.append(row)
                multipliers.append(Fraction(-side * sign * weights[place]))
        return Outcome("empty", tuple(rows), self._unscaled(rows, multipliers))

    # ---- primal pivots: to an optimal vertex, or to a falling ray ---------------------------

    def _descend(self, cost: list[int], scale: Fraction) -> Outcome:
        step = 0
        while True:
            prices, (point, total) = self._prices(cost), self._point()
            vertex = tuple(Fraction(x, total) for x in point)
            wrong = [
                (row, place)
                for place, row in enumerate(self._rows)
                if (prices[place] < 0 and not self._free(row)) or (row < 0 and prices[place])
            ]
            if not wrong:
                rows = [r for r, p in zip(self._rows, prices, strict=True) if p]
                values = [Fraction(p, total) / scale for p in prices if p]
                return Outcome("optimal", tuple(rows), self._unscaled(rows, values), vertex)
            row, place = min(wrong)  # artificial rows first, then the least number (Bland)
            if row >= 0 and step < _GREEDY:
                row, place = max(wrong, key=lambda pair: -prices[pair[1]])
            along = self._column(place)
            if row < 0 and prices[place] > 0:
                along = [-d for d in along]
            if not self._advance(place, along, point, total):
                ray = tuple(Fraction(d, total) for d in along)
                return Outcome("unbounded", vertex=vertex, ray=ray)
            step += 1

    def _advance(self, place: int, along: list[int], point: list[int], total: int) -> bool:
        """Pivot primally to the first row met in a direction; False for none."""
        falling = np.flatnonzero(self._set.signs(along, 0, total) < 0)
        falling = falling[self._set.present[falling]]
        if not falling.size:
            return False
        near = self._near(falling, along, point, total)
        best: tuple[Fraction, int] | None = None
        for number in near.tolist():
            slope = -self._set.value(number, along, 0)
            candidate = (Fraction(self._set.value(number, point, total), slope), number)
            best = candidate if best is None else min(best, candidate)
        assert best is not None
        self._pivot(place, best[1], self._weights(best[1]))
        return True

    def _near(
        self, falling: NDArray[np.int64], along: list[int], point: list[int], total: int
    ) -> NDArray[np.int64]:
        """Rows that may be met first, by intervals of the step in doubles."""
        x, first = doubles(point, total)
        d, second = doubles(along, total)
        if not (first and second):
            return falling
        matrix, constant = self._set.matrix[falling], self._set.constant[falling]
        gamma = (self._set.dimension + 6) * 1.01 * _UNIT
        with np.errstate(all="ignore"):
            value, slope = matrix @ x + constant, -(matrix @ d)
            value_error = gamma * (np.abs(matrix) @ np.abs(x) + np.abs(constant)) + 1e-300
            slope_error = gamma * (np.abs(matrix) @ np.abs(d)) + 1e-300
            low = np.maximum(value - value_error, 0.0) / (slope + slope_error) * (1 - 1e-15)
            high = (value + value_error) / np.maximum(slope - slope_error, 0.0) * (1 + 1e-15)
        high = np.where(np.isnan(high), np.inf, high)
        return falling[~(low > high.min())]

    def _unscaled(self, rows: list[int], values: list[Fraction]) -> tuple[Fraction, ...]:
        """Multipliers of the rows as given, from those of the integer rows."""
        return tuple(v * self._set.scale(r) for r, v in zip(rows, values, strict=True))


def _model_of(polyhedron: Polyhedron) -> LinearModel:
    """Build the linear program for HiGHS, rows scaled to a largest entry near 1."""
    n = polyhedron.dimension
    m = polyhedron.constant.size - 2 * n
    size = np.maximum(np.abs(polyhedron.matrix[:m]).max(axis=1, initial=0.0), 1e-300)
    scale = np.exp2(-np.round(np.log2(size)))
    with np.errstate(over="ignore"):  # an infinite number here leaves the row to the exact part
        low = -polyhedron.constant[:m] * scale
    high = np.where(polyhedron.equality[:m], low, np.inf)
    columns = (-polyhedron.constant[m : m + n], polyhedron.constant[m + n :])
    matrix = sps.csr_array(polyhedron.matrix[:m] * scale[:, None])
    return LinearModel(matrix, (low, high), columns)
