"""Intervals of hidden weights of small ReLU networks, over all networks that explain a record.

A network sum_j v_j phi(w_j x + b_j) + c of ReLU or leaky ReLU does not change where neurons are
exchanged, or where w_j, b_j are multiplied and v_j divided by a positive number. So its output
weights are normalised to s_j = +-1 and neurons of equal sign are ordered by their first weight.
The networks that are left and explain the record with an equation error of at most D are, for each
choice of signs, a finite union of polytopes, one for each activation pattern. Each end of an
interval is a search over the patterns (:mod:`setid.neural.training.patterns`). An end that is
proved shrinks the box of weights for those that follow.

References
----------
M. Milanese, C. Novara, "Set membership identification of nonlinear systems", Automatica 40 (2004)
957-975.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from setid import (
    IntervalStatus,
    IOData,
    ModelError,
    Noise,
    NoiseError,
    ParameterInterval,
    Verification,
)
from setid.data.checks import FrozenMapping, frozen, number, seconds_of, switch
from setid.data.digits import all_digits
from setid.neural.arithmetic import activate, quiet_overflow, require_ieee, up
from setid.neural.branching import DualNode
from setid.neural.last_layers.equation_error import equation_error, rows_of
from setid.neural.models.network import Network
from setid.neural.models.regressor import RegressorNetwork
from setid.neural.status import Status, agreed, same_intervals
from setid.neural.training.patterns import Goal, Patterns, PatternSearch, prove_tree
from setid.neural.training.smooth_weights import (
    SMOOTH,
    SmoothHiddenWeights,
    interval_of,
    smooth_hidden_weights,
)
from setid.neural.training.structure import has_hidden_layer, hidden_layer, output_signs
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["HiddenWeights", "SignChoice", "hidden_weights"]

Reals = NDArray[np.float64]
_ROUNDS = (30, 3000)  # nodes for each end, first for all of them, then for those still open
_INSIDE = 1e-7  # members are looked for this fraction below the bound
_PIECEWISE = ("relu", "leaky_relu")
_CLOSED = 1e-4  # of the width of an interval: what "certified" allows between its ends


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SignChoice(ReadOnly):
    """All networks with one choice of output signs that explain a record.

    Parameters
    ----------
    signs : tuple of float
        +1 or -1 of each neuron, descending.
    low, high : (p,) float
        Proved ends of all weights, biases and the output bias; low above high where it is proved
        that no network has these signs.
    steps : tuple of (goal, tree)
        The proof: each tree bounds one end within the box that those before leave.
    members : (K, p) float
        Networks that are proved to explain the record; they attain the inner ends.
    """

    signs: tuple[float, ...]
    low: Reals
    high: Reals
    steps: tuple[tuple[Goal, DualNode], ...]
    members: Reals

    @property
    def empty(self) -> bool:
        """True if it is proved that no network has these signs."""
        return bool(np.any(self.low > self.high))

    def __repr__(self) -> str:
        signs = ", ".join(f"{s:+g}" for s in self.signs)
        found = "empty" if self.empty else f"{len(self.members)} members"
        return f"<SignChoice: signs {signs}, {found}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class HiddenWeights:
    """Intervals of the weights of all networks of one structure that explain a record.

    Parameters
    ----------
    net : NNARX or NNOE
        The structure.
    data : IOData
    bound : float
        Of the equation error.
    weights : float
        Assumed bound of normalised hidden weights and biases.
    status : Status
        ``"proved"`` (every interval certified), ``"partial"`` or ``"empty"``.
    choices : tuple of SignChoice
    intervals : mapping of str to ParameterInterval
        Of ``w1_1`` (neuron, regressor), ..., ``b1``, ..., ``c``, over all choices of signs
        together. Positive neurons come first, those of equal sign by descending first weight.
    assumptions : tuple of str
    """

    net: RegressorNetwork
    data: IOData
    bound: float
    weights: float
    status: Status
    choices: tuple[SignChoice, ...]
    intervals: Mapping[str, ParameterInterval]
    assumptions: tuple[str, ...]

    @as_verdict
    def verify(self) -> Verification:
        """Draw all conclusions again from the stored multipliers, without any solver."""
        if not has_hidden_layer(self.net, *_PIECEWISE) or _folded(self.net.network) == 1.0:
            return Verification(False, "the structure is none of relu or leaky relu neurons")
        if not (0.0 < self.bound < np.inf and 0.0 < self.weights < np.inf):
            return Verification(False, "the bounds of errors and weights are not positive numbers")
        if not set(_assumptions(self.data, self.bound, self.weights)) <= set(self.assumptions):
            return Verification(False, "an assumption is left out")
        task = _Task.of(self.net, self.data, self.bound, self.weights)
        if [item.signs for item in self.choices] != output_signs(task.width):
            return Verification(False, "the choices of signs are not all of them")
        for item in self.choices:
            low, high = task.drawn(item.signs, item.steps)
            empty = bool(np.any(low > high))
            holds = empty or not np.any((item.low > low) | (item.high < high))
            members = all(task.member(np.array(item.signs), x) for x in item.members)
            verdict = agreed(
                (item.low.shape == low.shape == item.high.shape, "the ends are not all there"),
                (holds and (empty or not item.empty), "an outer end is not proved"),
                (members, "a member does not explain the record"),
            )
            if not verdict:
                return verdict
        wanted, status = _intervals(task, self.choices)
        same = status is self.status and same_intervals(self.intervals, wanted)
        return agreed((same, "the intervals are not those of the choices"))

    def __repr__(self) -> str:
        items = ", ".join(repr(item) for item in list(self.intervals.values())[:3])
        return f"<HiddenWeights: {len(self.intervals)} parameters, {self.status}: {items}, ...>"


@quiet_overflow
def hidden_weights(
    net: RegressorNetwork,
    data: IOData,
    noise: Noise | float,
    weights: float = 10.0,
    time_limit: float = 60.0,
    normalised: bool = True,
) -> HiddenWeights | SmoothHiddenWeights:
    """Bound hidden weights over all small networks that explain a record.

    Parameters
    ----------
    net : NNARX or NNOE
        Its structure is used: one hidden layer (ReLU, leaky ReLU, tanh, sigmoid or algebraic), a
        linear last one, one output. One or two neurons are practical.
    data : IOData
    noise : Noise or float
        One bound of the equation error.
    weights : float
        Bound of hidden weights and biases after normalisation, and of output weights of smooth
        neurons, an assumption. Where an interval ends there, the record does not bound it.
    time_limit : float
        Seconds; the intervals hold when it is over, but may be wider than need be. Ctrl-C ends the
        search in the same way.
    normalised : bool
        Only True: without normalisation and order the intervals would mean nothing.

    Returns
    -------
    HiddenWeights or SmoothHiddenWeights
        The latter for tanh, sigmoid and algebraic neurons, with ``eps``: how far the activation is
        from the lines that stand for it where the proof ends, which the intervals allow for.

    Raises
    ------
    ModelError, DataError, NoiseError, SetidError
        If the structure is not covered, network, record and noise do not fit, or the limit is no
        number of at least 0.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.NNARX(neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]],
    ...                                   "relu"), order=1)
    >>> data = setid.IOData([0, -1, 2, -2, 1, 3, -3], [0, 0, 2, 0, 1, 3, 0])
    >>> found = neural.hidden_weights(net, data, 0.01)
    >>> low, high = found.intervals["w1_2"].outer
    >>> bool(low <= 1 <= high), bool(found.verify())
    (True, True)
    """
    require_ieee()
    if not switch(normalised, "normalised", ModelError):
        raise ModelError(
            "normalised: found False, expected True: neurons can be exchanged, and v phi(w x + b) "
            "is (v / g) phi(g w x + g b) for every g > 0, so that hidden weights have no intervals "
            "before output weights are +-1 and neurons are ordered"
        )
    weights = number(weights, "weights", ModelError)
    if not 0 < weights < np.inf:
        raise ModelError(f"weights: found {weights!r}, expected a positive number")
    seconds = seconds_of(time_limit)
    bound = _bound(net, data, noise)
    if hidden_layer(net).activation[0] in SMOOTH:
        found = smooth_hidden_weights(net, data, bound, float(weights), seconds)
        stated = noise.assumptions if isinstance(noise, Noise) else ()
        return replace(found, assumptions=(*found.assumptions, *stated))
    task = _Task.of(net, data, bound, float(weights))
    until = time.monotonic() + seconds
    choices = []
    options = output_signs(task.width)
    for index, signs in enumerate(options):
        share = time.monotonic() + (until - time.monotonic()) / (len(options) - index)
        search = _Search(task, signs, share)
        choices.append(search.run())
        until = -np.inf if search.until == -np.inf else until  # interrupted
    intervals, status = _intervals(task, tuple(choices))
    given = noise.assumptions if isinstance(noise, Noise) else ()
    texts = (*given, *_assumptions(data, task.bound, task.reach))
    return HiddenWeights(
        net, data, task.bound, task.reach, status, tuple(choices), FrozenMapping(intervals), texts
    )


def _assumptions(data: IOData, bound: float, weights: float) -> tuple[str, ...]:
    """Name what the intervals rest on, beside assumptions of the noise."""
    return (
        *data.assumptions,
        f"the equation error of each row is at most {all_digits(bound)}",
        f"normalised hidden weights and biases are at most {all_digits(weights)} in absolute value",
        "output weights are normalised to +-1, neurons of equal sign by descending first weight",
    )


def _bound(net: RegressorNetwork, data: IOData, noise: Noise | float) -> float:
    """The bound of the equation error, one for all rows."""
    given = noise if isinstance(noise, Noise) else Noise(equation=noise)
    _, row = rows_of(net, data)
    output, inputs, equation = given.bounds(data)
    if np.any(output[row] > 0) or np.any(inputs > 0):
        raise NoiseError(
            "noise: found a bound of output or input noise, expected one of the equation error"
        )
    values = np.unique(equation[row])
    if values.size != 1 or not 0.0 < values[0] < np.inf:
        raise NoiseError(f"noise.equation: found {values[:3]}, expected one positive bound")
    return float(values[0])


def _folded(network: Network) -> float:
    """Slope of the hidden layer for negative arguments."""
    return 0.0 if network.activation[0] == "relu" else float(network.leak)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Record, structure and limits that all searches share."""

    net: RegressorNetwork
    data: IOData
    phi: Reals
    y: Reals
    bound: float
    reach: float

    @staticmethod
    def of(net: RegressorNetwork, data: IOData, bound: float, reach: float) -> _Task:
        phi, row = rows_of(net, data)
        inner = hidden_layer(net)
        if inner.activation[0] not in _PIECEWISE or _folded(inner) == 1.0:
            raise ModelError(
                f"net: found {inner.activation[0]} neurons, expected relu, leaky_relu (leak not "
                "1), tanh, sigmoid or algebraic"
            )
        return _Task(net, data, phi, data.y[row, 0], bound, reach)

    @property
    def width(self) -> int:
        return int(self.net.network.weights[0].shape[0])

    @property
    def leak(self) -> float:
        return _folded(self.net.network)

    @property
    def names(self) -> list[str]:
        k, d = self.width, self.phi.shape[1]
        found = [f"w{j + 1}_{i + 1}" for j in range(k) for i in range(d)]
        return [*found, *(f"b{j + 1}" for j in range(k)), "c"]

    def box(self) -> tuple[Reals, Reals]:
        """Compute the assumed ranges of hidden weights and biases, and that of c."""
        high = np.full(self.width * (self.phi.shape[1] + 1) + 1, self.reach)
        size = self.width * float(up(np.abs(self.phi).sum(axis=1).max() * 1.000001 + 1.000001))
        high[-1] = float(up(up(size * self.reach) * max(1.0, abs(self.leak)))) * 1.000001
        high[-1] += (float(np.abs(self.y).max()) + self.bound) * 1.000001
        return -high, high

    def program(self, signs: tuple[float, ...], box: tuple[Reals, Reals]) -> Patterns:
        """Build the program of all patterns within a box of weights."""
        return Patterns.of(self.phi, self.y, np.array(signs), self.leak, box, self.bound)

    def drawn(
        self, signs: tuple[float, ...], steps: tuple[tuple[Goal, DualNode], ...]
    ) -> tuple[Reals, Reals]:
        """Compute the box that the trees prove in turn; low above high where empty."""
        low, high = self.box()
        goals = {(entry, side) for entry in range(low.size + 1) for side in (1.0, -1.0)}
        for goal, tree in steps:
            if goal not in goals:
                return self.box()
            program = self.program(signs, (low.copy(), high.copy()))
            value = prove_tree(program, tree, np.zeros(program.pairs, np.int8), goal)
            shrink(low, high, goal, value)
            if np.any(low > high):
                break
        return low, high

    def parts(self, x: Reals) -> tuple[Reals, Reals, float]:
        """Split a vector in hidden weights (k, d), biases (k,) and output bias."""
        k, d = self.width, self.phi.shape[1]
        return x[: k * d].reshape(k, d), x[k * d : k * d + k], float(x[-1])

    def member(self, signs: Reals, x: Reals) -> bool:
        """Prove that a network explains the record within the range of weights, ordered."""
        w, b, c = self.parts(x)
        inner = self.net.network
        made = Network([w, signs[None]], [b, [c]], inner.activation, inner.leak)
        trial = type(self.net)(made, self.net.order, self.net.channels)
        reached = float(equation_error(trial, self.data).upper_bound[0])
        same = signs[:-1] == signs[1:]
        ordered = bool(np.all(w[:-1, 0][same] >= w[1:, 0][same]))
        return reached <= self.bound and ordered and bool(np.all(np.abs(x[:-1]) <= self.reach))


