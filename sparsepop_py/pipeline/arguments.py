"""Check the arguments of ``solve`` and ``solve_each``; wrong ones raise with their name."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.budget import Deadline
from sparsepop_py.errors import ProblemError, doubles, shown
from sparsepop_py.options import Options
from sparsepop_py.presolve.size_limits import check_degrees
from sparsepop_py.problem.problem import Problem, check_objective
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.strategy.multi_objective import pairs

__all__ = [
    "check_branching",
    "check_callable",
    "check_objectives",
    "check_problem",
    "deadline_of",
    "options_with",
    "start_vectors",
]


def options_with(options: Options | None, executor: Executor | None) -> Options:
    """Take an executor into options, which have their defaults where they are left out."""
    options = Options() if options is None else options
    if not isinstance(options, Options):
        raise ProblemError(f"options: found {type(options).__name__}, expected sp.Options")
    return options if executor is None else replace(options, executor=executor)


def check_callable(field: str, given: object) -> None:
    """Refuse what is given and no function."""
    if given is not None and not callable(given):
        raise ProblemError(f"{field}: found {type(given).__name__}, expected a function")


def check_branching(problem: Problem | RationalProblem, options: Options) -> None:
    """Refuse numbers in ``branch_on`` that are no variables of the problem."""
    for v in options.branch_on or ():
        if v >= problem.dimension:
            raise ProblemError(
                f"Options.branch_on: found {v}, expected numbers below {problem.dimension}"
            )


def check_problem(problem: Problem, options: Options) -> None:
    """Refuse what is no problem, numbers in ``branch_on`` beyond it, and too large degrees."""
    if not isinstance(problem, Problem):
        raise ProblemError(
            f"problem: found {type(problem).__name__}, expected a Problem, such as "
            "Problem(objective, constraints), parse(text) or read_gms(path)"
        )
    check_branching(problem, options)
    check_degrees(problem)


def check_objectives(problem: Problem, objectives: list[Polynomial], options: Options) -> None:
    """Refuse what is no objective over the problem, and gaps by width without pairs."""
    check_problem(problem, options)
    for number, objective in enumerate(objectives):
        check_objective(objective, problem.dimension, f"objectives[{number}]")
    check_degrees(problem, objectives)
    if options.gap_kind == "width":
        paired = pairs(objectives)
        for number in range(len(objectives)):
            if number not in paired:
                raise ProblemError(
                    f"Options.gap_kind: found 'width', but objectives[{number}] has no "
                    "negative among the other objectives"
                )


def start_vectors(
    problem: Problem | RationalProblem, start: NDArray[Any] | None
) -> list[NDArray[np.float64]]:
    """List the starting vector that is given, if any."""
    if start is None:
        return []
    vector = doubles(start, "start")
    if vector.shape != (problem.dimension,):
        raise ProblemError(
            f"start: found shape {vector.shape}, expected ({problem.dimension},) finite numbers"
        )
    if not np.all(np.isfinite(vector)):
        raise ProblemError(f"start: found {shown(start)}, expected finite numbers")
    return [vector]


def deadline_of(options: Options) -> Deadline:
    """Start the clocks of a solve with the limits of its options."""
    return Deadline(options.time_limit, options.work_limit, options.cpu_limit)
