"""Compiled kernels on eight semidefinite blocks of one size and pattern at a time.

Group k has size[k]^2 vectors of eight doubles from start[k] on, by rows: the entries at one
place of eight blocks. So small blocks need no padding, and what is sequential in one block, such
as a Cholesky factorization, is done in eight at once. Numba frees an array after the last
statement that names it, whatever is known of its address, so every turn of a loop names it.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels.machine import (
    LANES,
    WORD,
    all_positive,
    filled,
    inline,
    jit,
    largest,
    load,
    root,
    store,
)

__all__ = ["inverse_factors", "inverses", "largest_step", "pair_sums", "sandwich"]

_STEP = LANES * WORD  # bytes of a vector
_CLOSE = 0.999  # how close to the longest step is close enough


@inline
def _room(size):
    most = size.max() if size.size else 1
    return most * most * LANES


@inline
def _dot(total, a, a_step, b, b_step, low, high):
    """Subtract the sum of a_k b_k from a vector."""
    for k in range(low, high):
        total = total - load(a + k * a_step) * load(b + k * b_step)
    return total


@inline
def _product(a, a_step, b, b_step, low, high):
    """Compute the sum of a_k b_k."""
    total = filled(0.0)
    for k in range(low, high):
        total = total + load(a + k * a_step) * load(b + k * b_step)
    return total


@jit
def sandwich(left, middle, right, start, size, low, high, result):
    """Compute the symmetric part of P D Z of groups low to high - 1."""
    work = np.zeros(_room(size[low:high]))
    half = filled(0.5)
    for k in range(low, high):
        s, b, t_at = size[k], start[k] * WORD, work.ctypes.data
        row = s * _STEP
        p_at, d_at = left.ctypes.data + b, middle.ctypes.data + b
        z_at, r_at = right.ctypes.data + b, result.ctypes.data + b
        for i in range(s):
            for j in range(s):
                total = _product(d_at + i * row, _STEP, z_at + j * row, _STEP, 0, s)
                store(t_at + j * row + i * _STEP, total)
        for i in range(s):
            for j in range(i + 1):
                p_i, p_j, t_i, t_j = p_at + i * row, p_at + j * row, t_at + i * row, t_at + j * row
                total = filled(0.0)
                for m in range(s):
                    at = m * _STEP
                    total = total + load(p_i + at) * load(t_j + at)
                    total = total + load(p_j + at) * load(t_i + at)
                total = total * half
                store(r_at + i * row + j * _STEP, total)
                store(r_at + j * row + i * _STEP, total)


@jit
def _factorized(x, s):
    """Lower Cholesky factors in place, diagonals inverted; whether all eight have one."""
    row, good = s * _STEP, True
    for j in range(s):
        jj = x + j * row
        pivot = _dot(load(jj + j * _STEP), jj, _STEP, jj, _STEP, 0, j)
        if not all_positive(pivot):
            good = False
            break
        inverse = filled(1.0) / root(pivot)
        store(jj + j * _STEP, inverse)
        for i in range(j + 1, s):
            ii = x + i * row
            total = _dot(load(ii + j * _STEP), ii, _STEP, jj, _STEP, 0, j)
            store(ii + j * _STEP, total * inverse)
    return good


@jit
def inverse_factors(x, start, size, low, high, result):
    """Compute inverse lower Cholesky factors; return the first group without one, or -1."""
    nothing = filled(0.0)
    for k in range(low, high):
        s, b = size[k], start[k] * WORD
        row = s * _STEP
        x_at, r_at = x.ctypes.data + b, result.ctypes.data + b
        for i in range(s):
            for j in range(s):
                at = i * row + j * _STEP
                store(r_at + at, load(x_at + at) if j <= i else nothing)
        if not _factorized(r_at, s):
            return k
        for j in range(s):
            for i in range(j + 1, s):
                ii = r_at + i * row
                total = _dot(nothing, ii, _STEP, r_at + j * _STEP, row, j, i)
                store(ii + j * _STEP, total * load(ii + i * _STEP))
    return -1


@jit
def inverses(factor, start, size, low, high, result):
    """Compute F' F of lower triangular blocks F of groups low to high - 1."""
    for k in range(low, high):
        s, b = size[k], start[k] * WORD
        row = s * _STEP
        f_at, r_at = factor.ctypes.data + b, result.ctypes.data + b
        for i in range(s):
            for j in range(i + 1):
                total = _product(f_at + i * _STEP, row, f_at + j * _STEP, row, i, s)
                store(r_at + i * row + j * _STEP, total)
                store(r_at + j * row + i * _STEP, total)


