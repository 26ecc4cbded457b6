"""Sums of squares that are exact."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from ..arithmetic.polynomial import INF, Polynomial
from ..files.reading import Malformed, alike, below, fields
from .elimination import Rows, add, pivoted


class ExactGram:
    """f - c = b' Q b with entries of Q as stored, but for one a monomial, which takes the rest."""

    def __init__(self, found: Any, n: int, place: str) -> None:
        kinds = {"basis": "w2", "first": "i1", "second": "i1", "value": "f1"}
        got = fields(found, place, n, **kinds)
        self.basis = got.basis
        self.entries = list(zip(got.first, got.second, got.value, strict=False))
        alike(place, got.first, got.second, got.value)
        below([*got.first, *got.second], len(got.basis), place)
        if got.basis.count(()) != 1 or got.basis[0]:
            raise Malformed(f"{place}.basis: the constant has to be the first word and no other")

    def prove(self, objective: Polynomial) -> Any:
        """Prove the lower bound of the objective over all space, -INF without one."""
        return self.below(objective.open(), objective.coefficient())

    def below(self, rest: dict[tuple[int, ...], Fraction], constant: Fraction) -> Any:
        """Prove the same of a polynomial's words but 1, which are used up, and constant."""
        rows: Rows = {i: {} for i in range(len(self.basis))}
        taker: dict[tuple[int, ...], tuple[int, int]] = {}
        for i, j, value in self.entries:
            letters = tuple(sorted(self.basis[i] + self.basis[j]))
            if letters not in taker:
                taker[letters] = i, j
                continue
            taken = Fraction(value) * (1 if i == j else 2)
            rest[letters] = rest.get(letters, Fraction(0)) - taken
            add(rows, i, j, Fraction(value))
        rest.pop((), None)
        for letters, coefficient in rest.items():
            if letters not in taker and coefficient:
                return -INF
        for letters, (i, j) in taker.items():
            if letters:
                add(rows, i, j, rest.get(letters, Fraction(0)) / (1 if i == j else 2))
        hidden: list[Fraction] = []
        if not pivoted(rows, 0, hidden.append):
            return -INF
        while len(hidden) > 1:  # in pairs, so that long denominators meet near the end
            hidden = [sum(hidden[k : k + 2], Fraction(0)) for k in range(0, len(hidden), 2)]
        return constant - sum(hidden, Fraction(0))
