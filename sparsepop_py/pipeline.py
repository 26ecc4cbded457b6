"""Pipeline from a problem to proved bound, attained point, gap and status.

    search -> box -> scale -> cliques -> relax -> assemble -> solve -> certify -> extract

One pass is :mod:`sparsepop_py.bounding.relaxation_bound`, the loop over passes
:mod:`sparsepop_py.strategy.order_loop`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, tee
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.exact_convex import falling_direction
from sparsepop_py.bounding.relaxation_bound import (
    CertifiedBound,
    Model,
    build_relaxations,
    lower_bound,
)
from sparsepop_py.budget import Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError, SparsePOPError
from sparsepop_py.local_search.incumbents import first_incumbent, random_starts
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import Stages
from sparsepop_py.result import Point, Result, Status
from sparsepop_py.solvers.threads import one_thread
from sparsepop_py.strategy.multi_objective import (
    MultiObjectiveSearch,
    first_starts,
    pairs,
    width_between,
)
from sparsepop_py.strategy.order_loop import INTERRUPTED, SearchState, run_orders, unstarted_state
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import BoxProof
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["solve", "solve_each"]

_LOST = 1e-3  # relative to a relaxation's value: what is worth a sentence


@one_thread
def solve(
    problem: Problem, options: Options | None = None, *, start: NDArray[Any] | None = None
) -> Result:
    """Solve a polynomial problem: proved lower bound, attained upper bound, minimisers.

    Parameters
    ----------
    problem : Problem
    options : Options, optional
        Defaults: relaxation of least order, with presolve.
    start : (n,) array_like, optional
        A point to start the local search from.

    Returns
    -------
    Result
        ``lower_bound`` is proved (``result.certificate.verify(problem)`` re-checks it),
        ``upper_bound`` is attained by a point whose existence is proved.

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
    >>> problem = sp.Problem(x1 * x2, [x1**2 + x2**2 <= 2], lower=0.5)
    >>> result = sp.solve(problem, sp.Options(order=1))
    >>> result.status, abs(result.lower_bound - 0.25) < 1e-6
    (<Status.OPTIMAL: 'OPTIMAL'>, True)
    """
    options = options or Options()
    _check_problem(problem, options)
    if options.gap_kind == "width":
        raise ProblemError(
            "Options.gap_kind: found 'width', which needs pairs of objectives (solve_each)"
        )
    context = SolveContext(
        problem, options, Stages(options.progress), Deadline(options.time_limit, options.work_limit)
    )
    return _result(_solve_one(context, _start_vectors(problem, start), None), {})


@one_thread
def solve_each(
    problem: Problem,
    objectives: Sequence[Polynomial],
    options: Options | None = None,
    *,
    start: NDArray[Any] | None = None,
    repair: Callable[[NDArray[Any]], NDArray[Any]] | None = None,
    points: Sequence[ProvedPoint] = (),
    branch_on: Sequence[int] | None = None,
    on_progress: Callable[[int, float, float], None] | None = None,
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
        Feasible points that are known already (effort ``"auto"``); each is proved again.
    branch_on : sequence of int, optional
        Takes the place of ``options.branch_on``.
    on_progress : callable, optional
        Called with an objective's number, its proved and its attained value so far.

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
    options = options or Options()
    if branch_on is not None:
        options = replace(options, branch_on=tuple(branch_on))
    objectives = list(objectives)
    _check(problem, objectives, options)
    if not objectives:
        return []
    problem = problem.with_objective(objectives[0])  # its own joins no variables
    stages, starts = Stages(options.progress), _start_vectors(problem, start)
    report = _ProgressReporter(on_progress)
    deadline = Deadline(options.time_limit, options.work_limit)
    first = Model(BoxProof(), Interval(problem.lower, problem.upper))
    try:
        with stages.stage("presolve"):
            first = Model(*find_box(problem, None, options))
    except KeyboardInterrupt:
        deadline.stop()
    box = first.box
    if options.effort == "auto" and finite(box) and not is_empty(box):
        starts += [] if deadline.over else first_starts(problem, box, options)
        search = MultiObjectiveSearch(
            problem,
            objectives,
            options,
            first,
            starts,
            stages,
            deadline,
            report,
            repair=repair,
            points=[p for p in (point.recheck(problem) for point in points) if p is not None],
        )
        states = search.run()
        return [_result(state, search.known) for state in states]
    model = None
    if (finite(box) or options.effort == "plain") and not is_empty(box):
        try:
            with stages.stage("relax"):
                model = build_relaxations(problem, tuple(objectives), first, options)
        except KeyboardInterrupt:
            deadline.stop()
    states = []
    for number, objective in enumerate(objectives):
        own = Stages(options.progress)
        own.seconds.update(stages.seconds if not states else {})
        one, count = problem.with_objective(objective), len(objectives)
        context = SolveContext(one, options, own, deadline, repair=repair, objectives=count)
        states.append(_solve_one(context, starts, model))
        if INTERRUPTED in states[-1].notes:
            deadline.stop()  # the others end with what is known
        report(number, states[-1])
    known: dict[Any, Any] = {}
    return [_result(state, known) for state in _with_widths(states, objectives, options)]


@dataclass(frozen=True)
class _ProgressReporter:
    """Callback that reports the bounds of an objective to the caller."""

    on_progress: Callable[[int, float, float], None] | None

    def __call__(self, number: int, state: SearchState) -> None:
        if self.on_progress is not None:
            lower = lower_bound(state.outcome.certificate)
            self.on_progress(number, lower, state.context.upper)


def _check(problem: Problem, objectives: list[Polynomial], options: Options) -> None:
    _check_problem(problem, options)
    for number, objective in enumerate(objectives):
        if not isinstance(objective, Polynomial) or objective.dimension != problem.dimension:
            raise ProblemError(
                f"objectives[{number}]: expected a Polynomial in {problem.dimension} variables"
            )
    if options.gap_kind == "width":
        paired = pairs(objectives)
        for number in range(len(objectives)):
            if number not in paired:
                raise ProblemError(
                    f"Options.gap_kind: found 'width', but objectives[{number}] has no "
                    "negative among the other objectives"
                )


def _check_problem(problem: Problem, options: Options) -> None:
    if not isinstance(problem, Problem):
        raise ProblemError(
            f"problem: found {type(problem).__name__}, expected a Problem, such as "
            "Problem(objective, constraints), parse(text) or read_gms(path)"
        )
    for v in options.branch_on or ():
        if v >= problem.dimension:
            raise ProblemError(
                f"Options.branch_on: found {v}, expected numbers below {problem.dimension}"
            )


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


def _start_vectors(problem: Problem, start: NDArray[Any] | None) -> list[NDArray[np.float64]]:
    if start is None:
        return []
    try:
        vector = np.asarray(start, float)
    except (TypeError, ValueError):
        raise ProblemError(f"start: found {start!r}, expected numbers") from None
    if vector.shape != (problem.dimension,) or not np.all(np.isfinite(vector)):
        raise ProblemError(
            f"start: found shape {vector.shape}, expected ({problem.dimension},) finite numbers"
        )
    return [vector]


def _solve_one(
    context: SolveContext, starts: list[NDArray[Any]], shared: Model | None
) -> SearchState:
    """Search an incumbent, then loop over relaxations; an interrupt keeps what is proved."""
    problem, candidates = context.problem, list[NDArray[Any]]()
    try:
        with context.stages.stage("search"):
            box = shared.box if shared else Interval(problem.lower, problem.upper)
            first, more_starts = tee(chain(starts, _random(problem, box, context.options)))
            context, candidates = first_incumbent(context, first)
        return run_orders(context, candidates, shared, more_starts)
    except KeyboardInterrupt:
        return unstarted_state(context, candidates)
    finally:
        context.stages.close()


def _random(problem: Problem, box: Interval, options: Options) -> Iterator[NDArray[np.float64]]:
    yield from random_starts(problem, box, options)  # a box is found only if they are asked for


def _verified(state: SearchState, known: dict[Any, Any]) -> SearchState:
    """Lower the claims of a state, also those on the way, to what verification confirms.

    An interrupt here asks for the result, which this is the last step to; a second one ends it.
    """
    problem, outcome = state.context.problem, state.outcome
    certificate = outcome.certificate
    if certificate is None:
        return state
    with state.context.stages.stage("verify"):
        try:
            settled = certificate.settled(problem, known)
        except KeyboardInterrupt:
            state.context.deadline.stop()
            settled = certificate.settled(problem, known)
    state.context.stages.close()
    if settled is certificate:
        return state
    most = lower_bound(settled)
    history = tuple(
        replace(entry, lower_bound=min(entry.lower_bound, most)) for entry in state.history
    )
    return replace(state, outcome=replace(outcome, certificate=settled), history=history)


def _result(state: SearchState, known: dict[Any, Any]) -> Result:
    """Make the result; its bound is what verification recomputes, with the shared ``known``."""
    state = _verified(state, known)
    context, bound = state.context, state.outcome
    problem, best = context.problem, context.best
    lower = lower_bound(bound.certificate)
    upper = best.value if best is not None else np.inf
    if lower > upper:
        raise SparsePOPError(
            f"contradiction: a bound of {lower!r} is proved and {upper!r} is attained; "
            "this is a defect of the program, please report the problem"
        )
    status, notes, ray = _status(state, lower)
    points = _points(problem, best, state.candidates)
    return Result(
        problem=problem,
        options=context.options,
        status=status,
        lower_bound=lower,
        upper_bound=upper if status is not Status.UNBOUNDED else -np.inf,
        x=points[0].x if points else None,
        certificate=bound.certificate,
        attained=best,
        points=points,
        relaxation=bound.relaxation,
        solution=bound.solution,
        solver_value=bound.value,
        history=state.history,
        timings=context.stages.seconds,
        notes=notes,
        ray=ray,
    )


_Status = tuple[Status, tuple[str, ...], NDArray[np.float64] | None]


def _status(state: SearchState, lower: float) -> _Status:
    context, bound = state.context, state.outcome
    notes = [*bound.model.notes, *state.notes, *_lost_by_the_proof(context, bound, lower)]
    if context.deadline.stopped and not state.notes:
        notes.append(INTERRUPTED)
    status, ray = Status.BOUNDED, None
    if lower == np.inf:
        status = Status.INFEASIBLE
    elif context.closed(lower):
        status = Status.OPTIMAL
    elif lower == -np.inf:
        ray = _ray(context.problem, context.best)
        status, note = _unproved(context.problem, bound, ray)
        notes += note
    elif context.deadline.over or state.notes:
        status = Status.LIMIT
    return status, tuple(notes), ray


def _lost_by_the_proof(context: SolveContext, bound: CertifiedBound, lower: float) -> list[str]:
    """Say that the proof and not the relaxation lost the value, and where."""
    solution, value, box = bound.solution, bound.value, bound.model.box
    single = context.options.effort != "auto"  # else the last relaxation may be of one node
    if not single or solution is None or solution.status not in ("solved", "almost"):
        return []
    if context.closed(lower) or not value - lower > _LOST * (1.0 + abs(value)):
        return []
    reach = np.maximum(np.abs(box.lo), np.abs(box.hi))
    open_ = np.flatnonzero(np.isinf(reach))
    where = f"no finite bounds are known for {_listed(context.problem, open_)}"
    if not open_.size:
        widest = context.problem.names[int(np.argmax(reach))]
        where = f"rounding costs much where bounds are wide, such as those of {widest}"
    return [f"the relaxation's value is {value:.8g}, the proof loses the rest: {where}"]


def _listed(problem: Problem, variables: NDArray[Any]) -> str:
    """Names of variables, the first eight."""
    names = ", ".join(problem.names[v] for v in variables[:8])
    return names + (f" and {variables.size - 8} more" if variables.size > 8 else "")


def _ray(problem: Problem, best: ProvedPoint | None) -> NDArray[np.float64] | None:
    """Find a direction along which the objective provably falls without limit."""
    if best is None:
        return None
    ray = falling_ray(problem, best)
    direction = falling_direction(problem) if ray is None else None
    return ray if direction is None else falling_ray(problem, best, direction)


def _unproved(
    problem: Problem, bound: CertifiedBound, ray: NDArray[np.float64] | None
) -> tuple[Status, list[str]]:
    if ray is not None:
        shown = ", ".join(f"{v:g}" for v in ray[:8]) + (", ..." if ray.size > 8 else "")
        return Status.UNBOUNDED, [f"the objective falls along the ray ({shown}) from x"]
    box = bound.model.box
    unbounded = np.flatnonzero(np.isinf(box.lo) | np.isinf(box.hi))
    if unbounded.size:
        return Status.UNPROVED, [f"no finite bounds are known for {_listed(problem, unbounded)}"]
    return Status.FAILED, []


def _points(
    problem: Problem, best: ProvedPoint | None, candidates: list[NDArray[Any]]
) -> tuple[Point, ...]:
    """Select distinct candidates, the attained one first, then by value."""
    vectors = [best.x] if best is not None else []
    least = min([problem.objective(x) for x in vectors + candidates], default=np.inf)
    candidates = [
        x for x in candidates if problem.objective(x) <= least + 1e-3 * (1.0 + abs(least))
    ]
    rated = sorted(candidates, key=problem.objective)
    for x in rated:
        if all(np.abs(x - kept).max() > 1e-4 * (1.0 + np.abs(kept).max()) for kept in vectors):
            vectors.append(x)
        if len(vectors) >= 16:
            break
    return tuple(Point(x, problem.objective(x), problem.violation(x)) for x in vectors)
