"""Proved bands over time of two measured records, beside what members attain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import setid

DATA = Path(__file__).parents[3] / "examples" / "data"
MOST = 1.25  # proved width by attained width


def identified(
    name: str, Ts: float, samples: int, model: setid.TransferFunction, bound: float, *priors: object
) -> tuple[setid.Identification, setid.IOData]:
    record = setid.IOData.from_csv(DATA / f"{name}.csv", inputs="u", outputs="y", Ts=Ts)
    estimation, validation = record.split(samples)
    noise = setid.Noise(equation=bound)
    return setid.identify(estimation, model, noise, list(priors)), validation


@pytest.fixture(scope="module")
def heating() -> tuple[setid.Identification, setid.IOData]:
    model = setid.TransferFunction(na=2, nb=2, nk=1, offset=True)
    return identified("heating_system", 2.0, 400, model, 0.8533)


def mixtures(result: setid.Identification, count: int = 60) -> np.ndarray:
    """Members: the feasible set of equation errors is convex."""
    known = result.attained
    return np.random.default_rng(0).dirichlet(np.full(len(known), 0.5), count) @ known


def holds_members(result: setid.Identification, band: setid.StepBand) -> bool:
    model, ones = result.formulation.model, np.ones(len(band.low))
    plants = mixtures(result)
    plants[:, -1] = 0.0  # the offset, which is not of the plant
    outputs = np.array([setid.simulate(model, theta, ones).ravel() for theta in plants])
    slack = 1e-9 * np.abs(outputs).max()
    return bool(np.all(outputs >= band.low - slack) and np.all(outputs <= band.high + slack))


def test_steps_of_the_heating_system(heating: tuple) -> None:
    result, _ = heating
    band = setid.step_band(result, 40, time_limit=60.0, all_time=True)
    assert band.report is not None and band.report.verdict == "tight"
    assert 1.0 <= band.report.ratio <= MOST and band.report.growing == 0
    assert holds_members(result, band)
    a, b = (
        np.array([mixtures(result)[:, i] for i in pair]).sum(axis=0) for pair in ((0, 1), (2, 3))
    )
    gains = b / (1.0 + a)
    assert band.later[0] <= gains.min() and gains.max() <= band.later[1]
    assert np.isfinite(band.all_time).all() and band.all_time[1] < 2.0 * gains.max()


def test_simulations_of_the_heating_system(heating: tuple) -> None:
    result, validation = heating
    found = setid.compare(result, validation)
    (report,) = found.band.reports
    assert report.verdict == "tight" and 1.0 <= report.ratio <= MOST
    assert not len(found.band.outside) and "the band says nothing at" in found.summary()
    assert 0 < found.band.silent.sum() < validation.samples


@pytest.mark.slow
@pytest.mark.parametrize("margin", [0.01, 0.0])
def test_steps_and_simulations_of_the_robot_arm(margin: float) -> None:
    model = setid.TransferFunction(na=2, nb=2, nk=0, offset=True)
    prior = setid.Stable(margin=margin)
    result, validation = identified("robot_arm", 1.0, 512, model, 0.07608514, prior)
    step = setid.step_band(result, 60, time_limit=120.0)
    assert step.report is not None and step.report.ratio <= MOST and holds_members(result, step)
    band = setid.simulate_band(result, validation, time_limit=120.0)
    assert band.reports[0].ratio <= MOST and np.isfinite(band.reading_high).all()
