"""Boxes, and one sweep of interval propagation over rows of polynomials.

A row says that a sum of atoms lies in [low, high]. An atom is a term c x1^p1 x2^p2 ..., or
c1 x + c2 x^2 taken together. All atoms get a range over the box with which the sweep begins.
An atom then lies in what the row leaves when the ranges of the others are taken off, and each
variable in what the atom leaves when the ranges of its other factors are divided off. First come
the atoms c1 x + c2 x^2 of all rows, then the last factors of all terms, the factors before, ....
"""

from __future__ import annotations

from typing import NamedTuple

from ..arithmetic import interval as iv
from ..arithmetic.interval import WHOLE, End, Interval
from ..arithmetic.polynomial import INF, Polynomial, powers

Factors = list[tuple[int, int]]
_FAR = iv.above(2**1024)  # beyond all doubles


class Box:
    """Intervals of all variables; it holds no point where a lower end lies above the upper one.

    ``stale`` holds the variables that changed since the last sweep with and without a cutoff:
    a row none of whose variables changed says what it said before, unless an even root has to
    choose its branch by the box as it is by then.
    """

    def __init__(self, ends: list[Interval], stale: dict[bool, set[int]] | None = None) -> None:
        self.ends = ends
        every = range(len(ends))
        self.stale = {False: set(every), True: set(every)} if stale is None else stale

    def copy(self) -> Box:
        """Copy the box, to be changed apart."""
        return Box(list(self.ends), {key: set(value) for key, value in self.stale.items()})

    def shrink(self, variable: int, low: End, high: End) -> None:
        """Intersect with low <= x_variable <= high; beyond all doubles an end says no more.

        Sweeps may square ends without end, and so double their digits each time.
        """
        old = self.ends[variable]
        if not low > high:
            low, high = _within_reach(low), -_within_reach(-high)
        new = iv.met(old, (low, high))
        if new != old:
            self.ends[variable] = new
            for stale in self.stale.values():
                stale.add(variable)

    @property
    def empty(self) -> bool:
        """True if a lower end lies above the upper one."""
        return any(low > high for low, high in self.ends)


def _within_reach(low: End) -> End:
    """Weaken a lower end that is beyond all doubles."""
    return -INF if low < -_FAR else min(low, _FAR)


class Square(NamedTuple):
    """The atom c1 x + c2 x^2, with place and value of its extremum."""

    variable: int
    c1: Interval
    c2: Interval
    place: Interval
    depth: Interval

    def range(self, x: Interval) -> Interval:
        """Enclose the atom over an interval."""
        ends = [self._at(end) for end in x]
        low, high = min(e[0] for e in ends), max(e[1] for e in ends)
        if self.place[0] <= x[1] and self.place[1] >= x[0]:
            upwards = self.c2[1] > 0
            low, high = (
                (min(low, self.depth[0]), high) if upwards else (low, max(high, self.depth[1]))
            )
        return low, high

    def _at(self, end: End) -> Interval:
        if end in (INF, -INF):
            far = INF if self.c2[1] > 0 else -INF
            return far, far
        return iv.times((end, end), iv.plus(self.c1, iv.times(self.c2, (end, end))))

    def solve(self, asked: Interval, x: Interval) -> Interval:
        """Enclose the z of x with the atom in ``asked``; ends cross where there is none."""
        squares = iv.quotient(iv.minus(asked, self.depth), self.c2)  # of the way to the extremum
        found = iv.roots(squares, 2, iv.minus(x, self.place))
        return found if found[0] > found[1] else iv.plus(found, self.place)


def square_of(variable: int, c1: int, c2: int, exp: int) -> Square:
    """Make the atom (c1 x + c2 x^2) 2**exp: extreme at -c1 / (2 c2), where it is -c1^2 / (4 c2)."""
    place = iv.quotient(iv.scaled(-c1, 0), iv.scaled(2 * c2, 0))
    depth = iv.quotient(iv.scaled(-c1 * c1, exp), iv.scaled(4 * c2, 0))
    return Square(variable, iv.scaled(c1, exp), iv.scaled(c2, exp), place, depth)


