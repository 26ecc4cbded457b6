"""Find a box of the parameters from data and priors, by the fitting method."""

from __future__ import annotations

from math import inf

import numpy as np

from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.units import coupled_rows
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.parameter_box import ProvedBox, product_rows, start_of
from sparsepop_py.uncertain_rows.directions import direction_box
from sparsepop_py.uncertain_rows.lifted_products import complete_box, lifted_box
from sparsepop_py.uncertain_rows.sign_tree import parameter_box

__all__ = ["find_box"]


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
        unbounded = np.any(np.isinf([first.lower, first.upper])) and not first.empty
        if not unbounded:
            return first
        return direction_box(rows, coupled_rows(formulation), first, until) or first
    cells = cell_box(formulation, start, until)
    if cells is not None:
        return cells
    products = product_rows(formulation)
    if products is None:
        return None
    box = lifted_box(products, start, until)
    return complete_box(box, coupled_rows(formulation), products, until)
