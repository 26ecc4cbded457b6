"""Monomial bases of the blocks of a relaxation.

The full basis of a clique holds all its monomials up to a degree. An equality h == 0
that lives in the clique puts the coefficient vector of every x^a h of degree at most d
into the kernel of the moment matrix; dropping as many monomials as these vectors have
rank leaves a smaller matrix that can be positive definite (facial reduction). Any choice of
monomials is sound, since fewer monomials only make a relaxation weaker.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.problem.problem import Problem
from sparsepop_py.sparsity.correlative import Cliques

__all__ = ["MOST_BYTES", "Bases", "building_bytes", "by_size", "clique_bases", "reduced_bases"]

Bases = list[tuple[NDArray[np.int64], Words]]
MOST_BYTES = 1e10  # of building; what needs more is beyond any solver
_LETTER_BYTES = 35.0  # measured, for each letter of the products of a basis


def building_bytes(problem: Problem, cliques: Cliques, order: int) -> float:
    """Estimate the memory in bytes that building the largest clique's block takes.

    Its products are words as long as their degree.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> problem = sp.Problem(x**2)
    >>> cliques = sp.find_cliques(problem)
    >>> [f"{building_bytes(problem, cliques, order) / 1e9:.2g}" for order in (50, 5000)]
    ['0.0046', '4.4e+03']
    """
    free = problem.lower != problem.upper
    if np.all(free):
        variables = max(map(len, cliques.members))
    else:
        variables = max(int(free[list(clique)].sum()) for clique in cliques.members)
    basis = float(min(comb(variables + order, order), 10**18))
    return _LETTER_BYTES * order * basis * (basis + 1.0)


def clique_bases(members: Sequence[tuple[int, ...]], clique: NDArray[Any], degree: int) -> Bases:
    """Build full bases of the given cliques, stacked by clique size.

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
    for size in monomials.distinct(sizes):
        place = np.flatnonzero(sizes == size)
        letters = np.zeros((place.size, size + 1), np.int32)
        if size:
            letters[:, 1:] = np.array([members[clique[p]] for p in place]) + 1
        local = monomials.full_basis(int(size), degree)
        result.append((place, letters[:, local]))
    return result


def reduced_bases(
    problem: Problem, members: Sequence[tuple[int, ...]], home: NDArray[Any], order: int
) -> Bases:
    """Reduce the moment bases of all cliques by the equalities they are home to."""
    equalities: dict[int, list[int]] = {}
    for number in np.flatnonzero(problem.equality):
        polynomial = problem.constraints[number].polynomial
        inside = set(polynomial.support.tolist()) <= set(members[home[number]])
        if 0 < polynomial.degree <= order and inside:
            equalities.setdefault(int(home[number]), []).append(int(number))
    plain = np.array([c for c in range(len(members)) if c not in equalities], int)
    stacked: dict[int, list[tuple[NDArray[Any], Words]]] = {}
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


def by_size(basis: Words, keep: NDArray[np.bool_]) -> Bases:
    """Keep chosen monomials (K, s) of bases (K, s, D), stacked by their number."""
    count, parts = keep.sum(axis=1), []
    for size in monomials.distinct(count).tolist():
        rows = np.flatnonzero(count == size)
        words = basis[rows][keep[rows]].reshape(rows.size, size, basis.shape[2])
        parts.append((rows, words))
    return parts


def _independent(
    problem: Problem, basis: Words, member: tuple[int, ...], numbers: list[int], order: int
) -> NDArray[np.int64]:
    """Select the basis monomials that stay when the kernel vectors are divided out."""
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
