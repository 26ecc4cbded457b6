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

import clarabel
import numpy as np
import scipy.sparse as sps

from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution, solution

__all__ = ["solve_moment_form", "solve_squares_form"]

_MOMENT_STATUS = {
    "Solved": "solved",
    "AlmostSolved": "almost",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
    "DualInfeasible": "unbounded",
    "AlmostDualInfeasible": "unbounded",
}
_SWAPPED = {"infeasible": "unbounded", "unbounded": "infeasible"}


def _settings(time_limit: float | None, accuracy: float, most: int | None) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = accuracy
    settings.tol_feas = accuracy
    settings.max_iter = most or 200
    if time_limit is not None:
        settings.time_limit = max(time_limit, 1e-3)
    return settings


def _cones(cones: Cones) -> list[Any]:
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
    cones: list[Any],
    limits: tuple[float | None, float, int | None],
) -> tuple[Any, float]:
    nothing = sps.csc_matrix((q.size, q.size))
    start = time.process_time()
    solver = clarabel.DefaultSolver(nothing, q, A, b, cones, _settings(*limits))
    result = solver.solve()
    return result, time.process_time() - start


def solve_moment_form(
    program: ConicProgram,
    time_limit: float | None = None,
    accuracy: float = 1e-9,
    max_iterations: int | None = None,
) -> ConicSolution:
    """Solve the program as it stands."""
    matrix = sps.csc_matrix(program.A)
    cones = _cones(program.cones)
    limits = time_limit, accuracy, max_iterations
    result, seconds = _run(program.q, matrix, program.b, cones, limits)
    status = str(result.status)
    return solution(
        program,
        _MOMENT_STATUS.get(status, "failed"),
        np.array(result.x),
        np.array(result.z),
        result.iterations,
        seconds,
        "clarabel-moment",
        status,
    )


def solve_squares_form(
    program: ConicProgram,
    time_limit: float | None = None,
    accuracy: float = 1e-9,
    max_iterations: int | None = None,
) -> ConicSolution:
    """Solve the dual: multipliers as variables, moments as their prices."""
    rows, zero = program.b.size, program.cones.zero
    conic = sps.csc_array(
        (-np.ones(rows - zero), (np.arange(rows - zero), np.arange(zero, rows))),
        shape=(rows - zero, rows),
    )
    matrix = sps.csc_matrix(sps.vstack([program.A.T, conic]))
    right = np.concatenate([-program.q, np.zeros(rows - zero)])
    cones = Cones(program.q.size, program.cones.nonnegative, program.cones.psd)
    limits = time_limit, accuracy, max_iterations
    result, seconds = _run(program.b, matrix, right, _cones(cones), limits)
    status = str(result.status)
    seen = _MOMENT_STATUS.get(status, "failed")
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
