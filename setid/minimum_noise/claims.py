"""Put together what a search for the least output noise found, and its proof."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.proofs.denominators.denominator_cells import Cell, DenominatorCells, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows
from setid.proofs.denominators.varying_multipliers import VaryingCells

__all__ = ["FoundDenominators", "claimed", "with_better"]

Reals = NDArray[np.float64]
_LOSSES = (1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 5e-2)  # of a factor: what may be left to rounding
_OVER = 1.0 + 1e-12
_KEPT = 5  # of the best denominators


@dataclass(frozen=True, slots=True, eq=False)
class FoundDenominators:
    """A proved factor on the noise bounds, and denominators near the least one.

    Parameters
    ----------
    factor : float
        Refuted; 0 for none.
    cells : DenominatorCells or None
        What refutes it.
    best : tuple of (n,) float
        Coefficients a_1, ..., a_n that need little noise, the best one first.
    """

    factor: float
    cells: DenominatorCells | None
    best: tuple[Reals, ...]


def with_better(best: Sequence[Reals], found: Reals) -> list[Reals]:
    """Put a denominator that needs less noise before the best ones so far, of which few are kept.

    Parameters
    ----------
    best : sequence of (n,) float
        Coefficients a_1, ..., a_n.
    found : (n + 1,) float
        With a_0 = 1.
    """
    return [found[1:], *best[: _KEPT - 1]]


def claimed(
    rows: OutputRows,
    claim: DenominatorCells,
    multiplier: Callable[[int], Reals],
    proved: Sequence[float],
    best: Sequence[Reals],
) -> FoundDenominators:
    """State what a tree of cells refutes, with the multipliers that its leaves use.

    Parameters
    ----------
    rows : OutputRows
    claim : DenominatorCells
        Without multipliers, and with its free samples among those of the rows.
    multiplier : callable
        From the number of a multiplier to itself, (S,).
    proved : sequence of float
        The factor that each cell refutes, before rounding.
    best : sequence of (n,) float
    """
    leaves = [n for n, cell in enumerate(claim.cells) if not _is_split(cell)]
    factor = min(proved[number] for number in leaves)
    nothing = FoundDenominators(0.0, None, tuple(best))
    if not 0.0 < factor < np.inf:
        return nothing
    numbers = sorted({m for n in leaves for m in np.ravel(claim.cells[n].used).tolist()})
    place = {m: i for i, m in enumerate(numbers)}
    cells = tuple(_renumbered(cell, place) for cell in claim.cells)
    kind = VaryingCells if isinstance(claim, VaryingCells) else DenominatorCells
    table = np.array([multiplier(m)[rows.inside] for m in numbers])
    proof = kind(claim.output, rows.numbers(claim.free), table, cells)
    for loss in _LOSSES:
        least = factor * (1.0 - loss)
        if proof.follows(rows._replace(bound=rows.bound * (least * _OVER))):
            return FoundDenominators(least, proof, tuple(best))
    return nothing


def _is_split(cell: Cell | VaryingLeaf) -> bool:
    return isinstance(cell, Cell) and bool(cell.children)


def _renumbered(cell: Cell | VaryingLeaf, place: dict[int, int]) -> Cell | VaryingLeaf:
    if isinstance(cell, VaryingLeaf):
        return cell._replace(used=tuple(tuple(place[m] for m in family) for family in cell.used))
    return cell if cell.children else cell._replace(used=tuple(place[m] for m in cell.used))
