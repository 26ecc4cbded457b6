"""Global training of small piecewise linear networks: branch and bound on activation patterns.

One hidden layer of ReLU or leaky ReLU (slope leak below 0) is positively homogeneous, so that the
output weights can be normalised to s_j = +-1. With a = a+ - a-, a+, a- >= 0 and a+ a- = 0 the
output is sum_j s_j (a+_j - leak a-_j) + c, linear, and the least equation error D is a linear
program but for the complementarity a+ a- = 0. A node fixes some pairs (a+ = 0 or a- = 0) and drops
the others; row u- a+ + u+ a- <= u+ u-, with a+ <= u+ and a- <= u-, is valid for all of them. The
goal is D, or one weight with a sign, below a largest D.

Every variable is boxed, so multipliers y of the rows r_l <= A x <= r_u prove

    D >= sum_i min(y_i [r_l, r_u]_i) + min over the box of (e_D - A'y) x

in interval arithmetic, whatever the solver did (Neumaier and Shcherbina 2004).

References
----------
A. Neumaier, O. Shcherbina, "Safe bounds in linear and mixed-integer linear programming",
Mathematical Programming 99 (2004) 283-296.
R. Arora et al., "Understanding deep neural networks with rectified linear units", ICLR 2018,
theorem 4.1: enumeration of patterns.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.neural.arithmetic import Interval, LinearModel, down, matmul, up
from setid.neural.branching import BestFirst, DualNode

__all__ = ["Goal", "PatternSearch", "Patterns", "prove_tree"]

Reals = NDArray[np.float64]
Goal = tuple[int, float]  # column, and +1 to bound it from below, -1 from above
_ROOM = 1e-9
_LEAST = 0.01  # seconds of a program that is begun when the time is over


@dataclass(frozen=True, slots=True, eq=False)
class Patterns:
    """The linear program of all patterns for one choice of the output signs.

    Columns: weights of each neuron, biases, c, D, then a+ and a- of each pair.
    """

    matrix: sps.csr_array
    rows: tuple[Reals, Reals]
    columns: tuple[Reals, Reals]
    weights: int
    pairs: int
    free: bool

    @staticmethod
    def of(
        phi: Reals, y: Reals, signs: Reals, leak: float, box: tuple[Reals, Reals], cap: float
    ) -> Patterns:
        """Build the program.

        Parameters
        ----------
        phi : (T, d) float
        y : (T,) float
        signs : (k,) float
            Output weights, +1 or -1, in descending order.
        leak : float
            Slope for negative arguments; 1 makes the network linear.
        box : ((k d + k + 1,) float, (k d + k + 1,) float)
            Least and largest weights of each neuron, biases and output bias, finite.
        cap : float
            Bound of D from a network that is known.
        """
        count, d = phi.shape
        k = signs.size
        size = k * d + k + 2
        plus, minus = _reached(phi, box, k)
        pairs = count * k
        eye = sps.identity(pairs, format="csr")
        neuron = np.kron(np.ones((count, 1)), np.eye(k))  # of each pair, as (pairs, k)
        weighted = neuron.repeat(d, axis=1) * np.tile(np.repeat(phi, k, axis=0), k)
        own = sps.csr_array(np.hstack([weighted, neuron, np.zeros((pairs, 2))]))
        arguments = sps.hstack([own, -eye, eye])
        add = sps.csr_array(sps.kron(sps.identity(count), signs[None, :]))
        offset = np.zeros((count, size))
        offset[:, -2] = 1.0
        level = np.zeros((count, size))
        level[:, -1] = 1.0
        output = sps.hstack([sps.csr_array(offset + level), add, -leak * add])
        below = sps.hstack([sps.csr_array(offset - level), add, -leak * add])
        triangle = sps.hstack([sps.csr_array((pairs, size)), sps.diags(minus), sps.diags(plus)])
        order = _ordering(signs, d, size + 2 * pairs)
        matrix = sps.csr_array(sps.vstack([arguments, output, below, triangle, order]))
        zero, free = np.zeros(pairs), np.inf
        low = np.concatenate(
            [zero, y, np.full(count, -free), np.full(pairs, -free), np.zeros(order.shape[0])]
        )
        high = np.concatenate(
            [zero, np.full(count, free), y, up(plus * minus), np.full(order.shape[0], free)]
        )
        columns = (
            np.concatenate([box[0], np.zeros(1 + 2 * pairs)]),
            np.concatenate([box[1], [cap], plus, minus]),
        )
        return Patterns(matrix, (low, high), columns, size, pairs, leak == 1.0)

    def decided(self, fixed: NDArray[np.int8]) -> tuple[Reals, Reals]:
        """Bound columns where pairs are fixed: 1 if a- = 0, -1 if a+ is."""
        high = self.columns[1].copy()
        high[self.weights : self.weights + self.pairs][fixed == -1] = 0.0
        high[self.weights + self.pairs :][fixed == 1] = 0.0
        return self.columns[0], high

    @property
    def level(self) -> Goal:
        """The goal of least D."""
        return self.weights - 1, 1.0

    def floor(self, goal: Goal) -> float:
        """Bound a goal from below by its column's range."""
        entry, side = goal
        return float(self.columns[0][entry] if side > 0 else -self.columns[1][entry])

    def prove(
        self, dual: Reals, fixed: NDArray[np.int8], infeasible: bool, goal: Goal | None = None
    ) -> float:
        """Bound a goal over a node from below; infinite where it is proved empty."""
        entry, side = goal = goal or self.level
        if dual.shape != self.rows[0].shape or not np.all(np.isfinite(dual)):
            return self.floor(goal)
        y = np.where((dual > 0) & np.isinf(self.rows[0]), 0.0, dual)
        y = np.where((y < 0) & np.isinf(self.rows[1]), 0.0, y)
        used = np.flatnonzero(y)
        ends = np.where(y > 0, self.rows[0], self.rows[1])[used]
        gain = matmul(Interval.point(y[None, used]), Interval.point(ends[:, None]))
        cost = np.zeros((1, self.matrix.shape[1]))
        if not infeasible:
            cost[0, entry] = side
        part = Interval.point(self.matrix[used].toarray())
        reduced = Interval.point(cost) - matmul(Interval.point(y[None, used]), part)
        low, high = self.decided(fixed)
        terms = (reduced * Interval(low[None], high[None])).lo[0]
        size = np.abs(terms).sum() * (terms.size + 4.0) * 2.0**-52
        value = float(down(down(gain.lo[0, 0]) + down(down(terms.sum()) - up(size))))
        if infeasible:
            return np.inf if value > 0 else self.floor(goal)
        return value if value > self.floor(goal) else self.floor(goal)  # also where it is NaN


