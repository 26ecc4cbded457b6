"""Monomials that no multiplier of a relaxation can hold, whatever the program's solution.

In f - gamma = sum_l sigma_l + sum_k sigma_k g_k + sum_j lambda_j h_j compare the coefficients of
one monomial that f lacks. If only squares b^2 of bases contribute to it, times terms of their
g_k of one sign, then their diagonal Gram entries add up to zero, hence are zero, and so are
their rows: these b leave. That goes on until nothing leaves. For sigma_l alone it is
:mod:`sparsepop_py.relaxation.newton_polytope`; here the multipliers of the constraints take part.

References
----------
H. Waki, M. Muramatsu, An extension of the elimination method for a sparse SOS polynomial,
J. Oper. Res. Soc. Japan 54 (2011) 161-190.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.problem.generators import Generators
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks, ragged, row_monomials
from sparsepop_py.relaxation.sparsepop.substitution import Rules

__all__ = ["eliminated"]


@dataclass(frozen=True, eq=False)
class _Terms:
    """Terms that the blocks of one group contribute: one entry a term of a row.

    ``keys`` names the monomial, ``sign`` the sign of the term, 0 where it is rewritten;
    ``block``, ``left`` and ``right`` number the product of the basis that it comes from.
    """

    keys: NDArray[Any]
    sign: NDArray[np.float64]
    block: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]


def eliminated(
    blocks: Blocks, system: Generators, held: Sequence[Words], rules: Rules, degree: int = 0
) -> Blocks:
    """Drop monomials that no multiplier can hold; the value of the relaxation stays.

    Parameters
    ----------
    blocks : list of BlockGroup
        Every block: moment matrices, multipliers of constraints, rows of equations.
    system : Generators
    held : sequence of (T, D) words
        Monomials of the objectives.
    rules : Rules
        Equations that are substituted: monomials that they rewrite stay.
    degree : int
        Monomials of moment matrices below it stay.

    Returns
    -------
    list of BlockGroup
    """
    plain = [block for block in blocks if not block.free and block.place is None]
    others = [block for block in blocks if block.free or block.place is not None]
    constant = np.zeros((1, 1), np.int32)
    words = [constant, *held, *(row_monomials(block, system) for block in others)]
    width = max(1, *(part.shape[1] for part in words))
    width = max([width, *(row_monomials(block, system).shape[1] for block in plain)])
    known = np.unique(np.concatenate([_keys(part, width, rules, system) for part in words]))
    parts = [_terms(block, system, rules, width) for block in plain]
    kept = [np.ones(block.basis.shape[:2], bool) for block in plain]
    low = [
        (block.generator == 0)[:, None] & (monomials.degrees(block.basis) < degree)
        for block in plain
    ]
    while True:
        matched = _matched(parts, kept, known)
        shrunk = []
        for part, keep, stays in zip(parts, kept, low, strict=True):
            keep = keep.copy()
            alone = (part.left == part.right) & ~np.isin(part.keys, matched)
            keep[part.block[alone], part.left[alone]] = False
            shrunk.append(keep | stays)
        if all(np.array_equal(a, b) for a, b in zip(kept, shrunk, strict=True)):
            break
        kept = shrunk
    left = [part for block, keep in zip(plain, kept, strict=True) for part in ragged(block, keep)]
    return [*others, *(block for block in left if block.size)]


def _terms(block: BlockGroup, system: Generators, rules: Rules, width: int) -> _Terms:
    row, words, coefficients = block.terms(system)
    words = monomials.widen(words, width)
    alive = ~rules.vanish(words)
    row, words, coefficients = row[alive], words[alive], coefficients[alive]
    i, j = block.pairs
    sign = np.where(rules.divides(words), 0.0, np.sign(coefficients))
    which = row % block.rows_each
    keys = _keys(words, width, rules, system)
    return _Terms(keys, sign, row // block.rows_each, i[which], j[which])


def _keys(words: Words, width: int, rules: Rules, system: Generators) -> NDArray[Any]:
    return monomials.pack(rules.rewritten(monomials.widen(words, width)), system.dimension)


def _matched(
    parts: Sequence[_Terms], kept: Sequence[NDArray[Any]], known: NDArray[Any]
) -> NDArray[Any]:
    """Find monomials whose coefficients do not force squares to vanish."""
    found, up, down = [known], [known[:0]], [known[:0]]
    for part, keep in zip(parts, kept, strict=True):
        alive = keep[part.block, part.left] & keep[part.block, part.right]
        square = part.left == part.right
        found.append(part.keys[alive & (~square | (part.sign == 0))])
        up.append(part.keys[alive & square & (part.sign > 0)])
        down.append(part.keys[alive & square & (part.sign < 0)])
    both = np.intersect1d(np.concatenate(up), np.concatenate(down))
    return np.unique(np.concatenate([*found, both]))
