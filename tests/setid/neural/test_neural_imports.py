"""Imported weights: arrays here; torch, equinox, jax-sysid and ONNX where they are installed."""

from __future__ import annotations

import functools
import sys
from types import FunctionType, SimpleNamespace

import numpy as np
import pytest

import setid
from setid import neural

PEER = "a peer in an environment of its own; not a dependency of this project"


def inputs(samples: int = 40, channels: int = 2) -> setid.IOData:
    rng = np.random.default_rng(0)
    return setid.IOData(rng.normal(size=(samples, channels)), np.zeros((samples, 1)))


def test_arrays_and_files(tmp_path) -> None:
    rng = np.random.default_rng(0)
    w, b = [rng.normal(size=(3, 2)), rng.normal(size=(1, 3))], [rng.normal(size=3), [0.5]]
    net = neural.from_arrays(w, b, "relu")
    np.savez(tmp_path / "net.npz", W1=w[0], b1=b[0], W2=w[1], b2=b[1])
    again = neural.from_arrays(tmp_path / "net.npz", activation="relu")
    x = rng.normal(size=(5, 2))
    np.testing.assert_array_equal(net(x), again(x))
    np.testing.assert_allclose(net(x), np.maximum(x @ w[0].T + b[0], 0) @ w[1].T + 0.5, atol=1e-15)
    np.savez(tmp_path / "half.npz", W1=w[0])
    with pytest.raises(setid.ModelError, match="found no array b1"):
        neural.from_arrays(tmp_path / "half.npz")
    with pytest.raises(setid.ModelError, match="biases: found None"):
        neural.from_arrays(w)
    with pytest.raises(setid.ModelError, match="biases: found .* beside a file"):
        neural.from_arrays(tmp_path / "net.npz", b)
    np.savez(tmp_path / "more.npz", W1=w[1], b1=b[1], b2=b[1])
    with pytest.raises(setid.ModelError, match="found the arrays W1, b1, b2, expected"):
        neural.from_arrays(tmp_path / "more.npz")


def test_pickles_are_not_executed(tmp_path) -> None:
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("code ran while loading",))

    np.savez(tmp_path / "bomb.npz", W1=np.array([Bomb()], dtype=object), b1=[0.0])
    with pytest.raises(ValueError, match="allow_pickle=False"):
        neural.from_arrays(tmp_path / "bomb.npz")


def test_state_dictionaries_need_no_torch() -> None:
    rng = np.random.default_rng(1)
    state = {"0.weight": rng.normal(size=(3, 2)), "0.bias": rng.normal(size=3),
             "2.weight": rng.normal(size=(1, 3))}  # fmt: skip
    net = neural.from_torch(state, activation="tanh")
    x = rng.normal(size=2)
    expected = state["2.weight"] @ np.tanh(state["0.weight"] @ x + state["0.bias"])
    np.testing.assert_allclose(net(x), expected, atol=1e-15)


def test_the_update_gate_of_libraries_is_one_minus_ours() -> None:
    """h' = (1 - z) n + z h with n = tanh(W x + b + r (U h + c)), rows of r, z, n stacked."""
    rng = np.random.default_rng(2)
    shapes = {"weight_ih": (6, 2), "weight_hh": (6, 2), "bias_ih": 6, "bias_hh": 6}
    state = {f"{key}_l0": rng.normal(size=shape) for key, shape in shapes.items()}
    net = neural.from_torch(state)
    assert net.reset == "after"
    h, u = rng.normal(size=2), rng.normal(size=2)
    a = np.split(state["weight_ih_l0"] @ u + state["bias_ih_l0"], 3)
    b = np.split(state["weight_hh_l0"] @ h + state["bias_hh_l0"], 3)
    r, z = (1 / (1 + np.exp(-a[i] - b[i])) for i in (0, 1))
    n = np.tanh(a[2] + r * b[2])
    np.testing.assert_allclose(net.step(h, u)[0], (1 - z) * n + z * h, atol=1e-14)


class Conv1d:
    """What a foreign module looks like: nothing but its class name is known."""


def test_unknown_modules_are_refused_by_name() -> None:
    with pytest.raises(setid.ModelError, match="torch module Conv1d, expected Linear"):
        neural.from_torch(Conv1d())
    with pytest.raises(setid.ModelError, match="equinox module Conv1d"):
        neural.from_equinox(Conv1d())
    with pytest.raises(setid.ModelError, match="found arrays kernel, expected those of linear"):
        neural.from_torch({"kernel": np.zeros((2, 2))})
    model = SimpleNamespace(params=[np.zeros((2, 2))], nx=2, nu=1, ny=1, isLinear=False)
    with pytest.raises(setid.ModelError, match="with its own functions"):
        neural.from_jax_sysid(model)
    with pytest.raises(setid.ModelError, match="found int without params, nx, nu, ny"):
        neural.from_jax_sysid(3)


