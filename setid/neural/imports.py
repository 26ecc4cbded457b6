"""Weights from elsewhere: arrays, torch, equinox, jax-sysid and ONNX. Nothing executes on loading.

Files are read as numbers only (``weights_only`` of torch, ``allow_pickle=False`` of numpy, the
tensors of ONNX). Kinds of layers are recognised by their class names; an unknown one is refused by
its name. The models are those of the imported numbers: sums of two biases are rounded once.
"""

from __future__ import annotations

import os
import pickle
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import permutations
from types import FunctionType
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import ModelError
from setid.data.checks import entries_of, natural, real_array
from setid.neural.models.network import Network
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.training.shooting import optional

__all__ = ["from_arrays", "from_equinox", "from_jax_sysid", "from_onnx", "from_torch"]

Reals = NDArray[np.float64]
Path = str | os.PathLike[str]
Imported = Network | Elman | LSTM | GRU
_LEAK = 0.01  # slope of leaky ReLU where nothing is said
_TORCH = {"Tanh": "tanh", "Sigmoid": "sigmoid", "ReLU": "relu", "LeakyReLU": "leaky_relu",
          "Identity": "identity"}  # fmt: skip
_ONNX = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Relu": "relu", "LeakyRelu": "leaky_relu"}
_ONNX_USED = {"Gemm": {"alpha", "beta", "transA", "transB", "broadcast"}, "MatMul": set(),
              "Add": {"broadcast"}, "Identity": set()}  # fmt: skip
_FUNCTIONS = {"tanh": "tanh", "sigmoid": "sigmoid", "relu": "relu", "leaky_relu": "leaky_relu",
              "_identity": "identity", "identity": "identity"}  # fmt: skip


def from_arrays(
    weights: Sequence[ArrayLike] | Path,
    biases: Sequence[ArrayLike] | None = None,
    activation: str | Sequence[str] = "tanh",
    leak: float = 0.01,
) -> Network:
    """Read a network from arrays, or from an ``.npz`` file with ``W1``, ``b1``, ``W2``, ...

    Parameters
    ----------
    weights : sequence of (outputs, inputs) array_like, or path
    biases : sequence of (outputs,) array_like, optional
        Left out for a file.
    activation, leak
        As for :class:`Network`.

    Raises
    ------
    ModelError
        Naming the array that is missing or has the wrong shape.

    Examples
    --------
    >>> from setid import neural
    >>> neural.from_arrays([[[1.0, 2.0]], [[3.0]]], [[0.0], [1.0]], "relu").parameters
    5
    """
    if isinstance(weights, (str, os.PathLike)):
        _alone(biases, "biases", "a file, which holds its own")
        with _reading(weights, "an .npz file"), open(weights, "rb") as stream:
            file = np.load(stream, allow_pickle=False)
            held = dict(file) if isinstance(file, Mapping) else {}
        count = sum(name.startswith("W") for name in held)
        for name in (f"{letter}{i + 1}" for i in range(max(count, 1)) for letter in "Wb"):
            if name not in held:
                raise ModelError(f"{os.fspath(weights)}: found no array {name}, expected W1, "
                                 "b1, W2, ...")  # fmt: skip
        if len(held) > 2 * count:
            raise ModelError(f"{os.fspath(weights)}: found the arrays {', '.join(sorted(held))}, "
                             f"expected W1, b1 to W{count}, b{count} alone")  # fmt: skip
        return Network(
            [held[f"W{i + 1}"] for i in range(count)],
            [held[f"b{i + 1}"] for i in range(count)],
            activation,
            leak,
        )
    if biases is None:
        raise ModelError("biases: found None, expected one array a layer")
    return Network(weights, biases, activation, leak)


