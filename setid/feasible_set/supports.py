"""Proved ranges of linear functions over the feasible set: multipliers by linear programs."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.feasible_set.feasible_set import FeasibleSet
from setid.proofs import supports as proved
from setid.proofs.supports import Cover
from sparsepop_py.lp.scaled import solve_scaled

__all__ = ["Proposer", "cover_of", "supports"]

Reals = NDArray[np.float64]


def cover_of(result: FeasibleSet) -> Cover:
    """Box and rows in theta alone that follow from a result.

    Parameters
    ----------
    result : FeasibleSet

    Returns
    -------
    Cover

    Raises
    ------
    SetidError
        If the feasible set is empty.

    Examples
    --------
    >>> import setid
    >>> from setid.feasible_set.supports import cover_of, supports
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> supports(cover_of(result), [[1.0, 0.0]]).round(5)
    array([[-0.52326, -0.34533]])
    """
    result.require_members()
    return proved.cover(result.formulation, *result.outer_box)


def supports(cover: Cover, directions: NDArray[Any] | list[list[float]]) -> Reals:
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
    """
    return proved.supports(cover, directions, Proposer)


class Proposer:
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
        solution = solve_scaled(self._cost, none, (self._sparse, goal), bounds)
        if solution.status != "solved":  # an unbounded dual: rows are (nearly) contradictory
            return np.zeros(self._cost.size)
        found = solution.x
        basis = np.flatnonzero(found > 1e-12)
        if basis.size == goal.size:
            block = self._columns[:, basis]
            if np.linalg.cond(block) < 1e10:
                self._bases.append((basis, np.linalg.inv(block)))
        return found
