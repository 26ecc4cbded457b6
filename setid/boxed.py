"""The problem that bounds are about: that of a formulation, with the parameters in a box."""

from __future__ import annotations

import numpy as np

import sparsepop_py as sp

from .boxes import ParameterBox
from .cells import CellBox
from .directions import DirectionBox
from .formulation import Formulation
from .lifted import LiftedBox

__all__ = ["ProvedBox", "boxed", "objectives"]

ProvedBox = ParameterBox | DirectionBox | LiftedBox | CellBox  # of parameters, from the data


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
