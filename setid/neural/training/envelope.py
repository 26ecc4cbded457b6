"""Piecewise polynomials that stay within a proved distance of an activation.

On each piece a Chebyshev fit p is proved by subdivision: on a cell with middle m and half width h,
|f - p| <= |f(m) - p(m)| + h max |f' - p'|, all in interval arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import ModelError, Verification
from setid.data.checks import natural, number, word
from setid.neural.arithmetic import Interval, enclose, slope_at, up
from setid.neural.status import agreed
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Envelope", "envelope"]

Reals = NDArray[np.float64]
_SMOOTH = ("tanh", "sigmoid", "algebraic")
_MOST = 10**6  # pieces, and cells of each
_HIGHEST = 100  # degree


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Envelope(ReadOnly):
    """Polynomials p_i with abs(activation(a) - p_i(a - centre_i)) <= eps on each piece.

    Parameters
    ----------
    name : str
        The activation.
    breaks : (pieces + 1,) float
    centres : (pieces,) float
    coefficients : (pieces, degree + 1) float
        From the constant upwards, in a - centre.
    eps : float
        Proved, for real arithmetic.
    cells : int
        Subdivision of each piece that proves it.
    """

    name: str
    breaks: Reals
    centres: Reals
    coefficients: Reals
    eps: float
    cells: int

    def __call__(self, a: ArrayLike) -> Reals:
        """Evaluate the polynomials in floating point, constant beyond the ends."""
        x = np.clip(np.asarray(a, float), self.breaks[0], self.breaks[-1])
        piece = np.clip(np.searchsorted(self.breaks, x) - 1, 0, len(self.centres) - 1)
        t, value = x - self.centres[piece], np.zeros_like(x)
        for k in range(self.coefficients.shape[1] - 1, -1, -1):
            value = value * t + self.coefficients[piece, k]
        return value

    @as_verdict
    def verify(self) -> Verification:
        """Prove the distance again from the coefficients."""
        if not self._pieces_fit():
            return Verification(False, "the pieces are not those between increasing breaks")
        found = np.max(
            [
                _distance(self.name, self.breaks[i : i + 2], self.centres[i], c, self.cells)
                for i, c in enumerate(self.coefficients)
            ]
        )
        return agreed((bool(found <= self.eps), "the distance is not proved"))

    def _pieces_fit(self) -> bool:
        """Check for one polynomial between each pair of neighbouring breaks, all of it finite."""
        tables = (self.breaks, self.centres, self.coefficients)
        count = self.breaks.size - 1
        shapes = self.breaks.ndim == 1 and self.centres.shape == (count,)
        if not shapes or self.coefficients.ndim != 2 or len(self.coefficients) != count:
            return False
        finite = all(np.all(np.isfinite(table)) for table in tables)
        full = count > 0 and self.coefficients.shape[1] > 1 and 0 < self.cells <= _MOST
        return bool(finite and full and self.name in _SMOOTH and np.all(np.diff(self.breaks) > 0))

    def __repr__(self) -> str:
        pieces, degree = len(self.centres), self.coefficients.shape[1] - 1
        eps = rounded(self.eps, True, 3)
        return f"<Envelope: {self.name} within {eps}, {pieces} pieces, degree {degree}>"


def envelope(
    name: str, low: float, high: float, pieces: int = 1, degree: int = 5, cells: int = 2000
) -> Envelope:
    """Fit polynomials to a smooth activation and prove their distance from it.

    Parameters
    ----------
    name : {"tanh", "sigmoid", "algebraic"}
    low, high : float
        Range of the argument.
    pieces, degree, cells : int
        Pieces of equal length, their degree, and the cells that prove each.

    Returns
    -------
    Envelope

    Raises
    ------
    ModelError
        If the activation is not smooth or the range is empty.

    References
    ----------
    L. N. Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapter 8.

    Examples
    --------
    >>> from setid import neural
    >>> found = neural.envelope("tanh", -2.0, 2.0, pieces=4)
    >>> found.eps < 1e-3, bool(found.verify())
    (True, True)
    """
    word(name, "name", _SMOOTH, ModelError)
    natural(pieces, "pieces", ModelError, 1, _MOST)
    natural(degree, "degree", ModelError, 1, _HIGHEST)
    natural(cells, "cells", ModelError, 1, _MOST)
    low, high = number(low, "low", ModelError), number(high, "high", ModelError)
    if not -np.inf < low < high < np.inf:
        raise ModelError(f"low, high: found {low!r}, {high!r}, expected finite low < high")
    breaks = np.linspace(low, high, pieces + 1)
    centres = 0.5 * (breaks[:-1] + breaks[1:])
    rows = [_fit(name, breaks[i : i + 2], centres[i], degree) for i in range(pieces)]
    eps = max(_distance(name, breaks[i : i + 2], centres[i], c, cells) for i, c in enumerate(rows))
    return Envelope(name, breaks, centres, np.array(rows), eps, cells)


def _fit(name: str, ends: Reals, centre: float, degree: int) -> Reals:
    """Interpolate at Chebyshev points of the piece; odd about 0 where the piece is."""
    half = 0.5 * (ends[1] - ends[0])
    points = np.cos(np.pi * (np.arange(2 * degree + 2) + 0.5) / (2 * degree + 2))
    value = enclose(name, Interval.point(centre + half * points)).middle()
    scaled = np.polynomial.chebyshev.cheb2poly(
        np.polynomial.chebyshev.chebfit(points, value, degree)
    )
    found = np.zeros(degree + 1)
    found[: scaled.size] = scaled / half ** np.arange(scaled.size)
    if centre == 0.0 and name != "sigmoid":
        found[::2] = 0.0
    return found


def _horner(coefficients: Reals, x: Interval) -> Interval:
    value = Interval.point(np.full(x.lo.shape, coefficients[-1]))
    for c in coefficients[-2::-1]:
        value = value * x + Interval.point(np.full(x.lo.shape, c))
    return value


def _distance(name: str, ends: Reals, centre: float, coefficients: Reals, cells: int) -> float:
    """Upper bound of the distance on one piece."""
    edges = np.linspace(ends[0], ends[1], cells + 1)
    edges[0], edges[-1] = ends
    box = Interval(edges[:-1], edges[1:])
    middle = box.middle()
    half = np.maximum(up(box.hi - middle), up(middle - box.lo))
    shift = Interval.point(np.full(cells, centre))
    at = enclose(name, Interval.point(middle))
    gap = at - _horner(coefficients, Interval.point(middle) - shift)
    rise = coefficients[1:] * np.arange(1, coefficients.size)
    exact = Interval.point(coefficients[1:]) * Interval.point(np.arange(1.0, coefficients.size))
    slack = up(exact.hi - exact.lo)  # rounding of the derivative's coefficients
    steep = _slope(name, box) - _horner(rise, box - shift)
    reach = up(np.abs(ends).max() + abs(centre)) ** np.arange(slack.size)
    extra = up(np.sum(slack * reach) * (1.0 + 1e-10))
    return float(np.max(up(gap.magnitude() + up(half * up(steep.magnitude() + extra)))))


def _slope(name: str, box: Interval) -> Interval:
    """Range of the derivative, which falls on both sides of 0."""
    one, two = slope_at(name, box.lo), slope_at(name, box.hi)
    low, high = np.minimum(one.lo, two.lo), np.maximum(one.hi, two.hi)
    top = slope_at(name, np.zeros_like(box.lo)).hi
    inside = (box.lo <= 0) & (box.hi >= 0)
    return Interval(low, np.where(inside, top, high))
