"""Boxes of the parameters that follow from rows of the data, without simulations or cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.regression import Regression
from setid.formulation.units import coupled_rows
from setid.models.equations import channel_of
from setid.models.lti import TransferFunction
from setid.proofs.fields import well_formed
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox, lifted_rows
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["RowBox", "product_rows", "rows_prove"]

RowBox = ParameterBox | DirectionBox | LiftedBox


def rows_prove(box: RowBox, formulation: Formulation, start: NDArray[np.float64]) -> bool:
    """Check a box against the rows of the data, without any solver.

    Parameters
    ----------
    box : ParameterBox, DirectionBox or LiftedBox
    formulation : Formulation
    start : (2, p) float
        The bounds of the parameters that priors give.
    """
    if not well_formed(box):
        return False
    formulation = multiplied_out(formulation)
    if isinstance(box, LiftedBox):
        products = product_rows(formulation)
        return products is not None and box.verify(products, start, coupled_rows(formulation))
    rows = formulation.smoothed
    if rows is None:
        return False
    if isinstance(box, DirectionBox):
        return box.verify(rows, coupled_rows(formulation), start)
    return box.verify(rows, start)


def product_rows(formulation: Formulation) -> ProductRows | None:
    """State the rows of the data in products of parameters.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    ProductRows or None
        With rows that know their samples. None where an unknown other than theta has no finite
        bounds, or no row is left.
    """
    if formulation.products is not None:
        return formulation.products
    formulation = multiplied_out(formulation)
    found = lifted_rows(coupled_rows(formulation), formulation.parameters)
    if found is None:
        return None
    rows, problem = formulation.rows, formulation.problem
    kept = np.flatnonzero((rows.sample > 0) & problem.equality)
    channel = np.array([_output(rows.equation[row]) for row in kept], np.int64)
    record, sample = rows.record[kept], rows.sample[kept]
    where = formulation.data.starts[record - 1] + sample - 1
    known = found.regression
    fields = known.names, known.target, known.regressors, known.radius, known.radii
    places = (frozen(np.array(array)) for array in (where, record, sample, channel))
    denominators = _denominators(formulation)
    return replace(found, regression=Regression(*fields, *places), denominators=denominators)


def _output(equation: str) -> int:
    """Number the output of an equation from 1; 0 where it defines an internal signal."""
    channel = channel_of(equation)
    return channel[1] + 1 if channel else 0


def _denominators(formulation: Formulation) -> tuple[tuple[tuple[int, ...], ...], ...]:
    """Number the coefficients of the denominators that are multiplied out, output by output."""
    model, number = formulation.model, {n: k for k, n in enumerate(formulation.parameters)}
    if not isinstance(model, TransferFunction):
        return ()
    return tuple(
        tuple(tuple(number[name] for name in names) for names in model.denominators(output))
        for output in range(model.outputs)
        if len(model.denominators(output)) > 1
    )
