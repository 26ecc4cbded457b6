"""Networks from ONNX files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from setid import ModelError
from setid.data.checks import real_array
from setid.neural.imports.layers import LEAK, Path, Reals, one_slope, reading
from setid.neural.models.network import Network
from setid.neural.training.shooting import optional

__all__ = ["from_onnx"]

_ACTIVATIONS = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Relu": "relu", "LeakyRelu": "leaky_relu"}
_ATTRIBUTES = {  # of other operators that are known
    "Gemm": {"alpha", "beta", "transA", "transB", "broadcast"},
    "MatMul": set(),
    "Add": {"broadcast"},
    "Identity": set(),
}


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
            raise ModelError(
                f"{label}: found the inputs {', '.join(unknown) or 'none'}, expected "
                f"{flow} and constants: a chain of layers"
            )
        given = [numbers[name] for name in node.input if name in numbers]
        attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
        chain.add(node, given, attributes, label, first=node.input[0] == flow)
        flow = node.output[0]
    shown = [item.name for item in graph.output]
    if shown != [flow]:
        raise ModelError(
            f"output: found {', '.join(shown) or 'none'}, expected {flow}, the end of the chain"
        )
    return Network(chain.weights, chain.biases, chain.names, one_slope(chain.leaks))


def _graph(path: Path) -> tuple[Any, Any]:
    """Load the package onnx, and the graph of a file."""
    if not isinstance(path, (str, os.PathLike)):
        raise ModelError(f"path: found {type(path).__name__}, expected that of an ONNX file")
    onnx = optional("onnx", "onnx")
    damaged = optional("google.protobuf.message", "onnx").DecodeError
    with reading(path, "an ONNX file", damaged):
        graph = onnx.load(os.fspath(path), load_external_data=False).graph
    if not graph.input:
        raise ModelError(
            f"{os.fspath(path)}: found a graph without inputs, expected a chain of layers"
        )
    return onnx, graph


def _rank(graph: Any, numbers: Mapping[str, Reals]) -> int | None:
    """Count the axes of the input, where the file says it."""
    kinds = [item.type.tensor_type for item in graph.input if item.name not in numbers]
    return len(kinds[0].shape.dim) if kinds and kinds[0].HasField("shape") else None


def _tensor(onnx: Any, item: Any) -> Reals:
    if item.data_location == onnx.TensorProto.EXTERNAL:
        raise ModelError(f"{item.name}: found weights in another file, expected them in the model")
    with reading(item.name, "numbers"):
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
        name = f"{node.domain} {kind}".strip()
        if node.domain not in ("", "ai.onnx") or kind not in (*_ATTRIBUTES, *_ACTIVATIONS):
            raise ModelError(
                f"{label}: found the ONNX operator {name}, expected "
                f"{', '.join((*_ATTRIBUTES, *_ACTIVATIONS))}"
            )
        other = sorted(set(attributes) - _ATTRIBUTES.get(kind, {"alpha"}))
        if other:
            raise ModelError(f"{label}: found the attribute {other[0]} of {kind}, expected none")
        if kind in ("Gemm", "MatMul"):
            self._dense(kind, given, attributes, label, first)
        elif kind == "Identity":
            return
        elif not self.weights or self.names[-1] != "identity":
            raise ModelError(
                f"{label}: found {kind} behind no Gemm, MatMul or Add, expected one "
                "activation behind each layer"
            )
        elif kind == "Add":
            if len(given) != 1:
                raise ModelError(f"{label}: found {len(given)} constants, expected one")
            self.biases[-1] = self.biases[-1] + self._bias(given[0], label)
        else:
            self.names[-1] = _ACTIVATIONS[kind]
            if kind == "LeakyRelu":
                self.leaks.append(float(attributes.get("alpha", LEAK)))

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
                raise ModelError(
                    f"{label}: found samples as {samples} behind layers that take "
                    f"{self._samples}, expected all layers alike"
                )
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