def recurrent() -> dict[str, np.ndarray]:
    shapes = {"weight_ih_l0": (4, 2), "weight_hh_l0": (4, 4), "bias_ih_l0": 4, "bias_hh_l0": 4}
    return {key: np.full(shape, 0.1) for key, shape in shapes.items()}


def test_arrays_that_belong_to_no_layer_are_refused() -> None:
    """A network without them would be another one than that which was trained."""
    head = {"fc.weight": np.ones((1, 4)), "fc.bias": [0.0]}
    with pytest.raises(setid.ModelError, match=r"found rnn.bias_hh_l0, .* beside known layers"):
        neural.from_torch({f"rnn.{key}": value for key, value in recurrent().items()} | head)
    with pytest.raises(setid.ModelError, match=r"found fc.bias, fc.weight beside known layers"):
        neural.from_torch(recurrent() | head)
    with pytest.raises(setid.ModelError, match="weight_hh_l0_reverse"):
        state = recurrent()
        neural.from_torch(state | {f"{key}_reverse": value for key, value in state.items()})
    with pytest.raises(setid.ModelError, match="found gain beside known layers"):
        neural.from_torch({"0.weight": [[1.0, 2.0]], "gain": [2.0]})
    with pytest.raises(setid.ModelError, match="expected one for all recurrent layers"):
        neural.from_torch(recurrent(), activation=["tanh", "relu"])


class Linear:
    def __init__(self, inputs: int, outputs: int) -> None:
        self.weight, self.bias = np.ones((outputs, inputs)), None


class LeakyReLU:
    def __init__(self, slope: float) -> None:
        self.negative_slope = slope


class Sequential(list):
    """Modules one after the other, known by its class name alone."""


def test_leaky_relus_of_several_slopes_are_refused() -> None:
    stack = [Linear(2, 3), LeakyReLU(0.1), Linear(3, 2), LeakyReLU(0.1), Linear(2, 1)]
    assert neural.from_torch(Sequential(stack)).leak == 0.1
    stack[3] = LeakyReLU(0.3)
    with pytest.raises(setid.ModelError, match=r"slopes \[0.1, 0.3\], expected one slope"):
        neural.from_torch(Sequential(stack))


def test_hooks_are_refused_wherever_a_module_may_have_them() -> None:
    """Old weight_norm leaves the class Linear and makes the weight in a hook before each call."""
    for name in ("_forward_hooks", "_forward_pre_hooks"):
        layer, stack = Linear(2, 1), Sequential([Linear(2, 1)])
        setattr(layer, name, {0: print})
        setattr(stack, name, {0: print})
        for call in (
            lambda layer=layer: neural.from_torch(layer),
            lambda layer=layer: neural.from_torch(Sequential([layer])),
            lambda stack=stack: neural.from_torch(stack),
            lambda layer=layer: neural.from_torch(recurrent(), output=layer),
        ):
            with pytest.raises(setid.ModelError, match="forward hooks"):
                call()


def test_layers_are_taken_in_the_order_of_their_numbers_or_refused() -> None:
    """Files that sort their names list 10 before 2; all layers of a width fit one another."""
    state = {f"{k}.weight": np.full((2, 2), float(k)) for k in range(11)}
    np.testing.assert_array_equal(neural.from_torch(state).weights[2], np.full((2, 2), 2.0))
    with pytest.raises(setid.ModelError, match=r"0\., 1\., 10\., 2\., .* expected ascending"):
        neural.from_torch(dict(sorted(state.items())))
    named = {"first1.weight": [[1.0]], "b.0.weight": [[2.0]], "a.1.weight": [[3.0]]}
    assert [w[0, 0] for w in neural.from_torch(named).weights] == [1, 2, 3]


