"""Proofs that matrices are positive semidefinite, at a point or over a box.

Over a box a matrix is compared with L L' for the Cholesky factor L of its middle less a shift:
the rest is an interval matrix that is diagonally dominant, hence semidefinite. At a rational
point this comes first too; on the boundary, where it must fail, Gaussian elimination in rationals
decides. A second-order cone needs f1 >= 0 and f1^2 >= f2^2 + ... + fk^2 only.

References
----------
S. M. Rump, Verification of positive definiteness, BIT 46, 2006.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.matrix_constraints import Matrices
from sparsepop_py.budget import check
from sparsepop_py.verified.arithmetic.interval import Interval, exact_values, gram, up
from sparsepop_py.verified.arithmetic.polynomial_range import range_over

__all__ = ["entries_hold", "hold_at", "hold_over", "is_semidefinite", "surely_semidefinite"]

_LARGEST = 60  # rows of matrices that are eliminated in rationals
_SHIFT = 1e-12  # of the largest entry, kept for what rounding costs


def hold_at(matrices: Matrices, x: Sequence[Fraction]) -> bool:
    """Prove all matrices semidefinite at a rational point; False if unknown."""
    system = matrices.system
    if not matrices.constraints.size:
        return True
    values = exact_values(system.words, system.coefficients, system.row, system.size, x)
    return entries_hold(matrices, values)


def entries_hold(matrices: Matrices, values: Sequence[Fraction]) -> bool:
    """Prove all matrices semidefinite for given entries; False if unknown."""
    for k in matrices.constraints:
        layout = matrices.layout(k)
        if matrices.second_order[k]:
            axis, *rest = (values[e] for e in layout[0])
            if axis < 0 or axis * axis < sum(v * v for v in rest):
                return False
        elif not is_semidefinite([[values[e] for e in row] for row in layout.tolist()]):
            return False
    return True


def hold_over(matrices: Matrices, box: Interval) -> bool:
    """Prove all matrices semidefinite all over a box; False if unknown."""
    if not matrices.constraints.size:
        return True
    values = range_over(matrices.system, box)
    for k in matrices.constraints:
        layout = matrices.layout(k)
        if not matrices.second_order[k]:
            if not surely_semidefinite(values[layout]):
                return False
            continue
        axis, rest = float(values.lo[layout[0, 0]]), values[layout[0, 1:]].magnitude()
        total = 0.0
        for square in up(rest * rest).tolist():
            total = float(up(total + square))
        if not (axis >= 0 and float(np.nextafter(axis * axis, -np.inf)) >= total):
            return False
    return True


def surely_semidefinite(matrix: Interval) -> bool:
    """Prove every symmetric matrix in an interval matrix (m, m) semidefinite.

    False also where this method cannot decide, which includes all singular matrices.

    Parameters
    ----------
    matrix : Interval
        Of shape (m, m).

    Returns
    -------
    bool

    Examples
    --------
    >>> import numpy as np
    >>> surely_semidefinite(Interval.point(np.array([[2.0, 1.0], [1.0, 2.0]])))
    True
    """
    if not np.all(np.isfinite(matrix.lo) & np.isfinite(matrix.hi)):
        return False
    middle = matrix.middle()
    radius = np.sum(0.5 * matrix.hi - 0.5 * matrix.lo, axis=1)
    shift = radius + middle.shape[0] * _SHIFT * np.abs(middle).max(initial=0.0)
    try:
        factor = np.asarray(np.linalg.cholesky(middle - np.diag(shift)), np.float64)
    except np.linalg.LinAlgError:
        return False
    rest = matrix - gram(factor[None])[0]
    beside = rest.magnitude()
    np.fill_diagonal(beside, 0.0)
    total: NDArray[np.float64] = np.zeros(beside.shape[0])
    for column in beside.T:
        total = up(total + column)
    return bool(np.all(np.diag(rest.lo) >= total))


def is_semidefinite(matrix: Sequence[Sequence[Fraction]]) -> bool:
    """Decide in rationals whether a symmetric matrix is positive semidefinite.

    Parameters
    ----------
    matrix : sequence of sequences of Fraction

    Returns
    -------
    bool
        False also for a matrix that is too large.

    Examples
    --------
    >>> from fractions import Fraction
    >>> third = Fraction(1, 3)
    >>> is_semidefinite([[Fraction(1), third], [third, third * third]])
    True
    """
    ends = [[Interval.of_fraction(value) for value in row] for row in matrix]
    enclosure = Interval(
        np.array([[float(v.lo) for v in row] for row in ends]),
        np.array([[float(v.hi) for v in row] for row in ends]),
    )
    if surely_semidefinite(enclosure):
        return True
    if len(matrix) > _LARGEST:
        return False
    rest = [list(row) for row in matrix]
    while rest:
        check()
        pivot, row = rest[0][0], rest[0][1:]
        if pivot < 0 or (pivot == 0 and any(row)):
            return False
        inner = [line[1:] for line in rest[1:]]
        if pivot:
            inner = [
                [value - row[i] * row[j] / pivot for j, value in enumerate(line)]
                for i, line in enumerate(inner)
            ]
        rest = inner
    return True
