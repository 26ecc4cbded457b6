"""Difference equations solved by filters and by samples, against rationals."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import setid
from setid.models.equations import Equation, Lagged, Term, term
from setid.simulation import recursions
from setid.simulation.recursions import solve_equations
from setid.simulation.responses import from_readings, run

RNG = np.random.default_rng(2)


def replayed(equations, theta, signals, first, drives):
    """Go through samples and equations in rationals: the definition."""
    exact = {name: [Fraction(v) for v in x.tolist()] for name, x in signals.items()}
    number = {name: Fraction(value) for name, value in theta.items()}

    def weight(term):
        value = Fraction(term.coefficient)
        for name in term.parameters:
            value *= number[name]
        return value

    for k in range(first, len(next(iter(exact.values())))):
        for equation in equations:
            drive = drives.get(equation.defines)
            value = Fraction(0) if drive is None else Fraction(drive[k])
            for each in equation.explicit:
                product = weight(each)
                for s in each.signals:
                    product *= exact[s.signal][k - s.lag]
                value -= product
            lead = 1 + sum(weight(term) for term in equation.implicit)
            exact[equation.defines][k] = value / lead
    return exact


LINEAR = setid.TransferFunction(na=2, nb=1, nk=1)
STRUCTURES = {
    "one input": setid.TransferFunction(na=2, nb=2, nk=1, offset=True),
    "static gain": setid.TransferFunction(na=0, nb=1),
    "two denominators": setid.TransferFunction(na=1, nb=1, nk=1, inputs=2),
    "static map in front": setid.Hammerstein(LINEAR, 3),
    "static map behind": setid.Wiener(LINEAR, 2),
    "feedback through a map": setid.Lure(LINEAR, 2),
    "products": setid.PolynomialNARX(["y1", "y1*y2", "u1*u2"], ny=2, nu=2),
    "a product with the input alone": setid.PolynomialNARX(["y1*u1", "u1"], ny=1, nu=1),
    "an implicit equation": setid.ContinuousTransferFunction(2, 1, Ts=0.5),
}


@pytest.mark.parametrize("count", [0, 1, 12])
@pytest.mark.parametrize("name", STRUCTURES)
def test_equations_are_solved(name: str, count: int) -> None:
    model = STRUCTURES[name]
    equations = model.equations()
    lag = max(e.lag for e in equations)
    theta = dict(zip(model.parameters, RNG.integers(-8, 8, 20) / 32, strict=False))
    signals = {f"u{j + 1}": RNG.uniform(-1, 1, count + lag) for j in range(model.inputs)}
    signals |= {e.defines: np.append(RNG.uniform(-1, 1, lag), np.zeros(count)) for e in equations}
    drives = {e.defines: RNG.uniform(-0.1, 0.1, count + lag) for e in equations if e.error}
    expected = replayed(equations, theta, signals, lag, drives)
    solve_equations(equations, theta, signals, lag, drives)
    for signal, values in signals.items():
        assert values == pytest.approx([float(v) for v in expected[signal]], abs=1e-13)


def test_signals_that_feed_each_other_are_solved_together() -> None:
    """y1(k) = .5 y2(k-1), y2(k) = y1(k) + 1, from y2 = 2: neither is known before the other."""
    first = Equation("y1", (term(1.0, "", Lagged("y1")), term(-0.5, "", Lagged("y2", 1))))
    one = term(1.0, "", Lagged("y2")), term(-1.0, "", Lagged("y1")), term(-1.0, "")
    signals = {"y1": np.zeros(4), "y2": np.array([2.0, 0.0, 0.0, 0.0])}
    solve_equations([first, Equation("y2", one)], {}, signals, 1, {})
    assert signals["y1"].tolist() == [0.0, 1.0, 1.0, 1.0]
    assert signals["y2"].tolist() == [2.0, 2.0, 2.0, 2.0]


def test_records_go_on_from_their_first_readings() -> None:
    """y(k) = .5 y(k-1) + 2 u(k-1) from y = 4: what was read later does not count."""
    model = setid.TransferFunction(na=1, nb=1, nk=1)
    data = setid.IOData([1.0, 0.0, 1.0, 0.0], [4.0, 7.0, np.nan, 9.0])
    assert run(model, [-0.5, 2.0], data).ravel().tolist() == [4.0, 4.0, 2.0, 3.0]


def test_linear_records_need_no_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*given):
        raise AssertionError("by samples")

    monkeypatch.setattr(recursions, "_by_samples", fails)
    data = setid.IOData(RNG.uniform(-1.0, 1.0, (9, 2)), RNG.uniform(-1.0, 1.0, 9))
    model = setid.TransferFunction(na=2, nb=1, nk=1, inputs=2)
    assert len(from_readings(model)) == 1
    assert np.isfinite(run(model, np.full(6, 0.1), data)).all()


def test_an_equation_that_gives_no_sample_is_refused() -> None:
    model = setid.PolynomialNARX(["y1", "u0"], ny=1, nu=0)
    equation = model.equations()[0]
    implicit = replace(equation, terms=(*equation.terms, Term(1.0, ("y1_1",), (Lagged("y1"),))))
    theta = dict.fromkeys((*model.parameters, "y1_1"), -1.0)
    with pytest.raises(setid.ModelError, match="factor of zero before y1"):
        solve_equations([implicit], theta, {"y1": np.ones(3), "u1": np.ones(3)}, 1, {})
