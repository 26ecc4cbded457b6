"""Members chosen by simulation or prediction error, and their fits beside least squares'."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, lsq_linear, minimize

import setid
from setid.feasible_points.best import best
from setid.feasible_points.members import is_member, members
from setid.feasible_points.modelled_outputs import predicted
from setid.formulation.regression import regression_of_data
from setid.simulation.responses import run

MODEL = setid.TransferFunction(na=1, nb=1, nk=1)


def biased(bound: float = 0.2) -> setid.Identification:
    """Output noise taken for equation errors, which pull one-step models off."""
    u = np.sign(np.sin(0.7 * np.arange(120) ** 1.1))
    y = setid.simulate(MODEL, [-0.9, 1.0], u)[:, 0]
    y += 0.4 * np.random.default_rng(3).uniform(-1, 1, y.size)
    data = setid.IOData(u, y)
    least = setid.linf(data, MODEL).cost
    return setid.identify(data, MODEL, setid.Noise(equation=least * (1 + bound)))


def test_simulations_start_at_the_first_complete_readings() -> None:
    u = np.sign(np.sin(0.7 * np.arange(30) ** 1.1))
    y = setid.simulate(MODEL, [-0.9, 1.0], u)[:, 0]
    y[0] = np.nan
    noise = setid.Noise(equation=0.1)
    result = setid.identify(setid.IOData(u, y), MODEL, noise)
    later = setid.identify(setid.IOData(u[1:], y[1:]), MODEL, noise)  # the same equations
    assert best(result).error == pytest.approx(best(later).error, rel=1e-3)
    assert best(result).fit[0] > 90.0
    found, of_later = run(MODEL, [-0.9, 1.0], result.formulation.data), y[1:]
    assert np.isnan(found[0, 0]) and found[1:, 0] == pytest.approx(of_later)
    assert setid.compare(result).fits["best member"][0] > 90.0
    with pytest.raises(setid.SetidError, match="missing outputs at row 0.*the rows from 1 on"):
        setid.simulate_band(result, kind="proved")
    y[::2] = np.nan
    second = setid.TransferFunction(na=2, nb=1, nk=1)
    with pytest.raises(setid.SetidError, match="in each 2 samples in a row.*take predictions"):
        run(second, [-0.9, 0.0, 1.0], setid.IOData(u, y))


def test_constant_readings_have_no_fit() -> None:
    u = np.sign(np.sin(0.7 * np.arange(30) ** 1.1))
    result = setid.identify(setid.IOData(u, np.ones(30)), MODEL, setid.Noise(equation=0.1))
    found = setid.compare(result)
    for text in (found.summary(), repr(found), str(best(result))):
        assert "-inf" not in text and "none (constant readings" in text
    assert setid.fit(result.formulation.data, MODEL).summary().count("none (constant") == 1
    titles = [axis.get_title() for axis in found.plot()]
    plt.close("all")
    assert titles == ["simulation: fit none (constant readings, or outputs that overflow)"]


def test_best_prediction_is_least_squares_over_the_polytope() -> None:
    result = biased(0.01)
    data = result.formulation.data
    rows = regression_of_data(data, MODEL)
    bound = float(result.formulation.noise.bounds(data)[2].max())
    limits = [
        {"type": "ineq", "fun": lambda t: bound - rows.target - rows.regressors @ t},
        {"type": "ineq", "fun": lambda t: bound + rows.target + rows.regressors @ t},
    ]
    oracle = minimize(
        lambda t: np.sum((rows.target + rows.regressors @ t) ** 2),
        result.feasible,
        constraints=limits,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    free = lsq_linear(rows.regressors, -rows.target).x
    assert not is_member(result.formulation, free)  # the rows matter here
    found = best(result, "prediction")
    assert found.proved
    assert found.error == pytest.approx(np.sqrt(oracle.fun / rows.target.size), rel=1e-6)


def test_best_simulation_beats_every_member_of_a_fine_sample() -> None:
    result = biased()
    data = result.formulation.data
    found = best(result, "simulation")

    def error(theta: np.ndarray) -> float:
        return float(np.sqrt(np.mean((run(MODEL, theta, data) - data.y)[1:] ** 2)))

    sampled = [error(t) for t in members(result, 300)]
    assert found.proved and is_member(result.formulation, found.theta)
    assert found.error == pytest.approx(error(found.theta))
    assert found.error <= min(sampled) * (1 + 1e-6)
    assert found.error < 0.9 * error(result.centre.theta)


def test_a_consistent_output_error_fit_is_taken_as_it_is() -> None:
    result = biased(2.0)
    data = result.formulation.data
    fitted = least_squares(lambda t: (run(MODEL, t, data) - data.y)[1:, 0], [-0.9, 1.0])
    assert is_member(result.formulation, fitted.x)
    assert result.best("simulation").theta == pytest.approx(fitted.x, rel=1e-5)


def test_comparison_shows_the_fits_of_member_centre_and_least_squares() -> None:
    result = biased()
    validation = result.formulation.data
    found = setid.compare(result, validation, "simulation", "sampled")
    assert set(found.fits) == {"best member", "centre", "least squares"}
    y, theta = validation.y, setid.least_squares(validation, MODEL).theta
    v = run(MODEL, theta, validation)
    expected = 100 * (1 - np.linalg.norm((y - v)[1:]) / np.linalg.norm(y[1:] - y[1:].mean()))
    assert found.fits["least squares"][0] == pytest.approx(expected)
    assert found.fit[0] == found.fits["best member"][0] > found.fits["centre"][0]
    first, second = found.summary().splitlines()[:2]  # the nominal model is named, not repeated
    assert first.startswith("fit of the nominal model, the best member (simulation)  ")
    assert second.startswith("fit of centre  ")
    assert "meant for prediction" in found.summary()
    assert "meant for prediction" not in setid.compare(result, mode="prediction").summary()


def test_a_goal_that_does_not_exist_is_refused() -> None:
    with pytest.raises(setid.SetidError, match="goal: found 'fit'"):
        best(biased(), "fit")  # type: ignore[arg-type]


def test_predictions_in_continuous_time_do_not_know_the_reading_they_predict() -> None:
    model = setid.ContinuousTransferFunction(2, 1, Ts=0.2)
    truth = np.array([1.2, 2.0, 0.5, 2.0])
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    data = setid.simulate_record(model, truth, u, setid.Noise(), seed=0).data
    assert predicted(model, truth, data)[4:] == pytest.approx(data.y[4:])  # nothing is lost
    y = data.y.copy()
    y[20] += 5.0
    moved = predicted(model, truth, setid.IOData(data.u, y, 0.2)) - predicted(model, truth, data)
    assert abs(moved[20]) < 1e-12 < abs(moved[21])


@pytest.mark.slow
def test_the_best_predictor_in_continuous_time_predicts_better_than_members() -> None:
    model, noise = setid.ContinuousTransferFunction(2, 1, Ts=0.2), setid.Noise(output=0.05)
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    data = setid.simulate_record(model, [1.2, 2.0, 0.5, 2.0], u, noise, seed=0).data
    options = setid.Options(time_limit=2.0, progress=False)
    result = setid.identify(data, model, noise, setid.Stable(), options)
    found = best(result, "prediction")

    def error(theta: NDArray[np.float64]) -> float:
        return float(np.sqrt(np.nanmean((data.y - predicted(model, theta, data)) ** 2)))

    assert is_member(result.formulation, found.theta)
    assert found.error == pytest.approx(error(found.theta))
    assert found.error <= min(error(theta) for theta in members(result, 50)) * (1 + 1e-9)


def test_no_member_is_tried_when_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Attained members are known already; that mixtures are members takes linear programs."""
    result, tried = biased(), []

    def never(*given: object) -> bool:
        tried.append(given)
        return False

    monkeypatch.setattr("setid.feasible_points.members.is_member", never)
    found = members(result, count=50, time_limit=0.0)
    assert not tried and np.array_equal(found, result.attained)
    assert len(members(result, count=5)) == len(result.attained) and len(tried) == 5
    with pytest.raises(setid.SetidError, match="time_limit: found"):
        best(result, time_limit="long")  # type: ignore[arg-type]
    with pytest.raises(setid.SetidError, match="time_limit: found"):
        setid.compare(result, mode="prediction", time_limit="long")  # type: ignore[arg-type]
    assert is_member(result.formulation, best(result, time_limit=0.0).theta)


def test_no_step_is_begun_when_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    result, calls = biased(), []

    def counted(model: setid.TransferFunction, theta: NDArray[np.float64], data: setid.IOData):
        calls.append(theta)
        return run(model, theta, data)

    monkeypatch.setattr("setid.feasible_points.modelled_outputs.run", counted)
    best(result, "simulation")
    least = len(result.attained) + 4  # members, then the one that is taken: three errors, outputs
    assert len(calls) > 3 * least
    calls.clear()
    found = best(replace(result), "simulation", time_limit=0.0)  # which has no known mixtures
    assert len(calls) <= least and found.proved
    assert np.any(np.all(np.abs(result.attained - found.theta) <= 1e-2, axis=1))
