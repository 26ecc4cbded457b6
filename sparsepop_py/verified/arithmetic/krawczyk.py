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
from sparsepop_py.verified.arithmetic.interval import Interval, applied, up
from sparsepop_py.verified.arithmetic.polynomial_range import jacobian_range, range_over

__all__ = ["polished", "zero_near"]

_SPARSE = 40  # equations from which matrices are sparse
_UNIT = 2.0**-53  # relative rounding error of doubles (IEEE 754)
_TINY = 2.0**-1022  # least normal double


def polished(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Take a few Newton steps in the variables ``solved``; None if they diverge."""
    x = x.copy()
    for _ in range(6):
        values = system.values(x)
        try:
            step = _newton_step(system.jacobian(x).tocsc()[:, solved], -values)
        except np.linalg.LinAlgError:  # of numbers near the largest double
            return None
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
    inverse = _inverse(system, x, solved)
    if inverse is None:
        return None
    move = -applied(inverse, range_over(system, Interval.point(x)))
    least = 2.0 * float((move.magnitude() / (1.0 + np.abs(x[solved]))).max(initial=0.0))
    for radius in (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        if radius < least and radius < 1e-8:
            continue  # the image of a smaller box lies outside it
        box = _image_inside(system, x, solved, radius, inverse, move)
        if box is not None:
            return box
    return None


def _inverse(
    system: PolynomialSystem, x: NDArray[np.float64], solved: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Invert the Jacobian in the variables ``solved``, nearly; None where it is singular."""
    try:
        if solved.size <= _SPARSE:
            return np.asarray(np.linalg.inv(system.dense_jacobian(x)[:, solved]), np.float64)
        matrix = sps.csc_matrix(system.jacobian(x).tocsc()[:, solved])
        return np.asarray(splu(matrix).solve(np.eye(solved.size)), np.float64)
    except (np.linalg.LinAlgError, RuntimeError):
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
    reach = (box - Interval.point(x))[solved].magnitude()
    left = _left_over(system, box, solved, inverse, reach)
    image = move + Interval(-left, left) + Interval.point(x[solved])
    inside = (image.lo > box.lo[solved]) & (image.hi < box.hi[solved])
    if not np.all(inside):
        return None
    lo, hi = x.copy(), x.copy()
    lo[solved], hi[solved] = image.lo, image.hi
    return Interval(lo, hi)


def _left_over(
    system: PolynomialSystem,
    box: Interval,
    solved: NDArray[Any],
    inverse: NDArray[Any],
    reach: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Bound |I - C F'(X)| d for the vector d = ``reach``.

    With slopes in M +- R that is at most |I - C M| d + |C| R d. The computed product of C and M,
    of r terms an entry, is off by at most gamma_r |C| |M|, which joins R.
    """
    size, inner = solved.size, solved.size + 4.0
    rows, variables, slopes = jacobian_range(system, box)
    place = np.full(system.dimension, -1)
    place[solved] = np.arange(size)
    kept = place[variables] >= 0
    rows, columns, slopes = rows[kept], place[variables[kept]], slopes[kept]
    middle = slopes.middle()
    radius = up(slopes.radius(middle) + up(inner * _UNIT * np.abs(middle)))
    with np.errstate(over="ignore", invalid="ignore"):
        rest = np.abs(np.eye(size) - inverse @ _matrix(rows, columns, middle, size))
        rest = up(rest + inner * _TINY)
    aside = applied(_matrix(rows, columns, radius, size), Interval.point(reach)).hi
    least = applied(rest, Interval.point(reach))
    return (least + applied(np.abs(inverse), Interval.point(aside))).hi


def _matrix(
    rows: NDArray[Any], columns: NDArray[Any], entries: NDArray[np.float64], size: int
) -> NDArray[np.float64] | sps.csc_array:
    """Make a square matrix of its entries, sparse where it is large."""
    if size > _SPARSE:
        return sps.csc_array((entries, (rows, columns)), shape=(size, size))
    matrix = np.zeros((size, size))
    matrix[rows, columns] = entries
    return matrix
