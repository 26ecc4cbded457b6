"""Rows of a record as affine functions of the parameters, with every noise sample named."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.control.engine import DataError, IOData, ModelError, Noise, TransferFunction, frozen

__all__ = ["NoisyRows", "noisy_rows"]

Reals = NDArray[np.float64]
_LEAST, _MOST = 1e-150, 1e150  # of signals, whose squares are doubles


@dataclass(frozen=True, slots=True, eq=False)
class NoisyRows:
    """Rows target + regressors x = (noise + sum_j x_j slopes[j]) w with abs(w) <= bound.

    The parameters are theta = offset + basis x; x are those that equations leave free.

    Parameters
    ----------
    names : tuple of str
        Names of theta.
    offset, basis : (p,), (p, q) float
        Integers.
    target, regressors : (R,), (R, q) float
    target_size, regressor_size : (R,), (R, q) float
        Sums of absolute values of what they were computed from, for error bounds.
    noise : sparse (R, M)
    slopes : tuple of q sparse (R, M)
    bound : (M,) float
    """

    names: tuple[str, ...]
    offset: Reals
    basis: Reals
    target: Reals
    regressors: Reals
    target_size: Reals
    regressor_size: Reals
    noise: sps.csr_array
    slopes: tuple[sps.csr_array, ...]
    bound: Reals

    @property
    def largest(self) -> float:
        """Largest bound of a noise sample; 1 without noise."""
        return float(self.bound.max(initial=0.0)) or 1.0

    @property
    def relative(self) -> Reals:
        """Bounds (M,) as fractions of the largest: weights of fits, whose squares are doubles."""
        return np.asarray(self.bound / self.largest, np.float64)

    @property
    def squarable(self) -> bool:
        """True if squares of target and regressors are doubles, which error bounds rest on."""
        columns = np.column_stack([self.target_size, self.regressor_size])
        largest = columns.max(axis=0, initial=0.0)
        return bool(np.all((largest == 0.0) | ((largest > _LEAST) & (largest < _MOST))))

    def shape_of_noise(self, x: Reals) -> sps.csr_array:
        """Compute coefficients (R, M) of the noise samples at x (q,)."""
        total = self.noise
        for value, slope in zip(x, self.slopes, strict=True):
            total = total + slope * float(value)
        return sps.csr_array(total)


def noisy_rows(
    data: IOData, model: TransferFunction, noise: Noise, integrators: int = 0
) -> NoisyRows:
    """Write the rows of one transfer function from input to output.

    Parameters
    ----------
    data : IOData
        One input, one output, complete.
    model : TransferFunction
        One denominator, without offset.
    noise : Noise
        Sets over the record are not used: the rows hold without them.
    integrators : int
        Poles at exactly z = 1, 0 or 1.

    Raises
    ------
    DataError, ModelError
        If samples are missing, channels are several or an integrator has no pole.
    """
    na, nb, nk = _orders(data, model, integrators)
    u, y = data.u.ravel(), data.y.ravel()
    eta, xi, e = (bound.ravel() for bound in noise.bounds(data))
    lag = max(na, nk + nb - 1)
    if lag >= data.samples:
        raise DataError(f"data: found {data.samples} samples, expected more than {lag} in a record")
    begins = np.repeat(data.starts, np.diff(np.append(data.starts, data.samples)))
    first = begins + (0 if model.initial == "zero" else lag)
    rows = np.flatnonzero(np.arange(data.samples) >= first)
    if not rows.size:
        raise DataError(f"data: found {data.samples} samples, expected more than {lag} in a record")
    signals = [(y, i, 1.0) for i in range(1, na + 1)] + [(u, nk + j, -1.0) for j in range(nb)]
    groups = [0] * na + [1] * nb
    shifted = [_lagged(s, lags, sign, rows, begins) for s, lags, sign in signals]
    full = np.stack(shifted, axis=1) if shifted else np.zeros((rows.size, 0))
    parts = [
        _noise_matrix(data.samples, g, lags, sign, rows, begins)
        for g, (_, lags, sign) in zip(groups, signals, strict=True)
    ]
    own = _noise_matrix(data.samples, 0, 0, 1.0, rows, begins)
    own = own + _noise_matrix(data.samples, 2, 0, 1.0, rows, begins)
    offset, basis = _free(na, nb, integrators)
    bound = np.concatenate([eta, xi, e])
    used = np.flatnonzero(bound > 0)
    constant = _combined([own, *parts], np.append(1.0, offset))
    slopes = [_combined(parts, column) for column in basis.T]
    size = np.abs(full)
    return NoisyRows(
        names=model.parameters,
        offset=frozen(offset),
        basis=frozen(basis),
        target=frozen(y[rows] + full @ offset),
        regressors=frozen(full @ basis),
        target_size=frozen(np.abs(y[rows]) + size @ np.abs(offset)),
        regressor_size=frozen(size @ np.abs(basis)),
        noise=sps.csr_array(constant[:, used]),
        slopes=tuple(sps.csr_array(slope[:, used]) for slope in slopes),
        bound=frozen(bound[used]),
    )


def _orders(data: IOData, model: TransferFunction, integrators: int) -> tuple[int, int, int]:
    if not isinstance(data, IOData) or data.inputs != 1 or data.outputs != 1:
        raise DataError("data: expected an IOData with one input and one output")
    if np.isnan(data.u).any() or np.isnan(data.y).any():
        raise DataError("data: found missing samples, expected a complete record")
    if model.offset or model.inputs != 1 or model.outputs != 1:
        raise ModelError(
            "model: expected a TransferFunction with one input, one output and no offset"
        )
    na, nb, nk = model.na[0][0], model.nb[0][0], model.nk[0][0]
    if not 0 <= integrators <= min(na, 1):
        raise ModelError(f"integrators: found {integrators}, expected 0 or 1, at most the order")
    return na, nb, nk


def _lagged(
    signal: Reals, lag: int, sign: float, rows: NDArray[Any], begins: NDArray[Any]
) -> Reals:
    inside = rows - lag >= begins[rows]
    return np.where(inside, sign * signal[np.maximum(rows - lag, 0)], 0.0)


def _noise_matrix(
    samples: int, group: int, lag: int, sign: float, rows: NDArray[Any], begins: NDArray[Any]
) -> sps.csr_array:
    """Coefficients of the noise of one lagged signal; groups: output, input, equation."""
    inside = np.flatnonzero(rows - lag >= begins[rows])
    columns = group * samples + rows[inside] - lag
    shape = (rows.size, 3 * samples)
    return sps.csr_array((np.full(inside.size, sign), (inside, columns)), shape=shape)


def _combined(parts: list[sps.csr_array], weights: Reals) -> sps.csr_array:
    total = sps.csr_array(parts[0].shape)
    for part, weight in zip(parts, weights, strict=True):
        if weight:
            total = total + part * float(weight)
    return sps.csr_array(total)


def _free(na: int, nb: int, integrators: int) -> tuple[Reals, Reals]:
    """Theta = offset + basis x: with an integrator the last a is -1 minus the others."""
    p = na + nb
    offset, basis = np.zeros(p), np.eye(p)
    if integrators:
        offset[na - 1] = -1.0
        basis[na - 1, : na - 1] = -1.0
        basis = np.delete(basis, na - 1, axis=1)
    return offset, basis