@contextmanager
def _reading(path: Path, what: str, *others: type[Exception]) -> Iterator[None]:
    """Name a file that cannot be read, and why."""
    damaged: tuple[type[Exception], ...] = (
        ValueError,
        EOFError,
        BadZipFile,
        pickle.UnpicklingError,
        zlib.error,
        *others,
    )
    try:
        yield
    except OSError as error:
        raise ModelError(f"{os.fspath(path)}: {error.strerror or error}, expected {what}") from None
    except damaged as error:
        raise ModelError(f"{os.fspath(path)}: {error!s:.300}, expected {what}") from None


def _alone(given: Any, field: str, beside: str) -> None:
    """Refuse an argument that would be without effect."""
    if given is not None:
        raise ModelError(f"{field}: found {given!r:.60} beside {beside}, expected None")


# ---- torch ----------------------------------------------------------------------------------


def from_torch(
    source: Any,
    activation: str | Sequence[str] = "tanh",
    output: Any = None,
) -> Imported:
    """Read a torch module, its ``state_dict`` or a file that holds one.

    Parameters
    ----------
    source : torch.nn.Module, mapping of str to tensor, or path
        ``Linear``, ``Sequential`` of ``Linear`` and activations, ``RNN``, ``LSTM`` or ``GRU``
        (one layer, one direction; several layers for ``RNN``), without hooks. A file is loaded
        with ``weights_only=True``. Layers of a ``state_dict`` are applied in its order; where
        they differ by their numbers, these ascend.
    activation : str or sequence of str
        Used where only a ``state_dict`` is there, which does not hold it.
    output : torch.nn.Linear, mapping or (W, b), optional
        Output layer of a recurrent network, and of no other.

    Returns
    -------
    Network, Elman, LSTM or GRU
        A GRU comes with ``reset="after"`` and the update gate of the notes, which is one minus
        that of torch.

    Raises
    ------
    ModelError
        Naming the layer that is unknown, or has hooks, which compute something else than its
        weights say.

    Examples
    --------
    >>> from setid import neural
    >>> neural.from_torch({"0.weight": [[1.0, 2.0]], "0.bias": [0.5]})([1.0, 1.0])
    array([3.5])
    """
    if isinstance(source, (str, os.PathLike)):
        torch = optional("torch", "torch")
        with _reading(source, "a file of torch", RuntimeError):
            source = torch.load(source, map_location="cpu", weights_only=True)
    if isinstance(source, Mapping):
        return _from_state(_numbers(source), activation, _linear(output))
    kind = type(source).__name__
    _without_hooks(source, "source")
    if kind in ("Linear", "Sequential"):
        _alone(output, "output", f"a {kind}, which is no recurrent network")
        return _from_sequence([source] if kind == "Linear" else list(source))
    if kind not in ("RNN", "LSTM", "GRU"):
        raise ModelError(f"source: found a torch module {kind}, expected Linear, Sequential, RNN, "
                         "LSTM or GRU")  # fmt: skip
    if getattr(source, "bidirectional", False) or getattr(source, "proj_size", 0):
        raise ModelError(f"source: found a bidirectional or projected {kind}, expected neither")
    name = getattr(source, "nonlinearity", "tanh")
    return _from_state(_numbers(source.state_dict()), name, _linear(output))


def _array(tensor: Any, field: str = "source") -> Reals:
    """A tensor of any library as doubles."""
    try:
        if hasattr(tensor, "is_floating_point") and tensor.is_floating_point():
            tensor = tensor.double()  # numpy knows no bfloat16
        for step in ("detach", "to_dense", "cpu", "numpy"):
            tensor = getattr(tensor, step)() if hasattr(tensor, step) else tensor
    except (TypeError, RuntimeError) as error:  # such as tensors without data
        raise ModelError(f"{field}: {error!s:.200}, expected real numbers") from None
    return real_array(tensor, field, ModelError)


