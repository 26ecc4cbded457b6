"""Arithmetic of cells, all at once: enclosures of a simulation, rows in gamma, contradictions.

A cell is a box of denominator and of numerator coefficients. With centre c and z = z_c + e,

    D_c e = - sum_i da_i z_c(k-i) + sum_r dv_r phi_r - sum_i da_i e(k-i),

so that e is at most the sum of the sensitivities times the radii, plus the last part, which
is bounded by the impulse response h of 1 / D_c and by what came before. Simulations in
floating point leave residuals; h times their bounds is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CellRows", "Enclosed", "Fitted", "enclosed", "fitted", "rows_of"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53
_MORE = 1.0 + 1e-11  # more than the rounding of sums of positive numbers
_RIDGE = 1e-13  # added to normal equations, so that dependent columns have an answer
_TINY = 1e-300  # more than what underflows
_EXACT = 1e-8  # of the largest error of a row: less counts as this in weights


class Enclosed(NamedTuple):
    """A signal in each of C cells."""

    centre: Reals  # (C, N)
    radius: Reals  # (C, N)
    slopes: Reals  # (C, d, N): how far each coordinate moves it, to first order
    radii: Reals  # (C, d)


class CellRows(NamedTuple):
    """Rows y~_k = past_k a + sum gamma_m z_(k-lag)^power + eta_k in each of C cells.

    Parameters
    ----------
    matrix, wide : (C, R, M) float
        Columns, and how far they may be off.
    y, noise : (C, R) float
        Readings, and how far they may be off.
    shape : (C, R, T) float, optional
        How T errors make those of rows, where one error counts in several of them.
    shared : (T, M + 1) float, optional
        Bounds of these errors, in each column and in the readings.
    """

    matrix: Reals
    wide: Reals
    y: Reals
    noise: Reals
    shape: Reals | None = None
    shared: Reals | None = None

    def of(self, cells: NDArray[np.int64]) -> CellRows:
        """Take the rows of some cells."""
        return CellRows(
            self.matrix[cells],
            self.wide[cells],
            self.y[cells],
            self.noise[cells],
            None if self.shape is None else self.shape[cells],
            self.shared,
        )

    def errors(self, weights: Reals) -> tuple[Reals, Reals]:
        """Bound errors of columns (C, W, M) and readings (C, W) in combinations (C, W, R)."""
        size = np.abs(weights)
        columns = size @ self.wide
        readings = np.einsum("cwk,ck->cw", size, self.noise)
        if self.shape is not None and self.shared is not None:
            mixed = np.abs(weights @ self.shape)
            loss = 4.0 * (self.noise.shape[1] + 8) * _UNIT
            mixed = (mixed + loss * (size @ np.abs(self.shape))) @ self.shared
            columns, readings = columns + mixed[..., :-1], readings + mixed[..., -1]
        return columns * _MORE, readings * _MORE


class Fitted(NamedTuple):
    """Coefficients of the rows in each of C cells: denominators behind the map, then the map's."""

    gamma: Reals  # (C, M)
    radius: Reals  # (C, M)
    bounded: NDArray[np.bool_]  # (C,): whether the radius is proved
    empty: NDArray[np.bool_]  # (C,): whether no coefficients fit, proved


