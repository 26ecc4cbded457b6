"""Point estimates for comparison: least squares, least absolute values, least maximum.

They know no noise bounds. Least squares is consistent for equation errors that are white,
and for output noise only without output lags (finite impulse responses, static systems).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from setid.data.checks import frozen, number, real_array
from setid.data.record import IOData
from setid.errors import DataError, SetidError
from setid.formulation.regression import Regression, regression_of_data
from setid.models.equations import Structure
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.lp.highs import LinearSolution
from sparsepop_py.lp.scaled import solve_scaled
from sparsepop_py.uncertain_rows.sign_tree import left_inverse

__all__ = ["Estimate", "NamedVector", "l1", "least_squares", "linf", "recursive_least_squares"]


class NamedVector:
    """Base of parameter vectors whose entries are found by their names."""

    __slots__ = ()
    names: tuple[str, ...]
    theta: NDArray[np.float64]

    def __getitem__(self, name: str) -> float:
        """Return a parameter by name."""
        if not isinstance(name, str) or name not in self.names:
            raise SetidError(f"name: found {name!r}, expected one of {', '.join(self.names)}")
        return float(self.theta[self.names.index(name)])

    def __str__(self) -> str:
        pairs = zip(self.names, self.theta.tolist(), strict=True)
        return ", ".join(f"{name} = {value:.6g}" for name, value in pairs)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Estimate(NamedVector, ReadOnly):
    """A parameter vector and what it minimises.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
    cost : float
        Sum of squares, sum of absolute values, or largest absolute value of the residuals.
    residuals : (R,) float
        y~_k - phi_k' theta, row by row.
    row : (R,) int
        Row of the data (from 0) of each residual.
    history : (R, p) float or None
        The estimate after each row, for recursive least squares.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])
    >>> round(setid.least_squares(data, setid.TransferFunction(1, 1, 1))["a1"], 9)
    -0.5
    """

    names: tuple[str, ...]
    theta: NDArray[np.float64]
    cost: float
    residuals: NDArray[np.float64]
    row: NDArray[np.int64]
    history: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        return f"<Estimate: {self}, cost {self.cost:.6g}>"


def least_squares(data: IOData, model: Structure) -> Estimate:
    """Minimise the sum of squared equation residuals, in one batch.

    Parameters
    ----------
    data : IOData
        Rows with missing samples are left out.
    model : Structure
        Linear in its parameters.

    Returns
    -------
    Estimate
        Its ``cost`` is the sum of squares. Where the regressors are dependent, so that many
        vectors have the least sum, the one of least norm.

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.
    DataError
        If the channels do not fit, or no row is complete.

    References
    ----------
    L. Ljung, System Identification, 2nd ed. 1999, eqs. (7.34) and (10.4).

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])
    >>> print(setid.least_squares(data, setid.TransferFunction(na=1, nb=1, nk=1)))
    a1 = -0.5, b1 = 1
    """
    rows = regression_of_data(data, model)
    theta = -left_inverse(rows.regressors) @ rows.target
    residuals = _residuals(rows, theta)
    return _estimate(rows, theta, float(residuals @ residuals))


def recursive_least_squares(
    data: IOData,
    model: Structure,
    forgetting: float = 1.0,
    initial: ArrayLike | None = None,
    covariance: float | ArrayLike = 1e8,
) -> Estimate:
    """Update least squares row by row, as it would run online.

    Parameters
    ----------
    data : IOData
        Rows with missing samples are left out.
    model : Structure
        Linear in its parameters.
    forgetting : float
        In (0, 1]: the weight of each row is multiplied by it at every later row. 1, the default,
        forgets nothing.
    initial : array_like (p,), optional
        Estimate before the first row; zero when left out.
    covariance : float or array_like (p, p)
        Covariance P_0 of the initial estimate; a number stands for that multiple of the identity.
        With forgetting 1 the last estimate minimises the sum of squares plus
        (theta - initial)' P_0^-1 (theta - initial).

    Returns
    -------
    Estimate
        With ``history`` (R, p), the estimate after each of the R rows.

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.
    DataError
        If the channels do not fit, or no row is complete.
    SetidError
        If forgetting, initial or covariance are none of these.

    References
    ----------
    L. Ljung, System Identification, 2nd ed. 1999, section 11.2; in square-root form:
    G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. IV.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])
    >>> found = setid.recursive_least_squares(data, setid.TransferFunction(1, 1, 1))
    >>> found.theta.round(5), found.history.shape
    (array([-0.5,  1. ]), (3, 2))
    """
    factor = number(forgetting, "forgetting", SetidError)
    if not 0.0 < factor <= 1.0:
        raise SetidError(f"forgetting: found {forgetting!r}, expected a number in (0, 1]")
    rows = regression_of_data(data, model)
    p = len(rows.names)
    theta = np.zeros(p) if initial is None else real_array(initial, "initial", SetidError)
    spread = real_array(covariance, "covariance", SetidError)
    if np.isnan(theta).any() or np.isnan(spread).any():
        raise SetidError("initial, covariance: found NaN, expected numbers")
    spread = spread * np.eye(p) if spread.ndim == 0 else spread
    if theta.shape != (p,) or spread.shape != (p, p):
        raise SetidError(
            f"initial, covariance: found shapes {theta.shape}, {spread.shape}, "
            f"expected ({p},), ({p}, {p})"
        )
    order = np.lexsort((rows.output, rows.row))
    triangle = _information_root(spread, theta)
    history = np.empty((order.size, p))
    for step, row in enumerate(order):
        fresh = np.append(-rows.regressors[row], rows.target[row])
        stacked = np.vstack([np.sqrt(factor) * triangle, fresh])
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"), float)[:p]
        history[step] = solve_triangular(triangle[:, :p], triangle[:, p])
    theta = history[-1].copy()
    residuals = _residuals(rows, theta)
    return _estimate(rows, theta, float(residuals @ residuals), history)


def _information_root(
    covariance: NDArray[np.float64], theta: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[R, R theta] with R'R = covariance^-1, upper triangular, shape (p, p + 1)."""
    try:
        lower = np.linalg.cholesky(np.linalg.inv(covariance))
    except np.linalg.LinAlgError:
        raise SetidError("covariance: expected a symmetric positive definite matrix") from None
    return np.column_stack([lower.T, lower.T @ theta])