def _without_hooks(module: Any, field: str) -> None:
    """Refuse a torch module that computes something else than its weights say.

    Hooks change inputs and outputs, or make the weights anew in each call, as weight_norm,
    spectral_norm and pruning do.
    """
    for name in ("_forward_hooks", "_forward_pre_hooks"):
        if getattr(module, name, None):
            raise ModelError(f"{field}: found a {type(module).__name__} with forward hooks, as of "
                             "weight_norm, spectral_norm or pruning, expected none: make the "
                             "weights permanent (remove_weight_norm, prune.remove)")  # fmt: skip


def _numbers(state: Mapping[str, Any], field: str = "source") -> dict[str, Reals]:
    return {str(key): _array(value, f"{field}[{key!r}]") for key, value in state.items()}


def _bias(layer: Any, field: str = "source") -> Reals:
    if layer.bias is None:
        return np.zeros(_array(layer.weight, field).shape[:1])
    return _array(layer.bias, field)


def _linear(given: Any) -> Any:
    """An output layer of a recurrent network as (W, b)."""
    if given is None or isinstance(given, Network):
        return given
    if isinstance(given, Mapping):
        state = _numbers(given, "output")
        if "weight" not in state or not state["weight"].ndim:
            raise ModelError(f"output: found arrays {', '.join(state) or 'none'}, expected weight "
                             "and bias of a linear layer")  # fmt: skip
        _used(state, {"weight", "bias"}, "output")
        return state["weight"], state.get("bias", np.zeros(len(state["weight"])))
    if hasattr(given, "weight"):
        kind = type(given).__name__
        if kind != "Linear":
            raise ModelError(f"output: found a module {kind}, expected Linear or (W, b)")
        _without_hooks(given, "output")
        return _array(given.weight, "output"), _bias(given, "output")
    return given


def _from_sequence(modules: list[Any]) -> Network:
    weights: list[Reals] = []
    biases: list[Reals] = []
    names: list[str] = []
    leaks: list[float] = []
    for place, module in enumerate(modules):
        kind = type(module).__name__
        _without_hooks(module, f"source[{place}]")
        if kind == "Linear":
            weights.append(_array(module.weight))
            biases.append(_bias(module))
            names.append("identity")
        elif kind in _TORCH and weights and names[-1] == "identity":
            names[-1] = _TORCH[kind]
            if kind == "LeakyReLU":
                leaks.append(float(getattr(module, "negative_slope", _LEAK)))
        elif kind not in ("Identity", "Dropout"):
            raise ModelError(f"source[{place}]: found a torch module {kind}, expected Linear "
                             f"followed by one of {', '.join(_TORCH)}")  # fmt: skip
    return Network(weights, biases, names, _one_slope(leaks))


def _one_slope(leaks: list[float]) -> float:
    """The slope of all leaky ReLUs of a network, which has one."""
    if len(set(leaks)) > 1:
        raise ModelError(f"source: found leaky ReLUs of the slopes {sorted(set(leaks))}, expected "
                         "one slope")  # fmt: skip
    return leaks[0] if leaks else _LEAK


def _used(state: dict[str, Reals], names: set[str], field: str = "source") -> None:
    """Refuse arrays that belong to no known layer: a network without them would be another one."""
    rest = sorted(set(state) - names)
    if rest:
        raise ModelError(f"{field}: found {', '.join(rest):.200} beside known layers, expected the "
                         "arrays of linear layers alone, or of RNN, LSTM or GRU alone")  # fmt: skip


def _from_state(state: dict[str, Reals], activation: str | Sequence[str], output: Any) -> Imported:
    if "weight_ih_l0" in state:
        return _recurrent(state, activation, output)
    _alone(output, "output", "linear layers, which are no recurrent network")
    keys = [key[: -len("weight")] for key in state if key.endswith("weight")]
    matrices = [state[f"{key}weight"] for key in keys]
    if not keys or any(matrix.ndim != 2 for matrix in matrices):
        raise ModelError(f"source: found arrays {', '.join(state) or 'none'}, expected those of "
                         "linear layers or of RNN, LSTM or GRU")  # fmt: skip
    _used(state, {f"{key}{part}" for key in keys for part in ("weight", "bias")})
    _ascending(keys)
    biases = [state.get(f"{key}bias", np.zeros(len(m)))
              for key, m in zip(keys, matrices, strict=True)]  # fmt: skip
    return Network(matrices, biases, activation, _LEAK)


