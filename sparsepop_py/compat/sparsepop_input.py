"""What ``sparsePOP`` is called with: a file, four structs, a problem, or what makes them."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sparsepop_py import problems
from sparsepop_py.algebra.polynomial import Constraint, Kind
from sparsepop_py.compat.structs import from_structs
from sparsepop_py.errors import ProblemError
from sparsepop_py.io.gams import read_gms
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling

__all__ = ["Input", "read_input", "with_tolerance"]

_FORMS = "sparsePOP(objPoly, ineqPolySys, lbd, ubd, param) or sparsePOP('file.gms', param)"
_CALL = re.compile(r"(?:(?P<module>[\w.]+):)?(?P<name>[A-Za-z_]\w*)(?:\((?P<given>.*)\))?", re.S)


@dataclass(frozen=True, eq=False)
class Input:
    """A problem, what it is called in reports, and CPU seconds of forming a sum of squares."""

    problem: Problem
    source: str | None
    single: float | None


def read_input(
    first: Any, ineqPolySys: Any, lbd: Any, ubd: Any, param: Any
) -> tuple[Callable[[], Input], Any]:
    """How to read the problem, and ``param`` wherever it stands.

    Raises
    ------
    ProblemError
        If the arguments do not fit.
    """
    named = isinstance(first, (str, os.PathLike, Problem)) or callable(first)
    if not named:
        absent = [name for name, given in (("lbd", lbd), ("ubd", ubd)) if given is None]
        if absent:
            raise ProblemError(f"sparsePOP: found no {' and no '.join(absent)}, expected {_FORMS}")
        return (lambda: _of_structs((first, ineqPolySys, lbd, ubd), None)), param
    if lbd is not None or ubd is not None or (ineqPolySys is not None and param is not None):
        raise ProblemError(
            f"sparsePOP: found more than a problem and its parameters, expected {_FORMS}"
        )
    param = param if ineqPolySys is None else ineqPolySys
    if isinstance(first, Problem):
        return (lambda: Input(first, None, None)), param
    if callable(first):
        return (lambda: _made(first(), getattr(first, "__name__", "a function"))), param
    if Path(first).suffix.lower() == ".gms":
        return (lambda: Input(read_gms(first), str(first), None)), param
    function, arguments = _function(str(first))
    return (lambda: _made(function(*arguments), str(first))), param


def _of_structs(given: tuple[Any, ...], source: str | None) -> Input:
    start = time.process_time()
    problem = from_structs(*given)
    spent = time.process_time() - start
    return Input(problem, source, spent if problem.squares else None)


def _made(given: Any, source: str) -> Input:
    """What a function returned."""
    if isinstance(given, Problem):
        return Input(given, source, None)
    if not isinstance(given, (tuple, list)) or len(given) != 4:
        raise ProblemError(
            f"{source}: found {type(given).__name__}, expected a Problem or "
            "objPoly, ineqPolySys, lbd, ubd"
        )
    return _of_structs(tuple(given), source)


def _function(text: str) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """The function that 'module:name(arguments)' names; without a module, one of ``problems``."""
    found = _CALL.fullmatch(text.strip())
    expected = (
        "the name of a .gms file, 'module:function', or a function of sparsepop_py.problems, "
        "with arguments that are literals or without"
    )
    if found is None:
        raise ProblemError(f"objPoly: found the string {text!r}, expected {expected}")
    try:
        module = importlib.import_module(found["module"]) if found["module"] else problems
    except ImportError as error:
        raise ProblemError(
            f"objPoly: found the string {text!r}, expected {expected}: {error}"
        ) from error
    function = getattr(module, found["name"], None)
    if not callable(function):
        raise ProblemError(f"objPoly: found the string {text!r}, expected {expected}")
    try:
        tree = ast.literal_eval(f"({found['given']},)") if (found["given"] or "").strip() else ()
    except (ValueError, SyntaxError, TypeError):
        raise ProblemError(f"objPoly: found the string {text!r}, expected {expected}") from None
    _check_arguments(text, function, tuple(tree))
    return function, tuple(tree)


def _check_arguments(text: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        accepted = inspect.signature(function)
    except ValueError:
        return  # it does not say what it takes
    try:
        accepted.bind(*arguments)
    except TypeError as error:
        names = ", ".join(accepted.parameters)
        raise ProblemError(
            f"objPoly: found the string {text!r} ({error}), expected arguments as in "
            f"{function.__name__}({names})"
        ) from None


def with_tolerance(problem: Problem, tolerance: float, scaled: bool) -> Problem:
    """The problem with h = 0 relaxed to 0 <= h <= tolerance, in scaled rows where ``scaled``.

    Its feasible set contains the original one, so its bounds hold there.
    """
    if not tolerance or not problem.equality.any():
        return problem
    sizes = np.ones(len(problem.constraints))
    if scaled:
        box = Interval(problem.lower, problem.upper)
        whole = Scaled.of(problem, Scaling.of_bounds(box), (problem.objective,), whole=True)
        sizes = whole.row_sizes
    rows: list[Constraint] = []
    for constraint, size in zip(problem.constraints, sizes.tolist(), strict=True):
        if constraint.kind is Kind.ZERO:
            h = constraint.polynomial
            rows.append(Constraint(h, Kind.NONNEGATIVE, constraint.name))
            rows.append(Constraint(tolerance * size - h, Kind.NONNEGATIVE, constraint.name))
        else:
            rows.append(constraint)
    return Problem(
        problem.objective,
        rows,
        problem.lower,
        problem.upper,
        problem.names,
        problem.squares or None,
        problem.sense,
    )
