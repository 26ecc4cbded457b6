"""Steps of the linear program of a cone, compiled by numba.

The same functions as in ``plain_steps.py``. What is made of an entry is made in one pass, and the
banded factor is read once for all right-hand sides. Row i of an array of the factor holds column i
of its lower band, padded to whole vectors, with the inverse of the diagonal entry. Python's lock is
free meanwhile. What is compiled fills arrays that are given to it and returns a number or nothing:
for other results numba calls Python, and does not survive an interrupt that is raised there.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import numpy as np

from setid.minimum_noise.cones.plain_steps import Half, Reduced, Sized, Totals
from sparsepop_py.solvers.cliquetree.kernels.machine import (
    LANES,
    WORD,
    filled,
    is_kept,
    jit,
    load,
    spread,
    store,
    total,
)

__all__ = ["advanced", "are_kept", "backward", "eliminated", "forward"]

_BLOCK = LANES * WORD
_ROWS = 128  # whose products are added at once


def are_kept() -> bool:
    """Check that no step has to be compiled."""
    return all(map(is_kept, (_advanced, _backward, _eliminated, _forward)))


def eliminated(at, weights, fixed):
    """Eliminate sizes, factor the matrix of multipliers, and solve for the columns beside it."""
    shape, (count, width), pairs = at.sizes.shape, fixed.columns.shape, len(weights)
    reach = _padded(len(fixed.vectors) ** 2)
    solved = np.zeros((count + reach, reach)), fixed.columns.copy(), np.zeros(pairs)
    both, skew = np.empty((2, *shape))
    found = both, skew, *solved, np.zeros((width, width)), np.zeros(count)
    return Reduced(_eliminated(at, weights, fixed, found), *found)


def forward(aim, at, step, now, fixed, reduced):
    """Solve for half of a direction in which products of slacks and duals become ``aim``."""
    shape, (count, width) = at.sizes.shape, fixed.columns.shape
    first, second, size = np.empty((3, *shape))
    found = Half(first, second, size, np.zeros(shape[0]), np.empty(count), np.empty(width))
    _forward(aim, at, step, now, fixed, reduced, found)
    return found


def backward(solved, half, at, change, fixed, reduced):
    """Solve for the other half of a direction."""
    size, samples = len(fixed.vectors), fixed.w.size
    padded, filtered = np.zeros((size, samples + size - 1)), np.zeros(at.sizes.shape)
    one, two, three = np.empty((3, *at.sizes.shape))
    sized, least, sums = Sized(one, filtered, two, three), np.zeros(2), np.zeros(4)
    _backward(solved, half, at, change, fixed, reduced, (padded, sized, least, sums))
    return padded[:, size - 1 : samples].copy(), sized, least, sums


def advanced(at, step, primal, dual, multipliers, fixed):
    """Go a part of a direction, in sizes and in their dual values."""
    shape, width = at.sizes.shape, fixed.columns.shape[1]
    sized = Sized(*np.empty((4, *shape)))
    totals = Totals(np.zeros(shape[0]), np.zeros(shape[0]), np.empty(width))
    _advanced(at, step, primal, dual, multipliers, fixed, sized, totals)
    return sized, totals


def _padded(width: int) -> int:
    """Round a width up to whole vectors of the processor."""
    return (width + LANES - 1) // LANES * LANES


@jit
def _eliminated(at, weights, fixed, found):
    w, pairs = fixed.w, len(weights)
    both, skew, factor, columns, curve, inner, loss = found
    middle = np.empty(at.sizes.shape)
    _ratios(at, both, skew, middle)
    _band(middle, fixed.vectors, fixed.places, factor)
    _silence(factor, fixed.silent)
    count = len(columns)
    fine = _factored(factor, count, np.zeros(2 * factor.shape[1]))
    for p in range(pairs):
        whole = both[p]
        for i in range(w.size):
            curve[p] += w[i] * w[i] / whole[i]
    for i in range(count):
        for p in range(pairs):
            loss[i] += weights[p] * fixed.columns[i, p]
    if fine:
        _gather(columns, skew, fixed)
        columns[fixed.silent] = 0.0
        _substitute(factor, columns, count)
        _products(columns, inner)
    return fine


@jit
def _forward(aim, at, step, now, fixed, reduced, found):
    shape, w = at.sizes.shape, fixed.w
    first, second, sizes, moved = found.first, found.second, found.size, found.moved
    push = np.empty(shape)
    for p in range(shape[0]):
        level = fixed.target * now.weights[p] + now.dual_level
        for i in range(shape[1]):
            size, inside = at.sizes[p, i], at.filtered[p, i]
            turn, shift = step.sizes[p, i], step.filtered[p, i]
            one = (aim - (turn - shift) * step.above[p, i]) / (size - inside)
            two = (aim - (turn + shift) * step.below[p, i]) / (size + inside)
            gain = one + two - level * w[i]
            first[p, i], second[p, i], sizes[p, i] = one, two, gain
            push[p, i] = one - two - reduced.skew[p, i] * gain
            moved[p] += w[i] * gain / reduced.total[p, i]
    count, width = reduced.loss.size, reduced.factor.shape[1]
    drive = np.zeros(count + width)
    drive[:count] = reduced.loss
    _transpose(drive, push, fixed)
    drive[fixed.silent] = 0.0
    base, start = reduced.factor.ctypes.data, drive.ctypes.data
    for i in range(count):
        value = drive[i] * reduced.factor[i, 0]
        by = filled(value)
        for v in range(0, width * WORD, _BLOCK):
            to = start + i * WORD + v
            store(to, load(to) - by * load(base + i * width * WORD + v))
        drive[i] = value
    found.drive[:] = drive[:count]
    found.inner[:] = found.drive @ reduced.columns


@jit
def _backward(solved, half, at, change, fixed, reduced, found):
    padded, sized, least, sums = found
    shape, w, size = at.sizes.shape, fixed.w, len(fixed.vectors)
    n, rows = size - 1, w.size - size + 1
    back = _substitute_back(reduced.factor, half.drive + reduced.columns @ solved)
    for c in range(size):
        for r in range(rows):
            padded[c, n + r] = -back[r * size + c]
    _filter(padded, fixed, sized.filtered)
    for p in range(shape[0]):
        level = fixed.target * change.weights[p] + change.dual_level
        primal, dual = 0.0, 0.0
        for i in range(shape[1]):
            inside = sized.filtered[p, i]
            turn = (half.size[p, i] - level * w[i]) / reduced.total[p, i]
            turn += reduced.skew[p, i] * inside
            down, up = at.sizes[p, i] - at.filtered[p, i], at.sizes[p, i] + at.filtered[p, i]
            u, v = at.above[p, i], at.below[p, i]
            less, more = (turn - inside) / down, (turn + inside) / up
            x, y = half.first[p, i] - u - u * less, half.second[p, i] - v - v * more
            sized.sizes[p, i], sized.above[p, i], sized.below[p, i] = turn, x, y
            primal = min(primal, min(less, more))
            dual = min(dual, min(x / u, y / v))
            sums[0] += down * u + up * v
            sums[1] += (turn - inside) * u + (turn + inside) * v
            sums[2] += down * x + up * y
            sums[3] += (turn - inside) * x + (turn + inside) * y
        least[0], least[1] = min(least[0], primal), min(least[1], dual)


@jit
def _advanced(at, step, primal, dual, multipliers, fixed, sized, totals):
    shape, w = at.sizes.shape, fixed.w
    for p in range(shape[0]):
        for i in range(shape[1]):
            size = at.sizes[p, i] + primal * step.sizes[p, i]
            inside = at.filtered[p, i] + primal * step.filtered[p, i]
            sized.sizes[p, i], sized.filtered[p, i] = size, inside
            sized.above[p, i] = at.above[p, i] + dual * step.above[p, i]
            sized.below[p, i] = at.below[p, i] + dual * step.below[p, i]
            totals.sizes[p] += w[i] * size
            totals.noise[p] += w[i] * abs(inside)
    totals.products[:] = multipliers.T.copy().ravel() @ fixed.columns


@jit
def _ratios(at, both, skew, weights):
    """The diagonal of sizes, its skew part, and the weights that it leaves to the filters."""
    shape = at.sizes.shape
    for p in range(shape[0]):
        for i in range(shape[1]):
            one = at.above[p, i] / (at.sizes[p, i] - at.filtered[p, i])
            two = at.below[p, i] / (at.sizes[p, i] + at.filtered[p, i])
            whole = one + two
            both[p, i], skew[p, i] = whole, (one - two) / whole
            weights[p, i] = 4.0 * one * two / whole


@jit
def _band(weights, vectors, places, found):
    """Fill in the lower band of F' diag(weights) F; ``_factored`` may touch rows behind it."""
    size = len(vectors)
    rows = weights.shape[1] - size + 1
    sums = np.empty(rows)
    for c in range(size):
        for e in range(size):
            for d in range(1 if e < c else 0, size):
                sums[:] = 0.0
                if c != e:
                    _add(sums, vectors[e], vectors[c], d, weights[places[c, e]], 1.0)
                else:
                    for k in range(size):
                        by = 4.0 if k == c else 1.0
                        _add(sums, vectors[k], vectors[k], d, weights[places[c, k]], by)
                place = d * size + e - c
                for r in range(rows - d):
                    found[r * size + c, place] = sums[r]


