"""Arithmetic of cells, all at once: enclosures of a simulation, rows in gamma, contradictions.

A cell is a box of denominator coefficients, numerator coefficients and initial values. With
centre c and z = z_c + e,

    D_c e = - sum_i da_i z_c(k-i) + sum_r dv_r phi_r - sum_i da_i e(k-i),

so that e is at most the sum of the sensitivities times the radii, plus the last part, which
is bounded by the impulse response h of 1 / D_c and by what came before. Simulations in
floating point leave residuals; h times their bounds is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Enclosed", "Fitted", "enclosed", "fitted"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53
_MORE = 1.0 + 1e-11  # more than the rounding of sums of positive numbers


class Enclosed(NamedTuple):
    """A signal in each of C cells."""

    centre: Reals  # (C, N)
    radius: Reals  # (C, N)
    slopes: Reals  # (C, d, N): how far each coordinate moves it, to first order
    radii: Reals  # (C, d)


class Fitted(NamedTuple):
    """Coefficients of the rows in each of C cells: denominators behind the map, then the map's."""

    gamma: Reals  # (C, M)
    radius: Reals  # (C, M)
    bounded: NDArray[np.bool_]  # (C,): whether the radius is proved
    empty: NDArray[np.bool_]  # (C,): whether no coefficients fit, proved


def enclosed(cells: Reals, poles: int, drives: Reals, spread: Reals, initial: int) -> Enclosed:
    """The signal z in each cell.

    Parameters
    ----------
    cells : (C, 2, d) float
        Ends of ``poles`` denominator coefficients, of one coefficient for each drive, and of
        ``initial`` first samples.
    poles : int
    drives, spread : (q, N) float
        Known samples, and how far noise may move them.
    initial : int
        Number of first samples that are coordinates themselves.
    """
    middle = cells.mean(axis=1)
    radii = np.maximum(cells[:, 1] - middle, middle - cells[:, 0]) * (1 + 4 * _UNIT)
    a, v = middle[:, :poles], middle[:, poles:]
    (count, d), (q, samples) = middle.shape, drives.shape
    h, h_doubt = _response(a, np.eye(1, samples)[0] * np.ones((count, 1)), np.zeros((count, 0)))
    size = np.abs(h)
    for k in range(1, samples):  # |h| <= |h computed| + |h| * (its residual)
        size[:, k] = size[:, k] + np.einsum("cl,cl->c", size[:, :k], h_doubt[:, k:0:-1])
    size = size * _MORE
    drive = v[:, :q] @ drives
    doubt = 4 * (q + 2) * _UNIT * (np.abs(v[:, :q]) @ np.abs(drives))
    z, residual = _response(a, drive, v[:, q:])
    radius_of_z = _filtered(size, residual + doubt)
    slopes = np.zeros((count, d, samples))
    none = np.zeros((count, initial))
    for i in range(d):
        if i < poles:
            source = np.zeros((count, samples))
            source[:, i + 1 :] = -z[:, : samples - i - 1]
            first = none
        elif i < poles + q:
            source, first = np.tile(drives[i - poles], (count, 1)), none
        else:
            source = np.zeros((count, samples))
            first = np.tile(np.eye(1, initial, i - poles - q), (count, 1))
        s, rest = _response(a, source, first)
        slopes[:, i] = (np.abs(s) + _filtered(size, rest)) * radii[:, i, None]
    noise = (np.abs(v[:, :q]) + radii[:, poles : poles + q]) @ spread
    base = slopes.sum(axis=1) + _filtered(size, noise) + radius_of_z
    # what the radii of the denominator do to the error of z_c itself is in the recursion
    error = base * _MORE
    for k in range(1, samples):
        late = np.zeros((count, k))  # sum_i da_i e(l - i) for l = 1..k
        for i in range(poles):
            if k > i:
                late[:, i:] += radii[:, i, None] * error[:, : k - i]
        if initial:
            late[:, : max(0, min(initial - 1, k))] = 0.0
        error[:, k] += np.einsum("cl,cl->c", late, size[:, k - 1 :: -1][:, :k]) * _MORE
    if initial:
        error[:, :initial] = base[:, :initial]
    with np.errstate(invalid="ignore", over="ignore"):
        return Enclosed(z, error * _MORE + 4 * _UNIT * np.abs(z), slopes, radii)


def _response(a: Reals, drive: Reals, first: Reals) -> tuple[Reals, Reals]:
    """Solution of the difference equation in each cell, and bounds of its residual."""
    count, samples = drive.shape
    given, poles = first.shape[1], a.shape[1]
    z, doubt = np.zeros((count, samples)), np.zeros((count, samples))
    z[:, :given] = first[:, :samples]
    for k in range(given, samples):
        total, size = drive[:, k].copy(), np.abs(drive[:, k])
        for i in range(min(poles, k)):
            part = a[:, i] * z[:, k - 1 - i]
            total -= part
            size += np.abs(part)
        z[:, k], doubt[:, k] = total, 2 * (poles + 2) * _UNIT * size
    doubt[:, 0] = np.where(a.shape[1] and not given, doubt[:, 0], doubt[:, 0])
    return z, doubt


def _filtered(size: Reals, values: Reals) -> Reals:
    """|h| * values, for values >= 0."""
    samples = values.shape[1]
    found = np.zeros_like(values)
    for lag in range(samples):
        found[:, lag:] += size[:, lag, None] * values[:, : samples - lag]
    return found * _MORE


