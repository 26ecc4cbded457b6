"""Models against cells written out by hand, scalar by scalar."""

from __future__ import annotations

import pickle
from math import exp, tanh

import numpy as np
import pytest

import setid
from setid import neural


def sigma(x: float) -> float:
    return 1.0 / (1.0 + exp(-x))


def record(samples: int, inputs: int = 1, outputs: int = 1, seed: int = 0) -> setid.IOData:
    rng = np.random.default_rng(seed)
    return setid.IOData(
        rng.normal(size=(samples, inputs)), rng.normal(size=(samples, outputs)), Ts=1.0
    )


def dense(rng: np.random.Generator, *sizes: int) -> tuple[list, list]:
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    return [rng.normal(size=p) for p in pairs], [rng.normal(size=p[0]) for p in pairs]


def test_nnarx_one_step_by_hand() -> None:
    rng = np.random.default_rng(1)
    w, b = dense(rng, 5, 2, 1)
    data = record(6)
    y, u = data.y.ravel(), data.u.ravel()
    found = neural.NNARX(neural.Network(w, b), order=2).one_step(data).ravel()
    assert np.isnan(found[:2]).all()
    for t in range(2, 6):
        phi = [y[t - 1], y[t - 2], u[t], u[t - 1], u[t - 2]]
        hidden = [tanh(sum(w[0][i][j] * phi[j] for j in range(5)) + b[0][i]) for i in range(2)]
        assert found[t] == pytest.approx(
            w[1][0][0] * hidden[0] + w[1][0][1] * hidden[1] + b[1][0], abs=1e-14
        )


def test_nnoe_feeds_its_own_outputs() -> None:
    rng = np.random.default_rng(2)
    w, b = dense(rng, 3, 2, 1)
    data = record(5)
    u = data.u.ravel()
    value = 0.3
    found = neural.NNOE(neural.Network(w, b), order=1).simulate(data, [[0.3]]).ravel()
    assert found[0] == 0.3
    for t in range(1, 5):
        phi = [value, u[t], u[t - 1]]
        hidden = [tanh(sum(w[0][i][j] * phi[j] for j in range(3)) + b[0][i]) for i in range(2)]
        value = w[1][0][0] * hidden[0] + w[1][0][1] * hidden[1] + b[1][0]
        assert found[t] == pytest.approx(value, abs=1e-14)


def test_several_channels_are_ordered_by_lag_first() -> None:
    data = setid.IOData([[1, 2], [3, 4]], [[10, 20], [30, 40]])
    net = neural.Network([np.eye(6)[:2]], [np.zeros(2)])
    assert neural.NNARX(net, 1, channels=2).one_step(data)[1].tolist() == [10, 20]
    net = neural.Network([np.eye(6)[2:4]], [np.zeros(2)])
    assert neural.NNARX(net, 1, channels=2).one_step(data)[1].tolist() == [3, 4]


def test_records_do_not_touch() -> None:
    one, two = record(4, seed=3), record(5, seed=4)
    rng = np.random.default_rng(5)
    net = neural.NNARX(neural.Network(*dense(rng, 3, 3, 1)), 1)
    both = setid.IOData.concat([one, two])
    for run in (net.one_step, net.simulate):
        np.testing.assert_array_equal(run(both), np.concatenate([run(one), run(two)]))


def test_missing_samples_leave_rows_out() -> None:
    data = setid.IOData([1.0, 2.0, 3.0, 4.0], [1.0, np.nan, 3.0, 4.0])
    net = neural.NNARX(neural.Network([[[1.0, 0.0, 0.0]]], [[0.0]]), 1)
    assert np.isnan(net.one_step(data).ravel()).tolist() == [True, True, True, False]


def test_elman_of_two_layers_by_hand() -> None:
    layers = [
        ([[0.5], [-0.4]], [[0.1, 0.2], [0.3, -0.5]], [0.05, -0.1]),
        ([[0.7, -0.6]], [[0.25]], [0.2]),
    ]
    net = neural.Elman(layers, ([[1.5]], [-0.3]))
    data = record(4)
    h1, h2, g = 0.1, -0.2, 0.3
    found = net.simulate(data, [0.1, -0.2, 0.3]).ravel()
    for t in range(4):
        u = data.u[t, 0]
        h1, h2 = (
            tanh(0.5 * u + 0.1 * h1 + 0.2 * h2 + 0.05),
            tanh(-0.4 * u + 0.3 * h1 - 0.5 * h2 - 0.1),
        )
        g = tanh(0.7 * h1 - 0.6 * h2 + 0.25 * g + 0.2)
        assert found[t] == pytest.approx(1.5 * g - 0.3, abs=1e-14)
    assert net.parameters == (2 + 4 + 2) + (2 + 1 + 1) + 2


