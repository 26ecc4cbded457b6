"""Kernels compiled by numba, which call the BLAS and LAPACK that scipy carries.

Importing this module costs 0.4 s and, once per machine, the compilation; machine code is
cached by numba. Fronts and blocks are taken one by one, so that each stays in the cache of
the processor and costs no call of numpy.

Matrices are stored by rows, which LAPACK reads as their transposes by columns: what it calls
the upper triangle is the lower one here.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels import compiled_blocks as blocks
from sparsepop_py.solvers.cliquetree.kernels import compiled_lanes as lanes
from sparsepop_py.solvers.cliquetree.kernels import compiled_pairs as pairs
from sparsepop_py.solvers.cliquetree.kernels.machine import (
    LANES,
    WORD,
    filled,
    inline,
    jit,
    load,
    routine,
    spread,
    store,
    total,
)

__all__ = ["blocks", "factorize", "lanes", "pairs", "scatter", "solve"]

_dpotrf = routine("lapack", "dpotrf", 5)
_dlacpy = routine("lapack", "dlacpy", 7)
_dtrtri = routine("lapack", "dtrtri", 6)
_dgemm = routine("blas", "dgemm", 13)
_dtrmm = routine("blas", "dtrmm", 11)
_dtrsm = routine("blas", "dtrsm", 11)
_dsyrk = routine("blas", "dsyrk", 10)

_PANEL = 64  # rows of a front that are eliminated together
# What is passed by its address must outlive the call, so constants are global.
_LETTERS = np.frombuffer(b"ULRTN", np.uint8)
_ONES = np.array([1.0, -1.0, 0.0])


@inline
def _letters():
    at = _LETTERS.ctypes.data
    return at, at + 1, at + 2, at + 3, at + 4


@inline
def _ones():
    at = _ONES.ctypes.data
    return at, at + WORD, at + 2 * WORD


@jit
def _extend_add(values, work, stack, source, to, base, e, u):
    """Add a child's update to pivots (values) and update (work) of its parent."""
    inner = np.searchsorted(to, e)
    for i in range(to.size):
        row = source + i * to.size
        target = base + to[i] * e
        for j in range(min(inner, i + 1)):
            values[target + to[j]] += stack[row + j]
        target = (to[i] - e) * u - e
        for j in range(inner, i + 1):
            work[target + to[j]] += stack[row + j]


@jit
def _eliminate(front, e, u, inverse):
    """Replace pivots and columns behind them by the e rows of U, U'U the pivots.

    Rows are taken in panels, and triangles of a panel are inverted: products of matrices run at
    almost twice the speed of LAPACK's Cholesky factorization and of triangular solves.
    """
    n, info = np.empty(5, np.int32), np.zeros(1, np.int32)
    upper, left, _, transpose, general = _letters()
    plus, minus, _ = _ones()
    rows = n.ctypes.data
    ahead, wide, further, stride = rows + 4, rows + 8, rows + 12, rows + 16
    n[3], n[4] = u, e
    for j in range(0, e, _PANEL):
        m = min(_PANEL, e - j)
        n[0], n[1], n[2] = m, e - j - m, e - j - m + u
        corner = front + WORD * (j * e + j)
        _dpotrf(upper, rows, corner, stride, info.ctypes.data)
        if info[0] != 0:
            return False
        if n[2] == 0:
            break
        right, beyond = corner + WORD * m * e, front + WORD * (e * e + j)
        if m == e:
            _dtrsm(left, upper, transpose, general, rows, wide, plus, corner, stride, right, stride)
            break
        triangle = inverse.ctypes.data
        _dlacpy(upper, rows, rows, corner, stride, triangle, rows)
        _dtrtri(upper, general, rows, triangle, rows, info.ctypes.data)
        _dtrmm(left, upper, transpose, general, rows, wide, plus, triangle, rows, right, stride)
        if n[1]:
            _dsyrk(
                upper, transpose, ahead, rows, minus, right, stride, plus, right + WORD * m, stride
            )
        if n[1] and u:
            _dgemm(
                transpose,
                general,
                ahead,
                further,
                rows,
                minus,
                right,
                stride,
                beyond,
                stride,
                plus,
                beyond + WORD * m,
                stride,
            )
    return n[4] == e  # which also keeps n alive: it is passed by its address


@jit
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
    n, inner = np.empty(2, np.int32), np.empty(_PANEL**2)
    upper, _, _, transpose, _ = _letters()
    plus, minus, _ = _ones()
    n1, n2 = n.ctypes.data, n.ctypes.data + 4
    for f in range(low, high):
        e, u, b = pivots[f], updates[f], base[f]
        for i in range(u):
            for j in range(i * u, i * u + i + 1):
                work[j] = 0.0
        for number in range(child[f], child[f + 1]):
            c = children[number]
            to = slots[slot[c] : slot[c + 1]]
            _extend_add(values, work, stack, home[c], to, b, e, u)
        for i in range(e):
            at = b + i * e + i
            values[at] += regularisation * values[at] + least
        pointer = values.ctypes.data + WORD * b
        if not _eliminate(pointer, e, u, inner):
            return f
        if u:
            below = pointer + WORD * e * e
            n[0], n[1] = e, u
            _dsyrk(upper, transpose, n2, n1, minus, below, n1, plus, work.ctypes.data, n2)
            for i in range(u):
                for j in range(i * u, i * u + i + 1):
                    stack[home[f] + j] = work[j]
    return -1


