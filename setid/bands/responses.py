"""Bands of frequency and step responses over the feasible parameter set.

Every band says what it is: *proved* bands contain the response of every consistent
parameter vector; *sampled* ones are what members of the set reach, and may be too narrow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import frozen, natural
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import members, nominal
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.supports import Proposer, cover_of, supports
from setid.models.equations import Structure
from setid.proofs.enclosures import Nominal, enclose
from setid.proofs.supports import Cover
from setid.simulation.responses import frequency_response, frequency_weights, grid, run, transfer_of
from setid.simulation.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["FrequencyBand", "Kind", "StepBand", "frequency_band", "nominal_outputs", "step_band"]

Kind = Literal["proved", "sampled"]
Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyBand:
    """Magnitude and phase of one transfer function over the feasible parameter set.

    Parameters
    ----------
    kind : {"proved", "sampled"}
    output, input : int
        Channels, from 1.
    omega : (F,) float
        rad per unit of time.
    nominal : (F,) complex
        Response of the nominal model.
    magnitude : (F, 2) float
        Least and largest gain (not in dB); infinite where nothing is proved.
    phase : (F, 2) float
        Least and largest phase in rad, continuous along the nominal response.
    regions : (F, V) complex
        For a proved band the corners of a quadrangle that contains the response at each
        frequency (V = 4), for a sampled one the responses of V members.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.frequency_band(result, [0.5, 1.0])
    >>> band.kind, band.regions.shape
    ('proved', (2, 4))
    """

    kind: Kind
    output: int
    input: int
    omega: Reals
    nominal: Complexes
    magnitude: Reals
    phase: Reals
    regions: Complexes

    @property
    def decibel(self) -> Reals:
        """The gain in dB, shape (F, 2)."""
        with np.errstate(divide="ignore"):
            return np.asarray(20.0 * np.log10(self.magnitude), np.float64)

    def plot(self, kind: str = "bode") -> NDArray[Any] | Axes:
        """Draw a ``"bode"``, ``"nyquist"`` or ``"nichols"`` plot; returns the axes.

        Parameters
        ----------
        kind : {"bode", "nyquist", "nichols"}
        """
        from setid.plots.responses import plot_frequency_band

        return plot_frequency_band(self, kind)


@dataclass(frozen=True, slots=True, eq=False)
class StepBand:
    """Response to a unit step from rest over the feasible parameter set.

    Parameters
    ----------
    kind : {"proved", "sampled"}
    output, input : int
        Channels, from 1.
    time : (N,) float
    nominal : (N,) float
    low, high : (N,) float

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.step_band(result, 3).time
    array([0., 1., 2.])
    """

    kind: Kind
    output: int
    input: int
    time: Reals
    nominal: Reals
    low: Reals
    high: Reals

    def plot(self) -> Axes:
        """Draw it; returns the axes."""
        from setid.plots.responses import plot_step_band

        return plot_step_band(self)


# ---- frequency --------------------------------------------------------------------------


def frequency_band(
    result: FeasibleSet,
    omega: ArrayLike | None = None,
    kind: Kind = "proved",
    output: int = 1,
    input: int = 1,
    samples: int = 100,
    seed: int = 0,
) -> FrequencyBand:
    """Band of a frequency response, for Bode, Nyquist and Nichols plots.

    Parameters
    ----------
    result : FeasibleSet
        Of a linear structure.
    omega : array_like (F,), optional
        rad per unit of time, at most pi / Ts (any in continuous time).
    kind : {"proved", "sampled"}
    output, input : int
        Channels, from 1.
    samples, seed : int
        Mixtures of attained members, for sampled bands.

    Returns
    -------
    FrequencyBand

    Raises
    ------
    SetidError
        If the feasible set is empty, or the structure is not linear.

    Notes
    -----
    With G = N / D and a nominal g = N0 / D0, the number (N - g D) / D0 is affine in theta;
    its proved ranges in four directions, over a cover of the feasible set, bound
    (G - g) D / D0, and the proved range of D / D0 turns that into bounds of G - g. The
    error is of second order in the widths, and rounding is included.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.frequency_band(result, [1.0])
    >>> inner = setid.frequency_band(result, [1.0], kind="sampled")
    >>> bool(band.magnitude[0, 0] <= inner.magnitude[0, 0])
    True
    """
    data, model = result.formulation.data, result.formulation.model
    continuous = transfer_of(model, output, input).continuous
    frequencies = grid(omega, data.Ts, continuous=continuous)
    theta = nominal(result)
    response = frequency_response(model, theta, frequencies, data.Ts, output, input)
    if kind == "proved":
        a, b = frequency_weights(model, output, input, frequencies, data.Ts)
        found = _proved(cover_of(result), theta, a, b, _rounding(model, output, input))
    elif kind == "sampled":
        thetas = np.vstack([theta, members(result, samples, seed)])
        found = _sampled(frequency_response(model, thetas, frequencies, data.Ts, output, input))
    else:
        raise SetidError(f"kind: found {kind!r}, expected 'proved' or 'sampled'")
    magnitude, turn, regions = found
    angle = np.unwrap(np.angle(response))
    return FrequencyBand(
        kind,
        output,
        input,
        frozen(frequencies),
        frozen(response),
        frozen(magnitude),
        frozen(angle[:, None] + turn),
        frozen(regions),
    )


def _sampled(responses: Complexes) -> tuple[Reals, Reals, Complexes]:
    """Ranges over members (M, F), the first being nominal."""
    gains = np.abs(responses)
    turns = np.angle(responses * np.conj(responses[0]))
    magnitude = np.stack([gains.min(axis=0), gains.max(axis=0)], axis=1)
    return magnitude, np.stack([turns.min(axis=0), turns.max(axis=0)], axis=1), responses.T


def _rounding(model: Structure, output: int, input: int) -> float:
    """Bound the relative error of exp(-j omega Ts lag), of sums over theta and of quotients.

    The angle omega Ts lag <= pi lag is rounded twice, each time by at most half an ulp, and moves
    the point of the unit circle by as much; (j omega)^-lag loses less. The factor 8 leaves room
    for the exponential and for products with weights, the count of parameters for sums.
    """
    transfer = transfer_of(model, output, input)
    lag = max(transfer.delay + len(transfer.numerator), len(transfer.denominator))
    return _EPS * (8.0 * np.pi * lag + 4.0 * len(model.parameters) + 64.0)


def _proved(
    cover: Cover, theta: Reals, a: Complexes, b: Complexes, rounding: float
) -> tuple[Reals, Reals, Complexes]:
    """Gains, turns about the nominal phase, corners; see the notes of frequency_band."""
    d0 = 1.0 + b @ theta
    d0 = np.where(d0 == 0, np.finfo(float).tiny, d0)  # then the range of D / D0 is endless
    g = a @ theta / d0
    turn = np.where(g == 0, 1.0, g / np.where(g == 0, 1.0, np.abs(g)))
    # With e = (N - g D) / (D0 turn) and q = D / D0 it is (G - g) / turn = e / q.
    scale = (d0 * turn)[:, None]
    low, high = _rectangles(
        cover,
        np.concatenate([-g / (d0 * turn), 1.0 / d0]),
        np.concatenate([(a - g[:, None] * b) / scale, b / d0[:, None]]),
        rounding,
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
    cover: Cover, constants: Complexes, weights: Complexes, rounding: float
) -> tuple[Complexes, Complexes]:
    """Lower left and upper right corners of constant + weights'theta, proved, (K,) each."""
    count = len(constants)
    ranges = supports(cover, np.concatenate([weights.real, weights.imag]))
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
    if not q[0].real > 0 or not np.all(np.isfinite([*e, *q])):
        return (0.0, np.inf), (-np.pi, np.pi), np.full(4, np.inf + 0j)
    size = _farthest(*e)
    off = _farthest(q[0] - 1.0, q[1] - 1.0) / q[0].real  # abs(1/q - 1) is at most this
    slack = off * size * (1.0 + 8 * _EPS) + 8 * _EPS * (gain + size)
    west, east = gain + e[0].real - slack, gain + e[1].real + slack
    south, north = e[0].imag - slack, e[1].imag + slack
    corners = np.array([west + 1j * south, east + 1j * south, east + 1j * north, west + 1j * north])
    return _gains(west, east, south, north), _angles(corners, west), corners


