"""Proved bands of outputs over the feasible set, output by output and record by record."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.bands.branching import (
    FIRST_SECONDS,
    Branching,
    Effort,
    branched,
)
from setid.bands.model_outputs import attained_by, force_of, pole_radius, slopes_of
from setid.bands.verdicts import FLOOR, BandReport, Verdict, ratio_of
from setid.data.checks import number, seconds_of
from setid.data.noise import NoiseBounds
from setid.data.record import IOData
from setid.errors import EmptySetError, SetidError
from setid.feasible_points.members import members
from setid.feasible_set.coordinates import Coordinates, coordinates_of
from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.narrowing import Narrowing, narrowing_of
from setid.models.equations import Structure
from setid.proofs.supports import Cover
from setid.proofs.time_bands.enclosures import Experiment
from setid.proofs.time_bands.partition import Ranges
from setid.proofs.time_bands.rows import OutputRow, output_row
from setid.simulation.responses import known_from

__all__ = ["Accuracy", "Band", "AffineRows", "band_of", "record_bands", "affine_rows"]

Reals = NDArray[np.float64]
_USELESS = 1e3  # times the attained width: what grows beyond it counts as infinite
_DRAWING = 0.2  # of the time, for members that are simulated
_BRIEF = 0.1  # of the time, for a band from which the next question follows
_BRIEF_CELLS = 500  # the same where no time is given


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
        seconds_of(self.time_limit)


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

    def narrowed(self, other: Band) -> Band:
        """Take another band of the same output, and what is proved here too."""
        ranges = other.ranges.met(self.ranges)
        ratio = ratio_of((ranges.low, ranges.high), (other.low, other.high))
        return replace(other, ranges=ranges, report=replace(other.report, ratio=ratio))

    def excess(self, tolerance: float) -> Reals:
        """Find by how much it is wider than attained ones may be, in attained widths; (N,)."""
        width, reached = self.ranges.high - self.ranges.low, self.high - self.low
        scale = np.maximum(reached, FLOOR * np.max(reached, initial=0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            found = (width - reached) / scale - 2 * tolerance
        return np.where(np.isnan(found), 0.0, found)


@dataclass(frozen=True, slots=True)
class AffineRows:
    """Rows of all outputs, and the coordinates in which these are affine.

    Parameters
    ----------
    coordinates : Coordinates
    rows : tuple of OutputRow
        One an output.
    """

    coordinates: Coordinates
    rows: tuple[OutputRow, ...]


def affine_rows(model: Structure) -> AffineRows:
    """Write the equations of all outputs as lags, in coordinates in which they are affine.

    Parameters
    ----------
    model : Structure

    Raises
    ------
    ModelError
        If the structure feeds back products of outputs, couples outputs or has internal signals.
    """
    found = coordinates_of(model)
    return AffineRows(found, tuple(output_row(e, found.names) for e in found.equations))


def record_bands(
    result: FeasibleSet, record: IOData, bounds: NoiseBounds, from_rest: bool, accuracy: Accuracy
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
    EmptySetError
        If the set is proved empty on the way.
    """
    model = result.formulation.model
    affine = affine_rows(model)
    first = 0 if from_rest else max(e.lag for e in affine.coordinates.equations)
    if np.any(np.isnan(record.u)):
        raise SetidError("data: found missing inputs, expected complete ones to simulate with")
    edges = [*record.starts.tolist(), record.samples]
    tasks = []
    for i, row in enumerate(affine.rows):
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            part, begun = slice(begin, end), slice(begin, min(begin + first, end))
            readings = record.y[begun, i]
            if np.any(np.isnan(readings)):
                row = begin + known_from(record.y[part], first) - first
                raise SetidError(
                    f"data: found missing outputs at row {begin}, where a proved band starts, "
                    f"expected readings; give the rows from {row} on as a record of their own"
                )
            start, errors = bounds.output[begun, i], bounds.equation[part, i]
            inputs = bounds.input[part]
            tasks.append(Experiment(row, record.u[part], readings, start, inputs, errors))
    bands = _all_bands(result, affine.coordinates, tasks, accuracy)
    pieces = len(edges) - 1
    return [_joined(bands[i * pieces : (i + 1) * pieces]) for i in range(len(affine.rows))]


def band_of(
    result: FeasibleSet,
    coordinates: Coordinates,
    experiment: Experiment,
    accuracy: Accuracy,
    settle: int | None = None,
) -> Band:
    """Bound one output for one record; ``settle`` as of :func:`branched`."""
    return _all_bands(result, coordinates, [experiment], accuracy, settle)[0]


