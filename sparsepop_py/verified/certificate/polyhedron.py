"""Polyhedra A x + b >= 0 in doubles, with exact signs from integer rows.

Signs are screened in floating point with a bound on the error; only those that this cannot
decide are evaluated in integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import lcm

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.problem.problem import Problem

__all__ = ["Polyhedron", "doubles", "integers"]

_UNIT = 2.0**-53  # relative rounding error of doubles (IEEE 754)


def integers(values: Sequence[float | Fraction]) -> list[int]:
    """Multiply numbers by the least number that makes all of them integers."""
    pairs = [value.as_integer_ratio() for value in values]
    scale = lcm(*(denominator for _, denominator in pairs))
    return [numerator * (scale // denominator) for numerator, denominator in pairs]


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A x + b >= 0, with == where ``equality``: constraints, lower bounds, upper bounds.

    Parameters
    ----------
    matrix : (m + 2n, n) float
    constant : (m + 2n,) float
        Infinite for bounds that are not there.
    equality : (m + 2n,) bool
    """

    matrix: NDArray[np.float64]
    constant: NDArray[np.float64]
    equality: NDArray[np.bool_]
    _whole: dict[int, tuple[list[int], int]] = field(default_factory=dict, repr=False)

    @staticmethod
    def of(problem: Problem) -> Polyhedron:
        """Build the feasible set of a problem whose constraints are linear."""
        n, m = problem.dimension, len(problem.constraints)
        matrix, constant = np.zeros((m, n)), np.zeros(m)
        letter, rows = problem.rows.words[:, -1], problem.rows
        linear = letter > 0
        matrix[rows.row[linear], letter[linear] - 1] = rows.coefficients[linear]
        constant[rows.row[~linear]] = rows.coefficients[~linear]
        return Polyhedron(
            np.concatenate([matrix, np.eye(n), -np.eye(n)]),
            np.concatenate([constant, -problem.lower, problem.upper]),
            np.concatenate([problem.equality, np.zeros(2 * n, bool)]),
        )

    @property
    def dimension(self) -> int:
        """Number of unknowns n."""
        return self.matrix.shape[1]

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows that say something: bounds at infinity do not."""
        return np.isfinite(self.constant)

    def row(self, number: int) -> tuple[list[int], int]:
        """Convert a row to integers: n coefficients and the constant, times a power of two."""
        if number not in self._whole:
            whole = integers([*self.matrix[number].tolist(), float(self.constant[number])])
            self._whole[number] = whole[:-1], whole[-1]
        return self._whole[number]

    def scale(self, number: int) -> Fraction:
        """Return the factor of :meth:`row`."""
        values = [*self.matrix[number].tolist(), float(self.constant[number])]
        place = next(i for i, value in enumerate(values) if value)
        whole = self.row(number)
        return Fraction((*whole[0], whole[1])[place]) / Fraction(values[place])

    def value(self, number: int, point: list[int], weight: int) -> int:
        """Evaluate the integer row at point / weight, times weight.

        With weight 0 it is the slope along the point.
        """
        slope, constant = self.row(number)
        return sum(a * x for a, x in zip(slope, point, strict=True) if a) + constant * weight

    def signs(self, point: list[int], weight: int, total: int) -> NDArray[np.int64]:
        """Compute the signs of all rows at a point, or along a direction.

        Parameters
        ----------
        point : list of int, length n
        weight : int
            ``total`` for points, 0 for directions.
        total : int
            Positive common denominator of ``point``.

        Returns
        -------
        (m + 2n,) int
            -1, 0 or 1; 1 for rows that are not there.
        """
        x, safe = doubles(point, total)
        constant = np.where(self.present, self.constant, 0.0) if weight else 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            value = self.matrix @ x + constant
            size = np.abs(self.matrix) @ np.abs(x) + np.abs(constant)
            error = (self.dimension + 6) * 1.01 * _UNIT * size + 1e-300
        clear = (np.abs(value) > error) & np.isfinite(value) & np.isfinite(error) & safe
        found = np.sign(np.where(clear, value, 0.0)).astype(np.int64)
        found[~self.present] = 1
        for number in np.flatnonzero(~clear & self.present):
            exact = self.value(int(number), point, weight)
            found[number] = (exact > 0) - (exact < 0)
        return found


def doubles(point: list[int], total: int) -> tuple[NDArray[np.float64], bool]:
    """Divide a point by a total in doubles; tell whether none overflows or underflows."""
    try:
        x = np.array([value / total for value in point])
    except OverflowError:
        return np.zeros(len(point)), False
    whole = np.array([value != 0 for value in point])
    return x, not np.any(whole & (np.abs(x) < 1e-290))
