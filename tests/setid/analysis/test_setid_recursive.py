"""Online identification: the same set as from the whole record, faults found, cost bounded."""

from __future__ import annotations

import copy
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt
import numpy as np
import pytest
from prior_cases import Never
from slow_values import slow_after

import setid
import sparsepop_py as sp
from sparsepop_py.errors import SparsePOPError

MODEL = setid.TransferFunction(na=1, nb=1, nk=1)
THETA = (-0.7, 1.0)


def record(noise: setid.Noise, samples: int, seed: int = 0) -> setid.IOData:
    u = np.random.default_rng(seed).uniform(-1, 1, samples)
    return setid.simulate_record(MODEL, THETA, u, noise, seed).data


def fed(online: setid.Recursive, data: setid.IOData) -> setid.Recursive:
    online.update(data.u[:, 0], data.y[:, 0])
    return online


def test_equation_errors_give_the_set_of_the_whole_record() -> None:
    noise = setid.Noise(equation=0.1)
    data = record(noise, 150)
    online = fed(setid.Recursive(MODEL, noise, limit=16), data)
    whole = setid.identify(data, MODEL, noise)
    assert online.exact and online.samples == 150 and len(online.retained) <= 16
    for name, item in whole.intervals.items():
        assert online.intervals[name].outer == pytest.approx(item.outer, rel=1e-12)
        assert online.intervals[name].inner is None  # samples were left out: not proved
    assert online.verify() and online.cost.solved < 100


def test_attained_ends_are_claimed_as_long_as_no_sample_is_left_out() -> None:
    noise = setid.Noise(equation=0.1)
    online = fed(setid.Recursive(MODEL, noise), record(noise, 20))
    assert online.complete
    assert all(str(i.status) == "certified" for i in online.intervals.values())
    whole = setid.identify(record(noise, 20), MODEL, noise)
    assert repr(online.intervals["a1"]) == repr(whole.intervals["a1"])


@pytest.mark.parametrize(
    "noise",
    slow_after(1, [setid.Noise(output=0.05, input=0.02, equation=0.01), setid.Noise(output=0.05)]),
)
def test_noisy_sensors_keep_the_truth_in_a_box_that_only_shrinks(noise: setid.Noise) -> None:
    data = record(noise, 80, 3)
    online = setid.Recursive(MODEL, noise, limit=20)
    before = np.array([[-np.inf] * 2, [np.inf] * 2])
    for u, y in zip(data.u[:, 0], data.y[:, 0], strict=True):
        assert online.update(u, y)
        low, high = online.box
        assert np.all(low >= before[0]) and np.all(high <= before[1])
        assert np.all(low <= THETA) and np.all(high >= THETA)
        before = np.array([low, high])
    assert np.all(np.isfinite(before)) and online.verify() and len(online.retained) <= 20


def test_priors_bound_the_first_box() -> None:
    online = setid.Recursive(MODEL, setid.Noise(output=0.1), [setid.Box({"a1": (-1, 1)})])
    assert online.update(1.0, 0.0) and online.update(0.0, 1.0)
    low, high = online.intervals["a1"].outer
    assert low >= -1 and high <= 1 and online.verify()


def test_a_fault_is_found_at_the_sample_that_proves_it() -> None:
    noise = setid.Noise(equation=0.02)
    good, other = record(noise, 40, 1), record(noise, 40, 2)
    u = np.concatenate([good.u[:, 0], other.u[:, 0]])
    y = [0.0]
    errors = np.random.default_rng(5).uniform(-0.02, 0.02, 80)
    for k in range(1, 80):
        a, b = (-0.7, 1.0) if k < 40 else (-0.2, 1.0)  # the pole jumps
        y.append(-a * y[-1] + b * u[k - 1] + errors[k])
    online = setid.Recursive(MODEL, noise)
    where = next(k for k in range(80) if not online.update(u[k], y[k]))
    assert online.inconsistent_at == where >= 40
    assert all(str(i.status) == "empty" for i in online.intervals.values())
    assert online.verify() and f"inconsistent at sample {where}" in online.summary()
    # the first sample at which the record up to it refutes the structure, and not one before
    refuted = setid.IOData(u[: where + 1], y[: where + 1])
    assert setid.identify(refuted, MODEL, noise).empty
    assert not setid.identify(setid.IOData(u[:where], y[:where]), MODEL, noise).empty
    assert not online.update(0.0, 0.0)
    online.restart()
    assert online.update(0.0, 0.0) and online.inconsistent_at is None