def _ascending(keys: list[str]) -> None:
    """Refuse layers whose numbers do not ascend, as where files list 10 before 2."""
    last: dict[str, list[int]] = {}
    for key in keys:
        numbers = [int(digits) for digits in re.findall("[0-9]+", key)]
        stem = re.sub("[0-9]+", "#", key)
        if numbers < last.get(stem, numbers):
            raise ModelError(f"source: found the layers {', '.join(keys):.200} in this order, "
                             "expected ascending numbers, the order in which layers are "
                             "applied")  # fmt: skip
        last[stem] = numbers


def _recurrent(state: dict[str, Reals], activation: str | Sequence[str], output: Any) -> Imported:
    layers = next(i for i in range(len(state) + 1) if f"weight_ih_l{i}" not in state)
    names = [f"{part}_{way}_l{i}" for i in range(layers) for part in ("weight", "bias")
             for way in ("ih", "hh")]  # fmt: skip
    _used(state, set(names))
    parts = []
    for i in range(layers):
        for name in (f"weight_ih_l{i}", f"weight_hh_l{i}"):
            if np.ndim(state.get(name, 0.0)) != 2 or not state[name].size:
                raise ModelError(f"source: found no matrix {name}, expected one")
        fed, back = state[f"weight_ih_l{i}"], state[f"weight_hh_l{i}"]
        zero = np.zeros(len(fed))
        parts.append((fed, back, state.get(f"bias_ih_l{i}", zero),
                      state.get(f"bias_hh_l{i}", zero)))  # fmt: skip
    fed, back, inner, outer = parts[0]
    count = len(back) // back.shape[1]
    if count == 1:
        cells = [(w, v, _sum(a, b)) for w, v, a, b in parts]
        return Elman(cells, output, _one_name(activation))
    if layers > 1:
        raise ModelError(f"source: found {layers} gated layers, expected one")
    if _one_name(activation) != "tanh":
        raise ModelError(f"activation: found {activation!r:.60}, expected tanh, that of gated "
                         "layers")  # fmt: skip
    return _gated(fed, back, inner, outer, count, output)


def _sum(inner: Reals, outer: Reals) -> Reals:
    """The bias of a recurrent layer, of which libraries keep two."""
    if inner.shape != outer.shape:
        raise ModelError(f"source: found biases of the shapes {inner.shape} and {outer.shape}, "
                         "expected equal ones")  # fmt: skip
    return inner + outer


def _one_name(activation: str | Sequence[str]) -> str:
    """The activation of all recurrent layers."""
    listed = entries_of(activation, "activation", "a name", ModelError)
    names = {activation} if isinstance(activation, str) else set(map(str, listed))
    if len(names) != 1:
        raise ModelError(f"activation: found {activation!r:.60}, expected one for all recurrent "
                         "layers")  # fmt: skip
    return str(names.pop())


def _gated(
    fed: Reals, back: Reals, inner: Reals, outer: Reals, count: int, output: Any
) -> LSTM | GRU:
    """Gates of LSTM (i, f, g, o) or GRU (r, z, n) stacked as torch and equinox do."""
    rows = [np.shape(a)[0] if np.ndim(a) else 0 for a in (fed, back, inner, outer)]
    if len(set(rows)) > 1 or not rows[0] or rows[0] % count:
        raise ModelError(f"source: found weights and biases with {rows} rows, expected equal "
                         f"multiples of {count} gates")  # fmt: skip
    split = [np.split(a, count) for a in (fed, back, inner, outer)]
    gate = [(w, v, a + b) for w, v, a, b in zip(*split, strict=True)]
    if count == 4:
        return LSTM(gate[1], gate[0], gate[3], gate[2], output)
    if count != 3:
        raise ModelError(f"source: found {count} gates, expected 1 (RNN), 3 (GRU) or 4 (LSTM)")
    w, v, b = gate[1]
    candidate = (split[0][2], split[1][2], split[2][2], split[3][2])
    return GRU((-w, -v, -b), gate[0], candidate, output, reset="after")


