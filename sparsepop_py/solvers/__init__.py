"""Solve conic programs by the solver of a given name.

One file or folder a solver; each turns a program into a solution in the convention of
:mod:`sparsepop_py.conic.program`. The table ``SOLVERS`` names them, and a solver is imported
when it is first used. To add one, write a :class:`~sparsepop_py.solvers.interface.ConicSolver`
and register it; ``Options(solver=...)`` then knows its name.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sparsepop_py.budget import TOO_LONG, TOO_MUCH, iterations_left, outlasts, pace, spend
from sparsepop_py.conic.program import ConicProgram, ConicSolution, solution
from sparsepop_py.errors import (
    SolverNotFound,
    SparsePOPError,
    check_kind,
    check_number,
    check_whole,
)
from sparsepop_py.plugins.registry import Registry
from sparsepop_py.solvers.interface import ConicSolver, SolverSettings

__all__ = [
    "NOT_BEGUN",
    "SOLVERS",
    "WITHOUT_WORK",
    "least_seconds",
    "preferred",
    "require_solver",
    "solve_conic",
    "solver_names",
]

# Rows of the largest block from which on, with at least so many moments, the clique-tree method
# was measured to be faster, with numpy alone and more so with compiled kernels.
_DOMAIN = ((20, 100), (9, 200), (6, 1200), (2, 5000))
# The same where so many programs share their pattern, and with it the analysis.
_SHARED_DOMAIN, _SHARED = ((6, 100), *_DOMAIN), 4

# Operations a second of Clarabel in factorizations (measured with blocks of 45 to 78 rows), and
# iterations, the analysis counted in, without which its output proves nothing.
_RATE, _ITERATIONS = 1.7e10, 10
_UNSTOPPABLE = ("clarabel", "clarabel-moment")
_USUAL = 80  # iterations that each solver does by itself, at most or more
NOT_BEGUN = f"not begun: its iterations take {TOO_LONG}"
WITHOUT_WORK = f"not begun: its iterations need {TOO_MUCH}"

SOLVERS: Registry[ConicSolver] = Registry(
    "solver",
    {
        "clarabel": "sparsepop_py.solvers.clarabel_:squares_form",
        "clarabel-moment": "sparsepop_py.solvers.clarabel_:moment_form",
        "cliquetree": "sparsepop_py.solvers.cliquetree:clique_tree",
    },
    SolverNotFound,
    raised=SparsePOPError,
)
# Solvers with a name of their own behind a colon: the function makes a solver of the rest.
_FAMILIES = {"cvxpy": "sparsepop_py.solvers.cvxpy_:solver_of"}


def preferred(largest: int, moments: int, compact: bool, solves: int = 1) -> tuple[str, ...]:
    """Choose the solvers to try, in order, by sizes of the program.

    The clique-tree method wants moments in [-1, 1] (``compact``) and blocks large or
    numerous enough to pay for its analysis: its domain, as ``docs/cliquetree.md`` measures it,
    is 20 rows and 100 moments, 9 rows and 200, 6 rows and 1200, 2 rows and 5000, and 6 rows and
    100 moments for four programs of one pattern, which share the analysis. Whatever it does not
    solve goes to Clarabel, whose sum-of-squares form is more accurate and whose
    moment form ends in other cases.

    Parameters
    ----------
    largest : int
        Rows of the largest block.
    moments : int
    compact : bool
        Whether every moment lies in [-1, 1].
    solves : int
        How many programs of this pattern are to be solved.

    Examples
    --------
    >>> preferred(8, 900, True)[0], preferred(8, 900, True, solves=10)[0]
    ('clarabel', 'cliquetree')
    """
    clarabel = ("clarabel", "clarabel-moment")
    domain = _SHARED_DOMAIN if solves >= _SHARED else _DOMAIN
    large = any(largest >= block and moments >= many for block, many in domain)
    return ("cliquetree", *clarabel) if compact and large else clarabel


def solver_names() -> list[str]:
    """List the names that ``Options(solver=...)`` accepts; ``cvxpy:NAME`` opens any of cvxpy's."""
    return ["auto", *SOLVERS, *(f"{family}:NAME" for family in _FAMILIES)]


def _solver(name: str) -> ConicSolver:
    family, colon, rest = name.partition(":")
    if colon and family in _FAMILIES:
        makers: Registry[object] = Registry("solver", _FAMILIES, SolverNotFound)
        made: ConicSolver = makers[family](rest)  # type: ignore[operator]
        return made
    if name not in SOLVERS:
        names = ", ".join(solver_names())
        raise SolverNotFound(f"solver: found {name!r}, expected one of {names}")
    return SOLVERS[name]


