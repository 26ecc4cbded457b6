"""Attained points: in rationals, near zeros of Krawczyk's test, or row by row; rays."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from fractions import Fraction
from itertools import pairwise, product, zip_longest
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import INF, Polynomial, split
from ..files.reading import Constraint, Malformed, Problem, alike, below, fields
from .elimination import eliminated, semidefinite, solution
from .left_inverse import dot, reached
from .substitution import blocks, substituted

Range = tuple[Any, Any]  # rational ends, INF or -INF
RangeOf = Callable[[Polynomial], Range]
PROOFS = {
    "exact": "the rows are not linear in the variables, or not regular",
    "krawczyk": "Krawczyk's test fails",
    "substitution": "the rows are not solved one after the other",
}  # kinds, and what is said where one fails
RADII = (200, 150, 100, 60, 45, 38, 33, 30, 27)  # boxes of 2**-k are tried, small ones first


class ProvedPoint:
    """A point near ``x``, at most ``radius`` away, whose objective is at most ``value``."""

    def __init__(self, found: Any, problem: Problem, place: str) -> None:
        n, m = problem.dimension, len(problem.constraints)
        kinds = {"x": "f1", "value": "F", "radius": "f", "proof": "t", "rows": "i1", "solved": "i1"}
        got = fields(found, place, n, **kinds)
        self.problem, self.value, self.proof = problem, got.value, got.proof
        self.rows, self.solved = got.rows, got.solved
        self.x, self.radius = [Fraction(v) for v in got.x], Fraction(got.radius)
        alike(place, got.x, range(n))
        alike(place, got.rows, got.solved)
        below(got.rows, m, f"{place}.rows")
        below(got.solved, n, f"{place}.solved")
        twice = any(len(set(v)) < len(v) for v in (got.rows, got.solved))
        if twice or got.proof not in PROOFS:
            raise Malformed(f"{place}: a row or variable twice, or proof {got.proof!r:.20}")

    def fails(self) -> str:
        """Tell why claims about the point are not proved; empty where they are."""
        if self.proof == "exact":
            point = self.coordinates()
            return PROOFS[self.proof] if point is None else self._near(*at_point(point))
        if not self.rows:
            return "no row is solved"
        box = self._enclosed() if self.proof == "krawczyk" else self._by_rows()
        return PROOFS[self.proof] if box is None else self._over(box)

    def coordinates(self) -> list[Fraction] | None:
        """Solve the rows for some variables: the rational point x, None without one."""
        solution = solved_linearly(self.problem, self.rows, self.solved, self.x)
        if solution is None:
            return None
        return [solution.get(v, x) for v, x in enumerate(self.x)]

    def _near(self, ends: list[Range], range_of: RangeOf, zero: Container[Any] = ()) -> str:
        """Tell why a claim may fail in a box, with a zero of some rows; empty where it holds."""
        if any(max(b - x, x - a) > self.radius for (a, b), x in zip(ends, self.x, strict=True)):
            return "the point lies farther away than its radius"
        if reason := infeasible(self.problem, ends, range_of, zero):
            return reason
        most = range_of(self.problem.objective)[1]
        return "" if most <= self.value else "the objective may be larger"

    def _over(self, box: list[Interval]) -> str:
        """Tell why a claim may fail in a box with a zero of the rows; empty where it holds."""

        def range_of(p: Polynomial) -> Range:
            """Enclose a polynomial, exactly where none of its variables is solved."""
            letters = {v - 1 for word in p.terms for v in word}
            if letters.isdisjoint(self.solved):
                return (p.at(self.x),) * 2
            return iv.exactly(iv.range_over(p, box))

        zero = {_up_to_sign(self.problem.constraints[k].polynomial) for k in self.rows}
        return self._near([iv.exactly(pair) for pair in box], range_of, zero)

    def _by_rows(self) -> list[Interval] | None:
        """A box around x that holds the zero of rows that are solved one after the other."""
        rows = [self.problem.constraints[k].polynomial for k in self.rows]
        known, bounds = list(self.x), blocks(rows, self.solved)
        for begin, end in pairwise(bounds):
            ours = self.solved[begin:end]
            values = solved_linearly(self.problem, self.rows[begin:end], ours, known)
            if values is None:
                return None
            for v in ours:
                known[v] = values[v]
        first = [known[v] for v in self.solved[: bounds[-1]]]
        found = substituted(rows, self.solved, self.x, first)
        if found is None:
            return None
        box = [iv.around(x, x) for x in self.x]
        for v, pair in zip(self.solved, found, strict=True):
            box[v] = iv.around(*pair)
        return box

    def _enclosed(self) -> list[Interval] | None:
        """A box around x, wide in the solved variables only, that holds a zero of the rows."""
        system = [self.problem.constraints[k].polynomial for k in self.rows]
        slopes = [[p.derivative(v + 1) for v in self.solved] for p in system]
        middle = [iv.around(x, x) for x in self.x]
        jacobian = [[iv.range_over(p, middle)[0] for p in row] for row in slopes]
        inverse = _inverse(jacobian)
        if inverse is None:
            return None
        one = iv.scaled(1, 0)[0]
        for _ in range(7):  # Newton's method; nothing rests on how good it is
            residual = [iv.range_over(p, middle) for p in system]
            for v, weights in zip(self.solved, inverse, strict=True):
                at = middle[v][0] - sum(dot(weights, residual)) // (2 * one)
                middle[v] = at, at
        residual = [iv.range_over(p, middle) for p in system]
        matrix = [[Fraction(a, one) for a in weights] for weights in inverse]
        nothing = [0.0] * len(self.solved)
        for bits in RADII:
            radius = [Fraction(1, 1 << bits)] * len(self.solved)
            box = _around(middle, self.solved, radius)
            table = [
                [*(iv.range_over(p, box) for p in row), rest]
                for row, rest in zip(slopes, residual, strict=True)
            ]
            image = reached(matrix, table, nothing, radius)  # K(X) lies so near to the middle
            if all(a < b for a, b in zip(image, radius, strict=True)):
                return _around(middle, self.solved, image)
        return None


def _up_to_sign(p: Polynomial) -> frozenset[tuple[tuple[int, ...], Fraction]]:
    """Return what p and -p have in common: their terms, that of the first word positive."""
    terms = {word: value for word, value in p.coefficients().items() if value}
    sign = -1 if terms and terms[min(terms)] < 0 else 1
    return frozenset((word, sign * value) for word, value in terms.items())


def _around(middle: list[Interval], solved: list[int], radius: list[Fraction]) -> list[Interval]:
    """The box around a point that is wide in the solved variables only."""
    box = list(middle)
    for v, size in zip(solved, map(iv.above, radius), strict=True):
        box[v] = middle[v][0] - size, middle[v][1] + size
    return box


def _inverse(matrix: list[list[int]]) -> list[list[int]] | None:
    """About the inverse of a matrix in fixed point; nothing rests on how good it is."""
    one, size = iv.scaled(1, 0)[0], len(matrix)
    rows = [
        {j: v for j, v in enumerate(row) if v} | {size + i: one} for i, row in enumerate(matrix)
    ]
    for i in range(size):
        pivot = max(range(i, size), key=lambda k: abs(rows[k].get(i, 0)))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        own = rows[i].pop(i, 0)
        if not own:
            return None
        rows[i] = {j: v * one // own for j, v in rows[i].items() if v}
        for k in range(size):
            factor = rows[k].pop(i, 0) if k != i else 0
            if factor:
                other = rows[k]
                for j, v in rows[i].items():
                    other[j] = other.get(j, 0) - factor * v // one
    return [[row.get(size + j, 0) for j in range(size)] for row in rows]


# ---- exact checks -----------------------------------------------------------------------------


def solved_linearly(
    problem: Problem, rows: list[int], solved: list[int], x: list[Fraction]
) -> dict[int, Fraction] | None:
    """Solve equations that are linear in some variables, the others being x."""
    table: list[dict[int, Fraction]] = []  # key -1: the constant
    inside = {v + 1 for v in solved}
    for k in rows:
        p = problem.constraints[k].polynomial
        parts = split(p.terms, inside)
        if any(len(head) > 1 for head in parts):
            return None
        row = {
            head[0] - 1 if head else -1: Polynomial(part, p.exp).at(x)
            for head, part in parts.items()
        }
        table.append({key: value for key, value in row.items() if value or key < 0})
    done = eliminated(table)
    return None if done is None else solution(done, {-1: Fraction(1)})


def at_point(x: list[Fraction]) -> tuple[list[Range], RangeOf]:
    """Make a point a box, and the function that evaluates polynomials there."""
    return [(v, v) for v in x], lambda p: (p.at(x),) * 2


def infeasible(
    problem: Problem, ends: list[Range], range_of: RangeOf, zero: Container[Any] = ()
) -> str:
    """Tell why points of a box may not be feasible; empty where they are.

    ``zero`` holds polynomials that are zero at the point that matters.
    """
    for v, ((low, high), a, b) in enumerate(zip(ends, problem.lower, problem.upper, strict=True)):
        if not a <= low <= high <= b:
            return f"variable {v + 1} may leave its bounds"
    for k, c in enumerate(problem.constraints):
        if not zero or _up_to_sign(c.polynomial) not in zero:
            low, high = range_of(c.polynomial)
            if low < 0 or (c.equality and high > 0):
                return f"constraint {k} may not hold"
        if c.side and not entries_hold(c, [range_of(p) for p in c.entries]):
            return f"matrix {k} may not be positive semidefinite"
    return ""


def entries_hold(c: Constraint, ends: list[Range]) -> bool:
    """Check whether all matrices with entries in these intervals are positive semidefinite."""
    if any(end in (INF, -INF) for pair in ends for end in pair):
        return False
    if c.kind == "SECOND_ORDER":
        rest = sum((max(abs(low), abs(high)) ** 2 for low, high in ends[1:]), Fraction(0))
        return bool(ends[0][0] >= 0 and ends[0][0] ** 2 >= rest)
    side = range(c.side)
    matrix = [[ends[c.place(i, j)] for j in side] for i in side]
    middle = [[(low + high) / 2 for low, high in row] for row in matrix]
    for i, row in enumerate(matrix):  # what is left is diagonally dominant
        middle[i][i] -= sum((high - low for low, high in row), Fraction(0)) / 2
    return semidefinite(middle)


# ---- rays -------------------------------------------------------------------------------------


def falls_without_limit(problem: Problem, point: ProvedPoint, ray: list[Fraction] | None) -> bool:
    """Check whether the objective falls along a feasible ray from the point, given or found."""
    origin = None if point.proof != "exact" or point.fails() else point.coordinates()
    if origin is None or (ray is not None and len(ray) != len(origin)):
        return False
    tried = _directions(problem, point.x) if ray is None else iter([ray])
    return any(falls(problem, origin, direction) for direction in tried)


def _directions(problem: Problem, x: list[Fraction]) -> Iterator[list[Fraction]]:
    """Signs of the descent direction, the axes, and all signs where there are few variables."""
    n = problem.dimension
    slope = [problem.objective.derivative(v + 1).at(x) for v in range(n)]
    least = max(map(abs, slope)) / 10**9
    yield [Fraction(0 if abs(s) <= least else (-1 if s > 0 else 1)) for s in slope]
    for v in range(n):
        for sign in (1, -1):
            yield [Fraction(sign if k == v else 0) for k in range(n)]
    if n <= 5:
        for signs in product((-1, 0, 1), repeat=n):
            yield [Fraction(s) for s in signs]


def falls(problem: Problem, x: list[Fraction], direction: list[Fraction]) -> bool:
    """Check that x + s * direction is feasible for all s >= 0 and the objective falls there."""
    for step, low, high in zip(direction, problem.lower, problem.upper, strict=True):
        if (step < 0 and low != -INF) or (step > 0 and high != INF):
            return False
    falling = _along(problem.objective, x, direction)
    if len(falling) < 2 or falling[-1] >= 0:
        return False
    for c in problem.constraints:
        values = _along(c.polynomial, x, direction)
        if any(values) if c.equality else any(value < 0 for value in values):
            return False
        entries = [_along(p, x, direction) for p in c.entries]
        for powers in zip_longest(*entries, fillvalue=Fraction(0)):
            if not entries_hold(c, [(value, value) for value in powers]):
                return False
    return True


def _along(p: Polynomial, x: list[Fraction], direction: list[Fraction]) -> list[Fraction]:
    """Coefficients in s of p(x + s * direction), without zeros at the end."""
    found = [Fraction(0)] * (1 + max(map(len, p.terms), default=0))
    for letters, value in p.coefficients().items():
        term = [value]
        for v in letters:
            shifted = [Fraction(0), *(a * direction[v - 1] for a in term)]
            term = [a * x[v - 1] for a in term] + [Fraction(0)]
            term = [a + b for a, b in zip(term, shifted, strict=True)]
        for k, a in enumerate(term):
            found[k] += a
    while found and not found[-1]:
        found.pop()
    return found
