"""Symbolic analysis of a program's pattern: layout of blocks, fronts, index maps.

Every semidefinite block, linear row and equality row couples the moments it holds, so the
matrix of the Newton system is a union of cliques. These are eliminated along a tree of
fronts (multifrontal method). All work of a solve is then done on dense arrays whose places
are found here, once for every program of the same pattern.

References
----------
J. W. H. Liu, The multifrontal method for sparse matrix solution, SIAM Review 34, 1992.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.solvers.cliquetree.symbolic.assembly import (
    Assembly,
    BlockPairs,
    RowPairs,
    block_pairs,
    row_pairs,
    stacked,
)
from sparsepop_py.solvers.cliquetree.symbolic.elimination import amalgamate, eliminate, maximal
from sparsepop_py.solvers.cliquetree.symbolic.fronts import Fronts, line_up
from sparsepop_py.solvers.cliquetree.symbolic.layout import Layout, lay_out
from sparsepop_py.solvers.cliquetree.symbolic.tree import Tree, plant

__all__ = ["Symbolic", "analyse", "numpy_seconds", "pattern_key"]

Indices = NDArray[np.int64]
_SHALLOW, _LEAN = 2.0, 1.5  # slack of elimination orders for stacks and for single fronts
_ITERATIONS = 20  # of a usual solve


@dataclass(frozen=True, slots=True, eq=False)
class Symbolic:
    """Everything that a solve needs to know of the pattern.

    Parameters
    ----------
    key : bytes
        Digest of the pattern; programs with the same key share this object.
    moments : int
    layout : Layout
    assemblies : tuple of Assembly or of BlockPairs
    zero, linear : RowPairs
    tree : Tree or Fronts
        Stacks of equal fronts for numpy, single fronts for compiled kernels.
    """

    key: bytes
    moments: int
    layout: Layout
    assemblies: tuple[Assembly | BlockPairs, ...]
    zero: RowPairs
    linear: RowPairs
    tree: Tree | Fronts

    @property
    def compiled(self) -> bool:
        """True if this is for the compiled kernels."""
        return isinstance(self.tree, Fronts)


def pattern_key(program: ConicProgram) -> bytes:
    """Compute a digest of the pattern of A and of the cones."""
    digest = hashlib.blake2b(digest_size=16)
    cones = program.cones
    digest.update(repr((program.A.shape, cones.zero, cones.nonnegative, cones.psd)).encode())
    digest.update(np.ascontiguousarray(program.A.indptr, np.int64).tobytes())
    digest.update(np.ascontiguousarray(program.A.indices, np.int64).tobytes())
    return digest.digest()


def numpy_seconds(program: ConicProgram) -> float:
    """Estimate seconds of a solve without compiled kernels: calls, entries, assembly of blocks."""
    sizes = np.array(program.cones.psd, float)
    entries, products = float((sizes**2).sum()), float((sizes**4).sum())
    return _ITERATIONS * (2e-3 + 4e-7 * (entries + program.A.nnz) + 2.5e-9 * products)


def analyse(program: ConicProgram, compiled: bool = False) -> Symbolic:
    """Find fronts and index maps of a program, which serve all programs of its pattern.

    Parameters
    ----------
    program : ConicProgram
        Only the pattern of A and the cones are read.
    compiled : bool
        Whether for the compiled kernels.
    """
    moments = program.q.size
    row = program.A.indices.astype(np.int64)
    column = np.repeat(np.arange(moments), np.diff(program.A.indptr))
    layout = lay_out(program.cones, row, column, compiled)
    keys, local = np.unique(layout.block[row] * max(moments, 1) + column, return_inverse=True)
    owner, member = np.divmod(keys, max(moments, 1))
    first = np.searchsorted(owner, np.arange(int(layout.block.max(initial=-1)) + 2))
    tree = _tree(member, first, moments, compiled)
    spot = tree.locate(owner, member, first)
    assemblies: tuple[Assembly | BlockPairs, ...]
    if isinstance(tree, Fronts):
        order = np.lexsort((_rank(row, column, local), owner))
        turned = np.empty(order.size, np.int64)
        turned[order] = np.arange(order.size)
        spot, local = spot[order], turned[local] - first[layout.block[row]]
        assemblies = block_pairs(layout, first, spot, local, tree)
    else:
        local = local - first[layout.block[row]]
        assemblies = tuple(stacked(layout, first, spot, local, tree))
    lines = row_pairs(program.cones, row, first, spot, local, tree)
    return Symbolic(pattern_key(program), moments, layout, assemblies, *lines, tree)


def _rank(row: Indices, column: Indices, key: Indices) -> Indices:
    """Rank the moments of each block by number of nonzeros, then first nonzero.

    So moments of blocks side by side correspond, and loops over nonzeros are of equal length.
    """
    by_rows = np.lexsort((column, row))
    first = np.empty(int(key.max(initial=-1)) + 1, np.int64)
    first[key[by_rows[::-1]]] = np.arange(by_rows.size)[::-1]  # the first one is written last
    rank = np.empty_like(first)
    rank[np.lexsort((first, np.bincount(key)))] = np.arange(first.size)
    return rank


def _tree(member: Indices, first: Indices, moments: int, compiled: bool) -> Tree | Fronts:
    """Build the elimination tree of the cliques."""
    cliques = [member[a:b] for a, b in zip(first, first[1:], strict=False)]
    order = eliminate(maximal(cliques, moments), moments, _LEAN if compiled else _SHALLOW)
    fronts = amalgamate(order, moments)
    return line_up(fronts, moments) if compiled else plant(fronts, moments)
