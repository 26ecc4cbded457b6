"""Proved ranges of linear functions of the parameters over the feasible parameter set.

A :class:`Cover` is a box and linear rows that every consistent parameter vector obeys. For
equation errors alone it *is* the feasible set; otherwise the noise is replaced by its
largest effect and ``abs(theta)`` by its chord over the box. Multipliers may come from anywhere
(:mod:`setid.feasible_set.supports` takes those of linear programs); the bound is what weak
duality makes of them, every rounding error included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation

__all__ = [
    "Cover",
    "HalfSpaces",
    "Multipliers",
    "Proposal",
    "box_ranges",
    "cover",
    "safe_maxima",
    "sources",
    "supports",
]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_TINY = 1e-300  # more than all products that underflow
_LEAST = 2.0**-1074  # more than one product that underflows, which a wide box then multiplies
_NORMAL = 2.0**-1022  # smaller products are rounded by more than their size times _EPS


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """A polytope that provably contains every consistent parameter vector.

    Parameters
    ----------
    names : tuple of str
    lower, upper : (p,) float
        The outer intervals.
    matrix, right : (m, p), (m,) float
        Rows ``matrix @ theta <= right``: those of the problem as they are, others relaxed
        by more than their rounding errors.
    exact : bool
        Whether the feasible set is this polytope (equation errors and linear priors alone).
    """

    names: tuple[str, ...]
    lower: Reals
    upper: Reals
    matrix: Reals
    right: Reals
    exact: bool

    @property
    def centre(self) -> Reals:
        """Middle of the box, shape (p,); NaN where the box is not finite."""
        finite = np.isfinite(self.lower) & np.isfinite(self.upper)
        low, high = np.where(finite, self.lower, np.nan), np.where(finite, self.upper, np.nan)
        return low / 2 + high / 2

    @property
    def magnitude(self) -> Reals:
        """Largest absolute value of each parameter, shape (p,)."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    @property
    def spread(self) -> Reals:
        """Distance of the centre from the ends, rounded up, shape (p,)."""
        ends = np.maximum(self.upper - self.centre, self.centre - self.lower)
        return np.nextafter(ends, np.inf)


class HalfSpaces(Protocol):
    """A box and rows ``matrix @ x <= right``: a :class:`Cover`, or a polytope of another room."""

    @property
    def lower(self) -> Reals:
        """Lower ends (p,)."""

    @property
    def upper(self) -> Reals:
        """Upper ends (p,)."""

    @property
    def matrix(self) -> Reals:
        """Rows (m, p)."""

    @property
    def right(self) -> Reals:
        """Right sides (m,)."""


class Proposal(NamedTuple):
    """Multipliers for some of the directions that were asked.

    Parameters
    ----------
    places : (k,) int
        Which directions.
    rows : (r,) int
        Rows of the half spaces that are used.
    weights : (k, r) float
        Their multipliers; negative ones and those that are not finite are left out.
    """

    places: NDArray[np.int64]
    rows: NDArray[np.int64]
    weights: Reals


class Multipliers(Protocol):
    """Whatever proposes multipliers of the rows of a cover; nothing is asked of their quality."""

    def multipliers(self, directions: Reals) -> Iterable[Proposal]:
        """Propose multipliers for the largest values of directions (K, p) times theta."""
        ...


def cover(formulation: Formulation, lower: Reals, upper: Reals) -> Cover:
    """State box and rows in theta alone that every consistent parameter vector obeys.

    Parameters
    ----------
    formulation : Formulation
    lower, upper : (p,) float
        Proved bounds of the parameters.

    Returns
    -------
    Cover
    """
    matrix, right, _, all_linear = _candidates(formulation, lower, upper)
    cuts = _binding(matrix, right, lower, upper)
    ends = frozen(np.array(lower)), frozen(np.array(upper))
    rows = frozen(matrix[cuts]), frozen(right[cuts])
    return Cover(formulation.parameters, *ends, *rows, all_linear)


def sources(formulation: Formulation, lower: Reals, upper: Reals) -> NDArray[np.int64]:
    """List the constraints and readings from which the rows of a cover come.

    Parameters
    ----------
    formulation, lower, upper
        As of :func:`cover`.

    Returns
    -------
    (m, 3) int
        0 and a constraint of the problem, or 1 and a row of ``formulation.smoothed``; then 1 or -1:
        for constraints -1 is ``<= 0`` of an equation, for rows the sign of target and regressors.
    """
    matrix, right, origin, _ = _candidates(formulation, lower, upper)
    return origin[_binding(matrix, right, lower, upper)]


