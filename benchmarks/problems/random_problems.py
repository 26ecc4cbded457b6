"""Random small problems with a planted feasible point, and exact samples of them.

All coefficients and points are multiples of 1/4 of moderate size, so that products and
sums of doubles are exact: what a sample attains is attained.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp

from ..errors import BenchmarkError
from ..measuring.registry import Case, Selection, Task

__all__ = ["KINDS", "RandomProblem", "cases", "random_problem", "samples"]

KINDS = ("sparse", "dense", "equalities", "binary", "open")
_GRID = 0.25
_SAMPLES = 4000
_FAR = 64.0  # how far unbounded directions are sampled


@dataclass(frozen=True, eq=False)
class RandomProblem:
    """A problem and a point that satisfies all its constraints exactly.

    Parameters
    ----------
    kind : str
        One of KINDS.
    problem : Problem
    planted : (n,) float
    """

    kind: str
    problem: sp.Problem
    planted: NDArray[np.float64]

    @property
    def boxed(self) -> bool:
        """Whether all variables have finite bounds."""
        return bool(np.all(np.isfinite(self.problem.lower) & np.isfinite(self.problem.upper)))

    @property
    def name(self) -> str:
        """Kind, and whether there is a box."""
        return f"{self.kind}, {'boxed' if self.boxed else 'unbounded directions'}"


def cases(selection: Selection) -> Iterator[Case]:
    """``--count`` problems from each seed on."""
    if selection.count < 1:
        raise BenchmarkError(f"--count: found {selection.count}, expected at least 1")
    for start in selection.seeds:
        for number in range(selection.count):
            seed = 10**6 * start + number
            made = random_problem(seed)
            yield Case(made.name, partial(Task.of, made.problem), made.problem.dimension, seed)


def random_problem(seed: int) -> RandomProblem:
    """A problem in 1 to 6 variables; the kinds take turns.

    Examples
    --------
    >>> made = random_problem(7)
    >>> made.kind, made.problem.violation(made.planted)
    ('equalities', 0.0)
    """
    rng = np.random.default_rng([seed, 17])
    kind = KINDS[seed % len(KINDS)]
    n = int(rng.integers(1, 7))
    x = sp.variables(n)
    low = rng.integers(-2, 1, n).astype(float)
    high = low + rng.integers(1, 4, n)
    planted = _on_grid(rng, low, high, (n,))
    if kind == "binary":
        planted = np.where(rng.random(n) < 0.5, low, high)
    rows = list(_rows(rng, kind, x, planted, low, high))
    if kind == "open":
        low = np.where(rng.random(n) < 0.5, -np.inf, low)
        high = np.where(rng.random(n) < 0.5, np.inf, high)
    return RandomProblem(kind, sp.Problem(_objective(rng, kind, x), rows, low, high), planted)


def _objective(rng: np.random.Generator, kind: str, x: tuple) -> sp.Polynomial:
    if kind == "dense":
        return _dense(rng, x)
    if kind == "open" and rng.random() < 0.7:  # mostly bounded from below
        return sp.total([_sparse(rng, x, 3), *(v**4 for v in x)])
    return _sparse(rng, x, 4)


def _sparse(rng: np.random.Generator, x: tuple, degree: int) -> sp.Polynomial:
    parts = [0.0 * x[0]]
    for _ in range(int(rng.integers(1, 6))):
        term = _coefficient(rng) + 0.0 * x[0]
        for v in rng.integers(0, len(x), int(rng.integers(1, degree + 1))).tolist():
            term = term * x[v]
        parts.append(term)
    return sp.total(parts)


def _dense(rng: np.random.Generator, x: tuple) -> sp.Polynomial:
    """All quadratic terms, and for up to three variables all products of two of these."""
    quadratic = [1.0 + 0.0 * x[0], *x, *(a * b for i, a in enumerate(x) for b in x[i:])]
    terms = quadratic
    if len(x) <= 3:
        terms = [p * q for i, p in enumerate(quadratic) for q in quadratic[i:]]
    return sp.total([_coefficient(rng) * term for term in terms])


def _coefficient(rng: np.random.Generator) -> float:
    return float(rng.integers(-12, 13)) / 4


def _rows(
    rng: np.random.Generator,
    kind: str,
    x: tuple,
    planted: NDArray,
    low: NDArray,
    high: NDArray,
) -> Iterator[sp.Constraint]:
    if kind == "binary":
        for v, a, b in zip(x, low.tolist(), high.tolist(), strict=True):
            yield (v - a) * (v - b) == 0
    for _ in range(int(rng.integers(0, 4))):
        g = _sparse(rng, x, 2 if kind == "dense" else 4)
        at = float(_values(g, planted[None, :])[0])
        if kind == "equalities":
            yield _equality(rng, x, planted, g, at)
        else:
            yield g >= at - float(rng.integers(0, 5)) / 4


def _equality(
    rng: np.random.Generator, x: tuple, planted: NDArray, g: sp.Polynomial, at: float
) -> sp.Constraint:
    """A union of two planes through or beside the point, or the level set of g there."""
    if rng.random() < 0.4:
        return g == at
    i, j = rng.integers(0, len(x), 2).tolist()
    return (x[i] - float(planted[i])) * (x[j] - float(rng.integers(-2, 3))) == 0


def samples(made: RandomProblem, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exactly feasible points (k, n) and the objective there (k,); the planted point is first."""
    problem, planted = made.problem, made.planted
    rng = np.random.default_rng([seed, 23])
    low = np.where(np.isfinite(problem.lower), problem.lower, planted - _FAR)
    high = np.where(np.isfinite(problem.upper), problem.upper, planted + _FAR)
    near_low, near_high = np.maximum(low, planted - 4.0), np.minimum(high, planted + 4.0)
    shape = (_SAMPLES, planted.size)
    near = _on_grid(rng, near_low, near_high, shape)
    far = _on_grid(rng, low, high, shape)
    kept = rng.random(shape) < rng.random((_SAMPLES, 1))  # few coordinates move: equalities
    points = np.concatenate([planted[None, :], near, far, np.where(kept, planted, near)])
    feasible = np.all((points >= problem.lower) & (points <= problem.upper), axis=1)
    for row in problem.constraints:
        value = _values(row.polynomial, points)
        feasible &= value == 0 if row.kind is sp.Kind.ZERO else value >= 0
    if not feasible[0]:
        raise BenchmarkError(f"seed {seed}: the planted point is not feasible, expected it to be")
    return points[feasible], _values(problem.objective, points[feasible])


def _on_grid(
    rng: np.random.Generator, low: NDArray, high: NDArray, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Points between low and high, which lie on the grid, both included."""
    steps = np.round((high - low) / _GRID).astype(np.int64)
    return low + _GRID * rng.integers(0, steps + 1, shape)


def _values(polynomial: sp.Polynomial, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values term by term, apart from the evaluation of the package under test."""
    result = np.zeros(points.shape[0])
    for word, coefficient in zip(polynomial.words, polynomial.coefficients, strict=True):
        term = np.full(points.shape[0], coefficient)
        for letter in word[word > 0].tolist():
            term = term * points[:, letter - 1]
        result += term
    return result
