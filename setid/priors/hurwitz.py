"""Polynomials with all roots in the closed left half plane, as rows with few unknowns.

Of ``s^n + c_1 s^(n-1) + ... + c_n`` the closure of "all roots have real part <= 0" is

- n = 1, 2: all c_i >= 0;
- n = 3: all c_i >= 0 and c_1 c_2 >= c_3 (Routh);
- n > 3: Schwarz's recursion ``D_m = s D_(m-1) + k_m D_(m-2)`` with k_m >= 0 from D_1 = s + k_1,
  D_0 = 1. Positive k give exactly the Hurwitz polynomials. Because c_1 = k_1 and
  c_2 = k_2 + ... + k_n, coefficients that are bounded have bounded k, so that the image of
  all k >= 0 is closed: it is the closure.

References
----------
H. S. Wall, "Polynomials whose zeros have negative real parts", Amer. Math. Monthly 52
(1945) 308-322 (the continued fraction).
H. R. Schwarz, "Ein Verfahren zur Stabilitaetsfrage bei Matrizen-Eigenwertproblemen",
ZAMP 7 (1956) 473-500 (the recursion).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import comb, inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.priors.stability import rounded_up

__all__ = ["half_plane_rows", "half_plane_unknowns", "half_plane_values", "schwarz_parameters"]

Box = tuple[float, float]


def _shift(degree: int, margin: float) -> list[list[Fraction]]:
    """Matrix from the coefficients of D(s), leading one first, to those of D(s - margin)."""
    zero, step = Fraction(0), -Fraction(margin)
    return [
        [comb(degree - j, i - j) * step ** (i - j) if j <= i else zero for j in range(degree + 1)]
        for i in range(degree + 1)
    ]


def half_plane_unknowns(degree: int, monic: bool, label: str) -> dict[str, Box]:
    """Name the unknowns that :func:`half_plane_rows` needs, with their boxes."""
    if degree <= 3:
        return {}
    found: dict[str, Box] = {_k(label, m): (0.0, inf) for m in range(2, degree + 1)}
    for m in range(3, degree):
        found |= {_inner(label, m, i): (0.0, inf) for i in range(2, m + 1)}
    if not monic:
        found |= {_inner(label, degree, i): (0.0, inf) for i in range(1, degree + 1)}
    return found


def _k(label: str, m: int) -> str:
    return f"{label}.k{m}"


def _inner(label: str, m: int, i: int) -> str:
    return f"{label}.s{m}_{i}"


def half_plane_rows(
    lead: sp.Polynomial | None,
    rest: Sequence[sp.Polynomial],
    margin: float,
    unknowns: Mapping[str, sp.Polynomial],
    label: str,
) -> list[sp.Constraint]:
    """State rows for all roots to the left of -margin, or on that line.

    Parameters
    ----------
    lead : Polynomial or None
        Leading coefficient, known to be >= 0 (> 0 for degrees above 3); None for 1.
    rest : sequence of Polynomial
        c_1, ..., c_n.
    margin : float
    unknowns : mapping of str to Polynomial
        Those of :func:`half_plane_unknowns`.
    label : str
    """
    n = len(rest)
    if n == 0:
        return []
    if margin:
        every = [rest[0] * 0.0 + 1.0 if lead is None else lead, *rest]
        weights = _shift(n, margin)[1:]
        if lead is None and n == 2:  # the only one that is no double: no polynomial is lost
            weights[1][0] = Fraction(rounded_up(weights[1][0]))
        rest = [sp.total(w * c for w, c in zip(row, every, strict=True) if w) for row in weights]
    rows = [c >= 0 for c in rest]
    if n == 3:
        rows.append(rest[0] * rest[1] - (rest[2] if lead is None else lead * rest[2]) >= 0)
    if n <= 3:
        return rows
    top = list(rest)
    if lead is not None:
        top = [unknowns[_inner(label, n, i)] for i in range(1, n + 1)]
        rows += [c - lead * ratio == 0 for c, ratio in zip(rest, top, strict=True)]
    return rows + _recursion(top, unknowns, label)


def _recursion(
    top: list[sp.Polynomial], unknowns: Mapping[str, sp.Polynomial], label: str
) -> list[sp.Constraint]:
    """D_m = s D_(m-1) + k_m D_(m-2) coefficient by coefficient; c_1 = k_1 at every level."""
    n, first = len(top), top[0]
    older: list[sp.Polynomial] = [first]
    old = [first, unknowns[_k(label, 2)]]
    rows = []
    for m in range(3, n + 1):
        here = top if m == n else [first, *(unknowns[_inner(label, m, i)] for i in range(2, m + 1))]
        k = unknowns[_k(label, m)]
        for i in range(2, m + 1):
            carried = k * older[i - 3] if i > 2 else k
            rows.append(here[i - 1] - carried - (old[i - 1] if i < m else 0.0) == 0)
        older, old = old, here
    return rows


def schwarz_parameters(coefficients: ArrayLike) -> NDArray[np.float64]:
    """Compute Schwarz's parameters k_1, ..., k_n: quotients r_m / r_(m-2) of Routh's column.

    The polynomial is s^n + c_1 s^(n-1) + ... + c_n. Where that column has a zero the rest is zero.

    Examples
    --------
    >>> schwarz_parameters([6.0, 11.0, 6.0]).tolist()  # (s + 1)(s + 2)(s + 3)
    [6.0, 10.0, 1.0]
    """
    c = np.append(1.0, np.asarray(coefficients, float))
    n = c.size - 1
    width = n // 2 + 1
    above, here = np.zeros(width + 1), np.zeros(width + 1)
    above[: c[0::2].size], here[: c[1::2].size] = c[0::2], c[1::2]
    column = [above[0], here[0]]
    for _ in range(n - 1):
        if here[0] == 0.0:
            break
        below = np.zeros(width + 1)
        below[:-1] = above[1:] - above[0] / here[0] * here[1:]
        above, here = here, below
        column.append(here[0])
    column += [0.0] * (n + 1 - len(column))
    found = [column[1]]
    for m in range(2, n + 1):
        found.append(column[m] / column[m - 2] if column[m - 2] else 0.0)
    return np.array(found)


def half_plane_values(
    lead: float, rest: ArrayLike, margin: float, monic: bool, label: str
) -> dict[str, float]:
    """Compute values of the unknowns for given coefficients."""
    values = np.asarray(rest, float)
    n = values.size
    if n <= 3:
        return {}
    ratios = (
        (np.array(_shift(n, margin), float) @ np.append(lead, values))[1:] / lead
        if lead
        else np.zeros(n)
    )
    k = schwarz_parameters(ratios)
    found = {_k(label, m): float(k[m - 1]) for m in range(2, n + 1)}
    older, old = np.array([1.0, k[0]]), np.array([1.0, k[0], k[1]])
    for m in range(3, n):
        here = np.append(old, 0.0) + k[m - 1] * np.append([0.0, 0.0], older)
        found |= {_inner(label, m, i): float(here[i]) for i in range(2, m + 1)}
        older, old = old, here
    if not monic:
        found |= {_inner(label, n, i): float(c) for i, c in enumerate(ratios, 1)}
    return found
