"""Bounds of the internal signal in cells: the response from rest, and what began before it."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.proofs.cells.arithmetic import Fitted, enclosed
from setid.proofs.cells.cell_normalisation import factor_of
from setid.proofs.cells.parts import Parts, row_noise

__all__ = ["signal_bounds"]

Reals = NDArray[np.float64]
_NUMBERS = 400_000  # of slopes of the internal signal at a time, in all of its samples
_FAR = 1e100  # of a signal: what says nothing
_SMALL = 1e-290  # of a product: a smaller one may be a subnormal number, and rounded by all of it


def signal_bounds(
    parts: Parts,
    formulation: Formulation,
    cells: Reals,
    fit: Fitted,
    kept: NDArray[np.int64],
    until: float,
) -> Reals:
    """Bound the internal signal in some cells, (2, N); infinite where time ends before all.

    Parameters
    ----------
    parts : Parts
    formulation : Formulation
    cells : (C, 2, d) float
    fit : Fitted
    kept : (K,) int
        Numbers of the cells.
    until : float
        Reading of ``time.monotonic`` at which the work ends.
    """
    model, samples = formulation.model, formulation.data.samples
    assert isinstance(model, BlockStructured)
    factor = factor_of(parts, model, cells, fit)
    low, high = np.full(samples, np.inf), np.full(samples, -np.inf)
    size = max(_NUMBERS // (samples * cells.shape[2]), 1)
    for begin in range(0, kept.size, size):
        if time.monotonic() >= until:
            return np.array([np.full(samples, -np.inf), np.full(samples, np.inf)])
        some = kept[begin : begin + size]
        found = enclosed(cells[some], len(parts.poles), parts.drives, parts.drive_noise)
        z = np.stack([found.centre - found.radius, found.centre + found.radius], axis=1)
        if parts.initial or parts.begin:
            own = fit.gamma[some], fit.radius[some]
            part = Fitted(*own, fit.bounded[some], fit.empty[some])
            reach = _from_start(parts, formulation, cells[some], part)
            z += np.stack([-reach, reach], axis=1)
        with np.errstate(invalid="ignore", over="ignore"):
            both = factor[some, :, None, None] * z[:, None]
        finite = np.all(np.isfinite(both), axis=(1, 2))
        both = np.where(finite[:, None, None], both, 0.0)
        most = np.abs(both).max(axis=(1, 2))
        zero = ~np.any((factor[some, :, None, None] != 0.0) & (z[:, None] != 0.0), axis=(1, 2))
        wide = 1e-12 * most + np.where(zero | (most > _SMALL), 0.0, _SMALL)
        wide = np.where(finite, wide, np.inf)
        low = np.minimum(low, (both.min(axis=(1, 2)) - wide).min(axis=0))
        high = np.maximum(high, (both.max(axis=(1, 2)) + wide).max(axis=0))
    return np.array([low, high])


def _from_start(parts: Parts, formulation: Formulation, cells: Reals, fit: Fitted) -> Reals:
    """Bound what z has besides the response from rest, (C, N); infinite where no row tells.

    A row holds one sample of z alone, and its square cannot be larger than what the others let.
    """
    count, samples = len(cells), formulation.data.samples
    found, past = np.full((count, samples), np.inf), len(parts.past)
    lags = {column.lag for column in parts.columns}
    degree = max(column.power for column in parts.columns)
    unknown = parts.initial or parts.begin or 0
    if not parts.initial:
        found[:, unknown:] = 0.0
    if len(lags) > 1 or degree > 2:
        return found
    size, radius = np.abs(fit.gamma) * (1 + 1e-15), fit.radius * (1 + 1e-15)
    most, least = size + radius, np.maximum(np.abs(fit.gamma) * (1 - 1e-15) - radius, 0.0)
    sums = {power: np.zeros(count) for power in (0, 1, 2)}
    for place, column in enumerate(parts.columns, past):
        sums[column.power] += most[:, place]
    top = [column.power for column in parts.columns].index(degree) + past
    y = np.abs(formulation.data.y[:, 0]) + row_noise(formulation)
    for k in range(unknown):
        row = k + min(lags)
        needed = y[row - past : row + 1] if row >= past and row < samples else np.full(1, np.nan)
        if np.any(np.isnan(needed)):
            continue
        right = sums[0] + needed[-1] + most[:, :past] @ needed[past - 1 :: -1][:past]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            low = least[:, top]
            if degree == 2:
                root = (sums[1] + np.sqrt(sums[1] ** 2 + 4.0 * low * right)) / (2.0 * low)
            else:
                root = right / low
            found[:, k] = np.where(root < _FAR, root * (1 + 1e-12), np.inf)
    far = np.abs(cells[:, :, 0]).max(axis=1)
    for k in range(unknown, samples if parts.initial else 0):
        with np.errstate(invalid="ignore"):
            found[:, k] = found[:, k - 1] * far * (1 + 1e-15)
    doubtful = np.isnan(found) | (~fit.bounded[:, None] & (found > 0.0))
    return np.where(doubtful, np.inf, found)
