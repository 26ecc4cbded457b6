"""Plain relaxations are proved on boxes that the rows imply; the relaxation stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

import sparsepop_py as sp

INF = np.inf


def hammerstein(count, gain=0.5, noise=0.05, seed=0):
    """y_k = -a y_{k-1} + b0 x_k + b1 x_{k-1}, x_k = u_k + g u_k^2 without bounds, noisy y."""
    rng = np.random.default_rng(seed)
    a, b0, b1 = -0.6, 1.0, 0.4
    u = rng.uniform(-1, 1, count)
    x, y = u + gain * u * u, np.zeros(count)
    for k in range(1, count):
        y[k] = -a * y[k - 1] + b0 * x[k] + b1 * x[k - 1]
    read = y + rng.uniform(-noise, noise, count)
    v = sp.variables(4 + 2 * count)
    (pole, first, second, slope), inner, error = v[:4], v[4 : 4 + count], v[4 + count :]
    rows = [inner[k] == float(u[k]) + float(u[k] ** 2) * slope for k in range(count)]
    clean = [float(read[k]) - error[k] for k in range(count)]
    rows += [
        clean[k] + pole * clean[k - 1] - first * inner[k] - second * inner[k - 1] == 0
        for k in range(1, count)
    ]
    low = np.concatenate([np.full(4, -1.0), np.full(count, -INF), np.full(count, -noise)])
    return sp.Problem(pole, rows, low, -low)


def test_inner_signals_without_bounds_cost_a_plain_proof_nothing():
    """The equations bound the inner signals; before, only the box of the parameter was proved."""
    problem = hammerstein(8)
    _, value, POP, *_ = sp.sparsePOP(problem, {"relaxOrder": 2, "tighten": 0, "printLevel": 0})
    assert -1e-6 <= value - POP.solverValue <= 0.0
    assert value <= -0.6  # the true parameter is consistent
    truth = sp.solve(problem, sp.Options(order=2))  # with bounds of the signals from the start
    assert truth.status == "OPTIMAL" and value <= truth.upper_bound <= value + 1e-6


@pytest.mark.parametrize("shifted", [0, 1])
def test_one_bound_and_matrices_keep_their_multipliers(shifted):
    """x >= 1 and x y <= 3, y in [1, 2] bound x by 3: min -x^2 + y is -9 + 1 at (3, 1)."""
    x, y = sp.variables(2)
    problem = sp.Problem(y - x**2, [x * y <= 3], lower=[1, 1], upper=[INF, 2])
    more = {"relaxOrder": 2, "tighten": 0, "printLevel": 0, "scalingSW": shifted}
    _, value, *_ = sp.sparsePOP(problem, more)
    assert -8.0 - 1e-4 <= value <= -8.0


def test_chains_are_propagated_to_their_end():
    """x_k = a x_{k-1} / 2 + 0.3, |a| <= 1: |x_k| <= 0.6 + 0.4 / 2^k from the start on."""
    count = 150
    v = sp.variables(count + 1)
    rows = [v[0] == 1, *(v[k] == 0.5 * v[k - 1] * v[count] + 0.3 for k in range(1, count))]
    low = np.append(np.full(count, -INF), -1.0)
    result = sp.solve(sp.Problem(v[count - 1], rows, low, -low), sp.Options(order=1))
    assert -0.6 <= result.lower_bound <= 0.2 + 1e-9  # at a = -1 the signal tends to 0.2
    assert result.certificate.verify(result.problem).ok


def test_a_loss_of_the_proof_is_said_with_names_of_variables():
    """(x + y)^2 = 2 leaves x - y open: the relaxation has -sqrt(2), nothing pays for rounding."""
    x, y, z = sp.variables(3)
    problem = sp.Problem(x + y + z, [(x + y) ** 2 == 2], [-INF, -INF, 0], [INF, INF, 1])
    for effort in ("plain", "presolve"):
        result = sp.solve(problem, sp.Options(order=1, effort=effort))
        (said,) = [note for note in result.notes if "the proof loses the rest" in note]
        assert "value is -1.41421" in said and said.endswith("known for x1, x2")
        assert result.solver_value == pytest.approx(-(2**0.5), abs=1e-6)


def test_products_of_shifted_quartics_get_a_box():
    """Coefficients over six decades: far out the leading form outweighs the others."""
    x, y = sp.variables(2)
    first = (x - 3) ** 4 + 100 * (y + 2) ** 4 + 1
    second = (x + 30) ** 4 + (y - 20) ** 4 + 5
    problem = sp.Problem(first * second)
    result = sp.solve(problem)
    near = 33.0**4 + 22.0**4 + 5.0  # at (3, -2), where the first factor is 1
    assert 0.8 * near <= result.lower_bound <= result.upper_bound <= near
    assert result.certificate.verify(problem).ok


def test_a_chain_of_squares_without_squares_given_is_proved_by_a_gram_matrix():
    """Broyden's tridiagonal function, expanded: the minimum is 0, at a root of its equations."""
    given = sp.problems.broyden_tridiagonal(20)
    problem = sp.Problem(given.objective, (), given.lower, given.upper)
    plain = {"relaxOrder": 2, "tighten": 0, "printLevel": 0}
    _, value, POP, *_ = sp.sparsePOP(problem, plain)
    assert -1e-6 <= value <= 0.0
    assert abs(POP.solverValue) <= 1e-4  # the relaxation's own output stays
