"""Networks from modules of equinox."""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numpy as np

from setid import ModelError
from setid.neural.imports.layers import (
    Imported,
    array_of,
    bias_of,
    gated,
    output_layer,
    refuse_beside,
)
from setid.neural.models.network import Network

__all__ = ["from_equinox"]

_ACTIVATIONS = {
    "tanh": "tanh",
    "sigmoid": "sigmoid",
    "relu": "relu",
    "leaky_relu": "leaky_relu",
    "_identity": "identity",
    "identity": "identity",
}


def from_equinox(
    source: Any, activation: str | None = None, output: Any = None, final: str | None = None
) -> Imported:
    """Read ``Linear``, ``MLP``, ``LSTMCell`` or ``GRUCell`` of equinox.

    Parameters
    ----------
    source : equinox module
    activation : str, optional
        Of the hidden layers; read from the module's function where left out.
    output : equinox Linear or (W, b), optional
        Output layer of a cell, and of nothing else.
    final : str, optional
        Activation of the last layer; where left out it is read likewise, and equinox's own
        default is the identity.

    Returns
    -------
    Network, LSTM or GRU
        A GRU comes with ``reset="after"``.

    Raises
    ------
    ModelError
        Naming the module or the activation that is unknown: functions of jax and equinox are
        known by their names, a function of your own never is.
    """
    kind = type(source).__name__
    parts = {"Linear": ("weight", "bias"), "MLP": ("layers", "activation", "final_activation")}
    missing = [name for name in parts.get(kind, ()) if not hasattr(source, name)]
    if missing:
        raise ModelError(
            f"source: found {kind} without {', '.join(missing)}, expected a module of equinox"
        )
    if kind in ("Linear", "MLP"):
        refuse_beside(output, "output", f"{kind}, which is no recurrent cell")
    if kind == "MLP":
        return _mlp(source, activation, final)
    for field, given in (("activation", activation), ("final", final)):
        refuse_beside(given, field, f"{kind}, whose activations are fixed")
    if kind == "Linear":
        return Network([array_of(source.weight)], [bias_of(source)], "identity")
    if kind not in ("LSTMCell", "GRUCell"):
        raise ModelError(
            f"source: found an equinox module {kind}, expected Linear, MLP, LSTMCell or GRUCell"
        )
    fed, back = array_of(source.weight_ih), array_of(source.weight_hh)
    inner = np.zeros(len(fed)) if source.bias is None else array_of(source.bias)
    outer = np.zeros(len(fed))
    if kind == "GRUCell" and getattr(source, "bias_n", None) is not None:
        extra = array_of(source.bias_n, "source.bias_n")
        if 3 * extra.size != len(fed):
            raise ModelError(
                f"source.bias_n: found shape {extra.shape}, expected ({len(fed) // 3},)"
            )
        outer[-extra.size :] = extra.ravel()
    count = 4 if kind == "LSTMCell" else 3
    return gated(fed, back, inner, outer, count, output_layer(output))


def _mlp(source: Any, activation: str | None, final: str | None) -> Network:
    layers = list(source.layers)
    for place, layer in enumerate(layers):
        if type(layer).__name__ != "Linear":
            raise ModelError(
                f"source.layers[{place}]: found {type(layer).__name__}, expected Linear"
            )
    hidden = activation or _function_name(source.activation, "activation")
    final = final or _function_name(source.final_activation, "final_activation")
    names = [hidden] * (len(layers) - 1) + [final]
    return Network([array_of(m.weight) for m in layers], [bias_of(m) for m in layers], names)


def _function_name(function: Any, field: str) -> str:
    """Find the activation that a function of jax or equinox is called after.

    Wrappers bear the name of what they wrap, so that each plain function on the way counts:
    one from elsewhere, or whose code has another name, computes something else.
    """
    chain = [function]
    while hasattr(chain[-1], "__wrapped__"):
        chain.append(chain[-1].__wrapped__)
    last = chain[-1]
    name = getattr(last, "__name__", type(last).__name__)
    plain = [part for part in chain if isinstance(part, FunctionType)]
    homes = {str(part.__globals__.get("__name__")).partition(".")[0] for part in plain}
    known = homes <= {"jax", "equinox"} and {part.__code__.co_name for part in plain} <= {name}
    found = "identity" if name == "<lambda>" and homes == {"equinox"} else _ACTIVATIONS.get(name)
    if found is None or not known:
        raise ModelError(
            f"{field}: found the function {name}, expected a known name of jax or equinox: pass "
            "activation= or final="
        )
    return found
