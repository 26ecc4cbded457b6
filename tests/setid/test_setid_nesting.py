"""How sets of different records, noise bounds and priors must lie in each other."""

from __future__ import annotations

import numpy as np
import pytest

import setid

QUICK = setid.Options(time_limit=60.0, progress=False)
MODEL, THETA = setid.TransferFunction(1, 1, 1), [-0.6, 2.0]
NOISES = [
    setid.Noise(equation=0.2),
    pytest.param(setid.Noise(output=0.2), marks=pytest.mark.slow),
    setid.Noise(output=0.2, input=0.05),
]


def simulated(noise: setid.Noise, seed: int, samples: int = 12) -> setid.Simulated:
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    return setid.simulate_record(MODEL, THETA, u, noise, seed)


def identified(data: setid.IOData, noise: setid.Noise, *priors, model=MODEL):
    result = setid.identify(data, model, noise, priors, QUICK)
    assert all(item.inner is not None for item in result.intervals.values())
    return result


def assert_nested(small: setid.Identification, large: setid.Identification) -> None:
    """What is attained of the smaller set lies within what is proved of the larger one."""
    for name, item in small.intervals.items():
        low, high = large.intervals[name].outer
        assert low <= item.inner[0] <= item.inner[1] <= high


def scaled(noise: setid.Noise, factor: float) -> setid.Noise:
    bounds = {key: factor * getattr(noise, key) for key in ("output", "input", "equation")}
    return setid.Noise(**bounds)


@pytest.mark.parametrize("noise", NOISES)
def test_a_longer_record_lies_in_the_outer_set_of_its_beginning(noise: setid.Noise) -> None:
    truth = simulated(noise, 0)
    results = [identified(truth.data.split(k)[0], noise) for k in (6, 9)]
    results.append(identified(truth.data, noise))
    for short, long in zip(results, results[1:], strict=False):
        assert_nested(long, short)
    assert results[-1].intervals["a1"].width < results[0].intervals["a1"].width
    for result in results:
        assert all(v in result.intervals[n] for n, v in truth.theta.items())


@pytest.mark.parametrize("noise", NOISES)
def test_the_set_grows_with_each_noise_bound(noise: setid.Noise) -> None:
    data = simulated(noise, 5).data
    results = [identified(data, scaled(noise, factor)) for factor in (1.0, 1.2, 1.5)]
    for small, large in zip(results, results[1:], strict=False):
        assert_nested(small, large)
        for name, item in small.intervals.items():
            assert item.width < large.intervals[name].width
    if noise.input:
        more = identified(data, setid.Noise(output=noise.output, input=2 * noise.input))
        assert_nested(results[0], more)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(
    "prior",
    [setid.Stable(), setid.Box({"b1": (1.9, 2.05)}), setid.DCGain(4.95, 5.05)],
    ids=lambda prior: type(prior).__name__,
)
def test_a_prior_never_widens(noise: setid.Noise, prior: setid.Stable) -> None:
    truth = simulated(noise, 7)
    free, bound = identified(truth.data, noise), identified(truth.data, noise, prior)
    assert_nested(bound, free)
    assert all(v in bound.intervals[n] for n, v in truth.theta.items())
    if not isinstance(prior, setid.Stable):  # active here
        pairs = zip(bound.intervals.values(), free.intervals.values(), strict=True)
        assert min(one.width / two.width for one, two in pairs) < 0.9
        assert any(bound.active.values())


@pytest.mark.parametrize("noise", NOISES)
def test_permuted_inputs_permute_the_intervals(noise: setid.Noise) -> None:
    model = setid.TransferFunction(1, 1, 1, inputs=2, common_denominator=True)
    u = np.random.default_rng(1).uniform(-1, 1, (12, 2))
    truth = setid.simulate_record(model, [-0.6, 1.0, -2.0], u, noise, 1)
    other = setid.IOData(truth.data.u[:, ::-1], truth.data.y)
    straight, swapped = (identified(d, noise, model=model) for d in (truth.data, other))
    for name, mirror in {"a1": "a1", "b[1,1]1": "b[1,2]1", "b[1,2]1": "b[1,1]1"}.items():
        one, two = straight.intervals[name], swapped.intervals[mirror]
        slack = 2e-3 * one.width  # both are closed to 1e-3 of their width
        np.testing.assert_allclose(one.outer, two.outer, rtol=0, atol=slack)
        assert two.outer[0] <= one.inner[0] and one.inner[1] <= two.outer[1]
        assert one.outer[0] <= two.inner[0] and two.inner[1] <= one.outer[1]


@pytest.mark.slow
def test_permuted_inputs_with_denominators_of_their_own() -> None:
    noise, model = setid.Noise(output=0.02), setid.TransferFunction(1, 1, 1, inputs=2)
    u = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    truth = setid.simulate_record(model, [0.5, -0.3, 1, 2], u, noise)
    other = setid.IOData(truth.data.u[:, ::-1], truth.data.y)
    straight, swapped = (
        identified(d, noise, setid.Stable(), model=model) for d in (truth.data, other)
    )
    for letter in "ab":
        for one, two in (("1,1", "1,2"), ("1,2", "1,1")):
            mine = straight.intervals[f"{letter}[{one}]1"]
            mirror = swapped.intervals[f"{letter}[{two}]1"]
            assert mirror.outer[0] <= mine.inner[0] and mine.inner[1] <= mirror.outer[1]
            assert mine.outer[0] <= mirror.inner[0] and mirror.inner[1] <= mine.outer[1]


def test_the_order_of_records_changes_nothing() -> None:
    noise = setid.Noise(output=0.2)
    parts = [simulated(noise, seed, 6).data for seed in (1, 2)]
    one, two = (identified(setid.IOData.concat(p), noise) for p in (parts, parts[::-1]))
    assert_nested(one, two)
    assert_nested(two, one)
    assert_nested(one, identified(parts[0], noise))
