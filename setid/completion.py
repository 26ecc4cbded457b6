"""From parameters and noise to all unknowns of a formulation, and the least noise for theta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import lsqr

import sparsepop_py as sp

from .errors import ModelError, SetidError
from .linear import minimise
from .models.equations import channel_of

if TYPE_CHECKING:
    from .formulation import Formulation

__all__ = ["Witness", "complete_point", "least_noise"]

_DENSE = 1500  # unknowns up to which least squares are solved by a dense factorization


@dataclass(frozen=True, slots=True, eq=False)
class Witness:
    """Noise that makes parameters consistent with the data.

    Parameters
    ----------
    x : (n,) float
        All unknowns of the formulation.
    level : float
        Factor on all noise bounds that this noise needs; infinite if none suffices, and
        then ``x`` holds no noise.
    """

    x: NDArray[np.float64]
    level: float


def complete_point(
    formulation: Formulation,
    theta: NDArray[np.float64],
    noise: Mapping[str, ArrayLike | None],
    signals: Mapping[str, ArrayLike],
) -> NDArray[np.float64]:
    """The vector of unknowns; see :meth:`Formulation.point`."""
    layout = formulation.layout
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    for group, given in noise.items():
        _place(x, layout.group(group), 0.0 if given is None else given, group)
    for group, given in signals.items():
        _place(x, layout.group(group), given, group)
    _place_slack(x, formulation, theta)
    _solve_definitions(x, formulation)
    rest = np.flatnonzero(np.isnan(x))
    if rest.size:
        x[rest] = _best_fit(x, formulation, rest)
    return x


def _place(
    x: NDArray[np.float64], numbers: NDArray[np.int64], given: ArrayLike, field: str
) -> None:
    values = np.asarray(given, float)
    if values.ndim == 1 and numbers.ndim == 2 and numbers.shape[1] == 1:
        values = values[:, None]
    if values.ndim and values.shape != numbers.shape:
        raise SetidError(f"{field}: found shape {values.shape}, expected {numbers.shape}")
    present = numbers >= 0
    x[numbers[present]] = np.broadcast_to(values, numbers.shape)[present]


def _place_slack(
    x: NDArray[np.float64], formulation: Formulation, theta: NDArray[np.float64]
) -> None:
    named = dict(zip(formulation.parameters, theta.tolist(), strict=True))
    for prior in formulation.priors:
        for name, value in prior.complete(formulation.model, named).items():
            x[formulation.layout.index(name)] = value


def _solve_definitions(x: NDArray[np.float64], formulation: Formulation) -> None:
    """Unknowns that a row gives as -(the rest), in the order of rows: products of signals."""
    problem, rows, layout = formulation.problem, formulation.rows, formulation.layout
    if not np.any(np.isnan(x)):
        return
    internal = [name in layout.groups for name in rows.equation]
    for row in np.flatnonzero(internal):
        name = rows.equation[row]
        polynomial = problem.constraints[row].polynomial
        open_ = polynomial.support[np.isnan(x[polynomial.support])]
        if open_.size == 1 and open_[0] in layout.group(name):
            trial = x.copy()
            trial[open_] = 0.0
            x[open_] = -polynomial(trial)


class _Affine(NamedTuple):
    """Rows as matrix @ x[free] + constant, with their kinds."""

    matrix: sps.csr_array
    constant: NDArray[np.float64]
    equality: NDArray[np.bool_]


def _affine(formulation: Formulation, x: NDArray[np.float64], free: NDArray[np.int64]) -> _Affine:
    """All rows in the free unknowns, the others fixed at x.

    Raises
    ------
    ModelError
        If two free unknowns are multiplied.
    """
    constraints = formulation.problem.constraints
    number = np.full(x.size + 1, -1)
    number[free + 1] = np.arange(free.size)
    value = np.append(1.0, x)
    value[free + 1] = 1.0
    width = max(c.polynomial.words.shape[1] for c in constraints)
    words = np.concatenate(
        [
            np.pad(c.polynomial.words, ((0, 0), (width - c.polynomial.words.shape[1], 0)))
            for c in constraints
        ]
    )
    row = np.repeat(np.arange(len(constraints)), [c.polynomial.terms for c in constraints])
    coefficient = np.concatenate([c.polynomial.coefficients for c in constraints])
    coefficient = coefficient * np.prod(value[words], axis=1)
    column = number[words].max(axis=1)
    if np.any(np.count_nonzero(number[words] >= 0, axis=1) > 1):
        raise ModelError(
            "theta: found products of unknown samples for fixed theta, expected rows that are "
            "linear in the noise and in what is not given"
        )
    bare = column < 0
    shape = (len(constraints), free.size)
    matrix = sps.csr_array((coefficient[~bare], (row[~bare], column[~bare])), shape=shape)
    constant = np.bincount(row[bare], weights=coefficient[bare], minlength=len(constraints))
    equality = np.array([c.kind is sp.Kind.ZERO for c in constraints], bool)
    return _Affine(matrix, constant.astype(float), equality)


def _best_fit(
    x: NDArray[np.float64], formulation: Formulation, rest: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Least-squares values of unknowns that nothing else gives (initial partial outputs)."""
    rows = _affine(formulation, np.where(np.isnan(x), 0.0, x), rest)
    matrix, right = rows.matrix[rows.equality], -rows.constant[rows.equality]
    if matrix.shape[1] > _DENSE:
        return np.asarray(lsqr(matrix, right, atol=1e-14, btol=1e-14, iter_lim=10**5)[0])
    return np.asarray(np.linalg.lstsq(matrix.toarray(), right, rcond=None)[0])


