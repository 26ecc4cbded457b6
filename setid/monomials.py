"""Rows of the data in products of parameters, and what bounds of products say of factors.

Where internal signals can be eliminated, a row is linear in monomials of theta (a1, b1,
b1*gamma2, ...). Bounds of all monomials follow from the rows as for parameters (see
:mod:`setid.boxes`). Then each factor is bounded by the quotient: gamma2 lies in
(b1*gamma2) / b1 where b1 excludes zero; with static gain 1 the sum of all b_j*gamma2 is
gamma2 (1 + sum a).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from .compiler import plan
from .data import IOData
from .interval_arithmetic import Ends, meet, plus, product, quotient, sum_of, times
from .models.block import BlockStructured
from .models.equations import Structure
from .regression import Regression, rows_of
from .signals import Signal

__all__ = ["Gain", "Monomial", "MonomialRows", "build_products", "contracted"]

Reals = NDArray[np.float64]
Monomial = tuple[int, ...]
Gain = tuple[tuple[int, ...], tuple[int, ...]]  # numerator and denominator of a block
_SWEEPS = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MonomialRows:
    """Regression rows in monomials of theta.

    Parameters
    ----------
    regression : Regression
        Its names are those of the monomials.
    monomials : tuple of tuple of int
        Parameters (from 0) of each column.
    parameters : tuple of str
    gains : tuple of (numerator, denominator)
        Parameters of blocks whose static gain is 1.
    """

    regression: Regression
    monomials: tuple[Monomial, ...]
    parameters: tuple[str, ...]
    gains: tuple[Gain, ...] = ()

    def start(self, box: Reals) -> Reals:
        """Bounds (2, q) of all monomials on a box (2, p) of theta, rounded outwards."""
        ends = [product([box[:, i].tolist() for i in monomial]) for monomial in self.monomials]
        return np.array(ends).T

    @property
    def sums(self) -> tuple[tuple[Monomial, ...], ...]:
        """Sums of monomials that static gains speak of: of the a, and of b gamma for each gamma."""
        found: list[tuple[Monomial, ...]] = []
        for numerator, denominator in self.gains:
            found.append(tuple((i,) for i in denominator))
            for i in range(len(self.parameters)):
                found.append(tuple(tuple(sorted((j, i))) for j in numerator))
        known = set(self.monomials)
        return tuple(dict.fromkeys(s for s in found if len(s) > 1 and set(s) <= known))

    def objectives(self) -> list[sp.Polynomial]:
        """The sums and their negatives in turn, as polynomials in the monomials."""
        x = sp.variables(len(self.monomials))
        place = {m: i for i, m in enumerate(self.monomials)}
        totals = [sp.total([x[place[m]] for m in parts]) for parts in self.sums]
        return [sign * total for total in totals for sign in (1.0, -1.0)]

    def shrunk(self, box: Reals, low: Reals, high: Reals, sums: Sequence[Ends] = ()) -> Reals:
        """The box (2, p) of theta, the monomials in [low, high], their sums in ``sums``."""
        ends = {m: (float(low[i]), float(high[i])) for i, m in enumerate(self.monomials)}
        totals = dict(zip(self.sums, sums, strict=bool(sums)))
        return contracted(box, ends, self.gains, totals)


def contracted(
    box: Reals,
    monomials: Mapping[Monomial, Ends],
    gains: Sequence[Gain],
    sums: Mapping[tuple[Monomial, ...], Ends],
) -> Reals:
    """A box of theta made smaller by bounds of products, and by static gains of 1.

    Parameters
    ----------
    box : (2, p) float
    monomials : mapping of parameters to (low, high)
    gains : sequence of (numerator, denominator)
    sums : mapping of several monomials to (low, high)
        Bounds of their sum.

    Returns
    -------
    (2, p) float
        Rounded outwards; ends that cross where nothing is left.
    """
    ends = [(float(a), float(b)) for a, b in box.T]
    for _ in range(_SWEEPS):
        for monomial, found in monomials.items():
            for place, i in enumerate(monomial):
                others = product([ends[j] for k, j in enumerate(monomial) if k != place])
                ends[i] = meet(ends[i], quotient(found, others))
        for numerator, denominator in gains:
            _settle_gain(ends, numerator, denominator)
            _settle_factors(ends, numerator, denominator, monomials, sums)
    return np.array(ends).T


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
    monomials: Mapping[Monomial, Ends],
    sums: Mapping[tuple[Monomial, ...], Ends],
) -> None:
    """Gamma = (sum_j b_j gamma) / (1 + sum a)."""
    everything = (-inf, inf)
    single = tuple((i,) for i in denominator)
    poles = meet(sum_of([ends[i] for i in denominator]), sums.get(single, everything))
    total = plus((1.0, 1.0), poles)
    for i in range(len(ends)):
        parts = tuple(tuple(sorted((j, i))) for j in numerator)
        if i in numerator or not parts or not set(parts) <= set(monomials):
            continue
        top = meet(sum_of([monomials[part] for part in parts]), sums.get(parts, everything))
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
        As for :func:`setid.regression.build_regression`.
    """
    if not isinstance(model, BlockStructured):
        return None
    equations = model.direct()
    if not equations or all(e.linear_in_parameters for e in equations):
        return None
    words = {tuple(sorted(t.parameters)) for e in equations for t in e.terms if t.parameters}
    columns = {word: place for place, word in enumerate(sorted(words, key=lambda w: (len(w), w)))}
    number = {name: place for place, name in enumerate(model.parameters)}
    monomials = tuple(tuple(sorted(number[name] for name in word)) for word in columns)
    names = tuple("*".join(word) for word in columns)
    plans = plan(equations, data, usable, model.initial)
    rows = rows_of(plans, columns, names, data, signals, equation_bound)
    blocks = [model.linear_blocks[label] for label in model.unit_gain]
    gains = tuple(
        (tuple(number[n] for n in b.numerator), tuple(number[n] for n in b.denominator))
        for b in blocks
        if {*b.numerator, *b.denominator} <= set(number)
    )
    return MonomialRows(rows, monomials, model.parameters, gains)
