"""Random problems against brute force: grids on which every value is exact.

Coefficients are multiples of 1/4 and grid points of 1/16, degrees at most 4, so that a
polynomial's values on the grid are exact in double precision, however they are added.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exact_polynomials import value_at
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import SEEDS, random_case
from slow_values import slow_after

import sparsepop_py as sp
from sparsepop_py.local_search.feasibility import prove_feasible
from sparsepop_py.relaxation.recover_multipliers import identity_of
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.box.propagation import is_empty, propagate
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import box_rows

quick = settings(max_examples=40, deadline=None, derandomize=True, database=None)


# ---- problems and their grids -----------------------------------------------------------------


# ---- any multipliers --------------------------------------------------------------------------


def variants(z, rng):
    yield "solver", z
    for size in (1e-12, 1e-9, 1e-6, 1e-3, 1.0):
        yield f"noise {size}", z + size * rng.normal(size=z.size)
    yield "float32", z.astype(np.float32).astype(float)
    yield "random", rng.normal(size=z.size) * 10.0 ** rng.integers(-3, 4)
    yield "zero", 0.0 * z
    yield "negated", -z


def bounds_of_any_multipliers(case, order, products, rng):
    problem = case.problem
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    scaled = Scaled.of(problem, scaling, (problem.objective,))
    relaxation = sp.relax(scaled.problem, order, products=products)
    program = sp.assemble(relaxation, scaled.objectives[0])
    z = sp.solve_conic(program).z
    for name, multipliers in variants(z, rng):
        identity = identity_of(relaxation, scaled, multipliers, scaled.objective_sizes[0])
        yield name, identity
    last = identity_of(relaxation, scaled, z, scaled.objective_sizes[0])
    for name, change in {
        "factors in float32": lambda v: v.astype(np.float32),
        "factors disturbed": lambda v: v * (1 + 1e-4 * rng.normal(size=v.shape)),
        "columns lost": lambda v: v[..., :1] if v.ndim == 3 else 0.5 * v,
    }.items():
        groups = tuple(replace(g, values=change(g.values)) for g in last.multipliers)
        yield name, replace(last, multipliers=groups)
    floors = tuple(
        g if g.free else replace(g, floor=float(rng.uniform(0, 1))) for g in last.multipliers
    )
    yield "floors", replace(last, multipliers=floors)
    shuffled = rng.permutation(len(last.multipliers))[: len(last.multipliers) // 2]
    yield "half", replace(last, multipliers=tuple(last.multipliers[k] for k in shuffled))
    yield "none", Identity(last.scaling, ())


@given(SEEDS)
@quick
def test_no_multipliers_prove_more_than_the_grid_allows(seed):
    case, rng = random_case(seed), np.random.default_rng([seed, 7])
    problem = case.problem
    for name, identity in bounds_of_any_multipliers(case, 2, bool(seed % 2), rng):
        found = identity.evaluate(problem.rows, problem.equality, problem.objective_row)
        assert found.bound <= case.least, (name, found)
        assert found.bound > -np.inf, (name, found)  # all variables are boxed


@pytest.mark.slow
@given(SEEDS)
@settings(quick, max_examples=500)
def test_no_multipliers_prove_more_many_times(seed):
    case, rng = random_case([seed, 1]), np.random.default_rng([seed, 8])
    problem = case.problem
    for name, identity in bounds_of_any_multipliers(case, 2 + seed % 2, bool(seed % 3), rng):
        found = identity.evaluate(problem.rows, problem.equality, problem.objective_row)
        assert found.bound <= case.least, (name, found)


def test_good_multipliers_prove_nearly_everything():
    """So that the property above is not one of useless bounds."""
    close = 0
    for seed in range(30):
        case = random_case(seed, constrained=False)
        rng = np.random.default_rng(seed)
        _, identity = next(bounds_of_any_multipliers(case, 2, False, rng))
        problem = case.problem
        found = identity.evaluate(problem.rows, problem.equality, problem.objective_row)
        spread = 1.0 + np.ptp(case.values)
        assert found.bound <= case.least
        close += case.least - found.bound <= 0.02 * spread
    assert close >= 25


# ---- the whole solver -------------------------------------------------------------------------


@given(SEEDS)
@settings(quick, max_examples=10)
def test_solve_is_right_about_random_problems(seed):
    check_solve(random_case(seed))


@pytest.mark.slow
@pytest.mark.parametrize("block", range(8))
def test_solve_is_right_about_many_random_problems(block):
    for seed in range(25):
        check_solve(random_case([block, seed, 4]))


def check_solve(case):
    for effort in ("presolve", "plain"):
        result = sp.solve(case.problem, sp.Options(effort=effort, order=2))
        assert result.status is not sp.Status.INFEASIBLE
        assert result.lower_bound <= min(case.least, result.upper_bound)
        assert result.lower_bound > -np.inf
        assert result.certificate.verify(case.problem).ok
        if result.attained is not None:
            worst = max([1.0, *(abs(c.polynomial.coefficients).max() for c in rows(case))])
            assert case.problem.violation(result.x) <= 1e-9 * worst
        # the grid has a point of value least: a good upper bound is not much above it
        if not case.problem.constraints:
            assert result.upper_bound <= case.least + 1e-9 * (1 + abs(case.least))


def rows(case):
    return [c for c in case.problem.constraints if c.polynomial.terms]


@pytest.mark.parametrize("block", slow_after(2, range(4)))
def test_a_feasible_problem_is_never_called_infeasible(block):
    """100 problems with a planted point: random doubles, equalities that hold exactly there."""
    for seed in range(25 * block, 25 * block + 25):
        case = random_case([seed, 99])
        result = sp.solve(case.problem, sp.Options(refine="none", order=2))
        assert result.status is not sp.Status.INFEASIBLE
        assert result.lower_bound <= case.least


@given(SEEDS)
@quick
def test_every_candidate_that_is_proved_is_feasible(seed):
    case, rng = random_case(seed), np.random.default_rng([seed, 3])
    start = case.points[rng.integers(case.points.shape[0])]
    proved = prove_feasible(case.problem, start + 1e-9 * rng.normal(size=start.size))
    if proved is None:
        return
    assert np.all(proved.x >= case.problem.lower)
    assert np.all(proved.x <= case.problem.upper)
    if proved.proof == "exact" and proved.radius == 0:
        for row in case.problem.constraints:
            value = value_at(row.polynomial, proved.x)
            assert value == 0 if row.kind is sp.Kind.ZERO else value >= 0
        assert value_at(case.problem.objective, proved.x) <= Fraction(proved.value)


# ---- boxes ------------------------------------------------------------------------------------


@given(SEEDS)
@quick
def test_propagation_keeps_every_feasible_point(seed):
    case = random_case(seed)
    problem = case.problem
    for cutoff in (None, float(np.median(case.values)), case.least):
        box, sweeps = propagate(
            box_rows(problem, cutoff), Interval(problem.lower, problem.upper), limit=30
        )
        kept = case.points if cutoff is None else case.points[case.values <= cutoff]
        assert sweeps >= 1
        assert not is_empty(box)
        assert np.all(kept >= box.lo)
        assert np.all(kept <= box.hi)


@given(SEEDS)
@quick
def test_propagation_from_nothing_keeps_every_feasible_point(seed):
    """The same rows without the bounds: what shrinks must still hold the grid's points."""
    case = random_case(seed)
    problem = case.problem
    unbounded = Interval(np.full(problem.dimension, -np.inf), np.full(problem.dimension, np.inf))
    box, _ = propagate(box_rows(problem, case.least), unbounded, limit=30)
    kept = case.points[case.values <= case.least]
    assert np.all(kept >= box.lo)
    assert np.all(kept <= box.hi)


