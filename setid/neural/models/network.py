"""Feed-forward networks: frozen weights, evaluation, and enclosures of what they compute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import ModelError
from setid.data.checks import entries_of, number, without_mask, word
from setid.neural.arithmetic import ACTIVATIONS, Interval, activate, enclose, matmul
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["Network", "affine", "finite_array"]

Reals = NDArray[np.float64]


def finite_array(given: Any, field: str, dimensions: int | None = None) -> Reals:
    """Copy numbers into a read-only array of doubles.

    Parameters
    ----------
    given : array_like
    field : str
        Name in messages.
    dimensions : int, optional
        Number of axes asked for.

    Raises
    ------
    ModelError
        Naming the field and the first value that is no finite number.
    """
    try:
        array = without_mask(given)
        if np.iscomplexobj(array) or array.dtype.kind in "USmM":
            raise TypeError
        values = np.array(array, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ModelError(f"{field}: found {type(given).__name__}, expected real numbers") from None
    if dimensions is not None and values.ndim != dimensions:
        raise ModelError(f"{field}: found shape {values.shape}, expected {dimensions} axes")
    if not np.all(np.isfinite(values)):
        where = np.argwhere(~np.isfinite(values))[0].tolist()
        raise ModelError(f"{field}{where}: found {values[tuple(where)]}, expected finite numbers")
    values.flags.writeable = False
    return values


def affine(weight: Reals, bias: Reals, x: Interval) -> Interval:
    """Enclose W x + b for intervals x of shape (..., inputs)."""
    return matmul(x, Interval.point(weight.T)) + Interval.point(bias)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Network(ReadOnly):
    """N(x) = phi_L(W_L ... phi_1(W_1 x + b_1) ... + b_L), the last phi being the identity.

    Parameters
    ----------
    weights : sequence of (outputs, inputs) array_like
        One matrix a layer.
    biases : sequence of (outputs,) array_like
    activation : str or sequence of str
        ``"tanh"``, ``"sigmoid"``, ``"relu"``, ``"leaky_relu"``, ``"identity"`` or
        ``"algebraic"``, x / sqrt(1 + x^2): of all layers but the last, which is linear, or one
        a layer.
    leak : float
        Slope of ``"leaky_relu"`` for negative arguments, in [0, 1].

    Raises
    ------
    ModelError
        If shapes do not fit, a weight is not finite or an activation is unknown.

    Examples
    --------
    >>> from setid import neural
    >>> net = neural.Network([[[1.0, -1.0]], [[2.0]]], [[0.0], [0.5]], "relu")
    >>> net([[3.0, 1.0], [1.0, 3.0]])
    array([[4.5],
           [0.5]])
    >>> net.parameters
    5
    """

    weights: tuple[Reals, ...]
    biases: tuple[Reals, ...]
    activation: tuple[str, ...]
    leak: float

    def __init__(
        self,
        weights: Sequence[ArrayLike],
        biases: Sequence[ArrayLike],
        activation: str | Sequence[str] = "tanh",
        leak: float = 0.01,
    ) -> None:
        matrices = tuple(
            finite_array(w, f"weights[{i}]", 2)
            for i, w in enumerate(entries_of(weights, "weights", "one array a layer", ModelError))
        )
        offsets = tuple(
            finite_array(b, f"biases[{i}]", 1)
            for i, b in enumerate(entries_of(biases, "biases", "one array a layer", ModelError))
        )
        if not matrices or len(matrices) != len(offsets):
            raise ModelError(
                f"weights, biases: found {len(matrices)} and {len(offsets)} layers, expected "
                "equal numbers, at least one"
            )
        _check_shapes(matrices, offsets)
        slope = slope_of(leak)
        for key, value in {
            "weights": matrices,
            "biases": offsets,
            "activation": _activations(activation, len(matrices)),
            "leak": slope,
        }.items():
            object.__setattr__(self, key, value)

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.weights[0].shape[1]

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return self.weights[-1].shape[0]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(w.size + b.size for w, b in zip(self.weights, self.biases, strict=True))

    def __call__(self, x: ArrayLike) -> Reals:
        """Evaluate in floating point.

        Parameters
        ----------
        x : (..., inputs) float

        Returns
        -------
        (..., outputs) float
        """
        value = self._checked(x)
        for w, b, name in zip(self.weights, self.biases, self.activation, strict=True):
            value = activate(name, value @ w.T + b, self.leak)
        return np.asarray(value, float)

    def features(self, x: ArrayLike) -> Reals:
        """Evaluate all layers but the last.

        Parameters
        ----------
        x : (..., inputs) float

        Returns
        -------
        (..., width) float
        """
        value = self._checked(x)
        parts = list(zip(self.weights, self.biases, self.activation, strict=True))
        for w, b, name in parts[:-1]:
            value = activate(name, value @ w.T + b, self.leak)
        return np.asarray(value, float)

    def _checked(self, x: ArrayLike) -> Reals:
        try:
            value = np.asarray(x, float)
        except (TypeError, ValueError, OverflowError):
            raise ModelError(f"x: found {type(x).__name__}, expected real numbers") from None
        if value.shape[-1:] != (self.inputs,):
            raise ModelError(f"x: found shape {value.shape}, expected (..., {self.inputs})")
        return value

    def enclose(self, x: Interval) -> Interval:
        """Enclose the outputs over boxes of inputs.

        Parameters
        ----------
        x : Interval (..., inputs)

        Returns
        -------
        Interval (..., outputs)
        """
        return self._enclose(x, len(self.weights))

    def enclose_features(self, x: Interval) -> Interval:
        """Enclose all layers but the last over boxes of inputs."""
        return self._enclose(x, len(self.weights) - 1)

    def _enclose(self, x: Interval, layers: int) -> Interval:
        size = self.inputs
        if not isinstance(x, Interval) or not x.lo.ndim or x.lo.shape[-1] != size:
            found = f"shape {x.lo.shape}" if isinstance(x, Interval) else type(x).__name__
            raise ModelError(f"x: found {found}, expected an Interval of shape (..., {size})")
        value = x
        for w, b, name in list(zip(self.weights, self.biases, self.activation, strict=True))[
            :layers
        ]:
            value = enclose(name, affine(w, b, value), self.leak)
        return value

    def with_last_layer(self, weight: ArrayLike, bias: ArrayLike) -> Network:
        """Replace the last layer.

        Parameters
        ----------
        weight : (outputs, width) array_like
        bias : (outputs,) array_like
        """
        return Network(
            [*self.weights[:-1], weight], [*self.biases[:-1], bias], self.activation, self.leak
        )

    def __repr__(self) -> str:
        sizes = "-".join(str(w.shape[1]) for w in self.weights) + f"-{self.outputs}"
        names = ", ".join(dict.fromkeys(self.activation))
        return f"<Network: {sizes}, {names}, {self.parameters} parameters>"


def _check_shapes(matrices: tuple[Reals, ...], offsets: tuple[Reals, ...]) -> None:
    for i, (w, b) in enumerate(zip(matrices, offsets, strict=True)):
        if 0 in w.shape:
            raise ModelError(f"weights[{i}]: found shape {w.shape}, expected no empty axis")
        if b.shape != (w.shape[0],):
            raise ModelError(f"biases[{i}]: found shape {b.shape}, expected ({w.shape[0]},)")
        if i and w.shape[1] != matrices[i - 1].shape[0]:
            raise ModelError(
                f"weights[{i}]: found {w.shape[1]} columns, expected {matrices[i - 1].shape[0]}, "
                "the outputs of the layer before"
            )


def slope_of(leak: Any) -> float:
    """Read a slope of leaky ReLU: outside [0, 1] it is not monotone or not 1-Lipschitz."""
    slope = number(leak, "leak", ModelError)
    if not 0.0 <= slope <= 1.0:
        raise ModelError(f"leak: found {leak!r}, expected a number in [0, 1]")
    return slope


def _activations(given: str | Sequence[str], layers: int) -> tuple[str, ...]:
    listed = entries_of(given, "activation", "a name, or one a layer", ModelError)
    names = (given,) * (layers - 1) + ("identity",) if isinstance(given, str) else tuple(listed)
    if len(names) != layers:
        raise ModelError(f"activation: found {len(names)} names, expected {layers}, one a layer")
    for name in [given] if isinstance(given, str) else names:
        word(name, "activation", ACTIVATIONS, ModelError)
    return names
