"""Simulation: noise-free outputs of any structure, and records with bounded noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import FrozenMapping, frozen, parameters_of, real_array, seed_of
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError
from setid.models.block import BlockStructured
from setid.models.checked_structures import check_structure, equations_of
from setid.models.continuous import at_rate, interval_of
from setid.models.equations import Equation, Structure, channel_of
from setid.simulation.recursions import solve_equations
from sparsepop_py.algebra.read_only import ReadOnly

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Simulated", "in_order", "simulate", "simulate_record"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulated(ReadOnly):
    """A record with everything that a real one hides.

    Parameters
    ----------
    data : IOData
        What a sensor would have recorded.
    theta : mapping of str to float
    u, y : (N, nu), (N, ny) float
        Noise-free signals.
    output, input, equation : arrays
        The noise, as :meth:`Formulation.point` takes it.
    signals : mapping of str to (N,) float
        Internal signals.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> truth = setid.simulate_record(model, [-0.5, 1], [1, 0, 0], setid.Noise(output=0.1))
    >>> truth.y.ravel(), bool(abs(truth.output).max() <= 0.1)
    (array([0. , 1. , 0.5]), True)
    """

    data: IOData
    theta: Mapping[str, float]
    u: NDArray[np.float64]
    y: NDArray[np.float64]
    output: NDArray[np.float64]
    input: NDArray[np.float64]
    equation: NDArray[np.float64]
    signals: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in self.theta.items())
        return f"<Simulated: {values}, {f'{self.data!r}'[1:-1]}>"

    def plot(self, ax: Any = None) -> NDArray[Any] | Axes:
        """Draw the record, as :meth:`IOData.plot`; returns the axes."""
        return self.data.plot(ax)


def simulate(
    model: Structure,
    theta: ArrayLike | Mapping[str, float],
    u: ArrayLike,
    equation: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Simulate noise-free outputs for given inputs, all signals zero before the record.

    Parameters
    ----------
    model : Structure
    theta : array_like (p,) or mapping of names to numbers
    u : array_like (N,) or (N, nu)
    equation : array_like (N,) or (N, ny), optional
        Equation errors that drive the difference equations.

    Returns
    -------
    (N, ny) float

    Raises
    ------
    SetidError
        If shapes or names do not fit.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> setid.simulate(model, {"a1": -0.5, "b1": 1.0}, [1, 0, 0, 0]).ravel().tolist()
    [0.0, 1.0, 0.5, 0.25]
    """
    inputs = _inputs(model, u)
    shape = (inputs.shape[0], model.outputs)
    errors = np.zeros(shape) if equation is None else _columns(equation, "equation", shape[1])
    if errors.shape != shape:
        raise DataError(f"equation: found shape {errors.shape}, expected {shape}")
    found = _simulate(model, _values(model, theta), inputs, errors)
    return np.stack([found[f"y{i + 1}"] for i in range(model.outputs)], axis=1)


