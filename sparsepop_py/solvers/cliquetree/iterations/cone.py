"""Operations on the blocks and linear rows of a vector of all matrix entries.

Linear rows follow the entries of all blocks. By numpy all blocks of one size are taken
together; compiled kernels take block by block, in parts that do not depend on the threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.kernels.batched import (
    Workers,
    cholesky,
    compiled_kernels,
    largest_step,
    lower_inverse,
    symmetric,
    transposed,
)
from sparsepop_py.solvers.cliquetree.symbolic.assembly import BlockPairs
from sparsepop_py.solvers.cliquetree.symbolic.layout import BlockStack

__all__ = ["CompiledCone", "Cone"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cone:
    """The semidefinite blocks and linear rows of vectors of all matrix entries.

    Parameters
    ----------
    stacks : tuple of BlockStack
    entries : int
        Where the linear rows begin.
    linear : int
        Number of linear rows.
    """

    stacks: tuple[BlockStack, ...]
    entries: int
    linear: int

    @property
    def degree(self) -> int:
        """The barrier parameter: rows of all matrices and linear rows."""
        return sum(s.size * s.count for s in self.stacks) + self.linear

    def identity(self) -> Reals:
        """Build unit matrices and ones."""
        result = np.ones(self.entries + self.linear)
        for stack in self.stacks:
            result[stack.span] = stack.entries(np.broadcast_to(np.eye(stack.size), stack.shape))
        return result

    def inverse_factor(self, x: Reals) -> Reals:
        """Compute L^-1 of each matrix L L', and 1 / sqrt(x) of linear rows.

        Raises
        ------
        numpy.linalg.LinAlgError
            If x is not in the interior of the cone.
        """
        result = np.empty_like(x)
        self._inverse_factors(x, result)
        tail = x[self.entries :]
        if tail.size and not tail.min() > 0.0:
            raise np.linalg.LinAlgError("a linear row is not positive")
        result[self.entries :] = 1.0 / np.sqrt(tail)
        return result

    def inverse(self, factor: Reals) -> Reals:
        """Compute L^-T L^-1."""
        result = np.empty_like(factor)
        self._inverses(factor, result)
        result[self.entries :] = factor[self.entries :] ** 2
        return result

    def sandwich(self, left: Reals, middle: Reals, right: Reals) -> Reals:
        """Compute the symmetric part of P D Z, and p d z."""
        result = np.empty_like(middle)
        self._sandwich(left, middle, right, result)
        tail = slice(self.entries, None)
        result[tail] = left[tail] * middle[tail] * right[tail]
        return result

    def largest_step(self, factor: Reals, direction: Reals, limit: float, roughly: bool) -> float:
        """Compute the largest a <= limit that keeps x + a d in the cone.

        x is given by its inverse factor.
        """
        limit = self._largest_step(factor, direction, limit, roughly)
        ratio = direction[self.entries :] * factor[self.entries :] ** 2
        least = float(ratio.min(initial=0.0))
        return -1.0 / least if least * limit < -1.0 else limit

    # ---- blocks --------------------------------------------------------------------------------

    def _inverse_factors(self, x: Reals, result: Reals) -> None:
        for s in self.stacks:
            lower_inverse(cholesky(x[s.span].reshape(s.shape)), result[s.span].reshape(s.shape))

    def _inverses(self, factor: Reals, result: Reals) -> None:
        for s in self.stacks:
            matrices = factor[s.span].reshape(s.shape)
            result[s.span] = (transposed(matrices) @ matrices).ravel()

    def _sandwich(self, left: Reals, middle: Reals, right: Reals, result: Reals) -> None:
        for s in self.stacks:
            p, d, z = (x[s.span].reshape(s.shape) for x in (left, middle, right))
            result[s.span] = symmetric(p @ d @ z).ravel()

    def _largest_step(self, factor: Reals, direction: Reals, limit: float, roughly: bool) -> float:
        for s in self.stacks:
            inverse, change = (x[s.span].reshape(s.shape) for x in (factor, direction))
            limit = largest_step(inverse, change, limit, roughly)
        return limit


@dataclass(frozen=True, eq=False)
class CompiledCone(Cone):
    """The same with compiled kernels.

    Parameters
    ----------
    stacks, entries, linear
        As in :class:`Cone`.
    parts : list of (BlockPairs, (int, int))
        Ranges of blocks that may be worked on at the same time.
    workers : Workers
    """

    parts: list[tuple[BlockPairs, tuple[int, int]]]
    workers: Workers

    def _each(self, name: str, vectors: tuple[Reals, ...], last: Reals | float) -> list[Any]:
        """Run the kernel of this name on all parts and list its results."""
        compiled = compiled_kernels()
        kernels = getattr(compiled.blocks, name), getattr(compiled.lanes, name)

        def work(part: tuple[BlockPairs, tuple[int, int]]) -> Any:
            b, (low, high) = part
            return kernels[b.lanes > 1](*vectors, b.start, b.size, low, high, last)

        return self.workers.each(work, self.parts)

    def _inverse_factors(self, x: Reals, result: Reals) -> None:
        if max(self._each("inverse_factors", (x,), result), default=-1) >= 0:
            raise np.linalg.LinAlgError("a block is not positive definite")

    def _inverses(self, factor: Reals, result: Reals) -> None:
        self._each("inverses", (factor,), result)

    def _sandwich(self, left: Reals, middle: Reals, right: Reals, result: Reals) -> None:
        self._each("sandwich", (left, middle, right), result)

    def _largest_step(self, factor: Reals, direction: Reals, limit: float, roughly: bool) -> float:
        return min(self._each("largest_step", (factor, direction), limit), default=limit)
