"""Bands of step responses over the feasible parameter set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from setid.bands.enclosing import Accuracy, affine_rows, band_of
from setid.bands.model_outputs import pole_radius
from setid.bands.verdicts import BandReport, Kind
from setid.data.checks import channel_pair, frozen, natural, switch, word
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_set.coordinates import Coordinates
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.models.block import BlockStructured
from setid.models.checked_structures import coefficients_of, regression_of
from setid.models.continuous import ContinuousTransferFunction
from setid.models.equations import Structure
from setid.models.lti import TransferFunction
from setid.proofs.time_bands.enclosures import Experiment
from setid.proofs.time_bands.rows import OutputRow, transfer_row
from setid.simulation.simulate import simulate
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["StepBand", "step_band"]

Reals = NDArray[np.float64]
_MOST = 100_000  # samples of a response
_SETTLED = 1e-4  # of the nominal impulse response where it is cut off for a bound for all time
_LONGEST = 3000  # samples of it
_HOPELESS = 2  # times as many samples: where nothing is proved for all time


@dataclass(frozen=True, slots=True, eq=False)
class StepBand(ReadOnly):
    """Response of the plant to a unit step from rest over the feasible parameter set.

    Parameters
    ----------
    kind : {"proved", "sampled"}
    output, input : int
        Channels, from 1.
    time : (N,) float
    nominal : (N,) float
    low, high : (N,) float
        Proved, or what members reach.
    attained_low, attained_high : (N,) float
        What members reach, up to rounding; NaN where none is known.
    later : (float, float)
        Proved range of the response after the last sample; infinite unless it was asked for and
        proved.
    report : BandReport or None
        Of a proved band: how it compares with what is attained.
    labels : (str, str) or None
        Names and units of output and input, for axes.
    time_unit : str
        For axes; empty where the record says none.
    recursion : str
        Of a continuous-time structure: what responds, and what the step is between samples.

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
    attained_low: Reals
    attained_high: Reals
    later: tuple[float, float] = (-np.inf, np.inf)
    report: BandReport | None = None
    labels: tuple[str, str] | None = None
    time_unit: str = ""
    recursion: str = ""

    def __repr__(self) -> str:
        pair = f"y{self.output} from u{self.input}"
        return f"<StepBand: {self.kind}, {pair}, {self.time.size} samples>"

    @property
    def all_time(self) -> tuple[float, float]:
        """Range of the response at all samples, the later ones included."""
        low, high = min(self.low.min(), self.later[0]), max(self.high.max(), self.later[1])
        return float(low), float(high)

    def summary(self) -> str:
        """Describe the band in a few lines."""
        lines = [f"{self.kind} band of the step response of y{self.output} from u{self.input}"]
        if self.recursion:
            lines.append(f"{self.recursion}: the plant's own response differs by its error")
        if self.report is not None:
            lines.append(self.report.text)
        if np.all(np.isfinite(self.later)):
            low, high = rounded(self.later[0], False, 5), rounded(self.later[1], True, 5)
            lines.append(f"after the last sample  [{low}, {high}]")
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw what is proved and what is attained; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.responses import plot_step_band

        return plot_step_band(self, ax)


def step_band(
    result: FeasibleSet,
    length: int = 50,
    kind: Kind = "proved",
    output: int = 1,
    input: int = 1,
    samples: int = 100,
    seed: int = 0,
    tolerance: float = 0.1,
    time_limit: float = 20.0,
    all_time: bool = False,
) -> StepBand:
    """Enclose the response to a unit step at one input, from rest, without noise.

    Of a continuous-time structure it is the response of its recursion. With ``hold="linear"`` the
    input rises over the sampling interval before the first sample. The plant's own step response
    differs by the error of the recursion for this input, which ``delta`` does not bound.

    Parameters
    ----------
    result : FeasibleSet
    length : int
        Number of samples, at most 100 000.
    kind : {"proved", "sampled"}
        Proved bands are available where outputs are fed back linearly, each to itself.
    output, input : int
        Channels, from 1.
    samples, seed : int
        Mixtures of attained members, for sampled bands.
    tolerance : float
        Share of the attained width by which a proved band may reach beyond it on each side.
    time_limit : float
        Seconds in which that is tried, or mixtures are. If infinite, until cells are forecast to
        become too many.
    all_time : bool
        Whether to prove a range of the response after the last sample too; possible where every
        member is stable.

    Returns
    -------
    StepBand

    Raises
    ------
    SetidError
        If the feasible set is empty, or nothing can be proved of this structure.

    Notes
    -----
    The response is that of the plant: an offset of a linear structure is left out.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.step_band(result, 3, all_time=True)
    >>> bool(((band.low <= band.nominal) & (band.nominal <= band.high)).all())
    True
    >>> [round(x, 2) for x in band.later]  # from the fourth sample on, for ever
    [2.85, 4.15]
    """
    check_result(result)
    data, model = result.formulation.data, result.formulation.model
    count = natural(length, "length", SetidError, least=1)
    if count > _MOST:
        raise SetidError(f"length: found {count}, expected at most {_MOST}")
    channel_pair(output, input, model.outputs, model.inputs)
    accuracy = Accuracy(tolerance, time_limit)
    draws_of(samples, seed)
    later_on = switch(all_time, "all_time", SetidError)
    column, theta = output - 1, _plant(model, nominal(result))
    u = np.zeros((count, model.inputs))
    u[:, input - 1] = 1.0
    centre = simulate(model, theta, u)[:, column]
    later, report = (-np.inf, np.inf), None
    if word(kind, "kind", ("proved", "sampled"), SetidError) == "proved":
        low, high, attained, later, report = _proved_step(
            result, (count, column, input - 1), theta, accuracy, later_on
        )
    else:
        thetas = np.vstack([theta, _plant(model, members(result, samples, seed, time_limit))])
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.array([simulate(model, t, u)[:, column] for t in thetas])
        low, high = attained = found.min(axis=0), found.max(axis=0)
    time = np.arange(count) * data.Ts
    columns = (frozen(x) for x in (time, centre, low, high, *attained))
    t, middle, a, b, c, d = columns
    data = result.formulation.data
    labels = data.output_labels[output - 1], data.input_labels[input - 1]
    said = labels, data.time_unit, _recursion(model)
    return StepBand(kind, output, input, t, middle, a, b, c, d, later, report, *said)


