"""Training to a proved global optimum, for small networks of one hidden layer.

ReLU, leaky ReLU and identity networks are searched by activation patterns (module ``patterns``):
their output weights are normalised to +-1 and neurons of equal sign are ordered, which removes the
symmetries; ``method="engine"`` states the same as a polynomial problem with complementarity and
asks :func:`sparsepop_py.solve`. Networks of tanh, sigmoid or algebraic activations are searched by
boxes of hidden weights (module ``weight_boxes``), with signs moved inside.
Both are exact: nothing is approximated but for rounding, which is enclosed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid import IOData, ModelError, Verification
from setid.data.checks import natural, number, seconds_of, word
from setid.neural.arithmetic import activate, quiet_overflow, require_ieee, up
from setid.neural.last_layers.equation_error import equation_error, rows_of
from setid.neural.models.network import Network
from setid.neural.models.regressor import RegressorNetwork
from setid.neural.status import Status, agreed
from setid.neural.training.engine import (
    TrainingProblem,
    proved_by_certificate,
    search_by_engine,
    training_problem,
)
from setid.neural.training.patterns import Patterns, PatternSearch, prove_tree
from setid.neural.training.structure import has_hidden_layer, hidden_layer, output_signs
from setid.neural.training.weight_boxes import (
    WeightProgram,
    WeightSearch,
    fitted,
    prove_boxes,
    reaches,
)
from setid.proofs.evidence import as_verdict
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["ProvedTraining", "train_proved"]

Reals = NDArray[np.float64]
_PIECEWISE = ("relu", "leaky_relu", "identity")
_SIMULATED = 0.3  # of the time, for these
_STARTS = 20  # random weights whose errors are simulated before the engine is asked


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProvedTraining:
    """Least equation error over all networks of one structure, enclosed.

    Parameters
    ----------
    net : NNARX or NNOE
        The best network found; its output weights are +-1 for piecewise linear activations.
    data : IOData
    status : Status
        ``"proved"`` where the bounds agree within the tolerance, else ``"partial"``.
    lower_bound : float
        Proved: no network within ``weights`` has a smaller largest equation error.
    upper_bound : float
        Attained by ``net``.
    weights : float
        Bound of hidden weights and biases after normalisation; the output bias may exceed it, for
        smooth activations times the number of neurons, by the largest reading.
    tolerance : float
    nodes : int
    trees : mapping of tuple of float to DualNode or Certificate
        The proof, for each choice of output signs where there are several.
    cap : float
        Error above which nothing was followed: that of the best constant, or for the engine the
        one that simulated weights attain.
    """

    net: RegressorNetwork
    data: IOData
    status: Status
    lower_bound: float
    upper_bound: float
    weights: float
    tolerance: float
    nodes: int
    trees: Mapping[tuple[float, ...], Any]
    cap: float

    @as_verdict
    def verify(self) -> Verification:
        """Prove both bounds again, without any solver."""
        if not has_hidden_layer(self.net):
            return Verification(False, "the network is none of one hidden layer and one output")
        phi, row = rows_of(self.net, self.data)
        y = self.data.y[row, 0]
        reached = equation_error(self.net, self.data).upper_bound[0]
        closed = self.upper_bound - self.lower_bound <= self.tolerance * _cap(y)
        inside = _inside(self.net.network, self.weights, y)
        first = agreed(
            (reached <= self.upper_bound, "the network does not attain the upper bound"),
            (inside, "the network is outside the range of weights"),
            (0.0 < self.cap < np.inf, "the largest error that is followed is none"),
            (self.status is (Status.PROVED if closed else Status.PARTIAL), "the status"),
        )
        if not first:
            return first
        if self.net.network.activation[0] in _PIECEWISE:
            least = _replay(self.net.network, phi, y, self)
        else:
            program = _boxes(self.net.network, phi, y, self.weights, self.cap)
            tree = self.trees.get(())
            least = 0.0 if tree is None else prove_boxes(program, tree, program.root())
            least = min(least, self.cap)
        return agreed((self.lower_bound <= least, "the lower bound is not proved"))

    def __repr__(self) -> str:
        ends = f"[{rounded(self.lower_bound, False, 6)}, {rounded(self.upper_bound, True, 6)}]"
        return f"<ProvedTraining: least error in {ends}, {self.nodes} nodes, {self.status}>"


@quiet_overflow
def train_proved(
    net: RegressorNetwork,
    data: IOData,
    weights: float = 10.0,
    tolerance: float = 1e-4,
    time_limit: float = 60.0,
    nodes: int = 20_000,
    method: Literal["patterns", "engine"] = "patterns",
) -> ProvedTraining:
    """Find the network of least equation error and prove that no other is better.

    Parameters
    ----------
    net : NNARX or NNOE
        Its structure is used: one hidden layer, a linear last one, one output.
    data : IOData
    weights : float
        Bound of hidden weights and biases after normalisation of the output weights to +-1
        (piecewise linear), or of all weights (smooth activations). It is part of the claim.
    tolerance : float
        Gap at which the search ends, as a fraction of the error of the best constant.
    time_limit : float
        Seconds; the bounds hold when it is over, but need not meet. Ctrl-C ends the search in the
        same way.
    nodes : int
        Most sets of patterns that are bounded.
    method : {"patterns", "engine"}
        Search activation patterns, or let the engine branch on hidden weights of a polynomial
        problem (ReLU and leaky ReLU). The error below which the engine searches is attained by
        simulated weights.

    Returns
    -------
    ProvedTraining

    Raises
    ------
    ModelError, SetidError
        If the structure is not covered, or a tolerance or limit is negative.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.NNARX(neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]],
    ...                                   "relu"), order=1)
    >>> data = setid.IOData([0, -1, 2, -2, 1], [0, 0.25, 2, 0, 1])
    >>> found = neural.train_proved(net, data)
    >>> found.status, bool(found.verify())
    (<Status.PROVED: 'proved'>, True)
    """
    require_ieee()
    phi, row = rows_of(net, data)
    inner = hidden_layer(net)
    if not 0 < number(weights, "weights", ModelError) < np.inf:
        raise ModelError(f"weights: found {weights!r}, expected a positive number")
    natural(nodes, "nodes", ModelError)
    if not 0.0 <= number(tolerance, "tolerance", ModelError) < np.inf:
        raise ModelError(f"tolerance: found {tolerance!r}, expected a number >= 0")
    y, until = data.y[row, 0], time.monotonic() + seconds_of(time_limit)
    if word(method, "method", ("patterns", "engine"), ModelError) == "engine":
        return _by_engine(net, data, phi, y, float(weights), tolerance, until)
    if inner.activation[0] in _PIECEWISE:
        return _by_patterns(net, data, phi, y, float(weights), tolerance, until, nodes)
    return _by_boxes(net, data, phi, y, float(weights), tolerance, until, nodes)


# ---- piecewise linear activations -----------------------------------------------------------


def _leak(network: Network) -> float:
    name = network.activation[0]
    return {"relu": 0.0, "identity": 1.0}.get(name, network.leak)


def _signs(width: int, linear: bool) -> list[tuple[float, ...]]:
    """Output weights up to permutations; one choice is enough for a linear network."""
    if linear:
        return [(1.0,)]
    return output_signs(width)


def _summed(network: Network, weights: float) -> float:
    """Bound the weights of a neuron of the search: of identity the sum of all neurons."""
    if network.activation[0] != "identity":
        return weights
    return float(up(weights * network.weights[0].shape[0]))


def _cap(y: Reals) -> float:
    """The error of the best constant, rounded up."""
    return float(up(up(0.5 * np.max(y) - 0.5 * np.min(y)) * 1.0000002)) + 1e-300


def _program(
    network: Network, phi: Reals, y: Reals, signs: Sequence[float], weights: float, cap: float
) -> Patterns:
    high = np.full(len(signs) * (phi.shape[1] + 1) + 1, _summed(network, weights))
    high[-1] = reaches(weights, y)
    return Patterns.of(phi, y, np.array(signs), _leak(network), (-high, high), cap)


def _by_patterns(
    net: RegressorNetwork,
    data: IOData,
    phi: Reals,
    y: Reals,
    weights: float,
    tolerance: float,
    until: float,
    nodes: int,
) -> ProvedTraining:
    network = net.network
    width = network.weights[0].shape[0]
    cap = _cap(y)
    best = _Best(network, phi, y, weights)
    searches: dict[tuple[float, ...], PatternSearch] = {}
    count = 0
    choices = _signs(width, network.activation[0] == "identity")
    with suppress(KeyboardInterrupt):
        for index, signs in enumerate(choices):
            share = time.monotonic() + (until - time.monotonic()) / (len(choices) - index)
            search = PatternSearch(_program(network, phi, y, signs, weights, cap), until=share)
            searches[signs] = search
            _search(search, best, np.array(signs), tolerance, share, nodes - count)
            count += len(search.known)
    known = {signs: search for signs, search in searches.items() if search.known}
    trees = {signs: search.tree() for signs, search in known.items()}
    count = sum(len(search.known) for search in known.values())
    lower = min((search.bound for search in known.values()), default=0.0)
    lower = min(lower, cap) if len(known) == len(choices) else 0.0  # the others are not bounded
    return _result(net, data, best.network(), (lower, weights, tolerance, count), trees, cap)


def _by_engine(
    net: RegressorNetwork,
    data: IOData,
    phi: Reals,
    y: Reals,
    weights: float,
    tolerance: float,
    until: float,
) -> ProvedTraining:
    """Ask the engine for each choice of signs, below the error that simulated weights attain."""
    network = net.network
    if network.activation[0] not in ("relu", "leaky_relu"):
        raise ModelError(
            f"method='engine': found {network.activation[0]}, expected relu or leaky_relu"
        )
    best = _Best(network, phi, y, weights)
    choices = _signs(network.weights[0].shape[0], False)
    begin = time.monotonic()
    ended = False
    try:
        for index, signs in enumerate(choices):
            share = begin + _SIMULATED * (until - begin) * (index + 1) / len(choices)
            program = _program(network, phi, y, signs, weights, _cap(y))
            _simulated(best, program, np.array(signs), share)
    except KeyboardInterrupt:
        ended = True
    cap = best.value * (1.0 + 1e-9) + 1e-300
    exact = best.value <= tolerance * best.scale  # 0 is bound enough
    trees: dict[tuple[float, ...], Any] = dict.fromkeys(choices) if exact else {}
    lower, count = 0.0 if exact else cap, 0
    for index, signs in enumerate(() if exact else choices):
        item = None if ended else _stated(network, phi, y, signs, weights, cap, until)
        if item is None:
            lower = 0.0  # nothing is proved of this choice of signs
            break
        share = (until - time.monotonic()) / (len(choices) - index)
        result, point = search_by_engine(item, share)
        if point is not None:
            best.take(point, np.array(signs))
        trees[signs], ended = result.certificate, result.status is sp.Status.INTERRUPTED
        lower = min(lower, proved_by_certificate(item, result.certificate))
        count += 1 if result.certificate is None else result.certificate.leaves
    found = _result(net, data, best.network(), (lower, weights, tolerance, count), trees, _cap(y))
    return replace(found, cap=cap)


def _simulated(best: _Best, program: Patterns, signs: Reals, until: float) -> None:
    """Attain errors by random weights, whose patterns' programs are then solved."""
    search, rng = PatternSearch(program, until=until), np.random.default_rng(0)
    k, d = best.given.weights[0].shape
    for _ in range(_STARTS):
        if time.monotonic() > until:
            return
        best.take(best.weights * rng.uniform(-1.0, 1.0, k * (d + 1)), signs)
        best.polish(search, signs)
    search.add(np.zeros(program.pairs, np.int8))
    best.take(search.known[0][-1], signs)
    best.polish(search, signs)