def test_state_space_output_uses_the_state_before_the_step() -> None:
    f = neural.Network([[[0.3, -0.8], [0.2, 0.4]], [[1.1, -0.9]]], [[0.1, 0.2], [0.05]])
    h = neural.Network([[[0.6, -0.7]], [[2.0]]], [[0.0], [1.0]], "sigmoid")
    net = neural.NeuralStateSpace(f, h)
    data = record(4)
    x = 0.4
    found = net.simulate(data, [x]).ravel()
    for t in range(4):
        u = data.u[t, 0]
        assert found[t] == pytest.approx(2.0 * sigma(0.6 * u - 0.7 * x) + 1.0, abs=1e-14)
        a, b = tanh(0.3 * u - 0.8 * x + 0.1), tanh(0.2 * u + 0.4 * x + 0.2)
        x = 1.1 * a - 0.9 * b + 0.05


def test_lstm_by_hand() -> None:
    rng = np.random.default_rng(6)
    gates = [(rng.normal(size=(2, 1)), rng.normal(size=(2, 2)), rng.normal(size=2))
             for _ in range(4)]  # fmt: skip
    net = neural.LSTM(*gates, (np.array([[1.0, -2.0]]), [0.5]))
    data = record(5)
    h, c = [0.1, -0.3], [0.2, 0.6]
    found = net.simulate(data, [*h, *c]).ravel()

    def argument(gate: int, i: int, u: float) -> float:
        w, v, b = gates[gate]
        return w[i][0] * u + v[i][0] * h[0] + v[i][1] * h[1] + b[i]

    for t in range(5):
        u = data.u[t, 0]
        f, i, o = ([sigma(argument(g, k, u)) for k in range(2)] for g in range(3))
        c = [f[k] * c[k] + i[k] * tanh(argument(3, k, u)) for k in range(2)]
        h = [o[k] * tanh(c[k]) for k in range(2)]
        assert found[t] == pytest.approx(h[0] - 2.0 * h[1] + 0.5, abs=1e-13)
    assert net.parameters == 4 * (2 + 4 + 2) + 3


@pytest.mark.parametrize("reset", ["before", "after"])
def test_gru_by_hand(reset: str) -> None:
    rng = np.random.default_rng(7)
    z, r, n = [(rng.normal(size=(2, 1)), rng.normal(size=(2, 2)), rng.normal(size=2))
               for _ in range(3)]  # fmt: skip
    inner = rng.normal(size=2)
    last = n if reset == "before" else (*n, inner)
    net = neural.GRU(z, r, last, ([[1.0, 1.0]], [0.0]), reset=reset)
    data = record(5)
    h = [0.2, -0.7]
    found = net.simulate(data, h).ravel()
    for t in range(5):
        u = data.u[t, 0]

        def gate(g, i, u=u, h=h) -> float:
            return sigma(g[0][i][0] * u + g[1][i][0] * h[0] + g[1][i][1] * h[1] + g[2][i])

        zs, rs = [gate(z, i) for i in range(2)], [gate(r, i) for i in range(2)]
        new = []
        for i in range(2):
            if reset == "before":
                fed = n[1][i][0] * rs[0] * h[0] + n[1][i][1] * rs[1] * h[1]
            else:
                fed = rs[i] * (n[1][i][0] * h[0] + n[1][i][1] * h[1] + inner[i])
            new.append((1 - zs[i]) * h[i] + zs[i] * tanh(n[0][i][0] * u + fed + n[2][i]))
        h = new
        assert found[t] == pytest.approx(h[0] + h[1], abs=1e-13)
    assert net.parameters == 3 * 8 + (2 if reset == "after" else 0) + 3


def test_parameter_counts_of_the_literature() -> None:
    # order 4 with 8 tanh: 9 regressors, 9 * 8 + 8 + 8 + 1
    rng = np.random.default_rng(0)
    assert neural.NNARX(neural.Network(*dense(rng, 9, 8, 1)), 4).parameters == 89
    # order 2 with 8 tanh: 5 * 8 + 8 + 8 + 1
    assert neural.NNARX(neural.Network(*dense(rng, 5, 8, 1)), 2).parameters == 57


