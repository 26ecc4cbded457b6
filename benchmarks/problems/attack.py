"""Random problems of twenty kinds whose answers are known by construction, against all claims.

Each has planted points of small dyadic numbers, at which rows and objective are exact in
rationals, and where it can be, its least value. No claim of a result may contradict them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

import sparsepop_py as sp

__all__ = ["KINDS", "Planted", "attack", "contradictions", "planted"]

Point = tuple[Fraction, ...]
_EFFORTS = ("plain", "presolve", "auto")
_LONGEST = 4.0  # seconds a solve


@dataclass(frozen=True, eq=False)
class Planted:
    """A problem with what is known of it.

    Parameters
    ----------
    problem : Problem
    points : tuple of tuple of Fraction
        Feasible, if their exact values say so; none where the problem is infeasible.
    least : Fraction or None
        The infimum, if it is known; -inf has ``falls`` instead.
    falls : bool
        True if the objective falls without limit.
    """

    problem: sp.Problem
    points: tuple[Point, ...] = ()
    least: Fraction | None = None
    falls: bool = False


def _point(rng: np.random.Generator, n: int) -> Point:
    return tuple(Fraction(int(v), 4) for v in rng.integers(-4, 5, n))


def _shifted(x: Any, point: Point) -> list[sp.Polynomial]:
    return [v - float(p) for v, p in zip(x, point, strict=True)]


def _some(rng: np.random.Generator, x: Any, terms: int = 5, degree: int = 3) -> sp.Polynomial:
    parts = [0.0 * x[0]]
    for _ in range(terms):
        term = float(rng.integers(-8, 9)) / 4 + 0.0 * x[0]
        for _ in range(int(rng.integers(1, degree + 1))):
            term = term * x[int(rng.integers(len(x)))]
        parts.append(term)
    return sp.total(parts)


def _sum_of_squares(rng: np.random.Generator, x: Any, point: Point) -> sp.Polynomial:
    """Zero at the point, a sum of squares elsewhere."""
    s = _shifted(x, point)
    rows = [s[int(rng.integers(len(s)))] * _some(rng, x, 2, 1) + v for v in s]
    return sp.total([r * r for r in rows])


Maker = Callable[[np.random.Generator, Any, Point], Planted]


def _constrained(rows: Callable[[Any, Point], list[Any]], low: float, high: float) -> Maker:
    """Any objective over rows that hold at the planted point."""

    def make(rng: np.random.Generator, x: Any, p: Point) -> Planted:
        return Planted(sp.Problem(_some(rng, x), rows(x, p), low, high), (p,))

    return make


def _squares(rows: Callable[[Any, Point], list[Any]], low: float, high: float) -> Maker:
    """A sum of squares whose zero is planted, plus 3/4."""

    def make(rng: np.random.Generator, x: Any, p: Point) -> Planted:
        objective = _sum_of_squares(rng, x, p) + 0.75
        return Planted(sp.Problem(objective, rows(x, p), low, high), (p,), Fraction(3, 4))

    return make


def _empty(rows: Callable[[Any], list[Any]], low: float, high: float) -> Maker:
    def make(rng: np.random.Generator, x: Any, p: Point) -> Planted:
        return Planted(sp.Problem(_some(rng, x), rows(x), low, high))

    return make


def _norm(x: Any) -> sp.Polynomial:
    return sp.total([v * v for v in x])


def _linear(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """The least value of c'x on [-1, 1]^n is -sum |c|, at a vertex."""
    c = [Fraction(int(v), 8) for v in rng.integers(-20, 21, len(x))]
    vertex = tuple(Fraction(-1 if v > 0 else 1) for v in c)
    goal = sp.total([0.0 * x[0], *(float(v) * w for v, w in zip(c, x, strict=True))])
    return Planted(sp.Problem(goal, [], -1, 1), (vertex, p), -sum(map(abs, c), Fraction(0)))


