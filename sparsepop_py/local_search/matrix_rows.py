"""Matrix constraints as polynomial rows, for local searches without matrices.

A second-order cone is f1 >= 0 and f1^2 >= f2^2 + ... + fk^2; a matrix of two rows has its
diagonal and its determinant. A larger one is G = R R' with further variables, the entries of a
lower triangle R, which loses nothing and has no gradient that vanishes where G has rank one less
(Burer and Monteiro). Of large ones only the diagonal enters: points come from the moments of a
relaxation there. Nothing here is proved: candidates are checked against the matrices.

References
----------
S. Burer, R. D. C. Monteiro, A nonlinear programming algorithm for solving semidefinite
programs via low-rank factorization, Math. Programming 95, 2003.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial, total, variables
from sparsepop_py.problem.problem import Problem

__all__ = ["RowForm"]

_LARGEST = 10  # rows of a matrix that gets a factor
_USUAL = 500  # powers of two: coefficients whose squares are far from the ends of doubles


@dataclass(frozen=True, eq=False)
class RowForm:
    """Problem without matrices that stands for one with them.

    Parameters
    ----------
    given : Problem
    problem : Problem
        In the variables of ``given`` and, behind these, those of the factors R.
    factored : tuple of int
        The constraints of ``given`` with a factor, in the order of its variables.
    """

    given: Problem
    problem: Problem
    factored: tuple[int, ...] = ()

    @staticmethod
    def of(problem: Problem) -> RowForm:
        """Convert a problem; one without matrices stays as it is."""
        matrices, n = problem.matrices, problem.dimension
        if not matrices.constraints.size:
            return RowForm(problem, problem)
        side = np.where(matrices.second_order, 0, matrices.side)
        factored = tuple(np.flatnonzero((side > 2) & (side <= _LARGEST)).tolist())
        size = sum(int(matrices.side[k]) * (int(matrices.side[k]) + 1) // 2 for k in factored)
        extra = iter(variables(n + size)[n:])
        rows: list[Constraint] = []
        for number, c in enumerate(problem.constraints):
            entries = [p.within(n + size) for p in c.entries]
            if not entries:
                rows.append(Constraint(c.polynomial.within(n + size), c.kind))
            elif c.kind is Kind.SECOND_ORDER:
                entries = _near_one(entries)
                rows += [entries[0] >= 0, entries[0] ** 2 - total(f * f for f in entries[1:]) >= 0]
            elif c.side > _LARGEST:
                rows += [entries[c.position(i, i) or 0] >= 0 for i in range(c.side)]
            elif number not in factored:
                a, b, d = _near_one(entries)
                rows += [a >= 0, d >= 0, a * d - b * b >= 0]
            else:
                factor = [[next(extra) for _ in range(i + 1)] for i in range(c.side)]
                for i in range(c.side):
                    for j in range(i + 1):
                        parts = [-(a * b) for a, b in zip(factor[i], factor[j], strict=False)]
                        rows.append(total([entries[c.position(i, j) or 0], *parts]) == 0)
        free = np.full(size, np.inf)
        low, high = np.append(problem.lower, -free), np.append(problem.upper, free)
        return RowForm(
            problem, Problem(problem.objective.within(n + size), rows, low, high), factored
        )

    def start(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Extend a vector (n,) of the given problem to all variables."""
        parts = [x]
        for k in self.factored:
            layout = self.given.matrices.layout(k)
            try:
                size, vectors = np.linalg.eigh(self.given.matrices.system.values(x)[layout])
            except np.linalg.LinAlgError:  # entries near the largest double
                size, vectors = np.zeros(len(layout)), np.eye(len(layout))
            root = vectors * np.sqrt(np.maximum(size, 0.0))
            triangle = np.linalg.qr(root.T)[1].T
            parts.append(triangle[np.tril_indices(layout.shape[0])])
        return np.concatenate(parts)

    def point(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variables of the given problem, shape (n,)."""
        return x[: self.given.dimension]


def _near_one(entries: list[Polynomial]) -> list[Polynomial]:
    """Scale huge and tiny entries by a power of two: products stay doubles."""
    largest = max(float(np.abs(p.coefficients).max(initial=0.0)) for p in entries)
    power = int(np.frexp(largest)[1])
    if abs(power) < _USUAL:
        return entries
    return [math.ldexp(1.0, -max(power, -1000)) * p for p in entries]
