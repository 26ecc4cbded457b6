"""Rows of cells that hold for every first sample of the internal signal.

A record that does not begin at rest has z_k = f_k + c s_k. There f starts from 0 at a sample m,
c = z_m is unknown, and s_k = (-a)^(k - m) for a block with one coefficient a in its denominator,
f_k + a f_(k-1) = e_k. Nothing bounds c at first. With powers p <= 2 the rows

    r_k = y~_k + sum_i a'_i y~_(k-i) - sum_jp beta_jp z_(k-j)^p

hold multiples of s_k, of s_k^2 and, for each lag j, of s_k f_(k-j), all of them unknown.
Combinations of neighbouring rows are free of them, one after the other and whatever c is:

    r_k + a r_(k-1)               of s_k; s_k f_(k-j) becomes s_k (f_(k-j) - f_(k-j-1)),
    r_k - a^2 r_(k-1)             of s_k^2; the others become s_k h_k, h_k = e_(k-j) - e_(k-j-1),
    h_(k-1) r_k + a h_k r_(k-1)   of s_k h_k; another h, say g, becomes h_(k-1) g_k - h_k g_(k-1).

Each identity is exact for the true a and e, which lie in the intervals of the cell. What is left
is f instead of z, in rows that share their noise. The first two steps make

    h_k + (1 - a^2) e_(k-j-1)                         of f_(k-j),
    v_k + a v_(k-1),  v_k = e_k (e_k - 2 a f_(k-1))   of f_k^2

and the others leave a multiple of 1 + a of the first: S + (1 + a) T becomes

    h_(k-1) S_k - h_k S_(k-1)  +  (1 + a) (h_(k-1) T_k + a h_k T_(k-1) + h_k S_(k-1)),

where S ends at 0. For a = -1 an offset of z and a gain of the map cannot be told apart. So the
unknown of such a column is (1 + a) beta, and its samples are T.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from setid.proofs.cells.arithmetic import CellRows
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = ["depth", "free_rows"]

Reals = NDArray[np.float64]
_LEAST = 1e-9  # of the noise of the loudest row
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers


def depth(lags: Sequence[int]) -> int:
    """Number of earlier rows that a combination needs.

    Parameters
    ----------
    lags : sequence of int
        Of the internal signal in the rows.
    """
    return 2 + len(set(lags))


def free_rows(
    pole: Interval,
    drive: Interval,
    signal: Interval,
    rows: NDArray[np.int64],
    columns: Sequence[tuple[int, int]],
    past: int,
    y: Reals,
    bound: Reals,
    noise: Reals,
) -> CellRows:
    """Combine rows so that they do not hold the first sample.

    Parameters
    ----------
    pole : Interval
        Of the coefficient a, shape (C, 1).
    drive, signal : Interval
        Of e and of f, shape (C, N).
    rows : (R,) int
        Samples k; all that a combination asks for lies after m, and has readings.
    columns : sequence of (lag, power)
        Powers 1 and 2 at most.
    past : int
        Number of the a'.
    y, bound, noise : (N,) float
        Readings, their noise bounds, and those of a row.
    """
    lags = sorted({lag for lag, _ in columns})
    y, bound, noise = np.nan_to_num(y), np.nan_to_num(bound), np.nan_to_num(noise)
    steps = _steps(drive, lags)
    weights = [weight[:, rows] for weight in _weights(pole, drive, steps)]
    middles, radii = zip(*[_split(weight) for weight in weights], strict=True)
    readings = Interval.point(y)
    shared = np.zeros((y.size, past + len(columns) + 1))
    shared[:, -1] = noise
    value, doubt = _split(_total([w * readings[rows - i] for i, w in enumerate(weights)]))
    doubt = doubt + sum(radius * noise[rows - i] for i, radius in enumerate(radii))
    matrix, wide = [], []
    for back in range(1, past + 1):
        parts = [-(w * readings[rows - i - back]) for i, w in enumerate(weights)]
        middle, radius = _split(_total(parts))
        radius = radius + sum(more * bound[rows - i - back] for i, more in enumerate(radii))
        matrix.append(middle)
        wide.append(radius * _MORE)
        shared[back:, back - 1] = bound[:-back]
    for lag, power in columns:
        middle, radius = _split(_column(pole, drive, signal, steps, lags, (lag, power))[:, rows])
        matrix.append(middle)
        wide.append(radius)
    shape = np.zeros((*value.shape, y.size))
    for i, middle in enumerate(middles):
        shape[:, np.arange(rows.size), rows - i] = middle
    loud = np.abs(shape) @ noise
    least = _LEAST * np.max(loud, axis=1, keepdims=True)
    doubt = np.where(loud > least, doubt * _MORE, np.inf)  # others say 0 = 0
    return CellRows(np.stack(matrix, axis=2), np.stack(wide, axis=2), value, doubt, shape, shared)


def _steps(drive: Interval, lags: list[int]) -> list[Interval]:
    """The sequences h (C, N) of the last steps, one for each lag."""
    left, found = [_late(drive, lag) - _late(drive, lag + 1) for lag in lags], []
    while left:
        found.append(left[0])
        left = [_late(left[0], 1) * g - left[0] * _late(g, 1) for g in left[1:]]
    return found


def _column(
    pole: Interval,
    drive: Interval,
    signal: Interval,
    steps: list[Interval],
    lags: list[int],
    column: tuple[int, int],
) -> Interval:
    """State f^power some samples ago in the combinations, (C, N)."""
    lag, power = column
    one = Interval.point(np.ones(drive.lo.shape))
    if power == 1:
        left = _late(drive, lag) - _late(drive, lag + 1)
        found = (one - pole) * _late(drive, lag + 1)
        for number, h in enumerate(steps):
            if number > lags.index(lag):
                left = Interval.point(np.zeros(drive.lo.shape))
            found = _combined(pole, h, found) + h * _late(left, 1)
            left = _late(h, 1) * left - h * _late(left, 1)
        return found
    found = one
    if power == 2:
        twice = Interval.point(2.0) * pole
        found = _late(drive * (drive - twice * _late(signal, 1)), lag)
    else:
        found = found - pole.power(np.array(2)) * found
    found = found + pole * _late(found, 1)
    for h in steps:
        found = _combined(pole, h, found)
    return found


def _combined(pole: Interval, h: Interval, values: Interval) -> Interval:
    return _late(h, 1) * values + pole * h * _late(values, 1)


def _weights(pole: Interval, drive: Interval, steps: list[Interval]) -> list[Interval]:
    """Weights (C, N) of the rows k, k - 1, ... in a combination; the first samples say nothing."""
    one = Interval.point(np.ones(drive.lo.shape))
    square = pole.power(np.array(2))
    found = [one, (pole - square) * one, -(square * pole) * one]
    for h in steps:
        before, scaled = _late(h, 1), pole * h
        moved = [scaled * _late(weight, 1) for weight in found]
        kept = [before * weight for weight in found]
        inner = [one + two for one, two in zip(kept[1:], moved[:-1], strict=True)]
        found = [kept[0], *inner, moved[-1]]
    return found


def _late(values: Interval, lag: int) -> Interval:
    """Values some samples ago; the first ones are those of the end, and are not asked."""
    return Interval(np.roll(values.lo, lag, axis=1), np.roll(values.hi, lag, axis=1))


def _total(parts: list[Interval]) -> Interval:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _split(values: Interval) -> tuple[Reals, Reals]:
    """Middle and radius of intervals."""
    middle = values.middle()
    return middle, np.maximum(values.hi - middle, middle - values.lo) * _MORE
