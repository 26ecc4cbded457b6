"""Monomial bases of the blocks of a relaxation.

The full basis of a clique holds all its monomials up to a degree. An equality h == 0
that lives in the clique puts the coefficient vector of every x^a h of degree at most d
into the kernel of the moment matrix; dropping as many monomials as these vectors have
rank leaves a smaller matrix that can be positive definite (facial reduction). In a sum
of squares, the square of a basis monomial must be matched by another product or by the
polynomial itself, else its diagonal entry is zero and the monomial can go (diagonal
consistency, a cheap form of the Newton polytope). Any choice of monomials is sound,
since fewer monomials only make a relaxation weaker.

References
----------
J. Loefberg, Pre- and post-processing sum-of-squares programs in practice, IEEE Trans.
Automatic Control 54, 2009 (diagonal inconsistency).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from . import monomials
from .monomials import Words
from .problem import Problem

__all__ = ["by_size", "clique_bases", "consistent_bases", "reduced_bases"]

Bases = list[tuple[NDArray[np.int64], Words]]


def clique_bases(members: Sequence[tuple[int, ...]], clique: NDArray, degree: int) -> Bases:
    """Full bases of the given cliques, stacked by clique size.

    Parameters
    ----------
    members : sequence of tuples
        Sorted variable indices (from 0) of each clique.
    clique : (K,) int
        The cliques asked for.
    degree : int

    Returns
    -------
    list of (positions (k,), basis (k, s, degree))
        Positions into ``clique``, and the bases as words.
    """
    sizes = np.array([len(members[c]) for c in clique], int)
    result = []
    for size in np.unique(sizes):
        place = np.flatnonzero(sizes == size)
        letters = np.zeros((place.size, size + 1), np.int32)
        if size:
            letters[:, 1:] = np.array([members[clique[p]] for p in place]) + 1
        local = monomials.full_basis(int(size), degree)
        result.append((place, letters[:, local]))
    return result


def reduced_bases(
    problem: Problem, members: Sequence[tuple[int, ...]], home: NDArray, order: int
) -> Bases:
    """Moment bases of all cliques after facial reduction by the equalities they are home to."""
    equalities: dict[int, list[int]] = {}
    for number in np.flatnonzero(problem.equality):
        polynomial = problem.constraints[number].polynomial
        inside = set(polynomial.support.tolist()) <= set(members[home[number]])
        if 0 < polynomial.degree <= order and inside:
            equalities.setdefault(int(home[number]), []).append(int(number))
    plain = np.array([c for c in range(len(members)) if c not in equalities], int)
    stacked: dict[int, list[tuple[NDArray, Words]]] = {}
    for place, basis in clique_bases(members, plain, order):
        stacked.setdefault(basis.shape[1], []).append((plain[place], basis))
    for clique, numbers in equalities.items():
        [(_, basis)] = clique_bases(members, np.array([clique]), order)
        kept = basis[:, _independent(problem, basis[0], members[clique], numbers, order)]
        stacked.setdefault(kept.shape[1], []).append((np.array([clique]), kept))
    return [
        (np.concatenate([p for p, _ in parts]), np.concatenate([b for _, b in parts]))
        for parts in stacked.values()
    ]


def consistent_bases(
    bases: Bases,
    held: Sequence[Words],
    dimension: int,
    rewrite: Callable[[Words], Words] | None = None,
    degree: int = 0,
) -> Bases:
    """Drop monomials whose squares no other product and none of ``held`` can match.

    Parameters
    ----------
    bases : list of (positions (k,), basis (k, s, D))
    held : sequence of (T, D) words
        Monomials of the objective and of all other multipliers' products.
    dimension : int
    rewrite : callable, optional
        What becomes of words (T, D) where equations are substituted.
    degree : int
        Monomials below it stay.
    """
    width = max([1, *(2 * b.shape[2] for _, b in bases), *(w.shape[1] for w in held)])

    def keys(words: Words) -> NDArray:
        words = monomials.widen(words, width)
        return monomials.pack(words if rewrite is None else rewrite(words), dimension)

    fixed = np.unique(np.concatenate([keys(np.zeros((1, 1), np.int32)), *map(keys, held)]))
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
            j, i = np.tril_indices(keep.shape[1], -1)
            alive.append(product[keep[:, i] & keep[:, j]])
        matched = np.unique(np.concatenate(alive))
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


def by_size(basis: Words, keep: NDArray[np.bool_]) -> Bases:
    """Bases (K, s, D) with only the monomials to keep (K, s), stacked by what is left of s."""
    count, parts = keep.sum(axis=1), []
    for size in np.unique(count).tolist():
        rows = np.flatnonzero(count == size)
        words = basis[rows][keep[rows]].reshape(rows.size, size, basis.shape[2])
        parts.append((rows, words))
    return parts


def _independent(
    problem: Problem, basis: Words, member: tuple[int, ...], numbers: list[int], order: int
) -> NDArray[np.int64]:
    """Positions of the basis monomials that stay when the kernel vectors are divided out."""
    keys = monomials.pack(basis, problem.dimension)
    vectors = []
    for number in numbers:
        polynomial = problem.constraints[number].polynomial
        [(_, shift)] = clique_bases([member], np.array([0]), order - polynomial.degree)
        words = monomials.multiply(shift[0][:, None, :], polynomial.words[None, :, :])
        for row in words:
            row = monomials.widen(monomials.trim(row), order)
            column = np.searchsorted(keys, monomials.pack(row, problem.dimension))
            vector = np.zeros(keys.size)
            vector[column] = polynomial.coefficients / np.abs(polynomial.coefficients).max()
            vectors.append(vector)
    weight = 4.0 ** monomials.degrees(basis)  # high monomials leave before low ones
    weight[0] = 0.0  # the constant stays
    _, triangle, pivots = scipy.linalg.qr(
        np.array(vectors) * weight, mode="economic", pivoting=True
    )
    size = np.abs(np.diag(triangle))
    rank = int(np.count_nonzero(size > 1e-8 * size[0]))
    return np.sort(pivots[rank:])
