"""Sets |y - F theta| <= E with features F in enclosures: bounds that multipliers prove.

A linear program proposes; what is claimed follows from its multipliers in interval arithmetic
for every F in the enclosures, so that neither the solver nor its tolerances are trusted.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.neural.arithmetic import Interval, LinearModel, down, matmul, up

__all__ = [
    "Rows",
    "least_factor",
    "multipliers",
    "prove_bounds",
    "prove_factor",
    "prove_reach",
    "surely_inside",
]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Rows abs(target - features theta) <= radius.

    Parameters
    ----------
    features : Interval (T, m)
    target, radius : (T,) float
    """

    features: Interval
    target: Reals
    radius: Reals

    @property
    def size(self) -> int:
        """Number m of unknowns."""
        return self.features.lo.shape[1]

    def widened(self, factor: float) -> Rows:
        """Widen the rows to ``factor`` times the radius, rounded up."""
        return self if factor == 1.0 else Rows(self.features, self.target, up(self.radius * factor))


def multipliers(rows: Rows, costs: Reals, until: float = inf) -> tuple[Reals, Reals]:
    """Solve min cost theta over the rows; nothing proved rests on it.

    Parameters
    ----------
    rows : Rows
    costs : (K, m) float
    until : float
        Reading of ``time.monotonic`` at which no further program is begun.

    Returns
    -------
    dual : (K, T) float
        Positive at rows whose lower end is active; zero where the solver failed or time was over.
    points : (K, m) float
        NaN there.
    """
    unit = float(np.median(rows.radius[rows.radius > 0])) if np.any(rows.radius > 0) else 1.0
    middle = rows.features.middle()
    scale = _powers(middle)
    matrix = sps.csr_array(middle / scale)
    ends = (rows.target - rows.radius) / unit, (rows.target + rows.radius) / unit
    free = np.full(rows.size, np.inf)
    model = LinearModel(matrix, ends, (-free, free))
    dual = np.zeros((len(costs), rows.target.size))
    points = np.full((len(costs), rows.size), np.nan)
    for k, cost in enumerate(costs):
        if time.monotonic() >= until:
            break
        scaled = cost / scale
        size = _powers(scaled[:, None])[0]
        found = model.solve(scaled / size, _left(until))
        if found.status == "solved":
            dual[k], points[k] = found.dual * size, found.x / scale * unit
    return dual, points


def prove_bounds(rows: Rows, costs: Interval, dual: Reals) -> tuple[Reals, Reals]:
    """Prove cost theta >= value - slack abs(theta) from multipliers.

    Parameters
    ----------
    rows : Rows
    costs : Interval (K, m)
    dual : (K, T) float

    Returns
    -------
    value : (K,) float
    slack : (K, m) float
    """
    used = np.flatnonzero(np.any(dual != 0, axis=0))
    small = Interval.point(dual[:, used])
    gain = matmul(small, Interval.point(rows.target[used, None]))
    loss = matmul(Interval.point(np.abs(dual[:, used])), Interval.point(rows.radius[used, None]))
    rest = costs - matmul(small, rows.features[used])
    return down(gain.lo - loss.hi)[:, 0], rest.magnitude()


def prove_reach(value: Reals, slack: Reals) -> Reals | None:
    """Bound abs(theta) from ``value`` and ``slack`` of the objectives theta_1, -theta_1, ...

    Returns
    -------
    (m,) float or None
        None where rounding errors are too large for this conclusion.
    """
    with np.errstate(invalid="ignore"):
        size = np.maximum(np.abs(value[::2]), np.abs(value[1::2]))
        coupling = np.maximum(slack[::2], slack[1::2])
        growth = up(coupling.sum(axis=1) * (1.0 + 1e-12)).max()
        if not (np.all(np.isfinite(size)) and growth < 0.5):
            return None
    largest = up(up(size.max()) / down(1.0 - growth))
    return up(size + up(up(coupling.sum(axis=1) * (1.0 + 1e-12)) * largest))


def _powers(matrix: Reals) -> Reals:
    """Powers of two next to the largest entry of each column (m,), so that solvers see about 1."""
    _, exponent = np.frexp(np.abs(matrix).max(axis=0, initial=0.0))
    return np.asarray(np.ldexp(1.0, np.clip(exponent, -1000, 1000)), np.float64)


def _left(until: float) -> float | None:
    """Seconds until a reading of ``time.monotonic``; None where there is no end."""
    return None if until == inf else max(until - time.monotonic(), 0.0)


def least_factor(rows: Rows, until: float = inf) -> tuple[float, Reals, Reals]:
    """Solve for the least factor k with abs(y - F theta) <= k radius; nothing proved rests on it.

    Parameters
    ----------
    rows : Rows
    until : float
        Reading of ``time.monotonic`` at which the program ends.

    Returns
    -------
    factor : float
        That of ``theta`` where it is more than the solver says. Infinite where the solver failed
        or time was over.
    theta : (m,) float
    dual : (2, T) float
        Multipliers of the lower and the upper rows.
    """
    count, m = rows.features.lo.shape
    most, size = float(np.max(rows.radius)), _powers(rows.target[:, None])[0]
    weight = (rows.radius / most)[:, None]
    middle = rows.features.middle()
    scale = _powers(middle)
    matrix = sps.csr_array(np.block([[middle / scale, weight], [middle / scale, -weight]]))
    free, target = np.full(count, np.inf), rows.target / size
    ends = np.concatenate([target, -free]), np.concatenate([free, target])
    columns = np.append(np.full(m, -np.inf), 0.0), np.full(m + 1, np.inf)
    found = LinearModel(matrix, ends, columns).solve(np.append(np.zeros(m), 1.0), _left(until))
    if found.status != "solved":
        return np.inf, np.zeros(m), np.zeros((2, count))
    theta, some = found.x[:-1] / scale * size, rows.radius > 0
    needed = np.abs(rows.target - middle @ theta)[some] / rows.radius[some]
    factor = max(float(found.x[-1]) * (size / most), float(needed.max()))
    return factor, theta, found.dual.reshape(2, count)


def prove_factor(rows: Rows, dual: Reals, reach: Reals) -> float:
    """Bound the least factor over abs(theta) <= reach from below, by multipliers (2, T)."""
    signed = Interval.point(np.maximum(dual[:1], 0.0)) + Interval.point(np.minimum(dual[1:], 0.0))
    size = matmul(Interval.point(np.abs(dual)), Interval.point(rows.radius[:, None])).hi.sum()
    gain = matmul(signed, Interval.point(rows.target[:, None])).lo[0, 0]
    rest = matmul(signed, rows.features).magnitude()
    lost = up(up(rest @ reach) * (1.0 + 1e-12))[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = down(down(gain - lost) / up(size * (1.0 + 1e-15)))
    return float(found) if found > 0 else 0.0


def surely_inside(rows: Rows, points: Reals) -> NDArray[np.bool_]:
    """Check that points (K, m) obey all rows for every choice of the features."""
    value = matmul(Interval.point(points), Interval(rows.features.lo.T, rows.features.hi.T))
    rest = Interval.point(rows.target) - value
    return np.asarray(np.all(rest.magnitude() <= rows.radius, axis=1))
