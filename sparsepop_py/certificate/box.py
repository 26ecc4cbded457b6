"""Proof of a box: which steps shrank the problem's bounds, replayed from the exact data.

Each step names its argument and its scope. Steps that use the cut-off f(x) <= value at
a proved point hold for that objective only; an empty box after them is no proof of
infeasibility.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import monomials
from ..presolve.propagation import Rows, is_empty, propagate, sweep
from ..problem import Problem
from ..rounding import Interval, up
from ..system import PolynomialSystem
from .identity import Identity

__all__ = [
    "BoxProof",
    "Propagation",
    "Sublevel",
    "box_rows",
    "sublevel_box",
    "tighten",
    "with_cutoff",
]


@dataclass(frozen=True)
class Propagation:
    """``sweeps`` passes of interval propagation, with the cut-off row or without it."""

    sweeps: int
    cutoff: bool


@dataclass(frozen=True, eq=False)
class Sublevel:
    """|t_v| <= (K - 1)^(1 / 2d) on the set where f <= value, from a sum-of-squares identity.

    The identity proves 0 >= -K + sum_b (b(t))^2 on that set, the sum running over the
    monomials of the moment blocks, among them t_v^d.
    """

    identity: Identity


@dataclass(frozen=True)
class BoxProof:
    """The steps that lead from the bounds of a problem to a box."""

    steps: tuple[Propagation | Sublevel, ...] = ()

    @property
    def uses_cutoff(self) -> bool:
        """Whether the box holds for one objective only."""
        return any(isinstance(s, Sublevel) or s.cutoff for s in self.steps)

    def replay(self, problem: Problem, cutoff: float | None) -> Interval:
        """Recompute the box; lo > hi somewhere proves that it holds no feasible point."""
        box = Interval(problem.lower, problem.upper)
        for step in self.steps:
            if isinstance(step, Sublevel):
                box = sublevel_box(problem, cutoff, step, box)
            else:
                rows = box_rows(problem, cutoff if step.cutoff else None)
                for _ in range(step.sweeps):
                    box = sweep(rows, box)
                    if is_empty(box):
                        return box
        return box


def tighten(problem: Problem, box: Interval, cutoff: float | None) -> tuple[Interval, Propagation]:
    """Propagate to a fixed point; the box and the step that proves it."""
    tighter, sweeps = propagate(box_rows(problem, cutoff), box)
    return tighter, Propagation(sweeps, cutoff is not None)


def box_rows(problem: Problem, cutoff: float | None) -> Rows:
    """The rows that propagation uses: constraints, and with a cut-off f <= value and squares.

    From f = constant + sum w r^2 follows |r| <= sqrt((value - constant) / w).
    """
    high = [np.where(problem.equality, 0.0, np.inf)]
    low = [np.zeros(len(problem.constraints))]
    polynomials = [c.polynomial for c in problem.constraints]
    if cutoff is not None:
        polynomials.append(problem.objective)
        low.append(np.array([-np.inf]))
        high.append(np.array([cutoff]))
        constant = problem.squares_constant
        if constant is not None:
            room = max(0.0, float(np.nextafter(cutoff - constant, np.inf)))
            weights = np.array([w for w, _ in problem.squares if w > 0])
            radius = up(np.sqrt(up(room / weights)))
            polynomials += [r for w, r in problem.squares if w > 0]
            low.append(-radius)
            high.append(radius)
    system = PolynomialSystem.stack(polynomials, problem.dimension)
    return Rows(system, Interval(np.concatenate(low), np.concatenate(high)))


def with_cutoff(problem: Problem, cutoff: float) -> tuple[PolynomialSystem, NDArray[np.bool_]]:
    """Constraints and the row value - f >= 0 behind them, without rounding, and which are equal."""
    rows, objective = problem.rows, problem.objective_row
    width = max(rows.words.shape[1], objective.words.shape[1])
    words = np.concatenate(
        [
            monomials.widen(rows.words, width),
            monomials.widen(objective.words, width),
            np.zeros((1, width), np.int32),
        ]
    )
    values = np.concatenate([rows.coefficients, -objective.coefficients, [cutoff]])
    index = np.concatenate([rows.row, np.full(objective.row.size + 1, rows.size)])
    system = PolynomialSystem(words, values, index, rows.size + 1, problem.dimension)
    return system, np.append(problem.equality, False)


def sublevel_box(problem: Problem, cutoff: float | None, step: Sublevel, box: Interval) -> Interval:
    """Intersect a box with what a sublevel identity proves."""
    scaling = step.identity.scaling
    if cutoff is None or not scaling.contains(box):
        return box
    system, equality = with_cutoff(problem, cutoff)
    nothing = PolynomialSystem.stack([problem.objective * 0.0], problem.dimension)
    proved = step.identity.evaluate(system, equality, nothing)
    if not proved.floor > 0 or not np.isfinite(proved.bound):
        return box
    size = Interval.point(-proved.bound) / Interval.point(proved.floor)
    power = np.zeros(problem.dimension + 1, np.int64)
    one = 0.0
    for group in step.identity.multipliers:
        if group.floor > 0 and not group.free:
            words = group.basis[group.generator == 0].reshape(-1, group.basis.shape[2])
            one = max(one, float(not words.any(axis=1).all()))
            row, variable, exponent = monomials.runs(words)
            pure = np.bincount(row, minlength=words.shape[0]) == 1
            keep = pure[row]
            np.maximum.at(power, variable[keep], exponent[keep])
    power = power[:-1]
    room = max(0.0, float((size - Interval.point(one)).hi))
    radius = np.where(power > 0, _root_above(room, 2 * np.maximum(power, 1)), np.inf)
    reach = Interval.point(scaling.scale) * Interval.point(np.where(power > 0, radius, 0.0))
    centre = Interval.point(scaling.centre)
    low, high = (centre - reach).lo, (centre + reach).hi
    return Interval(
        np.where(power > 0, np.maximum(box.lo, low), box.lo),
        np.where(power > 0, np.minimum(box.hi, high), box.hi),
    )


def _root_above(value: float, power: NDArray) -> NDArray[np.float64]:
    """Upper bounds of value^(1/power), checked by multiplication."""
    root = value ** (1.0 / power) * (1.0 + 1e-12)
    holds = Interval.point(root).power(power).lo >= value
    return np.where(holds, root, max(1.0, value))