def test_a_window_forgets_what_an_older_plant_said() -> None:
    noise = setid.Noise(equation=0.05)
    online = setid.Recursive(MODEL, noise, window=10)
    data = record(noise, 40)
    fed(online, data)
    assert min(online.retained) >= 40 - 10
    tail = setid.IOData(data.u[-11:, 0], data.y[-11:, 0])  # ten rows
    whole = setid.identify(tail, MODEL, noise)
    for name, item in whole.intervals.items():
        assert online.intervals[name].outer == pytest.approx(item.outer, rel=1e-12)
    assert online.verify()


def test_claims_that_were_tampered_with_do_not_verify() -> None:
    noise = setid.Noise(equation=0.1)
    online = fed(setid.Recursive(MODEL, noise), record(noise, 20))
    claim, used = online._claims[0]
    low, high = claim.intervals["a1"].outer
    forged = dict(claim.intervals)
    forged["a1"] = setid.ParameterInterval(
        "a1", (0.5 * (low + high), high), None, setid.IntervalStatus.PARTIAL
    )
    from dataclasses import replace

    online._claims = [(replace(claim, intervals=forged), used)]
    assert not online.verify()


def test_claims_are_about_the_structure_noise_and_priors_that_are_said() -> None:
    """A smaller noise bound beside older claims once verified."""
    online = setid.Recursive(setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    online.update([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    assert online.verify()
    for field, other, why in (
        ("noise", setid.Noise(equation=0.1), "noise"),
        ("priors", (setid.Known({"b0": 2.0}),), "priors"),
        ("model", setid.TransferFunction(1, 1, 1), "structure"),
        ("Ts", 2.0, "structure"),
        ("inconsistent_at", 3, "does not follow"),
    ):
        changed = copy.copy(online)
        setattr(changed, field, other)
        assert why in changed.verify().reason
    online.restart()
    online.inconsistent_at = 0
    assert online.verify().reason == "inconsistency does not follow"


def test_attained_ends_are_not_claimed_again_by_hand() -> None:
    """Of 40 samples of a plant with b0 = 2 at most 16 are retained: the ends are theirs."""
    rng, model = np.random.default_rng(0), setid.TransferFunction(1, 1)
    u = rng.uniform(-1.0, 1.0, 40)
    y = setid.simulate(model, [-0.5, 2.0], u, rng.uniform(-0.1, 0.1, 40))
    online = setid.Recursive(model, setid.Noise(equation=0.1), limit=16)
    online.update(u, y)
    assert not online.complete and online.verify()
    online.complete = True
    assert "left out" in online.verify().reason


def test_missing_readings_and_several_channels() -> None:
    model = setid.TransferFunction(
        na=[[1, 1]], nb=[[1, 1]], nk=1, inputs=2, common_denominator=True
    )
    u = np.random.default_rng(0).uniform(-1, 1, (40, 2))
    theta = [-0.5, 1.0, -2.0]
    noise = setid.Noise(equation=0.05)
    truth = setid.simulate_record(model, theta, u, noise)
    y = truth.data.y.copy()
    y[7] = np.nan
    online = setid.Recursive(model, noise)
    assert online.update(u, y[:, 0])
    whole = setid.identify(setid.IOData(u, y), model, noise)
    for name, item in whole.intervals.items():
        assert online.intervals[name].outer == pytest.approx(item.outer, rel=1e-12)
    assert online.verify()


def test_structures_of_many_parameters_need_no_limit_of_their_own() -> None:
    model = setid.TransferFunction(na=2, nb=2, nk=1, offset=True)
    online = setid.Recursive(model, setid.Noise(equation=0.1))
    assert online.limit == 4 * 5**2
    assert setid.Recursive(MODEL, setid.Noise(equation=0.1)).limit == 60


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda: setid.Recursive(MODEL, setid.Noise(equation=0.1), limit=3), "limit"),
        (lambda: setid.Recursive(MODEL, setid.Noise(equation=np.ones((3, 1)))), "one a sample"),
        (lambda: setid.Recursive(MODEL, setid.Noise(equation=[0.1, 0.2])), "found 2 bounds"),
        (
            lambda: setid.Recursive(MODEL, setid.Noise(input=[0.1, 0.2, 0.3])),
            "noise.input: found 3",
        ),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1), [setid.Box({"zz": (0, 1)})]), "'zz'"),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1), [setid.Known({"b0": 1})]), "'b0'"),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1), [3]), r"priors\[0\]: found int"),
        (
            lambda: setid.Recursive(MODEL, setid.Noise(0.1), sp.variables(3)[2] >= 0),
            "a constraint in 3 variables, expected 2",
        ),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1), executor=3), "executor: found 3"),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1), window=0), "window"),
        (
            lambda: setid.Recursive(
                setid.TransferFunction(1, 1, 0, inputs=2), setid.Noise(output=0.1)
            ),
            "regression form",
        ),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1)).update([1.0, 2.0], [1.0]), "samples"),
        (lambda: setid.Recursive(MODEL, setid.Noise(0.1)).update(np.eye(2), [1.0, 2.0]), "shape"),
    ],
)
def test_wrong_input_is_refused(make: object, why: str) -> None:
    with pytest.raises(setid.SetidError, match=why):
        make()  # type: ignore[operator]