def _falling(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    return Planted(sp.Problem(_some(rng, x[1:] or x, 2, 1) - x[0] ** 3, [x[0] >= 0]), falls=True)


def _hyperbola(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """The sum u + v on u v = 1 with u, v >= 0 has the least value 2, and none without signs."""
    u, v = x[0], x[1]
    signs = bool(rng.integers(2))
    one = (Fraction(1),) * len(x)
    problem = sp.Problem(u + v, [u * v == 1], 0.0 if signs else -np.inf, np.inf)
    return Planted(problem, (one,), Fraction(2) if signs else None, not signs)


def _univariate(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    power = 2 * int(rng.integers(1, 6))
    rest = sp.total([v * v for v in _shifted(x[1:], p[1:])] or [0.0 * x[0]])
    return Planted(sp.Problem((x[0] - float(p[0])) ** power + rest), (p,), Fraction(0))


def _decimal(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Coefficients that are no doubles: what is proved is about the rounded ones."""
    third = sp.total([(v / 3 - 0.1 * float(q)) ** 2 for v, q in zip(x, p, strict=True)])
    return Planted(sp.Problem(0.7 * third * 1.1, [0.1 * x[0] + 0.2 * x[1] <= 2], -2, 2), (p,))


def _cone(x: Any, p: Point) -> list[Any]:
    return [sp.second_order(2 + x[0], *x[1:]), sp.psd([[2, x[0]], [x[0], 2]])]


KINDS: dict[str, Maker] = {
    "box": _constrained(lambda x, p: [], -1, 1),
    "ball": _constrained(lambda x, p: [_norm(x) <= len(x)], -np.inf, np.inf),
    "equality": _constrained(lambda x, p: [sp.total(x) == float(sum(p))], -1, 1),
    "product": _constrained(lambda x, p: [x[0] * x[1] == float(p[0] * p[1])], -1, 1),
    "inequality": _constrained(lambda x, p: [x[0] ** 3 + x[1] >= float(p[0] ** 3 + p[1])], -1, 1),
    "thin": _constrained(lambda x, p: [_norm(_shifted(x, p)) <= 2.0**-30], -1, 1),
    "point": _constrained(lambda x, p: [_norm(_shifted(x, p)) <= 0], -1, 1),
    "cone": _constrained(_cone, -1, 1),
    "wide": _constrained(lambda x, p: [], -1e6, 1e6),
    "binary": _constrained(
        lambda x, p: [(v - float(q)) * (v - 0.5) == 0 for v, q in zip(x, p, strict=True)], -2, 2
    ),
    "squares": _squares(lambda x, p: [], -np.inf, np.inf),
    "squares in a box": _squares(lambda x, p: [], -1, 1),
    "squares on a line": _squares(lambda x, p: [sp.total(x) == float(sum(p))], -2, 2),
    "no ball": _empty(lambda x: [_norm(x) <= 1, sp.total(x) >= 2 * len(x)], -4, 4),
    "no root": _empty(lambda x: [x[0] ** 2 + x[1] ** 2 == -1], -np.inf, np.inf),
    "linear": _linear,
    "falling": _falling,
    "hyperbola": _hyperbola,
    "powers": _univariate,
    "decimal": _decimal,
}


def planted(seed: int) -> tuple[str, Planted]:
    """Make the problem of a seed; kinds take turns.

    Parameters
    ----------
    seed : int

    Returns
    -------
    kind : str
    problem : Planted
    """
    rng = np.random.default_rng([seed, 17])
    kind = list(KINDS)[seed % len(KINDS)]
    n = int(rng.integers(2, 5))
    return kind, KINDS[kind](rng, sp.variables(n), _point(rng, n))


def _at(polynomial: sp.Polynomial, point: Point) -> Fraction:
    total = Fraction(0)
    for word, value in zip(
        polynomial.words.tolist(), polynomial.coefficients.tolist(), strict=True
    ):
        term = Fraction(value)
        for letter in word:
            term *= point[letter - 1] if letter else 1
        total += term
    return total


def _is_feasible(problem: sp.Problem, point: Point) -> bool:
    """Exactly; matrices of the kind ``cone`` hold on the whole box."""
    ends = zip(point, problem.lower.tolist(), problem.upper.tolist(), strict=True)
    if not all(low <= x <= high for x, low, high in ends):
        return False
    for row in problem.constraints:
        value = _at(row.polynomial, point)
        if row.kind.is_matrix:
            if problem.violation([float(x) for x in point]) > 0:
                return False
        elif value < 0 or (row.kind is sp.Kind.ZERO and value):
            return False
    return True


def contradictions(made: Planted, result: sp.Result) -> Iterator[str]:
    """Claims of a result that planted points or a known least value refute.

    Parameters
    ----------
    made : Planted
    result : Result

    Yields
    ------
    str
    """
    problem, lower, upper = made.problem, result.lower_bound, result.upper_bound
    known = [_at(problem.objective, p) for p in made.points if _is_feasible(problem, p)]
    if known and lower > min(known):
        yield f"the bound {lower!r} is above the value {float(min(known))!r} of a planted point"
    if made.least is not None and (lower > made.least or upper < made.least):
        yield f"[{lower!r}, {upper!r}] leaves out the least value {float(made.least)!r}"
    if made.falls and lower > -np.inf:
        yield f"the bound {lower!r} of an objective that falls without limit"
    if result.status is sp.Status.UNBOUNDED and not made.falls and made.least is not None:
        yield "UNBOUNDED, but the least value is known"
    if not made.points and not made.falls and upper < np.inf:
        yield f"{upper!r} is attained, but no point is feasible"
    if result.certificate is not None and not result.certificate.verify(problem).ok:
        yield "its certificate does not verify"
    again = sp.from_json(sp.to_json(result))
    if (again.lower_bound, again.problem.rounding) != (lower, problem.rounding):
        yield "its file says something else"


def attack(minutes: float, first: int = 0) -> Iterator[str]:
    """Solve planted problems and yield a line for each contradiction, then counts.

    Parameters
    ----------
    minutes : float
        CPU time.
    first : int
        Seed of the first problem.

    Yields
    ------
    str
    """
    end, seed = time.process_time() + 60.0 * minutes, first
    statuses, false = Counter[str](), 0
    while time.process_time() < end:
        kind, made = planted(seed)
        effort = _EFFORTS[seed // len(KINDS) % len(_EFFORTS)]
        result = sp.solve(made.problem, sp.Options(effort=effort, time_limit=_LONGEST))
        statuses[str(result.status)] += 1
        for found in contradictions(made, result):
            false += 1
            yield f"seed {seed}, {kind}, {effort}: {found}"
        seed += 1
    counts = ", ".join(f"{name} {count}" for name, count in sorted(statuses.items()))
    yield f"{seed - first} problems of {len(KINDS)} kinds, {false} contradictions: {counts}"
