"""OBBT by a semidefinite relaxation: bounds of the branching variables below the cutoff.

As :mod:`~sparsepop_py.tightening.obbt_lp` does with linear programs: the least and the largest
value of a variable over a relaxation of the box bound it for every point below the cutoff,
since the box holds the cutoff where the objective is a variable. Where few variables complicate
a problem, its star relaxation often leaves a tenth of each width where linear programs leave
most, and the next relaxation is tighter on the smaller box. One round takes two solves a
variable at most, each on the box that the ones before it left, and none for a side that the
points of this round nearly touch. Variables with the largest product violations come first.
The error of a bound falls about as their widths do, so the round ends where these are small
enough.

References
----------
A. M. Gleixner, T. Berthold, B. Mueller, S. Weltge, Three enhancements for
optimization-based bound tightening, J. Global Optim. 67, 2017.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.relaxation_bound import (
    BoxBound,
    bound_box,
    shorten_if_enough,
    solvers_for,
)
from sparsepop_py.context import SolveContext
from sparsepop_py.executors.dispatch import workers_of
from sparsepop_py.executors.within_limits import run_on
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.hierarchy import Families, RelaxationSpec
from sparsepop_py.tightening.mccormick import first_moments
from sparsepop_py.tightening.settings import OBBT
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Node, claim
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import Replay, Step, Tightening, shrunk, tighten

__all__ = ["TightenedBox", "tighten_by_relaxation"]

_Task = tuple[
    SolveContext, Problem, Interval, tuple[RelaxationSpec, Families], NDArray[np.float64] | float
]


@dataclass(frozen=True, eq=False)
class TightenedBox:
    """Result of one round of OBBT by a semidefinite relaxation.

    Parameters
    ----------
    box : Interval
        The tightened box, which may be empty.
    steps : tuple
        The steps that prove it.
    left : float
        Weighted mean share of the widths that is left; 0 for an empty box.
    node : Node or None
        The argument that the box holds no point below the cutoff, if a relaxation proved it.
    """

    box: Interval
    steps: tuple[Step, ...] = ()
    left: float = 1.0
    node: Node | None = None


def tighten_by_relaxation(
    context: SolveContext,
    replay: Replay,
    box: Interval,
    spec: tuple[RelaxationSpec, Families],
    weights: Mapping[int, float],
    enough: float = 0.0,
    points: Sequence[NDArray[np.float64]] = (),
    slack: NDArray[np.float64] | float = 0.0,
    executor: Executor | None = None,
) -> TightenedBox:
    """Run one round of OBBT by a semidefinite relaxation.

    Parameters
    ----------
    context : SolveContext
    replay : Replay
        Its problem, with the cutoff.
    box : Interval
    spec : (RelaxationSpec, Families)
        The relaxation, and the cliques to build it on.
    weights : mapping from int to float
        The variables, and the weights of their widths.
    enough : float
        Weighted mean share of the widths at which the round ends.
    points : sequence of (n,) float
        First moments of relaxations on this box: sides that they touch are left out.
    slack : (n,) float
        Arguments hold on boxes larger by this.
    executor : concurrent.futures.Executor, optional
        Solves one relaxation on each worker at a time.

    Returns
    -------
    TightenedBox
    """
    moved = [v for v in sorted(weights, key=lambda v: -weights[v]) if box.hi[v] > box.lo[v]]
    start, steps, seen = box.width()[moved], list[Step](), list(points)
    weight = np.array([weights[v] for v in moved])

    def left() -> float:
        return float(np.average(box.width()[moved] / start, weights=weight))

    def touched(v: int, side: int) -> bool:
        width, edge = box.hi[v] - box.lo[v], box.lo[v] if side > 0 else box.hi[v]
        return width <= 0 or any(abs(x[v] - edge) <= OBBT.touched * width for x in seen)

    sides = ((v, side) for v in moved for side in (1, -1) if not touched(v, side))
    while not (context.deadline.over or is_empty(box) or left() < enough):
        taken = list(islice(sides, max(1, workers_of(executor))))
        if not taken:
            break
        tasks = [(context, replay.about(v, side), box, spec, slack) for v, side in taken]
        for (v, side), (found, point) in zip(taken, _reached_all(tasks, executor), strict=True):
            if is_empty(box):
                break
            if point is not None:
                seen.append(point)
            if found.node.empty and found.proved.bound == np.inf:
                return TightenedBox(box, tuple(steps), 0.0, found.node)
            value, argument = _claimed(found), found.node.argument
            edge, width = box.lo[v] if side > 0 else box.hi[v], box.hi[v] - box.lo[v]
            if isinstance(argument, Identity) and value - side * edge > OBBT.worth * width:
                bound = np.array([v]), np.array([side]), np.array([value])
                box, more = _propagated(replay, shrunk(box, *bound))
                steps += [Tightening(*bound, argument, False), *more]
    rest = 0.0 if is_empty(box) else left() if moved else 1.0
    return TightenedBox(box, tuple(steps), rest)


def _reached_all(
    tasks: list[_Task], executor: Executor | None
) -> list[tuple[BoxBound, NDArray[np.float64] | None]]:
    """Bound several variables on one box, on the executor if there is one."""
    answers: list[tuple[BoxBound, NDArray[np.float64] | None] | None] = [None] * len(tasks)
    if executor is not None and len(tasks) > 1:
        context = tasks[0][0]
        apart = [(context.for_worker(), *task[1:]) for task in tasks]
        answers, failure = run_on(executor, _reached_apart, apart, context.deadline)
        if failure:
            text = f"the executor failed ({failure}): relaxations are solved in this process"
            context.stages.note(text, logging.WARNING)
    return [
        _reached(*task) if answer is None else answer
        for task, answer in zip(tasks, answers, strict=True)
    ]


def _reached_apart(*task: Any) -> tuple[BoxBound, NDArray[np.float64] | None]:
    """Bound a variable in another process or thread, and leave the solution there."""
    found, point = _reached(*task)
    return replace(found, solution=None), point


def _propagated(replay: Replay, box: Interval) -> tuple[Interval, tuple[Step, ...]]:
    """Propagate a moved bound to the other variables; return the box and the steps."""
    if is_empty(box):
        return box, ()
    smaller, sweeps = tighten(replay, box, OBBT.sdp_sweeps)
    return (smaller, (sweeps,)) if shrinks(box, smaller) else (box, ())


def _claimed(found: BoxBound) -> float:
    """Return the bound less what a replay on another machine may lose by rounding."""
    value = claim(found.proved)
    return value - 1e-14 * abs(value)


def _reached(
    context: SolveContext,
    about: Problem,
    box: Interval,
    spec: tuple[RelaxationSpec, Families],
    slack: NDArray[np.float64] | float,
) -> tuple[BoxBound, NDArray[np.float64] | None]:
    """Bound side * x_v, the objective of ``about``, by the relaxation.

    Returns
    -------
    BoxBound
        The bound.
    (n,) float or None
        First moments, if the solver found any.
    """
    with context.stages.stage("relax"):
        scaled = Scaled.of(about, Scaling.of_box(box, slack=slack), (about.objective,))
        relaxation = spec[0].build(scaled, spec[1])
    solver = solvers_for(context, relaxation, True)[0]
    options = replace(
        context.options,
        effort="presolve",
        accuracy=OBBT.rough_accuracy if solver == "cliquetree" else OBBT.accuracy,
        max_iterations=min(
            OBBT.iterations,
            context.options.max_iterations or OBBT.iterations,
        ),
        solver=solver,
    )
    reach = range_over(about.objective_row, box)
    least, largest = float(reach.lo[0]), float(reach.hi[0])
    aim = largest + OBBT.beyond * (largest - least)
    own = replace(context, problem=about, options=options, best=None, aim=aim)
    found = bound_box(own, box, scaled, relaxation)
    value = _claimed(found)
    if np.isfinite(value):
        with context.stages.stage("certify"):
            needed = value - OBBT.short * (value - least)
            found = shorten_if_enough(needed, own.at_cutoff(), box, found)
    solution = found.solution
    if solution is None or solution.status not in ("solved", "almost"):
        return found, None
    return found, first_moments(scaled, relaxation, solution.y)
