"""Polynomials with all roots in a disc, as linear and bilinear rows with boxed unknowns.

Of ``lead + c_1 q^-1 + ... + c_n q^-n`` with lead >= 0, the closure of "all roots z satisfy
abs(z) <= r" is described by

- n = 1: ``abs(c_1) <= r lead``;
- n = 2: the triangle ``abs(c_2) <= r^2 lead``, ``r^2 lead +- r c_1 + c_2 >= 0``, where r^2 is
  rounded upwards for lead 1, so that no polynomial is lost;
- n > 2: the step-up recursion ``s_m = [s_{m-1}, 0] + k_m reverse([s_{m-1}, 0])`` from a point
  s_2 of the triangle, with reflection coefficients k_m in [-1, 1] and s_n the scaled
  coefficients. Its image of the closed cube is the closure of the stable set. (Jury's
  closed inequalities admit more: the roots 1, 2, 0.5 pass.)

References
----------
L. B. Jackson, Digital Filters and Signal Processing, 3rd ed. 1996, section 11.6 (lattice).
A. T. Fam, J. S. Meditch, "A canonical parameter space for linear systems design", IEEE
Trans. Automatic Control 23 (1978) 454-458 (the triangle and its generalisation).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval

__all__ = [
    "disc_rows",
    "disc_unknowns",
    "rounded_up",
    "step_down",
    "unknown_values",
]

Box = tuple[float, float]


def rounded_up(value: Fraction) -> float:
    """Find the least double that is no smaller."""
    return float(Interval.of_fraction(value).hi)


def step_down(coefficients: ArrayLike) -> list[NDArray[np.float64]]:
    """Compute coefficients of degree 1, ..., n of the step-up recursion to the given ones.

    Where a reflection coefficient has absolute value 1 the recursion cannot be inverted;
    the roots are then pulled inwards a little, which the last entry keeps silent about.
    """
    top = np.array(coefficients, float)
    for shrink in (0.0, 1e-9, 1e-7, 1e-5, 1e-3, 1e-1, 0.5, 1.0):
        levels = [top * (1.0 - shrink) ** np.arange(1, top.size + 1)]
        while levels[0].size > 1 and abs(levels[0][-1]) < 1.0:
            k, rest = levels[0][-1], levels[0][:-1]
            levels.insert(0, (rest - k * rest[::-1]) / ((1.0 - k) * (1.0 + k)))
        if levels[0].size <= 1:
            break
    return [*levels[:-1], top]


def disc_unknowns(degree: int, monic: bool, label: str) -> dict[str, Box]:
    """Name the unknowns that :func:`disc_rows` needs, with their boxes."""
    if degree <= 2:
        return {}
    found = {
        _level(label, m, i): (-float(comb(m, i)), float(comb(m, i)))
        for m in range(2, degree)
        for i in range(1, m + 1)
    }
    if not monic:
        top = range(1, degree + 1)
        found |= {
            _level(label, degree, i): (-float(comb(degree, i)), float(comb(degree, i))) for i in top
        }
    return found


def _level(label: str, m: int, i: int) -> str:
    return f"{label}.k{m}" if i == m else f"{label}.s{m}_{i}"


def disc_rows(
    lead: sp.Polynomial | None,
    rest: Sequence[sp.Polynomial],
    radius: float,
    unknowns: Mapping[str, sp.Polynomial],
    label: str,
) -> list[sp.Constraint]:
    """State rows for all roots in the closed disc.

    Parameters
    ----------
    lead : Polynomial or None
        Leading coefficient, known to be >= 0; None for 1.
    rest : sequence of Polynomial
        c_1, ..., c_n.
    radius : float
        Positive.
    unknowns : mapping of str to Polynomial
        Those of :func:`disc_unknowns`.
    label : str
    """
    n = len(rest)
    if n == 0:
        return []
    one = rest[0] * 0.0 + 1.0
    if lead is None and n == 2:
        square = rounded_up(Fraction(radius) ** 2)
        return _triangle(one * square, rest[0] * radius, rest[1])
    head = one if lead is None else lead
    scaled = [c * (1 / Fraction(radius) ** i) for i, c in enumerate(rest, 1)]
    if n == 1:
        return [head - scaled[0] >= 0, head + scaled[0] >= 0]
    if n == 2:
        return _triangle(head, *scaled)
    rows = [  # implied, and a help for relaxations: the values at z = r and z = -r
        sp.total([head, *scaled]) >= 0,
        sp.total([head, *(c * (-1.0) ** i for i, c in enumerate(scaled, 1))]) >= 0,
    ]
    if lead is not None:
        ratios = [unknowns[_level(label, n, i)] for i in range(1, n + 1)]
        rows += [c - lead * ratio == 0 for c, ratio in zip(scaled, ratios, strict=True)]
        scaled = ratios
    return [*rows, *_recursion(one, scaled, unknowns, label)]


def _triangle(
    head: sp.Polynomial, first: sp.Polynomial, second: sp.Polynomial
) -> list[sp.Constraint]:
    return [head + first + second >= 0, head - first + second >= 0, head - second >= 0]


def _recursion(
    one: sp.Polynomial,
    top: Sequence[sp.Polynomial],
    unknowns: Mapping[str, sp.Polynomial],
    label: str,
) -> list[sp.Constraint]:
    n = len(top)
    below = [unknowns[_level(label, 2, i)] for i in (1, 2)]
    rows = _triangle(one, *below)[:2]  # the third is the box of k_2
    for m in range(3, n + 1):
        here = list(top) if m == n else [unknowns[_level(label, m, i)] for i in range(1, m + 1)]
        k = here[-1]
        rows += [here[i] - below[i] - k * below[m - 2 - i] == 0 for i in range(m - 1)]
        below = here
    return rows


def unknown_values(
    lead: float, rest: ArrayLike, radius: float, monic: bool, label: str
) -> dict[str, float]:
    """Compute values of the unknowns for given coefficients."""
    values = np.asarray(rest, float)
    n = values.size
    if n <= 2:
        return {}
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = values / radius ** np.arange(1, n + 1) / lead
    levels = step_down(np.where(np.isfinite(scaled), scaled, 0.0))
    tops = range(2, n) if monic else range(2, n + 1)
    by_size = {level.size: level for level in levels}
    blank = {m: np.zeros(m) for m in tops}
    return {
        _level(label, m, i): float(by_size.get(m, blank[m])[i - 1])
        for m in tops
        for i in range(1, m + 1)
    }
