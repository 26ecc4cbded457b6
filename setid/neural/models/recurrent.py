"""Networks with a state: Elman, neural state space, LSTM and GRU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import IOData, ModelError
from setid.data.checks import entries_of, word
from setid.neural.arithmetic import ACTIVATIONS, activate
from setid.neural.models.network import Network, finite_array, slope_of
from setid.neural.models.regressor import check_record
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["GRU", "LSTM", "Elman", "NeuralStateSpace", "StateNetwork"]

Reals = NDArray[np.float64]
Reset = Literal["before", "after"]


class StateNetwork:
    """Base of the models with a state: simulation from x0, and prediction by it."""

    __slots__ = ()
    output: Network

    @property
    def states(self) -> int:
        """Number of states."""
        raise NotImplementedError

    @property
    def channels(self) -> int:
        """Number of inputs."""
        raise NotImplementedError

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return self.output.outputs

    def step(self, x: Reals, u: Reals) -> tuple[Reals, Reals]:
        """Return the next state and the output of this sample, in floating point."""
        raise NotImplementedError

    def simulate(self, data: IOData, x0: ArrayLike | None = None) -> Reals:
        """Run from an initial state; each record by itself.

        Parameters
        ----------
        data : IOData
            Its inputs are used.
        x0 : (states,) float, optional
            State before the first sample; zero where left out.

        Returns
        -------
        (N, ny) float
        """
        check_record(data, self.channels, self.outputs)
        first = self.start(np.zeros(self.states) if x0 is None else x0)
        found = np.empty((data.samples, self.outputs))
        ends = [*data.starts[1:].tolist(), data.samples]
        for begin, end in zip(data.starts.tolist(), ends, strict=True):
            x = first
            for t in range(begin, end):
                x, found[t] = self.step(x, data.u[t])
        return found

    def one_step(self, data: IOData, x0: ArrayLike | None = None) -> Reals:
        """Predict one step ahead: for output noise the predictor is the simulation.

        Parameters
        ----------
        data : IOData
        x0 : (states,) float, optional
        """
        return self.simulate(data, x0)

    def start(self, x0: ArrayLike) -> Reals:
        """Check an initial state (states,)."""
        values = finite_array(x0, "x0")
        if values.size != self.states:
            raise ModelError(f"x0: found shape {values.shape}, expected ({self.states},)")
        return values.reshape(self.states)


def _matrix(given: Any, field: str, shape: tuple[int, ...]) -> Reals:
    """Numbers of a given shape; -1 leaves an axis open."""
    values = finite_array(given, field, len(shape))
    if any(a not in (-1, b) for a, b in zip(shape, values.shape, strict=True)):
        text = ", ".join("any" if a == -1 else str(a) for a in shape)
        raise ModelError(f"{field}: found shape {values.shape}, expected ({text})")
    return values


def _parts(given: Any, field: str, expected: str, count: int) -> list[Any]:
    """The arrays of a layer or gate."""
    parts = entries_of(given, field, expected, ModelError)
    if len(parts) != count:
        raise ModelError(f"{field}: found {len(parts)} arrays, expected {expected}")
    return parts


def _readout(given: Any, width: int) -> Network:
    """A static output layer as a network: (W, b), a Network, or None for the state itself."""
    if given is None:
        return Network([np.eye(width)], [np.zeros(width)])
    net = given
    if not isinstance(given, Network):
        weight, bias = _parts(given, "output", "a Network or (W, b)", 2)
        net = Network([weight], [bias])
    if net.inputs != width:
        raise ModelError(f"output: found {net.inputs} inputs, expected {width} states")
    return net


def _count(*arrays: Reals) -> int:
    return sum(a.size for a in arrays)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Elman(StateNetwork, ReadOnly):
    """h^i_t = phi(W_i x^i_t + V_i h^i_{t-1} + b_i), x^1 = u, x^i = h^{i-1}_t; y_t = W h_t + b.

    Parameters
    ----------
    layers : sequence of (W, V, b)
        Input matrix (m_i, m_{i-1}), state matrix (m_i, m_i) and bias (m_i,) of each layer.
    output : (W, b) or Network
        Static output layer, of the state of the last layer.
    activation : str
        Of all recurrent layers.
    leak : float
        Slope of ``"leaky_relu"`` for negative arguments, in [0, 1].

    Raises
    ------
    ModelError
        If shapes do not fit, or the slope is none.

    Notes
    -----
    The state stacks h^1, h^2, ...; ``x0`` is the state before the first sample.

    References
    ----------
    J. L. Elman, "Finding structure in time", Cognitive Science 14 (1990) 179-211.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[2.0]], [0.0]), "relu")
    >>> net.simulate(setid.IOData([1.0, 0.0, -4.0], [0, 0, 0])).ravel()
    array([2., 1., 0.])
    """

    layers: tuple[tuple[Reals, Reals, Reals], ...]
    output: Network
    activation: str
    leak: float

    def __init__(
        self,
        layers: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]],
        output: Any = None,
        activation: str = "tanh",
        leak: float = 0.01,
    ) -> None:
        read: list[tuple[Reals, Reals, Reals]] = []
        below = -1
        for i, layer in enumerate(entries_of(layers, "layers", "a list of (W, V, b)", ModelError)):
            w, v, b = _parts(layer, f"layers[{i}]", "(W, V, b)", 3)
            offset = _matrix(b, f"layers[{i}].b", (-1,))
            size = offset.size
            read.append(
                (
                    _matrix(w, f"layers[{i}].W", (size, below)),
                    _matrix(v, f"layers[{i}].V", (size, size)),
                    offset,
                )
            )
            below = size
        if not read:
            raise ModelError("layers: found none, expected at least one")
        word(activation, "activation", ACTIVATIONS, ModelError)
        fields = {
            "layers": tuple(read),
            "output": _readout(output, below),
            "activation": activation,
            "leak": slope_of(leak),
        }
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    @property
    def states(self) -> int:
        """Number of states."""
        return sum(b.size for _, _, b in self.layers)

    @property
    def channels(self) -> int:
        """Number of inputs."""
        return self.layers[0][0].shape[1]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(_count(*layer) for layer in self.layers) + self.output.parameters

    def step(self, x: Reals, u: Reals) -> tuple[Reals, Reals]:
        """Return the next state and the output of this sample."""
        parts, begin, value = [], 0, u
        for w, v, b in self.layers:
            before = x[begin : begin + b.size]
            value = activate(self.activation, w @ value + v @ before + b, self.leak)
            parts.append(value)
            begin += b.size
        return np.concatenate(parts), self.output(value)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class NeuralStateSpace(StateNetwork):
    """x_{t+1} = N_f([u_t, x_t]), y_t = N_h([u_t, x_t]).

    Parameters
    ----------
    transition : Network
        N_f, from nu + n inputs to n outputs.
    output : Network
        N_h, from nu + n inputs.

    Raises
    ------
    ModelError
        If the two do not fit.

    References
    ----------
    J. A. K. Suykens, B. L. R. De Moor, J. Vandewalle, "Nonlinear system identification using
    neural state space models", International Journal of Control 62 (1995) 129-152.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.NeuralStateSpace(
    ...     neural.Network([[[1.0, 0.5]]], [[0.0]]), neural.Network([[[0.0, 1.0]]], [[0.0]])
    ... )
    >>> net.simulate(setid.IOData([1.0, 0.0, 0.0], [0, 0, 0])).ravel()
    array([0. , 1. , 0.5])
    """

    transition: Network
    output: Network

    def __init__(self, transition: Network, output: Network) -> None:
        for field, value in (("transition", transition), ("output", output)):
            if not isinstance(value, Network):
                raise ModelError(f"{field}: found {type(value).__name__}, expected neural.Network")
        if transition.inputs <= transition.outputs or output.inputs != transition.inputs:
            raise ModelError(
                f"transition, output: found {transition.inputs} and {output.inputs} inputs, "
                f"expected equal numbers above the {transition.outputs} states"
            )
        object.__setattr__(self, "transition", transition)
        object.__setattr__(self, "output", output)

    @property
    def states(self) -> int:
        """Number of states."""
        return self.transition.outputs

    @property
    def channels(self) -> int:
        """Number of inputs."""
        return self.transition.inputs - self.states

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.transition.parameters + self.output.parameters

    def step(self, x: Reals, u: Reals) -> tuple[Reals, Reals]:
        """Return the next state and the output of this sample."""
        both = np.concatenate([u, x])
        return self.transition(both), self.output(both)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class LSTM(StateNetwork, ReadOnly):
    """Long short-term memory: gates f, i, o and candidate c~, all products elementwise.

    f, i, o = sigmoid(W [h_{t-1}, u_t] + b), c~ = tanh(W_c [h_{t-1}, u_t] + b_c),
    c_t = f c_{t-1} + i c~, h_t = o tanh(c_t), y_t = W h_t + b.

    Parameters
    ----------
    forget, input, output_gate, candidate : (W, U, b)
        Input matrix (n, nu), state matrix (n, n) and bias (n,) of each.
    output : (W, b) or Network, optional
        Static output layer; y = h where left out.

    Raises
    ------
    ModelError
        If shapes do not fit.

    Notes
    -----
    The state stacks h and c. The notes join [h, x] and so [U, W]; the count is the same.

    References
    ----------
    F. A. Gers, J. Schmidhuber, F. Cummins, "Learning to forget: continual prediction with
    LSTM", Neural Computation 12 (2000) 2451-2471.

    Examples
    --------
    >>> from setid import neural
    >>> gate = ([[1.0]], [[0.0]], [0.0])
    >>> neural.LSTM(gate, gate, gate, gate, ([[1.0]], [0.0])).parameters
    14
    """

    gates: tuple[tuple[Reals, Reals, Reals], ...]
    output: Network

    def __init__(
        self,
        forget: Sequence[ArrayLike],
        input: Sequence[ArrayLike],
        output_gate: Sequence[ArrayLike],
        candidate: Sequence[ArrayLike],
        output: Any = None,
    ) -> None:
        named = {
            "forget": forget,
            "input": input,
            "output_gate": output_gate,
            "candidate": candidate,
        }
        gates = _gates(named)
        object.__setattr__(self, "gates", gates)
        object.__setattr__(self, "output", _readout(output, gates[0][2].size))

    @property
    def width(self) -> int:
        """Number of cells."""
        return self.gates[0][2].size

    @property
    def states(self) -> int:
        """Number of states, h and c."""
        return 2 * self.width

    @property
    def channels(self) -> int:
        """Number of inputs."""
        return self.gates[0][0].shape[1]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(_count(*gate) for gate in self.gates) + self.output.parameters

    def step(self, x: Reals, u: Reals) -> tuple[Reals, Reals]:
        """Return the next state and the output of this sample."""
        h, c = x[: self.width], x[self.width :]
        f, i, o = (activate("sigmoid", w @ u + v @ h + b) for w, v, b in self.gates[:3])
        w, v, b = self.gates[3]
        c = f * c + i * np.tanh(w @ u + v @ h + b)
        h = o * np.tanh(c)
        return np.concatenate([h, c]), self.output(h)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class GRU(StateNetwork, ReadOnly):
    """Gated recurrent unit: gates z and r, h_t = (1 - z) h_{t-1} + z h~, elementwise.

    z, r = sigmoid(W u_t + U h_{t-1} + b) and, with ``reset="before"`` the product with U,
    h~ = tanh(W u_t + U (r h_{t-1}) + b); with ``reset="after"`` it,
    h~ = tanh(W u_t + b + r (U h_{t-1} + c)).

    Parameters
    ----------
    update, reset_gate : (W, U, b)
        Input matrix (n, nu), state matrix (n, n) and bias (n,).
    candidate : (W, U, b) or (W, U, b, c)
        The inner bias c belongs to ``reset="after"`` and is zero where left out.
    output : (W, b) or Network, optional
        Static output layer; y = h where left out.
    reset : {"before", "after"}
        Libraries default to ``"after"``, the notes and most papers to ``"before"``.

    Raises
    ------
    ModelError
        If shapes do not fit.

    References
    ----------
    K. Cho et al., "Learning phrase representations using RNN encoder-decoder for statistical
    machine translation", EMNLP 2014, section 2.3.

    Examples
    --------
    >>> from setid import neural
    >>> gate = ([[1.0]], [[0.0]], [0.0])
    >>> neural.GRU(gate, gate, gate, ([[1.0]], [0.0])).parameters
    11
    """

    gates: tuple[tuple[Reals, Reals, Reals], ...]
    inner: Reals
    output: Network
    reset: Reset

    def __init__(
        self,
        update: Sequence[ArrayLike],
        reset_gate: Sequence[ArrayLike],
        candidate: Sequence[ArrayLike],
        output: Any = None,
        reset: Reset = "before",
    ) -> None:
        word(reset, "reset", ("before", "after"), ModelError)
        parts = entries_of(candidate, "candidate", "(W, U, b) or (W, U, b, c)", ModelError)
        gates = _gates({"update": update, "reset_gate": reset_gate, "candidate": parts[:3]})
        width = gates[0][2].size
        if len(parts) > 3 and reset == "before":
            raise ModelError("candidate: found an inner bias, expected none for reset='before'")
        inner = parts[3] if len(parts) > 3 else np.zeros(width)
        for key, value in {
            "gates": gates,
            "inner": _matrix(inner, "candidate[3]", (width,)),
            "output": _readout(output, width),
            "reset": reset,
        }.items():
            object.__setattr__(self, key, value)

    @property
    def states(self) -> int:
        """Number of states."""
        return self.gates[0][2].size

    @property
    def channels(self) -> int:
        """Number of inputs."""
        return self.gates[0][0].shape[1]

    @property
    def parameters(self) -> int:
        """Number of weights and biases; the inner bias counts for ``reset="after"``."""
        inner = self.inner.size if self.reset == "after" else 0
        return sum(_count(*gate) for gate in self.gates) + inner + self.output.parameters

    def step(self, x: Reals, u: Reals) -> tuple[Reals, Reals]:
        """Return the next state and the output of this sample."""
        z, r = (activate("sigmoid", w @ u + v @ x + b) for w, v, b in self.gates[:2])
        w, v, b = self.gates[2]
        inner = v @ (r * x) if self.reset == "before" else r * (v @ x + self.inner)
        h = (1.0 - z) * x + z * np.tanh(w @ u + inner + b)
        return h, self.output(h)


def _gates(given: dict[str, Sequence[ArrayLike]]) -> tuple[tuple[Reals, Reals, Reals], ...]:
    """Gates (W, U, b) of one width and one number of inputs."""
    found: list[tuple[Reals, Reals, Reals]] = []
    size = channels = -1
    for name, arrays in given.items():
        parts = _parts(arrays, name, "(W, U, b)", 3)
        bias = _matrix(parts[2], f"{name}[2]", (size,))
        size = bias.size
        weight = _matrix(parts[0], f"{name}[0]", (size, channels))
        channels = weight.shape[1]
        found.append((weight, _matrix(parts[1], f"{name}[1]", (size, size)), bias))
    return tuple(found)
