"""Rows of a record one by one: |Y + R m| <= w0 + W |m|, noise at its largest effect.

The columns m are the parameters, or sums of products of them.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.polynomial import INF, Word, split
from ..certificates.left_inverse import contracts
from ..files.reading import Malformed, alike, below, each, fields, item, together
from ..result import NotProved
from .box import ZERO, Ends, hull, met, move, no_point, walk

MULTIPLIERS = each(together("i", "q"))  # rows and rationals


def bound_rows(lower: list[Any], upper: list[Any]) -> list[list[Any]]:
    """Write the bounds as rows, lower ones first: slopes, then the constant or INF."""
    n = len(lower)
    rows = [[*(Fraction(j == v) for j in range(n)), -lower[v]] for v in range(n)]
    return rows + [[*(Fraction(-(j == v)) for j in range(n)), upper[v]] for v in range(n)]


class Regression:
    """The rows of a record in columns, each the sum of some products of parameters."""

    def __init__(self, about: Any, columns: list[list[Word]]) -> None:
        self.about, self.columns, self.count = about, columns, len(columns)
        self.places = {name: v for v, name in enumerate(about.names)}
        self._known: dict[tuple[int, int], tuple[list[Fraction], list[Fraction]]] = {}

    def row(self, output: int, k: int, place: str = "box") -> tuple[list[Any], list[Any]]:
        """Take R and W of an output (from 1) and sample, Y and w0 behind."""
        key = output, k
        if key not in self._known:
            record, structure = self.about.record, self.about.structure
            below([output - 1], len(record.y), f"{place}: output")
            below([k], record.samples, f"{place}: sample")
            terms = record.row(structure.direct(output - 1), self.places, k, structure.zero)
            pairs = [self._spread(factors, place) for factors in self._split(terms, place)]
            centre, radius = ([pair[side] for pair in pairs] for side in (0, 1))
            radius[-1] += record.bounds["equation"][output - 1][k]
            self._known[key] = centre, radius
        return self._known[key]

    def _split(self, terms: dict[Word, Fraction], place: str) -> list[dict[Word, Fraction]]:
        """Collect the factor of each column, in unknowns that are no parameters; the rest last."""
        nonzero = {word: value for word, value in terms.items() if value}
        found, parts = split(nonzero, range(1, len(self.places) + 1)), []
        for column in self.columns:
            shared = [found.pop(monomial, {}) for monomial in column]
            if any(other != shared[0] for other in shared):
                raise NotProved(f"{place}: products of one column multiply different signals")
            parts.append(shared[0])
        parts.append(found.pop((), {}))
        if found:
            raise Malformed(f"{place}: a row with a product of parameters that is no column")
        return parts

    def _spread(self, factors: dict[Word, Fraction], place: str) -> tuple[Fraction, Fraction]:
        """The middle of a sum of numbers and bounded unknowns, and how far it may be away."""
        centre, radius, problem = ZERO, ZERO, self.about.problem
        for word, value in factors.items():
            if not word:
                centre += value
                continue
            (v,) = (letter - 1 for letter in word)
            low, high = problem.lower[v], problem.upper[v]
            if low == -INF or high == INF:
                raise Malformed(f"{place}: a row with an unknown that is not bounded")
            centre += value * self.about.units[v] * (low + high) / 2
            radius += abs(value) * self.about.units[v] * (high - low) / 2
        return centre, radius


def by_inverse(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Prove |m - centre| <= radius by rows with intervals of Y and R."""
    kinds = {"inverse": "e**", "centre": "e*", "radius": "e*"}
    got = fields(step, place, 0, rows=each(together("i", "i")), **kinds)
    table = []
    for number, (output, k) in enumerate(got.rows):
        pairs = zip(*rows.row(output, k, f"{place}.rows[{number}]"), strict=True)
        table.append([iv.around(a - r, a + r) for a, r in pairs])
    alike(place, got.inverse, got.centre, got.radius, range(rows.count))
    alike(place, table, *got.inverse)
    given = got.inverse, table, got.centre, got.radius
    if any(not r > 0 for r in got.radius) or not contracts(*given):
        raise NotProved(f"{place}: the left inverse of the rows does not give its box")
    ball = list(zip(got.centre, got.radius, strict=True))
    return met(ends, [m - r for m, r in ball], [m + r for m, r in ball])


