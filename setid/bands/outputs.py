"""Validation: outputs of identified models, their fit, and bands that hold for every model.

A *proved* band contains the output of every consistent parameter vector; if a reading of a
validation record lies outside the proved band of readings, structure, noise bounds or
priors are falsified. *Sampled* bands are what members of the set reach.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from setid.bands.enclosing import Accuracy, record_bands
from setid.bands.verdicts import BandReport, Kind
from setid.data.checks import FrozenMapping, frozen, seconds_of, word
from setid.data.noise import Noise, NoiseBounds
from setid.data.record import IOData
from setid.errors import DataError, EmptySetError, ModelError, NoiseError, SetidError
from setid.feasible_points.best import best
from setid.feasible_points.estimators import least_squares
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_points.modelled_outputs import fit, per_cent, predicted, simulated, started
from setid.feasible_set.coordinates import coordinates_of
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.proposer import Proposer
from setid.formulation.formulation import formulate
from setid.formulation.regression import Regression, check_channels
from setid.minimum_noise.conflicting_samples import samples_listed
from setid.proofs.predictions import predicted_ranges
from setid.proofs.supports import HalfSpaces
from setid.simulation.responses import run
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Comparison", "OutputBand", "compare", "fit", "predict", "simulate_band"]

Reals = NDArray[np.float64]
Mode = Literal["simulation", "prediction"]


@dataclass(frozen=True, slots=True, eq=False)
class OutputBand(ReadOnly):
    """Outputs over a record for the feasible parameter set.

    Parameters
    ----------
    kind : {"proved", "sampled"}
    mode : {"simulation", "prediction"}
        Inputs alone (and the first outputs, to start from), or one step ahead from the
        readings.
    data : IOData
    nominal : (N, ny) float
        NaN where there is no row to predict from.
    low, high : (N, ny) float
        Range of the models' outputs.
    reading_low, reading_high : (N, ny) float
        Where readings lie if the assumptions hold: noise and equation error included.
    attained_low, attained_high : (N, ny) float or None
        What members reach, up to rounding, beside a proved simulation; NaN where none is known.
    reports : tuple of BandReport
        Of a proved simulation, one an output.
    late : int
        Number of ends of predictions for which the time was over: those over the outer box.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.predict(result)
    >>> band.mode, band.low[1:].ravel().round(2)
    ('prediction', array([-6.33,  0.67,  2.32]))
    """

    kind: Kind
    mode: Mode
    data: IOData
    nominal: Reals
    low: Reals
    high: Reals
    reading_low: Reals
    reading_high: Reals
    attained_low: Reals | None = None
    attained_high: Reals | None = None
    reports: tuple[BandReport, ...] = ()
    late: int = 0

    @property
    def silent(self) -> NDArray[np.bool_]:
        """Samples at which the band says nothing, shape (N, ny).

        There it is infinite, or holds every reading that the record has of that output: none of
        them would lie outside.
        """
        with np.errstate(invalid="ignore"):
            least = np.nanmin(self.data.y, axis=0, initial=np.inf)
            most = np.nanmax(self.data.y, axis=0, initial=-np.inf)
            holds_all = (self.reading_low <= least) & (self.reading_high >= most)
        unknown = np.isinf(self.reading_low) | np.isinf(self.reading_high)
        return np.asarray(holds_all | unknown, np.bool_)

    @property
    def tested(self) -> NDArray[np.bool_]:
        """Readings that the band is about, shape (N, ny): neither missing nor of the first samples.

        Predictions begin where the readings that they need are known.
        """
        return ~np.isnan(self.data.y) & ~np.isnan(self.reading_low)

    @property
    def outside(self) -> NDArray[np.int64]:
        """Sample and output (both from 0) of readings outside the band, shape (K, 2).

        One of them, outside a proved band, falsifies the assumptions for this record and the
        one identified from together: no parameter vector explains both. Each of the two may be
        explained by vectors of its own.
        """
        with np.errstate(invalid="ignore"):
            gone = (self.data.y < self.reading_low) | (self.data.y > self.reading_high)
        return np.argwhere(gone)

    def __repr__(self) -> str:
        return f"<OutputBand: {self.mode}, {self._says}>"

    @property
    def _says(self) -> str:
        """At how many samples the band says something."""
        silent, known = self.silent | np.isnan(self.low), ~np.isnan(self.data.y)
        said, count = int(np.sum(known & ~silent)), int(np.sum(known))
        return f"{self.kind} band, which says something of {said} of {count} readings"

    def plot(self, ax: Any = None) -> NDArray[Any]:
        """Draw the readings and the band, one axis an output; returns the axes.

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One an output.
        """
        from setid.plots.outputs import plot_output_band

        return plot_output_band(self, ax)


@dataclass(frozen=True, slots=True, eq=False)
class Comparison(ReadOnly):
    """Fit of the nominal model to a record, with the band of all consistent models.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
        The nominal model: the member that is best for the mode on the identification record,
        where one is known.
    fit : (ny,) float
        100 (1 - |y - yhat| / |y - mean y|), in per cent; 100 is perfect.
    band : OutputBand
    fits : mapping of str to (ny,) float
        The same of ``"best member"``, ``"centre"`` and ``"least squares"``, as far as they
        exist, that of the nominal model first; least squares is that of the identification record,
        whatever the noise bounds.
    advice : str
        For what an equation-error set is meant, where it is simulated; else empty.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> setid.compare(result).theta.round(3)
    array([-0.49 ,  2.011])
    """

    names: tuple[str, ...]
    theta: Reals
    fit: Reals
    band: OutputBand
    fits: Mapping[str, Reals] = field(default_factory=dict)
    advice: str = ""

    def summary(self) -> str:
        """Describe the comparison in a few lines."""
        band = self.band
        own, *others = self.fits or [""]  # the first one is that of the nominal model
        named = f", the {own}" if own else ""
        lines = [f"fit of the nominal model{named} ({band.mode})  {per_cent(self.fit)}"]
        lines += [f"fit of {name}  {per_cent(self.fits[name])}" for name in others]
        lines.append(self._widths())
        many = len(band.reports) > 1
        for place, report in enumerate(band.reports, 1):
            lines.append(f"y{place}: {report.text}" if many else report.text)
        if band.late:
            lines.append(
                f"time was over for {band.late} ends of predictions, which are those over the "
                "outer box; a larger time_limit narrows them"
            )
        lines += self._silence()
        outside, count = len(band.outside), int(np.sum(band.tested))
        lines.append(f"readings outside the {band.kind} band of readings  {outside} of {count}")
        if outside and band.kind == "proved":
            row, output = band.outside[0].tolist()
            key = int(band.data.record[row]) + 1, row - int(band.data.first[row])
            sample = samples_listed((key,), band.data.records)
            lines.append(
                "the assumptions are falsified for this record together with the one identified "
                f"from, first by {band.data.output_names[output]} at sample {sample}: no parameter "
                "vector explains both within the noise bounds; larger bounds, a higher order or "
                "another structure is needed"
            )
        lines += [self.advice] if self.advice else []
        return "\n".join(lines)

    def _widths(self) -> str:
        """A line for the mean width of each output, over samples at which the band is a test."""
        band, found = self.band, list[str]()
        if not np.any(np.isfinite(band.high - band.low)):
            return f"the {band.kind} band of models is infinite: nothing is proved"
        if not np.any(np.isfinite(band.high - band.low) & ~band.silent):
            return f"the {band.kind} band of models is no test of any reading"
        names, units = band.data.output_names, band.data.output_units
        for place, (low, high) in enumerate(zip(band.low.T, band.high.T, strict=True)):
            said = np.isfinite(high - low) & ~band.silent[:, place]
            shown = f"{np.mean((high - low)[said]):.4g}" if np.any(said) else "says nothing"
            unit = f" {units[place]}" if np.any(said) and units[place] else ""
            found.append((f"{names[place]}: " if len(names) > 1 else "") + shown + unit)
        where = " where it says something" if np.any(band.silent) else ""
        return f"mean width of the {band.kind} band of models{where}  {', '.join(found)}"

    def _silence(self) -> list[str]:
        """A line for samples at which the band is no test."""
        band = self.band
        silent, count = int(np.sum(band.silent & band.tested)), int(np.sum(band.tested))
        if not silent:
            return []
        return [
            f"the band says nothing at {silent} of {count} samples: it is infinite there, or every "
            "reading of the record would lie in it"
        ]

    def __repr__(self) -> str:
        text = f"{self.band.mode}, fit {per_cent(self.fit)}, {len(self.band.outside)} readings"
        return f"<Comparison: {text} outside the {self.band._says}>"

    def plot(self, ax: Any = None) -> NDArray[Any]:
        """Draw the band with the fit in the title; returns the axes.

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One an output.
        """
        from setid.plots.outputs import plot_comparison

        return plot_comparison(self, ax)


def simulate_band(
    result: FeasibleSet,
    data: IOData | None = None,
    kind: Kind | None = None,
    noise: Noise | None = None,
    samples: int = 30,
    seed: int = 0,
    tolerance: float = 0.1,
    time_limit: float = 20.0,
) -> OutputBand:
    """Simulate all models for the inputs of a record, with bands of their outputs.

    Parameters
    ----------
    result : FeasibleSet
    data : IOData, optional
        The identification record when left out. Structures that start ``"free"`` take the
        first readings of each record as start values, within their noise.
    kind : {"proved", "sampled"}, optional
        When left out, proved where outputs are fed back linearly, each to itself, and all
        intervals are finite, otherwise sampled.
    noise : Noise, optional
        Of this record; that of the identification when left out.
    samples, seed : int
        Mixtures of attained members, for sampled bands.
    tolerance : float
        Share of the attained width by which a proved band of models may reach beyond it on each
        side.
    time_limit : float
        Seconds in which that is tried. If infinite, until cells are forecast to become too many.

    Returns
    -------
    OutputBand

    Raises
    ------
    SetidError
        If the feasible set is empty, data do not fit the structure, or a setting is none.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> band = setid.simulate_band(result)
    >>> band.kind, bool((band.low <= band.high).all())
    ('proved', True)
    """
    check_result(result)
    if kind is not None:
        word(kind, "kind", ("proved", "sampled"), SetidError)
    accuracy = Accuracy(tolerance, time_limit, samples)
    draws_of(samples, seed)
    record, _, bounds = _record(result, data, noise)
    model, theta, eta = result.formulation.model, nominal(result), bounds.output
    if kind != "sampled":
        try:
            bands = record_bands(result, record, bounds, model.initial == "zero", accuracy)
        except SetidError as error:
            if kind == "proved" or isinstance(error, EmptySetError):
                raise
        else:
            ranges = [np.stack(x, axis=1) for x in zip(*[b.ranges[:4] for b in bands], strict=True)]
            attained = [
                np.stack(x, axis=1) for x in zip(*[(b.low, b.high) for b in bands], strict=True)
            ]
            columns = [run(model, theta, record), *ranges]
            band = _band("proved", "simulation", record, columns, eta)
            low, high = (frozen(x) for x in attained)
            reports = tuple(b.report for b in bands)
            return replace(band, attained_low=low, attained_high=high, reports=reports)
    thetas = np.vstack([theta, members(result, samples, seed)])
    with np.errstate(over="ignore", invalid="ignore"):
        outputs = np.array([run(model, t, record) for t in thetas])
    low, high = outputs.min(axis=0), outputs.max(axis=0)
    return _band("sampled", "simulation", record, [outputs[0], low, high, low, high], eta)


def predict(
    result: FeasibleSet,
    data: IOData | None = None,
    noise: Noise | None = None,
    *,
    time_limit: float = 20.0,
) -> OutputBand:
    """Predict one step from the readings before, with a proved band.

    Parameters
    ----------
    result : FeasibleSet
        Of a structure whose outputs obey equations in readings and parameters: products of
        parameters are allowed (separate denominators, static maps), internal signals are not.
    data : IOData, optional
        The identification record when left out.
    noise : Noise, optional
        Of this record; that of the identification when left out.
    time_limit : float
        Seconds for linear programs. Ranges that there is no time for are those over the outer
        box, which are valid and wider.

    Returns
    -------
    OutputBand
        NaN at samples that no equation predicts, such as the first ones of a record. An equation
        may hold a missing sample that has a range (``y_range``); ``low`` and ``high`` are then
        bounds of the reading, as ``reading_low`` and ``reading_high``.

    Raises
    ------
    SetidError
        If the structure has no such equations, or the limit is no number of at least 0.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> len(setid.predict(result).outside)
    0
    """
    check_result(result)
    until = time.monotonic() + seconds_of(time_limit)
    record, loud, _ = _record(result, data, noise)
    model = result.formulation.model
    coordinates = coordinates_of(model, "no one-step prediction; simulate instead")
    if any(equation.implicit for equation in coordinates.equations):
        raise SetidError(
            "model: rows of a continuous-time structure hold the sample itself beside its "
            "parameters and predict nothing one step ahead; simulate instead"
        )
    rows, cover = coordinates.rows(formulate(record, model, loud)), coordinates.cover(result)
    if cover.names != coordinates.names:
        raise SetidError(
            "result: found an infinite interval, expected finite ones where predictions have "
            "products of parameters; give priors such as Box or Stable"
        )
    theta = coordinates.values(nominal(result))
    found = np.full((5, *record.y.shape), np.nan)
    sources = list[Proposer]()

    def timed(spaces: HalfSpaces) -> Proposer:
        sources.append(Proposer(spaces, until=until))
        return sources[-1]

    def put(rows: Regression, kinds: slice) -> None:
        place = rows.row, rows.output - 1
        known = rows.target - record.y[place]  # what a row holds beside the reading itself
        ranges = predicted_ranges(cover, rows, record.y[place], timed)
        values = [-(rows.regressors @ theta) - known, *ranges]
        for target, column in zip(found[kinds], values[kinds], strict=True):
            target[place] = column

    put(rows, slice(None))
    with suppress(DataError):  # of no sample all that it takes is known
        exact = coordinates.rows_of_readings(record, model)
        same = np.array_equal(exact.target, rows.target)
        if not (same and np.array_equal(exact.regressors, rows.regressors)):
            # missing samples have ranges in the others, and noise moves the middle of powers
            found[1:3] = found[3:5]
            put(exact, slice(0, 3))
    middle, a, b, c, d = (frozen(x) for x in found)
    late = sum(source.late for source in sources)
    return OutputBand("proved", "prediction", record, middle, a, b, c, d, late=late)


def compare(
    result: FeasibleSet,
    validation: IOData | None = None,
    mode: Mode = "simulation",
    kind: Kind | None = None,
    noise: Noise | None = None,
    time_limit: float = 20.0,
) -> Comparison:
    """Compare the nominal model and the band of all models with a record.

    The nominal model is the consistent vector that fits the identification record best in this
    mode, where one is known. A reading outside a proved band shows that no parameter vector
    explains both records within the noise bounds.

    Parameters
    ----------
    result : FeasibleSet
    validation : IOData, optional
        The identification record when left out.
    mode : {"simulation", "prediction"}
        Outputs from the inputs alone, the default, or one step ahead from the readings before.
    kind : {"proved", "sampled"}, optional
        As in :func:`simulate_band`; bands of predictions are always proved.
    noise : Noise, optional
        Of the validation record; that of the identification when left out. Bounds that are given
        one a sample then need as many samples in both records.
    time_limit : float
        Seconds, three quarters of them for a proved band of simulations, the rest for the best
        member.

    Returns
    -------
    Comparison
        Samples from which the simulation starts do not count for the fit.

    Raises
    ------
    SetidError
        If the set is empty, or mode, kind or limit are none of these.
    DataError
        If the channels of the record are not those of the model.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = setid.compare(result)
    >>> found.fit.round(1), len(found.band.outside)
    (array([92.2]), 0)
    """
    begin, limit = time.monotonic(), seconds_of(time_limit)
    check_result(result)
    if kind is not None:
        word(kind, "kind", ("proved", "sampled"), SetidError)
    if word(mode, "mode", ("simulation", "prediction"), SetidError) == "simulation":
        band = simulate_band(result, validation, kind, noise, time_limit=_BAND * limit)
    else:
        band = predict(result, validation, noise, time_limit=_BAND * limit)
    left = max(begin + limit - time.monotonic(), (1.0 - _BAND) * limit)
    candidates = _candidates(result, mode, left)
    model, outputs_of = result.formulation.model, simulated if mode == "simulation" else predicted
    outputs = {name: outputs_of(model, t, band.data) for name, t in candidates.items()}
    fits = {name: frozen(fit(band.data.y, values)) for name, values in outputs.items()}
    chosen = next(iter(candidates))
    if chosen == "best member":
        begun = started(model, band.data)[:, None] & (mode == "simulation")
        band = replace(band, nominal=frozen(np.where(begun, band.nominal, outputs[chosen])))
    return Comparison(
        names=result.formulation.parameters,
        theta=frozen(candidates[chosen].copy()),
        fit=fits[chosen],
        band=band,
        fits=FrozenMapping(fits),
        advice="\n".join(_advice(result, mode, band, validation is not None)),
    )


def _advice(result: FeasibleSet, mode: Mode, band: OutputBand, other: bool) -> list[str]:
    """Say what a structure or its noise bounds are not meant for, where that may matter."""
    found = []
    if other and len(band.outside) and result.formulation.model.initial == "zero":
        found.append(_AT_REST)
    if mode == "simulation" and _equation_errors_alone(result):
        found.append(_ONE_STEP)
    return found


_BAND = 0.75  # share of a time limit for the band beside a nominal model
_AT_REST = (
    "that rests on signals that are zero before this record (initial='zero'): where they are not, "
    "as in a part of a record, identify with initial='free'"
)
_ONE_STEP = (
    "the noise bounds are those of equation errors: they limit one-step errors, so that the set is "
    "meant for prediction; for simulation take result.best('simulation'), or bounds of the "
    "sensors (output=, input=)"
)


def _candidates(result: FeasibleSet, mode: Mode, time_limit: float) -> dict[str, Reals]:
    """Parameter vectors whose fits are compared, the nominal one first."""
    found: dict[str, Reals] = {}
    try:
        found["best member"] = best(result, mode, time_limit).theta
    except SetidError:  # no member is known, or readings to start from are missing
        pass
    found["centre"] = nominal(result) if result.middle is None else result.middle
    try:
        found["least squares"] = least_squares(
            result.formulation.data, result.formulation.model
        ).theta
    except (ModelError, DataError):
        pass
    return found


def _equation_errors_alone(result: FeasibleSet) -> bool:
    """Tell whether noise acts within the equations and on no sensor."""
    eta, xi, e = result.formulation.noise.bounds(result.formulation.data)
    return bool(np.any(e > 0) and not np.any(eta > 0) and not np.any(xi > 0))


def _record(
    result: FeasibleSet, data: IOData | None, noise: Noise | None
) -> tuple[IOData, Noise, NoiseBounds]:
    """The record, its noise, and the bounds of that."""
    formulation = result.formulation
    record = formulation.data if data is None else data
    check_channels(record, formulation.model)
    if record.Ts != formulation.data.Ts:
        raise DataError(
            f"data: found Ts = {record.Ts:g}, expected {formulation.data.Ts:g} as identified"
        )
    if noise is not None and not isinstance(noise, Noise):
        raise NoiseError(f"noise: found {type(noise).__name__}, expected Noise")
    noise = (noise or formulation.noise).covering(formulation.noise.model_error)
    return record, noise, noise.bounds(record)


def _band(kind: Kind, mode: Mode, record: IOData, columns: list[Reals], eta: Reals) -> OutputBand:
    middle, low, high, driven_low, driven_high = (frozen(x) for x in columns)
    least = frozen(np.nextafter(driven_low - eta, -np.inf))
    most = frozen(np.nextafter(driven_high + eta, np.inf))
    return OutputBand(kind, mode, record, middle, low, high, least, most)