def enclosed(cells: Reals, poles: int, drives: Reals, spread: Reals) -> Enclosed:
    """Enclose the signal z in each cell.

    Parameters
    ----------
    cells : (C, 2, d) float
        Ends of ``poles`` denominator coefficients, and of one coefficient for each drive.
    poles : int
    drives, spread : (q, N) float
        Known samples, and how far noise may move them.
    """
    middle = cells.mean(axis=1)
    radii = np.maximum(cells[:, 1] - middle, middle - cells[:, 0]) * (1 + 4 * _UNIT)
    a, v = middle[:, :poles], middle[:, poles:]
    (count, d), (q, samples) = middle.shape, drives.shape
    h, h_doubt = _response(a, np.eye(1, samples)[0] * np.ones((count, 1)))
    size = np.abs(h)
    for k in range(1, samples):  # |h| <= |h computed| + |h| * (its residual)
        size[:, k] = size[:, k] + np.einsum("cl,cl->c", size[:, :k], h_doubt[:, k:0:-1])
    size = size * _MORE
    drive = v @ drives
    doubt = 4 * (q + 2) * _UNIT * (np.abs(v) @ np.abs(drives))
    z, residual = _response(a, drive)
    radius_of_z = _filtered(size, residual + doubt)
    slopes = np.zeros((count, d, samples))
    for i in range(d):
        if i < poles:
            source = np.zeros((count, samples))
            source[:, i + 1 :] = -z[:, : samples - i - 1]
        else:
            source = np.tile(drives[i - poles], (count, 1))
        s, rest = _response(a, source)
        slopes[:, i] = (np.abs(s) + _filtered(size, rest)) * radii[:, i, None]
    noise = (np.abs(v) + radii[:, poles:]) @ spread
    base = slopes.sum(axis=1) + _filtered(size, noise) + radius_of_z
    # what the radii of the denominator do to the error of z_c itself is in the recursion
    error = base * _MORE
    for k in range(1, samples):
        late = np.zeros((count, k))  # sum_i da_i e(l - i) for l = 1..k
        for i in range(poles):
            if k > i:
                late[:, i:] += radii[:, i, None] * error[:, : k - i]
        error[:, k] += np.einsum("cl,cl->c", late, size[:, k - 1 :: -1][:, :k]) * _MORE
    with np.errstate(invalid="ignore", over="ignore"):
        return Enclosed(z, error * _MORE + 4 * _UNIT * np.abs(z), slopes, radii)


def _response(a: Reals, drive: Reals) -> tuple[Reals, Reals]:
    """Solution of the difference equation in each cell, and bounds of its residual."""
    count, samples = drive.shape
    poles = a.shape[1]
    z, doubt = np.zeros((count, samples)), np.zeros((count, samples))
    for k in range(samples):
        total, size = drive[:, k].copy(), np.abs(drive[:, k])
        for i in range(min(poles, k)):
            part = a[:, i] * z[:, k - 1 - i]
            total -= part
            size += np.abs(part)
        z[:, k], doubt[:, k] = total, 2 * (poles + 2) * _UNIT * size + _TINY
    return z, doubt


def _filtered(size: Reals, values: Reals) -> Reals:
    """|h| * values, for values >= 0."""
    samples = values.shape[1]
    found = np.zeros_like(values)
    for lag in range(samples):
        found[:, lag:] += size[:, lag, None] * values[:, : samples - lag]
    return found * _MORE


def rows_of(
    found: Enclosed,
    rows: NDArray[np.int64],
    columns: tuple[tuple[int, int], ...],
    past: tuple[Reals, Reals],
    y: Reals,
    noise: Reals,
) -> CellRows:
    """State the rows of samples where the internal signal is enclosed.

    Parameters
    ----------
    found : Enclosed
    rows : (R,) int
        Samples.
    columns : tuple of (lag, power)
    past : two of (R, n) float
        Columns of measured samples, and how far noise may move them.
    y, noise : (R,) float
    """
    with np.errstate(over="ignore", invalid="ignore"):
        pairs = [_column(found, rows, lag, power) for lag, power in columns]
    count = found.centre.shape[0]
    every = np.ones((count, 1, 1))
    return CellRows(
        np.concatenate([every * past[0], np.stack([p[0] for p in pairs], axis=2)], axis=2),
        np.concatenate([every * past[1], np.stack([p[1] for p in pairs], axis=2)], axis=2),
        np.tile(y, (count, 1)),
        np.tile(noise, (count, 1)),
    )


