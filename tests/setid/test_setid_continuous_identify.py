"""Identification in continuous time: truths, collapse, independent programs, what is said."""

from __future__ import annotations

import control
import numpy as np
import pytest
from continuous_cases import PLANT, QUICK, THETA, exact_samples, levels, noisy
from scipy.optimize import linprog
from slow_values import slow_after

import setid

C = setid.ContinuousTransferFunction


def sampled(Ts: float, count: int = 24) -> tuple[setid.IOData, float]:
    """A noisy record of exact samples, and the discretisation error of the truth."""
    u = levels(Ts, count)
    model = C(2, 1, hold="constant", Ts=Ts)
    error = setid.simulate(model, THETA, u)[:, 0] - exact_samples(u, Ts)
    data = setid.IOData(u, noisy(exact_samples(u, Ts), 0.005), Ts=Ts)
    return data, float(np.abs(error).max())


def holds_truth(result: setid.Identification, theta: np.ndarray = THETA) -> bool:
    pairs = zip(result.intervals.values(), theta, strict=True)
    return all(value in interval for interval, value in pairs)


@pytest.fixture(scope="module")
def rates() -> dict[float, setid.Identification]:
    """The plant at three rates, delta covering the error of the truth."""
    found = {}
    for Ts in (0.4, 0.2, 0.1):
        data, error = sampled(Ts, 12)
        model = C(2, 1, hold="constant", delta=1.1 * error)
        found[Ts] = setid.identify(data, model, setid.Noise(output=0.005), options=QUICK)
    return found


def test_the_truth_is_inside_at_every_rate(rates: dict[float, setid.Identification]) -> None:
    for result in rates.values():
        assert holds_truth(result) and result.verify()
        for interval in result.intervals.values():
            assert interval.status == "certified" and interval.inner is not None
            assert interval.outer[0] <= interval.inner[0] <= interval.inner[1] <= interval.outer[1]


def test_intervals_narrow_with_the_interval_of_sampling(
    rates: dict[float, setid.Identification],
) -> None:
    widths = np.array([[i.width for i in r.intervals.values()] for r in rates.values()])
    assert np.all(widths[1:] < 0.7 * widths[:-1])


def test_a_result_says_what_it_takes_for_granted(
    rates: dict[float, setid.Identification],
) -> None:
    result = rates[0.2]
    text = "\n".join(result.assumptions)
    assert "between samples inputs are held constant" in text and "delta = 0.0" in text
    assert list(result.intervals) == list(PLANT) and "a1  " in result.table()
    assert not any("off by" in note for note in result.notes)
    data, _ = sampled(0.2, 8)
    bare = setid.identify(data, C(2, 1, hold="constant"), setid.Noise(output=0.005), options=QUICK)
    assert any("the recursion is off by 0.0" in note for note in bare.notes)


@pytest.mark.slow
def test_bands_and_models_are_continuous(rates: dict[float, setid.Identification]) -> None:
    result = rates[0.2]
    plant = control.tf([0.5, 2.0], [1.0, 1.2, 2.0])
    band = setid.frequency_band(result, [0.3, 1.4, 5.0, 100.0])  # beyond pi / Ts as well
    truth = np.array([plant(1j * omega) for omega in band.omega])
    assert np.all(np.abs(truth) >= band.magnitude[:, 0])
    assert np.all(np.abs(truth) <= band.magnitude[:, 1])
    models = result.to_control(band.omega)
    assert models.nominal.isctime(strict=True) and models.weight.isctime(strict=True)
    a1, a0, b1, b0 = result.best("simulation").theta
    member = control.tf([b1, b0], [1.0, a1, a0])
    np.testing.assert_allclose(
        [models.nominal(1j * omega) for omega in band.omega],
        [member(1j * omega) for omega in band.omega],
        rtol=1e-9,
    )
    far = np.array(
        [v(1j * w) / models.nominal(1j * w) - 1 for v in models.vertices for w in band.omega]
    )
    covered = np.tile([abs(models.weight(1j * w)) for w in band.omega], len(models.vertices))
    assert np.all(np.abs(far) <= covered * (1 + 1e-9))
    assert models.weight.poles().real.max() < 0


