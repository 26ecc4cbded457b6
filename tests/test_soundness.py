"""No bound exceeds the value at any feasible point, over random small problems of mixed kinds.

Coefficients and points are dyadic numbers of few digits, so that feasibility and values on the
grid are exact in doubles.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from random_cases import on_grid, some_polynomial
from slow_values import slow_after

import sparsepop_py as sp
from benchmarks.problems.soundness import damaged
from sparsepop_py.errors import ParameterWarning

KINDS = ("box", "ball", "equality", "binary", "empty", "unbounded", "complementary", "mixed")


def rows_of(kind: str, rng: np.random.Generator, x: Any) -> tuple[list[Any], Any, Any]:
    """Constraints and bounds of one kind; the origin is feasible unless it is empty."""
    n = len(x)
    squares = sp.total(v * v for v in x)
    if kind == "ball":
        return [squares <= 4.0], -np.inf, np.inf
    if kind == "equality":
        i, j = rng.integers(0, n, 2)
        line = sp.total(float(rng.integers(-2, 3)) * v for v in x)
        return [line == 0, x[i] * (x[j] + 0.5 * x[i]) <= 2], -2, 2
    if kind == "binary":
        return [v * v == (v if rng.integers(2) else 2 * v) for v in x], 0, 2
    if kind == "empty":
        return [squares <= 1, sp.total(x) >= 4], -2, 2
    if kind == "unbounded":
        return [x[0] >= -1], -np.inf, np.inf
    if kind == "complementary":
        rows = [x[0] * x[-1] == 0] if n > 1 else [x[0] ** 2 == x[0]]
        return rows, 0, [2.0] * (n - 1) + [np.inf]
    if kind == "mixed":
        return [x[0] ** 2 == x[0], 1 + sp.total(x) >= 0], [0.0] + [-2.0] * (n - 1), np.inf
    return [], rng.integers(-2, 1, n).astype(float), rng.integers(1, 3, n).astype(float)


def random_problem(seed: int) -> tuple[sp.Problem, np.ndarray]:
    """A problem and the feasible points of a grid."""
    rng = np.random.default_rng(seed)
    kind, n = KINDS[seed % len(KINDS)], int(rng.integers(1, 4))
    x = sp.variables(n)
    rows, low, high = rows_of(kind, rng, x)
    if rng.integers(2) and kind != "empty":
        rows.append(some_polynomial(rng, x, 3) <= float(rng.integers(0, 4)))
    problem = sp.Problem(some_polynomial(rng, x, 4), rows, low, high)
    axis = np.arange(-2, 2.25, 0.25)
    points = np.stack(np.meshgrid(*[axis] * n, indexing="ij"), axis=-1).reshape(-1, n)
    keep = np.all((points >= problem.lower) & (points <= problem.upper), axis=1)
    for row in rows:
        value = on_grid(row.polynomial, points)
        keep &= value == 0 if row.kind is sp.Kind.ZERO else value >= 0
    return problem, points[keep]


def parameters(seed: int) -> dict[str, Any]:
    """Fields of param, mostly not the defaults."""
    rng = np.random.default_rng([seed, 1])
    fields = {
        "tighten": int(rng.integers(2)),
        "relaxOrder": float(rng.choice([1, 2, 2.5])),
        "sparseSW": int(rng.integers(2)),
        "multiCliquesFactor": [0, 1, "all"][rng.integers(3)],
        "boundSW": int(rng.integers(3)),
        "eqTolerance": float(rng.choice([0, 0, 1e-3])),
        "perturbation": float(rng.choice([0, 0, 1e-3])),
    }
    names = ("scalingSW", "reduceMomentMatSW", "complementaritySW", "SquareOneSW", "binarySW")
    return {**fields, **{name: int(rng.integers(2)) for name in (*names, "reduceAMatSW")}}


def check(seed: int) -> None:
    problem, points = random_problem(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        output = sp.sparsePOP(problem, {"printLevel": 0, **parameters(seed)})
    value, POP = output.SDPobjValue, output.POP
    least = on_grid(problem.objective, points).min(initial=np.inf)
    assert value <= least, (seed, value, least)
    assert value <= POP.upperBound or POP.status is sp.Status.UNBOUNDED
    if points.shape[0]:
        assert POP.status is not sp.Status.INFEASIBLE, seed
    if KINDS[seed % len(KINDS)] == "empty":
        assert POP.upperBound == np.inf, seed
    if value > -np.inf:
        verdict = POP.certificate.verify(POP.result.problem)
        assert verdict.ok, (seed, verdict)


def test_damaged_certificates_of_plain_relaxations_prove_nothing_wrong() -> None:
    """Prices of monomials, ends of scaled variables and multipliers with one number changed."""
    proved = 0
    for seed in range(32):
        problem, points = random_problem(seed)
        if not points.shape[0]:
            continue
        switches = sp.Switches(order=2, scaled=bool(seed % 3))
        options = sp.Options(effort="plain", switches=switches, refine="none")
        certificate = sp.solve(problem, options).certificate
        if certificate is None:
            continue
        proved += 1
        least = on_grid(problem.objective, points).min()
        rng = np.random.default_rng([seed, 2])
        for _ in range(12):
            forged, place = damaged(certificate, rng)
            verdict = forged.verify(problem)
            assert verdict.bound <= least, (seed, place)
            assert not verdict.ok or forged.bound <= least, (seed, place)
    assert proved > 10


@pytest.mark.parametrize("first", slow_after(3, [0, 16, 24, 8, 32]))
def test_bounds_never_exceed_values(first: int) -> None:
    for seed in range(first, first + 8):
        check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(40, 2040, 100))
def test_bounds_never_exceed_values_of_many(first: int) -> None:
    for seed in range(first, first + 100):
        check(seed)
