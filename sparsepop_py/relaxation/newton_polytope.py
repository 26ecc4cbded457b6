"""Monomials that a sum of squares can hold: reduction by the Newton polytope.

In a sum of squares p, the square of a basis monomial must be matched by another product or
by p itself; else its diagonal entry is zero and the monomial goes. Repeated until nothing
goes, this leaves no monomial outside half the Newton polytope of p: let B be the monomials
left. A vertex of the convex hull of 2B is twice some b in B and no midpoint of two others, so
only p can match b^2, and the vertex is in the support of p. Hence conv(2B) lies in the Newton
polytope. Often more goes than the polytope asks for. With cliques, only products within one
clique count, by which still more can go; with other multipliers, their products count
among what p may match.

References
----------
B. Reznick, Extremal psd forms with few terms, Duke Math. J. 45 (1978) 363-374 (half the
Newton polytope).
J. Loefberg, Pre- and post-processing sum-of-squares programs in practice, IEEE Trans.
Automatic Control 54 (2009) (diagonal inconsistency).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.budget import check
from sparsepop_py.relaxation.basis import Bases, by_size

__all__ = ["consistent_bases"]


def consistent_bases(
    bases: Bases,
    held: Sequence[Words],
    dimension: int,
    rewrite: Callable[[Words], Words] | None = None,
    degree: int = 0,
) -> Bases:
    """Drop monomials whose squares no other product and none of ``held`` can match.

    The value of the relaxation stays: the diagonal entries of what is dropped are zero in every
    Gram matrix, and so are their rows.

    Parameters
    ----------
    bases : list of (positions (k,), basis (k, s, D))
    held : sequence of (T, D) words
        Monomials of the objective and of all other multipliers' products.
    dimension : int
    rewrite : callable, optional
        Rewrites words (T, D) where equations are substituted.
    degree : int
        Monomials below it stay.

    Examples
    --------
    Of the 10 monomials of degree 3 in two variables, Motzkin's polynomial needs four.

    >>> import sparsepop_py as sp
    >>> f = sp.problems.motzkin().objective
    >>> full = [(np.array([0]), monomials.full_basis(2, 3)[None])]
    >>> [(_, kept)] = consistent_bases(full, [f.words], 2)
    >>> kept[0].tolist()
    [[0, 0, 0], [0, 1, 2], [1, 1, 2], [1, 2, 2]]
    """
    width = max([1, *(2 * b.shape[2] for _, b in bases), *(w.shape[1] for w in held)])

    def keys(words: Words) -> NDArray[Any]:
        check()  # high orders have millions of words
        words = monomials.widen(words, width)
        return monomials.pack(words if rewrite is None else rewrite(words), dimension)

    fixed = monomials.distinct(np.concatenate([keys(np.zeros((1, 1), np.int32)), *map(keys, held)]))
    squares, products = [], []
    for _, basis in bases:
        k, s, d = basis.shape
        j, i = np.tril_indices(s, -1)
        squares.append(keys(monomials.multiply(basis, basis).reshape(-1, 2 * d)).reshape(k, s))
        mixed = monomials.multiply(basis[:, i], basis[:, j]).reshape(-1, 2 * d)
        products.append(keys(mixed).reshape(k, i.size))
    kept = [np.ones(square.shape, bool) for square in squares]
    low = [monomials.degrees(basis) < degree for _, basis in bases]
    while True:
        alive = [fixed]
        for keep, product in zip(kept, products, strict=True):
            check()
            j, i = np.tril_indices(keep.shape[1], -1)
            alive.append(product[keep[:, i] & keep[:, j]])
        matched = monomials.distinct(np.concatenate(alive))
        shrunk = [
            k & (few | np.isin(sq, matched)) for k, sq, few in zip(kept, squares, low, strict=True)
        ]
        if all(np.array_equal(a, b) for a, b in zip(kept, shrunk, strict=True)):
            break
        kept = shrunk
    stacked: dict[int, Bases] = {}
    for (place, basis), keep in zip(bases, kept, strict=True):
        for chosen, rows in by_size(basis, keep):
            stacked.setdefault(rows.shape[1], []).append((place[chosen], rows))
    return [
        (np.concatenate([p for p, _ in parts]), np.concatenate([b for _, b in parts]))
        for parts in stacked.values()
    ]