def _iteration_work(program: ConicProgram) -> float:
    """Model the work of one iteration: dense blocks, then rows."""
    sides = np.array(program.cones.psd, float)
    entries = sides * (sides + 1.0) / 2.0
    return float(
        1e-4 + np.sum(1.2e-7 * entries**2 / (1.0 + entries / 600.0)) + 1e-6 * program.b.size
    )


def least_seconds(sides: Sequence[int], solver: str = "clarabel") -> float:
    """Estimate the wall seconds of the fewest iterations that lead anywhere.

    Only of solvers that cannot be stopped inside an iteration, 0 for others: their Newton systems
    hold a dense matrix for each block, whose factorization takes nearly all the time.

    Parameters
    ----------
    sides : sequence of int
        Rows of each semidefinite block.
    solver : str
    """
    if solver not in _UNSTOPPABLE:
        return 0.0
    rows = np.asarray(sides, float)
    entries = rows * (rows + 1.0) / 2.0
    return float(_ITERATIONS * pace() * np.sum(entries**3) / 3.0 / _RATE)


def _not_begun(program: ConicProgram, solver: str, detail: str) -> ConicSolution:
    """Return the solution of a program that would have taken too long."""
    y, z = np.zeros(program.q.size), np.zeros(program.b.size)
    return solution(program, "failed", y, z, 0, 0.0, solver, detail)


def require_solver(name: str) -> None:
    """Refuse a name that no installed solver has.

    Parameters
    ----------
    name : str

    Raises
    ------
    SolverNotFound
        If the name is unknown or the package is missing.
    """
    if name != "auto" and name not in SOLVERS:
        _solver(name)


def _computed_again(program: ConicProgram, found: ConicSolution, solver: str) -> ConicSolution:
    """Compute what follows from y and z, whatever a solver from outside says of it."""
    if np.iscomplexobj(found.y) or np.iscomplexobj(found.z):
        raise TypeError("found complex numbers, expected doubles")
    y, z = np.asarray(found.y, float), np.asarray(found.z, float)
    counts = max(0, int(found.iterations)), float(found.seconds)
    return solution(program, found.status, y, z, *counts, solver, str(found.detail))


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
        ``"cliquetree"`` (for programs whose moments lie in [-1, 1]), ``"cvxpy:NAME"``, or a
        name that was registered.
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

    Returns
    -------
    ConicSolution
        None of its values is a bound.

    Raises
    ------
    ProblemError
        If it is no conic program.
    SolverNotFound
        If the name is unknown or the package is missing.
    SparsePOPError
        If a solver that was registered raises, or returns no solution of this program.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> program = sp.assemble(sp.relax(problem, 1), problem.objective)
    >>> print(f"{sp.solve_conic(program).dual:.6f}")
    -0.500000
    """
    check_kind(program, ConicProgram, "program")
    check_kind(solver, str, "solver")
    accuracy = check_number(accuracy, "accuracy", 0.0)
    if time_limit is not None:
        time_limit = check_number(time_limit, "time_limit", 0.0)
    if target is not None:
        target = check_number(target, "target")
    if max_iterations is not None:
        max_iterations = check_whole(max_iterations, "max_iterations", 1)
    solves = check_whole(solves, "solves", 1, 2**63 - 1)
    if solver == "auto":  # where nothing is known of the moments
        solver = preferred(max(program.cones.psd, default=0), program.q.size, False)[0]
    start, each = time.perf_counter(), _iteration_work(program)
    if time_limit is not None and least_seconds(program.cones.psd, solver) > time_limit:
        return _not_begun(program, solver, NOT_BEGUN)
    if outlasts(_ITERATIONS * each):
        return _not_begun(program, solver, WITHOUT_WORK)
    most = iterations_left(each, _ITERATIONS)
    allowed = int(most) if most < (max_iterations or _USUAL) else max_iterations
    settings = SolverSettings(time_limit, accuracy, target, allowed, solves)
    found = SOLVERS.ask(solver, _solver(solver), program, settings)
    check_kind(found, ConicSolution, f"what the solver {solver!r} returned")
    if SOLVERS.plugged(solver):
        found = SOLVERS.ask(solver, _computed_again, program, found, solver)
    spend(found.iterations * each)
    return replace(found, wall=time.perf_counter() - start)
