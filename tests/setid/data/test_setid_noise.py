"""Noise bounds and noise sets."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import setid
import sparsepop_py as sp

DATA = setid.IOData([[1, 2], [-3, 4], [5, 6]], [10.0, np.nan, -30.0])
FIR = setid.TransferFunction(na=1, nb=1, nk=1)


def test_bounds_are_spread_over_samples_and_channels() -> None:
    output, input, equation = setid.Noise(0.5, [0.1, 0.2], [1, 2, 3]).bounds(DATA)
    assert output.tolist() == [[0.5], [0.0], [0.5]], "a missing sample has no noise"
    assert input.tolist() == [[0.1, 0.2]] * 3
    assert equation.tolist() == [[1], [2], [3]]
    full = np.arange(6.0).reshape(3, 2)
    assert np.array_equal(setid.Noise(input=full).bounds(DATA)[1], full)


def test_relative_bounds_are_fractions_of_the_reading() -> None:
    output, input, equation = setid.Noise(0.01, 0.1, 0.5, relative=True).bounds(DATA)
    np.testing.assert_allclose(output.ravel(), [0.1, 0.0, 0.3])
    np.testing.assert_allclose(input, 0.1 * np.abs(DATA.u))
    assert equation.tolist() == [[0.5]] * 3


def test_a_proportional_error_is_covered() -> None:
    """Measured = true (1 + d), |d| <= D, gives |measured - true| <= D / (1 - D) |measured|."""
    d = np.linspace(-0.2, 0.2, 41)
    true = 7.0
    measured = true * (1 + d)
    assert np.all(np.abs(measured - true) <= 0.2 / 0.8 * np.abs(measured) + 1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setid.Noise(output=-1), "output: found -1, expected bounds >= 0"),
        (lambda: setid.Noise(input=[1, np.nan]), "input: found"),
        (lambda: setid.Noise(output=np.ma.array([1, 9], mask=[0, 1])), "output: found"),
        (lambda: setid.Noise(input="loud"), "input: found str"),
        (lambda: setid.Noise(equation=np.inf), "equation: found an infinite value"),
        (lambda: setid.Noise(output=np.inf), "output: found an infinite value, expected finite"),
        (lambda: setid.Noise(relative=2), "relative: found 2"),
        (lambda: setid.Noise(constraints=[3]), r"constraints\[0\]: found int"),
        (lambda: setid.Noise(output=[1, 2]).bounds(DATA), r"output: found shape \(2,\), expected"),
        (lambda: setid.EnergyBound("sound", 1), "kind: found 'sound', expected one of output"),
        (lambda: setid.RateLimit("output", -1), "limit: found -1, expected a number >= 0"),
        (lambda: setid.estimate_noise_bound([1, 2], margin=0.5), "margin: found 0.5"),
        (lambda: setid.estimate_noise_bound(0.1), "zero_input_record: found shape \\(\\)"),
        (lambda: setid.estimate_noise_bound([]), "zero_input_record: found shape \\(0,\\)"),
        (lambda: setid.estimate_noise_bound(setid.IOData([0, 1], [1, 2])), "expected rest"),
        (lambda: setid.estimate_noise_bound([np.nan]), "zero_input_record: found no number in"),
        (lambda: setid.estimate_noise_bound([-9e307, 9e307], 3.0), "margin: found 3.0, times"),
    ],
)
def test_wrong_noise(make, message: str) -> None:
    with pytest.raises(setid.NoiseError, match=message):
        make()


def test_ambiguous_shapes_are_refused() -> None:
    data = setid.IOData([[1, 2], [3, 4]], [1, 2])
    with pytest.raises(setid.NoiseError, match="one a channel or one a sample"):
        setid.Noise(input=[0.1, 0.2]).bounds(data)


def test_a_bound_estimated_at_rest_is_an_assumption() -> None:
    rest = setid.IOData(np.zeros(4), [[0.1, 5.0], [-0.3, 5.2], [0.2, 4.9], [0.0, 5.0]])
    bound = setid.estimate_noise_bound(rest, margin=2)
    np.testing.assert_allclose(bound.value, [0.5, 0.3])
    np.testing.assert_allclose(bound.centre, [-0.05, 5.05])
    np.testing.assert_allclose(setid.estimate_noise_bound(rest, offset=False).value, [0.3, 5.2])
    noise = setid.Noise(output=bound)
    data = setid.IOData([1, 2, 3], [[1, 2], [2, 3], [3, 1]])
    formulation = setid.formulate(data, setid.TransferFunction(1, 1, outputs=2), noise)
    assert any("estimated from 4 samples at rest" in text for text in formulation.assumptions)
    np.testing.assert_allclose(noise.bounds(data)[0][0], [0.5, 0.3])


def test_exact_signals_have_no_variables() -> None:
    data = setid.IOData([1, 2, 3, 2], [1, 2, 1, 0])
    names = setid.formulate(data, FIR, setid.Noise(output=0.1)).layout.names
    assert names == ("a1", "b1", "eta[1]", "eta[2]", "eta[3]", "eta[4]")
    partly = setid.formulate(data, FIR, setid.Noise(output=[0, 0.1, 0, 0.1], input=0.1))
    assert partly.layout.names == ("a1", "b1", "eta[2]", "eta[4]", "xi[1]", "xi[2]", "xi[3]")
    assert setid.formulate(data, FIR, setid.Noise()).layout.names == ("a1", "b1")


def test_energy_and_rate_are_rows() -> None:
    data = setid.IOData([1, 2, 3, 2, 1], [1, 2, 1, 0, 1], starts=[0, 3])
    sets = [setid.EnergyBound("output", 0.5), setid.RateLimit("output", 0.25)]
    formulation = setid.formulate(data, FIR, setid.Noise(output=1.0, constraints=sets))
    origin = np.array(formulation.rows.origin)
    rows = [str(formulation.problem.constraints[r]) for r in np.flatnonzero(origin == "noise")]
    assert rows[0] == "0.25 - eta[1,1]^2 - eta[1,2]^2 - eta[1,3]^2 >= 0"
    assert rows[1] == "0.25 - eta[2,1]^2 - eta[2,2]^2 >= 0"
    assert rows[2:4] == ["0.25 + eta[1,1] - eta[1,2] >= 0", "0.25 - eta[1,1] + eta[1,2] >= 0"]
    assert len(rows) == 2 + 2 * 3, "no rate across the join"


def test_sets_of_equation_errors_make_them_unknowns() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model = setid.TransferFunction(1, 1)
    noise = setid.Noise(equation=0.5, constraints=setid.EnergyBound("equation", 0.7))
    formulation = setid.formulate(data, model, noise)
    assert formulation.layout.names[2:] == ("e[2]", "e[3]", "e[4]")
    e = np.array([0.05, -0.25, 0.3, -0.5])
    x = formulation.point([-0.5, 2.0], equation=e)
    assert formulation.problem.violation(x) < 1e-12
    assert formulation.equation(2).endswith("== e[2]")


def test_sets_of_the_users_own() -> None:
    data = setid.IOData([1, 2, 3], [1, 2, 1])
    zero_mean = lambda layout: [layout.variable("eta[1]") + layout.variable("eta[2]") == 0]  # noqa: E731
    formulation = setid.formulate(data, FIR, setid.Noise(0.1, constraints=zero_mean))
    assert str(formulation.problem.constraints[-1]) == "eta[1] + eta[2] == 0"
    for bad in (lambda layout: [1.0], lambda layout: [sp.variables(1)[0] >= 0]):
        with pytest.raises(setid.NoiseError, match=r"Noise.constraints\[0\]: found"):
            setid.formulate(data, FIR, setid.Noise(0.1, constraints=bad))
    with pytest.raises(setid.SetidError, match=r"name: found 'xi\[1\]'"):
        setid.formulate(data, FIR, setid.Noise(0.1)).layout.variable("xi[1]")


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (lambda layout: None, "found NoneType, expected a list of constraints"),
        (lambda layout: layout.variable("eta[1]") >= 0, "found Constraint, expected a list"),
        (lambda layout: [layout.variable("eta[99]") >= 0], "raised SetidError: name: found 'eta"),
        (lambda layout: (1 / k for k in [0]), "raised ZeroDivisionError"),
        (lambda: [], "raised TypeError"),
        (setid.EnergyBound, "raised TypeError: .*radius"),
    ],
)
def test_constraints_that_raise_are_named(constraint: Any, message: str) -> None:
    noise = setid.Noise(0.1, constraints=[lambda layout: [], constraint])
    data = setid.IOData([1, 2, 3], [1, 2, 3])
    with pytest.raises(setid.NoiseError, match=rf"^Noise.constraints\[1\]: {message}"):
        setid.formulate(data, FIR, noise)


def test_the_square_of_a_norm_is_rounded_upwards() -> None:
    """The noise of one sample may be as large as the radius, whose square is no double."""
    noise = setid.Noise(output=1.0, constraints=setid.EnergyBound("output", 0.7))
    row = setid.formulate(DATA, setid.TransferFunction(0, 1, inputs=2), noise).problem
    assert Fraction(0.7) ** 2 <= Fraction(row.constraints[-1].polynomial.constant_term)


def test_a_norm_beyond_all_doubles_says_nothing() -> None:
    noise = setid.Noise(output=1.0, constraints=setid.EnergyBound("output", 1e200))
    model = setid.TransferFunction(0, 1, inputs=2)
    without = setid.formulate(DATA, model, setid.Noise(output=1.0)).problem
    assert len(setid.formulate(DATA, model, noise).problem.constraints) == len(without.constraints)


def test_constraints_on_the_noise_are_assumptions() -> None:
    def nothing(layout: object) -> list[sp.Constraint]:
        return []

    sets = [setid.EnergyBound("output", 0.5), setid.RateLimit("output", 0.25), nothing]
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    noise = setid.Noise(output=1.0, constraints=sets)
    known = setid.formulate(data, setid.TransferFunction(1, 1), noise)
    assert known.assumptions[-3:] == (
        "the Euclidean norm of the output noise over each record is at most 0.5",
        "output noise changes by at most 0.25 from sample to sample",
        "the noise satisfies the constraints that nothing states",
    )


@pytest.mark.parametrize(
    "constraint",
    [setid.EnergyBound("output", 5e-4), setid.RateLimit("output", 2e-4), lambda layout: []],
)
def test_constraints_of_output_noise_say_nothing_of_a_discretisation_error(constraint) -> None:
    """Unknowns of outputs hold both: a norm of the noise alone would lose the truth."""
    model = setid.ContinuousTransferFunction(1, 0, hold="constant", delta=0.006)
    data = setid.IOData([1.0, 1.0, -1.0, -1.0], [0.0, 0.3, 0.5, 0.1], 0.1)
    noise = setid.Noise(output=1e-4, constraints=[constraint])
    with pytest.raises(setid.NoiseError, match="beside delta = 0.006"):
        setid.identify(data, model, noise)
    with pytest.raises(setid.NoiseError, match="beside delta"):
        setid.estimate_delta(data, model, noise)
    assert noise.covering(0.0).constraints == noise.constraints
    inputs = setid.Noise(output=1e-4, input=0.1, constraints=[setid.EnergyBound("input", 0.1)])
    assert inputs.covering(0.006).model_error == 0.006


@pytest.mark.parametrize(
    ("noise", "field"),
    [
        (setid.Noise(output=1e308, relative=True), "output"),
        (setid.Noise(input=1e308, relative=True), "input"),
        (setid.Noise(output=1e308).covering(1e308), "output"),
    ],
)
def test_bounds_beyond_all_doubles_are_refused(noise: setid.Noise, field: str) -> None:
    with pytest.raises(setid.NoiseError, match=f"{field}: found a bound beyond all doubles"):
        noise.bounds(setid.IOData([3, 2], [2, 4]))


def test_the_middle_of_huge_readings_does_not_overflow() -> None:
    bound = setid.estimate_noise_bound([2.0**1023, 1.5 * 2.0**1023])
    assert bound.value[0] == 2.0**1021 and bound.centre[0] == 1.25 * 2.0**1023
