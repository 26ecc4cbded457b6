"""Proved regions of frequency responses between grid points: on whole arcs of the unit circle.

With G = N / D, a nominal g(t) = g0 (1 + g1 t) for t in [-1, 1] along the arc and D0 = D(theta0)
at its centre, e = (N - g D) / D0 and q = D / D0 are polynomials in t with coefficients affine in
theta, up to Taylor remainders. Their Bernstein points are bounded by linear programs, and
G - g = e / q, as at a single frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from setid.models.equations import Transfer
from setid.proofs.frequency.arcs import DEGREE, Arc, Family, bernstein, taylor
from setid.proofs.frequency.regions import angles_of, gains_of, quotient_rectangle
from setid.proofs.supports import Cover, Multipliers, supports

__all__ = ["ArcRegions", "arc_regions", "families_of"]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_EPS = float(np.finfo(float).eps)
_NOTHING = np.array([-np.inf, np.inf, -np.inf, np.inf])
_UPPER, _LOWER = bernstein(DEGREE + 1), bernstein(DEGREE)


@dataclass(frozen=True, slots=True, eq=False)
class ArcRegions:
    """Regions of a response: on each arc a rectangle about a point that moves along a line.

    On arc i, at w = centre + half t, the response lies in
    ``turn (gain (1 + slope t) + rectangle)``.

    Parameters
    ----------
    centre, half : (A,) float
        rad a sample.
    turn : (A,) complex
        Of modulus one, up to rounding that the rectangle holds.
    gain : (A,) float
    slope : (A,) complex
    rectangles : (A, 4) float
        West, east, south and north; infinite where nothing is proved.
    """

    centre: Reals
    half: Reals
    turn: Complexes
    gain: Reals
    slope: Complexes
    rectangles: Reals

    @property
    def radius(self) -> Reals:
        """Largest absolute value in each rectangle, (A,)."""
        west, east, south, north = np.abs(self.rectangles).T
        found = np.hypot(np.maximum(west, east), np.maximum(south, north))
        return np.asarray(found * (1.0 + 4 * _EPS), np.float64)

    def joined(self, other: ArcRegions) -> ArcRegions:
        """Join two families of regions on the same arcs.

        The rectangle of the other one is turned, and its moving point is put in a box: the
        difference of the two points is affine in t.
        """
        assert np.array_equal(self.centre, other.centre) and np.array_equal(self.half, other.half)
        turn = other.turn * np.conj(self.turn)
        off, along = turn * other.gain - self.gain, other.gain * other.slope * turn
        along = along - self.gain * self.slope
        with np.errstate(invalid="ignore"):
            west, east, south, north = other.rectangles.T
            corners = turn[:, None] * np.stack(
                [west + 1j * south, east + 1j * south, east + 1j * north, west + 1j * north], axis=1
            )
            real, imaginary = off.real[:, None] + corners.real, off.imag[:, None] + corners.imag
        moves = np.abs(along.real), np.abs(along.imag)
        size = other.gain * (1 + np.abs(other.slope)) + self.gain * (1 + np.abs(self.slope))
        slack = 32 * _EPS * (size + np.abs(other.rectangles).sum(axis=1))
        ends = [
            np.minimum(self.rectangles[:, 0], real.min(axis=1) - moves[0] - slack),
            np.maximum(self.rectangles[:, 1], real.max(axis=1) + moves[0] + slack),
            np.minimum(self.rectangles[:, 2], imaginary.min(axis=1) - moves[1] - slack),
            np.maximum(self.rectangles[:, 3], imaginary.max(axis=1) + moves[1] + slack),
        ]
        found = np.stack(ends, axis=1)
        unknown = ~np.all(np.isfinite(found), axis=1)
        found[unknown] = _NOTHING
        return replace(self, rectangles=found)

    def corners(self, w: float) -> Complexes:
        """Find corners (4,) of a rectangle around the response at a frequency; infinite without.

        Parameters
        ----------
        w : float
            rad a sample.
        """
        west, east, south, north, turn = self._rectangle(w)
        if not np.isfinite(west):
            return np.full(4, np.inf + 0j)
        return turn * np.array(
            [west + 1j * south, east + 1j * south, east + 1j * north, west + 1j * north]
        )

    def at(self, w: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Bound gain and phase at a frequency.

        Parameters
        ----------
        w : float
            rad a sample. Where no arc holds it nothing is proved.

        Returns
        -------
        gains, phases : (float, float)
            Phases are in rad, without unwrapping.
        """
        west, east, south, north, turn = self._rectangle(w)
        if not np.isfinite(west):
            return (0.0, np.inf), (-np.pi, np.pi)
        turned = float(np.angle(turn))
        low, high = angles_of(west, east, south, north)
        return gains_of(west, east, south, north), (turned + low, turned + high)

    def _rectangle(self, w: float) -> tuple[float, float, float, float, complex]:
        """Rectangle that holds the response at a frequency, after a turn; infinite without one."""
        place = int(np.argmin(np.abs(self.centre - w) - self.half))
        t = (w - self.centre[place]) / self.half[place]
        if not abs(t) <= 1.0 + 1e-10 or not np.isfinite(self.rectangles[place]).all():
            return -np.inf, np.inf, -np.inf, np.inf, 1.0 + 0j
        middle = self.gain[place] * (1.0 + self.slope[place] * t)
        slack = 1e-9 * abs(self.gain[place] * self.slope[place]) + 16 * _EPS * abs(middle)
        ends = self.rectangles[place] + slack * np.array([-1.0, 1.0, -1.0, 1.0])
        ends += np.array([middle.real, middle.real, middle.imag, middle.imag])
        west, east, south, north = ends.tolist()
        return west, east, south, north, complex(self.turn[place])

    @property
    def least_peak(self) -> float:
        """Proved lower bound of the largest gain, of every member."""
        return max(self.at(w)[0][0] for w in self.centre.tolist())

    @property
    def covers(self) -> bool:
        """True if the arcs leave no gap from 0 to pi."""
        order = np.argsort(self.centre - self.half)
        low, high = (self.centre - self.half)[order], (self.centre + self.half)[order]
        reach = np.maximum.accumulate(high)
        gaps = bool(np.any(low[1:] > reach[:-1]))
        return not gaps and bool(low[0] <= 0.0 and reach[-1] >= np.pi)

    @property
    def largest_gain(self) -> float:
        """Proved upper bound of the gain at all frequencies."""
        if not self.covers:
            return float("inf")
        # the modulus is convex in t
        ends = np.maximum(np.abs(1.0 + self.slope), np.abs(1.0 - self.slope))
        most = self.gain * (ends + 1e-9 * (1.0 + np.abs(self.slope))) + self.radius
        return float(most.max() * (1.0 + 16 * _EPS))

    def distance(self, point: complex) -> float:
        """Bound from below the distance of the response from a point, at all frequencies.

        Parameters
        ----------
        point : complex

        Notes
        -----
        From -1 it is the modulus margin of the loop that the response closes.
        """
        if not self.covers:
            return 0.0
        off = self.gain - point / self.turn
        along = self.gain * self.slope
        size = np.abs(along)
        moves = size > 0.0
        way = np.where(moves, along, 1.0) / np.where(moves, size, 1.0)  # no square may underflow
        t = np.clip(-(off * np.conj(way)).real / np.where(moves, size, np.inf), -1.0, 1.0)
        doubt = 1e-9 * (np.abs(off) + np.abs(along)) + 16 * _EPS * abs(point)
        near = np.abs(off + along * t) - doubt - self.radius * (1.0 + 16 * _EPS)
        return max(0.0, float(near.min()))


