"""Semidefinite matrices in rationals, and sums of squares that are exact."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from ..arithmetic.polynomial import INF, Polynomial
from ..files.reading import Malformed, alike, below, fields

Rows = dict[int, dict[int, Fraction]]


def eliminated(rows: Rows, last: int | None, pair: Callable[[Fraction], None]) -> bool:
    """Check whether a symmetric matrix is positive semidefinite but for one row.

    Rows other than ``last`` are eliminated. What each elimination takes from the diagonal entry
    of row ``last`` goes to ``pair``.
    """
    depth = dict.fromkeys(rows, 0)
    while len(rows) > (last in rows):
        i = min((k for k in rows if k != last), key=lambda k: (len(rows[k]).bit_length(), depth[k]))
        row = rows.pop(i)
        pivot = row.pop(i, Fraction(0))
        if pivot < 0 or (row and not pivot):
            return False
        for j in row:
            del rows[j][i]
            depth[j] = max(depth[j], depth[i] + 1)
        others = list(row.items())
        for place, (j, value) in enumerate(others):
            share = value / pivot
            for k, other in others[place:]:
                if j == k == last:
                    pair(share * other)
                else:
                    add(rows, j, k, -share * other)
    return True


def add(rows: Rows, i: int, j: int, value: Fraction) -> None:
    """Change an entry and its mirror image by a value; what becomes zero is left out."""
    changed = value + rows[i].pop(j, Fraction(0))
    rows[j].pop(i, None)
    if changed:
        rows[i][j] = rows[j][i] = changed


def semidefinite(matrix: list[list[Fraction]]) -> bool:
    """Check whether a symmetric matrix of rationals is positive semidefinite."""
    rows = {i: {j: v for j, v in enumerate(row) if v} for i, row in enumerate(matrix)}
    return eliminated(rows, None, lambda _: None)


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
        if not eliminated(rows, 0, hidden.append):
            return -INF
        while len(hidden) > 1:  # in pairs, so that long denominators meet near the end
            hidden = [sum(hidden[k : k + 2], Fraction(0)) for k in range(0, len(hidden), 2)]
        return constant - sum(hidden, Fraction(0))
