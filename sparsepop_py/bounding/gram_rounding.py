"""Exact Gram matrices by rounding nearly exact ones.

Monomials are those whose squares occur in the objective, entries those whose products do.
A solver finds a nearly semidefinite matrix. What the coefficients leave open in it is rounded
to ever finer binary fractions, until elimination in rationals shows that the matrix is
semidefinite. That succeeds where the Gram matrix is simple, as in objectives written as a sum
of squares with few digits; the fewer squares there are to choose from, the more likely it is.

References
----------
H. Peyrl, P. A. Parrilo, Computing sum of squares decompositions with rational coefficients,
Theoret. Comput. Sci. 409 (2008) 269-281.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.conic.alike_blocks import merge_alike_blocks
from sparsepop_py.conic.program import ConicProgram
from sparsepop_py.problem import generators
from sparsepop_py.relaxation.assemble import assemble, split_dual
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks, stacked_groups
from sparsepop_py.relaxation.moment import Relaxation, on_groups
from sparsepop_py.relaxation.term_sparsity import TermGraphs
from sparsepop_py.solvers import solve_conic
from sparsepop_py.verified.certificate.rational_gram import ExactGram

__all__ = [
    "entries_of",
    "estimate",
    "exact_grams",
    "interior_grams",
    "open_entries",
    "semidefinite_part",
    "restricted_to_terms",
]


def exact_grams(
    objective: Polynomial, relaxation: Relaxation, time_limit: float | None = None
) -> Iterator[ExactGram]:
    """Yield candidates for an exact Gram matrix of the objective, coarse ones first.

    Parameters
    ----------
    objective : Polynomial
    relaxation : Relaxation
        Of the problem of that objective, unscaled but for a factor, with moment matrices only.
    time_limit : float, optional
        Seconds for the solver.

    Yields
    ------
    ExactGram
    """
    linear = np.any(monomials.degrees(objective.words) == 1)
    for constant in (True,) if linear else (False, True):
        sparse = restricted_to_terms(objective, relaxation, constant)
        if sparse is not None:
            yield from _rounded(objective, sparse, time_limit)


def interior_grams(
    objective: Polynomial, relaxation: Relaxation, time_limit: float | None = None
) -> Iterator[ExactGram]:
    """Yield candidates from the interior of the cone, the nearest to an optimal one first.

    Parameters
    ----------
    objective : Polynomial
    relaxation : Relaxation
        As for :func:`exact_grams`.
    time_limit : float, optional
        Seconds for each call of the solver.

    Yields
    ------
    ExactGram
    """
    sparse = restricted_to_terms(objective, relaxation, True)
    if sparse is None:
        return
    program, rows = _normed(objective, sparse, 0.0)
    sharp: NDArray[np.float64] | None = None
    for accuracy in BOUNDING.accuracies:
        solution = solve_conic(program, "clarabel", time_limit, accuracy)
        if solution.status not in ("solved", "almost"):
            return
        sharp = solution.z if sharp is None else sharp
        for share in BOUNDING.interior_steps:
            z = sharp + share * (solution.z - sharp)
            basis, first, second, value = entries_of(sparse, rows * z)
            for bits in BOUNDING.interior_bits:
                yield ExactGram(basis, first, second, np.round(value * 2.0**bits) / 2.0**bits)


def _normed(
    objective: Polynomial, sparse: Relaxation, trace: float
) -> tuple[ConicProgram, NDArray[np.float64]]:
    """Scale the program by coefficients of squares; return it and its rows' weights."""
    program = assemble(sparse, objective)
    rows = _row_weights(objective, sparse)
    matrix = sps.csc_array(sps.diags_array(rows) @ program.A)
    columns = 1.0 / np.maximum(abs(matrix).max(axis=0).toarray().ravel(), 1e-300)
    matrix = sps.csc_array(matrix @ sps.diags_array(columns))
    traced = rows * program.b + trace * np.concatenate(
        [np.tile(np.equal(*group.pairs), group.count) for group in sparse.groups]
    )
    return replace(program, q=columns * program.q, A=matrix, b=traced), rows


