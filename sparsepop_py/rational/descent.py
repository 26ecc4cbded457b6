"""Points of problems with ratios: samples of the box, and descent.

Reciprocals as variables tie a local search to their equations; the ratios themselves do not.
Nothing here is proved.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.algebra.rational import Rational
from sparsepop_py.budget import Deadline, spend
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["descended", "sampled"]

_POINTS, _REACH, _WIDEST = 200, 4.0, 3000  # of a sample; where no bounds are; most variables
_STEPS = 2000


def sampled(problem: RationalProblem, seed: int) -> NDArray[np.float64] | None:
    """Draw points of the box and return the best feasible one, None without one.

    Parameters
    ----------
    problem : RationalProblem
    seed : int

    Returns
    -------
    (n,) float or None
    """
    if problem.dimension > _WIDEST:
        return None
    low, high = np.maximum(problem.lower, -_REACH), np.minimum(problem.upper, _REACH)
    low, high = np.minimum(low, problem.upper), np.maximum(high, problem.lower)
    generator = np.random.default_rng(seed)
    points = generator.uniform(low, high, (_POINTS, problem.dimension))
    points[0] = 0.0
    points = np.clip(points, problem.lower, problem.upper)
    for k in np.argsort(problem.objective(points)):
        if problem.violation(points[k]) <= 0.0:
            return np.asarray(points[k])
    return None


def descended(
    problem: RationalProblem, x: NDArray[np.float64], deadline: Deadline
) -> NDArray[np.float64]:
    """Descend from a point by L-BFGS-B; the point itself where there are constraints.

    Parameters
    ----------
    problem : RationalProblem
    x : (n,) float
    deadline : Deadline
        Of this descent.

    Returns
    -------
    (n,) float
    """
    if problem.constraints:
        return x
    objective = _Gradient(problem.objective, deadline)
    bounds = list(zip(problem.lower, problem.upper, strict=True))
    try:
        found = minimize(
            objective, x, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS}
        ).x
    except StopIteration:
        found = objective.best
    found = np.clip(found, problem.lower, problem.upper)
    better = problem.objective(found) <= problem.objective(x)
    return np.asarray(found) if better else x


class _Gradient:
    """Value and gradient of a sum of ratios; raises ``StopIteration`` when time is over."""

    def __init__(self, f: Rational, deadline: Deadline) -> None:
        self.system = PolynomialSystem.stack(list(f.parts), f.dimension)
        self.deadline, self.best, self.least = deadline, np.zeros(f.dimension), np.inf
        self.work = 1e-5 + 1e-7 * sum(len(part.coefficients) for part in f.parts)

    def __call__(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        if self.deadline.over:
            raise StopIteration
        spend(self.work)
        values, slopes = self.system.values(x), self.system.jacobian(x)
        p, q = values[1::2], values[2::2]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            weights = np.ones(values.size)
            weights[1::2], weights[2::2] = 1.0 / q, -p / q**2
            value = float(values[0] + np.sum(p / q))
        if value < self.least:
            self.best, self.least = x.copy(), value
        return value, np.asarray(slopes.T @ weights).ravel()
