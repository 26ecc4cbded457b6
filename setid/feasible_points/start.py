"""Starting points of the engine: estimates with the least noise that they need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.errors import ModelError, SetidError
from setid.feasible_points.fits.output_error import least_largest_error
from setid.feasible_points.witness import least_noise
from setid.formulation.formulation import Formulation
from sparsepop_py.uncertain_rows.sign_tree import left_inverse

__all__ = ["Repair", "candidates", "first_point"]


def candidates(formulation: Formulation, problem: sp.Problem) -> list[NDArray[np.float64]]:
    """List parameter vectors that may be consistent: the box's middle, and least squares."""
    p = len(formulation.parameters)
    found = []
    with np.errstate(invalid="ignore"):
        middle = 0.5 * problem.lower[:p] + 0.5 * problem.upper[:p]
    rows = formulation.smoothed
    if rows is not None:
        fit = -left_inverse(rows.regressors) @ rows.target
        found.append(np.clip(fit, problem.lower[:p], problem.upper[:p]))
    found.append(middle)
    return [theta for theta in found if np.all(np.isfinite(theta))]


def first_point(formulation: Formulation, problem: sp.Problem) -> NDArray[np.float64] | None:
    """Choose the candidate that needs the least noise; return it with that noise."""
    best: tuple[float, NDArray[np.float64] | None] = (inf, None)
    for theta in chain(candidates(formulation, problem), _simulated(formulation, problem)):
        try:
            witness = least_noise(formulation, theta)
        except ModelError:
            return None
        if witness.level < best[0]:
            best = witness.level, np.clip(witness.x, problem.lower, problem.upper)
        if best[0] <= 1.0:
            break
    return best[1]


def _simulated(formulation: Formulation, problem: sp.Problem) -> Iterator[NDArray[np.float64]]:
    """Parameters whose simulation has a small largest error, where outputs are noisy."""
    data, p = formulation.data, len(formulation.parameters)
    output = formulation.noise.bounds(data).output
    if not np.any(output > 0) or np.isnan(data.u).any():
        return
    try:
        theta = least_largest_error(data, formulation.model, output)
    except SetidError:
        return
    if theta.size == p and np.all(np.isfinite(theta)):
        yield np.clip(theta, problem.lower[:p], problem.upper[:p])


@dataclass(frozen=True, eq=False)
class Repair:
    """Replacement of the noise of a vector by the least it needs; it pickles.

    Parameters
    ----------
    formulation : Formulation
    problem : Problem
        In the units of the parameters.
    units : (n,) float
        Of the vectors that are repaired.
    """

    formulation: Formulation
    problem: sp.Problem
    units: NDArray[np.float64]

    def __call__(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Repair a vector; return it as it is where it needs more noise than is allowed."""
        p = len(self.formulation.parameters)
        lower, upper = self.problem.lower[:p], self.problem.upper[:p]
        theta = np.clip(z[:p] * self.units[:p], lower, upper)
        try:
            witness = least_noise(self.formulation, theta)
        except ModelError:
            return z
        return witness.x / self.units if witness.level <= 1.0 else z
