"""Parameters and outputs with the least error, where the denominator is given.

The outputs come from filters in the direction of time in which each pole is stable, so that poles
outside the unit disc are as good as others. A simulation forward in time would overflow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.formulation.regression import regression_of_data
from setid.minimum_noise.programs import Programs, longest_stretches
from setid.models.checked_structures import coefficients_of
from setid.models.lti import TransferFunction
from setid.proofs.denominators.output_rows import OutputRows
from setid.simulation.responses import run

__all__ = ["fit_of_denominator"]

Reals = NDArray[np.float64]
_CLOSE = 1e-3  # of the largest error


def fit_of_denominator(
    data: IOData, model: TransferFunction, rows: OutputRows, denominator: Reals
) -> tuple[Reals, Reals] | None:
    """Fit the other parameters and all states of a single output.

    Parameters
    ----------
    data : IOData
    model : TransferFunction
    rows : OutputRows
        Of the output, with the norm of the error.
    denominator : (n,) float
        Coefficients a_1, ..., a_n.

    Returns
    -------
    theta : (p,) float
    outputs : (N, 1) float
        None of both where readings are missing.

    Examples
    --------
    >>> import setid
    >>> from setid.proofs.least_noise.least_error import error_rows, stated
    >>> data = setid.IOData([1, 0, 2, 1, 0, 1], [0, 1, 0.5, 2.25, 2.1, 1.0])
    >>> model = setid.TransferFunction(1, 1, 1)
    >>> rows = error_rows(stated(data, model, (), 1.0), "l2", 1.0)
    >>> theta, outputs = fit_of_denominator(data, model, rows, np.array([-0.5]))
    >>> theta.round(6), float(abs(outputs - data.y).max().round(3))
    (array([-0.5     ,  0.989481]), 0.052)
    """
    section = longest_stretches(rows.row, rows.order)
    if np.any(np.isnan(data.y)) or not section.size:
        return None
    programs = Programs(rows, section)
    if section.size < np.count_nonzero(rows.row):
        return None
    fitted = programs.fitted(np.append(1.0, denominator))
    if fitted is None or not np.all(np.isfinite(fitted)):
        return None
    outputs = data.y.copy()
    numbers = rows.numbers(programs.samples)
    outputs[numbers[numbers >= 0], 0] = fitted[numbers >= 0]
    found = regression_of_data(data.with_outputs(outputs), model)
    places = [model.parameters.index(name) for name in coefficients_of(model, 1, 1).denominator]
    others = np.setdiff1d(np.arange(len(model.parameters)), places)
    theta = np.zeros(len(model.parameters))
    theta[places] = denominator
    rest = found.target + found.regressors[:, places] @ denominator
    theta[others] = -np.linalg.lstsq(found.regressors[:, others], rest, rcond=None)[0]
    with np.errstate(over="ignore", invalid="ignore"):  # to the last digit, where that is stable
        again = run(model, theta, data.with_outputs(outputs))
    close = np.abs(again - outputs) <= _CLOSE * np.abs(outputs - data.y).max()
    return theta, again if np.all(close) else outputs