@pytest.mark.slow
def test_proved_outputs_hold_the_recursion_of_the_truth(
    rates: dict[float, setid.Identification],
) -> None:
    result = rates[0.1]
    u = np.random.default_rng(9).uniform(-1, 1, 40)
    model = result.formulation.model
    y = setid.simulate(model, THETA, u)
    at_rest = setid.IOData(
        np.append(np.zeros(5), u), np.append(np.zeros((5, 1)), y, axis=0), Ts=0.1
    )
    band = setid.simulate_band(result, at_rest, kind="proved")
    assert np.all(band.low[5:] <= y + 1e-12) and np.all(y - 1e-12 <= band.high[5:])
    step = setid.step_band(result, 30)
    response = setid.simulate(model, THETA, np.ones(30))[:, 0]
    assert np.all(step.low <= response + 1e-12) and np.all(response - 1e-12 <= step.high)
    assert setid.compare(result).fit[0] > 90.0
    with pytest.raises(setid.SetidError, match="predict nothing one step ahead"):
        setid.predict(result)


@pytest.mark.parametrize("size", slow_after(1, [1e-8, 1e-2]))
def test_intervals_collapse_with_the_noise(size: float) -> None:
    """The plant is the recursion itself, so that no discretisation error remains."""
    model = C(2, 1, Ts=0.3)
    u = np.random.default_rng(4).uniform(-1, 1, 14)
    truth = setid.simulate_record(model, THETA, u, setid.Noise(output=size), Ts=0.3)
    result = setid.identify(truth.data, C(2, 1), setid.Noise(output=size), options=QUICK)
    assert holds_truth(result)
    assert max(interval.width for interval in result.intervals.values()) < 150 * size


@pytest.mark.parametrize("tau", slow_after(1, [0.2, 5.0]))
def test_lambda_collapses_under_its_hold_assumption(tau: float) -> None:
    theta = np.array([2.0, 0.5, 3.0])
    model = C(1, 1, method="lambda", tau=tau, Ts=0.1)
    u = np.random.default_rng(4).uniform(-1, 1, 25)
    noise = setid.Noise(output=1e-6, input=1e-6)
    truth = setid.simulate_record(model, theta, u, noise, Ts=0.1)
    result = setid.identify(truth.data, C(1, 1, method="lambda", tau=tau), noise, options=QUICK)
    assert holds_truth(result, theta)
    assert max(interval.width for interval in result.intervals.values()) < 5e-3


def test_output_error_of_order_one_against_programs_on_a_grid() -> None:
    """For fixed a0 rows are linear in (b0, eta): scipy's programs on a grid of a0."""
    Ts, a0, b0, bound = 0.2, 1.5, 3.0, 0.05
    model = C(1, 0, Ts=Ts)
    u = np.random.default_rng(8).uniform(-1, 1, 12)
    data = setid.simulate_record(model, [a0, b0], u, setid.Noise(output=bound), Ts=Ts).data
    result = setid.identify(data, C(1, 0), setid.Noise(output=bound), options=QUICK)
    y, half = data.y[:, 0], Ts / 2

    def ends(a: float) -> tuple[float, float] | None:
        rows, right = np.zeros((11, 13)), np.zeros(11)
        for k in range(1, 12):  # (1 + a T/2)(y - eta)_k - (1 - a T/2)(y - eta)_(k-1) = b T/2 (..)
            new, old = 1 + a * half, 1 - a * half
            right[k - 1] = new * y[k] - old * y[k - 1]
            rows[k - 1, 0] = half * (u[k] + u[k - 1])
            rows[k - 1, 1 + k], rows[k - 1, k] = new, -old
        limits = [(None, None)] + [(-bound, bound)] * 12
        found = [
            linprog(np.eye(1, 13)[0] * sign, A_eq=rows, b_eq=right, bounds=limits)
            for sign in (1.0, -1.0)
        ]
        return (found[0].fun, -found[1].fun) if found[0].status == 0 else None

    low, high = result.intervals["a0"].outer
    for outside in (low - 1e-4, high + 1e-4):
        assert ends(outside) is None
    grid = [ends(a) for a in np.linspace(low, high, 41)[1:-1]]
    reached = np.array([pair for pair in grid if pair is not None])
    assert len(reached) == 39
    outer = result.intervals["b0"].outer
    assert outer[0] <= reached[:, 0].min() and reached[:, 1].max() <= outer[1]
    assert reached[:, 1].max() - reached[:, 0].min() > 0.98 * (outer[1] - outer[0])


