"""One part of a search: its box shrinks, then it is bounded.

Propagation with the cut-off comes first. Then either a linear program bounds the part, others like
it tighten its box, and a semidefinite relaxation follows where that leaves it open; or, where few
variables complicate the problem and the objective is one variable, a relaxation does all of it: it
bounds the part and tightens its box in turn while that gains (:mod:`~sparsepop_py.tightening.obbt_sdp`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.relaxation_bound import argue, short_if
from sparsepop_py.context import Task
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.relaxation.hierarchy import Families, Recipe
from sparsepop_py.tightening.mccormick import Lifted, first_moments, products_error, tightened
from sparsepop_py.tightening.obbt_sdp import squeezed
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Argument, Proved, claim, prove
from sparsepop_py.verified.certificate.steps import Replay, Step, tighten

__all__ = ["Explored", "Plan", "explore"]

_SWEEPS = 6
_ROUNDS = 6  # of squeezing one part
_AGAIN = 0.7  # another round of squeezing follows where one left less of the widths
_HALF = 0.5  # what is spared of the error that a bound may have


@dataclass(frozen=True, eq=False)
class Plan:
    """How the parts of one search are bounded.

    Parameters
    ----------
    cliques : dict
        A family for each way of joining variables.
    variables : tuple of int
        Which variables may be cut.
    recipe : Recipe or None
        The semidefinite relaxation of a part that the linear one leaves open.
    narrow : bool
        Tighten the bounds of the variables by linear programs.
    squeeze : Recipe or None
        The semidefinite relaxation that bounds a part and tightens its box, instead of all others.
    room : (n,) float
        Arguments hold on boxes larger by this: rounding, where parts are replayed at a later level.
    """

    cliques: Families
    variables: tuple[int, ...]
    recipe: Recipe | None = None
    narrow: bool = False
    squeeze: Recipe | None = None
    room: NDArray[np.float64] | float = 0.0


@dataclass(frozen=True, eq=False)
class Explored:
    """What one part turned out to be.

    Parameters
    ----------
    steps : tuple
        How its box shrank.
    box : Interval
    proved : Proved
    argument : Identity or LinearDual or None
    empty : bool
        Whether the argument proves emptiness.
    point : (n,) float or None
        First moments: a candidate.
    error : (n,) float
        By how much the products of each variable are untrue there.
    left : float
        Mean share of the widths that the first round of tightening left; NaN without it.
    """

    steps: tuple[Step, ...]
    box: Interval
    proved: Proved
    argument: Argument | None
    empty: bool = False
    point: NDArray[np.float64] | None = None
    error: NDArray[np.float64] | None = None
    left: float = np.nan


def explore(task: Task, plan: Plan, box: Interval, level: float | None) -> Explored:
    """Shrink and bound one part. Depends on nothing else, so it can run in any process.

    Parameters
    ----------
    task : Task
    plan : Plan
    box : Interval
    level : float or None
        The cut-off.
    """
    replay = Replay(task.problem, level)
    steps: tuple[Step, ...] = ()
    with task.stages.stage("branch"):
        smaller, step = tighten(replay, box, _SWEEPS)
        if shrinks(box, smaller):
            box, steps = smaller, (step,)
    found = Explored(steps, box, prove(replay, box, None, False), None)
    if _done(found, level):
        return found
    if plan.squeeze is not None:
        return _squeezed(task, plan, plan.squeeze, replay, found)
    with task.stages.stage("branch"):
        found = _linear(task, plan, replay, found)
    if plan.recipe is not None and not _done(found, level):
        found = _semidefinite(task, plan, plan.recipe, replay, found)
    return found


def _done(found: Explored, level: float | None) -> bool:
    return found.proved.bound == np.inf or (level is not None and claim(found.proved) >= level)


def _linear(task: Task, plan: Plan, replay: Replay, found: Explored) -> Explored:
    """The bound of the linear relaxation, and if asked a tighter box by others like it."""
    problem, left = task.problem, task.clock.left
    lifted = Lifted.of(problem, found.box, plan.cliques["constraints"], room=plan.room)
    solution = lifted.minimise(left)
    if solution.status not in ("solved", "infeasible"):
        return found
    empty = solution.status == "infeasible"
    dual = lifted.objective_dual(solution)
    proved = prove(replay, found.box, dual, empty)
    if proved.bound > found.proved.bound:
        found = replace(found, proved=proved, argument=dual, empty=empty)
    if empty:
        return found
    found = replace(found, point=lifted.point(solution), error=lifted.products_error(solution))
    if not plan.narrow or _done(found, replay.level):
        return found
    open_ = [v for v in plan.variables if found.box.hi[v] > found.box.lo[v]]
    box, step, _ = tightened(replay, lifted, found.box, open_, left)
    if step is None or not open_:
        return replace(found, left=1.0)
    left_over = np.mean((box.hi - box.lo)[open_] / (found.box.hi - found.box.lo)[open_])
    return replace(found, steps=(*found.steps, step), box=box, left=float(left_over))


def _semidefinite(
    task: Task, plan: Plan, recipe: Recipe, replay: Replay, found: Explored
) -> Explored:
    """The bound of a semidefinite relaxation, if it is better."""
    problem = task.problem
    with task.stages.stage("relax"):
        scaling = Scaling.of_box(found.box, room=plan.room)
        scaled = Scaled.of(problem, scaling, (problem.objective,))
        relaxation = recipe.build(scaled, plan.cliques)
    argued = argue(task, found.box, scaled, relaxation)
    if replay.level is not None:
        argued = short_if(replay.level, replay, found.box, argued)
    if argued.proved.bound > found.proved.bound:
        node = argued.node
        found = replace(found, proved=argued.proved, argument=node.argument, empty=node.empty)
    solution = argued.solution
    if solution is None or solution.status not in ("solved", "almost"):
        return found
    return replace(
        found,
        point=first_moments(scaled, relaxation, solution.y),
        error=products_error(relaxation, solution.y),
    )


def _squeezed(task: Task, plan: Plan, recipe: Recipe, replay: Replay, found: Explored) -> Explored:
    """The bound of one relaxation, and while that leaves the part open, its box made smaller."""
    level = replay.level
    for _ in range(_ROUNDS):
        found = _semidefinite(task, plan, recipe, replay, found)
        if _done(found, level) or task.clock.over:
            return found
        error = found.error if found.error is not None else np.zeros(found.box.lo.size)
        weights = {v: float(error[v]) + 1e-6 for v in plan.variables}
        points = () if found.point is None else (found.point,)
        enough = _enough(task, level, found.proved.bound)
        how = (recipe, plan.cliques)
        made = squeezed(task, replay, found.box, how, weights, enough, points, plan.room)
        left = made.left if np.isnan(found.left) else found.left
        found = replace(found, box=made.box, steps=(*found.steps, *made.steps), left=left)
        if made.node is not None:
            nothing = Proved(np.inf, 0.0, "")
            return replace(found, proved=nothing, argument=made.node.argument, empty=True)
        alone = prove(replay, found.box, None, False)  # +inf where the box is empty
        if alone.bound > found.proved.bound:  # the objective is a variable
            found = replace(found, proved=alone, argument=None, empty=False)
        if _done(found, level) or made.left > _AGAIN:
            break
    return found


def _enough(task: Task, level: float | None, bound: float) -> float:
    """Share of the widths at which the bound may reach the level, 0 where nobody knows."""
    if level is None or not -np.inf < bound < task.upper < np.inf:
        return 0.0
    return _HALF * (task.upper - level) / (task.upper - bound)