def test_a_picture_shows_the_intervals_over_the_samples() -> None:
    noise = setid.Noise(equation=0.1)
    online = fed(setid.Recursive(MODEL, noise), record(noise, 20))
    ax = online.plot()
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"a1", "b1"}
    plt.close("all")


@pytest.mark.parametrize("noise", [setid.Noise(output=0.1), setid.Noise(input=0.1)])
def test_a_parameter_that_no_sample_tells_of_keeps_what_priors_say(noise: setid.Noise) -> None:
    """y_k + a1 y_(k-1) = b0 u_k at rest says nothing of a1, and without input nothing of b0."""
    model, quiet = setid.TransferFunction(na=1, nb=1), noise.output == 0.1
    u, y = ([0.0, 0.0], [1.0, 0.5]) if quiet else ([1.0, 1.0], [0.0, 1.5])
    unknown = "b0" if quiet else "a1"
    for priors, outer in (((), (-np.inf, np.inf)), (setid.Box({unknown: (-3, 2)}), (-3, 2))):
        online = setid.Recursive(model, noise, priors)
        assert online.update(u, y) and online.verify()
        assert online.intervals[unknown].outer == outer


def test_an_update_that_raises_leaves_everything_as_it_was() -> None:
    noise = setid.Noise(equation=0.1)
    data = record(noise, 12)
    with ThreadPoolExecutor(1) as executor:
        online = setid.Recursive(MODEL, noise, executor=executor, window=5)
        online.update(data.u[:8], data.y[:8])
        before, shown = dict(vars(online)), online.summary()
    with pytest.raises(SparsePOPError, match="takes no tasks any more"):
        online.update(data.u[8:], data.y[8:])
    assert online.samples == 8 and online.summary() == shown and online.verify()
    assert all(vars(online)[key] is value for key, value in before.items())
    assert online.retained == (3, 4, 5, 6, 7)


def test_bounds_of_two_channels_are_not_taken_for_those_of_two_samples() -> None:
    """One window of this structure has as many samples as there are outputs."""
    model = setid.TransferFunction(1, 1, 1, outputs=2)
    u = np.random.default_rng(4).uniform(-1, 1, 20)
    bounds = [0.02, 0.3]
    truth = setid.simulate_record(model, [-0.5, 1.0, 0.2, 2.0], u, setid.Noise(equation=bounds))
    online = setid.Recursive(model, setid.Noise(equation=bounds))
    assert online.update(truth.data.u, truth.data.y) and online.verify()
    whole = setid.identify(truth.data, model, setid.Noise(equation=bounds))
    for name, item in whole.intervals.items():
        assert online.intervals[name].outer == pytest.approx(item.outer, rel=1e-12)


def test_a_window_has_no_rows_of_an_older_plant() -> None:
    """y1 = b u with b = 1, then 3; the lags of y2 = u(k - 4) keep samples before the window."""
    k, window, change = np.arange(20), 5, 12
    u = np.where(k < change, 1.0, 0.5) * (-1.0) ** k
    y = np.column_stack([np.where(k < change, 1.0, 3.0) * u, np.append(np.zeros(4), u[:-4])])
    model = setid.TransferFunction(0, [[1], [1]], [[0], [4]], outputs=2)
    online = setid.Recursive(model, setid.Noise(equation=1.0), window=window)
    for sample in range(20):
        assert online.update(u[sample], y[sample])
        if sample >= change + window - 1:
            low, high = online.intervals["b[1,1]0"].outer
            assert low <= 3.0 <= high and not online.exact and online.verify()
    with pytest.raises(setid.SetidError, match="window"):
        setid.Recursive(model, setid.Noise(equation=1.0), window=4)


