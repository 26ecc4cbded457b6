"""Rows in theta alone, summed through low-pass filters before the noise is bounded.

A row of an n-th difference holds little of a slow signal and all of the noise: row by row,
fast sampling bounds nothing. A sum of rows with weights l_0, l_1, ... is a row as well,
and in it most of the noise cancels: for l = the impulse response of 1 / (1 - alpha z)^n,
z = q^-1, it speaks of filtered signals, whose noise is no larger than before. Rows are
summed before the noise is replaced by its largest effect. Sums with any weights are rows that
hold, so the weights are doubles that are taken as exact; sums are rounded outwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.data.noise import NoiseBounds
from setid.data.record import IOData
from setid.formulation.regression import Regression
from setid.formulation.signals import Integers, Reals
from setid.models.checked_structures import regression_of
from setid.models.equations import Equation, Structure

__all__ = ["smoothed"]

_EPS = 2.0**-52
_LENGTHS = 4.0 ** np.arange(8)  # time constants of filters, in samples


def smoothed(
    rows: Regression | None,
    data: IOData,
    model: Structure,
    bounds: NoiseBounds,
) -> Regression | None:
    """Append sums of the rows through filters where equations ask for it.

    Parameters
    ----------
    rows : Regression or None
    data : IOData
    model : Structure
    bounds : NoiseBounds

    Returns
    -------
    Regression or None
        ``row`` of a sum is its newest row. The rows themselves where nothing is summed.
    """
    equations = [e for e in regression_of(model) if e.differences]
    if rows is None or not equations:
        return rows
    parts = [_own(rows, np.arange(rows.target.size))]
    for equation in equations:
        for run in _runs(rows, equation, data):
            for length in _LENGTHS[3.0 * _LENGTHS < run.size]:
                weights = _weights(float(length), equation.differences, run.size)
                kept = np.arange(0, run.size, max(1, int(length) // 2))
                terms = _terms(equation, model)
                start = int(data.first[rows.row[run[0]]])
                parts.append(_summed(rows, run, kept, weights, terms, bounds, start))
    columns = (frozen(np.concatenate(column)) for column in zip(*parts, strict=True))
    return Regression(rows.names, *columns)


def _own(rows: Regression, chosen: Integers) -> tuple[NDArray[Any], ...]:
    fields = ("target", "regressors", "radius", "radii", "row", "record", "sample", "output")
    return tuple(getattr(rows, field)[chosen] for field in fields)


def _runs(rows: Regression, equation: Equation, data: IOData) -> list[Integers]:
    """Places of consecutive rows of one equation whose samples are all measured."""
    assert equation.output is not None
    gaps = np.isnan(data.y[:, equation.output]) | np.isnan(data.u).any(axis=1)
    beside_gap = np.convolve(gaps, np.ones(equation.lag + 1))[: data.samples] > 0
    mine = (rows.output == equation.output + 1) & ~beside_gap[rows.row]
    places = np.flatnonzero(mine)
    breaks = np.flatnonzero((np.diff(rows.row[places]) != 1) | (np.diff(rows.record[places]) != 0))
    return [run for run in np.split(places, breaks + 1) if run.size]


def _weights(length: float, order: int, count: int) -> Reals:
    """Impulse response of 1 / (1 - exp(-1 / length) z)^order, scaled to a sum of about 1."""
    found = np.zeros(count)
    found[0] = 1.0
    decay = np.exp(-1.0 / length)
    for _ in range(order):
        for k in range(1, count):
            found[k] += decay * found[k - 1]
    return np.asarray(found / found.sum(), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Term:
    """All terms of one parameter (or none) and one signal: coefficients by lag."""

    column: int  # of theta; -1 for none
    signal: str
    coefficients: Reals


def _terms(equation: Equation, model: Structure) -> list[_Term]:
    found: dict[tuple[str, str], Reals] = {}
    for term in equation.terms:
        if not term.signals:
            continue  # an offset, which no noise moves
        key = (term.parameters or ("",))[0], term.signals[0].signal
        table = found.setdefault(key, np.zeros(equation.lag + 1))
        table[term.signals[0].lag] += term.coefficient
    place = {"": -1} | {name: column for column, name in enumerate(model.parameters)}
    return [_Term(place[name], signal, table) for (name, signal), table in found.items()]


def _summed(
    rows: Regression,
    run: Integers,
    kept: Integers,
    weights: Reals,
    terms: list[_Term],
    bounds: NoiseBounds,
    start: int,
) -> tuple[NDArray[Any], ...]:
    """Sums of the rows of a run up to each of those that are kept."""
    first, last = int(rows.row[run[0]]), int(rows.row[run[-1]])
    channel = int(rows.output[run[0]]) - 1
    grow = 1.0 + (run.size + 16) * _EPS
    target, slack = _running(weights, rows.target[run])
    regressors, radii = np.empty((run.size, len(rows.names))), np.empty((run.size, len(rows.names)))
    for column in range(len(rows.names)):
        regressors[:, column], radii[:, column] = _running(weights, rows.regressors[run, column])
    radius = (
        slack + np.convolve(weights, bounds.equation[first : last + 1, channel])[: run.size] * grow
    )
    for term in terms:
        every = bounds.output if term.signal[0] == "y" else bounds.input
        noise = every[start:, int(term.signal[1:]) - 1]
        width = _noise_width(weights, term.coefficients, noise, first - start, run.size)
        if term.column < 0:
            radius = radius + width
        else:
            radii[:, term.column] += width
    found = target, regressors, radius * grow, radii * grow, *_own(rows, run)[4:]
    return tuple(values[kept] for values in found)


def _running(weights: Reals, values: Reals) -> tuple[Reals, Reals]:
    """Weighted sums of all values so far, and bounds of their rounding errors."""
    count = values.size
    size = np.convolve(weights, np.abs(values))[:count]
    return np.convolve(weights, values)[:count], 2 * (count + 4) * _EPS * size


def _noise_width(
    weights: Reals, coefficients: Reals, noise: Reals, first: int, count: int
) -> Reals:
    """Largest effect of the noise of one signal in a record on each sum, (count,)."""
    response = np.convolve(weights, coefficients)[:count]
    doubt = np.convolve(weights, np.abs(coefficients))[:count]
    response = np.abs(response) + 4 * (coefficients.size + 2) * _EPS * doubt
    width = np.convolve(response, noise[first : first + count])[:count]
    for before in range(1, coefficients.size):  # samples older than the first row
        place = first - before
        if place >= 0 and noise[place]:
            late = np.convolve(weights, coefficients[before:])[:count]
            doubt = np.convolve(weights, np.abs(coefficients[before:]))[:count]
            width += noise[place] * (np.abs(late) + 4 * (coefficients.size + 2) * _EPS * doubt)
    return np.asarray(width, np.float64)
