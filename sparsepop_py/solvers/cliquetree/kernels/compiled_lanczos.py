"""An estimate of the least eigenvalue of a symmetric matrix, for the compiled kernels.

References
----------
C. Lanczos, An iteration method for the solution of the eigenvalue problem of linear differential
and integral operators, J. Res. Nat. Bur. Standards 45, 1950.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels.machine import (
    LANES,
    WORD,
    filled,
    inline,
    jit,
    load,
    spread,
    store,
)

__all__ = ["ritz"]

_LANCZOS = 20  # steps that find a least eigenvalue up to a thousandth, more or less


@inline
def _multiplied(T, x, s, width, y):
    """Write the product T x of a symmetric T to y."""
    step, n = width * WORD, s - s % 2
    for t in range(0, step, LANES * WORD):
        at, one, two = T.ctypes.data + t, filled(0.0), filled(0.0)
        for j in range(0, n, 2):
            one = one + spread(x.ctypes.data + j * WORD) * load(at + j * step)
            two = two + spread(x.ctypes.data + (j + 1) * WORD) * load(at + (j + 1) * step)
        if n < s:
            one = one + spread(x.ctypes.data + n * WORD) * load(at + n * step)
        store(y.ctypes.data + t, one + two)


@jit
def ritz(T, s, width, vectors, diagonal, beside):
    """Bound the least eigenvalue of T from above by a few Lanczos steps (1950)."""
    x, y, before = vectors[0], vectors[1], vectors[2]
    square = 0.0
    for i in range(s):
        for j in range(i):
            T[j * width + i] = T[i * width + j]
        x[i], before[i] = 1.0 + i / s, 0.0
        square += x[i] * x[i]
    size, last, count = np.sqrt(square), 0.0, 0
    for i in range(s):
        x[i] /= size
    for k in range(min(s, _LANCZOS)):
        _multiplied(T, x, s, width, y)
        along = 0.0
        for i in range(s):
            y[i] -= last * before[i]
            along += x[i] * y[i]
        square = 0.0
        for i in range(s):
            y[i] -= along * x[i]
            square += y[i] * y[i]
        last = np.sqrt(square)
        diagonal[k], beside[k], count = along, last, k + 1
        if last < 1e-9 * (1.0 + abs(along)):
            break
        for i in range(s):
            before[i], x[i] = x[i], y[i] / last
    return _least(diagonal, beside, count)


@inline
def _least(diagonal, beside, count):
    """Bound the least eigenvalue of a tridiagonal matrix from above, to a ten-thousandth."""
    low, high, last = diagonal[0], diagonal[0], 0.0
    for k in range(count):
        off = beside[k] if k + 1 < count else 0.0
        low, high = min(low, diagonal[k] - last - off), min(high, diagonal[k])
        last = off
    while high - low > 1e-4 * (abs(high) + 1e-9):
        middle = 0.5 * (low + high)
        pivot = diagonal[0] - middle
        for k in range(1, count):
            if pivot <= 0.0:
                break
            pivot = diagonal[k] - middle - beside[k - 1] * beside[k - 1] / pivot
        if pivot > 0.0:
            low = middle
        else:
            high = middle
    return high
