"""The least noise with which given parameters explain a record, and proofs that it does.

With the parameters fixed, rows are affine in the other unknowns. A linear program minimises s such
that each noise sample is within s times its bound. Where unknowns are multiplied, the rows are
linearised at its last solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import ModelError, SetidError
from setid.formulation.completion import (
    Affine,
    affine,
    band_width,
    defined_unknowns,
    held_unknowns,
    place_slack,
    polished,
    solve_definitions,
)
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import LIFTED
from setid.proofs.existence import admitted, proved_point
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.lp.scaled import solve_scaled

__all__ = ["Witness", "consistent", "least_noise"]

_STEPS = 25  # most linear programs for one witness
_SETTLED = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Witness(ReadOnly):
    """Noise that makes parameters consistent with the data.

    Parameters
    ----------
    x : (n,) float
        All unknowns of the formulation.
    level : float
        Factor on all noise bounds that this noise needs; infinite if none suffices, and
        then ``x`` holds no noise.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5))
    >>> setid.least_noise(known, [-0.5, 2.0]).x.shape
    (6,)
    """

    x: NDArray[np.float64]
    level: float

    def __repr__(self) -> str:
        return f"<Witness: {self.x.size} unknowns, level {self.level:.6g}>"


def least_noise(formulation: Formulation, theta: ArrayLike | Mapping[str, float]) -> Witness:
    """Find the least noise with which parameters explain a record, by a linear program.

    Parameters
    ----------
    formulation : Formulation
    theta : array_like (p,) or mapping of names to numbers

    Returns
    -------
    Witness
        ``level`` is the factor on all noise bounds that is needed, 1 or less where theta is
        consistent (up to rounding; nothing is proved), and ``x`` holds the unknowns.

    Raises
    ------
    SetidError
        If names or shapes of theta do not fit.

    Notes
    -----
    Where unknown samples are multiplied (powers of noisy or internal signals) the rows are
    linearised again and again; the level is then that of a local minimum.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> round(setid.least_noise(known, [-0.5, 2.0]).level, 4)
    1.0
    """
    if not isinstance(formulation, Formulation):
        found = type(formulation).__name__
        raise SetidError(f"formulation: found {found}, expected Formulation")
    theta = formulation.parameter_vector(theta)
    layout = formulation.layout
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    place_slack(x, formulation, theta)
    free = np.flatnonzero(np.isnan(x))
    scaled = held_unknowns(formulation)
    given = x.copy()
    x[free] = 0.0
    rows, before = affine(formulation, x, free), inf
    if not rows.exact:  # begin with the readings, and what follows from them
        given[scaled] = 0.0
        solve_definitions(given, formulation)
        given[np.isnan(given)] = 0.0
        x = given
    for step in range(_STEPS):
        if step or not rows.exact:
            rows = affine(formulation, x, free)
        found = _least_step(formulation, rows, free, scaled)
        if found is None:
            break
        x[free], level = found
        if rows.exact:
            return Witness(frozen(x), level)
        if abs(level - before) <= _SETTLED * (1.0 + level):
            x = polished(formulation, x, free)
            return Witness(frozen(x), level if _holds(formulation, x) else inf)
        before = level
    x[free] = np.nan
    return Witness(frozen(x), inf)


def _holds(formulation: Formulation, x: NDArray[np.float64]) -> bool:
    """Check equations that were linearised, up to rounding."""
    return all(
        abs(c.polynomial(x)) <= 1e-9 * (1.0 + np.abs(c.polynomial.coefficients).max(initial=0.0))
        for c, origin in zip(formulation.problem.constraints, formulation.rows.origin, strict=True)
        if origin == "model" and c.kind is sp.Kind.ZERO
    )


def _least_step(
    formulation: Formulation,
    rows: Affine,
    free: NDArray[np.int64],
    scaled: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], float] | None:
    """Solve for unknowns and noise level by a linear program, if anything is unknown."""
    problem = formulation.problem
    origins = zip(formulation.rows.origin, formulation.rows.equation, strict=True)
    model = np.array([o == "model" and e != LIFTED for o, e in origins], bool)  # sums are placed
    noise = np.flatnonzero(scaled[free])
    width = band_width(formulation)
    limits = sps.csr_array(
        (np.ones(noise.size), (np.arange(noise.size), noise)), shape=(noise.size, free.size)
    )
    size = problem.upper[free][noise]
    bands = np.flatnonzero(model & ~rows.equality)
    if not free.size and bands.size == np.count_nonzero(model) and np.all(width[bands] > 0.0):
        # nothing is left to choose: each row needs its share of its bound
        needed = 1.0 - rows.constant[bands] / width[bands]
        return np.zeros(0), max(0.0, float(needed.max(initial=0.0)))
    below = sps.vstack(
        [
            sps.hstack([limits, sps.csr_array(-size[:, None])]),
            sps.hstack([-limits, sps.csr_array(-size[:, None])]),
            sps.hstack([-rows.matrix[bands], sps.csr_array(-width[bands][:, None])]),
        ]
    ).tocsr()
    right = np.concatenate([np.zeros(2 * noise.size), rows.constant[bands] - width[bands]])
    equal = np.flatnonzero(model & rows.equality)
    loose = scaled[free] | defined_unknowns(formulation)[free]
    lower = np.where(loose, -np.inf, problem.lower[free])
    upper = np.where(loose, np.inf, problem.upper[free])
    tied = sps.hstack([rows.matrix[equal], sps.csr_array((equal.size, 1))]).tocsr()
    found = solve_scaled(
        np.append(np.zeros(free.size), 1.0),
        (below, right),
        (tied, -rows.constant[equal]),
        (np.append(lower, 0.0), np.append(upper, np.inf)),
    )
    if found.status != "solved":  # no witness, which proves nothing either way
        return None
    return found.x[:-1], float(found.x[-1])


def consistent(
    formulation: Formulation,
    theta: ArrayLike | Mapping[str, float],
    near: NDArray[np.float64] | None = None,
) -> NDArray[np.float64] | None:
    """Prove that parameters are consistent with data, noise bounds and priors.

    Parameters
    ----------
    formulation : Formulation
    theta : array_like (p,) or mapping of names to numbers
    near : (n,) float, optional
        Unknowns that may be a witness already; of other parameters they are none.

    Returns
    -------
    (n,) float or None
        A witness, noise included, near which a consistent one provably exists with exactly
        these parameters; None where no proof was found.
    """
    p = len(formulation.parameters)
    if near is not None and np.array_equal(near[:p], formulation.parameter_vector(theta)):
        found = _proved_near(formulation, near)
        if found is not None:
            return found
    try:
        witness = least_noise(formulation, theta)
    except ModelError:
        return None
    if not np.isfinite(witness.level) or witness.level > 1.0 + 1e-9:
        return None
    return _proved_near(formulation, witness.x)


def _proved_near(formulation: Formulation, x: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Prove that a witness lies near unknowns and has their parameters."""
    p = len(formulation.parameters)
    point = proved_point(formulation, formulation.problem, x)
    if point is None or not np.array_equal(point.x[:p], x[:p]):
        return None
    return point.x if admitted(formulation, point.x[:p]) else None
