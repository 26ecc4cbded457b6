"""Models from jax-sysid, and networks of flax in them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np

from setid import ModelError
from setid.data.checks import entries_of, natural
from setid.neural.imports.layers import Reals, array_of
from setid.neural.models.network import Network
from setid.neural.models.recurrent import NeuralStateSpace

__all__ = ["from_jax_sysid"]


def from_jax_sysid(
    source: Any, activation: str = "tanh", order: Sequence[int] | None = None
) -> NeuralStateSpace:
    """Read an ``RNN`` (flax ``Dense`` layers) or a ``LinearModel`` of jax-sysid.

    Parameters
    ----------
    source : jax_sysid model
        Fitted or not; its ``params`` are read.
    activation : str
        Of the hidden layers; the functions themselves are never called.
    order : sequence of int, optional
        Order in which the ``Dense`` layers are applied, by their numbers; asked for only where
        their shapes allow several.

    Returns
    -------
    NeuralStateSpace

    Raises
    ------
    ModelError
        If the arrays are not those of such a model.
    """
    missing = [name for name in ("params", "nx", "nu", "ny") if not hasattr(source, name)]
    if missing:
        raise ModelError(
            f"source: found {type(source).__name__} without {', '.join(missing)}, "
            "expected a model of jax-sysid"
        )
    listed = entries_of(source.params, "source.params", "a list of arrays", ModelError)
    params = [array_of(p, f"source.params[{i}]") for i, p in enumerate(listed)]
    nx, nu, ny = (
        natural(getattr(source, n), f"source.{n}", ModelError) for n in ("nx", "nu", "ny")
    )
    if getattr(source, "isLinear", False):
        return _linear_model(params, nx, nu, ny, bool(source.y_in_x))
    split = getattr(source, "nthx", None)
    if split is None:
        raise ModelError(
            f"source: found {type(source).__name__} with its own functions, expected "
            "RNN or LinearModel; build NeuralStateSpace from its arrays"
        )
    transition = _flax(params[:split], nx, nu, nx, activation, order)
    if source.y_in_x:
        shown = np.hstack([np.zeros((ny, nu)), np.eye(ny, nx)])
        return NeuralStateSpace(transition, Network([shown], [np.zeros(ny)]))
    return NeuralStateSpace(transition, _flax(params[split:], nx, nu, ny, activation, order))


def _linear_model(params: list[Reals], nx: int, nu: int, ny: int, shown: bool) -> NeuralStateSpace:
    usual = [np.zeros((nx, nx)), np.zeros((nx, nu)), np.eye(ny, nx), np.zeros((ny, nu))]
    given = [*params, *usual[len(params) :]] if 2 <= len(params) <= 4 else []
    if [p.shape for p in given] != [p.shape for p in usual]:
        raise ModelError(
            f"source.params: found the shapes {[p.shape for p in params]}, expected "
            f"A, B, C and D of {nx} states, {nu} inputs and {ny} outputs"
        )
    a, b, c, d = given
    c = usual[2] if shown else c
    return NeuralStateSpace(
        Network([np.hstack([b, a])], [np.zeros(nx)]), Network([np.hstack([d, c])], [np.zeros(ny)])
    )


def _flax(
    params: list[Reals], nx: int, nu: int, ends: int, activation: str, order: Sequence[int] | None
) -> Network:
    """Dense layers (bias, kernel) of flax; the first takes [x, u].

    Flax names layers in the order in which they are built, not applied, so that the order is
    taken from the shapes where these leave only one.
    """
    if len(params) % 2 or any(p.ndim != 1 + i % 2 for i, p in enumerate(params)):
        raise ModelError("source.params: found other arrays than (bias, kernel) of Dense layers")
    biases, kernels = params[0::2], params[1::2]
    count = len(kernels)
    fits = [
        choice
        for choice in (permutations(range(count)) if order is None else [_order(order)])
        if sorted(choice) == list(range(count))
        and [nx + nu, *(kernels[i].shape[1] for i in choice)]
        == [*(kernels[i].shape[0] for i in choice), ends]
    ]
    if len(fits) != 1:
        shapes = ", ".join(str(k.shape) for k in kernels)
        raise ModelError(
            f"source.params: found {len(fits)} orders in which layers of shapes {shapes} make a "
            f"chain from {nx + nu} to {ends}, expected one: pass order="
        )
    weights = [kernels[i].T for i in fits[0]]
    weights[0] = np.hstack([weights[0][:, nx:], weights[0][:, :nx]])
    return Network(weights, [biases[i] for i in fits[0]], activation)


def _order(given: Any) -> tuple[Any, ...]:
    return tuple(entries_of(given, "order", "numbers of layers", ModelError))