def families_of(transfer: Transfer, parameters: Sequence[str]) -> tuple[Family, Family]:
    """State numerator and denominator of a transfer function in discrete time.

    Parameters
    ----------
    transfer : Transfer
    parameters : sequence of str
        Names in the order of theta.
    """
    place = {name: column for column, name in enumerate(parameters)}
    size = 1 + max(transfer.delay + len(transfer.numerator) - 1, len(transfer.denominator))
    top, below = np.zeros((size, len(place))), np.zeros((size, len(place)))
    for lag, name in enumerate(transfer.numerator, transfer.delay):
        top[lag, place[name]] = 1.0
    for lag, name in enumerate(transfer.denominator, 1):
        below[lag, place[name]] = 1.0
    return Family(np.zeros(size), top), Family(np.eye(1, size)[0], below)


def arc_regions(
    cover: Cover,
    theta: Reals,
    families: tuple[Family, Family],
    arcs: Sequence[Arc],
    proposer: Callable[[Cover], Multipliers],
) -> ArcRegions:
    """Bound a response on arcs.

    Parameters
    ----------
    cover : Cover
    theta : (p,) float
        Nominal; any numbers will do, close ones give narrow regions.
    families : (numerator, denominator)
        Of one length.
    arcs : sequence of (centre, half width)
        rad a sample; half widths may be 0.
    proposer : callable
    """
    size = families[0].constants.size
    powers, rest, rounding = taylor(size, 0.5 * (size - 1), arcs)
    above, under = (_affine(powers, f) for f in families)  # (A, d + 1, 1 + p)
    d0, g0, g1 = _nominal(above, under, theta)
    turn = np.where(g0 == 0, 1.0, g0 / np.where(g0 == 0, 1.0, np.abs(g0)))
    # e = (N - g0 (1 + g1 t) D) / (d0 turn), of degree d + 1, and q = D / d0
    wide = np.pad(above, ((0, 0), (0, 1), (0, 0))) - g0[:, None, None] * (
        np.pad(under, ((0, 0), (0, 1), (0, 0)))
        + g1[:, None, None] * np.pad(under, ((0, 0), (1, 0), (0, 0)))
    )
    e = np.einsum("im,amp->aip", _UPPER, wide) / (d0 * turn)[:, None, None]
    q = np.einsum("im,amp->aip", _LOWER, under) / d0[:, None, None]
    sizes = [np.abs(f.constants) + np.abs(f.weights) @ cover.magnitude for f in families]
    lost = [(rest + rounding) @ x / np.abs(d0) * (1.0 + 1e-12) for x in sizes]
    grown = np.abs(g0) * (1.0 + np.abs(g1))
    boxes = _rectangles(cover, [e, q], [lost[0] + grown * lost[1], lost[1]], proposer)
    gain = np.abs(g0)
    unit = 16 * _EPS * gain * (1.0 + np.abs(g1))  # of turn, gain and slope
    found = [
        quotient_rectangle((elow[i], ehigh[i]), (qlow[i], qhigh[i]), float(unit[i]))
        for elow, ehigh, qlow, qhigh in [boxes]
        for i in range(len(gain))
    ]
    centre, half = np.array(arcs, float).T
    return ArcRegions(centre, half, turn, gain, g1, np.array(found))


