"""A box for variables without bounds, from equations that are linear in them.

Rows h_k(x) = r_k(w) + sum_j c_kj(w) theta_j = 0, whose other variables w have bounds, hold
with interval matrices C of the c_kj and r of the r_k. For any matrix M and centre theta0

    theta - theta0 = (I - M C)(theta - theta0) - M (r + C theta0),

so that |theta - theta0| <= G |theta - theta0| + d with G = |I - M C| and d the size of
M (r + C theta0). If G v + d < v for some v, then |theta - theta0| <= v: with
t = max_j |theta - theta0|_j / v_j at j, t v_j <= t (G v)_j + d_j, which t > 1 contradicts.
Parameters of a system among bounded noise are such variables, and M is that of least
squares.

References
----------
S. M. Rump, Verification methods: rigorous results using floating-point arithmetic, Acta
Numerica 19, 2010 (enclosures by approximate inverses).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import are_indices, are_numbers
from sparsepop_py.verified.arithmetic.interval import Interval, matmul
from sparsepop_py.verified.arithmetic.polynomial_range import range_over

__all__ = ["LeftInverse", "left_inverse"]

_MOST = 4_000_000  # entries of M times columns of C
_RADIUS = 0.999  # of the spectrum of G, from which the box would be useless


@dataclass(frozen=True, eq=False)
class LeftInverse:
    """|theta - centre| <= radius, from an approximate left inverse of linear rows.

    Parameters
    ----------
    rows : (R,) int
        Equality constraints, linear in the variables together.
    variables : (p,) int
    inverse : (p, R) float
    centre, radius : (p,) float
    """

    rows: NDArray[np.int64]
    variables: NDArray[np.int64]
    inverse: NDArray[np.float64]
    centre: NDArray[np.float64]
    radius: NDArray[np.float64]

    @property
    def uses_cutoff(self) -> bool:
        """Never: it holds on the whole feasible set."""
        return False

    def shrink(self, problem: Problem, box: Interval) -> Interval:
        """Intersect a box with it; a box where it does not hold stays."""
        if not self._sensible(problem):
            return box
        regression = _regression(problem, box, self.rows, self.variables)
        if regression is None:
            return box
        coupling, drive = _coupling_and_drive(*regression, self.inverse, self.centre)
        v = Interval.point(self.radius[:, None])
        reached = (matmul(Interval.point(coupling), v) + Interval.point(drive[:, None])).hi.ravel()
        if not np.all(reached < self.radius):
            return box
        centre, reach = Interval.point(self.centre), Interval(-self.radius, self.radius)
        around = centre + reach
        lo, hi = box.lo.copy(), box.hi.copy()
        lo[self.variables] = np.maximum(lo[self.variables], around.lo)
        hi[self.variables] = np.minimum(hi[self.variables], around.hi)
        return Interval(lo, hi)

    def _sensible(self, problem: Problem) -> bool:
        p, count = self.variables.size, self.rows.size
        shapes = self.inverse.shape == (p, count) and self.centre.shape == self.radius.shape == (p,)
        if not shapes or self.rows.ndim != 1 or self.variables.ndim != 1:
            return False
        if not are_indices(self.rows, len(problem.constraints)):
            return False
        if not are_indices(self.variables, problem.dimension) or np.unique(self.variables).size < p:
            return False
        numbers = (self.inverse, self.centre, self.radius)
        return bool(
            np.all(problem.equality[self.rows])
            and all(are_numbers(array) for array in numbers)
            and np.all(self.radius > 0)
        )


def left_inverse(problem: Problem, box: Interval) -> LeftInverse | None:
    """Bound variables without bounds by a left inverse of enough tight rows.

    Parameters
    ----------
    problem : Problem
    box : Interval
        Known ranges of the variables.

    Returns
    -------
    LeftInverse or None
        None where the rows give no bounds.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> p, e1, e2 = sp.variables(3, ["p", "e1", "e2"])
    >>> rows = [p * (2 + e1) == 4 + e2, p * (1 + e2) == 2 + e1]
    >>> problem = sp.Problem(p, rows, [-float("inf"), -0.1, -0.1], [float("inf"), 0.1, 0.1])
    >>> step = left_inverse(problem, Interval(problem.lower, problem.upper))
    >>> box = step.shrink(problem, Interval(problem.lower, problem.upper))
    >>> bool(box.lo[0] > 1.5 and box.hi[0] < 2.5)
    True
    """
    unbounded = ~(np.isfinite(box.lo) & np.isfinite(box.hi))
    variables = np.flatnonzero(unbounded)
    rows = _linear_rows(problem, unbounded)
    p, count = variables.size, rows.size
    if not 0 < p <= count or p * p * count > _MOST:
        return None
    regression = _regression(problem, box, rows, variables)
    if regression is None:
        return None
    matrix, rest = regression
    middle, offset = matrix.middle(), rest.middle().ravel()
    noise = np.maximum(rest.hi - rest.lo, 0.0).ravel() + (matrix.hi - matrix.lo).sum(axis=1)
    for power in (0.0, 0.5, 1.0):
        scale = 1.0 / np.maximum(noise, 1e-9 * max(1.0, noise.max())) ** power
        with np.errstate(all="ignore"):
            inverse = np.asarray(np.linalg.pinv(middle * scale[:, None])) * scale
            centre = -inverse @ offset
        if not np.all(np.isfinite(inverse)):
            continue
        coupling, drive = _coupling_and_drive(matrix, rest, inverse, centre)
        if not np.max(np.abs(np.linalg.eigvals(coupling))) < _RADIUS:
            continue
        radius = np.asarray(np.linalg.solve(np.eye(p) - coupling, drive) * 1.01 + 1e-12, float)
        found = LeftInverse(rows, variables, inverse, centre, radius)
        if np.all(np.isfinite(found.shrink(problem, box).lo[variables])):
            return found
    return None


def _linear_rows(problem: Problem, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Equalities that hold chosen variables, at most one in each term, to the first power."""
    rows = problem.rows
    inside = np.append(False, chosen)[rows.words].sum(axis=1)
    most = np.zeros(rows.size, int)
    np.maximum.at(most, rows.row, inside)
    return np.flatnonzero(problem.equality & (most == 1))


