"""Rows that share uncertain numbers: a problem in the parameters and in these numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.units import InUnits, in_units

__all__ = ["CoupledRows"]


@dataclass(frozen=True, slots=True, eq=False)
class CoupledRows:
    """Rows in parameters and in bounded uncertain numbers that several rows may share.

    Parameters
    ----------
    problem : Problem
        Its first unknowns are the parameters, the others uncertain numbers such as noise
        samples, with their bounds. Its objective does not matter.
    parameters : int
        Number of parameters p.
    rows : (m,) bool
        Constraints that arguments are built on; the others say more, and may be left out.
    sizes : (n,) float
        Sizes of the unknowns, where bounds do not tell them: noise is of the size of what it
        is added to. 0 where nothing is known.
    """

    problem: Problem
    parameters: int
    rows: NDArray[np.bool_]
    sizes: NDArray[np.float64]

    @property
    def constraints(self) -> list[Constraint]:
        """Constraints that arguments are built on."""
        pairs = zip(self.problem.constraints, self.rows.tolist(), strict=True)
        return [row for row, used in pairs if used]

    @property
    def others(self) -> list[Constraint]:
        """All other constraints."""
        pairs = zip(self.problem.constraints, self.rows.tolist(), strict=True)
        return [row for row, used in pairs if not used]

    def in_units(self, problem: Problem) -> InUnits:
        """State a problem in these unknowns, and perhaps more, in ordinary units.

        Parameters
        ----------
        problem : Problem
        """
        return in_units(problem, self.sizes)
