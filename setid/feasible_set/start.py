"""The box of the parameters, and the problem that bounds are about: a formulation on it."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.feasible_set.directions import DirectionBox, direction_box
from setid.feasible_set.lifted_products import LiftedBox, completed, lifted_box, lifted_rows
from setid.feasible_set.sign_tree import ParameterBox, parameter_box
from setid.formulation.formulation import Formulation
from setid.proofs.output_cells import CellBox, cell_box

__all__ = ["ProvedBox", "box_follows", "boxed", "objectives", "proved_box", "start_of"]

ProvedBox = ParameterBox | DirectionBox | LiftedBox | CellBox  # of parameters, from the data


def proved_box(formulation: Formulation, until: float = inf) -> ProvedBox | None:
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
        endless = np.any(np.isinf([first.lower, first.upper])) and not first.empty
        return (direction_box(formulation, first, until) if endless else None) or first
    cells = cell_box(formulation, start, until)
    if cells is not None:
        return cells
    rows = lifted_rows(formulation)
    if rows is None:
        return None
    return completed(lifted_box(rows, start, until), formulation, rows, until)


def box_follows(box: ProvedBox, formulation: Formulation) -> bool:
    """Whether the box is proved by data and priors, without any solver."""
    start = start_of(formulation)
    if isinstance(box, ParameterBox):
        return formulation.smoothed is not None and box.verify(formulation.smoothed, start)
    if isinstance(box, CellBox | DirectionBox):
        return box.verify(formulation, start)
    rows = lifted_rows(formulation)
    return rows is not None and box.verify(rows, start, formulation)


def start_of(formulation: Formulation) -> NDArray[np.float64]:
    """The bounds of the parameters that priors give, (2, p)."""
    p, problem = len(formulation.parameters), formulation.problem
    return np.array([problem.lower[:p], problem.upper[:p]])


def objectives(formulation: Formulation) -> list[sp.Polynomial]:
    """The polynomials theta_1, -theta_1, theta_2, ... in all unknowns."""
    theta = formulation.layout.group("theta").tolist()
    return [sign * formulation.layout.polynomial(i) for i in theta for sign in (1.0, -1.0)]


def boxed(formulation: Formulation, box: ProvedBox | None) -> sp.Problem:
    """The problem of a formulation with the parameters in a box.

    A parameter that no constraint speaks of, and that has no finite bounds, is set to
    zero: that changes nothing for the others.
    """
    problem = formulation.problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    p = len(formulation.parameters)
    if box is not None:
        lower[:p], upper[:p] = np.maximum(lower[:p], box.lower), np.minimum(upper[:p], box.upper)
    if isinstance(box, CellBox):
        samples = box.unknowns
        lower[samples] = np.maximum(lower[samples], box.low)
        upper[samples] = np.minimum(upper[samples], box.high)
    silent = np.array([i for i in range(p) if not _occurs(problem, i)], int)
    idle = silent[(lower[silent] <= 0) & (upper[silent] >= 0)]
    lower[idle] = upper[idle] = 0.0
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _occurs(problem: sp.Problem, variable: int) -> bool:
    return bool(np.any(problem.rows.words == variable + 1))
