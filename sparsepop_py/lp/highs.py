"""Linear programs, solved by HiGHS. What they return guides; nothing proved rests on it.

A :class:`LinearModel` keeps one program and its simplex basis while objectives, bounds
and numbers are swapped, so that the next program of a series starts where the last ended.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import highspy
import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.budget import before_check, check, iterations_left, spend

__all__ = ["LinearModel", "LinearSolution", "QuietHighs", "SparseRows", "solve_lp"]

_PROGRAM_WORK, _PIVOT_WORK = 2e-4, 2e-8  # a program, and a pivot for each row and column
_PIVOTS = "simplex_iteration_limit"
_LEAST_PIVOTS = 20  # of a program, however little work is left
_OPTIONS: dict[str, bool | int | float | str] = {
    "output_flag": False,
    "threads": 1,
    "presolve": "off",  # it writes beyond its memory where it eliminates long recursions
    "solver": "simplex",
    "primal_feasibility_tolerance": 1e-9,
    "dual_feasibility_tolerance": 1e-9,
}
_PRIMAL: dict[str, int | float] = {
    "simplex_strategy": 4,
    "primal_simplex_bound_perturbation_multiplier": 0.0,  # it cannot cycle for ever:
    _PIVOTS: 20_000,
}
_AGAIN: dict[str, int | float] = {"dual_simplex_cost_perturbation_multiplier": 0.0}
_STATUS = {
    highspy.HighsModelStatus.kOptimal: "solved",
    highspy.HighsModelStatus.kInfeasible: "infeasible",
    highspy.HighsModelStatus.kUnbounded: "unbounded",
    highspy.HighsModelStatus.kTimeLimit: "stopped",
}


class QuietHighs(highspy.Highs):
    """Solver that prints nothing from its construction on.

    The constructor enables callbacks, at which HiGHS 1.16 prints its name and licence unless
    output is off by then.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def enableCallbacks(self) -> Any:  # the name that the constructor calls
        """Turn output off, then enable callbacks."""
        self.setOptionValue("output_flag", False)
        return super().enableCallbacks()  # type: ignore[no-untyped-call]


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Output of HiGHS for a linear program.

    Parameters
    ----------
    status : {"solved", "infeasible", "unbounded", "stopped", "failed"}
        "stopped" by the limit on time or work.
    x : (n,) float
        Zeros unless solved.
    dual : (m,) float
        Row prices: cost - A' dual are the reduced costs. A ray where infeasible. Where stopped, the
        prices reached by then.
    value : float
    """

    status: str
    x: NDArray[np.float64]
    dual: NDArray[np.float64]
    value: float


class SparseRows(NamedTuple):
    """Parts of a matrix in rows, made faster than an array of SciPy.

    Parameters
    ----------
    data : (T,) float
    indices, indptr : int32
        Column of each nonzero, and where each row begins.
    shape : (int, int)
    """

    data: NDArray[np.float64]
    indices: NDArray[np.int32]
    indptr: NDArray[np.int32]
    shape: tuple[int, int]


class LinearModel:
    """min cost'x subject to row_lower <= A x <= row_upper, lower <= x <= upper.

    Parameters
    ----------
    matrix : csr or SparseRows (m, n)
    rows : (row_lower, row_upper), each (m,)
    columns : (lower, upper), each (n,)
    options : mapping of str to value, optional
        Options of HiGHS in place of the usual ones.
    """

    def __init__(
        self,
        matrix: sps.csr_array | SparseRows,
        rows: tuple[NDArray[Any], NDArray[Any]],
        columns: tuple[NDArray[Any], NDArray[Any]],
        options: Mapping[str, bool | int | float | str] | None = None,
    ) -> None:
        self._highs = QuietHighs()
        for name, value in {**_OPTIONS, **(options or {})}.items():
            self._highs.setOptionValue(name, value)
        self._usual = {name: self._highs.getOptionValue(name)[1] for name in (*_PRIMAL, *_AGAIN)}
        self._shape: tuple[int, int] | None = None
        self._basis: Any = None
        self._feasible = False
        self.load(matrix, rows, columns)

    def load(
        self,
        matrix: sps.csr_array | SparseRows,
        rows: tuple[NDArray[Any], NDArray[Any]],
        columns: tuple[NDArray[Any], NDArray[Any]],
    ) -> None:
        """Load another program; the basis is kept where the shape is the same."""
        m, n = matrix.shape
        program = highspy.HighsLp()
        program.num_row_, program.num_col_ = m, n
        program.col_cost_ = np.zeros(n)
        program.col_lower_, program.col_upper_ = columns
        program.row_lower_, program.row_upper_ = rows
        program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        program.a_matrix_.start_ = matrix.indptr
        program.a_matrix_.index_ = matrix.indices
        program.a_matrix_.value_ = matrix.data
        self._highs.passModel(program)
        if self._basis is not None and self._shape == (m, n):
            self._highs.setBasis(self._basis)
        self._shape = (m, n)
        self._feasible = False

    def add(self, table: NDArray[np.float64], upper: NDArray[np.float64]) -> None:
        """Add dense rows table x <= upper behind the others.

        They are basic, so that the next solve begins where the last one ended.

        Parameters
        ----------
        table : (k, n) float
        upper : (k,) float
        """
        assert self._shape is not None
        rows, (m, n) = _rows_of(table), self._shape
        below = np.full(upper.size, -np.inf)
        parts = rows.indptr[:-1], rows.indices, rows.data
        self._highs.addRows(upper.size, below, upper, rows.data.size, *parts)
        self._shape, self._feasible = (m + upper.size, n), False

    def bound(self, columns: NDArray[Any], lower: NDArray[Any], upper: NDArray[Any]) -> None:
        """Set other bounds for some columns."""
        self._feasible = False
        self._highs.changeColsBounds(columns.size, columns.astype(np.int32), lower, upper)

    def solve(self, cost: NDArray[np.float64], time_limit: float | None = None) -> LinearSolution:
        """Minimise another cost (n,), starting from the last basis.

        Where nothing but the cost has changed that basis is feasible, and the primal simplex
        method is faster; otherwise the dual one, whose rays are clean. That one gives up where
        the costs that it perturbs lead to large prices; then it starts again without perturbing.
        Where no time is left at all, :func:`~sparsepop_py.budget.check` ends it. A limit on work
        that is kept limits the pivots.
        """
        ways: list[dict[str, int | float]] = [_PRIMAL] if self._feasible else []
        begin, found = time.monotonic(), None
        for options in [*ways, {}, _AGAIN]:
            spent = time.monotonic() - begin
            left = None if time_limit is None else time_limit - spent
            for name, value in options.items():
                self._highs.setOptionValue(name, value)
            try:
                found = self._solve(cost, left)
            finally:
                for name in options:
                    self._highs.setOptionValue(name, self._usual[name])
            if found.status != "failed":
                break
        assert found is not None
        return found

    def _solve(self, cost: NDArray[np.float64], time_limit: float | None) -> LinearSolution:
        assert self._shape is not None
        m, n = self._shape
        highs = self._highs
        highs.changeColsCost(n, np.arange(n, dtype=np.int32), np.asarray(cost, float))
        left = min(np.inf if time_limit is None else time_limit, before_check())
        highs.setOptionValue("time_limit", highs.getRunTime() + max(left, 1e-3))
        cut = self._run(m + n)
        info = highs.getInfo()
        pivots = max(0, info.simplex_iteration_count)
        spend(_PROGRAM_WORK + (1 + pivots) * _PIVOT_WORK * (m + n))
        reached = highs.getModelStatus()
        status = _STATUS.get(reached, "failed")
        if cut and reached == highspy.HighsModelStatus.kIterationLimit:
            status = "stopped"
        self._feasible = status == "solved"
        if status == "stopped":
            check()
        if status == "solved":
            found = highs.getSolution()
            self._basis = highs.getBasis()
            value = info.objective_function_value
            return LinearSolution(
                status, np.array(found.col_value), np.array(found.row_dual), value
            )
        dual = np.zeros(m)
        if status == "infeasible":
            answer: Any = highs.getDualRay()  # type: ignore[attr-defined]
            dual = np.array(answer[2]) if answer[1] else dual
        elif status == "stopped":
            prices = np.array(highs.getSolution().row_dual)
            dual = prices if prices.shape == (m,) and np.all(np.isfinite(prices)) else dual
        self._basis = None
        return LinearSolution(
            status, np.zeros(n), dual, np.inf if status == "infeasible" else np.nan
        )

    def _run(self, size: int) -> bool:
        """Run the solver; return whether work allows fewer pivots than are usual."""
        usual = int(self._highs.getOptionValue(_PIVOTS)[1])
        most = iterations_left(_PIVOT_WORK * size, _LEAST_PIVOTS)
        if most >= usual:
            self._highs.run()
            return False
        self._highs.setOptionValue(_PIVOTS, int(most))
        try:
            self._highs.run()
        finally:
            self._highs.setOptionValue(_PIVOTS, usual)
        return True

    def active(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """List rows and columns on which the last basis rests: those not basic.

        Returns
        -------
        rows, columns : int arrays
            Together n where the basis is regular; empty where the solver kept none.
        """
        basis, basic = self._highs.getBasis(), highspy.HighsBasisStatus.kBasic
        rows = [i for i, status in enumerate(basis.row_status) if status != basic]
        columns = [j for j, status in enumerate(basis.col_status) if status != basic]
        return np.array(rows, np.int64), np.array(columns, np.int64)


def solve_lp(
    cost: NDArray[np.float64],
    margins: tuple[sps.csr_array | NDArray[Any], NDArray[np.float64], NDArray[np.float64]],
    equalities: tuple[sps.csr_array | NDArray[Any], NDArray[np.float64]],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64] | None:
    """Minimise cost'(d, t) for G d - w t >= -g, H d = r.

    Parameters
    ----------
    cost : (n + 1,) float
    margins : (G, w, g)
        Rows that ask for a margin t, weighted by w.
    equalities : (H, r)
        G and H are both sparse or both dense.
    bounds : (lower, upper), each (n + 1,)

    Returns
    -------
    (n + 1,) float or None
        The solution, None if there is none.
    """
    matrix, weight, value = margins
    equal, right = equalities
    if isinstance(matrix, np.ndarray):
        table = np.zeros((weight.size + right.size, matrix.shape[1] + 1))
        table[: weight.size, :-1], table[: weight.size, -1] = matrix, -weight
        table[weight.size :, :-1] = equal
        stacked = _rows_of(table)
    else:
        stacked = sps.csr_array(
            sps.vstack(
                [
                    sps.hstack([matrix, sps.csr_array(-weight[:, None])]),
                    sps.hstack([equal, sps.csr_array((right.size, 1))]),
                ]
            )
        )
    rows = np.append(-value, right), np.append(np.full(weight.size, np.inf), right)
    found = LinearModel(stacked, rows, bounds).solve(cost)
    return found.x if found.status == "solved" else None


def _rows_of(table: NDArray[np.float64]) -> SparseRows:
    """Take the nonzeros of a dense matrix."""
    row, column = np.nonzero(table)
    first = np.searchsorted(row, np.arange(table.shape[0] + 1)).astype(np.int32)
    shape = (table.shape[0], table.shape[1])
    return SparseRows(table[row, column], column.astype(np.int32), first, shape)