def _all_bands(
    result: FeasibleSet,
    coordinates: Coordinates,
    tasks: list[Experiment],
    accuracy: Accuracy,
    settle: int | None = None,
) -> list[Band]:
    begin, cover = time.monotonic(), coordinates.cover(result)
    if not np.all(np.isfinite(cover.lower) & np.isfinite(cover.upper)):
        raise SetidError(
            "result: found an infinite interval, expected finite ones for proved bands; "
            "give priors such as Box or Stable"
        )
    efforts = _efforts(len(tasks), begin, accuracy)
    if cover.exact:
        known = coordinates.values(result.attained)
        return [
            _one(task, cover, known, effort, settle)
            for task, effort in zip(tasks, efforts, strict=False)
        ]
    asked, drawn = narrowing_of(result, coordinates), _members(result, accuracy)
    return [
        _narrowed(task, asked, drawn, effort, settle)
        for task, effort in zip(tasks, efforts, strict=False)
    ]


def _efforts(count: int, begin: float, accuracy: Accuracy) -> Iterator[Effort]:
    """Yield the effort of each of so many tasks; what one leaves is shared by the others."""
    until = begin + accuracy.time_limit
    more = max(accuracy.time_limit, FIRST_SECONDS) / max(count, 1)
    for left in range(count, 0, -1):
        now = time.monotonic()
        share = now + max(until - now, 0.0) / left
        yield Effort(accuracy.tolerance, share, first=share + more)


def _narrowed(
    task: Experiment, asked: Narrowing, drawn: Reals, effort: Effort, settle: int | None
) -> Band:
    """Bound one record on a cover that is narrowed where the band is widest."""

    def band_until(until: float, cells: int = effort.cells) -> Band:
        known = asked.coordinates.values(np.concatenate([drawn, asked.points]))
        return _one(task, asked.cover, known, replace(effort, until=until, cells=cells), settle)

    begin = time.monotonic()
    timed, brief, cells = effort.until < inf, inf, min(effort.cells, _BRIEF_CELLS)
    if timed:
        brief, cells = _BRIEF * (effort.until - begin), effort.cells
    until = effort.until - brief if timed else inf  # the cover has to be narrowed too
    band = band_until(begin + brief, cells)
    if task.samples > 0 and len(drawn):
        slopes = slopes_of(task, asked.cover, asked.coordinates.values(drawn.mean(axis=0)))
        while asked.narrow(slopes, band.excess(effort.tolerance), until):
            band = band.narrowed(band_until(time.monotonic() + brief, cells))
    if band.report.verdict != "tight":
        band = band.narrowed(band_until(effort.until))
    report = replace(band.report, seconds=time.monotonic() - begin)
    return replace(band, report=report)


def _members(result: FeasibleSet, accuracy: Accuracy) -> Reals:
    """Draw the members that are simulated; none where none is known."""
    try:
        return members(result, accuracy.samples, time_limit=_DRAWING * accuracy.time_limit)
    except SetidError:  # no member is known; what is proved holds all the same
        return np.zeros((0, len(result.formulation.parameters)))


def _one(task: Experiment, cover: Cover, known: Reals, effort: Effort, settle: int | None) -> Band:
    """Bound one record on a cover; points of an exact cover are members."""
    begin = time.monotonic()
    if task.samples <= 0:  # a record that is over before any equation is complete
        return _begun(task)
    found = branched(task, cover, effort, known if cover.exact else None, settle)
    if found.ranges is None:
        raise EmptySetError(
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
    report = BandReport(verdict, *sizes, ratio, radius, seconds, found.spent)
    return Band(found.ranges, low, high, report)


def _verdict(found: Branching, tolerance: float, measured: tuple[float, float]) -> Verdict:
    """Choose the verdict by the pole radius of members and the ratio of widths."""
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
    """Find the largest absolute value of a pole over points; NaN without any."""
    radii = [pole_radius(task.row, theta) for theta in points]
    return max(radii, default=float("nan"))


def _begun(task: Experiment) -> Band:
    first = task.first
    ends = np.nextafter(first - task.start, -np.inf), np.nextafter(first + task.start, np.inf)
    ranges = Ranges(ends[0], ends[1], ends[0], ends[1], np.array([-np.inf, np.inf]))
    nan = float("nan")
    return Band(ranges, *ends, BandReport("tight", 0, 0, 0, nan, nan, 0.0))


def _joined(bands: list[Band]) -> Band:
    """Join the bands of one output over all records."""
    if len(bands) == 1:
        return bands[0]
    columns = zip(*[(*band.ranges[:4], band.low, band.high) for band in bands], strict=True)
    a, b, c, d, low, high = (np.concatenate(column) for column in columns)
    ranges = Ranges(a, b, c, d, np.array([-np.inf, np.inf]))
    report = BandReport.merged([band.report for band in bands])
    return Band(ranges, low, high, report)
