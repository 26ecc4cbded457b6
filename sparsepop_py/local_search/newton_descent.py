"""Second-order descent in thousands of variables that have bounds at most.

Each step is one sparse elimination; nothing here is proved.

References
----------
D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM
11 (1963) 431-441.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import spend
from sparsepop_py.problem.problem import Problem

__all__ = ["newton_polish", "zeros_of_squares"]

_STEPS = 300  # at most
_DENSE = 60  # variables up to which matrices are dense
_SHIFTS = 12  # times a shift grows tenfold before the search ends
Matrix = Any  # (n, n) float, dense or sparse


def zeros_of_squares(problem: Problem, start: NDArray[Any], end: float) -> NDArray[np.float64]:
    """Take shifted Gauss-Newton steps where the objective is a sum of squares.

    They end at zeros of the squares where those of the expanded objective stop in one of its
    many poorer minima.
    """
    if not problem.squares:
        return start
    weight = np.array([w for w, _ in problem.squares])
    system = PolynomialSystem.stack([r for _, r in problem.squares], problem.dimension)

    def value(x: NDArray[Any]) -> float:
        return float(weight @ np.square(system.values(x)))

    def model(x: NDArray[Any], inner: NDArray[Any]) -> tuple[Matrix, NDArray[Any]]:
        jacobian = _jacobian(system, x)[:, inner]
        weighted = jacobian.T * weight
        return weighted @ jacobian, weighted @ system.values(x)

    return _descended(problem, start, end, value, model)


def newton_polish(
    problem: Problem, x: NDArray[Any], end: float, steps: int = _STEPS
) -> NDArray[np.float64]:
    """Take shifted Newton steps, few from a point near a minimum."""
    row = problem.objective_row

    def value(x: NDArray[Any]) -> float:
        return float(row.values(x)[0])

    def model(x: NDArray[Any], inner: NDArray[Any]) -> tuple[Matrix, NDArray[Any]]:
        return _jacobian(row.gradient_system, x)[inner][:, inner], row.gradient(x)[inner]

    return _descended(problem, x, end, value, model, steps)


def _jacobian(system: PolynomialSystem, x: NDArray[Any]) -> Matrix:
    """Compute the Jacobian, sparse from many variables on."""
    return system.jacobian(x) if x.size > _DENSE else system.dense_jacobian(x)


def _solved(matrix: Matrix, shift: float, right: NDArray[Any]) -> NDArray[np.float64]:
    """Solve (matrix + shift I) step = right."""
    if not isinstance(matrix, np.ndarray):
        shifted = sps.csc_array(matrix + shift * sps.eye_array(right.size))
        return np.asarray(spsolve(shifted, right))
    try:
        return np.linalg.solve(matrix + shift * np.eye(right.size), right)
    except np.linalg.LinAlgError:
        return np.full(right.size, np.nan)  # as sparse elimination returns it


def _descended(
    problem: Problem,
    x: NDArray[np.float64],
    end: float,
    value: Callable[[NDArray[Any]], float],
    model: Callable[[NDArray[Any], NDArray[Any]], tuple[Matrix, NDArray[Any]]],
    steps: int = _STEPS,
) -> NDArray[np.float64]:
    """Take steps -(H + shift I)^-1 g in the inner variables while they descend.

    ``model`` gives H and g in the variables off their bounds. The shift falls after steps that
    descend and grows after others (Levenberg, Marquardt), so that curved valleys of thousands of
    variables are followed to their end, each step by one sparse elimination.
    """
    reached, shift, fails = value(x), 0.0, 0
    for _ in range(steps):
        spend(1e-4 + 1e-6 * problem.dimension)
        if time.monotonic() >= end:
            break
        inner = np.flatnonzero((x > problem.lower) & (x < problem.upper))
        hessian, slope = model(x, inner)
        size = max(1.0, float(abs(hessian).max())) if inner.size else 1.0
        step = np.zeros(x.size)
        step[inner] = -_solved(hessian, (shift + 1e-12) * size, slope)
        trial = np.clip(x + step, problem.lower, problem.upper)
        new = value(trial)
        if new < reached:
            x, reached, fails = trial, new, 0
            shift = 0.1 * shift if shift > 1e-9 else 0.0
            continue
        fails += 1
        if fails > _SHIFTS or not np.abs(step).max(initial=0.0) > 1e-12:
            break
        shift = max(10.0 * shift, 1e-6)
    return x
