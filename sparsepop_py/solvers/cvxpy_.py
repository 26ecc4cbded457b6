"""The door to every solver that cvxpy knows (SCS, MOSEK, COPT, SDPA, CVXOPT ...).

cvxpy compiles slowly (as long as the solve at a few hundred blocks), so it is imported
only when asked for.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from sparsepop_py.conic.program import ConicProgram, ConicSolution, solution
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.executors.threads import silent
from sparsepop_py.solvers.interface import ConicSolver

__all__ = ["require", "solve", "solver_of"]

_STATUS = {
    "optimal": "solved",
    "optimal_inaccurate": "almost",
    "infeasible": "infeasible",
    "infeasible_inaccurate": "infeasible",
    "unbounded": "unbounded",
    "unbounded_inaccurate": "unbounded",
}
_ROOT2 = float(np.sqrt(2.0))


def require(name: str) -> Any:
    """Import cvxpy and check that it has the solver ``name``.

    Returns
    -------
    module

    Raises
    ------
    SolverNotFound
        If cvxpy or the solver is not installed.
    """
    try:
        import cvxpy as cp
    except ImportError as error:
        raise SolverNotFound(
            "solver: cvxpy is missing; install it with: pip install 'sparsepop-py[cvxpy]'"
        ) from error
    if name.upper() not in cp.installed_solvers():
        raise SolverNotFound(
            f"solver: cvxpy has no installed solver {name!r}, found "
            f"{', '.join(cp.installed_solvers())}"
        )
    return cp


def solver_of(name: str) -> ConicSolver:
    """Make a conic solver of the cvxpy solver ``name``; it follows none of the settings.

    Parameters
    ----------
    name : str

    Raises
    ------
    SolverNotFound
        If cvxpy or the solver is not installed.
    """
    require(name)
    return lambda program, settings: solve(program, name)


def solve(program: ConicProgram, name: str, **settings: Any) -> ConicSolution:
    """Solve a program by the cvxpy solver ``name``.

    Raises
    ------
    SolverNotFound
        If cvxpy or the solver is not installed.
    """
    cp = require(name)
    y = cp.Variable(program.q.size)
    slack = program.b - program.A @ y
    cones = program.cones
    constraints: list[Any] = []
    if cones.zero:
        constraints.append(slack[: cones.zero] == 0)
    if cones.nonnegative:
        constraints.append(slack[cones.zero : cones.zero + cones.nonnegative] >= 0)
    offset = cones.zero + cones.nonnegative
    for size in cones.psd:
        count = size * (size + 1) // 2
        matrix = cp.Variable((size, size), symmetric=True)
        j, i = np.tril_indices(size)
        weight = np.where(i == j, 1.0, _ROOT2)
        entries = cp.multiply(weight, cp.hstack([matrix[a, c] for a, c in zip(i, j, strict=True)]))
        constraints += [matrix >> 0, entries == slack[offset : offset + count]]
        offset += count
    problem = cp.Problem(cp.Minimize(program.q @ y), constraints)
    start = time.process_time()
    try:
        with silent():  # inaccuracy is in the status
            problem.solve(solver=name.upper(), **settings)
        detail = str(problem.status)
    except cp.error.SolverError as error:
        detail = str(error)
    seconds = time.process_time() - start
    stats = problem.solver_stats
    moments = np.zeros(program.q.size) if y.value is None else y.value
    return solution(
        program,
        _STATUS.get(detail, "failed"),
        moments,
        _multipliers(program, constraints),
        int(getattr(stats, "num_iters", 0) or 0),
        seconds,
        f"cvxpy:{name}",
        detail,
    )


def _multipliers(program: ConicProgram, constraints: list[Any]) -> np.ndarray:
    """Duals in the convention of this package: z in K*, q + A'z = 0."""
    z = np.zeros(program.b.size)
    cones, index = program.cones, 0
    if any(constraint.dual_value is None for constraint in constraints):
        return z
    if cones.zero:  # cvxpy: minimise f + dual * (b - A y), so z = -dual
        z[: cones.zero] = -constraints[index].dual_value
        index += 1
    if cones.nonnegative:
        z[cones.zero : cones.zero + cones.nonnegative] = constraints[index].dual_value
        index += 1
    offset = cones.zero + cones.nonnegative
    for size in cones.psd:
        j, i = np.tril_indices(size)
        dual = np.asarray(constraints[index].dual_value)
        count = i.size
        z[offset : offset + count] = np.where(i == j, 1.0, _ROOT2) * dual[i, j]
        offset += count
        index += 2
    return z