def least_noise(formulation: Formulation, theta: NDArray[np.float64]) -> Witness:
    """Minimise the noise level over everything but theta; see :meth:`Formulation.witness`."""
    problem, layout, rows = formulation.problem, formulation.layout, formulation.rows
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    _place_slack(x, formulation, theta)
    free = np.flatnonzero(np.isnan(x))
    affine = _affine(formulation, x, free)
    model = np.array([origin == "model" for origin in rows.origin], bool)
    scaled = np.zeros(layout.dimension, bool)  # unknowns whose bounds are noise bounds
    for group in ("eta", "xi", "e"):
        numbers = layout.group(group)
        scaled[numbers[numbers >= 0]] = True
    noise = np.flatnonzero(scaled[free])
    width = _band_width(formulation)
    limits = sps.csr_array(
        (np.ones(noise.size), (np.arange(noise.size), noise)), shape=(noise.size, free.size)
    )
    size = problem.upper[free][noise]
    bands = np.flatnonzero(model & ~affine.equality)
    below = sps.vstack(
        [
            sps.hstack([limits, sps.csr_array(-size[:, None])]),
            sps.hstack([-limits, sps.csr_array(-size[:, None])]),
            sps.hstack([-affine.matrix[bands], sps.csr_array(-width[bands][:, None])]),
        ]
    ).tocsr()
    right = np.concatenate([np.zeros(2 * noise.size), affine.constant[bands] - width[bands]])
    equal = np.flatnonzero(model & affine.equality)
    lower = np.where(scaled[free], -np.inf, problem.lower[free])
    upper = np.where(scaled[free], np.inf, problem.upper[free])
    solution = minimise(
        np.append(np.zeros(free.size), 1.0),
        (below, right),
        (
            sps.hstack([affine.matrix[equal], sps.csr_array((equal.size, 1))]).tocsr(),
            -affine.constant[equal],
        ),
        (np.append(lower, 0.0), np.append(upper, np.inf)),
    )
    if solution is None:
        return Witness(x, float("inf"))
    x[free] = solution[:-1]
    return Witness(x, float(solution[-1]))


def _band_width(formulation: Formulation) -> NDArray[np.float64]:
    """Bound of the equation error of each row that has one eliminated, shape (m,)."""
    rows, data = formulation.rows, formulation.data
    bound = formulation.noise.bounds(data)[2]
    width = np.zeros(len(rows.origin))
    for row in np.flatnonzero(rows.sample > 0):
        found = channel_of(rows.equation[row])
        if found:
            sample = data.starts[rows.record[row] - 1] + rows.sample[row] - 1
            width[row] = bound[sample, found[1]]
    return width
