"""Hidden weights of smooth networks: planted and sampled ones stay inside, forgeries are found."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from interrupted_programs import InterruptedPrograms
from slow_values import slow_after

import setid
from setid import neural
from setid.neural.arithmetic import Interval
from setid.neural.training import smooth_members, smooth_weights
from setid.neural.training.smooth_weights import WeightStep

PHI = {
    "tanh": np.tanh,
    "sigmoid": lambda a: 1.0 / (1.0 + np.exp(-a)),
    "algebraic": lambda a: a / np.sqrt(1.0 + a * a),
}
TRUTH = {"w1_1": 0.4, "w1_2": 0.8, "w1_3": -0.5, "b1": 0.2, "v1": 1.5, "c": 0.1}


def planted(name: str, rows: int, noise: float) -> setid.IOData:
    """Record of y_t = 1.5 phi(.4 y_(t-1) + .8 u_t - .5 u_(t-1) + .2) + .1 + noise."""
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-2, 2, rows + 1), np.zeros(rows + 1)
    for t in range(1, rows + 1):
        a = 0.4 * y[t - 1] + 0.8 * u[t] - 0.5 * u[t - 1] + 0.2
        y[t] = 1.5 * PHI[name](a) + 0.1 + noise * rng.uniform(-1, 1)
    return setid.IOData(u, y)


def structure(name: str, width: int = 1) -> neural.NNARX:
    parts = [np.ones((width, 3)), np.ones((1, width))], [np.zeros(width), [0.0]]
    return neural.NNARX(neural.Network(*parts, name), 1)


@pytest.fixture(scope="module", autouse=True)
def counted_time() -> Iterator[None]:
    """Let a search see 1/100 s more at each look at the clock, so that every machine goes as far.

    A hundred looks are a second of the limit; they take from .4 to 2 s.
    """
    ticks = itertools.count()
    clock = SimpleNamespace(monotonic=lambda: 0.01 * next(ticks))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smooth_weights, "time", clock)
        patch.setattr(smooth_members, "time", SimpleNamespace(monotonic=lambda: 0.0))
        yield


@pytest.fixture(scope="module")
def found(counted_time: None) -> neural.SmoothHiddenWeights:
    return neural.hidden_weights(
        structure("tanh"), planted("tanh", 30, 0.02), 0.03, weights=2.0, time_limit=5.6
    )


def test_planted_and_other_networks_stay_inside(found: neural.SmoothHiddenWeights) -> None:
    assert found.verify()
    assert list(found.intervals) == list(TRUTH)
    for name, value in TRUTH.items():
        assert found.intervals[name].outer[0] <= value <= found.intervals[name].outer[1]
    # negative weights of u_t with v >= 0 are excluded by the first bisections
    assert found.intervals["w1_2"].outer[0] >= -0.5
    data, rng, kept = found.data, np.random.default_rng(1), 0
    full = np.column_stack([data.y[:-1], data.u[1:], data.u[:-1], np.ones(data.samples - 1)])
    for _ in range(20_000):
        x = np.array(list(TRUTH.values())) + rng.uniform(-0.02, 0.02, 6)
        rest = data.y[1:, 0] - x[4] * np.tanh(full @ x[:4]) - x[5]
        if np.abs(rest).max() <= 0.03:
            kept += 1
            for item, value in zip(found.intervals.values(), x, strict=True):
                assert item.outer[0] <= value <= item.outer[1]
    assert kept >= 20


def test_inner_ends_are_attained(found: neural.SmoothHiddenWeights) -> None:
    data = found.data
    full = np.column_stack([data.y[:-1], data.u[1:], data.u[:-1], np.ones(data.samples - 1)])
    for x in found.members:
        assert np.abs(data.y[1:, 0] - x[4] * np.tanh(full @ x[:4]) - x[5]).max() <= 0.03
    for place, (name, item) in enumerate(found.intervals.items()):
        assert item.inner == (found.members[:, place].min(), found.members[:, place].max())
        assert item.inner[0] <= TRUTH[name] + 1e-3 and item.inner[1] >= TRUTH[name] - 1e-3
        assert item.inner[1] - item.inner[0] > 1e-3


def test_ends_of_the_last_layer_are_bounded(found: neural.SmoothHiddenWeights) -> None:
    """Boxes that are empty but for rounding have multipliers for both ends, too.

    Without these the ends were those of the range, v in [0, 2] and c beyond -3 and 3.
    """
    for name in ("v1", "c"):
        assert np.ptp(found.intervals[name].outer) <= 1.0


@pytest.mark.slow
def test_all_weights_of_a_tanh_neuron_are_certified() -> None:
    data = planted("tanh", 30, 0.02)
    found = neural.hidden_weights(structure("tanh"), data, 0.03, weights=2.0, time_limit=200.0)
    assert found.status == "proved" and found.verify()
    for name, item in found.intervals.items():
        assert item.outer[0] <= TRUTH[name] <= item.outer[1]
        assert np.ptp(item.outer) <= 1.001 * np.ptp(item.inner)


def test_the_distance_from_the_lines_is_said(found: neural.SmoothHiddenWeights) -> None:
    for text in (found.assumptions[-1], repr(found)):
        shown = float(text.split("tanh within ")[1].split()[0].rstrip(":"))
        assert found.eps <= shown <= 1.1 * found.eps
    assert not replace(found, eps=0.5 * found.eps).verify()


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "algebraic"])
def test_what_no_network_explains_is_proved_empty(name: str) -> None:
    y = np.where(np.arange(9) % 2, 6.0, 0.0)
    data = setid.IOData(np.random.default_rng(0).uniform(-1, 1, 9), y)
    found = neural.hidden_weights(structure(name), data, 0.5, weights=2.0)
    assert found.status == "empty" and found.verify() and not len(found.members)
    assert not replace(found, steps=(WeightStep(),)).verify()
    halved = replace(found.steps[0], dual=np.zeros_like(found.steps[0].dual))
    assert not replace(found, steps=(halved, *found.steps[1:])).verify()


@pytest.mark.parametrize("name", slow_after(1, ["sigmoid", "algebraic"]))
def test_other_smooth_neurons(name: str) -> None:
    data = planted(name, 20, 0.01)
    found = neural.hidden_weights(structure(name), data, 0.012, weights=2.0, time_limit=1.0)
    assert found.status == "partial" and found.verify()
    for key, value in TRUTH.items():
        assert found.intervals[key].outer[0] <= value <= found.intervals[key].outer[1]


@pytest.mark.slow
def test_two_neurons_are_ordered() -> None:
    data = planted("tanh", 12, 0.02)
    found = neural.hidden_weights(structure("tanh", 2), data, 0.03, weights=2.0, time_limit=2.0)
    assert found.verify() and len(found.members)
    assert np.all(found.members[:, 0] >= found.members[:, 4])  # w1_1 >= w2_1
    assert np.all(found.members[:, 8:10] >= 0.0)
    x = np.array([0.4, 0.8, -0.5, 0.2, -0.5, 0.3, 0.1, 0.0, 1.5, 0.0, 0.1])  # v2 = 0
    for item, value in zip(found.intervals.values(), x[[0, 1, 2, 4, 5, 6, 3, 7, 8, 9, 10]],
                           strict=True):  # fmt: skip
        assert item.outer[0] <= value <= item.outer[1]


def test_forged_intervals_are_found(found: neural.SmoothHiddenWeights) -> None:
    item = found.intervals["w1_1"]
    for outer in ((item.inner[0], item.outer[1]), (item.outer[0], item.inner[1])):
        forged = setid.ParameterInterval("w1_1", outer, item.inner, item.status)
        assert not replace(found, intervals={**found.intervals, "w1_1": forged}).verify()
    beyond = found.members.copy()
    beyond[0, 4] += 1.0
    assert "member" in replace(found, members=beyond).verify().reason


def test_steps_without_proof_leave_all_weights(found: neural.SmoothHiddenWeights) -> None:
    """Steps whose multipliers are gone, whose boxes are lost or used twice, exclude nothing."""
    bare = tuple(replace(s, dual=np.zeros_like(s.dual), ends=s.ends[:0]) for s in found.steps)
    lost = (replace(found.steps[0], children=(7, 10**6)), *found.steps[1:])
    twice = (replace(found.steps[0], children=(1, 1)), *found.steps[1:])
    back = (replace(found.steps[0], children=(0, 1)), *found.steps[1:])
    for steps in (bare, lost, twice, back, found.steps[:1]):
        assert not replace(found, steps=steps).verify()


def test_cuts_without_proof_are_not_believed() -> None:
    """Whatever the multipliers are, a cut never excludes the planted network."""
    data, hidden = planted("tanh", 30, 0.02), np.array([0.4, 0.8, -0.5, 0.2])
    task = smooth_weights._Task.of(structure("tanh"), data, 0.03, 2.0)
    box, rng = Interval(hidden - 0.12, hidden + 0.12), np.random.default_rng(0)
    rows = task.program.rows(box)[1].size
    for entry in range(4):
        for side in (1.0, -1.0):
            cuts = np.array([[entry, side, hidden[entry] + 0.06 * side]])
            for dual in (np.zeros((1, rows)), rng.normal(size=(1, rows))):
                left = task.after(WeightStep((1,), cuts=cuts, dual=dual), box)
                assert left is not None
                assert np.all(left.lo <= hidden) and np.all(hidden <= left.hi)


@pytest.mark.parametrize("at", [np.nan, np.inf, -np.inf])
def test_branches_at_no_number_leave_all_weights(at: float) -> None:
    """Comparisons with no number are false: both halves would count as wrongly ordered."""
    task = smooth_weights._Task.of(structure("tanh", 2), planted("tanh", 12, 0.02), 0.03, 2.0)
    low, high, _ = task.drawn((WeightStep((1, 2), 4, at), WeightStep(), WeightStep()))
    assert np.all(low[:8] == -2.0) and np.all(high[:8] == 2.0)


def test_proofs_are_about_their_structure_and_say_their_assumptions(
    found: neural.SmoothHiddenWeights,
) -> None:
    given = found.net.network
    deep = neural.Network([*given.weights, [[1.0]]], [*given.biases, [0.0]], "tanh")
    bent = neural.Network(given.weights, given.biases, ["tanh", "relu"])
    sharp = neural.Network(given.weights, given.biases, "relu")
    none = found.members[:0]
    for other in (deep, bent, sharp):
        forged = replace(found, net=neural.NNARX(other, 1), members=none)
        assert "structure" in forged.verify().reason
    for number in range(len(found.assumptions)):
        fewer = found.assumptions[:number] + found.assumptions[number + 1 :]
        assert "assumption" in replace(found, assumptions=fewer).verify().reason
    assert "positive" in replace(found, bound=np.nan).verify().reason


def test_interrupts_keep_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    programs = InterruptedPrograms(monkeypatch)
    for last in (2, 300):
        programs.interrupt(last)
        data = planted("tanh", 12, 0.02)
        part = neural.hidden_weights(structure("tanh"), data, 0.03, weights=2.0, time_limit=2.0)
        assert part.verify() and part.status == "partial" and programs.count == last
        for name, value in TRUTH.items():
            assert part.intervals[name].outer[0] <= value <= part.intervals[name].outer[1]
