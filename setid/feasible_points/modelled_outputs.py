"""Outputs that a parameter vector simulates or predicts, and how well they fit the readings.

A simulation knows the inputs and a few first readings alone. A prediction of one step knows all
readings before it. Nothing here is proved.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.feasible_set.coordinates import Coordinates, coordinates_of
from setid.formulation.regression import Regression
from setid.models.continuous import at_rate
from setid.models.equations import Structure
from setid.simulation.recursions import leading
from setid.simulation.responses import begun, run

__all__ = [
    "fit",
    "per_cent",
    "predicted",
    "prediction_errors",
    "prediction_rows",
    "simulated",
    "started",
]

Reals = NDArray[np.float64]


def fit(measured: Reals, modelled: Reals) -> Reals:
    """Compute 100 (1 - |e| / |y - mean y|) of each output.

    Samples count where both are known.

    Parameters
    ----------
    measured, modelled : (N, ny) float

    Returns
    -------
    (ny,) float
        -inf where the modelled output is not finite or the readings never change.

    Examples
    --------
    >>> import numpy as np
    >>> from setid.feasible_points.modelled_outputs import fit
    >>> fit(np.array([[0.0], [1.0], [2.0]]), np.array([[0.0], [1.0], [1.0]])).round(2)
    array([29.29])
    """
    found = np.full(measured.shape[1], -np.inf)
    for i, (y, v) in enumerate(zip(measured.T, modelled.T, strict=True)):
        known = ~np.isnan(y) & ~np.isnan(v)
        if not np.any(known):
            continue
        size = float(np.linalg.norm(y[known] - y[known].mean()))
        error = float(np.linalg.norm(y[known] - v[known]))
        if size > 0 and np.isfinite(error):
            found[i] = 100.0 * (1.0 - error / size)
    return found


def per_cent(fits: Reals) -> str:
    """Write fits for people; where readings never change there is nothing to fit.

    Parameters
    ----------
    fits : (ny,) float

    Examples
    --------
    >>> import numpy as np
    >>> from setid.feasible_points.modelled_outputs import per_cent
    >>> per_cent(np.array([92.24, -np.inf]))
    '92.2 %, none (constant readings, or outputs that overflow)'
    """
    nothing = "none (constant readings, or outputs that overflow)"
    return ", ".join(f"{value:.1f} %" if value > -np.inf else nothing for value in fits)


def started(model: Structure, data: IOData) -> NDArray[np.bool_]:
    """Mark samples (N,) from which a simulation starts, which do not count.

    Parameters
    ----------
    model : Structure
    data : IOData
    """
    found = np.zeros(data.samples, bool)
    for begin, end in pairwise([*data.starts.tolist(), data.samples]):
        found[begin : begin + begun(model, data.y[begin:end])] = True
    return found


def simulated(model: Structure, theta: Reals, data: IOData) -> Reals:
    """Simulate outputs (N, ny), NaN at the samples from which the simulation starts.

    Parameters
    ----------
    model : Structure
    theta : (p,) float
    data : IOData
    """
    with np.errstate(over="ignore", invalid="ignore"):
        outputs = run(model, theta, data)
    return np.where(started(model, data)[:, None], np.nan, outputs)


def predicted(model: Structure, theta: Reals, data: IOData) -> Reals:
    """Predict one step (N, ny) from the readings, NaN where no row predicts.

    Parameters
    ----------
    model : Structure
    theta : (p,) float
    data : IOData
    """
    rows, coordinates = prediction_rows(model, data)
    found = np.full(data.y.shape, np.nan)
    place = rows.row, rows.output - 1
    found[place] = data.y[place] - prediction_errors(rows, coordinates, theta)
    return found


def prediction_rows(model: Structure, data: IOData) -> tuple[Regression, Coordinates]:
    """Write the equations of the readings as if exact, and what they are linear in.

    Parameters
    ----------
    model : Structure
    data : IOData

    Returns
    -------
    (Regression, Coordinates)
    """
    model = at_rate(model, data.Ts)
    coordinates = coordinates_of(model, "no one-step prediction; simulate instead")
    return coordinates.rows_of_readings(data, model), coordinates


def prediction_errors(rows: Regression, coordinates: Coordinates, theta: Reals) -> Reals:
    """Subtract predictions from readings; equations are solved for the newest sample.

    Parameters
    ----------
    rows : Regression
    coordinates : Coordinates
    theta : (p,) float

    Returns
    -------
    (r,) float
        One for each row.

    Raises
    ------
    ModelError
        If the factor of the newest sample is zero.
    """
    values = coordinates.values(theta)
    named = dict(zip(coordinates.names, values.tolist(), strict=True))
    factors = {e.output: leading(e, named) for e in coordinates.equations if e.implicit}
    own = np.array([factors.get(output, 1.0) for output in range(int(rows.output.max()))])
    return np.asarray((rows.target + rows.regressors @ values) / own[rows.output - 1], np.float64)
