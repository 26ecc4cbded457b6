"""Rows of the data in products of parameters, and what bounds of products say of factors.

Where internal signals can be eliminated, a row is linear in monomials of theta (a1, b1,
b1*gamma2, ...). Bounds of all monomials follow from the rows as for parameters (see
:mod:`setid.feasible_set.sign_tree`). Then each factor is bounded by the quotient: gamma2 lies in
(b1*gamma2) / b1 where b1 excludes zero; with static gain 1 the sum of all b_j*gamma2 is
gamma2 (1 + sum a). Products that multiply the same signal everywhere (with two denominators a1
and a'1, both at y(k-1)) are one column, their sum, which bounds each where the others are bounded.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.data.record import IOData
from setid.formulation.compiler import plan
from setid.formulation.interval_arithmetic import Ends, meet, plus, product, quotient, sum_of, times
from setid.formulation.regression import Regression, rows_of
from setid.formulation.signals import Signal
from setid.models.block import BlockStructured
from setid.models.equations import Structure

__all__ = ["Gain", "Monomial", "MonomialRows", "Total", "build_products", "contracted", "merged"]

Reals = NDArray[np.float64]
Monomial = tuple[int, ...]
Total = tuple[Monomial, ...]  # a sum of monomials
Gain = tuple[tuple[int, ...], tuple[int, ...]]  # numerator and denominator of a block
_SWEEPS = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MonomialRows:
    """Regression rows in monomials of theta, and in sums of them.

    Parameters
    ----------
    regression : Regression
        Its names are those of the columns.
    columns : tuple of tuple of tuple of int
        Each column multiplies a sum of monomials; a monomial is its parameters (from 0).
    parameters : tuple of str
    gains : tuple of (numerator, denominator)
        Parameters of blocks whose static gain is 1.
    """

    regression: Regression
    columns: tuple[Total, ...]
    parameters: tuple[str, ...]
    gains: tuple[Gain, ...] = ()

    def start(self, box: Reals) -> Reals:
        """Bounds (2, q) of all columns on a box (2, p) of theta, rounded outwards."""
        ends = [(float(a), float(b)) for a, b in box.T]
        return np.array([_total(ends, column) for column in self.columns]).T

    @property
    def place(self) -> dict[Monomial, int]:
        """The column of each monomial that has one of its own."""
        return {column[0]: i for i, column in enumerate(self.columns) if len(column) == 1}

    @property
    def sums(self) -> tuple[Total, ...]:
        """Sums of monomials that static gains speak of: of the a, and of b gamma for each gamma."""
        found: list[Total] = []
        for numerator, denominator in self.gains:
            found.append(tuple((i,) for i in denominator))
            for i in range(len(self.parameters)):
                found.append(tuple(tuple(sorted((j, i))) for j in numerator))
        known = self.place.keys()
        return tuple(dict.fromkeys(s for s in found if len(s) > 1 and set(s) <= known))

    def objectives(self) -> list[sp.Polynomial]:
        """The sums and their negatives in turn, as polynomials in the columns."""
        x, place = sp.variables(len(self.columns)), self.place
        totals = [sp.total([x[place[m]] for m in parts]) for parts in self.sums]
        return [sign * total for total in totals for sign in (1.0, -1.0)]

    def shrunk(self, box: Reals, low: Reals, high: Reals, sums: Sequence[Ends] = ()) -> Reals:
        """The box (2, p) of theta, the columns in [low, high], sums of columns in ``sums``."""
        columns = zip(self.columns, low.tolist(), high.tolist(), strict=True)
        ends = {column: (a, b) for column, a, b in columns}
        return contracted(box, ends | dict(zip(self.sums, sums, strict=bool(sums))), self.gains)


def contracted(box: Reals, totals: Mapping[Total, Ends], gains: Sequence[Gain]) -> Reals:
    """A box of theta made smaller by bounds of sums of products, and by static gains of 1.

    Parameters
    ----------
    box : (2, p) float
    totals : mapping of monomials to (low, high)
        Bounds of their sum.
    gains : sequence of (numerator, denominator)

    Returns
    -------
    (2, p) float
        Rounded outwards; ends that cross where nothing is left.
    """
    ends = [(float(a), float(b)) for a, b in box.T]
    for _ in range(_SWEEPS):
        for total, found in totals.items():
            _settle_total(ends, total, found)
        for numerator, denominator in gains:
            _settle_gain(ends, numerator, denominator)
            _settle_factors(ends, numerator, denominator, totals)
    return np.array(ends).T


def _total(ends: Sequence[Ends], total: Total) -> Ends:
    """The range of a sum of monomials; a single one as it is."""
    ranges = [product([ends[i] for i in monomial]) for monomial in total]
    return ranges[0] if len(ranges) == 1 else sum_of(ranges)


def _settle_total(ends: list[Ends], total: Total, found: Ends) -> None:
    """A sum of monomials lies in ``found``: solved for each monomial, and that for each factor."""
    for monomial in total:
        rest = tuple(other for other in total if other != monomial)
        mine = plus(found, times((-1.0, -1.0), _total(ends, rest))) if rest else found
        for place, i in enumerate(monomial):
            others = product([ends[j] for k, j in enumerate(monomial) if k != place])
            ends[i] = meet(ends[i], quotient(mine, others))


def _settle_gain(ends: list[Ends], numerator: Sequence[int], denominator: Sequence[int]) -> None:
    """Sum b - sum a = 1, solved for each in turn."""
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


# ---- rows of block structures -------------------------------------------------------------


def build_products(
    data: IOData,
    model: Structure,
    signals: Mapping[str, Signal],
    usable: Mapping[str, NDArray[np.bool_]],
    equation_bound: Reals,
) -> MonomialRows | None:
    """Rows of a block structure whose outputs are sums of products; None for other models.

    Parameters
    ----------
    data, model, signals, usable, equation_bound
        As for :func:`setid.formulation.regression.build_regression`.
    """
    if not isinstance(model, BlockStructured):
        return None
    equations = model.direct()
    if not equations or all(e.linear_in_parameters for e in equations):
        return None
    words = {tuple(sorted(t.parameters)) for e in equations for t in e.terms if t.parameters}
    columns = {word: place for place, word in enumerate(sorted(words, key=lambda w: (len(w), w)))}
    number = {name: place for place, name in enumerate(model.parameters)}
    monomials = [tuple(sorted(number[name] for name in word)) for word in columns]
    names = tuple("*".join(word) for word in columns)
    plans = plan(equations, data, usable, model.initial)
    rows = rows_of(plans, columns, names, data, signals, equation_bound)
    blocks = [model.linear_blocks[label] for label in model.unit_gain]
    gains = tuple(
        (tuple(number[n] for n in b.numerator), tuple(number[n] for n in b.denominator))
        for b in blocks
        if {*b.numerator, *b.denominator} <= set(number)
    )
    factors = [
        tuple(
            (place, t.coefficient, t.signals)
            for place, equation in enumerate(equations)
            for t in equation.terms
            if tuple(sorted(t.parameters)) == word
        )
        for word in columns
    ]
    found = MonomialRows(rows, tuple((m,) for m in monomials), model.parameters, gains)
    return merged(found, factors)


def merged(rows: MonomialRows, factors: Sequence[Hashable]) -> MonomialRows:
    """Columns that multiply the same become one, the sum of their monomials.

    Parameters
    ----------
    rows : MonomialRows
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
