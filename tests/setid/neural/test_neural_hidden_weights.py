"""Hidden weights against enumeration of all patterns, planted networks and forged results."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from interrupted_programs import InterruptedPrograms
from scipy.optimize import linprog

import setid
from setid import neural
from setid.neural.branching import DualNode
from setid.neural.training import hidden_weights


def planted(rows: int, seed: int, slopes: list[list[float]], signs: list[float], leak: float,
            noise: float) -> setid.IOData:  # fmt: skip
    """Record of y_t = sum_j s_j phi(w_j [y_(t-1), u_t, u_(t-1), 1]) + 0.1 + noise."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, rows + 1), np.zeros(rows + 1)
    for t in range(1, rows + 1):
        z = np.array(slopes) @ [y[t - 1], u[t], u[t - 1], 1.0]
        y[t] = np.where(z >= 0, z, leak * z) @ np.array(signs) + 0.1 + noise * rng.uniform(-1, 1)
    return setid.IOData(u, y)


def structure(width: int, leak: float) -> neural.NNARX:
    kind = "leaky_relu" if leak else "relu"
    parts = [np.ones((width, 3)), np.ones((1, width))], [np.zeros(width), [0.0]]
    return neural.NNARX(neural.Network(*parts, kind, leak=leak or 0.01), 1)


def enumerated(data: setid.IOData, leak: float, bound: float, reach: float) -> np.ndarray:
    """Ends (2, 5) of [w, b, c] for one neuron: a linear program for each pattern and sign."""
    full = np.column_stack([data.y[:-1], data.u[1:], data.u[:-1], np.ones(data.samples - 1)])
    y, count = data.y[1:, 0], data.samples - 1
    ends = np.array([np.full(5, np.inf), np.full(5, -np.inf)])
    for sign in (1.0, -1.0):
        for pattern in product([1.0, -1.0], repeat=count):
            on = np.array(pattern)[:, None]
            out = np.column_stack([sign * np.where(on > 0, 1.0, leak) * full, np.ones(count)])
            side = np.column_stack([-on * full, np.zeros(count)])
            rows = np.vstack([out, -out, side])
            right = np.concatenate([y + bound, bound - y, np.zeros(count)])
            ranges = [(-reach, reach)] * 4 + [(None, None)]
            for i in range(5):
                for k, direction in enumerate((1.0, -1.0)):
                    found = linprog(direction * np.eye(5)[i], rows, right, bounds=ranges)
                    if found.status == 2:
                        break
                    if found.status == 0 and found.fun < direction * ends[k, i]:
                        ends[k, i] = direction * found.fun
                else:
                    continue
                break
    return ends


@pytest.mark.parametrize(("leak", "seed"), [(0.0, 0), (0.2, 1), (0.0, 2)])
def test_ends_are_those_of_all_patterns(leak: float, seed: int) -> None:
    data = planted(7, seed, [[0.5, 1.0, -0.3, 0.2]], [1.0], leak, 0.05)
    found = neural.hidden_weights(structure(1, leak), data, 0.06, weights=4.0)
    ends = enumerated(data, leak, 0.06, 4.0)
    outer = np.array([item.outer for item in found.intervals.values()]).T
    assert list(found.intervals) == ["w1_1", "w1_2", "w1_3", "b1", "c"]
    assert found.status == "proved" and found.verify()
    assert np.allclose(outer, ends, rtol=0, atol=2e-4 * np.max(ends[1] - ends[0]))
    assert np.all(outer[0] <= ends[0] + 1e-7) and np.all(outer[1] >= ends[1] - 1e-7)


def test_an_empty_set_is_proved() -> None:
    data = planted(12, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.3)
    found = neural.hidden_weights(structure(1, 0.0), data, 0.01)
    assert found.status == "empty" and found.verify()
    assert not replace(found, bound=0.4).verify()