def _stated(
    network: Network,
    phi: Reals,
    y: Reals,
    signs: Sequence[float],
    weights: float,
    cap: float,
    until: float = np.inf,
) -> TrainingProblem | None:
    reach = reaches(weights, y)
    return training_problem(phi, y, signs, _leak(network), weights, reach, cap, until)


def _result(
    net: RegressorNetwork,
    data: IOData,
    network: Network,
    found: tuple[float, float, float, int],
    trees: Mapping[tuple[float, ...], Any],
    cap: float,
) -> ProvedTraining:
    """The result for the best network, with the error that it provably attains."""
    lower, weights, tolerance, count = found
    trained = type(net)(network, net.order, net.channels)
    upper = float(equation_error(trained, data).upper_bound[0])
    closed = upper - lower <= tolerance * cap
    status = Status.PROVED if closed else Status.PARTIAL
    return ProvedTraining(
        net=trained,
        data=data,
        status=status,
        lower_bound=lower,
        upper_bound=upper,
        weights=weights,
        tolerance=tolerance,
        nodes=count,
        trees=trees,
        cap=cap,
    )


def _search(
    search: PatternSearch, best: _Best, signs: Reals, tolerance: float, until: float, nodes: int
) -> None:
    """Branch and bound in slices, with the best network found as cutoff."""
    search.add(np.zeros(search.program.pairs, np.int8))
    seen = 0
    while True:
        for *_, point in search.known[seen:]:
            best.take(point, signs)
        best.polish(search, signs)
        seen, before = len(search.known), best.value
        limit = min(nodes, seen + 50)
        search.run(best.value - 0.5 * tolerance * best.scale, until, limit)
        ended = len(search.known) < limit and len(search.known) == seen
        if ended and best.value == before or limit >= nodes or time.monotonic() >= until:
            return


