"""Many polynomials stacked into one sparse object, for values and derivatives.

Row i holds polynomial i. Distinct monomials are evaluated once; values and
Jacobians are sparse products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["PolynomialSystem"]


@dataclass(frozen=True, eq=False)
class PolynomialSystem(ReadOnly):
    """Stacked polynomials.

    Parameters
    ----------
    words : (T, D) int32
        The monomial of each term, repeated when several rows share it.
    coefficients : (T,) float
    row : (T,) int
        The polynomial of each term, ascending.
    size : int
        Number of polynomials m.
    dimension : int
        Number of variables n.
    """

    words: Words
    coefficients: NDArray[np.float64]
    row: NDArray[np.int64]
    size: int
    dimension: int

    @staticmethod
    def stack(polynomials: Sequence[Polynomial], dimension: int) -> PolynomialSystem:
        """Stack polynomials in ``dimension`` variables, in read-only arrays."""
        words = [*(p.words for p in polynomials), np.zeros((0, 1), np.int32)]
        counts = [p.terms for p in polynomials]
        arrays = (
            monomials.stack(words),
            np.concatenate([*(p.coefficients for p in polynomials), np.zeros(0)]),
            np.repeat(np.arange(len(polynomials)), np.array(counts, int)),
        )
        for array in arrays:
            array.flags.writeable = False
        return PolynomialSystem(*arrays, len(polynomials), dimension)

    def take(self, rows: NDArray[Any]) -> PolynomialSystem:
        """Select rows, in the order given."""
        number = np.full(self.size, -1)
        number[rows] = np.arange(len(rows))
        keep = np.flatnonzero(number[self.row] >= 0)
        keep = keep[np.argsort(number[self.row[keep]], kind="stable")]
        return PolynomialSystem(
            self.words[keep],
            self.coefficients[keep],
            number[self.row[keep]],
            len(rows),
            self.dimension,
        )

    def without(self, rows: NDArray[Any]) -> PolynomialSystem:
        """Empty the chosen rows."""
        gone = np.zeros(self.size, bool)
        gone[rows] = True
        keep = np.flatnonzero(~gone[self.row])
        return PolynomialSystem(
            self.words[keep], self.coefficients[keep], self.row[keep], self.size, self.dimension
        )

    def terms_of(self, rows: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """List terms of the chosen rows: position in ``rows`` and term number, both (L,)."""
        first = np.searchsorted(self.row, np.arange(self.size + 1))
        count = first[rows + 1] - first[rows]
        position = np.repeat(np.arange(len(rows)), count)
        within = np.arange(position.size) - (np.cumsum(count) - count)[position]
        return position, first[rows][position] + within

    def values(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Evaluate at ``x`` of shape (n,), giving (m,)."""
        with np.errstate(over="ignore", invalid="ignore"):  # inf or NaN where doubles end
            terms = self.coefficients * monomials.evaluate(self.words, x)
        return np.bincount(self.row, weights=terms, minlength=self.size).astype(float)

    @cached_property
    def _gradient(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], Words]:
        """Terms of all partial derivatives: row, variable, coefficient, word."""
        term, variable, power = monomials.runs(self.words)
        words = self.words[term].copy()
        slot = np.argmax(words == (variable + 1)[:, None], axis=1)
        words[np.arange(term.size), slot] = 0
        words.sort(axis=1)
        return self.row[term], variable, self.coefficients[term] * power, words

    def gradient(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Evaluate the gradient of the only row at ``x``, shape (n,)."""
        _, variable, coefficient, words = self._gradient
        with np.errstate(over="ignore", invalid="ignore"):  # inf or NaN where doubles end
            values = coefficient * monomials.evaluate(words, x)
        return np.bincount(variable, weights=values, minlength=self.dimension).astype(float)

    @cached_property
    def gradient_system(self) -> PolynomialSystem:
        """The partial derivatives of the only row, as n rows; its Jacobian is the Hessian."""
        _, variable, coefficient, words = self._gradient
        order = np.argsort(variable, kind="stable")
        return PolynomialSystem(
            words[order], coefficient[order], variable[order], self.dimension, self.dimension
        )

    @cached_property
    def _places(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
        """Rows and variables of the Jacobian's entries, and the entry of each derivative term."""
        row, variable, *_ = self._gradient
        keys, entry = np.unique(row * self.dimension + variable, return_inverse=True)
        rows, columns = np.divmod(keys, max(self.dimension, 1))
        return rows.astype(np.int32), columns.astype(np.int32), entry

    def jacobian_places(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """List rows and variables of the entries of :meth:`slopes`, ascending."""
        return self._places[:2]

    def slopes(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Evaluate the entries of the Jacobian at ``x`` that are not zero everywhere."""
        _, _, coefficient, words = self._gradient
        rows, _, entry = self._places
        with np.errstate(over="ignore", invalid="ignore"):
            values = coefficient * monomials.evaluate(words, x)
        return np.bincount(entry, weights=values, minlength=rows.size).astype(float)

    def dense_jacobian(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Evaluate the Jacobian at ``x`` of shape (n,), dense (m, n)."""
        matrix = np.zeros((self.size, self.dimension))
        matrix[self.jacobian_places()] = self.slopes(x)
        return matrix

    def jacobian(self, x: NDArray[Any]) -> sps.csr_array:
        """Evaluate the Jacobian at ``x`` of shape (n,), sparse (m, n)."""
        rows, columns = self.jacobian_places()
        first = np.searchsorted(rows, np.arange(self.size + 1)).astype(np.int32)
        return sps.csr_array((self.slopes(x), columns, first), shape=(self.size, self.dimension))
