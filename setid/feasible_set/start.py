"""Find a box of the parameters from data and priors, by the method that suits the rows."""

from __future__ import annotations

from math import inf

import numpy as np

from setid.feasible_set.directions import direction_box
from setid.feasible_set.lifted_products import completed, lifted_box
from setid.feasible_set.sign_tree import parameter_box
from setid.formulation.formulation import Formulation
from setid.proofs.lifted_products import lifted_rows
from setid.proofs.output_cells import cell_box
from setid.proofs.parameter_box import ProvedBox, start_of

__all__ = ["find_box"]


def find_box(formulation: Formulation, until: float = inf) -> ProvedBox | None:
    """The box of the parameters that data and priors prove, None where no rows tell.

    Parameters
    ----------
    formulation : Formulation
    until : float
        Reading of ``time.monotonic`` at which all work ends.
    """
    start = start_of(formulation)
    if formulation.smoothed is not None:
        first = parameter_box(formulation.smoothed, start, until)
        unbounded = np.any(np.isinf([first.lower, first.upper])) and not first.empty
        return (direction_box(formulation, first, until) if unbounded else None) or first
    cells = cell_box(formulation, start, until)
    if cells is not None:
        return cells
    rows = lifted_rows(formulation)
    if rows is None:
        return None
    return completed(lifted_box(rows, start, until), formulation, rows, until)
