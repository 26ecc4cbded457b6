"""Optimal control and nondquar: formulas written once more, and published optima."""

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import problems


def test_nondquar_is_the_formula():
    x = np.random.default_rng(0).integers(-4, 5, 9) / 4
    value = (x[0] - x[1]) ** 2 + (x[-2] + x[-1]) ** 2
    value += sum((x[i] + x[i + 1] + x[-1]) ** 4 for i in range(7))
    problem = problems.nondquar(9)
    assert problem.objective(x) == pytest.approx(value, rel=1e-14)
    assert problem.squares_constant == 0.0


@pytest.mark.parametrize(("controls", "states", "mu"), [(1, 1, 0.0), (2, 4, 0.0), (1, 2, 1.0)])
def test_states_follow_from_controls(controls, states, mu):
    """Simulate Coleman and Liao's system by loops: the rows hold, the cost is the sum."""
    steps, rng = 5, np.random.default_rng(1)
    drift = np.zeros((states, states))
    for j in range(states):
        for k in range(states):
            drift[j, k] = {0: 0.5, 1: 0.25, -1: -0.25}.get(k - j, 0.0)
    total = controls + states
    gain = [[(j - k) / total for k in range(1, controls + 1)] for j in range(1, states + 1)]
    couple = [[mu * (j + k) / total for k in range(1, controls + 1)] for j in range(1, states + 1)]
    y, point, cost = np.zeros(states), [], 0.0
    for _ in range(steps - 1):
        x = rng.uniform(-1, 1, controls)
        cost += np.sum((y + 0.25) ** 4) + np.sum((x + 0.5) ** 4)
        y = drift @ y + np.array(gain) @ x + y @ np.array(couple) @ x
        point += [*x, *y]
    cost += np.sum((y + 0.25) ** 4)
    problem = problems.bilinear_control(steps, controls, states, mu)
    assert problem.violation(point) < 1e-14
    assert problem.objective(point) == pytest.approx(cost, rel=1e-13)


def test_one_state_follows_from_one_control():
    steps, y, point = 7, 1.0, []
    cost = 0.0
    for x in np.linspace(-1, 1, steps - 1):
        y = y + (y**2 - x) / steps
        point += [x, y]
        cost += (x**2 + y**2) / steps
    problem = problems.scalar_control(steps)
    assert problem.violation(point) < 1e-14
    assert problem.objective(point) == pytest.approx(cost, rel=1e-13)


@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        # SparsePOP 3.03 with SeDuMi, its examples optControl(6,2,4,0) and optControl2(20)
        (problems.bilinear_control(6, 2, 4, 0.0), 0.0580887),
        (problems.scalar_control(20), 1.5141107),
        # PolynomialOptimization.jl, tests of correlative sparsity
        (problems.bilinear_control(6, 1, 2, 1.0, 0.25), 0.0282973),
        (problems.bilinear_control(12, 2, 4, 0.0, 0.25), 0.0440061),
    ],
)
def test_published_optima_are_proved(problem, optimum):
    result = sp.solve(problem, sp.Options(effort="auto", time_limit=60))
    assert result.lower_bound <= optimum + 1e-7
    assert result.lower_bound == pytest.approx(optimum, abs=2e-6)
    assert result.upper_bound == pytest.approx(optimum, abs=2e-6)


@pytest.mark.slow
def test_equations_alone_are_searched_without_vertices():
    """798 variables at an order above the least: the first point makes the box."""
    first, second = (
        sp.solve(problems.scalar_control(400), sp.Options(order=order)) for order in (1, 2)
    )
    for result in (first, second):
        assert result.status is sp.Status.OPTIMAL
    assert first.lower_bound <= second.upper_bound and second.lower_bound <= first.upper_bound


def test_wrong_sizes_are_named():
    with pytest.raises(sp.ProblemError, match="steps: found 1"):
        problems.scalar_control(1)
    with pytest.raises(sp.ProblemError, match="mu: found -1"):
        problems.bilinear_control(3, mu=-1.0)
    with pytest.raises(sp.ProblemError, match="rest: found nan"):
        problems.bilinear_control(3, rest=np.nan)