def test_arguments_without_effect_are_refused() -> None:
    head = ([[1.0]], [0.0])
    for source in (Linear(2, 1), Sequential([Linear(2, 1)]), {"weight": [[1.0]]}):
        with pytest.raises(setid.ModelError, match="output: found .* beside"):
            neural.from_torch(source, output=head)
    gates = {"weight_ih_l0": np.ones((3, 1)), "weight_hh_l0": np.ones((3, 1))}
    assert neural.from_torch(gates, "tanh").states == 1
    with pytest.raises(setid.ModelError, match="activation: found 'relu', expected tanh"):
        neural.from_torch(gates, "relu")
    with pytest.raises(setid.ModelError, match="output: found scale beside"):
        neural.from_torch(recurrent(), output={"weight": [[1.0, 1.0]], "scale": [2.0]})
    for more in ({"output": head}, {"activation": "relu"}, {"final": "relu"}):
        with pytest.raises(setid.ModelError, match=f"{next(iter(more))}: found .* beside Linear"):
            neural.from_equinox(Linear(2, 1), **more)


def test_functions_are_known_by_their_home_and_not_by_their_name() -> None:
    """1 / (1 + exp(-4.9 x)) is called sigmoid by many; that of jax is another function."""

    def sigmoid(x: float) -> float:
        return 1 / (1 + np.exp(-4.9 * x))

    def home(module: str) -> FunctionType:
        return FunctionType(sigmoid.__code__, {"__name__": module}, "sigmoid")

    @functools.wraps(home("jax._src.nn.functions"))
    def wrapper(x: float) -> float:
        return 2 * x

    mlp = type("MLP", (), {})()
    mlp.layers, mlp.final_activation = [Linear(2, 3), Linear(3, 1)], home("jax._src.nn.functions")
    mlp.activation = home("jax._src.nn.functions")
    assert neural.from_equinox(mlp).activation == ("sigmoid", "sigmoid")
    for own in (sigmoid, wrapper, home("mine")):
        mlp.activation = own
        with pytest.raises(setid.ModelError, match="activation: found the function sigmoid"):
            neural.from_equinox(mlp)
        assert neural.from_equinox(mlp, activation="relu").activation == ("relu", "sigmoid")
    mlp.layers[0] = type("WeightNorm", (Linear,), {})(2, 3)
    with pytest.raises(setid.ModelError, match=r"layers\[0\]: found WeightNorm, expected Linear"):
        neural.from_equinox(mlp, activation="relu")


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ({"0.weight": np.array([[1.0 + 2.0j, 0.0]])}, r"source\['0.weight'\]: found ndarray"),
        ({"0.weight": [["1", "2"]]}, "expected real numbers"),
        (recurrent() | {"bias_ih_l0": np.zeros(3)}, r"biases of the shapes \(3,\) and \(4,\)"),
        ({"weight_ih_l0": np.ones((4, 2))}, "no matrix weight_hh_l0"),
        ({"weight_ih_l0": np.ones((9, 2)), "weight_hh_l0": np.ones((9, 3)),
          "bias_ih_l0": np.ones(8)}, r"with \[9, 9, 8, 9\] rows"),
    ],
)  # fmt: skip
def test_arrays_of_no_layer_are_named(state: dict, message: str) -> None:
    with pytest.raises(setid.ModelError, match=message):
        neural.from_torch(state)


@pytest.mark.parametrize("bad", [3, None, [[[1.0 + 1.0j]]], [[["1"]]]])
def test_weights_that_are_no_matrices_are_named(bad: object) -> None:
    with pytest.raises(setid.ModelError, match="weights"):
        neural.from_arrays(bad, [[0.0]])
    with pytest.raises(setid.ModelError, match="layers"):
        neural.Elman(bad, ([[1.0]], [0.0]))
    with pytest.raises(setid.ModelError, match=r"output|weights"):
        neural.Elman([([[1.0]], [[0.5]], [0.0])], 3 if bad is None else bad)


