"""Flows that are mixed and split: pooling and separation problems with known optima.

References
----------
C. A. Haverly, Studies of the behavior of recursion for the pooling problem, ACM SIGMAP
Bulletin 25 (1978) 19-28.
A. Ben-Tal, G. Eiger, V. Gershovitz, Global minimization by reducing the duality gap, Math.
Programming 63 (1994) 193-212.
C. A. Floudas et al., Handbook of Test Problems in Local and Global Optimization, Kluwer,
1999, problems 5.2.5 and 5.3.2.
"""

from __future__ import annotations

import numpy as np

import sparsepop_py as sp

from ..measuring.registry import Task

__all__ = ["haverly", "pooling", "separation"]

_PRICES = (18.0, 15.0, 19.0, 16.0, 14.0)
_DEMANDS = (100.0, 200.0, 100.0, 100.0, 100.0)
_COSTS = (6.0, 16.0, 15.0, 12.0)  # of four sources that feed pools; the fifth costs 10
_QUALITIES = ((3.0, 1.0, 1.0, 1.5), (1.0, 3.0, 2.5, 2.5))
_DIRECT = (2.0, 2.5)  # qualities of the fifth source
_LIMITS = ((2.5, 1.5, 2.0, 2.0, 2.0), (2.0, 2.5, 2.6, 2.0, 2.0))


def haverly(price: float, cap: float, profit: float) -> Task:
    """Two crudes share a pool of sulphur content p, a third goes straight into two products.

    Parameters
    ----------
    price : float
        Of the second crude.
    cap : float
        Demand of the first product.
    profit : float
        The optimum: 400 for (16, 100), 600 for (16, 600), 750 for (13, 100).
    """
    names = ["a", "b", "px", "py", "cx", "cy", "p"]
    a, b, px, py, cx, cy, p = sp.variables(7, names)
    cost = 6 * a + price * b + 10 * (cx + cy) - 9 * (px + cx) - 15 * (py + cy)
    rows = [
        a + b == px + py,
        3 * a + b == p * (px + py),
        p * px + 2 * cx <= 2.5 * (px + cx),
        p * py + 2 * cy <= 1.5 * (py + cy),
        px + cx <= cap,
        py + cy <= 200,
    ]
    upper = [cap + 200, cap + 200, cap, 200, cap, 200, 3]
    return Task.of(sp.Problem(cost, rows, [0.0] * 6 + [1.0], upper), -profit)


def pooling() -> Task:
    """Four sources in three pools, a fifth one direct, five products of two qualities.

    q[i, p] is the share of source i in pool p, y[p, j] the flow from pool p to product j and
    z[j] the direct flow; 32 variables, 60 products. Optimum -3500 (Handbook, 5.2.5).
    """
    x = sp.variables(32)
    q = np.array(x[:12], object).reshape(4, 3)
    z, y = x[12:17], np.array(x[17:], object).reshape(3, 5)
    profit = [
        (price - 10.0) * z[j] + sp.total([price * y[p, j] for p in range(3)])
        for j, price in enumerate(_PRICES)
    ]
    mixed = [(q[i, p], y[p, j], i, j) for i in range(4) for p in range(3) for j in range(5)]
    cost = sp.total([_COSTS[i] * share * flow for share, flow, i, _ in mixed])
    rows = [sp.total([share * flow for share, flow, i, _ in mixed if i == 2]) <= 50]
    for j, demand in enumerate(_DEMANDS):
        into = sp.total([z[j], *y[:, j]])
        rows.append(into <= demand)
        for quality, direct, limit in zip(_QUALITIES, _DIRECT, _LIMITS, strict=True):
            held = [quality[i] * share * flow for share, flow, i, k in mixed if k == j]
            rows.append(direct * z[j] + sp.total(held) <= limit[j] * into)
    rows += [sp.total(list(q[:, p])) == 1 for p in range(3)]
    upper = [1.0] * 12 + [*_DEMANDS] * 4
    return Task.of(sp.Problem(cost - sp.total(profit), rows, 0.0, upper), -3500.0)


def separation() -> Task:
    """Three components in a stream that splitters and two columns turn into two products.

    22 variables, 16 equations, objective linear. Optimum 1.8642 (Handbook, 5.3.2).
    """
    names = [f"x{v}" for v in range(1, 23)]
    x = dict(zip(range(1, 23), sp.variables(22, names), strict=True))
    feed = 0.333
    rows = [
        x[1] + x[2] + x[3] + x[4] == 300,
        x[5] == x[6] + x[7],
        x[8] == x[9] + x[10] + x[11],
        x[12] == x[13] + x[14] + x[15],
        x[16] == x[17] + x[18],
        x[13] * x[21] + feed * x[1] == x[5],
        x[13] * x[22] + feed * x[1] == x[8] * x[20],
        feed * x[1] == x[8] * x[19],
        x[12] * x[21] + feed * x[2] == 0,
        x[9] * x[20] + feed * x[2] == x[12] * x[22],
        x[9] * x[19] + feed * x[2] == x[16],
        x[14] * x[21] + feed * x[3] + x[6] == 30,
        x[10] * x[20] + x[14] * x[22] + feed * x[3] == 50,
        x[10] * x[19] + feed * x[3] + x[17] == 30,
        x[19] + x[20] == 1,
        x[21] + x[22] == 1,
    ]
    cost = 0.9979 + 0.00432 * (x[1] + x[13]) + 0.01517 * (x[2] + x[9])
    return Task.of(sp.Problem(cost, rows, 0.0, [300.0] * 18 + [1.0] * 4), 1.86415946)
