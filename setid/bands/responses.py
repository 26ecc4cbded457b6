"""Bands of frequency and step responses over the feasible parameter set.

Every band says what it is: *proved* bands contain the response of every consistent
parameter vector; *sampled* ones are what members of the set reach, and may be too narrow.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import frozen, natural
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import members, nominal
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.supports import Proposer, cover_of
from setid.models.equations import Structure
from setid.proofs.enclosures import Nominal, enclose
from setid.proofs.frequency_regions import frequency_regions, rounding_of
from setid.proofs.supports import Cover
from setid.simulation.responses import frequency_response, frequency_weights, grid, run, transfer_of
from setid.simulation.simulate import simulate
from sparsepop_py.executors.dispatch import map_in_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["FrequencyBand", "Kind", "StepBand", "frequency_band", "nominal_outputs", "step_band"]

Kind = Literal["proved", "sampled"]
_FREQUENCIES = 32  # of one task
Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]


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
    *,
    executor: Executor | None = None,
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
    executor : concurrent.futures.Executor, optional
        Bounds proved bands, 32 frequencies a task; what is proved is the same with any number
        of workers.

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
        weights = frequency_weights(model, output, input, frequencies, data.Ts)
        rounding = rounding_of(model, output, input)
        found = _proved((cover_of(result), theta, weights, rounding), executor)
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


def _proved(
    given: tuple[Cover, Reals, tuple[Complexes, Complexes], float], executor: Executor | None
) -> tuple[Reals, Reals, Complexes]:
    """Bound gains, phases about the nominal one and regions, in parts if there is an executor."""
    cover, theta, (a, b), rounding = given
    if executor is None or not len(a):
        return _regions_task(given)
    parts = [slice(k, k + _FREQUENCIES) for k in range(0, len(a), _FREQUENCIES)]
    tasks = [(cover, theta, (a[part], b[part]), rounding) for part in parts]
    gains, turns, regions = zip(*map_in_order(executor, _regions_task, tasks), strict=True)
    return np.concatenate(gains), np.concatenate(turns), np.concatenate(regions)


def _regions_task(
    given: tuple[Cover, Reals, tuple[Complexes, Complexes], float],
) -> tuple[Reals, Reals, Complexes]:
    return frequency_regions(*given, Proposer)


def _sampled(responses: Complexes) -> tuple[Reals, Reals, Complexes]:
    """Ranges over members (M, F), the first being nominal."""
    gains = np.abs(responses)
    turns = np.angle(responses * np.conj(responses[0]))
    magnitude = np.stack([gains.min(axis=0), gains.max(axis=0)], axis=1)
    return magnitude, np.stack([turns.min(axis=0), turns.max(axis=0)], axis=1), responses.T


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
