"""Intervals of hidden weights of small smooth networks, over all networks that explain a record.

A network sum_j v_j phi(w_j x + b_j) + c of tanh does not change where the signs of v_j, w_j, b_j
change together, or neurons are exchanged (for sigmoid c changes as well). So v_j >= 0, and neurons
are ordered by their first weight. A box of hidden weights is enclosed as in
:mod:`setid.neural.training.weight_boxes`: lines within a proved distance eps of the activation,
with eps in the rows, so that every claim is about the activation itself. A linear program then
proves the box empty, or that w_i > t in it: q_i - t v > 0 where q_i = v w_i. Boxes that are neither
are bisected, those at the ends of the intervals first.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid import IntervalStatus, IOData, ParameterInterval, Verification
from setid.data.checks import FrozenMapping, frozen
from setid.data.digits import all_digits
from setid.neural.arithmetic import Interval, LinearModel, down, up
from setid.neural.branching import halves
from setid.neural.last_layers.equation_error import equation_error, rows_of
from setid.neural.models.network import Network
from setid.neural.models.regressor import RegressorNetwork
from setid.neural.status import Status, agreed, same_intervals
from setid.neural.training.smooth_members import MemberSearch
from setid.neural.training.structure import has_hidden_layer
from setid.neural.training.weight_boxes import WeightProgram
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["SMOOTH", "SmoothHiddenWeights", "WeightStep", "interval_of", "smooth_hidden_weights"]

Reals = NDArray[np.float64]
SMOOTH = ("tanh", "sigmoid", "algebraic")
_CLOSED = 1e-4  # of the width of an interval: what "certified" allows between its ends
_LINEAR = 0.3  # distance of the lines from the activation below which cuts are tried
_WORTH = 0.1  # of the width of a box: what a cut must take off
_MEMBERS = 0.5  # of the time, until which networks that explain the record are looked for first
_STARTS, _TRIES = 10, 30  # local searches: at the start, and in all (successes count 6)
_ROOMS = (1.0, 1.0 + 1e-6, 1.01, 2.0)  # multiples of the bound at which ends are looked for
_HIDDEN = 0.85  # of the time for the ends of hidden weights, before those of v and c
_CHECK = 0.4  # seconds that a step takes to check, of those that it takes to find


@dataclass(frozen=True, slots=True, eq=False)
class WeightStep:
    """One step of the proof, about the box that it is handed.

    Parameters
    ----------
    children : tuple of int
        Later steps: none, or one for the box that cuts leave, or two for its halves.
    entry : int
        Entry of the hidden weights that is bisected.
    at : float
        Where it is bisected.
    cuts : (K, 3) float
        Entry, side and value t: with side 1 values up to t are excluded, with -1 those from t on.
    dual : (K, rows) float
        Multipliers that prove the cuts, or with no children that the box is empty (K = 1).
    ends : (E, rows) float
        Multipliers for both ends of output weights and bias where the box remains.
    """

    children: tuple[int, ...] = ()
    entry: int = -1
    at: float = 0.0
    cuts: Reals = field(default_factory=lambda: frozen(np.zeros((0, 3))))
    dual: Reals = field(default_factory=lambda: frozen(np.zeros((0, 0))))
    ends: Reals = field(default_factory=lambda: frozen(np.zeros((0, 0))))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SmoothHiddenWeights(ReadOnly):
    """Intervals of the weights of all smooth networks of one structure that explain a record.

    Parameters
    ----------
    net : NNARX or NNOE
        The structure.
    data : IOData
    bound : float
        Of the equation error.
    weights : float
        Assumed bound of all weights and biases but the output's bias.
    eps : float
        Largest distance of the activation from the lines that stand for it in the boxes that
        remain. It is part of every row, so that the intervals are those of the activation itself.
    status : Status
        ``"proved"`` (every interval certified), ``"partial"`` or ``"empty"``.
    steps : tuple of WeightStep
        The proof; the first step is about all weights.
    members : (K, p) float
        Networks that are proved to explain the record; they attain the inner ends.
    intervals : mapping of str to ParameterInterval
        Of ``w1_1`` (neuron, regressor), ..., ``b1``, ..., ``v1``, ..., ``c``, normalised (v >= 0),
        neurons by descending first weight.
    assumptions : tuple of str
    """

    net: RegressorNetwork
    data: IOData
    bound: float
    weights: float
    eps: float
    status: Status
    steps: tuple[WeightStep, ...]
    members: Reals
    intervals: Mapping[str, ParameterInterval]
    assumptions: tuple[str, ...]

    @as_verdict
    def verify(self) -> Verification:
        """Draw all conclusions again from the stored multipliers, without any solver."""
        if not has_hidden_layer(self.net, *SMOOTH):
            return Verification(False, "the structure is none of smooth neurons")
        if not (0.0 < self.bound < np.inf and 0.0 < self.weights < np.inf):
            return Verification(False, "the bounds of errors and weights are not positive numbers")
        stated = _assumptions(self.net, self.data, self.bound, self.weights, self.eps)
        if not set(stated) <= set(self.assumptions):
            return Verification(False, "an assumption is left out")
        task = _Task.of(self.net, self.data, self.bound, self.weights)
        low, high, eps = task.drawn(self.steps)
        size = task.size
        if self.members.ndim != 2 or self.members.shape[1] != size:
            return Verification(False, "the members do not fit the structure")
        if not all(task.member(x) for x in self.members):
            return Verification(False, "a member does not explain the record")
        wanted, status = _intervals(task, low, high, self.members)
        same = status is self.status and same_intervals(self.intervals, wanted)
        return agreed(
            (same, "the intervals are not those that the steps and members prove"),
            (eps <= self.eps, "the activation is not proved to be within eps of its lines"),
        )

    def __repr__(self) -> str:
        items = ", ".join(repr(item) for item in list(self.intervals.values())[:3])
        name = self.net.network.activation[0]
        return (
            f"<SmoothHiddenWeights: {len(self.intervals)} parameters, {self.status}, "
            f"{name} within {rounded(self.eps, True, 2)}: {items}, ...>"
        )


def smooth_hidden_weights(
    net: RegressorNetwork, data: IOData, bound: float, weights: float, time_limit: float
) -> SmoothHiddenWeights:
    """Bound hidden weights of tanh, sigmoid or algebraic neurons; see :func:`hidden_weights`."""
    task = _Task.of(net, data, bound, weights)
    search = _Search(task, time.monotonic() + time_limit)
    with suppress(KeyboardInterrupt):  # steps that are left open only widen the intervals
        search.run()
    steps = tuple(search.steps)
    low, high, eps = task.drawn(steps)
    kept = [x for x in search.members.values() if task.member(x)]
    members = np.array(kept).reshape(len(kept), task.size)
    intervals, status = _intervals(task, low, high, members)
    texts = _assumptions(net, data, bound, weights, eps)
    return SmoothHiddenWeights(
        net=net,
        data=data,
        bound=bound,
        weights=weights,
        eps=eps,
        status=status,
        steps=steps,
        members=frozen(members),
        intervals=FrozenMapping(intervals),
        assumptions=texts,
    )


def _assumptions(
    net: RegressorNetwork, data: IOData, bound: float, weights: float, eps: float
) -> tuple[str, ...]:
    """Name what the intervals rest on, beside assumptions of the noise."""
    return (
        *data.assumptions,
        f"the equation error of each row is at most {all_digits(bound)}",
        "hidden weights and biases, and output weights, are at most "
        f"{all_digits(weights)} in absolute value",
        "output weights are normalised to v >= 0, neurons by descending first weight",
        f"{net.network.activation[0]} within {rounded(eps, True, 3)} of the lines that stand for "
        "it, which every row allows for",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Record, structure and limits that search and verification share."""

    net: RegressorNetwork
    data: IOData
    bound: float
    program: WeightProgram

    @staticmethod
    def of(net: RegressorNetwork, data: IOData, bound: float, weights: float) -> _Task:
        phi, row = rows_of(net, data)
        inner, y = net.network, data.y[row, 0]
        width = inner.weights[0].shape[0]
        # |c| <= |y| + D + sum v |phi|, where abs(phi) <= 1 for every smooth activation
        bias = float(up(up(width * weights * (1.0 + 1e-12)) + up(np.max(np.abs(y)) + bound)))
        program = WeightProgram(inner.activation[0], phi, y, width, weights, bias, bound)
        return _Task(net, data, bound, program)

    @property
    def hidden(self) -> int:
        """Number of hidden weights and biases."""
        return self.program.width * (self.program.phi.shape[1] + 1)

    @property
    def size(self) -> int:
        return self.hidden + self.program.width + 1

    @property
    def order(self) -> NDArray[np.int64]:
        """Places of w1_1, ..., b1, ..., v1, ..., c in the columns (w_1, b_1, w_2, b_2, ...)."""
        k, d = self.program.width, self.program.phi.shape[1]
        place = np.arange(self.hidden).reshape(k, d + 1)
        rest = np.arange(self.hidden, self.size)
        return np.concatenate([place[:, :d].ravel(), place[:, d], rest])

    @property
    def names(self) -> list[str]:
        k, d = self.program.width, self.program.phi.shape[1]
        found = [f"w{j + 1}_{i + 1}" for j in range(k) for i in range(d)]
        return [*found, *(f"{letter}{j + 1}" for letter in "bv" for j in range(k)), "c"]

    def ordered(self, box: Interval) -> bool:
        """Check that a box may hold networks whose neurons are ordered."""
        stride = self.program.phi.shape[1] + 1
        first = np.arange(0, self.hidden, stride)
        return bool(np.all(box.hi[first[:-1]] >= box.lo[first[1:]]))

    def cost(self, box: Interval, entry: int, side: float, at: float) -> Reals:
        """Write the cost side v (w_entry - at), above 0 where w_entry is beyond ``at``.

        That of v >= 0 is rounded down.
        """
        middle, radius = self.program.scale(box)
        found = np.zeros(self.size + 1)
        found[entry] = side * radius[entry]
        place = self.hidden + entry // (self.program.phi.shape[1] + 1)
        found[place] = down(side * (middle[entry] - at))
        return found

    def outer_costs(self) -> Reals:
        """Write the costs of v_1, -v_1, ..., c, -c."""
        rows = np.zeros((2 * (self.size - self.hidden), self.size + 1))
        for number, column in enumerate(range(self.hidden, self.size)):
            rows[2 * number, column], rows[2 * number + 1, column] = 1.0, -1.0
        return rows

    def after(self, step: WeightStep, box: Interval) -> Interval | None:
        """Take the part of a box that cuts leave, unproved cuts left out."""
        cuts = [c for c in step.cuts if c[0] in range(self.hidden) and abs(c[1]) == 1.0]
        if len(cuts) != len(step.dual):
            return box
        costs = np.array([self.cost(box, int(i), side, at) for i, side, at in cuts])
        proved = self.program.bounded(box, step.dual, costs.reshape(len(cuts), self.size + 1))
        low, high = box.lo.copy(), box.hi.copy()
        for (number, side, at), value in zip(cuts, proved, strict=True):
            entry = int(number)
            if value > 0.0 and side > 0:
                low[entry] = max(low[entry], at)
            elif value > 0.0:
                high[entry] = min(high[entry], at)
        return Interval(low, high) if np.all(low <= high) else None

    def remaining(self, steps: tuple[WeightStep, ...]) -> list[tuple[Interval, Reals]]:
        """List boxes that the steps leave, with their multipliers for v and c."""
        boxes, left = {0: self.program.root()}, list[tuple[Interval, Reals]]()
        for number, step in enumerate(steps):
            box = boxes.pop(number, None)
            if box is None or not self.ordered(box):
                continue
            parts = self.parts(step, box)
            children = step.children
            later = all(c > number and c not in boxes for c in children)
            if parts is None or not later or len(set(children)) != len(parts):
                left.append((box, step.ends))
                continue
            boxes.update((c, p) for c, p in zip(children, parts, strict=True) if p is not None)
        return left + [(box, np.zeros((0, 0))) for box in boxes.values()]

    def parts(self, step: WeightStep, box: Interval) -> list[Interval | None] | None:
        """List boxes that a step hands on; None where the box remains."""
        if len(step.children) == 2:
            if step.entry not in range(self.hidden) or not np.isfinite(step.at):
                return None
            return list(halves(box, step.entry, step.at))
        if len(step.children) == 1:
            return [self.after(step, box)]
        if step.children or len(step.dual) != 1:
            return None
        return [] if self.program.prove(box, step.dual[0], True) == np.inf else None

    def drawn(self, steps: tuple[WeightStep, ...]) -> tuple[Reals, Reals, float]:
        """Compute ends of all weights, in column order, and eps; reversed where empty."""
        low, high, eps = np.full(self.size, np.inf), np.full(self.size, -np.inf), 0.0
        costs = self.outer_costs()
        for box, duals in self.remaining(steps):
            least, most = (c[self.hidden : -1] for c in self.program.columns(box))
            ends = np.column_stack([least, -most]).ravel()
            if duals.shape[0] == len(costs):
                ends = np.maximum(ends, self.program.bounded(box, duals, costs))
            low = np.minimum(low, np.concatenate([box.lo, ends[::2]]))
            high = np.maximum(high, np.concatenate([box.hi, -ends[1::2]]))
            eps = max(eps, self.program.distance(box))
        return low, high, eps

    def network(self, x: Reals) -> Network:
        """Build the network of weights in the order of the columns."""
        k, inner = self.program.width, self.net.network
        w = x[: self.hidden].reshape(k, -1)
        v = x[self.hidden : -1]
        return Network([w[:, :-1], v[None]], [w[:, -1], x[-1:]], inner.activation, inner.leak)

    def member(self, x: Reals) -> bool:
        """Prove that a network explains the record within the range of weights, ordered."""
        if not np.all(np.isfinite(x)):
            return False
        trial = type(self.net)(self.network(x), self.net.order, self.net.channels)
        reached = float(equation_error(trial, self.data).upper_bound[0])
        point = Interval.point(x[: self.hidden])
        v = x[self.hidden : -1]
        inside = np.all(np.abs(x[:-1]) <= self.program.weights) and np.all(v >= 0.0)
        return reached <= self.bound and bool(inside) and self.ordered(point)


