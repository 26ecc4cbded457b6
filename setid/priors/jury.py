"""Jury's array of a polynomial, as bilinear rows with its entries as boxed unknowns.

Of p(z) = 1 + c_1 z^-1 + ... + c_n z^-n the array begins with p = (1, c_1, ..., c_n), and each row
q of degree m gives the next one, of degree m - 1, by

    q'_k = q_m q_(m-k) - q_0 q_k,    k = 0, ..., m - 1.

All roots lie inside the unit circle if and only if p(1) > 0, p(-1) > 0, abs(c_n) < 1, and
abs(q_m) < abs(q_0) in each further row down to degree 2. The sign of q_0 is known there, q_0 < 0,
so that the last condition is two linear rows and no quadratic one.

Outer bounds need the closure, and the closed rows say less: where c_n = -1, for instance, all
that is left of degree 3 is c_1 + c_2 = 0, which the roots 1, 2 and 0.5 satisfy. So rows of this
form hold for every stable polynomial and for some that are not; the step-up recursion of
:mod:`setid.priors.stability` describes the closure itself. Points are proved to be stable by
:func:`is_stable`.

References
----------
E. I. Jury, Theory and Application of the z-Transform Method, 1964, chapter 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import comb

import numpy as np
from numpy.typing import ArrayLike

import sparsepop_py as sp

__all__ = ["is_stable", "jury_rows", "jury_unknowns", "jury_values"]

Ends = tuple[Fraction, Fraction]


def jury_unknowns(degree: int, label: str) -> dict[str, tuple[float, float]]:
    """Name the entries of the array and box them, as they lie for stable polynomials.

    Parameters
    ----------
    degree : int
    label : str

    Notes
    -----
    A row of degree m is that of the step-up recursion times a number in [-1, 0], so that entry k
    is at most binomial(m, k) in size.
    """
    found: dict[str, tuple[float, float]] = {}
    for m in range(degree - 1, 1, -1):
        for k in _kept(m):
            size = float(comb(m, k))
            found[_entry(label, m, k)] = (-size, 0.0 if k == 0 else size)
    return found


def _kept(m: int) -> Sequence[int]:
    """Entries of the row of degree m that are used: of the last one, both ends."""
    return range(m + 1) if m > 2 else (0, 2)


def _entry(label: str, m: int, k: int) -> str:
    return f"{label}.q{m}_{k}"


def jury_rows(
    rest: Sequence[sp.Polynomial],
    radius: float,
    unknowns: Mapping[str, sp.Polynomial],
    label: str,
) -> list[sp.Constraint]:
    """State Jury's conditions, closed, for all roots in a disc.

    Parameters
    ----------
    rest : sequence of Polynomial
        c_1, ..., c_n; abs(c_n) <= radius^n is left to the box.
    radius : float
        Positive.
    unknowns : mapping of str to Polynomial
        Those of :func:`jury_unknowns`.
    label : str
    """
    n = len(rest)
    one = rest[0] * 0.0 + 1.0
    above = [one, *(c * (1 / Fraction(radius) ** i) for i, c in enumerate(rest, 1))]
    rows = [
        sp.total(above) >= 0,
        sp.total([c * (-1.0) ** i for i, c in enumerate(above)]) >= 0,
    ]
    if n <= 2:
        return [*rows, one - above[-1] >= 0, one + above[-1] >= 0]
    for m in range(n - 1, 1, -1):
        here = {k: unknowns[_entry(label, m, k)] for k in _kept(m)}
        for k, entry in here.items():
            rows.append(entry - above[m + 1] * above[m + 1 - k] + above[0] * above[k] == 0)
        rows += [-here[0] - here[m] >= 0, here[m] - here[0] >= 0]
        if m > 2:
            above = [here[k] for k in range(m + 1)]
    return rows


def jury_values(rest: ArrayLike, radius: float, label: str) -> dict[str, float]:
    """Compute the entries of the array for given coefficients.

    Parameters
    ----------
    rest : array_like (n,)
        c_1, ..., c_n.
    radius : float
    label : str

    Examples
    --------
    >>> jury_values([-3.5, 3.5, -1.0], 1.0, "stable")  # of the roots 1, 2 and 0.5
    {'stable.q2_0': 0.0, 'stable.q2_2': 0.0}
    """
    values = np.asarray(rest, float)
    above = [1.0, *(values / radius ** np.arange(1, values.size + 1)).tolist()]
    found: dict[str, float] = {}
    for m in range(values.size - 1, 1, -1):
        above = [above[m + 1] * above[m + 1 - k] - above[0] * above[k] for k in range(m + 1)]
        found |= {_entry(label, m, k): above[k] for k in _kept(m)}
    return found


def is_stable(lower: ArrayLike, upper: ArrayLike, radius: float = 1.0) -> bool:
    """Prove that all polynomials with coefficients in a box have their roots in a disc.

    Parameters
    ----------
    lower, upper : array_like (n,)
        Ends of c_1, ..., c_n.
    radius : float

    Returns
    -------
    bool
        Whether the reflection coefficients of the step-up recursion are proved to lie in
        (-1, 1), the last of them in [-1, 1]; by intervals of rationals, so that nothing is
        rounded. False says nothing.

    Examples
    --------
    >>> is_stable([-0.5, 0.2], [-0.5, 0.2]), is_stable([-3.5, 3.5, -1.0], [-3.5, 3.5, -1.0])
    (True, False)
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        return False
    size = Fraction(float(radius))
    pairs = zip(low.tolist(), high.tolist(), strict=True)
    levels: list[Ends] = [
        (Fraction(a) / size**i, Fraction(b) / size**i) for i, (a, b) in enumerate(pairs, 1)
    ]
    while len(levels) > 1:
        k = levels[-1]
        if not -1 < k[0] <= k[1] < 1:
            return False
        squares = (k[0] * k[0], k[1] * k[1])
        below = (1 - max(squares), Fraction(1) if k[0] <= 0 <= k[1] else 1 - min(squares))
        levels = [_quotient(_minus(s, _times(k, r)), below) for s, r in _pairs(levels)]
    return all(-1 <= a <= b <= 1 for a, b in levels)


def _pairs(levels: list[Ends]) -> list[tuple[Ends, Ends]]:
    return list(zip(levels[:-1], levels[-2::-1], strict=True))


def _times(one: Ends, other: Ends) -> Ends:
    corners = [a * b for a in one for b in other]
    return min(corners), max(corners)


def _minus(one: Ends, other: Ends) -> Ends:
    return one[0] - other[1], one[1] - other[0]


def _quotient(top: Ends, below: Ends) -> Ends:
    """The quotient by a positive interval."""
    corners = [a / b for a in top for b in below]
    return min(corners), max(corners)