def _farthest(low: complex, high: complex) -> float:
    """Largest absolute value in a rectangle, rounded up."""
    real = max(abs(low.real), abs(high.real))
    imaginary = max(abs(low.imag), abs(high.imag))
    return float(np.hypot(real, imaginary) * (1.0 + 4 * _EPS))


def _gains(west: float, east: float, south: float, north: float) -> tuple[float, float]:
    """Least and largest absolute value in the rectangle."""
    across = max(0.0, west, -east), max(0.0, south, -north)
    far = max(abs(west), abs(east)), max(abs(south), abs(north))
    least = float(np.hypot(*across)) * (1.0 - 4 * _EPS)
    return least, float(np.hypot(*far)) * (1.0 + 4 * _EPS)


def _angles(corners: Complexes, west: float) -> tuple[float, float]:
    """Range of the angle in a rectangle; all angles where it reaches the left half plane."""
    if west <= 0:
        return -np.pi, np.pi
    angles = np.angle(corners)
    return float(angles.min()) - 8 * _EPS, float(angles.max()) + 8 * _EPS


def nominal_outputs(model: Structure, theta: Reals, record: IOData, from_rest: bool) -> Nominal:
    """Simulate what an enclosure is computed around.

    Parameters
    ----------
    model : Structure
    theta : (p,) float
    record : IOData
    from_rest : bool
        All signals are zero before the record.
    """
    linear = bool(model.regression())  # enclosures refuse the others and say why
    outputs = run(model, theta, record, from_rest) if linear else np.zeros(record.y.shape)
    return Nominal(theta, outputs, Proposer)


