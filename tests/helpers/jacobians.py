"""Dense Jacobians from the entries that the package encloses."""

from __future__ import annotations

import numpy as np

from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import jacobian_range

__all__ = ["dense_jacobian_range"]


def dense_jacobian_range(system, box):
    """Fill the entries into a table; each place may have one."""
    rows, variables, entries = jacobian_range(system, box)
    assert np.unique(rows * system.dimension + variables).size == rows.size
    low, high = np.zeros((2, system.size, system.dimension))
    low[rows, variables], high[rows, variables] = entries.lo, entries.hi
    return Interval(low, high)
