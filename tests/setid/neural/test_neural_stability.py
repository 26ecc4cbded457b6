"""Stability against closed forms, spectra of linear networks and 10^4 simulated pairs."""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import inf

import numpy as np
import pytest

import setid
from setid import neural
from setid.neural.arithmetic import Interval
from setid.neural.contraction import comparison, stability
from setid.neural.contraction.comparison import norm

RNG = np.random.default_rng


def scalar(v: float, activation: str = "tanh") -> neural.Elman:
    return neural.Elman([([[1.0]], [[v]], [0.0])], ([[1.0]], [0.0]), activation)


def elman(n: int, size: float, seed: int) -> neural.Elman:
    rng = RNG(seed)
    v = rng.normal(size=(n, n))
    v *= size / np.linalg.norm(v, 2)
    return neural.Elman([(rng.normal(size=(n, 2)), v, rng.normal(size=n))])


def gates(n: int, size: float, count: int, seed: int) -> list[tuple]:
    rng = RNG(seed)
    shapes = ((size, (n, 2)), (size, (n, n)), (0.3, n))
    return [tuple(s * rng.normal(size=shape) for s, shape in shapes) for _ in range(count)]


@pytest.mark.parametrize("v", [0.0, 0.3, -0.7, 0.999])
def test_scalar_elman_has_the_rate_of_its_weight(v: float) -> None:
    found = neural.stability(scalar(v), lmi=False)
    assert found.status == "stable" and found.verify()
    assert abs(v) <= found.rate <= abs(v) + 1e-6


@pytest.mark.parametrize("v", [1.0, -1.0, 1.2, -5.0])
@pytest.mark.parametrize("activation", ["tanh", "relu", "identity"])
def test_what_does_not_contract_is_open(v: float, activation: str) -> None:
    """With v = 1 two trajectories of h+ = tanh(h) approach, but at no geometric rate."""
    found = neural.stability(scalar(v, activation))
    assert found.status == "open" and found.rate == np.inf and found.verify()
    with pytest.raises(setid.ModelError, match="no condition that holds"):
        found.distance(3, 1.0)


def test_sigmoid_contracts_four_times_as_fast() -> None:
    assert neural.stability(scalar(3.6, "sigmoid"), lmi=False).rate == pytest.approx(0.9, 1e-6)
    assert neural.stability(scalar(4.0, "sigmoid")).status == "open"


def test_the_inequality_finds_what_norms_miss() -> None:
    """V = [[0, 2], [0.2, 0]] has norm 2; scaled by diag(1, sqrt(10)) it is sqrt(0.4) times a
    rotation, so that the best rate of a diagonal P is sqrt(0.4) = 0.632."""
    net = neural.Elman([(np.ones((2, 1)), [[0.0, 2.0], [0.2, 0.0]], [0.0, 0.0])])
    found = neural.stability(net)
    lmi = found.conditions[-1]
    assert not found.conditions[0].holds and lmi.holds
    assert 0.4**0.5 - 1e-9 <= lmi.rate <= 0.4**0.5 + 0.02
    assert found.verify()


def _warning(*_: object, **__: object) -> None:
    warnings.warn("inaccurate", stacklevel=2)


