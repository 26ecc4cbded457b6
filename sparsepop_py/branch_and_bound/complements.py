"""Variables and linear rows whose product is zero, or at most zero: complementarity.

Where x_v > 0 the inequality is an equation. With the lower end l > 0 of a box follows

    -g  =  (x_v - l) g / l  -  x_v g / l,

a product of two inequalities and a multiple of the equation, so that multipliers of g of either
sign become those of rows that the problem has. All numbers here are rounded; what they prove is
computed by the trusted kernel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.verified.box.scaling import Scaling

__all__ = ["Complements", "Terms"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Terms = dict[tuple[int, ...], float]  # coefficients by the variables of a term, () for 1
_LEAST_RATIO = 2.0**-20  # of the lower end of a positive factor to its half width, to divide by it


@dataclass(frozen=True, eq=False)
class Complements:
    """Rows that say that the product of a variable and an inequality is zero.

    Parameters
    ----------
    variable : (F,) int
        v, at least zero where the rest of this is used.
    equation, inequality : (F,) int
        Rows; the first may also say that the product is at most zero.
    factor : (F,) float
        Equation = factor * x_v * inequality.
    """

    variable: Ints
    equation: Ints
    inequality: Ints
    factor: Floats

    @staticmethod
    def of(rows: Sequence[Terms], equality: NDArray[np.bool_]) -> Complements:
        """Find the pairs among rows of degree at most 2.

        Parameters
        ----------
        rows : sequence of dict
        equality : (m,) bool

        Returns
        -------
        Complements
        """
        quotients = [
            (v, row, quotient)
            for row, terms in enumerate(rows)
            for v, quotient in _quotients(terms)
        ]
        forms: dict[tuple[tuple[tuple[int, ...], str], ...], tuple[int, float]] = {}
        for row in np.flatnonzero(~equality).tolist() if quotients else ():
            if all(len(term) < 2 for term in rows[row]):
                form, size = _normal(rows[row], 1.0)
                forms.setdefault(form, (row, size))
        made = []
        for v, row, quotient in quotients:
            for sign in (1.0, -1.0):
                form, size = _normal(quotient, sign)
                if form in forms and (equality[row] or sign < 0):
                    other, own = forms[form]
                    made.append((v, row, other, sign * size / own))
        variable, equation, inequality = np.array([m[:3] for m in made], np.int64).reshape(-1, 3).T
        return Complements(variable, equation, inequality, np.array([m[3] for m in made], float))

    def positive(self, scaling: Scaling) -> Ints:
        """Find the pairs whose variable is positive on a box, one for each inequality."""
        scale = scaling.scale[self.variable]
        least = scaling.centre[self.variable] - scale
        sure = np.flatnonzero((least > _LEAST_RATIO * scale) & (scale > 0))
        _, first = np.unique(self.inequality[sure], return_index=True)
        return sure[first]

    def replaced(
        self, table: Floats, scaling: Scaling, sizes: Floats, free: NDArray[np.bool_]
    ) -> Floats:
        """Replace prices of the wrong sign of inequalities that are equations on a box.

        Parameters
        ----------
        table : (K, R) float
            Prices of the rows, each over its size, and of others behind them.
        scaling : Scaling
            Of the box.
        sizes : (m + 1,) float
            Sizes of the rows.
        free : (R,) bool
            Rows whose prices have no sign.

        Returns
        -------
        (K, R + F) float
            With prices of the products (1 + t_v) g behind.
        """
        used = self.positive(scaling)
        v, row, equation = self.variable[used], self.inequality[used], self.equation[used]
        scale = scaling.scale[v]
        wrong = np.where(free[row], 0.0, np.maximum(-table[:, row], 0.0))
        shared = wrong / (sizes[row] * (scaling.centre[v] - scale))
        result = np.concatenate([table, np.zeros((table.shape[0], self.variable.size))], axis=1)
        result[:, table.shape[1] + used] = shared * scale
        result[:, row] += wrong
        change = shared * sizes[equation] / self.factor[used]
        for place, row_of in enumerate(equation.tolist()):
            result[:, row_of] -= change[:, place]
        return result


def _quotients(terms: Terms) -> Iterator[tuple[int, Terms]]:
    """Divide a row by each variable that all its terms contain, where it has products."""
    if not terms or max(map(len, terms)) < 2:
        return
    for v in sorted(set.intersection(*(set(term) for term in terms))):
        parts: Terms = {}
        for term, value in terms.items():
            rest = list(term)
            rest.remove(v)
            parts[tuple(rest)] = value
        yield v, parts


def _normal(terms: Terms, sign: float) -> tuple[tuple[tuple[tuple[int, ...], str], ...], float]:
    """Divide a form by the size of its first coefficient that is no constant; both.

    Ten digits are kept: what differs by rounding is the same, and the proof pays for the rest.
    """
    items = sorted(terms.items())
    size = abs(next((value for term, value in items if term), 1.0))
    return tuple((term, f"{sign * value / size:.9e}") for term, value in items), size
