"""Rational sums of squares f - c = b'Q b with an exactly semidefinite Q.

Where every Gram matrix of a form is singular, no margin pays for rounding. Then the matrix
has to be exact. Its entries are the doubles that are stored, but for one entry of each
monomial, which takes what the others leave of the coefficient of f; so the identity holds by
construction. That Q is positive semidefinite is shown by elimination in rationals, which
keeps the row of the constant for the end:

    f_0 - c = q' Q^+ q,   q being the row of the constant without its diagonal.

A definite Q of many rows is not eliminated: a point near the minimiser shows nearly as much
(:mod:`~sparsepop_py.verified.certificate.dense_rows`). The elimination prefers rows with few
entries and short chains of rows eliminated before. A long chain is then eliminated from many
places at once, and the fractions stay short. That of a large matrix takes seconds. It is a
function of the matrix and the objective alone, so the last one is remembered, by a digest of all
their numbers.
"""

from __future__ import annotations

import hashlib
import heapq
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.budget import check
from sparsepop_py.verified.arithmetic.array_checks import are_indices, are_numbers
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.dense_rows import hidden_by_definite, hidden_by_minors
from sparsepop_py.verified.certificate.independent_rows import (
    Entries,
    eliminate_independent,
    whole_numbers,
)

__all__ = ["ExactGram", "RationalPolynomial"]

_MANY = 200  # monomials from which rows are eliminated many at a time, as far as they fit
_SMALL = 40  # monomials up to which elimination takes no time
_DENSE = 0.3  # share of entries from which no order of elimination keeps zeros
_LARGE = 1000  # monomials from which factors in floating point take long
_BITS = 1_000_000  # numbers longer than this end the elimination without a result

Rows = dict[int, dict[int, Fraction]]

_last: tuple[bytes, Fraction | None] = b"", None  # digest of numbers, and what was hidden


@dataclass(frozen=True, eq=False)
class RationalPolynomial:
    """Polynomial with rational coefficients, its words distinct.

    Parameters
    ----------
    words : (T, D) int32
    coefficients : (T,) object
        Fractions.
    dimension : int
    """

    words: Words
    coefficients: NDArray[Any]
    dimension: int

    @property
    def constant_term(self) -> Fraction:
        """The coefficient of 1."""
        constant = ~self.words.any(axis=1)
        return sum(self.coefficients[constant].tolist(), Fraction(0))


