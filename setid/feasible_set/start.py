"""Find a box of the parameters from data and priors.

    rows linear in theta        linear programs by signs, then all rows together
    a map behind a block        cells of the block's coefficients
    rows in products of theta   bounds of the products, then of their factors

It is the first stage after exact linear programs. The engine is asked only
where all rows are taken together.
"""

from __future__ import annotations

import time
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.units import coupled_rows
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.parameter_box import ProvedBox, product_rows, start_of
from sparsepop_py.budget import LimitReached
from sparsepop_py.uncertain_rows.directions import direction_box
from sparsepop_py.uncertain_rows.lifted_products import complete_box, lifted_box
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["find_box"]

_SHARE = 0.5  # of the time that all rows together may take, where priors give a box already
_MOST = 20.0  # seconds for the same, or units of work


def find_box(formulation: Formulation, until: float = inf) -> ProvedBox | None:
    """Find the box of parameters that data and priors prove, None where nothing tells.

    Parameters
    ----------
    formulation : Formulation
    until : float
        Reading of ``time.monotonic`` at which all work ends.
    """
    formulation = multiplied_out(formulation)
    start, rows = start_of(formulation), formulation.smoothed
    if rows is not None:
        first = parameter_box(rows, start, until)
        if first.empty:
            return first
        if not _is_finite(first):
            return direction_box(rows, coupled_rows(formulation), first, until) or first
        return _by_all_rows(formulation, rows, first, until)
    cells = cell_box(formulation, start, until)
    if cells is not None:
        return cells
    products = product_rows(formulation)
    if products is None:
        return None
    box = lifted_box(products, start, until)
    return complete_box(box, coupled_rows(formulation), products, until)


def _is_finite(box: ParameterBox) -> bool:
    return bool(np.all(np.isfinite([box.lower, box.upper])))


def _by_all_rows(
    formulation: Formulation, rows: UncertainRows, first: ParameterBox, until: float
) -> ParameterBox | DirectionBox:
    """Shrink a box by all rows together where it rests on bounds that priors give.

    Without these bounds it would be infinite, and all rows together be asked. A prior must not
    leave them out.
    """
    begun = time.monotonic()
    end = begun + _SHARE * (until - begun)
    if not _touches(first, first.start) or begun >= end:
        return first
    try:
        if _is_finite(parameter_box(rows, until=end)):
            return first
        found = direction_box(rows, coupled_rows(formulation), first, end, _MOST)
    except LimitReached:
        return first
    if found is None or found.cut_short:
        return first
    smaller = np.any(found.lower > first.lower) or np.any(found.upper < first.upper)
    return found if smaller else first


def _touches(box: ParameterBox, start: NDArray[np.float64]) -> bool:
    """Check for an end of a box that is one of the bounds that were known before."""
    known = np.isfinite(start)
    return bool(np.any(known & (start == np.array([box.lower, box.upper]))))
