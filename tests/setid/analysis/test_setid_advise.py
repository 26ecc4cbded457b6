"""Advice on acquisition: settling times by hand, tolerance limits, saturation, planned inputs."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.signal import lfilter, lsim, lti

import setid

TAU, TS = 0.1, 1e-3


def step(noise: float = 0.0, samples: int = 1200, seed: int = 0) -> setid.IOData:
    """A first-order system of time constant 0.1 s, sampled at 1 kHz, the step at 0.1 s."""
    u = np.where(np.arange(samples) >= 100, 2.0, 0.0)
    _, y, _ = lsim(lti([3.0], [TAU, 1.0]), u, np.arange(samples) * TS, interp=False)
    y = y + np.random.default_rng(seed).uniform(-noise, noise, samples)
    return setid.IOData(u, y, TS, output_names="speed", time_unit="s")


def test_the_settling_time_of_a_first_order_system() -> None:
    found = setid.advise(step())
    assert found.settling_time == pytest.approx(TAU * np.log(50), abs=2 * TS)  # exp(-t/tau) = 2 %
    assert 20 <= found.settling_time / found.sampling_time <= 50
    low, high = found.sampling_range
    assert low < found.sampling_time < high
    assert found.settling_time / low == pytest.approx(50, rel=0.06)
    assert found.settling_time / high == pytest.approx(20, rel=0.06)
    assert "0.013 s" in found.text and not found.saturation and not found.quantisation


def test_noise_does_not_hide_the_settling_time() -> None:
    found = setid.advise(step(0.05))
    # 6 exp(-t / tau) with noise of 0.05 last leaves the band 0.12 + 0.05 between these times
    assert TAU * np.log(6 / 0.17) - TS <= found.settling_time <= TAU * np.log(6 / 0.12) + 2 * TS
    assert found.noise_bound is not None
    assert 0.045 <= float(found.noise_bound) <= 0.051


def test_the_noise_bound_of_a_record_at_rest_and_its_confidence() -> None:
    rest = 0.7 + np.random.default_rng(1).uniform(-0.02, 0.02, 473)
    found = setid.advise(step(), rest)
    assert found.noise_bound is not None
    assert float(found.noise_bound) == (rest.max() - rest.min()) / 2
    # Wilks: 473 samples hold 99 % of the distribution within their range with confidence 95 %
    assert found.coverage == pytest.approx(0.99, abs=2e-5)
    noise = setid.Noise(output=found.noise_bound)
    assert "estimated from 473 samples" in noise.assumptions[0]
    assert np.asarray(found.noise_bound).shape == (1,)


def test_the_confidence_holds_for_two_parts_at_rest() -> None:
    """Of 1500 records, 95 % have the share of noise in the range seen that is claimed."""
    u = np.append(np.zeros(130), np.ones(300))
    clean = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.8, 0.2], u).ravel()
    held = 0
    for seed in range(1500):
        noise = np.random.default_rng(seed).uniform(-1e-3, 1e-3, u.size)
        found = setid.advise(setid.IOData(u, clean + noise))
        held += float(found.noise_bound) / 1e-3 >= found.coverage  # the share of uniform noise
    assert held / 1500 >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / 1500)


def test_missing_readings_at_rest_do_not_count() -> None:
    rest = np.random.default_rng(0).uniform(-0.02, 0.02, 473)
    holes = np.full(2 * 473, np.nan)
    holes[::2] = rest
    found = setid.advise(step(), setid.IOData(np.zeros(holes.size), holes))
    assert found.coverage == setid.advise(step(), rest).coverage
    assert "from 473 samples" in setid.Noise(output=found.noise_bound).assumptions[0]
    assert "from 473 samples" in found.text


def test_a_record_that_ends_too_soon_gives_no_sampling_time() -> None:
    found = setid.advise(step(samples=200))  # one time constant
    assert np.isnan(found.sampling_time) and "has not settled" in found.text
    with pytest.raises(setid.SetidError, match="settles"):
        found.square_wave()
    ramp = setid.IOData(np.append(np.zeros(50), np.ones(150)), np.maximum(np.arange(200) - 50.0, 0))
    assert "integrates" in setid.advise(ramp).text


def test_saturation_and_quantisation_are_seen() -> None:
    data = step(0.05)
    cut = setid.IOData(data.u, np.minimum(data.y, 5.5), TS, output_names="speed")
    found = setid.advise(cut)
    assert dict(found.saturation) == {"speed": (None, 5.5)} and "speed sticks at 5.5" in found.text
    coarse = setid.IOData(data.u, 0.25 * np.round(data.y / 0.25), TS, output_names="speed")
    assert setid.advise(coarse).quantisation["speed"] == pytest.approx(0.25)


def test_a_record_without_a_step_is_refused() -> None:
    with pytest.raises(setid.DataError, match="never change"):
        setid.advise(setid.IOData(np.zeros(5), np.arange(5.0)))
    gap = np.append(np.zeros(20), np.ones(20))
    gap[18:22] = np.nan  # it does change, but not between known samples
    with pytest.raises(setid.DataError, match="from one known sample to the next"):
        setid.advise(setid.IOData(gap, np.arange(40.0)))


def test_an_input_that_differs_between_two_records_is_no_step() -> None:
    u, y = np.repeat([0.0, 1.0], 50), np.repeat([0.0, 5.0], 50)
    with pytest.raises(setid.DataError, match="found 2 records"):
        setid.advise(setid.IOData(u, y, starts=[0, 50]))


def test_the_square_wave_has_both_half_periods() -> None:
    wave = setid.advise(step()).square_wave(200, -2.0, 3.0)
    assert set(wave) == {-2.0, 3.0} and wave.shape == (200,)
    runs = np.diff(np.flatnonzero(np.diff(wave)))
    assert set(runs.tolist()) == {6, 30}


@pytest.mark.parametrize(
    "given", [(-1,), (0,), (9.5,), (9, "low"), (9, float("nan"), 1.0), (9, 0.0, float("inf"))]
)
def test_settings_of_a_square_wave_are_checked(given: tuple) -> None:
    with pytest.raises(setid.SetidError, match="found"):
        setid.advise(step()).square_wave(*given)


def test_expected_widths_of_a_static_gain_by_hand() -> None:
    model = setid.TransferFunction(na=0, nb=1)
    found = setid.excitation(model, [2.0], [0.0, 1.0, -4.0, 2.0], setid.Noise(output=0.1))
    # abs(d u_k) <= 0.1 for all k: abs(d) <= 0.1 / 4
    assert found.widths == pytest.approx([0.05]) and found.wide == ()
    weak = setid.excitation(model, [2.0], [0.0, 0.1], setid.Noise(output=0.1))
    assert weak.widths == pytest.approx([2.0]) and weak.wide == ("b0",)
    none = setid.excitation(model, [2.0], [0.0, 0.0], setid.Noise(output=0.1))
    assert np.isinf(none.widths[0]) and "says nothing of any parameter" in none.text


def test_expected_widths_are_those_of_a_record_without_noise() -> None:
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(equation=0.1)
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    found = setid.excitation(model, {"a1": -0.6, "b1": 1.0}, u, noise)
    data = setid.IOData(u, setid.simulate(model, [-0.6, 1.0], u))
    result = setid.identify(data, model, noise)
    widths = [item.width for item in result.intervals.values()]
    assert found.widths == pytest.approx(widths, rel=1e-6)


def test_pictures_are_drawn() -> None:
    found = setid.advise(step(0.05))
    assert found.plot().get_xlabel() == "time [s]"
    _, ax = plt.subplots()
    model = setid.TransferFunction(na=0, nb=1)
    planned = setid.excitation(model, [2.0], [0.0, 0.0], setid.Noise(output=0.1))
    assert planned.plot(ax) is ax and "unbounded" in {t.get_text() for t in ax.texts}
    plt.close("all")


def test_a_record_without_rest_gives_no_noise_bound() -> None:
    """A random input never rests: ranges of its response are no noise."""
    u = np.random.default_rng(2).uniform(-1.0, 1.0, 200)
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    found = setid.advise(setid.IOData(u, y))
    assert found.noise_bound is None and "no part of the record is at rest" in found.text


def test_inputs_that_go_on_changing_are_no_step() -> None:
    u = np.repeat(np.random.default_rng(0).uniform(-1, 1, 60), 5)
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    found = setid.advise(setid.IOData(u, y, 0.1))
    assert np.isnan(found.settling_time) and np.isnan(found.sampling_time)
    assert "no input steps once" in found.text and "integrates" not in found.text
    gaps = np.where(np.arange(u.size) % 7 == 3, np.nan, u)
    assert "no input steps once" in setid.advise(setid.IOData(gaps, y, 0.1)).text
    jitter = 0.01 * np.random.default_rng(1).uniform(-1, 1, 1200)
    slightly = setid.IOData(step().u[:, 0] + jitter, step().y, TS)
    assert setid.advise(slightly).settling_time == setid.advise(step()).settling_time


def test_a_quantised_output_that_settles_need_not_be_saturated() -> None:
    u = np.append(np.zeros(20), np.ones(180))
    y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u).ravel()
    rounded = setid.advise(setid.IOData(u, np.round(y / 0.05) * 0.05, 0.01))
    assert rounded.saturation and "sticks at 1: it settles there within a step" in rounded.text
    cut = setid.advise(setid.IOData(u, np.minimum(y, 0.8), 0.01))
    assert "sticks at 0.8: saturation; use a smaller step" in cut.text


@pytest.mark.parametrize(
    ("poles", "zeros"), [((-0.5,), (0.0, 0.5)), ((), (0.0, 0.3, 0.4, 0.3)), ((), (0.0, 2.0))]
)
def test_an_exact_output_that_settles_need_not_be_saturated(poles, zeros) -> None:
    """In doubles 1 - 2^-k ends at 1; sums of a few inputs end after these."""
    u = np.append(np.zeros(20), np.ones(180))
    y = lfilter(zeros, (1.0, *poles), u)
    found = setid.advise(setid.IOData(u, y, 0.01))
    assert f"sticks at {y[-1]:g}: it settles there without any noise, or saturates" in found.text
    assert not found.quantisation  # 1.1e-16 is no step of a converter


def test_exact_outputs_that_were_on_their_way_are_saturated() -> None:
    u = np.append(np.zeros(20), np.ones(180))
    y = lfilter((0.0, 0.1), (1.0, -0.9), u)
    for cut in (0.5, 0.9, 0.97):
        found = setid.advise(setid.IOData(u, -np.minimum(y, cut), 0.01))
        assert f"sticks at {-cut}: saturation; use a smaller step" in found.text
    swings = lfilter((0.0, 0.1), (1.0, -1.8, 0.9), u)  # comes back from where it was cut
    found = setid.advise(setid.IOData(u, np.minimum(swings, 1.2), 0.01))
    assert "sticks at 1.2: saturation; use a smaller step" in found.text


@pytest.mark.parametrize("constants", [0.5, 1.0, 2.0])
def test_a_response_that_ends_on_its_way_has_not_settled(constants: float) -> None:
    """After t time constants 1 - exp(-t) of the step are reached, whatever the last samples are."""
    k = np.arange(int(100 * constants))
    u, y = np.append(np.zeros(20), np.ones(k.size)), np.append(np.zeros(20), 1 - np.exp(-0.01 * k))
    found = setid.advise(setid.IOData(u, y, Ts=0.01))
    assert np.isnan(found.sampling_time) and "has not settled" in found.text


def test_an_output_that_does_not_answer_says_so() -> None:
    noise = 0.001 * np.cos(np.arange(70) ** 2)
    u = np.append(np.zeros(20), np.ones(50))
    found = setid.advise(setid.IOData(u, noise, Ts=0.01))
    assert np.isnan(found.sampling_time) and "no output answers the step" in found.text
    both = np.column_stack([noise, np.append(np.zeros(20), 1 - np.exp(-0.3 * np.arange(50)))])
    alone = setid.advise(setid.IOData(u, both[:, 1], Ts=0.01))
    assert setid.advise(setid.IOData(u, both, Ts=0.01)).settling_time == alone.settling_time


def test_parts_at_rest_of_several_lengths_are_refused() -> None:
    parts = [np.zeros(5), np.ones(7)]
    with pytest.raises(setid.NoiseError, match="zero_input_record: found"):
        setid.estimate_noise_bound(parts)


def test_widths_of_continuous_structures_need_the_interval() -> None:
    u = np.append(0.0, np.ones(60))
    shapes = [setid.ContinuousTransferFunction(1, 0, delta=0.01, Ts=Ts) for Ts in (None, 0.1)]
    noise = setid.Noise(output=0.1)
    with pytest.raises(setid.ModelError, match="Ts: found None"):
        setid.excitation(shapes[0], [2, 2], u, noise)
    one = setid.excitation(shapes[0], [2, 2], u, noise, Ts=0.1)
    two = setid.excitation(shapes[1], [2, 2], u, noise)
    assert one.widths == pytest.approx(two.widths)
    assert "nothing of any parameter" in setid.excitation(shapes[1], [2, 2], 0 * u, noise).text


def test_a_record_at_rest_has_the_channels_of_the_step_record() -> None:
    with pytest.raises(setid.DataError, match="zero_record: found 3 channels, expected 1"):
        setid.advise(step(), np.zeros((20, 3)))


def test_quantised_readings_at_rest_leave_half_a_step_of_noise() -> None:
    """Readings in steps of 1/4 that rest at a level are off by up to 1/8."""
    data = step()
    coarse = setid.IOData(data.u, np.round(4 * data.y) / 4, TS, output_names="speed")
    for found in (setid.advise(coarse), setid.advise(coarse, np.zeros(30))):
        assert found.noise_bound is not None
        assert float(found.noise_bound) == 0.125 and "noise bound 0.125 from" in found.text
        assert "widened to 0.125" in found.noise_bound.assumption
        assert "noise bound of speed is half a step of its quantisation" in found.text
    wide = setid.advise(coarse, [0.25, -0.25, 0.0])
    assert float(wide.noise_bound or 0) == 0.25 and "half a step" not in wide.text


def test_a_rest_that_shows_no_noise_says_so() -> None:
    assert "speed never changes at rest" in setid.advise(step(), np.full(9, 3.0)).text
    assert "one sample at rest shows no noise" in setid.advise(step(), [3.0]).text


@pytest.mark.parametrize("gap", [slice(0, 100), slice(100, None), slice(-120, None)])
def test_missing_readings_are_not_called_unsettled(gap: slice) -> None:
    y = step().y[:, 0].copy()
    y[gap] = np.nan
    found = setid.advise(setid.IOData(step().u, y, TS, output_names="speed"))
    assert np.isnan(found.settling_time) and "has not settled" not in found.text
    assert "no reading of speed is known before the step or at the end" in found.text


def test_readings_without_digits_are_not_called_saturated() -> None:
    """About 1e15 doubles are 1/8 apart."""
    found = setid.advise(setid.IOData(step().u, step().y + 1e15, TS))
    assert not found.saturation and "never changes at rest" in found.text


@pytest.mark.parametrize("place", ["u", "y", "Ts"])
def test_numbers_that_would_overflow_are_refused(place: str) -> None:
    data = {"u": step().u, "y": step().y, "Ts": 1.0}
    data[place] = 1e307 * data[place]
    with pytest.raises(setid.DataError, match=r"step_record: found .*e\+307, expected numbers"):
        setid.advise(setid.IOData(**data))


def test_what_is_wrong_with_readings_at_rest_names_the_argument() -> None:
    for rest in ([], "loud", [np.nan], setid.IOData([0, 1], [1, 2])):
        with pytest.raises(setid.NoiseError, match="zero_record: found"):
            setid.advise(step(), rest)
