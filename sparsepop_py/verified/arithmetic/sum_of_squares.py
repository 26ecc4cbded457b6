"""Sums of squares: their expansion, and whether it is a polynomial exactly.

Squares come as pairs (weight, polynomial); those of equal shape are handled together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = ["Weighted", "constant_above", "expanded"]

Weighted = tuple[float, Polynomial]

_WHOLE = 2.0**62  # sums of integers below this are exact in 64 bits


def expanded(squares: Sequence[Weighted], dimension: int) -> Polynomial:
    """Add up weight * p^2, rounded."""
    words, values = [np.zeros((1, 1), np.int32)], [np.zeros(1)]
    for product, weight, first, second in _products(squares):
        words.append(product)
        values.append(weight * first * second)
    return Polynomial._merged(monomials.stack(words), np.concatenate(values), dimension)


def constant_above(objective: Polynomial, squares: Sequence[Weighted]) -> float | None:
    """Compute the constant in objective = constant + sum weight * p^2, rounded down.

    Parameters
    ----------
    objective : Polynomial
    squares : sequence of (float, Polynomial)

    Returns
    -------
    float or None
        None if the identity does not hold exactly in the given doubles.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> constant_above(3 + (x - y) ** 2, [(1.0, x - y)])
    3.0
    """
    words, products = [monomials.stack([objective.words, np.zeros((1, 1), np.int32)])], []
    for product, weight, first, second in _products(squares):
        words.append(product)
        products.append((weight, first, second))
    weight, first, second = (np.concatenate(parts) for parts in zip(*products, strict=True))
    distinct, number = monomials.collect(monomials.stack(words), objective.dimension)
    value = np.append(objective.coefficients, 0.0)  # the constant is always there, and first
    rest = _whole_sums(value, (weight, first, second), number, distinct.shape[0])
    if rest is None:
        rest = _rational_sums(value, (weight, first, second), number, distinct.shape[0])
    return None if any(rest[1:]) else float(Interval.of_fraction(rest[0]).lo)


def _products(
    squares: Sequence[Weighted],
) -> Iterator[tuple[Words, NDArray[Any], NDArray[Any], NDArray[Any]]]:
    """Monomials of p^2 with three factors of their coefficients, by shapes of p."""
    shapes: dict[tuple[int, ...], list[Weighted]] = {}
    for weight, p in squares:
        shapes.setdefault(p.words.shape, []).append((weight, p))
    for (terms, _), items in shapes.items():
        i, j = np.triu_indices(terms)
        letters = np.stack([p.words for _, p in items])
        value = np.stack([p.coefficients for _, p in items])
        product = monomials.multiply(letters[:, i], letters[:, j])
        scale = np.repeat(np.array([w for w, _ in items]), i.size)
        twice = np.where(i == j, 1.0, 2.0) * value[:, j]
        yield product.reshape(-1, product.shape[-1]), scale, value[:, i].ravel(), twice.ravel()


def _whole_sums(
    value: NDArray[Any], factors: tuple[NDArray[Any], ...], number: NDArray[Any], size: int
) -> list[Fraction] | None:
    """Subtract sums of products from coefficients in integers; None beyond 64 bits."""
    product = np.prod(factors, axis=0)
    unit = max(_last_bit(value), sum(_last_bit(factor) for factor in factors))
    largest = np.abs(value).sum() + np.abs(product).sum()
    if unit > 1000 or not largest < _WHOLE / 2.0**unit:
        return None  # products are exact below
    terms = np.concatenate([value, -product]) * 2.0**unit
    if np.any(np.abs(terms) >= 2.0**53):
        return None
    order = np.argsort(number, kind="stable")
    start = np.searchsorted(number[order], np.arange(size))
    sums = np.add.reduceat(terms[order].astype(np.int64), start)
    return [Fraction(s, 2**unit) if s else Fraction(0) for s in sums.tolist()]


def _last_bit(values: NDArray[np.float64]) -> int:
    """Find the least k >= 0 with values * 2^k whole."""
    mantissa, exponent = np.frexp(values)
    whole = (mantissa * 2.0**53).astype(np.int64)
    lowest = np.frexp((whole & -whole).astype(float))[1] - 1
    last = np.where(whole == 0, 0, 53 - exponent - lowest)
    return int(last.max(initial=0))


def _rational_sums(
    value: NDArray[Any], factors: tuple[NDArray[Any], ...], number: NDArray[Any], size: int
) -> list[Fraction]:
    rest = [Fraction(0)] * size
    for place, coefficient in zip(number.tolist(), value.tolist(), strict=False):
        rest[place] += Fraction(coefficient)
    for place, w, a, b in zip(
        number[value.size :].tolist(), *(f.tolist() for f in factors), strict=True
    ):
        if w and a and b:
            rest[place] -= Fraction(w) * Fraction(a) * Fraction(b)
    return rest
