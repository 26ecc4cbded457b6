"""The MATLAB face: ``sparsePOP`` with the calls, fields and files of SparsePOP 3.03.

The output differs from the original's in what its numbers mean: ``SDPobjValue`` is
proved, whatever the solver returned, and the raw value of the SDP is ``POP.solverValue``.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py import problems
from sparsepop_py.algebra.monomials import evaluate
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total
from sparsepop_py.bounding.order_bound import Model, build_relaxations
from sparsepop_py.budget import Deadline, cpu_seconds
from sparsepop_py.compat.error_bounds import error_bounds, index_sets
from sparsepop_py.compat.output import CpuTime, POPOutput, SparsePOPOutput
from sparsepop_py.compat.param import Parameters, read_parameters
from sparsepop_py.compat.report import check_files, write_files, write_report
from sparsepop_py.compat.sdp_sizes import BuiltSDP, sizes_of, solver_info
from sparsepop_py.compat.structs import from_structs
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import ProblemError
from sparsepop_py.io.gams import read_gms
from sparsepop_py.local_search.incumbents import search_incumbent
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.presolve.size_limits import check_degrees
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.moment import least_order
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["Input", "in_the_given_problem", "read_input", "sparsePOP", "with_tolerance"]

_FORMS = "sparsePOP(objPoly, ineqPolySys, lbd, ubd, param) or sparsePOP('file.gms', param)"
_CALL = re.compile(r"(?:(?P<module>[\w.]+):)?(?P<name>[A-Za-z_]\w*)(?:\((?P<given>.*)\))?", re.S)


@dataclass(frozen=True, eq=False)
class Input:
    """Problem with its name in reports, and CPU seconds of forming squares."""

    problem: Problem
    source: str | None
    single: float | None


def read_input(
    first: Any, ineqPolySys: Any, lbd: Any, ubd: Any, param: Any
) -> tuple[Callable[[], Input], Any]:
    """Recognise the form of the arguments; return a reader of the problem and ``param``.

    Raises
    ------
    ProblemError
        If the arguments do not fit.
    """
    is_function = callable(first) and not isinstance(first, Polynomial)
    named = isinstance(first, (str, os.PathLike, Problem)) or is_function
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
        return (lambda: Input(_polynomial(read_gms(first)), str(first), None)), param
    function, arguments = _function(str(first))
    return (lambda: _made(function(*arguments), str(first))), param


def _polynomial(problem: Problem | RationalProblem) -> Problem:
    if isinstance(problem, RationalProblem):
        raise ProblemError(
            "sparsePOP: found a problem with ratios, expected polynomials: use sparsepop_py.solve"
        )
    return problem


def _of_structs(given: tuple[Any, ...], source: str | None) -> Input:
    start = cpu_seconds()
    problem = from_structs(*given)
    spent = cpu_seconds() - start
    return Input(problem, source, spent if problem.squares else None)


def _made(given: Any, source: str) -> Input:
    """Convert the value of a function to a problem."""
    if isinstance(given, Problem):
        return Input(given, source, None)
    if not isinstance(given, (tuple, list)) or len(given) != 4:
        raise ProblemError(
            f"{source}: found {type(given).__name__}, expected a Problem or "
            "objPoly, ineqPolySys, lbd, ubd"
        )
    return _of_structs(tuple(given), source)


def _function(text: str) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Look up the function that 'module:name(arguments)' names.

    Without a module, one of ``problems``.
    """
    found = _CALL.fullmatch(text.strip())
    expected = (
        "the name of a .gms file, 'module:function', or a function of sparsepop_py.problems, "
        "with arguments that are literals or without"
    )
    if found is None:
        raise ProblemError(f"objPoly: found the string {text!r}, expected {expected}")
    try:
        module = importlib.import_module(found["module"]) if found["module"] else problems
    except (ImportError, TypeError, ValueError) as error:  # relative names, empty ones
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
    """Relax h = 0 to 0 <= h <= tolerance, in scaled rows where ``scaled``.

    The feasible set contains the original one, so bounds hold there.
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
            rows.append(
                Constraint(_at_most(h, tolerance * size), Kind.NONNEGATIVE, constraint.name)
            )
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


def _at_most(h: Polynomial, tolerance: float) -> Polynomial:
    """Build the row tolerance - h; however its constant is rounded, h = 0 stays."""
    constant = Fraction(tolerance) - Fraction(h.constant_term)
    return total([-(h - h.constant_term), float(constant)])


def sparsePOP(
    objPoly: Any,
    ineqPolySys: Any = None,
    lbd: Any = None,
    ubd: Any = None,
    param: Any = None,
    *,
    strict: bool = False,
) -> SparsePOPOutput:
    """Solve a polynomial optimization problem, called like the original.

    Parameters
    ----------
    objPoly : struct, list of structs, path, function, its name or Problem
        A list of two or more polynomials is a least-squares problem. A path ends in
        ``.gms``. A function returns ``objPoly, ineqPolySys, lbd, ubd`` or a Problem; it is
        called without arguments, or named as ``"module:function(3, 2)"``, or without a
        module as one of :mod:`sparsepop_py.problems`. In all but the first two cases
        ``param`` is the second argument.
    ineqPolySys : list of structs
        ``[]`` or None without constraints.
    lbd, ubd : array_like (n,)
        Magnitudes of 1e10 or more stand for no bound.
    param : struct, optional
        A dict, namespace, dataclass or MATLAB struct; see the table of parameters.
    strict : bool
        Unknown fields of ``param`` are errors instead of warnings.

    Returns
    -------
    SparsePOPOutput
        ``(param, SDPobjValue, POP, cpuTime, SDPsolverInfo, SDPinfo)``. A report is
        written to standard output unless ``param.printLevel`` is 0.

    Raises
    ------
    ProblemError
        If the arguments, a struct or a parameter is malformed.
    FormatError
        If a file cannot be read.
    SolverNotFound
        If the chosen solver is not installed.

    Warns
    -----
    ParameterWarning
        For parameters that are unknown or have no effect.

    Examples
    --------
    >>> square = {"typeCone": 1, "dimVar": 1, "degree": 2, "noTerms": 2,
    ...           "supports": [[1], [2]], "coef": [-2.0, 1.0]}
    >>> param, value, POP, *_ = sparsePOP(square, [], [-5], [5], {"printLevel": 0})
    >>> abs(value + 1) < 1e-6, POP.status, POP.xVect.round(6)
    (True, <Status.OPTIMAL: 'OPTIMAL'>, array([1.]))
    """
    start = cpu_seconds()
    read, param = read_input(objPoly, ineqPolySys, lbd, ubd, param)
    parameters = read_parameters(param, strict, stacklevel=3)
    options = parameters.options
    deadline = Deadline(options.time_limit, None, options.cpu_limit)
    given = read()
    problem = given.problem
    _check_sizes(parameters, problem)
    check_files(parameters)
    spent = cpu_seconds() - start
    larger = with_tolerance(problem, parameters.eqTolerance, bool(parameters.scalingSW))
    asked = bool(parameters.SDPsolverSW)
    result = solve(larger, parameters.options) if asked else _unsolved(larger, parameters.options)
    built = BuiltSDP.of(result)
    sign = -1.0 if problem.sense == "max" else 1.0
    point = _point(problem, result, built, parameters, sign)
    output = SparsePOPOutput(
        replace(parameters, relaxOrder=_order_used(parameters, problem)),
        sign * result.lower_bound if asked else None,
        _with_error_bounds(point, problem, _remaining(parameters, deadline), sign),
        _times(result, spent, given),
        solver_info(built, asked, parameters.options.accuracy, point.status is Status.OPTIMAL),
        sizes_of(result, built),
    )
    write_report(output, given.source, parameters.printLevel[0])
    write_files(output, given.source, parameters, built)
    return output


def _check_sizes(parameters: Parameters, problem: Problem) -> None:
    """Check degrees, and parameters that depend on the number of variables."""
    check_degrees(problem)
    factor, n = parameters.multiCliquesFactor, problem.dimension
    if n < factor < np.inf:
        raise ProblemError(
            f"param.multiCliquesFactor: found {factor:g}, expected a number from 0 to dimVar "
            f"({n}), or a string"
        )
    index_sets(parameters.errorBdIdx, n)


def _order_used(parameters: Parameters, problem: Problem) -> float:
    return max(parameters.relaxOrder, least_order(problem))


def _unsolved(problem: Problem, options: Options) -> Result:
    """Build the SDP without solving it."""
    stages = Stages(options.progress)
    with stages.stage("presolve"):
        model = Model(*find_box(problem, None, options))
    with stages.stage("relax"):
        model = build_relaxations(problem, (problem.objective,), model, options)
    built = "SDPsolverSW = 0: the SDP was built and not solved" if model.relaxations else None
    stages.close()
    return Result(
        problem=problem,
        options=options,
        status=Status.UNPROVED,
        lower_bound=-np.inf,
        upper_bound=np.inf,
        x=None,
        certificate=None,
        attained=None,
        points=(),
        relaxation=model.relaxations[-1] if model.relaxations else None,
        solution=None,
        solver_value=np.nan,
        timings=stages.seconds,
        notes=(*model.notes, built) if built else model.notes,
    )


# ---- output -----------------------------------------------------------------------------


def _point(
    problem: Problem, result: Result, built: BuiltSDP | None, parameters: Parameters, sign: float
) -> POPOutput:
    attained, status = result.attained, result.status
    if result.problem is not problem:
        attained, status = in_the_given_problem(problem, result)
    refined = attained.x if parameters.POPsolver and attained is not None else None
    upper = attained.value if attained is not None else np.inf
    upper = -np.inf if status is Status.UNBOUNDED else upper
    ends = (sign * result.lower_bound, sign * upper)
    if status is Status.INFEASIBLE:
        ends = (ends[0], ends[0])
    shown = _vector(problem, result, built) if parameters.SDPsolverSW else None
    x, xL = _shown(problem, shown, sign), _shown(problem, refined, sign)
    return POPOutput(
        *x,
        *xL,
        lowerBound=min(ends),
        upperBound=max(ends),
        status=status,
        certificate=result.certificate,
        solverValue=_solver_value(result, sign),
        result=result,
        objValueScaled=x[1],
        violation=None if x[2] is None else 0.0 - x[2],
    )


def _solver_value(result: Result, sign: float) -> float | None:
    """Read the solver's value, infinite where it reports infeasibility."""
    status = "" if result.solution is None else result.solution.status
    value = {"unbounded": -np.inf, "infeasible": np.inf}.get(status, result.solver_value)
    return None if np.isnan(value) else sign * value


