"""A random bilinear problem on a box."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py import Problem


class Bilinear:
    """min c'x + q'w, A x + B w <= b, w_k = x_i x_j, on a box, feasible at a planted point."""

    def __init__(self, seed, n=4, rows=3, feasible=True):
        rng = np.random.default_rng(seed)
        self.pairs = [(0, 1), (1, 2), (2, 3)]
        self.low = rng.integers(-2, 1, n).astype(float)
        self.high = self.low + rng.integers(1, 4, n)
        self.c, self.q = rng.integers(-3, 4, n) * 1.0, rng.integers(-3, 4, 3) * 1.0
        self.a = rng.integers(-2, 3, (rows, n)) * 1.0
        planted = rng.uniform(self.low, self.high)
        # a linear row and a product never stand in one row: no products of rows arise
        self.b = np.ceil(self.a @ planted) if feasible else self.a @ planted - 50.0
        x = sp.variables(n)
        objective = sp.total(
            [0.0 * x[0], *(c * v for c, v in zip(self.c, x, strict=True))]
            + [q * x[i] * x[j] for q, (i, j) in zip(self.q, self.pairs, strict=True)]
        )
        linear = [
            sp.total([0.0 * x[0], *(r * v for r, v in zip(row, x, strict=True))]) for row in self.a
        ]
        rows_ = [f <= b for f, b in zip(linear, self.b, strict=True)]
        self.problem = Problem(objective, rows_, self.low, self.high)

    def mccormick(self):
        """The least value over the envelopes of the three products, by linprog."""
        n, low, high = self.c.size, self.low, self.high
        rows, right = [np.append(r, np.zeros(3)) for r in self.a], list(self.b)
        for k, (i, j) in enumerate(self.pairs):
            for side_i, side_j in ((0, 0), (1, 1), (0, 1), (1, 0)):
                p, q = (low, high)[side_i][i], (low, high)[side_j][j]
                sign = 1.0 if side_i == side_j else -1.0  # sign (x_i - p)(x_j - q) >= 0
                row = np.zeros(n + 3)
                row[i], row[j], row[n + k] = sign * q, sign * p, -sign
                rows.append(row)
                right.append(sign * p * q)
        bounds = [*zip(low, high, strict=True), *[(None, None)] * 3]
        cost = np.append(self.c, self.q)
        return linprog(cost, A_ub=np.array(rows), b_ub=right, bounds=bounds, method="highs")