def shrink(low: Reals, high: Reals, goal: Goal, value: float) -> None:
    """Move one end of a box to a proved bound; an infinite one empties the box."""
    entry, side = goal
    if np.isinf(value) and value > 0:
        low[:], high[:] = np.inf, -np.inf
    elif entry < low.size and side > 0:
        low[entry] = max(low[entry], value)
    elif entry < low.size:
        high[entry] = min(high[entry], -value)


class _Search:
    """Search for both ends of all weights, for one choice of signs."""

    def __init__(self, task: _Task, signs: tuple[float, ...], until: float) -> None:
        self.task, self.signs, self.until = task, signs, until
        self.low, self.high = task.box()
        self.steps: list[tuple[Goal, DualNode]] = []
        self.members: dict[Goal, Reals] = {}

    def run(self) -> SignChoice:
        """Decide whether there is a network, then search each end in two rounds."""
        try:
            self.ends()
        except KeyboardInterrupt:  # between two steps: what they prove is drawn again
            self.until = -np.inf
            self.low, self.high = self.task.drawn(self.signs, tuple(self.steps))
        signs = np.array(self.signs)
        kept = [x for x in self.members.values() if self.task.member(signs, x)]
        members = np.array(kept).reshape(len(kept), self.low.size)
        if np.any(self.low > self.high):
            members = members[:0]
        return SignChoice(
            self.signs, frozen(self.low), frozen(self.high), tuple(self.steps), frozen(members)
        )

    def ends(self) -> None:
        """Search all ends; the first program decides whether there is a network."""
        size = self.low.size
        self.bounded((size, 1.0), _ROUNDS[-1])
        goals = [(entry, side) for entry in range(size) for side in (1.0, -1.0)]
        for nodes in _ROUNDS:
            for goal in goals:
                if np.any(self.low > self.high) or time.monotonic() > self.until:
                    break
                if self.gap(goal) > 0.0:
                    self.bounded(goal, nodes)

    def value(self, goal: Goal) -> float:
        """Find the least value of a goal that a member attains."""
        found = self.members.get(goal)
        return np.inf if found is None else goal[1] * float(found[goal[0]])

    def gap(self, goal: Goal) -> float:
        """Compute by how much the ends differ beyond the allowed; infinite without a member."""
        entry, side = goal
        if goal not in self.members:
            return np.inf
        proved = self.low[entry] if side > 0 else -self.high[entry]
        return self.value(goal) - float(proved) - self.allowed(entry)

    def allowed(self, entry: int) -> float:
        """Compute half of the gap that "certified" allows."""
        ends = [self.value((entry, side)) for side in (1.0, -1.0)]
        return 0.5 * _CLOSED * max(-ends[1] - ends[0], 0.0) if np.all(np.isfinite(ends)) else 0.0

    def bounded(self, goal: Goal, nodes: int) -> None:
        """Search the patterns for one end, and shrink the box by what is proved."""
        if time.monotonic() > self.until:
            return
        program = self.task.program(self.signs, (self.low.copy(), self.high.copy()))
        search = PatternSearch(program, goal, self.until)
        search.add(np.zeros(program.pairs, np.int8))
        try:
            self.searched(search, goal, nodes)
        except KeyboardInterrupt:  # as if the time were over
            self.until = -np.inf
        before = self.low.copy(), self.high.copy()
        shrink(self.low, self.high, goal, search.bound)
        if np.any(self.low > before[0]) or np.any(self.high < before[1]):
            self.steps.append((goal, search.tree()))

    def searched(self, search: PatternSearch, goal: Goal, nodes: int) -> None:
        """Branch for one end in slices, with the best network found as cutoff."""
        seen: int = 0
        while True:
            for *_, point in search.known[seen:]:
                self.offer(search, point)
            seen = len(search.known)
            cutoff = self.value(goal) - 0.5 * self.allowed(goal[0])
            search.run(cutoff, self.until, min(nodes, seen + 10))
            if len(search.known) == seen or len(search.known) >= nodes:
                break
        for *_, point in search.known[seen:]:
            self.offer(search, point)

    def offer(self, search: PatternSearch, point: Reals | None) -> None:
        """Take the best network of the pattern that a point has."""
        if point is None:
            return
        w, b, _ = self.task.parts(point[:-1])
        pattern = np.where((self.task.phi @ w.T + b).ravel() >= 0, 1, -1).astype(np.int8)
        x = search.propose(pattern, _INSIDE)
        if x is not None:
            self.take(x[: self.low.size])

    def take(self, x: Reals) -> None:
        """Keep a network for every end at which it is the best, where it explains the record."""
        task, signs = self.task, np.array(self.signs)
        low, high = task.box()
        x = np.clip(x, low, high)
        w, b, c = task.parts(x)
        order = np.lexsort((-w[:, 0], -signs))
        x = np.concatenate([w[order].ravel(), b[order], [c]])
        w, b, c = task.parts(x)
        inner = task.net.network
        rest = task.y - c - activate(inner.activation[0], task.phi @ w.T + b, inner.leak) @ signs
        if np.max(np.abs(rest)) > task.bound:
            return
        for entry in range(x.size):
            for side in (1.0, -1.0):
                if side * x[entry] < self.value((entry, side)):
                    self.members[entry, side] = x


def _intervals(
    task: _Task, choices: tuple[SignChoice, ...]
) -> tuple[dict[str, ParameterInterval], Status]:
    """Hull over all choices of signs, and what the intervals are worth together."""
    names, kept = task.names, [item for item in choices if not item.empty]
    if not kept:
        ends = np.inf, -np.inf
        none = {n: ParameterInterval(n, ends, None, IntervalStatus.EMPTY) for n in names}
        return none, Status.EMPTY
    low = np.min([item.low for item in kept], axis=0)
    high = np.max([item.high for item in kept], axis=0)
    members = np.vstack([item.members for item in kept])
    found = {
        name: interval_of(name, (float(low[i]), float(high[i])), members[:, i])
        for i, name in enumerate(names)
    }
    closed = all(item.status is IntervalStatus.CERTIFIED for item in found.values())
    return found, Status.PROVED if closed else Status.PARTIAL