def test_equation_errors_are_a_linear_program() -> None:
    model = C(2, 1, Ts=0.3)
    u = np.random.default_rng(4).uniform(-1, 1, 25)
    truth = setid.simulate_record(model, THETA, u, setid.Noise(equation=0.01), Ts=0.3)
    result = setid.identify(truth.data, C(2, 1), setid.Noise(equation=0.01))
    y, half = truth.data.y[:, 0], 0.15

    def lagged(signal: np.ndarray, weights: list[float]) -> np.ndarray:
        return sum(w * signal[2 - lag : 25 - lag] for lag, w in enumerate(weights))

    first, second = [half, 0.0, -half], [half**2, 2 * half**2, half**2]
    matrix = np.stack(
        [lagged(y, first), lagged(y, second), -lagged(u, first), -lagged(u, second)], axis=1
    )
    target = lagged(y, [1.0, -2.0, 1.0])
    whole = np.vstack([matrix, -matrix]), np.concatenate([0.01 - target, 0.01 + target])
    for place, interval in enumerate(result.intervals.values()):
        for sign, end in zip((1.0, -1.0), interval.outer, strict=True):
            cost = sign * np.eye(4)[place]
            found = linprog(cost, *whole, bounds=[(None, None)] * 4)
            assert sign * found.fun == pytest.approx(end, abs=1e-7)
    assert result.status == "certified"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "theta", "size", "Ts"),
    [
        (3, [3.0, 4.0, 2.0, 2.0], 1e-3, 0.2),
        (4, [4.0, 8.0, 8.0, 4.0, 4.0], 1e-4, 0.3),
        (2, [16.0, 4500.0, 4500.0], 1e-2, 0.01),
    ],
)
def test_higher_orders_and_large_coefficients(
    n: int, theta: list[float], size: float, Ts: float
) -> None:
    u = np.repeat(np.random.default_rng(3).uniform(-1, 1, 10), 8)
    noise = setid.Noise(output=size)
    truth = setid.simulate_record(C(n, 0, Ts=Ts), theta, u, noise, Ts=Ts)
    result = setid.identify(
        truth.data, C(n, 0), noise, [setid.Stable()], setid.Options(time_limit=300, progress=False)
    )
    assert holds_truth(result, np.array(theta)) and result.status == "certified"


def test_without_a_box_the_variables_are_named() -> None:
    """Noise as large as the signal: a box asked for, by name, settles it."""
    data, _ = sampled(0.4, 10)
    loud = setid.Noise(output=2.0)
    result = setid.identify(data, C(2, 1), loud, options=QUICK)
    assert "no finite bounds of a1, a0, b1, b0 were found" in result.notes[0]
    box = setid.Box({name: (0.5 * value, 2 * value) for name, value in PLANT.items()})
    boxed = setid.identify(data, C(2, 1), loud, [box], QUICK)
    assert holds_truth(boxed) and all(np.isfinite(i.width) for i in boxed.intervals.values())


# ---- the discretisation error -----------------------------------------------------------


