"""Simulation, prediction and comparison with a validation record."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from identification_cases import PLANT, laboratory_two_second
from identified_cases import empty, identified, second_order
from slow_values import slow_after

import setid
from setid.bands.comparison import compare
from setid.bands.outputs import predict, simulate_band
from setid.bands.residuals import residuals
from setid.feasible_points.modelled_outputs import fit
from setid.simulation.responses import run


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return second_order()


def validation(bound: float = 0.5) -> setid.IOData:
    return laboratory_two_second(bound, 240).split(120)[1]


def test_fit_is_the_one_of_the_field() -> None:
    y, v = np.array([[1.0], [2.0], [4.0]]), np.array([[1.0], [2.5], [3.5]])
    expected = 100 * (1 - np.linalg.norm(y - v) / np.linalg.norm(y - y.mean()))
    assert fit(y, v)[0] == pytest.approx(expected)
    assert fit(np.ones((3, 1)), v)[0] == -np.inf
    assert fit(y, np.full((3, 1), np.nan))[0] == -np.inf


def test_validation_readings_lie_in_proved_bands(result: setid.Identification) -> None:
    for mode in ("simulation", "prediction"):
        found = compare(result, validation(), mode)
        assert found.band.kind == "proved" and found.fit[0] > 97
        assert not len(found.band.outside)
        assert np.isfinite(found.band.high[5:]).all()
        assert "falsified" not in found.summary()


def test_what_is_shown_at_a_prompt_is_one_line() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    band = predict(found)  # of the first sample there is no prediction
    said = "proved band, which says something of 3 of 4 readings"
    assert repr(band) == f"<OutputBand: prediction, {said}>"
    shown = repr(compare(found, mode="prediction"))
    assert shown.startswith("<Comparison: prediction, fit 9") and "\n" not in shown
    assert shown.endswith(f"%, 0 readings outside the {said}>")
    assert compare(found, mode="prediction").summary().endswith("band of readings  0 of 3")


def test_a_band_that_says_nothing_does_not_look_like_a_pass_at_a_prompt() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    loud = predict(found, noise=setid.Noise(equation=100.0))
    assert repr(loud).endswith("says something of 0 of 4 readings>")


@pytest.mark.parametrize(
    ("setting", "why"),
    [
        ({"tolerance": -1}, "tolerance: found -1"),
        ({"time_limit": "x"}, "time_limit: found 'x'"),
        ({"kind": "sure"}, "kind: found 'sure'"),
    ],
)
def test_wrong_settings_are_refused_where_bands_are_sampled_too(
    result: setid.Identification, setting: dict[str, object], why: str
) -> None:
    for each in (result, narx()):  # of the second, bands are sampled
        with pytest.raises(setid.SetidError, match=why):
            simulate_band(each, **setting)  # type: ignore[arg-type]
        with pytest.raises(setid.SetidError, match=why):
            result.step(4, **({"kind": "sampled"} | setting))  # type: ignore[arg-type]


def test_noise_free_outputs_lie_in_the_band_of_models() -> None:
    model, noise = setid.TransferFunction(na=2, nb=2, nk=1), setid.Noise(output=0.2, input=0.01)
    theta = np.array([-1.2, 0.5, 1.0, 0.4])
    box = [(t - 0.01, t + 0.012) for t in theta]
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    truth = setid.simulate_record(model, theta, u, noise, 0)
    found = identified(setid.formulate(truth.data, model, noise), box)
    band = simulate_band(found)
    assert band.kind == "proved"
    assert np.all((truth.y >= band.low) & (truth.y <= band.high))
    assert not len(band.outside)
    ahead = predict(found)
    assert not len(ahead.outside)


def test_equation_errors_drive_the_band_of_readings(result: setid.Identification) -> None:
    band = simulate_band(result, validation())
    assert np.all(band.reading_low <= band.low) and np.all(band.reading_high >= band.high)
    assert np.all(band.reading_high[2:] - band.high[2:] >= 0.5)


def test_a_bound_too_small_is_falsified(result: setid.Identification) -> None:
    found = compare(result, validation(), "prediction", noise=setid.Noise(equation=0.01))
    assert len(found.band.outside) > 50 and "falsified" in found.summary()


def test_unstable_boxes_end_in_infinite_bands_not_in_wrong_ones() -> None:
    model, noise = setid.TransferFunction(1, 1, nk=1), setid.Noise(output=3.0)
    u = np.random.default_rng(0).uniform(-1, 1, 150)
    truth = setid.simulate_record(model, [-0.9, 1.0], u, noise)
    found = identified(setid.formulate(truth.data, model, noise), [(-3.0, 1.0), (-9.0, 9.0)])
    band = simulate_band(found, time_limit=0.5)
    assert np.all((truth.y >= band.low) & (truth.y <= band.high))


def test_simulation_starts_from_readings_or_from_rest() -> None:
    data = laboratory_two_second(0.5, 60).split(30)[1]
    free = run(setid.TransferFunction(2, 3), PLANT, data)
    assert np.array_equal(free[:2], data.y[:2])
    rest = run(setid.TransferFunction(2, 3, initial="zero"), PLANT, data)
    assert rest[0, 0] == pytest.approx(PLANT[2] * data.u[0, 0])
    assert np.abs(free - data.y)[2:].max() < 5


def test_records_do_not_cross(result: setid.Identification) -> None:
    both = setid.IOData.concat([validation(), validation()])
    band, one = simulate_band(result, both), simulate_band(result, validation())
    assert np.allclose(band.low, np.concatenate([one.low, one.low]))


def narx() -> setid.Identification:
    model = setid.PolynomialNARX(["y1", "u1", "y1*u1"], ny=1, nu=1)
    noise = setid.Noise(equation=0.05)
    u = np.random.default_rng(2).uniform(-1, 1, 60)
    truth = setid.simulate_record(model, [0.5, 1.0, 0.2], u, noise)
    return identified(setid.formulate(truth.data, model, noise))


def test_nonlinear_structures_are_sampled_in_simulation_and_proved_in_prediction() -> None:
    found = narx()
    assert simulate_band(found).kind == "sampled"
    assert compare(found, mode="simulation").fit[0] > 80
    assert predict(found).kind == "proved" and not len(predict(found).outside)
    with pytest.raises(setid.SetidError, match="linear"):
        simulate_band(found, kind="proved")
    with pytest.raises(setid.ModelError, match="kind='sampled' has the range"):
        found.step()
    assert found.step(4, "sampled").kind == "sampled"


def test_residuals_within_bounds(result: setid.Identification) -> None:
    assert not len(residuals(result).outside)
    assert not len(residuals(result, PLANT).outside)
    wrong = residuals(result, PLANT * 1.01)
    assert len(wrong.outside)


def test_bad_arguments(result: setid.Identification) -> None:
    with pytest.raises(setid.SetidError, match="mode"):
        compare(result, mode="guess")
    with pytest.raises(setid.SetidError, match="kind"):
        simulate_band(result, kind="sure")
    with pytest.raises(setid.DataError, match="Ts"):
        compare(result, setid.IOData([1.0, 2.0], [1.0, 2.0], Ts=0.5))
    with pytest.raises(setid.DataError, match="inputs"):
        compare(result, setid.IOData(np.eye(2), [1.0, 2.0]))
    with pytest.raises(setid.SetidError, match="missing inputs"):
        simulate_band(result, setid.IOData([1.0, np.nan, 2.0], [1.0, 2.0, 3.0]))
    with pytest.raises(setid.SetidError, match="empty"):
        compare(empty(result.formulation))
    with pytest.raises(setid.SetidError, match="theta"):
        residuals(result, np.zeros(2))


@pytest.mark.parametrize("length", [1, 2])
def test_records_may_be_over_before_an_equation_is_complete(
    result: setid.Identification, length: int
) -> None:
    rng = np.random.default_rng(length)
    data = setid.IOData(rng.uniform(-1, 1, 12), rng.uniform(-9, 9, 12), starts=[0, length])
    alone = setid.IOData(data.u[length:], data.y[length:])
    noise = setid.Noise(output=0.3, equation=0.5)
    both, rest = simulate_band(result, data, noise=noise), simulate_band(result, alone, noise=noise)
    np.testing.assert_array_equal(both.low[length:], rest.low)
    np.testing.assert_array_equal(both.high[length:], rest.high)


def test_starts_are_rounded_outwards(result: setid.Identification) -> None:
    data = setid.IOData(np.zeros(40), np.random.default_rng(0).uniform(-9, 9, 40))
    for seed in range(20):
        bound = float(np.random.default_rng(seed).uniform(0.01, 3))
        band = simulate_band(result, data, noise=setid.Noise(output=bound, equation=0.5))
        for y, low, high in zip(data.y[:2, 0], band.low[:2, 0], band.high[:2, 0], strict=True):
            assert Fraction(low) <= Fraction(y) - Fraction(bound)
            assert Fraction(high) >= Fraction(y) + Fraction(bound)


def test_proved_predictions_are_rounded_outwards() -> None:
    rng = np.random.default_rng(3)
    data = setid.IOData(rng.uniform(-3, 3, 200), rng.uniform(-9, 9, 200))
    noise = setid.Noise(equation=1e-3)
    formulation = setid.formulate(data, setid.TransferFunction(na=0, nb=1), noise)
    low, high = 1000.1, 1000.3
    band = predict(identified(formulation, [(low, high)]))
    for k, u in enumerate(data.u[:, 0]):
        ends = [Fraction(b) * Fraction(u) for b in (low, high)]
        assert Fraction(band.low[k, 0]) <= min(ends) and Fraction(band.high[k, 0]) >= max(ends)
        assert Fraction(band.reading_low[k, 0]) <= min(ends) - Fraction(1e-3)
        assert Fraction(band.reading_high[k, 0]) >= max(ends) + Fraction(1e-3)


def test_simulations_without_feedback_have_nothing_to_part() -> None:
    """y_k = b0 u_k with u = 2, y = 2 and abs(e) <= .1: b0 is in [.95, 1.05]."""
    data = setid.IOData([2.0, -2.0], [2.0, -2.0])
    found = setid.identify(data, setid.TransferFunction(0, 1), setid.Noise(equation=0.1))
    band = simulate_band(found, setid.IOData([1.0, 0.0, -4.0], [0.0, 0.0, 0.0]), tolerance=1e-300)
    assert band.low[:, 0] == pytest.approx([0.95, 0.0, -4.2])
    assert band.high[:, 0] == pytest.approx([1.05, 0.0, -3.8])


def test_verdicts_on_parts_of_records_that_begin_at_rest_name_the_start() -> None:
    model, noise = setid.TransferFunction(1, 1, 1, initial="zero"), setid.Noise(output=0.01)
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 40)
    record = setid.simulate_record(model, [-0.9, 0.8], u, noise, seed=1).data
    first, rest = record.split(20)
    found = setid.identify(first, model, noise, (), setid.Options(progress=False))
    assert "initial='free'" in setid.compare(found, rest).summary()
    assert "initial='free'" not in setid.compare(found).summary()
    free = setid.TransferFunction(1, 1, 1)
    found = setid.identify(first, free, noise, (), setid.Options(progress=False))
    assert "falsified" not in setid.compare(found, rest).summary()


@pytest.mark.parametrize("normalise", slow_after(1, ["dcgain", "gamma1"]))
def test_simulations_of_hammerstein_structures_hold_the_truth(normalise: str) -> None:
    """Rows are affine in the weights of the map times those of the numerator."""
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise=normalise)
    gains = {"gamma1": [-0.6, 0.8, 0.4], "dcgain": [-0.6, 0.4, 2.0, 0.8]}[normalise]
    u, noise = np.random.default_rng(0).uniform(-1, 1, (30, 1)), setid.Noise(output=0.05)
    truth = setid.simulate_record(model, gains, u, noise)
    options = setid.Options(time_limit=10.0, progress=False)
    found = setid.identify(truth.data, model, noise, setid.Stable(), options)
    band = simulate_band(found, kind="proved", time_limit=3.0)
    assert np.all((band.low <= truth.y + 1e-12) & (truth.y - 1e-12 <= band.high))
    assert not len(band.outside) and band.reports[0].ratio < 2.0
    again = run(found.formulation.model, gains, setid.IOData(u, truth.y))
    assert again == pytest.approx(truth.y)  # from the first readings on


def test_a_falsified_sample_is_named_by_its_record() -> None:
    """Row 7 of two records of five samples is sample 2 of the second."""
    model, u = setid.TransferFunction(0, 1, 0), np.arange(1.0, 11.0)
    y = 2.0 * u
    noise = setid.Noise(equation=0.1)
    found = setid.identify(setid.IOData(u, y, starts=[0, 5]), model, noise)
    y = y + 5.0 * (np.arange(10) == 7)
    several = setid.compare(found, setid.IOData(u, y, starts=[0, 5]), mode="prediction")
    assert several.band.outside.tolist() == [[7, 0]]
    assert "first by y1 at sample 2:2: " in several.summary()
    single = setid.compare(found, setid.IOData(u, y), mode="prediction")
    assert "first by y1 at sample 7: " in single.summary()
