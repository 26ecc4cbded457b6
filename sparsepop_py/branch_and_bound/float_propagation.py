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
_GAIN = 0.02  # of a width: sweeps that gain less are the last
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

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Floats]:
        """Pairs of terms a x and b x^2, their variable, and the vertex."""
        model, (linear, variable) = self.model, self._linear
        terms, squared = self._squares
        width = model.dimension
        _, one, two = np.intersect1d(
            model.row[linear] * width + variable,
            model.row[terms] * width + squared,
            return_indices=True,
        )
        one, two = linear[one], terms[two]
        vertex = -0.5 * model.coefficient[one] / model.coefficient[two]
        return one, two, model.column[one], vertex

    def sweeps(
        self, low: Floats, high: Floats, cutoff: float, most: int
    ) -> tuple[Floats, Floats, int, bool]:
        """Propagate up to ``most`` times while widths shrink by a share.

        Parameters
        ----------
        low, high : (n,) float
        cutoff : float
            Upper end of the objective, +inf without one.
        most : int

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
                if not np.any((width - left > _GAIN * width) & (width > 1e-9)):
                    return low, high, number, False
                low, high = new_low, new_high
        return low, high, most, False

    def _sweep(self, low: Floats, high: Floats, cutoff: float) -> tuple[Floats, Floats, bool]:
        model = self.model
        bottom, top = self._ranges(low, high)
        value, column, row = model.coefficient, model.column, model.row
        p, q = value * bottom[column], value * top[column]
        least, most = np.minimum(p, q), np.maximum(p, q)
        self._join_pairs((low, high), (least, most))
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
        one, two, _, _ = self._pairs
        for terms in (one, two):
            down[terms], up[terms] = bottom[column[terms]], top[column[terms]]
        new_low, new_high = low.copy(), high.copy()
        terms, variable = self._linear
        np.maximum.at(new_low, variable, down[terms])
        np.minimum.at(new_high, variable, up[terms])
        self._solve_mixed((low, high), (new_low, new_high), down, up)
        self._solve_squares((new_low, new_high), down, up)
        self._solve_pairs((low, high), (new_low, new_high), below[two], above[two])
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

    def _join_pairs(self, box: tuple[Floats, Floats], ends: tuple[Floats, Floats]) -> None:
        """Move the range of both terms of a pair to its square, in place."""
        one, two, v, vertex = self._pairs
        if not one.size:
            return
        a, b = self.model.coefficient[one], self.model.coefficient[two]
        low, high = box[0][v], box[1][v]
        inner = np.clip(vertex, low, high)
        values = np.stack([x * (a + b * x) for x in (low, high, inner)])
        ends[0][one] = ends[1][one] = 0.0
        ends[0][two], ends[1][two] = values.min(axis=0), values.max(axis=0)

    def _solve_pairs(
        self,
        old: tuple[Floats, Floats],
        new: tuple[Floats, Floats],
        below: Floats,
        above: Floats,
    ) -> None:
        """Solve each pair of terms for (x - vertex)^2, in place.

        The proof knows the old box only: a sweep must not be ahead of it.
        """
        _, two, v, vertex = self._pairs
        if not two.size:
            return
        b = self.model.coefficient[two]
        up = np.where(b > 0, above, below) / b + vertex**2
        down = np.where(b > 0, below, above) / b + vertex**2
        shift = _DIGITS * _ROUNDING * (1.0 + vertex**2)  # what is 0 but for rounding
        self._solve_roots(old, new, (v, vertex), down - shift, up + shift)

    def _solve_squares(self, new: tuple[Floats, Floats], down: Floats, up: Floats) -> None:
        """Solve down <= x_i^2 <= up, in place."""
        terms, v = self._squares
        if terms.size:
            self._solve_roots(new, new, (v, 0.0), down[terms], up[terms])

    @staticmethod
    def _solve_roots(
        known: tuple[Floats, Floats],
        new: tuple[Floats, Floats],
        about: tuple[NDArray[np.int64], Floats | float],
        down: Floats,
        up: Floats,
    ) -> None:
        """Solve for squares about a vertex, in place, from a known box."""
        (low, high), (v, vertex) = known, about
        far, near = np.sqrt(np.maximum(up, 0.0)), np.sqrt(np.maximum(down, 0.0))
        sure = near * (1.0 - _ROUNDING) - _ROUNDING  # a fixed variable is not beyond its root
        at_least = np.where((near > 0) & (low[v] - vertex > -sure), near, -far)
        at_most = np.where((near > 0) & (high[v] - vertex < sure), -near, far)
        np.maximum.at(new[0], v, vertex + at_least)
        np.minimum.at(new[1], v, vertex + at_most)