def _candidates(
    formulation: Formulation, lower: Reals, upper: Reals
) -> tuple[Reals, Reals, NDArray[np.int64], bool]:
    """State rows, right sides, their origins, and whether the constraints are all there is."""
    matrix, right, origin, all_linear = _linear_constraints(formulation)
    if not all_linear and formulation.smoothed is not None:
        more, width, places = _regression_rows(formulation, lower, upper)
        matrix, right = np.concatenate([matrix, more]), np.concatenate([right, width])
        origin = np.concatenate([origin, places])
    return matrix, right, origin, all_linear


def supports(
    cover: Cover,
    directions: NDArray[Any] | list[list[float]],
    proposer: Callable[[Cover], Multipliers],
) -> Reals:
    """Bound linear functions of theta from below and above.

    Parameters
    ----------
    cover : Cover
    directions : (K, p) float
        Coefficients of the functions.
    proposer : callable
        Makes a source of multipliers for a finite cover with rows; not trusted.

    Returns
    -------
    (K, 2) float
        Lower and upper bounds over every consistent parameter vector.

    References
    ----------
    A. Neumaier, O. Shcherbina, "Safe bounds in linear and mixed-integer linear
    programming", Mathematical Programming 99 (2004) 283-296, section 2.
    """
    wanted = np.atleast_2d(np.asarray(directions, float))
    ranges = box_ranges(cover, wanted)
    usable = np.all(np.isfinite(cover.lower) & np.isfinite(cover.upper)) and cover.right.size
    if not usable:
        return ranges
    wide = np.flatnonzero(np.any(wanted != 0.0, axis=1) & (ranges[:, 1] > ranges[:, 0]))
    both = np.concatenate([wanted[wide], -wanted[wide]])
    most = np.full(len(both), np.inf)
    for places, rows, weights in proposer(cover).multipliers(both):
        most[places] = np.fmin(most[places], safe_maxima(cover, both[places], rows, weights))
    ranges[wide, 0] = np.maximum(ranges[wide, 0], -most[wide.size :])
    ranges[wide, 1] = np.minimum(ranges[wide, 1], most[: wide.size])
    return ranges


def box_ranges(cover: Cover, directions: Reals) -> Reals:
    """Bound over the box alone, rounded outwards, shape (K, 2)."""
    with np.errstate(invalid="ignore", over="ignore"):
        ends = np.stack([directions * cover.lower, directions * cover.upper])
        ends = np.where(directions == 0.0, 0.0, ends)
        sizes = np.abs(np.where(np.isfinite(ends), ends, 0.0)).max(axis=0)
        small = (directions != 0.0) & (cover.magnitude > 0.0) & (sizes < _NORMAL)
        slack = 2 * (directions.shape[1] + 2) * _EPS * sizes.sum(axis=1)
        slack += 2 * _LEAST * small.sum(axis=1)
        low, high = ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1)
        low = np.where(low < np.inf, low - slack, -np.inf)  # what overflows is not known
        high = np.where(high > -np.inf, high + slack, np.inf)
    return np.stack([low, high], axis=1)


# ---- rows -------------------------------------------------------------------------------


def _linear_constraints(
    formulation: Formulation,
) -> tuple[Reals, Reals, NDArray[np.int64], bool]:
    """Constraints in theta alone that are linear, which, and whether these are all."""
    problem, p = formulation.problem, len(formulation.parameters)
    matrix, right, origin = [], [], []
    for number, row in enumerate(problem.constraints):
        polynomial = row.polynomial
        if polynomial.degree > 1 or np.any(polynomial.support >= p):
            continue
        slope, constant = np.zeros(p), 0.0
        letters = polynomial.words.max(axis=1).tolist()
        for letter, value in zip(letters, polynomial.coefficients.tolist(), strict=True):
            if letter:
                slope[letter - 1] = value
            else:
                constant = value
        signs = (1.0, -1.0) if row.kind is sp.Kind.ZERO else (1.0,)
        matrix += [-sign * slope for sign in signs]
        right += [sign * constant for sign in signs]
        origin += [(0, number, int(sign)) for sign in signs]
    every = problem.degree <= 1 and problem.dimension == p
    places = np.reshape(np.array(origin, np.int64), (-1, 3))
    return np.reshape(matrix, (-1, p)), np.array(right), places, every


