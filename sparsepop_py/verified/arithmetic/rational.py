"""Linear systems in rationals, exact to the last digit."""

from __future__ import annotations

from fractions import Fraction

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.budget import check

__all__ = ["solve_matrix", "solve_rationally"]


def solve_rationally(
    system: PolynomialSystem, x: list[Fraction], solved: list[int]
) -> dict[int, Fraction] | None:
    """Solve the rows, linear in ``solved``, exactly; None if they are not, or are singular."""
    unknown = set(solved)
    table: list[dict[int, Fraction]] = [{} for _ in range(system.size)]
    for letters, coefficient, row in zip(
        system.words.tolist(), system.coefficients.tolist(), system.row.tolist(), strict=True
    ):
        term, column = Fraction(coefficient), -1
        for letter in letters:
            if not letter:
                continue
            if letter - 1 in unknown:
                if column >= 0:
                    return None
                column = letter - 1
            else:
                term *= x[letter - 1]
        table[row][column] = table[row].get(column, Fraction(0)) + term
    return _eliminate(table)


def _eliminate(table: list[dict[int, Fraction]]) -> dict[int, Fraction] | None:
    """Sparse rational elimination; key -1 holds the constant of each row (row sum = 0)."""
    open_rows = set(range(len(table)))
    where: dict[int, set[int]] = {}
    for number, row in enumerate(table):
        for key in row:
            where.setdefault(key, set()).add(number)
    order: list[tuple[int, dict[int, Fraction]]] = []
    while open_rows:
        check()
        number = min(open_rows, key=lambda r: len(table[r]))
        open_rows.remove(number)
        row = {key: value for key, value in table[number].items() if value or key == -1}
        columns = [key for key in row if key >= 0]
        if not columns:
            return None
        column = min(columns, key=lambda key: len(where[key]))
        pivot = row.pop(column)
        order.append((column, {key: -value / pivot for key, value in row.items()}))
        for other in where[column] & open_rows:
            factor = table[other].pop(column, Fraction(0))
            for key, value in order[-1][1].items():
                table[other][key] = table[other].get(key, Fraction(0)) + factor * value
                where.setdefault(key, set()).add(other)
    values = {-1: Fraction(1)}
    for column, row in reversed(order):
        values[column] = sum((values[key] * value for key, value in row.items()), Fraction(0))
    del values[-1]
    return values


def solve_matrix(
    matrix: list[list[Fraction]], right: list[list[Fraction]]
) -> list[list[Fraction]] | None:
    """Solve a dense square system by Gauss and Jordan; None if it is singular.

    Parameters
    ----------
    matrix : list of list of Fraction
        One row each.
    right : list of list of Fraction
        Right sides, one row for each row of the matrix.

    Examples
    --------
    >>> solve_matrix([[Fraction(3)]], [[Fraction(2)]])
    [[Fraction(2, 3)]]
    """
    size = len(matrix)
    rows = [[*line, *values] for line, values in zip(matrix, right, strict=True)]
    for column in range(size):
        pivot = next((i for i in range(column, size) if rows[i][column]), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        first = rows[column][column]
        rows[column] = [value / first for value in rows[column]]
        for i in range(size):
            factor = rows[i][column]
            if i != column and factor:
                pairs = zip(rows[i], rows[column], strict=True)
                rows[i] = [a - factor * b for a, b in pairs]
    return [row[size:] for row in rows]
