"""Sequential linear programming: local minima of problems that are nearly linear.

Each step minimises the linearised objective plus a penalty on the linearised violations,

    f'd + nu sum s,   h + h'd = s+ - s-,   g + g'd >= -s,

within a trust region. Where the rows are so curved that little of the predicted reduction is
gained, a second step within the same region is linearised at its end; without it searches creep
along curved rows. In problems whose products are covered by few complicating variables only
these are held in the trust region: with them fixed everything is linear, so a second program
with these fixed restores the rows after each step, unless they are many. Minima of such problems
are mostly vertices, where the method converges quadratically; sparse programs of thousands of
rows cost milliseconds. The result is a candidate; nothing here is proved.

References
----------
R. Fletcher, E. Sainz de la Maza, Nonlinear programming and nonsmooth optimization by
successive linear programming, Math. Programming 43, 1989.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.lp.highs import LinearModel
from sparsepop_py.problem.problem import Problem

__all__ = ["conflict_prices", "row_prices", "sequential_search", "violated_rows"]

_MANY = 600  # rows beyond which they are not restored after each step
_DEVEX = {"simplex_dual_edge_weight_strategy": 1}  # exact weights of many rows take long
_VIOLATED = 1e-7  # in units of a row
_LEVEL = 1e-8  # of a row's largest coefficient: one that changes less at the start is level there
_FEASIBLE = 1e-7  # sum of violations in units of the rows: no larger penalty is needed
_STEPS = 150  # at most
_STEEPEST = 1e300  # slopes beyond this are taken for it, gradients over slopes no larger
_FLAT = 1e-6  # of the slope near a start: a slope less than that is no measure of the objective
_PENALTY = 1e2  # first weight of violations against the scaled objective
_MOST = 1e9  # largest such weight
_PROMISED = 1e-11  # of the value: a step that promises less is not taken
_LAST = 1e-9  # a step that promises less is the last one: what follows is rounding
_TRUST = 0.1  # trust region of prices, relative to the widths of bounds
_NEAR = 1e-2  # trust region, relative, within which the violation is to be reduced
_STUCK = 1e-6  # of the violation: less is no reduction
_WATCHED = 10  # steps over which the gain of a search is watched, where an end of creeping is asked


@dataclass(frozen=True, eq=False)
class _Place:
    """Iterate of a search: x, the scaled objective there, and the violation."""

    x: NDArray[np.float64]
    value: float
    off: float

    def merit(self, penalty: float) -> float:
        """Add penalised violations to the value; each step is to reduce the sum."""
        return self.value + penalty * self.off


@dataclass(eq=False)
class _Watch:
    """Watch on a search that creeps: that gains too little in ten steps. Mutable."""

    least: float
    seen: list[_Place] = field(default_factory=list)

    def creeps(self, here: _Place) -> bool:
        """Check for an iterate that is hardly better than the one ten steps before.

        One that is not feasible has to gain as much of its violation.
        """
        self.seen.append(here)
        if self.least == 0.0 or len(self.seen) <= _WATCHED:
            return False
        before = self.seen[-1 - _WATCHED]
        gained = before.merit(_PENALTY) - here.merit(_PENALTY)
        if here.off <= _FEASIBLE:
            return gained < self.least * (1.0 + abs(here.value))
        nearer = before.off - here.off >= self.least * here.off
        return not nearer and gained < self.least * (1.0 + abs(here.merit(_PENALTY)))


@dataclass(eq=False)
class _Search:
    """Problem in units of its variables, rows and objective, with a linear model. Mutable."""

    problem: Problem
    held: NDArray[np.int64]
    start: NDArray[np.float64]
    end: float = np.inf
    scale: float = 1.0

    @property
    def long(self) -> bool:
        """Check that rows are many, so that programs take long."""
        return self.problem.rows.size > _MANY

    @cached_property
    def width(self) -> NDArray[np.float64]:
        """Width of each variable's bounds, 1 + abs(start) where it has none."""
        width = self.problem.upper - self.problem.lower
        return np.where(np.isfinite(width), width, 1.0 + np.abs(self.start))

    @cached_property
    def unit(self) -> NDArray[np.float64]:
        """Unit of each variable in linear programs: the width of its bounds, at most 1.

        Tolerances of linear programs are absolute: 1e-9 is much of a noise bound of 1e-6.
        """
        return np.where(self.width > 0.0, np.minimum(self.width, 1.0), 1.0)

    @cached_property
    def size(self) -> NDArray[np.float64]:
        """Size of each row: its largest coefficient, or the largest change, if that is less.

        Changes are those of the linearised row at the start, over the width of one variable.
        """
        rows = self.problem.rows
        largest, change = np.full((2, rows.size), 1e-300)
        np.maximum.at(largest, rows.row, np.abs(rows.coefficients))
        row, column = rows.jacobian_places()
        with np.errstate(over="ignore", invalid="ignore"):
            np.maximum.at(change, row, np.abs(rows.slopes(self.start)) * self.width[column])
        return np.where(change > _LEVEL * largest, np.minimum(change, largest), largest)

    @cached_property
    def _program(self) -> tuple[sps.csr_array, NDArray[np.intp]]:
        """Rows [J | slacks] of the linearised problem, and positions of J's entries.

        The slacks: plus for each row, minus for each equality.
        """
        m, n = self.problem.rows.size, self.problem.dimension
        equal = np.flatnonzero(self.problem.equality)
        rows, columns = self.problem.rows.jacobian_places()
        row = np.concatenate([rows, np.arange(m), equal])
        column = np.concatenate([columns, n + np.arange(m + equal.size)])
        value = np.concatenate([np.zeros(rows.size), np.ones(m), -np.ones(equal.size)])
        order = np.argsort(row, kind="stable")
        first = np.searchsorted(row[order], np.arange(m + 1)).astype(np.int32)
        shape = (m, n + m + equal.size)
        matrix = sps.csr_array((value[order], column[order].astype(np.int32), first), shape=shape)
        return matrix, np.argsort(order)[: rows.size]

    _model: LinearModel | None = None
    prices: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))  # of the last program

    def violation(self, x: NDArray[np.float64]) -> float:
        """Sum the violations at x in units of the rows."""
        values = self.problem.rows.values(x) / self.size
        return float(
            np.where(self.problem.equality, np.abs(values), np.maximum(-values, 0.0)).sum()
        )

    def step(
        self,
        x: NDArray[np.float64],
        gradient: NDArray[np.float64],
        penalty: float,
        low: NDArray[np.float64],
        high: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], float] | None:
        """Solve the linearised problem for x + d within bounds; return it and its value."""
        rows, (matrix, places) = self.problem.rows, self._program
        row, column = rows.jacobian_places()
        matrix.data[places] = rows.slopes(x) / self.size[row] * self.unit[column]
        right = -rows.values(x) / self.size
        top = np.where(self.problem.equality, right, np.inf)
        slack = np.full(matrix.shape[1] - x.size, penalty)
        columns = (
            np.append((low - x) / self.unit, np.zeros(slack.size)),
            np.append((high - x) / self.unit, np.full(slack.size, np.inf)),
        )
        if self._model is None:
            options = _DEVEX if self.long else None
            self._model = LinearModel(matrix, (right, top), columns, options)
        else:
            self._model.load(matrix, (right, top), columns)
        left = self.end - time.monotonic()
        costs = np.append(gradient * self.unit, slack)
        found = self._model.solve(costs, left if np.isfinite(left) else None)
        if found.status != "solved":
            return None
        self.prices = np.abs(found.dual)
        return np.clip(x + self.unit * found.x[: x.size], low, high), found.value

    def place(self, x: NDArray[np.float64]) -> _Place:
        """Evaluate a vector; where some variables are held, choose the others anew.

        Not where rows are many: the program takes as long as a step, whose violation is of second
        order already.
        """
        x = _restored(self, x) if self.held.size and not self.long else x
        return _Place(x, self.problem.objective(x) / self.scale, self.violation(x))

    def within(
        self, x: NDArray[np.float64], reach: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bound the held variables, or all without any, to the trust region."""
        held = self.held if self.held.size else np.arange(x.size)
        low, high = self.problem.lower.copy(), self.problem.upper.copy()
        low[held] = np.maximum(low[held], x[held] - reach[held])
        high[held] = np.minimum(high[held], x[held] + reach[held])
        return low, high

    def stuck(self, at: _Place) -> bool:
        """Check that no direction reduces the violation, so that no larger penalty does."""
        bounds = self.within(at.x, _NEAR * self.width)
        found = self.step(at.x, np.zeros(at.x.size), 1.0, *bounds)
        return found is not None and found[1] >= (1.0 - _STUCK) * at.off

    def ahead(
        self, at: _Place, penalty: float, bounds: tuple[NDArray[Any], NDArray[Any]]
    ) -> tuple[float, _Place | None]:
        """Linearise at an iterate; return the predicted reduction and the next iterate."""
        gradient = self.problem.objective_row.gradient(at.x) / self.scale
        if not np.isfinite(gradient).all():
            return 0.0, None
        found = self.step(at.x, gradient, penalty, *bounds)
        if found is None:
            return 0.0, None
        return penalty * at.off - found[1], self.place(found[0])


def violated_rows(
    problem: Problem, x: NDArray[np.float64], held: NDArray[np.int64]
) -> NDArray[np.int64]:
    """List constraints that no choice of the variables not held satisfies together.

    Empty where the held variables are nearly those of a feasible point.
    """
    search = _Search(problem, held, x)
    values = problem.rows.values(_restored(search, x)) / search.size
    off = np.where(problem.equality, np.abs(values), np.maximum(-values, 0.0))
    return np.flatnonzero(off > _VIOLATED)


def row_prices(
    problem: Problem,
    x: NDArray[np.float64],
    held: NDArray[np.int64],
    end: float = np.inf,
) -> NDArray[np.float64]:
    """Compute prices of constraints in the linearised problem at a point.

    At a local minimiser the constraints with a price are those that make it one.

    Parameters
    ----------
    problem : Problem
    x : (n,) float
    held : (c,) int
        Complicating variables, as in :func:`sequential_search`.
    end : float
        End on the monotonic clock.

    Returns
    -------
    (m,) float
        Sizes, for rows as a search scales them; zeros where there is no solution.
    """
    search = _Search(problem, held, x, end)
    gradient = problem.objective_row.gradient(x) / _slope(problem, x, search.width, _TRUST)
    found = search.step(x, gradient, _PENALTY, *search.within(x, _TRUST * search.width))
    return np.zeros(problem.rows.size) if found is None else search.prices


def conflict_prices(
    problem: Problem, x: NDArray[np.float64], held: NDArray[np.int64], end: float = np.inf
) -> NDArray[np.float64]:
    """Compute prices of constraints in the linear program of least violation at a point.

    The held variables stay as they are. Constraints with a price contradict each other; which of
    them are violated may be a matter of choice.

    Parameters
    ----------
    problem : Problem
    x : (n,) float
    held : (c,) int
    end : float
        End on the monotonic clock.

    Returns
    -------
    (m,) float
        Sizes; zeros where the held variables are those of a feasible point, or time is over.
    """
    search = _Search(problem, held, x, end)
    feasible = search.violation(_restored(search, x)) <= _VIOLATED
    return search.prices if search.prices.size and not feasible else np.zeros(problem.rows.size)


def _slope(
    problem: Problem, x: NDArray[np.float64], width: NDArray[np.float64], trust: float
) -> float:
    """Measure how fast the objective changes at x; where it is flat there, near x."""
    near = np.clip(x + trust * width, problem.lower, problem.upper)
    places = x, near, np.clip(x - trust * width, problem.lower, problem.upper)
    with np.errstate(over="ignore", invalid="ignore"):
        gradients = [np.abs(problem.objective_row.gradient(at)) for at in places]
        steep = [float((gradient * width).max(initial=0.0)) for gradient in gradients]
    slope = max(steep[0], _FLAT * max(steep)) or 1.0
    least = max(float(gradient.max(initial=0.0)) for gradient in gradients) / _STEEPEST
    slope = max(slope, least)  # where units are subnormal
    return slope if np.isfinite(slope) else _STEEPEST  # beyond doubles: only the direction counts


def _restored(search: _Search, x: NDArray[Any]) -> NDArray[np.float64]:
    """Choose the variables that are not held for least violation."""
    problem = search.problem
    low, high = problem.lower.copy(), problem.upper.copy()
    low[search.held] = high[search.held] = x[search.held]
    found = search.step(x, np.zeros(x.size), 1.0, low, high)
    return x if found is None else found[0]


def sequential_search(
    problem: Problem,
    start: NDArray[np.float64],
    held: tuple[int, ...] = (),
    trust: float = 0.1,
    end: float = np.inf,
    creeping: float = 0.0,
) -> NDArray[np.float64]:
    """Search a local minimiser from ``start``, nearly feasible at best.

    Parameters
    ----------
    problem : Problem
    start : (n,) float
    held : tuple of int
        Complicating variables: with these fixed all constraints are linear. Empty where
        there are no such; then all variables stay within the trust region.
    trust : float
        First trust region, relative to the width of each variable's bounds.
    end : float
        End on the monotonic clock.
    creeping : float
        Relative to the value: a search that gained less in ten steps ends. Minima that are no
        vertices are approached slowly, and others than linear programs find their last digits.

    Returns
    -------
    (n,) float
    """
    x = np.clip(start, problem.lower, problem.upper)
    search = _Search(problem, np.array(held, np.int64), x, end)
    search.scale = _slope(problem, x, search.width, trust)
    here, penalty, small = search.place(x), _PENALTY, 0
    watch = _Watch(creeping)
    for _ in range(_STEPS):
        bounds = search.within(here.x, trust * search.width)
        promised, trial = search.ahead(here, penalty, bounds)
        if trial is None or time.monotonic() >= end or watch.creeps(here):
            break
        size = 1.0 + abs(here.value)
        if promised <= _PROMISED * size:
            if here.off <= _FEASIBLE or penalty >= _MOST or search.stuck(here):
                break
            penalty *= 10.0
            continue
        if promised <= _LAST * size and here.off <= _FEASIBLE:
            here = min(here, trial, key=lambda each: each.merit(penalty))
            break
        if here.merit(penalty) - trial.merit(penalty) <= 0.5 * promised:  # rows are curved there
            _, again = search.ahead(trial, penalty, bounds)
            trial = min(trial, again or trial, key=lambda each: each.merit(penalty))
        gained = here.merit(penalty) - trial.merit(penalty)
        if gained <= 0.05 * promised:
            trust *= 0.25
            if trust < 1e-10:
                break
            continue
        small = small + 1 if gained < _LAST * size else 0
        here = trial
        trust = min(1.0, 2.0 * trust) if gained > 0.5 * promised else trust
        if small > 1:
            break
    return here.x