class _Search:
    """Branch, cut and discard boxes, those first that end an interval."""

    def __init__(self, task: _Task, until: float) -> None:
        self.task, self.program, self.until = task, task.program, until
        self.steps: list[WeightStep] = [WeightStep()]
        self.alive: dict[int, Interval] = {0: self.program.root()}
        self.members: dict[tuple[int, float], Reals] = {}
        self.tries, self.begin = 0, time.monotonic()
        self.local = MemberSearch(task.program, task.bound, until)
        self.last: dict[int, Reals] = {}  # ends of v, -v, ..., c, -c over boxes

    def run(self) -> None:
        """Work on the ends in turn until they are closed or the time is over."""
        goals = [(entry, side) for entry in range(self.task.hidden) for side in (1.0, -1.0)]
        self.start()
        busy, rounds = True, 0
        while busy and self.alive and self.spare(_HIDDEN):
            busy, rounds = False, rounds + 1
            if rounds & (rounds - 1) == 0:  # 1, 2, 4, 8, ...
                self.approach(goals)
            for entry, side in goals:
                if not self.alive or not self.spare(_HIDDEN):
                    break
                number = min(self.alive, key=lambda n: self.end(n, entry, side))
                if self.open_(number, entry, side):
                    self.work(number)
                    busy = True
        self.run_last()

    def run_last(self) -> None:
        """Bound output weights and bias over all boxes, and work on their ends in turn."""
        entries = range(self.task.hidden, self.task.size)
        goals = [(entry, side) for entry in entries for side in (1.0, -1.0)]
        self.bound_last()
        busy, rounds = True, 0
        while busy and self.alive and self.spare():
            busy, rounds = False, rounds + 1
            if rounds & (rounds - 1) == 0:
                self.approach(goals)
            for entry, side in goals:
                if not self.alive or not self.spare():
                    break
                number = min(self.alive, key=lambda n: self.end(n, entry, side))
                if self.open_(number, entry, side):
                    self.work(number)
                    self.bound_last()
                    busy = True

    def bound_last(self) -> None:
        """Bound output weights and bias over boxes that are new."""
        costs = self.task.outer_costs()
        for number, box in self.alive.items():
            if number in self.last or time.monotonic() > self.until:
                continue
            duals = self.ends(box)
            self.steps[number] = WeightStep(ends=duals)
            self.last[number] = self.program.bounded(box, duals, costs)

    def spare(self, share: float = 1.0) -> bool:
        """Check that time is left beyond what the ends of v and c and a last check need."""
        now, until = time.monotonic(), self.begin + share * (self.until - self.begin)
        each, new = (now - self.begin) / len(self.steps), len(self.alive) - len(self.last)
        return now + each * (max(new, 0) + _CHECK * len(self.steps)) < until

    def end(self, number: int, entry: int, side: float) -> float:
        if entry >= self.task.hidden:
            found = self.last.get(number)
            place = 2 * (entry - self.task.hidden) + (side < 0)
            return -np.inf if found is None else float(found[place])
        box = self.alive[number]
        return float(box.lo[entry] if side > 0 else -box.hi[entry])

    def value(self, entry: int, side: float) -> float:
        found = self.members.get((entry, side))
        return np.inf if found is None else side * float(found[entry])

    def open_(self, number: int, entry: int, side: float) -> bool:
        """Check that an end is not closed, and its box not too small to go on."""
        box = self.alive[number]
        if np.all(box.width() < 1e-9):
            return False
        width = -self.value(entry, 1.0) - self.value(entry, -1.0)
        allowed = 0.5 * _CLOSED * width if np.isfinite(width) else 0.0
        return self.value(entry, side) - self.end(number, entry, side) > allowed

    def work(self, number: int) -> None:
        """Prove a box empty, cut it, or bisect it."""
        box = self.alive.pop(number)
        self.last.pop(number, None)
        if not self.task.ordered(box):
            return
        while True:
            model = self.model(box)
            cost = np.zeros(self.task.size + 1)
            cost[-1] = 1.0
            found = model.solve(cost)
            if found.status == "infeasible":
                dual = self.empty(box, found.dual, cost)
                if dual is not None:
                    self.steps[number] = WeightStep(dual=frozen(dual[None]))
                    return
            if found.status == "solved":
                self.offer(self.point(found.x, box))
            before = box
            if found.status == "solved" and self.program.distance(box) < _LINEAR:
                number, cut = self.cuts(number, box, model, found.x)
                if cut is None:
                    return
                box = cut
            shrunk = np.prod(box.width() / np.maximum(before.width(), 1e-300))
            if shrunk > 0.5 or time.monotonic() > self.until:
                break
        self.bisect(number, box)

    def model(self, box: Interval, room: float = 1.0) -> LinearModel:
        """Build the linear program of a box, the error's bound times ``room``."""
        matrix, low, high = self.program.rows(box)
        least, most = self.program.columns(box)
        most[-1] *= room
        return LinearModel(sps.csr_array(matrix.middle()), (low, high), (least, most))

    def empty(self, box: Interval, ray: Reals, cost: Reals) -> Reals | None:
        """Search multipliers that prove a box empty: a ray, or of an error too large."""
        if self.program.prove(box, ray, True) > 0:
            return ray
        found = self.model(box, np.inf).solve(cost)
        proved = found.status == "solved" and self.program.prove(box, found.dual, True) > 0
        return found.dual if proved else None

    def bisect(self, number: int, box: Interval) -> None:
        reach = np.append(np.abs(self.program.phi).max(axis=0), 1.0)
        entry = int(np.argmax(box.width() * np.tile(reach, self.program.width)))
        at = float(box.middle()[entry])
        first = len(self.steps)
        self.steps[number] = WeightStep((first, first + 1), entry, at)
        for child, half in zip((first, first + 1), halves(box, entry, at), strict=True):
            self.steps.append(WeightStep())
            self.alive[child] = half

    def cuts(
        self, number: int, box: Interval, model: LinearModel, start: Reals
    ) -> tuple[int, Interval | None]:
        """Cut a box at the least and the largest weights that its program allows."""
        cuts, duals = [], []
        for entry in range(self.task.hidden):
            for side in (1.0, -1.0):
                at = self.least_ratio(model, start, entry, side, box)
                span = float(box.hi[entry] - box.lo[entry])
                edge = float(box.lo[entry] if side > 0 else box.hi[entry])
                at -= side * 1e-6 * span
                if side * (at - edge) < _WORTH * span:
                    continue
                found = model.solve(self.task.cost(box, entry, side, at))
                if found.status == "solved":
                    cuts.append((float(entry), side, at))
                    duals.append(found.dual)
        if not cuts:
            return number, box
        child = len(self.steps)
        step = WeightStep((child,), cuts=frozen(np.array(cuts)), dual=frozen(np.array(duals)))
        self.steps[number] = step
        self.steps.append(WeightStep())
        return child, self.task.after(step, box)

    def least_ratio(
        self, model: LinearModel, start: Reals, entry: int, side: float, box: Interval
    ) -> float:
        """Minimise side w_entry over a box, by Dinkelbach's iteration."""
        middle, radius = self.program.scale(box)
        v = self.task.hidden + entry // (self.program.phi.shape[1] + 1)
        edge = float(box.lo[entry] if side > 0 else box.hi[entry])
        span = float(box.hi[entry] - box.lo[entry])
        at = edge + side * 1.01 * _WORTH * span
        found = model.solve(self.task.cost(box, entry, side, at))
        if found.status != "solved" or found.value <= 0.0:
            return edge  # weights near the edge remain, so that no cut is worth its while
        x = start
        for _ in range(5):
            if x[v] < 1e-9:
                return edge
            new = float(middle[entry] + radius[entry] * x[entry] / x[v])
            if side * (at - new) < 1e-6 * span and x is not start:
                return new
            at, found = new, model.solve(self.task.cost(box, entry, side, new))
            if found.status != "solved":
                return edge
            x = found.x
        return edge + side * 1.01 * _WORTH * span

    # ---- members --------------------------------------------------------------------------

    def start(self) -> None:
        """Look for networks that explain the record, from the one given and from random ones."""
        inner = self.task.net.network
        rng = np.random.default_rng(0)
        side = np.where(inner.weights[1][0] < 0.0, -1.0, 1.0)
        first = np.hstack([inner.weights[0], inner.biases[0][:, None]]) * side[:, None]
        given = np.concatenate([first.ravel(), np.abs(inner.weights[1][0]), inner.biases[1]])
        self.local.until = self.begin + _MEMBERS * (self.until - self.begin)
        self.search_from(given, rng)
        self.local.until = self.until

    def search_from(self, given: Reals, rng: np.random.Generator) -> None:
        """Go from given weights, then from random ones, until some explain the record."""
        task = self.task
        for number in range(_STARTS):
            if self.members or self.local.late:
                return
            x = given if number == 0 else rng.uniform(-1.0, 1.0, task.size)
            self.offer(np.where(np.arange(x.size) >= task.hidden, np.abs(x), x))

    def point(self, x: Reals, box: Interval) -> Reals:
        """Read all weights of a solution, hidden ones within their box."""
        return np.concatenate([self.program.hidden(box, x), x[self.task.hidden : -1]])

    def offer(self, x: Reals) -> None:
        """Improve weights, and go from those that explain the record to all ends."""
        if self.members and self.local.error(x) > 2.0 * self.task.bound:
            return
        if self.tries >= _TRIES or time.monotonic() > self.until:
            return
        self.tries += 1
        x, error = self.local.least(x)
        if error > self.task.bound * (1.0 - 1e-9):
            return
        self.tries += 5
        self.take(x)
        for entry in range(x.size):
            for side in (1.0, -1.0):
                if self.local.late:
                    return
                self.take(self.local.extreme(x, entry, side))

    def approach(self, goals: list[tuple[int, float]]) -> None:
        """Look for networks near the boxes that end intervals, which other searches may miss."""
        for entry, side in goals:
            number = min(self.alive, key=lambda n: self.end(n, entry, side))
            if not self.members or not self.open_(number, entry, side) or not self.spare():
                continue
            box = self.alive[number]
            cost = np.zeros(self.task.size + 1)
            cost[-1] = 1.0
            found = self.model(box, np.inf).solve(cost)
            if found.status == "solved":
                near, reach = self.point(found.x, box), float(box.width().max())
                x, error = self.local.least(near, self.local.room, reach)
                if error <= self.local.room:
                    self.take(self.local.extreme(x, entry, side))

    def take(self, x: Reals) -> None:
        """Order neurons, and keep the network for every end at which it is the best."""
        k, hidden = self.program.width, self.task.hidden
        w, v = x[:hidden].reshape(k, -1), x[hidden:-1]
        order = np.argsort(-w[:, 0], kind="stable")
        x = np.concatenate([w[order].ravel(), v[order], x[-1:]])
        for entry in range(x.size):
            for side in (1.0, -1.0):
                if side * x[entry] < self.value(entry, side):
                    self.members[entry, side] = x

    def ends(self, box: Interval) -> Reals:
        """Find multipliers for the ends of output weights and bias over a box.

        A box that is empty but for rounding has them for a larger error.
        """
        costs = self.task.outer_costs()
        for room in _ROOMS:
            model = self.model(box, room)
            solved = [model.solve(cost) for cost in costs]
            if all(found.status == "solved" for found in solved):
                return frozen(np.array([found.dual for found in solved]))
        return frozen(np.zeros((0, 0)))


