"""Single linear programs in any units, scaled and solved by HiGHS.

Nothing proved rests on it. :class:`~sparsepop_py.lp.highs.LinearModel` keeps a program whose
numbers are of ordinary size and solves it again and again; here one program of numbers of any size
is solved once, and by another method where one meets numerical difficulties.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.lp.highs import LinearModel, LinearSolution

__all__ = ["solve_scaled"]

# the least that HiGHS takes: boxes may be far wider than what is asked of them
_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
# the next where one meets numerical difficulties
_TRIES: tuple[dict[str, str | int], ...] = (
    {"solver": "simplex"},
    {"solver": "ipm"},
    {"solver": "simplex", "simplex_strategy": 4},
)
_BALANCING = 10  # passes
_LARGEST_SCALE = 500.0  # exponent of two


def solve_scaled(
    cost: NDArray[np.float64],
    below: tuple[sps.csr_array, NDArray[np.float64]],
    equal: tuple[sps.csr_array, NDArray[np.float64]] | None = None,
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> LinearSolution:
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
    LinearSolution
        Its status is ``"failed"`` where all methods gave up; x is of use where it is
        ``"solved"``.

    Examples
    --------
    >>> import numpy as np, scipy.sparse as sps
    >>> rows = sps.csr_array(np.array([[-1e-9, 0.0], [0.0, -1e9]]))  # x >= 1e9, y >= 1e-9
    >>> found = solve_scaled(np.array([1e-9, 1e9]), (rows, np.array([-1.0, -1.0])))
    >>> found.status, np.allclose(found.x, [1e9, 1e-9], atol=0)
    ('solved', True)
    """
    free = (np.full(cost.size, -np.inf), np.full(cost.size, np.inf))
    low, high = bounds or free
    parts = [part for part in (below, equal) if part is not None and part[1].size]
    matrix = sps.vstack([part[0] for part in parts]) if parts else sps.csr_array((0, cost.size))
    right = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0)
    row, column = _scales(sps.csr_array(matrix), right)
    matrix = sps.csr_array(matrix.multiply(row[:, None]).multiply(column[None, :-1]))
    right, units = row * right * column[-1], column[:-1] / column[-1]
    bottom = np.where(np.arange(right.size) < below[1].size, -np.inf, right)
    weights = cost * units
    size = float(np.abs(weights).max(initial=0.0)) or 1.0
    for options in _TRIES:
        model = LinearModel(
            matrix, (bottom, right), (low / units, high / units), {**_TOLERANCES, **options}
        )
        found = model.solve(weights / size)
        if found.status != "failed":
            break
    prices = found.dual * row * (column[-1] * size)
    return replace(found, x=found.x * units, dual=prices, value=found.value * size)


def _scales(
    matrix: sps.csr_array, right: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose powers of two that scale rows, columns and right side to about one.

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
    ends = -_LARGEST_SCALE, _LARGEST_SCALE  # columns of subnormal numbers stay as good as zero
    return np.exp2(np.clip(np.round(row), *ends)), np.exp2(np.clip(np.round(column), *ends))