@jit
def _silence(band, silent):
    """Part unknowns from all others, with 1 on the diagonal."""
    for i in silent:
        band[i] = 0.0
        for place in range(1, min(band.shape[1], i + 1)):
            band[i - place, place] = 0.0
        band[i, 0] = 1.0


@jit
def _add(sums, one, two, lag, weights, by):
    """Add weighted products of two filters, the second one ``lag`` rows behind."""
    n = one.size - 1
    for i in range(one.size - lag):
        factor, row = by * one[i] * two[i + lag], weights[n - i : n - i + sums.size]
        for r in range(sums.size):
            sums[r] += factor * row[r]


@jit
def _gather(columns, skew, fixed):
    """Add what sizes leave in the columns of pairs, and of the sum of sizes."""
    size, pairs, w = len(fixed.vectors), len(skew), fixed.w
    n, rows = size - 1, w.size - size + 1
    sums = np.empty(rows)
    for c in range(size):
        for k in range(size):
            p, by = fixed.places[c, k], 2.0 if c == k else 1.0
            sums[:] = 0.0
            for i in range(size):
                factor = by * fixed.vectors[k, i]
                row, noise = skew[p, n - i : n - i + rows], w[n - i : n - i + rows]
                for r in range(rows):
                    sums[r] += factor * noise[r] * row[r]
            for r in range(rows):
                columns[r * size + c, p] += fixed.target * sums[r]
                columns[r * size + c, pairs] += sums[r]


