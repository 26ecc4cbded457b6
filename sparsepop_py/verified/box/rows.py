"""The rows that boxes are shrunk by: constraints, what follows from matrices, and cut-offs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.interval import Interval, up
from sparsepop_py.verified.box.propagation import Rows

__all__ = ["box_rows", "with_cutoff"]


def box_rows(problem: Problem, cutoff: float | None) -> Rows:
    """The rows that propagation uses: constraints, and with a cut-off f <= value and squares.

    From f = constant + sum w r^2 follows |r| <= sqrt((value - constant) / w), from a matrix
    G >= 0 that G_ii >= 0 and G_ij^2 <= G_ii G_jj.
    """
    high = [np.where(problem.equality, 0.0, np.inf)]
    low = [np.zeros(len(problem.constraints))]
    polynomials = [c.polynomial for c in problem.constraints]
    if cutoff is not None:
        polynomials.append(problem.objective)
        low.append(np.array([-np.inf]))
        high.append(np.array([cutoff]))
        constant = problem.squares_constant
        if constant is not None:
            room = max(0.0, float(np.nextafter(cutoff - constant, np.inf)))
            weights = np.array([w for w, _ in problem.squares if w > 0])
            radius = up(np.sqrt(up(room / weights)))
            polynomials += [r for w, r in problem.squares if w > 0]
            low.append(-radius)
            high.append(radius)
    diagonal, minors = problem.matrices.propagation()
    minors = minors + len(polynomials)
    polynomials += [p for c in problem.constraints for p in c.entries]
    low.append(np.where(diagonal, 0.0, -np.inf))
    high.append(np.full(diagonal.size, np.inf))
    system = PolynomialSystem.stack(polynomials, problem.dimension)
    return Rows(system, Interval(np.concatenate(low), np.concatenate(high)), minors)


def with_cutoff(problem: Problem, cutoff: float) -> tuple[PolynomialSystem, NDArray[np.bool_]]:
    """Constraints and the row value - f >= 0 behind them, without rounding, and which are equal."""
    rows, objective = problem.rows, problem.objective_row
    width = max(rows.words.shape[1], objective.words.shape[1])
    words = np.concatenate(
        [
            monomials.widen(rows.words, width),
            monomials.widen(objective.words, width),
            np.zeros((1, width), np.int32),
        ]
    )
    values = np.concatenate([rows.coefficients, -objective.coefficients, [cutoff]])
    index = np.concatenate([rows.row, np.full(objective.row.size + 1, rows.size)])
    system = PolynomialSystem(words, values, index, rows.size + 1, problem.dimension)
    return system, np.append(problem.equality, False)