def fitted(given: CellRows) -> Fitted:
    """Bound gamma in each cell by its rows.

    Parameters
    ----------
    given : CellRows
    """
    given, usable = _usable(given)
    matrix, y = given.matrix, given.y
    wide, noise = _alone(given)
    sure = usable.astype(float)
    gamma = _least_squares(matrix, sure, y)[0]
    for _ in range(3):  # rows in which z is known badly count little
        size = noise + np.einsum("ckm,cm->ck", wide, np.abs(gamma))
        size = _above_rounding(size, usable, y)
        trust = sure * (size.min(axis=1, keepdims=True) / size) ** 2
        gamma, inverse = _least_squares(matrix, trust, y)
    inverse = np.where(usable[:, None, :], inverse, 0.0)
    reach, bounded = _radius(inverse, given, gamma)
    empty = np.zeros(len(matrix), bool)
    left, weight, fit = np.flatnonzero(bounded), trust[bounded], gamma[bounded]
    for _ in range(4):  # residuals near their largest count most
        if not left.size:
            break
        some, good, sizes = given.of(left), usable[left], size[left]
        rest = (some.y - np.einsum("ckm,cm->ck", some.matrix, fit)) / sizes
        normal = _orthogonal(some.matrix, good * weight * sizes * rest)
        out = _contradicted(normal, some, np.abs(gamma[left]) + reach[left])
        empty[left[out]] = True
        top = np.maximum(np.abs(rest * good).max(axis=1, keepdims=True), 1e-300)
        weight = (weight * (np.abs(rest) / top + 3e-2) ** 2)[~out]
        left = left[~out]
        fit = _least_squares(matrix[left], weight, y[left])[0]
    return Fitted(gamma, reach, bounded, empty)


def _above_rounding(errors: Reals, usable: NDArray[np.bool_], y: Reals) -> Reals:
    """Errors of rows with a least size, so that weights of exact rows are finite."""
    largest = np.maximum(errors, _EXACT * np.abs(y)) * usable
    least = np.maximum(_EXACT * largest.max(axis=1, keepdims=True), 1e-150)
    return np.asarray(np.maximum(errors, least), np.float64)


def _usable(given: CellRows) -> tuple[CellRows, NDArray[np.bool_]]:
    """Set rows to 0 in which a number overflowed; and which rows are left."""
    matrix, wide, y, noise = given[:4]
    usable = np.all(np.isfinite(matrix) & np.isfinite(wide) & (wide < 1e100), axis=2)
    usable &= np.isfinite(y) & np.isfinite(noise)
    shape = given.shape
    if shape is not None:
        usable &= np.all(np.isfinite(shape), axis=2)
        shape = np.where(usable[:, :, None], shape, 0.0)
    return CellRows(
        np.where(usable[:, :, None], matrix, 0.0),
        np.where(usable[:, :, None], wide, 0.0),
        np.where(usable, y, 0.0),
        np.where(usable, noise, 1.0),
        shape,
        given.shared,
    ), usable


def _alone(given: CellRows) -> tuple[Reals, Reals]:
    """Bound errors of the columns (C, R, M) and readings (C, R) of each row."""
    if given.shape is None or given.shared is None:
        return given.wide, given.noise
    mixed = np.abs(given.shape) @ given.shared
    return given.wide + mixed[..., :-1], given.noise + mixed[..., -1]


def _column(found: Enclosed, rows: NDArray[np.int64], lag: int, power: int) -> tuple[Reals, Reals]:
    """Powers of z some samples ago, at rest before the first, and their radii."""
    before, rest = rows - lag, rows < lag
    z = np.where(rest, 0.0, found.centre[:, before])
    radius = np.where(rest, 0.0, found.radius[:, before])
    wide = power * radius * (np.abs(z) + radius) ** max(power - 1, 0) * _MORE
    tiny = np.where(rest, 0.0, _TINY if power else 0.0)
    return z**power, wide + 16 * power * _UNIT * np.abs(z) ** power + tiny


def _least_squares(matrix: Reals, weight: Reals, y: Reals) -> tuple[Reals, Reals]:
    """Weighted fit in each cell, and the left inverse that gives it."""
    top = np.maximum(weight.max(axis=1, keepdims=True), 1e-300)
    root = np.sqrt(weight / top)[:, :, None]
    inverse = _left_inverses(matrix * root) * root.transpose(0, 2, 1)
    return np.einsum("cmk,ck->cm", inverse, y), inverse


