"""Samples that contradict each other where no box of the data alone is empty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from slow_values import slow_after

import setid
from setid.minimum_noise.conflicting_samples import conflicting_samples, samples_listed
from setid.result.reports import conflict
from sparsepop_py.budget import Deadline

QUICK = setid.Options(time_limit=60.0, progress=False)
ONE, TWO = setid.TransferFunction(1, 1, 1), setid.TransferFunction(2, 2, 1)
OUTPUT, BOTH = setid.Noise(output=0.1), setid.Noise(output=0.1, input=0.02)


def least_level(result: setid.Identification, a: float, b: float) -> float:
    """The least factor on the noise bounds with which a1, b1 pass the rows of the samples.

    An independent linear program: rows y~_k - eta_k + a (y~_{k-1} - eta_{k-1}) =
    b (u~_{k-1} - xi_{k-1}), noise scaled to [-s, s].
    """
    data, noise = result.formulation.data, result.formulation.noise
    y, u, count = data.y.ravel(), data.u.ravel(), data.samples
    output, below = float(noise.output), float(noise.input)
    matrix = np.zeros((len(result.samples), 2 * count + 1))
    right = np.zeros(len(result.samples))
    for row, (_, k) in enumerate(result.samples):
        matrix[row, k], matrix[row, k - 1] = output, a * output
        matrix[row, count + k - 1] = -b * below
        right[row] = y[k] + a * y[k - 1] - b * u[k - 1]
    limits = np.vstack([np.eye(2 * count), -np.eye(2 * count)])
    limits = np.hstack([limits, -np.ones((4 * count, 1))])
    cost = np.append(np.zeros(2 * count), 1.0)
    free = [(None, None)] * (2 * count) + [(0.0, None)]
    found = linprog(cost, limits, np.zeros(4 * count), matrix, right, free, method="highs")
    return float(found.fun)


def check(result: setid.Identification, truth: setid.Simulated) -> None:
    """Empty by the engine, and no pair on a grid passes the rows of the samples alone."""
    assert result.empty and result.results and bool(result.verify(truth.data))
    rows = set(
        zip(*(getattr(result.formulation.rows, n) for n in ("record", "sample")), strict=True)
    )
    named = {(record, k + 1) for record, k in result.samples}  # rows count samples from 1
    assert named <= rows and 2 < len(result.samples) < len(rows)
    shown, more = ", ".join(str(k) for _, k in result.samples[:12]), len(result.samples) - 12
    shown += f" and {more} more" if more > 0 else ""
    assert f"samples that contradict each other: {shown}\n" in result.summary() + "\n"
    grid = [(a, b) for a in np.linspace(-1, 0, 11) for b in np.linspace(0.2, 2.2, 11)]
    assert min(least_level(result, a, b) for a, b in grid) > 1.0


def test_sentences_name_records_and_count_what_they_leave_out() -> None:
    many = tuple((1 + k // 10, k) for k in range(15))
    assert samples_listed(many[:3], 1) == "0, 1, 2"
    assert samples_listed(many[9:11], 2) == "1:9, 2:10"
    assert samples_listed(many, 2).endswith("1:9, 2:10, 2:11 and 3 more")


@pytest.mark.parametrize("noise", slow_after(1, [OUTPUT, BOTH]))
def test_a_wrong_order(noise: setid.Noise) -> None:
    u = np.random.default_rng(3).uniform(-1, 1, 16)
    truth = setid.simulate_record(TWO, [-0.6, 0.1, 1.0, 0.15], u, noise, 3)
    check(setid.identify(truth.data, ONE, noise, options=QUICK), truth)


@pytest.mark.parametrize(
    ("noise", "factor"), [(OUTPUT, 0.57), pytest.param(BOTH, 0.61, marks=pytest.mark.slow)]
)
def test_too_small_a_noise_bound(noise: setid.Noise, factor: float) -> None:
    u = np.random.default_rng(1).uniform(-1, 1, 16)
    truth = setid.simulate_record(ONE, [-0.6, 1.0], u, noise, 1)
    small = setid.Noise(output=factor * noise.output, input=factor * noise.input)
    check(setid.identify(truth.data, ONE, small, options=QUICK), truth)


def test_the_whole_record_where_there_is_no_time() -> None:
    noise = setid.Noise(output=0.1)
    u = np.random.default_rng(3).uniform(-1, 1, 12)
    truth = setid.simulate_record(ONE, [-0.6, 1.0], u, noise, 3)
    formulation = setid.formulate(truth.data, ONE, noise)
    everything = tuple((1, k) for k in range(2, 13))
    assert (
        conflicting_samples(formulation, QUICK.for_engine("absolute"), Deadline(0.0)) == everything
    )
    two = setid.TransferFunction(1, 1, 1, inputs=2)  # separate denominators: no rows in theta
    data = setid.IOData(np.c_[u, u[::-1]], truth.data.y)
    other = replace(setid.formulate(data, two, noise), regression=None)
    assert (1, 12) in conflicting_samples(other, QUICK.for_engine("absolute"), Deadline(5.0))


def test_an_interrupt_keeps_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("setid.minimum_noise.conflicting_samples._proved_empty", interrupt)
    u = np.random.default_rng(3).uniform(-1, 1, 16)
    truth = setid.simulate_record(TWO, [-0.6, 0.1, 1.0, 0.15], u, OUTPUT, 3)
    result = setid.identify(truth.data, ONE, OUTPUT, options=QUICK)
    assert result.empty and len(result.samples) == 15


def factor_of_rows(result: setid.Identification, poles: dict[str, float]) -> float:
    """The least factor on the noise bounds with which the named rows hold, poles given.

    An independent linear program: with the denominators fixed the rows are linear.
    """
    formulation = result.formulation
    keys = {(record, k + 1) for record, k in result.samples}  # rows count samples from 1
    problem, count = formulation.problem, formulation.problem.dimension
    p = len(formulation.parameters)
    place = {formulation.parameters.index(name): value for name, value in poles.items()}
    pairs = zip(formulation.rows.record.tolist(), formulation.rows.sample.tolist(), strict=True)
    rows = [c for c, key in zip(problem.constraints, pairs, strict=True) if key in keys]
    matrix, right = np.zeros((len(rows), count + 1)), np.zeros(len(rows))
    for number, row in enumerate(rows):
        terms = zip(row.polynomial.words.tolist(), row.polynomial.coefficients, strict=True)
        for word, value in terms:
            used = [letter - 1 for letter in word if letter]
            value = value * np.prod([place[v] for v in used if v in place])
            rest = [v for v in used if v not in place]
            if rest:
                matrix[number, rest[0]] += value
            else:
                right[number] -= value
    bounds = [(None, None)] * p + [(None, None)] * (count - p) + [(0.0, None)]
    noise = np.eye(count + 1)[p:count]
    reach = np.zeros_like(noise)
    reach[:, -1] = problem.upper[p:]
    limits = np.vstack([noise - reach, -noise - reach])
    cost = np.append(np.zeros(count), 1.0)
    none = np.zeros(len(limits))
    return float(linprog(cost, limits, none, matrix, right, bounds, method="highs").fun)


@pytest.mark.parametrize(
    ("seed", "two"), [pytest.param(26, True, marks=pytest.mark.slow), (200, False)]
)
def test_rows_that_are_named_contradict_each_other_alone(seed: int, two: bool) -> None:
    """The last programs stand on a box that other rows made: theirs alone may be consistent."""
    block = setid.TransferFunction(1, 1, 1)
    model = TWO
    if two:
        wires = {("y1", "u1"): block, ("y1", "u2"): block}
        model = setid.BlockStructured(wires, {}, inputs=2, form="direct")
    source = np.random.default_rng(seed)
    u = source.uniform(-1, 1, (8 + seed % 6, model.inputs)).round(2)
    noise = setid.Noise(output=0.02)
    theta = np.array([source.uniform(-0.9, 0.9), source.uniform(-0.4, 0.4), 0.7, 0.5])
    y = setid.simulate_record(model, theta, u, noise, seed).data.y.round(3)
    low = round(
        float(np.clip(theta[0] + source.choice([-1, 1]) * source.uniform(0.03, 0.3), -0.9, 0.8)), 2
    )
    first, second = model.parameters[:2]
    box = setid.Box({first: (low, low + 0.1), second: (-1.0, 1.0)})
    result = setid.identify(setid.IOData(u, y), model, noise, [box], QUICK)
    assert result.empty and result.samples and bool(result.verify())
    grid = [(a, b) for a in np.linspace(low, low + 0.1, 6) for b in np.linspace(-1, 1, 41)]
    assert min(factor_of_rows(result, {first: a, second: b}) for a, b in grid) > 1.0


def test_a_whole_record_is_not_listed_as_its_samples() -> None:
    u = np.arange(15.0)
    known = setid.formulate(setid.IOData(u, u), setid.TransferFunction(1, 1), setid.Noise(output=1))
    every = tuple((1, k) for k in range(1, 15))  # the first sample has no row
    assert conflict(every, known).startswith(
        "the equations of 14 samples, all that there are, contradict"
    )
    assert conflict(every[:2], known) == "samples that contradict each other: 1, 2"
