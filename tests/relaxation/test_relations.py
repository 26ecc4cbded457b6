"""Relations between problems: what must not change a bound, and what must not worsen it."""

from __future__ import annotations

import numpy as np
import pytest
from random_cases import random_case
from slow_values import slow_after

import sparsepop_py as sp

# ---- relations between problems ---------------------------------------------------------------


def bound(problem, **fields):
    return sp.solve(problem, sp.Options(order=2, **fields)).lower_bound


@pytest.mark.parametrize("seed", slow_after(3, range(6)))
@pytest.mark.parametrize("effort", ["plain", "presolve"])
def test_more_constraints_and_tighter_bounds_never_lower_the_bound(seed, effort):
    case = random_case([seed, 5])
    problem = case.problem
    base = bound(problem, effort=effort)
    best = case.points[int(np.argmin(case.values))]
    x = sp.variables(problem.dimension)
    scale = 1e-5 * (1 + abs(base))
    extra = sp.total((v - float(p)) ** 2 for v, p in zip(x, best, strict=True)) <= 4
    more = sp.Problem(
        problem.objective, [*problem.constraints, extra], problem.lower, problem.upper
    )
    assert base - scale <= bound(more, effort=effort) <= case.least
    middle = 0.5 * (problem.lower + best), 0.5 * (problem.upper + best)
    tighter = sp.Problem(problem.objective, problem.constraints, *middle)
    assert base - scale <= bound(tighter, effort=effort) <= case.least


@pytest.mark.parametrize("seed", range(8))
def test_names_of_variables_do_not_matter(seed):
    case = random_case([seed, 6])
    problem = case.problem
    order = np.random.default_rng(seed).permutation(problem.dimension)
    place = np.argsort(order)
    x = sp.variables(problem.dimension)

    def moved(p):
        parts = [0.0 * x[0]]
        for word, coefficient in zip(p.words.tolist(), p.coefficients.tolist(), strict=True):
            term = coefficient
            for letter in word:
                term = term * x[place[letter - 1]] if letter else term
            parts.append(term)
        return sp.total(parts)

    relabelled = sp.Problem(
        moved(problem.objective),
        [sp.Constraint(moved(c.polynomial), c.kind) for c in problem.constraints],
        problem.lower[order],
        problem.upper[order],
    )
    assert bound(relabelled, effort="plain") == pytest.approx(
        bound(problem, effort="plain"), rel=1e-6, abs=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("factor", [1e3, 1e-3, 2.0**20])
def test_the_bound_scales_with_the_objective(seed, factor):
    problem = random_case([seed, 8]).problem
    large = sp.Problem(
        factor * problem.objective, problem.constraints, problem.lower, problem.upper
    )
    expected = bound(problem, effort="plain")
    assert bound(large, effort="plain") / factor == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_a_shift_of_the_objective_shifts_the_bound(seed):
    problem = random_case([seed, 9]).problem
    moved = sp.Problem(problem.objective + 7.0, problem.constraints, problem.lower, problem.upper)
    assert bound(moved, effort="plain") == pytest.approx(
        bound(problem, effort="plain") + 7.0, abs=1e-5
    )


@pytest.mark.parametrize("seed", slow_after(2, [1, 3, 2, 4, 5]))
def test_higher_orders_prove_more(seed):
    problem = random_case([seed, 10]).problem
    scale = 1e-6 * (1 + abs(bound(problem)))
    values = [sp.solve(problem, sp.Options(order=k, effort="plain")).lower_bound for k in (2, 3, 4)]
    assert values[0] <= values[1] + scale
    assert values[1] <= values[2] + scale