def _regression_rows(
    formulation: Formulation, lower: Reals, upper: Reals
) -> tuple[Reals, Reals, NDArray[np.int64]]:
    """Rows of the regression, abs(theta) replaced by its chord over the box."""
    rows = formulation.smoothed
    assert rows is not None
    slope, level = _chords(lower, upper)
    size = np.maximum(np.abs(lower), np.abs(upper))
    # Without bounds there is no chord, or its rounding grows with the parameter.
    usable = ~np.any((np.isinf(size) | np.isinf(level)) & (rows.radii > 0), axis=1)
    size, level = np.where(np.isfinite(size), size, 0.0), np.where(np.isinf(level), 0.0, level)
    target, radii, regressors = (x[usable] for x in (rows.target, rows.radii, rows.regressors))
    width = rows.radius[usable] + radii @ level
    slack = 8 * (lower.size + 4) * _EPS
    slack = slack * (np.abs(target) + width + (np.abs(regressors) + radii) @ size)
    slack = slack + np.where(width > 0, _TINY, 0.0)
    matrix = np.concatenate([regressors - radii * slope, -regressors - radii * slope])
    right = np.concatenate([width - target + slack, width + target + slack])
    kept = np.flatnonzero(usable)
    signs = np.repeat([1, -1], kept.size)
    return matrix, right, np.stack([np.ones_like(signs), np.tile(kept, 2), signs], axis=1)


def _chords(lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
    """Bound abs(t) <= slope t + level on each interval; level is inf where there is no chord."""
    mixed = (lower < 0) & (upper > 0)
    finite = mixed & np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(finite, lower, -1.0), np.where(finite, upper, 1.0)
    with np.errstate(over="ignore"):  # ends so far apart have no chord
        slope = np.where(finite, (high + low) / (high - low), np.where(lower >= 0, 1.0, -1.0))
        level = -2.0 * (low / (high - low)) * high
        level = level + 8 * _EPS * (level + high - low)  # the chord of a convex function, raised
        level = level + _TINY
    return np.where(mixed & ~finite, 0.0, slope), np.where(
        finite, level, np.where(mixed, np.inf, 0.0)
    )


def _binding(matrix: Reals, right: Reals, lower: Reals, upper: Reals) -> NDArray[np.bool_]:
    """Rows that cut the box; leaving others out only enlarges the cover."""
    with np.errstate(invalid="ignore"):
        ends = np.maximum(matrix * lower, matrix * upper)
    most = np.where(matrix == 0.0, 0.0, ends).sum(axis=1)
    return np.asarray(~(most <= right))


# ---- bounds -----------------------------------------------------------------------------


def safe_maxima(
    spaces: HalfSpaces, directions: Reals, rows: NDArray[np.int64], weights: Reals
) -> Reals:
    """Bound linear functions from above by any multipliers, rounding included.

    Parameters
    ----------
    spaces : HalfSpaces
        With a finite box.
    directions : (K, p) float
    rows : (r,) int
        Rows that are used.
    weights : (K, r) float
        Multipliers; negative ones and those that are not finite are left out.

    Returns
    -------
    (K,) float
        Upper bounds of directions times x; NaN says nothing. One below 0 for the direction 0
        proves that there is no point.

    References
    ----------
    A. Neumaier, O. Shcherbina, "Safe bounds in linear and mixed-integer linear
    programming", Mathematical Programming 99 (2004) 283-296, section 2.
    """
    use = np.where((weights > 0) & np.isfinite(weights), weights, 0.0)
    matrix, right = spaces.matrix[rows], spaces.right[rows]
    size = np.maximum(np.abs(spaces.lower), np.abs(spaces.upper))
    unit = 4 * (rows.size + size.size + 8) * _EPS
    rest = directions - use @ matrix
    over_box = np.maximum(rest * spaces.lower, rest * spaces.upper).sum(axis=1)
    doubt = np.abs(directions) + use @ np.abs(matrix)
    slack = unit * (use @ np.abs(right) + (np.abs(rest) + doubt) @ size) + _TINY
    slack += _LEAST * (rows.size + 1) * float(size[np.isfinite(size)].sum())
    return np.asarray(use @ right + over_box + slack, np.float64)