class Row:
    """A polynomial that lies in ``target``, split into atoms."""

    def __init__(self, polynomial: Polynomial, target: Interval) -> None:
        exp, terms = polynomial.exp, {w: c for w, c in polynomial.terms.items() if c}
        self.target = target
        self.variables = {letter - 1 for word in terms for letter in word}
        self.squares: list[Square] = []
        for variable in sorted(self.variables):
            one, two = (variable + 1,), (variable + 1, variable + 1)
            if one in terms and two in terms:
                self.squares.append(square_of(variable, terms.pop(one), terms.pop(two), exp))
        self.terms = [(iv.scaled(value, exp), powers(word)) for word, value in terms.items()]
        self.branches = any(n % 2 == 0 for _, factors in self.terms for _, n in factors)

    def matters(self, stale: set[int]) -> bool:
        """Check whether it may say more than before these variables changed.

        A constant that is not in ``target`` leaves no point, whatever has changed.
        """
        if not self.variables:
            return True
        return bool(stale) and (self.branches or not stale.isdisjoint(self.variables))


class Rows:
    """Rows, and triples a, b, c of them with a^2 <= b c, as matrices imply."""

    def __init__(self, rows: list[Row], minors: list[tuple[int, int, int]]) -> None:
        self.rows = rows
        self.minors = minors

    def sweep(self, box: Box, uses_cutoff: bool) -> None:
        """Sweep once, in place; the box is empty where no point is left."""
        stale = box.stale[uses_cutoff]
        chosen = [r for r in self.rows if self.minors or r.matters(stale)]
        box.stale[uses_cutoff] = set()
        if uses_cutoff:  # the other rows are among these
            box.stale[False] = set()
        begin = list(box.ends)
        ranges = [_ranges(row, begin) for row in chosen]
        targets = self._targets(ranges) if self.minors else [row.target for row in chosen]
        work: list[list[tuple[Factors, list[Interval], Interval, Interval]]] = []
        for row, known, target in zip(chosen, ranges, targets, strict=True):
            allowed = _allowed(known, target)
            if allowed is None:
                return box.shrink(0, INF, -INF)
            for square, asked in zip(row.squares, allowed, strict=False):
                box.shrink(square.variable, *square.solve(asked, begin[square.variable]))
            for (value, factors), asked in zip(row.terms, allowed[len(row.squares) :], strict=True):
                while len(work) < len(factors):
                    work.append([])
                parts = [iv.power(begin[v], n) for v, n in factors]
                for place in range(len(factors)):
                    work[place].append((factors, parts, value, asked))
        for place in reversed(range(len(work))):
            for factors, parts, value, asked in work[place]:
                _solve_factor(box, place, factors, parts, value, asked)

    def _targets(self, ranges: list[list[Interval]]) -> list[Interval]:
        """Find where rows must lie, with |a| <= sqrt(b c) for the upper ends of b and c."""
        found = [row.target for row in self.rows]
        for a, b, c in self.minors:
            ends = [iv.total(ranges[k])[1] for k in (b, c)]
            product = iv.times((0, max(ends[0], 0)), (0, max(ends[1], 0)))[1]
            reach = iv.root_above(product, 2)
            found[a] = iv.met(found[a], (-reach, reach))
        return found


def _ranges(row: Row, box: list[Interval]) -> list[Interval]:
    """Enclose the ranges of all atoms: first those with a square, then the terms."""
    found = [square.range(box[square.variable]) for square in row.squares]
    for value, factors in row.terms:
        for variable, n in factors:
            value = iv.times(value, iv.power(box[variable], n))
        found.append(value)
    return found


def _allowed(ranges: list[Interval], target: Interval) -> list[Interval] | None:
    """Find where each atom must lie; None where there is no such place."""
    low = sum(part[0] for part in ranges if part[0] != -INF)
    high = sum(part[1] for part in ranges if part[1] != INF)
    open_low = sum(part[0] == -INF for part in ranges)
    open_high = sum(part[1] == INF for part in ranges)
    found = []
    for own_low, own_high in ranges:
        least: End = low - (0 if own_low == -INF else own_low)
        most: End = high - (0 if own_high == INF else own_high)
        if open_low > (own_low == -INF):
            least = -INF
        if open_high > (own_high == INF):
            most = INF
        asked = iv.minus(target, (least, most))
        both = iv.met(asked, (own_low, own_high))
        if both[0] > both[1]:
            return None
        found.append(both)
    return found


def _solve_factor(
    box: Box, place: int, factors: Factors, parts: list[Interval], value: Interval, asked: Interval
) -> None:
    """Bound one factor of c x1^p1 x2^p2 ..., which lies in ``asked``."""
    variable, n = factors[place]
    others = value
    for k, part in enumerate(parts):
        if k != place:
            others = iv.times(others, part)
    wanted = iv.quotient(asked, others)
    if wanted != WHOLE:
        box.shrink(variable, *iv.roots(wanted, n, box.ends[variable]))
