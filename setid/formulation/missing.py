"""Ranges of missing samples: those the user gives, or what the row of the sample implies.

The equation of a missing output y_k bounds it where every other sample in the row has a
range and every parameter in it is bounded by a prior. Such a range follows from the
formulation, so it is no assumption. Missing inputs need a range from the user.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite, nextafter

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.models.equations import Equation, Lagged, Structure, Term, channel_of

__all__ = ["missing_ranges"]

Interval = tuple[float, float]
Bounds = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def missing_ranges(
    data: IOData, model: Structure, bounds: Bounds, parameters: Mapping[str, Interval]
) -> dict[str, NDArray[np.float64]]:
    """Low and high ends for the missing samples of each measured signal.

    Parameters
    ----------
    data : IOData
    model : Structure
    bounds : tuple of arrays
        Noise bounds of outputs, inputs and equations.
    parameters : mapping of str to (low, high)
        What priors say of the parameters.

    Returns
    -------
    mapping of str to (N, 2) float
        Infinite ends where nothing is known, and for samples that are not missing.
    """
    found = {}
    groups = (("y", data.y, data.y_range), ("u", data.u, data.u_range))
    for letter, values, limits in groups:
        for channel in range(values.shape[1]):
            table = np.tile([-inf, inf], (data.samples, 1))
            if limits is not None:
                table[np.isnan(values[:, channel])] = limits[channel]
            found[f"{letter}{channel + 1}"] = table
    equations = {equation.defines: equation for equation in model.regression()}
    for sample, channel in np.argwhere(np.isnan(data.y)).tolist():
        equation = equations.get(f"y{channel + 1}")
        if equation is None or (
            model.initial == "free" and sample - equation.lag < data.first[sample]
        ):
            continue
        low, high = _implied(equation, sample, data, bounds, parameters, found)
        table = found[equation.defines]
        table[sample] = max(low, table[sample, 0]), min(high, table[sample, 1])
    return found


def _implied(
    equation: Equation,
    sample: int,
    data: IOData,
    bounds: Bounds,
    parameters: Mapping[str, Interval],
    ranges: Mapping[str, NDArray[np.float64]],
) -> Interval:
    """Range of the defined sample: minus the other terms, plus the equation error."""
    error = float(bounds[2][sample, equation.output])
    total = (-error, error)
    for item in equation.terms[1:]:
        factors = [parameters.get(name, (-inf, inf)) for name in item.parameters]
        factors += [_signal(s, sample, data, bounds, ranges) for s in item.signals]
        if not all(isfinite(low) and isfinite(high) for low, high in factors):
            return (-inf, inf)
        total = _plus(total, _product(item, factors))
    return total


def _signal(
    lagged: Lagged,
    sample: int,
    data: IOData,
    bounds: Bounds,
    ranges: Mapping[str, NDArray[np.float64]],
) -> Interval:
    place = sample - lagged.lag
    if place < data.first[sample]:
        return (0.0, 0.0)
    found = channel_of(lagged.signal)
    if found is None:
        return (-inf, inf)
    output, channel = found[0] == "y", found[1]
    value = float((data.y if output else data.u)[place, channel])
    if np.isnan(value):
        low, high = ranges[lagged.signal][place].tolist()
        return low, high
    width = float(bounds[0 if output else 1][place, channel])
    return (value, value) if width == 0.0 else _plus((value, value), (-width, width))


def _plus(left: Interval, right: Interval) -> Interval:
    return nextafter(left[0] + right[0], -inf), nextafter(left[1] + right[1], inf)


def _product(item: Term, factors: list[Interval]) -> Interval:
    low, high = -item.coefficient, -item.coefficient
    for a, b in factors:
        ends = (low * a, low * b, high * a, high * b)
        low, high = nextafter(min(ends), -inf), nextafter(max(ends), inf)
    return low, high