@dataclass(frozen=True, eq=False)
class ExactGram:
    """A sparse Gram matrix of the objective less a constant.

    Parameters
    ----------
    basis : (s, D) int32
        Monomials as words; the first, and no other, is the constant.
    first, second : (k,) int
        The entries of Q that may be other than zero, in pairs of basis monomials.
    value : (k,) float
        Their values. Among the entries of one monomial, that of the first is not used: it is
        what the others leave.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> basis = np.array([[0], [1], [2]], np.int32)
    >>> first, second = np.array([1, 1, 2]), np.array([1, 2, 2])
    >>> ExactGram(basis, first, second, np.zeros(3)).bound(5 + (x - 2 * y) ** 2)
    5.0
    """

    basis: Words
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    value: NDArray[np.float64]

    @property
    def numbers(self) -> int:
        """Number of stored numbers."""
        return self.value.size

    def bound(self, objective: Polynomial | RationalPolynomial) -> float:
        """Compute the proved lower bound over all of space, -inf where none is.

        Parameters
        ----------
        objective : Polynomial or RationalPolynomial

        Returns
        -------
        float
        """
        if not self._sensible(objective.dimension):
            return -np.inf
        hidden = self._hidden(objective)
        if hidden is None:
            return -np.inf
        return float(Interval.of_fraction(Fraction(objective.constant_term) - hidden).lo)

    def _sensible(self, n: int) -> bool:
        size = self.basis.shape[0] if self.basis.ndim == 2 else 0
        return bool(
            size > 0
            and self.basis.shape[1] > 0
            and are_indices(self.basis, n + 1)
            and not self.basis[0].any()
            and np.all(self.basis[1:].any(axis=1))  # else c would not be all of the constant
            and self.first.shape == self.second.shape == self.value.shape
            and self.first.ndim == 1
            and are_indices(self.first, size)
            and are_indices(self.second, size)
            and are_numbers(self.value)
        )

    def _hidden(self, objective: Polynomial | RationalPolynomial) -> Fraction | None:
        """Compute what the squares cost the constant, None unless Q is semidefinite."""
        global _last
        if self.basis.shape[0] < _MANY or not isinstance(objective, Polynomial):
            return self._hidden_in_fractions(objective)
        digest = _digest(
            self.basis,
            self.first,
            self.second,
            self.value,
            objective.words,
            objective.coefficients,
        )
        known, hidden = _last
        if known != digest:
            hidden = self._hidden_in_whole_numbers(objective)
            _last = digest, hidden
        return hidden

    def _hidden_in_fractions(self, objective: Polynomial | RationalPolynomial) -> Fraction | None:
        rows = self._matrix(objective)
        return None if rows is None else _taken(rows)

    def _hidden_in_whole_numbers(self, objective: Polynomial) -> Fraction | None:
        scaled = self._whole_matrix(objective)
        if scaled is None:
            return self._hidden_in_fractions(objective)
        entries, bits = scaled
        found = None
        if entries is not None:
            found = eliminate_independent(entries, self.basis.shape[0])
        if found is None:
            return None
        left, lost = found
        rest = _taken(_rows(left))
        if rest is None:
            return None
        terms = [
            Fraction(*pair) for pair in zip(lost.top.tolist(), lost.under.tolist(), strict=True)
        ]
        return (_total(terms) + rest) / 2**bits

    def _whole_matrix(self, objective: Polynomial) -> tuple[Entries | None, int] | None:
        """The matrix of :meth:`_matrix` times a power of two, which is given as its exponent.

        None where whole numbers may not fit; None as entries where f has other monomials.
        """
        found = whole_numbers(np.concatenate([self.value, objective.coefficients]))
        if found is None:
            return None
        count, n = self.first.size, objective.dimension
        value, coefficient = 2 * found[0][:count], 2 * found[0][count:]
        letters = np.sort(self.basis, axis=1)
        product = monomials.multiply(letters[self.first], letters[self.second])
        distinct, number = monomials.collect(monomials.stack((product, objective.words)), n)
        times = np.where(self.first == self.second, 1, 2)
        place, taker = np.unique(number[:count], return_index=True)
        value[taker] = 0
        rest = np.zeros(distinct.shape[0], np.int64)
        rest[number[count:]] = coefficient
        np.subtract.at(rest, number[:count], value * times)
        value[taker] = rest[place] // times[taker]  # even, so that no half is lost
        rest[place] = 0
        rest[: int(not distinct[:1].any())] = 0
        if rest.any():
            return None, 0
        size = self.basis.shape[0]
        pairs = self.first.astype(np.int64), self.second.astype(np.int64)  # their keys are long
        low, high = np.minimum(*pairs), np.maximum(*pairs)
        key, at = np.unique(low * size + high, return_inverse=True)
        total = np.zeros(key.size, np.int64)
        np.add.at(total, at, value)
        kept = (total != 0) & (key != 0)
        low, high = np.divmod(key[kept], size)
        return Entries(low, high, total[kept], np.ones(low.size, np.int64)), found[1] + 1

    def _matrix(self, objective: Polynomial | RationalPolynomial) -> Rows | None:
        """Rows of Q without the entry of the constant; None where f has other monomials."""
        n = objective.dimension
        letters = np.sort(self.basis, axis=1)
        product = monomials.multiply(letters[self.first], letters[self.second])
        distinct, number = monomials.collect(monomials.stack((product, objective.words)), n)
        rest = [Fraction(0)] * distinct.shape[0]
        for place, coefficient in zip(
            number[self.first.size :].tolist(), objective.coefficients.tolist(), strict=True
        ):
            rest[place] = Fraction(coefficient)
        rows: Rows = {i: {} for i in range(self.basis.shape[0])}
        taker: dict[int, tuple[int, int]] = {}
        for i, j, place, value in zip(
            self.first.tolist(),
            self.second.tolist(),
            number[: self.first.size].tolist(),
            self.value.tolist(),
            strict=True,
        ):
            if place not in taker:
                taker[place] = (i, j)
                continue
            rest[place] -= Fraction(value) * (1 if i == j else 2)
            _add(rows, i, j, Fraction(value))
        constant = int(not distinct[:1].any())
        for place in range(constant, len(rest)):
            if place in taker:
                i, j = taker[place]
                _add(rows, i, j, rest[place] / (1 if i == j else 2))
            elif rest[place]:
                return None
        rows[0].pop(0, None)  # open, however often it is listed
        return rows


