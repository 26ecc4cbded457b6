"""Merge semidefinite blocks that are alike, so that long chains get small programs.

A sum of the same terms over many windows of variables gives many blocks of multipliers, and
equations that differ in names alone. Two blocks are alike where their entries stand in alike
equations. Two equations are alike where alike entries of blocks stand in them with the same
coefficients, and their right-hand sides are the same. Kinds of blocks begin with their sizes, and
each round parts the kinds by what stands beside them: after one round the first and the last block
of a chain have kinds of their own, after two their neighbours as well. Alike blocks are then
required to be the same matrix,

    minimise  b'z   subject to   A'z = -q,   z in K,   z = small[row],

and one equation of each kind is left. Each solution of this program is one of the program as it
stands. It may have none where that one has some: a chain whose first and last term are needed to
make it a sum of squares.

References
----------
M. Grohe, K. Kersting, M. Mladenov, E. Selman, Dimension reduction via colour refinement,
European Symposium on Algorithms 2014, LNCS 8737, 505-516: there rounds go on until no kind is
parted any more, and no solution is lost.
G. L. Steele, D. Lea, C. H. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014:
the function that mixes numbers of kinds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import Cones, ConicProgram

__all__ = ["MergedProgram", "merge_alike_blocks"]

Kinds = NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class MergedProgram:
    """Conic program with one block of each kind.

    Parameters
    ----------
    program : ConicProgram
    row : (R,) int
        For each row of the program that was merged, its row here. So ``z[row]`` are multipliers of
        that program, for multipliers ``z`` of this one.
    """

    program: ConicProgram
    row: NDArray[np.int64]


def merge_alike_blocks(
    program: ConicProgram, share: float, rounds: int = 1
) -> MergedProgram | None:
    """Merge blocks that are alike after some rounds, None where too many rows are left.

    The objective counts each kind of block once, however many blocks are of that kind.

    Parameters
    ----------
    program : ConicProgram
    share : float
        Most rows that may be left, as a share of the rows of the program.
    rounds : int
        How often kinds are parted. More rounds keep more blocks apart, those near the ends of
        chains first.

    Returns
    -------
    MergedProgram or None
        None also where the program has rows that belong to no semidefinite block.
    """
    sizes = np.array(program.cones.psd, np.int64)
    if program.cones.zero or program.cones.nonnegative or not sizes.size:
        return None
    each = sizes * (sizes + 1) // 2
    block = np.repeat(np.arange(sizes.size), each)
    place = np.arange(block.size) - (np.cumsum(each) - each)[block]
    matrix = program.A.tocoo()
    kinds = _kinds_of_blocks(program, matrix, block, place, rounds)
    _, first, kind = np.unique(kinds, return_index=True, return_inverse=True)
    kept = each[first]
    if kept.sum() > share * block.size:
        return None
    row = (np.cumsum(kept) - kept)[kind][block] + place
    entries = _mixed(row.astype(np.uint64)[matrix.row], _bits(matrix.data))
    equations = _mixed(_bits(program.q), _sums(entries, matrix.col, program.q.size))
    _, columns = np.unique(equations, return_index=True)
    sums = sps.csc_array((np.ones(row.size), (row, np.arange(row.size))), (kept.sum(), row.size))
    right = np.zeros(kept.sum())
    right[row] = program.b
    cones = Cones(0, 0, tuple(sizes[first].tolist()))
    left = sps.csc_array(sums @ program.A[:, columns])
    return MergedProgram(ConicProgram(program.q[columns], left, right, cones, program.offset), row)


def _kinds_of_blocks(
    program: ConicProgram,
    matrix: Any,
    block: NDArray[np.int64],
    place: NDArray[np.int64],
    rounds: int,
) -> Kinds:
    """Number the kinds of blocks; alike ones have the same number."""
    sizes = np.array(program.cones.psd, np.uint64)
    at, weight = place.astype(np.uint64), _bits(matrix.data)
    kinds, rows, columns = sizes, _mixed(at, sizes[block], _bits(program.b)), _bits(program.q)
    for _ in range(rounds):
        entries = _mixed(rows[matrix.row], weight)
        columns = _mixed(columns, _sums(entries, matrix.col, columns.size))
        entries = _mixed(columns[matrix.col], weight)
        rows = _mixed(rows, at, _sums(entries, matrix.row, rows.size))
        kinds = _sums(rows, block, sizes.size)
        rows = _mixed(at, kinds[block])
    return kinds


def _bits(values: NDArray[np.float64]) -> Kinds:
    """Return the bits of numbers, the same for both zeros."""
    return np.asarray(values + 0.0, np.float64).view(np.uint64)


def _sums(values: Kinds, index: NDArray[Any], size: int) -> Kinds:
    """Sum the values of each index modulo 2^64, whatever their order."""
    found = np.zeros(size, np.uint64)
    np.add.at(found, index, values)
    return found


def _mixed(*parts: Kinds) -> Kinds:
    """Mix numbers of 64 bits into one, which depends on their order."""
    mixed = np.zeros(1, np.uint64)
    for part in parts:
        mixed = (mixed ^ part) + np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed = mixed ^ (mixed >> np.uint64(31))
    return mixed
