"""Bands of frequency responses over the feasible parameter set.

Every band says what it is: *proved* bands contain the response of every consistent
parameter vector; *sampled* ones are what members of the set reach, and may be too narrow.
"""

from __future__ import annotations

import numbers
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.bands.branching import FIRST_SECONDS
from setid.bands.frequency_arcs import refined_arcs
from setid.bands.verdicts import Kind
from setid.data.checks import frozen, natural, real_array, seconds_of, word
from setid.errors import SetidError
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_set.coordinates import parameter_coordinates
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.narrowing import narrowing_of
from setid.feasible_set.proposer import Proposer
from setid.options import check_executor
from setid.proofs.frequency.arc_regions import ArcRegions, families_of
from setid.proofs.frequency.regions import frequency_regions, rounding_of
from setid.proofs.supports import Cover
from setid.simulation.responses import frequency_response, frequency_weights, grid, transfer_of
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.executors.dispatch import map_in_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["FrequencyBand", "frequency_band"]

_FREQUENCIES = 32  # of one task
Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_Given = tuple[Cover, Reals, tuple[Complexes, Complexes], float]  # of frequency_regions
_SHARE = 0.7  # of the time, for ranges of responses
_TOLERANCE = 0.1  # share of the members' range that these may reach beyond it on each side


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyBand(ReadOnly):
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
    arcs : ArcRegions or None
        What is proved between the frequencies; None for sampled bands, in continuous time, and
        where an interval is infinite.
    Ts : float
        Sampling time.
    labels : (str, str) or None
        Names and units of output and input, for axes.
    time_unit : str
        For axes; empty where the record says none.
    view : {"bode", "nyquist", "nichols"}
        What :meth:`plot` draws unless it is told otherwise.

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
    arcs: ArcRegions | None = None
    Ts: float = 1.0
    labels: tuple[str, str] | None = None
    time_unit: str = ""
    view: str = "bode"

    def __repr__(self) -> str:
        pair = f"y{self.output} from u{self.input}"
        return f"<FrequencyBand: {self.kind}, {pair}, {self.omega.size} frequencies>"

    def between(self, omega: ArrayLike) -> tuple[Reals, Reals]:
        """Bound gains and phases at any frequencies, also between those of the band.

        Parameters
        ----------
        omega : (K,) array_like
            rad per unit of time, from 0 to pi / Ts.

        Returns
        -------
        magnitude, phase : (K, 2) float
            Infinite, or all angles, where nothing is proved.

        Raises
        ------
        SetidError
            If nothing is proved between frequencies: the band is sampled, or of a
            continuous-time structure.
        """
        arcs = self._proved_arcs()
        frequencies = np.atleast_1d(real_array(omega, "omega", SetidError))
        if frequencies.ndim != 1 or not frequencies.size or np.any(np.isnan(frequencies)):
            raise SetidError(f"omega: found {frequencies.tolist()!r:.60}, expected frequencies")
        found = [arcs.at(w) for w in (frequencies * self.Ts).tolist()]
        gains, phases = (np.array(x) for x in zip(*found, strict=True))
        near = np.interp(frequencies, self.omega, np.unwrap(np.angle(self.nominal)))
        turns = np.round((near - phases.mean(axis=1)) / (2 * np.pi))
        return gains, phases + 2 * np.pi * turns[:, None]

    @property
    def peak(self) -> tuple[float, float]:
        """Proved bounds of the largest gain that a consistent model has at any frequency."""
        arcs = self._proved_arcs()
        return max(float(self.magnitude[:, 0].max()), arcs.least_peak), arcs.largest_gain

    def distance(self, point: complex = -1.0) -> float:
        """Bound the distance of all responses from a point of the plane from below.

        From -1 it is the modulus margin of the loop that the response closes with gain 1; where
        it is positive and one of these loops is stable, all of stable plants are.

        Parameters
        ----------
        point : complex

        Raises
        ------
        SetidError
            If it is no finite number, or nothing is proved between the frequencies.
        """
        if not isinstance(point, numbers.Complex) or not np.isfinite(complex(point)):
            raise SetidError(f"point: found {point!r:.60}, expected a finite complex number")
        return self._proved_arcs().distance(complex(point))

    def _proved_arcs(self) -> ArcRegions:
        if self.arcs is None:
            raise SetidError(
                "band: nothing is proved between its frequencies; expected a proved band of a "
                "discrete-time structure with finite intervals"
            )
        return self.arcs

    @property
    def decibel(self) -> Reals:
        """The gain in dB, shape (F, 2)."""
        with np.errstate(divide="ignore"):
            return np.asarray(20.0 * np.log10(self.magnitude), np.float64)

    def plot(self, ax: Any = None, kind: str | None = None) -> NDArray[Any] | Axes:
        """Draw a ``"bode"``, ``"nyquist"`` or ``"nichols"`` plot; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, or two of them for a Bode plot, optional
            The kind may stand in this place.
        kind : {"bode", "nyquist", "nichols"}, optional
            ``view`` when left out.
        """
        from setid.plots.responses import plot_frequency_band

        given, chosen = (None, ax) if isinstance(ax, str) else (ax, kind or self.view)
        return plot_frequency_band(self, chosen, given)


