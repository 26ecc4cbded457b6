"""Matrix games, which weight multipliers of the rows: max over p of min over q of p' T q.

p and q are weights >= 0 of rows and columns, each of sum 1. The simplex method on the table,
shifted until all entries are positive, gives both at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["matrix_game"]

Reals = NDArray[np.float64]


def matrix_game(table: Reals) -> tuple[Reals | None, Reals | None]:
    """Solve a matrix game: weights of rows (M,) for the most, of columns (K,) for the least."""
    rows, columns = table.shape
    size = float(np.abs(table).max(initial=0.0))
    if not (np.isfinite(size) and size > 0.0):
        return None, None
    pivots = np.zeros((rows + 1, columns + rows + 1))
    pivots[:rows, :columns] = table - float(table.min()) + size
    pivots[:rows, columns:-1], pivots[:rows, -1] = np.eye(rows), 1.0
    pivots[rows, :columns] = -1.0
    basic = np.arange(columns, columns + rows)
    for _ in range(200):
        column = int(np.argmin(pivots[rows, :-1]))
        entries = pivots[:rows, column]
        usable = entries > 1e-12 * size
        if pivots[rows, column] >= -1e-12 or not np.any(usable):
            break
        ratios = np.where(usable, pivots[:rows, -1] / np.where(usable, entries, 1.0), np.inf)
        row = int(np.argmin(ratios))
        pivots[row] /= pivots[row, column]
        others = pivots[:, column].copy()
        others[row] = 0.0
        pivots -= np.outer(others, pivots[row])
        basic[row] = column
    weights = np.maximum(pivots[rows, columns:-1], 0.0)
    mixture = np.zeros(columns + rows)
    mixture[basic] = pivots[:rows, -1]
    mixture = np.maximum(mixture[:columns], 0.0)
    if not (weights.sum() > 0.0 and mixture.sum() > 0.0):
        return None, None
    return weights / weights.sum(), mixture / mixture.sum()
