"""Monomials as rows of integers, called words.

A monomial of degree at most D in variables x1, ..., xn is a row of D numbers:
its variables in ascending order, repeated as often as they occur, padded with
zeros on the left. With D = 4, ``x1^2 x3`` is ``0 1 1 3`` and the constant is
``0 0 0 0``. Products are "join and sort", evaluation is a lookup, and the
order of the packed rows is the graded lexicographic order. Many words are one
array of shape (T, D), so that everything here is vectorised.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

Words = NDArray[np.int32]
LARGEST_POWER = 1_000_000  # words are as long as the degree
LARGEST_PRODUCT = 500_000_000  # letters of all words of a product, of 4 bytes
_ONE = np.ones(1)

__all__ = [
    "LARGEST_POWER",
    "LARGEST_PRODUCT",
    "Words",
    "are_exponents",
    "collect",
    "degrees",
    "distinct",
    "evaluate",
    "from_exponents",
    "full_basis",
    "lookup",
    "multiply",
    "pack",
    "runs",
    "stack",
    "to_exponents",
    "trim",
    "widen",
]


def lookup(words: Words, table: Words, dimension: int) -> NDArray[np.int64]:
    """Find the row of each word in a graded table, -1 for none."""
    width = table.shape[1]
    words = widen(trim(words), width)
    outside = degrees(words) > width
    keys = pack(np.where(outside[:, None], 0, words)[:, words.shape[1] - width :], dimension)
    known = pack(table, dimension)
    if known.size == 0:
        return np.full(keys.size, -1)
    place = np.minimum(np.searchsorted(known, keys), known.size - 1)
    return np.where((known[place] == keys) & ~outside, place, -1)


def degrees(words: Words) -> NDArray[np.int64]:
    """Count the degree of each word, shape (..., D) -> (...)."""
    # a product, since sums along short rows are slow
    letters = (words != 0).reshape(-1, words.shape[-1]) @ np.ones(words.shape[-1])
    return letters.astype(np.int64).reshape(words.shape[:-1])


def widen(words: Words, width: int) -> Words:
    """Pad words on the left to ``width`` letters (at least their own width)."""
    missing = width - words.shape[-1]
    if missing <= 0:
        return words
    return np.concatenate([np.zeros((*words.shape[:-1], missing), np.int32), words], axis=-1)


def stack(parts: Iterable[Words]) -> Words:
    """Concatenate tables of words (..., w), at least one, padded to the largest width."""
    tables = list(parts)
    width = max(words.shape[-1] for words in tables)
    return np.concatenate([widen(words, width) for words in tables])


def trim(words: Words) -> Words:
    """Drop the leading columns that hold no letter, keeping at least one column."""
    if words.size == 0:
        return words[..., -1:]
    last = words.shape[-1] - 1
    first = bisect_left(range(last), True, key=lambda column: bool(words[..., column].any()))
    return np.ascontiguousarray(words[..., first:])


def multiply(left: Words, right: Words) -> Words:
    """Multiply row by row; leading dimensions broadcast, widths add."""
    shape = np.broadcast_shapes(left.shape[:-1], right.shape[:-1])
    product = np.concatenate(
        [
            np.broadcast_to(left, (*shape, left.shape[-1])),
            np.broadcast_to(right, (*shape, right.shape[-1])),
        ],
        axis=-1,
    )
    product.sort(axis=-1)
    return product


def pack(words: Words, dimension: int) -> NDArray[Any]:
    """Pack words (T, D) to sortable keys (T,); equal widths give comparable keys.

    Keys are 64-bit integers where they fit and fixed-width byte strings otherwise.
    """
    bits = max(1, int(dimension).bit_length())
    width = words.shape[-1]
    if bits * width <= 63:
        keys = np.zeros(words.shape[0], np.int64)
        for column in range(width):
            keys = (keys << bits) | words[:, column]
        return keys
    letters = np.ascontiguousarray(words.astype(">u4"))
    return letters.view(f"S{4 * width}").ravel()


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """Sort the entries of an array and keep one of each.

    As :func:`numpy.unique`, which hashes integers; that takes three to ten times as long where
    they are many.

    Examples
    --------
    >>> distinct(np.array([[3, 1], [1, 2]]))
    array([1, 2, 3])
    """
    found = np.sort(values, axis=None)
    kept = np.ones(found.size, bool)
    kept[1:] = found[1:] != found[:-1]
    return found[kept]


def collect(words: Words, dimension: int) -> tuple[Words, NDArray[np.int64]]:
    """List distinct words in graded order, and for each input row its number among them."""
    if words.shape[0] == 0:
        return words, np.zeros(0, np.int64)
    keys = pack(words, dimension)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return words[first], inverse.ravel()


def evaluate(words: Words, points: NDArray[Any]) -> NDArray[Any]:
    """Evaluate words at ``points``: (n,) gives (T,), (N, n) gives (N, T)."""
    if points.ndim == 1:  # local searches call it thousands of times
        letters = np.concatenate([_ONE, points]).take(words.T)
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            return np.multiply.reduce(letters, axis=0)
    extended = np.concatenate([np.ones((*points.shape[:-1], 1)), points], axis=-1)
    values = extended[..., words[:, 0]]
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        for column in range(1, words.shape[1]):
            values = values * extended[..., words[:, column]]
    return values


def runs(words: Words) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """List factors of words as (row, variable, power), variables from 0, rows ascending."""
    letter = words != 0
    starts = letter.copy()
    starts[:, 1:] &= words[:, 1:] != words[:, :-1]
    row, column = np.nonzero(starts)
    position = np.flatnonzero(starts[letter])
    ends = np.append(position[1:], np.count_nonzero(letter))[: row.size]
    return row, words[row, column].astype(np.int64) - 1, ends - position


def are_exponents(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Mark whole numbers from 0 to LARGEST_POWER: powers that words can hold."""
    return (values >= 0) & (values <= LARGEST_POWER) & (values == np.floor(values))


def from_exponents(exponents: sps.csr_array) -> Words:
    """Write the rows of a sparse exponent matrix of shape (T, n) as words."""
    exponents = sps.csr_array(exponents, copy=True)  # sorting in place must not reach the caller
    exponents.sort_indices()
    powers = exponents.data.astype(np.int64)
    rows = np.repeat(np.arange(exponents.shape[0]), np.diff(exponents.indptr))
    row = np.repeat(rows, powers)
    letters = np.repeat(exponents.indices + 1, powers)
    degree = np.bincount(row, minlength=exponents.shape[0])
    width = max(1, int(degree.max(initial=0)))
    words = np.zeros((exponents.shape[0], width), np.int32)
    ends = np.cumsum(degree)
    words[row, width - (ends[row] - np.arange(row.size))] = letters
    return words


def to_exponents(words: Words, dimension: int) -> sps.csr_array:
    """Write words as a sparse exponent matrix (T, n)."""
    row, variable, power = runs(words)
    return sps.csr_array((power, (row, variable)), shape=(words.shape[0], dimension))


def full_basis(variables: int, degree: int) -> Words:
    """List all monomials up to a degree in variables 1..variables, graded.

    Parameters
    ----------
    variables : int
    degree : int

    Returns
    -------
    (s, degree) int32

    Examples
    --------
    >>> full_basis(2, 2).tolist()
    [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]]
    """
    if degree == 0:
        return np.zeros((1, 1), np.int32)
    letters = combinations_with_replacement(range(variables + 1), degree)
    return np.array(list(letters), np.int32).reshape(-1, degree)