def _vector(problem: Problem, result: Result, built: BuiltSDP | None) -> NDArray[np.float64]:
    """Choose the point to show: first moments or the best point, else near 0."""
    plain = built is not None and built.scaled is not None
    first = built.first_moments() if plain and built is not None else None
    known = (x for x in (first, result.x, result.moments) if x is not None)
    nearest: NDArray[np.float64] = np.clip(0.0, problem.lower, problem.upper)
    return next(known, nearest)


def in_the_given_problem(
    problem: Problem, result: Result, deadline: Deadline | None = None
) -> tuple[ProvedPoint | None, Status]:
    """Prove a point in the given problem from one of the larger set.

    Parameters
    ----------
    problem : Problem
    result : Result
        Of the same objective with relaxed equations.
    deadline : Deadline, optional
        By default the limits of the result's options, from now.

    Returns
    -------
    point : ProvedPoint or None
    status : Status
        What follows for the given problem.
    """
    options = result.options
    if deadline is None:
        deadline = Deadline(options.time_limit, options.work_limit, options.cpu_limit)
    context = SolveContext(problem, options, Stages(False), deadline)
    best, _ = search_incumbent(problem, [] if result.x is None else [result.x], context)
    context = replace(context, best=best)
    if result.status is Status.INFEASIBLE:
        return None, result.status
    if context.closed(result.lower_bound):
        return best, Status.OPTIMAL
    return best, Status.BOUNDED if result.lower_bound > -np.inf else Status.UNPROVED


