"""Multiples of monomials that an identity replaces by their least values over the box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.monomials import Words
from sparsepop_py.verified.arithmetic.interval import Interval, sum_by
from sparsepop_py.verified.arithmetic.polynomial_range import monomial_ranges
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.multipliers import are_indices, are_numbers

__all__ = ["Priced"]


@dataclass(frozen=True, eq=False)
class Priced:
    """Multiples of monomials that are replaced by their least values over the box.

    What multipliers of bounds on moments (l <= y_a <= u) amount to.

    Parameters
    ----------
    words : (L, D) int32
    values : (L,) float
    """

    words: Words
    values: NDArray

    def consistent(self, n: int) -> bool:
        """Whether these are L monomials in n variables and L finite numbers."""
        shapes = self.words.ndim == 2 and self.values.shape == (self.words.shape[0],)
        wide = shapes and self.words.shape[1] > 0
        return bool(wide and are_indices(self.words, n + 1) and are_numbers(self.values))

    def least(self, scaling: Scaling) -> float:
        """Sum of the least values over the box of t, rounded down."""
        value = monomial_ranges(self.words, Interval(*scaling.bounds))
        least = (value * Interval.point(self.values.astype(float))).lo
        least = np.where(self.values == 0, 0.0, least)
        if not np.all(np.isfinite(least)):
            return -np.inf
        return float(sum_by(np.zeros(least.size, int), Interval.point(least), 1).lo[0])