def fitted(
    found: Enclosed,
    rows: NDArray[np.int64],
    columns: tuple[tuple[int, int], ...],
    past: tuple[Reals, Reals],
    y: Reals,
    noise: Reals,
) -> Fitted:
    """Bound gamma in each cell by the rows y~_k = past_k a + sum gamma_m z_(k-lag)^power + eta_k.

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
    every = np.ones((found.centre.shape[0], 1, 1))
    matrix = np.concatenate([every * past[0], np.stack([p[0] for p in pairs], axis=2)], axis=2)
    wide = np.concatenate([every * past[1], np.stack([p[1] for p in pairs], axis=2)], axis=2)
    usable = np.all(np.isfinite(matrix) & np.isfinite(wide) & (wide < 1e100), axis=2)
    matrix = np.where(usable[:, :, None], matrix, 0.0)
    wide = np.where(usable[:, :, None], wide, 0.0)
    sure = usable.astype(float)
    gamma = _least_squares(matrix, sure, y)[0]
    for _ in range(3):  # rows in which z is known badly count little
        size = noise + np.einsum("ckm,cm->ck", wide, np.abs(gamma)) + 1e-300
        trust = sure / size**2
        gamma, inverse = _least_squares(matrix, trust, y)
    inverse = np.where(usable[:, None, :], inverse, 0.0)
    reach, bounded = _radius(inverse, matrix, wide, gamma, y, noise)
    most = np.where(bounded[:, None], np.abs(gamma) + reach, np.inf)
    empty, weight, fit = np.zeros(len(matrix), bool), trust, gamma
    for _ in range(4):  # residuals near their largest count most
        rest = (y - np.einsum("ckm,cm->ck", matrix, fit)) / size
        normal = _orthogonal(matrix, usable * weight * size * rest)
        empty |= bounded & _contradicted(normal, matrix, wide, most, y, noise)
        top = np.maximum(np.abs(rest * usable).max(axis=1, keepdims=True), 1e-300)
        weight = weight * (np.abs(rest) / top + 3e-2) ** 2
        fit = _least_squares(matrix, weight, y)[0]
    return Fitted(gamma, reach, bounded, empty)


def _column(found: Enclosed, rows: NDArray[np.int64], lag: int, power: int) -> tuple[Reals, Reals]:
    """Powers of z some samples ago, at rest before the first, and their radii."""
    before, rest = rows - lag, rows < lag
    z = np.where(rest, 0.0, found.centre[:, before])
    radius = np.where(rest, 0.0, found.radius[:, before])
    wide = power * radius * (np.abs(z) + radius) ** max(power - 1, 0) * _MORE
    return z**power, wide + 16 * power * _UNIT * np.abs(z) ** power


def _least_squares(matrix: Reals, weight: Reals, y: Reals) -> tuple[Reals, Reals]:
    """Weighted fit in each cell, and the left inverse that gives it."""
    top = np.maximum(weight.max(axis=1, keepdims=True), 1e-300)
    root = np.sqrt(weight / top)[:, :, None]
    inverse = np.linalg.pinv(matrix * root, rcond=1e-13) * root.transpose(0, 2, 1)
    return np.einsum("cmk,k->cm", inverse, y), inverse


def _orthogonal(matrix: Reals, raw: Reals) -> Reals:
    """Multipliers made orthogonal to the columns, nearly, of size 1."""
    inverse = np.linalg.pinv(matrix, rcond=1e-13)
    for _ in range(2):
        part = np.einsum("cmk,ck->cm", inverse, raw)
        raw = raw - np.einsum("ckm,cm->ck", matrix, part)
    size = np.maximum(np.abs(raw).sum(axis=1, keepdims=True), 1e-300)
    return np.asarray(raw / size, np.float64)


def _radius(
    inverse: Reals, matrix: Reals, wide: Reals, middle: Reals, y: Reals, noise: Reals
) -> tuple[Reals, NDArray[np.bool_]]:
    """|gamma - middle| <= radius by the left inverse, as for boxes of regressions."""
    count, size, _ = inverse.shape
    loss = 4.0 * (y.size + size + 8) * _UNIT
    slope = np.abs(matrix)
    rest = np.abs(y - np.einsum("ckm,cm->ck", matrix, middle))
    rest = rest + loss * (np.abs(y) + np.einsum("ckm,cm->ck", slope, np.abs(middle)))
    push = rest + noise + np.einsum("ckm,cm->ck", wide, np.abs(middle))
    drive = np.einsum("cmk,ck->cm", np.abs(inverse), push) * _MORE
    gram = np.abs(np.eye(size) - inverse @ matrix) + loss * (np.abs(inverse) @ slope + np.eye(size))
    coupling = (np.abs(inverse) @ wide + gram) * _MORE
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


def _contradicted(
    normal: Reals, matrix: Reals, wide: Reals, most: Reals, y: Reals, noise: Reals
) -> NDArray[np.bool_]:
    """Check that multipliers n exclude every gamma: |n'y| exceeds what noise explains."""
    loss = 4.0 * (y.size + most.shape[1] + 8) * _UNIT
    size = np.abs(normal)
    left = np.abs(normal @ y) - loss * (size @ np.abs(y))
    through = np.abs(np.einsum("ck,ckm->cm", normal, matrix))
    through = through + loss * np.einsum("ck,ckm->cm", size, np.abs(matrix))
    through = through + np.einsum("ck,ckm->cm", size, wide)
    with np.errstate(invalid="ignore"):
        right = (size @ noise + np.einsum("cm,cm->c", through, most)) * _MORE
    return np.asarray(left > right)
