"""The box of the parameters, and the problem of a formulation on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.formulation.formulation import Formulation
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.denominators.denominator_box import DenominatorBox
from setid.proofs.row_boxes import RowBox, product_rows, rows_prove
from setid.proofs.simulated.tree import SimulatedBox
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = [
    "DenominatorBox",
    "DirectionBox",
    "ParameterBox",
    "ProvedBox",
    "box_follows",
    "objectives",
    "problem_on_box",
    "product_rows",
    "start_of",
]

ProvedBox = RowBox | CellBox | DenominatorBox | SimulatedBox  # of parameters, from the data


def box_follows(box: ProvedBox, formulation: Formulation) -> bool:
    """Check a box against data and priors, without any solver."""
    start = start_of(formulation)
    if box.names != formulation.parameters:
        return False
    if isinstance(box, CellBox | DenominatorBox | SimulatedBox):
        return box.verify(formulation, start)
    return rows_prove(box, formulation, start)


def start_of(formulation: Formulation) -> NDArray[np.float64]:
    """Collect the bounds of the parameters that priors give, (2, p)."""
    p, problem = len(formulation.parameters), formulation.problem
    return np.array([problem.lower[:p], problem.upper[:p]])


def objectives(formulation: Formulation) -> list[sp.Polynomial]:
    """List the polynomials theta_1, -theta_1, theta_2, ... in all unknowns."""
    theta = formulation.layout.group("theta").tolist()
    return [sign * formulation.layout.polynomial(i) for i in theta for sign in (1.0, -1.0)]


def problem_on_box(formulation: Formulation, box: ProvedBox | None) -> sp.Problem:
    """State the problem of a formulation with the parameters in a box.

    A parameter that no constraint speaks of, and that has an infinite bound, is set to the number
    nearest to zero: that changes nothing for the others. One with finite bounds keeps them, since
    bands ask this problem about it as about all others.
    """
    problem = formulation.problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    p = len(formulation.parameters)
    if box is not None:
        lower[:p], upper[:p] = np.maximum(lower[:p], box.lower), np.minimum(upper[:p], box.upper)
    cells = box.first if isinstance(box, SimulatedBox) else box
    if isinstance(cells, CellBox):
        samples = cells.unknowns
        lower[samples] = np.maximum(lower[samples], cells.low)
        upper[samples] = np.minimum(upper[samples], cells.high)
    free = [i for i in range(p) if np.isinf(upper[i] - lower[i]) and not _occurs(problem, i)]
    lower[free] = upper[free] = np.clip(0.0, lower[free], upper[free])
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _occurs(problem: sp.Problem, variable: int) -> bool:
    return bool(np.any(problem.rows.words == variable + 1))
