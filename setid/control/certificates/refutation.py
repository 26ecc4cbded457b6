"""Search for a consistent plant with an unstable loop; what is returned is proved."""

from __future__ import annotations

import time
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from setid.control.certificates.characteristic import closed_loop_polynomial, polynomials_of
from setid.control.certificates.small_gain import denominator_of
from setid.control.engine import (
    Formulation,
    IOData,
    Noise,
    TransferFunction,
    consistent,
    formulate,
    least_noise,
)
from setid.control.parameters.parameter_set import ParameterSet
from setid.control.parameters.rows import noisy_rows
from setid.control.parameters.sums import Frame, best_fit, least_noise_fit
from setid.control.transfer import Transfer, is_schur

__all__ = ["proves_instability", "unstable_plant"]

Reals = NDArray[np.float64]
_OUTSIDE = Fraction(1000000001, 1000000000)  # a root is proved to lie beyond this radius
_TRIES = 24  # directions
_BISECTIONS = 8


def unstable_plant(
    data: IOData,
    model: TransferFunction,
    noise: Noise,
    controller: Transfer,
    found: ParameterSet | None,
    integrators: int,
    margin: float | None,
    until: float,
) -> Transfer | None:
    """Look for a consistent plant that this controller does not stabilise.

    Parameters
    ----------
    data, model, noise, controller
    found : ParameterSet or None
        Where consistent parameters lie.
    integrators : int
    margin : float or None
        The plant is to obey it; it is to be stable in any case.
    until : float
        Reading of ``time.monotonic``.

    Returns
    -------
    Transfer or None
        Consistent with the record, with a root of the closed loop outside the unit disc: both
        proved. None where none was found.
    """
    if time.monotonic() > until:
        return None
    rows = noisy_rows(data, model, noise, integrators)
    frame = best_fit(rows) if found is None else found.frame
    formulation = formulate(data, model, noise)
    frame = Frame(least_noise_fit(rows, frame.origin), frame.axes)
    start = _theta(rows.offset, rows.basis, frame.origin)
    if _level(formulation, start) > 1.0:
        return None
    generator = np.random.default_rng(0)
    for turn in range(_TRIES):
        if time.monotonic() > until:
            return None
        direction = _direction(frame, rows.offset, rows.basis, controller, model, turn, generator)
        theta = _farthest(formulation, rows.offset, rows.basis, frame.origin, direction, until)
        if _radius(controller, model, theta) <= 1.0:
            continue
        if proves_instability(formulation, controller, model, theta, integrators, margin):
            below, top = polynomials_of(model, theta)
            return Transfer(top, below, data.Ts)
    return None


def _theta(offset: Reals, basis: Reals, x: Reals) -> Reals:
    return np.asarray(offset + basis @ x, np.float64)


def _level(formulation: Formulation, theta: Reals) -> float:
    level = least_noise(formulation, theta).level
    return float(level) if np.isfinite(level) else np.inf


def _radius(controller: Transfer, model: TransferFunction, theta: Reals) -> float:
    """Spectral radius of the closed loop (computed)."""
    polynomial = [float(c) for c in closed_loop_polynomial(controller, model, theta)]
    return float(np.abs(np.roots(polynomial)).max(initial=0.0))


def _direction(
    frame: Frame,
    offset: Reals,
    basis: Reals,
    controller: Transfer,
    model: TransferFunction,
    turn: int,
    generator: np.random.Generator,
) -> Reals:
    """First the gradient of the spectral radius, then random ones that do not oppose it."""
    x, step = frame.origin, 1e-4
    here = _radius(controller, model, _theta(offset, basis, x))
    ahead = [
        _radius(controller, model, _theta(offset, basis, x + step * axis)) for axis in frame.axes.T
    ]
    gradient = (np.array(ahead) - here) / step
    size = float(np.linalg.norm(gradient)) or 1.0
    if turn:
        random = generator.standard_normal(gradient.size)
        gradient = gradient / size + random / np.linalg.norm(random)
        size = float(np.linalg.norm(gradient)) or 1.0
    return np.asarray(frame.axes @ (gradient / size), np.float64)


def _farthest(
    formulation: Formulation,
    offset: Reals,
    basis: Reals,
    x: Reals,
    direction: Reals,
    until: float,
) -> Reals:
    """The last consistent parameters along a ray, by bisection (computed)."""
    low, high = 0.0, 1.0
    for _ in range(12):
        if (
            time.monotonic() > until
            or _level(formulation, _theta(offset, basis, x + high * direction)) > 1.0
        ):
            break
        low, high = high, 2.0 * high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if (
            time.monotonic() > until
            or _level(formulation, _theta(offset, basis, x + middle * direction)) > 1.0
        ):
            high = middle
        else:
            low = middle
    return _theta(offset, basis, x + low * direction)


def proves_instability(
    formulation: Formulation,
    controller: Transfer,
    model: TransferFunction,
    theta: Reals,
    integrators: int,
    margin: float | None,
) -> bool:
    """Prove that a loop is unstable and that its plant is consistent and as assumed.

    Parameters
    ----------
    formulation, controller, model
    theta : (p,) float
        Of the plant.
    integrators, margin
        What is assumed of the plant.
    """
    if integrators and sum(polynomials_of(model, theta)[0]) != 0:
        return False
    if is_schur(closed_loop_polynomial(controller, model, theta), _OUTSIDE):
        return False
    own = [Fraction(c) for c in denominator_of(model, integrators).at(theta)]
    if not is_schur(own, Fraction(1) - Fraction(margin or 0.0)):
        return False
    return consistent(formulation, theta) is not None
