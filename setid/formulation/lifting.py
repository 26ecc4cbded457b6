"""Sums of products of parameters as unknowns of their own, so that rows stay bilinear.

Two denominators multiplied out, (1 + a q^-1)(1 + a' q^-1) y, put (a + a') y(k-1) + a a' y(k-2)
into each row. With noise in y that is of degree three. With

    l1 = a + a',    l2 = a a'

stated once, rows hold l1 y(k-1) + l2 y(k-2), of degree two. Of three denominators l = a a' is
stated before l a'', so that each definition is of degree two as well. Nothing is gained or lost:
each vector of parameters gives one value of each unknown.

References
----------
G. P. McCormick, Computability of global solutions to factorable nonconvex programs: part I,
Mathematical Programming 10, 1976 (products as further variables).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

import sparsepop_py as sp
from setid.formulation.layout import Layout
from setid.models.equations import Equation, Lagged, Term

__all__ = ["DRIVEN", "LIFTED", "Lifting", "definitions", "lift"]

LIFTED: Final = "lifted"  # the form of such structures, and the group of these unknowns
DRIVEN: Final = "driven"  # the same with an offset of the equation
Sum = tuple[tuple[float, tuple[str, ...]], ...]


@dataclass(frozen=True, slots=True)
class Lifting:
    """Equations with sums of products as parameters, and what these are.

    Parameters
    ----------
    equations : tuple of Equation
        In the parameters and in ``lifted[1]``, ``lifted[2]``, ...
    sums : tuple
        For each of them coefficients and two names at most, of parameters or of those before it.
    """

    equations: tuple[Equation, ...]
    sums: tuple[Sum, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(f"{LIFTED}[{k}]" for k in range(1, len(self.sums) + 1))


def lift(equations: Sequence[Equation]) -> Lifting:
    """Replace what multiplies each signal, where that is more than one parameter.

    Parameters
    ----------
    equations : sequence of Equation

    Returns
    -------
    Lifting
        Without sums where a product of parameters multiplies several signals: rows add their
        readings up, and would not be about the same doubles.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(1, 1, 1, inputs=2, form="lifted")
    >>> lifting = lift(model.equations())
    >>> lifting.sums[0]
    ((1.0, ('a[1,2]1',)), (1.0, ('a[1,1]1',)))
    >>> lifting.equations[0].linear_in_parameters
    True
    """
    words = [(e.defines, t.parameters) for e in equations for t in e.terms if t.parameters]
    if len(set(words)) < len(words):
        return Lifting(tuple(equations))
    sums: dict[Sum, str] = {}
    made = []
    for equation in equations:
        groups: dict[tuple[Lagged, ...], list[Term]] = {}
        for term in equation.terms:
            groups.setdefault(term.signals, []).append(term)
        terms = [_joined(signals, terms, sums) for signals, terms in groups.items()]
        made.append(replace(equation, terms=tuple(terms)))
    return Lifting(tuple(made), tuple(sums))


def _joined(signals: tuple[Lagged, ...], terms: list[Term], sums: dict[Sum, str]) -> Term:
    """One term for all that multiplies some signals."""
    first = terms[0]
    if len(terms) == 1 and len(first.parameters) <= 1:
        return first
    sign = math.copysign(1.0, first.coefficient)
    own = tuple((sign * t.coefficient, _pair(t.parameters, sums)) for t in terms)
    return Term(sign, (_named(own, sums),), signals)


def _pair(names: tuple[str, ...], sums: dict[Sum, str]) -> tuple[str, ...]:
    """The same product of at most two factors, the first of which may be a product itself."""
    while len(names) > 2:
        names = _named(((1.0, names[:2]),), sums), *names[2:]
    return names


def _named(own: Sum, sums: dict[Sum, str]) -> str:
    return sums.setdefault(own, f"{LIFTED}[{len(sums) + 1}]")


def definitions(lifting: Lifting, layout: Layout) -> list[sp.Constraint]:
    """State each of these unknowns minus its sum == 0.

    Parameters
    ----------
    lifting : Lifting
    layout : Layout
        With the group of these unknowns.
    """
    rows = []
    for number, own in zip(layout.group(LIFTED).tolist(), lifting.sums, strict=True):
        words = [[layout.index(name) + 1 for name in names] for _, names in own]
        letters = np.zeros((len(own) + 1, max(map(len, words), default=1)), np.int32)
        letters[0, -1] = number + 1
        for row, word in enumerate(words, 1):
            letters[row, letters.shape[1] - len(word) :] = sorted(word)
        values = np.array([1.0, *(-coefficient for coefficient, _ in own)])
        polynomial = sp.Polynomial.from_words(letters, values, layout.dimension, layout.names)
        rows.append(sp.Constraint(polynomial, sp.Kind.ZERO, layout.names[number]))
    return rows
