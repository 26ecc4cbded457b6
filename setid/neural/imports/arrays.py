"""Networks from arrays and from ``.npz`` files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from setid import ModelError
from setid.neural.imports.layers import Path, reading, refuse_beside
from setid.neural.models.network import Network

__all__ = ["from_arrays"]


def from_arrays(
    weights: Sequence[ArrayLike] | Path,
    biases: Sequence[ArrayLike] | None = None,
    activation: str | Sequence[str] = "tanh",
    leak: float = 0.01,
) -> Network:
    """Read a network from arrays, or from an ``.npz`` file with ``W1``, ``b1``, ``W2``, ...

    Parameters
    ----------
    weights : sequence of (outputs, inputs) array_like, or path
    biases : sequence of (outputs,) array_like, optional
        Left out for a file.
    activation, leak
        As for :class:`Network`.

    Raises
    ------
    ModelError
        Naming the array that is missing or has the wrong shape.

    Examples
    --------
    >>> from setid import neural
    >>> neural.from_arrays([[[1.0, 2.0]], [[3.0]]], [[0.0], [1.0]], "relu").parameters
    5
    """
    if isinstance(weights, (str, os.PathLike)):
        refuse_beside(biases, "biases", "a file, which holds its own")
        with reading(weights, "an .npz file"), open(weights, "rb") as stream:
            file = np.load(stream, allow_pickle=False)
            held = dict(file) if isinstance(file, Mapping) else {}
        count = sum(name.startswith("W") for name in held)
        for name in (f"{letter}{i + 1}" for i in range(max(count, 1)) for letter in "Wb"):
            if name not in held:
                raise ModelError(
                    f"{os.fspath(weights)}: found no array {name}, expected W1, b1, W2, ..."
                )
        if len(held) > 2 * count:
            raise ModelError(
                f"{os.fspath(weights)}: found the arrays {', '.join(sorted(held))}, "
                f"expected W1, b1 to W{count}, b{count} alone"
            )
        return Network(
            [held[f"W{i + 1}"] for i in range(count)],
            [held[f"b{i + 1}"] for i in range(count)],
            activation,
            leak,
        )
    if biases is None:
        raise ModelError("biases: found None, expected one array a layer")
    return Network(weights, biases, activation, leak)
