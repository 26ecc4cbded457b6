"""Bound what a dense Gram matrix hides in its constant, without elimination in fractions.

Elimination of some hundred dense rows in fractions takes minutes. Where Q - d I is semidefinite
for some d > 0, any point u will do instead:

    q' Q^-1 q  =  -(u' Q u + 2 q' u) + r' Q^-1 r  <=  -u' (r + q) + r' r / d,    r = Q u + q.

That Q - d I is semidefinite is shown in floating point
(:func:`~sparsepop_py.verified.arithmetic.definiteness.surely_semidefinite`), after powers of two
have scaled the diagonal to about 1. All the rest is computed in whole numbers, and u is refined
until r is so small that its square no longer counts.

Other dense matrices are eliminated in whole numbers: after each step all of them are minors, and
the last pivot divides them.

References
----------
E. H. Bareiss, Sylvester's identity and multistep integer-preserving Gaussian elimination, Math.
Comp. 22 (1968) 565-578.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import gcd, lcm
from operator import mul

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import check
from sparsepop_py.verified.arithmetic.definiteness import surely_semidefinite
from sparsepop_py.verified.arithmetic.interval import Interval, down, up

__all__ = ["hidden_by_definite", "hidden_by_minors"]

Rows = dict[int, dict[int, Fraction]]

_PLACES = 160  # binary places of u
_CUT = 2**120  # u with so many places less is tried too: what is a short number is met exactly
_ROUNDS = 8  # refinements: each gains some ten digits of r, less where Q is ill-conditioned
_ENOUGH = Fraction(1, 2**120)  # relative: what r costs then is no part of a double
_LONGEST = 4000  # bits of the common denominator
_SAFE = 0.5  # share of the least eigenvalue that d is


def hidden_by_definite(rows: Rows) -> Fraction | None:
    """Bound q' Q^-1 q from above, row 0 = q, the others a definite Q.

    Parameters
    ----------
    rows : dict of int to dict of int to Fraction
        A symmetric matrix without the entry (0, 0); not changed.

    Returns
    -------
    Fraction or None
        Larger than the value by less than 2^-120 of it where u is accurate. None where Q is not
        clearly definite, numbers are long, or the value is not well approximated.

    Examples
    --------
    >>> one, two = Fraction(1), Fraction(2)
    >>> float(hidden_by_definite({0: {1: two}, 1: {0: two, 1: two, 2: one}, 2: {1: one, 2: two}}))
    2.6666666666666665
    """
    used = [i for i, row in rows.items() if i and row]
    if not used:
        return Fraction(0)
    diagonal = [rows[i].get(i, Fraction(0)) for i in used]
    if min(diagonal) <= 0:
        return None
    scale = [_binary_places(value) for value in diagonal]
    found = _whole([{j: v for j, v in rows[i].items() if j} for i in used], used, scale)
    if found is None:
        return None
    inverse = _inverse(*found)
    if inverse is None:
        return None
    q = [rows[0].get(i, Fraction(0)) * Fraction(2) ** e for i, e in zip(used, scale, strict=True)]
    return _refined(*found, q, *inverse)


def _whole(
    lines: list[dict[int, Fraction]], used: list[int], scale: list[int]
) -> tuple[list[dict[int, int]], int] | None:
    """Scale by powers of two; return whole numbers and their common denominator."""
    under = lcm(*(v.denominator for line in lines for v in line.values()))
    least, place = min(0, *scale), {i: k for k, i in enumerate(used)}
    if under.bit_length() + 2 * (max(scale) - least) > _LONGEST:
        return None
    return [
        {
            place[j]: v.numerator * (under // v.denominator) << e + scale[place[j]] - 2 * least
            for j, v in line.items()
        }
        for line, e in zip(lines, scale, strict=True)
    ], under << -2 * least


def _binary_places(value: Fraction) -> int:
    """Choose e such that 4^e times a value > 0 lies near 1."""
    return -((value.numerator.bit_length() - value.denominator.bit_length()) // 2)


def _inverse(
    whole: list[dict[int, int]], under: int
) -> tuple[NDArray[np.float64], Fraction] | None:
    """Compute Q^-1 roughly, and a d for which Q - d I is proved semidefinite."""
    middle = np.zeros((len(whole), len(whole)))
    for i, row in enumerate(whole):
        check()
        for j, v in row.items():
            if abs(v) > 8 * under:  # larger than a definite matrix has beside such diagonals
                return None
            middle[i, j] = v / under  # correctly rounded
    least = float(np.linalg.eigvalsh(middle)[0])
    if not least > 0.0:
        return None
    d = 2.0 ** np.floor(np.log2(_SAFE * least))
    shift = d * np.eye(len(whole))
    if not surely_semidefinite(Interval(down(middle), up(middle)) - Interval.point(shift)):
        return None
    return np.asarray(np.linalg.inv(middle), np.float64), Fraction(float(d))


def _refined(
    whole: list[dict[int, int]],
    under: int,
    q: list[Fraction],
    inverse: NDArray[np.float64],
    d: Fraction,
) -> Fraction | None:
    """Refine u, and compute the bound with it."""
    u, one = [0] * len(q), 2**_PLACES
    lines = [(list(row), list(row.values())) for row in whole]

    def residual(u: list[int]) -> list[Fraction]:
        sums = (sum(map(mul, values, [u[j] for j in places])) for places, values in lines)
        return [Fraction(s, under * one) + value for s, value in zip(sums, q, strict=True)]

    for _ in range(_ROUNDS):
        check()
        r = residual(u)
        found, lost = _bound(u, r, q, d)
        if lost <= _ENOUGH * found:
            short = [round(Fraction(v, _CUT)) * _CUT for v in u]
            r = residual(short)
            return found if any(r) else _bound(short, r, q, d)[0]
        size = max(map(abs, r))
        step = inverse @ np.array([float(v / size) for v in r])
        u = [a - round(Fraction(s) * size * one) for a, s in zip(u, step.tolist(), strict=True)]
    return None


def _bound(
    u: list[int], r: list[Fraction], q: list[Fraction], d: Fraction
) -> tuple[Fraction, Fraction]:
    """Compute -u' (r + q) + r' r / d, and its second part."""
    lost = sum((v * v for v in r), Fraction(0)) / d
    taken = sum((a * (b + c) for a, b, c in zip(u, r, q, strict=True)), Fraction(0))
    return lost - taken / 2**_PLACES, lost


def hidden_by_minors(rows: Rows) -> Fraction | None:
    """Compute q' Q^+ q, row 0 being q, by elimination in whole numbers.

    Parameters
    ----------
    rows : dict of int to dict of int to Fraction
        A symmetric matrix without the entry (0, 0); not changed.

    Returns
    -------
    Fraction or None
        None unless Q is semidefinite, with q in its range.

    Examples
    --------
    >>> one, two = Fraction(1), Fraction(2)
    >>> line = {0: two, 1: one, 2: one}
    >>> hidden_by_minors({0: {1: two, 2: two}, 1: line, 2: line})
    Fraction(4, 1)
    """
    order = [*sorted(i for i in rows if i), 0]
    under = _whole_by(v for i in order[:-1] for j, v in rows[i].items() if j)
    of_q = _whole_by(rows[0].values())
    upper = [
        [int(rows[i].get(j, 0) * (under if j else of_q)) for j in order[place:]]
        for place, i in enumerate(order)
    ]
    before = 1
    for place in range(len(order) - 1):
        check()
        pivot, *beside = upper[place]
        if pivot < 0 or (not pivot and any(beside)):
            return None
        if not pivot:
            continue
        for k, factor in enumerate(beside):
            old = upper[place + 1 + k]
            upper[place + 1 + k] = [
                (pivot * a - factor * b) // before for a, b in zip(old, beside[k:], strict=True)
            ]
        before = pivot
    return Fraction(-upper[-1][0], before) * under / of_q**2


def _whole_by(values: Iterable[Fraction]) -> Fraction:
    """Choose the least factor that makes numbers whole; 1 where all are zero."""
    kept = [v for v in values if v]
    under = lcm(*(v.denominator for v in kept))
    return Fraction(under, gcd(*(int(v * under) for v in kept)) or 1)
