"""Attained points: in rationals, near zeros of Krawczyk's test, or row by row; rays."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise, product
from typing import Any

from ..arithmetic import interval as iv
from ..arithmetic.interval import Interval
from ..arithmetic.polynomial import INF, Polynomial
from ..files.reading import Constraint, Malformed, Problem, alike, below, fields
from .gram import semidefinite
from .left_inverse import dot, reached
from .substitution import blocks, substituted

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
        if twice or got.proof not in ("exact", "krawczyk", "substitution"):
            raise Malformed(f"{place}: a row or variable twice, or proof {got.proof!r:.20}")

    def fails(self) -> str:
        """Tell why claims about the point are not proved; empty where they are."""
        if self.proof == "exact":
            return self._exactly()
        if not self.rows:
            return "no row is solved"
        if self.proof == "krawczyk":
            box = self._enclosed()
            return "Krawczyk's test fails" if box is None else self._over(box)
        box = self._by_rows()
        return "the rows are not solved one after the other" if box is None else self._over(box)

    # ---- rational points ------------------------------------------------------------------

    def coordinates(self) -> list[Fraction] | None:
        """Solve the rows for some variables: the rational point x, None without one."""
        solution = solved_linearly(self.problem, self.rows, self.solved, self.x)
        if solution is None:
            return None
        point = list(self.x)
        for variable, value in solution.items():
            point[variable] = value
        return point

    def _exactly(self) -> str:
        point = self.coordinates()
        if point is None:
            return "the rows are not linear in the variables, or not regular"
        if any(abs(a - b) > self.radius for a, b in zip(point, self.x, strict=True)):
            return "the point lies farther away than its radius"
        return infeasible(self.problem, point) or (
            "" if self.problem.objective.at(point) <= self.value else "the objective is larger"
        )

    # ---- Krawczyk's test ------------------------------------------------------------------

    def _over(self, box: list[Interval]) -> str:
        """Tell why a claim may fail in a box with a zero of the rows; empty where it holds."""
        problem = self.problem
        zero = {_up_to_sign(problem.constraints[k].polynomial) for k in self.rows}
        for (low, high), x, a, b in zip(box, self.x, problem.lower, problem.upper, strict=True):
            if iv.exact(low) < a or iv.exact(high) > b:
                return "the box of the point leaves the bounds"
            if max(iv.exact(high) - x, x - iv.exact(low)) > self.radius:
                return "the point lies farther away than its radius"
        for k, c in enumerate(problem.constraints):
            if _up_to_sign(c.polynomial) not in zero and not self._holds(c, box):
                return f"constraint {k} may fail near the point"
            if c.side and not _semidefinite_over(c, box):
                return f"matrix {k} may fail near the point"
        most = iv.exact(iv.range_over(problem.objective, box)[1])
        return "" if most <= self.value else "the objective may be larger"

    def _holds(self, c: Constraint, box: list[Interval]) -> bool:
        """Check a constraint over a box, exactly where none of its variables is solved."""
        letters = {v - 1 for word in c.polynomial.terms for v in word}
        if letters.isdisjoint(self.solved):
            value = c.polynomial.at(self.x)
            return value == 0 or (value > 0 and not c.equality)
        low, high = iv.range_over(c.polynomial, box)
        return bool(low >= 0 and not (c.equality and high > 0))

    def _by_rows(self) -> list[Interval] | None:
        """A box around x that holds the zero of rows that are solved one after the other."""
        rows = [self.problem.constraints[k].polynomial for k in self.rows]
        known, values = list(self.x), list[Fraction]()
        for begin, end in pairwise(blocks(rows, self.solved)):
            ours = self.solved[begin:end]
            first = solved_linearly(self.problem, self.rows[begin:end], ours, known)
            if first is None:
                return None
            for v in ours:
                known[v] = first[v]
                values.append(first[v])
        found = substituted(rows, self.solved, self.x, values)
        if found is None:
            return None
        box = [(iv.below(x), iv.above(x)) for x in self.x]
        for v, (low, high) in zip(self.solved, found, strict=True):
            box[v] = iv.below(low), iv.above(high)
        return box

    def _enclosed(self) -> list[Interval] | None:
        """A box around x, wide in the solved variables only, that holds a zero of the rows."""
        system = [self.problem.constraints[k].polynomial for k in self.rows]
        slopes = [[p.derivative(v + 1) for v in self.solved] for p in system]
        middle = [(iv.below(x), iv.above(x)) for x in self.x]
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


def _semidefinite_over(c: Constraint, box: list[Interval]) -> bool:
    """Check that the matrix of a constraint is positive semidefinite all over a box."""
    ends = [tuple(map(iv.exact, iv.range_over(p, box))) for p in c.entries]
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


# ---- exact checks -----------------------------------------------------------------------------


def solved_linearly(
    problem: Problem, rows: list[int], solved: list[int], x: list[Fraction]
) -> dict[int, Fraction] | None:
    """Solve equations that are linear in some variables, the others being x."""
    table: list[dict[int, Fraction]] = []  # key -1: the constant
    for k in rows:
        row: dict[int, Fraction] = {}
        for letters, term in problem.constraints[k].polynomial.coefficients().items():
            ours = [v - 1 for v in letters if v - 1 in solved]
            if len(ours) > 1:
                return None
            for v in letters:
                term *= x[v - 1] if v - 1 not in ours else 1
            key = ours[0] if ours else -1
            row[key] = row.get(key, Fraction(0)) + term
        table.append({key: value for key, value in row.items() if value or key < 0})
    return _solution(table)


def _solution(table: list[dict[int, Fraction]]) -> dict[int, Fraction] | None:
    done: list[tuple[int, dict[int, Fraction]]] = []
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
    found = {-1: Fraction(1)}
    for column, rest in reversed(done):
        found[column] = sum((found[key] * value for key, value in rest.items()), Fraction(0))
    del found[-1]
    return found


def infeasible(problem: Problem, x: list[Fraction]) -> str:
    """Tell why a rational point is not feasible; empty where it is."""
    for v, (value, low, high) in enumerate(zip(x, problem.lower, problem.upper, strict=True)):
        if not low <= value <= high:
            return f"variable {v + 1} leaves its bounds"
    for k, c in enumerate(problem.constraints):
        value = c.polynomial.at(x)
        if (value != 0) if c.equality else (value < 0):
            return f"constraint {k} does not hold"
        if c.side and not entries_hold(c, [p.at(x) for p in c.entries]):
            return f"matrix {k} is not positive semidefinite"
    return ""


def entries_hold(c: Constraint, values: list[Fraction]) -> bool:
    """Check whether the matrix with these entries is positive semidefinite."""
    if c.kind == "SECOND_ORDER":
        rest = sum((v * v for v in values[1:]), Fraction(0))
        return values[0] >= 0 and values[0] ** 2 >= rest
    side = range(c.side)
    return semidefinite([[values[c.place(i, j)] for j in side] for i in side])


# ---- rays -------------------------------------------------------------------------------------


def falls_without_limit(problem: Problem, point: ProvedPoint, ray: list[Fraction] | None) -> bool:
    """Check whether the objective falls along a feasible ray from the point, given or found."""
    origin = None if point.proof != "exact" or point.fails() else point.coordinates()
    if origin is None or (ray is not None and len(ray) != len(origin)):
        return False
    tried = _directions(problem, point.x) if ray is None else iter([ray])
    return any(_falls(problem, origin, direction) for direction in tried)


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


def _falls(problem: Problem, x: list[Fraction], direction: list[Fraction]) -> bool:
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
        for k in range(max(map(len, entries), default=0)):
            if not entries_hold(c, [e[k] if k < len(e) else Fraction(0) for e in entries]):
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
