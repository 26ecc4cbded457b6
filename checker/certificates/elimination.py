"""Elimination in rationals: semidefinite matrices, and linear equations."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

Rows = dict[int, dict[int, Fraction]]


def pivoted(rows: Rows, last: int | None, pair: Callable[[Fraction], None]) -> bool:
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
    return pivoted(rows, None, lambda _: None)


# ---- equations --------------------------------------------------------------------------------

Row = dict[int, Fraction]  # a sum of unknowns 0, 1, ... and of known numbers -1, -2, ..., zero


def eliminated(table: list[Row]) -> list[tuple[int, Row]] | None:
    """Solve each row for an unknown in terms of others that come later, the rows of fewest first.

    The rows are used up. None where they determine no solution.
    """
    done: list[tuple[int, Row]] = []
    while table:
        table.sort(key=len, reverse=True)
        row = table.pop()
        columns = [key for key in row if key >= 0]
        if not columns:
            return None
        column = min(columns, key=lambda key: sum(key in other for other in table))
        pivot = row.pop(column)
        rest = {key: -value / pivot for key, value in row.items()}
        done.append((column, rest))
        for other in table:
            factor = other.pop(column, None)
            if factor is None:
                continue
            for key, value in rest.items():
                other[key] = other.get(key, Fraction(0)) + factor * value
                if not other[key] and key >= 0:
                    del other[key]
    return done


def solution(done: list[tuple[int, Row]], known: Row) -> Row:
    """Compute the unknowns from the known numbers."""
    found = dict(known)
    for column, rest in reversed(done):
        found[column] = sum((found[key] * value for key, value in rest.items()), Fraction(0))
    return {key: value for key, value in found.items() if key >= 0}
