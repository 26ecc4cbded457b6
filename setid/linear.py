"""Linear programs, solved by HiGHS: the one door to them. Nothing proved rests on it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.optimize import linprog

from .errors import SetidError

__all__ = ["minimise"]

# the next where one meets numerical difficulties; long recursions lose their meaning in presolve
_TRIES = (("highs", True), ("highs-ipm", True), ("highs", False))
_NUMERICAL = 4


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
    rows, right = equal if equal is not None and equal[1].size else (None, None)
    upper_rows, upper_right = below if below[1].size else (None, None)
    for method, presolve in _TRIES:
        result = linprog(
            cost,
            A_ub=upper_rows,
            b_ub=upper_right,
            A_eq=rows,
            b_eq=right,
            bounds=np.stack(bounds or free, axis=1),
            method=method,
            options={"presolve": presolve},
        )
        if result.status != _NUMERICAL:
            break
    if result.status == 2:
        return None
    if result.status != 0:
        raise SetidError(f"linear program: {result.message}")
    return np.asarray(result.x)
