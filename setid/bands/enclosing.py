"""Proved bands of outputs over the feasible set, output by output and record by record."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.bands.branching import Effort, Found, attained_by, branched, force_of
from setid.bands.verdicts import BandReport, Verdict, ratio_of
from setid.data.checks import number
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import members
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.principal import principal_cover
from setid.feasible_set.supports import cover_of
from setid.models.equations import Structure
from setid.models.general import nonlinear_rows
from setid.models.lti import TransferFunction
from setid.proofs.supports import Cover
from setid.proofs.time_bands.enclosures import Experiment
from setid.proofs.time_bands.partition import Ranges
from setid.proofs.time_bands.rows import OutputRow, output_row
from setid.simulation.responses import known_from

__all__ = ["Accuracy", "Band", "band_of", "record_bands", "rows_of"]

Reals = NDArray[np.float64]
Bounds = tuple[Reals, Reals, Reals]
_USELESS = 1e3  # times the attained width: what grows beyond it counts as infinite
_SHARE = 0.7  # of the time, for ranges along principal axes where the cover is not the set


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Wanted width of proved bands, and the time for it.

    Parameters
    ----------
    tolerance : float
        Share of the attained width by which a band may reach beyond it on each side.
    time_limit : float
        Seconds of wall time.
    samples : int
        Mixtures of attained members that are simulated where the cover is not the set itself.
    """

    tolerance: float
    time_limit: float
    samples: int = 30

    def __post_init__(self) -> None:
        if not number(self.tolerance, "tolerance", SetidError) > 0:
            raise SetidError(f"tolerance: found {self.tolerance!r}, expected a number > 0")
        if not number(self.time_limit, "time_limit", SetidError) >= 0:
            raise SetidError(f"time_limit: found {self.time_limit!r}, expected seconds >= 0")


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Proved ranges of one output, what members attain, and the report.

    Parameters
    ----------
    ranges : Ranges
    low, high : (N,) float
        Attained.
    report : BandReport
    """

    ranges: Ranges
    low: Reals
    high: Reals
    report: BandReport


def rows_of(model: Structure) -> list[OutputRow]:
    """Write the equations of all outputs as lags.

    Raises
    ------
    ModelError
        If the structure is not linear with one denominator an output.
    """
    equations = model.regression()
    if not equations:
        other = ", or a common denominator" if isinstance(model, TransferFunction) else ""
        raise ModelError(
            f"model: {nonlinear_rows(model)} have no proved bands; use kind='sampled'{other}"
        )
    return [output_row(equation, model) for equation in equations]


def record_bands(
    result: FeasibleSet, record: IOData, bounds: Bounds, from_rest: bool, accuracy: Accuracy
) -> list[Band]:
    """Bound all outputs for the inputs of one record or several.

    Parameters
    ----------
    result : FeasibleSet
    record : IOData
        Inputs are readings; without ``from_rest`` the first outputs are too.
    bounds : output noise, input noise, equation error
        As :meth:`Noise.bounds` gives them.
    from_rest : bool
        All signals are zero before the record.
    accuracy : Accuracy

    Returns
    -------
    list of Band
        One an output.

    Raises
    ------
    SetidError
        If the structure does not allow it or the cover is not finite.
    """
    model = result.formulation.model
    rows = rows_of(model)
    first = 0 if from_rest else max(e.lag for e in model.regression())
    if np.any(np.isnan(record.u)):
        raise SetidError("data: found missing inputs, expected complete ones to simulate with")
    edges = [*record.starts.tolist(), record.samples]
    tasks = []
    for i, row in enumerate(rows):
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            part, begun = slice(begin, end), slice(begin, min(begin + first, end))
            readings = record.y[begun, i]
            if np.any(np.isnan(readings)):
                row = begin + known_from(record.y[part], first) - first
                raise SetidError(
                    f"data: found missing outputs at row {begin}, where a proved band starts, "
                    f"expected readings; give the rows from {row} on as a record of their own"
                )
            start, errors = bounds[0][begun, i], bounds[2][part, i]
            tasks.append(Experiment(row, record.u[part], readings, start, bounds[1][part], errors))
    bands = _all_bands(result, tasks, accuracy)
    pieces = len(edges) - 1
    return [_joined(bands[i * pieces : (i + 1) * pieces]) for i in range(len(rows))]


def band_of(
    result: FeasibleSet, experiment: Experiment, accuracy: Accuracy, settle: int | None = None
) -> Band:
    """Bound one output for one record; ``settle`` as of :func:`branched`."""
    return _all_bands(result, [experiment], accuracy, settle)[0]


def _all_bands(
    result: FeasibleSet, tasks: list[Experiment], accuracy: Accuracy, settle: int | None = None
) -> list[Band]:
    begin, cover = time.monotonic(), cover_of(result)
    if not np.all(np.isfinite(cover.lower) & np.isfinite(cover.upper)):
        raise SetidError(
            "result: found an infinite interval, expected finite ones for proved bands; "
            "give priors such as Box or Stable"
        )
    known = result.attained
    if not cover.exact:
        cover, points = principal_cover(result, _SHARE * accuracy.time_limit)
        known = np.concatenate([_members(result, accuracy.samples), points])
    until = begin + accuracy.time_limit
    found = []
    for place, task in enumerate(tasks):
        now = time.monotonic()
        share = now + max(until - now, 0.0) / (len(tasks) - place)
        found.append(_one(task, cover, known, Effort(accuracy.tolerance, share), settle))
    return found


def _members(result: FeasibleSet, samples: int) -> Reals:
    try:
        return members(result, samples)
    except SetidError:  # no member is known; what is proved holds all the same
        return np.zeros((0, len(result.formulation.parameters)))


def _one(task: Experiment, cover: Cover, known: Reals, effort: Effort, settle: int | None) -> Band:
    """The band of one record; points of an exact cover are members."""
    begin = time.monotonic()
    if task.samples <= 0:  # a record that is over before any equation is complete
        return _begun(task)
    found = branched(task, cover, effort, known if cover.exact else None, settle)
    if found.ranges is None:
        raise SetidError(
            "result: every cell of the parameters is proved empty; see setid.consistency for the "
            "least noise bound that explains the data"
        )
    points = found.points if cover.exact else known
    low, high = (found.low, found.high) if cover.exact else _attained(task, cover, known)
    radius = _pole_radius(task, points)
    ratio = ratio_of((found.ranges.low, found.ranges.high), (low, high))
    verdict = _verdict(found, effort.tolerance, (radius, ratio))
    seconds = time.monotonic() - begin
    sizes = found.cells, found.left, found.growing
    return Band(found.ranges, low, high, BandReport(verdict, *sizes, ratio, radius, seconds))


def _verdict(found: Found, tolerance: float, measured: tuple[float, float]) -> Verdict:
    """The verdict, from the pole radius of members and the ratio of widths."""
    ranges, (radius, ratio) = found.ranges, measured
    assert ranges is not None
    useless = found.growing > 0 and ratio > _USELESS
    if useless or not np.all(np.isfinite([ranges.low, ranges.high])):
        return "unstable" if radius >= 1.0 else "unproved"
    return "tight" if found.excess <= tolerance else "wide"


def _attained(task: Experiment, cover: Cover, known: Reals) -> tuple[Reals, Reals]:
    force = force_of(task, cover)
    found = [attained_by(task, theta, force) for theta in known]
    if not found:
        none = np.full(len(task.u), np.nan)
        return none, none
    low, high = zip(*found, strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def _pole_radius(task: Experiment, points: Reals) -> float:
    """Largest absolute value of a pole over points; NaN without any."""
    radii = [0.0] * len(points)
    for place, theta in enumerate(points):
        lags = {lag: f.at(theta) for lag, f in task.row.feedback.items()}
        coefficients = [lags.get(lag, 0.0) for lag in range(task.row.lag + 1)]
        roots = np.roots(coefficients) if np.all(np.isfinite(coefficients)) else np.zeros(0)
        radii[place] = float(np.abs(roots).max(initial=0.0))
    return max(radii, default=float("nan"))


def _begun(task: Experiment) -> Band:
    first = task.first
    ends = np.nextafter(first - task.start, -np.inf), np.nextafter(first + task.start, np.inf)
    ranges = Ranges(ends[0], ends[1], ends[0], ends[1], np.array([-np.inf, np.inf]))
    nan = float("nan")
    return Band(ranges, *ends, BandReport("tight", 0, 0, 0, nan, nan, 0.0))


def _joined(bands: list[Band]) -> Band:
    """One output over all records."""
    if len(bands) == 1:
        return bands[0]
    columns = zip(*[(*band.ranges[:4], band.low, band.high) for band in bands], strict=True)
    a, b, c, d, low, high = (np.concatenate(column) for column in columns)
    ranges = Ranges(a, b, c, d, np.array([-np.inf, np.inf]))
    report = BandReport.merged([band.report for band in bands])
    return Band(ranges, low, high, report)
