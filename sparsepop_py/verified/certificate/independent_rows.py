"""Elimination of many independent rows at once, in whole numbers of 64 bits.

Rows that do not meet can be eliminated together, and what is left does not depend on the order.
Values are fractions of two int64 arrays in lowest terms, denominators positive. A round whose
numbers may not fit is not done; single rows in fractions of any length follow then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import check

__all__ = ["Entries", "eliminate_independent", "whole_numbers"]

_LARGEST = 2.0**61  # numbers estimated below it are below 2**62, whatever the rounding
_FEW = 32  # rows of a round that are not worth it
_MEETS = 8  # entries beside the diagonal that a row of a round has at most
_MIX = 2654435761  # odd: i -> i * _MIX modulo 2**32 is one to one

Whole = NDArray[np.int64]


class _TooLong(ArithmeticError):
    """Raised where a number may not fit into 64 bits."""


@dataclass(frozen=True, eq=False)
class Entries:
    """Entries of a symmetric matrix, each pair of places once, none of them zero.

    Parameters
    ----------
    low, high : (k,) int64
        Places with low <= high, all pairs distinct.
    top, under : (k,) int64
        Numerators, and denominators > 0.
    """

    low: Whole
    high: Whole
    top: Whole
    under: Whole

    def take(self, chosen: NDArray[np.bool_]) -> Entries:
        """Select entries."""
        return Entries(self.low[chosen], self.high[chosen], self.top[chosen], self.under[chosen])


def whole_numbers(values: NDArray[np.float64]) -> tuple[Whole, int] | None:
    """Write doubles as whole numbers over one power of two.

    Parameters
    ----------
    values : (k,) float
        Finite.

    Returns
    -------
    (k,) int64 and int, or None
        Numerators, and the number of binary places; None where four times the sum of all
        magnitudes may not fit.
    """
    mantissa, exponent = np.frexp(values)
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    lowest = np.frexp((digits & -digits).astype(float))[1] - 1
    places = -(exponent.astype(np.int64) - 53 + lowest)[digits != 0]
    bits = max(0, int(places.max(initial=0)))
    if bits > 60 or np.ldexp(np.abs(values).sum(), bits + 3) >= _LARGEST:
        return None
    return np.ldexp(values, bits).astype(np.int64), bits


def eliminate_independent(entries: Entries, size: int) -> tuple[Entries, Entries] | None:
    """Eliminate rows 1, 2, ... in rounds while many do not meet.

    Parameters
    ----------
    entries : Entries
        Row 0 is kept; its own diagonal entry is none of them.
    size : int
        Number of rows.

    Returns
    -------
    left : Entries
        Of the rows that are left.
    hidden : Entries
        Terms that sum to what the diagonal entry of row 0 has lost, not yet added.
    None is returned for both where the matrix is not semidefinite.
    """
    hidden = entries.take(np.zeros(entries.low.size, bool))
    depth = np.zeros(size, np.int64)
    while True:
        check()
        chosen = _independent(entries, size, depth)
        if np.count_nonzero(chosen) < _FEW:
            return entries, hidden
        if not _pivots_allow(entries, size, chosen):
            return None
        try:
            entries, more = _round(entries, size, chosen, depth)
        except _TooLong:
            return entries, hidden
        hidden = _joined(hidden, more)


def _independent(entries: Entries, size: int, depth: Whole) -> NDArray[np.bool_]:
    """Select rows of few entries and little depth that do not meet."""
    beside = entries.low < entries.high
    low, high = entries.low[beside], entries.high[beside]
    degree = np.bincount(low, minlength=size) + np.bincount(high, minlength=size)
    mixed = np.arange(size, dtype=np.uint64) * np.uint64(_MIX) % np.uint64(2**32)
    urgency = depth + 3.0 * np.log2(1.0 + degree) + 1e-3 * (mixed / 2.0**32)
    inner = low > 0
    first = np.full(size, np.inf)
    np.minimum.at(first, low[inner], urgency[high[inner]])
    np.minimum.at(first, high[inner], urgency[low[inner]])
    present = np.zeros(size, bool)
    present[entries.low] = present[entries.high] = True
    chosen: NDArray[np.bool_] = present & (urgency < first) & (degree <= _MEETS)
    chosen[0] = False
    return chosen


def _pivots_allow(entries: Entries, size: int, chosen: NDArray[np.bool_]) -> bool:
    """Check that pivots are positive, or zero in rows without other entries."""
    diagonal = entries.low == entries.high
    pivot = np.zeros(size, np.int64)
    pivot[entries.low[diagonal]] = entries.top[diagonal]
    meets = np.zeros(size, bool)
    meets[entries.low[~diagonal]] = meets[entries.high[~diagonal]] = True
    return not np.any(chosen & ((pivot < 0) | (meets & (pivot == 0))))


def _round(
    entries: Entries, size: int, chosen: NDArray[np.bool_], depth: Whole
) -> tuple[Entries, Entries]:
    """Subtract the products of the entries of each chosen row, divided by its pivot."""
    diagonal = entries.low == entries.high
    top, under = np.zeros(size, np.int64), np.ones(size, np.int64)
    top[entries.low[diagonal]], under[entries.low[diagonal]] = (
        entries.top[diagonal],
        entries.under[diagonal],
    )
    in_low, in_high = chosen[entries.low], chosen[entries.high]
    row_entries = entries.take((in_low | in_high) & ~diagonal)
    kept = entries.take(~(in_low | in_high))
    by_low = chosen[row_entries.low]
    owner = np.where(by_low, row_entries.low, row_entries.high)
    other = np.where(by_low, row_entries.high, row_entries.low)
    order = np.lexsort((other, owner))
    owner, other = owner[order], other[order]
    a_top, a_under = row_entries.top[order], row_entries.under[order]
    left, right = _pairs_of_runs(owner)
    share = _product(a_top, a_under, under[owner], top[owner])
    value = _product(share[0][left], share[1][left], a_top[right], a_under[right])
    low, high = np.minimum(other[left], other[right]), np.maximum(other[left], other[right])
    outer = high == 0
    made = Entries(low, high, -value[0], value[1])
    lost = made.take(outer)
    rest = _summed(_joined(kept, made.take(~outer)), size)
    np.maximum.at(depth, other, depth[owner] + 1)
    return rest, Entries(lost.low, lost.high, -lost.top, lost.under)


def _pairs_of_runs(owner: Whole) -> tuple[Whole, Whole]:
    """List pairs of places of one owner, each with itself too; owners are sorted."""
    place = np.arange(owner.size)
    end = np.searchsorted(owner, owner, side="right")
    count = end - place
    left = np.repeat(place, count)
    start = np.repeat(np.cumsum(count) - count, count)
    return left, left + np.arange(left.size) - start


def _product(top: Whole, under: Whole, by: Whole, over: Whole) -> tuple[Whole, Whole]:
    """Multiply the fractions top / under and by / over, over > 0."""
    first, second = np.gcd(top, over), np.gcd(by, under)
    top, over, by, under = top // first, over // first, by // second, under // second
    for a, b in ((top, by), (under, over)):
        if np.any(np.abs(a.astype(float)) * np.abs(b.astype(float)) >= _LARGEST):
            raise _TooLong
    return top * by, under * over


def _sum(top: Whole, under: Whole, more: Whole, below: Whole) -> tuple[Whole, Whole]:
    """Add the fractions top / under and more / below."""
    shared = np.gcd(under, below)
    left, right = below // shared, under // shared
    size = np.abs(top.astype(float)) * left + np.abs(more.astype(float)) * right
    if np.any(size >= _LARGEST) or np.any(under.astype(float) * left >= _LARGEST):
        raise _TooLong
    total, whole = top * left + more * right, under * left
    common = np.gcd(total, whole)
    return total // common, whole // common


def _joined(first: Entries, second: Entries) -> Entries:
    pairs = zip(vars(first).values(), vars(second).values(), strict=True)
    return Entries(*(np.concatenate(pair) for pair in pairs))


def _summed(entries: Entries, size: int) -> Entries:
    """Add entries of the same place two by two, and drop zeros."""
    key = entries.low * size + entries.high
    order = np.argsort(key, kind="stable")
    key, top, under = key[order], entries.top[order], entries.under[order]
    while True:
        again = np.append(False, key[1:] == key[:-1])
        if not again.any():
            break
        start = np.flatnonzero(~again)
        rank = np.arange(key.size) - np.repeat(start, np.diff(np.append(start, key.size)))
        second = np.flatnonzero(rank % 2 == 1)
        total = _sum(top[second - 1], under[second - 1], top[second], under[second])
        top[second - 1], under[second - 1] = total
        kept = rank % 2 == 0
        key, top, under = key[kept], top[kept], under[kept]
    low, high = np.divmod(key, size)
    return Entries(low, high, top, under).take(top != 0)
