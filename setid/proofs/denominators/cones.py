"""Cones of denominators: the first ones, and how they are split.

The first ones are spanned by the coefficients of (1 - q)^j (1 + q)^(n - j) with all signs, a basis.
A polynomial whose zeros lie in the closed unit disc is, up to its sign, a combination of these with
coefficients >= 0: the bilinear transformation makes them the coefficients of a Hurwitz polynomial
(A. T. Fam, J. S. Meditch, *IEEE Trans. Automatic Control* 23 (1978) 454-458). Cones are split at
an edge.
"""

from __future__ import annotations

from itertools import product
from math import gcd

import numpy as np
from numpy.typing import NDArray

__all__ = ["Cone", "first_cones", "split_cone"]

Cone = NDArray[np.object_]  # rows of Python's integers
_LARGEST_ENTRY = 2**400  # of a vector: its doubles are finite


def first_cones(order: int, stable: bool) -> list[Cone]:
    """List vectors (n + 1, n + 1) that span the first cones, one a row.

    Parameters
    ----------
    order : int
    stable : bool
        The zeros lie in the closed unit disc; otherwise the cones and their negatives are all
        of space.

    Examples
    --------
    >>> first_cones(1, True)[0].tolist()
    [[1, 1], [1, -1]]
    """
    basis = []
    for j in range(order + 1):
        factors = [np.array([1, -1])] * j + [np.array([1, 1])] * (order - j)
        vector = np.ones(1, np.int64)
        for factor in factors:
            vector = np.convolve(vector, factor)
        basis.append(vector.tolist())
    signs = [(1,) * order] if stable else list(product((1, -1), repeat=order))
    return [
        np.array([[1], *([s] for s in more)], object) * np.array(basis, object) for more in signs
    ]


def split_cone(
    cone: Cone, edge: tuple[int, int], weights: tuple[int, int]
) -> tuple[Cone, Cone] | None:
    """Split a cone at a vector on an edge; None where it is no such vector.

    Parameters
    ----------
    cone : (n + 1, n + 1) int
    edge : (int, int)
        Numbers of two of its vectors.
    weights : (int, int)
        Positive: the new vector is a multiple of their sum with these weights.
    """
    (i, j), (one, two) = edge, weights
    if not (0 <= i < len(cone) and 0 <= j < len(cone) and i != j and min(weights) > 0):
        return None
    made = [one * a + two * b for a, b in zip(cone[i], cone[j], strict=True)]
    divisor = gcd(*made) or 1
    made = [value // divisor for value in made]
    if max(map(abs, made)) > _LARGEST_ENTRY:
        return None
    below, above = cone.copy(), cone.copy()
    below[i] = above[j] = made
    return below, above
