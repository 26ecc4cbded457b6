"""Convex quadratic programs over polyhedra, solved by Clarabel. Nothing proved rests on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import Cones
from sparsepop_py.solvers.clarabel_ import STATUS, run_clarabel
from sparsepop_py.solvers.interface import SolverSettings
from sparsepop_py.verified.certificate.polyhedron import Polyhedron

__all__ = ["QuadraticSolution", "minimise_on_box", "solve_convex_qp"]

_ACCURACY = 1e-12  # a tangent at the minimiser bounds a program as well as its gradient vanishes


@dataclass(frozen=True, eq=False)
class QuadraticSolution:
    """Output of an interior-point method for a convex quadratic program.

    Parameters
    ----------
    status : {"solved", "almost", "infeasible", "unbounded", "failed"}
    x : (n,) float
    multipliers : (m + 2n,) float
        Of the rows of the polyhedron, not negative but for equalities.
    slack : (m + 2n,) float
        Values of the rows, +inf for bounds that are not there.
    """

    status: str
    x: NDArray[np.float64]
    multipliers: NDArray[np.float64]
    slack: NDArray[np.float64]


def solve_convex_qp(
    polyhedron: Polyhedron,
    cost: NDArray[np.float64],
    hessian: sps.csc_array,
    settings: SolverSettings,
) -> QuadraticSolution:
    """Minimise cost'x + x' hessian x / 2 over a polyhedron.

    Parameters
    ----------
    polyhedron : Polyhedron
    cost : (n,) float
    hessian : (n, n) csc
        Positive semidefinite; no entries for a linear program.
    settings : SolverSettings

    Returns
    -------
    QuadraticSolution
    """
    equal = np.flatnonzero(polyhedron.equality)
    others = np.flatnonzero(polyhedron.present & ~polyhedron.equality)
    rows = np.append(equal, others)
    size = np.abs(polyhedron.matrix[rows]).max(axis=1, initial=0.0)
    scale = np.exp2(-np.round(np.log2(np.where(size > 0.0, size, 1.0))))  # rows may be constant
    largest = max(np.abs(cost).max(initial=0.0), np.abs(hessian.data).max(initial=0.0))
    weight = np.exp2(-np.round(np.log2(largest or 1.0)))
    matrix = sps.csc_matrix(-polyhedron.matrix[rows] * scale[:, None])
    right = polyhedron.constant[rows] * scale
    result = run_clarabel(
        sps.csc_matrix(sps.triu(hessian) * weight),
        cost * weight,
        matrix,
        right,
        Cones(equal.size, others.size, ()),
        settings,
    )
    multipliers: NDArray[Any] = np.zeros(polyhedron.constant.size)
    with np.errstate(over="ignore"):
        multipliers[rows] = result.z * scale / weight
    slack = np.full(polyhedron.constant.size, np.inf)
    slack[rows] = result.s / scale
    status = STATUS.get(result.status, "failed")
    if status in ("solved", "almost") and not np.isfinite(multipliers).all():
        status = "failed"  # multipliers beyond all doubles
    return QuadraticSolution(status, result.x, multipliers, slack)


def minimise_on_box(
    hessian: sps.csc_array,
    cost: NDArray[np.float64],
    rows: tuple[sps.csr_array, NDArray[np.float64], NDArray[np.bool_]],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64] | None:
    """Minimise cost'z + z' hessian z / 2 on a box, A z >= b.

    Parameters
    ----------
    hessian : (N, N) csc
        Positive semidefinite.
    cost : (N,) float
    rows : (A, b, equality)
        Rows marked in ``equality`` hold with equality; those with b = -inf are left out.
    bounds : (lower, upper), each (N,)

    Returns
    -------
    (N,) float or None
        None where the solver finds no minimiser.
    """
    matrix, right, equality = rows
    equal = np.flatnonzero(equality)
    others = np.flatnonzero(~equality & np.isfinite(right))
    one = sps.eye_array(cost.size, format="csr")
    stacked = sps.csc_matrix(sps.vstack([-matrix[equal], -matrix[others], -one, one]))
    sides = np.concatenate([-right[equal], -right[others], -bounds[0], bounds[1]])
    cones = Cones(equal.size, others.size + 2 * cost.size, ())
    upper = sps.csc_matrix(sps.triu(hessian))
    result = run_clarabel(upper, cost, stacked, sides, cones, SolverSettings(accuracy=_ACCURACY))
    solved = STATUS.get(result.status, "failed") in ("solved", "almost")
    return result.x if solved else None
