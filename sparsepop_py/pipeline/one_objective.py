"""Solve a problem with one objective: an incumbent first, then the loop over relaxations."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import chain, tee
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import Model, lower_bound
from sparsepop_py.budget import EARLY
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError
from sparsepop_py.executors.threads import while_solving
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import first_incumbent, random_starts
from sparsepop_py.options import Options
from sparsepop_py.pipeline.arguments import (
    check_branching,
    check_callable,
    check_problem,
    deadline_of,
    options_with,
    start_vectors,
)
from sparsepop_py.pipeline.final_result import closed_box, falls, final_result
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.progress import OnProgress, Stages
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.rational.solve import solve_rational
from sparsepop_py.result import Result
from sparsepop_py.strategy.linear_tree import box_of_starts, from_convex_minimiser
from sparsepop_py.strategy.order_loop import run_orders
from sparsepop_py.strategy.search_state import SearchState, unstarted_state
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = ["search", "solve"]


@overload
def solve(
    problem: Problem,
    options: Options | None = None,
    *,
    start: NDArray[Any] | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> Result: ...


@overload
def solve(
    problem: RationalProblem,
    options: Options | None = None,
    *,
    start: NDArray[Any] | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> RationalResult: ...


@while_solving
def solve(
    problem: Problem | RationalProblem,
    options: Options | None = None,
    *,
    start: NDArray[Any] | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> Result | RationalResult:
    """Solve a polynomial problem: proved lower bound, attained upper bound, minimisers.

    Parameters
    ----------
    problem : Problem or RationalProblem
    options : Options, optional
        Defaults: relaxation of least order, with presolve.
    start : (n,) array_like, optional
        A point to start the local search from.
    on_progress : callable, optional
        Called with 0, the proved and the attained value: when they change, and at the next stage
        after two seconds. Where it raises ``KeyboardInterrupt``, what is proved is returned.
        Not called for a problem with ratios.
    executor : concurrent.futures.Executor, optional
        Processes the nodes of branch and bound, as ``options.executor`` does.

    Returns
    -------
    Result or RationalResult
        ``lower_bound`` is proved (``result.certificate.verify(problem)`` re-checks it),
        ``upper_bound`` is attained by a point whose existence is proved.

    Raises
    ------
    ProblemError
        If an argument is malformed.
    DenominatorError
        If the sign of a denominator is not proved.
    SolverNotFound
        If the chosen solver is not installed.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2 = sp.variables(2)
    >>> problem = sp.Problem(x1 * x2, [x1**2 + x2**2 <= 2], lower=0.5)
    >>> result = sp.solve(problem, sp.Options(order=1))
    >>> result.status, abs(result.lower_bound - 0.25) < 1e-6
    (<Status.OPTIMAL: 'OPTIMAL'>, True)
    """
    options = options_with(options, executor)
    check_callable("on_progress", on_progress)
    if isinstance(problem, RationalProblem):
        check_branching(problem, options)
        starts = start_vectors(problem, start)
        return solve_rational(problem, options, starts[0] if starts else None, solve)
    check_problem(problem, options)
    if options.gap_kind == "width":
        raise ProblemError(
            "Options.gap_kind: found 'width', which needs pairs of objectives (solve_each)"
        )
    stages = Stages(options.progress, on_progress)
    context = SolveContext(problem, options, stages, deadline_of(options))
    try:
        state = search(context, start_vectors(problem, start), None)
        return final_result(state, state.known)
    finally:
        stages.close()


def search(context: SolveContext, starts: list[NDArray[Any]], shared: Model | None) -> SearchState:
    """Search an incumbent, then loop over relaxations; an early end keeps what is proved."""
    problem, candidates = context.problem, list[NDArray[Any]]()
    try:
        with context.deadline.kept():
            with context.stages.stage("search"):
                box = shared.box if shared else Interval(problem.lower, problem.upper)
                context, own = from_convex_minimiser(_at_the_origin(context))
                random = _random(context, box)
                first, more_starts = tee(chain(starts, own, random))
                if context.best is None:
                    context, candidates = first_incumbent(context, first)
            context.report(-np.inf)
            if not falls(context):
                state = run_orders(context, candidates, shared, more_starts)
            elif context.options.effort == "plain":  # the relaxation was asked for
                state = run_orders(context, candidates, shared, iter(()))
            else:
                state = unstarted_state(context, candidates)
    except EARLY as cause:
        context.deadline.ended(cause)
        state = unstarted_state(context, candidates)
    state.context.report_last(lower_bound(state.outcome.certificate))
    return state


def _at_the_origin(context: SolveContext) -> SolveContext:
    """Take the feasible point nearest to 0 if the objective falls without limit from it."""
    problem = context.problem
    x = np.clip(np.zeros(problem.dimension), problem.lower, problem.upper)
    if closed_box(problem) or problem.violation(x) > 0.0:
        return context
    there = replace(context, best=prove_feasible(problem, x))
    return there if falls(there) else context


def _random(context: SolveContext, box: Interval) -> Iterator[NDArray[np.float64]]:
    """Yield random starts; a box is found only if they are asked for."""
    found = box_of_starts(context)
    tightened = found is not None
    yield from random_starts(context.problem, found or box, context.options, tightened=tightened)
