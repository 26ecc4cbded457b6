"""Members of the feasible set that simulate or predict the record best.

The centre of a set of equation errors is a one-step model and may simulate badly. The search for
the best member proves nothing about optimality: it descends locally from members. That the member
it ends with is consistent is proved where ``proved`` says so.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares as gauss_newton
from scipy.optimize import nnls

from setid.data.checks import frozen, seconds_of, word
from setid.errors import ModelError, SetidError
from setid.feasible_points.estimators import NamedVector, least_squares
from setid.feasible_points.fits.differences import HUGE, capped, slopes_of_errors
from setid.feasible_points.members import is_member, members
from setid.feasible_points.modelled_outputs import (
    fit,
    per_cent,
    predicted,
    prediction_errors,
    prediction_rows,
    simulated,
    started,
)
from setid.feasible_points.witness import consistent
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["BestMember", "Goal", "best"]

Reals = NDArray[np.float64]
Goal = Literal["simulation", "prediction"]
Misfit = Callable[[Reals], Reals]

_MIXTURES = 20  # mixtures of attained members among which the search begins
_STEPS = 25  # Gauss-Newton steps
_HALVINGS = 12  # of one step
_CUTS = 60  # rounds in which violated rows join a least-squares program
_INSIDE = (0.0, 1e-9, 1e-6, 1e-3)  # shares of the way to the mean of members, until proved
_PART = 1e-6  # of a parameter: step of a difference


@dataclass(frozen=True, slots=True, eq=False)
class BestMember(NamedVector, ReadOnly):
    """A consistent parameter vector, chosen by how well it simulates or predicts.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
    goal : {"simulation", "prediction"}
    error : float
        Root of the mean squared error on the identification record.
    fit : (ny,) float
        100 (1 - |y - yhat| / |y - mean y|) there, in per cent.
    proved : bool
        Whether the vector is proved to be consistent. That no member is better is not proved.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = result.best("prediction")
    >>> found.proved, round(found.error, 3)
    (True, 0.289)
    """

    names: tuple[str, ...]
    theta: Reals
    goal: Goal
    error: float
    fit: Reals
    proved: bool

    def __str__(self) -> str:
        return f"{NamedVector.__str__(self)} (fit in {self.goal} {per_cent(self.fit)})"


def best(result: FeasibleSet, goal: Goal = "simulation", time_limit: float = 20.0) -> BestMember:
    """Find a member of the feasible set that simulates or predicts its record best.

    Parameters
    ----------
    result : FeasibleSet
    goal : {"simulation", "prediction"}
        What to make small: the error of outputs that are simulated from the inputs alone, or
        that of one-step predictions.
    time_limit : float
        Seconds after which no further step is begun and no further member tried; on long records
        each takes some of a second.

    Returns
    -------
    BestMember
        Of a local search: for predictions in discrete time with equation errors it is the best
        one (a convex program), otherwise a better one may exist.

    Raises
    ------
    SetidError
        If the set is empty, no member is known, or the structure cannot be simulated or
        predicted.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> print(setid.best(result, "simulation"))
    a1 = -0.490393, b0 = 2.01129 (fit in simulation 92.2 %)
    """
    check_result(result)
    misfit = _misfit(result, goal)
    limit = seconds_of(time_limit)
    until = time.monotonic() + limit
    known = members(result, count=_MIXTURES, time_limit=0.5 * limit)
    theta = min(known, key=lambda t: _size(misfit(t)))
    target = _unconstrained(result, misfit, theta, until)
    if target is not None and is_member(result.formulation, target):
        theta = target
    elif (rows := _linear_rows(result)) is not None:
        theta = _within_rows(misfit, theta, *rows, until)
    else:
        theta = _within_members(result, misfit, theta, target, until)
    theta, proved = _proved(result, theta, known.mean(axis=0))
    errors = misfit(theta)
    data, model = result.formulation.data, result.formulation.model
    outputs = (simulated if goal == "simulation" else predicted)(model, theta, data)
    return BestMember(
        names=result.formulation.parameters,
        theta=frozen(theta.copy()),
        goal=goal,
        error=float(np.sqrt(np.mean(errors**2))),
        fit=frozen(fit(data.y, outputs)),
        proved=proved,
    )


# ---- what is made small -----------------------------------------------------------------


def _misfit(result: FeasibleSet, goal: Goal) -> Misfit:
    """Build the errors over the identification record as a function of theta."""
    data, model = result.formulation.data, result.formulation.model
    if word(goal, "goal", ("simulation", "prediction"), SetidError) == "prediction":
        rows, coordinates = prediction_rows(model, data)

        def beyond(theta: Reals) -> Reals:
            try:
                found = prediction_errors(rows, coordinates, theta)
            except ModelError:
                return np.full(rows.target.size, HUGE)
            return found.clip(-HUGE, HUGE)

        return beyond
    counted = ~np.isnan(data.y) & ~started(model, data)[:, None]

    def errors(theta: Reals) -> Reals:
        try:
            found = (simulated(model, theta, data) - data.y)[counted]
        except (ModelError, OverflowError):
            return np.full(int(counted.sum()), HUGE)
        return capped(found)

    return errors


def _size(errors: Reals) -> float:
    return float(np.linalg.norm(errors))


# ---- descent ----------------------------------------------------------------------------


def _unconstrained(result: FeasibleSet, misfit: Misfit, theta: Reals, until: float) -> Reals | None:
    """Choose the best local minimum from a member and least squares, consistent or not.

    A descent that is not over in time is left aside.
    """

    def timed(point: Reals) -> Reals:
        if time.monotonic() >= until:
            raise TimeoutError
        return misfit(point)

    starts = [theta]
    try:
        starts.append(least_squares(result.formulation.data, result.formulation.model).theta)
    except SetidError:
        pass
    best_found: tuple[float, Reals] | None = None
    for start in starts:
        if not np.isfinite(size := _size(misfit(start))) or size >= HUGE:
            continue
        try:
            found = gauss_newton(timed, start, x_scale="jac", max_nfev=_STEPS)
        except TimeoutError:
            break
        if best_found is None or _size(found.fun) < best_found[0]:
            best_found = _size(found.fun), np.asarray(found.x, np.float64)
    return None if best_found is None else best_found[1]


def _linear_rows(result: FeasibleSet) -> tuple[Reals, Reals] | None:
    """Write rows A theta <= b of a polytope; None for other sets."""
    problem, p = result.problem, len(result.formulation.parameters)
    if problem.degree > 1 or problem.dimension != p or np.any(problem.equality):
        return None
    origin = np.zeros((1, p))
    right = problem.rows.values(origin[0])
    matrix = np.column_stack([problem.rows.values(e) - right for e in np.eye(p)])
    eye = np.eye(p)
    high, low = np.isfinite(problem.upper), np.isfinite(problem.lower)
    left = np.vstack([-matrix, eye[high], -eye[low]])
    return left, np.concatenate([right, problem.upper[high], -problem.lower[low]])


def _within_rows(misfit: Misfit, theta: Reals, matrix: Reals, right: Reals, until: float) -> Reals:
    """Descend over a polytope by Gauss-Newton steps: least-squares programs with rows."""
    errors = misfit(theta)
    for _ in range(_STEPS):
        if time.monotonic() >= until:
            break
        jacobian = slopes_of_errors(misfit, theta, errors, _PART)
        step = _nearest(jacobian, errors, matrix, right - matrix @ theta)
        if step is None:
            break
        found = _shorter(misfit, theta, step, _size(errors))
        if found is None:
            break
        gain = _size(errors) - _size(found[1])
        theta, errors = found
        if gain <= 1e-9 * _size(errors):
            break
    return theta


def _within_members(
    result: FeasibleSet, misfit: Misfit, theta: Reals, target: Reals | None, until: float
) -> Reals:
    """Go towards the unconstrained minimum as far as members are known to reach."""
    if target is None:
        return theta
    size = _size(misfit(theta))
    for share in 0.5 ** np.arange(1, _HALVINGS):
        if time.monotonic() >= until:
            break
        point = theta + share * (target - theta)
        if _size(misfit(point)) < size and is_member(result.formulation, point):
            return np.asarray(point, np.float64)
    return theta


def _shorter(misfit: Misfit, theta: Reals, step: Reals, size: float) -> tuple[Reals, Reals] | None:
    for share in 0.5 ** np.arange(_HALVINGS):
        point = theta + share * step
        errors = misfit(point)
        if _size(errors) < size:
            return point, errors
    return None


def _nearest(jacobian: Reals, errors: Reals, matrix: Reals, right: Reals) -> Reals | None:
    """Minimise |J d + e| subject to matrix d <= right, rows joining as they are violated.

    Reduced to least distance programming, and that to nonnegative least squares: C. L. Lawson,
    R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    q, r = np.linalg.qr(jacobian)
    if not np.all(np.isfinite(r)) or np.linalg.cond(r) > 1e13:
        return None
    inverse, best_free = np.linalg.inv(r), -(q.T @ errors)
    scale = np.linalg.norm(matrix, axis=1) + np.finfo(float).tiny
    used: list[int] = []
    step = inverse @ best_free
    for _ in range(_CUTS):
        excess = (matrix @ step - right) / scale
        worst = [int(i) for i in np.argsort(excess)[::-1][:3] if excess[i] > 1e-12]
        worst = [i for i in worst if i not in used]
        if not worst:
            return step
        used += worst
        # least |w| with G w >= h, w = R d - best_free
        g = -(matrix[used] / scale[used, None]) @ inverse
        h = -right[used] / scale[used] - g @ best_free
        unit = np.append(np.zeros(g.shape[1]), 1.0)
        weights, _ = nnls(np.vstack([g.T, h]), unit)
        rest = np.vstack([g.T, h]) @ weights - unit
        if abs(rest[-1]) < 1e-14:
            return None
        step = inverse @ (best_free - rest[:-1] / rest[-1])
    return step


def _proved(result: FeasibleSet, theta: Reals, inside: Reals) -> tuple[Reals, bool]:
    """Prove a vector consistent, moved inwards where only that can be proved."""
    for share in _INSIDE:
        point = np.asarray(theta + share * (inside - theta), np.float64)
        if consistent(result.formulation, point) is not None:
            return point, True
    return theta, False
