"""Vectors near the ends of intervals where rows of data are linear in the parameters.

A prior such as stability may add unknowns and products to such rows. Without it the ends are
solutions of linear programs. Those that satisfy the prior are ends with it, too.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.feasible_points.witness import least_noise
from setid.formulation.formulation import Formulation
from sparsepop_py.lp.scaled import solve_scaled

__all__ = ["linear_ends"]

_INSIDE = 1e-6  # of the way to a vector with room in all rows


def linear_ends(formulation: Formulation) -> list[NDArray[np.float64]]:
    """Find vectors (n,) near the lower and upper end of each parameter, all unknowns included.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    list of (n,) float
        The lower and upper end of each parameter, in turn, without rows of priors that are not
        linear. Empty where there are no such rows, the others do not bound all parameters, or
        those of the model are not linear.

    Examples
    --------
    >>> import setid
    >>> u = [1.0, 2.0, -1.0, 2.0, 1.0, -2.0, 0.0, 1.0]
    >>> model, noise = setid.TransferFunction(na=3, nb=1), setid.Noise(equation=0.5)
    >>> data = setid.simulate_record(model, [-0.5, 0.0, 0.1, 1.0], u, noise).data
    >>> len(linear_ends(setid.formulate(data, model, noise, setid.Stable())))
    8
    >>> len(linear_ends(setid.formulate(data, model, noise)))  # linear programs settle it
    0
    """
    problem, size = formulation.problem, len(formulation.parameters)
    words = problem.rows.words
    plain = (np.count_nonzero(words, axis=1) <= 1) & (words.max(axis=1, initial=0) <= size)
    linear = np.ones(len(problem.constraints), bool)
    linear[problem.rows.row[~plain]] = False
    if np.all(linear) or any(
        origin == "model" and not kept
        for origin, kept in zip(formulation.rows.origin, linear.tolist(), strict=True)
    ):
        return []
    rows = _matrix(problem)[linear], problem.equality[linear]
    low, high = problem.lower[:size], problem.upper[:size]
    inner, *ends = _solved(rows, low, high)
    found = []
    for end in ends:
        if inner is None or end is None:
            return []
        near = np.clip(end + _INSIDE * (inner - end), low, high)
        found.append(least_noise(formulation, near).x)
    return found


def _matrix(problem: sp.Problem) -> sps.csr_array:
    """Write the coefficients of linear rows (m, 1 + n), the constant first."""
    system = problem.rows
    places = system.row, system.words.max(axis=1, initial=0)
    shape = len(problem.constraints), 1 + problem.dimension
    return sps.csr_array((system.coefficients, places), shape=shape)


def _solved(
    rows: tuple[sps.csr_array, NDArray[np.bool_]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> Iterator[NDArray[np.float64] | None]:
    """Yield parameters (p,) with room in all rows, then those of each end."""
    matrix, equal = rows
    constant, slopes = matrix[:, [0]].toarray()[:, 0], matrix[:, 1 : low.size + 1]
    with_room = sps.csr_array(sps.hstack([slopes, -1.0 * ~equal[:, None]]))
    below = -with_room[~equal], constant[~equal]
    level = with_room[equal], -constant[equal]
    room, *units = np.eye(low.size + 1)[::-1]
    for cost in (-room, *(sign * unit for unit in units[::-1] for sign in (1.0, -1.0))):
        most = np.inf if cost[-1] else 0.0  # room, where it is asked for
        found = solve_scaled(cost, below, level, (np.append(low, 0.0), np.append(high, most)))
        yield found.x[:-1] if found.status == "solved" else None
