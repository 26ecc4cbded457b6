"""Multipliers for many directions over one polytope, from simplex bases that are kept.

A basis that is optimal for one direction is optimal for every direction for which its multipliers
are not negative. So few of many programs are solved, each from the basis of the one before, and all
directions of a basis are served by one product of matrices. A program has the rows that bind
somewhere, few of those of a long record: what a solution violates is added. Nothing proved rests on
any of it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.proofs.supports import HalfSpaces, Proposal
from sparsepop_py.lp.highs import LinearModel

__all__ = ["Proposer"]

Reals = NDArray[np.float64]
Rows = NDArray[np.int64]
_LARGEST_CONDITION = 1e12  # of bases that are kept
_KEPT = 400  # bases
_NEAR = 1e-8  # of the box: how far beyond a row the vertex of a basis may lie
_VIOLATED = 1e-9  # of the box: rows that are violated by more are added to a program
_TOGETHER = 2  # rows a parameter that are added at once
_TINY = 1e-300


class _Directions:
    """Directions (K, p) that wait for multipliers, in units of the box and with entries up to 1."""

    def __init__(self, directions: Reals) -> None:
        sizes = np.abs(directions).max(axis=1, initial=0.0)
        self.places = np.flatnonzero((sizes > 0.0) & np.isfinite(sizes))
        self.sizes = sizes[self.places]
        self.goals = np.ascontiguousarray((directions[self.places] / self.sizes[:, None]).T)
        self.open = np.full(self.places.size, True)
        self.left = self.places.size

    @property
    def first(self) -> int:
        """Column of the first one that waits."""
        return int(np.argmax(self.open))

    def take(self, columns: int | NDArray[np.bool_]) -> None:
        """Take some out; columns are moved together when half of them are gone."""
        self.open[columns] = False
        self.left = int(np.count_nonzero(self.open))
        if self.left < self.open.size / 2:
            self.places, self.sizes = self.places[self.open], self.sizes[self.open]
            self.goals = np.ascontiguousarray(self.goals[:, self.open])
            self.open = np.full(self.left, True)


class Proposer:
    """Source of multipliers for the rows of one polytope, by linear programs.

    The polytope is taken in coordinates in which its box is [-1, 1] and its rows have norm 1.

    Parameters
    ----------
    spaces : HalfSpaces
        With a finite box.
    seeds : sequence of (p,) int
        Bases to begin with, such as those of a polytope with the same rows and other right sides;
        see :attr:`bases`. Those whose vertex lies outside are left out.
    until : float
        Reading of ``time.monotonic`` after which no program is begun.

    Examples
    --------
    >>> import numpy as np
    >>> from setid.feasible_set.proposer import Proposer
    >>> from setid.proofs.supports import Cover
    >>> ends, rows = (np.zeros(2), np.ones(2)), (np.array([[1.0, 1.0]]), np.ones(1))
    >>> triangle = Cover(("x", "y"), *ends, *rows, True)
    >>> [found] = Proposer(triangle).multipliers(np.array([[2.0, 1.0]]))
    >>> found.rows.tolist(), found.weights.tolist()
    ([0], [[1.0]])
    """

    def __init__(self, spaces: HalfSpaces, seeds: Sequence[Rows] = (), until: float = inf) -> None:
        self._until = until
        self._unit = np.maximum(spaces.upper / 2 - spaces.lower / 2, _TINY)
        self._middle = np.asarray(spaces.lower / 2 + spaces.upper / 2, np.float64)
        scaled = spaces.matrix * self._unit
        self._norm = np.maximum(np.abs(scaled).max(axis=1, initial=0.0), _TINY)
        self._table = scaled / self._norm[:, None]
        self._room = (spaces.right - spaces.matrix @ self._middle) / self._norm
        p = self._unit.size
        eye = np.eye(p)
        self._sides = np.concatenate([self._table, eye, -eye])
        self._ends = np.concatenate([self._room, np.ones(2 * p)])
        self._program: LinearModel | None = None
        self._known = np.zeros(0, np.int64)  # rows of the program
        self._inverses: list[Reals] = []
        self.bases: list[Rows] = []
        """Rows of each basis: m rows, then p upper and p lower sides of the box."""
        self.contradictory = False
        """True after a program found no point that satisfies all rows."""
        self.late = 0
        """Number of directions for which there was no time."""
        for rows in seeds:
            self._keep(rows, check=True)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the warm linear program, which is no data; copies make one of their own."""
        return self.__dict__ | {"_program": None}

    @property
    def points(self) -> Reals:
        """Vertices (M, p) on which the bases rest, in doubles."""
        found = [inv @ self._ends[b] for b, inv in zip(self.bases, self._inverses, strict=True)]
        return self._middle + self._unit * np.reshape(found, (-1, self._unit.size))

    @property
    def program_rows(self) -> int:
        """Number of rows in the linear program so far."""
        return self._known.size

    def multipliers(self, directions: Reals) -> Iterator[Proposal]:
        """Propose multipliers for the largest values of directions (K, p) times x."""
        waiting = _Directions(directions * self._unit)
        for place in range(len(self.bases)):
            yield from self._served(place, waiting)
        while waiting.left and self._norm.size and not self.contradictory:
            if time.monotonic() > self._until:
                self.late += waiting.left
                return
            first = waiting.first
            if self._solved(waiting.goals[:, first]):
                yield from self._served(len(self.bases) - 1, waiting, first)
            else:
                waiting.take(first)

    def contradiction(self) -> Reals | None:
        """Propose multipliers (m,) that prove that there is no point.

        They are prices of the least t with matrix x - t <= right, in units of the box.
        """
        m, p = self._table.shape
        table = sps.csr_array(np.column_stack([self._table, -np.ones(m)]))
        ends = np.append(np.full(p, -1.0), 0.0), np.append(np.ones(p), np.inf)
        model = LinearModel(table, (np.full(m, -np.inf), self._room), ends)
        found = model.solve(np.append(np.zeros(p), 1.0))
        if found.status != "solved":
            return None
        return np.asarray(np.maximum(-found.dual, 0.0) / self._norm, np.float64)

    # ---- bases --------------------------------------------------------------------------

    def _served(
        self, place: int, waiting: _Directions, sure: int | None = None
    ) -> Iterator[Proposal]:
        """Yield multipliers for all waiting directions for which a basis is optimal."""
        weights = self._inverses[place].T @ waiting.goals
        least = weights.min(axis=0, initial=0.0)
        fits = least >= -1e-11 * np.maximum(weights.max(axis=0, initial=0.0), -least)
        if sure is not None:
            fits[sure] = True
        fits &= waiting.open
        if np.any(fits):
            rows = self.bases[place]
            mine = rows < self._norm.size  # the box takes what its sides leave
            found = weights[mine][:, fits] * waiting.sizes[fits] / self._norm[rows[mine]][:, None]
            yield Proposal(waiting.places[fits], rows[mine], found.T)
            waiting.take(fits)

    def _solved(self, goal: Reals) -> bool:
        """Solve for one direction; whether that added a basis."""
        m, p = self._table.shape
        if self._program is None:
            self._known = _begun(self.bases, m)
            sides = np.full(p, -1.0), np.full(p, 1.0)
            below = np.full(self._known.size, -np.inf), self._room[self._known]
            self._program = LinearModel(sps.csr_array(self._table[self._known]), below, sides)
        while (found := self._program.solve(-goal)).status == "solved":
            missed = self._missed(found.x)
            if not missed.size:
                break
            self._known = np.append(self._known, missed)
            self._program.add(self._table[missed], self._room[missed])
        if found.status != "solved":
            self.contradictory = found.status == "infeasible"
            return False
        rows, columns = self._program.active()
        upper = found.x[columns] > 0.0
        rows = self._known[rows]
        return self._keep(np.concatenate([rows, m + columns + np.where(upper, 0, p)]))

    def _missed(self, x: Reals) -> Rows:
        """Choose rows that a point (p,) violates, those it violates most."""
        beyond = self._table @ x - self._room
        beyond[self._known] = -np.inf
        missed = np.flatnonzero(beyond > _VIOLATED)
        most = _TOGETHER * self._unit.size
        if missed.size > most:
            missed = missed[np.argpartition(-beyond[missed], most)[:most]]
        return missed

    def _keep(self, rows: Rows, check: bool = False) -> bool:
        """Add a basis; False where it is none or its vertex is to be looked at and is outside."""
        block = self._sides[rows]
        if rows.size != self._unit.size or not np.linalg.cond(block) < _LARGEST_CONDITION:
            return False
        inverse = np.linalg.inv(block)
        if check and np.any(self._sides @ (inverse @ self._ends[rows]) > self._ends + _NEAR):
            return False
        if len(self.bases) >= _KEPT:
            del self.bases[0], self._inverses[0]
        self.bases.append(rows)
        self._inverses.append(inverse)
        return True


def _begun(bases: Sequence[Rows], count: int) -> Rows:
    """List the rows, of so many, on which bases rest."""
    rows = np.unique(np.concatenate([*bases, np.zeros(0, np.int64)]))
    return rows[rows < count]
