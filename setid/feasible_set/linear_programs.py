"""Linear programs, solved by HiGHS, and least squares, in any units. Nothing proved rests on it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.optimize import linprog

from setid.errors import SetidError

__all__ = ["minimise"]

# the next where one meets numerical difficulties; long recursions lose their meaning in presolve
_TRIES = (("highs", True), ("highs-ipm", True), ("highs", False))
_NUMERICAL = 4
_BALANCING = 10  # passes
# the least that HiGHS takes: boxes may be far wider than what is asked of them
_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def minimise(
    cost: NDArray[np.float64],
    below: tuple[sps.csr_array, NDArray[np.float64]],
    equal: tuple[sps.csr_array, NDArray[np.float64]] | None = None,
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> NDArray[np.float64] | None:
    """Minimise cost'x subject to A x <= b, E x == d and bounds.

    Parameters
    ----------
    cost : (n,) float
    below : (A, b)
    equal : (E, d), optional
    bounds : (lower, upper), each (n,), optional
        Free variables when left out.

    Returns
    -------
    (n,) float or None
        A solution, None if there is none.

    Raises
    ------
    SetidError
        If the solver gives up, or the objective falls without limit.
    """
    free = (np.full(cost.size, -np.inf), np.full(cost.size, np.inf))
    low, high = bounds or free
    parts = [part for part in (below, equal) if part is not None and part[1].size]
    matrix = sps.vstack([part[0] for part in parts]) if parts else sps.csr_array((0, cost.size))
    right = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0)
    row, column = _scales(sps.csr_array(matrix), right)
    matrix = sps.csr_array(matrix.multiply(row[:, None]).multiply(column[None, :-1]))
    right, units = row * right * column[-1], column[:-1] / column[-1]
    split = below[1].size
    weights = cost * units
    for method, presolve in _TRIES:
        result = linprog(
            weights / (np.abs(weights).max(initial=0.0) or 1.0),
            A_ub=matrix[:split] if split else None,
            b_ub=right[:split] if split else None,
            A_eq=matrix[split:] if right.size > split else None,
            b_eq=right[split:] if right.size > split else None,
            bounds=np.stack([low / units, high / units], axis=1),
            method=method,
            options={"presolve": presolve, **_TOLERANCES},
        )
        if result.status != _NUMERICAL:
            break
    if result.status == 2:
        return None
    if result.status != 0:
        raise SetidError(f"linear program: {result.message}")
    return np.asarray(result.x) * units


def _scales(
    matrix: sps.csr_array, right: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Powers of two for rows, and for columns and the right side, after which all is about one.

    The tolerances of the solver are absolute, so that without them small units mean nothing.

    References
    ----------
    A. R. Curtis, J. K. Reid, "On the automatic scaling of matrices for Gaussian elimination",
    IMA Journal of Applied Mathematics 10 (1972) 118-124: least squares of the logarithms.
    """
    size = sps.coo_array(abs(sps.hstack([matrix, sps.csr_array(right[:, None])])))
    size.eliminate_zeros()
    logs = np.log2(size.data)
    row, column = np.zeros(size.shape[0]), np.zeros(size.shape[1])
    for _ in range(_BALANCING):
        for scale, place in ((row, size.row), (column, size.col)):
            left = logs + row[size.row] + column[size.col]
            count = np.bincount(place, minlength=scale.size)
            scale -= np.bincount(place, left, scale.size) / np.maximum(count, 1)
    return np.exp2(np.round(row)), np.exp2(np.round(column))
