"""Points of long records: their equations are solved in turn, where they can be."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from setid.proofs import existence
from setid.proofs.existence import proved_point
from sparsepop_py.verified.points.feasible_point import exact_coordinates


def long_record(
    model: setid.TransferFunction, theta: list[float], shape: tuple[int, ...] = (220,)
) -> tuple[setid.Formulation, sp.ProvedPoint]:
    u = np.random.default_rng(0).uniform(-1.0, 1.0, shape)
    noise = setid.Noise(output=0.01)
    truth = setid.simulate_record(model, theta, u, noise, seed=1)
    formulation = setid.formulate(truth.data, model, noise, setid.Stable())
    x = setid.least_noise(formulation, theta).x
    point = proved_point(formulation, formulation.problem, x)
    assert point is not None and point.proof == "substitution"
    return formulation, point


@pytest.mark.parametrize(
    ("poles", "rows"), [((0.9, 0.7, -0.5), 2), ((0.9, 0.8, 0.3, -0.6), 2 + 1 + 2)]
)
def test_reflection_coefficients_are_solved_together(poles: tuple[float, ...], rows: int) -> None:
    """Rows of ``Stable`` join two unknowns each; all coordinates lie where rationals put them."""
    order = len(poles)
    theta = [*np.poly(poles)[1:].tolist(), 1.0]
    formulation, point = long_record(setid.TransferFunction(order, 1), theta)
    origins = [formulation.rows.origin[row] for row in point.rows.tolist()]
    assert origins.index("model") == rows
    assert np.array_equal(point.x[: order + 1], theta)
    near = dict(zip(formulation.layout.names, map(Fraction, point.x.tolist()), strict=True))
    for name, value in reflections(theta[:order]).items():
        assert abs(near[name] - value) <= Fraction(point.radius)


def reflections(coefficients: list[float]) -> dict[str, Fraction]:
    """Step down from a denominator: k_n = a_n, then (a_i - k_n a_(n-i)) / (1 - k_n^2)."""
    a, found = [Fraction(value) for value in coefficients], {}
    while len(a) > 2:
        k, a = a[-1], a[:-1]
        a = [(one - k * two) / (1 - k**2) for one, two in zip(a, reversed(a), strict=True)]
        found[f"stable.k{len(a)}"] = a[-1]
    return found


def test_outputs_lie_where_rationals_put_them() -> None:
    formulation, point = long_record(setid.TransferFunction(3, 1), [-1.1, -0.17, 0.315, 1.0])
    exact = exact_coordinates(formulation.problem, point.x, point.rows, point.solved)
    assert exact is not None
    assert all(
        abs(a - Fraction(b)) <= Fraction(point.radius)
        for a, b in zip(exact, point.x.tolist(), strict=True)
    )


def test_many_rows_that_need_each_other_have_no_order(monkeypatch: pytest.MonkeyPatch) -> None:
    x = sp.variables(4)
    ring = [2 * x[k] + x[(k + 1) % 3] == 1 for k in range(3)]
    problem = sp.Problem(x[0], [x[3] == x[0], *ring])
    rows, solved = np.arange(4), np.array([3, 0, 1, 2])
    order = existence._in_turn(problem, rows, solved)
    assert order is not None and order.tolist() == [1, 2, 3, 0]
    for most in (2, 0):
        monkeypatch.setattr(existence, "_MANY", most)
        assert existence._in_turn(problem, rows, solved) is None


def test_denominators_that_share_an_integrator_are_solved_in_turn() -> None:
    """Rows multiply out what is solved for; poles near one spoil the test of Krawczyk."""
    poles = ((0.81, 0.09), (0.99999, 0.934), (0.99999, 0.345))
    model = setid.TransferFunction(2, 2, 1, inputs=3, form="lifted")
    denominators = [float(a) for pair in poles for a in np.poly(pair)[1:]]
    theta = [*denominators, 0.1, 0.05, 0.2, 0.05, 0.3, 0.05]
    formulation, point = long_record(model, theta, (60, 3))
    assert point.recheck(formulation.problem) is not None