def _remaining(parameters: Parameters, deadline: Deadline) -> Parameters:
    """Limit what follows the solve to the time that is left."""
    options = parameters.options
    wall = None if options.time_limit is None else deadline.left
    rest = replace(options, time_limit=wall, cpu_limit=deadline.cpu_left)
    return replace(parameters, options=rest)


def _with_error_bounds(
    point: POPOutput, problem: Problem, parameters: Parameters, sign: float
) -> POPOutput:
    sets = index_sets(parameters.errorBdIdx, problem.dimension)
    if not sets or not point.xVect.size:
        return point
    cutoff = parameters.fValueUbd
    end = point.lowerBound if sign < 0 else point.upperBound
    cutoff = sign * (end if cutoff == "" else float(cutoff))
    if not np.isfinite(cutoff):
        return point
    options = replace(parameters.options, effort="presolve", switches=None, progress=False)
    results = error_bounds(problem, point.xVect, cutoff, sets, options)
    zeta = [float(max(0.0, -result.lower_bound)) for result in results]
    return replace(point, xCenter=[point.xVect.copy() for _ in sets], zeta=zeta)


def _shown(
    problem: Problem, x: NDArray[np.float64] | None, sign: float
) -> tuple[NDArray[np.float64], float | None, float | None, float | None]:
    """Evaluate a point: itself, its objective and its two errors."""
    if x is None:
        return np.zeros(0), None, None, None
    absolute, scaled = _errors(problem, x)
    return x.copy(), sign * problem.objective(x), absolute, scaled


