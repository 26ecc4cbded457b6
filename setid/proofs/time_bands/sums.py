"""Sums of products of parameters as further coordinates of a cover.

Where denominators are multiplied out, an output obeys one equation that is affine in the parameters
and in sums of their products, l = sum_i c_i a_i b_i (:mod:`setid.formulation.lifting`). On a box
each product lies on one side of its tangent at each corner,

    a b >= a0 b + b0 a - a0 b0    at (low, low) and (high, high),
    a b <= a0 b + b0 a - a0 b0    at (low, high) and (high, low),

and so does the sum, corner by corner. A sum without products is a linear equation.

References
----------
G. P. McCormick, Computability of global solutions to factorable nonconvex programs: part I,
Mathematical Programming 10 (1976) 147-175.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.lifting import Sum
from setid.proofs.supports import Cover

__all__ = ["with_sums"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_TINY = 1e-290  # more than everything that underflows


def with_sums(cover: Cover, names: Sequence[str], sums: Sequence[Sum]) -> Cover:
    """Cover parameters and sums of their products.

    Parameters
    ----------
    cover : Cover
        Of the parameters; a finite one.
    names : sequence of str
        Of the sums, in turn; each is in parameters and in sums before it.
    sums : sequence of Sum
        For each of them coefficients, and two names at most.

    Returns
    -------
    Cover
        The sums are the last coordinates.
    """
    every = (*cover.names, *names)
    place = {name: column for column, name in enumerate(every)}
    p, count = len(cover.names), len(every)
    lower, upper = np.zeros(count), np.zeros(count)
    lower[:p], upper[:p] = cover.lower, cover.upper
    matrix, right = np.zeros((4 * len(names), count)), np.zeros(4 * len(names))
    for number, own in enumerate(sums):
        terms = [(c, tuple(place[name] for name in word)) for c, word in own]
        row = slice(4 * number, 4 * number + 4)
        matrix[row], right[row] = _tangents(terms, p + number, (lower, upper))
        lower[p + number], upper[p + number] = _range(terms, (lower, upper))
    kept = np.concatenate([np.pad(cover.matrix, ((0, 0), (0, len(names)))), matrix])
    ends = np.concatenate([cover.right, right])
    return Cover(every, frozen(lower), frozen(upper), frozen(kept), frozen(ends), False)


Terms = list[tuple[float, tuple[int, ...]]]


def _range(terms: Terms, box: tuple[Reals, Reals]) -> tuple[float, float]:
    """Bound a sum on the box, rounded outwards."""
    low = high = size = 0.0
    for coefficient, word in terms:
        ends = [coefficient]
        for column in word:
            ends = [end * side[column] for end in ends for side in box]
        low, high = low + min(ends), high + max(ends)
        size += max(map(abs, ends))
    slack = 4 * (len(terms) + 4) * _EPS * size + _TINY
    return low - slack, high + slack


def _tangents(terms: Terms, own: int, box: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
    """State two bounds of a sum from below, two from above: rows (4, n), right sides (4,)."""
    matrix, right = np.zeros((4, box[0].size)), np.zeros(4)
    for row, (sign, corner) in enumerate([(1.0, 0), (1.0, 1), (-1.0, 0), (-1.0, 1)]):
        # sign * (tangents - l) <= 0, with the tangents below the sum where sign is 1
        matrix[row, own] = -sign
        size = 0.0
        for coefficient, word in terms:
            if not word:
                right[row] -= sign * coefficient
                size += abs(coefficient)
                continue
            if len(word) == 1:
                matrix[row, word[0]] += sign * coefficient
                size += abs(coefficient) * _most(box, word[0])
                continue
            a, b = word
            below = coefficient * sign > 0
            at, bt = box[corner][a], box[corner if below else 1 - corner][b]
            matrix[row, b] += sign * coefficient * at
            matrix[row, a] += sign * coefficient * bt
            right[row] += sign * coefficient * at * bt
            size += 3 * abs(coefficient) * _most(box, a) * _most(box, b)
        right[row] += 4 * (len(terms) + 8) * _EPS * size + _TINY
    return matrix, right


def _most(box: tuple[Reals, Reals], column: int) -> float:
    return float(max(abs(box[0][column]), abs(box[1][column])))
