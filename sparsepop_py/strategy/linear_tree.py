"""A tree of linear programs before the relaxations of effort "auto", for small problems.

Small problems of degree 2 are mostly closed by a few nodes, in less time than a semidefinite
relaxation takes to be built. A tree that does not close its gap soon is given up; better points
that it met stay.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import CertifiedBound, Model, certified_bound, lower_bound
from sparsepop_py.bounding.relaxation_bound import BoxBound
from sparsepop_py.branch_and_bound.float_propagation import FloatPropagation
from sparsepop_py.branch_and_bound.linear_tree import (
    LinearTree,
    convex_minimiser,
    suits_linear_tree,
)
from sparsepop_py.branch_and_bound.product_model import ProductModel
from sparsepop_py.branch_and_bound.settings import LINEAR_TREE
from sparsepop_py.budget import EARLY, cpu_seconds
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.presolve.initial_box import finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import HistoryEntry
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate, Node, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Replay, tighten

__all__ = [
    "LinearTreeResult",
    "bound_by_box",
    "box_of_starts",
    "by_linear_tree",
    "from_convex_minimiser",
]

_WIDEST = 1e150  # of boxes: products of wider ones overflow
# who leaves out one of these compares other ways to a bound
_PARTS = frozenset({"linear_tree", "linear", "branch", "cutoff", "obbt_lp"})


@dataclass(frozen=True, eq=False)
class LinearTreeResult:
    """Result of a tree of linear programs.

    Parameters
    ----------
    context : SolveContext
        With the incumbent.
    candidates : list of (n,) float
        Nearly feasible vectors seen.
    outcome : CertifiedBound or None
        The bound of a tree that closed its gap or ran out of time, None without one.
    history : tuple of HistoryEntry
    known : dict
        What verification of the certificate found.
    """

    context: SolveContext
    candidates: list[NDArray[np.float64]]
    outcome: CertifiedBound | None = None
    history: tuple[HistoryEntry, ...] = ()
    known: dict[Any, Any] = field(default_factory=dict)

    @property
    def final(self) -> bool:
        """True if nothing is left to do: the gap is closed or time is over."""
        return self.outcome is not None


def by_linear_tree(
    context: SolveContext, candidates: list[NDArray[np.float64]]
) -> LinearTreeResult:
    """Try to close the gap of a small problem by a tree of linear programs.

    Parameters
    ----------
    context : SolveContext
    candidates : list of (n,) float
        Nearly feasible vectors seen so far.

    Returns
    -------
    LinearTreeResult
    """
    start = cpu_seconds()
    if not _wanted(context) or not suits_linear_tree(context.problem):
        return LinearTreeResult(context, candidates)
    with context.stages.stage("presolve"):
        model = _first_model(context)
    box = model.box
    if not finite(box) or not np.all(box.hi / 2 - box.lo / 2 < _WIDEST):
        return LinearTreeResult(context, candidates)
    by_box = bound_by_box(context, model, candidates)
    if by_box.final or is_empty(box):
        return by_box
    seen = list(candidates)

    def search(
        now: SolveContext, starts: list[NDArray[Any]], proof: bool, bound: float
    ) -> SolveContext:
        alone = proof and now.options.refine != "none"
        options = replace(now.options, refine="prove") if alone else now.options
        found, more = update_incumbent(replace(now, options=options), starts, bound, brief=True)
        seen.extend(more)
        return replace(now, best=found.best)

    branch_on = context.options.branch_on
    variables = None if branch_on is None else np.unique(np.array(branch_on, np.int64))
    tree = LinearTree(context, model.box, search, variables)
    known: dict[Any, Any] = {}
    closed, certificate = False, None
    try:
        with context.stages.stage("branch"):
            closed = tree.run()
    except EARLY as cause:
        context.deadline.ended(cause)
    whole, over = context.deadline, tree.context.deadline.over
    try:
        if closed or over:
            certificate = _settled(tree, model, known)
    except EARLY as cause:
        whole.ended(cause)
    context = replace(tree.context, deadline=whole)
    proved = lower_bound(certificate)
    over |= whole.over  # while the certificate was made
    if certificate is None or not (context.closed(proved) or over):
        return LinearTreeResult(context, seen)
    whole.cut |= not context.closed(proved)
    entry = HistoryEntry(
        name="linear tree",
        order=0,
        lower_bound=proved,
        upper_bound=context.upper,
        seconds=cpu_seconds() - start,
        largest_block=0,
        moments=0,
        nodes=tree.nodes,
    )
    return LinearTreeResult(context, seen, CertifiedBound(model, certificate), (entry,), known)


def _settled(tree: LinearTree, model: Model, known: dict[Any, Any]) -> Certificate | None:
    """Build the certificate of a tree with a claim that verification confirms."""
    with tree.context.stages.stage("verify"):
        certificate = tree.certificate(model.proof)
        return None if certificate is None else certificate.settled(tree.context.problem, known)


def _wanted(context: SolveContext) -> bool:
    """Check that options ask for no other bounds, node counts or workers."""
    options = context.options
    return (
        _PARTS.isdisjoint(options.skip) and options.node_limit is None and options.executor is None
    )


def from_convex_minimiser(
    context: SolveContext,
) -> tuple[SolveContext, list[NDArray[np.float64]]]:
    """Minimise a convex quadratic objective over the linear relaxation, for a first point.

    Where all rows are linear the minimiser needs no local search, which would take many steps.

    Parameters
    ----------
    context : SolveContext

    Returns
    -------
    context : SolveContext
        With the minimiser as its incumbent, where it is proved to be feasible.
    starts : list of (n,) float
        The minimiser as a start of local searches, empty without one.
    """
    problem, options = context.problem, context.options
    other = context.best is not None or options.effort != "auto" or options.refine != "scipy"
    if other or problem.objective.degree != 2 or not _wanted(context):
        return context, []
    if not suits_linear_tree(problem):
        return context, []
    model = ProductModel.of(problem)
    if model.rows not in model.convex:
        return context, []
    with context.stages.stage("presolve"):
        box = box_of_starts(context)
        if box is None:
            return context, []
        scaling = Scaling.of_box(box)
        found = convex_minimiser(model, model.on_box(scaling))
    if found is None:
        return context, []
    point = scaling.point(np.clip(found[: problem.dimension], -1.0, 1.0))
    linear = all(c.polynomial.degree <= 1 for c in problem.constraints)
    proved = prove_feasible(problem, point) if linear else None
    return replace(context, best=proved), [point]


def _first_model(context: SolveContext) -> Model:
    """Take the bounds of a problem where they are finite, else propagate."""
    box = Interval(context.problem.lower, context.problem.upper)
    if finite(box):
        return Model(BoxProof(), box)
    box, step = _without_cutoff(context.problem)
    if not finite(box):
        box = Interval(context.problem.lower, context.problem.upper)
        box, step = tighten(context.at_cutoff(), box, LINEAR_TREE.first_sweeps)
    return Model(BoxProof((step,)), box)


@lru_cache(maxsize=2)  # the starts and the tree ask for it
def _without_cutoff(problem: Problem) -> tuple[Interval, Propagation]:
    """Propagate the rows of a problem whose bounds are not finite."""
    box = Interval(problem.lower, problem.upper)
    return tighten(Replay(problem, None), box, LINEAR_TREE.first_sweeps)


def box_of_starts(context: SolveContext) -> Interval | None:
    """Propagate the rows of a small problem of degree 2, for starts: rounded, no proof.

    Parameters
    ----------
    context : SolveContext

    Returns
    -------
    Interval or None
        None where another box has to be found, or no point is feasible.
    """
    problem = context.problem
    if context.options.effort != "auto" or not _wanted(context) or not suits_linear_tree(problem):
        return None
    return _propagated(problem)


@lru_cache(maxsize=2)
def _propagated(problem: Problem) -> Interval | None:
    """Propagate the rows of a problem of degree 2, without a cutoff."""
    box = Interval(problem.lower, problem.upper)
    if not finite(box):
        box, _ = _without_cutoff(problem)
        return box if finite(box) and not is_empty(box) else None
    propagation = FloatPropagation(ProductModel.of(problem))
    low, high, _, empty = propagation.sweeps(box.lo, box.hi, np.inf, LINEAR_TREE.start_sweeps)
    return None if empty else Interval(low, high)


def bound_by_box(
    context: SolveContext, model: Model, candidates: list[NDArray[np.float64]]
) -> LinearTreeResult:
    """Bound the objective by its range over a small box.

    Parameters
    ----------
    context : SolveContext
    model : Model
        The box and its proof.
    candidates : list of (n,) float
        Nearly feasible vectors seen so far.

    Returns
    -------
    LinearTreeResult
        With an outcome where the gap is closed.
    """
    replay = context.at_cutoff()
    proved = prove(replay, model.box, None, False)
    if not context.closed(proved.bound):
        return LinearTreeResult(context, candidates)
    outcome = certified_bound(replay, model, BoxBound(proved, Node()))
    return LinearTreeResult(context, candidates, outcome)
