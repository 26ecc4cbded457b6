"""Margins and steps of certified loops: verified again, and forged ones found."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import setid
from setid import control
from setid.control import loops

P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
K = control.ideal_controller(P, M)


@pytest.fixture(scope="module")
def found() -> control.StabilityCertificate:
    rng = np.random.default_rng(0)
    r = rng.uniform(-1, 1, 60)
    data = setid.IOData(r, P.simulate(r) + rng.uniform(-0.01, 0.01, 60))
    return control.stability_certificate(data, K, M, 1, 0.01, delay=1)


def test_margins_follow_from_the_sensitivity(found: control.StabilityCertificate) -> None:
    margins = control.loop_margins(found)
    m = margins.sensitivity  # the true one is max abs(1 - M) = 2 / 1.6, at z = -1
    assert 1.25 <= m < 1.4
    assert margins.gain == pytest.approx((m / (m + 1), m / (m - 1)), rel=1e-6)
    assert margins.phase == pytest.approx(2 * np.arcsin(0.5 / m), rel=1e-6)
    assert margins.verify()
    assert not replace(margins, sensitivity=0.9 * m).verify()
    assert not replace(margins, gain=(margins.gain[0], 1.1 * margins.gain[1])).verify()
    assert not replace(margins, gain=(0.9 * margins.gain[0], margins.gain[1])).verify()
    assert not replace(margins, phase=1.1 * margins.phase).verify()


def test_bands_of_steps_are_verified(found: control.StabilityCertificate) -> None:
    step = control.loop_step(found, 20)
    truth = 1 - 0.6 ** np.arange(20)
    assert np.all(step.low <= truth) and np.all(truth <= step.high)
    assert step.verify()
    part = 0.3 * (step.high - step.low)
    assert not replace(step, low=step.low + part).verify()
    assert not replace(step, high=step.high - part).verify()
    assert not replace(step, low=step.low * np.nan).verify()
    assert not replace(step, high=step.high * np.nan).verify()
    assert not replace(step, time=2.0 * step.time).verify()
    assert not replace(step, nominal=step.nominal * np.nan).verify()
    assert not replace(step, nominal=0.5 * step.low + 0.5 * step.high + 1e-3).verify()


@pytest.mark.parametrize("junk", [(), None, "x", (1.0,), (0.9, 1.0, 1.1), np.eye(2), -(10**400)])
def test_fields_of_another_kind_are_refused_without_an_exception(
    found: control.StabilityCertificate, junk: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    margins, step = control.loop_margins(found), control.loop_step(found, 5)
    monkeypatch.setattr(control.StabilityCertificate, "verify", lambda _: setid.Verification(True))
    monkeypatch.setattr(loops, "loop_margins", lambda _: margins)  # proved once is enough here
    monkeypatch.setattr(loops, "loop_step", lambda *_: step)
    assert margins.verify() and step.verify()
    for name in ("sensitivity", "gain", "certificate"):
        assert not replace(margins, **{name: junk}).verify(), name
    for name in ("time", "nominal", "low", "high", "certificate"):
        assert not replace(step, **{name: junk}).verify(), name


def test_a_certificate_that_was_read_has_margins(found: control.StabilityCertificate) -> None:
    again = control.StabilityCertificate.from_json(found.to_json())
    assert control.loop_margins(again).sensitivity < 1.4
    assert control.loop_step(again, 5).low.size == 5


def test_numbers_of_responses_are_bounded(found: control.StabilityCertificate) -> None:
    huge = 10**40
    for call in (
        lambda: control.loop_step(found, huge),
        lambda: control.check_matching(P, K, M, huge),
    ):
        with pytest.raises(setid.SetidError, match="samples: found"):
            call()
    for field, value in (("rise", 5e-324), ("settling", 5e-324), ("delay", huge)):
        given = {"rise": 1.0, "overshoot": 0.1, field: value}
        with pytest.raises(setid.ModelError, match=f"{field}: found"):
            control.reference_model(**given)


@pytest.mark.parametrize("kind", [np.float32, Fraction, np.float64])
def test_numbers_of_other_types_are_numbers(kind: type) -> None:
    model = control.reference_model(kind(4), kind(8), Ts=kind(1))
    assert model.denominator == control.reference_model(4.0, 8.0).denominator
    r = np.random.default_rng(0).uniform(-1, 1, 40)
    answer = control.stability_certificate(
        setid.IOData(r, P.simulate(r)), K, M, 1, 0.01, kind(0.125), delay=1
    )
    assert type(answer.margin) is float and answer.verify()
    assert control.StabilityCertificate.from_json(answer.to_json()).margin == 0.125
