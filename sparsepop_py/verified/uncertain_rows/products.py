"""Rows in products of parameters, and what bounds of products say of factors.

Rows may be linear in monomials of theta (a, b, b*g, ...). Bounds of all monomials follow from
the rows as for parameters (:mod:`sparsepop_py.verified.uncertain_rows.sign_tree`). Then each
factor is bounded by the quotient: g lies in (b*g) / b where b excludes zero; with sum b - sum a
= 1 the sum of all b_j*g is g (1 + sum a). Products with equal coefficients in all rows share one
column, which stands for their sum. A bound of the sum bounds one of them where the others are
bounded, and a factor that all of them share: c lies in (c + c*a + c*b) / (1 + a + b), where a
column that is a + b bounds that sum.

Where denominators 1 + a_1 q^-1 + ... are multiplied out, the coefficients of their product bound
those of each: its zeros are zeros of the product, so that |a_i| <= C(n, i) M for a denominator of
order n, with M the product of all max(1, |zero|), and M is at most the root of the sum of the
squared coefficients of the product, 1 among them.

References
----------
E. Landau, Sur quelques theoremes de M. Petrovic relatifs aux zeros des fonctions analytiques,
Bull. Soc. Math. France 33, 1905 (M). M. Mignotte, An inequality about factors of polynomials,
Math. Comp. 28, 1974 (factors).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product as every_choice
from math import comb, inf, nextafter, sqrt

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial, total, variables
from sparsepop_py.errors import ProblemError
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


Factors = tuple[tuple[int, ...], ...]  # denominators that are multiplied, each from lag 1 on


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
    denominators : tuple of tuple of tuple of int
        For each output its denominators, by their parameters from lag 1 on; rows hold their
        product.

    Raises
    ------
    ProblemError
        If there is not one sum for each column, or a sum holds a monomial twice.
    """

    regression: UncertainRows
    columns: tuple[Total, ...]
    parameters: tuple[str, ...]
    gains: tuple[Gain, ...] = ()
    denominators: tuple[Factors, ...] = ()

    def __post_init__(self) -> None:
        if len(self.columns) != len(self.regression.names):
            count = len(self.regression.names)
            raise ProblemError(f"columns: found {len(self.columns)}, expected {count} as in rows")
        for number, column in enumerate(self.columns):
            if len(set(column)) < max(len(column), 1):
                raise ProblemError(
                    f"columns[{number}]: found {column}, expected distinct monomials"
                )

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
        totals = ends | dict(zip(self.sums, sums, strict=bool(sums)))
        return contracted(box, totals, self.gains, self.denominators)


def contracted(
    box: Reals,
    totals: Mapping[Total, Ends],
    gains: Sequence[Gain],
    denominators: Sequence[Factors] = (),
) -> Reals:
    """Tighten a box of theta by sums of products, unit gains and products of denominators.

    Parameters
    ----------
    box : (2, p) float
    totals : mapping of monomials to (low, high)
        Bounds of their sum.
    gains : sequence of (numerator, denominator)
        Static gains that are 1.
    denominators : sequence of denominators
        Those that are multiplied with each other.

    Returns
    -------
    (2, p) float
        Rounded outwards; ends that cross where nothing is left.
    """
    ends = [(float(a), float(b)) for a, b in box.T]
    for factors in denominators:
        _settle_denominators(ends, factors, totals)
    for _ in range(_SWEEPS):
        for terms, found in totals.items():
            _settle_total(ends, terms, found, totals, denominators)
        for numerator, denominator in gains:
            _settle_gain(ends, numerator, denominator)
            _settle_factors(ends, numerator, denominator, totals)
    return np.array(ends).T


def _total(ends: Sequence[Ends], total: Total) -> Ends:
    """Compute the range of a sum of monomials; a single one as it is."""
    ranges = [product([ends[i] for i in monomial]) for monomial in total]
    return ranges[0] if len(ranges) == 1 else sum_of(ranges)


def _sum_by(ends: Sequence[Ends], terms: Total, totals: Mapping[Total, Ends]) -> Ends:
    """Bound a sum of monomials, repeated ones too, by bounds of its parts."""
    left, ranges = Counter(terms), []
    for part, found in totals.items():
        if Counter(part) <= left:
            ranges.append(meet(found, _total(ends, part)))
            left.subtract(part)
    ranges += [product([ends[i] for i in monomial]) for monomial in left.elements()]
    return sum_of(ranges)


def _multiplied(factors: Factors) -> dict[int, list[Monomial]]:
    """List the coefficients of a product of denominators by their lags; 1 at lag 0."""
    coefficients: dict[int, list[Monomial]] = {}
    for choice in every_choice(*(enumerate((-1, *names)) for names in factors)):
        monomial = tuple(sorted(i for _, i in choice if i >= 0))
        coefficients.setdefault(sum(lag for lag, _ in choice), []).append(monomial)
    return coefficients


def _at_one(ends: Sequence[Ends], factors: Factors) -> Ends:
    """Bound the product of denominators at q = 1, factor by factor."""
    return product([sum_of([(1.0, 1.0), *(ends[i] for i in names)]) for names in factors])


def _settle_denominators(ends: list[Ends], factors: Factors, totals: Mapping[Total, Ends]) -> None:
    """Bound the coefficients of monic polynomials by those of their product."""
    coefficients, square = _multiplied(factors), 1.0
    for lag in range(1, max(coefficients) + 1):
        low, high = _sum_by(ends, tuple(coefficients[lag]), totals)
        largest = max(-low, high)
        square = nextafter(square + nextafter(largest * largest, inf), inf)
    size = nextafter(sqrt(square), inf)
    for names in factors:
        for lag, i in enumerate(names, 1):
            far = nextafter(comb(len(names), lag) * size, inf)
            ends[i] = meet(ends[i], (-far, far))


def _settle_total(
    ends: list[Ends],
    total: Total,
    found: Ends,
    totals: Mapping[Total, Ends],
    denominators: Sequence[Factors],
) -> None:
    """Solve a sum of monomials in ``found`` for each monomial and factor."""
    for i in total[0] if len(total) > 1 else ():
        if all(monomial.count(i) == 1 for monomial in total):
            cofactors = tuple(tuple(j for j in monomial if j != i) for monomial in total)
            divisor = _sum_by(ends, cofactors, totals)
            for factors in denominators:
                whole = [m for parts in _multiplied(factors).values() for m in parts]
                if sorted(whole) == sorted(cofactors):
                    divisor = meet(divisor, _at_one(ends, factors))
            ends[i] = meet(ends[i], quotient(found, divisor))
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
