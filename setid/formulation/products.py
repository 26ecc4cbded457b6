"""Rows of the data in products of parameters, for structures with internal signals.

Where internal signals can be eliminated, a row is linear in monomials of theta (a1, b1,
b1*gamma2, ...); what bounds of products say of factors is in
:mod:`sparsepop_py.verified.uncertain_rows.products`. Products that multiply the same signal
in all rows (with two denominators a1 and a'1, both at y(k-1)) share one column: their sum.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from setid.data.record import IOData
from setid.formulation.compiler import plan
from setid.formulation.regression import rows_of
from setid.formulation.signals import Signal
from setid.models.block import BlockStructured
from setid.models.equations import Structure
from sparsepop_py.verified.uncertain_rows.products import ProductRows, merged

__all__ = ["build_products"]

Reals = NDArray[np.float64]


def build_products(
    data: IOData,
    model: Structure,
    signals: Mapping[str, Signal],
    usable: Mapping[str, NDArray[np.bool_]],
    equation_bound: Reals,
) -> ProductRows | None:
    """Build rows of block structures with sums of products; None for other models.

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
    found = ProductRows(rows, tuple((m,) for m in monomials), model.parameters, gains)
    return merged(found, factors)
