"""Compiled kernels on semidefinite blocks, taken one by one for the cache.

Block k has size[k]^2 entries from start[k] on, by rows. Work is done on copies whose rows are
padded to whole vectors; two rows are computed at a time, the last two again where their number
is odd. Numba frees an array after the last statement that names it, whatever is known of its
address, so these copies are parts of one array that every turn of a loop names.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels.compiled_lanczos import ritz
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
)

__all__ = ["inverse_factors", "inverses", "largest_step", "pad", "room_of", "sandwich", "width_of"]

_dpotrf = routine("lapack", "dpotrf", 5)
_dtrtri = routine("lapack", "dtrtri", 6)

_SMALL = 16  # size up to which calls of LAPACK cost more than they gain
_CLOSE = 0.999  # part of the longest step that is taken for it
_LETTERS = np.frombuffer(b"UN", np.uint8)


@inline
def width_of(size):
    """Round a size up to whole vectors, and at least two rows."""
    return (size + LANES - 1) // LANES * LANES


@inline
def room_of(size):
    """Count the doubles of the largest of so many blocks, padded."""
    width = width_of(size.max()) if size.size else LANES
    return width * width


@inline
def _two_rows(out, stride, a, row, step, x, width, low, high):
    """Sum products of numbers and vectors over k, for two rows.

    out[r * stride] = sum of a[r * row + k * step] * x[k * width] over k in [low, high), for
    r = 0, 1; all in bytes.
    """
    one, two = filled(0.0), filled(0.0)
    for k in range(low, high):
        vector, at = load(x + k * width), a + k * step
        one = one + spread(at) * vector
        two = two + spread(at + row) * vector
    store(out, one)
    store(out + stride, two)


@inline
def pad(x, begin, s, width, result, place):
    """Copy a block to rows of whole vectors."""
    for i in range(s):
        for j in range(s):
            result[place + i * width + j] = x[begin + i * s + j]


@inline
def _pad_turned(x, begin, s, width, result, place):
    for i in range(s):
        for j in range(s):
            result[place + j * width + i] = x[begin + i * s + j]


@inline
def _row(r, s):
    """Return the first of two rows; the last two where only one is left."""
    return r if r + 2 <= s else s - 2


@jit
def sandwich(left, middle, right, start, size, low, high, result):
    """Compute the symmetric part of P D Z of blocks low to high - 1."""
    room = room_of(size[low:high])
    work = np.zeros(3 * room)
    z_at = work.ctypes.data
    t_at, r_at = z_at + room * WORD, z_at + 2 * room * WORD
    for k in range(low, high):
        s, b = size[k], start[k]
        if s == 1:
            result[b] = left[b] * middle[b] * right[b]
            continue
        width = width_of(s)
        row, step = s * WORD, width * WORD
        pad(right, b, s, width, work, 0)
        p_at = left.ctypes.data + b * WORD
        d_at = middle.ctypes.data + b * WORD
        for t in range(0, step, LANES * WORD):
            for r in range(0, s, 2):
                i = _row(r, s)
                out, a = t_at + i * step + t, d_at + i * row
                _two_rows(out, step, a, row, WORD, z_at + t, step, 0, s)
            for r in range(0, s, 2):
                i = _row(r, s)
                out, a = r_at + i * step + t, p_at + i * row
                _two_rows(out, step, a, row, WORD, t_at + t, step, 0, s)
        for i in range(s):
            for j in range(i + 1):
                mean = 0.5 * (work[2 * room + i * width + j] + work[2 * room + j * width + i])
                result[b + i * s + j] = mean
                result[b + j * s + i] = mean


@jit
def _factorized(x, begin, s, width):
    """Lower Cholesky factor in place, diagonal inverted; whether there is one."""
    for j in range(s):
        jj = begin + j * width
        pivot = x[jj + j]
        for k in range(j):
            pivot -= x[jj + k] * x[jj + k]
        if not pivot > 0.0:
            return False
        inverse = 1.0 / np.sqrt(pivot)
        x[jj + j] = inverse
        for i in range(j + 1, s):
            ii = begin + i * width
            total = x[ii + j]
            for k in range(j):
                total -= x[ii + k] * x[jj + k]
            x[ii + j] = total * inverse
    return True


@inline
def _inverted(x, begin, s):
    """Invert the result of ``_factorized`` in place."""
    for j in range(s):
        for i in range(j + 1, s):
            ii = begin + i * s
            total = 0.0
            for k in range(j, i):
                total += x[ii + k] * x[begin + k * s + j]
            x[ii + j] = -total * x[ii + i]


@jit
def inverse_factors(x, start, size, low, high, result):
    """Compute inverse lower Cholesky factors; return the first block without one, or -1."""
    n, info = np.empty(1, np.int32), np.zeros(1, np.int32)
    upper, general = _LETTERS.ctypes.data, _LETTERS.ctypes.data + 1
    n_at, failed = n.ctypes.data, info.ctypes.data
    for k in range(low, high):
        s, b = size[k], start[k]
        for i in range(s):
            row = b + i * s
            for j in range(i + 1):
                result[row + j] = x[row + j]
            for j in range(i + 1, s):
                result[row + j] = 0.0
        if s <= _SMALL:
            if not _factorized(result, b, s, s):
                return k
            _inverted(result, b, s)
            continue
        n[0] = s
        pointer = result.ctypes.data + WORD * b
        _dpotrf(upper, n_at, pointer, n_at, failed)
        if info[0] != 0:
            return k
        _dtrtri(upper, general, n_at, pointer, n_at, failed)
        if info[0] != 0:
            return k
    return -1


@jit
def inverses(factor, start, size, low, high, result):
    """Compute F' F of the lower triangular blocks F from low to high - 1."""
    room = room_of(size[low:high])
    work = np.zeros(2 * room)
    f_at = work.ctypes.data
    r_at = f_at + room * WORD
    for k in range(low, high):
        s, b = size[k], start[k]
        if s == 1:
            result[b] = factor[b] * factor[b]
            continue
        width = width_of(s)
        step = width * WORD
        pad(factor, b, s, width, work, 0)
        for r in range(0, s, 2):
            i = _row(r, s)
            for t in range(0, step, LANES * WORD):
                a, x = f_at + i * WORD, f_at + t
                _two_rows(r_at + i * step + t, step, a, WORD, step, x, step, i, s)
        for i in range(s):
            for j in range(s):
                result[b + i * s + j] = work[room + i * width + j]


