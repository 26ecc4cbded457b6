"""Proved ranges of one-step predictions over a cover of the feasible parameter set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from setid.formulation.regression import Regression
from setid.proofs.supports import Cover, Multipliers, supports

__all__ = ["predicted_ranges"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)


def predicted_ranges(
    cover: Cover, rows: Regression, readings: Reals, proposer: Callable[[Cover], Multipliers]
) -> tuple[Reals, Reals, Reals, Reals]:
    """Bound what each row predicts of its sample, without noise and with it.

    Parameters
    ----------
    cover : Cover
    rows : Regression
        Row k is reading + (known) + regressors theta, within its width.
    readings : (R,) float
        The reading in each row, which it predicts.
    proposer : callable
        Source of multipliers, as of :func:`setid.proofs.supports.supports`.

    Returns
    -------
    low, high : (R,) float
        Of the models' outputs.
    reading_low, reading_high : (R,) float
        Of readings, where the assumptions hold.
    """
    ranges = -supports(cover, rows.regressors, proposer)[:, ::-1]

    def shifted(values: Reals, side: float) -> Reals:
        """Shift outwards, by more than is rounded here; to infinity where a sum overflows."""
        found = values - known + side * 4.0 * _EPS * (np.abs(values) + size)
        return np.where(np.isfinite(found), found, side * np.inf)

    with np.errstate(over="ignore", invalid="ignore"):
        width = _noise_width(cover, rows.radius, rows.radii)
        known = rows.target - readings
        size = np.abs(rows.target) + np.abs(readings) + width
        low, high = ranges[:, 0], ranges[:, 1]
        return (
            shifted(low, -1.0),
            shifted(high, 1.0),
            shifted(low - width, -1.0),
            shifted(high + width, 1.0),
        )


def _noise_width(cover: Cover, radius: Reals, radii: Reals) -> Reals:
    """Largest width of the noise of each row over the cover."""
    size = np.where(np.any(radii > 0, axis=0), cover.magnitude, 0.0)
    return np.asarray((radius + radii @ size) * (1.0 + 1e-14), np.float64)
