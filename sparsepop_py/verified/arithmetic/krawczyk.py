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

from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval, matmul
from sparsepop_py.verified.arithmetic.polynomial_range import jacobian_range, range_over

__all__ = ["polished", "zero_near"]

_SPARSE = 40  # equations from which Newton steps use sparse elimination


def polished(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Take a few Newton steps in the variables ``solved``; None if they diverge."""
    x = x.copy()
    for _ in range(6):
        values = system.values(x)
        step = _newton_step(system.jacobian(x).tocsc()[:, solved], -values)
        if not np.all(np.isfinite(step)) or np.abs(step).max(initial=0.0) > 1e-2:
            return None
        x[solved] += step
        if np.abs(step).max(initial=0.0) <= 1e-15 * (1.0 + np.abs(x[solved]).max(initial=0.0)):
            break
    return x


def _newton_step(matrix: sps.csc_array, right: NDArray[Any]) -> NDArray[np.float64]:
    """Solve matrix d = right, by sparse elimination where it is regular."""
    if matrix.shape[0] > _SPARSE:
        try:
            return np.asarray(splu(sps.csc_matrix(matrix)).solve(right))
        except RuntimeError:  # singular
            pass
    return np.linalg.lstsq(matrix.toarray(), right, rcond=None)[0]


def zero_near(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> Interval | None:
    """Enclose a zero in a box around x by Krawczyk's test.

    The box is degenerate in all variables but ``solved``.

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
    try:
        inverse = np.linalg.inv(system.dense_jacobian(x)[:, solved])
    except np.linalg.LinAlgError:
        return None
    residual = range_over(system, Interval.point(x))
    move = -matmul(Interval.point(inverse), residual[:, None])
    least = 2.0 * float((move.magnitude()[:, 0] / (1.0 + np.abs(x[solved]))).max(initial=0.0))
    for radius in (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        if radius < least and radius < 1e-8:
            continue  # the image of a smaller box lies outside it
        box = _image_inside(system, x, solved, radius, inverse, move)
        if box is not None:
            return box
    return None


def _image_inside(
    system: PolynomialSystem,
    x: NDArray[Any],
    solved: NDArray[Any],
    radius: float,
    inverse: NDArray[Any],
    move: Interval,
) -> Interval | None:
    """Compute the Krawczyk image of a box, if it lies inside the box."""
    spread = np.zeros(x.size)
    spread[solved] = radius * (1.0 + np.abs(x[solved]))
    box = Interval(x - spread, x + spread)
    slopes = jacobian_range(system, box)
    slopes = Interval(slopes.lo[:, solved], slopes.hi[:, solved])
    identity = Interval.point(np.eye(solved.size))
    contraction = identity - matmul(Interval.point(inverse), slopes)
    image = move + matmul(contraction, (box - Interval.point(x))[solved][:, None])
    image = Interval(image.lo[:, 0], image.hi[:, 0]) + Interval.point(x[solved])
    inside = (image.lo > box.lo[solved]) & (image.hi < box.hi[solved])
    if not np.all(inside):
        return None
    lo, hi = x.copy(), x.copy()
    lo[solved], hi[solved] = image.lo, image.hi
    return Interval(lo, hi)
