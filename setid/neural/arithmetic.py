"""Verified arithmetic of networks: activations, affine maps and matrices with outward rounding.

The only module of this room that reaches into modules of the engine. Nothing here
trusts the exponential or the hyperbolic tangent of a mathematical library. They are built from
additions, multiplications and divisions that IEEE 754 rounds correctly:

    exp(-y) = T[n] p(r),  n = floor(64 y),  r = y - n / 64 (exact),  0 <= r < 1/64, y <= 40

with a table T of exp(-n / 64) that rational arithmetic makes (each entry within 1.01 u of the
truth, u = 2^-53) and the Taylor polynomial p of degree 7. Its truncation is below
(1/64)^8 / 8! < 1e-19. In Horner's scheme q_i = c_i - r q_{i+1} all values lie in [0, 1], so that
an error bound E of them obeys E <= 2u + r (u + E), hence E < 2.1 u, and the last step, whose
coefficient 1 is exact, loses at most u + r (u + E) < 1.1 u. Relative to exp(-r) >= 0.98 that is
1.12 u; with the table and one product the total is below 4 u. The enclosure grants 2^-50 = 8 u.

References
----------
J.-M. Muller, Elementary Functions: Algorithms and Implementation, Birkhaeuser 2016, chapter 6.
N. J. Higham, Accuracy and Stability of Numerical Algorithms, SIAM 2002, section 5.1.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache, wraps
from math import factorial
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sparsepop_py.lp.highs import LinearModel
from sparsepop_py.verified.arithmetic.array_checks import at_least
from sparsepop_py.verified.arithmetic.definiteness import surely_semidefinite
from sparsepop_py.verified.arithmetic.interval import Interval, down, matmul, require_ieee, up

__all__ = [
    "ACTIVATIONS",
    "Interval",
    "LinearModel",
    "activate",
    "at_least",
    "down",
    "enclose",
    "exp_negative",
    "linearise",
    "matmul",
    "nowhere_above",
    "quiet_overflow",
    "require_ieee",
    "row_sums",
    "slope_at",
    "slope_range",
    "surely_semidefinite",
    "up",
]

Reals = NDArray[np.float64]
P = ParamSpec("P")
T = TypeVar("T")
ACTIVATIONS = ("tanh", "sigmoid", "relu", "leaky_relu", "identity", "algebraic")
_BITS = 400  # of the rationals that make the table
_STEPS = 64  # entries of the table for a unit of y
_LARGEST = 40  # beyond it exp(-y) is enclosed by [0, exp(-40)]
_WIDEN = 2.0**-50
_DEGREE = 7


def quiet_overflow(function: Callable[P, T]) -> Callable[P, T]:
    """Keep numpy from warning where numbers leave the doubles, which then prove nothing.

    Infinite ends and NaN are what every check of this room takes as no bound.

    Examples
    --------
    >>> float(quiet_overflow(lambda size: np.float64(size) * size)(1e308))
    inf
    """

    @wraps(function)
    def quiet(*args: P.args, **kwargs: P.kwargs) -> T:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return function(*args, **kwargs)

    return quiet


# ---- exponential --------------------------------------------------------------------------


@cache
def _table() -> Reals:
    """Doubles nearest to exp(-n / 64), n = 0 .. 2560, from integer enclosures of exp(1 / 64)."""
    one = 1 << _BITS
    terms = 60
    low = sum(one // (_STEPS**k * factorial(k)) for k in range(terms))
    high = low + terms + 2  # each quotient loses less than 1; the rest is far below 1
    least = most = one
    values = []
    for _ in range(_STEPS * _LARGEST + 1):
        near = float(Fraction(one, most))
        values.append(near)
        least, most = (least * low) >> _BITS, ((most * high) >> _BITS) + 1
    table = np.array(values)
    table.flags.writeable = False
    return table


def nowhere_above(array: Reals, other: Reals) -> bool:
    """Check that no entry exceeds that of another array of its shape, NaN at the same places.

    Parameters
    ----------
    array, other : array of float
    """
    return np.array_equal(np.isnan(array), np.isnan(other)) and not np.any(array > other)


def exp_negative(y: ArrayLike) -> Interval:
    """Enclose exp(-y) for doubles y >= 0.

    Parameters
    ----------
    y : array_like of float
        Not negative; infinity is allowed.

    Returns
    -------
    Interval
        Of the shape of ``y``, of relative width 2e-15 up to y = 40.

    Examples
    --------
    >>> found = exp_negative([0.0, 1.0])
    >>> bool(found.lo[1] <= 0.36787944117144233 <= found.hi[1])
    True
    """
    given = np.asarray(y, float)
    inside = np.minimum(given, float(_LARGEST))
    number = np.floor(inside * _STEPS)
    rest = inside - number / _STEPS
    value = np.full(np.shape(given), 1.0 / factorial(_DEGREE))
    for k in range(_DEGREE - 1, -1, -1):
        value = 1.0 / factorial(k) - rest * value
    value = _table()[number.astype(np.int64)] * value
    low = np.where(given > _LARGEST, 0.0, value * (1.0 - _WIDEN))
    return Interval(low, value * (1.0 + _WIDEN))


# ---- activations at doubles ---------------------------------------------------------------


def _odd(function: Callable[[Reals], Interval]) -> Callable[[Reals], Interval]:
    """The odd extension of an enclosure for x >= 0."""

    def whole(x: Reals) -> Interval:
        found = function(np.abs(x))
        below = x < 0
        return Interval(np.where(below, -found.hi, found.lo), np.where(below, -found.lo, found.hi))

    return whole


def _tanh_positive(x: Reals) -> Interval:
    """Enclose (1 - t) / (1 + t) with t = exp(-2 x), and x - x^3 / 3 <= tanh(x) <= x."""
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        t = exp_negative(2.0 * x)
        low = down(down(1.0 - t.hi) / up(1.0 + t.hi))
        high = up(up(1.0 - t.lo) / down(1.0 + t.lo))
        cubic = down(x - up(up(up(x * x) * x) / 3.0))
    cubic = np.where(np.isnan(cubic), 0.0, cubic)
    return Interval(np.maximum(np.maximum(low, cubic), 0.0), np.minimum(np.minimum(high, x), 1.0))


def _sigmoid(x: Reals) -> Interval:
    """Enclose 1 / (1 + t) for x >= 0 and t / (1 + t) for x < 0, with t = exp(-|x|)."""
    t = exp_negative(np.abs(x))
    with np.errstate(under="ignore"):
        low = np.where(x >= 0, down(1.0 / up(1.0 + t.hi)), down(t.lo / up(1.0 + t.lo)))
        high = np.where(x >= 0, up(1.0 / down(1.0 + t.lo)), up(t.hi / down(1.0 + t.hi)))
    return Interval(np.maximum(low, 0.0), np.minimum(high, 1.0))


def _algebraic_positive(x: Reals) -> Interval:
    """Enclose x / sqrt(1 + x^2); beyond 1e8 by its value there and by 1."""
    near = np.minimum(x, 1e8)
    with np.errstate(under="ignore"):
        low = down(near / up(np.sqrt(up(1.0 + up(near * near)))))
        high = up(near / down(np.sqrt(down(1.0 + np.maximum(down(near * near), 0.0)))))
    high = np.where(x > near, 1.0, high)
    return Interval(np.maximum(low, 0.0), np.minimum(np.minimum(high, x), 1.0))


def _leaky(x: Reals, leak: float) -> Interval:
    with np.errstate(under="ignore"):
        scaled = leak * x
    exact = (x >= 0) | (leak == 0.0)
    value = np.where(x >= 0, x, np.where(leak == 0.0, 0.0, scaled))
    return Interval(np.where(exact, value, down(value)), np.where(exact, value, up(value)))


_SMOOTH: dict[str, Callable[[Reals], Interval]] = {
    "tanh": _odd(_tanh_positive),
    "sigmoid": _sigmoid,
    "algebraic": _odd(_algebraic_positive),
}


def activate(name: str, x: Reals, leak: float = 0.0) -> Reals:
    """Evaluate an activation in floating point.

    Parameters
    ----------
    name : str
        One of :data:`ACTIVATIONS`.
    x : array of float
    leak : float
        Slope of ``"leaky_relu"`` for negative arguments.
    """
    if name == "tanh":
        return np.tanh(x)
    if name == "sigmoid":
        return 0.5 * (1.0 + np.tanh(0.5 * x))
    if name == "algebraic":
        return np.asarray(x / np.hypot(1.0, x))
    if name == "relu":
        return np.maximum(x, 0.0)
    return np.where(x >= 0, x, leak * x) if name == "leaky_relu" else x


def _at(name: str, x: Reals, leak: float) -> Interval:
    """Enclosure at doubles; the whole range where a double is no number."""
    if name == "identity":
        return Interval(x, x)
    if name in ("relu", "leaky_relu"):
        return _leaky(x, leak if name == "leaky_relu" else 0.0)
    found = _SMOOTH[name](np.nan_to_num(x, nan=0.0, posinf=np.inf, neginf=-np.inf))
    unknown = np.isnan(x)
    least = 0.0 if name == "sigmoid" else -1.0
    return Interval(np.where(unknown, least, found.lo), np.where(unknown, 1.0, found.hi))


def enclose(name: str, x: Interval, leak: float = 0.0) -> Interval:
    """Enclose the range of an activation over intervals; all activations are monotone.

    Parameters
    ----------
    name : str
        One of :data:`ACTIVATIONS`.
    x : Interval
    leak : float

    Returns
    -------
    Interval

    Examples
    --------
    >>> found = enclose("tanh", Interval.point([0.0, 1.0]))
    >>> float(found.lo[0]), bool(found.lo[1] <= 0.7615941559557649 <= found.hi[1])
    (0.0, True)
    """
    low = _at(name, np.asarray(x.lo, float), leak)
    if x.lo is x.hi:
        return low
    return Interval(low.lo, _at(name, np.asarray(x.hi, float), leak).hi)


# ---- slopes and linear enclosures ---------------------------------------------------------


def slope_at(name: str, x: Reals, leak: float = 0.0) -> Interval:
    """Enclose the derivative of an activation at doubles; both slopes at a kink."""
    one = Interval.point(np.ones(np.shape(x)))
    if name == "identity":
        return one
    if name in ("relu", "leaky_relu"):
        below = leak if name == "leaky_relu" else 0.0
        return Interval(np.where(x > 0, 1.0, below), np.where(x >= 0, 1.0, below))
    value = _at(name, np.asarray(x, float), leak)
    if name == "sigmoid":
        found = value * (one - value)
        return Interval(np.maximum(found.lo, 0.0), np.minimum(found.hi, 0.25))
    rest = one - value.power(np.int64(2))  # type: ignore[arg-type]
    rest = Interval(np.maximum(rest.lo, 0.0), np.minimum(rest.hi, 1.0))
    if name == "tanh":
        return rest
    root = Interval(np.maximum(down(np.sqrt(rest.lo)), 0.0), up(np.sqrt(rest.hi)))
    found = rest * root
    return Interval(np.maximum(found.lo, 0.0), np.minimum(found.hi, 1.0))


def slope_range(name: str, leak: float = 0.0) -> tuple[float, float]:
    """Find least and largest slope of an activation over the whole line."""
    if name == "identity":
        return 1.0, 1.0
    if name == "leaky_relu":
        return min(leak, 1.0), max(leak, 1.0)
    return 0.0, 0.25 if name == "sigmoid" else 1.0


def _touching(name: str, slope: Reals) -> Reals:
    """About the positive argument at which the derivative equals a slope."""
    with np.errstate(all="ignore"):
        if name == "tanh":
            found = np.arctanh(np.sqrt(np.clip(1.0 - slope, 0.0, 1.0)))
        elif name == "sigmoid":
            found = 2.0 * np.arctanh(np.sqrt(np.clip(1.0 - 4.0 * slope, 0.0, 1.0)))
        else:
            found = np.sqrt(np.maximum(slope ** (-2.0 / 3.0) - 1.0, 0.0))
    return np.where(np.isfinite(found), found, 0.0)


def _tangent(
    name: str, at: Reals, slope: Interval, ends: tuple[Reals, Reals]
) -> tuple[Reals, Reals]:
    """Ends of f(at) + f'(at) (a - at), a between ``ends``, for f = activation - slope a."""
    point = Interval.point(at)
    value = enclose(name, point) - slope * point
    rise = slope_at(name, at) - slope
    parts = [value + rise * (Interval.point(end) - point) for end in ends]
    return np.minimum(parts[0].lo, parts[1].lo), np.maximum(parts[0].hi, parts[1].hi)


