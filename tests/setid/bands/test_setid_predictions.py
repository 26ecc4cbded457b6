"""One-step predictions where denominators are separate or maps are inserted.

What a parameter vector predicts is known from polynomials: with one denominator A_i an input,
prod A_i y = sum_i B_i prod_{j != i} A_j u_i + prod A_i eta.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import identified
from numpy.typing import NDArray

import setid
from setid.bands.comparison import compare
from setid.bands.outputs import predict
from setid.bands.residuals import residuals
from setid.feasible_points.members import nominal
from setid.feasible_set.coordinates import coordinates_of
from setid.feasible_set.proposer import Proposer
from setid.proofs.predictions import predicted_ranges

Reals = NDArray[np.float64]
TWO_INPUTS = setid.TransferFunction(na=1, nb=1, nk=1, inputs=2)
TRUTH = np.array([-0.7, -0.4, 0.5, -0.8])  # a[1,1]1, a[1,2]1, b[1,1]1, b[1,2]1
POINT = [(value, value) for value in TRUTH.tolist()]
OPTIONS = setid.Options(time_limit=10.0, progress=False)


def record(seed: int, noise: setid.Noise, samples: int = 50) -> setid.IOData:
    u = np.random.default_rng(seed).uniform(-1, 1, (samples, 2))
    return setid.simulate_record(TWO_INPUTS, TRUTH, u, noise, seed=seed).data


def filtered(polynomial: Reals, signal: Reals) -> Reals:
    """Apply c0 + c1 q^-1 + ..."""
    return np.convolve(polynomial, signal)[: signal.size]


def oracle(theta: Reals, data: setid.IOData) -> Reals:
    """What the parameters predict from sample 2 on."""
    a, c, b, d = theta
    both = np.convolve([1.0, a], [1.0, c])
    known = filtered(np.convolve([0.0, b], [1.0, c]), data.u[:, 0])
    known += filtered(np.convolve([0.0, d], [1.0, a]), data.u[:, 1])
    return (known - filtered(np.append(0.0, both[1:]), data.y[:, 0]))[2:]


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    noise = setid.Noise(output=0.02)
    return setid.identify(record(0, noise), TWO_INPUTS, noise, setid.Stable(), OPTIONS)


def test_what_members_predict_lies_in_the_band(result: setid.Identification) -> None:
    for data in (None, record(7, setid.Noise(output=0.02), 200)):
        band = predict(result, data)
        assert np.isnan(band.low[:2]).all() and band.kind == "proved"
        assert band.nominal[2:, 0] == pytest.approx(oracle(nominal(result), band.data))
        reached = np.array([oracle(theta, band.data) for theta in result.attained])
        assert (band.low[2:, 0] <= reached.min(axis=0)).all()
        assert (reached.max(axis=0) <= band.high[2:, 0]).all()
        widths = np.ptp(reached, axis=0)
        assert (band.high - band.low)[2:].sum() < 3 * widths.sum()


@pytest.mark.parametrize("seed", range(5))
def test_readings_of_other_records_lie_in_the_band(result: setid.Identification, seed: int) -> None:
    assert not len(predict(result, record(seed + 20, setid.Noise(output=0.02), 200)).outside)


def test_readings_that_need_all_of_the_noise_lie_in_the_band() -> None:
    """Outputs of the plant itself, plus noise of alternating sign: each row takes it in full."""
    noise = setid.Noise(output=0.1)
    u = np.random.default_rng(1).uniform(-1, 1, (40, 2))
    clean = setid.simulate_record(TWO_INPUTS, TRUTH, u, setid.Noise()).data
    y = clean.y[:, 0] + 0.1 * (-1.0) ** np.arange(40)
    known = identified(setid.formulate(setid.IOData(u, y), TWO_INPUTS, noise), POINT)
    band = predict(known)
    assert not len(band.outside)
    # (1 - .7 q^-1)(1 - .4 q^-1) eta with eta = +-.1 in turn is .1 (1 + 1.1 + .28)
    assert (band.reading_high - band.reading_low)[2:] == pytest.approx(2 * 0.238)
    less = predict(known, noise=setid.Noise(output=0.0999))
    assert len(less.outside) == 38


def test_noise_of_inputs_widens_readings() -> None:
    known = setid.formulate(record(0, setid.Noise()), TWO_INPUTS, setid.Noise(input=0.1))
    band = predict(identified(known, POINT))
    # b (1 + c q^-1) xi_1 + d (1 + a q^-1) xi_2, all signs at worst
    expected = 0.1 * (0.5 * 1.4 + 0.8 * 1.7)
    assert (band.reading_high - band.reading_low)[2:] == pytest.approx(2 * expected)


def test_residuals_are_those_of_polynomials(result: setid.Identification) -> None:
    found = residuals(result, TRUTH)
    data = result.formulation.data
    assert found.values == pytest.approx(data.y[2:, 0] - oracle(TRUTH, data))
    assert found.bound == pytest.approx(0.02 * 2.38)
    assert not found.outside.size and found.row.tolist() == list(range(2, 50))
    wrong = residuals(result, [-0.7, -0.4, 0.5, 0.8])
    assert wrong.outside.size > 20


def test_the_best_predictor_is_better_than_other_members(result: setid.Identification) -> None:
    data, best = result.formulation.data, result.best("prediction")

    def error(theta: Reals) -> float:
        return float(np.sqrt(np.mean((data.y[2:, 0] - oracle(theta, data)) ** 2)))

    assert best.proved and best.error == pytest.approx(error(best.theta))
    assert best.error <= min(error(theta) for theta in result.attained) * (1 + 1e-9)


def test_samples_of_unknown_value_take_part_with_their_range() -> None:
    noise = setid.Noise(output=0.02)
    data = record(3, noise)
    y = data.y.copy()
    y[20] = np.nan
    gaps = setid.IOData(data.u, y), setid.IOData(data.u, y, y_range=(-3.0, 3.0))
    without, ranged = (
        predict(identified(setid.formulate(g, TWO_INPUTS, noise), POINT)) for g in gaps
    )
    assert np.flatnonzero(np.isnan(without.low[:, 0])).tolist() == [0, 1, 20, 21, 22]
    assert (ranged.reading_high - ranged.reading_low)[21] > 2 * 3.0
    assert ranged.low[21] == ranged.reading_low[21] and ranged.high[21] == ranged.reading_high[21]
    assert ranged.reading_low[21] <= data.y[21] <= ranged.reading_high[21]


def test_maps_in_front_of_a_plant_predict() -> None:
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    noise, theta = setid.Noise(output=0.05), [-0.6, 0.8, 0.4]
    u = np.random.default_rng(0).uniform(-1, 1, (30, 1))
    data = setid.simulate_record(model, theta, u, noise).data
    found = setid.identify(data, model, noise, setid.Stable(), OPTIONS)
    comparison = compare(found, mode="prediction")
    assert comparison.band.kind == "proved" and not len(comparison.band.outside)
    z = data.u[:, 0] + 0.4 * data.u[:, 0] ** 2
    expected = 0.6 * data.y[:-1, 0] + 0.8 * z[:-1]
    assert (comparison.band.low[1:, 0] <= expected).all()
    assert (expected <= comparison.band.high[1:, 0]).all()
    shown = residuals(found, theta)
    assert shown.values == pytest.approx(data.y[1:, 0] - expected)
    assert comparison.fits["best member"][0] >= comparison.fits["centre"][0]


def test_what_cannot_predict_says_why() -> None:
    data, noise = record(0, setid.Noise(output=0.02)), setid.Noise(output=0.02)
    model = setid.TransferFunction(1, 1, 1, inputs=2)
    boxes = [(-0.9, 0.9)] * 3 + [(-np.inf, np.inf)]
    endless = identified(setid.formulate(data, model, noise), boxes)
    with pytest.raises(setid.SetidError, match="infinite interval.*products of parameters"):
        predict(endless)
    wiener = setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    single = setid.IOData(data.u[:, :1], data.y)
    inner = identified(setid.formulate(single, wiener, noise), [(-0.5, 0.5)] * 3)
    with pytest.raises(setid.SetidError, match=r"internal signals \(z\) have no one-step predict"):
        predict(inner)
    with pytest.raises(setid.SetidError, match=r"internal signals \(z\) have no one-step residual"):
        residuals(inner, [0.0] * 3)


def test_functions_of_noisy_inputs_have_no_rows() -> None:
    """What noise does to a function that is not polynomial is not known."""
    basis = [lambda x: np.tanh(3 * x), 1]
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), basis, normalise="gamma1")
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    y = np.zeros(40)
    for k in range(1, 40):
        y[k] = 0.6 * y[k - 1] + 0.8 * (np.tanh(3 * u[k - 1]) + 0.5 * u[k - 1])
    exact = setid.IOData(u, y)
    known = setid.formulate(exact, model, setid.Noise(output=0.02))
    found = identified(known, [(-0.61, -0.59), (0.79, 0.81), (0.49, 0.51)])
    assert not len(predict(found).outside)
    with pytest.raises(setid.ModelError, match="not known exactly"):
        predict(found, exact, setid.Noise(output=0.02, input=0.3))


def test_sums_of_inputs_behind_two_denominators_say_why_they_do_not_predict() -> None:
    shape = setid.TransferFunction(1, 1, 1)
    model = setid.BlockStructured({("y1", "u1 - u2"): shape, ("y1", "u3"): shape}, {}, inputs=3)
    u = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    noise = setid.Noise(output=0.01)
    data = setid.simulate_record(model, [-0.5, 0.7, 0.3, 0.9], u, noise).data
    found = identified(setid.formulate(data, model, noise), [(-0.9, 0.9)] * 4)
    for call in (lambda: predict(found), lambda: residuals(found, [0.0] * 4)):
        with pytest.raises(setid.SetidError, match="multiplies several signals have no one-step"):
            call()


def test_predictions_are_those_of_the_readings_whatever_their_noise() -> None:
    """With noise in u the middle of u^2 is larger than the square of the reading."""
    rng = np.random.default_rng(0)
    model = setid.Hammerstein(setid.TransferFunction(1, 1, 1), 2, normalise="gamma1")
    u, y = rng.uniform(-2, 2, 40), np.zeros(40)
    for k in range(1, 40):
        y[k] = 0.6 * y[k - 1] + 0.8 * (u[k - 1] + 0.4 * u[k - 1] ** 2)
    data = setid.IOData(u + rng.uniform(-0.05, 0.05, 40), y)
    noise = setid.Noise(input=0.05)
    known = setid.formulate(data, model, noise)
    band = predict(identified(known, [(-0.6001, -0.5999), (0.7999, 0.8001), (0.3999, 0.4001)]))
    read = data.u[:-1, 0]
    expected = 0.6 * y[:-1] + 0.8 * (read + 0.4 * read**2)
    assert (band.low[1:, 0] <= expected).all() and (expected <= band.high[1:, 0]).all()
    assert (band.high - band.low)[1:].max() < 0.01
    assert band.nominal[1:, 0] == pytest.approx(expected) and not len(band.outside)


def test_noisy_powers_without_a_parameter_do_not_move_predictions() -> None:
    """y(k) = gamma1 u(k-1) + u(k-1)^2: no parameter multiplies the square."""
    u = np.random.default_rng(0).uniform(-2, 2, 30)
    blocks = {("y1", "w"): setid.TransferFunction(0, 1, 1)}
    maps = {"w": setid.StaticMap("u1", 2)}
    model = setid.BlockStructured(blocks, maps, normalise=["b1", "gamma2"])
    y = np.append(0.0, u[:-1] + u[:-1] ** 2)
    known = setid.formulate(setid.IOData(u, y), model, setid.Noise(input=0.1))
    assert known.parameters == ("gamma1",)
    band = predict(identified(known, [(1.0, 1.0)]))
    assert band.low[1:, 0] == pytest.approx(y[1:]) and band.high[1:, 0] == pytest.approx(y[1:])
    assert not len(band.outside)


def test_residuals_keep_the_rows_that_priors_add() -> None:
    u, y = np.random.default_rng(0).uniform(-1, 1, 30), np.zeros(30)
    for k in range(1, 30):
        y[k] = 0.6 * y[k - 1] + 0.8 * u[k - 1]
    y[10] = np.nan
    box = setid.Box({"a1": (-0.9, 0.9), "b1": (0.0, 2.0)})
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(output=0.02)
    found = setid.identify(setid.IOData(u, y), model, noise, box)
    assert len(residuals(found).row) == 29


def test_residuals_beyond_the_numbers_are_outside(result: setid.Identification) -> None:
    found = residuals(result, [1e200] * 4)
    assert found.outside.size == found.values.size


def test_readings_beyond_the_numbers_have_no_bound(result: setid.Identification) -> None:
    coordinates = coordinates_of(TWO_INPUTS, "no rows")
    rows = coordinates.rows(result.formulation)
    far = replace(rows, target=1e308 + rows.target, radius=1e308 + rows.radius)
    found = predicted_ranges(coordinates.cover(result), far, -far.target, Proposer)
    low, high, least, most = found
    assert (least <= low).all() and (high <= most).all()
    assert not np.isfinite(least).any() and not np.isfinite(most).any()
    assert not np.isposinf(low).any() and not np.isneginf(high).any()
