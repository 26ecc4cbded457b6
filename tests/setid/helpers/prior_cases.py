"""Points and the rows of priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import setid
import sparsepop_py as sp
from setid.priors.base import Plain


@dataclass(frozen=True)
class Never(Plain):
    """A prior whose rows say nothing, and which no parameters are proved to meet."""

    def admits(self, model: object, box: object) -> bool:
        return False


def reflections_to_coefficients(reflections: list[float] | np.ndarray) -> np.ndarray:
    """Coefficients c_1, ..., c_n of the monic polynomial with these reflection coefficients."""
    coefficients = np.zeros(0)
    for k in reflections:
        coefficients = np.append(coefficients + k * coefficients[::-1], k)
    return coefficients


def admits(formulation: setid.Formulation, theta: np.ndarray, tolerance: float = 1e-9) -> bool:
    """Whether theta obeys bounds and rows of the priors."""
    x = formulation.point(theta)
    problem = formulation.problem
    rows = [r for r, origin in enumerate(formulation.rows.origin) if origin == "prior"]
    numbers = np.concatenate([formulation.layout.group(g) for g in ("theta", "slack")])
    inside = np.all(x[numbers] >= problem.lower[numbers] - tolerance)
    inside &= np.all(x[numbers] <= problem.upper[numbers] + tolerance)
    for row in rows:
        value = problem.constraints[row].polynomial(x)
        zero = problem.constraints[row].kind is sp.Kind.ZERO
        inside &= abs(value) <= tolerance if zero else value >= -tolerance
    return bool(inside)
