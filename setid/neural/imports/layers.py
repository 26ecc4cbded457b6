"""Parts of all readers of networks: numbers of tensors, output layers, gates, refusals."""

from __future__ import annotations

import os
import pickle
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from setid import ModelError
from setid.data.checks import real_array
from setid.neural.models.network import Network
from setid.neural.models.recurrent import GRU, LSTM, Elman

__all__ = [
    "LEAK",
    "Imported",
    "Path",
    "Reals",
    "array_of",
    "arrays_of",
    "bias_of",
    "check_used",
    "gated",
    "one_slope",
    "output_layer",
    "reading",
    "refuse_beside",
    "refuse_hooks",
]

Reals = NDArray[np.float64]
Path = str | os.PathLike[str]
Imported = Network | Elman | LSTM | GRU
LEAK = 0.01  # slope of leaky ReLU where nothing is said


@contextmanager
def reading(path: Path, what: str, *others: type[Exception]) -> Iterator[None]:
    """Raise ModelError that names a file which cannot be read, and says why."""
    damaged: tuple[type[Exception], ...] = (
        ValueError,
        EOFError,
        BadZipFile,
        pickle.UnpicklingError,
        zlib.error,
        *others,
    )
    try:
        yield
    except OSError as error:
        raise ModelError(f"{os.fspath(path)}: {error.strerror or error}, expected {what}") from None
    except damaged as error:
        raise ModelError(f"{os.fspath(path)}: {error!s:.300}, expected {what}") from None


def refuse_beside(given: Any, field: str, beside: str) -> None:
    """Refuse an argument that would be without effect."""
    if given is not None:
        raise ModelError(f"{field}: found {given!r:.60} beside {beside}, expected None")


def array_of(tensor: Any, field: str = "source") -> Reals:
    """Convert a tensor of any library to doubles."""
    try:
        if hasattr(tensor, "is_floating_point") and tensor.is_floating_point():
            tensor = tensor.double()  # numpy knows no bfloat16
        for step in ("detach", "to_dense", "cpu", "numpy"):
            tensor = getattr(tensor, step)() if hasattr(tensor, step) else tensor
    except (TypeError, RuntimeError) as error:  # such as tensors without data
        raise ModelError(f"{field}: {error!s:.200}, expected real numbers") from None
    return real_array(tensor, field, ModelError)


def arrays_of(state: Mapping[str, Any], field: str = "source") -> dict[str, Reals]:
    """Convert the tensors of a mapping to doubles."""
    return {str(key): array_of(value, f"{field}[{key!r}]") for key, value in state.items()}


def bias_of(layer: Any, field: str = "source") -> Reals:
    """Take the bias of a linear layer, zeros (outputs,) where it has none."""
    if layer.bias is None:
        return np.zeros(array_of(layer.weight, field).shape[:1])
    return array_of(layer.bias, field)


def output_layer(given: Any) -> Any:
    """Take the output layer of a recurrent network as (W, b)."""
    if given is None or isinstance(given, Network):
        return given
    if isinstance(given, Mapping):
        state = arrays_of(given, "output")
        if "weight" not in state or not state["weight"].ndim:
            raise ModelError(
                f"output: found arrays {', '.join(state) or 'none'}, expected weight "
                "and bias of a linear layer"
            )
        check_used(state, {"weight", "bias"}, "output")
        return state["weight"], state.get("bias", np.zeros(len(state["weight"])))
    if hasattr(given, "weight"):
        kind = type(given).__name__
        if kind != "Linear":
            raise ModelError(f"output: found a module {kind}, expected Linear or (W, b)")
        refuse_hooks(given, "output")
        return array_of(given.weight, "output"), bias_of(given, "output")
    return given


def refuse_hooks(module: Any, field: str) -> None:
    """Refuse a torch module that computes something else than its weights say.

    Hooks change inputs and outputs, or make the weights anew in each call, as weight_norm,
    spectral_norm and pruning do.
    """
    for name in ("_forward_hooks", "_forward_pre_hooks"):
        if getattr(module, name, None):
            raise ModelError(
                f"{field}: found a {type(module).__name__} with forward hooks, as of "
                "weight_norm, spectral_norm or pruning, expected none: make the "
                "weights permanent (remove_weight_norm, prune.remove)"
            )


def check_used(state: dict[str, Reals], names: set[str], field: str = "source") -> None:
    """Refuse arrays that belong to no known layer: without them the network would be another."""
    rest = sorted(set(state) - names)
    if rest:
        raise ModelError(
            f"{field}: found {', '.join(rest):.200} beside known layers, expected the "
            "arrays of linear layers alone, or of RNN, LSTM or GRU alone"
        )


def one_slope(leaks: list[float]) -> float:
    """Take the slope of the leaky ReLUs of a network, which all have the same."""
    if len(set(leaks)) > 1:
        raise ModelError(
            f"source: found leaky ReLUs of the slopes {sorted(set(leaks))}, expected one slope"
        )
    return leaks[0] if leaks else LEAK


def gated(
    fed: Reals, back: Reals, inner: Reals, outer: Reals, count: int, output: Any
) -> LSTM | GRU:
    """Make a network of gates stacked as (i, f, g, o) of LSTM or (r, z, n) of GRU."""
    rows = [np.shape(a)[0] if np.ndim(a) else 0 for a in (fed, back, inner, outer)]
    if len(set(rows)) > 1 or not rows[0] or rows[0] % count:
        raise ModelError(
            f"source: found weights and biases with {rows} rows, expected equal "
            f"multiples of {count} gates"
        )
    split = [np.split(a, count) for a in (fed, back, inner, outer)]
    gate = [(w, v, a + b) for w, v, a, b in zip(*split, strict=True)]
    if count == 4:
        return LSTM(gate[1], gate[0], gate[3], gate[2], output)
    if count != 3:
        raise ModelError(f"source: found {count} gates, expected 1 (RNN), 3 (GRU) or 4 (LSTM)")
    w, v, b = gate[1]
    candidate = (split[0][2], split[1][2], split[2][2], split[3][2])
    return GRU((-w, -v, -b), gate[0], candidate, output, reset="after")
