"""The MATLAB face: ``sparsePOP`` with the calls, fields and files of SparsePOP 3.03.

The output differs from the original's in what its numbers mean: ``SDPobjValue`` is
proved, whatever the solver returned, and the raw value of the SDP is ``POP.solverValue``.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ProblemError
from .formats.gms import read_gms
from .monomials import evaluate
from .parameters import Parameters, read_parameters
from .problem import Problem
from .relaxation import Relaxation
from .result import Result, Status
from .solve import solve
from .sparsepop_output import CpuTime, POPOutput, SDPInfo, SolverInfo, SparsePOPOutput
from .sparsepop_report import write_report
from .structs import from_structs

__all__ = ["sparsePOP"]

_FORMS = "sparsePOP(objPoly, ineqPolySys, lbd, ubd, param) or sparsePOP('file.gms', param)"


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
    objPoly : struct, list of structs, path or Problem
        A list of two or more polynomials is a least-squares problem. A path ends in
        ``.gms``; then, and for a :class:`Problem`, ``param`` is the second argument.
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
    start = time.process_time()
    source, param = _source(objPoly, ineqPolySys, lbd, ubd, param)
    parameters = read_parameters(param, strict, stacklevel=3)
    if isinstance(objPoly, Problem):
        problem = objPoly
    elif source:
        problem = read_gms(source)
    else:
        problem = from_structs(objPoly, ineqPolySys, lbd, ubd)
    read = time.process_time() - start
    result = solve(problem, parameters.options)
    sign = -1.0 if problem.sense == "max" else 1.0
    output = SparsePOPOutput(
        replace(parameters, relaxOrder=_order_used(parameters, result)),
        sign * result.lower_bound,
        _point(result, bool(parameters.POPsolver), sign),
        _times(result, read),
        _solver_info(result),
        _sizes(result),
    )
    write_report(output, source, parameters.printLevel[0])
    return output


# ---- input ------------------------------------------------------------------------------


def _source(
    first: Any, ineqPolySys: Any, lbd: Any, ubd: Any, param: Any
) -> tuple[str | os.PathLike[str] | None, Any]:
    """The file, if the first argument names one, and param wherever it stands."""
    if not isinstance(first, (str, os.PathLike, Problem)):
        absent = [name for name, given in (("lbd", lbd), ("ubd", ubd)) if given is None]
        if absent:
            raise ProblemError(f"sparsePOP: found no {' and no '.join(absent)}, expected {_FORMS}")
        return None, param
    if lbd is not None or ubd is not None or (ineqPolySys is not None and param is not None):
        raise ProblemError(
            f"sparsePOP: found more than a problem and its parameters, expected {_FORMS}"
        )
    if isinstance(first, str) and Path(first).suffix.lower() != ".gms":
        raise ProblemError(
            f"objPoly: found the string {first!r}, expected the name of a .gms file or a "
            "struct; calls written as strings are not evaluated"
        )
    param = param if ineqPolySys is None else ineqPolySys
    return (None if isinstance(first, Problem) else first), param


def _order_used(parameters: Parameters, result: Result) -> int:
    if result.relaxation is not None:
        return result.relaxation.order
    return max(parameters.relaxOrder, (result.problem.degree + 1) // 2)


# ---- output -----------------------------------------------------------------------------


def _point(result: Result, refine: bool, sign: float) -> POPOutput:
    problem, attained = result.problem, result.attained
    refined = attained.x if refine and attained is not None else None
    ends = (sign * result.lower_bound, sign * result.upper_bound)
    if result.status is Status.INFEASIBLE:
        ends = (ends[0], ends[0])
    x, xL = _shown(problem, result.x, sign), _shown(problem, refined, sign)
    return POPOutput(
        *x,
        *xL,
        lowerBound=min(ends),
        upperBound=max(ends),
        status=result.status,
        certificate=result.certificate,
        solverValue=None if np.isnan(result.solver_value) else sign * result.solver_value,
        result=result,
    )


def _shown(
    problem: Problem, x: NDArray[np.float64] | None, sign: float
) -> tuple[NDArray[np.float64], float | None, float | None, float | None]:
    """A point with its objective and its two errors."""
    if x is None:
        return np.zeros(0), None, None, None
    absolute, scaled = _errors(problem, x)
    return x.copy(), sign * problem.objective(x), absolute, scaled


def _errors(problem: Problem, x: NDArray[np.float64]) -> tuple[float, float]:
    """Violations as the original states them: 0 or negative, absolute and scaled."""
    rows = problem.rows
    values = rows.values(x)
    size = np.ones(rows.size)
    terms = np.abs(evaluate(rows.words, x[None, :]).ravel() * rows.coefficients)
    np.maximum.at(size, rows.row, terms)
    short = np.where(problem.equality, -np.abs(values), values)
    bounds = np.concatenate([x - problem.lower, problem.upper - x])
    ends = np.abs(np.concatenate([problem.lower, problem.upper]))
    ends = np.maximum(np.where(np.isfinite(ends), ends, 1.0), np.tile(np.abs(x), 2))
    least, entries = problem.matrices.least_eigenvalue(x[None]), problem.matrices.system.values(x)
    short = np.concatenate([short, bounds, least])
    largest = np.maximum(np.abs(entries).max(keepdims=True), 1.0)
    size = np.concatenate([size, np.maximum(ends, 1.0), largest])
    return float(short.min(initial=0.0)), float((short / size).min(initial=0.0))


def _times(result: Result, read: float) -> CpuTime:
    spent = result.timings
    conversion = sum(spent.get(stage, 0.0) for stage in ("presolve", "relax", "assemble"))
    local = sum(spent.get(stage, 0.0) for stage in ("search", "extract"))
    solver, certify = spent.get("solve", 0.0), spent.get("certify", 0.0)
    return CpuTime(conversion, solver, certify, read, local, conversion + solver + certify)


def _solver_info(result: Result) -> SolverInfo:
    solution = result.solution
    if solution is None:
        return SolverInfo("", 0, 0, 0, 0, 0.0, None, None, "no SDP was solved")
    return SolverInfo(
        solution.solver,
        solution.iterations,
        0 if solution.status in ("solved", "infeasible", "unbounded") else 1,
        int(solution.status == "unbounded"),
        int(solution.status == "infeasible"),
        solution.seconds,
        None,
        solution.residual,
        solution.detail,
    )


def _sizes(result: Result) -> SDPInfo:
    problem, relaxation = result.problem, result.relaxation
    fixed = np.flatnonzero(problem.lower == problem.upper)
    linear, free, blocks = 0, 0, np.zeros(0, int)
    if relaxation is not None:
        counts = relaxation.block_sizes
        blocks = np.repeat(sorted(counts), [counts[size] for size in sorted(counts)])
        linear, free = counts[1], relaxation.equality_rows
        blocks = blocks[blocks > 1].astype(int)
    sign = -1.0 if problem.sense == "max" else 1.0
    return SDPInfo(
        relaxation.moments.shape[0] if relaxation is not None else 0,
        free + linear + int((blocks**2).sum()),
        _nonzeros(relaxation) if relaxation is not None else 0,
        free,
        linear,
        (),
        tuple(blocks.tolist()),
        _infeasible_switch(result, fixed.size == problem.dimension),
        sign * problem.objective.constant_term,
        problem.dimension,
        problem.dimension - fixed.size,
        np.stack([fixed + 1.0, problem.lower[fixed]], axis=1),
    )


def _nonzeros(relaxation: Relaxation) -> int:
    """Nonzeros of A, where an off-diagonal entry of a block has two columns."""
    weight = [np.zeros(0, int)]
    for group in relaxation.groups:
        i, j = group.pairs
        each = np.ones(group.size, int) if group.free else np.where(i == j, 1, 2)
        weight.append(np.tile(each, group.count))
    entries = relaxation.entries
    row = np.repeat(np.arange(relaxation.rows), np.diff(entries.indptr))
    return int(np.concatenate(weight)[row][entries.indices > 0].sum())


def _infeasible_switch(result: Result, all_fixed: bool) -> float:
    if all_fixed and result.status is Status.INFEASIBLE:
        return 2.0
    if all_fixed and result.attained is not None:
        return -2.0
    if result.solution is None:
        return 1.0 if result.status is Status.INFEASIBLE else 0.0
    return 0.5 if result.solution.status in ("infeasible", "unbounded") else 0.0
