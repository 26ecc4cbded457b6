"""Zeros and ratios of uncertain trigonometric polynomials over a set of parameters, on arcs.

The polynomials and their Taylor forms are those of :mod:`setid.proofs.frequency.arcs`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from setid.control.parameters.parameter_set import ParameterSet
from setid.proofs.frequency.arcs import (
    DEGREE,
    Arc,
    Family,
    bernstein,
    first_arcs,
    halves,
    taylor,
)

__all__ = ["Arc", "Ceiling", "Family", "first_arcs", "ratio_on_arcs", "zero_free"]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_LEAST = 1e-6  # half width below which an arc is given up
_MOST = 4000  # arcs of one question
_NEAR = 1e-12  # rad, of ends that are one
_TURNS = (0.0, 0.6, -0.6, 1.1, -1.1)  # rad, of half planes that are tried
_OCTAGON = 1.0 / np.cos(pi / 8) * (1.0 + 1e-12)
_MATRIX = bernstein(DEGREE)


def _taylor(size: int, shift: float, arcs: Sequence[Arc]) -> tuple[Complexes, Reals, Reals]:
    """Bernstein points as combinations (arcs, d + 1, K) of coefficients, and what they lose."""
    powers, rest, rounding = taylor(size, shift, arcs)
    return np.einsum("im,amk->aik", _MATRIX, powers), rest, rounding


def _lost(
    found: ParameterSet, family: Family, reference: Reals, rest: Reals, rounding: Reals
) -> Reals:
    """Remainder and rounding errors (arcs,) over a set and a reference."""
    low, high = found.ranges(family.constants, family.weights)
    size = np.maximum(np.maximum(np.abs(low), np.abs(high)), np.abs(family.at(reference)))
    ends = found.box
    reach = np.maximum(np.maximum(np.abs(ends[0]), np.abs(ends[1])), np.abs(reference))
    summed = np.abs(family.constants) + np.abs(family.weights) @ reach
    return np.asarray((rest @ size + rounding @ summed) * (1.0 + 1e-12), np.float64)


# ---- zeros ------------------------------------------------------------------------------


def zero_free(
    found: ParameterSet,
    family: Family,
    reference: Reals,
    hint: Sequence[float] = (),
    until: float = inf,
) -> list[float]:
    """Prove that a family has no zero on the unit circle, on the set joined with a reference.

    On each arc a half plane is found that contains f(w; theta) for every theta of the set and for
    the reference, hence on all segments between them as well.

    Parameters
    ----------
    found : ParameterSet
    family : Family
    reference : (p,) float
    hint : sequence of float
        Frequencies that are looked at first.
    until : float
        Reading of ``time.monotonic`` after which no arc is halved.

    Returns
    -------
    list of float
        Frequencies at which the proof failed; empty where it succeeded.

    References
    ----------
    J. Ackermann, Robust Control, 2nd ed. 2002, section 4.1 (zero exclusion).
    """
    unproved, count = first_arcs(), 0
    if hint:
        known = _half_planes(found, family, reference, [(w, 0.0) for w in hint])
        if not np.all(known):
            return [w for w, ok in zip(hint, known, strict=True) if not ok]
    while unproved:
        count += len(unproved)
        clear = _half_planes(found, family, reference, unproved)
        failed = [arc for arc, ok in zip(unproved, clear, strict=True) if not ok]
        bad = [arc[0] for arc in failed if arc[1] < _LEAST]
        if bad or count > _MOST or time.monotonic() > until:
            return bad or [arc[0] for arc in failed]
        if failed:
            single = _half_planes(found, family, reference, [(arc[0], 0.0) for arc in failed])
            if not np.all(single):
                return [arc[0] for arc, ok in zip(failed, single, strict=True) if not ok]
        unproved = [half for arc in failed for half in halves(arc)]
    return []


def _half_planes(
    found: ParameterSet, family: Family, reference: Reals, arcs: Sequence[Arc]
) -> NDArray[np.bool_]:
    """For each arc, whether one of a few half planes contains all values of the family."""
    points, rest, rounding = _taylor(family.constants.size, family.shift, arcs)
    bound = _lost(found, family, reference, rest, rounding)
    own = np.einsum("aik,k->ai", points, family.at(reference))
    middle = own.mean(axis=1)
    clear = np.zeros(len(points), bool)
    for angle in _TURNS:
        unclear = np.flatnonzero(~clear)
        if not unclear.size:
            break
        size = np.maximum(np.abs(middle[unclear]), 1e-300)
        turn = np.conj(middle[unclear] / size) * np.exp(1j * angle)
        rotated = (points[unclear] * turn[:, None, None]).real
        flat = rotated.reshape(-1, rotated.shape[2])
        low, _ = found.ranges(flat @ family.constants, flat @ family.weights)
        least = low.reshape(rotated.shape[:2]).min(axis=1)
        mine = (own[unclear] * turn[:, None]).real.min(axis=1)
        clear[unclear] = (least > bound[unclear]) & (mine > bound[unclear])
    return clear


# ---- ratios -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Ceiling:
    """Bounds of a ratio that are to be proved, constant between neighbouring frequencies.

    Parameters
    ----------
    ends : (K + 1,) float
        Increasing, rad a sample.
    values : (K,) float
    """

    ends: Reals
    values: Reals

    @staticmethod
    def of(arcs: Sequence[tuple[float, float, float]]) -> Ceiling:
        """Take the largest bound of the arcs that contain a frequency; -inf where none does.

        Ends of neighbouring arcs may differ by a rounding error.
        """
        table = np.reshape(np.array(arcs, float), (-1, 3))
        ends = _apart(np.unique(np.concatenate([[0.0, pi], table[:, 0], table[:, 1]])))
        middle = (ends[:-1] / 2 + ends[1:] / 2)[:, None]
        inside = (table[:, 0] <= middle) & (middle <= table[:, 1])
        values = np.where(inside, table[:, 2], -inf).max(axis=1, initial=-inf)
        return Ceiling(ends, np.asarray(values, np.float64))

    def over(self, low: float, high: float) -> float:
        """Find the least bound that is asked for between two frequencies."""
        first = int(np.searchsorted(self.ends, low + 2 * _NEAR, "right")) - 1
        last = int(np.searchsorted(self.ends, high - 2 * _NEAR, "left"))
        return float(self.values[first : max(last, first + 1)].min(initial=inf))


def _apart(ends: Reals) -> Reals:
    """Take increasing ends, none of them near the last one that is taken."""
    kept = [ends[0]]
    for end in ends[1:]:
        if end - kept[-1] > _NEAR:
            kept.append(end)
    return np.array(kept)


def ratio_on_arcs(
    found: ParameterSet,
    top: Family,
    below: Family,
    reference: Reals,
    enough: float,
    arcs: Sequence[Arc] | None = None,
    until: float = inf,
    ceiling: Ceiling | None = None,
) -> list[tuple[float, float, float]]:
    """Bound abs(top / below) on arcs that cover [0, pi], with proof.

    With a nominal ratio g at the centre, top / below - g = (top - g below) / below, and both are
    affine in theta: the excess is of second order in the widths.

    Parameters
    ----------
    found : ParameterSet
    top, below : Family
    reference : (p,) float
        Nominal parameters.
    enough : float
        Arcs whose bound is no larger are not refined.
    arcs : sequence of (centre, half width), optional
    until : float
        Reading of ``time.monotonic`` after which no arc is halved.
    ceiling : Ceiling, optional
        What is to be proved on each arc, in place of ``enough``.

    Returns
    -------
    list of (from, to, bound)
        In the order of frequency; infinite where ``below`` may vanish.
    """
    size = max(top.constants.size, below.constants.size)
    top, below = top.padded(size), below.padded(size)
    coarse, done, count = list(arcs or first_arcs()), list[tuple[Arc, float]](), 0
    while coarse:
        count += len(coarse)
        bounds = _ratios(found, top, below, reference, coarse)
        floor = _ratios(found, top, below, reference, [(c, 0.0) for c, _ in coarse])
        following: list[Arc] = []
        late = count > _MOST or time.monotonic() > until
        for arc, bound, least in zip(coarse, bounds, floor, strict=True):
            close = bound <= max(enough, 1.05 * least)
            if ceiling is not None:
                close = bound <= ceiling.over(*_ends(arc)) or least > ceiling.over(arc[0], arc[0])
            hopeless = not bound < np.inf and not least < np.inf
            if close or hopeless or arc[1] < _LEAST or late:
                done.append((arc, float(bound)))
            else:
                following += halves(arc)
        coarse = following
    return sorted((*_ends(arc), bound) for arc, bound in done)


def _ends(arc: Arc) -> tuple[float, float]:
    return max(arc[0] - arc[1], 0.0), min(arc[0] + arc[1], pi)


def _ratios(
    found: ParameterSet, top: Family, below: Family, reference: Reals, arcs: Sequence[Arc]
) -> Reals:
    """Bounds (arcs,) of abs(top / below)."""
    points, rest, rounding = _taylor(top.constants.size, top.shift, arcs)
    own = [np.einsum("aik,k->ai", points, f.at(reference)).mean(axis=1) for f in (top, below)]
    pivot = np.where(own[1] == 0, 1e-300, own[1])
    g = own[0] / pivot
    unit = points / pivot[:, None, None]
    flat = unit.reshape(-1, unit.shape[2])
    wide = np.repeat(g, unit.shape[1])[:, None]
    weights = flat @ top.weights - wide * (flat @ below.weights)
    constants = flat @ top.constants - wide[:, 0] * (flat @ below.constants)
    away = _moduli(found, constants, weights).reshape(unit.shape[:2]).max(axis=1)
    low, _ = found.ranges((flat @ below.constants).real, (flat @ below.weights).real)
    least = low.reshape(unit.shape[:2]).min(axis=1)
    lost = [_lost(found, f, reference, rest, rounding) / np.abs(pivot) for f in (top, below)]
    away = (away + lost[0] + np.abs(g) * lost[1]) * (1.0 + 1e-12)
    least = least - lost[1] * (1.0 + 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = (np.abs(g) + away / least) * (1.0 + 1e-12)
    return np.where(least > 0, bound, np.inf)


def _moduli(found: ParameterSet, constants: Complexes, weights: Complexes) -> Reals:
    """Upper bounds of abs(constants + weights theta) from eight half planes."""
    turns = np.exp(1j * pi / 4 * np.arange(4))
    ends = []
    for turn in turns:
        low, high = found.ranges((constants * turn).real, (weights * turn).real)
        ends.append(np.maximum(np.abs(low), np.abs(high)))
    octagon = np.max(ends, axis=0) * _OCTAGON
    rectangle = np.minimum(np.hypot(ends[0], ends[2]), np.hypot(ends[1], ends[3]))
    return np.minimum(octagon, rectangle * (1.0 + 1e-12))
