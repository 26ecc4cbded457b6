"""Frequency responses and free-running outputs of given parameter vectors: plain arithmetic."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import real_array
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.models.checked_structures import coefficients_of, regression_of
from setid.models.equations import Equation, Structure, Transfer, channel_of
from setid.models.general import BlockStructured
from setid.models.lti import TransferFunction
from setid.simulation.recursions import solve_equations
from setid.simulation.simulate import simulate

__all__ = [
    "begun",
    "frequency_response",
    "frequency_weights",
    "from_readings",
    "grid",
    "known_from",
    "run",
    "transfer_of",
]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_POINTS = 60  # of a grid of frequencies


def transfer_of(model: Structure, output: int, input: int) -> Transfer:
    """Name coefficients between two channels (from 1).

    Raises
    ------
    ModelError
        If the structure has no linear block between these channels, or subtracts the input there,
        or a coefficient is no parameter.
    """
    found = coefficients_of(model, output, input)
    if isinstance(model, BlockStructured):
        model.check_between(output, input)
    every = (*found.numerator, *found.denominator)
    fixed = [name for name in every if name not in model.parameters]
    if fixed:
        raise ModelError(
            f"model: found {fixed[0]} fixed by normalise, expected coefficients that are "
            "parameters; identify with normalise='gamma1' or 'dcgain'"
        )
    return found


def grid(omega: ArrayLike | None, Ts: float, continuous: bool = False) -> Reals:
    """Choose angular frequencies in rad per unit of time, up to the Nyquist frequency.

    Parameters
    ----------
    omega : array_like (F,) or None
        Checked where given; a grid otherwise.
    Ts : float
    continuous : bool
        Models in continuous time, which also respond beyond the Nyquist frequency.

    Raises
    ------
    SetidError
        If a frequency is not in (0, pi / Ts].
    """
    top = np.pi / Ts
    if omega is None:
        return np.geomspace(top / 500.0, top, _POINTS)
    values = np.atleast_1d(real_array(omega, "omega", SetidError))
    if values.ndim != 1 or not values.size or not np.all((values > 0) & np.isfinite(values)):
        raise SetidError(f"omega: found {values.tolist()!r:.60}, expected finite frequencies > 0")
    if not continuous and np.any(values > top * (1 + 1e-12)):
        raise SetidError(
            f"omega: found {values.max():g}, expected frequencies in (0, pi / Ts] = (0, {top:g}]"
        )
    return values


def frequency_weights(
    model: Structure, output: int, input: int, omega: Reals, Ts: float
) -> tuple[Complexes, Complexes]:
    """Compute the matrices of N = A theta and D = 1 + B theta at given frequencies.

    Returns
    -------
    A, B : (F, p) complex
    """
    place = {name: column for column, name in enumerate(model.parameters)}
    transfer = transfer_of(model, output, input)
    numerator = np.zeros((omega.size, len(place)), complex)
    denominator = np.zeros_like(numerator)
    for lag, name in enumerate(transfer.numerator, transfer.delay):
        numerator[:, place[name]] = _step(transfer, omega, Ts, lag)
    for lag, name in enumerate(transfer.denominator, 1):
        denominator[:, place[name]] = _step(transfer, omega, Ts, lag)
    return numerator, denominator


def _step(transfer: Transfer, omega: Reals, Ts: float, lag: int) -> Complexes:
    """q^-lag at exp(j omega Ts), or s^-lag at j omega in continuous time."""
    if transfer.continuous:
        return np.asarray(omega**-lag * (1, -1j, -1, 1j)[lag % 4], np.complex128)
    return np.asarray(np.exp(-1j * omega * Ts * lag), np.complex128)


def frequency_response(
    model: Structure,
    theta: ArrayLike,
    omega: Reals,
    Ts: float,
    output: int = 1,
    input: int = 1,
) -> Complexes:
    """Compute G(exp(j omega Ts)), or G(j omega) in continuous time, for one or many vectors.

    Parameters
    ----------
    model : Structure
        Linear.
    theta : (p,) or (M, p) array_like
    omega : (F,) float
    Ts : float
    output, input : int
        Channels, from 1.

    Returns
    -------
    (F,) or (M, F) complex

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid.simulation.responses import frequency_response
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> frequency_response(model, [-0.5, 1.0], np.array([np.pi]), 1.0).real.round(4)
    array([0.6667])
    """
    a, b = frequency_weights(model, output, input, np.asarray(omega, float), Ts)
    values = np.asarray(theta, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        response = (a @ values.T) / (1.0 + b @ values.T)
    return np.asarray(response.T, np.complex128)


def run(model: Structure, theta: ArrayLike, data: IOData) -> Reals:
    """Simulate the model for a record's inputs, without its later outputs.

    Parameters
    ----------
    model : Structure
    theta : (p,) array_like
    data : IOData
        Inputs must be complete. Where the model's ``initial`` is ``"free"`` and its outputs follow
        from readings (:func:`from_readings`), the first outputs of each record are those that
        were read, up to the first complete ones; otherwise everything is at rest before the record.

    Returns
    -------
    (N, ny) float

    Raises
    ------
    SetidError
        If an input is missing, or all outputs to start from are.
    """
    if np.any(np.isnan(data.u)):
        raise SetidError("data: found missing inputs, expected complete ones to simulate with")
    values, equations = np.asarray(theta, float), from_readings(model)
    bounds = [*data.starts.tolist(), data.samples]
    parts = []
    for begin, end in zip(bounds[:-1], bounds[1:], strict=True):
        u, y = data.u[begin:end], data.y[begin:end]
        first = _begun(model, equations, y)
        if first:
            parts.append(_continued(equations, model.parameters, values, u, y, first))
        else:
            parts.append(simulate(model, values, u))
    return np.concatenate(parts)


def from_readings(model: Structure) -> tuple[Equation, ...]:
    """List equations that continue a record from its first readings; none for systems at rest.

    Denominators of their own are multiplied out, and maps of inputs are inserted. Structures with
    internal signals that nobody measures have none.

    Parameters
    ----------
    model : Structure

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1, inputs=2)
    >>> from_readings(model)[0].lag
    2
    """
    if model.initial == "zero":
        return ()
    if isinstance(model, TransferFunction):
        return model.multiplied()
    if not isinstance(model, BlockStructured):
        return regression_of(model)
    found = model.direct()
    measured = all(channel_of(signal) for equation in found for signal in equation.signals)
    return found if measured else ()


def begun(model: Structure, y: Reals) -> int:
    """Count the samples of a record from which a simulation starts; 0 where it starts at rest.

    Sums over several denominators, which predict nothing one step ahead, start at rest where the
    readings are too sparse.

    Parameters
    ----------
    model : Structure
    y : (N, ny) float
        NaN where a reading is missing.

    Raises
    ------
    SetidError
        If there are too few readings in a row for another structure.

    Examples
    --------
    >>> import numpy as np, setid
    >>> sparse = np.array([[1.0], [np.nan], [2.0], [np.nan]])
    >>> begun(setid.TransferFunction(na=1, nb=1, nk=1, inputs=2), sparse)
    0
    """
    return _begun(model, from_readings(model), y)


def _begun(model: Structure, equations: Sequence[Equation], y: Reals) -> int:
    first = max((equation.lag for equation in equations), default=0)
    try:
        return known_from(y, first)
    except SetidError:
        if regression_of(model):
            raise
        return 0


def known_from(y: Reals, first: int) -> int:
    """Count the samples (N, ny) of a record up to the end of the first complete readings.

    Parameters
    ----------
    y : (N, ny) float
        NaN where a reading is missing.
    first : int
        Number of readings in a row, from which a simulation starts.

    Raises
    ------
    SetidError
        If there are none.

    Examples
    --------
    >>> import numpy as np
    >>> known_from(np.array([[np.nan], [1.0], [2.0], [3.0]]), 2)
    3
    """
    known, count = np.all(~np.isnan(y), axis=1).tolist(), 0
    for k in range(len(y)):
        if count == first:
            return k
        count = count + 1 if known[k] else 0
    if count < min(first, len(y)):
        raise SetidError(
            f"data: found missing outputs in each {first} samples in a row, expected {first} "
            "complete ones, from which a simulation starts; take predictions"
        )
    return len(y)


def _continued(
    equations: Sequence[Equation],
    names: Sequence[str],
    theta: Reals,
    u: Reals,
    y: Reals,
    first: int,
) -> Reals:
    """From some sample on, after complete readings."""
    signals = {f"u{j + 1}": column for j, column in enumerate(u.T)}
    signals |= {f"y{i + 1}": column.copy() for i, column in enumerate(y.T)}
    place = dict(zip(names, theta.tolist(), strict=True))
    solve_equations(equations, place, signals, first, {})
    return np.stack([signals[f"y{i + 1}"] for i in range(y.shape[1])], axis=1)