# ---- equinox --------------------------------------------------------------------------------


def from_equinox(
    source: Any, activation: str | None = None, output: Any = None, final: str | None = None
) -> Imported:
    """Read ``Linear``, ``MLP``, ``LSTMCell`` or ``GRUCell`` of equinox.

    Parameters
    ----------
    source : equinox module
    activation : str, optional
        Of the hidden layers; read from the module's function where left out.
    output : equinox Linear or (W, b), optional
        Output layer of a cell, and of nothing else.
    final : str, optional
        Activation of the last layer; where left out it is read likewise, and equinox's own
        default is the identity.

    Returns
    -------
    Network, LSTM or GRU
        A GRU comes with ``reset="after"``.

    Raises
    ------
    ModelError
        Naming the module or the activation that is unknown: functions of jax and equinox are
        known by their names, a function of your own never is.
    """
    kind = type(source).__name__
    parts = {"Linear": ("weight", "bias"), "MLP": ("layers", "activation", "final_activation")}
    missing = [name for name in parts.get(kind, ()) if not hasattr(source, name)]
    if missing:
        raise ModelError(f"source: found {kind} without {', '.join(missing)}, expected a module of "
                         "equinox")  # fmt: skip
    if kind in ("Linear", "MLP"):
        _alone(output, "output", f"{kind}, which is no recurrent cell")
    if kind == "MLP":
        return _mlp(source, activation, final)
    for field, given in (("activation", activation), ("final", final)):
        _alone(given, field, f"{kind}, whose activations are fixed")
    if kind == "Linear":
        return Network([_array(source.weight)], [_bias(source)], "identity")
    if kind not in ("LSTMCell", "GRUCell"):
        raise ModelError(
            f"source: found an equinox module {kind}, expected Linear, MLP, LSTMCell or GRUCell"
        )
    fed, back = _array(source.weight_ih), _array(source.weight_hh)
    inner = np.zeros(len(fed)) if source.bias is None else _array(source.bias)
    outer = np.zeros(len(fed))
    if kind == "GRUCell" and getattr(source, "bias_n", None) is not None:
        extra = _array(source.bias_n, "source.bias_n")
        if 3 * extra.size != len(fed):
            raise ModelError(
                f"source.bias_n: found shape {extra.shape}, expected ({len(fed) // 3},)"
            )
        outer[-extra.size :] = extra.ravel()
    count = 4 if kind == "LSTMCell" else 3
    return _gated(fed, back, inner, outer, count, _linear(output))


def _mlp(source: Any, activation: str | None, final: str | None) -> Network:
    layers = list(source.layers)
    for place, layer in enumerate(layers):
        if type(layer).__name__ != "Linear":
            raise ModelError(
                f"source.layers[{place}]: found {type(layer).__name__}, expected Linear"
            )
    hidden = activation or _function_name(source.activation, "activation")
    final = final or _function_name(source.final_activation, "final_activation")
    names = [hidden] * (len(layers) - 1) + [final]
    return Network([_array(m.weight) for m in layers], [_bias(m) for m in layers], names)