@given(SEEDS, st.integers(-8, 8))
@quick
def test_propagation_keeps_a_point_of_any_size(seed, decade):
    """Random doubles of many sizes; rows that hold at the point in rational arithmetic."""
    rng = np.random.default_rng([seed, decade + 8])
    n = int(rng.integers(1, 4))
    x = sp.variables(n)
    point = rng.normal(size=n) * 10.0 ** rng.integers(-3, 4, n) * 10.0**decade
    constraints = []
    for _ in range(int(rng.integers(1, 4))):
        parts = [0.0 * x[0]]
        for _ in range(int(rng.integers(1, 5))):
            term = float(rng.normal() * 10.0 ** rng.integers(-6, 7))
            for v in rng.integers(0, n, int(rng.integers(1, 5))).tolist():
                term = term * x[v]
            parts.append(term)
        g = sp.total(parts)
        value = float(value_at(g, point))
        g = g - value
        slack = value_at(g, point)  # the constant's rounding, of either sign
        constraints.append(g >= 0 if slack >= 0 else g <= 0)
        if slack == 0:
            constraints.append(g == 0)
    problem = sp.Problem(x[0], constraints)
    box, _ = propagate(
        box_rows(problem, None), Interval(point - np.abs(point), point + np.abs(point))
    )
    assert np.all(point >= box.lo)
    assert np.all(point <= box.hi)


@given(SEEDS)
@quick
def test_ranges_enclose_the_values_on_the_grid(seed):
    case = random_case(seed)
    box = Interval(case.problem.lower, case.problem.upper)
    enclosed = range_over(case.problem.objective_row, box)
    assert enclosed.lo[0] <= case.least
    assert case.values.max() <= enclosed.hi[0]
