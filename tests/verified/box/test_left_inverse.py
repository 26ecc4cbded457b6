"""First boxes from equations that are linear in what has no bounds.

Oracles: the record's own parameters and noise (feasible by construction), and closed forms
of single equations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.left_inverse import LeftInverse, left_inverse

INF = float("inf")


def record(seed, count=12, noise=0.05, size=2):
    """Rows (c_k + e_k)' theta = y_k - f_k with noise in the bounds, and a solution of them."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-3, 3, size)
    clean = rng.uniform(-2, 2, (count, size))
    e, f = rng.uniform(-noise, noise, (count, size)), rng.uniform(-noise, noise, count)
    measured = clean - e  # clean = measured + e
    y = clean @ truth + f
    x = sp.variables(size + count * (size + 1))
    theta, errors = x[:size], np.array(x[size:]).reshape(count, size + 1)
    rows = [
        sp.total([(measured[k, j] + errors[k, j]) * theta[j] for j in range(size)])
        == y[k] - errors[k, size]
        for k in range(count)
    ]
    free = np.full(size, INF)
    bounds = np.full(count * (size + 1), noise)
    problem = sp.Problem(
        theta[0], rows, np.concatenate([-free, -bounds]), np.concatenate([free, bounds])
    )
    return problem, np.concatenate([truth, np.column_stack([e, f]).ravel()])


def start(problem):
    return Interval(problem.lower, problem.upper)


@given(seed=st.integers(0, 10**6), noise=st.floats(1e-6, 0.2), size=st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_the_box_holds_a_feasible_point(seed, noise, size):
    problem, x = record(seed, noise=noise, size=size)
    assert problem.violation(x) < 1e-9
    step = left_inverse(problem, start(problem))
    if step is not None:
        box = step.shrink(problem, start(problem))
        assert np.all(np.isfinite(box.hi - box.lo))
        assert np.all(box.lo <= x + 1e-12) and np.all(x - 1e-12 <= box.hi)


def test_less_noise_makes_a_smaller_box():
    widths = []
    for noise in (1e-1, 1e-3, 1e-6):
        problem, _ = record(1, noise=noise)
        box = left_inverse(problem, start(problem)).shrink(problem, start(problem))
        widths.append(float((box.hi - box.lo)[:2].max()))
    assert widths[0] > 50 * widths[1] > 50 * 50 * widths[2]


def test_one_equation_with_its_closed_form():
    p, e = sp.variables(2)
    # p = 1 / (4 + e) in [0.2, 1/3], e in [-1, 1]
    problem = sp.Problem(p, [p * (4 + e) == 1], [-INF, -1], [INF, 1])
    step = left_inverse(problem, start(problem))
    box = step.shrink(problem, start(problem))
    assert box.lo[0] <= 0.2 and box.hi[0] >= 1 / 3
    # M = 1/4: |p - 1/4| <= |p - 1/4| / 4 + 1/16, the radius is 1/12
    assert box.lo[0] == pytest.approx(1 / 4 - 1.01 / 12) and box.hi[0] == pytest.approx(
        1 / 4 + 1.01 / 12
    )


def test_records_without_bounds_of_the_parameters_are_solved():
    problem, x = record(3, count=8, noise=0.02)
    low, high = sp.solve_each(
        problem,
        [problem.objective, -problem.objective],
        sp.Options(effort="auto", gap=1e-3, gap_kind="width", time_limit=60),
    )
    assert low.status is high.status is sp.Status.OPTIMAL
    assert low.lower_bound <= x[0] <= -high.lower_bound
    for result in (low, high):
        assert result.certificate.verify(result.problem).ok
        assert any(isinstance(step, LeftInverse) for step in result.certificate.box.steps)
    without = sp.solve(problem, sp.Options(effort="auto", skip=("inverse",), time_limit=1))
    assert without.lower_bound == -INF


def unbounded(problem, step):
    return np.isinf(step.shrink(problem, start(problem)).lo[0])


def test_steps_that_prove_nothing_change_nothing():
    problem, _ = record(5)
    step = left_inverse(problem, start(problem))
    assert not unbounded(problem, step)
    count = len(problem.constraints)
    forged = [
        replace(step, radius=0.5 * step.radius),
        replace(step, radius=-step.radius),
        replace(step, radius=step.radius[:1]),
        replace(step, radius=np.full_like(step.radius, np.nan)),
        replace(step, centre=step.centre + 1.0),
        replace(step, inverse=0.0 * step.inverse),
        replace(step, inverse=np.full_like(step.inverse, np.inf)),
        replace(step, inverse=step.inverse[:, 1:]),
        replace(step, rows=step.rows - 1),
        replace(step, rows=np.full_like(step.rows, count)),
        replace(step, rows=step.rows.astype(float)),
        replace(step, rows=np.zeros_like(step.rows)),
        replace(step, variables=np.array([0, 0])),
        replace(step, variables=np.array([0, problem.dimension])),
        replace(step, variables=np.array([0, 2])),  # products of both in a row
    ]
    for wrong in forged:
        assert unbounded(problem, wrong)


def test_inequalities_and_squares_are_no_rows():
    p, e = sp.variables(2)
    for row in (p * (4 + e) >= 1, p**2 * (4 + e) == 1, p * p * e + p == 1):
        problem = sp.Problem(p, [row], [-INF, -1], [INF, 1])
        assert left_inverse(problem, start(problem)) is None
    step = left_inverse(
        sp.Problem(p, [p * (4 + e) == 1], [-INF, -1], [INF, 1]),
        Interval(np.array([-INF, -1.0]), np.array([INF, 1.0])),
    )
    looser = sp.Problem(p, [p * (4 + e) >= 1], [-INF, -1], [INF, 1])
    assert unbounded(looser, step)


def test_too_much_noise_or_too_few_rows_give_nothing():
    p, q, e = sp.variables(3)
    few = sp.Problem(p, [p + q * (1 + e) == 1], [-INF, -INF, -0.1], [INF, INF, 0.1])
    assert left_inverse(few, start(few)) is None
    p, e = sp.variables(2)
    loud = sp.Problem(p, [p * (1 + e) == 1], [-INF, -2], [INF, 2])
    assert left_inverse(loud, start(loud)) is None
