"""Models for python-control."""

from __future__ import annotations

import builtins
from dataclasses import replace
from fractions import Fraction

import control
import numpy as np
import pytest
from identification_cases import PLANT
from identified_cases import empty, identified, second_order

import setid
import sparsepop_py as sp
from setid.export.python_control import coefficients, to_control
from setid.feasible_points.members import members
from setid.simulation.responses import frequency_response


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return second_order()


def test_the_nominal_model_has_the_response_of_the_parameters(
    result: setid.Identification,
) -> None:
    models = to_control(result)
    omega, theta = np.array([0.1, 1.0, 3.0]), result.best("simulation").theta
    expected = frequency_response(result.formulation.model, theta, omega, 1.0)
    assert np.allclose(models.nominal(np.exp(1j * omega)), expected)
    assert models.nominal.dt == 1.0
    y = setid.simulate(result.formulation.model, theta, np.ones(20)).ravel()
    _, step = control.step_response(models.nominal, np.arange(20.0))
    assert np.allclose(np.ravel(step), y)


def test_the_weight_covers_what_was_sampled(result: setid.Identification) -> None:
    models = to_control(result)
    assert models.label == "sampled" and len(models.vertices) >= 5
    assert repr(replace(models, radius=np.array([0.1231, 0.04]))) == (
        f"<ControlModels: {len(models.vertices)} vertices, radius up to 0.124, sampled>"
    )
    weight = np.abs(models.weight(np.exp(1j * models.omega)))
    assert np.all(weight >= models.radius)
    assert np.all(np.abs(models.weight.poles()) <= 1.0)
    thetas = members(result, 100)
    g = frequency_response(result.formulation.model, thetas, models.omega, 1.0)
    g0 = models.nominal(np.exp(1j * models.omega))
    assert np.all(np.abs(g / g0 - 1.0) <= weight + 1e-12)


def test_proved_radii_contain_sampled_ones_and_the_truth(result: setid.Identification) -> None:
    proved, sampled = to_control(result, kind="proved"), to_control(result)
    assert proved.label == "proved at the grid frequencies"
    assert np.all(proved.radius >= sampled.radius * (1 - 1e-6))
    truth = frequency_response(result.formulation.model, PLANT, proved.omega, 1.0)
    g0 = proved.nominal(np.exp(1j * proved.omega))
    assert np.all(np.abs(truth / g0 - 1.0) <= proved.radius * (1 + 1e-9))


def test_proved_radii_reach_all_corners_of_the_regions(result: setid.Identification) -> None:
    models = to_control(result, kind="proved")
    band = setid.frequency_band(result, models.omega, "proved")
    theta = result.best("simulation").theta
    around = frequency_response(result.formulation.model, theta, models.omega, 1.0)
    for radius, middle, corners in zip(models.radius, around, band.regions, strict=True):
        size = Fraction(middle.real) ** 2 + Fraction(middle.imag) ** 2
        for corner in corners:
            re, im = Fraction(corner.real) - Fraction(middle.real), Fraction(corner.imag)
            away = re**2 + (im - Fraction(middle.imag)) ** 2
            assert away <= Fraction(radius) ** 2 * size


def test_several_channels() -> None:
    model = setid.TransferFunction(1, 1, 1, inputs=2, outputs=2, common_denominator=True)
    theta = np.array([-0.5, 1.0, 0.2, -0.3, 0.8])
    u = np.random.default_rng(0).uniform(-1, 1, (40, 2))
    noise = setid.Noise(equation=0.1)
    truth = setid.simulate_record(model, theta, u, noise)
    models = to_control(identified(setid.formulate(truth.data, model, noise)))
    assert (models.nominal.noutputs, models.nominal.ninputs) == (2, 2)
    assert models.weight is None
    z = np.exp(1j * models.omega)  # python-control's own responses of the vertices
    assert models.radius.shape == (z.size, 2, 2)
    nominal = models.nominal(z)
    for vertex in models.vertices:
        apart = np.abs(vertex(z) / nominal - 1.0)
        assert np.all(models.radius >= np.moveaxis(apart, 2, 0) * (1 - 1e-9))
    assert np.all(models.radius > 0.0)


def test_what_is_refused_is_refused_before_any_search(monkeypatch: pytest.MonkeyPatch) -> None:
    model = setid.TransferFunction(1, 1, 1, inputs=2, common_denominator=True)
    noise = setid.Noise(equation=0.1)
    u = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    data = setid.simulate_record(model, [-0.5, 1.0, 0.2], u, noise).data
    found = identified(setid.formulate(data, model, noise))
    monkeypatch.setattr("setid.export.python_control.best", lambda *_: pytest.fail("searched"))
    with pytest.raises(setid.ModelError, match="found 'proved' with 2 inputs and 1 outputs"):
        to_control(found, kind="proved")
    with pytest.raises(setid.SetidError, match="omega"):
        to_control(found, omega=[4.0])  # above the Nyquist frequency


def test_delays_become_poles_at_zero() -> None:
    model = setid.TransferFunction(na=1, nb=2, nk=3)
    assert coefficients(model, np.array([-0.5, 1.0, 2.0])) == (
        [0, 0, 0, 1.0, 2.0],
        [1.0, -0.5, 0, 0, 0],
    )


def test_refusals(result: setid.Identification, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(setid.SetidError, match="empty"):
        to_control(empty(result.formulation))
    with pytest.raises(setid.SetidError, match="kind"):
        to_control(result, kind="sure")
    real = builtins.__import__

    def without(name: str, *rest: object) -> object:
        if name == "control":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(sp.SolverNotFound, match=r"sparsepop-py\[control\]"):
        to_control(result)