def frequency_band(
    result: FeasibleSet,
    omega: ArrayLike | None = None,
    kind: Kind = "proved",
    output: int = 1,
    input: int = 1,
    samples: int = 100,
    seed: int = 0,
    time_limit: float = 20.0,
    *,
    executor: Executor | None = None,
) -> FrequencyBand:
    """Enclose a frequency response, for Bode, Nyquist and Nichols plots.

    Parameters
    ----------
    result : FeasibleSet
        Of a linear structure, or of a block structure: then of the linear block between the
        channels, or the only one, without static maps and feedback through them.
    omega : array_like (F,), optional
        rad per unit of time, at most pi / Ts (any in continuous time).
    kind : {"proved", "sampled"}
    output, input : int
        Channels, from 1.
    samples, seed : int
        Mixtures of attained members, for sampled bands.
    time_limit : float
        Seconds for ranges of responses, where the rows in theta say little, and for what is proved
        between the frequencies; of sampled bands for mixtures.
    executor : concurrent.futures.Executor, optional
        Bounds proved bands, 32 frequencies a task; what is proved is the same with any number
        of workers.

    Returns
    -------
    FrequencyBand

    Raises
    ------
    SetidError
        If the feasible set is empty, or there is no linear block between the channels, or it
        subtracts the input, or is not all that is linear between them (a loop, a second path).

    Notes
    -----
    With G = N / D and a nominal g = N0 / D0, the number (N - g D) / D0 is affine in theta;
    its proved ranges in four directions, over a cover of the feasible set, bound
    (G - g) D / D0, and the proved range of D / D0 turns that into bounds of G - g. The
    error is of second order in the widths, and rounding is included. Between frequencies the
    same is done on arcs of the unit circle; see :meth:`FrequencyBand.between`.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.frequency_band(result, [1.0])
    >>> inner = setid.frequency_band(result, [1.0], kind="sampled")
    >>> bool(band.magnitude[0, 0] <= inner.magnitude[0, 0])
    True
    >>> [round(gain, 1) for gain in band.peak]  # of every consistent model, at any frequency
    [2.6, 4.5]
    """
    check_result(result)
    data, model = result.formulation.data, result.formulation.model
    for field, channel in (("output", output), ("input", input)):
        natural(channel, field, SetidError, 1)
    continuous = transfer_of(model, output, input).continuous
    draws_of(samples, seed)
    frequencies = grid(omega, data.Ts, continuous=continuous)
    theta = nominal(result)
    response = frequency_response(model, theta, frequencies, data.Ts, output, input)
    arcs = None
    check_executor(executor)
    seconds = seconds_of(time_limit)
    if word(kind, "kind", ("proved", "sampled"), SetidError) == "proved":
        until = time.monotonic() + seconds
        late = until + max(seconds, FIRST_SECONDS)
        weights = frequency_weights(model, output, input, frequencies, data.Ts)
        cover = _narrowed(result, theta, weights, _SHARE * time_limit)
        rounding = rounding_of(model, output, input)
        found = _proved((cover, theta, weights, rounding), late, executor)
        if not continuous and np.all(np.isfinite([cover.lower, cover.upper])):
            families = families_of(transfer_of(model, output, input), model.parameters)
            arcs = refined_arcs(cover, theta, families, until, late)
            found = _met(found, arcs, frequencies * data.Ts, response)
    else:
        thetas = np.vstack([theta, members(result, samples, seed, time_limit)])
        found = _sampled(frequency_response(model, thetas, frequencies, data.Ts, output, input))
    magnitude, turn, regions = found
    angle = np.unwrap(np.angle(response))
    return FrequencyBand(
        kind=kind,
        output=output,
        input=input,
        omega=frozen(frequencies),
        nominal=frozen(response),
        magnitude=frozen(magnitude),
        phase=frozen(angle[:, None] + turn),
        regions=frozen(regions),
        arcs=arcs,
        Ts=data.Ts,
        labels=(data.output_labels[output - 1], data.input_labels[input - 1]),
        time_unit=data.time_unit,
    )


