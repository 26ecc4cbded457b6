"""Orders that are too high: the set is unbounded, and this is proved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import setid
from setid.common_factor import unbounded_names

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
    endless = ["a1", "a2", "b2"]  # b1 does not change with the factor
    assert statuses == {**dict.fromkeys(endless, "unbounded"), "b1": "partial"}
    assert result.status == "unbounded" and bool(result.verify(truth.data))
    assert "take the lower order" in result.summary() and "a1, a2, b2 unbounded" in result.notes[1]
    for c in (-1e4, -1.0, 0.0, 3.0, 1e4):  # the true system times 1 + c q^-1, with the true noise
        theta = [-0.6 + c, -0.6 * c, 2.0, 2.0 * c]
        x = result.formulation.point(theta, output=truth.output, input=truth.input)
        assert result.formulation.problem.violation(x) <= 1e-11 * (1.0 + abs(c))


def test_the_engine_finds_a_member_where_estimates_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(data: setid.IOData, model: setid.TransferFunction) -> setid.Estimate:
        return setid.least_squares(setid.IOData(data.u, data.y[::-1]), model)

    monkeypatch.setattr("setid.common_factor.linf", wrong)
    monkeypatch.setattr("setid.common_factor.least_squares", wrong)
    known = setid.formulate(simulated(NOISES[0]).data, TWO, NOISES[0])
    assert unbounded_names(known) == ("a1", "a2", "b2")


def test_where_nothing_is_claimed() -> None:
    noise = NOISES[0]
    data = simulated(noise).data
    gap = np.where(np.arange(20) == 9, np.nan, data.y.ravel())
    cases = [
        setid.formulate(data, TWO, noise, setid.Stable()),
        setid.formulate(data, TWO, setid.Noise(output=0.1, equation=0.1)),
        setid.formulate(data, setid.TransferFunction(2, 2, 1, initial="zero"), noise),
        setid.formulate(data, setid.TransferFunction(2, 1, 1), noise),
        setid.formulate(data, setid.TransferFunction(2, 2, 1, offset=True), noise),
        setid.formulate(setid.IOData(data.u, gap), TWO, noise),
        setid.formulate(data, setid.PolynomialNARX(["y1", "u1"], 1, 1), noise),
        setid.formulate(data, TWO, setid.Noise(output=0.01)),  # order 1 explains nothing
    ]
    assert [unbounded_names(known) for known in cases] == [()] * len(cases)


def test_a_forged_status_is_refused() -> None:
    noise = setid.Noise(output=0.1)
    u = np.random.default_rng(2).uniform(-1, 1, 12)
    truth = setid.simulate_record(TWO, [-1.2, 0.6, 1.0, 0.5], u, noise, 2)
    result = setid.identify(truth.data, TWO, noise, options=setid.Options(time_limit=0.5))
    assert bool(result.verify()) and result.status != "unbounded"
    forged = replace(result.intervals["a1"], status=setid.IntervalStatus.UNBOUNDED)
    claim = replace(result, intervals={**result.intervals, "a1": forged})
    assert "not proved that a1" in claim.verify().reason