def _rounded(
    objective: Polynomial, sparse: Relaxation, time_limit: float | None
) -> Iterator[ExactGram]:
    """Round the Gram matrices of solutions with growing precision."""
    normed, rows = _normed(objective, sparse, BOUNDING.trace)
    for z in _multipliers(normed, time_limit):
        basis, first, second, value = entries_of(sparse, rows * z)
        for bits in BOUNDING.bits:
            yield ExactGram(basis, first, second, np.round(value * 2.0**bits) / 2.0**bits)


def _multipliers(program: ConicProgram, time_limit: float | None) -> Iterator[NDArray[np.float64]]:
    """Solve the program with alike blocks merged where few rows are left, then whole."""
    merged = merge_alike_blocks(program, BOUNDING.alike)
    if merged is not None:
        accuracy = BOUNDING.merged_accuracy
        solution = solve_conic(merged.program, "clarabel", time_limit, accuracy)
        if solution.status == "solved":
            yield solution.z[merged.row]
    solution = solve_conic(program, "clarabel", time_limit, BOUNDING.rounded_accuracy)
    if solution.status in ("solved", "almost"):
        yield solution.z


@lru_cache(maxsize=1)  # the minimiser's matrix and rounded ones begin with the same
def restricted_to_terms(
    objective: Polynomial, relaxation: Relaxation, constant: bool, linear: bool = False
) -> Relaxation | None:
    """Restrict the relaxation to squares and products that occur, None if too few.

    Parameters
    ----------
    objective : Polynomial
    relaxation : Relaxation
        With moment matrices only.
    constant, linear : bool
        Whether 1 and the variables are kept as well, though their squares may not occur.

    Returns
    -------
    Relaxation or None
    """
    n = objective.dimension
    blocks: dict[int, Blocks] = {}
    for group in relaxation.groups:
        square = monomials.multiply(group.basis, group.basis).reshape(-1, 2 * group.basis.shape[2])
        held = monomials.lookup(square, objective.words, n) >= 0
        varies = square.any(axis=1)
        if linear:
            held |= monomials.degrees(square) == 2
        kept = np.where(varies, held, constant).reshape(group.basis.shape[:2])
        count = kept.sum(axis=1)
        for size in monomials.distinct(count[count > 0]).tolist():
            chosen = np.flatnonzero(count == size)
            basis = group.basis[chosen][kept[chosen]].reshape(chosen.size, size, -1)
            zero = np.zeros(chosen.size, np.int64)
            blocks.setdefault(size, []).append(BlockGroup(False, zero, group.clique[chosen], basis))
    groups = stacked_groups([block for parts in blocks.values() for block in parts])
    system = generators.stacked(relaxation.problem, relaxation.products)
    graphs = TermGraphs.of(groups, system, objective.words, n)
    # where nearly all products occur, cliques overlap and hold more than components
    closed = (graphs.split("chordal", steps=1), graphs.split("components", steps=1))
    groups = min(closed, key=lambda found: sum(group.rows_each * group.count for group in found))
    if not groups:
        return None
    found = on_groups(relaxation, groups)
    held = np.bincount(found.entries.indices, minlength=found.entries.shape[1]) > 0
    number = monomials.lookup(objective.words, found.moments, n)
    missing = (number < 0) | ~held[number + 1]
    return None if np.any(objective.words[missing]) else found


def _row_weights(objective: Polynomial, relaxation: Relaxation) -> NDArray[np.float64]:
    """Compute d_i d_j for each row, where d_i^2 is the coefficient of monomial i squared."""
    weights = [np.zeros(0)]
    for group in relaxation.groups:
        square = monomials.multiply(group.basis, group.basis).reshape(-1, 2 * group.basis.shape[2])
        number = monomials.lookup(square, objective.words, objective.dimension)
        size = np.where(number >= 0, np.abs(objective.coefficients[number]), 1.0)
        size = np.where(square.any(axis=1), size, 1.0)
        unit = np.sqrt(size.reshape(group.basis.shape[:2]))
        i, j = group.pairs
        weights.append((unit[:, i] * unit[:, j]).ravel())
    return np.concatenate(weights)


