"""Solutions of linear equations in rationals, near an approximation in floating point.

The columns that come first are solved for; the others keep simple fractions near their
approximate values. So unknowns that may take any value, and those far from their bounds, absorb
what rounding left. Equations are eliminated in whole numbers without common divisors, which takes
a tenth of the time that fractions take.

References
----------
H. Peyrl, P. A. Parrilo, Computing sum of squares decompositions with rational coefficients,
Theoret. Comput. Sci. 409 (2008) 269-281.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm

from sparsepop_py.budget import check

__all__ = ["near_fraction", "projected"]

_SIMPLE = 1000  # denominators tried before that of the double
_CLOSE = Fraction(1, 10**9)  # relative: a simple fraction this near stands for the double
_WORK = 5_000_000  # products; dense systems of some hundred unknowns need more
_BITS = 12_000  # longer numbers end the elimination: files hold 4300 digits

Row = dict[int, Fraction]
WholeRow = tuple[dict[int, int], int]  # coefficients by column, and the right side
Pivot = tuple[int, int, WholeRow]  # a column, its coefficient, and the rest of its equation


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
        Coefficients by column.
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
    whole = [_whole(row, value) for row, value in zip(rows, right, strict=True)]
    pivots = _pivots(whole, order)
    if pivots is None:
        return None
    values = list(near)
    for column, pivot, (row, value) in reversed(pivots):
        taken = sum((v * values[k] for k, v in row.items()), Fraction(0))
        values[column] = (value - taken) / pivot
    return values


def _pivots(whole: list[WholeRow], order: Sequence[int]) -> list[Pivot] | None:
    """Eliminate the columns that come first; the equations are used up."""
    meets: dict[int, set[int]] = {}
    for number, (row, _) in enumerate(whole):
        for column in row:
            meets.setdefault(column, set()).add(number)
    left = set(range(len(whole)))
    pivots: list[Pivot] = []
    work = 0
    for column in order:
        held = [k for k in meets.get(column, ()) if k in left and column in whole[k][0]]
        if not held:
            continue
        check()
        number = min(held, key=lambda k: len(whole[k][0]))
        left.remove(number)
        row, value = whole[number]
        pivot = row.pop(column)
        work += (len(row) + 1) * len(held)
        if pivot.bit_length() > _BITS or work > _WORK:
            return None
        pivots.append((column, pivot, (row, value)))
        for other in held:
            if other != number:
                whole[other] = _eliminated(whole[other], pivots[-1])
                for k in row.keys() & whole[other][0].keys():
                    meets[k].add(other)
    return None if any(whole[k][1] for k in left) else pivots


def _whole(row: Row, value: Fraction) -> WholeRow:
    """Write an equation in whole numbers without a common divisor."""
    under = lcm(value.denominator, *(v.denominator for v in row.values()))
    return _primitive({k: int(v * under) for k, v in row.items() if v}, int(value * under))


def _primitive(row: dict[int, int], value: int) -> WholeRow:
    """Divide an equation by the greatest common divisor of its numbers."""
    common = gcd(value, *row.values())
    if common <= 1:
        return row, value
    return {k: v // common for k, v in row.items()}, value // common


def _eliminated(equation: WholeRow, pivot: Pivot) -> WholeRow:
    """Take that multiple of the pivot's equation away with which its column vanishes."""
    column, top, (others, right) = pivot
    row, value = equation
    factor = row.pop(column)
    common = gcd(top, factor)
    top, factor = top // common, factor // common
    found = {k: top * v for k, v in row.items()}
    for k, v in others.items():
        found[k] = found.get(k, 0) - factor * v
    return _primitive({k: v for k, v in found.items() if v}, top * value - factor * right)