@inline
def _scaled(f_at, d_at, s, x_at, t_at):
    """Compute the lower triangles of T = F D F'."""
    row = s * _STEP
    for i in range(s):
        for j in range(s):
            total = _product(f_at + i * row, _STEP, d_at + j * row, _STEP, 0, i + 1)
            store(x_at + j * _STEP, total)
        for j in range(i + 1):
            total = _product(x_at, _STEP, f_at + j * row, _STEP, 0, j + 1)
            store(t_at + i * row + j * _STEP, total)


@jit
def _inside(t_at, s, limit, moved):
    """Check that all eight I + limit T are positive definite."""
    row, factor = s * _STEP, filled(limit)
    for i in range(s):
        for j in range(i + 1):
            at = i * row + j * _STEP
            store(moved + at, load(t_at + at) * factor)
        at = i * row + i * _STEP
        store(moved + at, load(moved + at) + filled(1.0))
    return _factorized(moved, s)


@jit
def largest_step(inverse, direction, start, size, low, high, limit):
    """Compute the largest a <= limit that keeps all L L' + a D semidefinite.

    T = L^-1 D L^-T has eigenvalues above minus its Frobenius norm, and I + a T has a Cholesky
    factor up to the step that is sought, which is found up to a thousandth by bisection.
    """
    room = _room(size[low:high])
    work = np.zeros(3 * room)
    for k in range(low, high):
        s, b, x_at = size[k], start[k] * WORD, work.ctypes.data
        t_at, moved = x_at + room * WORD, x_at + 2 * room * WORD
        row = s * _STEP
        _scaled(inverse.ctypes.data + b, direction.ctypes.data + b, s, x_at, t_at)
        square = filled(0.0)
        for i in range(s):
            half = filled(0.0)
            for j in range(i):
                entry = load(t_at + i * row + j * _STEP)
                half = half + entry * entry
            entry = load(t_at + i * row + i * _STEP)
            square = square + half + half + entry * entry
        norm = np.sqrt(largest(square))
        if norm * limit < 1.0 or _inside(t_at, s, limit, moved):
            continue
        good, bad = 1.0 / norm, limit
        while good < _CLOSE * bad:
            middle = np.sqrt(good * bad)
            if _inside(t_at, s, middle, moved):
                good = middle
            else:
                bad = middle
        limit = good
    return limit


@jit
def pair_sums(inverse, dual, start, size, member, first, row, column, weight, low, high, result):
    """Compute <A_p, P A_q Z> of groups for all pairs of their moments.

    Pairs p <= q; group k has the moments member[k] to member[k + 1]; moment p has the nonzeros
    first[p] to first[p + 1] of the lower triangle, each with eight weights, those of the diagonal
    halved. Groups run from low to high - 1.
    """
    weights, out = weight.ctypes.data, result.ctypes.data
    for k in range(low, high):
        line, b = size[k] * _STEP, start[k] * WORD
        p_at, z_at = inverse.ctypes.data + b, dual.ctypes.data + b
        for q in range(member[k], member[k + 1]):
            for p in range(member[k], q + 1):
                total = filled(0.0)
                for second in range(first[q], first[q + 1]):
                    i, j = np.int64(row[second]) * _STEP, np.int64(column[second]) * _STEP
                    p_i, p_j, z_i, z_j = p_at + i, p_at + j, z_at + i, z_at + j
                    part = filled(0.0)
                    for nonzero in range(first[p], first[p + 1]):
                        m, n = np.int64(row[nonzero]) * line, np.int64(column[nonzero]) * line
                        entry = load(p_i + m) * load(z_j + n) + load(p_j + m) * load(z_i + n)
                        entry = entry + load(z_i + m) * load(p_j + n)
                        entry = entry + load(z_j + m) * load(p_i + n)
                        part = part + entry * load(weights + nonzero * _STEP)
                    total = total + part * load(weights + second * _STEP)
                store(out, total)
                out += _STEP