def test_files_that_cannot_be_read_are_named(tmp_path) -> None:
    with pytest.raises(setid.ModelError, match="No such file"):
        neural.from_arrays(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("W1")
    np.save(tmp_path / "one.npy", np.eye(2))
    np.savez(tmp_path / "whole.npz", W1=np.eye(2), b1=np.zeros(2))
    (tmp_path / "half.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:90])
    for name in ("text.npz", "one.npy", "half.npz"):
        with pytest.raises(setid.ModelError, match=rf"{name}.*expected"):
            neural.from_arrays(tmp_path / name)


def test_models_of_jax_sysid_are_checked() -> None:
    def model(*params: object) -> SimpleNamespace:
        return SimpleNamespace(params=params, nx=2, nu=1, ny=1, isLinear=True, y_in_x=False)

    net = neural.from_jax_sysid(model(0.5 * np.eye(2), np.ones((2, 1)), np.ones((1, 2))))
    assert net.states == 2
    with pytest.raises(setid.ModelError, match=r"shapes \[\(2, 2\)\], expected A, B, C and D"):
        neural.from_jax_sysid(model(np.eye(2)))
    with pytest.raises(setid.ModelError, match="expected A, B, C and D of 2 states"):
        neural.from_jax_sysid(model(np.eye(2), np.ones((3, 1)), np.ones((1, 2))))


@pytest.mark.parametrize("name", ["onnx", "torch"])
def test_missing_packages_are_named(name: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    load = neural.from_onnx if name == "onnx" else neural.from_torch
    with pytest.raises(ImportError, match=f"{name} is not installed; it is optional: pip install"):
        load(tmp_path / "file")


def test_missing_trainers_are_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    data = inputs(channels=1)
    net = neural.initial(data, 1, [2], kind=neural.NNOE)
    with pytest.raises(ImportError, match="casadi is not installed"):
        neural.train(net, data)


# ---- against the libraries themselves -------------------------------------------------------


@pytest.mark.slow
def test_torch_layers() -> None:
    torch = pytest.importorskip("torch", reason=PEER)
    torch.manual_seed(0)
    nn = torch.nn
    data = inputs()
    x = torch.tensor(np.array(data.u))
    stack = nn.Sequential(nn.Linear(2, 5), nn.Tanh(), nn.Linear(5, 4), nn.LeakyReLU(0.2),
                          nn.Linear(4, 3), nn.Sigmoid(), nn.Linear(3, 1)).double()  # fmt: skip
    net = neural.from_torch(stack)
    np.testing.assert_allclose(net(data.u), stack(x).detach().numpy(), atol=1e-12)
    head = nn.Linear(4, 1).double()
    for kind, layers in ((nn.RNN, 2), (nn.LSTM, 1), (nn.GRU, 1)):
        cell = kind(2, 4, num_layers=layers).double()
        net = neural.from_torch(cell, output=head)
        with torch.no_grad():
            expected = head(cell(x)[0]).numpy()
        np.testing.assert_allclose(net.simulate(data), expected, atol=1e-12)
    with pytest.raises(setid.ModelError, match="torch module Conv1d"):
        neural.from_torch(nn.Sequential(nn.Linear(2, 2), nn.Conv1d(1, 1, 1)))
    with pytest.raises(setid.ModelError, match="bidirectional"):
        neural.from_torch(nn.GRU(2, 4, bidirectional=True))


@pytest.mark.slow
def test_torch_files(tmp_path) -> None:
    torch = pytest.importorskip("torch", reason=PEER)
    cell = torch.nn.LSTM(2, 3).double()
    torch.save(cell.state_dict(), tmp_path / "cell.pt")
    data = inputs()
    with torch.no_grad():
        expected = cell(torch.tensor(np.array(data.u)))[0].numpy()
    net = neural.from_torch(tmp_path / "cell.pt", output=(np.eye(3)[:1], [0.0]))
    np.testing.assert_allclose(net.simulate(data)[:, 0], expected[:, 0], atol=1e-12)
    torch.save(cell, tmp_path / "whole.pt")  # a pickled module: refused by weights_only
    with pytest.raises(Exception, match="[Ww]eights.only"):
        neural.from_torch(tmp_path / "whole.pt")


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.5, 1.0, 1.25])
def test_torch_gradient_of_a_first_order_model(alpha: float) -> None:
    """d y_t / d alpha = t alpha^(t - 1) for y_t = alpha y_{t-1}, y_0 = 1, by backpropagation."""
    torch = pytest.importorskip("torch", reason=PEER)
    a = torch.tensor(alpha, dtype=torch.float64, requires_grad=True)
    y = torch.ones((), dtype=torch.float64)
    for t in range(1, 30):
        y = a * y
        (slope,) = torch.autograd.grad(y, a, retain_graph=True)
        assert float(slope) == pytest.approx(t * alpha ** (t - 1), rel=1e-12)


@pytest.mark.slow
def test_equinox_modules() -> None:
    jax = pytest.importorskip("jax", reason=PEER)
    eqx = pytest.importorskip("equinox", reason=PEER)
    jax.config.update("jax_enable_x64", True)
    key, data = jax.random.PRNGKey(0), inputs()
    for function in (jax.nn.tanh, jax.nn.relu, jax.nn.sigmoid):
        mlp = eqx.nn.MLP(2, 1, 5, 2, activation=function, key=key)
        name = {"relu": "relu", "sigmoid": "sigmoid"}.get(function.__name__, "tanh")
        net = neural.from_equinox(mlp, activation=name)
        np.testing.assert_allclose(net(data.u), jax.vmap(mlp)(data.u), atol=1e-12)
    head = eqx.nn.Linear(4, 1, key=key)
    for kind in (eqx.nn.GRUCell, eqx.nn.LSTMCell):
        cell = kind(2, 4, key=key)
        net = neural.from_equinox(cell, output=head)
        state = jax.numpy.zeros(4)
        state = (state, state) if kind is eqx.nn.LSTMCell else state
        found = net.simulate(data)
        for t in range(data.samples):
            state = cell(data.u[t], state)
            h = state[0] if kind is eqx.nn.LSTMCell else state
            np.testing.assert_allclose(found[t], head(h), atol=1e-12)


@pytest.mark.slow
def test_jax_sysid_models() -> None:
    jax = pytest.importorskip("jax", reason=PEER)
    models = pytest.importorskip("jax_sysid.models", reason=PEER)
    nn = pytest.importorskip("flax.linen", reason=PEER)
    jax.config.update("jax_enable_x64", True)

    class FX(nn.Module):
        @nn.compact
        def __call__(self, x):
            return nn.Dense(3)(nn.tanh(nn.Dense(5)(x)))

    class FY(nn.Module):
        @nn.compact
        def __call__(self, x):
            return nn.Dense(1)(nn.tanh(nn.Dense(4)(x)))

    data = inputs()
    model = models.RNN(3, 1, 2, FX=FX, FY=FY, x_scaling=1.0)
    net = neural.from_jax_sysid(model)
    expected, _ = model.predict(model.x0, np.array(data.u))
    np.testing.assert_allclose(net.simulate(data), np.asarray(expected).reshape(-1, 1), atol=1e-6)


@pytest.mark.slow
def test_onnx_chains(tmp_path) -> None:
    onnx = pytest.importorskip("onnx", reason=PEER)
    rng = np.random.default_rng(0)
    w = [rng.normal(size=(2, 4)), rng.normal(size=(3, 4)), rng.normal(size=(3, 1))]
    b = [rng.normal(size=4), rng.normal(size=3)]
    helper, to = onnx.helper, onnx.numpy_helper.from_array
    numbers = [to(a, n) for a, n in zip([*w, *b], ["W1", "W2", "W3", "b1", "b2"], strict=True)]
    nodes = [
        helper.make_node("MatMul", ["x", "W1"], ["a"]),
        helper.make_node("Add", ["a", "b1"], ["c"]),
        helper.make_node("LeakyRelu", ["c"], ["d"], alpha=0.25),
        helper.make_node("Gemm", ["d", "W2", "b2"], ["e"], transB=1),
        helper.make_node("Tanh", ["e"], ["f"]),
        helper.make_node("MatMul", ["f", "W3"], ["y"]),
    ]
    double = onnx.TensorProto.DOUBLE

    def save(chain, path) -> None:
        ends = [helper.make_tensor_value_info(n, double, [1, s]) for n, s in (("x", 2), ("y", 1))]
        graph = helper.make_graph(chain, "net", ends[:1], ends[1:], numbers)
        onnx.save(helper.make_model(graph), str(path))

    save(nodes, tmp_path / "net.onnx")
    net = neural.from_onnx(tmp_path / "net.onnx")
    x = rng.normal(size=(6, 2))
    a = x @ w[0] + b[0]
    expected = np.tanh(np.where(a > 0, a, 0.25 * a) @ w[1].T + b[1]) @ w[2]
    np.testing.assert_allclose(net(x), expected, atol=1e-12)
    usual = list(nodes)
    for place, node, message in (
        (3, helper.make_node("Gemm", ["d", "W2", "d"], ["e"], transB=1), "found the inputs d, d"),
        (4, helper.make_node("LeakyRelu", ["e"], ["f"], alpha=0.5), "slopes"),
        (5, helper.make_node("MatMul", ["f", "W3"], ["z"]), "output: found y, expected z"),
    ):
        nodes[place] = node
        save(nodes, tmp_path / "other.onnx")
        with pytest.raises(setid.ModelError, match=message):
            neural.from_onnx(tmp_path / "other.onnx")
        nodes = list(usual)
    (tmp_path / "odd.onnx").write_text("no model")
    with pytest.raises(setid.ModelError, match="expected an ONNX file"):
        neural.from_onnx(tmp_path / "odd.onnx")
    nodes[4] = helper.make_node("Softplus", ["e"], ["f"])
    save(nodes, tmp_path / "odd.onnx")
    with pytest.raises(setid.ModelError, match="ONNX operator Softplus, expected Gemm"):
        neural.from_onnx(tmp_path / "odd.onnx")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chain", "shape", "message"),
    [
        ([("MatMul", "x", "W"), ("Add", "s", "row")], ["n", 3], None),
        ([("MatMul", "x", "W"), ("Add", "s", "column")], ["n", 3], r"shape \(3, 1\), expected"),
        ([("MatMul", "W", "x"), ("Add", "s", "column")], [3, "n"], None),
        ([("MatMul", "W", "x"), ("Add", "s", "row")], [3, "n"], r"shape \(3,\), expected"),
        ([("MatMul", "W", "x"), ("Add", "s", "row")], [3], None),
        ([("MatMul", "W", "x"), ("MatMul", "s", "W")], [3], None),
        ([("MatMul", "W", "x"), ("MatMul", "s", "W")], ["n", 3], "expected all layers alike"),
        ([("MatMul", "x", "W"), ("MatMul", "W", "s")], ["n", 3], "expected all layers alike"),
        ([("Gemm", "x", "W", "column")], ["n", 3], r"shape \(3, 1\), expected"),
        ([("Gemm", "x", "W", "one")], ["n", 3], None),
        ([("MatMul", "x", "W"), ("Add", "s", "table")], ["n", 3], r"shape \(3, 3\), expected"),
    ],
)
def test_samples_of_onnx_are_rows_or_columns(chain, shape, message, tmp_path) -> None:
    """The reference evaluator of onnx computes 3 samples; ours are the same or the file is refused.

    Three samples of three inputs are where broadcasting mixes up the two axes unnoticed.
    """
    onnx = pytest.importorskip("onnx", reason=PEER)
    rng = np.random.default_rng(3)
    held = {"W": (3, 3), "row": (3,), "column": (3, 1), "one": (1,), "table": (3, 3)}
    numbers = [onnx.numpy_helper.from_array(rng.normal(size=s), n) for n, s in held.items()]
    signal, nodes = "x", []
    for k, (kind, *given) in enumerate(chain):
        end = "y" if k == len(chain) - 1 else f"s{k}"
        given = [signal if name in ("x", "s") else name for name in given]
        nodes.append(onnx.helper.make_node(kind, given, [end]))
        signal = end
    double = onnx.TensorProto.DOUBLE
    ends = [onnx.helper.make_tensor_value_info(n, double, shape) for n in ("x", "y")]
    graph = onnx.helper.make_graph(nodes, "net", ends[:1], ends[1:], numbers)
    model = onnx.helper.make_model(graph)
    onnx.save(model, str(tmp_path / "net.onnx"))
    if message is not None:
        with pytest.raises(setid.ModelError, match=message):
            neural.from_onnx(tmp_path / "net.onnx")
        return
    run = pytest.importorskip("onnx.reference", reason=PEER).ReferenceEvaluator(model).run
    x = rng.normal(size=(3, 3) if len(shape) == 2 else 3)
    (expected,) = run(None, {"x": x})
    turned = shape[-1] == "n"
    found = neural.from_onnx(tmp_path / "net.onnx")(x.T if turned else x)
    np.testing.assert_allclose(found.T if turned else found, expected, atol=1e-12)


@pytest.mark.slow
def test_half_precision_and_sparse_tensors_of_torch() -> None:
    torch = pytest.importorskip("torch", reason=PEER)
    for kind in (torch.bfloat16, torch.float16):
        weight = torch.tensor([[1 / 3, 2.0]]).to(kind)
        found = neural.from_torch({"weight": weight}).weights[0]
        np.testing.assert_array_equal(found, [[float(weight[0, 0]), 2.0]])
    found = neural.from_torch({"weight": torch.eye(2).to_sparse()}).weights[0]
    np.testing.assert_array_equal(found, np.eye(2))
    with pytest.raises(setid.ModelError, match="expected real numbers"):
        neural.from_torch(torch.nn.Linear(2, 1, device="meta"))
    layer = torch.nn.Linear(2, 1)
    layer.register_forward_hook(lambda module, inputs, output: 2 * output)
    with pytest.raises(setid.ModelError, match="forward hooks"):
        neural.from_torch(torch.nn.Sequential(layer))
