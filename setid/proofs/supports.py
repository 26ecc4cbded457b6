"""Proved ranges of linear functions of the parameters over the feasible parameter set.

A :class:`Cover` is a box and linear rows that every consistent parameter vector obeys. For
equation errors alone it *is* the feasible set; otherwise the noise is replaced by its
largest effect and ``abs(theta)`` by its chord over the box. A linear program proposes
multipliers; the bound is what weak duality makes of them, every rounding error included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import SetidError
from setid.feasible_set.linear_programs import minimise

if TYPE_CHECKING:
    from setid.formulation.formulation import Formulation
    from setid.result.identification import Identification

__all__ = ["Cover", "box_ranges", "cover_of", "middle", "outer_box", "require_members", "supports"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)


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


def require_members(result: Identification) -> None:
    """Refuse a result whose feasible set is proved empty.

    Raises
    ------
    SetidError
        Saying so.
    """
    if any(interval.status == "empty" for interval in result.intervals.values()):
        raise SetidError(
            "result: found an empty feasible set, expected consistent parameters; "
            "see setid.consistency for the least noise bound that explains the data"
        )


def outer_box(result: Identification) -> tuple[Reals, Reals]:
    """Lower and upper ends of the outer intervals, each (p,)."""
    ends = np.array([result.intervals[name].outer for name in result.formulation.parameters])
    return ends[:, 0], ends[:, 1]


def middle(result: Identification) -> Reals | None:
    """The centre of the outer box (p,), None where the box is not finite."""
    low, high = outer_box(result)
    return low / 2 + high / 2 if np.all(np.isfinite([low, high])) else None


def cover_of(result: Identification) -> Cover:
    """Box and rows in theta alone that follow from a result.

    Parameters
    ----------
    result : Identification

    Raises
    ------
    SetidError
        If the feasible set is empty.

    Examples
    --------
    >>> import setid
    >>> from setid.proofs.supports import cover_of, supports
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> supports(cover_of(result), [[1.0, 0.0]]).round(5)
    array([[-0.52326, -0.34533]])
    """
    require_members(result)
    formulation = result.formulation
    lower, upper = outer_box(result)
    matrix, right, all_linear = _linear_constraints(formulation)
    if not all_linear and formulation.smoothed is not None:
        more, width = _regression_rows(formulation, lower, upper)
        matrix, right = np.concatenate([matrix, more]), np.concatenate([right, width])
    matrix, right = _binding(matrix, right, lower, upper)
    return Cover(
        formulation.parameters,
        frozen(lower),
        frozen(upper),
        frozen(matrix),
        frozen(right),
        all_linear,
    )


def supports(cover: Cover, directions: NDArray | list[list[float]]) -> Reals:
    """Proved least and largest value of linear functions of theta.

    Parameters
    ----------
    cover : Cover
    directions : (K, p) float
        Coefficients of the functions.

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
    proposer = _Proposer(cover)
    for k, direction in enumerate(wanted):
        if np.any(direction) and ranges[k, 1] > ranges[k, 0]:
            high = _safe_maximum(cover, direction, proposer.multipliers(direction))
            low = -_safe_maximum(cover, -direction, proposer.multipliers(-direction))
            ranges[k] = max(low, ranges[k, 0]), min(high, ranges[k, 1])
    return ranges


def box_ranges(cover: Cover, directions: Reals) -> Reals:
    """Ranges over the box alone, rounded outwards, shape (K, 2)."""
    with np.errstate(invalid="ignore"):
        ends = np.stack([directions * cover.lower, directions * cover.upper])
    ends = np.where(directions == 0.0, 0.0, ends)
    sizes = np.abs(np.where(np.isfinite(ends), ends, 0.0)).max(axis=0).sum(axis=1)
    slack = 2 * (directions.shape[1] + 2) * _EPS * sizes
    low, high = ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1)
    return np.stack([low - slack, high + slack], axis=1)


# ---- rows -------------------------------------------------------------------------------


def _linear_constraints(formulation: Formulation) -> tuple[Reals, Reals, bool]:
    """Constraints in theta alone that are linear, and whether these are all."""
    problem, p = formulation.problem, len(formulation.parameters)
    matrix, right = [], []
    for row in problem.constraints:
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
    every = problem.degree <= 1 and problem.dimension == p
    return np.reshape(matrix, (-1, p)), np.array(right), every