def _function_name(function: Any, field: str) -> str:
    """The activation that a function of jax or equinox is called after.

    Wrappers bear the name of what they wrap, so that each plain function on the way counts:
    one from elsewhere, or whose code has another name, computes something else.
    """
    chain = [function]
    while hasattr(chain[-1], "__wrapped__"):
        chain.append(chain[-1].__wrapped__)
    last = chain[-1]
    name = getattr(last, "__name__", type(last).__name__)
    plain = [part for part in chain if isinstance(part, FunctionType)]
    homes = {str(part.__globals__.get("__name__")).partition(".")[0] for part in plain}
    known = homes <= {"jax", "equinox"} and {part.__code__.co_name for part in plain} <= {name}
    found = "identity" if name == "<lambda>" and homes == {"equinox"} else _FUNCTIONS.get(name)
    if found is None or not known:
        raise ModelError(
            f"{field}: found the function {name}, expected a known name of jax or equinox: pass "
            "activation= or final="
        )
    return found


# ---- jax-sysid ------------------------------------------------------------------------------


def from_jax_sysid(
    source: Any, activation: str = "tanh", order: Sequence[int] | None = None
) -> NeuralStateSpace:
    """Read an ``RNN`` (flax ``Dense`` layers) or a ``LinearModel`` of jax-sysid.

    Parameters
    ----------
    source : jax_sysid model
        Fitted or not; its ``params`` are read.
    activation : str
        Of the hidden layers; the functions themselves are never called.
    order : sequence of int, optional
        Order in which the ``Dense`` layers are applied, by their numbers; asked for only where
        their shapes allow several.

    Returns
    -------
    NeuralStateSpace

    Raises
    ------
    ModelError
        If the arrays are not those of such a model.
    """
    missing = [name for name in ("params", "nx", "nu", "ny") if not hasattr(source, name)]
    if missing:
        raise ModelError(f"source: found {type(source).__name__} without {', '.join(missing)}, "
                         "expected a model of jax-sysid")  # fmt: skip
    listed = entries_of(source.params, "source.params", "a list of arrays", ModelError)
    params = [_array(p, f"source.params[{i}]") for i, p in enumerate(listed)]
    nx, nu, ny = (
        natural(getattr(source, n), f"source.{n}", ModelError) for n in ("nx", "nu", "ny")
    )
    if getattr(source, "isLinear", False):
        return _linear_model(params, nx, nu, ny, bool(source.y_in_x))
    split = getattr(source, "nthx", None)
    if split is None:
        raise ModelError(f"source: found {type(source).__name__} with its own functions, expected "
                         "RNN or LinearModel; build NeuralStateSpace from its arrays")  # fmt: skip
    transition = _flax(params[:split], nx, nu, nx, activation, order)
    if source.y_in_x:
        shown = np.hstack([np.zeros((ny, nu)), np.eye(ny, nx)])
        return NeuralStateSpace(transition, Network([shown], [np.zeros(ny)]))
    return NeuralStateSpace(transition, _flax(params[split:], nx, nu, ny, activation, order))


def _linear_model(params: list[Reals], nx: int, nu: int, ny: int, shown: bool) -> NeuralStateSpace:
    usual = [np.zeros((nx, nx)), np.zeros((nx, nu)), np.eye(ny, nx), np.zeros((ny, nu))]
    given = [*params, *usual[len(params) :]] if 2 <= len(params) <= 4 else []
    if [p.shape for p in given] != [p.shape for p in usual]:
        raise ModelError(f"source.params: found the shapes {[p.shape for p in params]}, expected "
                         f"A, B, C and D of {nx} states, {nu} inputs and {ny} outputs")  # fmt: skip
    a, b, c, d = given
    c = usual[2] if shown else c
    return NeuralStateSpace(
        Network([np.hstack([b, a])], [np.zeros(nx)]), Network([np.hstack([d, c])], [np.zeros(ny)])
    )


