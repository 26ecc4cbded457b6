"""Solutions of linear equations in rationals, near an approximation in floating point.

The columns that come first are solved for; the others keep simple fractions near their
approximate values. So unknowns that may take any value, and those far from their bounds, absorb
what rounding left.

References
----------
H. Peyrl, P. A. Parrilo, Computing sum of squares decompositions with rational coefficients,
Theoret. Comput. Sci. 409 (2008) 269-281.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

__all__ = ["near_fraction", "projected"]

_SIMPLE = 1000  # denominators tried before that of the double
_CLOSE = Fraction(1, 10**9)  # relative: a simple fraction this near stands for the double
_WORK = 500_000  # products of fractions; dense systems of some hundred unknowns need more
_BITS = 12_000  # longer fractions end the elimination: files hold 4300 digits

Row = dict[int, Fraction]


def near_fraction(value: float) -> Fraction:
    """Choose a simple fraction near a double, else the double itself."""
    exact = Fraction(value)
    simple = exact.limit_denominator(_SIMPLE)
    return simple if abs(simple - exact) <= _CLOSE * (1 + abs(exact)) else exact


def projected(
    rows: list[Row], right: list[Fraction], order: Sequence[int], near: Sequence[Fraction]
) -> list[Fraction] | None:
    """Solve a sparse linear system exactly, near given values.

    Parameters
    ----------
    rows : list of dict of int to Fraction
        Coefficients by column; used up.
    right : list of Fraction
    order : sequence of int
        Columns, those first that are to absorb the change.
    near : sequence of Fraction
        One value a column, kept where the equations leave it open.

    Returns
    -------
    list of Fraction or None
        None where the equations contradict one another, numbers grow too long, or the
        elimination would take too much work.

    Examples
    --------
    >>> one, half = Fraction(1), Fraction(1, 2)
    >>> projected([{0: Fraction(3), 1: one}], [one], [0, 1], [Fraction(0), half])
    [Fraction(1, 6), Fraction(1, 2)]
    """
    meets: dict[int, set[int]] = {}
    for number, row in enumerate(rows):
        for column in row:
            meets.setdefault(column, set()).add(number)
    left = set(range(len(rows)))
    pivots: list[tuple[int, Row, Fraction]] = []
    right, work = list(right), 0
    for column in order:
        held = [k for k in meets.get(column, ()) if k in left and column in rows[k]]
        if not held:
            continue
        number = min(held, key=lambda k: len(rows[k]))
        left.remove(number)
        row, value = rows[number], right[number]
        pivot = row.pop(column)
        work += (len(row) + 1) * len(held)
        if pivot.denominator.bit_length() + pivot.numerator.bit_length() > _BITS or work > _WORK:
            return None
        pivots.append((column, {k: v / pivot for k, v in row.items()}, value / pivot))
        for other in held:
            if other != number:
                right[other] -= _eliminate(rows[other], column, pivots[-1], meets, other)
    if any(right[k] for k in left):
        return None
    values = list(near)
    for column, row, value in reversed(pivots):
        values[column] = value - sum((v * values[k] for k, v in row.items()), Fraction(0))
    return values


def _eliminate(
    row: Row,
    column: int,
    pivot: tuple[int, Row, Fraction],
    meets: dict[int, set[int]],
    number: int,
) -> Fraction:
    """Take a multiple of the pivot's row from another; return that of its right side."""
    factor = row.pop(column)
    for k, v in pivot[1].items():
        rest = row.get(k, Fraction(0)) - factor * v
        if rest:
            row[k] = rest
            meets[k].add(number)
        else:
            row.pop(k, None)
    return factor * pivot[2]