def by_tree(step: Any, rows: Regression, ends: Ends, place: str = "box") -> Ends:
    """Enclose what linear programs prove on the parts that signs of parameters make."""
    found: list[Ends] = []

    def parts(_: int, node: Any, part: Ends) -> list[Ends]:
        if node.split < 0:
            found.append(leaf(node, rows, part))
            return []
        below([node.split], rows.count, f"{node.where}.split")
        left, right = ([list(side) for side in part] for _ in range(2))
        move(left, node.split, 1, ZERO)
        move(right, node.split, 0, ZERO)
        return [left, right]

    kinds = {"rows": each(together("i", "i", "i", "e*")), "bounds": each(bound_of)}
    walk(item(step, "nodes", place), f"{place}.nodes", [ends], parts, split="i", **kinds)
    return hull(found, rows.count)


def bound_of(found: Any, n: int, place: str) -> Any:
    """Read the multipliers of an end, or of rows that nothing satisfies."""
    return fields(found, place, n, multipliers=MULTIPLIERS, empty="b")


def leaf(node: Any, rows: Regression, part: Ends) -> Ends:
    """Shrink a part by linear programs; an end without multipliers stays as it is."""
    p = rows.count
    places = (f"{node.where}.rows[{k}]" for k in range(len(node.rows)))
    known = [given_row(row, rows, part, at) for row, at in zip(node.rows, places, strict=True)]
    known += bound_rows(*part)
    found = [list(side) for side in part]
    if len(node.bounds) not in (0, 1, 2 * p):
        raise Malformed(f"{node.where}.bounds: not one for each end")
    for number, got in enumerate(node.bounds):
        v, side = divmod(number, 2)
        if got.empty:
            combined(known, got.multipliers, None, got.where)
            return no_point(p)
        if got.multipliers:
            move(found, v, side, combined(known, got.multipliers, (v, side), got.where))
    return found


def given_row(row: Any, rows: Regression, part: Ends, place: str = "box") -> list[Fraction]:
    """Derive a linear row a theta + b >= 0 from a record's row.

    What it exceeds w0 + W |theta| - s (Y + R theta) by is concave in each parameter, so that its
    least value over the part is at ends. Towards an infinite end it must not fall.
    """
    output, k, sign, a = row
    centre, radius = rows.row(output, k, place)
    if len(a) != len(centre) or sign not in (1, -1):
        raise Malformed(f"{place}: a row of another length, or no sign")
    least: Any = a[-1] - radius[-1] + sign * centre[-1]
    for j in range(rows.count):
        rest = a[j] + sign * centre[j]
        values = []
        for end in (part[0][j], part[1][j]):
            if end in (INF, -INF):
                falls = (rest if end > 0 else -rest) < radius[j]
                values.append(-INF if falls else ZERO)
            else:
                values.append(rest * end - radius[j] * abs(end))
        least = -INF if -INF in values or least == -INF else least + min(values)
    if not least >= 0:
        raise NotProved(f"{place}: the row does not follow from the record")
    return a


def combined(
    rows: list[list[Any]],
    multipliers: list[Any],
    goal: tuple[int, int] | None,
    place: str = "multipliers",
    equal: set[int] | None = None,
) -> Any:
    """Bound x_v (goal v, 0) or -x_v (goal v, 1) by multipliers of rows.

    Without a goal they prove that nothing satisfies the rows, and the bound is INF.
    """
    total = [ZERO] * len(rows[0])
    for number, (row, value) in enumerate(multipliers):
        if not 0 <= row < len(rows) or rows[row][-1] in (INF, -INF):
            raise Malformed(f"{place}[{number}]: of a row that does not exist")
        if value < 0 and row not in (equal or ()):
            raise NotProved(f"{place}[{number}]: that of an inequality is negative")
        total = [a + value * b if b else a for a, b in zip(total, rows[row], strict=True)]
    wanted = [ZERO] * (len(total) - 1)
    if goal is not None:
        wanted[goal[0]] = Fraction(1 - 2 * goal[1])
    if total[:-1] != wanted or (goal is None and not total[-1] < 0):
        raise NotProved(f"{place}: they do not add up to the linear program's objective")
    return INF if goal is None else -total[-1]