def _left_inverses(matrix: Reals) -> Reals:
    """Left inverses, nearly: normal equations of columns of size 1, and a step of Newton's."""
    size = np.sqrt(np.einsum("ckm,ckm->cm", matrix, matrix))
    scale = 1.0 / np.where(size > 1e-150, size, 1.0)
    scaled, unit = matrix * scale[:, None, :], np.eye(matrix.shape[2])
    across = scaled.transpose(0, 2, 1)
    inverse = np.linalg.inv(across @ scaled + _RIDGE * unit) @ across
    inverse = inverse + (unit - inverse @ scaled) @ inverse
    return np.asarray(inverse * scale[:, :, None], np.float64)


def _orthogonal(matrix: Reals, raw: Reals) -> Reals:
    """Multipliers made orthogonal to the columns, nearly, of size 1."""
    inverse = _left_inverses(matrix)
    for _ in range(2):
        part = np.einsum("cmk,ck->cm", inverse, raw)
        raw = raw - np.einsum("ckm,cm->ck", matrix, part)
    size = np.maximum(np.abs(raw).sum(axis=1, keepdims=True), 1e-300)
    return np.asarray(raw / size, np.float64)


def _radius(inverse: Reals, given: CellRows, middle: Reals) -> tuple[Reals, NDArray[np.bool_]]:
    """|gamma - middle| <= radius by the left inverse, as for boxes of regressions."""
    matrix, y = given.matrix, given.y
    count, size, _ = inverse.shape
    loss = 4.0 * (y.shape[1] + size + 8) * _UNIT
    slope = np.abs(matrix)
    wide, noise = given.errors(inverse)
    rest = np.abs(y - np.einsum("ckm,cm->ck", matrix, middle))
    rest = rest + loss * (np.abs(y) + np.einsum("ckm,cm->ck", slope, np.abs(middle)))
    drive = np.einsum("cmk,ck->cm", np.abs(inverse), rest) + noise
    drive = (drive + np.einsum("cml,cl->cm", wide, np.abs(middle))) * _MORE
    gram = np.abs(np.eye(size) - inverse @ matrix) + loss * (np.abs(inverse) @ slope + np.eye(size))
    coupling = (wide + gram) * _MORE
    radius = np.full((count, size), np.inf)
    good = np.all(np.isfinite(coupling), axis=(1, 2)) & np.all(np.isfinite(drive), axis=1)
    if np.any(good):
        values = np.abs(np.linalg.eigvals(coupling[good])).max(axis=1)
        good[np.flatnonzero(good)[values > 0.999]] = False
    if np.any(good):
        solved = np.linalg.solve(np.eye(size) - coupling[good], drive[good][..., None])[..., 0]
        radius[good] = solved * 1.01 + 1e-300
    with np.errstate(invalid="ignore"):
        reached = (np.einsum("cml,cl->cm", coupling, radius) + drive) * (1 + 1e-12)
    good &= np.all((radius > 0) & (reached < radius), axis=1)
    return radius, good


def _contradicted(normal: Reals, given: CellRows, most: Reals) -> NDArray[np.bool_]:
    """Check that multipliers n exclude every gamma: |n'y| exceeds what noise explains."""
    matrix, y = given.matrix, given.y
    loss = 4.0 * (y.shape[1] + most.shape[1] + 8) * _UNIT
    size = np.abs(normal)
    wide, noise = given.errors(normal[:, None])
    left = np.abs(np.sum(normal * y, axis=1)) - loss * np.sum(size * np.abs(y), axis=1)
    through = np.abs(np.einsum("ck,ckm->cm", normal, matrix))
    through = through + loss * np.einsum("ck,ckm->cm", size, np.abs(matrix)) + wide[:, 0]
    with np.errstate(invalid="ignore"):
        right = (noise[:, 0] + np.einsum("cm,cm->c", through, most)) * _MORE
    return np.asarray(left > right)
