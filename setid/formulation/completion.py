"""From parameters and noise to all unknowns of a formulation: plain arithmetic, nothing proved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import lsqr

import sparsepop_py as sp
from setid.data.checks import real_array
from setid.data.noise import Noise
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.formulation.assembly import Rows
from setid.formulation.layout import Layout
from setid.formulation.lifting import LIFTED
from setid.models.equations import Structure, channel_of
from setid.priors.base import Prior
from setid.priors.checked_priors import completion_of

__all__ = [
    "Affine",
    "Stated",
    "affine",
    "band_width",
    "complete_point",
    "defined_unknowns",
    "held_unknowns",
    "noise_shares",
    "place_slack",
    "polished",
    "solve_definitions",
]

_NEWTON, _EXACT = 4, 1e-13
_DENSE = 1500  # unknowns up to which least squares are solved by a dense factorization


class Stated(Protocol):
    """Parts of a formulation that completing a point uses."""

    @property
    def problem(self) -> sp.Problem:
        """Polynomial problem in all unknowns."""

    @property
    def layout(self) -> Layout:
        """Names and numbers of the unknowns."""

    @property
    def rows(self) -> Rows:
        """Origin of each constraint."""

    @property
    def data(self) -> IOData:
        """Record."""

    @property
    def model(self) -> Structure:
        """Structure."""

    @property
    def noise(self) -> Noise:
        """Bounds of the noise."""

    @property
    def priors(self) -> tuple[Prior, ...]:
        """Priors."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""


_ARGUMENTS = {"eta": "output", "xi": "input", "e": "equation"}  # of Formulation.point


def complete_point(
    formulation: Stated,
    theta: NDArray[np.float64],
    noise: Mapping[str, ArrayLike | None],
    signals: Mapping[str, ArrayLike],
) -> NDArray[np.float64]:
    """Complete the vector of unknowns; see :meth:`Formulation.point`."""
    layout = formulation.layout
    x = np.full(layout.dimension, np.nan)
    x[layout.group("theta")] = theta
    for group, given in noise.items():
        _place(x, layout.group(group), 0.0 if given is None else given, _ARGUMENTS[group])
    for group, given in signals.items():
        _place(x, layout.group(group), given, group)
    place_slack(x, formulation, theta)
    solve_definitions(x, formulation)
    rest = np.flatnonzero(np.isnan(x))
    if rest.size:
        x[rest] = _best_fit(x, formulation, rest)
    return x


def _place(
    x: NDArray[np.float64], numbers: NDArray[np.int64], given: ArrayLike, field: str
) -> None:
    values = real_array(given, field, SetidError)
    if values.ndim == 1 and numbers.ndim == 2 and numbers.shape[1] == 1:
        values = values[:, None]
    if values.ndim and values.shape != numbers.shape:
        raise SetidError(f"{field}: found shape {values.shape}, expected {numbers.shape}")
    present = numbers >= 0
    x[numbers[present]] = np.broadcast_to(values, numbers.shape)[present]


def place_slack(x: NDArray[np.float64], formulation: Stated, theta: NDArray[np.float64]) -> None:
    """Set the unknowns of priors, and sums of products, in x to what the parameters give."""
    named = dict(zip(formulation.parameters, theta.tolist(), strict=True))
    named |= dict(getattr(formulation.model, "fixed", ()))
    for prior in formulation.priors:
        for name, value in completion_of(prior, formulation.model, named).items():
            x[formulation.layout.index(name)] = value
    numbers = formulation.layout.group(LIFTED)
    for number, row in zip(numbers.tolist(), formulation.problem.constraints, strict=False):
        x[number] = 0.0  # its definition, one of the first rows, is x[number] minus the sum
        x[number] = -row.polynomial(x)


def solve_definitions(x: NDArray[np.float64], formulation: Stated) -> None:
    """Set unknowns that a row gives as minus its other terms, in the order of rows."""
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


class Affine(NamedTuple):
    """Rows as matrix @ x[free] + constant, with their kinds; exact if they are linear."""

    matrix: sps.csr_array
    constant: NDArray[np.float64]
    equality: NDArray[np.bool_]
    exact: bool


def affine(formulation: Stated, x: NDArray[np.float64], free: NDArray[np.int64]) -> Affine:
    """State all rows in the free unknowns, linearised at x where need be."""
    constraints = formulation.problem.constraints
    number = np.full(x.size + 1, -1)
    number[free + 1] = np.arange(free.size)
    value = np.append(1.0, x)
    width = max(c.polynomial.words.shape[1] for c in constraints)
    terms = [c.polynomial.terms for c in constraints]
    words = np.zeros((sum(terms), width), np.int64)
    for c, end in zip(constraints, np.cumsum(terms).tolist(), strict=True):
        own = c.polynomial.words
        words[end - len(own) : end, width - own.shape[1] :] = own
    row = np.repeat(np.arange(len(constraints)), terms)
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
    x: NDArray[np.float64], formulation: Stated, rest: NDArray[np.int64]
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
    formulation: Stated, x: NDArray[np.float64], free: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Correct a point by Newton's shortest steps to the equations, which linear programs miss.

    Parameters
    ----------
    formulation : Stated
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


def held_unknowns(formulation: Stated) -> NDArray[np.bool_]:
    """Mark unknowns whose bounds are noise bounds, shape (n,)."""
    found = np.zeros(formulation.layout.dimension, bool)
    for group in ("eta", "xi", "e"):
        numbers = formulation.layout.group(group)
        found[numbers[numbers >= 0]] = True
    return found


def defined_unknowns(formulation: Stated) -> NDArray[np.bool_]:
    """Mark unknowns whose bounds follow from those of others: samples of internal signals."""
    groups = formulation.layout.groups
    found = np.zeros(formulation.layout.dimension, bool)
    for name in groups.keys() & set(formulation.rows.equation):
        found[groups[name][groups[name] >= 0]] = True
    return found


def noise_shares(formulation: Stated, theta: NDArray[np.float64]) -> dict[str, float]:
    """Compute the share of each kind of noise in the uncertainty of the equations.

    Parameters
    ----------
    formulation : Stated
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
    place_slack(x, formulation, theta)
    free = np.flatnonzero(np.isnan(x))
    x[free] = 0.0
    model = np.flatnonzero([origin == "model" for origin in formulation.rows.origin])
    slopes = np.abs(affine(formulation, x, free).matrix[model]).sum(axis=0)
    found = {}
    for group in ("eta", "xi", "e"):
        numbers = layout.group(group)
        mine = np.isin(free, numbers[numbers >= 0])
        found[group] = float(slopes[mine] @ problem.upper[free[mine]])
    found["e"] += float(band_width(formulation).sum())
    total = sum(found.values())
    return {group: value / total for group, value in found.items() if value > 0}


def band_width(formulation: Stated) -> NDArray[np.float64]:
    """Compute the bound of each row's eliminated equation error, shape (m,)."""
    rows, data = formulation.rows, formulation.data
    bound = formulation.noise.bounds(data).equation
    width, channels = np.zeros(len(rows.origin)), {}
    for label in set(rows.equation):
        found = channel_of(label)
        channels[label] = found[1] if found else -1
    channel = np.array([channels[label] for label in rows.equation], np.int64)
    row = np.flatnonzero((rows.sample > 0) & (channel >= 0))
    sample = np.array(data.starts)[rows.record[row] - 1] + rows.sample[row] - 1
    width[row] = bound[sample, channel[row]]
    return width
