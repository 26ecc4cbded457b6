"""What every adapter shares: the solution recomputes its own values and residual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.conic.program import ConicProgram, ConicSolution

__all__ = ["solution"]


def solution(
    program: ConicProgram,
    status: str,
    y: NDArray[np.float64],
    z: NDArray[np.float64],
    iterations: int,
    seconds: float,
    solver: str,
    detail: str,
) -> ConicSolution:
    """A ConicSolution whose slack, values and residual come from the program, not the solver."""
    y = np.where(np.isfinite(y), y, 0.0)
    z = np.where(np.isfinite(z), z, 0.0)
    residual = program.q + program.A.T @ z
    return ConicSolution(
        status=status,
        y=y,
        s=program.b - program.A @ y,
        z=z,
        primal=float(program.q @ y + program.offset),
        dual=float(program.offset - program.b @ z),
        residual=float(np.abs(residual).max(initial=0.0)),
        iterations=iterations,
        seconds=seconds,
        solver=solver,
        detail=detail,
    )