def test_a_missing_reading_leaves_no_exact_set() -> None:
    """y(2) = a^2 y(0) within 2: a row that only elimination of y(1) shows."""
    online = setid.Recursive(setid.TransferFunction(1, 1), setid.Noise(equation=1.0))
    online.update([0.0, 0.0, 0.0], [1.0, np.nan, 0.5])
    assert not online.exact and "outer box" in online.summary()


def test_nothing_is_attained_where_priors_mean_more_than_rows() -> None:
    noise = setid.Noise(equation=0.1)
    data = record(noise, 12)
    online = fed(setid.Recursive(MODEL, noise, [Never()]), data)
    plain = fed(setid.Recursive(MODEL, noise), data)
    assert online.verify() and not online.exact
    for name, item in online.intervals.items():
        low, high = plain.intervals[name].outer
        assert item.inner is None and item.outer[0] <= low and high <= item.outer[1]


@pytest.mark.slow
def test_continuous_structures_take_the_interval_of_either_place() -> None:
    found = []
    for inside, outside in ((None, 0.1), (0.1, None), (0.1, 0.1)):
        model = setid.ContinuousTransferFunction(1, 0, hold="constant", delta=0.01, Ts=inside)
        recursive = setid.Recursive(model, setid.Noise(output=0.1), setid.Stable(), Ts=outside)
        for k in range(40):
            recursive.update(float((-1) ** (k // 7)), 0.2 * k)
        assert recursive.Ts == 0.1
        found.append([interval.outer for interval in recursive.intervals.values()])
    assert found[0] == found[1] == found[2]
    with pytest.raises(setid.ModelError, match="Ts: found None"):
        setid.Recursive(setid.ContinuousTransferFunction(1, 0), setid.Noise(output=0.1))


def test_structures_without_a_regression_form_are_named_with_what_would_do() -> None:
    apart = setid.TransferFunction(1, 1, 1, inputs=2)
    with pytest.raises(setid.ModelError, match="TransferFunction without .*common_denominator"):
        setid.Recursive(apart, setid.Noise(equation=0.1))
    together = setid.TransferFunction(1, 1, 1, inputs=2, common_denominator=True)
    assert setid.Recursive(together, setid.Noise(equation=0.1)).update([1, 2], 0)


def test_before_the_first_equation_priors_bound_and_nothing_else_is_claimed() -> None:
    """With a1 in [-1, 1] by a prior it is false that consistent a1 of any size exist."""
    priors = [setid.Stable(), setid.Box({"b1": (0, 3)}), setid.Box({"b1": (1, None)})]
    noise = setid.Noise(equation=0.1)
    online = setid.Recursive(MODEL, noise, priors)
    for _ in range(2):
        assert online.intervals["a1"].outer == (-1.0, 1.0)
        assert online.intervals["b1"].outer == (1.0, 3.0)
        assert {str(item.status) for item in online.intervals.values()} == {"partial"}
        online.update(1.0, np.nan)
    free = setid.Recursive(MODEL, noise)
    assert str(free.intervals["a1"].status) == "unbounded" and "no equation" in free.summary()
    free.update([1.0, 1.0], [np.nan, 1.0])  # what the missing reading leaves open is not known
    assert str(free.intervals["a1"].status) == "partial"


def test_the_summary_does_not_say_that_each_sample_cut_the_box() -> None:
    """y = b1 u: the second sample says what the first one says."""
    model = setid.TransferFunction(na=0, nb=1, nk=0)
    online = setid.Recursive(model, setid.Noise(equation=0.1))
    online.update(1.0, 1.0)
    before = online.box
    online.update(1.0, 1.0)
    assert np.array_equal(before, online.box) and online.cost.solved == 2
    assert "cut the box" not in online.summary()
    assert "bounds computed anew at 2 of them" in online.summary()


def test_samples_in_pairs() -> None:
    online = setid.Recursive(setid.TransferFunction(1, 1, 1), setid.Noise(equation=0.1))
    with pytest.raises(setid.DataError, match="found 2 and 1 samples, expected equal numbers"):
        online.update([1.0, 2.0], [1.0])
    assert online.samples == 0
