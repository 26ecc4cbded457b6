"""Rows summed through low-pass filters: what they claim, by brute force and on truths."""

from __future__ import annotations

import numpy as np
import pytest
from continuous_cases import THETA, exact_samples, levels, noisy
from hypothesis import given, settings
from hypothesis import strategies as st

import setid
from setid.models.continuous import at_rate


def second_order(u: np.ndarray, Ts: float, noise: setid.Noise, **how: object) -> setid.Formulation:
    model = setid.ContinuousTransferFunction(2, 1, Ts=Ts, **how)
    record = setid.simulate_record(model, THETA, u, noise, seed=3, Ts=Ts)
    return setid.formulate(record.data, model, noise)


def test_sums_are_what_dense_matrices_give() -> None:
    """Weights are read off the sums of target; widths follow from the definition."""
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    noise = setid.Noise(output=np.linspace(0.01, 0.02, 40), input=0.005)
    formulation = second_order(u, 0.1, noise)
    raw, rows = formulation.regression, formulation.smoothed
    assert raw is not None and rows is not None
    count = raw.target.size
    np.testing.assert_array_equal(rows.target[:count], raw.target)
    model, data = formulation.model, formulation.data
    (equation,) = model.equations()
    matrices = {}
    for term in equation.terms:
        (lagged,) = term.signals
        key = "".join(term.parameters), lagged.signal
        table = matrices.setdefault(key, np.zeros((count, 40)))
        table[np.arange(count), raw.row - lagged.lag] += term.coefficient
    weights = np.array([(k + 1) * np.exp(-k / 4.0) for k in range(count)])
    lag = np.subtract.outer(np.arange(count), np.arange(count))
    lower = np.where(lag >= 0, weights[np.maximum(lag, 0)], 0.0)
    lower /= weights.sum()
    output, inputs, _ = noise.bounds(data)
    last = (count - 1) // 2 * 2  # every second sum is kept for length 4
    place = 2 * count + last // 2  # after the rows themselves and the sums for length 1
    assert rows.row[place] == raw.row[last]
    names = model.parameters
    assert rows.target[place] == pytest.approx(lower[last] @ raw.target, abs=1e-12)
    np.testing.assert_allclose(rows.regressors[place], lower[last] @ raw.regressors, atol=1e-12)
    width = np.abs(lower @ matrices["", "y1"]) @ output[:, 0]
    assert rows.radius[place] == pytest.approx(width[last], rel=1e-9)
    for column, name in enumerate(names):
        signal, bound = ("y1", output) if name[0] == "a" else ("u1", inputs)
        width = np.abs(lower @ matrices[name, signal]) @ bound[:, 0]
        assert rows.radii[place, column] == pytest.approx(width[last], rel=1e-9)
        assert rows.radii[place, column] >= width[last]


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.sampled_from([0.02, 0.1, 0.5]),
    st.sampled_from(["free", "zero"]),
    st.sampled_from(["linear", "constant"]),
)
def test_every_truth_obeys_all_sums(seed: int, Ts: float, initial: str, hold: str) -> None:
    """Two records, a missing sample, noise at its bounds."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(0.2, 3.0, 4) * rng.choice([1, 1, 1, -1], 4)
    model = setid.ContinuousTransferFunction(2, 1, initial=initial, hold=hold, Ts=Ts)
    u = rng.uniform(-1, 1, 30)
    y = np.concatenate([setid.simulate(model, theta, part)[:, 0] for part in (u[:18], u[18:])])
    size = 0.05 * np.abs(y).max()
    signs = rng.choice([-1.0, 1.0], (2, 30))
    readings = y + size * signs[0]
    readings[7] = np.nan
    data = setid.IOData(u + 0.01 * signs[1], readings, Ts=Ts, starts=[0, 18])
    formulation = setid.formulate(data, model, setid.Noise(output=size, input=0.01))
    rows = formulation.smoothed
    assert rows is not None and rows.target.size > formulation.regression.target.size
    scale = np.abs(rows.target) + np.abs(rows.regressors) @ np.abs(theta)
    assert np.all(rows.margin(theta) >= -1e-11 * (scale + size))


def test_fast_sampling_is_bounded_by_sums_alone() -> None:
    """90 samples a period: single rows do not even settle the signs."""
    Ts = 0.05
    u = levels(Ts, 13)[:100]
    data = setid.IOData(u, noisy(exact_samples(u, Ts), 0.01), Ts=Ts)
    model = setid.ContinuousTransferFunction(2, 1, hold="constant", delta=1e-3)
    formulation = setid.formulate(data, model, setid.Noise(output=0.01))
    assert formulation.regression is not None and formulation.smoothed is not None
    rows = setid.parameter_box(formulation.regression)
    sums = setid.parameter_box(formulation.smoothed)
    assert np.all((sums.lower <= THETA) & (sums.upper >= THETA))
    assert np.all(4 * (sums.upper - sums.lower) < rows.upper - rows.lower)
    assert np.all(sums.lower > 0) and np.all(rows.lower < 0)
    assert sums.verify(formulation.smoothed, sums.start)


def test_discrete_structures_are_not_summed() -> None:
    data = setid.IOData([1, 2, 3, 1, 2], [0, 1, 1, 2, 1])
    formulation = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(0.1))
    assert formulation.smoothed is formulation.regression
    assert at_rate(formulation.model, 5.0) is formulation.model
