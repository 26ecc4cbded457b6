"""Orders that are too high: the set is unbounded, and this is proved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
from benchmarks.problems.intervals import PLANTS, Experiment
from setid.identifiability.common_factor import find_unbounded

QUICK = setid.Options(time_limit=60.0, progress=False)
ONE, TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 2, 1)
NOISES = [setid.Noise(output=0.1), setid.Noise(output=0.1, input=0.02)]


def simulated(noise: setid.Noise, seed: int = 1) -> setid.Simulated:
    u = np.random.default_rng(seed).uniform(-1, 1, 20)
    return setid.simulate_record(ONE, [-0.6, 2.0], u, noise, seed)


@pytest.mark.parametrize("noise", NOISES)
def test_one_order_too_many(noise: setid.Noise) -> None:
    truth = simulated(noise)
    result = setid.identify(truth.data, TWO, noise, options=QUICK)
    statuses = {name: str(item.status) for name, item in result.intervals.items()}
    assert statuses == dict.fromkeys(["a1", "a2", "b1", "b2"], "unbounded")
    assert result.status == "unbounded" and bool(result.verify(truth.data))
    assert "take the lower order" in result.summary() and "a1, a2, b1, b2" in result.notes[0]
    for c in (-1e4, -1.0, 0.0, 3.0, 1e4):  # the true system times 1 + c q^-1, with the true noise
        theta = [-0.6 + c, -0.6 * c, 2.0, 2.0 * c]
        x = result.formulation.point(theta, output=truth.output, input=truth.input)
        assert result.formulation.problem.violation(x) <= 1e-11 * (1.0 + abs(c))


def test_the_engine_finds_a_member_where_estimates_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(data: setid.IOData, model: setid.TransferFunction) -> setid.Estimate:
        return setid.least_squares(setid.IOData(data.u, data.y[::-1]), model)

    monkeypatch.setattr("setid.identifiability.common_factor.linf", wrong)
    monkeypatch.setattr("setid.identifiability.common_factor.least_squares", wrong)
    known = setid.formulate(simulated(NOISES[0]).data, TWO, NOISES[0])
    found = find_unbounded(known)
    assert found is not None and found.verify(known)
    assert set(found.names) >= {"a1", "a2", "b2"}


def test_where_nothing_is_claimed() -> None:
    noise = NOISES[0]
    data = simulated(noise).data
    other = setid.simulate_record(ONE, [-0.6, 2.0], data.u, noise, 7).data
    gap = np.where(np.arange(20) == 9, np.nan, data.y.ravel())
    cases = [
        setid.formulate(data, TWO, noise, setid.Stable()),
        setid.formulate(data, TWO, setid.Noise(output=0.1, equation=0.1)),
        setid.formulate(data, setid.TransferFunction(2, 2, 1, initial="zero"), noise),
        setid.formulate(data, setid.TransferFunction(2, 1, 1), noise),
        setid.formulate(data, setid.TransferFunction(2, 2, 1, offset=True), noise),
        setid.formulate(setid.IOData(data.u, gap), TWO, noise),
        setid.formulate(data, setid.PolynomialNARX(["y1", "u1"], 1, 1), noise),
        setid.formulate(other, TWO, setid.Noise(output=0.01)),  # order 1 explains nothing
    ]
    assert [find_unbounded(known) for known in cases] == [None] * len(cases)


def test_a_forged_status_is_refused() -> None:
    noise = setid.Noise(output=0.1)
    u = np.random.default_rng(2).uniform(-1, 1, 12)
    truth = setid.simulate_record(TWO, [-1.2, 0.6, 1.0, 0.5], u, noise, 2)
    result = setid.identify(truth.data, TWO, noise, options=setid.Options(time_limit=0.5))
    assert bool(result.verify()) and result.status != "unbounded"
    forged = replace(result.intervals["a1"], status=setid.IntervalStatus.UNBOUNDED)
    claim = replace(result, intervals={**result.intervals, "a1": forged})
    assert "not proved that a1" in claim.verify().reason


@pytest.mark.parametrize("kind", ["oe", "eiv"])
def test_an_input_that_acts_sooner_makes_all_parameters_unbounded(kind: str) -> None:
    """Order three, noise of 10 %, 20 samples: linear programs find noise for huge parameters."""
    model, truth = setid.TransferFunction(3, 3, 1), (-1.4, 0.93, -0.36, 1.0, -0.5, 0.8)
    source = np.random.default_rng([0, 3, 20])
    u = source.uniform(-1.0, 1.0, 20)
    size = float(np.abs(setid.simulate(model, truth, u)).max())
    noise = setid.Noise(output=0.1 * size, input=0.02 * (kind == "eiv"))
    data = setid.simulate_record(model, truth, u, noise, source).data
    known = setid.formulate(data, model, noise)
    found = find_unbounded(known)
    assert found is not None and found.names == model.parameters and found.verify(known)
    assert found.model == setid.TransferFunction(2, 3, 0)
    for c in (-1e6, -1e4, 1e4, 1e6):  # no exact row holds, the noise makes up for it
        theta = c * np.concatenate([[1.0], found.theta])
        assert setid.least_noise(known, theta).level <= 1.0
    assert setid.least_noise(known, np.concatenate([[1.0], found.theta])).level > 1.0
    assert not replace(found, theta=found.theta + 1.0).verify(known)
    less = setid.Noise(output=0.01 * size, input=0.002 * (kind == "eiv"))
    assert not found.verify(setid.formulate(data, model, less))
    assert not found.verify(setid.formulate(data, model, noise, setid.Stable()))


@pytest.mark.slow
def test_little_to_spare_is_enough() -> None:
    """With a pole and a delay less 0.9873 of the noise explains the record, 0.9864 does not."""
    truth, (model, theta) = Experiment("eiv", 3, 20, 10.0, 9).record(), PLANTS[3]
    data, size = truth.data, float(np.abs(setid.simulate(model, theta, truth.u.ravel())).max())
    noise = setid.Noise(output=0.1 * size, input=0.1 / 3.0 * float(np.abs(truth.u).max()))
    result = setid.identify(data, model, noise, options=setid.Options(time_limit=60.0))
    assert result.status == "unbounded" and result.unbounded is not None
    assert result.unbounded.names == model.parameters and bool(result.verify(data))
    far = 1e6 * np.concatenate([[1.0], result.unbounded.theta])
    assert setid.least_noise(result.formulation, far).level <= 1.0


def test_noise_with_nothing_to_spare_proves_no_delay_less() -> None:
    """Bounds of 16 subnormal units: a little less rounds to all of them."""
    tiny = 2.0**-1074
    u = np.array([3.0, -2.0, 5.0, 7.0, -1.0, 4.0]) * tiny * 2**20
    y = 2 * u + 16 * tiny * np.array([1, -1, 1, -1, 1, -1])
    model = setid.TransferFunction(1, 1, 1)
    known = setid.formulate(setid.IOData(u, y), model, setid.Noise(output=16 * tiny))
    assert find_unbounded(known) is None
