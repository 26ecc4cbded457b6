"""Origin and scales about an attained point, for objectives without bounds.

Coefficients of powers of x - a reach a^d, and cancel near a. Moved there, the same polynomial is
small where it is small: about the attained point, with scales at which the powers of each
variable reach the size of its value, Gram matrices are regular.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.box.scaling import Scaling

__all__ = ["about_the_point", "cancels"]

_CANCELS = 1e4  # times the value: terms of that size hide what is left of them
_MOST_SCALE = 2.0**40


def cancels(objective: Polynomial, x: NDArray[np.float64]) -> bool:
    """Check that terms of an objective are far larger at x than their sum.

    Parameters
    ----------
    objective : Polynomial
    x : (n,) float

    Returns
    -------
    bool
    """
    with np.errstate(over="ignore"):
        terms = np.abs(objective.coefficients) * monomials.evaluate(objective.words, np.abs(x))
    return bool(np.sum(terms) > _CANCELS * (1.0 + abs(objective(x))))


def about_the_point(objective: Polynomial, x: NDArray[np.float64]) -> Scaling:
    """Move the origin to x and choose scales, powers of two.

    Parameters
    ----------
    objective : Polynomial
    x : (n,) float

    Returns
    -------
    Scaling
        Without a box.
    """
    n = objective.dimension
    nowhere, ones = np.zeros(n, bool), np.ones(n)
    moved = Scaling.about(x, ones, nowhere).expand(PolynomialSystem.stack([objective], n))
    size = 1.0 + abs(objective(x))
    scale = np.full(n, _MOST_SCALE)
    for word, value in zip(moved.words, moved.coefficients.tolist(), strict=True):
        letters = word[word > 0]
        if letters.size % 2 == 0 and letters.size and np.all(letters == letters[0]):
            reach = (size / abs(value)) ** (1.0 / letters.size)
            scale[letters[0] - 1] = min(scale[letters[0] - 1], reach)
    return Scaling.about(x, 2.0 ** np.round(np.log2(scale)), nowhere)
