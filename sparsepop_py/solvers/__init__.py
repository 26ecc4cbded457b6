"""Conic solvers behind one function: ``solve_conic(program, name)``.

One file or folder a solver; each turns a ConicProgram into a ConicSolution in the
convention of :mod:`sparsepop_py.conic.program`.
"""

from __future__ import annotations

import time
from dataclasses import replace

from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.solvers import clarabel_, cliquetree, cvxpy_

__all__ = ["preferred", "require_solver", "solve_conic", "solver_names"]

# Rows of the largest block from which on, with at least so many moments, the clique-tree method
# was measured to be faster, with numpy alone and more so with compiled kernels.
_DOMAIN = ((20, 100), (9, 200), (6, 1200), (2, 5000))


def preferred(largest: int, moments: int, compact: bool) -> tuple[str, ...]:
    """The solvers to try, in this order, for blocks up to a size and a number of moments.

    The clique-tree method wants moments in [-1, 1] (``compact``) and blocks large or
    numerous enough to pay for its analysis: its domain, as ``docs/cliquetree.md`` measures it,
    is 20 rows and 100 moments, 9 rows and 200, 6 rows and 1200, 2 rows and 5000. Whatever it
    does not solve goes to Clarabel, whose sum-of-squares form is more accurate and whose
    moment form ends in other cases.
    """
    clarabel = ("clarabel", "clarabel-moment")
    large = any(largest >= block and moments >= many for block, many in _DOMAIN)
    return ("cliquetree", *clarabel) if compact and large else clarabel


def solver_names() -> list[str]:
    """Names that ``Options(solver=...)`` accepts; ``cvxpy:NAME`` opens any cvxpy solver."""
    return ["auto", "clarabel", "clarabel-moment", "cliquetree", "cvxpy:NAME"]


def require_solver(name: str) -> None:
    """Refuse a name that no installed solver has.

    Raises
    ------
    SolverNotFound
        If the name is unknown or the package is missing.
    """
    if name.startswith("cvxpy:"):
        cvxpy_.require(name.removeprefix("cvxpy:"))
    elif name not in solver_names():
        raise SolverNotFound(f"solver: found {name!r}, expected one of {', '.join(solver_names())}")


def solve_conic(
    program: ConicProgram,
    solver: str = "clarabel",
    time_limit: float | None = None,
    accuracy: float = 1e-9,
    target: float | None = None,
    max_iterations: int | None = None,
    solves: int = 1,
) -> ConicSolution:
    """Solve a conic program by the solver of the given name.

    Parameters
    ----------
    program : ConicProgram
    solver : str
        ``"auto"``, ``"clarabel"`` (sum-of-squares form), ``"clarabel-moment"``,
        ``"cliquetree"`` (for programs whose moments lie in [-1, 1]) or ``"cvxpy:NAME"``.
    time_limit : float, optional
        Seconds after which the solver should stop where it can.
    accuracy : float
        Gap and residuals at which an interior-point method may stop, in scaled units.
    target : float, optional
        A dual value that is good enough; ``"cliquetree"`` stops there.
    max_iterations : int, optional
        Most iterations of Clarabel and of the clique-tree method.
    solves : int
        How many programs like this one are to be solved.

    Raises
    ------
    SolverNotFound
        If the name is unknown or the package is missing.
    """
    start = time.perf_counter()
    found = _solved(program, solver, time_limit, accuracy, target, max_iterations, solves)
    return replace(found, wall=time.perf_counter() - start)


def _solved(
    program: ConicProgram,
    solver: str,
    time_limit: float | None,
    accuracy: float,
    target: float | None,
    max_iterations: int | None,
    solves: int,
) -> ConicSolution:
    if solver == "auto":  # where nothing is known of the moments
        solver = preferred(max(program.cones.psd, default=0), program.q.size, False)[0]
    if solver == "clarabel":
        return clarabel_.solve_squares_form(program, time_limit, accuracy, max_iterations)
    if solver == "clarabel-moment":
        return clarabel_.solve_moment_form(program, time_limit, accuracy, max_iterations)
    if solver == "cliquetree":
        rows = max(1e-8, 1e-3 * accuracy)  # what rows miss costs no proof
        settings = cliquetree.Settings(gap=max(1e-7, accuracy), feasibility=rows, solves=solves)
        if max_iterations is not None:
            settings = replace(settings, iterations=max_iterations)
        return cliquetree.run(
            program, target=target, time_limit=time_limit, settings=settings
        ).solution
    require_solver(solver)
    return cvxpy_.solve(program, solver.removeprefix("cvxpy:"))