def linearise(name: str, x: Interval, leak: float = 0.0) -> tuple[Reals, Reals, Reals]:
    """Enclose an activation over intervals between two parallel lines.

    The slope is that of the secant. The difference f of activation and line is convex on one
    side of 0 and concave on the other (or piecewise linear with its kink at 0), so its extremes
    lie at the ends, at 0, or where its derivative vanishes; there a tangent bounds it, so that
    the point of contact needs no proof.

    Parameters
    ----------
    name : str
    x : Interval (n,)
        Finite.
    leak : float

    Returns
    -------
    slope, offset, radius : (n,) float
        |activation(a) - slope a - offset| <= radius for every a in ``x``.

    Examples
    --------
    >>> slope, offset, radius = linearise("relu", Interval(np.array([-1.0]), np.array([1.0])))
    >>> float(slope[0]), round(float(offset[0]), 12), bool(0.25 <= radius[0] < 0.2500001)
    (0.5, 0.25, True)
    """
    low, high = enclose(name, Interval.point(x.lo), leak), enclose(name, Interval.point(x.hi), leak)
    width = x.hi - x.lo
    with np.errstate(all="ignore"):
        secant = (high.middle() - low.middle()) / width
    near = slope_at(name, x.middle(), leak).middle()  # any slope is valid; this one is tight
    slope = np.where(np.isfinite(secant) & (width > 1e-7), np.clip(secant, 0.0, 1.0), near)
    if name not in _SMOOTH:
        ends = slope_at(name, x.lo, leak).hi, slope_at(name, x.hi, leak).lo
        slope = np.where(x.lo >= 0, 1.0, np.where(x.hi <= 0, ends[1], slope))
    line = Interval.point(slope)
    zero = np.clip(0.0, x.lo, x.hi)
    values = [
        enclose(name, Interval.point(a), leak) - line * Interval.point(a)
        for a in (x.lo, x.hi, zero)
    ]
    least = np.min([v.lo for v in values], axis=0)
    most = np.max([v.hi for v in values], axis=0)
    if name in _SMOOTH:
        contact = _touching(name, slope)
        right, left = (np.maximum(x.lo, zero), x.hi), (x.lo, np.minimum(x.hi, zero))
        _, top = _tangent(name, np.clip(contact, *right), line, right)
        bottom, _ = _tangent(name, np.clip(-contact, *left), line, left)
        # the activation grows, so that it is at most its last value less the line's first
        ceiling = enclose(name, Interval.point(right[1])) - line * Interval.point(right[0])
        ground = enclose(name, Interval.point(left[0])) - line * Interval.point(left[1])
        top, bottom = np.minimum(top, ceiling.hi), np.maximum(bottom, ground.lo)
        least, most = np.minimum(least, bottom), np.maximum(most, top)
    offset = 0.5 * least + 0.5 * most
    return slope, offset, np.maximum(up(most - offset), up(offset - least))


def row_sums(matrix: Reals) -> Reals:
    """Bound the sums of absolute values along the last axis from above."""
    size = matrix.shape[-1]
    return up(np.sum(np.abs(matrix), axis=-1) * (1.0 + (size + 4.0) * 2.0**-52))