@jit
def scatter(values, sums, place, low, high):
    """Add sums one after the other to values at places low to high - 1."""
    for k in range(low, high):
        values[np.int64(place[k])] += sums[k - low]


@inline
def _row(front, known, width):
    """Multiply a row of a front by known values."""
    found = filled(0.0)
    for at in range(0, width * WORD, LANES * WORD):
        found = found + load(front + at) * load(known + at)
    return total(found)


@inline
def _rows(values, base, e, low, high, known, width, x):
    """Subtract products of rows low to high - 1 with known values, four at once."""
    step, n = e * WORD, known.ctypes.data
    for i in range(low, high - 3, 4):
        at = values.ctypes.data + (base + i * e) * WORD
        one, two, three, four = filled(0.0), filled(0.0), filled(0.0), filled(0.0)
        for k in range(0, width * WORD, LANES * WORD):
            vector = load(n + k)
            one = one + load(at + k) * vector
            two = two + load(at + step + k) * vector
            three = three + load(at + 2 * step + k) * vector
            four = four + load(at + 3 * step + k) * vector
        x[i] -= total(one)
        x[i + 1] -= total(two)
        x[i + 2] -= total(three)
        x[i + 3] -= total(four)
    for i in range(high - (high - low) % 4, high):
        x[i] -= _row(values.ctypes.data + (base + i * e) * WORD, n, width)


@inline
def _column(values, base, e, k, high, x):
    """Subtract the products of later rows and entries of x from x[k:k + 8]."""
    step, at = e * WORD, values.ctypes.data + (base + k) * WORD
    x_at = x.ctypes.data
    one, two = load(x_at + k * WORD), filled(0.0)
    three, four = filled(0.0), filled(0.0)
    low = min(k + LANES, e)
    end = high - (high - low) % 4
    for i in range(low, end, 4):
        row, number = at + i * step, x_at + i * WORD
        one = one - spread(number) * load(row)
        two = two + spread(number + WORD) * load(row + step)
        three = three + spread(number + 2 * WORD) * load(row + 2 * step)
        four = four + spread(number + 3 * WORD) * load(row + 3 * step)
    for i in range(end, high):
        two = two + spread(x_at + i * WORD) * load(at + i * step)
    return one - (two + three + four)


@inline
def _forward(values, b, e, n, part, known):
    """Solve with the pivots of a front, and take what is known from its updates."""
    for k in range(0, e, LANES):
        end = min(k + LANES, e)
        _rows(values, b, e, k, end, known, k, part)
        for i in range(k, end):
            number = part[i]
            for j in range(k, i):
                number -= values[b + i * e + j] * known[j]
            known[i] = number / values[b + i * e + i]
    for i in range(e, e + LANES):
        known[i] = 0.0
    _rows(values, b, e, e, n, known, e, part)


@inline
def _backward(values, b, e, n, part, found):
    """Solve with the transposed pivots of a front, its updates known."""
    for k in range((e - 1) // LANES * LANES, -1, -LANES):
        store(found.ctypes.data, _column(values, b, e, k, n, part))
        for i in range(min(k + LANES, e) - 1, k - 1, -1):
            number = found[i - k] / values[b + i * e + i]
            part[i] = number
            for j in range(k, i):
                found[j - k] -= values[b + i * e + j] * number


@jit
def solve(values, x, pivots, updates, base, first, columns):
    """Solve in place with the factors of ``factorize``; front f has columns[first[f]:].

    Eight pivots at a time: what is known is taken from them in vectors, then they are solved
    for one by one. Vectors may reach beyond a row, where what is known is zero.
    """
    room = (pivots + updates).max() + LANES if pivots.size else 1
    part, known, found = np.zeros(room), np.zeros(room), np.zeros(LANES)
    for f in range(pivots.size):
        e, n = pivots[f], pivots[f] + updates[f]
        own = columns[first[f] : first[f + 1]]
        for i in range(n):
            part[i] = x[own[i]]
        _forward(values, base[f], e, n, part, known)
        for i in range(e):
            x[own[i]] = known[i]
        for i in range(e, n):
            x[own[i]] = part[i]
    for f in range(pivots.size - 1, -1, -1):
        e, n = pivots[f], pivots[f] + updates[f]
        own = columns[first[f] : first[f + 1]]
        for i in range(n):
            part[i] = x[own[i]]
        _backward(values, base[f], e, n, part, found)
        for i in range(e):
            x[own[i]] = part[i]
