"""Substitution of equations with at most two terms.

An equation x^2 = c, x^2 = c x, x = c or x y = 0 rewrites every multiple of its leading
monomial. The rewriting is read off the equation itself, coefficients included, and enters a
relaxation as the rows L(h x^a) = 0, one for each monomial that it rewrites; the monomials
themselves leave all bases. In a certificate these rows are ordinary multipliers of h.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks, ragged

__all__ = ["KINDS", "Rules"]

Letters = tuple[int, ...]


def _letters(polynomial: Polynomial) -> list[Letters]:
    return [tuple(v for v in word if v) for word in polynomial.words.tolist()]


def _square(terms: list[Letters]) -> bool:
    return len(terms) == 2 and terms[0] == () and _is_square(terms[1])


def _binary(terms: list[Letters]) -> bool:
    return len(terms) == 2 and _is_square(terms[1]) and terms[0] == terms[1][:1]


def _is_square(word: Letters) -> bool:
    return len(word) == 2 and word[0] == word[1]


def _fixed(terms: list[Letters]) -> bool:
    return len(terms[-1]) == 1 and (len(terms) == 1 or (len(terms) == 2 and terms[0] == ()))


def _zero(terms: list[Letters]) -> bool:
    return len(terms) == 1 and len(terms[0]) == 2 and terms[0][0] != terms[0][1]


KINDS: dict[str, Callable[[list[Letters]], bool]] = {
    "square": _square,
    "binary": _binary,
    "fixed": _fixed,
    "zero": _zero,
}


@dataclass(frozen=True, eq=False)
class Rules:
    """Equations of a problem that are substituted.

    Parameters
    ----------
    generator : (K,) int
        Their numbers as in :mod:`sparsepop_py.problem.generators`.
    leading : (K, 2) int32
        The word that each of them rewrites.
    rest : (K, 2) int32
        The word that takes its place.
    vanishes : (K,) bool
        Nothing takes its place.
    """

    generator: NDArray[np.int64]
    leading: Words
    rest: Words
    vanishes: NDArray[np.bool_]

    @staticmethod
    def of(problem: Problem, kinds: tuple[str, ...]) -> Rules:
        """Collect the equations of the kinds asked for, one for each leading monomial."""
        found: dict[Letters, tuple[int, Letters, bool]] = {}
        for number in np.flatnonzero(problem.equality):
            polynomial = problem.constraints[number].polynomial
            if not polynomial.terms or polynomial.terms > 2:
                continue
            terms = _letters(polynomial)
            if any(KINDS[kind](terms) for kind in kinds):
                first = terms[0] if len(terms) > 1 else ()
                found.setdefault(terms[-1], (int(number) + 1, first, len(terms) == 1))
        numbers = np.array([number for number, _, _ in found.values()], np.int64)
        vanishes = np.array([alone for _, _, alone in found.values()], bool)
        return Rules(numbers, _two(found), _two(w for _, w, _ in found.values()), vanishes)

    def which(self, words: Words) -> NDArray[np.int64]:
        """Find the first rule that rewrites each word (..., D), -1 for none."""
        first = np.full(words.shape[:-1], -1)
        for number in range(self.generator.size - 1, -1, -1):
            a, b = self.leading[number].tolist()
            holds = np.count_nonzero(words == b, axis=-1) >= (2 if a == b else 1)
            if a and a != b:
                holds &= (words == a).any(axis=-1)
            first[holds] = number
        return first

    def divides(self, words: Words) -> NDArray[np.bool_]:
        """Mark the words (..., D) that are rewritten."""
        return self.which(words) >= 0

    def vanish(self, words: Words) -> NDArray[np.bool_]:
        """Mark words (..., D) with a product that is zero, whatever the others become."""
        alone = self.vanishes
        if not alone.any():
            return np.zeros(words.shape[:-1], bool)
        only = Rules(self.generator[alone], self.leading[alone], self.rest[alone], alone[alone])
        return only.divides(words)

    def rewritten(self, words: Words) -> Words:
        """Rewrite each word (T, D), coefficients aside; words that vanish stay."""
        if not self.generator.size:
            return words
        words = words.copy()
        while True:
            which = self.which(words)
            which = np.where(which >= 0, np.where(self.vanishes[which], -1, which), -1)
            if np.all(which < 0):
                return words
            for number in np.unique(which[which >= 0]):
                rows = which == number
                shift = _quotient(words[rows], self.leading[number])
                joined = monomials.multiply(shift, self.rest[number][None, :])
                words[rows] = joined[:, joined.shape[1] - words.shape[1] :]

    def binary(self, problem: Problem) -> NDArray[np.bool_]:
        """Mark variables with a rule x^2 = c x and bounds that say the same."""
        found = np.zeros(problem.dimension, bool)
        for k, number in enumerate(self.generator.tolist()):
            if self.rest[k].any() and self.leading[k].all():
                p = problem.constraints[number - 1].polynomial
                other = -p.coefficients[0] / p.coefficients[1]
                v = int(self.rest[k].max()) - 1
                found[v] = problem.lower[v] <= 0 and problem.upper[v] >= other * (1 - 1e-9) > 0
        return found

    def normal(self, blocks: Blocks) -> Blocks:
        """Drop the monomials that are rewritten from blocks."""
        if not self.generator.size:
            return blocks
        return [part for block in blocks for part in ragged(block, ~self.divides(block.basis))]

    def rows(self, words: Words, n: int) -> Blocks:
        """Build a row L(h x^a) = 0 for each word that is rewritten, repeatedly."""
        blocks = Blocks()
        done = np.zeros((0, 1), np.int32)
        while True:
            which = self.which(words)
            words, which = words[which >= 0], which[which >= 0]
            new = monomials.lookup(words, done, n) < 0 if done.shape[0] else which >= 0
            words, which = words[new], which[new]
            if not words.shape[0]:
                return blocks
            done, _ = monomials.collect(monomials.stack([done[done.any(axis=1)], words]), n)
            further = []
            for number in np.unique(which):
                shift = _quotient(words[which == number], self.leading[number])
                generator = np.full(shift.shape[0], self.generator[number])
                blocks.append(BlockGroup(True, generator, generator * 0, shift[:, None, :]))
                if not self.vanishes[number]:
                    further.append(monomials.multiply(shift, self.rest[number][None, :]))
            words = monomials.trim(monomials.stack([*further, np.zeros((0, 1), np.int32)]))


def _two(words: Iterable[Letters]) -> Words:
    padded = [(0,) * (2 - len(word)) + word for word in words]
    return np.array(padded, np.int32).reshape(-1, 2)


def _quotient(words: Words, leading: Words) -> Words:
    """Divide words by one that divides them all."""
    rest = words.copy()
    for letter in leading[leading > 0].tolist():
        rest[np.arange(rest.shape[0]), np.argmax(rest == letter, axis=1)] = 0
    rest.sort(axis=1)
    return rest
