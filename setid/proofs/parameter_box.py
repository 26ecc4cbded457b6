"""The box of the parameters, and the problem that bounds are about: a formulation on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.formulation.formulation import Formulation
from setid.proofs.directions import DirectionBox
from setid.proofs.lifted_products import LiftedBox, lifted_rows
from setid.proofs.output_cells import CellBox
from setid.proofs.sign_tree import ParameterBox

__all__ = ["ProvedBox", "box_follows", "problem_on_box", "objectives", "start_of"]

ProvedBox = ParameterBox | DirectionBox | LiftedBox | CellBox  # of parameters, from the data


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
    if isinstance(box, CellBox):
        samples = box.unknowns
        lower[samples] = np.maximum(lower[samples], box.low)
        upper[samples] = np.minimum(upper[samples], box.high)
    silent = np.array([i for i in range(p) if not _occurs(problem, i)], int)
    free = silent[(lower[silent] <= 0) & (upper[silent] >= 0)]
    lower[free] = upper[free] = 0.0
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _occurs(problem: sp.Problem, variable: int) -> bool:
    return bool(np.any(problem.rows.words == variable + 1))
