"""Forward substitution with a banded factor for many right-hand sides, compiled by numba.

LAPACK reads the factor once for each right-hand side. Here it is read once for all of them.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels.machine import jit

__all__ = ["forward"]


@jit
def forward(factor, rows):
    """Solve L x = r for each row r.

    Parameters
    ----------
    factor : (b + 1, n) float
        The lower band of L, as of ``scipy.linalg.cholesky_banded``.
    rows : (m, n) float

    Returns
    -------
    (n, m) float
        One solution a column.
    """
    width, size, count = factor.shape[0] - 1, rows.shape[1], rows.shape[0]
    found = np.empty((size, count))
    for i in range(size):
        mine = found[i]
        for c in range(count):
            mine[c] = rows[c, i]
        for d in range(min(width, i), 0, -1):
            entry, other = factor[d, i - d], found[i - d]
            for c in range(count):
                mine[c] -= entry * other[c]
        scale = 1.0 / factor[0, i]
        for c in range(count):
            mine[c] *= scale
    return found