def test_what_a_solver_warns_of_is_not_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Inaccurate matrices once were a UserWarning, although only verified ones count."""
    monkeypatch.setattr("cvxpy.Problem.solve", _warning)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not neural.stability(scalar(0.5)).conditions[-1].holds


@pytest.mark.parametrize("seed", range(5))
def test_linear_networks_have_rates_above_their_spectral_radius(seed: int) -> None:
    rng = RNG(seed)
    w = 0.35 * rng.normal(size=(3, 4))
    net = neural.NeuralStateSpace(
        neural.Network([w], [np.zeros(3)]), neural.Network([np.ones((1, 4))], [[0.0]])
    )
    found = neural.stability(net)
    radius = np.max(np.abs(np.linalg.eigvals(w[:, 1:])))
    for item in found.conditions:
        assert not item.holds or item.rate >= radius - 1e-9
    if radius < 0.99:  # a Lyapunov matrix exists by Stein's theorem
        assert found.status == "stable" and found.conditions[-1].rate <= radius + 0.02


def test_lstm_condition_by_hand() -> None:
    """Zero weights but U_c = 0.5 and no bias: gates 1/2, A = [[.5, .25], [.25, .125]]."""
    zero = ([[0.0]], [[0.0]], [0.0])
    net = neural.LSTM(zero, zero, zero, ([[0.0]], [[0.5]], [0.0]))
    found = neural.stability(net)
    assert found.status == "stable" and found.verify()
    assert found.rate == pytest.approx(0.625, abs=1e-5)  # trace 5/8, determinant 0
    forget = ([[0.0]], [[0.8]], [0.0])
    found = neural.stability(neural.LSTM(forget, zero, zero, ([[0.0]], [[0.5]], [0.0])))
    f = 1 / (1 + np.exp(-0.8))
    c = 0.5 * np.tanh(0.5) / (1 - f)
    alpha = 0.25 * 0.8 * c + 0.5 * 0.5
    expected = np.max(np.abs(np.linalg.eigvals([[f, alpha], [0.5 * f, 0.5 * alpha]])))
    assert found.rate == pytest.approx(expected, abs=1e-5)


def test_gru_condition_by_hand() -> None:
    """Zero weights but U = 0.5: z = r = 1/2 and the rate is 1 - (1 - U r) / 2."""
    zero = ([[0.0]], [[0.0]], [0.0])
    for reset in ("before", "after"):
        net = neural.GRU(zero, zero, ([[0.0]], [[0.5]], [0.0]), reset=reset)
        found = neural.stability(net)
        assert found.rate == pytest.approx(1 - 0.5 * (1 - 0.25), abs=1e-9) and found.verify()
    # update gate with U_z: sigma(-0.4) <= z <= sigma(0.4), and 1/4 |U_z| (1 + tanh(U))
    net = neural.GRU(([[0.0]], [[0.4]], [0.0]), zero, ([[0.0]], [[0.5]], [0.0]))
    least = 1 / (1 + np.exp(0.4))
    expected = 1 - least * 0.75 + 0.25 * 0.4 * (1 + np.tanh(0.25))
    assert neural.stability(net).rate == pytest.approx(expected, abs=1e-9)


def test_gated_networks_need_the_range_of_their_inputs() -> None:
    net = neural.GRU(*gates(3, 0.05, 3, 0))
    near = neural.stability(net, [-1, 1])
    wide = neural.stability(net, [-100, 100])
    assert near.rate < wide.rate
    assert any("[-100, 100]" in text for text in wide.assumptions)
    with pytest.raises(setid.ModelError, match="inputs: found shape"):
        neural.stability(net, np.zeros((3, 2)))
    with pytest.raises(setid.ModelError, match="low <= high"):
        neural.stability(net, [1, -1])


@pytest.mark.parametrize("leak", [-3.0, -0.5, 5.0, np.nan, "steep", None])
def test_slopes_that_are_not_monotone_are_refused(leak: object) -> None:
    """With x -> max(0.9 x, 0) - 3 min(0.9 x, 0) distances of negative states grow by 2.7."""
    layer = ([[1.0]], [[0.9]], [0.0])
    with pytest.raises(setid.ModelError, match="leak: found"):
        neural.Elman([layer], ([[1.0]], [0.0]), "leaky_relu", leak)
    with pytest.raises(setid.ModelError, match="leak: found"):
        neural.Network([[[1.0]], [[1.0]]], [[0.0], [0.0]], "leaky_relu", leak)


def test_cascades_of_layers() -> None:
    layers = [([[1.0]], [[0.5]], [0.0]), ([[3.0]], [[0.6]], [0.0])]
    found = neural.stability(neural.Elman(layers))
    assert found.status == "stable" and 0.6 <= found.rate < 1.0 and found.verify()
    layers[1] = ([[3.0]], [[1.1]], [0.0])
    assert neural.stability(neural.Elman(layers)).status == "open"


def test_regressor_networks_in_simulation() -> None:
    def net(a: float, b: float) -> neural.NNOE:
        inner = neural.Network([[[a, b, 1.0, 0.0, 0.0]], [[1.0]]], [[0.0], [0.0]])
        return neural.NNOE(inner, 2)

    assert neural.stability(net(0.5, 0.4)).status == "stable"  # 0.9 < 1
    # z^2 = 0.6 z + 0.5 has the root 1.068: not stable at the origin
    assert neural.stability(net(0.6, 0.5)).status == "open"


def pairs(net, count: int, steps: int, seed: int):
    """Distances of pairs of trajectories, columns in parallel, from cells written out here."""
    rng = RNG(seed)

    def sigma(a):
        return 1 / (1 + np.exp(-a))

    def advance(x, u):
        if isinstance(net, neural.Elman):
            ((w, v, b),) = net.layers
            return np.tanh(w @ u + v @ x + b[:, None])
        gate = net.gates[0]
        arg = [w @ u + v @ x[: len(b)] + b[:, None] for w, v, b in net.gates]
        n = len(gate[2])
        if isinstance(net, neural.LSTM):
            f, i, o = (sigma(a) for a in arg[:3])
            c = f * x[n:] + i * np.tanh(arg[3])
            return np.vstack([o * np.tanh(c), c])
        z, r = sigma(arg[0]), sigma(arg[1])
        w, v, b = net.gates[2]
        fed = v @ (r * x) if net.reset == "before" else r * (v @ x + net.inner[:, None])
        return (1 - z) * x + z * np.tanh(w @ u + fed + b[:, None])

    size = net.states
    a, b = rng.uniform(-1, 1, size=(2, size, count))
    if isinstance(net, neural.LSTM):
        a, b = 0.2 * a, 0.2 * b
    yield a, b, np.zeros((2, count))
    for _ in range(steps):
        u = rng.uniform(-0.95, 0.95, size=(2, count))
        du = rng.uniform(-0.05, 0.05, size=(2, count))
        a, b = advance(a, u), advance(b, u + du)
        yield a, b, du


@pytest.mark.parametrize("kind", ["elman", "lstm", "before", "after"])
def test_ten_thousand_pairs_never_contradict(kind: str) -> None:
    """25 networks of each kind with 100 pairs each over 40 steps, all conditions that hold."""
    used = 0
    for seed in range(25):
        size = 0.05 + 0.004 * seed
        if kind == "elman":
            net = elman(4, 0.6 + 0.03 * seed, seed)
        elif kind == "lstm":
            net = neural.LSTM(*gates(3, size, 4, seed))
        else:
            net = neural.GRU(*gates(3, size, 3, seed), reset=kind)
        found = neural.stability(net, lmi=seed % 5 == 0)
        for item in (c for c in found.conditions if c.holds):
            used += 1
            euclid = item.norm in ("2", "P")
            first = None
            for t, (a, b, _) in enumerate(pairs(net, 100, 40, seed)):
                d = a - b
                parts = np.split(d, 2) if kind == "lstm" else [d]
                size_of = [np.linalg.norm(p, axis=0) if euclid else np.abs(p).max(0) for p in parts]
                value = np.max(size_of, axis=0)
                if first is None:
                    first = value
                    bound = np.array(
                        [found.distance(40, v, inputs=0.05 * 2**0.5, condition=item) for v in value]
                    )
                assert np.all(value <= bound[:, t] * (1 + 1e-12))
            assert np.all(bound[:, -1] <= bound[:, 0] + found.limit(0.05 * 2**0.5, condition=item))
    assert used >= 20


def test_errors_added_to_the_state() -> None:
    net = elman(3, 0.8, 2)
    found = neural.stability(net, lmi=False)
    rng = RNG(0)
    a = b = rng.uniform(-1, 1, size=3)
    worst = found.limit(errors=0.1)
    for _ in range(200):
        u = rng.normal(size=2)
        e = rng.normal(size=3)
        a, b = net.step(a, u)[0] + 0.1 * e / np.linalg.norm(e), net.step(b, u)[0]
        assert np.linalg.norm(a - b) <= worst
    # a scalar linear network attains the bound in the limit: e / (1 - v)
    lin = neural.stability(scalar(0.5, "identity"), lmi=False)
    assert lin.limit(errors=0.1) == pytest.approx(0.2, rel=1e-6)
    assert lin.output_distance(50, 0.0, errors=0.1)[-1] == pytest.approx(0.2, rel=1e-6)


def test_errors_may_push_a_gated_state_out_of_the_range_of_its_gates() -> None:
    """h+ = (1 - s(2 - 1.5 h)) h + 1 grows without end: h s(2 - 1.5 h) < 1 for all h >= 0."""
    zero = ([[0.0]], [[0.0]], [0.0])
    found = neural.stability(neural.GRU(([[0.0]], [[-1.5]], [2.0]), zero, zero))
    h = 0.0
    for _ in range(40):
        h = (1.0 - 1.0 / (1.0 + np.exp(1.5 * h - 2.0))) * h + 1.0
    assert found.limit(errors=1.0) < 5.0 < 30.0 < h  # holds while h stays in [-1, 1] only
    assert any("h in [-1, 1]" in text and "at all times" in text for text in found.assumptions)
    cells = neural.stability(neural.LSTM(*[([[0.1]], [[0.1]], [0.0])] * 4))
    assert any("invariant range" in t and "at all times" in t for t in cells.assumptions)


@pytest.mark.parametrize("seed", range(5))
def test_norms_are_upper_bounds_and_close(seed: int) -> None:
    matrix = RNG(seed).normal(size=(4, 6))
    assert np.linalg.norm(matrix, 2) <= norm(matrix, "2") <= np.linalg.norm(matrix, 2) * 1.000001
    assert np.abs(matrix).sum(1).max() <= norm(matrix, "inf")
    assert norm(np.zeros((2, 2)), "2") < 1e-100


def test_forged_verdicts_are_found() -> None:
    net = elman(3, 0.8, 2)
    found = neural.stability(net)
    first, last = found.conditions[0], found.conditions[-1]
    faster = replace(first, rate=first.rate - 1e-3)
    assert not replace(found, conditions=(faster,)).verify()
    assert not replace(found, conditions=(replace(first, drive=first.drive * 0.9),)).verify()
    matrices = replace(last.lyapunov, rate=0.5 * last.rate)
    assert not replace(found, conditions=(replace(last, rate=0.5 * last.rate),)).verify()
    forged = replace(last, rate=0.5 * last.rate, lyapunov=matrices)
    assert not replace(found, conditions=(forged,)).verify()
    assert not replace(found, net=elman(3, 1.5, 2)).verify()
    assert not replace(found, conditions=()).verify()


def test_a_matrix_inequality_is_about_its_own_norm() -> None:
    """In the largest entry its distances would be too small by up to sqrt(n)."""
    found = neural.stability(elman(3, 0.8, 2))
    last = found.conditions[-1]
    assert last.holds and last.norm == "P" and found.verify()
    for name in ("inf", "2", "entries"):
        assert not replace(found, conditions=(replace(last, norm=name),)).verify()


def test_gated_networks_are_stable_over_a_range_that_is_stated() -> None:
    """Ends the wrong way round once made gates narrower than any range of inputs does."""
    rng = np.random.default_rng(0)
    gates = [(0.3 * rng.normal(size=(2, 1)), 0.3 * rng.normal(size=(2, 2)), np.zeros(2))
             for _ in range(4)]  # fmt: skip
    net = neural.LSTM(*gates, ([[1.0, 1.0]], [0.0]))
    wide, narrow = neural.stability(net, [-5, 5]), neural.stability(net, [-0.1, 0.1])
    assert wide.status is neural.Status.OPEN and narrow.status is neural.Status.STABLE
    assert wide.verify() and narrow.verify()
    assert not replace(narrow, assumptions=wide.assumptions).verify()
    assert not replace(narrow, assumptions=()).verify()
    turned = Interval(np.array([5.0]), np.array([-5.0]))
    drawn = [stability._condition(item) for item in comparison.comparisons(net, turned)]
    assert all(item.holds for item in drawn)
    texts = stability._assumptions(net, turned)
    forged = replace(narrow, inputs=turned, conditions=tuple(drawn), assumptions=texts)
    assert not forged.verify()
    for inputs in (None, Interval(np.zeros(2), np.ones(2)), Interval(np.zeros(1), np.full(1, inf))):
        assert not replace(narrow, inputs=inputs).verify()
    free = neural.stability(elman(3, 0.8, 2))
    assert not replace(free, inputs=turned).verify()


def test_other_objects_are_refused() -> None:
    with pytest.raises(setid.ModelError, match="found int, expected a model"):
        neural.stability(3)
