"""Assemble the conic program of a relaxation with an objective.

    minimise  q'y + offset   subject to   A y + s = b,   s in K,

with y the moments without the constant (see :mod:`sparsepop_py.conic.program`). The inverse, from
a solver's dual to multipliers, is :mod:`sparsepop_py.relaxation.recover_multipliers`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.conic.program import Cones, ConicProgram
from sparsepop_py.errors import ProblemError, check_kind
from sparsepop_py.relaxation.moment import Relaxation

__all__ = ["assemble", "split_dual"]

_ROOT2 = float(np.sqrt(2.0))


def assemble(relaxation: Relaxation, objective: Polynomial) -> ConicProgram:
    """Assemble the conic program of a relaxation with an objective.

    Parameters
    ----------
    relaxation : Relaxation
    objective : Polynomial
        In the variables of ``relaxation.problem``.

    Returns
    -------
    ConicProgram

    Raises
    ------
    ProblemError
        If the objective has a monomial that the relaxation does not hold, or other variables.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> program = sp.assemble(sp.relax(problem), problem.objective)
    >>> program.A.shape, program.cones
    ((7, 5), Cones(zero=0, nonnegative=1, psd=(3,)))
    """
    check_kind(relaxation, Relaxation, "relaxation")
    check_kind(objective, Polynomial, "objective")
    if objective.dimension != relaxation.problem.dimension:
        raise ProblemError(
            f"objective: found {objective.dimension} variables, "
            f"expected {relaxation.problem.dimension}"
        )
    q, offset = relaxation.objective_vector(objective)
    A, b = relaxation.scaled_rows
    linear = sum(g.count for g in relaxation.groups if not g.free and g.size == 1)
    psd = [g.size for g in relaxation.groups for _ in range(g.count) if not g.free and g.size > 1]
    return ConicProgram(q, A, b, Cones(relaxation.equality_rows, linear, tuple(psd)), offset)


def split_dual(relaxation: Relaxation, z: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Split the dual z by groups into multipliers.

    Parameters
    ----------
    relaxation : Relaxation
    z : (R,) float

    Returns
    -------
    list of array
        One a group: (K, s) for free groups, else (K, s, s) symmetric.
    """
    parts: list[NDArray[np.float64]] = []
    offset = 0
    for group in relaxation.groups:
        total = group.count * group.rows_each
        part = z[offset : offset + total].reshape(group.count, group.rows_each)
        offset += total
        if group.free:
            parts.append(part.copy())
            continue
        i, j = group.pairs
        weight = np.where(i == j, 1.0, 1.0 / _ROOT2)
        matrix = np.zeros((group.count, group.size, group.size))
        matrix[:, i, j] = matrix[:, j, i] = part * weight
        parts.append(matrix)
    return parts
