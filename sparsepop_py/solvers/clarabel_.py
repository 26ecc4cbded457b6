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

import time
from typing import Any

import numpy as np
import scipy.sparse as sps

from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution, solution
from sparsepop_py.solvers.interface import SolverSettings

__all__ = ["STATUS", "moment_form", "run_clarabel", "squares_form"]

STATUS = {
    "Solved": "solved",
    "AlmostSolved": "almost",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
    "DualInfeasible": "unbounded",
    "AlmostDualInfeasible": "unbounded",
}
_MOST_ITERATIONS = 2**32 - 1  # that Clarabel counts
_SWAPPED = {"infeasible": "unbounded", "unbounded": "infeasible"}


def _settings(asked: SolverSettings) -> Any:
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
    import clarabel

    listed: list[Any] = []
    if cones.zero:
        listed.append(clarabel.ZeroConeT(cones.zero))
    if cones.nonnegative:
        listed.append(clarabel.NonnegativeConeT(cones.nonnegative))
    return listed + [clarabel.PSDTriangleConeT(size) for size in cones.psd]


def _run(
    q: Any,
    A: Any,
    b: Any,
    cones: Cones,
    settings: SolverSettings,
) -> tuple[Any, float]:
    start = time.process_time()
    result = run_clarabel(sps.csc_matrix((q.size, q.size)), q, A, b, cones, settings)
    return result, time.process_time() - start


def run_clarabel(
    hessian: Any, q: Any, A: Any, b: Any, cones: Cones, settings: SolverSettings
) -> Any:
    """Minimise a convex quadratic function on a cone.

    That is x' hessian x / 2 + q'x subject to A x + s = b, s in K; hessian is upper.
    """
    import clarabel

    return clarabel.DefaultSolver(hessian, q, A, b, _cones(cones), _settings(settings)).solve()


def moment_form(program: ConicProgram, settings: SolverSettings) -> ConicSolution:
    """Solve the program as it stands, moments being the variables."""
    matrix = sps.csc_matrix(program.A)
    result, seconds = _run(program.q, matrix, program.b, program.cones, settings)
    status = str(result.status)
    return solution(
        program,
        STATUS.get(status, "failed"),
        np.array(result.x),
        np.array(result.z),
        result.iterations,
        seconds,
        "clarabel-moment",
        status,
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
    result, seconds = _run(program.b, matrix, right, cones, settings)
    status = str(result.status)
    seen = STATUS.get(status, "failed")
    return solution(
        program,
        _SWAPPED.get(seen, seen),
        -np.array(result.z)[: program.q.size],
        np.array(result.x),
        result.iterations,
        seconds,
        "clarabel",
        status,
    )