def _errors(problem: Problem, x: NDArray[np.float64]) -> tuple[float, float]:
    """Violations as the original states them: 0 or negative, absolute and scaled."""
    rows = problem.rows
    values = rows.values(x)
    size = np.ones(rows.size)
    with np.errstate(over="ignore"):
        terms = np.abs(evaluate(rows.words, x[None, :]).ravel() * rows.coefficients)
    np.maximum.at(size, rows.row, terms)
    short = np.where(problem.equality, -np.abs(values), values)
    short[problem.matrices.constraints] = 0.0  # these follow from matrices, which are below
    bounds = np.concatenate([x - problem.lower, problem.upper - x])
    ends = np.abs(np.concatenate([problem.lower, problem.upper]))
    ends = np.maximum(np.where(np.isfinite(ends), ends, 1.0), np.tile(np.abs(x), 2))
    least, entries = problem.matrices.least_eigenvalue(x[None]), problem.matrices.system.values(x)
    short = np.concatenate([short, bounds, least])
    largest = np.maximum(np.abs(entries).max(keepdims=True), 1.0)
    size = np.concatenate([size, np.maximum(ends, 1.0), largest])
    return float(short.min(initial=0.0)), float((short / size).min(initial=0.0))


def _times(result: Result, read: float, given: Input) -> CpuTime:
    spent = result.timings
    conversion = sum(spent.get(stage, 0.0) for stage in ("presolve", "relax", "assemble"))
    local = sum(spent.get(stage, 0.0) for stage in ("search", "extract", "refine"))
    solver = spent.get("solve", 0.0)
    certify = spent.get("certify", 0.0) + spent.get("verify", 0.0)
    total = conversion + solver + certify
    return CpuTime(conversion, solver, certify, read, local, total, given.single)