@inline
def _scaled(inverse, direction, b, s, width, room, work):
    """Put the lower triangle of L^-1 D L^-T into the last quarter of memory."""
    f_at = work.ctypes.data
    d_at, x_at, t_at = f_at + room * WORD, f_at + 2 * room * WORD, f_at + 3 * room * WORD
    row, step = s * WORD, width * WORD
    pad(direction, b, s, width, work, room)
    _pad_turned(inverse, b, s, width, work, 0)
    a_at = inverse.ctypes.data + b * WORD
    for r in range(0, s, 2):
        i = _row(r, s)
        for t in range(0, step, LANES * WORD):
            out, a = x_at + i * step + t, a_at + i * row
            _two_rows(out, step, a, row, WORD, d_at + t, step, 0, i + 2)
        for t in range(0, (i + 2) * WORD, LANES * WORD):
            out, a = t_at + i * step + t, x_at + i * step
            _two_rows(out, step, a, step, WORD, f_at + t, step, 0, i + 2)


@jit
def _moved(T, s, width, limit, result):
    """Compute the lower triangle of I + limit T and the squares of limit T."""
    square = 0.0
    for i in range(s):
        for j in range(i + 1):
            entry = limit * T[i * width + j]
            square += (2.0 if j < i else 1.0) * entry * entry
            result[i * s + j] = entry
        result[i * s + i] += 1.0
    return square


@jit
def _definite(x, s):
    """Check that a matrix has a Cholesky factor, which takes its place."""
    if s <= _SMALL:
        return _factorized(x, 0, s, s)
    n, info = np.array([s], np.int32), np.zeros(1, np.int32)
    n_at, upper = n.ctypes.data, _LETTERS.ctypes.data
    _dpotrf(upper, n_at, x.ctypes.data, n_at, info.ctypes.data)
    return n[0] == s and info[0] == 0  # which also keeps n alive


@jit
def largest_step(inverse, direction, start, size, low, high, limit):
    """Compute the largest a <= limit that keeps all L L' + a D semidefinite.

    T = L^-1 D L^-T has eigenvalues above minus its Frobenius norm, and I + a T has a Cholesky
    factor up to the step that is sought. An estimate of the least eigenvalue is usually confirmed
    at once, otherwise bisection goes on. The step returned is a little less than the longest one,
    lest a chain of almost equal blocks make every second one fail.
    """
    room = room_of(size[low:high])
    largest = size[low:high].max() if high > low else 1
    work, moved = np.zeros(4 * room), np.empty(largest**2)
    T = work[3 * room :]
    vectors, diagonal, beside = np.zeros((3, largest + LANES)), np.empty(largest), np.empty(largest)
    for k in range(low, high):
        s, b = size[k], start[k]
        if s == 1:
            ratio = direction[b] * inverse[b] * inverse[b]
            if ratio * limit < -1.0:
                limit = -1.0 / ratio
            continue
        width = width_of(s)
        _scaled(inverse, direction, b, s, width, room, work)
        square = _moved(T, s, width, limit, moved)
        if square < 1.0 or _definite(moved, s):
            continue
        good, bad = limit / np.sqrt(square), limit
        guess = ritz(T, s, width, vectors, diagonal, beside) * bad
        middle = bad * _CLOSE / -guess if guess < -1.0 else np.sqrt(good * bad)
        while good < _CLOSE * bad:
            _moved(T, s, width, middle, moved)
            if _definite(moved, s):
                good = middle
                if guess < -1.0:
                    break
            else:
                bad, guess = middle, 0.0
            middle = np.sqrt(good * bad)
        limit = good
    return limit