def _flax(
    params: list[Reals], nx: int, nu: int, ends: int, activation: str, order: Sequence[int] | None
) -> Network:
    """Dense layers (bias, kernel) of flax; the first takes [x, u].

    Flax names layers in the order in which they are built, not applied, so that the order is
    taken from the shapes where these leave only one.
    """
    if len(params) % 2 or any(p.ndim != 1 + i % 2 for i, p in enumerate(params)):
        raise ModelError("source.params: found other arrays than (bias, kernel) of Dense layers")
    biases, kernels = params[0::2], params[1::2]
    count = len(kernels)
    fits = [
        choice
        for choice in (permutations(range(count)) if order is None else [_order(order)])
        if sorted(choice) == list(range(count))
        and [nx + nu, *(kernels[i].shape[1] for i in choice)]
        == [*(kernels[i].shape[0] for i in choice), ends]
    ]
    if len(fits) != 1:
        shapes = ", ".join(str(k.shape) for k in kernels)
        raise ModelError(
            f"source.params: found {len(fits)} orders in which layers of shapes {shapes} make a "
            f"chain from {nx + nu} to {ends}, expected one: pass order="
        )
    weights = [kernels[i].T for i in fits[0]]
    weights[0] = np.hstack([weights[0][:, nx:], weights[0][:, :nx]])
    return Network(weights, [biases[i] for i in fits[0]], activation)


def _order(given: Any) -> tuple[Any, ...]:
    return tuple(entries_of(given, "order", "numbers of layers", ModelError))


# ---- ONNX -----------------------------------------------------------------------------------


def from_onnx(path: Path) -> Network:
    """Read a chain of Gemm, MatMul, Add and activations from an ONNX file.

    Parameters
    ----------
    path : path-like
        Samples are rows, x W + b as in Gemm, or columns, W x + b, in all layers alike.

    Returns
    -------
    Network

    Raises
    ------
    ModelError
        Naming the operator that is unknown, or the attribute that is not supported.
    ImportError
        If onnx is not installed.
    """
    onnx, graph = _graph(path)
    numbers = {item.name: _tensor(onnx, item) for item in graph.initializer}
    chain = _Chain(_rank(graph, numbers))
    flow = next((item.name for item in graph.input if item.name not in numbers), "")
    for place, node in enumerate(graph.node):
        label = f"node {place + 1} ({node.name or node.op_type})"
        unknown = [name for name in node.input if name and name not in numbers]
        if unknown != [flow]:
            raise ModelError(f"{label}: found the inputs {', '.join(unknown) or 'none'}, expected "
                             f"{flow} and constants: a chain of layers")  # fmt: skip
        given = [numbers[name] for name in node.input if name in numbers]
        attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
        chain.add(node, given, attributes, label, first=node.input[0] == flow)
        flow = node.output[0]
    shown = [item.name for item in graph.output]
    if shown != [flow]:
        raise ModelError(f"output: found {', '.join(shown) or 'none'}, expected {flow}, the end of "
                         "the chain")  # fmt: skip
    return Network(chain.weights, chain.biases, chain.names, _one_slope(chain.leaks))


def _graph(path: Path) -> tuple[Any, Any]:
    """The package onnx, and the graph of a file."""
    if not isinstance(path, (str, os.PathLike)):
        raise ModelError(f"path: found {type(path).__name__}, expected that of an ONNX file")
    onnx = optional("onnx", "onnx")
    damaged = optional("google.protobuf.message", "onnx").DecodeError
    with _reading(path, "an ONNX file", damaged):
        graph = onnx.load(os.fspath(path), load_external_data=False).graph
    if not graph.input:
        raise ModelError(f"{os.fspath(path)}: found a graph without inputs, expected a chain of "
                         "layers")  # fmt: skip
    return onnx, graph


def _rank(graph: Any, numbers: Mapping[str, Reals]) -> int | None:
    """The number of axes of the input, where the file says it."""
    kinds = [item.type.tensor_type for item in graph.input if item.name not in numbers]
    return len(kinds[0].shape.dim) if kinds and kinds[0].HasField("shape") else None


def _tensor(onnx: Any, item: Any) -> Reals:
    if item.data_location == onnx.TensorProto.EXTERNAL:
        raise ModelError(f"{item.name}: found weights in another file, expected them in the model")
    with _reading(item.name, "numbers"):
        found = onnx.numpy_helper.to_array(item)
    if found.dtype.kind == "V":  # bfloat16 and others of ml_dtypes
        found = found.astype(float)
    return real_array(found, item.name, ModelError)


