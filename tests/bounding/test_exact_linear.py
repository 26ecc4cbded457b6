"""Linear bounds are exact: against another solver, and by hand where that one gives up."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog
from slow_values import slow_after

import sparsepop_py as sp

STATUS = {0: sp.Status.OPTIMAL, 2: sp.Status.INFEASIBLE, 3: sp.Status.UNBOUNDED}


def linear(coefficients: np.ndarray, x: list[sp.Polynomial]) -> sp.Polynomial:
    terms = [float(c) * v for c, v in zip(coefficients, x, strict=True)]
    return sp.total([*terms, 0.0 * x[0]])


def random_case(seed: int) -> tuple[sp.Problem, list[sp.Polynomial], list]:
    """Small integers, so that ties, parallel rows and empty sets are common."""
    g = np.random.default_rng(seed)
    n, m = int(g.integers(1, 5)), int(g.integers(0, 9))
    x = sp.variables(n)
    a, b = g.integers(-2, 3, (m, n)).astype(float), g.integers(-3, 4, m).astype(float)
    equal = g.random(m) < 0.15
    lower = np.where(g.random(n) < 0.4, -float(g.integers(0, 4)), -np.inf)
    upper = np.where(g.random(n) < 0.4, float(g.integers(0, 4)), np.inf)
    rows = []
    for i in range(m):
        p = linear(a[i], x) + b[i]
        rows.append(p == 0 if equal[i] else p >= 0)
    costs = g.integers(-2, 3, (3, n)).astype(float)
    problem = sp.Problem(linear(costs[0], x), rows, lower, upper)
    others = []
    for cost in costs:
        found = linprog(
            cost,
            A_ub=-a[~equal] if (~equal).any() else None,
            b_ub=b[~equal] if (~equal).any() else None,
            A_eq=a[equal] if equal.any() else None,
            b_eq=-b[equal] if equal.any() else None,
            bounds=np.stack([lower, upper], axis=1),
            method="highs-ds",
            options={"presolve": False},
        )
        others.append(found)
    return problem, [linear(c, x) for c in costs], others


@pytest.mark.parametrize("block", slow_after(4, range(10)))
def test_random_programs_agree_with_another_solver(block: int) -> None:
    for seed in range(30 * block, 30 * block + 30):
        problem, objectives, others = random_case(seed)
        found = sp.linear_bounds(problem, objectives)
        for bound, objective, other in zip(found, objectives, others, strict=True):
            verdict = bound.verify(problem, objective)
            assert verdict.ok, (seed, verdict)
            if other.status in STATUS:
                assert bound.status is STATUS[other.status], seed
            if other.status == 0:
                assert bound.lower == pytest.approx(other.fun, abs=1e-9)
                assert bound.lower <= bound.value <= bound.upper
                assert np.nextafter(bound.lower, np.inf) >= bound.upper


def test_thirds_are_rounded_outwards() -> None:
    (x,) = sp.variables(1)
    problem = sp.Problem(x, [3 * x >= 1])
    (bound,) = sp.linear_bounds(problem, [x])
    assert bound.value == Fraction(1, 3)
    assert Fraction(bound.lower) < bound.value < Fraction(bound.upper)


def test_emptiness_by_less_than_a_rounding_error_is_seen() -> None:
    x, y = sp.variables(2)
    tiny = 2.0**-52
    wide = sp.Problem(x, [x + y >= 1.0, -x - y >= -1.0])
    none = sp.Problem(x, [x + y >= 1.0 + tiny, -x - y >= -1.0])
    assert sp.linear_bounds(wide, [x])[0].status is sp.Status.UNBOUNDED
    (bound,) = sp.linear_bounds(none, [x])
    assert bound.status is sp.Status.INFEASIBLE and bound.lower == np.inf
    assert bound.verify(none, x).ok
    assert {row for row, _ in bound.multipliers} == {0, 1}
    assert not bound.verify(wide, x).ok


def test_what_no_row_speaks_of_is_unbounded_both_ways() -> None:
    x, y, z = sp.variables(3)
    problem = sp.Problem(x, [x + y >= 1, x + y <= 2])
    bounds = sp.linear_bounds(problem, [z, -z, x + y, -x - y, x])
    kinds = [bound.status.value for bound in bounds]
    assert kinds == ["UNBOUNDED", "UNBOUNDED", "OPTIMAL", "OPTIMAL", "UNBOUNDED"]
    assert (bounds[2].value, bounds[3].value) == (1, -2)


def test_a_degenerate_vertex_with_many_rows() -> None:
    g = np.random.default_rng(0)
    n = 5
    x = sp.variables(n)
    rows = [linear(a, x) >= 0 for a in np.abs(g.integers(0, 9, (300, n))).astype(float) + 0.1]
    problem = sp.Problem(x[0], rows, lower=0)
    (bound,) = sp.linear_bounds(problem, [sp.total(list(x))])
    assert bound.value == 0


def test_badly_scaled_rows() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x, [1e-150 * x - 3e150 * y >= 1e-140, 1e200 * y >= 1e-100])
    (bound,) = sp.linear_bounds(problem, [x])
    assert bound.status is sp.Status.OPTIMAL and bound.verify(problem, x).ok


def test_forged_claims_are_refused() -> None:
    x, y = sp.variables(2)
    problem = sp.Problem(x, [x + y >= 1, x - y >= 0, 3 - x >= 0])
    (bound,) = sp.linear_bounds(problem, [x])
    assert bound.verify(problem, x).ok
    forged = [
        replace(bound, lower=bound.lower + 1e-15),
        replace(bound, multipliers=((0, Fraction(-1)),)),
        replace(bound, multipliers=((99, Fraction(1)),)),
        replace(bound, multipliers=((0, Fraction(1)),)),
        replace(bound, vertex=(Fraction(0), Fraction(0))),
        replace(bound, vertex=None),
        replace(bound, upper=0.25),
        replace(bound, status=sp.Status.INFEASIBLE, lower=np.inf),
        replace(bound, status=sp.Status.UNBOUNDED, lower=-np.inf, ray=(Fraction(-1), Fraction(0))),
    ]
    for claim in forged:
        assert not claim.verify(problem, x).ok
    assert not bound.verify(problem, x - 1).ok


def test_only_linear_problems_are_taken() -> None:
    x, y = sp.variables(2)
    with pytest.raises(sp.ProblemError, match=r"constraints\[1\]"):
        sp.linear_bounds(sp.Problem(x, [x >= 0, x * y >= 1]), [x])
    with pytest.raises(sp.ProblemError, match=r"objectives\[1\]"):
        sp.linear_bounds(sp.Problem(x, [x >= 0]), [x, y**2])
    assert sp.linear_bounds(sp.Problem(x, [x >= 0]), []) == []


def test_objectives_are_taken_from_any_iterable() -> None:
    (x,) = sp.variables(1)
    low, high = sp.linear_bounds(sp.Problem(x, lower=1, upper=2), (f for f in (x, -x)))
    assert (low.value, high.value) == (1, -2)


def test_coefficients_of_objectives_count_before_they_are_rounded() -> None:
    (x,) = sp.variables(1)
    problem = sp.Problem(x, [x >= 1])
    tiny = Fraction(1, 10**400)
    third, constant, far = objectives = [x / 3, x + Fraction(1, 3), -tiny * x]
    found = sp.linear_bounds(problem, objectives)
    assert [bound.value for bound in found] == [Fraction(1, 3), Fraction(4, 3), None]
    assert Fraction(found[0].lower) < Fraction(1, 3) < Fraction(found[0].upper)
    assert found[2].status is sp.Status.UNBOUNDED
    for bound, objective in zip(found, (third, constant, far), strict=True):
        assert bound.verify(problem, objective).ok
    rounded = sp.Polynomial.from_words(third.words, third.coefficients, 1)
    assert not found[0].verify(problem, rounded).ok
    with pytest.raises(sp.ProblemError, match="linear"):
        sp.linear_bounds(problem, [x + tiny * x**2])
