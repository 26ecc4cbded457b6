"""SeDuMi's form of a conic program: what SparsePOP calls the size and the data of its SDP.

    minimise c'x  subject to  A x = b, x in K;     maximise b'y  subject to  c - A'y in K*.

The moments y are the free variables of the second problem; x holds the multipliers: free
ones, linear ones, then the entries of each semidefinite block column by column.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import Cones, ConicProgram, ConicSolution

__all__ = ["SeDuMi", "dimacs_errors", "full_columns"]

_ROOT2 = float(np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class SeDuMi:
    """The data A (M, N), b (M,), c (N,) and the cone K of a program.

    Parameters
    ----------
    A : csc (M, N)
    b : (M,) float
    c : (N,) float
    K : dict
        ``f`` free and ``l`` linear variables, ``s`` sizes of semidefinite blocks.
    """

    A: sps.csc_array
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    K: dict[str, object]

    @staticmethod
    def of(program: ConicProgram) -> SeDuMi:
        """The same program in SeDuMi's form."""
        spread = full_columns(program.cones)
        cones = program.cones
        K = {"f": cones.zero, "l": cones.nonnegative, "s": np.array(cones.psd, float)}
        A = sps.csc_array((spread @ program.A).T)
        return SeDuMi(A, -program.q, spread @ program.b, K)


def full_columns(cones: Cones) -> sps.csr_array:
    """The matrix (N, R) that writes the triangles of blocks out as full matrices."""
    free = cones.zero + cones.nonnegative
    columns, values, offset = [np.arange(free)], [np.ones(free)], free
    for size, count in _runs(cones):
        j, i = np.tril_indices(size)
        place = np.empty((size, size), int)
        place[i, j] = place[j, i] = np.arange(i.size)
        starts = offset + i.size * np.arange(count)
        columns.append((starts[:, None] + place.ravel()).ravel())
        weight = np.where(np.eye(size, dtype=bool), 1.0, 1.0 / _ROOT2).ravel()
        values.append(np.tile(weight, count))
        offset += i.size * count
    column = np.concatenate(columns)
    entries = (np.concatenate(values), (np.arange(column.size), column))
    return sps.csr_array(entries, shape=(column.size, cones.rows))


def dimacs_errors(program: ConicProgram, solution: ConicSolution) -> NDArray[np.float64]:
    """The six error measures of the seventh DIMACS challenge, shape (6,).

    References
    ----------
    H. D. Mittelmann, An independent benchmarking of SDP and SOCP solvers, Math. Program. 95
    (2003) 407-430.
    """
    q, b, y, z = program.q, program.b, solution.y, solution.z
    s = b - program.A @ y
    zero = program.cones.zero
    size_q, size_b = 1.0 + np.abs(q).max(initial=0.0), 1.0 + np.abs(b).max(initial=0.0)
    value = 1.0 + abs(float(b @ z)) + abs(float(q @ y))
    return np.array(
        [
            float(np.linalg.norm(q + program.A.T @ z)) / size_q,
            max(0.0, -_least(program.cones, z)) / size_q,
            float(np.linalg.norm(s[:zero])) / size_b,
            max(0.0, -_least(program.cones, s)) / size_b,
            float(b @ z + q @ y) / value,
            float(s[zero:] @ z[zero:]) / value,
        ]
    )


def _least(cones: Cones, vector: NDArray[np.float64]) -> float:
    """The least eigenvalue of all blocks and linear entries."""
    least = float(vector[cones.zero : cones.zero + cones.nonnegative].min(initial=np.inf))
    offset = cones.zero + cones.nonnegative
    for size, count in _runs(cones):
        j, i = np.tril_indices(size)
        matrix = np.zeros((count, size, size))
        part = vector[offset : offset + i.size * count].reshape(count, i.size)
        matrix[:, i, j] = matrix[:, j, i] = part * np.where(i == j, 1.0, 1.0 / _ROOT2)
        least = min(least, float(np.linalg.eigvalsh(matrix).min()))
        offset += i.size * count
    return least if np.isfinite(least) else 0.0


def _runs(cones: Cones) -> list[tuple[int, int]]:
    """Sizes of semidefinite blocks, and how many of each follow one another."""
    return [(size, len(list(run))) for size, run in groupby(cones.psd)]
