"""Kinds of random problems whose answers are known by construction.

Each has planted points of small dyadic numbers, at which rows and objective are exact in
rationals, and where it can be, its least value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from math import floor
from operator import mul
from typing import Any

import numpy as np

import sparsepop_py as sp

from .exact_points import Point, is_feasible, value_at

__all__ = ["KINDS", "Planted", "planted"]


@dataclass(frozen=True, eq=False)
class Planted:
    """A problem with what is known of it.

    Parameters
    ----------
    problem : Problem or RationalProblem
    points : tuple of tuple of Fraction
        Feasible, if their exact values say so; none where the problem is infeasible, or where
        coordinates are irrational.
    least : Fraction or None
        The infimum, if it is known; -inf has ``falls`` instead.
    falls : bool
        True if the objective falls without limit.
    """

    problem: sp.Problem | sp.RationalProblem
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


def _around(rng: np.random.Generator, s: list[sp.Polynomial]) -> sp.Polynomial:
    """Zero where the shifted variables are zero."""
    parts = [float(rng.integers(-4, 5)) / 2 * s[int(rng.integers(len(s)))] for _ in range(3)]
    return sp.total([*parts, 0.5 * s[int(rng.integers(len(s)))] * s[0]])


def _mixed_cones(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Multipliers u u' and (5, -3, -4) of a matrix and a cone that are singular at p.

    The objective is 3/4 plus their products with matrix and cone, which are not negative.
    """
    s = _shifted(x, p)
    t = float(rng.integers(0, 5)) / 4
    f1, f2, f3 = (size * t + _around(rng, s) for size in (5.0, 3.0, 4.0))
    side = int(rng.integers(2, 4))
    v = np.array([1, *rng.integers(-2, 3, side - 1)])
    u = np.array([0, *rng.integers(-2, 3, side - 1)])
    u[0] = -u @ v
    entries: list[list[sp.Polynomial]] = []
    for i in range(side):
        entries.append([float(v[i] * v[j]) + _around(rng, s) for j in range(i + 1)])
    full = [[entries[max(i, j)][min(i, j)] for j in range(side)] for i in range(side)]
    by_matrix = [float(u[i] * u[j]) * full[i][j] for i in range(side) for j in range(side)]
    rows: list[Any] = [sp.second_order(f1, f2, f3), sp.psd(full)]
    if rng.integers(2):
        rows.append(_norm(s) <= 1)
    share = float(rng.integers(0, 3))
    objective = sp.total([*by_matrix, share * (5 * f1 - 3 * f2 - 4 * f3)]) + 0.75
    return Planted(sp.Problem(objective, rows, -2, 2), (p,), Fraction(3, 4))