def l1(data: IOData, model: Structure) -> Estimate:
    """Minimise the sum of absolute equation residuals, by a linear program.

    Nothing is proved here; :func:`fit` proves a lower bound of the sum.

    Parameters
    ----------
    data : IOData
        Rows with missing samples are left out.
    model : Structure
        Linear in its parameters.

    Returns
    -------
    Estimate
        Its ``cost`` is the sum, in the unit of the output.

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.
    DataError
        If the channels do not fit, or no row is complete.

    Notes
    -----
    Minimise sum s subject to ``[A -I; -A -I] [theta; s] <= [b; -b]``.

    References
    ----------
    S. Boyd, L. Vandenberghe, Convex Optimization, 2004, section 6.1.1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, 0, 2, 1], [0, 1, 0.5, 2.25])
    >>> print(setid.l1(data, setid.TransferFunction(na=1, nb=1, nk=1)))
    a1 = -0.5, b1 = 1
    """
    rows = regression_of_data(data, model)
    a, b = -sps.csr_array(rows.regressors), rows.target
    eye = sps.eye_array(b.size)
    below = sps.vstack([sps.hstack([a, -eye]), sps.hstack([-a, -eye])]).tocsr()
    cost = np.concatenate([np.zeros(a.shape[1]), np.ones(b.size)])
    theta = _solved(solve_scaled(cost, (below, np.concatenate([b, -b]))))[: a.shape[1]]
    return _estimate(rows, theta, float(np.abs(_residuals(rows, theta)).sum()))


def linf(data: IOData, model: Structure) -> Estimate:
    """Minimise the largest absolute equation residual, by a linear program.

    Nothing is proved here; :func:`consistency` and :func:`fit` prove the same number.

    Parameters
    ----------
    data : IOData
        Rows with missing samples are left out.
    model : Structure
        Linear in its parameters.

    Returns
    -------
    Estimate
        Its ``cost`` is the least bound of an equation error that explains the data, in the unit
        of the output and up to the accuracy of the solver.

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.
    DataError
        If the channels do not fit, or no row is complete.

    References
    ----------
    S. Boyd, L. Vandenberghe, Convex Optimization, 2004, section 6.1.1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.linf(data, setid.TransferFunction(1, 1))
    >>> round(found.cost, 6)  # the least bound of an equation error
    0.339028
    """
    rows = regression_of_data(data, model)
    a, b = -sps.csr_array(rows.regressors), rows.target
    one = sps.csr_array(np.ones((b.size, 1)))
    below = sps.vstack([sps.hstack([a, -one]), sps.hstack([-a, -one])]).tocsr()
    cost = np.append(np.zeros(a.shape[1]), 1.0)
    theta = _solved(solve_scaled(cost, (below, np.concatenate([b, -b]))))[:-1]
    return _estimate(rows, theta, float(np.abs(_residuals(rows, theta)).max()))


def _solved(found: LinearSolution) -> NDArray[np.float64]:
    if found.status != "solved":
        raise DataError("data: the linear program has no solution; are numbers near overflow?")
    return found.x


def _residuals(rows: Regression, theta: NDArray[np.float64]) -> NDArray[np.float64]:
    return rows.target + rows.regressors @ theta


def _estimate(
    rows: Regression,
    theta: NDArray[np.float64],
    cost: float,
    history: NDArray[np.float64] | None = None,
) -> Estimate:
    kept = None if history is None else frozen(history)
    return Estimate(
        rows.names, frozen(theta.copy()), cost, frozen(_residuals(rows, theta)), rows.row, kept
    )