def _regression_rows(formulation: Formulation, lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
    """Rows of the regression, abs(theta) replaced by its chord over the box."""
    rows = formulation.smoothed
    assert rows is not None
    slope, level = _chords(lower, upper)
    usable = ~np.any(np.isinf(level) & (rows.radii > 0), axis=1)
    level = np.where(np.isinf(level), 0.0, level)
    target, radii, regressors = (x[usable] for x in (rows.target, rows.radii, rows.regressors))
    width = rows.radius[usable] + radii @ level
    size = np.maximum(np.abs(lower), np.abs(upper))
    size = np.where(np.isfinite(size), size, 0.0)
    slack = 8 * (lower.size + 4) * _EPS
    slack = slack * (np.abs(target) + width + (np.abs(regressors) + radii) @ size)
    matrix = np.concatenate([regressors - radii * slope, -regressors - radii * slope])
    right = np.concatenate([width - target + slack, width + target + slack])
    return matrix, right


def _chords(lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
    """slope, level with abs(t) <= slope t + level on each interval; level inf where none is."""
    mixed = (lower < 0) & (upper > 0)
    finite = mixed & np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(finite, lower, -1.0), np.where(finite, upper, 1.0)
    slope = np.where(finite, (high + low) / (high - low), np.where(lower >= 0, 1.0, -1.0))
    level = -2.0 * (low / (high - low)) * high
    level = level + 8 * _EPS * (level + high - low)  # the chord of a convex function, raised
    return np.where(mixed & ~finite, 0.0, slope), np.where(
        finite, level, np.where(mixed, np.inf, 0.0)
    )


def _binding(matrix: Reals, right: Reals, lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
    """Rows that cut the box; leaving others out only enlarges the cover."""
    with np.errstate(invalid="ignore"):
        ends = np.maximum(matrix * lower, matrix * upper)
    most = np.where(matrix == 0.0, 0.0, ends).sum(axis=1)
    cuts = ~(most <= right)
    return matrix[cuts], right[cuts]


# ---- bounds -----------------------------------------------------------------------------


class _Proposer:
    """Multipliers for one direction after the other, by dual linear programs.

    The cover is taken in coordinates in which its box is [-1, 1] and its rows have norm 1.
    A basis that was optimal for one direction is optimal for every direction for which its
    multipliers are not negative: many programs need not be solved.

    Parameters
    ----------
    cover : Cover
        Finite, with at least one row.
    """

    def __init__(self, cover: Cover) -> None:
        tiny = float(np.finfo(float).tiny)
        self._width = np.maximum(cover.spread, tiny)
        matrix = cover.matrix * self._width
        self._norm = np.maximum(np.abs(matrix).max(axis=1), tiny)
        right = (cover.right - cover.matrix @ cover.centre) / self._norm
        eye = np.eye(self._width.size)
        self._columns = np.concatenate([matrix / self._norm[:, None], eye, -eye]).T
        self._sparse = sps.csr_array(self._columns)
        self._cost = np.concatenate([right, np.ones(2 * self._width.size)])
        self._bases: list[tuple[NDArray[np.int64], Reals]] = []

    def multipliers(self, direction: Reals) -> Reals:
        """Multipliers >= 0 of the rows for the largest value of direction'theta."""
        goal = direction * self._width
        size = float(np.abs(goal).max()) or 1.0
        weights = self._known(goal / size)
        if weights is None:
            weights = self._solved(goal / size)
        return np.maximum(weights[: self._norm.size], 0.0) * size / self._norm

    def _known(self, goal: Reals) -> Reals | None:
        for basis, inverse in reversed(self._bases):
            values = inverse @ goal
            if values.min() >= 0.0:
                weights = np.zeros(self._cost.size)
                weights[basis] = values
                return weights
        return None

    def _solved(self, goal: Reals) -> Reals:
        none = (sps.csr_array((0, self._cost.size)), np.zeros(0))
        bounds = np.zeros(self._cost.size), np.full(self._cost.size, np.inf)
        try:
            found = minimise(self._cost, none, (self._sparse, goal), bounds)
        except SetidError:
            found = None  # an unbounded dual: the rows are (nearly) contradictory
        if found is None:
            return np.zeros(self._cost.size)
        basis = np.flatnonzero(found > 1e-12)
        if basis.size == goal.size:
            block = self._columns[:, basis]
            if np.linalg.cond(block) < 1e10:
                self._bases.append((basis, np.linalg.inv(block)))
        return found


def _safe_maximum(cover: Cover, direction: Reals, multipliers: Reals) -> float:
    """Upper bound of direction'theta from any multipliers >= 0, rounding included."""
    used = multipliers > 0
    weight, matrix, right = multipliers[used], cover.matrix[used], cover.right[used]
    unit = 4 * (weight.size + direction.size + 4) * _EPS
    rest = direction - weight @ matrix
    doubt = unit * (np.abs(direction) + weight @ np.abs(matrix))
    over_box = np.maximum(rest * cover.lower, rest * cover.upper)
    size = cover.magnitude
    slack = unit * (weight @ np.abs(right) + np.abs(rest) @ size) + doubt @ size
    return float((weight @ right + over_box.sum() + slack) * 1.0 + unit * np.abs(slack))
