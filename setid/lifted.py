"""Boxes where rows hold products of parameters: each product is an unknown of its own first.

With several denominators multiplied out, a row is linear in the monomials of theta (a1, b1,
a1*b1, ...). The rows in these monomials bound them as :mod:`setid.boxes` does, those of
degree one are parameters, and the products of their bounds bound the rest of the next round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from .bounds import Bounds, gained
from .boxes import ParameterBox, parameter_box
from .checks import frozen
from .formulation import Formulation
from .regression import Regression

__all__ = ["LiftedBox", "lifted_box", "lifted_rows"]

Reals = NDArray[np.float64]
Monomial = tuple[int, ...]
_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LiftedRows:
    """Regression rows in monomials of theta.

    Parameters
    ----------
    regression : Regression
        Its names are those of the monomials.
    monomials : tuple of tuple of int
        Parameters (from 0) of each column.
    parameters : tuple of str
    """

    regression: Regression
    monomials: tuple[Monomial, ...]
    parameters: tuple[str, ...]

    def start(self, box: Reals) -> Reals:
        """Bounds (2, q) of all monomials on a box (2, p) of theta, rounded outwards."""
        ends = [_product(box[:, list(monomial)]) for monomial in self.monomials]
        return np.array(ends).T

    def shrunk(self, box: Reals, found: ParameterBox) -> Reals:
        """The box of theta after the monomials of degree one are bounded."""
        low, high = box.copy()
        if found.empty:
            return np.array([np.full(low.size, np.inf), np.full(low.size, -np.inf)])
        for column, monomial in enumerate(self.monomials):
            if len(monomial) == 1:
                low[monomial[0]] = max(low[monomial[0]], found.lower[column])
                high[monomial[0]] = min(high[monomial[0]], found.upper[column])
        return np.array([low, high])


def _product(ends: Reals) -> tuple[float, float]:
    """Range of a product over a box (2, d), with 0 * inf = 0."""
    low, high = float(ends[0, 0]), float(ends[1, 0])
    for other in ends[:, 1:].T.tolist():
        corners = [0.0 if 0.0 in (a, b) else a * b for a in (low, high) for b in other]
        low, high = np.nextafter(min(corners), -np.inf), np.nextafter(max(corners), np.inf)
    return float(low), float(high)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LiftedBox(Bounds):
    """A box of theta by rounds of boxes of its monomials; as :class:`ParameterBox` otherwise.

    Parameters
    ----------
    names : tuple of str
    lower, upper : (p,) float
    rounds : tuple of ParameterBox
    """

    rounds: tuple[ParameterBox, ...]

    def verify(self, rows: LiftedRows, start: Reals) -> bool:
        """Replay all rounds from the rows of the data, without any solver."""
        box = start
        for found in self.rounds:
            if not found.verify(rows.regression, rows.start(box)):
                return False
            box = rows.shrunk(box, found)
        return bool(np.all(box[0] >= self.lower) and np.all(box[1] <= self.upper))

    def driving(self, rows: LiftedRows) -> list[tuple[int, int]]:
        """(record, sample) of the rows whose multipliers prove emptiness."""
        return self.rounds[-1].driving(rows.regression)


def lifted_box(rows: LiftedRows, start: Reals) -> LiftedBox:
    """Bound all parameters from rows in their monomials.

    Parameters
    ----------
    rows : LiftedRows
    start : (2, p) float
        Bounds from priors.
    """
    box, rounds = start, list[ParameterBox]()
    for _ in range(_ROUNDS):
        found = parameter_box(rows.regression, rows.start(box))
        rounds.append(found)
        before, box = box, rows.shrunk(box, found)
        if found.empty or not gained(before, box):
            break
    return LiftedBox(rows.parameters, frozen(box[0].copy()), frozen(box[1].copy()), tuple(rounds))


def lifted_rows(formulation: Formulation) -> LiftedRows | None:
    """The equations of a formulation as rows in monomials of theta.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    LiftedRows or None
        None where an unknown other than theta has no finite bounds, or no row is left.
    """
    problem, p = formulation.problem, len(formulation.parameters)
    kept = [
        row
        for row, origin in enumerate(formulation.rows.origin)
        if origin == "model" and problem.constraints[row].kind is sp.Kind.ZERO
    ]
    reach = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    table: list[dict[Monomial, list[float]]] = []
    for row in kept:
        cells = _cells(problem.constraints[row].polynomial, p, reach)
        if cells is None:
            return None
        table.append(cells)
    monomials = sorted({m for cells in table for m in cells if m}, key=lambda m: (len(m), m))
    if not monomials:
        return None
    place = {monomial: column for column, monomial in enumerate(monomials)}
    shape = len(kept), len(monomials)
    target, radius = np.zeros(shape[0]), np.zeros(shape[0])
    regressors, radii = np.zeros(shape), np.zeros(shape)
    for number, cells in enumerate(table):
        for monomial, (value, width) in cells.items():
            if monomial:
                regressors[number, place[monomial]] = value
                radii[number, place[monomial]] = width
            else:
                target[number], radius[number] = value, width
    names = tuple("*".join(formulation.parameters[i] for i in m) for m in monomials)
    rows = formulation.rows
    channel = np.array([int(rows.equation[row].strip("y") or 1) for row in kept], np.int64)
    record, sample = rows.record[kept], rows.sample[kept]
    where = formulation.data.starts[record - 1] + sample - 1
    arrays = (target, regressors, radius, radii, where, record, sample, channel)
    regression = Regression(names, *(frozen(np.array(array)) for array in arrays))
    return LiftedRows(regression, tuple(monomials), formulation.parameters)


def _cells(p: sp.Polynomial, count: int, reach: Reals) -> dict[Monomial, list[float]] | None:
    """For each monomial of theta what is known of its factor: value, and width of the noise."""
    cells: dict[Monomial, list[float]] = {}
    for letters, value in zip(p.words.tolist(), p.coefficients.tolist(), strict=True):
        used = [letter - 1 for letter in letters if letter]
        monomial = tuple(v for v in used if v < count)
        noise = [float(reach[v]) for v in used if v >= count]
        cell = cells.setdefault(monomial, [0.0, 0.0])
        if not noise:
            cell[0] = value  # monomials of a polynomial are distinct
            continue
        width = abs(value)
        for size in noise:
            width = float(np.nextafter(width * size, np.inf))
        if not np.isfinite(width):
            return None
        cell[1] = float(np.nextafter(cell[1] + width, np.inf)) if cell[1] else width
    return cells
