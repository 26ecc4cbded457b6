"""Protocol of conic solvers: a function from program and settings to a solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from sparsepop_py.conic.program import ConicProgram, ConicSolution

__all__ = ["ConicSolver", "SolverSettings"]


@dataclass(frozen=True)
class SolverSettings:
    """Settings that every conic solver is offered; it follows those that it knows.

    Parameters
    ----------
    time_limit : float or None
        Seconds after which the solver should stop where it can.
    accuracy : float
        Gap and residuals at which it may stop, in scaled units.
    target : float or None
        A dual value that is good enough: it may stop there.
    max_iterations : int or None
        Most iterations.
    solves : int
        How many programs of this pattern are to be solved, so that an analysis may pay.
    """

    time_limit: float | None = None
    accuracy: float = 1e-9
    target: float | None = None
    max_iterations: int | None = None
    solves: int = 1


class ConicSolver(Protocol):
    """Solve a conic program.

    What comes back must be in the convention of :mod:`sparsepop_py.conic.program`; pass it
    through :func:`sparsepop_py.conic.program.solution`, which recomputes values and residuals.
    Nothing proved rests on a solver: a wrong dual proves less, never more.
    """

    def __call__(self, program: ConicProgram, settings: SolverSettings) -> ConicSolution:
        """Minimise q'y + offset subject to A y + s = b, s in K."""
        ...
