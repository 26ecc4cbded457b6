"""Conic solvers behind one function: ``solve_conic(program, name)``.

One file a solver; each offers ``solve(program, settings) -> ConicSolution`` in the
convention of :mod:`sparsepop_py.conic`.
"""

from __future__ import annotations

from ..conic import ConicProgram, ConicSolution
from ..errors import SolverNotFound
from . import clarabel_, cvxpy_

__all__ = ["solve_conic", "solver_names"]


def solver_names() -> list[str]:
    """Names that ``Options(solver=...)`` accepts; ``cvxpy:NAME`` opens any cvxpy solver."""
    return ["clarabel", "clarabel-moment", "cvxpy:NAME"]


def solve_conic(
    program: ConicProgram, solver: str = "clarabel", time_limit: float | None = None
) -> ConicSolution:
    """Solve a conic program by the solver of the given name.

    Parameters
    ----------
    program : ConicProgram
    solver : str
        ``"clarabel"`` (sum-of-squares form), ``"clarabel-moment"``, or ``"cvxpy:NAME"``.
    time_limit : float, optional
        Seconds after which the solver should stop where it can.

    Raises
    ------
    SolverNotFound
        If the name is unknown or the package is missing.
    """
    if solver == "clarabel":
        return clarabel_.solve_squares_form(program, time_limit)
    if solver == "clarabel-moment":
        return clarabel_.solve_moment_form(program, time_limit)
    if solver.startswith("cvxpy:"):
        return cvxpy_.solve(program, solver.removeprefix("cvxpy:"))
    raise SolverNotFound(f"solver: found {solver!r}, expected one of {', '.join(solver_names())}")
