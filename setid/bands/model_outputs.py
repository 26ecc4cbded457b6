"""Outputs of given parameters: their slopes, their poles, and what noise of a record adds.

All numbers here are rounded: they guide searches, and say what members attain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, lfiltic

from setid.proofs.supports import Cover
from setid.proofs.time_bands.enclosures import Experiment, noise_reach
from setid.proofs.time_bands.rows import OutputRow

__all__ = [
    "attained_by",
    "denominator_of",
    "force_of",
    "impulse_response",
    "outputs_of",
    "pole_radius",
    "slopes_of",
]

Reals = NDArray[np.float64]
_SMALL = 2.0**-100  # of the largest number in an impulse response: it ends there


def force_of(experiment: Experiment, cover: Cover) -> Reals:
    """Compute what drives the output: the residual of the output zero.

    Parameters
    ----------
    experiment : Experiment
    cover : Cover
        Of the parameters, for the rounding of the residual.

    Returns
    -------
    (N, 1 + p) float
        What no parameter multiplies, then what each of them does.
    """
    own, regressors, _ = experiment.row.residual(np.zeros(len(experiment.u)), experiment.u, cover)
    return np.column_stack([own, regressors])


def outputs_of(experiment: Experiment, theta: Reals, force: Reals) -> Reals:
    """Compute outputs (N,) of given parameters, from the first readings on.

    Parameters
    ----------
    experiment : Experiment
    theta : (p,) float
    force : (N, 1 + p) float
        See :func:`force_of`.
    """
    den, first = denominator_of(experiment, theta), experiment.first
    drive = -(force[:, 0] + force[:, 1:] @ theta)[first.size :] / den[0]
    den = den / den[0]
    with np.errstate(all="ignore"):
        if not first.size or den.size == 1:
            rest = lfilter([1.0], den, drive)
        else:
            rest = lfilter([1.0], den, drive, zi=lfiltic([1.0], den, first[::-1]))[0]
    return np.concatenate([first, rest])


def slopes_of(experiment: Experiment, cover: Cover, theta: Reals) -> Reals:
    """Differentiate outputs with respect to the coordinates, at some parameters.

    Parameters
    ----------
    experiment : Experiment
    cover : Cover
    theta : (p,) float

    Returns
    -------
    (N, p) float
    """
    v = outputs_of(experiment, theta, force_of(experiment, cover))
    regressors = experiment.row.residual(v, experiment.u, cover)[1]
    den, begun = denominator_of(experiment, theta), experiment.first.size
    found = np.zeros(regressors.shape)
    with np.errstate(all="ignore"):
        found[begun:] = -lfilter([1.0 / den[0]], den / den[0], regressors[begun:], axis=0)
    return found


def attained_by(experiment: Experiment, theta: Reals, force: Reals) -> tuple[Reals, Reals]:
    """Compute the range of outputs over the noise in inputs and first outputs.

    Parameters
    ----------
    experiment : Experiment
    theta : (p,) float
    force : (N, 1 + p) float
        See :func:`force_of`.

    Returns
    -------
    low, high : (N,) float
    """
    outputs = outputs_of(experiment, theta, force)
    reach = np.concatenate([experiment.start, np.zeros(experiment.samples)])
    with np.errstate(all="ignore"):
        if np.any(experiment.start) or np.any(experiment.input_noise):
            impulse = impulse_response(denominator_of(experiment, theta), experiment.samples)
            rest = noise_reach(experiment, (theta, theta), theta, impulse)
            reach[experiment.first.size :] = rest
        return outputs - reach, outputs + reach


def impulse_response(den: Reals, count: int) -> Reals:
    """Compute the impulse response of 1 / D, zero where all that follows is below its rounding.

    Parameters
    ----------
    den : (n + 1,) float
        Coefficients of D, the first of which is not zero.
    count : int
        Number of samples.

    Examples
    --------
    >>> import numpy as np
    >>> impulse_response(np.array([2.0, -1.0]), 3).tolist()
    [0.5, 0.25, 0.125]
    """
    found = np.asarray(lfilter([1.0 / den[0]], den / den[0], np.eye(1, count)[0]), np.float64)
    large = np.flatnonzero(~(np.abs(found) <= _SMALL * np.abs(found).max(initial=0.0)))
    found[int(large[-1]) + 1 if large.size else count :] = 0.0
    return found


def _feedback(row: OutputRow, theta: Reals) -> Reals:
    """Evaluate the coefficients (lag + 1,) of the output in its equation, by lag."""
    found = np.zeros(row.lag + 1)
    for lag, factor in row.feedback.items():
        found[lag] = factor.at(theta)
    return found


def denominator_of(experiment: Experiment, theta: Reals) -> Reals:
    """Compute the denominator (lag + 1,) of an output; 1 stands for a first coefficient of 0.

    Parameters
    ----------
    experiment : Experiment
    theta : (p,) float
    """
    found = _feedback(experiment.row, theta)
    return found if found[0] != 0.0 else found + np.eye(1, found.size)[0]


def pole_radius(row: OutputRow, theta: Reals) -> float:
    """Find the largest absolute value of a pole; 0 without poles, or where one is no number.

    Parameters
    ----------
    row : OutputRow
    theta : (p,) float
    """
    found = _feedback(row, theta)
    roots = np.roots(found) if np.all(np.isfinite(found)) else np.zeros(0)
    return float(np.abs(roots).max(initial=0.0))
