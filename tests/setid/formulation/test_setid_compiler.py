"""The compiler carries more than the structures that ship: blocks, feedback, several signals.

The structures here are written for the tests; they show what a structure has to say.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import setid
from setid.formulation.compiler import plan
from setid.models.equations import Equation, Lagged, Transfer, term


@dataclass(frozen=True)
class Blocks:
    """A structure given by its equations."""

    stated: tuple[Equation, ...]
    parameters: tuple[str, ...]
    inputs: int = 1
    outputs: int = 1
    initial: str = "free"

    def equations(self, noisy: Collection[str] = ()) -> tuple[Equation, ...]:
        return self.stated

    def regression(self) -> tuple[Equation, ...]:
        return ()

    def transfer(self, output: int = 1, input: int = 1) -> Transfer:
        return Transfer(("b1",), ("a1",), 1)


U0, W1, Y0, Y1 = Lagged("u1"), Lagged("w", 1), Lagged("y1"), Lagged("y1", 1)
HAMMERSTEIN = Blocks(
    (
        Equation("w", (term(1.0, "", Lagged("w")), term(-1.0, "g1", U0), term(-1.0, "g2", U0, U0))),
        Equation("y1", (term(1.0, "", Y0), term(1.0, "a1", Y1), term(-1.0, "b1", W1)), error=True),
    ),
    ("a1", "b1", "g1", "g2"),
)
Z0, Z1 = Lagged("z"), Lagged("z", 1)
WIENER = Blocks(
    (
        Equation("z", (term(1.0, "", Z0), term(1.0, "a1", Z1), term(-1.0, "b1", Lagged("u1", 1)))),
        Equation("y1", (term(1.0, "", Y0), term(-1.0, "g1", Z0), term(-1.0, "g2", Z0, Z0))),
    ),
    ("a1", "b1", "g1", "g2"),
)
LURE = Blocks(
    (
        Equation("w", (term(1.0, "", Lagged("w")), term(-1.0, "g2", Y1, Y1))),
        Equation(
            "y1",
            (
                term(1.0, "", Y0),
                term(1.0, "a1", Y1),
                term(-1.0, "b1", Lagged("u1", 1)),
                term(1.0, "b1", Lagged("w")),
            ),
        ),
    ),
    ("a1", "b1", "g2"),
)


@pytest.mark.parametrize("initial", ["free", "zero"])
@pytest.mark.parametrize("noise", [setid.Noise(0.1), setid.Noise(0.1, 0.05), setid.Noise()])
@pytest.mark.parametrize(
    ("model", "theta"),
    [(HAMMERSTEIN, [-0.5, 1.0, 0.8, 0.3]), (WIENER, [-0.5, 1.0, 0.8, 0.3]), (LURE, [-0.5, 1, 0.1])],
)
def test_block_structures_hold_their_truth(model, theta, noise, initial: str) -> None:
    model = Blocks(model.stated, model.parameters, initial=initial)
    u = np.random.default_rng(2).uniform(-1, 1, 12)
    truth = setid.simulate_record(model, theta, u, noise, seed=1)
    formulation = setid.formulate(truth.data, model, noise, [setid.Stable(), setid.DCGain(1, 3)])
    x = formulation.point(truth.theta, truth.output, truth.input, signals=truth.signals)
    assert formulation.problem.violation(x) < 1e-12
    assert formulation.problem.degree <= 3
    assert formulation.regression is None
    if model.stated is HAMMERSTEIN.stated:
        found = formulation.point(truth.theta, truth.output, truth.input)
        np.testing.assert_allclose(found, x, atol=1e-12)


def test_definitions_that_nobody_uses_get_no_rows() -> None:
    data = setid.IOData([1, 2, 3, 4], [1, 2, 3, 1], starts=[0, 2])
    product = Equation("v", (term(1.0, "", Lagged("v")), term(-1.0, "", U0, U0)))
    row = Equation("y1", (term(1.0, "", Y0), term(-1.0, "g1", Lagged("v", 1))))
    everywhere = np.ones(4, bool)
    first, second = plan([product, row], data, {"u1": everywhere, "y1": everywhere}, "free")
    assert second.rows.tolist() == [1, 3] and first.rows.tolist() == [0, 2]
    holes = {"u1": np.array([True, True, False, True]), "y1": everywhere}
    first, second = plan([product, row], data, holes, "free")
    assert second.rows.tolist() == [1] and second.dropped == 1
    assert first.rows.tolist() == [0]


def test_constants_of_bands_are_rounded_outwards() -> None:
    """|y + ...| <= D becomes two rows whose constants are at least D + y and D - y, exactly."""
    y = np.random.default_rng(6).uniform(-1, 1, 200) * 10.0 ** np.arange(-5, 5).repeat(20)
    data = setid.IOData(np.arange(200.0), y)
    problem = setid.formulate(data, setid.TransferFunction(0, 1), setid.Noise(equation=0.1)).problem
    inexact = 0
    for k, value in enumerate(y.tolist()):
        for row, reading in ((2 * k, value), (2 * k + 1, -value)):
            constant = Fraction(problem.constraints[row].polynomial.constant_term)
            exact = Fraction(0.1) + Fraction(reading)
            assert 0 <= constant - exact <= 2.0**-52 * max(abs(exact), 1)
            inexact += constant != exact
    assert inexact > 100


def test_equations_that_define_nothing_are_refused() -> None:
    with pytest.raises(setid.ModelError, match="expected y1 at lag 0 first"):
        Equation("y1", (term(2.0, "", Y0), term(1.0, "a1", Y1)))


def test_simulation_needs_an_order() -> None:
    loop = Blocks(
        (
            Equation("w", (term(1.0, "", Lagged("w")), term(-1.0, "g2", Y0, Y0))),
            Equation("y1", (term(1.0, "", Y0), term(-1.0, "b1", Lagged("w")))),
        ),
        ("b1", "g2"),
    )
    with pytest.raises(setid.ModelError, match=r"equation of w needs \['y1'\] at the same sample"):
        setid.simulate(loop, [1.0, 1.0], [1.0, 2.0])


def test_products_with_a_sample_before_the_record_are_zero() -> None:
    """y(0) y(-1) is exactly 0 at rest; a product of readings keeps room for its rounding."""
    model = setid.PolynomialNARX(["y1", "y1*y2*u1"], ny=2, nu=1, initial="zero")
    data = setid.IOData([1.0, 0.5, -1.0, 0.25], [0.0, 0.5, 1.0, -0.5])
    problem = setid.formulate(data, model, setid.Noise(output=0.1, input=0.1)).problem
    ranges = {
        name: (low, high)
        for name, low, high in zip(problem.names, problem.lower, problem.upper, strict=True)
        if name.startswith("p[")
    }
    at_rest = [ends for ends in ranges.values() if max(map(abs, ends)) < 1e-300]
    assert at_rest and all(ends == (0.0, 0.0) for ends in at_rest)
    assert any(low < -0.1 * 0.6 < 0.1 * 0.6 < high for low, high in ranges.values())
    exact = setid.Noise(output=[[0.1], [0.0], [0.1], [0.1]], input=0.1)
    problem = setid.formulate(data, model, exact).problem
    place = problem.names.index("p[y0*y1][2]")
    assert problem.lower[place] <= -0.05 < 0.05 <= problem.upper[place]  # 0.5 times +-0.1


@pytest.mark.parametrize("form", ["auto", "partial", "lifted"])
@pytest.mark.parametrize("initial", ["zero", "free"])
@pytest.mark.parametrize("memory", [True, False])
def test_internal_signals_may_make_a_loop(form: Any, initial: Any, memory: bool) -> None:
    """z(k) = .5 z(k-1) + .6 (u - w)(k-1) with w = .2 z + .1 z^2, or .6 (u - .2 z^2)(k-1)."""
    gains = (0.5, 0.2, 0.1) if memory else (0.0, 0.0, 0.2)
    fixed = {"gamma1": 0.2, "b[y1,z]0": 1.0} | ({} if memory else {"b[z,u1-w]1": 0.6})
    model = setid.BlockStructured(
        {
            ("z", "u1 - w"): setid.TransferFunction(int(memory), 1, 1),
            ("y1", "z"): setid.TransferFunction(1, 1, 0),
        },
        {"w": setid.StaticMap("z", 2 if memory else [2])},
        normalise=fixed,
        initial=initial,
        form=form,
    )
    u, z, y = np.random.default_rng(0).uniform(-1, 1, 30), np.zeros(30), np.zeros(30)
    for k in range(1, 30):
        w = gains[1] * z[k - 1] + gains[2] * z[k - 1] ** 2
        z[k] = gains[0] * z[k - 1] + 0.6 * (u[k - 1] - w)
        y[k] = 0.3 * y[k - 1] + z[k]
    first = 6 if initial == "free" else 0
    data = setid.IOData(u[first:], y[first:])
    known = setid.formulate(data, model, setid.Noise(output=0.01))
    true = {"a[z,u1-w]1": -0.5, "a[y1,z]1": -0.3, "b[z,u1-w]1": 0.6, "gamma2": 0.1}
    x = np.zeros(known.layout.dimension)
    x[: len(known.parameters)] = [true[name] for name in known.parameters]
    signals = {"z": z, "w": gains[1] * z + gains[2] * z**2, "p[z^2]": z**2}
    for name, values in signals.items():
        if name in known.layout.groups:
            numbers = known.layout.group(name)
            x[numbers[numbers >= 0]] = values[first:][numbers >= 0]
    assert np.all(x >= known.problem.lower) and np.all(x <= known.problem.upper)
    residuals = [row.polynomial(x) for row in known.problem.constraints]
    assert len(residuals) > 40 and np.abs(residuals).max() < 1e-12
