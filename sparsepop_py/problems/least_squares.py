"""Least-squares problems with many squares of one shape, as arrays.

Objective and ``squares`` of a problem come from the same numbers, whose products and sums
are exact in double precision: a stated optimum is that of the very doubles in the problem.
"""

from __future__ import annotations

import numbers
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError, check_whole, shown
from sparsepop_py.problem.problem import Problem

__all__ = ["MOST", "Squares", "Term", "check_size", "least_squares"]

MOST = 10**6  # variables, each with some terms

Term = tuple[float, Sequence[int | NDArray[Any]]]


@dataclass(frozen=True, eq=False)
class Squares:
    """``weight * sum_{m, g} (sum_t coefficients[m, g, t] * words[m, t])^2``.

    ``words`` is (M, T, D) with sorted letters and distinct words in each m.
    """

    weight: float
    words: Words
    coefficients: NDArray[np.float64]

    @staticmethod
    def build(weight: float, centres: NDArray[Any], terms: Sequence[Term], n: int) -> Squares:
        """Build one square for each i in ``centres``.

        A term (c, [a, b]) stands for c x_{i+a} x_{i+b}. A shift is a number, or an array with one
        for each centre. Variables outside 1..n are zero, and so are the terms that contain them.
        """
        width = max(len(shifts) for _, shifts in terms)
        words = np.zeros((centres.size, len(terms), width), np.int32)
        coefficients = np.zeros((centres.size, 1, len(terms)))
        for t, (coefficient, shifts) in enumerate(terms):
            letters = np.array([centres + shift for shift in shifts], np.int64)
            letters = letters.reshape(len(shifts), centres.size).T
            inside = np.all((letters >= 1) & (letters <= n), axis=1)
            words[inside, t, width - len(shifts) :] = letters[inside]
            coefficients[inside, 0, t] = coefficient
        words.sort(axis=-1)
        return Squares(weight, words, coefficients)

    def expanded(self) -> tuple[Words, NDArray[np.float64]]:
        """Multiply out the sum: words (N, 2 D) and coefficients (N,), equal words not merged."""
        gram = self.weight * np.einsum("mgs,mgt->mst", self.coefficients, self.coefficients)
        s, t = np.triu_indices(self.words.shape[1])
        values = gram[:, s, t] * np.where(s == t, 1.0, 2.0)
        kept = values != 0.0
        words = monomials.multiply(self.words[:, s], self.words[:, t])
        return words[kept], values[kept]

    def polynomials(self, n: int) -> Iterator[Polynomial]:
        """Yield the squared polynomials, each in its normal form, without zeros."""
        count, terms, width = self.words.shape
        keys = monomials.pack(self.words.reshape(-1, width), n).reshape(count, terms)
        order = np.argsort(keys, axis=1)
        words = np.take_along_axis(self.words, order[:, :, None], axis=1)
        coefficients = np.take_along_axis(self.coefficients, order[:, None, :], axis=2)
        present = coefficients != 0.0
        degree = np.where(present, monomials.degrees(words)[:, None, :], 0).max(axis=-1)
        for m, g in np.argwhere(present.any(axis=-1)).tolist():
            kept = present[m, g]
            letters = words[m, kept, width - max(1, int(degree[m, g])) :]
            values = coefficients[m, g, kept]
            yield Polynomial._of_sorted(letters, values, n)


def least_squares(
    n: int,
    constant: float,
    *families: Squares,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Problem:
    """Build a problem from a constant plus sums of squares, expanded.

    The squares are kept beside the objective.
    """
    parts = [(np.zeros((1, 1), np.int32), np.array([constant]))]
    parts += [family.expanded() for family in families]
    words = monomials.stack(words for words, _ in parts)
    values = np.concatenate([values for _, values in parts])
    objective = Polynomial._merged(words, values, n)
    squares = [(f.weight, p) for f in families for p in f.polynomials(n)]
    return Problem(objective, lower=lower, upper=upper, squares=squares)


def check_size(n: int, least: int, multiple: int = 1, field: str = "n") -> None:
    """Refuse sizes that are no multiple, too small, or too large to hold."""
    if multiple > 1 and (not isinstance(n, numbers.Integral) or int(n) < least or n % multiple):
        raise ProblemError(
            f"{field}: found {shown(n)}, expected a multiple of {multiple}, at least {least}"
        )
    check_whole(n, field, least, MOST)
