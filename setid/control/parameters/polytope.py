"""Proved ranges of many linear functions over a polytope, from bases that are kept."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import highspy
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from setid.control.engine import frozen

__all__ = ["Polytope"]

Reals = NDArray[np.float64]
_EPS = 2.0**-52
_LARGEST_CONDITION = 1e12  # of bases that are kept
_KEPT = 400  # bases


@dataclass(slots=True, eq=False)
class _Bases:
    """Optimal bases of linear programs over one polytope; nothing proved rests on them."""

    rows: list[NDArray[np.int64]] = field(default_factory=list)
    inverses: list[Reals] = field(default_factory=list)
    program: highspy.Highs | None = None
    contradictory: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """The points x with lower <= x <= upper and matrix x <= right.

    Parameters
    ----------
    lower, upper : (p,) float
        Finite.
    matrix, right : (m, p), (m,) float
        Exactly as they are: rounding belongs into ``right``.

    Examples
    --------
    >>> import numpy as np
    >>> from setid.control.parameters.polytope import Polytope
    >>> triangle = Polytope(np.zeros(2), np.ones(2), np.array([[1.0, 1.0]]), np.ones(1))
    >>> low, high = triangle.ranges(np.array([[1.0, 2.0]]))
    >>> float(round(low[0], 9) + 0.0), float(round(high[0], 9))
    (0.0, 2.0)
    """

    lower: Reals
    upper: Reals
    matrix: Reals
    right: Reals
    _bases: _Bases = field(default_factory=_Bases, repr=False)

    @property
    def magnitude(self) -> Reals:
        """Largest absolute value of each coordinate, (p,)."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    @property
    def centre(self) -> Reals:
        """Middle of the box, (p,)."""
        return np.asarray(self.lower / 2 + self.upper / 2, np.float64)

    def with_rows(self, matrix: Reals, right: Reals) -> Polytope:
        """The part of the polytope in which further rows hold."""
        rows = np.concatenate([self.matrix, matrix]), np.concatenate([self.right, right])
        return Polytope(self.lower, self.upper, *rows)

    def within(self, lower: Reals, upper: Reals) -> Polytope:
        """The part of the polytope in a box."""
        ends = np.maximum(self.lower, lower), np.minimum(self.upper, upper)
        return Polytope(*ends, self.matrix, self.right)

    def essential(self) -> Polytope:
        """The same box with the rows that were active at some optimum; it contains this one."""
        m = self.right.size
        used = [rows[rows < m] for rows in self._bases.rows]
        kept = np.unique(np.concatenate(used)) if used else np.zeros(0, np.int64)
        return Polytope(self.lower, self.upper, self.matrix[kept], self.right[kept])

    def ranges(self, directions: Reals) -> tuple[Reals, Reals]:
        """Proved least and largest values of linear functions.

        Parameters
        ----------
        directions : (K, p) float

        Returns
        -------
        lower, upper : (K,) float
            They cross where the polytope is proved empty.

        References
        ----------
        A. Neumaier, O. Shcherbina, "Safe bounds in linear and mixed-integer linear
        programming", Mathematical Programming 99 (2004) 283-296, section 2.
        """
        both = self.maxima(np.concatenate([directions, -directions]))
        return -both[len(directions) :], both[: len(directions)]

    def maxima(self, directions: Reals) -> Reals:
        """Proved upper bounds (K,) of directions (K, p) times x."""
        wanted = np.asarray(directions, float)
        found = self._safe(wanted, np.zeros((len(wanted), 0)), np.zeros(0, np.int64))
        if not self.right.size:
            return found
        open_ = np.any(wanted != 0.0, axis=1)
        for place in range(len(self._bases.rows)):
            self._apply(place, wanted, found, open_)
        while np.any(open_):
            k = int(np.flatnonzero(open_)[0])
            open_[k] = False
            basis = self._solve(wanted[k])
            if basis is not None:
                mine = open_.copy()
                mine[k] = True
                self._apply(basis, wanted, found, mine, sure=k)
                open_ &= mine
        return found

    def proved_empty(self) -> bool:
        """Whether weak duality proves that no point is in the polytope."""
        if np.any(self.lower > self.upper):
            return True
        if not self.right.size:
            return False
        self.maxima(np.eye(self.lower.size)[:1])
        if not self._bases.contradictory:
            return False
        weights = self._farkas()
        return weights is not None and bool(self._gap(weights) < 0.0)

    # ---- weak duality -------------------------------------------------------------------

    def _apply(
        self, place: int, wanted: Reals, found: Reals, open_: NDArray[np.bool_], sure: int = -1
    ) -> None:
        """Improve ``found`` where a basis is optimal; mark these directions as done."""
        todo = np.flatnonzero(open_)
        if not todo.size:
            return
        weights = wanted[todo] @ self._bases.inverses[place]
        size = np.abs(weights).max(axis=1, initial=0.0)
        fits = (weights.min(axis=1, initial=0.0) >= -1e-11 * size) | (todo == sure)
        todo, weights = todo[fits], np.maximum(weights[fits], 0.0)
        if todo.size:
            bound = self._safe(wanted[todo], weights, self._bases.rows[place])
            found[todo] = np.minimum(found[todo], bound)
            open_[todo] = False

    def _safe(self, wanted: Reals, weights: Reals, rows: NDArray[np.int64]) -> Reals:
        """Upper bounds from any multipliers >= 0 of rows and sides, rounding included.

        Rows m, ..., m + p - 1 are the upper sides, the p after them the lower ones.
        """
        m, p = self.right.size, self.lower.size
        inner = rows < m
        use, chosen = weights[:, inner], rows[inner]
        matrix, right, size = self.matrix[chosen], self.right[chosen], self.magnitude
        unit = 4 * (chosen.size + p + 8) * _EPS
        rest = wanted - use @ matrix
        over_box = np.maximum(rest * self.lower, rest * self.upper).sum(axis=1)
        reach = np.abs(wanted) + use @ np.abs(matrix) + np.abs(rest)
        return np.asarray(
            use @ right + over_box + unit * (use @ np.abs(right) + reach @ size) + 1e-300,
            np.float64,
        )

    def _gap(self, weights: Reals) -> float:
        """Upper bound of weights (right - matrix x) over the box; negative: empty."""
        p = self.lower.size
        bound = self._safe(np.zeros((1, p)), weights[None, :], np.arange(self.right.size))
        return float(bound[0])

    # ---- linear programs ----------------------------------------------------------------

    def _start(self) -> highspy.Highs:
        m, p = self.matrix.shape
        unit, middle = self._units()
        scaled = self.matrix * unit
        norm = np.maximum(np.abs(scaled).max(axis=1, initial=0.0), 1e-300)
        linear = highspy.HighsLp()
        linear.num_col_, linear.num_row_ = p, m
        linear.col_cost_ = np.zeros(p)
        linear.col_lower_, linear.col_upper_ = np.full(p, -1.0), np.full(p, 1.0)
        linear.row_lower_ = np.full(m, -np.inf)
        linear.row_upper_ = (self.right - self.matrix @ middle) / norm
        linear.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        linear.a_matrix_.start_ = np.arange(0, m * p + 1, p)
        linear.a_matrix_.index_ = np.tile(np.arange(p), m)
        linear.a_matrix_.value_ = (scaled / norm[:, None]).ravel()
        program = highspy.Highs()
        options: dict[str, Any] = {
            "output_flag": False,
            "threads": 1,
            "presolve": "off",
            "simplex_strategy": 4,
        }
        for name, value in options.items():
            program.setOptionValue(name, value)
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            program.setOptionValue(name, 1e-9)
        program.passModel(linear)
        self._bases.program = program
        return program

    def _units(self) -> tuple[Reals, Reals]:
        return np.maximum(self.upper / 2 - self.lower / 2, 1e-300), self.centre

    def _solve(self, direction: Reals) -> int | None:
        """Number of a basis that a solver calls optimal, None where it gives none."""
        if self._bases.contradictory:
            return None
        program = self._bases.program or self._start()
        unit, _ = self._units()
        goal = -direction * unit
        p = goal.size
        goal = goal / (float(np.abs(goal).max()) or 1.0)
        program.changeColsCost(p, np.arange(p, dtype=np.int32), goal)
        program.run()
        if program.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            self._bases.contradictory = (
                program.getModelStatus() == highspy.HighsModelStatus.kInfeasible
            )
            program.clearSolver()
            return None
        return self._kept(program.getBasis())

    def _kept(self, basis: highspy.HighsBasis) -> int | None:
        m, p = self.right.size, self.lower.size
        status = highspy.HighsBasisStatus
        basic, upper, lower = status.kBasic, status.kUpper, status.kLower
        rows = [i for i, x in enumerate(basis.row_status) if x is not basic and x != basic]
        columns = list(basis.col_status)
        rows += [m + j for j, x in enumerate(columns) if x == upper]
        rows += [m + p + j for j, x in enumerate(columns) if x == lower]
        if len(rows) != p:
            return None
        eye = np.eye(p)
        chosen = np.array(rows)
        block = np.concatenate([self.matrix, eye, -eye])[chosen]
        unit, _ = self._units()
        scaled = block * unit
        scaled = scaled / np.maximum(np.abs(scaled).max(axis=1), 1e-300)[:, None]
        if not np.linalg.cond(scaled) < _LARGEST_CONDITION:
            return None
        if len(self._bases.rows) >= _KEPT:
            del self._bases.rows[0], self._bases.inverses[0]
        self._bases.rows.append(chosen)
        self._bases.inverses.append(np.linalg.inv(block))
        return len(self._bases.rows) - 1

    def _farkas(self) -> Reals | None:
        """Multipliers (m,) >= 0 that a solver proposes as proof that there is no point.

        They are duals of: the least t with matrix x - t <= right, in units of the box.
        """
        unit, middle = self._units()
        scaled = self.matrix * unit
        norm = np.maximum(np.abs(scaled).max(axis=1, initial=0.0), 1e-300)
        table = np.column_stack([scaled / norm[:, None], -np.ones(norm.size)])
        room = (self.right - self.matrix @ middle) / norm
        bounds = [(-1.0, 1.0)] * unit.size + [(0.0, None)]
        cost = np.append(np.zeros(unit.size), 1.0)
        found = linprog(cost, A_ub=table, b_ub=room, bounds=bounds, method="highs")
        if found.status != 0:
            return None
        return np.maximum(-np.asarray(found.ineqlin.marginals, float), 0.0) / norm


def box_of(lower: Reals, upper: Reals) -> Polytope:
    """A box as a polytope without rows."""
    p = lower.size
    return Polytope(frozen(lower.copy()), frozen(upper.copy()), np.zeros((0, p)), np.zeros(0))
