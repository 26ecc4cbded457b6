"""Processing of one branch-and-bound node: propagate bounds, bound, tighten.

Propagation with the cutoff comes first. Then a linear program bounds the node, others like it
tighten its box (OBBT), and a semidefinite relaxation follows where that leaves the node open.
Where few variables complicate the problem and the objective is one variable, a semidefinite
relaxation does all of it: it bounds the node and tightens its box in turn while that gains
(:mod:`~sparsepop_py.tightening.obbt_sdp`).
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.relaxation_bound import bound_box, shorten_if_enough
from sparsepop_py.branch_and_bound.settings import BRANCHING
from sparsepop_py.budget import spend, spent
from sparsepop_py.context import SolveContext
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.relaxation.hierarchy import Families, RelaxationSpec
from sparsepop_py.tightening.mccormick import (
    LinearRelaxation,
    first_moments,
    products_error,
)
from sparsepop_py.tightening.obbt_lp import tighten_bounds
from sparsepop_py.tightening.obbt_sdp import tighten_by_relaxation
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Argument, Proved, claim, prove
from sparsepop_py.verified.certificate.steps import Replay, Step, tighten

__all__ = ["NodeSettings", "ProcessedNode", "process_node"]


@dataclass(frozen=True, eq=False)
class NodeSettings:
    """Settings for the nodes of one search.

    Parameters
    ----------
    cliques : dict
        Cliques for each way of joining variables.
    variables : tuple of int
        Branching variables.
    spec : RelaxationSpec or None
        The semidefinite relaxation of a node that the linear one leaves open; None: none.
    obbt_lp : bool
        Tighten the bounds of the variables by linear programs.
    obbt_sdp : RelaxationSpec or None
        The semidefinite relaxation that bounds a node and tightens its box, instead of all others.
    slack : (n,) float
        Arguments hold on boxes larger by this: rounding, where a node is replayed with another
        cutoff.
    room : (n,) float
        The same for semidefinite relaxations, which have no interior on very flat boxes.
    """

    cliques: Families
    variables: tuple[int, ...]
    spec: RelaxationSpec | None = None
    obbt_lp: bool = False
    obbt_sdp: RelaxationSpec | None = None
    slack: NDArray[np.float64] | float = 0.0
    room: NDArray[np.float64] | float = 0.0


@dataclass(frozen=True, eq=False)
class ProcessedNode:
    """Result of processing one node.

    Parameters
    ----------
    steps : tuple
        Steps that tightened its box.
    box : Interval
        The tightened box.
    proved : Proved
        The proved bound.
    argument : Identity or LinearDual or None
        The argument behind the bound; None: interval arithmetic alone.
    empty : bool
        Whether the argument proves emptiness.
    point : (n,) float or None
        First moments: a candidate minimiser.
    error : (n,) float or None
        Violation of the products of each variable at that point.
    left : float
        Mean share of the widths that the first round of tightening left; NaN without a round.
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
    context: SolveContext,
    settings: NodeSettings,
    box: Interval,
    cutoff: float | None,
    executor: Executor | None = None,
) -> ProcessedNode:
    """Process one branch-and-bound node: propagate bounds, bound, tighten.

    Pure; safe in a worker process.

    Parameters
    ----------
    context : SolveContext
    settings : NodeSettings
    box : Interval
        The box of the node.
    cutoff : float or None
        Objective value above which the node is fathomed; None without an incumbent.
    executor : concurrent.futures.Executor, optional
        Solves the relaxations that tighten its box, several at a time.

    Returns
    -------
    ProcessedNode
    """
    before = spent()
    found = _processed(context, settings, box, cutoff, executor)
    spend(BRANCHING.node_work + 1e-6 * context.problem.rows.words.shape[0])
    return replace(found, work=spent() - before)


