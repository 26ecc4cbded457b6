"""Bounds of single moments, added to a relaxation (``boundSW`` of SparsePOP).

Bounds of variables bound their monomials. Blocks imply many of these bounds: on the diagonal
of a moment matrix nothing is negative, and where all variables lie in [-1, 1] an entry off the
diagonal is at most the larger of two diagonal ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.blocks import BlockGroup
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import monomial_ranges

__all__ = ["moment_bounds"]


def moment_bounds(
    problem: Problem,
    ends: tuple[NDArray[Any], NDArray[Any]],
    words: Words,
    groups: tuple[BlockGroup, ...],
    switch: int,
) -> PolynomialSystem:
    """Bound the monomials x^a of bounded variables by low <= x^a <= high.

    Parameters
    ----------
    problem : Problem
        Scaled, boxed variables within [-1, 1].
    ends : pair of (n,) float
        Bounds of the variables.
    words : (T, D) int32
        The monomials.
    groups : tuple of BlockGroup
        The blocks of the relaxation.
    switch : {0, 1, 2}
        No rows, all with a finite end, or those that the blocks do not imply.

    Returns
    -------
    PolynomialSystem
        The rows x^a - low >= 0 and high - x^a >= 0.
    """
    n = problem.dimension
    ranges = monomial_ranges(words, Interval(*ends))
    low, high = ranges.lo, ranges.hi
    bounded = np.isfinite(ends[0]) & np.isfinite(ends[1])
    known = np.append(True, np.isfinite(ends[0]) | np.isfinite(ends[1]))
    wanted = known[words].all(axis=1) & (switch > 0)
    below, above = wanted & np.isfinite(low), wanted & np.isfinite(high)
    if switch == 2 and bounded.all():
        implied = _implied(problem, words, groups)
        below, above = below & ~implied[0], above & ~implied[1]
    chosen = np.concatenate([np.flatnonzero(below), np.flatnonzero(above)])
    sign = np.repeat([1.0, -1.0], [np.count_nonzero(below), np.count_nonzero(above)])
    value = np.concatenate([-low[below], high[above]])
    number = np.arange(chosen.size)
    constant = np.flatnonzero(value)
    all_words = np.concatenate([words[chosen], np.zeros((constant.size, words.shape[1]), np.int32)])
    row = np.append(number, number[constant])
    order = np.argsort(row, kind="stable")
    coefficients = np.append(sign, value[constant])
    return PolynomialSystem(all_words[order], coefficients[order], row[order], chosen.size, n)


def _implied(
    problem: Problem, words: Words, groups: tuple[BlockGroup, ...]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find monomials that the blocks bound already, from below and from above.

    From below those on the diagonal of a block of 1 or of a bound; from above those on the
    diagonal of a block of an upper bound, and those off the diagonal of a moment matrix, since
    y_ab^2 <= y_aa y_bb.
    """
    n = problem.dimension
    _, low, high = generators.bound_family(len(problem.constraints), n)
    below, above = np.zeros(words.shape[0], bool), np.zeros(words.shape[0], bool)

    def mark(found: NDArray[np.bool_], products: Words) -> None:
        if products.size:
            flat = monomials.trim(products.reshape(-1, products.shape[-1]))
            place = monomials.lookup(flat, words, n)
            found[place[place >= 0]] = True

    for group in groups:
        if group.free:
            continue
        number, basis = group.generator, group.basis
        j, i = np.tril_indices(group.size, -1)
        moment = basis[number == 0]
        mark(below, monomials.multiply(moment, moment))
        mark(above, monomials.multiply(moment[:, i], moment[:, j]))
        for family, found in ((low, below), (high, above)):
            chosen = (family.start <= number) & (number < family.stop)
            letter = (number[chosen] - family.start + 1).astype(np.int32)[:, None, None]
            squares = monomials.multiply(basis[chosen], basis[chosen])
            mark(found, monomials.multiply(squares, letter))
    return below, above
