"""Interval propagation in plain doubles, for a search that proves its boxes afterwards.

It follows :mod:`sparsepop_py.verified.box.propagation` without rounding outwards, on the arrays
of a :class:`~sparsepop_py.branch_and_bound.product_model.ProductModel`.

References
----------
P. Belotti, J. Lee, L. Liberti, F. Margot, A. Waechter, Branching and bounds tightening
techniques for non-convex MINLP, Optim. Methods Softw. 24, 2009 (FBBT).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.branch_and_bound.product_model import ProductModel

__all__ = ["FloatPropagation"]

Floats = NDArray[np.float64]
_ROUNDING = 1e-9  # relative: a row that is violated by less may hold
_DIGITS = 1e-3  # of that: the rounding of a sum


@dataclass(frozen=True, eq=False)
class FloatPropagation:
    """Propagation of the rows of a product model over boxes with finite bounds.

    Parameters
    ----------
    model : ProductModel
    """

    model: ProductModel

    @cached_property
    def _linear(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Linear terms and their variables."""
        terms = np.flatnonzero(self.model.column < self.model.dimension)
        return terms, self.model.column[terms]

    @cached_property
    def _mixed(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Terms of two variables, each solved for either: term, variable, the other one."""
        model, product = self.model, self.model.column - self.model.dimension
        terms = np.flatnonzero(product >= 0)
        terms = terms[~model.square[product[terms]]]
        i, j = model.first[product[terms]], model.second[product[terms]]
        return np.append(terms, terms), np.append(i, j), np.append(j, i)

    @cached_property
    def _squares(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Terms of squares and their variables."""
        model, product = self.model, self.model.column - self.model.dimension
        terms = np.flatnonzero(product >= 0)
        terms = terms[model.square[product[terms]]]
        return terms, model.first[product[terms]]

    def sweeps(
        self, low: Floats, high: Floats, cutoff: float, most: int, gain: float = 0.02
    ) -> tuple[Floats, Floats, int, bool]:
        """Propagate up to ``most`` times while widths shrink by a share.

        Parameters
        ----------
        low, high : (n,) float
        cutoff : float
            Upper end of the objective, +inf without one.
        most : int
        gain : float

        Returns
        -------
        low, high : (n,) float
        count : int
            Sweeps that gained; the box is what these leave.
        empty : bool
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for number in range(most):
                new_low, new_high, empty = self._sweep(low, high, cutoff)
                if empty:
                    return low, high, number + 1, True
                width, left = high - low, new_high - new_low
                if not np.any((width - left > gain * width) & (width > 1e-9)):
                    return low, high, number, False
                low, high = new_low, new_high
        return low, high, most, False

    def _sweep(self, low: Floats, high: Floats, cutoff: float) -> tuple[Floats, Floats, bool]:
        model = self.model
        bottom, top = self._ranges(low, high)
        value, column, row = model.coefficient, model.column, model.row
        p, q = value * bottom[column], value * top[column]
        least, most = np.minimum(p, q), np.maximum(p, q)
        count = model.rows + 1
        under = model.constant + np.bincount(row, least, minlength=count)
        over = model.constant + np.bincount(row, most, minlength=count)
        target_high = np.append(np.where(model.equality, 0.0, np.inf), cutoff)
        target_low = np.append(np.zeros(model.rows), -np.inf)
        slack = _ROUNDING * (1.0 + np.bincount(row, np.maximum(abs(p), abs(q)), minlength=count))
        if np.any(under > target_high + slack) or np.any(over < target_low - slack):
            return low, high, True
        rounding = _DIGITS * slack  # roots of what is 0 but for rounding would be large
        above = (target_high - under + rounding)[row] + least
        below = (target_low - over - rounding)[row] + most
        up = np.where(value > 0, above / value, below / value)
        down = np.where(value > 0, below / value, above / value)
        down, up = np.maximum(down, bottom[column]), np.minimum(up, top[column])
        new_low, new_high = low.copy(), high.copy()
        terms, variable = self._linear
        np.maximum.at(new_low, variable, down[terms])
        np.minimum.at(new_high, variable, up[terms])
        self._solve_mixed((low, high), (new_low, new_high), down, up)
        self._solve_squares((new_low, new_high), down, up)
        low, high = new_low, new_high
        slack = _ROUNDING * (1.0 + np.abs(low))
        empty = bool(np.any(low > high + slack))
        return np.minimum(low, high), np.maximum(low, high), empty

    def _ranges(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Ranges of all columns over a box."""
        model = self.model
        i, j = model.first, model.second
        ends = np.stack([low[i] * low[j], low[i] * high[j], high[i] * low[j], high[i] * high[j]])
        least = ends.min(axis=0)
        least[model.square & (low[i] < 0) & (high[i] > 0)] = 0.0
        # l u lies among the ends of a square without being one of its values
        own = np.minimum(ends[0], ends[3])
        outside = model.square & ((low[i] >= 0) | (high[i] <= 0))
        least = np.where(outside, own, least)
        return np.append(low, least), np.append(high, ends.max(axis=0))

    def _solve_mixed(
        self, old: tuple[Floats, Floats], new: tuple[Floats, Floats], down: Floats, up: Floats
    ) -> None:
        """Solve down <= x_i x_j <= up for both factors, in place."""
        terms, variable, other = self._mixed
        low, high = old[0][other], old[1][other]
        sure = np.flatnonzero((low > 1e-8) | (high < -1e-8))
        if sure.size:
            term, a, b = terms[sure], 1.0 / high[sure], 1.0 / low[sure]
            ends = np.stack([down[term] * a, down[term] * b, up[term] * a, up[term] * b])
            np.maximum.at(new[0], variable[sure], ends.min(axis=0))
            np.minimum.at(new[1], variable[sure], ends.max(axis=0))

    def _solve_squares(self, new: tuple[Floats, Floats], down: Floats, up: Floats) -> None:
        """Solve down <= x_i^2 <= up, in place."""
        terms, v = self._squares
        if not terms.size:
            return
        low, high = new
        far, near = np.sqrt(np.maximum(up[terms], 0.0)), np.sqrt(np.maximum(down[terms], 0.0))
        sure = near * (1.0 - _ROUNDING) - _ROUNDING  # a fixed variable is not beyond its root
        at_least = np.where((near > 0) & (low[v] > -sure), near, -far)
        at_most = np.where((near > 0) & (high[v] < sure), -near, far)
        np.maximum.at(low, v, at_least)
        np.minimum.at(high, v, at_most)