def entries_of(
    relaxation: Relaxation, z: NDArray[np.float64]
) -> tuple[Words, NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Sum all Gram matrices: basis, rows, columns and values, diagonal entries first."""
    n, groups = relaxation.problem.dimension, relaxation.groups
    width = max(g.basis.shape[2] for g in groups)
    flat = [monomials.widen(g.basis, width).reshape(-1, width) for g in groups]
    basis, number = monomials.collect(np.concatenate([np.zeros((1, width), np.int32), *flat]), n)
    split = np.split(number[1:], np.cumsum([f.shape[0] for f in flat])[:-1])
    pairs, values = [], []
    for group, names, part in zip(groups, split, split_dual(relaxation, z), strict=True):
        i, j = group.pairs
        name = names.reshape(group.count, group.size)
        ends = np.sort(np.stack([name[:, i], name[:, j]], axis=-1), axis=-1)
        pairs.append(ends.reshape(-1, 2))
        values.append(part[:, i, j].ravel())
    joined = np.concatenate(pairs)
    key = joined[:, 0] * basis.shape[0] + joined[:, 1]
    distinct, place = np.unique(key, return_inverse=True)
    value = np.bincount(place, weights=np.concatenate(values))
    first, second = np.divmod(distinct, basis.shape[0])
    order = np.argsort(first != second, kind="stable")
    first, second = first[order].astype(np.int64), second[order].astype(np.int64)
    return basis, first, second, value[order].astype(float)


def open_entries(
    gram: ExactGram, objective: Polynomial
) -> tuple[NDArray[np.float64], sps.csc_array, NDArray[np.int64]]:
    """Write entries as those that complete the objective, plus changes by open ones.

    Parameters
    ----------
    gram : ExactGram
        Its values are not used.
    objective : Polynomial

    Returns
    -------
    entries : (k,) float
        Those where all open ones are 0.
    change : (k, m) sparse array
    open : (m,) int
        Which entries are open.
    """
    n = objective.dimension
    product = monomials.multiply(gram.basis[gram.first], gram.basis[gram.second])
    distinct, number = monomials.collect(product, n)
    at = monomials.lookup(distinct, objective.words, n)
    asked = np.where(at >= 0, objective.coefficients[at], 0.0)
    times = np.where(gram.first == gram.second, 1.0, 2.0)
    _, taker = np.unique(number, return_index=True)
    entries = np.zeros(times.size)
    entries[taker] = asked / times[taker]
    free = np.delete(np.arange(times.size), taker)
    takes = taker[number[free]]
    row, column = np.concatenate([free, takes]), np.tile(np.arange(free.size), 2)
    share = np.concatenate([np.ones(free.size), -times[free] / times[takes]])
    return entries, sps.csc_array((share, (row, column)), shape=(times.size, free.size)), free


def semidefinite_part(gram: ExactGram) -> tuple[sps.csc_array, NDArray[np.float64]]:
    """Return the matrix without the constant, shifted a little, and the row of the constant."""
    size = gram.basis.shape[0]
    upper = sps.csc_array((gram.value, (gram.first, gram.second)), shape=(size, size))
    matrix = sps.csc_array(upper + sps.triu(upper, 1).T)
    inner, row = matrix[1:][:, 1:], matrix[[0]].toarray().ravel()[1:]
    shift = BOUNDING.shift * np.maximum(1.0, np.abs(inner.diagonal()))
    return sps.csc_array(inner + sps.diags_array(shift)), row


def estimate(gram: ExactGram, objective: Polynomial) -> float:
    """Estimate in floating point the bound that a semidefinite Gram matrix would prove."""
    entries, change, free = open_entries(gram, objective)
    inner, row = semidefinite_part(replace(gram, value=entries + change @ gram.value[free]))
    return float(objective.constant_term - row @ spsolve(inner, row))
