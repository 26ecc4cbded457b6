"""The elimination tree as stacks of equal dense fronts, factorized and solved level by level.

A front holds its pivot columns first and then the columns that they reach. Fronts of one
level do not touch each other, so those of equal size are one (K, n, n) array and every step
on them is one call. After a level is eliminated, its Schur complements are added to the
fronts of the parents (extend-add). Sizes are rounded up a little so that stacks are few.

References
----------
I. S. Duff, J. K. Reid, The multifrontal solution of indefinite sparse symmetric linear
equations, ACM Trans. Math. Softw. 9, 1983.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.kernels.batched import (
    check,
    cholesky,
    lower_inverse,
    transposed,
)
from sparsepop_py.solvers.cliquetree.symbolic.elimination import Front, levels_of, parents

__all__ = ["Factor", "FrontStack", "Tree", "plant"]

Indices = NDArray[np.int64]
Reals = NDArray[np.float64]
_LEAST_PIVOT = 1e-14  # in scaled units: smaller pivots are rounding errors


@dataclass(frozen=True, slots=True, eq=False)
class FrontStack:
    """Fronts of equal size on one level of the tree.

    Parameters
    ----------
    pivots, size : int
        Pivots and all columns n of each front, padding included.
    columns : (K, n) int
        Their columns; padding has the number of all columns.
    start : int
        Where the (K, n, n) entries begin.
    parent : (K, U, U) int
        Where updates are added; those of padding go to the last entry of all.
    padding : (P,) int
        Diagonal entries of padded pivots.
    """

    pivots: int
    size: int
    columns: Indices
    start: int
    parent: Indices
    padding: Indices

    @property
    def count(self) -> int:
        """Number of fronts K."""
        return self.columns.shape[0]

    @property
    def span(self) -> slice:
        """The entries of all these fronts."""
        return slice(self.start, self.start + self.count * self.size**2)


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """Fronts from the leaves to the roots.

    Parameters
    ----------
    stacks : tuple of FrontStack
        By level.
    columns : int
    entries : int
        Entries of all fronts and one more, which takes what padding throws away.
    sizes : (F, 2) int
        Pivots and updates of each front, without padding.
    levels : int
    front, order : int arrays
        The front that eliminates each column; columns of each front with its number, sorted.
    base, width : (F,) int
        First entry and size of each front, and
    slot : int array
        the place of each column in it, in the order of ``order``.
    """

    stacks: tuple[FrontStack, ...]
    columns: int
    entries: int
    sizes: Indices
    levels: int
    front: Indices
    order: Indices
    base: Indices
    width: Indices
    slot: Indices

    @property
    def operations(self) -> int:
        """Floating-point operations of one factorization, without padding."""
        e, u = self.sizes.T
        return int((e**3 // 3 + e * e * u + e * u * u).sum())

    def locate(self, owner: Indices, member: Indices, first: Indices) -> Indices:
        """Find front and slot of each clique's members, as front * columns + slot."""
        at = np.append(self.front[member], self.sizes.shape[0])
        count = first.size - 1
        nonempty = first[:-1] < first[1:]
        lowest = np.zeros(count, np.int64)
        lowest[nonempty] = np.minimum.reduceat(at, first[:-1][nonempty])
        own = lowest[owner]
        found = np.searchsorted(self.order, own * max(self.columns, 1) + member)
        return own * 2**32 + self.slot[found]

    def pairs(self, spot: Indices, inside: NDArray[np.bool_]) -> Indices:
        """Find the entries (K, C, C) of all pairs of places (K, C) from ``locate``."""
        front, slot = np.divmod(spot, 2**32)
        base, width = self.base[front[:, 0]], self.width[front[:, 0]]
        place = base[:, None, None] + slot[:, :, None] * width[:, None, None] + slot[:, None, :]
        return np.where(inside[:, :, None] & inside[:, None, :], place, self.entries - 1)


def plant(fronts: list[Front], columns: int) -> Tree:
    """Stack the fronts of an elimination order.

    Parameters
    ----------
    fronts : list of Front
        Each after all that update it.
    columns : int
    """
    front, parent = parents(fronts, columns)
    level = levels_of(parent)
    sizes = np.array([[f.pivots.size, f.update.size] for f in fronts], np.int64).reshape(-1, 2)
    padded = np.stack([_rounded(sizes[:, 0]), _rounded(sizes[:, 1])], axis=1)
    key = np.column_stack([level, padded])
    kinds, kind = np.unique(key, axis=0, return_inverse=True)
    kind = kind.ravel()
    width = padded.sum(axis=1)
    by_kind = np.argsort(kind, kind="stable")
    base = np.zeros(len(fronts), np.int64)
    base[by_kind] = np.concatenate([[0], np.cumsum(width[by_kind] ** 2)[:-1]])[: len(fronts)]
    entries = int((width**2).sum()) + 1
    order, slot = _slots(fronts, padded, columns)
    lookup = (front, order, base, width, slot)
    partial = Tree((), columns, entries, sizes, 0, *lookup)
    stacks = []
    for number, (_, pivots, updates) in enumerate(kinds.tolist()):
        which = np.flatnonzero(kind == number)
        stacks.append(_stack(partial, [fronts[k] for k in which], which, parent, pivots, updates))
    return Tree(tuple(stacks), columns, entries, sizes, int(level.max(initial=-1)) + 1, *lookup)


