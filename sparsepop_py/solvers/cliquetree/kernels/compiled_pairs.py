"""The sums of the Newton matrix over single blocks, compiled.

References
----------
K. Fujisawa, M. Kojima, K. Nakata, Exploiting sparsity in primal-dual interior-point methods for
semidefinite programming, Math. Programming 79, 1997 (products by the nonzeros only).
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from sparsepop_py.solvers.cliquetree.kernels.compiled_blocks import pad, room_of, width_of
from sparsepop_py.solvers.cliquetree.kernels.machine import (
    LANES,
    WORD,
    filled,
    index,
    inline,
    jit,
    load,
    number,
    put,
    spread,
    store,
)

__all__ = ["pair_sums"]

_MANY = 4  # moments whose products are formed together


@inline
def _grown(sums, left, right):
    """Add multiples of one vector, the numbers from ``left`` on, to four vectors."""
    return (
        sums[0] + spread(left) * right,
        sums[1] + spread(left + WORD) * right,
        sums[2] + spread(left + 2 * WORD) * right,
        sums[3] + spread(left + 3 * WORD) * right,
    )


@inline
def _symmetric(out, at, row, column, weights, step, begin, end):
    """Compute four rows of eight entries of P A Z + Z A P.

    A is given by the nonzeros of its lower triangle. ``at`` has the first row of P and of Z from
    the first of the rows on, and from the first of the entries on.
    """
    sums = filled(0.0), filled(0.0), filled(0.0), filled(0.0)
    p_left, z_left, p_right, z_right = at
    for nonzero in range(begin, end):
        i, j = np.int64(row[nonzero]) * step, np.int64(column[nonzero]) * step
        weight = spread(weights + nonzero * WORD)
        p_i, p_j = weight * load(p_right + i), weight * load(p_right + j)
        z_i, z_j = weight * load(z_right + i), weight * load(z_right + j)
        sums = _grown(sums, p_left + i, z_j)
        sums = _grown(sums, z_left + i, p_j)
        sums = _grown(sums, p_left + j, z_i)
        sums = _grown(sums, z_left + j, p_i)
    for k in range(4):
        store(out + k * step, sums[k])


@inline
def _product(v, p, z, s, step, row, column, weights, begin, end):
    """Compute the lower triangle of P A Z + Z A P from A's nonzeros."""
    for i in range(0, s, 4):
        for t in range(0, min(i + 4, s) * WORD, LANES * WORD):
            at = p + i * WORD, z + i * WORD, p + t, z + t
            _symmetric(v + i * step + t, at, row, column, weights, step, begin, end)


@inline
def _weighed(weights, places, low, high, v):
    """Sum weight V over the nonzeros low to high - 1 of a moment."""
    total = 0.0
    for nonzero in range(low, high):
        at = nonzero * WORD
        total += number(weights + at) * number(v + index(places + at))
    return total


@inline
def _four_weighed(weights, places, low, high, v, step, out, n):
    """Sum weight V for four consecutive V, into rows of a triangle from n."""
    one, two, three, four = 0.0, 0.0, 0.0, 0.0
    for nonzero in range(low, high):
        at = nonzero * WORD
        weight, entry = number(weights + at), v + index(places + at)
        one += weight * number(entry)
        two += weight * number(entry + step)
        three += weight * number(entry + 2 * step)
        four += weight * number(entry + 3 * step)
    put(out, one)
    put(out + (n + 1) * WORD, two)
    put(out + (2 * n + 3) * WORD, three)
    put(out + (3 * n + 6) * WORD, four)


@jit
def pair_sums(inverse, dual, start, size, member, first, row, column, weight, low, high, result):
    """Compute <A_p, P A_q Z> of blocks for all pairs of their moments.

    Pairs p <= q; block k has the moments member[k] to member[k + 1]; moment p has the nonzeros
    first[p] to first[p + 1] of the lower triangle, weights of the diagonal halved. With
    V = P A_q Z + Z A_q P the result is the sum of weight V over the nonzeros of p; those of one q
    follow each other. Four q are taken at a time. Blocks run from low to high - 1.
    """
    room = room_of(size[low:high])
    work = np.zeros((2 + _MANY) * room)
    p_at, weights, out = work.ctypes.data, weight.ctypes.data, result.ctypes.data
    room *= WORD
    z_at, v_at = p_at + room, p_at + 2 * room
    most = np.int64(0)
    for k in range(low, high):
        most = max(most, first[member[k + 1]] - first[member[k]])
    place = np.empty(most, np.int64)  # of the entries of V that belong to the nonzeros
    for k in range(low, high):
        s, base, origin = size[k], member[k], first[member[k]]
        width = width_of(s)
        step = width * WORD
        pad(inverse, start[k], s, width, work, 0)
        pad(dual, start[k], s, width, work, room // WORD)
        for nonzero in range(origin, first[member[k + 1]]):
            place[nonzero - origin] = row[nonzero] * step + column[nonzero] * WORD
        places = place.ctypes.data - origin * WORD
        for some in range(base, member[k + 1], _MANY):
            many = min(_MANY, member[k + 1] - some)
            for q in range(some, some + many):
                v = v_at + (q - some) * room
                _product(v, p_at, z_at, s, step, row, column, weights, first[q], first[q + 1])
            alone = base
            if many == _MANY:
                alone = some
                for p in range(base, some):
                    begin, end, to = first[p], first[p + 1], out + (p - base) * WORD
                    _four_weighed(weights, places, begin, end, v_at, room, to, some - base)
            for q in range(some, some + many):
                v = v_at + (q - some) * room
                for p in range(alone, q + 1):
                    total = _weighed(weights, places, first[p], first[p + 1], v)
                    put(out + (p - base) * WORD, total)
                out += (q - base + 1) * WORD
