"""Rational multipliers of constraints and bounds, and an exact sum of squares for the rest."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from ..arithmetic.polynomial import INF, Polynomial, Terms, add_terms
from ..files.reading import Malformed, alike, below, fields, perhaps
from .gram import ExactGram
from .identity import Row


class ExactDual:
    """f - sum of multipliers times words times rows: a constant, or a sum of squares and one."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds = {"lower": "F1", "upper": "F1", "row": "i1", "word": "w2", "value": "q*"}
        got = fields(found, place, n, gram=perhaps(ExactGram), **kinds)
        self.lower, self.upper, self.gram, self.place = got.lower, got.upper, got.gram, place
        alike(place, got.lower, got.upper, range(n))
        alike(place, got.row, got.word, got.value)
        self.terms = list(zip(got.row, got.word, got.value, strict=True))

    def holds(self, ends: list[tuple[Any, Any]]) -> bool:
        """Check whether a box lies within the bounds that are assumed."""
        sides = zip(ends, self.lower, self.upper, strict=True)
        return all(a <= low and high <= b for (low, high), a, b in sides)

    def prove(self, rows: list[Row], objective: Polynomial) -> Any:
        """Prove the lower bound within the bounds assumed, -INF where nothing is proved."""
        m, n = len(rows), len(self.lower)
        below([row for row, _, _ in self.terms], m + 2 * n, f"{self.place}.row")
        rest: Terms = objective.coefficients()
        for row, word, value in self.terms:
            free = row < m and rows[row].equality
            if not free and (word or value < 0):
                raise Malformed(f"{self.place}: a monomial or a sign at no equality")
            add_terms(rest, self._row(rows, row).coefficients(), word, -value)
        constant = rest.pop((), Fraction(0))
        rest = {word: value for word, value in rest.items() if value}
        if self.gram is not None:
            return self.gram.below(rest, constant)
        return -INF if rest else constant

    def _row(self, rows: list[Row], row: int) -> Polynomial:
        m, n = len(rows), len(self.lower)
        if row < m:
            return rows[row].polynomial
        side, v = divmod(row - m, n)
        end = (self.lower, self.upper)[side][v]
        if end in (INF, -INF):
            raise Malformed(f"{self.place}: a multiplier of a bound that is not there")
        slope = 1 if side == 0 else -1
        return Polynomial.affine(v + 1, slope, -slope * end)
