"""Starting points of the engine: estimates with the least noise that they need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.errors import ModelError, SetidError
from setid.feasible_points.fits.output_error import least_largest_error
from setid.feasible_points.fits.separate_denominators import has_separate_denominators
from setid.feasible_points.fits.separate_noise import estimates_of_little_noise
from setid.feasible_points.witness import consistent, least_noise
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import DRIVEN
from setid.models.lti import TransferFunction
from setid.proofs.driven import driven
from sparsepop_py.uncertain_rows.sign_tree import left_inverse

__all__ = ["Repair", "candidates", "consistent_apart", "first_point", "with_offsets"]

_ENOUGH = 0.98  # of the noise: where a search for some consistent parameters ends


def candidates(formulation: Formulation, problem: sp.Problem) -> list[NDArray[np.float64]]:
    """List parameter vectors that may be consistent: least squares, and the middle of a box.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a box of the parameters, to which least squares are clipped.

    Returns
    -------
    list of (p,) float
        Those that are finite.
    """
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


def consistent_apart(formulation: Formulation, until: float = inf) -> dict[str, float] | None:
    """Search parameters that are proved consistent where an output has several denominators.

    Parameters
    ----------
    formulation : Formulation
    until : float
        The reading of ``time.monotonic`` at which the fit takes the best so far.

    Returns
    -------
    dict of str to float, or None
        None for other structures too, and where the inputs have gaps.
    """
    data, model, p = formulation.data, formulation.model, len(formulation.parameters)
    if not has_separate_denominators(model) or np.isnan(data.u).any():
        return None
    if not np.all(np.any(formulation.noise.bounds(data).output > 0, axis=0)):
        return None
    lower, upper = formulation.problem.lower[:p], formulation.problem.upper[:p]
    rows = driven(formulation)  # the fit that finds the least noise is of these
    for asked, enough in ((rows, _ENOUGH), (formulation, _ENOUGH), (rows, 0.0)):
        if asked is None:
            continue
        for estimate in estimates_of_little_noise(asked, until, enough):
            moved = estimate if asked is formulation else with_offsets(formulation, estimate)
            if moved is None:
                continue
            theta = np.clip(moved, lower, upper)
            witness = least_noise(formulation, theta)
            if witness.level <= 1.0 and consistent(formulation, theta, witness.x) is not None:
                return dict(zip(formulation.parameters, theta.tolist(), strict=True))
    return None


def first_point(
    formulation: Formulation, problem: sp.Problem, known: Mapping[str, float] | None = None
) -> NDArray[np.float64] | None:
    """Choose the candidate that needs the least noise; return it with that noise.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a box of the parameters.
    known : mapping of str to float, optional
        Parameters that are consistent, of the same structure with offsets of the outputs.
    """
    best: tuple[float, NDArray[np.float64] | None] = (inf, None)
    more = _simulated(formulation, problem) if known is None else _given(formulation, known)
    for theta in chain(candidates(formulation, problem), more):
        try:
            witness = least_noise(formulation, theta)
        except ModelError:
            return None
        if witness.level < best[0]:
            best = witness.level, np.clip(witness.x, problem.lower, problem.upper)
        if best[0] <= 1.0:
            break
    return best[1]


def with_offsets(
    formulation: Formulation, given: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Replace offsets that drive equations by those of the outputs.

    Parameters
    ----------
    formulation : Formulation
        With offsets of the outputs.
    given : (p,) float
        Parameters of its rows of :func:`setid.proofs.driven.driven`.

    Returns
    -------
    (p,) float or None
        None where a denominator is zero at q = 1.
    """
    model, theta = formulation.model, given.copy()
    assert isinstance(model, TransferFunction)
    place = {name: k for k, name in enumerate(formulation.parameters)}
    for output, name in enumerate(model.offsets()):
        factors = [1.0 + sum(theta[place[a]] for a in d) for d in model.denominators(output)]
        gain = float(np.prod(factors))
        if gain == 0.0:
            return None
        theta[place[name]] /= gain
    return theta


def _given(formulation: Formulation, known: Mapping[str, float]) -> Iterator[NDArray[np.float64]]:
    """Yield known parameters, with the offset of the equation where that is the parameter."""
    model, theta = formulation.model, dict(known)
    if isinstance(model, TransferFunction) and model.form == DRIVEN:
        for output, name in enumerate(model.offsets()):
            for denominator in model.denominators(output):
                theta[name] *= 1.0 + sum(theta[a] for a in denominator)
    yield np.array([theta[name] for name in formulation.parameters])


def _simulated(formulation: Formulation, problem: sp.Problem) -> Iterator[NDArray[np.float64]]:
    """Yield parameters whose simulation has a small largest error, where outputs are noisy."""
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