def _regression(
    problem: Problem, box: Interval, rows: NDArray[np.int64], variables: NDArray[np.int64]
) -> tuple[Interval, Interval] | None:
    """Enclose C (R, p) and r (R, 1) over a box, None if not finite."""
    part, p = problem.rows.take(rows), variables.size
    column = np.full(problem.dimension + 1, p)
    column[variables + 1] = np.arange(p)
    place = column[part.words]
    if np.any((place < p).sum(axis=1) > 1):
        return None
    target = place.min(axis=1, initial=p)
    rest = np.where(place < p, 0, part.words)
    words = monomials.trim(np.sort(rest, axis=1))
    index = part.row * (p + 1) + target
    order = np.argsort(index, kind="stable")
    split = PolynomialSystem(
        words[order],
        part.coefficients[order],
        index[order],
        rows.size * (p + 1),
        problem.dimension,
    )
    reach = range_over(split, box)
    if not np.all(np.isfinite(reach.lo) & np.isfinite(reach.hi)):
        return None
    lo, hi = (end.reshape(rows.size, p + 1) for end in (reach.lo, reach.hi))
    return Interval(lo[:, :p], hi[:, :p]), Interval(lo[:, p:], hi[:, p:])


def _coupling_and_drive(
    matrix: Interval, rest: Interval, inverse: NDArray[np.float64], centre: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Upper ends of G (p, p) and d (p,)."""
    left = Interval.point(inverse)
    coupling = (Interval.point(np.eye(centre.size)) - matmul(left, matrix)).magnitude()
    offset = rest + matmul(matrix, Interval.point(centre[:, None]))
    return coupling, matmul(left, offset).magnitude().ravel()