def _rounded(sizes: Indices) -> Indices:
    """Sizes rounded up to steps of about an eighth."""
    step = 2 ** np.maximum(np.floor(np.log2(np.maximum(sizes, 1))).astype(np.int64) - 3, 0)
    return -(-sizes // step) * step


def _slots(fronts: list[Front], padded: Indices, columns: int) -> tuple[Indices, Indices]:
    """Keys front * columns + column, sorted, and the slot of each."""
    number = np.arange(len(fronts))
    length = np.array([f.pivots.size + f.update.size for f in fronts], np.int64)
    member = np.concatenate(
        [np.zeros(0, np.int64), *(c for f in fronts for c in (f.pivots, f.update))]
    )
    slots = [
        c
        for f, (pivots, _) in zip(fronts, padded.tolist(), strict=True)
        for c in (np.arange(f.pivots.size), pivots + np.arange(f.update.size))
    ]
    slot = np.concatenate([np.zeros(0, np.int64), *slots])
    key = np.repeat(number, length) * max(columns, 1) + member
    order = np.argsort(key)
    return key[order], slot[order]


def _stack(
    tree: Tree,
    fronts: list[Front],
    which: Indices,
    parent: Indices,
    pivots: int,
    updates: int,
) -> FrontStack:
    size = pivots + updates
    columns = np.full((len(fronts), size), tree.columns, np.int64)
    e, u = tree.sizes[which].T
    slot = np.arange(size)
    inside = (slot < e[:, None]) | ((slot >= pivots) & (slot < pivots + u[:, None]))
    columns[inside] = np.concatenate([c for f in fronts for c in (f.pivots, f.update)])
    lost = (slot >= e[:, None]) & (slot < pivots)
    padding = (tree.base[which][:, None] + slot * (size + 1))[lost]
    reached = inside[:, pivots:]
    above = np.where(reached, parent[which][:, None], 0)
    key = above * max(tree.columns, 1) + np.where(reached, columns[:, pivots:], 0)
    found = np.minimum(np.searchsorted(tree.order, key), max(tree.slot.size - 1, 0))
    slots = tree.slot[found] if updates else found
    place = tree.pairs(above * 2**32 + slots, reached) if updates else found[:, :, None]
    return FrontStack(pivots, size, columns, int(tree.base[which[0]]), place, padding)


class Factor:
    """Working memory of factorizations: L^-1 (K, e, e) and F21 L^-T (K, u, e) stacks.

    Memory is taken once and used again, since pages that are returned and asked for in every
    iteration cost more than the arithmetic on small fronts.

    Parameters
    ----------
    tree : Tree
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.entries = np.zeros(tree.entries)
        self.inverse = [np.zeros((s.count, s.pivots, s.pivots)) for s in tree.stacks]
        self.across = [np.zeros((s.count, s.size - s.pivots, s.pivots)) for s in tree.stacks]
        self._update = np.zeros(max((s.parent.size for s in tree.stacks), default=0))

    def refactor(self, regularisation: float, deadline: float | None = None) -> None:
        """Factorize the sum of fronts in ``entries``, which is overwritten.

        Parameters
        ----------
        regularisation : float
            Added to each pivot, relative to it.
        deadline : float, optional
            Moment on the monotonic clock after which to give up.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a pivot block is not positive definite.
        OutOfTime
            If ``deadline`` passes.
        """
        for stack, inverse, across in zip(self.tree.stacks, self.inverse, self.across, strict=True):
            check(deadline)
            self.entries[stack.padding] = 1.0
            matrix = self.entries[stack.span].reshape(stack.count, stack.size, stack.size)
            e = stack.pivots
            diagonal = np.einsum("kii->ki", matrix)[:, :e]
            diagonal += regularisation * diagonal + _LEAST_PIVOT
            lower_inverse(cholesky(matrix[:, :e, :e], deadline), inverse, deadline)
            if stack.size > e:
                np.matmul(matrix[:, e:, :e], transposed(inverse), out=across)
                update = self._update[: stack.parent.size].reshape(stack.parent.shape)
                np.matmul(across, transposed(across), out=update)
                np.subtract(matrix[:, e:, e:], update, out=update)
                np.add.at(self.entries, stack.parent.ravel(), update.ravel())

    def solve(self, right: Reals) -> Reals:
        """Solve the factorized system for one right-hand side (M,)."""
        x = np.append(right, 0.0)
        parts = list(zip(self.tree.stacks, self.inverse, self.across, strict=True))
        for stack, inverse, across in parts:
            pivot, beyond = stack.columns[:, : stack.pivots], stack.columns[:, stack.pivots :]
            part = inverse @ x[pivot][:, :, None]
            x[pivot] = part[:, :, 0]
            if beyond.size:
                np.subtract.at(x, beyond.ravel(), (across @ part).ravel())
                x[-1] = 0.0
        for stack, inverse, across in reversed(parts):
            pivot, beyond = stack.columns[:, : stack.pivots], stack.columns[:, stack.pivots :]
            part = x[pivot][:, None, :]
            if beyond.size:
                part = part - x[beyond][:, None, :] @ across
            x[pivot] = (part @ inverse)[:, 0, :]
            x[-1] = 0.0
        return x[:-1]