class _Best:
    """The best network found so far."""

    def __init__(self, network: Network, phi: Reals, y: Reals, weights: float) -> None:
        self.given, self.phi, self.y, self.weights = network, phi, y, weights
        width, d = network.weights[0].shape
        self.linear = network.activation[0] == "identity"
        self.parts: tuple[Reals, Reals, Reals, float] = (
            np.zeros((width, d)),
            np.zeros(width),
            np.ones(width),
            float(0.5 * np.max(y) + 0.5 * np.min(y)),
        )
        self.value = float(0.5 * np.max(y) - 0.5 * np.min(y))
        self.scale = self.value
        self.seen: set[bytes] = set()

    def take(self, x: Reals | None, signs: Reals) -> None:
        """Evaluate the weights of a program's solution."""
        if x is None:
            return
        k, d = signs.size, self.phi.shape[1]
        most = _summed(self.given, self.weights)
        w = np.clip(x[: k * d].reshape(k, d), -most, most)
        b = np.clip(x[k * d : k * d + k], -most, most)
        hidden = activate(self.given.activation[0], self.phi @ w.T + b, self.given.leak) @ signs
        rest = self.y - hidden
        value = 0.5 * float(np.max(rest) - np.min(rest))
        if value < self.value:
            self.value = value
            self.parts = w, b, signs, 0.5 * float(np.max(rest) + np.min(rest))

    def polish(self, search: PatternSearch, signs: Reals) -> None:
        """Solve the program of the pattern that the best network has, while that helps."""
        while np.array_equal(self.parts[2], signs) and not search.program.free:
            w, b, _, _ = self.parts
            argument = (self.phi @ w.T + b).ravel()
            pattern = np.where(argument >= 0, 1, -1).astype(np.int8)
            if pattern.tobytes() in self.seen:
                return
            self.seen.add(pattern.tobytes())
            self.take(search.propose(pattern), signs)

    def network(self) -> Network:
        """Build the network, with as many neurons as were given."""
        w, b, signs, c = self.parts
        width = self.given.weights[0].shape[0]
        if self.linear:  # one neuron stands for all of them
            w, b = (
                np.clip(np.repeat(a / width, width, axis=0), -self.weights, self.weights)
                for a in (w[:1], b[:1])
            )
            signs = np.ones(width)
        full = np.zeros((width, self.phi.shape[1])), np.zeros(width), np.ones(width)
        for whole, part in zip(full, (w, b, signs), strict=True):
            whole[: len(part)] = part
        return Network(
            [full[0], full[2][None]], [full[1], [c]], self.given.activation, self.given.leak
        )


