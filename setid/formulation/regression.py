"""Linear regression rows: what the data alone say of theta, noise included as widths.

They are abs(Y + R theta) <= w0 + W abs(theta), one an output and sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.data.noise import NoiseBounds
from setid.data.record import IOData
from setid.errors import DataError, ModelError
from setid.formulation.compiler import Planned, plan
from setid.formulation.signals import (
    Integers,
    Reals,
    Signal,
    measured,
    missing_ranges,
    product,
)
from setid.models.block import BlockStructured
from setid.models.checked_structures import check_structure, regression_of
from setid.models.continuous import ContinuousTransferFunction, at_rate
from setid.models.equations import Equation, Structure
from setid.models.general import nonlinear_rows
from setid.models.lti import TransferFunction
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows

__all__ = [
    "Regression",
    "build_regression",
    "check_channels",
    "driven_signals",
    "regression_of_data",
    "rows_of",
    "rows_of_readings",
    "usable_samples",
]


@dataclass(frozen=True, slots=True, eq=False)
class Regression(UncertainRows):
    """Rows |target + regressors theta| <= radius + radii |theta|, which every theta obeys.

    Whatever the noise does within its bounds, a parameter vector that is consistent with
    the data satisfies all rows (for each row alone, they are also sufficient when no
    two samples in it share their noise).

    Parameters
    ----------
    names : tuple of str
        The parameters, in the order of theta.
    target : (R,) float
        What is known of each row without theta (Y).
    regressors : (R, p) float
        What multiplies theta (R).
    radius : (R,) float
        Width of the noise without theta, equation error included (w0).
    radii : (R, p) float
        Width of the noise for each unit of abs(theta) (W).
    row : (R,) int
        Row of the data, from 0.
    record, sample, output : (R,) int
        Record, sample in it and output, from 1; output 0 where a row defines an internal signal.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    >>> rows = known.regression
    >>> rows.names, rows.sample, rows.radii[0]
    (('a1', 'b0'), array([2, 3, 4]), array([0.5, 0. ]))
    """

    row: Integers
    record: Integers
    sample: Integers
    output: Integers


def usable_samples(
    data: IOData, ranges: Mapping[str, Reals], driven: Mapping[str, Signal]
) -> dict[str, NDArray[np.bool_]]:
    """Mark which samples are known or have a range, of readings and of functions of inputs."""
    read = {
        f"{letter}{channel + 1}": ~np.isnan(column)
        | np.isfinite(ranges[f"{letter}{channel + 1}"]).all(axis=1)
        for letter, values in (("y", data.y), ("u", data.u))
        for channel, column in enumerate(values.T)
    }
    return read | {name: ~np.isnan(signal.known) for name, signal in driven.items()}


def driven_signals(data: IOData, model: Structure) -> dict[str, Signal]:
    """Compute the functions of exact inputs that a structure asks for; NaN where unknown."""
    if not isinstance(model, BlockStructured):
        return {}
    none = np.full(data.samples, -1)
    found = {}
    for name, values in model.driven(data.u).items():
        centre = np.nan_to_num(values)
        zero = np.zeros(data.samples)
        found[name] = Signal(values, zero, none, centre, np.where(np.isnan(values), np.inf, 0.0))
    return found


def build_regression(
    data: IOData,
    model: Structure,
    signals: Mapping[str, Signal],
    usable: Mapping[str, NDArray[np.bool_]],
    equation_bound: Reals,
) -> Regression | None:
    """Build regression rows of a model, None if it has none.

    Parameters
    ----------
    data : IOData
    model : Structure
    signals : mapping of name to Signal
        At least the measured signals.
    usable : mapping of name to (N,) bool
        Samples of measured signals that rows may use.
    equation_bound : (N, ny) float
        Bounds of equation errors.
    """
    equations = regression_of(model)
    if not equations:
        return None
    plans = plan(equations, data, usable, model.initial)
    place: dict[tuple[str, ...], int] = {(n,): i for i, n in enumerate(model.parameters)}
    return rows_of(plans, place, model.parameters, data, signals, equation_bound)


def rows_of(
    plans: Sequence[Planned],
    columns: Mapping[tuple[str, ...], int],
    names: tuple[str, ...],
    data: IOData,
    signals: Mapping[str, Signal],
    equation_bound: Reals,
) -> Regression:
    """Build rows of planned equations of outputs, linear in products of parameters.

    Parameters
    ----------
    plans : sequence of Planned
    columns : mapping of products of parameters to columns
    names : tuple of str
        Of the columns.
    data, signals, equation_bound
        As for :func:`build_regression`.
    """
    parts = [_rows(item, data, columns, len(names), signals) for item in plans]
    row = np.concatenate([item.rows for item in plans])
    channels = [int(item.equation.defines[1:]) for item in plans]
    output = np.repeat(channels, [item.rows.size for item in plans])
    target, regressors, radius, radii = (
        np.concatenate([part[i] for part in parts]) for i in range(4)
    )
    radius = _sum(radius, equation_bound[row, output - 1])
    bounded = np.isfinite(radius) & np.all(np.isfinite(radii), axis=1)
    place = (row, data.record[row] + 1, row - data.first[row] + 1, output)
    chosen = [target, regressors, radius, radii, *place]
    return Regression(names, *(frozen(array[bounded]) for array in chosen))


def _sum(left: Reals, right: Reals) -> Reals:
    """Sum, rounded up where both are there."""
    total = left + right
    return np.where((left == 0) | (right == 0), total, np.nextafter(total, np.inf))


def _rows(
    item: Planned,
    data: IOData,
    columns: Mapping[tuple[str, ...], int],
    size: int,
    signals: Mapping[str, Signal],
) -> tuple[Reals, Reals, Reals, Reals]:
    count = item.rows.size
    target, radius = np.zeros(count), np.zeros(count)
    regressors, radii = np.zeros((count, size)), np.zeros((count, size))
    for term in item.equation.terms:
        ball = product(term.signals, signals, item.rows, data.first, term.coefficient)
        if term.parameters:
            column = columns[tuple(sorted(term.parameters))]
            regressors[:, column] += ball.centre
            radii[:, column] = _sum(radii[:, column], ball.radius)
        else:
            target += ball.centre
            radius = _sum(radius, ball.radius)
    return target, regressors, radius, radii


def regression_of_data(data: IOData, model: Structure) -> Regression:
    """Build regression rows of readings as if exact; rows with gaps left out.

    Raises
    ------
    ModelError
        If the model is not linear in its parameters.
    DataError
        If channels do not fit or no row is left.
    """
    check_channels(data, model)
    model = at_rate(model, data.Ts)
    equations = regression_of(model)
    if not equations:
        advice = "setid.fit with errors='output' takes them"
        if isinstance(model, TransferFunction):
            advice = "use common_denominator=True, or one output and one input at a time"
        raise ModelError(
            f"model: {nonlinear_rows(model)} are not linear in the parameters; {advice}"
        )
    return rows_of_readings(data, model, equations, model.parameters)


def rows_of_readings(
    data: IOData,
    model: Structure,
    equations: Sequence[Equation],
    names: tuple[str, ...],
    bounds: NoiseBounds | None = None,
) -> Regression:
    """Build rows of equations of outputs for a record, in coordinates in which they are linear.

    Parameters
    ----------
    data : IOData
    model : Structure
        At the sampling interval of the data.
    equations : sequence of Equation
        What the model says of its outputs.
    names : tuple of str
        Of the coordinates.
    bounds : NoiseBounds, optional
        Readings count as exact when left out, and rows with gaps are left out.

    Raises
    ------
    DataError
        If no row is left.
    """
    if bounds is None:
        output, input = np.zeros(data.y.shape), np.zeros(data.u.shape)
        bounds = NoiseBounds(output, input, output)
        gap = np.tile([-np.inf, np.inf], (data.samples, 1))
        channels = [("y", data.outputs), ("u", data.inputs)]
        ranges = {f"{letter}{i + 1}": gap for letter, count in channels for i in range(count)}
    else:
        ranges = missing_ranges(data, model, bounds, {})
    none = np.full(data.samples, -1)
    signals = {
        f"{letter}{channel + 1}": measured(
            column, bound[:, channel], none, none, ranges[f"{letter}{channel + 1}"]
        )
        for letter, values, bound in (("y", data.y, bounds.output), ("u", data.u, bounds.input))
        for channel, column in enumerate(values.T)
    }
    driven = driven_signals(data, model)
    usable = usable_samples(data, ranges, driven)
    plans = plan(equations, data, usable, model.initial)
    columns: dict[tuple[str, ...], int] = {(name,): place for place, name in enumerate(names)}
    found = rows_of(plans, columns, names, data, signals | driven, bounds.equation)
    if not found.target.size:
        raise DataError(f"data: found {data.samples} samples and no complete row, expected more")
    return found


def check_channels(data: IOData, model: Structure) -> None:
    """Refuse data and models that do not fit together."""
    if not isinstance(data, IOData):
        raise DataError(f"data: found {type(data).__name__}, expected IOData")
    check_structure(model)
    wanted: Sequence[int] = (model.inputs, model.outputs)
    if (data.inputs, data.outputs) != tuple(wanted):
        continuous = isinstance(model, ContinuousTransferFunction)
        raise DataError(
            f"data: found {data.inputs} inputs and {data.outputs} outputs, expected "
            f"{model.inputs} and {model.outputs} as in the model"
            + ("; in continuous time choose one of each, or a TransferFunction" * continuous)
        )
