"""A program's numbers in the places that the symbolic phase found, scaled.

Rows are scaled to a largest coefficient of one (a semidefinite block as a whole), the
objective likewise; multipliers are scaled back at the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.solvers.cliquetree.iterations.cone import CompiledCone, Cone
from sparsepop_py.solvers.cliquetree.kernels.batched import Workers
from sparsepop_py.solvers.cliquetree.symbolic.analysis import Symbolic
from sparsepop_py.solvers.cliquetree.symbolic.assembly import BlockPairs, PairProduct, StackProduct
from sparsepop_py.solvers.cliquetree.symbolic.fronts import FrontFactor, Fronts
from sparsepop_py.solvers.cliquetree.symbolic.tree import Factor

__all__ = ["Numbers"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """min q'y with c - C y in the cone and E y = e.

    Parameters
    ----------
    symbolic : Symbolic
    cone : Cone
    q : (M,) float
        Divided by ``unit``.
    unit : float
    offset : float
        Of the program, divided by ``unit``.
    C, Ct : csr (N, M), csr (M, N)
    c : (N,) float
    E, Et : csr (zero, M), csr (M, zero)
    e : (zero,) float
    scale : (R,) float
        What the rows of the program were multiplied by.
    data : (nnz,) float
        The scaled nonzeros of the program.
    products : tuple
    workers : Workers
    """

    symbolic: Symbolic
    cone: Cone
    q: Reals
    unit: float
    offset: float
    C: sps.csr_array
    Ct: sps.csr_array
    c: Reals
    E: sps.csr_array
    Et: sps.csr_array
    e: Reals
    scale: Reals
    data: Reals
    products: tuple[StackProduct | PairProduct, ...]
    workers: Workers

    @staticmethod
    def of(program: ConicProgram, symbolic: Symbolic, workers: Workers | None = None) -> Numbers:
        """Put the numbers of a program into place; compiled kernels use the workers."""
        workers = workers or Workers()
        layout, zero = symbolic.layout, program.cones.zero
        scale = _row_scale(program, layout.block)
        data = program.A.data * scale[program.A.indices]
        right = program.b * scale
        linear = program.cones.nonnegative
        width = layout.entries + linear
        row = program.A.indices[layout.source]
        half = np.where(layout.place == layout.mirror, 1.0, np.sqrt(0.5))
        C = sps.csr_array(
            (data[layout.source] * half[row], layout.indices, layout.indptr),
            shape=(width, symbolic.moments),
        )
        c = np.zeros(width)
        c[layout.place[zero:]] = c[layout.mirror[zero:]] = (right * half)[zero:]
        scaled = sps.csc_array((data, program.A.indices, program.A.indptr), shape=program.A.shape)
        E = scaled.tocsr()[:zero]
        unit = float(np.abs(program.q).max(initial=0.0)) or 1.0
        blocks = layout.stacks, layout.entries, linear
        pairs = [a for a in symbolic.assemblies if isinstance(a, BlockPairs)]
        parts = [(each, part) for each in pairs for part in each.parts()]
        return Numbers(
            symbolic=symbolic,
            cone=CompiledCone(*blocks, parts, workers) if symbolic.compiled else Cone(*blocks),
            q=program.q / unit,
            unit=unit,
            offset=program.offset / unit,
            C=C,
            Ct=C.T.tocsr(),
            c=c,
            E=E,
            Et=E.T.tocsr(),
            e=right[:zero],
            scale=scale,
            data=data,
            products=tuple(assembly.bound(C.data, workers) for assembly in symbolic.assemblies),
            workers=workers,
        )

    def factor(self) -> Factor | FrontFactor:
        """Allocate memory for a factorization."""
        tree = self.symbolic.tree
        return FrontFactor(tree, self.workers) if isinstance(tree, Fronts) else Factor(tree)

    def rows(self, y: Reals) -> Reals:
        """Compute E y."""
        return self.E @ y if self.e.size else self.e

    def rows_turned(self, w: Reals) -> Reals:
        """Compute E'w."""
        return self.Et @ w if self.e.size else np.zeros_like(self.q)

    def fixed_entries(self, weight: float) -> tuple[NDArray[np.int64], Reals]:
        """Find the entries of all fronts that weight * E'E changes, and the changes."""
        pairs = self.symbolic.zero
        if not pairs.place.size:
            return pairs.place, np.zeros(0)
        values = weight * self.data[pairs.left] * self.data[pairs.right]
        sums: Reals = np.bincount(pairs.place, values).astype(np.float64)
        place = np.flatnonzero(sums)
        return place, sums[place]

    def fill(
        self,
        entries: Reals,
        fixed: tuple[NDArray[np.int64], Reals],
        inverse: Reals,
        dual: Reals,
        deadline: float | None = None,
    ) -> None:
        """Assemble the fronts: ``fixed`` plus C_p' (S^-1 x Z) C_q of all blocks and rows.

        Raises
        ------
        OutOfTime
            If ``deadline`` passes.
        """
        entries.fill(0.0)
        entries[fixed[0]] = fixed[1]
        for product in self.products:
            product.add(entries, inverse, dual, deadline)
        pairs = self.symbolic.linear
        if pairs.place.size:
            place = self.symbolic.layout.place[pairs.row]
            weight = inverse[place] * dual[place] * self.data[pairs.left] * self.data[pairs.right]
            np.add.at(entries, pairs.place, weight)

    def multipliers(self, z: Reals, free: Reals) -> Reals:
        """Convert cone entries and multipliers of equalities to the program's multipliers."""
        layout, zero = self.symbolic.layout, free.size
        place, mirror = layout.place[zero:], layout.mirror[zero:]
        rows = np.where(place == mirror, z[place], np.sqrt(0.5) * (z[place] + z[mirror]))
        return np.concatenate([free, rows]) * self.scale * self.unit


def _row_scale(program: ConicProgram, block: NDArray[np.int64]) -> Reals:
    """Compute one over the largest coefficient of each row or block.

    Constants of inequalities count: one that holds far from its boundary would start with a
    residual that is large beside its slack, and steps would be short.
    """
    count = int(block.max(initial=-1)) + 1
    largest = np.zeros(count)
    np.maximum.at(largest, block[program.A.indices], np.abs(program.A.data))
    zero = program.cones.zero
    np.maximum.at(largest, block[zero:], np.abs(program.b[zero:]))
    scale = 1.0 / np.where(largest > 0.0, largest, 1.0)
    return scale[block]
