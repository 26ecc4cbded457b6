"""Linear programs, solved by HiGHS. What they return guides; nothing proved rests on it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.optimize import linprog

__all__ = ["solve_lp"]


def solve_lp(
    cost: NDArray[np.float64],
    margins: tuple[sps.csr_array, NDArray[np.float64], NDArray[np.float64]],
    equalities: tuple[sps.csr_array, NDArray[np.float64]],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64] | None:
    """Minimise cost'(d, t) subject to G d - w t >= -g, H d = r and bounds.

    Parameters
    ----------
    cost : (n + 1,) float
    margins : (G, w, g)
        Rows that ask for a margin t, weighted by w.
    equalities : (H, r)
    bounds : (lower, upper), each (n + 1,)

    Returns
    -------
    (n + 1,) float or None
        The solution, None if there is none.
    """
    matrix, weight, value = margins
    equal, right = equalities
    upper_rows = sps.hstack([-matrix, sps.csr_array(weight[:, None])]) if weight.size else None
    equal_rows = sps.hstack([equal, sps.csr_array((right.size, 1))]) if right.size else None
    result = linprog(
        cost,
        A_ub=upper_rows,
        b_ub=value if weight.size else None,
        A_eq=equal_rows,
        b_eq=right if right.size else None,
        bounds=np.stack(bounds, axis=1),
        method="highs",
    )
    return np.asarray(result.x) if result.status == 0 else None
