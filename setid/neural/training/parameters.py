"""Weights of a network as one vector and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from setid.neural.models.network import Network

__all__ = ["flatten", "unflatten"]

Reals = NDArray[np.float64]


def flatten(network: Network) -> Reals:
    """Stack weights and biases, layer by layer, rows of weights first."""
    parts = zip(network.weights, network.biases, strict=True)
    return np.concatenate([np.concatenate([w.ravel(), b]) for w, b in parts])


def unflatten(network: Network, theta: Reals) -> Network:
    """Make a network of the same shapes with other weights."""
    weights, biases, at = [], [], 0
    for w, b in zip(network.weights, network.biases, strict=True):
        weights.append(theta[at : at + w.size].reshape(w.shape))
        biases.append(theta[at + w.size : at + w.size + b.size])
        at += w.size + b.size
    return Network(weights, biases, network.activation, network.leak)
