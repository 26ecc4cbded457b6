"""Pipeline from a problem to proved bound, attained point, gap and status.

    search -> box -> scale -> cliques -> relax -> assemble -> solve -> certify -> extract

One pass is :mod:`sparsepop_py.bounding.relaxation_bound`, the loop over passes
:mod:`sparsepop_py.strategy.order_loop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain, tee
from typing import Any, TypeAlias, overload

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
from sparsepop_py.budget import EARLY, Deadline, LimitReached
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError, SparsePOPError, check_kind, entries_of
from sparsepop_py.executors.dispatch import completed
from sparsepop_py.local_search.extraction import means
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.local_search.incumbents import (
    first_incumbent,
    random_starts,
)
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box, finite
from sparsepop_py.presolve.size_limits import check_degrees
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.problem.rounding import note as rounding_note
from sparsepop_py.progress import OnProgress, Stages
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.rational.solve import solve_rational
from sparsepop_py.result import INTERRUPTED, Point, Result, Status
from sparsepop_py.solvers.threads import one_thread
from sparsepop_py.strategy.independent_parts import independent_parts, search_parts
from sparsepop_py.strategy.linear_tree import box_of_starts, from_convex_minimiser
from sparsepop_py.strategy.multi_objective import (
    MultiObjectiveSearch,
    first_starts,
    pairs,
    width_between,
)
from sparsepop_py.strategy.order_loop import run_orders
from sparsepop_py.strategy.search_state import SearchState, unstarted_state
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import BoxProof
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["solve", "solve_each"]

_UNVERIFIED = "time ended before the best bound was verified: a simpler one is claimed"
_CANCELLING = 1e10  # relative to an attained value: coefficients that say why digits are lost
_LOST = 1e-3  # relative to a relaxation's value: what is worth a sentence
_VERIFIED = 0.45  # of a limit: the last verification may end so much later


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


@one_thread
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
    options = _with_executor(options, executor)
    _check_callable("on_progress", on_progress)
    if isinstance(problem, RationalProblem):
        return solve_rational(problem, options, start, solve)
    _check_problem(problem, options)
    if options.gap_kind == "width":
        raise ProblemError(
            "Options.gap_kind: found 'width', which needs pairs of objectives (solve_each)"
        )
    stages = Stages(options.progress, on_progress)
    context = SolveContext(problem, options, stages, _deadline(options))
    try:
        state = _solve_one(context, _start_vectors(problem, start), None)
        return _result(state, state.known)
    finally:
        stages.close()


def _deadline(options: Options) -> Deadline:
    return Deadline(options.time_limit, options.work_limit, options.cpu_limit)


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
    options = _with_executor(options, executor)
    if branch_on is not None:
        options = replace(options, branch_on=branch_on)
    if isinstance(objectives, Polynomial):
        raise ProblemError("objectives: found one polynomial, expected a list of polynomials")
    objectives = entries_of(objectives, "objectives", "a list of polynomials")
    points = entries_of(points, "points", "a list of ProvedPoint")
    for number, point in enumerate(points):
        check_kind(point, ProvedPoint, f"points[{number}]")
    _check_callable("repair", repair)
    _check_callable("on_progress", on_progress)
    _check(problem, objectives, options)
    if not objectives:
        return []
    executor = options.executor
    if executor is not None and options.effort != "auto" and options.gap_kind != "width":
        limit = options.time_limit
        until = None if limit is None else time.time() + limit  # of all tasks, in any process
        own = _shared_out(options, len(objectives))
        tasks = [(problem.with_objective(each), own, start, until) for each in objectives]
        return _solve_apart(tasks, executor, on_progress)
    problem = problem.with_objective(objectives[0])  # its own joins no variables
    deadline = _deadline(options)
    several = _Several(
        problem,
        objectives,
        options,
        Stages(options.progress, on_progress),
        deadline,
        _start_vectors(problem, start),
        repair,
        _proved_again(points, problem, deadline),
    )
    try:
        with several.deadline.kept():
            states, known = several.run()
        return [_result(state, known) for state in states]
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


_Task: TypeAlias = tuple[Problem, Options, NDArray[Any] | None, float | None]
_PATIENCE = 2.0  # times the time that is left, and a second, for an executor
_LEAST = 1e-3  # seconds for a task that begins when time is over


def _solve_apart(
    tasks: list[_Task],
    executor: Executor,
    on_progress: OnProgress | None,
) -> list[Result]:
    """Solve problems as tasks of their own; an interrupt keeps those that are done."""
    found: dict[int, Result] = {}
    try:
        with closing(_results_apart(tasks, executor)) as results:
            for number, each in results:
                found[number] = each
                if on_progress is not None:
                    on_progress(number, each.lower_bound, each.upper_bound)
    except KeyboardInterrupt:
        for number, task in enumerate(tasks):
            if number not in found:
                found[number] = _interrupted(task)
    return [found[number] for number in range(len(tasks))]


def _results_apart(
    tasks: list[_Task], executor: Executor
) -> Generator[tuple[int, Result], None, None]:
    """Yield numbers and results as tasks end, from this process where the executor fails."""
    until = tasks[0][-1]
    patience = None if until is None else _PATIENCE * (until - time.time()) + 1.0
    left = dict(enumerate(tasks))
    try:
        with closing(completed(executor, _solve_task, enumerate(tasks), patience=patience)) as all_:
            for done in all_:
                if not isinstance(done.value, Result):
                    raise SparsePOPError(f"executor: task {done.key} was given up: {done.lost}")
                del left[done.key]
                yield done.key, done.value
    except Exception as error:  # of a task, which this process meets again, or of the executor
        text = f"the executor failed ({error}): objectives are bounded in this process"
        for number, task in left.items():
            one = _solve_task(task)
            yield number, replace(one, notes=(*one.notes, text))
            if INTERRUPTED in one.notes:
                raise KeyboardInterrupt from None


def _interrupted(task: _Task) -> Result:
    """Make the result of a task that an interrupt left undone."""
    problem, options, _, _ = task
    deadline = _deadline(options)
    deadline.stop()
    return _result(unstarted_state(SolveContext(problem, options, Stages(), deadline), []), {})


def _shared_out(options: Options, count: int) -> Options:
    """Give each of several tasks its part of the limits on CPU time and work."""
    parts = {
        name: limit / count
        for name in ("cpu_limit", "work_limit")
        if (limit := getattr(options, name)) is not None
    }
    return replace(options, executor=None, **parts)


def _solve_task(task: _Task) -> Result:
    """Solve a problem in a worker; relaxation and solution stay there, nothing rests on them."""
    problem, options, start, until = task
    if until is not None:
        options = replace(options, time_limit=max(until - time.time(), _LEAST))
    return replace(solve(problem, options, start=start), relaxation=None, solution=None)


def _with_executor(options: Options | None, executor: Executor | None) -> Options:
    options = Options() if options is None else options
    if not isinstance(options, Options):
        raise ProblemError(f"options: found {type(options).__name__}, expected sp.Options")
    return options if executor is None else replace(options, executor=executor)


@dataclass(frozen=True, eq=False)
class _Several:
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
        return _solve_one(context, self.starts, model)


def _check(problem: Problem, objectives: list[Polynomial], options: Options) -> None:
    _check_problem(problem, options)
    for number, objective in enumerate(objectives):
        if not isinstance(objective, Polynomial) or objective.dimension != problem.dimension:
            raise ProblemError(
                f"objectives[{number}]: expected a Polynomial in {problem.dimension} variables"
            )
    check_degrees(problem, objectives)
    if options.gap_kind == "width":
        paired = pairs(objectives)
        for number in range(len(objectives)):
            if number not in paired:
                raise ProblemError(
                    f"Options.gap_kind: found 'width', but objectives[{number}] has no "
                    "negative among the other objectives"
                )


def _check_callable(field: str, given: object) -> None:
    if given is not None and not callable(given):
        raise ProblemError(f"{field}: found {type(given).__name__}, expected a function")


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
    check_degrees(problem)


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
    except (TypeError, ValueError, OverflowError):
        raise ProblemError(f"start: found {start!r}, expected numbers") from None
    if vector.shape != (problem.dimension,) or not np.all(np.isfinite(vector)):
        raise ProblemError(
            f"start: found shape {vector.shape}, expected ({problem.dimension},) finite numbers"
        )
    return [vector]


def _solve_one(
    context: SolveContext, starts: list[NDArray[Any]], shared: Model | None
) -> SearchState:
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
            if not _falls(context):
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
    if _closed_box(problem) or problem.violation(x) > 0.0:
        return context
    there = replace(context, best=prove_feasible(problem, x))
    return there if _falls(there) else context


def _closed_box(problem: Problem) -> bool:
    return bool(np.all(np.isfinite(problem.lower) & np.isfinite(problem.upper)))


def _random(context: SolveContext, box: Interval) -> Iterator[NDArray[np.float64]]:
    """Yield random starts; a box is found only if they are asked for."""
    found = box_of_starts(context)
    tightened = found is not None
    yield from random_starts(context.problem, found or box, context.options, tightened=tightened)


def _verified(state: SearchState, known: dict[Any, Any]) -> SearchState:
    """Lower the claims of a state, also those on the way, to what verification confirms.

    An interrupt here asks for the result, which this is the last step to; a second one ends it.
    Where time ends before the verification of a tree does, the best bound without the tree is
    claimed.
    """
    context, outcome = state.context, state.outcome
    problem, certificate = context.problem, outcome.certificate
    if certificate is None:
        return state
    with context.stages.stage("verify"):
        try:
            with context.deadline.kept(_VERIFIED):
                settled = certificate.settled(problem, known)
        except KeyboardInterrupt:
            context.deadline.stop()
            settled = certificate.settled(problem, known)
        except LimitReached:
            simpler = outcome.simpler or certificate  # of one node, which takes little time
            settled = simpler.settled(problem, known)
            if outcome.simpler is not None:
                state = replace(state, notes=(*state.notes, _UNVERIFIED))
    if settled is certificate:
        return state
    most = lower_bound(settled)
    history = tuple(
        replace(entry, lower_bound=min(entry.lower_bound, most)) for entry in state.history
    )
    return replace(state, outcome=replace(outcome, certificate=settled), history=history)


def _result(state: SearchState, known: dict[Any, Any]) -> Result:
    """Make the result once more where the user interrupts that: all is proved by then."""
    try:
        return _made(state, known)
    except KeyboardInterrupt:
        state.context.deadline.stop()
        return _made(state, known)


def _made(state: SearchState, known: dict[Any, Any]) -> Result:
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
        moments=_moments(bound),
        ray=ray,
    )


def _moments(bound: CertifiedBound) -> NDArray[np.float64] | None:
    """Read the moments of degree one, whatever the solver's status; None if not finite."""
    scaled, solution = bound.model.scaled, bound.solution
    if bound.relaxation is None or scaled is None or solution is None:
        return None
    if not np.isfinite(solution.y).all():
        return None
    return scaled.scaling.point(means(bound.relaxation, solution.y))