@pytest.mark.slow
def test_the_least_bound_is_consistent_and_less_is_not() -> None:
    """Inputs said to be linear that are held: the structure cannot absorb it all."""
    u = levels(0.4, 12)
    data = setid.IOData(u, exact_samples(u, 0.4), Ts=0.4)
    model, noise = C(2, 1), setid.Noise(output=1e-3)
    found = setid.estimate_delta(data, model, noise, options=QUICK)
    value = float(found.value[0])
    assert 0 < value < 0.2 and "true error may be larger" in found.assumption
    lower = float(found.assumption.split("none below ")[1].split(" ")[0])
    assert 0.9 * value < lower <= value
    less = setid.identify(data, C(2, 1, delta=0.9 * lower), noise, options=QUICK)
    more = setid.identify(data, C(2, 1, delta=1.02 * value), noise, options=QUICK)
    assert less.empty and less.verify() and not more.empty
    doubled = setid.estimate_delta(data, model, noise, options=QUICK, margin=2.0)
    assert doubled.value[0] == pytest.approx(2 * value, rel=0.02)


def test_estimated_error_is_consistent_with_priors_too() -> None:
    """Rows that admit delta = 0 alone do not with the prior, whose set was proved empty then."""
    data = setid.IOData([1, 2, 1, 1, 0, 1], [0.0, 0.6, 1.5, 1.3, 1.2, 0.4], Ts=1.0)
    model, noise = C(1, 0, hold="constant", delta="estimate"), setid.Noise(output=0.3)
    fast = [setid.PoleIn(-2.0, -1.9)]
    assert setid.estimate_delta(data, model, noise).value[0] == 0.0
    assert setid.identify(data, C(1, 0, hold="constant"), noise, fast, options=QUICK).empty
    found = setid.estimate_delta(data, model, noise, fast, options=QUICK)
    assert found.value[0] > 0.0 and "none was found consistent" in found.assumption
    held = [setid.Known({"a0": 1.9}), setid.Sign({"b0": "-"})]
    found = setid.estimate_delta(data, model, noise, held, options=QUICK)
    assert found.value[0] == pytest.approx(1.2, rel=0.05) and "the least one" in found.assumption


def test_estimate_is_settled_by_identify_and_listed() -> None:
    """A held input and m = n - 1: other coefficients absorb the whole error."""
    data, error = sampled(0.4, 10)
    result = setid.identify(
        data, C(2, 1, hold="constant", delta="estimate"), setid.Noise(output=0.005), options=QUICK
    )
    assert any(
        "discretisation error: at most delta = 0, the least" in t for t in result.assumptions
    )
    assert any("by at most delta = 0" in text for text in result.assumptions)
    assert any("is off by" in note for note in result.notes) and error > 0.01
    assert result.verify()


@pytest.mark.slow
def test_consistency_counts_delta_as_noise() -> None:
    data, _ = sampled(0.4, 8)
    plain = setid.consistency(data, C(2, 1), setid.Noise(output=0.02), options=QUICK)
    split = setid.consistency(data, C(2, 1, delta=0.01), setid.Noise(output=0.01), options=QUICK)
    np.testing.assert_allclose(plain.scale, split.scale, rtol=1e-2)
    assert plain.verify() and split.verify()


def test_delta_is_added_once() -> None:
    data, _ = sampled(0.4, 8)
    model = C(2, 1, delta=0.25)
    first = setid.formulate(data, model, setid.Noise(output=0.5))
    again = setid.formulate(data, first.model, first.noise)
    assert first.problem.fingerprint == again.problem.fingerprint
    eta = first.layout.group("eta").ravel()
    np.testing.assert_allclose(first.problem.upper[eta], 0.75)
    with pytest.raises(setid.ModelError, match="margin: found 0.5"):
        setid.estimate_delta(data, model, setid.Noise(0.1), margin=0.5)


@pytest.mark.slow
def test_the_structure_loop_finds_the_order() -> None:
    """A record of the recursion itself, so that order 2 explains it and order 1 cannot."""
    u = levels(0.1, 12)
    plant = C(2, 1, hold="constant", Ts=0.1)
    data = setid.IOData(u, noisy(setid.simulate(plant, THETA, u)[:, 0], 0.005), Ts=0.1)
    found = setid.select(
        data,
        lambda n, degree: C(n, n - 1, hold="constant"),
        setid.Noise(output=0.005),
        orders=(1, 2),
        options=QUICK,
    )
    assert [step.decision for step in found.steps] == ["refuted", "kept"]
    assert found.result is not None and holds_truth(found.result)


