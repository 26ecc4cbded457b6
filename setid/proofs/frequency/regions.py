"""Proved regions of frequency responses over a cover of the feasible parameter set.

With G = N / D and a nominal g = N0 / D0, the number (N - g D) / D0 is affine in theta; its proved
ranges in four directions bound (G - g) D / D0, and the proved range of D / D0 turns that into
bounds of G - g. Rounding is included.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from setid.models.checked_structures import coefficients_of
from setid.models.equations import Structure
from setid.proofs.supports import Cover, Multipliers, supports

__all__ = [
    "angles_of",
    "frequency_regions",
    "gains_of",
    "quotient_rectangle",
    "rounding_of",
]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Proposer = Callable[[Cover], Multipliers]
_EPS = float(np.finfo(float).eps)


def rounding_of(model: Structure, output: int, input: int) -> float:
    """Bound the relative error of exp(-j omega Ts lag), of sums over theta and of quotients.

    The angle omega Ts lag <= pi lag is rounded twice, each time by at most half an ulp, and moves
    the point of the unit circle by as much; (j omega)^-lag loses less. The factor 8 leaves room
    for the exponential and for products with weights, the count of parameters for sums.
    """
    transfer = coefficients_of(model, output, input)
    lag = max(transfer.delay + len(transfer.numerator), len(transfer.denominator))
    return _EPS * (8.0 * np.pi * lag + 4.0 * len(model.parameters) + 64.0)


def frequency_regions(
    cover: Cover,
    theta: Reals,
    weights: tuple[Complexes, Complexes],
    rounding: float,
    proposer: Proposer,
) -> tuple[Reals, Reals, Complexes]:
    """Bound gains and phases of a transfer function at given frequencies.

    Parameters
    ----------
    cover : Cover
    theta : (p,) float
        Nominal; any numbers will do, close ones give narrow regions.
    weights : (A, B), each (F, p) complex
        N = A theta and D = 1 + B theta at each frequency.
    rounding : float
        Relative error of the weights, of sums and of quotients; see :func:`rounding_of`.
    proposer : callable
        Source of multipliers, as of :func:`setid.proofs.supports.supports`.

    Returns
    -------
    gains : (F, 2) float
    turns : (F, 2) float
        Phases about the nominal one.
    corners : (F, 4) complex
        Of a rectangle that holds the response; infinite where nothing is proved.
    """
    a, b = weights
    d0 = 1.0 + b @ theta
    d0 = np.where(d0 == 0, np.finfo(float).tiny, d0)  # then the range of D / D0 is unbounded
    g = a @ theta / d0
    turn = np.where(g == 0, 1.0, g / np.where(g == 0, 1.0, np.abs(g)))
    # With e = (N - g D) / (D0 turn) and q = D / D0 it is (G - g) / turn = e / q.
    scale = (d0 * turn)[:, None]
    low, high = _rectangles(
        cover,
        np.concatenate([-g / (d0 * turn), 1.0 / d0]),
        np.concatenate([(a - g[:, None] * b) / scale, b / d0[:, None]]),
        rounding,
        proposer,
    )
    count = len(a)
    found = [
        _one_frequency(abs(g[k]), (low[k], high[k]), (low[count + k], high[count + k]))
        for k in range(count)
    ]
    gains, angles, corners = (np.array(column) for column in zip(*found, strict=True))
    known = np.isfinite(corners)
    turned = np.where(known, corners, 0.0) * turn[:, None]
    return gains, angles, np.where(known, turned, np.inf)


def _rectangles(
    cover: Cover,
    constants: Complexes,
    weights: Complexes,
    rounding: float,
    proposer: Proposer,
) -> tuple[Complexes, Complexes]:
    """Lower left and upper right corners of constant + weights'theta, proved, (K,) each."""
    count = len(constants)
    ranges = supports(cover, np.concatenate([weights.real, weights.imag]), proposer)
    size = np.abs(weights) @ np.where(np.isfinite(cover.magnitude), cover.magnitude, 0.0)
    slack = rounding * (np.abs(constants) + size)
    real, imaginary = ranges[:count], ranges[count:]
    low = constants.real + real[:, 0] - slack, constants.imag + imaginary[:, 0] - slack
    high = constants.real + real[:, 1] + slack, constants.imag + imaginary[:, 1] + slack
    return _complex(*low), _complex(*high)


def _complex(real: Reals, imaginary: Reals) -> Complexes:
    found = np.empty(real.shape, np.complex128)
    found.real, found.imag = real, imaginary  # no arithmetic: infinite parts stay as they are
    return found


def _one_frequency(
    gain: float, e: tuple[complex, complex], q: tuple[complex, complex]
) -> tuple[tuple[float, float], tuple[float, float], Complexes]:
    """Bounds of gain, of phase about the nominal one, and the corners of a rectangle.

    Parameters
    ----------
    gain : float
        The nominal one.
    e, q : (low, high)
        Rectangles.
    """
    west, east, south, north = quotient_rectangle(e, q, 8 * _EPS * gain)
    if not np.isfinite(west):
        return (0.0, np.inf), (-np.pi, np.pi), np.full(4, np.inf + 0j)
    # the gain moves the rectangle; its rounding is in what was added to the quotient
    west, east = gain + west, gain + east
    corners = np.array([west + 1j * south, east + 1j * south, east + 1j * north, west + 1j * north])
    return gains_of(west, east, south, north), angles_of(west, east, south, north), corners


def quotient_rectangle(
    e: tuple[complex, complex], q: tuple[complex, complex], slack: float
) -> tuple[float, float, float, float]:
    """Bound e / q by a rectangle, for e and q in rectangles, q near 1.

    Parameters
    ----------
    e, q : (low, high)
        Lower left and upper right corners.
    slack : float
        Added on all sides.

    Returns
    -------
    west, east, south, north : float
        Infinite where q may have no positive real part.
    """
    if not q[0].real > 0 or not np.all(np.isfinite([*e, *q])):
        return -np.inf, np.inf, -np.inf, np.inf
    size = _farthest(*e)
    off = _farthest(q[0] - 1.0, q[1] - 1.0) / q[0].real  # abs(1/q - 1) is at most this
    wide = off * size * (1.0 + 8 * _EPS) + 8 * _EPS * size + slack
    return e[0].real - wide, e[1].real + wide, e[0].imag - wide, e[1].imag + wide


def _farthest(low: complex, high: complex) -> float:
    """Largest absolute value in a rectangle, rounded up."""
    real = max(abs(low.real), abs(high.real))
    imaginary = max(abs(low.imag), abs(high.imag))
    return float(np.hypot(real, imaginary) * (1.0 + 4 * _EPS))


def gains_of(west: float, east: float, south: float, north: float) -> tuple[float, float]:
    """Bound the absolute value in the rectangle."""
    across = max(0.0, west, -east), max(0.0, south, -north)
    far = max(abs(west), abs(east)), max(abs(south), abs(north))
    least = float(np.hypot(*across)) * (1.0 - 4 * _EPS)
    return least, float(np.hypot(*far)) * (1.0 + 4 * _EPS)


def angles_of(west: float, east: float, south: float, north: float) -> tuple[float, float]:
    """Bound the angle in a rectangle; all angles where it reaches the left half plane."""
    if west <= 0:
        return -np.pi, np.pi
    angles = np.angle([west + 1j * south, west + 1j * north, east + 1j * south, east + 1j * north])
    return float(angles.min()) - 8 * _EPS, float(angles.max()) + 8 * _EPS
