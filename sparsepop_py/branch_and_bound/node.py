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

from sparsepop_py.bounding.relaxation_bound import bound_box, short_if
from sparsepop_py.budget import spend, spent
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.relaxation.hierarchy import Families, RelaxationSpec
from sparsepop_py.tightening.mccormick import (
    LinearRelaxation,
    first_moments,
    products_error,
    tightened,
)
from sparsepop_py.tightening.obbt_sdp import tighten_by_relaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Argument, Proved, claim, prove
from sparsepop_py.verified.certificate.steps import Replay, Step, tighten

__all__ = ["NodeSettings", "ProcessedNode", "process_node"]

_SWEEPS = 6
_NODE_WORK = 5e-3  # units of work of a node beside its programs
_ROUNDS = 6  # of squeezing one part
_AGAIN = 0.7  # another round of squeezing follows where one left less of the widths
_HALF = 0.5  # what is spared of the error that a bound may have


@dataclass(frozen=True, eq=False)
class NodeSettings:
    """How the parts of one search are bounded.

    Parameters
    ----------
    cliques : dict
        A family for each way of joining variables.
    variables : tuple of int
        Which variables may be cut.
    recipe : RelaxationSpec or None
        The semidefinite relaxation of a part that the linear one leaves open.
    narrow : bool
        Tighten the bounds of the variables by linear programs.
    squeeze : RelaxationSpec or None
        The semidefinite relaxation that bounds a part and tightens its box, instead of all others.
    room : (n,) float
        Arguments hold on boxes larger by this: rounding, where parts are replayed at a later level.
    """

    cliques: Families
    variables: tuple[int, ...]
    spec: RelaxationSpec | None = None
    narrow: bool = False
    obbt_sdp: RelaxationSpec | None = None
    slack: NDArray[np.float64] | float = 0.0


