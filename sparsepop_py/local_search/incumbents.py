"""Incumbents: local searches from starts, and points shared between objectives.

Every attained point carries a proof of existence.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.conic.program import ConicSolution
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError, doubles
from sparsepop_py.local_search.extraction import candidates, means
from sparsepop_py.local_search.multistart import Aim, best_attained, starting_points
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.points.feasible_point import ProvedPoint, valued

__all__ = [
    "adopt_points",
    "candidates_from_moments",
    "first_incumbent",
    "random_starts",
    "search_incumbent",
    "update_incumbent",
]

_MANY = 2000  # variables from which no atoms are extracted: first moments start a search, too
_GAIN = 0.05  # of the allowed gap: a point that gains less is not proved while the gap is open


def search_incumbent(
    problem: Problem,
    starts: Iterable[NDArray[Any]],
    context: SolveContext,
    proved: float = -np.inf,
    brief: bool = False,
) -> tuple[ProvedPoint | None, list[NDArray[Any]]]:
    """Search from several starts for a better incumbent.

    The search ends early at a point that closes the gap to the ``proved`` bound.

    Parameters
    ----------
    problem : Problem
    starts : iterable of (n,) float
        No more are taken from an iterator than are searched.
    context : SolveContext
        Options, deadline, allowed gap and incumbent.
    proved : float
        A lower bound, -inf without one.
    brief : bool
        Whether a start that leads back to the incumbent is left to no other method.

    Returns
    -------
    point : ProvedPoint or None
        The best point that was proved.
    vectors : list of (n,) float
        All nearly feasible vectors seen, by value.
    """
    options = context.options
    if not starts or not context.attains:
        return None, []
    rough = options.effort == "auto" and options.gap_kind != "width" and not context.closed(proved)
    gain = _GAIN * context.allowed if rough else 0.0  # more points follow while the bound improves
    aim = Aim(
        options.tolerance, _enough(problem, context, proved), False, context.upper, gain, brief
    )
    with _counted(context):
        repaired = _in_time(context, _with_repaired(context, starts))
        return best_attained(problem, repaired, aim, _method(context), _end(context))


def _method(context: SolveContext) -> str | None:
    return None if context.options.refine == "scipy" else context.options.refine


def _end(context: SolveContext) -> float:
    """Compute the moment on the monotonic clock at which a search is to end."""
    end, limit = context.deadline.end, context.options.search_limit
    if limit is None or context.deadline.counts_work:
        return end
    return min(end, time.monotonic() + limit - context.stages.searched)


@contextmanager
def _counted(context: SolveContext) -> Iterator[None]:
    """Count CPU seconds or work of a search."""
    start = context.deadline.now()
    try:
        yield
    finally:
        context.stages.searched += context.deadline.now() - start


def _in_time(context: SolveContext, starts: Iterable[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """Take the first start, and others while limits, also of counted work, last."""
    limit, begin = context.options.search_limit, context.deadline.now()
    for number, start in enumerate(starts):
        searched = context.stages.searched + context.deadline.now() - begin
        if number and (context.deadline.over or (limit is not None and searched >= limit)):
            return
        yield start


def _enough(problem: Problem, context: SolveContext, proved: float) -> float:
    """Return a value that leaves half of the allowed gap to the known lower bound."""
    if context.options.gap_kind == "width":
        return -np.inf
    constant = problem.squares_constant
    known = proved if constant is None else max(proved, constant)
    relative = context.options.gap_kind == "relative" and np.isfinite(proved)
    return known + 0.5 * context.options.gap * (max(1.0, abs(known)) if relative else 1.0)


def first_incumbent(
    context: SolveContext, starts: Iterator[NDArray[Any]]
) -> tuple[SolveContext, list[NDArray[Any]]]:
    """Search until the first proved point.

    A relaxation comes next, and its moments are the best start. Starts are taken from the iterator
    only as far as needed.

    Parameters
    ----------
    context : SolveContext
    starts : iterator of (n,) float

    Returns
    -------
    context : SolveContext
        With the incumbent, if one was found.
    vectors : list of (n,) float
        All nearly feasible vectors seen.
    """
    if not context.attains:
        return context, []
    enough = _enough(context.problem, context, -np.inf)
    aim = Aim(context.options.tolerance, enough, any=enough == -np.inf)
    with _counted(context):
        repaired = _in_time(context, _with_repaired(context, starts))
        found, vectors = best_attained(
            context.problem, repaired, aim, _method(context), _end(context)
        )
    return (context if found is None else replace(context, best=found)), vectors


def _repaired(context: SolveContext, start: NDArray[Any]) -> NDArray[np.float64]:
    assert context.repair is not None
    point = doubles(context.repair(start), "repair")
    if point.shape != start.shape:
        raise ProblemError(f"repair: found shape {point.shape}, expected {start.shape}")
    return point


def _with_repaired(context: SolveContext, starts: Iterable[NDArray[Any]]) -> Iterable[NDArray[Any]]:
    """Put the repaired forms of starts before them; those that are feasible replace them.

    Those of a list come before the whole list, those of an iterator each before its own start.
    """
    if context.repair is None:
        return starts
    if not isinstance(starts, list):
        return (x for start in starts for x in _with_repaired(context, [start]))
    better = [_repaired(context, x) for x in starts]
    first = [y for x, y in zip(starts, better, strict=True) if not np.array_equal(x, y)]
    tolerance = context.options.tolerance
    left = [
        x
        for x, y in zip(starts, better, strict=True)
        if np.array_equal(x, y) or context.problem.violation(y) > tolerance
    ]
    return first + left


def update_incumbent(
    context: SolveContext,
    starts: Iterable[NDArray[Any]],
    proved: float = -np.inf,
    brief: bool = False,
) -> tuple[SolveContext, list[NDArray[Any]]]:
    """Search from starts and keep the better incumbent.

    Parameters
    ----------
    context : SolveContext
    starts : iterable of (n,) float
    proved : float
        A lower bound, -inf without one.
    brief : bool
        As for :func:`search_incumbent`.

    Returns
    -------
    context : SolveContext
        With the better incumbent.
    vectors : list of (n,) float
        All nearly feasible vectors seen.
    """
    with context.stages.stage("refine"):
        found, vectors = search_incumbent(context.problem, starts, context, proved, brief)
    if found is not None and found.value < context.upper:
        context = replace(context, best=found)
    return context, vectors


def adopt_points(context: SolveContext, points: list[ProvedPoint]) -> SolveContext:
    """Keep the best of the points that were proved for other objectives."""
    for point in points:
        here = valued(point, context.problem)
        if here.value < context.upper:
            context = replace(context, best=here)
    return context


def candidates_from_moments(
    relaxation: Relaxation, solution: ConicSolution | None, scaling: Scaling
) -> list[NDArray[np.float64]]:
    """Compute candidate minimisers from the moments of a solution."""
    if solution is None or solution.status not in ("solved", "almost"):
        return []
    found = [means(relaxation, solution.y)]
    if relaxation.problem.dimension <= _MANY:
        found = candidates(relaxation, solution.y)
    return [scaling.point(t) for t in found]


def random_starts(
    problem: Problem, box: Interval, options: Options, *, tightened: bool = False
) -> list[NDArray[Any]]:
    """Choose starting points in a box: many in few variables, none in very many.

    Parameters
    ----------
    problem : Problem
    box : Interval
    options : Options
    tightened : bool
        Whether the rows were propagated to this box already.

    Returns
    -------
    list of (n,) float
    """
    n = problem.dimension
    if options.refine in ("prove", "none"):
        return []
    count = 24 if n <= 12 else 12 if n <= 40 else 2 if n <= 300 else 0
    if options.effort == "auto":  # relaxations bring better ones
        count = 0 if Products.of(problem).has_star else count // 3
    if options.effort != "plain" and not tightened:
        _, tighter = find_box(problem, None, options) if n <= 300 else (None, box)
        box = box if is_empty(tighter) else tighter
    return starting_points(problem, box, count, options.seed)