def _affine(powers: Complexes, family: Family) -> Complexes:
    """Taylor coefficients as constants and weights of theta, (A, d + 1, 1 + p)."""
    table = np.column_stack([family.constants, family.weights])
    return np.asarray(powers @ table, np.complex128)


def _nominal(
    above: Complexes, under: Complexes, theta: Reals
) -> tuple[Complexes, Complexes, Complexes]:
    """D0, g0 and g1 at the nominal parameters, any numbers."""
    point = np.append(1.0, theta)
    n, d = above @ point, under @ point  # (A, d + 1)
    d0 = np.where(d[:, 0] == 0, np.finfo(float).tiny, d[:, 0])
    g0 = n[:, 0] / d0
    steady = np.abs(g0) > 1e-12 * np.abs(n).sum(axis=1) / np.abs(d0)
    safe = np.where(steady, g0, 1.0)
    g1 = np.where(steady, (n[:, 1] - g0 * d[:, 1]) / (d0 * safe), 0.0)
    return d0, g0, np.where(np.isfinite(g1), g1, 0.0)


def _rectangles(
    cover: Cover,
    points: list[Complexes],
    lost: list[Reals],
    proposer: Callable[[Cover], Multipliers],
) -> tuple[Complexes, Complexes, Complexes, Complexes]:
    """Lower left and upper right corners of e, then of q, over all Bernstein points, (A,) each."""
    flat = np.concatenate([x.reshape(-1, x.shape[2]) for x in points])
    ends = supports(cover, np.concatenate([flat[:, 1:].real, flat[:, 1:].imag]), proposer)
    size = np.abs(flat[:, 0]) + np.abs(flat[:, 1:]) @ cover.magnitude
    slack = 8 * _EPS * size
    found: list[Complexes] = []
    begin = 0
    for x, loss in zip(points, lost, strict=True):
        rows = slice(begin, begin + x.shape[0] * x.shape[1])
        begin = rows.stop
        corners = []
        for part, table in ((flat.real, ends[: len(flat)]), (flat.imag, ends[len(flat) :])):
            low = (part[rows, 0] + table[rows, 0] - slack[rows]).reshape(x.shape[:2]).min(axis=1)
            high = (part[rows, 0] + table[rows, 1] + slack[rows]).reshape(x.shape[:2]).max(axis=1)
            wide = loss * (1.0 + 8 * _EPS)
            corners.append((np.nextafter(low - wide, -np.inf), np.nextafter(high + wide, np.inf)))
        for side in (0, 1):
            corner = np.empty(len(loss), np.complex128)
            corner.real, corner.imag = corners[0][side], corners[1][side]
            found.append(corner)
    return found[0], found[1], found[2], found[3]
