"""From parameters and noise to all unknowns of a formulation, and the least noise for theta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import lsqr

import sparsepop_py as sp
from setid.errors import ModelError, SetidError
from setid.feasible_set.linear_programs import minimise
from setid.models.equations import channel_of

if TYPE_CHECKING:
    from setid.formulation.formulation import Formulation

__all__ = [
    "Affine",
    "Witness",
    "affine",
    "complete_point",
    "defined_unknowns",
    "held_unknowns",
    "least_noise",
    "noise_shares",
    "polished",
    "redefined",
]

_STEPS = 25  # most linear programs for one witness
_SETTLED = 1e-9
_NEWTON, _EXACT = 4, 1e-13
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


def redefined(formulation: Formulation, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vector with samples of internal signals as their rows give them from the rest.

    Parameters
    ----------
    formulation : Formulation
    x : (n,) float
    """
    found, rows, groups = x.copy(), formulation.rows, formulation.layout.groups
    for row, name in enumerate(rows.equation):
        if name in groups:
            sample = formulation.data.starts[rows.record[row] - 1] + rows.sample[row] - 1
            own = groups[name][sample]
            found[own] = 0.0
            found[own] = -formulation.problem.constraints[row].polynomial(found)
    return found


class Affine(NamedTuple):
    """Rows as matrix @ x[free] + constant, with their kinds; exact if they are linear."""

    matrix: sps.csr_array
    constant: NDArray[np.float64]
    equality: NDArray[np.bool_]
    exact: bool


def affine(formulation: Formulation, x: NDArray[np.float64], free: NDArray[np.int64]) -> Affine:
    """All rows in the free unknowns, the others fixed at x; linearised at x where need be."""
    constraints = formulation.problem.constraints
    number = np.full(x.size + 1, -1)
    number[free + 1] = np.arange(free.size)
    value = np.append(1.0, x)
    width = max(c.polynomial.words.shape[1] for c in constraints)
    words = np.concatenate(
        [
            np.pad(c.polynomial.words, ((0, 0), (width - c.polynomial.words.shape[1], 0)))
            for c in constraints
        ]
    )
    row = np.repeat(np.arange(len(constraints)), [c.polynomial.terms for c in constraints])
    coefficient = np.concatenate([c.polynomial.coefficients for c in constraints])
    column, factor = number[words], value[words]
    count = np.count_nonzero(column >= 0, axis=1)
    slopes, rows, columns = [], [], []
    for place in range(width):
        used = column[:, place] >= 0
        others = np.prod(np.delete(factor[used], place, axis=1), axis=1)
        slopes.append(coefficient[used] * others)
        rows.append(row[used])
        columns.append(column[used, place])
    shape = (len(constraints), free.size)
    places = (np.concatenate(rows), np.concatenate(columns))
    matrix = sps.csr_array((np.concatenate(slopes), places), shape=shape)
    weight = coefficient * np.prod(factor, axis=1) * (1 - count)
    weight = np.where(count == 1, 0.0, weight)  # 0 * x, also where x is not finite
    constant = np.bincount(row, weights=weight, minlength=len(constraints))
    equality = np.array([c.kind is sp.Kind.ZERO for c in constraints], bool)
    return Affine(matrix, constant.astype(float), equality, not np.any(count > 1))


