"""The least largest error of a linear approximation, by single exchanges.

A reference of c + 1 samples has a level, the least largest error of c columns at these samples. The
sample with the largest error of all takes the place of one of them, so that the level rises
(E. Stiefel, *Numerische Mathematik* 2 (1960) 1-17). It is the dual simplex method, and as there a
small pivot spoils the inverse: among the samples that may leave the one with the largest pivot
does (P. M. J. Harris, *Mathematical Programming* 5 (1973) 1-28). Columns that decay need that:
few samples tell of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

__all__ = ["Approximation", "approximated"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_EXCHANGES = 120
_AGAIN = 30  # exchanges after which the inverse is computed anew
_ALMOST = 1e-3  # of a level: where exchanges end
_PIVOT, _SLIP = 1e-9, 1e-9  # least pivot, and what a share may be below zero


class Approximation(NamedTuple):
    """Columns near a target.

    Parameters
    ----------
    level : float
        The error that is left.
    shares : (m,) float
        Dual solution at the reference; for the largest error their sizes sum up to 1.
    reference : (m,) int
        Samples.
    coefficients : (c,) float
        Of the columns.
    """

    level: float
    shares: Reals
    reference: Integers
    coefficients: Reals


def approximated(
    basis: Reals, target: Reals, reference: Integers | None = None
) -> Approximation | None:
    """Approximate a target by columns in the largest error.

    Parameters
    ----------
    basis : (S, c) float
        Orthonormal columns.
    target : (S,) float
    reference : (c + 1,) int, optional
        Samples to begin from; those at which the columns differ most where it is left out, or does
        not serve.

    Returns
    -------
    Approximation or None
        With a reference of c + 1 samples; None where the exchanges do not end.

    Examples
    --------
    >>> import numpy as np
    >>> found = approximated(np.full((4, 1), 0.5), np.array([0.0, 1.0, 5.0, 3.0]))
    >>> found.level, found.coefficients
    (2.5, array([5.]))
    """
    found = None if reference is None else _exchanged(basis, target, reference)
    if found is None:
        order = qr(basis.T, mode="r", pivoting=True)[1]
        found = _exchanged(basis, target, order[: basis.shape[1] + 1])
    return found


def _exchanged(basis: Reals, target: Reals, reference: Integers) -> Approximation | None:
    """Exchange samples of a reference one by one until the largest error is at one of them."""
    count, reference = basis.shape[1], reference.copy()
    try:
        weights = np.linalg.svd(basis[reference].T)[2][-1]
        signs = np.where(weights * np.sign(weights @ target[reference] or 1.0) >= 0, 1.0, -1.0)
        inverse = np.linalg.inv(_columns(basis, reference, signs))
        for step in range(_EXCHANGES):
            solved = (signs * target[reference]) @ inverse
            errors = target - basis @ solved[:count]
            worst = int(np.argmax(np.abs(errors)))
            level = abs(float(errors[worst]))
            if level <= solved[count] * (1.0 + _ALMOST) + 1e-14:
                if np.any(
                    np.abs(signs * errors[reference] - solved[count]) > _ALMOST * level + 1e-14
                ):
                    return None  # the inverse is spoilt
                shares = np.asarray(inverse[:, -1] * signs, np.float64)
                return Approximation(level, shares, reference, solved[:count])
            sign = 1.0 if errors[worst] > 0 else -1.0
            along = inverse @ np.append(sign * basis[worst], 1.0)
            place = _leaving(inverse[:, -1], along)
            if place is None:
                return None
            reference[place], signs[place] = worst, sign
            row = inverse[place] / along[place]
            inverse = inverse - np.outer(along, row)
            inverse[place] = row
            if (step + 1) % _AGAIN == 0:
                inverse = np.linalg.inv(_columns(basis, reference, signs))
    except np.linalg.LinAlgError:
        pass
    return None


def _leaving(shares: NDArray[Any], along: NDArray[Any]) -> int | None:
    """Choose the sample that leaves: the largest pivot among those almost first.

    A small pivot would spoil the inverse.
    """
    usable = along > _PIVOT
    if not np.any(usable):
        return None
    least = np.min((shares[usable] + _SLIP) / along[usable])
    first = usable & (shares <= least * along)
    return int(np.argmax(np.where(first, along, 0.0)))


def _columns(basis: Reals, reference: Integers, signs: Reals) -> Reals:
    return np.vstack([(basis[reference] * signs[:, None]).T, np.ones(reference.size)])