def test_forged_intervals_are_found() -> None:
    data = planted(10, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    found = neural.hidden_weights(structure(1, 0.0), data, 0.06, weights=4.0)
    assert found.verify()
    kept, gone = found.choices
    assert gone.empty
    corner = np.vstack([kept.members, kept.members.max(axis=0)])  # the intervals stay the same
    forged = [
        replace(found, choices=(replace(kept, members=corner), gone)),
        replace(found, choices=(kept,)),
        replace(found, choices=(gone, kept)),
        replace(found, choices=(replace(kept, steps=kept.steps[1:]), gone)),
        replace(found, choices=(replace(kept, low=kept.low + 1e-3), gone)),
        replace(found, choices=(replace(kept, high=kept.high - 1e-3), gone)),
        replace(found, choices=(replace(kept, members=kept.members * 1.1), gone)),
        replace(found, choices=(replace(kept, steps=()), gone)),
        replace(found, choices=(kept, replace(gone, steps=()))),
        replace(found, bound=0.07),
        replace(found, weights=5.0),
        replace(found, status=neural.Status.PARTIAL),
    ]
    for number, item in enumerate(forged):
        assert not item.verify(), number


def scaled(node: DualNode, share: float) -> DualNode:
    children = tuple(scaled(child, share) for child in node.children)
    return replace(node, dual=node.dual * share, children=children)


@pytest.mark.parametrize("goal", [(0, 3.0), (-1, 1.0), (0, float("nan")), (7, 1.0)])
def test_goals_that_are_no_ends_prove_nothing(goal: tuple[int, float]) -> None:
    """Three times the multipliers of a weight bound three times the weight, not the weight."""
    data = planted(10, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    found = neural.hidden_weights(structure(1, 0.0), data, 0.06, weights=4.0)
    kept = found.choices[0]
    tree = next(tree for end, tree in kept.steps if end == (0, 1.0))
    task = hidden_weights._Task.of(found.net, data, 0.06, 4.0)
    assert np.array_equal(task.drawn(kept.signs, ((goal, scaled(tree, 3.0)),)), task.box())


def test_choices_of_signs_are_shown_in_a_line() -> None:
    data = planted(5, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    found = neural.hidden_weights(structure(1, 0.0), data, 0.1, time_limit=0.01)
    shown = [repr(item) for item in found.choices]
    assert shown[0].startswith("<SignChoice: signs +1, ") and len(max(shown, key=len)) < 60
    assert "by descending first weight" in found.assumptions[-1]


def test_what_means_nothing_is_refused() -> None:
    data = planted(8, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    net = structure(1, 0.0)
    with pytest.raises(setid.ModelError, match="normalised: found False"):
        neural.hidden_weights(net, data, 0.1, normalised=False)
    with pytest.raises(setid.ModelError, match="found identity neurons"):
        linear = neural.Network([np.ones((1, 3)), [[1.0]]], [[0.0], [0.0]], "identity")
        neural.hidden_weights(neural.NNARX(linear, 1), data, 0.1)
    with pytest.raises(setid.ModelError, match="weights: found 0"):
        neural.hidden_weights(net, data, 0.1, weights=0)
    with pytest.raises(setid.NoiseError, match="expected one of the equation error"):
        neural.hidden_weights(net, data, setid.Noise(output=0.1))
    with pytest.raises(setid.NoiseError, match="expected one positive bound"):
        neural.hidden_weights(net, data, 0.0)


def test_an_emptiness_without_proof_is_found() -> None:
    data = planted(10, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    net = structure(1, 0.0)
    found = neural.hidden_weights(net, data, 0.06, weights=4.0)
    none = neural.hidden_weights(net, data, 0.001, weights=4.0)
    assert none.status == "empty"
    leaf = none.choices[0].steps[0][1]
    while leaf.children:
        leaf = leaf.children[0]
    bare = replace(leaf, dual=np.zeros(leaf.dual.size), infeasible=True)
    kept, gone = found.choices
    forged = replace(none.choices[0], steps=(((5, 1.0), bare),))
    assert none.choices[0].empty and not kept.empty
    assert not replace(none, choices=(forged, none.choices[1])).verify()
    assert not replace(none, bound=0.06, choices=(forged, gone)).verify()


@pytest.mark.slow
@pytest.mark.parametrize("signs", [[1.0, 1.0], [1.0, -1.0]])
def test_two_planted_neurons_stay_inside(signs: list[float]) -> None:
    slopes = [[0.3, 2.0, 0.5, 0.2], [-0.2, -1.0, 1.0, 0.1]]
    data = planted(30, 3, slopes, signs, 0.0, 0.002)
    found = neural.hidden_weights(structure(2, 0.0), data, 0.003, weights=4.0, time_limit=15)
    assert found.verify()
    truth = [*slopes[0][:3], *slopes[1][:3], slopes[0][3], slopes[1][3], 0.1]
    for value, item in zip(truth, found.intervals.values(), strict=True):
        assert item.outer[0] <= value <= item.outer[1]
    kept = [item for item in found.choices if item.signs == tuple(signs)]
    assert not kept[0].empty


def test_proofs_are_about_their_structure_and_say_their_assumptions() -> None:
    data = planted(8, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    found = neural.hidden_weights(structure(1, 0.0), data, setid.Noise(equation=0.1), weights=3.0)
    assert found.verify()
    given = found.net.network
    deep = neural.Network([*given.weights, [[1.0]]], [*given.biases, [0.0]], "relu")
    bent = neural.Network(given.weights, given.biases, ["relu", "tanh"])
    line = neural.Network(given.weights, given.biases, "leaky_relu", leak=1.0)
    for other in (deep, bent, line):
        assert "structure" in replace(found, net=neural.NNARX(other, 1)).verify().reason
    for number in range(len(found.assumptions)):
        fewer = found.assumptions[:number] + found.assumptions[number + 1 :]
        assert "assumption" in replace(found, assumptions=fewer).verify().reason
    assert "positive" in replace(found, bound=np.nan).verify().reason


def test_interrupts_keep_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    data = planted(8, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    programs = InterruptedPrograms(monkeypatch)
    for last in (1, 5, 16, 17, 40):
        programs.interrupt(last)
        found = neural.hidden_weights(structure(1, 0.0), data, 0.06, weights=3.0)
        assert found.verify() and found.status == "partial" and programs.count == last
        for name, truth in {"w1_1": 0.5, "w1_2": 1.0, "w1_3": -0.3, "b1": 0.2, "c": 0.1}.items():
            low, high = found.intervals[name].outer
            assert low <= truth <= high


def test_interrupts_between_a_bound_and_its_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was moved without a step is moved back: only steps prove ends."""
    data = planted(8, 0, [[0.5, 1.0, -0.3, 0.2]], [1.0], 0.0, 0.05)
    usual, count = hidden_weights.shrink, [0]

    def shrink(*arguments: Any) -> None:
        usual(*arguments)
        count[0] += 1
        if count[0] == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(hidden_weights, "shrink", shrink)
    found = neural.hidden_weights(structure(1, 0.0), data, 0.06, weights=3.0)
    assert count[0] > 4 and found.verify() and len(found.choices[0].steps) == 2