_Status = tuple[Status, tuple[str, ...], NDArray[np.float64] | None]


def _status(state: SearchState, lower: float) -> _Status:
    context, bound, deadline = state.context, state.outcome, state.context.deadline
    notes = [*bound.model.notes, *state.notes, *context.notes]
    notes += rounding_note(context.problem.rounding)
    notes += _lost_by_the_proof(context, bound, lower)
    if deadline.stopped:
        notes.append(INTERRUPTED)
    status, ray = Status.BOUNDED, None
    if lower == np.inf:
        status = Status.INFEASIBLE
    elif context.closed(lower):
        status = Status.OPTIMAL
    elif lower == -np.inf and (ray := _ray(context)) is not None:
        status = Status.UNBOUNDED
    elif deadline.stopped:
        status = Status.INTERRUPTED
    elif deadline.over or deadline.cut:
        status = Status.LIMIT
    elif lower == -np.inf:
        status, note = _unproved(context.problem, bound)
        notes += note
    return status, tuple(notes), ray


def _falls(context: SolveContext) -> bool:
    """Check for a proved ray from the attained point, without a search for its direction."""
    problem, best = context.problem, context.best
    return best is not None and not _closed_box(problem) and falling_ray(problem, best) is not None


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
    largest = float(np.abs(context.problem.objective.coefficients).max(initial=0.0))
    if largest > _CANCELLING * (1.0 + abs(context.upper)) and np.isfinite(context.upper):
        where = f"it is what is left of coefficients up to {largest:.2g}, whose rounding is larger"
    return [f"the relaxation's value is {value:.8g}, the proof loses the rest: {where}"]


def _listed(problem: Problem, variables: NDArray[Any]) -> str:
    """Names of variables, the first eight."""
    names = ", ".join(problem.names[v] for v in variables[:8])
    return names + (f" and {variables.size - 8} more" if variables.size > 8 else "")


def _ray(context: SolveContext) -> NDArray[np.float64] | None:
    """Find a direction along which the objective provably falls without limit."""
    problem, best = context.problem, context.best
    if best is None or _closed_box(problem):
        return None
    ray = falling_ray(problem, best)
    direction = falling_direction(problem) if ray is None else None
    return ray if direction is None else falling_ray(problem, best, direction)


def _unproved(problem: Problem, bound: CertifiedBound) -> tuple[Status, list[str]]:
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