@dataclass(frozen=True, eq=False)
class ProcessedNode:
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
    work : float
        Units of work that it took, see :mod:`sparsepop_py.budget`.
    """

    steps: tuple[Step, ...]
    box: Interval
    proved: Proved
    argument: Argument | None
    empty: bool = False
    point: NDArray[np.float64] | None = None
    error: NDArray[np.float64] | None = None
    left: float = np.nan
    work: float = 0.0


def process_node(
    context: SolveContext, settings: NodeSettings, box: Interval, cutoff: float | None
) -> ProcessedNode:
    """Shrink and bound one part. Depends on nothing else, so it can run in any process.

    Parameters
    ----------
    task : Task
    plan : Plan
    box : Interval
    level : float or None
        The cut-off.
    """
    before = spent()
    found = _processed(context, settings, box, cutoff)
    spend(_NODE_WORK + 1e-6 * context.problem.rows.words.shape[0])
    return replace(found, work=spent() - before)


def _processed(
    context: SolveContext, settings: NodeSettings, box: Interval, cutoff: float | None
) -> ProcessedNode:
    replay = Replay(context.problem, cutoff)
    steps: tuple[Step, ...] = ()
    with context.stages.stage("branch"):
        smaller, step = tighten(replay, box, _SWEEPS)
        if shrinks(box, smaller):
            box, steps = smaller, (step,)
    found = ProcessedNode(steps, box, prove(replay, box, None, False), None)
    if _done(found, cutoff):
        return found
    if settings.obbt_sdp is not None:
        return _tightened_by_relaxation(context, settings, settings.obbt_sdp, replay, found)
    with context.stages.stage("branch"):
        found = _linear(context, settings, replay, found)
    if settings.spec is not None and not _done(found, cutoff):
        found = _semidefinite(context, settings, settings.spec, replay, found)
    return found


def _done(found: ProcessedNode, cutoff: float | None) -> bool:
    return found.proved.bound == np.inf or (cutoff is not None and claim(found.proved) >= cutoff)


def _linear(
    context: SolveContext, settings: NodeSettings, replay: Replay, found: ProcessedNode
) -> ProcessedNode:
    """The bound of the linear relaxation, and if asked a tighter box by others like it."""
    problem, left = context.problem, context.deadline.left
    mccormick = LinearRelaxation.of(
        problem, found.box, settings.cliques["constraints"], slack=settings.slack
    )
    solution = mccormick.minimise(left)
    if solution.status not in ("solved", "infeasible"):
        return found
    empty = solution.status == "infeasible"
    dual = mccormick.objective_dual(solution)
    proved = prove(replay, found.box, dual, empty)
    if proved.bound > found.proved.bound:
        found = replace(found, proved=proved, argument=dual, empty=empty)
    if empty:
        return found
    found = replace(
        found, point=mccormick.point(solution), error=mccormick.products_error(solution)
    )
    if not settings.narrow or _done(found, replay.cutoff):
        return found
    open_ = [v for v in settings.variables if found.box.hi[v] > found.box.lo[v]]
    box, step, _ = tightened(replay, mccormick, found.box, open_, left)
    if step is None or not open_:
        return replace(found, left=1.0)
    left_over = np.mean((box.hi - box.lo)[open_] / (found.box.hi - found.box.lo)[open_])
    return replace(found, steps=(*found.steps, step), box=box, left=float(left_over))


def _semidefinite(
    context: SolveContext,
    settings: NodeSettings,
    spec: RelaxationSpec,
    replay: Replay,
    found: ProcessedNode,
) -> ProcessedNode:
    """The bound of a semidefinite relaxation, if it is better."""
    problem = context.problem
    with context.stages.stage("relax"):
        scaling = Scaling.of_box(found.box, slack=settings.slack)
        scaled = Scaled.of(problem, scaling, (problem.objective,))
        relaxation = spec.build(scaled, settings.cliques)
    box_bound = bound_box(context, found.box, scaled, relaxation)
    if replay.cutoff is not None:
        box_bound = short_if(replay.cutoff, replay, found.box, box_bound)
    if box_bound.proved.bound > found.proved.bound:
        node = box_bound.node
        found = replace(found, proved=box_bound.proved, argument=node.argument, empty=node.empty)
    solution = box_bound.solution
    if solution is None or solution.status not in ("solved", "almost"):
        return found
    return replace(
        found,
        point=first_moments(scaled, relaxation, solution.y),
        error=products_error(relaxation, solution.y),
    )


def _tightened_by_relaxation(
    context: SolveContext,
    settings: NodeSettings,
    spec: RelaxationSpec,
    replay: Replay,
    found: ProcessedNode,
) -> ProcessedNode:
    """The bound of one relaxation, and while that leaves the part open, its box made smaller."""
    cutoff = replay.cutoff
    for _ in range(_ROUNDS):
        found = _semidefinite(context, settings, spec, replay, found)
        if _done(found, cutoff) or context.deadline.over:
            return found
        error = found.error if found.error is not None else np.zeros(found.box.lo.size)
        weights = {v: float(error[v]) + 1e-6 for v in settings.variables}
        points = () if found.point is None else (found.point,)
        enough = _enough(context, cutoff, found.proved.bound)
        how = (spec, settings.cliques)
        made = tighten_by_relaxation(
            context, replay, found.box, how, weights, enough, points, settings.slack
        )
        left = made.left if np.isnan(found.left) else found.left
        found = replace(found, box=made.box, steps=(*found.steps, *made.steps), left=left)
        if made.node is not None:
            nothing = Proved(np.inf, 0.0, "")
            return replace(found, proved=nothing, argument=made.node.argument, empty=True)
        alone = prove(replay, found.box, None, False)  # +inf where the box is empty
        if alone.bound > found.proved.bound:  # the objective is a variable
            found = replace(found, proved=alone, argument=None, empty=False)
        if _done(found, cutoff) or made.left > _AGAIN:
            break
    return found


def _enough(context: SolveContext, cutoff: float | None, bound: float) -> float:
    """Share of the widths at which the bound may reach the level, 0 where nobody knows."""
    if cutoff is None or not -np.inf < bound < context.upper < np.inf:
        return 0.0
    return _HALF * (context.upper - cutoff) / (context.upper - bound)