def test_simulated_records_have_the_interval_of_their_structure() -> None:
    fixed, free, quiet = C(1, 0, Ts=0.2), C(1, 0), setid.Noise()
    one = setid.simulate_record(fixed, [1.0, 2.0], [1.0, 0.0, 0.0], quiet)
    two = setid.simulate_record(free, [1.0, 2.0], [1.0, 0.0, 0.0], quiet, Ts=0.2)
    assert one.data.Ts == two.data.Ts == 0.2
    assert one.output == pytest.approx(two.output)
    with pytest.raises(setid.ModelError, match="Ts: found 0.2 in the model, expected 0.5"):
        setid.simulate_record(fixed, [1.0, 2.0], [1.0, 0.0, 0.0], quiet, Ts=0.5)


def held(delta: float) -> tuple[setid.IOData, setid.ContinuousTransferFunction]:
    """A sampled first-order response with .01 of noise, and a structure with a model error."""
    u, y, pole = np.repeat([1.0, -1, 2, 0, 1], 3), np.zeros(15), np.exp(-0.2)
    for k in range(14):
        y[k + 1] = pole * y[k] + 1.5 * (1 - pole) * u[k]
    data = setid.IOData(u, y + 0.01 * np.cos(7 * np.arange(15)), Ts=0.1)
    return data, C(1, 0, hold="constant", delta=delta)


def test_least_factors_multiply_noise_and_delta_and_say_so() -> None:
    data, model = held(0.01)
    found = setid.consistency(data, model, setid.Noise(output=0.01))
    assert "noise bounds and delta = 0.01 together" in found.summary()
    assert any("at most delta = 0.01" in text for text in found.assumptions)
    low, high = found.scale
    for factor, status in ((low * 0.99, "empty"), (high * 1.01, "certified")):
        half = setid.identify(data, held(0.01 * factor)[1], setid.Noise(output=0.01 * factor))
        assert str(half.status) == status


def test_a_bound_read_off_is_what_is_needed_beyond_delta() -> None:
    data, model = held(0.003)
    found = setid.consistency(data, model, setid.Noise(output=0.001))
    bound = found.noise_bound()
    assert bound.output[0] == pytest.approx(found.scale[1] * 0.004 - 0.003)
    assert "beyond delta = 0.003" in bound.assumptions[0]
    assert (
        str(setid.identify(data, model, setid.Noise(output=0.99 * bound.output)).status) == "empty"
    )
    assert str(setid.identify(data, model, found.noise_bound(1.01)).status) == "certified"
    covered = setid.consistency(data, held(0.01)[1], setid.Noise(output=0.0001)).noise_bound()
    assert np.all(covered.output == 0)


def test_rows_of_a_sensitivity_have_delta_times_their_factor() -> None:
    data, model = held(0.01)
    result = setid.identify(data, model, setid.Noise(output=0.01))
    found = setid.sensitivity(result, factors=[0.3, 0.7])
    assert [str(row.status) for row in found.results] == ["empty", "certified"]
    assert any("at most delta = 0.006999" in text for text in found.results[1].assumptions)
    assert "each factor multiplies the noise bounds and delta = 0.01 together" in found.summary()
    assert found.verify()
    kept = setid.identify(data, held(0.007)[1], setid.Noise(output=0.007))
    assert found.outer[1].ravel() == pytest.approx(
        [e for i in kept.intervals.values() for e in i.outer]
    )


def test_steps_say_that_they_are_those_of_the_recursion() -> None:
    data, _ = held(0.01)
    for hold, words in (
        ("constant", "held at each sample"),
        ("linear", "interval before the first"),
    ):
        shape = C(1, 0, hold=hold, delta=0.01)
        result = setid.identify(data, shape, setid.Noise(output=0.5))
        band = setid.step_band(result, 5, kind="sampled")
        assert words in band.summary()
        begins = band.nominal[0] > 0  # the ramp before the first sample has acted on it
        assert begins == (hold == "linear")