def _recursion(model: Structure) -> str:
    """Say which recursion responds in place of a continuous-time plant."""
    if not isinstance(model, ContinuousTransferFunction) or model.method == "indirect":
        return ""
    rising = "which rises over the interval before the first sample"
    step = "held at each sample" if model.hold == "constant" else rising
    return f"response of the recursion to a step {step}"


def _plant(model: Structure, thetas: Reals) -> Reals:
    """Set the offsets of a linear structure to 0 in parameters (..., p)."""
    constants: set[str] = set()
    if isinstance(model, TransferFunction):
        constants = set(model.offsets())
    elif _is_linear(model):
        terms = [term for equation in regression_of(model) for term in equation.terms]
        constants = {name for term in terms if not term.signals for name in term.parameters}
    return np.where([name in constants for name in model.parameters], 0.0, thetas)


def _is_linear(model: Structure) -> bool:
    """Check that nothing but single inputs and constants drives the outputs.

    A constant in a static map is a part of the map, whatever the normalisation is.
    """
    if isinstance(model, BlockStructured) and model.maps:
        return False
    try:
        affine = affine_rows(model)
    except ModelError:
        return False
    terms = [term for row in affine.rows for term in row.others]
    fixed = any(not term.inputs and term.column is None for term in terms)  # part of a map
    inputs = max((len(term.inputs) for term in terms), default=0)
    return not affine.coordinates.sums and not fixed and inputs <= 1


def _row_of_pair(model: Structure, output: int, input: int) -> tuple[Coordinates, OutputRow]:
    """State the row of one output where one input acts, and its coordinates."""
    if isinstance(model, TransferFunction):  # with denominators of its own, that of the pair
        names = model.parameters
        row = transfer_row(coefficients_of(model, output + 1, input + 1), input, names)
        return Coordinates(names, ()), row
    affine = affine_rows(model)
    row = affine.rows[output]
    return affine.coordinates, row.without_constant() if _is_linear(model) else row


def _proved_step(
    result: FeasibleSet,
    place: tuple[int, int, int],
    theta: Reals,
    accuracy: Accuracy,
    all_time: bool,
) -> tuple[Reals, Reals, tuple[Reals, Reals], tuple[float, float], BandReport]:
    """Return the proved and the attained band, the range after them, and the report."""
    length, output, input = place
    model = result.formulation.model
    try:
        coordinates, row = _row_of_pair(model, output, input)
    except ModelError as error:
        raise ModelError(f"{error}; kind='sampled' has the range of known members") from None
    most = max([row.lag, *(term.lag for term in row.others)])
    settle, count = None, max(length, most + 1)
    if all_time:
        settle = _settling(row, coordinates.values(theta))
        count = max(length, 2 * settle + 1) + 2 * (settle + most) + most + 2
    u, none = np.zeros((count, model.inputs)), np.zeros(0)
    u[:, input] = 1.0
    experiment = Experiment(row, u, none, none, np.zeros_like(u), np.zeros(count))
    band = band_of(result, coordinates, experiment, accuracy, settle)
    ranges, part = band.ranges, slice(0, length)
    ends = (-np.inf, np.inf)
    if all_time and np.all(np.isfinite(ranges.later)):
        ends = float(ranges.later[0]), float(ranges.later[1])
        rest = ranges.low[length:], ranges.high[length:]
        ends = min(ends[0], float(rest[0].min())), max(ends[1], float(rest[1].max()))
    attained = band.low[part], band.high[part]
    return ranges.low[part], ranges.high[part], attained, ends, band.report


def _settling(row: OutputRow, theta: Reals) -> int:
    """Count the samples after which the nominal impulse response of 1 / D is small."""
    radius = pole_radius(row, theta)
    if radius < 1e-9:
        return row.lag + 1
    if radius >= 1.0:
        return 1  # nothing will be proved
    count = np.ceil(np.log(_SETTLED) / np.log(radius)) + row.lag + 1
    if count > _HOPELESS * _LONGEST:
        return 1  # as above: too much of it would be cut off
    return int(min(count, _LONGEST))
