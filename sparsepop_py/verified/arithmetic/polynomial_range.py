"""Enclosures of polynomials: their range over a box, and their affine expansion.

Both keep every rounding error, so that what follows from them is proved.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from operator import add

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.verified.arithmetic.interval import Interval, sum_by

__all__ = [
    "Factors",
    "expand_affine",
    "expand_exactly",
    "jacobian_range",
    "monomial_ranges",
    "range_over",
]

_LARGEST_KNOWN = 4096  # letters; the leaves of a tree use the same words again and again


@dataclass(frozen=True, eq=False)
class Factors:
    """The powers of single variables that make up each word, as padded tables.

    Column p of row t is the p-th factor of word t: ``variable`` (n where there is none),
    ``power`` (0 there) and ``start``, the column of its first letter. Shapes (T, P).
    """

    variable: NDArray[np.int64]
    power: NDArray[np.int64]
    start: NDArray[np.int64]

    @staticmethod
    def of(words: Words, dimension: int) -> Factors:
        """Factor tables of words in ``dimension`` variables."""
        words = np.ascontiguousarray(words, np.int32)
        known = _known_factors if words.size <= _LARGEST_KNOWN else _known_factors.__wrapped__
        return known(words.tobytes(), words.shape, dimension)

    def ranges(self, box: Interval) -> Interval:
        """Enclose every factor over the box, shape (T, P); [1, 1] for none."""
        lo, hi = np.append(box.lo, 1.0), np.append(box.hi, 1.0)
        return Interval(lo[self.variable], hi[self.variable]).power(self.power)


@lru_cache(maxsize=64)
def _known_factors(letters: bytes, shape: tuple[int, int], dimension: int) -> Factors:
    """Factor tables of words that are given as bytes, so that equal ones share them."""
    words = np.frombuffer(letters, np.int32).reshape(shape)
    row, variable, power = monomials.runs(words)
    count = np.bincount(row, minlength=words.shape[0])
    first = np.cumsum(count) - count
    slot = np.arange(row.size) - first[row]
    degree = np.bincount(row, weights=power, minlength=words.shape[0]).astype(np.int64)
    before = np.cumsum(power) - power
    start = words.shape[1] - degree[row] + before - before[first[row]]
    shape = (words.shape[0], int(count.max(initial=1)))
    table = Factors(np.full(shape, dimension), np.zeros(shape, int), np.zeros(shape, int))
    table.variable[row, slot] = variable
    table.power[row, slot] = power
    table.start[row, slot] = start
    for array in (table.variable, table.power, table.start):
        array.flags.writeable = False
    return table


def product(factors: Interval) -> Interval:
    """Multiply along the last axis."""
    result = factors[..., 0]
    for column in range(1, factors.lo.shape[-1]):
        result = result * factors[..., column]
    return result


def range_over(system: PolynomialSystem, box: Interval) -> Interval:
    """Enclose the range of every polynomial of ``system`` over a box, shape (m,)."""
    factors = Factors.of(system.words, system.dimension)
    terms = Interval.point(system.coefficients) * product(factors.ranges(box))
    return sum_by(system.row, terms, system.size)


def jacobian_range(
    system: PolynomialSystem, box: Interval
) -> tuple[NDArray[np.int64], NDArray[np.int64], Interval]:
    """Enclose the entries of the Jacobian over a box.

    Those that are left out are zero everywhere.

    Returns
    -------
    rows, variables : (k,) int
        Place of each entry, ascending, each once.
    entries : Interval (k,)
    """
    row, variable, power = monomials.runs(system.words)
    words = system.words[row].copy()
    words[np.arange(row.size), np.argmax(words == (variable + 1)[:, None], axis=1)] = 0
    words.sort(axis=1)
    scale = Interval.point(system.coefficients[row]) * Interval.point(power.astype(float))
    terms = scale * product(Factors.of(words, system.dimension).ranges(box))
    places, entry = np.unique(system.row[row] * system.dimension + variable, return_inverse=True)
    return *np.divmod(places, system.dimension), sum_by(entry, terms, places.size)


def expand_affine(
    system: PolynomialSystem, centre: NDArray[np.float64], scale: NDArray[np.float64]
) -> tuple[Words, NDArray[np.int64], Interval]:
    """Substitute x = centre + scale * t.

    Parameters
    ----------
    system : PolynomialSystem
    centre, scale : (n,) float
        Where ``scale`` is 0 the variable is fixed and disappears.

    Returns
    -------
    words : (T', D) int32, row : (T',) int, coefficients : Interval (T',)
        Terms of the expanded polynomials, rows ascending, equal monomials merged.
    """
    layout = _layout_of(system, centre == 0, scale == 0)
    value = Interval.point(system.coefficients)
    centre, scale = np.append(centre, 0.0), np.append(scale, 1.0)
    for copy, variable, power, dropped in layout.slots:
        check()
        c, w = centre[variable], scale[variable]
        shift = Interval.point(c).power(dropped) * Interval.point(w).power(power - dropped)
        weight = layout.binomials[power, dropped] * shift
        plain = (c == 0) & (w == 1)
        value = value[copy]
        scaled = value * weight
        if np.count_nonzero(plain):
            lo, hi = np.where(plain, value.lo, scaled.lo), np.where(plain, value.hi, scaled.hi)
            scaled = Interval(lo, hi)
        value = scaled
    check()
    return layout.merged(value)


def expand_exactly(
    system: PolynomialSystem, centre: NDArray[np.float64], scale: NDArray[np.float64]
) -> tuple[Words, NDArray[np.int64], Interval]:
    """Substitute as :func:`expand_affine`, with coefficients from exact rationals.

    Where powers of a centre cancel, rounding on the way may hide what is left of them.

    Parameters
    ----------
    system : PolynomialSystem
        With finite coefficients.
    centre, scale : (n,) float
        Finite.

    Returns
    -------
    words : (T', D) int32, row : (T',) int, coefficients : Interval (T',)
    """
    layout = _layout_of(system, centre == 0, scale == 0)
    value = [Fraction(v) for v in system.coefficients.tolist()]
    c = [*map(Fraction, centre.tolist()), Fraction(0)]
    w = [*map(Fraction, scale.tolist()), Fraction(1)]
    for copy, variable, power, dropped in layout.slots:
        check()
        factors = list(zip(variable.tolist(), power.tolist(), dropped.tolist(), strict=True))
        known = {
            (v, p, d): math.comb(p, d) * c[v] ** d * w[v] ** (p - d) for v, p, d in set(factors)
        }
        pairs = zip(copy.tolist(), factors, strict=True)
        value = [value[k] * known[factor] for k, factor in pairs]
    sums = [Fraction(0)] * layout.row.size
    for place, part in zip(layout.place.tolist(), value, strict=True):
        sums[place] += part
    keep = np.flatnonzero([bool(total) for total in sums])
    ends = [Interval.of_fraction(sums[k]) for k in keep.tolist()]
    enclosed = Interval(np.array([e.lo for e in ends]), np.array([e.hi for e in ends]))
    return layout.words[keep], layout.row[keep], enclosed


@dataclass(frozen=True, eq=False)
class _Layout:
    """Terms of an expansion, whatever the numbers.

    Parameters
    ----------
    slots : tuple of (copy, variable, power, dropped)
        For each factor: the term that each new term comes from, the factor's variable and power,
        and how many of its letters became the centre.
    binomials : Interval
        Enclosures of C(power, dropped).
    words : (T', D) int32
    row : (T',) int
        Distinct monomials of each row, in order.
    place : (T,) int
        Where the terms go that the last slot leaves.
    """

    slots: tuple[tuple[NDArray[np.int64], ...], ...]
    binomials: Interval
    words: Words
    row: NDArray[np.int64]
    place: NDArray[np.int64]

    def merged(self, value: Interval) -> tuple[Words, NDArray[np.int64], Interval]:
        """Add the terms of the same row and monomial, and drop those that are 0."""
        sums = sum_by(self.place, value, self.row.size)
        keep = np.flatnonzero((sums.lo != 0) | (sums.hi != 0))
        return self.words[keep], self.row[keep], sums[keep]


def _layout_of(
    system: PolynomialSystem, still: NDArray[np.bool_], gone: NDArray[np.bool_]
) -> _Layout:
    """Lay out an expansion, for centres that are 0 (``still``) and scales that are (``gone``)."""
    words = np.ascontiguousarray(system.words, np.int32)
    row = np.ascontiguousarray(system.row, np.int64)
    known = _known_layout if words.size <= _LARGEST_KNOWN else _known_layout.__wrapped__
    return known(
        words.tobytes(),
        words.shape,
        row.tobytes(),
        system.dimension,
        still.tobytes(),
        gone.tobytes(),
    )


@lru_cache(maxsize=64)
def _known_layout(
    letters: bytes, shape: tuple[int, int], rows: bytes, dimension: int, still: bytes, gone: bytes
) -> _Layout:
    """Lay out an expansion, given as bytes, so that equal ones share it."""
    words = np.frombuffer(letters, np.int32).reshape(shape)
    row = np.frombuffer(rows, np.int64)
    zero = np.append(np.frombuffer(still, bool), True)
    fixed = np.append(np.frombuffer(gone, bool), False)
    factors = Factors.of(words, dimension)
    term = np.arange(row.size)
    columns = np.arange(words.shape[1])
    slots = []
    for slot in range(factors.variable.shape[1]):
        check()
        variable, power = factors.variable[term, slot], factors.power[term, slot]
        options = np.where(zero[variable] | fixed[variable], 1, power + 1)
        copy = np.repeat(np.arange(term.size), options)
        dropped = np.arange(copy.size) - (np.cumsum(options) - options)[copy]
        power, variable, term = power[copy], variable[copy], term[copy]
        dropped = np.where(fixed[variable], power, dropped)
        slots.append((copy, variable, power, dropped))
        start = factors.start[term, slot]
        missing = (columns >= start[:, None]) & (columns < (start + dropped)[:, None])
        words = np.where(missing, 0, words[copy]).astype(np.int32)
    check()
    distinct, number = monomials.collect(np.sort(words, axis=1), dimension)
    count = max(1, distinct.shape[0])
    key, place = np.unique(row[term] * count + number, return_inverse=True)
    row, number = np.divmod(key, count)
    binomials = _binomials(int(factors.power.max(initial=0)))
    words = distinct[number]
    for array in (words, row, place, *(each for parts in slots for each in parts)):
        array.flags.writeable = False
    return _Layout(tuple(slots), binomials, words, row, place.ravel())


@lru_cache(maxsize=4)
def _binomials(largest: int) -> Interval:
    """Enclosures of C(a, b) for a, b <= largest; beyond 2^53 they are no doubles."""
    lo, hi = np.zeros((2, largest + 1, largest + 1))
    row = [1]
    for a in range(largest + 1):
        for b in range(a // 2 + 1):
            lo[a, [b, a - b]], hi[a, [b, a - b]] = _enclosed(row[b])
        row = [1, *map(add, row, row[1:]), 1]
    lo.flags.writeable = hi.flags.writeable = False
    return Interval(lo, hi)


def _enclosed(whole: int) -> tuple[float, float]:
    """The tightest doubles around a positive integer."""
    try:
        near = float(whole)
    except OverflowError:
        return sys.float_info.max, math.inf
    exact = int(near)
    lo = near if exact <= whole else math.nextafter(near, -math.inf)
    return lo, near if exact >= whole else math.nextafter(near, math.inf)


def monomial_ranges(words: Words, box: Interval) -> Interval:
    """Enclose ranges of monomials (T, D) over a box, (T,), exactly but for rounding."""
    count = words.shape[0]
    value = Interval(np.ones(count), np.ones(count))
    row, variable, power = monomials.runs(words)
    slot = np.arange(row.size) - np.searchsorted(row, row)
    for k in range(int(slot.max(initial=-1)) + 1):
        here = slot == k
        part = Interval(box.lo[variable[here]], box.hi[variable[here]]).power(power[here])
        low, high = np.ones(count), np.ones(count)
        low[row[here]], high[row[here]] = part.lo, part.hi
        value = value * Interval(low, high)
    return value
