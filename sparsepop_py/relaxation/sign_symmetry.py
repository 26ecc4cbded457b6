"""Sign symmetries: changes x_v -> s_v x_v, s_v = +-1, that keep a problem.

A monomial keeps its sign if its exponents are orthogonal to s over GF(2), where -1 counts
as 1. The sign changes that keep a set of monomials are a null space, and two monomials
behave alike under all of them if the exponents of their product are in the span of the set.
Moments whose monomials change sign may be zero: that is the mean of a measure over all
sign changes.

References
----------
J. Loefberg, Pre- and post-processing sum-of-squares programs in practice, IEEE Trans.
Automatic Control 54 (2009), section III.
J. Wang, V. Magron, J.-B. Lasserre, SIAM J. Optim. 31 (2021) 30-58, section 6.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem

__all__ = ["invariant_words", "sign_codes"]

_SEED = 20021  # any fixed number: codes are deterministic
_LETTERS = 62  # terms of an inequality whose signs fit into one integer


def invariant_words(system: PolynomialSystem, chosen: NDArray[np.int64]) -> list[Words]:
    """List monomials that a sign change must keep to map inequalities onto inequalities.

    Inequalities with equal monomials and coefficients up to sign are one family. Sign changes of
    its terms that map it to itself are a subgroup of GF(2)^T; products of monomials over
    the vectors orthogonal to it are what must keep its sign. An inequality that is alone
    in its family gives all its monomials.
    """
    system = system.take(chosen)
    count = np.bincount(system.row, minlength=system.size)
    first = np.cumsum(count) - count
    _, name = monomials.collect(system.words, system.dimension)
    result = []
    for terms in monomials.distinct(count[count > 0]).tolist():
        rows = np.flatnonzero(count == terms)
        place = first[rows][:, None] + np.arange(terms)
        value = system.coefficients[place]
        key = np.concatenate([name[place].astype(float), np.abs(value)], axis=1)
        _, one, family = np.unique(key, axis=0, return_index=True, return_inverse=True)
        if terms > _LETTERS:
            result.append(system.words[place.ravel()])
            continue
        signs = (value < 0) @ (1 << np.arange(terms, dtype=np.int64))
        pairs = np.unique(np.column_stack([family.ravel(), signs]), axis=0)
        size = np.bincount(pairs[:, 0])
        start = np.cumsum(size) - size
        for number in monomials.distinct(size):
            chosen = np.flatnonzero(size == number)
            sets = pairs[start[chosen][:, None] + np.arange(number), 1]
            kinds, kind = np.unique(sets, axis=0, return_inverse=True)
            for k, pattern in enumerate(kinds):
                table = place[one[chosen[kind.ravel() == k]]]
                for vector in _orthogonal(pattern, terms):
                    product = system.words[table[:, vector]]
                    product = np.sort(product.reshape(table.shape[0], -1), axis=1)
                    result.append(monomials.trim(product.astype(np.int32)))
    return result


def _orthogonal(pattern: NDArray[np.int64], terms: int) -> NDArray[np.bool_]:
    """Compute a basis (k, terms) orthogonal to all sign changes that keep a pattern."""
    known = set(pattern.tolist())
    moves = [m for m in (pattern[0] ^ pattern).tolist() if {m ^ p for p in known} == known]
    bits = (np.array(moves)[:, None] >> np.arange(terms)) & 1 == 1
    rows, pivots = _echelon(bits)
    open_ = np.setdiff1d(np.arange(terms), pivots)
    vectors = np.zeros((open_.size, terms), bool)
    vectors[np.arange(open_.size), open_] = True
    vectors[:, pivots] = rows[:, open_].T
    return vectors


def sign_codes(words: Words, dimension: int) -> NDArray[np.uint64]:
    """Assign codes (n + 1,) to letters whose sums over GF(2) name classes of monomials.

    The 64 bits are random vectors of the null space of the exponents of ``words`` over
    GF(2): two monomials have equal codes if and (but for a chance of 2^-64, which would
    only join two blocks) only if their product has the parity of a product of ``words``.
    """
    parity = monomials.to_exponents(words, dimension)
    name = np.arange(dimension + 1)  # letters with equal codes so far; 0 has code 0
    while True:
        parity.data %= 2
        parity.eliminate_zeros()
        parity.sort_indices()
        weight = np.diff(parity.indptr)
        single, double = np.flatnonzero(weight == 1), np.flatnonzero(weight == 2)
        if not single.size + double.size:
            break
        # x alone has code 0, x y says that the codes of x and y are equal
        begin = parity.indptr[double]
        a = np.append(np.zeros(single.size, int), parity.indices[begin] + 1)
        b = np.append(parity.indices[parity.indptr[single]], parity.indices[begin + 1]) + 1
        link = sps.coo_array((np.ones(a.size), (a, b)), shape=(dimension + 1,) * 2)
        _, label = connected_components(link, directed=False)
        _, least = np.unique(label, return_index=True)
        name = least[label][name]
        joined = least[label][1:]
        kept = np.flatnonzero(joined > 0)
        shape = (dimension, dimension)
        move = sps.csr_array((np.ones(kept.size, int), (kept, joined[kept] - 1)), shape=shape)
        parity = sps.csr_array(parity[weight > 0] @ move)
        parity.sum_duplicates()
    code = np.random.default_rng(_SEED).integers(0, 2**64, dimension + 1, np.uint64)
    code[0] = 0
    columns = monomials.distinct(parity.indices)
    rows, pivots = _echelon(parity[np.flatnonzero(weight)][:, columns].toarray() > 0)
    open_ = rows.copy()
    open_[:, pivots] = False
    letters = np.where(open_, code[columns + 1], np.uint64(0))
    code[columns[pivots] + 1] = np.bitwise_xor.reduce(letters, axis=1)
    return code[name]


def _echelon(rows: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Reduce rows to echelon form over GF(2) without zero rows; return pivot columns too."""
    rows = np.unique(rows, axis=0) if rows.size else rows
    pivots: list[int] = []
    for column in range(rows.shape[1]):
        hit = np.flatnonzero(rows[:, column])
        new = hit[hit >= len(pivots)]
        if not new.size:
            continue
        rows[[len(pivots), new[0]]] = rows[[new[0], len(pivots)]]
        others = np.flatnonzero(rows[:, column])
        rows[others[others != len(pivots)]] ^= rows[len(pivots)]
        pivots.append(column)
    return rows[: len(pivots)], np.array(pivots, np.int64)
