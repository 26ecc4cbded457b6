"""Local search for candidate minimisers in floating point.

Nothing here is proved; :mod:`sparsepop_py.verified.points.feasible_point` decides which points
are attained. SLSQP serves problems of up to a few hundred variables, L-BFGS-B large ones that
have bounds only, trust-constr the others; sequential linear programming serves problems of
degree two. IPOPT through casadi is an optional extra.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from sparsepop_py.budget import spend
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.executors.threads import silent
from sparsepop_py.local_search.newton_descent import newton_polish, zeros_of_squares
from sparsepop_py.local_search.own_units import in_own_units
from sparsepop_py.local_search.slp import sequential_search
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.shapes import Products

__all__ = ["DENSE_LIMIT", "local_search"]

DENSE_LIMIT = 300  # variables of the largest problems for SLSQP
_FIRST_STEPS = 60  # of second order before others, in more variables
_LEVEL = 1e-6  # largest slope where a search has ended, relative to 1 and the value
_LEAST_TIME = 1e-3  # seconds for IPOPT, which takes no time at all for an error
_FAR = 1e8  # a search that comes this far follows a falling objective to infinity


def local_search(
    problem: Problem,
    start: NDArray[np.float64],
    method: str | None = None,
    end: float = np.inf,
    creeping: float = 0.0,
) -> NDArray[np.float64]:
    """Search a local minimiser from ``start``, nearly feasible at best.

    Parameters
    ----------
    problem : Problem
    start : (n,) float
    method : {None, "sequential", "ipopt"}
        None chooses among SciPy's methods by size and structure.
    end : float
        End on the monotonic clock; the last vector that was evaluated is returned.
    creeping : float
        As in :func:`sparsepop_py.local_search.slp.sequential_search`.

    Returns
    -------
    (n,) float

    Raises
    ------
    SolverNotFound
        If ``method`` is "ipopt" and casadi is not installed.
    """
    scaled = in_own_units(problem.sharpened)
    return scaled.units * _searched(scaled.problem, start / scaled.units, method, end, creeping)


def _searched(
    problem: Problem,
    start: NDArray[np.float64],
    method: str | None,
    end: float,
    creeping: float,
) -> NDArray[np.float64]:
    start = np.clip(start, problem.lower, problem.upper)
    with silent(), np.errstate(all="ignore"):
        if method == "ipopt":
            return _ipopt(problem, start, end)
        if method == "sequential":
            held = Products.of(problem).complicating
            return sequential_search(problem, start, held, end=end, creeping=creeping)
        try:
            if not problem.constraints:
                start = zeros_of_squares(problem, start, end)
                return _by_bounds(problem, start, end)
            free = np.count_nonzero(problem.lower < problem.upper)
            inequalities = not np.all(problem.equality | problem.bound_rows)
            if inequalities and np.count_nonzero(problem.equality) >= free:
                return sequential_search(problem, start, end=end)  # SLSQP is not made for that
            if problem.dimension <= DENSE_LIMIT:
                return _by_slsqp(problem, start, end)
            if problem.dimension > _MATRIX_LIMIT:
                return sequential_search(problem, start, end=end)
            return _by_trust_region(problem, start, end)
        except _OutOfTime as late:
            return late.x


_SLSQP_WORK = 1e-9  # of a step and each cubed number of variables: its factorizations are dense
_MATRIX_LIMIT = 2000  # variables: the trust region method keeps two full matrices of that size


class _OutOfTime(Exception):
    """Raised inside a search that has no time left."""

    def __init__(self, x: NDArray[np.float64]) -> None:
        super().__init__()
        self.x = np.array(x, float)


def _value(problem: Problem, end: float, step_work: float = 0.0) -> Any:
    """Build the objective with its gradient; a step beside it counts ``step_work``."""
    row, terms = problem.objective_row, problem.objective.words.shape[0]

    def value(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        spend(1e-5 + 1e-7 * terms + step_work)
        if time.monotonic() >= end:
            raise _OutOfTime(x)
        return float(row.values(x)[0]), row.gradient(x)

    return value


def _by_bounds(problem: Problem, start: NDArray[Any], end: float) -> NDArray[np.float64]:
    if problem.dimension > DENSE_LIMIT:
        x = newton_polish(problem, start, end, _FIRST_STEPS)
        if _is_level(problem, x):
            return x
    bounds = Bounds(problem.lower, problem.upper)
    options = {"maxiter": 500, "maxfun": 1500, "ftol": 1e-12, "gtol": 1e-10}
    x = minimize(
        _value(problem, end),
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options=options,
        callback=_stop_far_away,
    ).x
    return newton_polish(problem, x, end)


def _is_level(problem: Problem, x: NDArray[np.float64]) -> bool:
    """Check that the objective falls in no direction that the bounds allow, up to rounding."""
    slope, value = problem.objective_row.gradient(x), problem.objective(x)
    slope = np.where(x <= problem.lower, np.minimum(slope, 0.0), slope)
    slope = np.where(x >= problem.upper, np.maximum(slope, 0.0), slope)
    return bool(np.abs(slope).max(initial=0.0) <= _LEVEL * (1.0 + abs(value)))


def _stop_far_away(intermediate_result: Any) -> None:
    """End a search that follows a falling objective to infinity."""
    if np.abs(intermediate_result.x).max(initial=0.0) > _FAR:
        raise StopIteration


def _by_slsqp(problem: Problem, start: NDArray[Any], end: float) -> NDArray[np.float64]:
    rows, size = problem.rows, _row_sizes(problem)
    constraints = []
    for kind, chosen in (
        ("ineq", ~problem.equality & ~problem.bound_rows),
        ("eq", _independent(problem, start)),
    ):
        index = np.flatnonzero(chosen)
        if index.size:
            chosen_rows, scale = rows.take(index), size[index]
            constraints.append(
                {
                    "type": kind,
                    "fun": lambda x, p=chosen_rows, s=scale: p.values(x) / s,
                    "jac": lambda x, p=chosen_rows, s=scale: p.dense_jacobian(x) / s[:, None],
                }
            )
    finite = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    bounds = Bounds(problem.lower, problem.upper) if finite.any() else None
    steps = min(300, 60 + 5 * problem.dimension)  # more than that is a stall
    options = {"maxiter": steps, "ftol": 1e-12}
    result = minimize(
        _value(problem, end, _SLSQP_WORK * problem.dimension**3),
        start,
        jac=True,
        method="SLSQP",
        bounds=bounds,
        constraints=constraints,
        options=options,
    )
    return np.asarray(result.x)


def _independent(problem: Problem, x: NDArray[Any]) -> NDArray[np.bool_]:
    """Select equalities, without linear ones that depend on others (SLSQP fails on them)."""
    chosen = problem.equality.copy()
    degree = np.array([c.polynomial.degree for c in problem.constraints], int)
    linear = np.flatnonzero(chosen & (degree <= 1))
    if linear.size > 1:
        matrix = problem.rows.take(linear).dense_jacobian(x)
        _, triangle, pivots = scipy.linalg.qr(matrix.T, mode="economic", pivoting=True)
        size = np.abs(np.diag(triangle))
        rank = int(np.count_nonzero(size > 1e-10 * max(size[0], 1e-300)))
        chosen[linear[pivots[rank:]]] = False
    return chosen


def _row_sizes(problem: Problem) -> NDArray[np.float64]:
    size = np.ones(problem.rows.size)
    np.maximum.at(size, problem.rows.row, np.abs(problem.rows.coefficients))
    return size


def _by_trust_region(problem: Problem, start: NDArray[Any], end: float) -> NDArray[np.float64]:
    rows = problem.rows
    upper = np.where(problem.equality, 0.0, np.inf)
    constraint = NonlinearConstraint(rows.values, 0.0, upper, jac=rows.jacobian)
    options = {"maxiter": 200, "gtol": 1e-9}
    result = minimize(
        _value(problem, end),
        start,
        jac=True,
        method="trust-constr",
        bounds=Bounds(problem.lower, problem.upper),
        constraints=[constraint],
        options=options,
    )
    return np.asarray(result.x)


def _ipopt(problem: Problem, start: NDArray[Any], end: float) -> NDArray[np.float64]:
    try:
        import casadi
    except ImportError as error:
        raise SolverNotFound(
            "refine: IPOPT comes with casadi, which is missing; "
            "install it with: pip install 'sparsepop-py[ipopt]'"
        ) from error
    x = casadi.MX.sym("x", problem.dimension)

    def expression(polynomial: Any) -> Any:
        total = casadi.MX(0)
        for letters, coefficient in zip(
            polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True
        ):
            term = casadi.MX(coefficient)
            for letter in letters:
                term = term * x[letter - 1] if letter else term
            total += term
        return total

    rows = [expression(c.polynomial) for c in problem.constraints]
    data = {"x": x, "f": expression(problem.objective), "g": casadi.vertcat(*rows)}
    quiet: dict[str, Any] = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
        "ipopt.tol": 1e-10,
    }
    if end < np.inf:
        quiet["ipopt.max_wall_time"] = max(end - time.monotonic(), _LEAST_TIME)
    search = casadi.nlpsol("search", "ipopt", data, quiet)
    high = np.where(problem.equality, 0.0, np.inf)
    found = search(
        x0=start, lbx=problem.lower, ubx=problem.upper, lbg=np.zeros(high.size), ubg=high
    )
    return np.asarray(found["x"]).ravel()