def _narrowed(
    result: FeasibleSet, theta: Reals, weights: tuple[Complexes, Complexes], time_limit: float
) -> Cover:
    """Cover the set, narrowly where responses are wide beside those of members."""
    until, asked = (
        time.monotonic() + time_limit,
        narrowing_of(result, parameter_coordinates(result)),
    )
    cover = asked.cover
    if cover.exact or not np.all(np.isfinite([cover.lower, cover.upper])):
        return cover
    functions = _slopes(theta, weights)
    while asked.narrow(functions, asked.excess(functions, _TOLERANCE), until):
        pass
    return asked.cover


def _slopes(theta: Reals, weights: tuple[Complexes, Complexes]) -> Reals:
    """Differentiate G / (g / abs(g)) at theta: finite real and imaginary parts, (K, p)."""
    a, b = weights
    with np.errstate(all="ignore"):
        below = 1.0 + b @ theta
        g = a @ theta / below
        slopes = (a - g[:, None] * b) / (below * np.exp(1j * np.angle(g)))[:, None]
    found = np.concatenate([slopes.real, slopes.imag])
    return found[np.all(np.isfinite(found), axis=1)]


def _proved(
    given: _Given, late: float, executor: Executor | None
) -> tuple[Reals, Reals, Complexes]:
    """Bound gains, phases about the nominal one and regions, in parts if there is an executor."""
    cover, theta, (a, b), rounding = given
    left = late - time.monotonic()
    if executor is None or not len(a):
        return _regions_task((given, left))
    parts = [slice(k, k + _FREQUENCIES) for k in range(0, len(a), _FREQUENCIES)]
    tasks = [((cover, theta, (a[part], b[part]), rounding), left) for part in parts]
    gains, turns, regions = zip(*map_in_order(executor, _regions_task, tasks), strict=True)
    return np.concatenate(gains), np.concatenate(turns), np.concatenate(regions)


def _regions_task(task: tuple[_Given, float]) -> tuple[Reals, Reals, Complexes]:
    """Bound regions, with linear programs that are begun within some seconds from now."""
    given, left = task
    until = time.monotonic() + left
    return frequency_regions(*given, lambda cover: Proposer(cover, until=until))


def _met(
    found: tuple[Reals, Reals, Complexes], arcs: ArcRegions, turns: Reals, response: Complexes
) -> tuple[Reals, Reals, Complexes]:
    """Join what is proved at frequencies and on the arcs there."""
    gains, angles, corners = found[0].copy(), found[1].copy(), found[2].copy()
    for k, w in enumerate(turns.tolist()):
        (low, high), phases = arcs.at(w)
        if np.isinf(gains[k, 1]) and np.isfinite(high):
            turn = float(np.angle(response[k]))
            off = 2 * np.pi * round((turn - sum(phases) / 2) / (2 * np.pi)) - turn
            angles[k] = phases[0] + off, phases[1] + off
            corners[k] = arcs.corners(w)
        gains[k] = max(gains[k, 0], low), min(gains[k, 1], high)
    return gains, angles, corners


def _sampled(responses: Complexes) -> tuple[Reals, Reals, Complexes]:
    """Find gains, phases and responses of members (M, F), the first being nominal."""
    gains = np.abs(responses)
    turns = np.angle(responses * np.conj(responses[0]))
    magnitude = np.stack([gains.min(axis=0), gains.max(axis=0)], axis=1)
    return magnitude, np.stack([turns.min(axis=0), turns.max(axis=0)], axis=1), responses.T
