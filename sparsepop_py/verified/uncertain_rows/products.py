"""Rows in products of parameters, and what bounds of products say of factors.

Rows may be linear in monomials of theta (a, b, b*g, ...). Bounds of all monomials follow from
the rows as for parameters (:mod:`sparsepop_py.verified.uncertain_rows.sign_tree`). Then each
factor is bounded by the quotient: g lies in (b*g) / b where b excludes zero; with sum b - sum a
= 1 the sum of all b_j*g is g (1 + sum a). Products with equal coefficients in all rows share one
column, which stands for their sum. A bound of the sum bounds one of them where the others are
bounded, and a factor that all of them share: c lies in (c + c*a + c*b) / (1 + a + b).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial, total, variables
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.arithmetic.scalar_interval import (
    Ends,
    meet,
    plus,
    product,
    quotient,
    sum_of,
    times,
)
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows

__all__ = ["Gain", "Monomial", "ProductRows", "Total", "contracted", "merged"]

Reals = NDArray[np.float64]
Monomial = tuple[int, ...]


Total = tuple[Monomial, ...]  # a sum of monomials


Gain = tuple[tuple[int, ...], tuple[int, ...]]  # numerator and denominator of a block


_SWEEPS = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductRows:
    """UncertainRows rows in monomials of theta, and in sums of them.

    Parameters
    ----------
    regression : UncertainRows
        Its names are those of the columns.
    columns : tuple of tuple of tuple of int
        Each column multiplies a sum of monomials; a monomial is its parameters (from 0).
    parameters : tuple of str
    gains : tuple of (numerator, denominator)
        Parameters with sum of the numerator = 1 + sum of the denominator (a static gain of 1).
    """

    regression: UncertainRows
    columns: tuple[Total, ...]
    parameters: tuple[str, ...]
    gains: tuple[Gain, ...] = ()

    def start(self, box: Reals) -> Reals:
        """Bound all columns (2, q) on a box (2, p) of theta, rounded outwards."""
        ends = [(float(a), float(b)) for a, b in box.T]
        return np.array([_total(ends, column) for column in self.columns]).T

    @property
    def place(self) -> dict[Monomial, int]:
        """The column of each monomial that has one of its own."""
        return {column[0]: i for i, column in enumerate(self.columns) if len(column) == 1}

    @property
    def sums(self) -> tuple[Total, ...]:
        """Sums of monomials in static gains: of a, and of b gamma."""
        found: list[Total] = []
        for numerator, denominator in self.gains:
            found.append(tuple((i,) for i in denominator))
            for i in range(len(self.parameters)):
                found.append(tuple(tuple(sorted((j, i))) for j in numerator))
        known = self.place.keys()
        return tuple(dict.fromkeys(s for s in found if len(s) > 1 and set(s) <= known))

    def objectives(self) -> list[Polynomial]:
        """List the sums and their negatives in turn, as polynomials in the columns."""
        x, place = variables(len(self.columns)), self.place
        totals = [total([x[place[m]] for m in parts]) for parts in self.sums]
        return [sign * total for total in totals for sign in (1.0, -1.0)]

    def shrunk(self, box: Reals, low: Reals, high: Reals, sums: Sequence[Ends] = ()) -> Reals:
        """Tighten the box (2, p) of theta by ranges of columns and sums."""
        columns = zip(self.columns, low.tolist(), high.tolist(), strict=True)
        ends = {column: (a, b) for column, a, b in columns}
        return contracted(box, ends | dict(zip(self.sums, sums, strict=bool(sums))), self.gains)


def contracted(box: Reals, totals: Mapping[Total, Ends], gains: Sequence[Gain]) -> Reals:
    """Tighten a box of theta by sums of products and unit gains.

    Parameters
    ----------
    box : (2, p) float
    totals : mapping of monomials to (low, high)
        Bounds of their sum.
    gains : sequence of (numerator, denominator)
        Static gains that are 1.

    Returns
    -------
    (2, p) float
        Rounded outwards; ends that cross where nothing is left.
    """
    ends = [(float(a), float(b)) for a, b in box.T]
    for _ in range(_SWEEPS):
        for terms, found in totals.items():
            _settle_total(ends, terms, found)
        for numerator, denominator in gains:
            _settle_gain(ends, numerator, denominator)
            _settle_factors(ends, numerator, denominator, totals)
    return np.array(ends).T


def _total(ends: Sequence[Ends], total: Total) -> Ends:
    """Compute the range of a sum of monomials; a single one as it is."""
    ranges = [product([ends[i] for i in monomial]) for monomial in total]
    return ranges[0] if len(ranges) == 1 else sum_of(ranges)


def _settle_total(ends: list[Ends], total: Total, found: Ends) -> None:
    """Solve a sum of monomials in ``found`` for each monomial and factor."""
    for i in total[0] if len(total) > 1 else ():
        if all(monomial.count(i) == 1 for monomial in total):
            cofactors = tuple(tuple(j for j in monomial if j != i) for monomial in total)
            ends[i] = meet(ends[i], quotient(found, _total(ends, cofactors)))
    for monomial in total:
        rest = tuple(other for other in total if other != monomial)
        mine = plus(found, times((-1.0, -1.0), _total(ends, rest))) if rest else found
        for place, i in enumerate(monomial):
            others = product([ends[j] for k, j in enumerate(monomial) if k != place])
            ends[i] = meet(ends[i], quotient(mine, others))


def _settle_gain(ends: list[Ends], numerator: Sequence[int], denominator: Sequence[int]) -> None:
    """Solve sum b - sum a = 1 for each term in turn."""
    signs = [(i, 1.0) for i in numerator] + [(i, -1.0) for i in denominator]
    for i, sign in signs:
        rest = (1.0, 1.0)
        for j, other in signs:
            if j != i:
                rest = plus(rest, times((-other, -other), ends[j]))
        ends[i] = meet(ends[i], times((sign, sign), rest))


def _settle_factors(
    ends: list[Ends],
    numerator: Sequence[int],
    denominator: Sequence[int],
    totals: Mapping[Total, Ends],
) -> None:
    """Gamma = (sum_j b_j gamma) / (1 + sum a)."""
    everything = (-inf, inf)
    single = tuple((i,) for i in denominator)
    poles = meet(sum_of([ends[i] for i in denominator]), totals.get(single, everything))
    total = plus((1.0, 1.0), poles)
    for i in range(len(ends)):
        parts = tuple(tuple(sorted((j, i))) for j in numerator)
        if i in numerator or not parts or any((part,) not in totals for part in parts):
            continue
        top = meet(sum_of([totals[part,] for part in parts]), totals.get(parts, everything))
        ends[i] = meet(ends[i], quotient(top, total))


def merged(rows: ProductRows, factors: Sequence[Hashable]) -> ProductRows:
    """Merge columns that multiply the same into one, the sum of their monomials.

    Parameters
    ----------
    rows : ProductRows
    factors : sequence of hashable
        For each column what it multiplies in all rows, noise included.
    """
    groups: dict[Hashable, list[int]] = {}
    for place, factor in enumerate(factors):
        groups.setdefault(factor, []).append(place)
    kept, known = [group[0] for group in groups.values()], rows.regression
    regression = replace(
        known,
        names=tuple("+".join(known.names[i] for i in group) for group in groups.values()),
        regressors=frozen(known.regressors[:, kept]),
        radii=frozen(known.radii[:, kept]),
    )
    columns = tuple(tuple(m for i in group for m in rows.columns[i]) for group in groups.values())
    return replace(rows, regression=regression, columns=columns)