# ---- steps ------------------------------------------------------------------------------


def step_band(
    result: FeasibleSet,
    length: int = 50,
    kind: Kind = "proved",
    output: int = 1,
    input: int = 1,
    samples: int = 100,
    seed: int = 0,
) -> StepBand:
    """Band of the response to a unit step at one input, from rest, without noise.

    Parameters
    ----------
    result : FeasibleSet
    length : int
        Number of samples.
    kind : {"proved", "sampled"}
        Proved bands are available for linear structures with one denominator an output;
        they become infinite where nothing is proved.
    output, input : int
        Channels, from 1.
    samples, seed : int
        Mixtures of attained members, for sampled bands.

    Returns
    -------
    StepBand

    Raises
    ------
    SetidError
        If the feasible set is empty, or nothing can be proved of this structure.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.step_band(result, 3)
    >>> bool(((band.low <= band.nominal) & (band.nominal <= band.high)).all())
    True
    """
    data, model = result.formulation.data, result.formulation.model
    count = natural(length, "length", SetidError, least=1)
    channels = natural(output, "output", SetidError, 1), natural(input, "input", SetidError, 1)
    if channels[0] > model.outputs or channels[1] > model.inputs:
        raise ModelError(
            f"output, input: found {output}, {input}, expected at most "
            f"{model.outputs}, {model.inputs}, counted from 1"
        )
    column, theta = output - 1, nominal(result)
    u = np.zeros((count, model.inputs))
    u[:, input - 1] = 1.0
    centre = simulate(model, theta, u)[:, column]
    if kind == "proved":
        record = IOData(np.vstack([u, np.zeros_like(u[:1])]), np.zeros((count + 1, model.outputs)))
        around = nominal_outputs(model, theta, record, True)
        enclosure = enclose(model, around, cover_of(result), record, from_rest=True)[column]
        low, high = enclosure.low[:count], enclosure.high[:count]
    elif kind == "sampled":
        thetas = np.vstack([theta, members(result, samples, seed)])
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.array([simulate(model, t, u)[:, column] for t in thetas])
        low, high = found.min(axis=0), found.max(axis=0)
    else:
        raise SetidError(f"kind: found {kind!r}, expected 'proved' or 'sampled'")
    time = np.arange(count) * data.Ts
    return StepBand(kind, output, input, frozen(time), frozen(centre), frozen(low), frozen(high))