def _sums_of_ratios(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Denominators have signs on the box; squares over them have the least value 0, at p."""
    s = _shifted(x, p)
    signs = [1.0, 1.0, -1.0]
    q = [1 + (x[0] - x[1]) ** 2, 4 + x[0] * x[-1], -3 - x[int(rng.integers(len(x)))]]
    squares = bool(rng.integers(2))
    numerators = [sign * _around(rng, s) ** 2 if squares else _some(rng, x, 3, 2) for sign in signs]
    terms = [sp.ratio(a, b) for a, b in zip(numerators, q, strict=True)]
    row = sp.ratio(_some(rng, x, 2, 2), q[0]) + sp.ratio(_some(rng, x, 2, 1), q[1])
    level = float(floor(value_at(row, p) * 16)) / 16
    rows = [row >= level] if rng.integers(2) else [sp.total(x) == float(sum(p))]
    problem = sp.RationalProblem(sum(terms[1:], terms[0]) + 0.75, rows, -1, 1)
    return Planted(problem, (p,), Fraction(3, 4) if squares else None)


def _isolated(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Squares that may not be positive: a grid of points, or one of irrational points."""
    grid = [sorted({q, Fraction(int(rng.integers(-2, 3)), 2)}) for q in p]
    products = [_product(v - float(r) for r in roots) for v, roots in zip(x, grid, strict=True)]
    rows = [h == 0 if rng.integers(3) == 0 else h * h <= 0 for h in products]
    if len(x) == 2 and rng.integers(2):
        rows = [_norm(products) <= 0]
    objective = _some(rng, x)
    if rng.integers(2):
        return _enumerated(sp.Problem(objective, rows, -2, 2), product(*grid))
    y = sp.variables(len(x) + 1)  # the last one is +-2^(1/2)
    wider = [(v**2 - 2) ** 2 <= 0 for v in y[-1:]]
    wider += [
        _product(v - float(r) for r in roots) ** 2 <= 0 for v, roots in zip(y, grid, strict=False)
    ]
    goal = _some(rng, y[:-1])
    least = min(value_at(goal, (*point, Fraction(0))) for point in product(*grid))
    return Planted(sp.Problem(goal + 1.5 * y[-1] ** 2, wider, -2, 2), (), least + 3)


def _enumerated(problem: sp.Problem, candidates: Iterable[Point]) -> Planted:
    """Plant the feasible ones of all points that may be, the best one first."""
    feasible = (point for point in candidates if is_feasible(problem, point))
    points = tuple(sorted(feasible, key=lambda point: value_at(problem.objective, point)))
    return Planted(problem, points, value_at(problem.objective, points[0]) if points else None)


def _product(factors: Iterable[sp.Polynomial]) -> sp.Polynomial:
    return reduce(mul, factors)


def _partition(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Numbers are parted into two heaps, by signs or by bits; all partings are tried."""
    n = int(rng.integers(3, 7))
    x = sp.variables(n)
    numbers = [float(v) for v in rng.integers(1, 2 ** int(rng.integers(2, 24)), n)]
    bits = bool(rng.integers(2))
    signs = [2 * v - 1 for v in x] if bits else list(x)
    difference = sp.total([a * v for a, v in zip(numbers, signs, strict=True)])
    rows = [v**2 == v if bits else v**2 == 1 for v in x]
    objective = difference**2
    if rng.integers(3) == 0:  # heaps of one size, if there are any
        rows.append(difference == 0)
        objective = _some(rng, x, 4, 2)
    low = 0.0 if bits else -1.0
    problem = sp.Problem(objective, rows, low, 1)
    return _enumerated(problem, product((Fraction(low), Fraction(1)), repeat=n))


_SCALES = (-900, -300, -60, -20, 0, 0, 20, 60, 300, 900)


def _weird_rows(rng: np.random.Generator, x: Any, p: Point) -> Planted:
    """Rows that bind at p, huge and tiny, twice, opposite, redundant; some contradict."""
    rows: list[Any] = []
    tight = [g - float(value_at(g, p)) for g in (_some(rng, x, 3, 2) for _ in range(3))]
    for _ in range(int(rng.integers(2, 8))):
        scale = 2.0 ** _SCALES[int(rng.integers(len(_SCALES)))]
        g = tight[int(rng.integers(len(tight)))] * scale
        slack = scale * (0.0, 0.0, 2.0**-40, 64.0)[int(rng.integers(4))]
        rows.append((g >= -slack, g <= slack, g == 0)[int(rng.integers(3))])
    objective = _sum_of_squares(rng, x, p) + 0.75
    if rng.integers(4):
        return Planted(sp.Problem(objective, rows, -2, 2), (p,), Fraction(3, 4))
    scale = 2.0 ** _SCALES[int(rng.integers(len(_SCALES)))]
    rows += [scale * tight[0] >= 0, tight[0] <= -(2.0**-40)]
    return Planted(sp.Problem(objective, rows, -2, 2))


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
    "mixed cones": _mixed_cones,
    "sums of ratios": _sums_of_ratios,
    "isolated": _isolated,
    "partition": _partition,
    "weird rows": _weird_rows,
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
