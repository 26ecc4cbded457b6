"""Local search: candidate minimisers in floating point.

Nothing here is proved; :mod:`sparsepop_py.feasibility` decides what is attained. SLSQP
serves problems of up to a few hundred variables, L-BFGS-B large ones that have bounds
only, trust-constr the rest; problems of degree two are first tried by sequential linear
programming. IPOPT through casadi is an optional extra.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from .descent import newton_polish, zeros_of_squares
from .errors import SolverNotFound
from .feasibility import ProvedPoint, prove_feasible
from .polynomial import Constraint, Kind
from .problem import Problem
from .rounding import Interval
from .rowform import RowForm
from .sequential import sequential_search
from .shapes import Products

__all__ = ["best_attained", "local_search", "starting_points"]

_DENSE_LIMIT = 300
_FEW = 40  # variables up to which SLSQP may follow where sequential programs failed on a star
_SMALL = 12  # variables up to which several methods are tried from each start
_FAR = 1e8
_ENOUGH = 5  # searches that end at the best value before the rest is left out


def local_search(
    problem: Problem,
    start: NDArray[np.float64],
    method: str | None = None,
    end: float = np.inf,
) -> NDArray[np.float64]:
    """A local minimiser from ``start``, nearly feasible at best.

    Parameters
    ----------
    problem : Problem
    start : (n,) float
    method : {None, "sequential", "ipopt"}
        None chooses among SciPy's methods by size and structure.
    end : float
        When to stop, on the monotonic clock; the last vector that was looked at is returned.
    """
    problem = problem.sharpened
    start = np.clip(start, problem.lower, problem.upper)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        if method == "ipopt":
            return _ipopt(problem, start)
        if method == "sequential":
            return sequential_search(problem, start, Products.of(problem).complicating)
        try:
            if not problem.constraints:
                start = zeros_of_squares(problem, start, end)
                return _by_bounds(problem, start, end)
            free = np.count_nonzero(problem.lower < problem.upper)
            inequalities = not np.all(problem.equality | problem.bound_rows)
            if inequalities and np.count_nonzero(problem.equality) >= free:
                return sequential_search(problem, start)  # SLSQP is not made for that
            if problem.dimension <= _DENSE_LIMIT:
                return _by_slsqp(problem, start, end)
            return _by_trust_region(problem, start, end)
        except _OutOfTime as late:
            return late.x


class _OutOfTime(Exception):
    """Raised inside a search that has no time left."""

    def __init__(self, x: NDArray[np.float64]) -> None:
        super().__init__()
        self.x = np.array(x, float)


def _value(problem: Problem, end: float) -> Any:
    row = problem.objective_row

    def value(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        if time.monotonic() >= end:
            raise _OutOfTime(x)
        return float(row.values(x)[0]), row.gradient(x)

    return value


def _by_bounds(problem: Problem, start: NDArray, end: float) -> NDArray[np.float64]:
    bounds = Bounds(problem.lower, problem.upper)
    options = {"maxiter": 500, "maxfun": 1500, "ftol": 1e-15, "gtol": 1e-10}
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


def _stop_far_away(intermediate_result: Any) -> None:
    """End a search that follows a falling objective to infinity."""
    if np.abs(intermediate_result.x).max(initial=0.0) > _FAR:
        raise StopIteration


def _by_slsqp(problem: Problem, start: NDArray, end: float) -> NDArray[np.float64]:
    rows, size = problem.rows, _row_sizes(problem)
    constraints = []
    for kind, chosen in (
        ("ineq", ~problem.equality & ~problem.bound_rows),
        ("eq", _independent(problem, start)),
    ):
        index = np.flatnonzero(chosen)
        if index.size:
            part, scale = rows.take(index), size[index]
            constraints.append(
                {
                    "type": kind,
                    "fun": lambda x, p=part, s=scale: p.values(x) / s,
                    "jac": lambda x, p=part, s=scale: p.dense_jacobian(x) / s[:, None],
                }
            )
    finite = np.isfinite(problem.lower) | np.isfinite(problem.upper)
    bounds = Bounds(problem.lower, problem.upper) if finite.any() else None
    options = {"maxiter": 300, "ftol": 1e-12}
    result = minimize(
        _value(problem, end),
        start,
        jac=True,
        method="SLSQP",
        bounds=bounds,
        constraints=constraints,
        options=options,
    )
    return np.asarray(result.x)


def _independent(problem: Problem, x: NDArray) -> NDArray[np.bool_]:
    """The equalities without those that are linear combinations of linear ones (SLSQP fails)."""
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


def _by_trust_region(problem: Problem, start: NDArray, end: float) -> NDArray[np.float64]:
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


def _ipopt(problem: Problem, start: NDArray) -> NDArray[np.float64]:
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
    search = casadi.nlpsol("search", "ipopt", data, quiet)
    high = np.where(problem.equality, 0.0, np.inf)
    found = search(
        x0=start, lbx=problem.lower, ubx=problem.upper, lbg=np.zeros(high.size), ubg=high
    )
    return np.asarray(found["x"]).ravel()


def starting_points(
    problem: Problem, box: Interval, count: int, seed: int
) -> list[NDArray[np.float64]]:
    """The middle of the box (0 or a bound where it is endless) and random points.

    Where the box is endless the points spread over three scales: 2, 10 and 50. In very many
    variables random points lead to poor minima; there the vectors of all 1 and all -1 follow.
    """
    rng = np.random.default_rng(seed)
    points = []
    for number in range(count + 1):
        size = (2.0, 10.0, 50.0)[number % 3]
        from_high = np.where(np.isfinite(box.hi), box.hi - 2 * size, -size)
        from_low = np.where(np.isfinite(box.lo), box.lo + 2 * size, size)
        low = np.where(np.isfinite(box.lo), box.lo, from_high)
        high = np.where(np.isfinite(box.hi), box.hi, from_low)
        low, high = 0.5 * low, 0.5 * high  # widths may be beyond all doubles
        points.append(2.0 * rng.uniform(low, high) if number else low + high)
    if problem.dimension > _DENSE_LIMIT and not problem.constraints:
        points += [np.clip(np.full(problem.dimension, v), box.lo, box.hi) for v in (1.0, -1.0)]
    return points


def _decide(problem: Problem, x: NDArray[np.float64]) -> Problem:
    """Decide either-or rows by the start: a x_i x_j == 0 and x_i^2 == c x_i fix a variable.

    Local searches stall on such rows, whose gradients vanish or contradict each other.
    """
    lower, upper = problem.lower.copy(), problem.upper.copy()
    decided = False
    for constraint in problem.constraints:
        p = constraint.polynomial
        if constraint.kind is not Kind.ZERO or p.degree != 2 or p.terms > 2:
            continue
        letters = p.words[-1][-2:] - 1
        if p.terms == 1 and letters[0] >= 0:
            chosen = letters[np.argmin(np.abs(x[letters]))]
            value = 0.0
        elif p.terms == 2 and letters[0] == letters[1] and p.words[0][-1] - 1 == letters[0]:
            chosen, root = letters[0], -p.coefficients[0] / p.coefficients[1]
            value = root if abs(x[chosen] - root) < abs(x[chosen]) else 0.0
        else:
            continue
        if lower[chosen] <= value <= upper[chosen]:
            lower[chosen] = upper[chosen] = value
            decided = True
    if not decided:
        return problem
    free = [c for c in problem.constraints if not _settled(c, lower, upper)]
    return Problem(problem.objective, free, lower, upper, problem.names)


def _settled(constraint: Constraint, lower: NDArray, upper: NDArray) -> bool:
    """Whether fixed variables make an equality hold, by zero factors or altogether."""
    p = constraint.polynomial
    if constraint.kind is not Kind.ZERO:
        return False
    fixed = lower == upper
    if np.all(fixed[p.support]):
        return abs(p(np.where(fixed, lower, 0.0))) == 0.0
    zero = np.append(False, fixed & (lower == 0.0))
    return bool(np.all(zero[p.words].any(axis=1)))


def _candidates(
    rows: RowForm, start: NDArray, tolerance: float, method: str | None, end: float
) -> list[tuple[float, NDArray[np.float64]]]:
    """Nearly feasible (value, vector) pairs that one start leads to, the start included."""
    given, problem, start = rows.given, rows.problem, rows.start(start)
    tried = [start]
    bilinear = problem.degree <= 2 and bool(problem.constraints) and not rows.factored
    if bilinear and method is None:
        tried.append(local_search(problem, start, "sequential", end))
    star = bilinear and Products.of(problem).has_star  # made for linear programs
    large = problem.dimension > (_FEW if star else _DENSE_LIMIT)  # then the others are slow
    if bilinear and method is None and problem.dimension <= _SMALL:
        tried.append(sequential_search(problem.sharpened, start))  # nothing held
    failed = len(tried) < 2 or given.violation(rows.point(tried[1])) > tolerance
    if problem.dimension <= _SMALL or (failed and not (bilinear and large)):
        tried.append(local_search(problem, start, method, end))
    branch = _decide(problem, start)
    if branch is not problem:
        tried.append(local_search(branch, start, method, end))
    kept = []
    for x in map(rows.point, tried):
        if np.all(np.isfinite(x)) and np.abs(x).max(initial=0.0) < _FAR * 1e4:
            with np.errstate(all="ignore"):
                value, violation = given.objective(x), given.violation(x)
            if np.isfinite(value) and violation <= tolerance:
                kept.append((value, x))
    return kept


def best_attained(
    problem: Problem,
    starts: Iterable[NDArray[np.float64]],
    tolerance: float,
    method: str | None = None,
    end: float = np.inf,
    enough: float = -np.inf,
) -> tuple[ProvedPoint | None, list[NDArray[np.float64]]]:
    """Search from every start; the best proved point, and all nearly feasible vectors by value.

    Parameters
    ----------
    problem : Problem
    starts : iterable of (n,) float
    tolerance : float
        Largest violation, in the user's units, of a vector that is kept.
    method : {None, "ipopt"}
    end : float
        When to stop, on the monotonic clock; what was found until then is kept.
    enough : float
        A value that needs no improvement, such as a proved bound with the allowed gap.
    """
    found: list[tuple[float, NDArray[np.float64]]] = []
    rows = RowForm.of(problem)
    reached: list[float] = []  # the best value that each start led to
    for start in starts:
        if time.monotonic() >= end:
            break
        ends = _candidates(rows, start, tolerance, method, end)
        found += ends
        reached.append(min((value for value, _ in ends), default=np.inf))
        best_value = min(reached)
        if best_value <= enough:
            break
        near = best_value + 1e-5 * (1.0 + abs(best_value))
        if best_value < np.inf and sum(value <= near for value in reached) >= _ENOUGH:
            break
    found.sort(key=lambda entry: entry[0])
    best: ProvedPoint | None = None
    for value, x in found[:12]:
        if best is not None and value >= best.value:
            break
        proved = prove_feasible(problem, x)
        if proved is not None and (best is None or proved.value < best.value):
            best = proved
    return best, [x for _, x in found]
