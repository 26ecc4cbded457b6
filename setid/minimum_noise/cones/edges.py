"""Choose how a cone of denominators is split, and what it hands on to its halves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["changing_edge", "edge_weights", "handed_on", "long_edge"]

Reals = NDArray[np.float64]
_LAST = 4  # of the multipliers that a cone hands on
_POOL = 10  # that it hands on
_UNEVEN = 24  # largest power of two between the weights of an edge
_EVEN, _SHARE = 0.01, 1e-3  # of each edge, and of each vector, beside those of the dual solution
_LITTLE, _MOVED = 1.0, 6.0  # powers of two between shares that do not count, and most that do
_LEAST = 1e-300


def handed_on(shares: Reals) -> NDArray[np.int64]:
    """Number the multipliers that a cone hands on: the last ones, and those of large shares.

    Parameters
    ----------
    shares : (m,) float

    Examples
    --------
    >>> handed_on(np.array([9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    array([ 0,  1,  2,  3,  4,  5,  9, 10, 11, 12])
    """
    last = np.arange(max(0, shares.size - _LAST), shares.size)
    return np.unique(np.concatenate([last, np.argsort(-np.abs(shares))[: _POOL - _LAST]]))


def changing_edge(
    filtered: Reals, sizes: Reals, bound: Reals, products: Reals | None = None
) -> tuple[int, int, tuple[int, int]] | None:
    """Choose the edge along which a filtered multiplier changes most; None where none changes.

    Parameters
    ----------
    filtered : (K, S) float
        The multiplier filtered by each vector of the cone.
    sizes : (K,) float
        Of these, in noise.
    bound : (S,) float
        Noise bounds.
    products : (K, K) float, optional
        Dual solution: products of the shares that the vectors have in a denominator that is hard
        to refute. They weight the edges, and the new vector lies towards the larger share. By
        default all count alike.

    Returns
    -------
    i, j : int
        Numbers of the vectors.
    weights : tuple of int
        Powers of two with which they make the new one.
    """
    scaled = filtered / sizes[:, None]
    apart = np.abs(scaled[:, None] - scaled[None]) @ bound
    moved = np.zeros(sizes.size)
    if products is not None:
        apart = (products / products.sum() + _EVEN) * apart
        shares = products.sum(axis=1) / products.sum()
        moved = np.log2(shares + _SHARE)
    i, j = (int(k) for k in np.unravel_index(int(np.argmax(apart)), apart.shape))
    if i == j:
        return None
    more = moved[i] - moved[j]
    more = np.sign(more) * np.clip(abs(more) - _LITTLE, 0.0, _MOVED)
    return i, j, edge_weights(float(np.log2(sizes[j] / sizes[i]) + more))


def long_edge(
    coefficients: Reals, filtered: Reals, sizes: Reals, bound: Reals, products: Reals
) -> tuple[int, int] | None:
    """Choose an edge that is long, changes the multiplier, and is hard to refute.

    Parameters
    ----------
    coefficients : (K, n) float
        a_1 / a_0, ..., a_n / a_0 of the vectors, in widths of the feasible set.
    filtered, sizes, bound
        As of :func:`changing_edge`.
    products : (K, K) float
        Dual solution, as there; here with its root.

    Returns
    -------
    (int, int) or None
        Numbers of the vectors; None where all are the same.
    """
    scaled = filtered / sizes[:, None]
    apart = np.abs(scaled[:, None] - scaled[None]) @ bound
    length = np.abs(coefficients[:, None] - coefficients[None]).max(axis=2, initial=0.0)
    hard = np.sqrt(products / max(float(products.max()), _LEAST) + _SHARE)
    value = length / max(float(length.max()), _LEAST) * apart * hard
    i, j = (int(k) for k in np.unravel_index(int(np.argmax(value)), value.shape))
    return None if i == j else (i, j)


def edge_weights(uneven: float) -> tuple[int, int]:
    """Choose powers of two whose quotient is about 2 to a power.

    Parameters
    ----------
    uneven : float

    Examples
    --------
    >>> edge_weights(3.2), edge_weights(-1), edge_weights(1e3)
    ((8, 1), (1, 2), (16777216, 1))
    """
    power = int(np.clip(np.round(uneven), -_UNEVEN, _UNEVEN))
    return 2 ** max(power, 0), 2 ** max(-power, 0)
