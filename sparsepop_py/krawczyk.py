"""Existence of a zero, proved by Krawczyk's test.

For F(v) = 0 with as many equations as unknowns, a box X around an approximate zero m,
and any matrix C (the inverse of F'(m), say): if

    K(X) = m - C F(m) + (I - C F'(X)) (X - m)

lies inside X, then K(X) contains a zero of F.

References
----------
R. Krawczyk, Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken,
Computing 4, 1969; A. Neumaier, Interval Methods for Systems of Equations, Cambridge,
1990, section 5.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .enclosure import jacobian_range, range_over
from .rounding import Interval, matmul
from .system import PolynomialSystem

__all__ = ["polished", "zero_near"]


def polished(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """A few Newton steps in the variables ``solved``; None if they run away."""
    x = x.copy()
    for _ in range(6):
        step = np.linalg.lstsq(
            system.jacobian(x).toarray()[:, solved], -system.values(x), rcond=None
        )[0]
        if not np.all(np.isfinite(step)) or np.abs(step).max(initial=0.0) > 1e-2:
            return None
        x[solved] += step
    return x


def zero_near(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> Interval | None:
    """A box around x, degenerate in all variables but ``solved``, that provably holds a zero.

    Parameters
    ----------
    system : PolynomialSystem
        As many rows as there are variables in ``solved``.
    x : (n,) float
        An approximate zero.
    solved : (r,) int

    Returns
    -------
    Interval (n,) or None
        None if the test fails for every radius tried.
    """
    for radius in (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        box = _image_inside(system, x, solved, radius)
        if box is not None:
            return box
    return None


def _image_inside(
    system: PolynomialSystem, x: NDArray, solved: NDArray, radius: float
) -> Interval | None:
    """The Krawczyk image of a box of that radius, if it lies inside the box."""
    spread = np.zeros(x.size)
    spread[solved] = radius * (1.0 + np.abs(x[solved]))
    box = Interval(x - spread, x + spread)
    centre_jacobian = system.jacobian(x).toarray()[:, solved]
    try:
        inverse = np.linalg.inv(centre_jacobian)
    except np.linalg.LinAlgError:
        return None
    slopes = jacobian_range(system, box)
    slopes = Interval(slopes.lo[:, solved], slopes.hi[:, solved])
    residual = range_over(system, Interval.point(x))
    identity = Interval.point(np.eye(solved.size))
    left = Interval.point(inverse)
    contraction = identity - matmul(left, slopes)
    image = -matmul(left, residual[:, None]) + matmul(
        contraction, (box - Interval.point(x))[solved][:, None]
    )
    image = Interval(image.lo[:, 0], image.hi[:, 0]) + Interval.point(x[solved])
    inside = (image.lo > box.lo[solved]) & (image.hi < box.hi[solved])
    if not np.all(inside):
        return None
    lo, hi = x.copy(), x.copy()
    lo[solved], hi[solved] = image.lo, image.hi
    return Interval(lo, hi)
