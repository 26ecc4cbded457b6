"""Networks from torch: modules, and what ``state_dict`` holds."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from setid import ModelError
from setid.data.checks import entries_of
from setid.neural.imports.layers import (
    LEAK,
    Imported,
    Reals,
    array_of,
    arrays_of,
    bias_of,
    check_used,
    gated,
    one_slope,
    output_layer,
    reading,
    refuse_beside,
    refuse_hooks,
)
from setid.neural.models.network import Network
from setid.neural.models.recurrent import Elman
from setid.neural.training.shooting import optional

__all__ = ["from_torch"]

_ACTIVATIONS = {
    "Tanh": "tanh",
    "Sigmoid": "sigmoid",
    "ReLU": "relu",
    "LeakyReLU": "leaky_relu",
    "Identity": "identity",
}


def from_torch(
    source: Any,
    activation: str | Sequence[str] = "tanh",
    output: Any = None,
) -> Imported:
    """Read a torch module, its ``state_dict`` or a file that holds one.

    Parameters
    ----------
    source : torch.nn.Module, mapping of str to tensor, or path
        ``Linear``, ``Sequential`` of ``Linear`` and activations, ``RNN``, ``LSTM`` or ``GRU``
        (one layer, one direction; several layers for ``RNN``), without hooks. A file is loaded
        with ``weights_only=True``. Layers of a ``state_dict`` are applied in its order; where
        they differ by their numbers, these ascend.
    activation : str or sequence of str
        Used where only a ``state_dict`` is there, which does not hold it.
    output : torch.nn.Linear, mapping or (W, b), optional
        Output layer of a recurrent network, and of no other.

    Returns
    -------
    Network, Elman, LSTM or GRU
        A GRU comes with ``reset="after"`` and the update gate of the notes, which is one minus
        that of torch.

    Raises
    ------
    ModelError
        Naming the layer that is unknown, or has hooks, which compute something else than its
        weights say.

    Examples
    --------
    >>> from setid import neural
    >>> neural.from_torch({"0.weight": [[1.0, 2.0]], "0.bias": [0.5]})([1.0, 1.0])
    array([3.5])
    """
    if isinstance(source, (str, os.PathLike)):
        torch = optional("torch", "torch")
        with reading(source, "a file of torch", RuntimeError):
            source = torch.load(source, map_location="cpu", weights_only=True)
    if isinstance(source, Mapping):
        return _from_state(arrays_of(source), activation, output_layer(output))
    kind = type(source).__name__
    refuse_hooks(source, "source")
    if kind in ("Linear", "Sequential"):
        refuse_beside(output, "output", f"a {kind}, which is no recurrent network")
        return _from_sequence([source] if kind == "Linear" else list(source))
    if kind not in ("RNN", "LSTM", "GRU"):
        raise ModelError(
            f"source: found a torch module {kind}, expected Linear, Sequential, RNN, LSTM or GRU"
        )
    if getattr(source, "bidirectional", False) or getattr(source, "proj_size", 0):
        raise ModelError(f"source: found a bidirectional or projected {kind}, expected neither")
    name = getattr(source, "nonlinearity", "tanh")
    return _from_state(arrays_of(source.state_dict()), name, output_layer(output))


def _from_sequence(modules: list[Any]) -> Network:
    weights: list[Reals] = []
    biases: list[Reals] = []
    names: list[str] = []
    leaks: list[float] = []
    for place, module in enumerate(modules):
        kind = type(module).__name__
        refuse_hooks(module, f"source[{place}]")
        if kind == "Linear":
            weights.append(array_of(module.weight))
            biases.append(bias_of(module))
            names.append("identity")
        elif kind in _ACTIVATIONS and weights and names[-1] == "identity":
            names[-1] = _ACTIVATIONS[kind]
            if kind == "LeakyReLU":
                leaks.append(float(getattr(module, "negative_slope", LEAK)))
        elif kind not in ("Identity", "Dropout"):
            raise ModelError(
                f"source[{place}]: found a torch module {kind}, expected Linear "
                f"followed by one of {', '.join(_ACTIVATIONS)}"
            )
    return Network(weights, biases, names, one_slope(leaks))


def _from_state(state: dict[str, Reals], activation: str | Sequence[str], output: Any) -> Imported:
    if "weight_ih_l0" in state:
        return _recurrent(state, activation, output)
    refuse_beside(output, "output", "linear layers, which are no recurrent network")
    keys = [key[: -len("weight")] for key in state if key.endswith("weight")]
    matrices = [state[f"{key}weight"] for key in keys]
    if not keys or any(matrix.ndim != 2 for matrix in matrices):
        raise ModelError(
            f"source: found arrays {', '.join(state) or 'none'}, expected those of "
            "linear layers or of RNN, LSTM or GRU"
        )
    check_used(state, {f"{key}{part}" for key in keys for part in ("weight", "bias")})
    _ascending(keys)
    biases = [
        state.get(f"{key}bias", np.zeros(len(m))) for key, m in zip(keys, matrices, strict=True)
    ]
    return Network(matrices, biases, activation, LEAK)


def _ascending(keys: list[str]) -> None:
    """Refuse layers whose numbers do not ascend, as where files list 10 before 2."""
    last: dict[str, list[int]] = {}
    for key in keys:
        numbers = [int(digits) for digits in re.findall("[0-9]+", key)]
        stem = re.sub("[0-9]+", "#", key)
        if numbers < last.get(stem, numbers):
            raise ModelError(
                f"source: found the layers {', '.join(keys):.200} in this order, "
                "expected ascending numbers, the order in which layers are "
                "applied"
            )
        last[stem] = numbers


def _recurrent(state: dict[str, Reals], activation: str | Sequence[str], output: Any) -> Imported:
    layers = next(i for i in range(len(state) + 1) if f"weight_ih_l{i}" not in state)
    names = [
        f"{part}_{way}_l{i}"
        for i in range(layers)
        for part in ("weight", "bias")
        for way in ("ih", "hh")
    ]
    check_used(state, set(names))
    parts = []
    for i in range(layers):
        for name in (f"weight_ih_l{i}", f"weight_hh_l{i}"):
            if np.ndim(state.get(name, 0.0)) != 2 or not state[name].size:
                raise ModelError(f"source: found no matrix {name}, expected one")
        fed, back = state[f"weight_ih_l{i}"], state[f"weight_hh_l{i}"]
        zero = np.zeros(len(fed))
        parts.append(
            (fed, back, state.get(f"bias_ih_l{i}", zero), state.get(f"bias_hh_l{i}", zero))
        )
    fed, back, inner, outer = parts[0]
    count = len(back) // back.shape[1]
    if count == 1:
        cells = [(w, v, _sum(a, b)) for w, v, a, b in parts]
        return Elman(cells, output, _one_name(activation))
    if layers > 1:
        raise ModelError(f"source: found {layers} gated layers, expected one")
    if _one_name(activation) != "tanh":
        raise ModelError(
            f"activation: found {activation!r:.60}, expected tanh, that of gated layers"
        )
    return gated(fed, back, inner, outer, count, output)


def _sum(inner: Reals, outer: Reals) -> Reals:
    """The bias of a recurrent layer, of which libraries keep two."""
    if inner.shape != outer.shape:
        raise ModelError(
            f"source: found biases of the shapes {inner.shape} and {outer.shape}, "
            "expected equal ones"
        )
    return inner + outer


def _one_name(activation: str | Sequence[str]) -> str:
    """The activation of all recurrent layers."""
    listed = entries_of(activation, "activation", "a name", ModelError)
    names = {activation} if isinstance(activation, str) else set(map(str, listed))
    if len(names) != 1:
        raise ModelError(
            f"activation: found {activation!r:.60}, expected one for all recurrent layers"
        )
    return str(names.pop())