def _processed(
    context: SolveContext,
    settings: NodeSettings,
    box: Interval,
    cutoff: float | None,
    executor: Executor | None,
) -> ProcessedNode:
    replay = Replay(context.problem, cutoff)
    steps: tuple[Step, ...] = ()
    with context.stages.stage("branch"):
        smaller, step = tighten(replay, box, BRANCHING.sweeps)
        if shrinks(box, smaller):
            box, steps = smaller, (step,)
    found = ProcessedNode(steps, box, prove(replay, box, None, False), None)
    if _done(found, cutoff):
        return found
    if settings.obbt_sdp is not None:
        return _obbt_sdp(context, settings, settings.obbt_sdp, replay, found, executor)
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
    """Bound a node by the linear relaxation, and if asked tighten its box by OBBT."""
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
    if not settings.obbt_lp or _done(found, replay.cutoff):
        return found
    open_ = [v for v in settings.variables if found.box.hi[v] > found.box.lo[v]]
    box, step, _ = tighten_bounds(replay, mccormick, found.box, open_, left)
    if step is None or not open_:
        return replace(found, left=1.0)
    left_over = np.mean(box.width()[open_] / found.box.width()[open_])
    return replace(found, steps=(*found.steps, step), box=box, left=float(left_over))


def _semidefinite(
    context: SolveContext,
    settings: NodeSettings,
    spec: RelaxationSpec,
    replay: Replay,
    found: ProcessedNode,
) -> ProcessedNode:
    """Bound a node by a semidefinite relaxation, kept where it is better."""
    problem = context.problem
    with context.stages.stage("relax"):
        scaling = Scaling.of_box(found.box, slack=settings.room)
        scaled = Scaled.of(problem, scaling, (problem.objective,))
        relaxation = spec.build(scaled, settings.cliques)
    box_bound = bound_box(context, found.box, scaled, relaxation)
    if replay.cutoff is not None:
        box_bound = shorten_if_enough(replay.cutoff, replay, found.box, box_bound)
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


def _obbt_sdp(
    context: SolveContext,
    settings: NodeSettings,
    spec: RelaxationSpec,
    replay: Replay,
    found: ProcessedNode,
    executor: Executor | None = None,
) -> ProcessedNode:
    """Bound a node and tighten its box by one relaxation, in turns while that gains."""
    cutoff = replay.cutoff
    for _ in range(BRANCHING.obbt_rounds):
        found = _semidefinite(context, settings, spec, replay, found)
        if _done(found, cutoff) or context.deadline.over:
            return found
        enough = _enough(context, cutoff, found.proved.bound)
        if enough > BRANCHING.nearly:  # its children are probably fathomed, at two solves
            return found
        error = found.error if found.error is not None else np.zeros(found.box.lo.size)
        weights = {v: float(error[v]) + 1e-6 for v in settings.variables}
        points = () if found.point is None else (found.point,)
        how = (spec, settings.cliques)
        made = tighten_by_relaxation(
            context, replay, found.box, how, weights, enough, points, settings.room, executor
        )
        left = made.left if np.isnan(found.left) else found.left
        found = replace(found, box=made.box, steps=(*found.steps, *made.steps), left=left)
        if made.node is not None:
            fathomed = Proved(np.inf, 0.0, "")
            return replace(found, proved=fathomed, argument=made.node.argument, empty=True)
        alone = prove(replay, found.box, None, False)  # +inf where the box is empty
        if alone.bound > found.proved.bound:  # the objective is a variable
            found = replace(found, proved=alone, argument=None, empty=False)
        if _done(found, cutoff) or made.left > BRANCHING.again:
            break
    return found


def _enough(context: SolveContext, cutoff: float | None, bound: float) -> float:
    """Estimate the share of the widths at which the bound reaches the cutoff, else 0."""
    if cutoff is None or not -np.inf < bound < context.upper < np.inf:
        return 0.0
    return BRANCHING.error_share * (context.upper - cutoff) / (context.upper - bound)