def _reached(phi: Reals, box: tuple[Reals, Reals], k: int) -> tuple[Reals, Reals]:
    """Largest a+ and a- of each pair (pair = t k + j) over the box of weights, rounded up."""
    low, high = (np.asarray(end[: k * phi.shape[1]]).reshape(k, -1).T for end in box)
    bias = slice(k * phi.shape[1], k * phi.shape[1] + k)
    a = matmul(Interval.point(phi), Interval(low, high)) + Interval(box[0][bias], box[1][bias])
    return np.maximum(a.hi, 0.0).ravel(), np.maximum(-a.lo, 0.0).ravel()


def _ordering(signs: Reals, d: int, width: int) -> sps.csr_array:
    """Neurons of equal sign are ordered by their first weight, which removes permutations."""
    rows = []
    for j in range(signs.size - 1):
        if signs[j] == signs[j + 1]:
            row = np.zeros(width)
            row[j * d], row[(j + 1) * d] = 1.0, -1.0
            rows.append(row)
    return sps.csr_array(np.array(rows).reshape(len(rows), width))


def prove_tree(
    program: Patterns, node: DualNode, fixed: NDArray[np.int8], goal: Goal | None = None
) -> float:
    """Bound a goal (D where left out) from below by the leaves of a tree."""
    if node.split < 0:
        return program.prove(node.dual, fixed, node.infeasible, goal)
    if len(node.children) != 2 or node.split >= program.pairs:
        return program.floor(goal or program.level)
    found = np.inf
    for child, value in zip(node.children, (1, -1), strict=True):
        below = fixed.copy()
        below[node.split] = value
        found = min(found, prove_tree(program, child, below, goal))
    return found


class PatternSearch(BestFirst[NDArray[np.int8]]):
    """Best-first branch and bound over the patterns of one program."""

    def __init__(self, program: Patterns, goal: Goal | None = None, until: float = np.inf) -> None:
        super().__init__()
        self.program, self.until = program, until  # a reading of time.monotonic
        self.goal = goal or program.level
        self.model = LinearModel(program.matrix, program.rows, program.columns)
        self.cost = np.zeros(program.matrix.shape[1])
        self.cost[self.goal[0]] = self.goal[1]

    def add(self, fixed: NDArray[np.int8]) -> None:
        """Bound a node and keep the weights that its program proposes."""
        program = self.program
        low, high = program.decided(fixed)
        self.model.bound(np.arange(low.size), low, high)
        found = self.model.solve(self.cost, self._left())
        infeasible = found.status == "infeasible"
        value = program.prove(found.dual, fixed, infeasible, self.goal)
        split = -1
        x = found.x if found.status == "solved" else None
        if x is not None and not program.free:
            plus = x[program.weights : program.weights + program.pairs]
            minus = x[program.weights + program.pairs :]
            gap = np.where(fixed == 0, np.minimum(plus, minus), -1.0)
            split = int(np.argmax(gap)) if np.max(gap) > _ROOM else -1
        point = None if x is None else x[: program.weights].copy()
        self.file(value, fixed, found.dual, infeasible, split, point)

    def parts(self, part: NDArray[np.int8], split: int) -> Iterator[NDArray[np.int8]]:
        """Decide a pair: a- = 0, then a+ = 0."""
        for choice in (1, -1):
            below = part.copy()
            below[split] = choice
            yield below

    def propose(self, fixed: NDArray[np.int8], room: float = 0.0) -> Reals | None:
        """Solve the program of one pattern, without keeping it, D a fraction below the cap."""
        low, high = self.program.decided(fixed)
        high[self.program.weights - 1] *= 1.0 - room
        self.model.bound(np.arange(low.size), low, high)
        found = self.model.solve(self.cost, self._left())
        return found.x if found.status == "solved" else None

    def _left(self) -> float | None:
        """Seconds that one program may take."""
        return None if self.until == np.inf else max(self.until - time.monotonic(), _LEAST)
