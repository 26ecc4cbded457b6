"""Starting points of the engine: estimates with the least noise that they need."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.errors import ModelError, SetidError
from setid.feasible_points.output_error import least_largest_error
from setid.feasible_points.witness import least_noise
from setid.formulation.formulation import Formulation
from sparsepop_py.uncertain_rows.sign_tree import left_inverse

__all__ = ["candidates", "first_point", "repair"]


def candidates(formulation: Formulation, problem: sp.Problem) -> list[NDArray[np.float64]]:
    """Parameter vectors that may be consistent: the middle of the box, and least squares."""
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
    """The candidate that needs the least noise, with that noise."""
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
    output = formulation.noise.bounds(data)[0]
    if not np.any(output > 0) or np.isnan(data.u).any():
        return
    try:
        theta = least_largest_error(data, formulation.model, output)
    except SetidError:
        return
    if theta.size == p and np.all(np.isfinite(theta)):
        yield np.clip(theta, problem.lower[:p], problem.upper[:p])


def repair(
    formulation: Formulation, problem: sp.Problem, units: NDArray[np.float64]
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Make a function that replaces the noise of a vector by the least it needs."""
    p = len(formulation.parameters)

    def repaired(z: NDArray[np.float64]) -> NDArray[np.float64]:
        theta = np.clip(z[:p] * units[:p], problem.lower[:p], problem.upper[:p])
        try:
            witness = least_noise(formulation, theta)
        except ModelError:
            return z
        return witness.x / units if witness.level <= 1.0 else z

    return repaired
