"""Outputs of identified models for a record, in bands that hold for every consistent model.

A *proved* band contains the output of every consistent parameter vector; if a reading of a
validation record lies outside the proved band of readings, structure, noise bounds or
priors are falsified. *Sampled* bands are what members of the set reach.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from setid.bands.enclosing import Accuracy, record_bands
from setid.bands.verdicts import BandReport, Kind
from setid.data.checks import frozen, seconds_of, word
from setid.data.noise import Noise, NoiseBounds
from setid.data.record import IOData
from setid.errors import DataError, EmptySetError, NoiseError, SetidError
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_set.coordinates import coordinates_of
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.proposer import Proposer
from setid.formulation.formulation import formulate
from setid.formulation.regression import Regression, check_channels
from setid.proofs.predictions import predicted_ranges
from setid.proofs.supports import HalfSpaces
from setid.simulation.responses import run
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Mode", "OutputBand", "extent_of", "predict", "simulate_band"]

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
        return f"<OutputBand: {self.mode}, {extent_of(self)}>"

    def plot(self, ax: Any = None) -> NDArray[Any]:
        """Draw the readings and the band, one axis an output; returns the axes.

        Parameters
        ----------
        ax : array of matplotlib Axes, optional
            One an output.
        """
        from setid.plots.outputs import plot_output_band

        return plot_output_band(self, ax)


def extent_of(band: OutputBand) -> str:
    """Say of how many readings of its record a band says something.

    Parameters
    ----------
    band : OutputBand
    """
    silent, known = band.silent | np.isnan(band.low), ~np.isnan(band.data.y)
    said, count = int(np.sum(known & ~silent)), int(np.sum(known))
    return f"{band.kind} band, which says something of {said} of {count} readings"


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
        Seconds in which that is tried, or mixtures are. If infinite, until cells are forecast to
        become too many.

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
    thetas = np.vstack([theta, members(result, samples, seed, time_limit)])
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


def _record(
    result: FeasibleSet, data: IOData | None, noise: Noise | None
) -> tuple[IOData, Noise, NoiseBounds]:
    """Check a record and its noise; return both, and the bounds of the noise."""
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
