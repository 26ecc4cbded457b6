"""The pipeline: from a problem to a proved bound, an attained point, the gap and a status.

    search -> box -> scale -> cliques -> relax -> assemble -> solve -> certify -> extract

The stages are in :mod:`sparsepop_py.rungs`, their repetition in :mod:`sparsepop_py.ladder`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .boxes import find_box, finite
from .errors import ProblemError, SparsePOPError
from .feasibility import ProvedPoint
from .ladder import Climbed, attain, climb
from .options import Options
from .polynomial import Polynomial
from .presolve.propagation import is_empty
from .problem import Problem
from .progress import Stages
from .refinement import starting_points
from .result import Point, Result, Status
from .rounding import Interval
from .rungs import Bound, Clock, Model, Task, closed, level, relaxed
from .unbounded import falling_ray

__all__ = ["solve", "solve_each"]


def solve(
    problem: Problem, options: Options | None = None, *, start: NDArray | None = None
) -> Result:
    """Proved lower bound, attained upper bound and minimisers of a polynomial problem.

    Parameters
    ----------
    problem : Problem
    options : Options, optional
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
    return _solve_one(
        problem, options, _start_vectors(problem, start), None, Stages(options.progress)
    )


def solve_each(
    problem: Problem,
    objectives: Sequence[Polynomial],
    options: Options | None = None,
    *,
    start: NDArray | None = None,
) -> list[Result]:
    """Solve for several objectives over one feasible set, with one relaxation for all.

    The shared box uses arguments that hold for all objectives (no cut-off). Where it is
    not finite in every variable, each objective gets a box and a relaxation of its own.

    Parameters
    ----------
    problem : Problem
        Its own objective is ignored.
    objectives : sequence of Polynomial
    options, start
        As in :func:`solve`.

    Returns
    -------
    list of Result
        One for each objective, about the problem with that objective.

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
    objectives = list(objectives)
    for number, objective in enumerate(objectives):
        if not isinstance(objective, Polynomial) or objective.dimension != problem.dimension:
            raise ProblemError(
                f"objectives[{number}]: expected a Polynomial in {problem.dimension} variables"
            )
    if not objectives:
        return []
    stages, starts = Stages(options.progress), _start_vectors(problem, start)
    with stages.stage("presolve"):
        proof, box = find_box(problem.with_objective(objectives[0]), None, options)
    model = None
    if (finite(box) or options.effort == "plain") and not is_empty(box):
        with stages.stage("relax"):
            model = relaxed(problem, tuple(objectives), Model(proof, box), options)
    results: list[Result] = []
    for objective in objectives:
        own = Stages(options.progress)
        own.seconds.update(stages.seconds if not results else {})
        results.append(_solve_one(problem.with_objective(objective), options, starts, model, own))
    return results


def _start_vectors(problem: Problem, start: NDArray | None) -> list[NDArray[np.float64]]:
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
    problem: Problem,
    options: Options,
    starts: list[NDArray],
    shared: Model | None,
    stages: Stages,
) -> Result:
    task = Task(problem, options, stages, Clock(options.time_limit))
    with stages.stage("search"):
        box = shared.box if shared else Interval(problem.lower, problem.upper)
        best, near = attain(problem, starts + _random_starts(problem, box, options), options)
        task = replace(task, best=best)
    climbed = climb(task, near, shared)
    stages.close()
    return _result(climbed)


def _random_starts(problem: Problem, box: Interval, options: Options) -> list[NDArray]:
    n = problem.dimension
    count = 24 if n <= 12 else 12 if n <= 40 else 2 if n <= 300 else 0
    if options.effort != "plain":
        _, tighter = find_box(problem, None, options) if n <= 300 else (None, box)
        box = box if is_empty(tighter) else tighter
    return starting_points(problem, box, count, options.seed)


def _result(climbed: Climbed) -> Result:
    task, bound, near = climbed.task, climbed.outcome, climbed.near
    problem, best = task.problem, task.best
    lower = level(bound.certificate)
    upper = best.value if best is not None else np.inf
    if lower > upper:
        raise SparsePOPError(
            f"contradiction: a bound of {lower!r} is proved and {upper!r} is attained; "
            "this is a defect of the program, please report the problem"
        )
    notes = list(bound.model.notes)
    status = Status.BOUNDED
    if lower == np.inf:
        status = Status.INFEASIBLE
    elif closed(task, bound):
        status = Status.OPTIMAL
    elif lower == -np.inf:
        status, note = _unproved(problem, bound, best)
        notes += note
    elif task.clock.over:
        status = Status.LIMIT
    points = _points(problem, best, near)
    return Result(
        problem=problem,
        options=task.options,
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
        history=climbed.history,
        timings=task.stages.seconds,
        notes=tuple(notes),
    )


def _unproved(problem: Problem, bound: Bound, best: ProvedPoint | None) -> tuple[Status, list[str]]:
    if best is not None:
        ray = falling_ray(problem, best)
        if ray is not None:
            shown = ", ".join(f"{v:g}" for v in ray[:8]) + (", ..." if ray.size > 8 else "")
            return Status.UNBOUNDED, [f"the objective falls along the ray ({shown}) from x"]
    box = bound.model.box
    endless = np.flatnonzero(np.isinf(box.lo) | np.isinf(box.hi))
    if endless.size:
        names = ", ".join(problem.names[v] for v in endless[:8])
        more = f" and {endless.size - 8} more" if endless.size > 8 else ""
        return Status.UNPROVED, [f"no finite bounds are known for {names}{more}"]
    return Status.FAILED, []


def _points(problem: Problem, best: ProvedPoint | None, near: list[NDArray]) -> tuple[Point, ...]:
    """Distinct candidates, the attained one first, then by value."""
    vectors = [best.x] if best is not None else []
    least = min([problem.objective(x) for x in vectors + near], default=np.inf)
    near = [x for x in near if problem.objective(x) <= least + 1e-3 * (1.0 + abs(least))]
    rated = sorted(near, key=problem.objective)
    for x in rated:
        if all(np.abs(x - kept).max() > 1e-4 * (1.0 + np.abs(kept).max()) for kept in vectors):
            vectors.append(x)
        if len(vectors) >= 16:
            break
    return tuple(Point(x, problem.objective(x), problem.violation(x)) for x in vectors)
