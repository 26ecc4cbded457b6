"""Proved ranges of many linear functions over a polytope, from bases that are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from setid.control.engine import frozen
from setid.feasible_set.proposer import Proposer
from setid.proofs.supports import safe_maxima

__all__ = ["Polytope"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """The points x with lower <= x <= upper and matrix x <= right.

    Parameters
    ----------
    lower, upper : (p,) float
        Finite.
    matrix, right : (m, p), (m,) float
        Exactly as they are: rounding belongs into ``right``.

    Examples
    --------
    >>> import numpy as np
    >>> from setid.control.parameters.polytope import Polytope
    >>> triangle = Polytope(np.zeros(2), np.ones(2), np.array([[1.0, 1.0]]), np.ones(1))
    >>> low, high = triangle.ranges(np.array([[1.0, 2.0]]))
    >>> float(round(low[0], 9) + 0.0), float(round(high[0], 9))
    (0.0, 2.0)
    """

    lower: Reals
    upper: Reals
    matrix: Reals
    right: Reals
    _sources: list[Proposer] = field(default_factory=list, repr=False)  # one, when it is asked

    @property
    def magnitude(self) -> Reals:
        """Largest absolute value of each coordinate, (p,)."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    @property
    def centre(self) -> Reals:
        """Middle of the box, (p,)."""
        return np.asarray(self.lower / 2 + self.upper / 2, np.float64)

    def with_rows(self, matrix: Reals, right: Reals) -> Polytope:
        """Add rows: the part of the polytope in which they hold."""
        rows = np.concatenate([self.matrix, matrix]), np.concatenate([self.right, right])
        return Polytope(self.lower, self.upper, *rows)

    def within(self, lower: Reals, upper: Reals) -> Polytope:
        """Take the part of the polytope in a box."""
        ends = np.maximum(self.lower, lower), np.minimum(self.upper, upper)
        return Polytope(*ends, self.matrix, self.right)

    def essential(self) -> Polytope:
        """Keep the box and the rows active at some optimum; it contains this polytope."""
        m = self.right.size
        used = [rows[rows < m] for rows in self._source.bases]
        kept = np.unique(np.concatenate(used)) if used else np.zeros(0, np.int64)
        return Polytope(self.lower, self.upper, self.matrix[kept], self.right[kept])

    def ranges(self, directions: Reals) -> tuple[Reals, Reals]:
        """Bound linear functions from both sides.

        Parameters
        ----------
        directions : (K, p) float

        Returns
        -------
        lower, upper : (K,) float
            They cross where the polytope is proved empty.

        References
        ----------
        A. Neumaier, O. Shcherbina, "Safe bounds in linear and mixed-integer linear
        programming", Mathematical Programming 99 (2004) 283-296, section 2.
        """
        both = self.maxima(np.concatenate([directions, -directions]))
        return -both[len(directions) :], both[: len(directions)]

    def maxima(self, directions: Reals) -> Reals:
        """Bound directions (K, p) times x from above, with proof."""
        wanted = np.asarray(directions, float)
        found = safe_maxima(self, wanted, np.zeros(0, np.int64), np.zeros((len(wanted), 0)))
        if self.right.size:
            for places, rows, weights in self._source.multipliers(wanted):
                better = safe_maxima(self, wanted[places], rows, weights)
                found[places] = np.fmin(found[places], better)
        return found

    def proved_empty(self) -> bool:
        """Prove by weak duality that no point is in the polytope."""
        if np.any(self.lower > self.upper):
            return True
        if not self.right.size:
            return False
        self.maxima(np.eye(self.lower.size)[:1])
        if not self._source.contradictory:
            return False
        weights = self._source.contradiction()
        if weights is None:
            return False
        every, nothing = np.arange(self.right.size), np.zeros((1, self.lower.size))
        return bool(safe_maxima(self, nothing, every, weights[None, :])[0] < 0.0)

    @property
    def _source(self) -> Proposer:
        if not self._sources:
            self._sources.append(Proposer(self))
        return self._sources[0]


def box_of(lower: Reals, upper: Reals) -> Polytope:
    """Make a box a polytope without rows."""
    p = lower.size
    return Polytope(frozen(lower.copy()), frozen(upper.copy()), np.zeros((0, p)), np.zeros(0))
