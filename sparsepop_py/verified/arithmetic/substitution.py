"""Zeros of triangular systems: rows solved one after the other, in fixed point rounded outwards.

Row i is linear in its own variable v_i and contains no v_j with j > i, as in a recursion over time:

    p_i = c_i + s_i v_i,    c_i, s_i polynomials in v_1, ..., v_{i-1} and variables that are kept.

Only the first rows may contain variables of later ones among them. They fall into blocks, each as
short as can be without a variable of a later block. A block is linear in its own variables
together, which are solved for in rationals. So the reflection coefficients that prove stability
follow from a denominator, two by two.

Where s_i is not zero over what encloses v_1, ..., v_{i-1}, v_i = -c_i / s_i exists and lies in the
quotient of the ranges. Each end is a whole multiple of its row's 2**-K. Enclosures widen from row
to row, by the sum of the magnitudes of the slopes at most, and K falls by as many bits, since more
of them would say nothing. So the first K grows with the length of a record, and the work with its
square, divided by the length of a machine word.

References
----------
A. Neumaier, Interval Methods for Systems of Equations, Cambridge, 1990, section 4.4 (triangular
systems by substitution).
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import ldexp
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check
from sparsepop_py.verified.arithmetic.interval import Interval, exact_values
from sparsepop_py.verified.arithmetic.rational import solve_rationally

__all__ = ["substituted"]

_BITS, _MOST_BITS = 256, 65536  # the first K, and the largest
_NARROW = 64  # bits below 1 that an enclosure has to be narrower than
_WIDE = 32  # bits of a width; with more, ends are rounded to fewer
_SIGNIFICANT, _LEAST_EXPONENT = 53, -1074  # of doubles
Ends = tuple[int, int]


class _Enclosure(NamedTuple):
    """Ends in units of 2**-bits."""

    low: int
    high: int
    bits: int


def substituted(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> Interval | None:
    """Enclose the zero of a triangular system whose other variables are kept.

    Parameters
    ----------
    system : PolynomialSystem
        As many rows as there are variables in ``solved``, in the order of the substitution.
    x : (n,) float
        The variables that are kept; entries of ``solved`` do not count.
    solved : (r,) int
        Distinct; row i is solved for ``solved[i]``.

    Returns
    -------
    Interval (n,) or None
        Degenerate in all variables but ``solved``. None if a row is not linear in its variable or
        has a slope that may be zero, or if the first rows do not determine theirs.
    """
    place = np.full(1 + x.size, -1)  # by letters; the first one stands for nothing
    place[1 + solved] = np.arange(solved.size)
    blocks = _blocks(system, place)
    first = _solved_blocks(system, x, solved, blocks)
    terms = _terms(system, x, place.tolist(), blocks[-1])
    if first is None or terms is None:
        return None
    bits = _BITS
    while True:
        found = _enclosures(first, terms, bits)
        if found is None or len(found) == solved.size:
            return None if found is None else _as_doubles(x, solved, found)
        if bits >= _MOST_BITS:
            return None
        bits = min(_more_bits(bits, len(found) / solved.size), _MOST_BITS)


class _Term(NamedTuple):
    """A term: whole * 2**exponent, times solved variables, times its own or not."""

    whole: int
    exponent: int
    before: list[int]
    own: bool


def _blocks(system: PolynomialSystem, place: NDArray[np.int64]) -> list[int]:
    """Bound the first blocks, from 0 to the last one of several rows."""
    every = np.arange(system.size)
    latest = every.copy()  # variable in a row or before, by its place
    np.maximum.at(latest, system.row, place[system.words].max(axis=1, initial=-1))
    latest = np.maximum.accumulate(latest)
    several = np.flatnonzero(latest > every)
    ends = 1 + np.flatnonzero(latest == every)
    return [0, *ends[ends <= several.max(initial=-2) + 2].tolist()]


def _solved_blocks(
    system: PolynomialSystem, x: NDArray[Any], solved: NDArray[Any], blocks: list[int]
) -> list[Fraction] | None:
    """Solve the first blocks in turn; None if one is not linear, or singular."""
    exact, count = [Fraction(value) for value in x.tolist()], blocks[-1]
    for begin, end in pairwise(blocks):
        block = system.take(np.arange(begin, end))
        found = solve_rationally(block, exact, solved[begin:end].tolist())
        if found is None:
            return None
        for variable, value in found.items():
            exact[variable] = value
    rows = system.take(np.arange(count))
    if any(exact_values(rows.words, rows.coefficients, rows.row, rows.size, exact)):
        return None
    return [exact[variable] for variable in solved[:count].tolist()]


def _terms(
    system: PolynomialSystem, x: NDArray[Any], place: list[int], together: int
) -> list[list[_Term]] | None:
    """Terms of each row but the first ones; None where one is wrong."""
    values = [_dyadic(value) for value in x.tolist()]
    found: list[list[_Term]] = [[] for _ in range(together, system.size)]
    for letters, coefficient, row in zip(
        system.words.tolist(), system.coefficients.tolist(), system.row.tolist(), strict=True
    ):
        if row < together:
            continue
        whole, exponent = _dyadic(coefficient)
        inside: list[int] = []
        for letter in letters:
            if place[letter] >= 0:
                inside.append(place[letter])
            elif letter:
                factor, more = values[letter - 1]
                whole, exponent = whole * factor, exponent + more
        own = inside.count(row)
        if own > 1:
            return None
        before = [number for number in inside if number != row]
        found[row - together].append(_Term(whole, exponent, before, own > 0))
    return found


def _dyadic(value: float) -> Ends:
    """A double as a whole number and an exponent of two."""
    top, bottom = value.as_integer_ratio()
    return top, 1 - bottom.bit_length()


def _more_bits(bits: int, part: float) -> int:
    """Bits that may suffice for all rows where so many sufficed for a part."""
    return int(min(max(1.1 * bits / max(part, 1e-9), 2.0 * bits), 16.0 * bits))


def _enclosures(
    first: list[Fraction], rows: list[list[_Term]], bits: int
) -> list[_Enclosure] | None:
    """Enclose all variables in turn; fewer where one is too wide."""
    found = [_around(value, bits) for value in first]
    for terms in rows:
        check()
        own = max((found[n].bits for term in terms for n in term.before), default=bits)
        rest = [_range(term, found, own) for term in terms if not term.own]
        negated = -sum(high for _, high in rest), -sum(low for low, _ in rest)
        ends = _quotient(negated, _slope([term for term in terms if term.own], found, own))
        if ends is None:
            return None
        if ends[1] - ends[0] > 1 << max(own - _NARROW, 0):
            break
        found.append(_rounded(*ends, own))
    return found


def _around(value: Fraction, bits: int) -> _Enclosure:
    """A rational number between ends in units of 2**-bits."""
    top, bottom = value.numerator << bits, value.denominator
    return _Enclosure(top // bottom, -(-top // bottom), bits)


def _rounded(low: int, high: int, bits: int) -> _Enclosure:
    """Ends with as many bits as their width leaves a meaning."""
    drop = max((high - low).bit_length() - _WIDE, 0)
    return _Enclosure(*_shifted(low, high, -drop), bits - drop)


def _range(term: _Term, found: list[_Enclosure], bits: int) -> Ends:
    """The range of a term without its own variable, in units of 2**-bits."""
    whole, exponent, before, _ = term
    if not before:
        return _shifted(whole, whole, exponent + bits)
    low, high, unit = found[before[0]]
    for number in before[1:]:
        a, b, more = found[number]
        ends = low * a, low * b, high * a, high * b
        low, high = _shifted(min(ends), max(ends), -more)
    if whole < 0:
        low, high = high, low
    return _shifted(whole * low, whole * high, exponent + bits - unit)


def _shifted(low: int, high: int, exponent: int) -> Ends:
    """Ends times a power of two, rounded outwards."""
    if exponent >= 0:
        return low << exponent, high << exponent
    return low >> -exponent, -(-high >> -exponent)


def _slope(terms: list[_Term], found: list[_Enclosure], bits: int) -> tuple[int, int, int]:
    """Ends of the slope in units of a power of two, and its exponent."""
    if not terms:
        return 0, 0, 0
    if any(term.before for term in terms):
        parts = [_range(term, found, bits) for term in terms]
        return sum(a for a, _ in parts), sum(b for _, b in parts), -bits
    least = min(term.exponent for term in terms)
    value = sum(term.whole << term.exponent - least for term in terms)
    return value, value, least


def _quotient(ends: Ends, slope: tuple[int, int, int]) -> Ends | None:
    """The quotients of ends by a slope, None where the slope may be zero."""
    low, high = ends
    least, most, exponent = slope
    if most < 0:
        low, high, least, most = -high, -low, -most, -least
    if least <= 0:
        return None
    if exponent < 0:
        low, high = low << -exponent, high << -exponent
    else:
        least, most = least << exponent, most << exponent
    return low // (most if low >= 0 else least), -(-high // (least if high >= 0 else most))


def _as_doubles(
    x: NDArray[np.float64], solved: NDArray[np.int64], found: list[_Enclosure]
) -> Interval:
    low, high = x.copy(), x.copy()
    for variable, (a, b, bits) in zip(solved.tolist(), found, strict=True):
        low[variable], high[variable] = _double_below(a, bits), -_double_below(-b, bits)
    return Interval(low, high)


def _double_below(value: int, bits: int) -> float:
    """The double that the leading bits of value * 2**-bits, rounded down, are."""
    drop = max(value.bit_length() - _SIGNIFICANT, 0)
    top, exponent = value >> drop, drop - bits
    if exponent >= _LEAST_EXPONENT:  # ldexp rounds nothing
        try:
            return ldexp(top, exponent)
        except OverflowError:
            pass
    scaled = Fraction(top << exponent) if exponent >= 0 else Fraction(top, 1 << -exponent)
    return float(Interval.of_fraction(scaled).lo)