def _inside(network: Network, weights: float, y: Reals) -> bool:
    """Check that a network is one of those that the bound is about."""
    hidden = max(np.max(np.abs(network.weights[0])), np.max(np.abs(network.biases[0])))
    last = np.abs(network.weights[1])
    fits = (
        np.all(last == 1.0)
        if network.activation[0] in _PIECEWISE
        else (np.all(last <= weights) and np.all(network.weights[1] >= 0))
    )
    piecewise = network.activation[0] in _PIECEWISE
    most = reaches(weights, y, 1 if piecewise else network.weights[0].shape[0])
    return bool(hidden <= weights and fits and np.all(np.abs(network.biases[1]) <= most))


def _replay(network: Network, phi: Reals, y: Reals, item: ProvedTraining) -> float:
    """Least of what all trees prove."""
    width = network.weights[0].shape[0]
    least = item.cap
    for signs in _signs(width, network.activation[0] == "identity"):
        if signs not in item.trees:
            return 0.0
        tree = item.trees[signs]
        if tree is None:
            return 0.0
        if isinstance(tree, sp.Certificate):
            stated = _stated(network, phi, y, signs, item.weights, item.cap)
            if stated is None:
                return 0.0
            least = min(least, proved_by_certificate(stated, tree))
            continue
        program = _program(network, phi, y, signs, item.weights, item.cap)
        none = np.zeros(program.pairs, np.int8)
        least = min(least, prove_tree(program, tree, none))
    return least