@pytest.mark.parametrize(
    ("name", "value"),
    [("tanh", tanh(-1.5)), ("sigmoid", sigma(-1.5)), ("relu", 0.0), ("leaky_relu", -0.3),
     ("identity", -1.5), ("algebraic", -1.5 / 3.25**0.5)],
)  # fmt: skip
def test_activations(name: str, value: float) -> None:
    net = neural.Network([[[1.0]], [[1.0]]], [[0.0], [0.0]], name, leak=0.2)
    assert net([-1.5])[0] == pytest.approx(value, abs=1e-15)


def test_frozen_copies() -> None:
    w = np.ones((1, 3))
    net = neural.NNARX(neural.Network([w], [[0.0]]), 1)
    w[:] = 5.0
    assert net.network.weights[0][0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        net.network.weights[0][0, 0] = 2.0
    again = pickle.loads(pickle.dumps(net))
    np.testing.assert_array_equal(again.network.weights[0], net.network.weights[0])


def net_of_one() -> neural.Network:
    return neural.Network([[[1.0, 0.0, 0.0]]], [[0.0]])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: neural.Network([[[np.nan]]], [[0.0]]), r"weights\[0\]\[0, 0\]: found nan"),
        (lambda: neural.Network([[[1.0]]], [[0.0, 1.0]]), r"biases\[0\]: found shape \(2,\)"),
        (lambda: neural.Network([[[1.0]], [[1.0, 2.0]]], [[0.0], [0.0]]), r"weights\[1\]: found 2"),
        (lambda: neural.Network([[[1.0]]], [[0.0]], "swish"), "activation: found 'swish'"),
        (lambda: neural.Network([], []), "found 0 and 0 layers"),
        (lambda: neural.Network([[["a"]]], [[0.0]]), "expected real numbers"),
        (lambda: neural.NNARX(net_of_one(), 2), "found 3 inputs, expected 5"),
        (lambda: neural.NNARX(net_of_one(), 0), "order: found 0"),
        (lambda: neural.Elman([([[1.0]], [[0.5, 1.0]], [0.0])]), r"layers\[0\].V: found shape"),
        (lambda: neural.Elman([]), "layers: found none"),
        (lambda: neural.GRU(*[([[1.0]], [[1.0]], [0.0])] * 3, reset="never"), "reset: found"),
        (
            lambda: neural.GRU(*[([[1.0]], [[1.0]], [0.0])] * 2, ([[1.0]], [[1.0]], [0.0], [1.0])),
            "inner bias",
        ),
        (lambda: neural.LSTM(*[([[1.0]], [[1.0]])] * 4), r"forget: found 2 arrays"),
        (lambda: neural.NeuralStateSpace(net_of_one(), 3), "output: found int"),
    ],
)
def test_wrong_networks_are_refused_by_name(make, text: str) -> None:
    with pytest.raises(setid.ModelError, match=text):
        make()


def test_wrong_records_are_refused_by_name() -> None:
    net = neural.NNARX(net_of_one(), 1)
    with pytest.raises(setid.DataError, match="found 2 inputs and 1 outputs, expected 1 and 1"):
        net.one_step(record(4, inputs=2))
    with pytest.raises(setid.DataError, match="found list, expected IOData"):
        net.simulate([1, 2, 3])
    with pytest.raises(setid.ModelError, match="x0: found shape"):
        net.simulate(record(4), [1.0, 2.0])


@pytest.mark.parametrize("alpha", [0.5, 1.0, 1.25])
def test_gradient_of_a_first_order_model_in_closed_form(alpha: float) -> None:
    """y_t = alpha y_{t-1} + beta u_{t-1}, y_0 = 1, u = 0: d y_t / d alpha = t alpha^{t-1}."""
    data = setid.IOData(np.zeros(12), np.zeros(12))

    def run(value: float) -> np.ndarray:
        net = neural.Network([[[value, 0.0, 1.0]]], [[0.0]])
        return neural.NNOE(net, 1).simulate(data, [1.0]).ravel()

    t = np.arange(12)
    step = 2.0**-20
    slope = (run(alpha + step) - run(alpha - step)) / (2 * step)
    expected = np.where(t > 0, t * alpha ** np.maximum(t - 1.0, 0.0), 0.0)
    np.testing.assert_allclose(slope, expected, rtol=1e-8, atol=1e-8)