def _digest(*arrays: NDArray[Any]) -> bytes:
    """A digest of arrays, with the type, shape and bytes of each."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(f"{array.dtype.str} {array.shape} ".encode())
        found.update(array.tobytes())
    return found.digest()


def _rows(entries: Entries) -> Rows:
    """Rows of a symmetric matrix as fractions."""
    rows: Rows = {0: {}}
    for low, high, top, under in zip(*(x.tolist() for x in vars(entries).values()), strict=True):
        value = Fraction(top, under)
        rows.setdefault(low, {})[high] = value
        rows.setdefault(high, {})[low] = value
    return rows


def _add(rows: Rows, i: int, j: int, value: Fraction) -> None:
    """Add to the entries (i, j) and (j, i); zeros are not kept."""
    total = rows[i].get(j, Fraction(0)) + value
    for a, b in {(i, j), (j, i)}:
        if total:
            rows[a][b] = total
        else:
            rows[a].pop(b, None)


def _taken(rows: Rows) -> Fraction | None:
    """Bound q' Q^+ q from above, row 0 = q; None unless Q is semidefinite."""
    if _SMALL < len(rows) <= _LARGE:
        found = hidden_by_definite(rows)
        if found is not None:
            return found
        if sum(map(len, rows.values())) >= _DENSE * len(rows) ** 2:
            return hidden_by_minors(rows)
    return _eliminated(rows)


def _eliminated(rows: Rows) -> Fraction | None:
    """Compute q' Q^+ q, row 0 = q, by elimination; None unless Q is semidefinite."""
    depth = dict.fromkeys(rows, 0)
    queue = [(_urgency(len(row), 0), i) for i, row in rows.items() if i]
    heapq.heapify(queue)
    done: set[int] = set()
    hidden: list[Fraction] = []
    while queue:
        urgency, i = heapq.heappop(queue)
        check()
        if i in done:
            continue
        now = _urgency(len(rows[i]), depth[i])
        if now > urgency:
            heapq.heappush(queue, (now, i))
            continue
        done.add(i)
        row = rows.pop(i)
        pivot = row.pop(i, Fraction(0))
        if pivot < 0 or (row and not pivot) or pivot.denominator.bit_length() > _BITS:
            return None
        others = list(row.items())
        for place, (j, value) in enumerate(others):
            del rows[j][i]
            depth[j] = max(depth[j], depth[i] + 1)
            share = value / pivot
            for k, other in others[place:]:
                if j or k:
                    _add(rows, j, k, -share * other)
                else:
                    hidden.append(share * other)
    return _total(hidden)


def _urgency(degree: int, depth: int) -> float:
    """Small for monomials that meet few others and have little below them."""
    return depth + 3.0 * math.log2(1 + degree)


def _total(terms: list[Fraction]) -> Fraction:
    """Add in pairs: long denominators then meet only near the end."""
    while len(terms) > 1:
        terms = [sum(terms[k : k + 2], Fraction(0)) for k in range(0, len(terms), 2)]
    return terms[0] if terms else Fraction(0)
