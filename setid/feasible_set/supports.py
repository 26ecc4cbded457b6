"""Proved ranges of linear functions over the feasible set: multipliers by linear programs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from setid.feasible_set.feasible_set import FeasibleSet
from setid.feasible_set.proposer import Proposer
from setid.proofs import supports as proved
from setid.proofs.supports import Cover

__all__ = ["cover_of", "supports"]

Reals = NDArray[np.float64]


def cover_of(result: FeasibleSet) -> Cover:
    """Collect box and rows in theta alone that follow from a result.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    Cover

    Raises
    ------
    SetidError
        If the feasible set is empty.

    Examples
    --------
    >>> import setid
    >>> from setid.feasible_set.supports import cover_of, supports
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> supports(cover_of(result), [[1.0, 0.0]]).round(5)
    array([[-0.52326, -0.34533]])
    """
    result.require_members()
    return proved.cover(result.formulation, *result.outer_box)


def supports(cover: Cover, directions: NDArray[Any] | list[list[float]]) -> Reals:
    """Bound linear functions of theta from both sides, with proof.

    Parameters
    ----------
    cover : Cover
    directions : (K, p) float
        Coefficients of the functions.

    Returns
    -------
    (K, 2) float
        Lower and upper bounds over every consistent parameter vector.
    """
    return proved.supports(cover, directions, Proposer)
