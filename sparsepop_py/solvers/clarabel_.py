"""Clarabel, an interior-point solver, fed the sum-of-squares form or the moment form.

The sum-of-squares form has the multipliers z as variables,

    minimise  b'z   subject to   A'z = -q,   z in K*,

so that its equality residual, which the safe bound pays for, is driven to rounding
level; the moments y come back as the multipliers of these equalities.

References
----------
P. Goulart, Y. Chen, Clarabel: an interior-point solver for conic programs with quadratic
objectives, 2024.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.budget import charge, importing
from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution, solution
from sparsepop_py.executors.processes import Processes, WorkerLost
from sparsepop_py.solvers.interface import SolverSettings

__all__ = ["STATUS", "Output", "moment_form", "run_clarabel", "squares_form"]

STATUS = {
    "Solved": "solved",
    "AlmostSolved": "almost",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
    "DualInfeasible": "unbounded",
    "AlmostDualInfeasible": "unbounded",
}
_LARGE = 40_000  # entries of A; below, an iteration takes 5 s at most, mostly milliseconds
_SLOWEST = 3e-9  # seconds of an iteration by square entries of A: rings of cliques, much fill-in
_SHARE = 0.25  # of the limit that an iteration may take in this process
_EARLIER = 0.8  # of the limit: then it is to return its iterate, which may prove something
_MOST_ITERATIONS = 2**32 - 1  # that Clarabel counts
_SWAPPED = {"infeasible": "unbounded", "unbounded": "infeasible"}


@dataclass(frozen=True, eq=False)
class Output:
    """Output of Clarabel.

    Parameters
    ----------
    x, z, s : array of float
        Variables, multipliers and slacks.
    iterations : int
    status : str
    seconds : float
        CPU time.
    """

    x: NDArray[np.float64]
    z: NDArray[np.float64]
    s: NDArray[np.float64]
    iterations: int
    status: str
    seconds: float = 0.0


def _settings(asked: SolverSettings) -> Any:
    with importing():
        import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = asked.accuracy
    settings.tol_feas = asked.accuracy
    settings.max_iter = min(asked.max_iterations or 200, _MOST_ITERATIONS)
    if asked.time_limit is not None:
        settings.time_limit = max(asked.time_limit, 1e-3)
    return settings


def _cones(cones: Cones) -> list[Any]:
    with importing():
        import clarabel

    listed: list[Any] = []
    if cones.zero:
        listed.append(clarabel.ZeroConeT(cones.zero))
    if cones.nonnegative:
        listed.append(clarabel.NonnegativeConeT(cones.nonnegative))
    return listed + [clarabel.PSDTriangleConeT(size) for size in cones.psd]


def _run(q: Any, A: Any, b: Any, cones: Cones, settings: SolverSettings) -> Output:
    return run_clarabel(sps.csc_matrix((q.size, q.size)), q, A, b, cones, settings)


def run_clarabel(
    hessian: Any, q: Any, A: Any, b: Any, cones: Cones, settings: SolverSettings
) -> Output:
    """Minimise a convex quadratic function on a cone.

    That is x' hessian x / 2 + q'x subject to A x + s = b, s in K; hessian is upper. Programs that
    are large for their time limit are solved in a process of their own, which ends with the limit:
    Clarabel looks at the clock between iterations alone, and one may take longer than the limit.
    """
    limit = settings.time_limit
    if limit is None or not _may_overrun(A.nnz, limit) or not sys.executable:  # embedded Python
        return _solved(hessian, q, A, b, cones, settings)
    start, earlier = time.monotonic(), replace(settings, time_limit=_EARLIER * limit)
    with Processes(1) as pool:
        try:
            found = pool.submit(_solved, hessian, q, A, b, cones, earlier).result(limit)
        except (TimeoutError, WorkerLost) as error:
            pool.stop()
            charge(time.monotonic() - start)
            status = "MaxTime" if isinstance(error, TimeoutError) else str(error)
            return Output(np.zeros(q.size), np.zeros(b.size), b.copy(), 0, status)
    charge(found.seconds)
    return found


def _may_overrun(entries: int, limit: float) -> bool:
    return entries >= _LARGE and _SLOWEST * entries**2 > _SHARE * limit


def _solved(hessian: Any, q: Any, A: Any, b: Any, cones: Cones, settings: SolverSettings) -> Output:
    with importing():
        import clarabel

    start = time.process_time()
    try:
        found = clarabel.DefaultSolver(hessian, q, A, b, _cones(cones), _settings(settings)).solve()
    except BaseException as error:  # Rust's panics, as where numbers overflow, are no Exception
        if type(error).__name__ != "PanicException":
            raise
        seconds = time.process_time() - start
        return Output(np.zeros(q.size), np.zeros(b.size), b.copy(), 0, f"Panic: {error}", seconds)
    x, z, s = (np.array(part) for part in (found.x, found.z, found.s))
    seconds = time.process_time() - start
    return Output(x, z, s, found.iterations, str(found.status), seconds)


def moment_form(program: ConicProgram, settings: SolverSettings) -> ConicSolution:
    """Solve the program as it stands, moments being the variables."""
    matrix = sps.csc_matrix(program.A)
    result = _run(program.q, matrix, program.b, program.cones, settings)
    return solution(
        program,
        STATUS.get(result.status, "failed"),
        result.x,
        result.z,
        result.iterations,
        result.seconds,
        "clarabel-moment",
        result.status,
    )


def squares_form(program: ConicProgram, settings: SolverSettings) -> ConicSolution:
    """Solve the dual program, multipliers being the variables and moments their prices."""
    rows, zero = program.b.size, program.cones.zero
    conic = sps.csc_array(
        (-np.ones(rows - zero), (np.arange(rows - zero), np.arange(zero, rows))),
        shape=(rows - zero, rows),
    )
    matrix = sps.csc_matrix(sps.vstack([program.A.T, conic]))
    right = np.concatenate([-program.q, np.zeros(rows - zero)])
    cones = Cones(program.q.size, program.cones.nonnegative, program.cones.psd)
    result = _run(program.b, matrix, right, cones, settings)
    seen = STATUS.get(result.status, "failed")
    return solution(
        program,
        _SWAPPED.get(seen, seen),
        -result.z[: program.q.size],
        result.x,
        result.iterations,
        result.seconds,
        "clarabel",
        result.status,
    )
