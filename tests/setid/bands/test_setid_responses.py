"""Bands of frequency and step responses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identification_cases import PLANT
from identified_cases import empty, first_order, identified, result_of, second_order
from slow_values import slow_after

import setid
from setid.bands.responses import frequency_band
from setid.bands.steps import step_band
from setid.feasible_points.members import members
from setid.proofs.frequency.regions import angles_of, quotient_rectangle
from setid.simulation.responses import frequency_response, grid


@pytest.fixture(scope="module")
def result() -> setid.Identification:
    return second_order()


def test_the_frequency_response_is_that_of_the_difference_equation() -> None:
    model = setid.TransferFunction(na=2, nb=2, nk=1)
    theta = np.array([-0.5, 0.2, 1.0, 0.5])
    omega, N = 0.7, 4000
    k = np.arange(N)
    y = setid.simulate(model, theta, np.cos(omega * k)).ravel()
    tail = slice(N // 2, N)
    basis = np.stack([np.cos(omega * k), -np.sin(omega * k)], axis=1)[tail]
    real, imaginary = np.linalg.lstsq(basis, y[tail], rcond=None)[0]
    found = frequency_response(model, theta, np.array([omega]), 1.0)
    assert found[0] == pytest.approx(complex(real, imaginary), abs=1e-9)


def test_proved_bands_contain_truth_and_members(result: setid.Identification) -> None:
    band = frequency_band(result)
    thetas = np.vstack([PLANT, members(result, 40)])
    responses = frequency_response(result.formulation.model, thetas, band.omega, 1.0)
    assert np.all(np.abs(responses) >= band.magnitude[:, 0] * (1 - 1e-9))
    assert np.all(np.abs(responses) <= band.magnitude[:, 1] * (1 + 1e-9))
    turn = np.angle(responses / band.nominal)
    angle = np.unwrap(np.angle(band.nominal))
    assert np.all(turn >= band.phase[:, 0] - angle - 1e-9)
    assert np.all(turn <= band.phase[:, 1] - angle + 1e-9)
    for corners, values in zip(band.regions, responses.T, strict=True):
        inside = (values - corners[0]) / (corners[1] - corners[0])
        height = abs(corners[3] - corners[0]) / abs(corners[1] - corners[0])
        assert np.all((inside.real > -1e-6) & (inside.real < 1 + 1e-6))
        assert np.all((inside.imag > -1e-6) & (inside.imag < height + 1e-6))


def test_proved_bands_are_tight(result: setid.Identification) -> None:
    band = frequency_band(result, np.geomspace(0.05, 3.0, 12))
    inner = frequency_band(result, np.geomspace(0.05, 3.0, 12), kind="sampled", samples=200)
    widths = [np.diff(b.magnitude, axis=1).ravel() for b in (band, inner)]
    assert np.all(widths[1] <= widths[0]) and np.median(widths[0] / widths[1]) < 2.5
    assert (band.kind, inner.kind) == ("proved", "sampled")


def test_a_wide_box_gives_infinite_but_valid_bands() -> None:
    wide = identified(first_order().formulation, [(-3.0, 3.0), (-3.0, 5.0)])
    noisy = setid.formulate(
        wide.formulation.data, setid.TransferFunction(1, 1), setid.Noise(output=5.0)
    )
    band = frequency_band(identified(noisy, [(-3.0, 3.0), (-3.0, 5.0)]), [1e-3, 1.0])
    assert band.magnitude[0].tolist() == [0.0, np.inf]  # a pole at 1 is in the box
    # abs(1 + a1 exp(-j)) is at least sin(1) for every real a1, and b0 is at most 5
    assert 5.0 / np.sin(1.0) <= band.magnitude[1, 1] < 10.0 / np.sin(1.0)
    assert np.all(np.isneginf(band.decibel[:, 0])) and np.ptp(band.phase[0]) == pytest.approx(
        2 * np.pi
    )


def test_steps_contain_the_truth(result: setid.Identification) -> None:
    true = setid.simulate(result.formulation.model, PLANT, np.ones(40)).ravel()
    band = step_band(result, 40)
    assert np.all((true >= band.low) & (true <= band.high))
    inner = step_band(result, 40, kind="sampled")
    assert np.all((inner.low >= band.low) & (inner.high <= band.high))
    assert np.max(band.high - band.low) < 3 * np.max(inner.high - inner.low)


def test_bad_arguments(result: setid.Identification) -> None:
    with pytest.raises(setid.SetidError, match="kind"):
        frequency_band(result, kind="sure")
    with pytest.raises(setid.SetidError, match="kind"):
        step_band(result, kind="sure")
    with pytest.raises(setid.SetidError, match="omega"):
        frequency_band(result, [4.0])
    with pytest.raises(setid.ModelError, match="output, input"):
        step_band(result, output=2)
    with pytest.raises(setid.SetidError, match="empty"):
        frequency_band(empty(result.formulation))
    with pytest.raises(setid.SetidError, match="length: found 1000000000, expected at most 100000"):
        step_band(result, 10**9)
    band = frequency_band(result, [0.1, 1.0])
    for point in ("a", np.nan, np.inf, None):
        with pytest.raises(setid.SetidError, match="point: found"):
            band.distance(point)  # type: ignore[arg-type]


def test_the_grid_ends_at_the_nyquist_frequency() -> None:
    assert grid(None, 0.1)[-1] == pytest.approx(10 * np.pi)


def two_inputs(**more: Any) -> tuple[setid.Identification, np.ndarray, np.ndarray]:
    """Two systems of order 1 on a box about the truth; with what their sum is without noise."""
    model = setid.TransferFunction(1, 1, nk=1, inputs=2, **more)
    theta = np.array([-0.5, -0.2, 1.0, 0.5, 0.7][: len(model.parameters)])
    u = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    noise = setid.Noise(output=0.1)
    truth = setid.simulate_record(model, theta, u, noise)
    box = [(t - 0.05, t + 0.05) for t in theta.tolist()]
    return identified(setid.formulate(truth.data, model, noise), box), theta, truth.y


@pytest.mark.slow
def test_steps_of_separate_denominators_are_those_of_one_input() -> None:
    found, _, _ = two_inputs(offset=True)
    band = step_band(found, 12, input=2, time_limit=3.0, all_time=True)
    for a, b in ((-0.25, 0.45), (-0.15, 0.55), (-0.2, 0.5)):
        true = b * (1 - (-a) ** np.arange(12)) / (1 + a)
        assert np.all((band.low <= true + 1e-12) & (true - 1e-12 <= band.high))
        assert band.later[0] <= b / (1 + a) <= band.later[1]
    assert band.high[-1] - band.low[-1] < 1.3 * (0.55 / 0.75 - 0.45 / 0.85)
    assert frequency_band(found, [0.5], input=2, time_limit=3.0).magnitude[0, 1] < np.inf


@pytest.mark.parametrize("more", slow_after(1, [{"offset": True}, {}, {"initial": "zero"}]))
def test_simulations_of_separate_denominators_hold_the_truth(more: dict[str, Any]) -> None:
    found, _, true = two_inputs(**more)
    band = setid.simulate_band(found, kind="proved", time_limit=1.0)
    assert np.all((band.low <= true + 1e-12) & (true - 1e-12 <= band.high))
    assert not len(band.outside) and np.max(band.high - band.low) < 2.0


def test_steps_of_a_map_keep_its_constant() -> None:
    """w = 0.2 + 2 u - 0.5 u^2 in front of b/(1 + a/q): the response to a step is not linear."""
    linear = setid.TransferFunction(1, 1, nk=1)
    model = setid.Hammerstein(linear, [0, 1, 2], normalise="b1")
    theta = np.array([-0.5, 0.2, 2.0, -0.5])
    u, noise = np.random.default_rng(0).uniform(-1, 1, (20, 1)), setid.Noise(output=0.1)
    truth = setid.simulate_record(model, theta, u, noise)
    box = [(t - 0.01, t + 0.01) for t in theta.tolist()]
    found = identified(setid.formulate(truth.data, model, noise), box)
    band = step_band(found, 12, time_limit=2.0)
    true = setid.simulate(model, theta, np.ones((12, 1))).ravel()
    assert true[-1] == pytest.approx(3.4, abs=0.01)
    assert np.all((band.low <= true + 1e-12) & (true - 1e-12 <= band.high))
    assert np.max(band.high - band.low) < 0.5


def test_systems_that_begin_at_an_offset_are_not_enclosed_from_rest() -> None:
    """y = c + (at rest) is not 0 before the record, as multiplied rows would have it."""
    found, _, _ = two_inputs(offset=True, initial="zero")
    with pytest.raises(setid.ModelError, match="begin at an offset"):
        setid.simulate_band(found, kind="proved", time_limit=0.0)
    assert setid.simulate_band(found, time_limit=0.0).kind == "sampled"


def test_constants_that_normalise_fixes_belong_to_the_map() -> None:
    """y = 2 + gamma2 u: what is drawn as nominal lies in what is proved."""
    maps = {"y1": setid.StaticMap("u1", [0, 1])}
    model = setid.BlockStructured({}, maps, normalise={"gamma1": 2.0})
    u, noise = np.linspace(-1, 1, 12)[:, None], setid.Noise(output=0.1)
    truth = setid.simulate_record(model, [1.0], u, noise)
    found = identified(setid.formulate(truth.data, model, noise), [(0.9, 1.1)])
    band = step_band(found, 5, time_limit=1.0)
    assert np.all((band.low <= 3.0) & (3.0 <= band.high)) and band.nominal[0] == pytest.approx(3)
    assert np.all((band.low <= band.attained_low) & (band.attained_high <= band.high))


def test_terms_without_a_parameter_count_for_what_is_attained() -> None:
    model = setid.Hammerstein(
        setid.TransferFunction(1, 2, 1), 2, normalise=[{"gamma1": 1.0}, {"b1": 1.0}]
    )
    theta = [-0.6, 0.5, 0.4]
    u, noise = np.random.default_rng(0).uniform(-1, 1, (20, 1)), setid.Noise(output=0.1)
    truth = setid.simulate_record(model, theta, u, noise)
    found = identified(
        setid.formulate(truth.data, model, noise), [(t - 0.01, t + 0.01) for t in theta]
    )
    band = setid.simulate_band(found, kind="proved", time_limit=2.0)
    assert band.attained_low is not None and band.attained_high is not None
    assert np.all((band.low <= band.attained_low) & (band.attained_high <= band.high))
    assert np.all((band.low <= truth.y + 1e-12) & (truth.y - 1e-12 <= band.high))


def test_records_shorter_than_the_delay_are_at_rest() -> None:
    model = setid.TransferFunction(1, 1, 6, initial="zero")
    u, noise = np.random.default_rng(0).uniform(-1, 1, (20, 1)), setid.Noise(output=0.1)
    truth = setid.simulate_record(model, [-0.5, 1.0], u, noise)
    found = identified(setid.formulate(truth.data, model, noise), [(-0.6, -0.4), (0.9, 1.1)])
    for samples in (1, 5, 7):
        short = setid.IOData(u[:samples], np.zeros(samples))
        band = setid.simulate_band(found, short, kind="proved", time_limit=1.0)
        assert np.all(np.abs(band.low[:6]) < 1e-6) and np.all(np.abs(band.high[:6]) < 1e-6)


def test_an_unbounded_interval_leaves_sampled_bands(result: setid.Identification) -> None:
    intervals = dict(result.intervals)
    first = intervals["a1"]
    intervals["a1"] = setid.ParameterInterval(
        "a1", (-np.inf, np.inf), first.inner, setid.IntervalStatus.UNBOUNDED, first.witnesses
    )
    endless = result_of(result.formulation, intervals)
    assert np.isfinite(frequency_band(endless, [0.5], kind="sampled").magnitude).all()
    assert frequency_band(endless, [0.5]).magnitude[0, 1] == np.inf
    with pytest.raises(setid.SetidError, match="infinite interval"):
        step_band(endless)
    assert np.isfinite(step_band(endless, 10, kind="sampled").high).all()


def test_quotients_of_rectangles_hold_all_quotients() -> None:
    rng = np.random.default_rng(0)
    e, q = (0.4 - 0.3j, 0.9 + 0.2j), (0.5 - 0.2j, 1.5 + 0.3j)
    west, east, south, north = quotient_rectangle(e, q, 0.0)
    tops, belows = (
        rng.uniform(a.real, b.real, 500) + 1j * rng.uniform(a.imag, b.imag, 500) for a, b in (e, q)
    )
    corners = [complex(a.real, b.imag) for a in e for b in e]
    poles = [complex(a.real, b.imag) for a in q for b in q]
    found = np.concatenate([tops / belows, [a / b for a in corners for b in poles]])
    assert np.all((west <= found.real) & (found.real <= east))
    assert np.all((south <= found.imag) & (found.imag <= north))
    assert quotient_rectangle(e, (0.0 - 1j, 1.0 + 1j), 0.0) == (-np.inf, np.inf, -np.inf, np.inf)


def test_angles_of_a_rectangle_beyond_the_left_half_plane_are_all() -> None:
    assert angles_of(-2.0, -1.0, -1.0, 1.0) == (-np.pi, np.pi)
    low, high = angles_of(1.0, 2.0, -1.0, 1.0)
    assert low <= -np.pi / 4 and np.pi / 4 <= high < np.pi / 4 + 1e-12


def test_results_hand_the_time_of_bands_on(result: setid.Identification) -> None:
    whole = result.step(12, time_limit=5.0, all_time=True, tolerance=0.2)
    assert np.all(np.isfinite(whole.later)) and not np.any(np.isfinite(result.step(4).later))
    hurried = result.step(12, time_limit=0.0)
    assert hurried.report is not None and hurried.report.cells == 1
    assert np.all(hurried.low <= whole.nominal) and np.all(whole.nominal <= hurried.high)
    outputs = result.simulate(time_limit=0.0)
    assert all(report.cells == 1 for report in outputs.reports)


@pytest.mark.parametrize("length", [1, 2, 3, 15])
def test_a_step_of_any_length_has_a_band_where_nothing_is_fed_back(length: int) -> None:
    """y_k = b2 u_(k-2) + e with u = 2, y = 2 and abs(e) <= .1: b2 is in [.95, 1.05]."""
    data = setid.IOData([2.0, 0.0, 0.0, 2.0], [0.0, 0.0, 2.0, 0.0])
    found = setid.identify(data, setid.TransferFunction(0, 1, 2), setid.Noise(equation=0.1))
    band = step_band(found, length)
    low, high = ([*[0.0] * 2, *[0.95] * 13][:length], [*[0.0] * 2, *[1.05] * 13][:length])
    assert band.low == pytest.approx(low) and band.high == pytest.approx(high)
    assert band.later == (-np.inf, np.inf)
    assert step_band(found, length, all_time=True).later[1] == pytest.approx(1.05)


@pytest.mark.slow
def test_a_numerator_that_normalise_fixes_is_named(tmp_path: Path) -> None:
    """w = 2 u + .6 u^2 and y_k = w_(k-1) + .5 w_(k-2), so that the zero is at -.5."""
    u = np.random.default_rng(0).uniform(-1, 1, 12)
    w = 2 * u + 0.6 * u**2
    y = np.array([0.0, 0.0, *(w[1:-1] + 0.5 * w[:-2])])
    model = setid.Hammerstein(setid.TransferFunction(0, 2, 1), 2, normalise="b1")
    priors = [setid.ZeroIn(-0.6, -0.4), setid.Box({"b2": (0.1, 2.0)})]
    options = setid.Options(time_limit=5.0, progress=False)
    found = setid.identify(setid.IOData(u, y), model, setid.Noise(output=0.01), priors, options)
    truth = {"b2": 0.5, "gamma1": 2.0, "gamma2": 0.6}
    for name, item in found.intervals.items():
        assert item.outer[0] <= truth[name] <= item.outer[1]
        assert item.outer[1] - item.outer[0] < 0.2
    assert found.verify()
    asked = (found.bode, found.to_control, lambda: setid.to_ureal(found, tmp_path / "model.m"))
    for ask in asked:
        with pytest.raises(setid.ModelError, match="^model: found b1 fixed by normalise"):
            ask()
    found.report(str(tmp_path / "page.html"))
    assert "b1 fixed by normalise" in (tmp_path / "page.html").read_text("utf-8")


def test_what_holds_between_frequencies_cannot_be_written_to(result: setid.Identification) -> None:
    arcs = frequency_band(result, [0.5, 1.0], time_limit=0.0).arcs
    assert arcs is not None
    for name in ("centre", "half", "turn", "gain", "slope", "rectangles"):
        assert not getattr(arcs, name).flags.writeable
    assert not setid.residuals(result).theta.flags.writeable


@pytest.mark.parametrize("normalise", ["b1", "gamma1"])
def test_a_constant_in_a_map_acts_in_every_normalisation(normalise: str) -> None:
    """y(k) = b1 (gamma1 + gamma2 u(k-1)) = 1 + u(k-1) / 2: 1.5 after a step, and not 0.5."""
    u = np.array([1.0, -1.0, 0.5, 0.0, -0.5, 1.0])
    linear = setid.TransferFunction(0, 1, 1)
    model = setid.Hammerstein(linear, [(0,), (1,)], normalise=normalise)
    data = setid.IOData(u, np.append(1.0, 1.0 + 0.5 * u[:-1]))
    band = setid.step_band(setid.identify(data, model, setid.Noise(output=0.01)), 3, time_limit=0.0)
    assert np.all((band.low[1:] <= 1.5) & (band.high[1:] >= 1.5))
    assert np.all((band.low <= band.nominal) & (band.nominal <= band.high))