@jit
def _transpose(drive, push, fixed):
    """Add the transposed filters of (pairs, S) to flat multipliers."""
    size = len(fixed.vectors)
    n, rows = size - 1, push.shape[1] - size + 1
    sums = np.empty(rows)
    for c in range(size):
        sums[:] = 0.0
        for k in range(size):
            p, by = fixed.places[c, k], 2.0 if c == k else 1.0
            for i in range(size):
                factor, row = by * fixed.vectors[k, i], push[p, n - i : n - i + rows]
                for r in range(rows):
                    sums[r] += factor * row[r]
        for r in range(rows):
            drive[r * size + c] += sums[r]


@jit
def _filter(padded, fixed, found):
    """Filter multipliers, padded at both ends, by the vectors; adds to zeros."""
    vectors, samples = fixed.vectors, fixed.w.size
    size = len(vectors)
    for j in range(size):
        for k in range(j, size):
            mine = found[fixed.places[j, k]]
            for i in range(size):
                one, two = vectors[j, i], vectors[k, i]
                first, second = padded[k, i : i + samples], padded[j, i : i + samples]
                for s in range(samples):
                    mine[s] += one * first[s] + two * second[s]


@jit
def _factored(band, count, column):
    """Factor in place, with room for a column; return False where it is not positive definite."""
    width = band.shape[1]
    vectors = width // LANES
    start, own = band.ctypes.data, column.ctypes.data
    for j in range(count):
        here, diagonal = start + j * width * WORD, band[j, 0]
        if not diagonal > 0.0:
            return False
        inverse = 1.0 / np.sqrt(diagonal)
        by = filled(inverse)
        for v in range(0, vectors * _BLOCK, _BLOCK):
            scaled = load(here + v) * by
            store(here + v, scaled)
            store(own + v, scaled)
        band[j, 0] = inverse
        for a in range(1, width):
            factor = spread(own + a * WORD)
            row, shifted = here + a * width * WORD, own + a * WORD
            for v in range(0, (vectors - a // LANES) * _BLOCK, _BLOCK):
                store(row + v, load(row + v) - factor * load(shifted + v))
    return True


@jit
def _substitute(factor, right, count):
    """Solve L X = R in place, for the rows of R; each is whole vectors wide."""
    step, line = (factor.shape[1] - 1) * WORD, right.shape[1] * WORD
    base, start = factor.ctypes.data, right.ctypes.data
    for i in range(count):
        reach, mine = min(i, factor.shape[1] - 1), start + i * line
        own = base + i * (step + WORD)
        inverse, v = spread(own), 0
        while v + 4 * _BLOCK <= line:  # four vectors at once
            to = mine + v
            a, b = load(to), load(to + _BLOCK)
            c, d = load(to + 2 * _BLOCK), load(to + 3 * _BLOCK)
            entry, other = own, to
            for _ in range(reach):
                entry, other = entry - step, other - line
                x = spread(entry)
                a, b = a - x * load(other), b - x * load(other + _BLOCK)
                c, d = c - x * load(other + 2 * _BLOCK), d - x * load(other + 3 * _BLOCK)
            store(to, a * inverse)
            store(to + _BLOCK, b * inverse)
            store(to + 2 * _BLOCK, c * inverse)
            store(to + 3 * _BLOCK, d * inverse)
            v += 4 * _BLOCK
        while v < line:
            to = mine + v
            a, entry, other = load(to), own, to
            for _ in range(reach):
                entry, other = entry - step, other - line
                a = a - spread(entry) * load(other)
            store(to, a * inverse)
            v += _BLOCK


@jit
def _products(columns, found):
    """Add products of columns with each other to zeros; each row is pairs of vectors wide."""
    count, width = columns.shape
    for begin in range(0, count, _ROWS):
        part = columns[begin : min(begin + _ROWS, count)]
        for v in range(0, width, 2 * LANES):
            for j in range(0, v + 2 * LANES, 4):
                _tile(part, found, j, v)
    for j in range(width):
        for v in range(j):
            found[j, v] = found[v, j]


@jit
def _tile(columns, found, j, v):
    """Add products of four columns from j on with those of two vectors from v on."""
    count, width = columns.shape
    line = width * WORD
    to = found.ctypes.data + j * line + v * WORD
    one, two = columns.ctypes.data + v * WORD, columns.ctypes.data + j * WORD
    a, b, c, d = load(to), load(to + _BLOCK), load(to + line), load(to + line + _BLOCK)
    to += 2 * line
    e, f, g, h = load(to), load(to + _BLOCK), load(to + line), load(to + line + _BLOCK)
    for _ in range(count):
        x, y = load(one), load(one + _BLOCK)
        p, q, r, s = (
            spread(two),
            spread(two + WORD),
            spread(two + 2 * WORD),
            spread(two + 3 * WORD),
        )
        a, b, c, d = a + p * x, b + p * y, c + q * x, d + q * y
        e, f, g, h = e + r * x, f + r * y, g + s * x, h + s * y
        one, two = one + line, two + line
    store(to, e)
    store(to + _BLOCK, f)
    store(to + line, g)
    store(to + line + _BLOCK, h)
    to -= 2 * line
    store(to, a)
    store(to + _BLOCK, b)
    store(to + line, c)
    store(to + line + _BLOCK, d)


@jit
def _substitute_back(factor, right):
    """Solve L' x = r."""
    count, width = right.size, factor.shape[1]
    solved = np.zeros(count + width)
    base, start = factor.ctypes.data, solved.ctypes.data
    for i in range(count - 1, -1, -1):
        behind, entries = start + i * WORD, base + i * width * WORD
        known = load(behind) * load(entries)  # the unknown itself is still 0
        for v in range(_BLOCK, width * WORD, _BLOCK):
            known = known + load(behind + v) * load(entries + v)
        solved[i] = (right[i] - total(known)) * factor[i, 0]
    return solved
