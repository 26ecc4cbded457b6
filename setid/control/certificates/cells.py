"""Proofs over a parameter set that is cut into cells until each of them is proved."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Protocol

import numpy as np

from setid.control.certificates.arcs import Family
from setid.control.parameters.parameter_set import ParameterSet

__all__ = ["Attempt", "Claim", "Outcome", "prove_over_cells"]

_HINTS = 3  # failing frequencies that are looked at first in the parts of a cell


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """Proof on one cell.

    Parameters
    ----------
    proved : bool
    failing : sequence of float
        Frequencies in rad a sample at which the proof failed.
    arcs : sequence of (from, to, bound)
        Bounds of a gain, where the claim is about one.
    family : Family
        What decides along which axis the cell is cut.
    """

    proved: bool
    failing: Sequence[float]
    arcs: Sequence[tuple[float, float, float]]
    family: Family


class Claim(Protocol):
    """A claim that is proved cell by cell."""

    def attempt(
        self, found: ParameterSet, hint: Sequence[float] = (), until: float = inf
    ) -> Attempt:
        """Try to prove it on one cell within a deadline, frequencies of the hint first."""

    def excluded(self, found: ParameterSet) -> bool:
        """Check that an assumption excludes all members of a cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Proof over all cells.

    Parameters
    ----------
    proved : bool
    arcs : tuple of (from, to, bound)
        Of all cells that were proved, or of the first one that was not.
    failing : tuple of float
        Frequencies at which the first unproved cell failed.
    cells : int
        Number of cells that were looked at.
    """

    proved: bool
    arcs: tuple[tuple[float, float, float], ...]
    failing: tuple[float, ...]
    cells: int


def prove_over_cells(found: ParameterSet, claim: Claim, until: float, most: float = inf) -> Outcome:
    """Prove a claim on every cell of a set.

    Parameters
    ----------
    found : ParameterSet
    claim : Claim
    until : float
        Reading of ``time.monotonic`` after which no cell and no arc is cut.
    most : float
        Cells after which none is cut.
    """
    unproved: list[tuple[ParameterSet, Sequence[float]]] = [(found, ())]
    arcs, count = list[tuple[float, float, float]](), 0
    first: Attempt | None = None
    while unproved:
        cell, hint = unproved.pop()
        count += 1
        attempt = claim.attempt(cell, hint, until)
        if attempt.proved:
            arcs += attempt.arcs
            continue
        first = first or attempt
        if claim.excluded(cell):
            continue
        if time.monotonic() > until or count >= most:
            return Outcome(False, tuple(first.arcs), tuple(first.failing), count)
        seen = list(attempt.failing)[:_HINTS]
        unproved += [(half, seen) for half in cell.halves(_axis(cell, attempt))]
    return Outcome(True, tuple(arcs), (), count)


def _axis(cell: ParameterSet, attempt: Attempt) -> int:
    """The coordinate whose width moves the family most at the first failing frequency."""
    family, w = attempt.family, attempt.failing[0]
    step = np.exp(-1j * w * np.arange(family.constants.size))
    slope = step @ family.weights @ cell.rows.basis @ cell.frame.axes
    width = cell.polytope.upper - cell.polytope.lower
    return int(np.argmax(np.abs(slope) * width))