class _Chain:
    """Layers of an ONNX graph, and whether samples are rows or columns. Mutable."""

    def __init__(self, rank: int | None) -> None:
        self.weights: list[Reals] = []
        self.biases: list[Reals] = []
        self.names: list[str] = []
        self.leaks: list[float] = []
        self._samples = "one" if rank == 1 else ""  # "rows" and "columns" by the first layer

    def add(
        self, node: Any, given: list[Reals], attributes: dict[str, Any], label: str, first: bool
    ) -> None:
        """Add an operator with its constants; ``first``: the signal is its first input."""
        kind = node.op_type
        if node.domain not in ("", "ai.onnx") or kind not in (*_ONNX_USED, *_ONNX):
            raise ModelError(f"{label}: found the ONNX operator {node.domain} {kind}, expected "
                             f"{', '.join((*_ONNX_USED, *_ONNX))}".replace("  ", " "))  # fmt: skip
        other = sorted(set(attributes) - _ONNX_USED.get(kind, {"alpha"}))
        if other:
            raise ModelError(f"{label}: found the attribute {other[0]}, expected none like it")
        if kind in ("Gemm", "MatMul"):
            self._dense(kind, given, attributes, label, first)
        elif kind == "Identity":
            return
        elif not self.weights or self.names[-1] != "identity":
            raise ModelError(f"{label}: found {kind} behind no Gemm, MatMul or Add, expected one "
                             "activation behind each layer")  # fmt: skip
        elif kind == "Add":
            if len(given) != 1:
                raise ModelError(f"{label}: found {len(given)} constants, expected one")
            self.biases[-1] = self.biases[-1] + self._bias(given[0], label)
        else:
            self.names[-1] = _ONNX[kind]
            if kind == "LeakyRelu":
                self.leaks.append(float(attributes.get("alpha", _LEAK)))

    def _dense(
        self, kind: str, given: list[Reals], attributes: dict[str, Any], label: str, first: bool
    ) -> None:
        for name, usual in (("alpha", 1.0), ("beta", 1.0), ("transA", 0)):
            if attributes.get(name, usual) != usual:
                raise ModelError(f"{label}: found {name} = {attributes[name]}, expected {usual}")
        if not given or given[0].ndim != 2:
            raise ModelError(
                f"{label}: found no constant matrix, expected the weights in the model"
            )
        if kind == "Gemm" and not first:
            raise ModelError(f"{label}: found the signal as second factor, expected it first")
        samples = "rows" if first else "columns"  # W x has samples as columns
        if kind == "Gemm" or self._samples != "one":
            if self._samples not in ("", samples):
                raise ModelError(f"{label}: found samples as {samples} behind layers that take "
                                 f"{self._samples}, expected all layers alike")  # fmt: skip
            self._samples = samples
        weight = given[0] if not first or attributes.get("transB", 0) else given[0].T
        self.weights.append(weight)
        self.names.append("identity")
        self.biases.append(np.zeros(len(weight)))
        if len(given) > 1:
            self.biases[-1] = self._bias(given[1], label)

    def _bias(self, given: Reals, label: str) -> Reals:
        """Spread a constant over the outputs of the last layer; over samples it is the same."""
        width, shape = len(self.weights[-1]), given.shape
        if self._samples == "columns":
            fits = given.ndim > 1 and shape[-1] == 1
            shape = shape[:-1]
        else:
            fits = self._samples == "rows" or given.ndim == 1
        if given.size != 1 and (not fits or given.size != width or shape[-1] != width):
            raise ModelError(
                f"{label}: found a constant of shape {given.shape}, expected one number for each "
                f"of {width} outputs, the same for all samples"
            )
        return np.broadcast_to(given.ravel(), (width,))
