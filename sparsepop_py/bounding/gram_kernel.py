"""Gram matrices that have the monomials of a minimiser in their kernel.

A matrix Q with f - min f = b'Q b is semidefinite only if Q b(x) = 0 at each minimiser x. These
equations, linear in what the coefficients of f leave open in Q, determine it where little is
open, and no semidefinite program is needed then. Entries that they leave open are kept near 0,
so that squares take what they can.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.linalg import splu, spsolve

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.gram_rounding import (
    entries_of,
    open_entries,
    restricted_to_terms,
    semidefinite_part,
)
from sparsepop_py.bounding.settings import BOUNDING
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.verified.certificate.rational_gram import ExactGram

__all__ = ["grams_with_kernel"]


def grams_with_kernel(
    objective: Polynomial, relaxation: Relaxation, point: NDArray[np.float64]
) -> Iterator[tuple[float, ExactGram]]:
    """Yield nearly semidefinite Gram matrices that vanish at a point, coarse ones first.

    Parameters
    ----------
    objective : Polynomial
    relaxation : Relaxation
        As for :func:`sparsepop_py.bounding.gram_rounding.exact_grams`.
    point : (n,) float
        A minimiser, up to rounding.

    Yields
    ------
    float
        The bound that the matrix seems to prove.
    ExactGram
    """
    linear = np.any(monomials.degrees(objective.words) == 1)
    sparse = restricted_to_terms(objective, relaxation, bool(linear))
    if sparse is None:
        return
    start = ExactGram(*entries_of(sparse, np.zeros(sparse.rows)))
    entries, change, free = open_entries(start, objective)
    if free.size >= start.basis.shape[0]:
        return  # more is open than the minimiser determines
    chosen = _with_kernel(start, entries, change, monomials.evaluate(start.basis, point))
    tried: NDArray[np.float64] | None = None
    for bits in BOUNDING.bits:
        rounded = np.round(chosen * 2.0**bits) / 2.0**bits
        if tried is not None and np.array_equal(rounded, tried):
            continue  # as at the origin, where all equations hold
        tried = rounded
        value = entries + change @ rounded
        expected = _expected(objective, replace(start, value=value))
        if expected > -np.inf:
            yield expected, replace(start, value=value)


def _with_kernel(
    gram: ExactGram,
    entries: NDArray[np.float64],
    change: sps.csc_array,
    monomial: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Choose the open entries by least squares so that rows of monomials but 1 vanish."""
    entry, off = np.arange(gram.first.size), np.flatnonzero(gram.first != gram.second)
    row = np.concatenate([gram.first, gram.second[off]])
    column = np.concatenate([entry, off])
    value = monomial[np.concatenate([gram.second, gram.first[off]])]
    rows = sps.csr_array((value, (row, column)), shape=(gram.basis.shape[0], entry.size))[1:]
    equations, right = sps.csc_array(rows @ change), rows @ entries
    normal = equations.T @ equations
    ridge = BOUNDING.kernel_ridge * max(1.0, float(normal.diagonal().max(initial=0.0)))
    return np.asarray(
        spsolve(
            sps.csc_array(normal + ridge * sps.eye_array(change.shape[1])), -(equations.T @ right)
        )
    ).reshape(-1)


def _expected(objective: Polynomial, gram: ExactGram) -> float:
    """Estimate the bound, -inf where the matrix has a negative eigenvalue."""
    inner, row = semidefinite_part(gram)
    try:
        factor = splu(
            inner,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return -np.inf
    if not factor.U.diagonal().min(initial=np.inf) > 0.0:
        return -np.inf
    return float(objective.constant_term - row @ factor.solve(row))
