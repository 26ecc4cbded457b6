"""Least equation errors: a convex program, and multipliers in rationals that prove its value.

The least norm of rows Y + R theta is at least |Y'lambda| / |lambda|, with the dual norm below, for
multipliers lambda with R'lambda = 0: the residuals of least squares, or the dual solution of a
linear program.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import scipy.linalg
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.errors import SetidError
from setid.formulation.regression import Regression
from setid.proofs.least_noise.least_error import Multipliers, Norm, weighted_sums
from sparsepop_py.lp.highs import LinearSolution
from sparsepop_py.lp.scaled import solve_scaled
from sparsepop_py.verified.arithmetic.rational import solve_matrix

__all__ = ["corrected", "minimiser"]

Reals = NDArray[np.float64]

_AT_END = 1e-9  # from an end of their range: multipliers of linear programs that lie there


def minimiser(rows: Regression, norm: Norm) -> tuple[Reals, Reals]:
    """Minimise |Y + R theta|; return theta and multipliers (R,) that nearly prove it.

    Parameters
    ----------
    rows : Regression
    norm : {"linf", "l2", "l1"}

    Raises
    ------
    SetidError
        If the linear program has no solution.
    """
    y, a = rows.target, rows.regressors
    if norm == "l2":
        scaled, size = _in_units(a)
        theta = -np.linalg.lstsq(scaled, y, rcond=None)[0]
        return theta / size, np.asarray(y + scaled @ theta, np.float64)
    return _least_largest(y, a) if norm == "linf" else _least_sum(y, a)


def _least_largest(y: Reals, a: Reals) -> tuple[Reals, Reals]:
    """Minimise the largest error."""
    count, p = a.shape
    size = np.ones((count, 1))
    below = sps.csr_array(np.vstack([np.hstack([a, -size]), np.hstack([-a, -size])]))
    found = solve_scaled(np.append(np.zeros(p), 1.0), (below, np.concatenate([-y, y])))
    _check_solved(found)
    return found.x[:p], np.abs(found.dual[:count]) - np.abs(found.dual[count:])


def _least_sum(y: Reals, a: Reals) -> tuple[Reals, Reals]:
    """Minimise the sum of errors: the dual program has one row a parameter."""
    count, p = a.shape
    scaled, size = _in_units(a)
    nothing, ends = sps.csr_array((0, count)), np.ones(count)
    equal = sps.csr_array(scaled.T), np.zeros(p)
    found = solve_scaled(-y, (nothing, np.zeros(0)), equal, (-ends, ends))
    _check_solved(found)
    near = ends - np.abs(found.x) < _AT_END
    return found.dual / size, np.where(near, np.sign(found.x), found.x)


def _check_solved(found: LinearSolution) -> None:
    if found.status != "solved":
        raise SetidError("data: the linear program has no solution; are numbers near overflow?")


def corrected(rows: Regression, dual: Reals, norm: Norm) -> Multipliers:
    """Correct multipliers in rationals so that R'lambda = 0, by changes at p rows.

    Parameters
    ----------
    rows : Regression
    dual : (R,) float
    norm : {"linf", "l2", "l1"}
    """
    a = rows.regressors
    a = a[:, _independent(a)]  # a sum of columns is orthogonal where these are
    p = a.shape[1]
    values = [Fraction(float(v)) for v in dual]
    size = np.abs(dual)
    if norm == "l1":  # change those that are far from their bound
        most = size.max(initial=1e-300)
        weight = most - size + 1e-6 * most
    else:
        weight = size + 1e-3 * size.max(initial=1e-300)
    order = _by_size((_in_units(a)[0] * weight[:, None]).T)
    if order.size < p:
        return Multipliers(())
    pivots = order.tolist()
    left = weighted_sums(a, values)
    matrix = [[Fraction(float(a[k, i])) for k in pivots] for i in range(p)]
    changes = solve_matrix(matrix, [[-value] for value in left])
    if changes is not None:
        for place, (change,) in zip(pivots, changes, strict=True):
            values[place] += change
    return Multipliers(tuple(values))


def _in_units(matrix: Reals) -> tuple[Reals, Reals]:
    """Divide columns by their largest sizes; return both."""
    size = np.abs(matrix).max(axis=0, initial=0.0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(matrix / size, np.float64), size


def _by_size(matrix: Reals) -> NDArray[np.int64]:
    """Choose independent columns, those first that are far from the span of others."""
    _, upper, order = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > 1e-12 * diagonal.max(initial=1e-300)))
    return np.asarray(order[:rank], np.int64)


def _independent(matrix: Reals) -> NDArray[np.int64]:
    """Choose columns that span all of them."""
    return np.sort(_by_size(_in_units(matrix)[0]))
