"""Many polynomials of few terms each, made at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial, _checked_labels, _checked_terms
from sparsepop_py.budget import check

__all__ = ["polynomial_rows"]


def polynomial_rows(
    words: Words,
    coefficients: NDArray[np.float64],
    dimension: int,
    names: Sequence[str] | None = None,
) -> list[Polynomial]:
    """Make a polynomial of each row, as :meth:`Polynomial.from_words` does one by one.

    Parameters
    ----------
    words : (R, T, D) int
        Monomials, each with its variables (from 1) in ascending order after zeros.
    coefficients : (R, T) float
        Terms with 0 are left out.
    dimension : int
        Number of variables n.
    names : sequence of str, optional

    Returns
    -------
    list of Polynomial

    Raises
    ------
    ProblemError
        If an array is anything else, or a coefficient is not finite.

    Examples
    --------
    >>> words = np.array([[[0, 0], [1, 2]], [[2, 2], [0, 1]]])
    >>> for row in polynomial_rows(words, np.array([[1.0, 3.0], [2.0, 0.0]]), 2):
    ...     print(row)
    1 + 3*x1*x2
    2*x2^2
    """
    if not len(words):
        return []
    labels = _checked_labels(names, dimension)
    flat, values = _checked_terms(np.concatenate(words), np.concatenate(coefficients), dimension)
    words, values = flat.reshape(*words.shape[:2], -1), values.reshape(words.shape[:2])
    used, size = values != 0.0, values.size
    number = monomials.collect(flat, dimension)[1].reshape(values.shape)  # in graded order
    number = np.where(used, number, size)
    order = np.argsort(number, axis=1, kind="stable")
    number = np.take_along_axis(number, order, axis=1)
    twice = np.any((number[:, 1:] == number[:, :-1]) & (number[:, 1:] < size), axis=1)
    width = np.where(used, monomials.degrees(words), 1).max(axis=1, initial=1)
    first = words.shape[2] - width
    count = np.count_nonzero(used, axis=1)
    in_order = np.take_along_axis(words, order[:, :, None], axis=1)
    sorted_values = np.take_along_axis(values, order, axis=1)
    made: list[Polynomial] = []
    for row, terms in enumerate(count.tolist()):
        check()
        if twice[row]:
            made.append(Polynomial.from_words(words[row], values[row], dimension, names))
            continue
        word = in_order[row, :terms, int(first[row]) :].copy()
        value = sorted_values[row, :terms].copy()
        made.append(Polynomial._of_sorted(word, value, dimension, labels))
    return made
