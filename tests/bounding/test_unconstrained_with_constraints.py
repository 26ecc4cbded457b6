"""Constraints that make no box: sublevel sets and bounds of the objective alone."""

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py import problems

CAMEL = -1.0316284535  # at +-(0.0898, -0.7126); L. C. W. Dixon, G. P. Szegoe (1978)


def camel(rows=(), lower=None, upper=None):
    x, y = sp.variables(2)
    f = 4 * x**2 - 2.1 * x**4 + x**6 / 3 + x * y - 4 * y**2 + 4 * y**4
    return sp.Problem(f, [row(x, y) for row in rows], lower, upper)


CAMELS = {
    "half plane": camel([lambda x, y: x + y <= 10]),
    "beside a parabola": camel([lambda x, y: y <= x**2]),
    "below a cubic": camel([lambda x, y: y**3 <= 5 + x**3, lambda x, y: x - y <= 7]),
    "one bound": camel(lower=[-1.0, -np.inf]),
}


@pytest.mark.parametrize("effort", ["presolve", "auto"])
@pytest.mark.parametrize("name", CAMELS)
def test_coercive_objectives_bring_their_own_box(name, effort):
    """The minimisers are feasible, so that the optimum is that without constraints."""
    problem = CAMELS[name]
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=60))
    assert result.status is sp.Status.OPTIMAL
    assert CAMEL - 3e-6 <= result.lower_bound <= CAMEL + 1e-9
    assert result.certificate.verify(problem).ok


def test_a_hyperbola_cuts_the_camel():
    """On x y = 2 the objective is a function of x alone; its least value by a fine grid."""
    problem = camel([lambda x, y: x * y == 2])
    x = np.concatenate([np.linspace(-6, -0.2, 400001), np.linspace(0.2, 6, 400001)])
    least = problem.objective(np.column_stack([x, 2 / x])).min()
    result = sp.solve(problem)
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound == pytest.approx(least, abs=1e-5)
    assert result.certificate.verify(problem).ok


@pytest.mark.parametrize("effort", ["presolve", "auto"])
def test_a_square_is_bounded_where_its_sublevel_sets_are_not(effort):
    x, y = sp.variables(2)
    problem = sp.Problem((x - y) ** 2, [x + y <= 10])
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=60))
    assert result.status is sp.Status.OPTIMAL
    assert result.lower_bound == 0.0
    assert result.certificate.verify(problem).ok


def test_history_entries_stand_in_the_order_of_solving():
    """The relaxation proves nothing, then the objective alone does; both are in the history."""
    x, y = sp.variables(2)
    problem = sp.Problem((x - y) ** 4, [x + y <= 10])  # of degree 4: no multipliers are exact
    result = sp.solve(problem, sp.Options(effort="presolve"))
    bounds = [entry.lower_bound for entry in result.history]
    assert bounds == [-np.inf, 0.0]


def test_singular_gram_matrices_bound_constrained_problems():
    """Rosenbrock's objective less 1 is a sum of squares; x1 x2 >= 3 keeps it away from 0."""
    x = sp.variables(4)
    f = problems.rosenbrock(4).objective - 1.0
    problem = sp.Problem(f, [x[0] * x[1] >= 3])
    result = sp.solve(problem)
    assert 0.0 <= result.lower_bound < result.upper_bound
    assert result.certificate.verify(problem).ok


@pytest.mark.slow
@pytest.mark.parametrize("effort", ["presolve", "auto"])
def test_cliques_of_monomials_where_those_of_rows_are_too_large(effort):
    """Linear control is convex: whatever is attained near the bound is the optimum."""
    problem = problems.bilinear_control(167)
    result = sp.solve(problem, sp.Options(effort=effort, gap=1e-4, time_limit=300))
    assert problem.dimension == 996
    assert result.gap < 5e-5
    assert result.certificate.verify(problem).ok