def _best_fit(
    x: NDArray[np.float64], formulation: Formulation, rest: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Least-squares values of unknowns that nothing else gives (initial partial outputs)."""
    rows = affine(formulation, np.where(np.isnan(x), 0.0, x), rest)
    if not rows.exact:
        raise ModelError(
            "theta: found products of unknown samples for fixed theta, expected rows that are "
            "linear in what is not given; give the internal signals"
        )
    return _least_squares(rows.matrix[rows.equality], -rows.constant[rows.equality])


def polished(
    formulation: Formulation, x: NDArray[np.float64], free: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Newton's shortest steps to the equations, which linear programs hold to a tolerance only.

    Parameters
    ----------
    formulation : Formulation
    x : (n,) float
        Close to a vector that satisfies all equations.
    free : (f,) int
        The unknowns that move.
    """
    found, equality = x.copy(), formulation.problem.equality
    for _ in range(_NEWTON):
        off = formulation.problem.rows.values(found)[equality]
        if np.max(np.abs(off), initial=0.0) <= _EXACT:
            break
        slopes = affine(formulation, found, free).matrix[equality]
        found[free] -= _least_squares(slopes, off)
    return found


def _least_squares(matrix: sps.csr_array, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shortest x that minimises the length of matrix @ x - right."""
    if matrix.shape[1] > _DENSE:
        return np.asarray(lsqr(matrix, right, atol=1e-14, btol=1e-14, iter_lim=10**5)[0])
    return np.asarray(np.linalg.lstsq(matrix.toarray(), right, rcond=None)[0])


def least_noise(formulation: Formulation, theta: NDArray[np.float64]) -> Witness:
    """Minimise the noise level over everything but theta; see :meth:`Formulation.witness`."""
    layout = formulation.layout
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    _place_slack(x, formulation, theta)
    free = np.flatnonzero(np.isnan(x))
    scaled = held_unknowns(formulation)
    given = x.copy()
    x[free] = 0.0
    rows, before = affine(formulation, x, free), inf
    if not rows.exact:  # begin with the readings, and what follows from them
        given[scaled] = 0.0
        _solve_definitions(given, formulation)
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
            return Witness(x, level)
        if abs(level - before) <= _SETTLED * (1.0 + level):
            x = polished(formulation, x, free)
            return Witness(x, level if _holds(formulation, x) else inf)
        before = level
    x[free] = np.nan
    return Witness(x, inf)


def held_unknowns(formulation: Formulation) -> NDArray[np.bool_]:
    """Unknowns whose bounds are noise bounds, shape (n,)."""
    found = np.zeros(formulation.layout.dimension, bool)
    for group in ("eta", "xi", "e"):
        numbers = formulation.layout.group(group)
        found[numbers[numbers >= 0]] = True
    return found


def _holds(formulation: Formulation, x: NDArray[np.float64]) -> bool:
    """Whether equations that were linearised hold, up to rounding."""
    return all(
        abs(c.polynomial(x)) <= 1e-9 * (1.0 + np.abs(c.polynomial.coefficients).max())
        for c, origin in zip(formulation.problem.constraints, formulation.rows.origin, strict=True)
        if origin == "model" and c.kind is sp.Kind.ZERO
    )


def defined_unknowns(formulation: Formulation) -> NDArray[np.bool_]:
    """Unknowns whose bounds follow from those of others: samples of internal signals."""
    groups = formulation.layout.groups
    found = np.zeros(formulation.layout.dimension, bool)
    for name in groups.keys() & set(formulation.rows.equation):
        found[groups[name][groups[name] >= 0]] = True
    return found


def _least_step(
    formulation: Formulation,
    rows: Affine,
    free: NDArray[np.int64],
    scaled: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], float] | None:
    """Unknowns and noise level of one linear program."""
    problem = formulation.problem
    model = np.array([origin == "model" for origin in formulation.rows.origin], bool)
    noise = np.flatnonzero(scaled[free])
    width = _band_width(formulation)
    limits = sps.csr_array(
        (np.ones(noise.size), (np.arange(noise.size), noise)), shape=(noise.size, free.size)
    )
    size = problem.upper[free][noise]
    bands = np.flatnonzero(model & ~rows.equality)
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
    try:
        solution = minimise(
            np.append(np.zeros(free.size), 1.0),
            (below, right),
            (
                sps.hstack([rows.matrix[equal], sps.csr_array((equal.size, 1))]).tocsr(),
                -rows.constant[equal],
            ),
            (np.append(lower, 0.0), np.append(upper, np.inf)),
        )
    except SetidError:  # the solver gave up: no witness, which proves nothing either way
        return None
    return None if solution is None else (solution[:-1], float(solution[-1]))


def noise_shares(formulation: Formulation, theta: NDArray[np.float64]) -> dict[str, float]:
    """What each kind of noise at its bounds can move in the equations, as shares of 1.

    Parameters
    ----------
    formulation : Formulation
    theta : (p,) float

    Returns
    -------
    dict
        Of the groups ``"eta"``, ``"xi"`` and ``"e"`` that have bounds; to first order where
        noise samples are multiplied.
    """
    problem, layout = formulation.problem, formulation.layout
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    _place_slack(x, formulation, theta)
    free = np.flatnonzero(np.isnan(x))
    x[free] = 0.0
    model = np.flatnonzero([origin == "model" for origin in formulation.rows.origin])
    slopes = np.abs(affine(formulation, x, free).matrix[model]).sum(axis=0)
    found = {}
    for group in ("eta", "xi", "e"):
        numbers = layout.group(group)
        mine = np.isin(free, numbers[numbers >= 0])
        found[group] = float(slopes[mine] @ problem.upper[free[mine]])
    found["e"] += float(_band_width(formulation).sum())
    total = sum(found.values())
    return {group: value / total for group, value in found.items() if value > 0}


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