# ---- smooth activations ---------------------------------------------------------------------


def _boxes(network: Network, phi: Reals, y: Reals, weights: float, cap: float) -> WeightProgram:
    width = network.weights[0].shape[0]
    bias = reaches(weights, y, width)
    return WeightProgram(network.activation[0], phi, y, width, weights, bias, cap)


def _by_boxes(
    net: RegressorNetwork,
    data: IOData,
    phi: Reals,
    y: Reals,
    weights: float,
    tolerance: float,
    until: float,
    nodes: int,
) -> ProvedTraining:
    cap = _cap(y)
    search = WeightSearch(_boxes(net.network, phi, y, weights, cap))
    best, value, seen = _clipped(net.network, phi, y, weights), np.inf, 0
    with suppress(KeyboardInterrupt):
        while True:
            for *_, point in search.known[seen:]:
                trial, reached = fitted(net.network, phi, y, weights, point)
                if trial is not None and reached < value:
                    best, value = trial, reached
            seen = len(search.known)
            search.run(value - 0.5 * tolerance * cap, until, min(nodes, seen + 50))
            if len(search.known) == seen or len(search.known) >= nodes or time.monotonic() >= until:
                break
    lower = min(search.bound, cap)
    return _result(
        net, data, best, (lower, weights, tolerance, len(search.known)), {(): search.tree()}, cap
    )


def _clipped(network: Network, phi: Reals, y: Reals, weights: float) -> Network:
    """The network given, with weights in range and output weights that are not negative."""
    first = np.clip(network.weights[0], -weights, weights)
    bias = np.clip(network.biases[0], -weights, weights)
    last = np.clip(network.weights[1][0], -weights, weights)
    side = np.where(last < 0, -1.0, 1.0)  # moved inside: f(-a) = -f(a), or 1 - f(a) for sigmoid
    found = np.hstack([first * side[:, None], (bias * side)[:, None]]).ravel()
    trial, _ = fitted(network, phi, y, weights, found)
    if trial is not None:
        return trial
    return Network(
        [first * 0.0, last[None] * 0.0],
        [bias * 0.0, [float(0.5 * y.max() + 0.5 * y.min())]],
        network.activation,
    )
