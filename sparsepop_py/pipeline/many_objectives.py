"""Solve for several objectives over one feasible set: shared box, relaxations and searches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.order_bound import Model, build_relaxations
from sparsepop_py.budget import EARLY, Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError, check_kind, entries_of
from sparsepop_py.executors.threads import while_solving
from sparsepop_py.options import Options
from sparsepop_py.pipeline.arguments import (
    check_callable,
    check_objectives,
    deadline_of,
    options_with,
    start_vectors,
)
from sparsepop_py.pipeline.final_result import final_result
from sparsepop_py.pipeline.one_objective import search
from sparsepop_py.pipeline.separate_tasks import solve_apart
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import OnProgress, Stages
from sparsepop_py.result import Result
from sparsepop_py.strategy.independent_parts import independent_parts, search_parts
from sparsepop_py.strategy.multi_objective import (
    MultiObjectiveSearch,
    first_starts,
    pairs,
    width_between,
)
from sparsepop_py.strategy.search_state import SearchState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import BoxProof
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["solve_each"]


@while_solving
def solve_each(
    problem: Problem,
    objectives: Sequence[Polynomial],
    options: Options | None = None,
    *,
    start: NDArray[Any] | None = None,
    repair: Callable[[NDArray[Any]], NDArray[Any]] | None = None,
    points: Sequence[ProvedPoint] = (),
    branch_on: Sequence[int] | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> list[Result]:
    """Solve for several objectives over one feasible set, sharing box and relaxations.

    The shared box uses arguments that hold for all objectives (no cutoff). Where it is
    not finite in every variable, each objective gets a box and a relaxation of its own.
    With effort ``"auto"`` a bound that one objective proves of a single variable tightens
    the box of the others, and its certificate is quoted in theirs.

    Parameters
    ----------
    problem : Problem
        Its own objective is ignored.
    objectives : sequence of Polynomial
    options : Options, optional
        ``time_limit`` is for all objectives together. With ``gap_kind="width"`` every
        objective p needs its negative -p among the others.
    start : (n,) array_like, optional
        A point to start local searches from.
    repair : callable, optional
        Given a candidate vector (n,), a better one: used before local searches.
    points : sequence of ProvedPoint
        Feasible points that are known already (effort ``"auto"``); each is proved again, as
        long as there is time.
    branch_on : sequence of int, optional
        Takes the place of ``options.branch_on``.
    on_progress : callable, optional
        Called with an objective's number, its proved and its attained value so far, as by
        :func:`solve`.
    executor : concurrent.futures.Executor, optional
        With effort ``"auto"``: takes turns of several objectives at a time, as ``options.executor``
        does. With other efforts, unless gaps are widths: solves each objective as a task of its
        own, as :func:`solve` does; bounds then do not depend on the number of workers.

    Returns
    -------
    list of Result
        One for each objective, about the problem with that objective.

    Raises
    ------
    ProblemError
        If an argument is malformed.
    SolverNotFound
        If the chosen solver is not installed.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x1, x2 = sp.variables(2)
    >>> disc = sp.Problem(x1, [x1**2 + x2**2 <= 1])
    >>> low, high = sp.solve_each(disc, [x1, -x1])
    >>> low.relaxation is high.relaxation
    True
    """
    options = options_with(options, executor)
    if branch_on is not None:
        options = replace(options, branch_on=branch_on)
    if isinstance(objectives, Polynomial):
        raise ProblemError("objectives: found one polynomial, expected a list of polynomials")
    objectives = entries_of(objectives, "objectives", "a list of polynomials")
    points = entries_of(points, "points", "a list of ProvedPoint")
    for number, point in enumerate(points):
        check_kind(point, ProvedPoint, f"points[{number}]")
    check_callable("repair", repair)
    check_callable("on_progress", on_progress)
    check_objectives(problem, objectives, options)
    if not objectives:
        return []
    if options.executor is not None and options.effort != "auto" and options.gap_kind != "width":
        return solve_apart(problem, objectives, options, start, on_progress)
    problem = problem.with_objective(objectives[0])  # its own joins no variables
    deadline = deadline_of(options)
    several = _Search(
        problem,
        objectives,
        options,
        Stages(options.progress, on_progress),
        deadline,
        start_vectors(problem, start),
        repair,
        _proved_again(points, problem, deadline),
    )
    try:
        with several.deadline.kept():
            states, known = several.run()
        return [final_result(state, known) for state in states]
    finally:
        several.stages.close()


def _proved_again(
    points: Sequence[ProvedPoint], problem: Problem, deadline: Deadline
) -> list[ProvedPoint]:
    """Prove points again for a problem: the first, and others while there is time."""
    proved: list[ProvedPoint] = []
    for point in points:
        if proved and deadline.over:
            break
        again = point.recheck(problem)
        if again is not None:
            proved.append(again)
    return proved


@dataclass(frozen=True, eq=False)
class _Search:
    """Several objectives over one feasible set, with what their searches share."""

    problem: Problem
    objectives: list[Polynomial]
    options: Options
    stages: Stages
    deadline: Deadline
    starts: list[NDArray[np.float64]]
    repair: Callable[[NDArray[Any]], NDArray[Any]] | None
    points: list[ProvedPoint]

    def run(self) -> tuple[list[SearchState], dict[Any, Any]]:
        """Search for all objectives; return states and what verification found on the way."""
        first = self._box()
        if self.options.effort == "auto" and finite(first.box) and not is_empty(first.box):
            try:
                return self._together(first)
            except EARLY as cause:  # before any search began
                self.deadline.ended(cause)
        model = self._shared_model(first)
        states = [self._alone(number, model) for number in range(len(self.objectives))]
        return _with_widths(states, self.objectives, self.options), {}

    def _box(self) -> Model:
        try:
            with self.stages.stage("presolve"):
                return Model(*find_box(self.problem, None, self.options))
        except EARLY as cause:
            self.deadline.ended(cause)
            return Model(BoxProof(), Interval(self.problem.lower, self.problem.upper))

    def _together(self, first: Model) -> tuple[list[SearchState], dict[Any, Any]]:
        """Run adaptive searches that learn from each other."""
        more = [] if self.deadline.over else first_starts(self.problem, first.box, self.options)
        search = MultiObjectiveSearch(
            self.problem,
            self.objectives,
            self.options,
            first,
            [*self.starts, *more],
            self.stages,
            self.deadline,
            repair=self.repair,
            points=self.points,
        )
        parts = independent_parts(self.problem, self.objectives, first.box)
        if parts:
            return search_parts(parts, search)
        return search.run(), search.known

    def _shared_model(self, first: Model) -> Model | None:
        if is_empty(first.box) or not (finite(first.box) or self.options.effort == "plain"):
            return None
        try:
            with self.stages.stage("relax"):
                return build_relaxations(self.problem, tuple(self.objectives), first, self.options)
        except EARLY as cause:
            self.deadline.ended(cause)
            return None

    def _alone(self, number: int, model: Model | None) -> SearchState:
        """Search for one objective; after an interrupt, return what is known without a search."""
        stages = self.stages.of_objective(number)
        stages.seconds.update(self.stages.seconds if number == 0 else {})
        context = SolveContext(
            self.problem.with_objective(self.objectives[number]),
            self.options,
            stages,
            self.deadline,
            repair=self.repair,
            objectives=len(self.objectives),
        )
        return search(context, self.starts, model)


def _with_widths(
    states: list[SearchState], objectives: list[Polynomial], options: Options
) -> list[SearchState]:
    """Make gaps relative to the distance of the attained values of pairs, if asked for."""
    if options.gap_kind != "width":
        return states
    paired, done = pairs(objectives), []
    for number, state in enumerate(states):
        width = width_between(state.context.upper, states[paired[number]].context.upper, options)
        unit = width if np.isfinite(width) else 0.0
        done.append(replace(state, context=replace(state.context, unit=unit)))
    return done
