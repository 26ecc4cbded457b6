"""Kernels compiled by numba, which call the BLAS and LAPACK that scipy carries.

Importing this module costs 0.4 s and, once per machine, the compilation; machine code is
cached by numba. Fronts and blocks are taken one by one, so that each stays in the cache of
the processor and costs no call of numpy.

Matrices are stored by rows, which LAPACK reads as their transposes by columns: what it calls
the upper triangle is the lower one here.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.extending import get_cython_function_address

__all__ = ["add_blocks", "factorize", "inverse_factors", "largest_step", "solve"]


def _routine(library: str, name: str, arguments: int) -> Any:
    """A routine of scipy by its address; all arguments are pointers."""
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    llvmlite.binding.add_symbol(f"cliquetree_{name}", address)
    return types.ExternalFunction(f"cliquetree_{name}", types.void(*[types.intp] * arguments))


_dpotrf = _routine("lapack", "dpotrf", 5)
_dtrtri = _routine("lapack", "dtrtri", 6)
_dsyev = _routine("lapack", "dsyev", 9)
_dtrsm = _routine("blas", "dtrsm", 11)
_dtrmm = _routine("blas", "dtrmm", 11)
_dsyrk = _routine("blas", "dsyrk", 10)
_dtrsv = _routine("blas", "dtrsv", 8)
_dgemv = _routine("blas", "dgemv", 11)

_jit = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
_WORD = 8  # bytes of a double
# What is passed by its address must outlive the call, so constants are global.
_LETTERS = np.frombuffer(b"ULRTN", np.uint8)
_ONES = np.array([1.0, -1.0, 0.0])


@numba.njit(inline="always")
def _letters():
    at = _LETTERS.ctypes.data
    return at, at + 1, at + 2, at + 3, at + 4


@numba.njit(inline="always")
def _ones():
    at = _ONES.ctypes.data
    return at, at + _WORD, at + 2 * _WORD


@_jit
def add_blocks(values, inverse, dual, start, size, member, first, row, column, weight, at, place):
    """Add <A_p, P A_q Z> of all blocks and all pairs p <= q of their moments.

    Block k has the moments member[k] to member[k + 1]; moment p has the nonzeros first[p] to
    first[p + 1] of the lower triangle, weights of the diagonal halved. With V = P A_p Z + Z A_p P
    the result is the sum of weight V over the nonzeros of q. It goes to place[at[k]:], row by row
    of the upper triangle.
    """
    taken = np.empty(size.max() ** 2)
    for k in range(size.size):
        s = np.uint32(size[k])
        P = inverse[start[k] : start[k] + s * s].reshape(s, s)
        Z = dual[start[k] : start[k] + s * s].reshape(s, s)
        V = taken[: s * s].reshape(s, s)
        target = at[k]
        for p in range(member[k], member[k + 1]):
            V[:] = 0.0
            for nonzero in range(first[p], first[p + 1]):
                i, j, w = row[nonzero], column[nonzero], weight[nonzero]
                Pi, Pj, Zi, Zj = P[i], P[j], Z[i], Z[j]
                for r in range(s):
                    a, b, c, d = w * Pi[r], w * Pj[r], w * Zi[r], w * Zj[r]
                    target_row = V[r]
                    for t in range(r + 1):
                        target_row[t] += a * Zj[t] + b * Zi[t] + c * Pj[t] + d * Pi[t]
            for q in range(p, member[k + 1]):
                total = 0.0
                for nonzero in range(first[q], first[q + 1]):
                    total += weight[nonzero] * V[row[nonzero], column[nonzero]]
                values[place[target]] += total
                target += 1


@_jit
def _extend_add(values, work, stack, source, to, base, e, u):
    """Add the update of a child to the pivots (values) and the update (work) of its parent."""
    inner = np.searchsorted(to, e)
    for i in range(to.size):
        row = source + i * to.size
        target = base + to[i] * e
        for j in range(min(inner, i + 1)):
            values[target + to[j]] += stack[row + j]
        target = (to[i] - e) * u - e
        for j in range(inner, i + 1):
            work[target + to[j]] += stack[row + j]


@_jit
def factorize(
    values,
    regularisation,
    least,
    low,
    high,
    pivots,
    updates,
    base,
    child,
    children,
    slot,
    slots,
    home,
    stack,
):
    """Factorize the fronts from low to high - 1 in place.

    Returns the number of the first one that is not definite, or -1. Front f has rows of
    ``pivots[f]`` entries from base[f] on, those of the pivots first. Its children are
    children[child[f]:child[f + 1]], its update goes to stack[home[f]:] and from there to the
    rows slots[slot[f]:slot[f + 1]] of its parent.
    """
    work = np.empty(max(1, updates.max() ** 2))
    n, info = np.empty(3, np.int32), np.zeros(1, np.int32)
    upper, left, _, transpose, general = _letters()
    plus, minus, _ = _ones()
    n1, n2 = n.ctypes.data, n.ctypes.data + 4
    for f in range(low, high):
        e, u, b = pivots[f], updates[f], base[f]
        for i in range(u):
            work[i * u : i * u + i + 1] = 0.0
        for number in range(child[f], child[f + 1]):
            c = children[number]
            to = slots[slot[c] : slot[c + 1]]
            _extend_add(values, work, stack, home[c], to, b, e, u)
        for i in range(e):
            at = b + i * e + i
            values[at] += regularisation * values[at] + least
        pointer = values.ctypes.data + _WORD * b
        n[0], n[1] = e, u
        _dpotrf(upper, n1, pointer, n1, info.ctypes.data)
        if info[0] != 0:
            return f
        if u:
            below = pointer + _WORD * e * e
            _dtrsm(left, upper, transpose, general, n1, n2, plus, pointer, n1, below, n1)
            _dsyrk(upper, transpose, n2, n1, minus, below, n1, plus, work.ctypes.data, n2)
            for i in range(u):
                to_row = home[f] + i * u
                stack[to_row : to_row + i + 1] = work[i * u : i * u + i + 1]
    return -1


@_jit
def solve(values, x, pivots, updates, base, first, columns):
    """Solve in place with the factors of ``factorize``; front f has columns[first[f]:]."""
    n = np.ones(3, np.int32)
    upper, _, _, transpose, general = _letters()
    plus, minus, zero = _ones()
    n1, n2, step = n.ctypes.data, n.ctypes.data + 4, n.ctypes.data + 8
    part = np.empty(max(1, (pivots + updates).max()))
    top = part.ctypes.data
    for f in range(pivots.size):
        e, u = pivots[f], updates[f]
        n[0], n[1] = e, u
        pointer = values.ctypes.data + _WORD * base[f]
        own = columns[first[f] : first[f + 1]]
        for i in range(e):
            part[i] = x[own[i]]
        _dtrsv(upper, transpose, general, n1, pointer, n1, top, step)
        for i in range(e):
            x[own[i]] = part[i]
        if u:
            below, rest = pointer + _WORD * e * e, top + _WORD * e
            _dgemv(transpose, n1, n2, plus, below, n1, top, step, zero, rest, step)
            for i in range(e, e + u):
                x[own[i]] -= part[i]
    for f in range(pivots.size - 1, -1, -1):
        e, u = pivots[f], updates[f]
        n[0], n[1] = e, u
        pointer = values.ctypes.data + _WORD * base[f]
        own = columns[first[f] : first[f + 1]]
        for i in range(e + u):
            part[i] = x[own[i]]
        if u:
            below, rest = pointer + _WORD * e * e, top + _WORD * e
            _dgemv(general, n1, n2, minus, below, n1, rest, step, plus, top, step)
        _dtrsv(upper, general, general, n1, pointer, n1, top, step)
        for i in range(e):
            x[own[i]] = part[i]


@_jit
def inverse_factors(x, start, size, result):
    """Inverse lower Cholesky factors of all blocks; the first one without, or -1."""
    n, info = np.empty(1, np.int32), np.zeros(1, np.int32)
    upper, _, _, _, general = _letters()
    for k in range(size.size):
        s, b = size[k], start[k]
        for i in range(s):
            row = b + i * s
            result[row : row + i + 1] = x[row : row + i + 1]
            result[row + i + 1 : row + s] = 0.0
        n[0] = s
        pointer, size_of = result.ctypes.data + _WORD * b, n.ctypes.data
        _dpotrf(upper, size_of, pointer, size_of, info.ctypes.data)
        if info[0] != 0:
            return k
        _dtrtri(upper, general, size_of, pointer, size_of, info.ctypes.data)
        if info[0] != 0:
            return k
    return -1


@_jit
def largest_step(inverse, direction, start, size, limit):
    """The largest a <= limit that keeps all L L' + a D semidefinite, by inverse factors."""
    largest = size.max() if size.size else 1
    scaled, moved = np.empty(largest**2), np.empty(largest**2)
    values, work = np.empty(largest), np.empty(8 * largest)
    n, info = np.empty(2, np.int32), np.zeros(1, np.int32)
    upper, left, right, transpose, general = _letters()
    one, _, _ = _ones()
    for k in range(size.size):
        s, b = size[k], start[k]
        n[0], n[1] = s, work.size
        size_of, failed = n.ctypes.data, info.ctypes.data
        scaled[: s * s] = direction[b : b + s * s]
        factor = inverse.ctypes.data + _WORD * b
        T = scaled.ctypes.data
        _dtrmm(left, upper, transpose, general, size_of, size_of, one, factor, size_of, T, size_of)
        _dtrmm(right, upper, general, general, size_of, size_of, one, factor, size_of, T, size_of)
        for i in range(s * s):
            moved[i] = limit * scaled[i]
        for i in range(s):
            moved[i * s + i] += 1.0
        _dpotrf(upper, size_of, moved.ctypes.data, size_of, failed)
        if info[0] == 0:
            continue
        lwork = n.ctypes.data + 4
        found = values.ctypes.data
        _dsyev(general, upper, size_of, T, size_of, found, work.ctypes.data, lwork, failed)
        if values[0] * limit < -1.0:
            limit = -1.0 / values[0]
    return limit