def simulate_record(
    model: Structure,
    theta: ArrayLike | Mapping[str, float],
    u: ArrayLike,
    noise: Noise,
    seed: int | np.random.Generator = 0,
    Ts: float | None = None,
) -> Simulated:
    """Simulate a record with uniform noise within its bounds; return the truth behind it too.

    Parameters
    ----------
    model : Structure
    theta : array_like (p,) or mapping of names to numbers
    u : array_like (N,) or (N, nu)
        Noise-free inputs.
    noise : Noise
        Absolute bounds in the units of the signals, from which the noise is drawn uniformly.
    seed : int or numpy.random.Generator
        The same seed gives the same record; 0 when left out.
    Ts : float, optional
        Sampling interval; that of a continuous-time structure, or 1, when left out.

    Returns
    -------
    Simulated
        ``data`` is the record with its noise; the other fields are what produced it.

    Raises
    ------
    NoiseError
        If bounds are relative, or there are constraints over the record.
    SetidError
        If something else does not fit the structure.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> truth = setid.simulate_record(model, [-0.5, 1], [1, 3, 2, 1], setid.Noise(output=0.1))
    >>> formulation = setid.formulate(truth.data, model, setid.Noise(output=0.1))
    >>> x = formulation.point(truth.theta, output=truth.output)
    >>> bool(formulation.problem.violation(x) < 1e-12)
    True
    """
    if not isinstance(noise, Noise):
        raise NoiseError(f"noise: found {type(noise).__name__}, expected Noise")
    if noise.relative or noise.constraints:
        raise NoiseError("noise: found relative bounds or sets, expected absolute bounds alone")
    generator = np.random.default_rng(seed_of(seed))
    inputs = _inputs(model, u)
    values = _values(model, theta)
    interval = interval_of(model, Ts)
    model = model if Ts is None else at_rate(model, Ts)
    blank = IOData(inputs, np.zeros((inputs.shape[0], model.outputs)), interval)
    eta, xi, e = (generator.uniform(-bound, bound) for bound in noise.bounds(blank))
    found = _simulate(model, values, inputs, e)
    outputs = np.stack([found[f"y{i + 1}"] for i in range(model.outputs)], axis=1)
    internal = {name: frozen(v) for name, v in found.items() if channel_of(name) is None}
    return Simulated(
        IOData(inputs + xi, outputs + eta, interval),
        FrozenMapping(values),
        frozen(inputs),
        frozen(outputs),
        frozen(eta),
        frozen(xi),
        frozen(e),
        FrozenMapping(internal),
    )


def _inputs(model: Structure, u: ArrayLike) -> NDArray[np.float64]:
    """The inputs of a structure, (N, nu)."""
    check_structure(model)
    return _columns(u, "u", model.inputs)


def _columns(given: ArrayLike, field: str, channels: int) -> NDArray[np.float64]:
    values = real_array(given, field, DataError)
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or values.shape[1] != channels or np.any(np.isnan(values)):
        raise DataError(f"{field}: found shape {values.shape}, expected (N, {channels}), no NaN")
    return values


def _values(model: Structure, theta: ArrayLike | Mapping[str, float]) -> dict[str, float]:
    values = parameters_of(theta, model.parameters)
    return dict(zip(model.parameters, values.tolist(), strict=True))


def _simulate(
    model: Structure,
    theta: Mapping[str, float],
    inputs: NDArray[np.float64],
    errors: NDArray[np.float64],
) -> dict[str, NDArray[np.float64]]:
    """All signals: each equation gives the one that it defines."""
    given = model.driven(inputs) if isinstance(model, BlockStructured) else {}
    known = {f"u{i + 1}" for i in range(inputs.shape[1])} | set(given)
    equations = in_order(equations_of(model), known)
    samples, pad = inputs.shape[0], max(e.lag for e in equations)
    signals = {f"u{i + 1}": column for i, column in enumerate(inputs.T)} | given
    padded = {name: np.append(np.zeros(pad), column) for name, column in signals.items()}
    padded |= {equation.defines: np.zeros(pad + samples) for equation in equations}
    drives = {
        equation.defines: np.append(np.zeros(pad), errors[:, equation.output])
        for equation in equations
        if equation.error and equation.output is not None
    }
    solve_equations(equations, theta, padded, pad, drives)
    return {name: values[pad:] for name, values in padded.items()}


def in_order(equations: Sequence[Equation], given: set[str]) -> list[Equation]:
    """Order equations so that each needs at lag 0 only what is defined before it."""
    known, rest, found = set(given), list(equations), list[Equation]()
    while rest:
        needs = [{s.signal for t in e.explicit for s in t.signals if s.lag == 0} for e in rest]
        ready = next((i for i, now in enumerate(needs) if now <= known), None)
        if ready is None:
            raise ModelError(
                f"model: the equation of {rest[0].defines} needs {sorted(needs[0] - known)} at the "
                "same sample, expected equations that can be solved one after the other"
            )
        known.add(rest[ready].defines)
        found.append(rest.pop(ready))
    return found
