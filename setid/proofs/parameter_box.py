"""The box of the parameters, and the problem of a formulation on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation
from setid.formulation.regression import Regression
from setid.formulation.units import coupled_rows
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.simulated.tree import SimulatedBox
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox, lifted_rows
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = [
    "DirectionBox",
    "ParameterBox",
    "ProvedBox",
    "box_follows",
    "objectives",
    "problem_on_box",
    "product_rows",
    "start_of",
]

ProvedBox = (
    ParameterBox | DirectionBox | LiftedBox | CellBox | SimulatedBox
)  # of parameters, from the data


def box_follows(box: ProvedBox, formulation: Formulation) -> bool:
    """Check a box against data and priors, without any solver."""
    start = start_of(formulation)
    if isinstance(box, CellBox | SimulatedBox):
        return box.verify(formulation, start)
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
    found = lifted_rows(coupled_rows(formulation), formulation.parameters)
    if found is None:
        return None
    rows, problem = formulation.rows, formulation.problem
    kept = np.flatnonzero((rows.sample > 0) & problem.equality)
    channel = np.array([int(rows.equation[row].strip("y") or 1) for row in kept], np.int64)
    record, sample = rows.record[kept], rows.sample[kept]
    where = formulation.data.starts[record - 1] + sample - 1
    known = found.regression
    fields = known.names, known.target, known.regressors, known.radius, known.radii
    places = (frozen(np.array(array)) for array in (where, record, sample, channel))
    return replace(found, regression=Regression(*fields, *places))


def start_of(formulation: Formulation) -> NDArray[np.float64]:
    """The bounds of the parameters that priors give, (2, p)."""
    p, problem = len(formulation.parameters), formulation.problem
    return np.array([problem.lower[:p], problem.upper[:p]])


def objectives(formulation: Formulation) -> list[sp.Polynomial]:
    """The polynomials theta_1, -theta_1, theta_2, ... in all unknowns."""
    theta = formulation.layout.group("theta").tolist()
    return [sign * formulation.layout.polynomial(i) for i in theta for sign in (1.0, -1.0)]


def problem_on_box(formulation: Formulation, box: ProvedBox | None) -> sp.Problem:
    """The problem of a formulation with the parameters in a box.

    A parameter that no constraint speaks of, and that has no finite bounds, is set to
    zero: that changes nothing for the others.
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
    silent = np.array([i for i in range(p) if not _occurs(problem, i)], int)
    free = silent[(lower[silent] <= 0) & (upper[silent] >= 0)]
    lower[free] = upper[free] = 0.0
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _occurs(problem: sp.Problem, variable: int) -> bool:
    return bool(np.any(problem.rows.words == variable + 1))
