"""OBBT by linear programs: bounds of the branching variables below the cutoff.

On a box propagated with f(x) <= cutoff, the least and the largest value of a variable over the
linear relaxation bound it for every point below the cutoff. A smaller box makes the next
relaxation tighter: products are enveloped on smaller intervals.

References
----------
A. M. Gleixner, T. Berthold, B. Mueller, S. Weltge, Three enhancements for
optimization-based bound tightening, J. Global Optim. 67, 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.tightening.mccormick import LinearRelaxation
from sparsepop_py.tightening.settings import OBBT
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Replay,
    Step,
    Tightening,
    coordinates,
    tighten,
)

__all__ = ["TightenedModel", "apply_steps", "tighten_bounds", "tighten_by_lp"]


@dataclass(frozen=True, eq=False)
class TightenedModel:
    """Result of one round of OBBT by linear programs.

    Parameters
    ----------
    model : Model
        With the tightened box, which may be empty.
    gains : bool
        Whether another round may gain.
    empty : bool
        Whether a linear program was infeasible: the box holds no point below the cutoff.
    """

    model: Model
    gains: bool = False
    empty: bool = False


def tighten_by_lp(
    context: SolveContext, model: Model, mccormick: LinearRelaxation, variables: Sequence[int]
) -> TightenedModel:
    """Run one round of OBBT by linear programs, then propagate.

    Parameters
    ----------
    context : SolveContext
        Its attained value is the cutoff.
    model : Model
        The box and its proof.
    mccormick : LinearRelaxation
        The linear relaxation on that box.
    variables : sequence of int

    Returns
    -------
    TightenedModel
    """
    box = model.box
    open_ = [v for v in variables if box.hi[v] > box.lo[v]]
    replay = context.at_cutoff()
    smaller, step, empty = tighten_bounds(replay, mccormick, box, open_, context.deadline.left)
    if step is None:
        return TightenedModel(model, empty=empty)
    steps: list[Step] = [*model.proof.steps, step]
    if not is_empty(smaller):
        again, more = tighten(replay, smaller, OBBT.lp_sweeps)
        if shrinks(smaller, again):
            smaller = again
            steps.append(more)
    made = replace(model, proof=BoxProof(tuple(steps)), box=smaller)
    old, new = box.width()[open_], smaller.width()[open_]
    return TightenedModel(made, not is_empty(smaller) and bool(np.any(new < OBBT.lp_gained * old)))


def tighten_bounds(
    replay: Replay,
    mccormick: LinearRelaxation,
    box: Interval,
    variables: Sequence[int],
    time_limit: float | None = None,
    seen: list[NDArray[Any]] | None = None,
) -> tuple[Interval, Tightening | None, bool]:
    """Tighten the bounds of variables on a box by two linear programs each (OBBT).

    A side that a solution of this round touches is left out.

    Parameters
    ----------
    replay : Replay
        The problem, with the cutoff.
    mccormick : LinearRelaxation
        The linear relaxation on the box.
    box : Interval
    variables : sequence of int
    time_limit : float, optional
        Seconds after which the remaining sides are left out.
    seen : list of (n,) float, optional
        The solutions' points are appended to it.

    Returns
    -------
    box : Interval
        The tightened box.
    step : Tightening or None
        The step that proves it; None if nothing was gained.
    empty : bool
        Whether a program was infeasible.
    """
    n = box.lo.size
    prices: list[NDArray[Any]] = []
    chosen: list[tuple[int, int]] = []
    points: list[NDArray[Any]] = []
    width = box.width()
    deadline = Deadline(time_limit)
    sides = [
        (v, side) for v in variables for side in (1, -1) if mccormick.holds(v) and width[v] > 0
    ]
    for v, side in sides:
        edge = box.lo[v] if side > 0 else box.hi[v]
        if deadline.over or any(abs(x[v] - edge) <= OBBT.touched * width[v] for x in points):
            continue
        found = mccormick.reach(v, side, deadline.left)
        if found.status == "infeasible":
            return box, None, True
        if found.status != "solved":
            continue
        points.append(mccormick.point(found))
        if seen is not None:
            seen.append(points[-1])
        if abs(points[-1][v] - edge) > OBBT.lp_worth * width[v]:
            prices.append(found.dual)
            chosen.append((v, side))
    if not chosen:
        return box, None, False
    variable, side = np.array(chosen, np.int64).T
    dual = mccormick.dual(prices, mccormick.scaled.scaling.scale[variable].tolist(), short=True)
    system, equality = replay.system(False)
    value = dual.evaluate(system, equality, coordinates(variable, side, n))
    value = np.where(np.isfinite(value), value - 1e-14 * np.abs(value), -np.inf)
    step = Tightening(variable, side, value, dual, False)
    smaller = replay.step(step, box)
    return smaller, step, is_empty(smaller)


def apply_steps(replay: Replay, steps: Sequence[Step], box: Interval) -> Interval:
    """Apply bound-tightening steps derived on one box to another.

    Steps verify themselves, so the result holds although they may have become weaker.

    Parameters
    ----------
    replay : Replay
        The problem, with the cutoff.
    steps : sequence of Step
    box : Interval
    """
    for step in steps:
        if is_empty(box):
            break
        box = replay.step(step, box)
    return box