def _intervals(
    task: _Task, low: Reals, high: Reals, members: Reals
) -> tuple[dict[str, ParameterInterval], Status]:
    """Intervals with their names, and what they are worth together."""
    if np.any(low > high):
        ends = np.inf, -np.inf
        none = {n: ParameterInterval(n, ends, None, IntervalStatus.EMPTY) for n in task.names}
        return none, Status.EMPTY
    found = {
        name: interval_of(name, (float(low[i]), float(high[i])), members[:, i])
        for name, i in zip(task.names, task.order, strict=True)
    }
    closed = all(item.status is IntervalStatus.CERTIFIED for item in found.values())
    return found, Status.PROVED if closed else Status.PARTIAL


def interval_of(name: str, outer: tuple[float, float], values: Reals) -> ParameterInterval:
    """Make the interval of proved ends and those that members attain."""
    if not values.size:
        return ParameterInterval(name, outer, None, IntervalStatus.PARTIAL)
    inner = float(values.min()), float(values.max())
    loose = max(inner[0] - outer[0], outer[1] - inner[1])
    closed = loose <= _CLOSED * (inner[1] - inner[0])
    status = IntervalStatus.CERTIFIED if closed else IntervalStatus.PARTIAL
    return ParameterInterval(name, outer, inner, status)
