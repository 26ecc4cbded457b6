"""Exact bounds by rational multipliers, without a box that pays for rounding.

Where variables have no finite bounds, whatever multiplies them has to cancel exactly. In

    f(x) = sum_k value_k word_k(x) row_k(x) + r(x)

the rows are constraints, bounds of variables x_v - lower_v >= 0 and upper_v - x_v >= 0, and
the values are rational, not negative for inequalities. r is formed in rationals. It is a
constant, or a sum of squares and a constant as an :class:`ExactGram` shows. Either constant
bounds f on the feasible set from below. For a linear problem this is its dual; for a convex
quadratic one r is the Lagrangian.

References
----------
D. Applegate, W. Cook, S. Dash, D. Espinoza, Exact solutions to linear programming problems,
Oper. Res. Lett. 35 (2007) 693-699.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.array_checks import are_indices
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.rational_gram import ExactGram, RationalPolynomial

__all__ = ["ExactDual"]

Terms = dict[tuple[int, ...], Fraction]


@dataclass(frozen=True, eq=False)
class ExactDual:
    """Rational multipliers of constraints and bounds, and a sum of squares for the rest.

    Parameters
    ----------
    lower, upper : (n,) float
        Bounds that the multipliers assume; whoever uses the bound has to prove them.
    row : (L,) int
        What each multiplier multiplies: one of m constraints, then n lower bounds, then n
        upper bounds.
    word : (L, D) int32
        The monomial in x that goes with it: the constant unless it multiplies an equality.
    value : tuple of L Fraction
        Not negative unless it multiplies an equality.
    gram : ExactGram or None
        Of the rest; None where the rest is a constant.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x + y, [3 * x + 3 * y >= 1])
    >>> row, word = np.array([0]), np.array([[0]], np.int32)
    >>> dual = ExactDual(problem.lower, problem.upper, row, word, (Fraction(1, 3),))
    >>> dual.bound(problem.rows, problem.equality, problem.objective)
    0.3333333333333333
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    row: NDArray[np.integer]
    word: Words
    value: tuple[Fraction, ...]
    gram: ExactGram | None = None

    def __post_init__(self) -> None:
        self.__dict__["value"] = tuple(map(Fraction, self.value))

    @property
    def numbers(self) -> int:
        """Number of stored numbers."""
        return len(self.value) + (0 if self.gram is None else self.gram.numbers)

    def covers(self, box: Interval) -> bool:
        """Check that a box lies within the bounds that are assumed."""
        if not self.lower.shape == self.upper.shape == box.lo.shape:
            return False
        return bool(np.all(box.lo >= self.lower) and np.all(box.hi <= self.upper))

    def bound(
        self, constraints: PolynomialSystem, equality: NDArray[np.bool_], objective: Polynomial
    ) -> float:
        """Compute the proved lower bound within the bounds assumed, -inf where none is.

        Parameters
        ----------
        constraints : PolynomialSystem
        equality : (m,) bool
        objective : Polynomial

        Returns
        -------
        float
        """
        n = constraints.dimension
        if not self._sensible(equality, n):
            return -np.inf
        rest: Terms = {}
        _add(rest, _terms(objective.words, objective.coefficients), (), Fraction(1))
        words = self.word.tolist()
        for row, word, value in zip(self.row.tolist(), words, self.value, strict=True):
            _add(rest, self._generator(constraints, row), _letters(word), -value)
        if self.gram is not None:
            return self.gram.bound(_polynomial(rest, n))
        if any(value for word, value in rest.items() if word):
            return -np.inf
        return float(Interval.of_fraction(rest.get((), Fraction(0))).lo)

    def _sensible(self, equality: NDArray[np.bool_], n: int) -> bool:
        """Check shapes, numbers, and that only equalities have signs or monomials."""
        m = equality.size
        shapes = (
            self.lower.shape == self.upper.shape == (n,)
            and self.row.shape == (len(self.value),)
            and self.word.ndim == 2
            and self.word.shape[0] == self.row.size
        )
        if not shapes or not are_indices(self.row, m + 2 * n) or not are_indices(self.word, n + 1):
            return False
        finite = np.isfinite(np.concatenate([np.zeros(m), self.lower, self.upper]))
        free = np.append(equality, np.zeros(2 * n, bool))[self.row]
        negative = np.array([value < 0 for value in self.value], bool)
        signed = negative | self.word.any(axis=1)
        return bool(np.all(finite[self.row]) and np.all(free | ~signed))

    def _generator(self, constraints: PolynomialSystem, row: int) -> Terms:
        m, n = constraints.size, constraints.dimension
        if row < m:
            chosen = constraints.row == row
            return _terms(constraints.words[chosen], constraints.coefficients[chosen])
        side, v = divmod(row - m, n)
        if side == 0:
            return {(v + 1,): Fraction(1), (): -Fraction(float(self.lower[v]))}
        return {(v + 1,): Fraction(-1), (): Fraction(float(self.upper[v]))}


def _letters(word: list[int]) -> tuple[int, ...]:
    return tuple(letter for letter in word if letter)


def _terms(words: Words, coefficients: NDArray[Any]) -> Terms:
    found: Terms = {}
    for word, value in zip(words.tolist(), coefficients.tolist(), strict=True):
        key = tuple(sorted(_letters(word)))
        found[key] = found.get(key, Fraction(0)) + Fraction(value)
    return found


def _add(rest: Terms, terms: Terms, letters: tuple[int, ...], times: Fraction) -> None:
    """Add a multiple of terms times a monomial, in place."""
    for word, value in terms.items():
        key = tuple(sorted(word + letters))
        rest[key] = rest.get(key, Fraction(0)) + times * value


def _polynomial(rest: Terms, n: int) -> RationalPolynomial:
    width = max((len(word) for word in rest), default=0)
    words = np.zeros((len(rest), max(width, 1)), np.int32)
    values = np.empty(len(rest), object)
    for place, (word, value) in enumerate(rest.items()):
        words[place, words.shape[1] - len(word) :] = word
        values[place] = value
    return RationalPolynomial(monomials.trim(words), values, n)
