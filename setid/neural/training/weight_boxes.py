"""Global training of small smooth networks: branch and bound on boxes of hidden weights.

On a box of hidden weights and biases every activation obeys phi(a) = lambda a + mu + s with
abs(s) <= delta (see :func:`setid.neural.arithmetic.linearise`), delta of second order in the width.
With output weights v_j >= 0 (signs are moved inside), x_t = (phi_t, 1) and hidden weights
m_j + r_j u_j about the middle m of the box, bias last, abs(u_j) <= 1, the row

    abs(y_t - c - sum_j (lambda_tj x_t (m_j v_j + r_j s_j) + mu_tj v_j)) <= D + sum_j delta_tj v_j

with s_j = v_j u_j is linear, as is the box, abs(s_j) <= v_j. (With v_j w_j in place of s_j the rows
of a small box would differ by rounding only, and so would what they prove of v and c.)
Each box needs one linear program
whose bound is proved as in :mod:`setid.neural.training.patterns`, with coefficients in intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.neural.arithmetic import (
    Interval,
    LinearModel,
    activate,
    down,
    linearise,
    matmul,
    row_sums,
    up,
)
from setid.neural.branching import BestFirst, DualNode, halves
from setid.neural.models.network import Network

__all__ = ["WeightProgram", "WeightSearch", "fitted", "prove_boxes", "reaches"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class WeightProgram:
    """Record, structure and ranges that the linear programs of all boxes share.

    Parameters
    ----------
    name : str
        Activation.
    phi : (T, d) float
    y : (T,) float
    width : int
        Number k of neurons.
    weights, bias, cap : float
        Ranges of hidden and output weights, of the output bias, and of D.
    last : list
        The rows that were made last, with their box.
    """

    name: str
    phi: Reals
    y: Reals
    width: int
    weights: float
    bias: float
    cap: float
    last: list[Any] = field(default_factory=list, repr=False)

    def root(self) -> Interval:
        """Make the box (k (d + 1),) of hidden weights and biases, neuron by neuron."""
        high = np.full(self.width * (self.phi.shape[1] + 1), self.weights)
        return Interval(-high, high)

    @staticmethod
    def scale(box: Interval) -> tuple[Reals, Reals]:
        """Compute middle and radius (k (d + 1),) of a box, the radius rounded up."""
        middle = box.middle()
        return middle, box.radius(middle)

    def hidden(self, box: Interval, x: Reals) -> Reals:
        """Read hidden weights of a solution, the box's middle where output weights are zero."""
        middle, radius = self.scale(box)
        v = np.repeat(x[box.lo.size : box.lo.size + self.width], self.phi.shape[1] + 1)
        with np.errstate(all="ignore"):
            found = middle + radius * np.where(v > 1e-12, x[: box.lo.size] / v, 0.0)
        return np.clip(found, box.lo, box.hi)

    def rows(self, box: Interval) -> tuple[Interval, Reals, Reals]:
        """Compute coefficients of the rows and their ends; columns s_j ..., v, c, D."""
        return self._stated(box)[:3]

    def distance(self, box: Interval) -> float:
        """Bound the distance of the activation from its lines over a box, with proof."""
        return self._stated(box)[3]

    def _stated(self, box: Interval) -> tuple[Interval, Reals, Reals, float]:
        """Rows and distance, kept for the box that was asked for last."""
        if not self.last or self.last[0][0] is not box:
            self.last[:] = [(box, self._made(box))]
        return self.last[0][1]

    def _made(self, box: Interval) -> tuple[Interval, Reals, Reals, float]:
        count, d = self.phi.shape
        k = self.width
        full = np.hstack([self.phi, np.ones((count, 1))])
        size = k * (d + 1)
        upper = Interval(np.zeros((count, size + k + 2)), np.zeros((count, size + k + 2)))
        lower = Interval(upper.lo.copy(), upper.hi.copy())
        far = 0.0
        middle, radii = self.scale(box)
        for j in range(k):
            own = slice(j * (d + 1), (j + 1) * (d + 1))
            a = matmul(Interval.point(full), box[own][:, None])[:, 0]
            slope, offset, radius = linearise(self.name, a)
            far = max(far, float(radius.max()))
            part = Interval.point(slope[:, None]) * Interval.point(full)
            centre = matmul(part, Interval.point(middle[own, None]))[:, 0] + Interval.point(offset)
            above = centre + Interval.point(radius)
            below = centre - Interval.point(radius)
            part = part * Interval.point(radii[None, own])
            for rows, level in ((upper, above), (lower, below)):
                rows.lo[:, own], rows.hi[:, own] = part.lo, part.hi
                rows.lo[:, size + j], rows.hi[:, size + j] = level.lo, level.hi
        for rows, sign in ((upper, 1.0), (lower, -1.0)):
            rows.lo[:, -2] = rows.hi[:, -2] = 1.0
            rows.lo[:, -1] = rows.hi[:, -1] = sign
        cone = np.zeros((2 * size, size + k + 2))
        entry = np.arange(size)
        cone[entry, entry], cone[size + entry, entry] = 1.0, -1.0
        cone[entry, size + entry // (d + 1)] = 1.0
        cone[size + entry, size + entry // (d + 1)] = 1.0
        matrix = Interval(
            np.vstack([upper.lo, lower.lo, cone]), np.vstack([upper.hi, lower.hi, cone])
        )
        free = np.inf
        low = np.concatenate([self.y, np.full(count, -free), np.zeros(2 * size)])
        high = np.concatenate([np.full(count, free), self.y, np.full(2 * size, free)])
        return matrix, low, high, far

    def columns(self, box: Interval) -> tuple[Reals, Reals]:
        """Compute the ranges of the columns."""
        most = np.full(box.lo.size, self.weights)
        ends = np.full(self.width, self.weights)
        return (
            np.concatenate([-most, np.zeros(self.width), [-self.bias, 0.0]]),
            np.concatenate([most, ends, [self.bias, self.cap]]),
        )

    def prove(self, box: Interval, dual: Reals, infeasible: bool) -> float:
        """Bound D over a box from below; infinite where it is proved empty."""
        cost = np.zeros(self.columns(box)[0].size)
        cost[-1] = 0.0 if infeasible else 1.0
        value = float(self.bounded(box, dual[None], cost[None])[0])
        if infeasible:
            return np.inf if value > 0 else 0.0
        return value if value > 0.0 else 0.0  # also where it is NaN

    def bounded(self, box: Interval, duals: Reals, costs: Reals) -> Reals:
        """Bound functions (K, n) of the columns from below (K,) by multipliers."""
        matrix, low, high = self.rows(box)
        found = np.full(len(costs), -np.inf)
        if duals.shape != (len(costs), low.size) or not np.all(np.isfinite(duals)):
            return found
        least, most = self.columns(box)
        for number, (dual, cost) in enumerate(zip(duals, costs, strict=True)):
            y = np.where((dual > 0) & np.isinf(low), 0.0, dual)
            y = np.where((y < 0) & np.isinf(high), 0.0, y)
            used = np.flatnonzero(y)
            ends = np.where(y > 0, low, high)[used]
            gain = matmul(Interval.point(y[None, used]), Interval.point(ends[:, None]))
            reduced = Interval.point(cost[None]) - matmul(
                Interval.point(y[None, used]), matrix[used]
            )
            terms = (reduced * Interval(least[None], most[None])).lo[0]
            slack = float(row_sums(terms[None])[0]) * (terms.size + 4.0) * 2.0**-52
            found[number] = down(down(gain.lo[0, 0]) + down(down(terms.sum()) - up(slack)))
        return found


def prove_boxes(program: WeightProgram, node: DualNode, box: Interval) -> float:
    """Bound D from below by what the leaves of a tree prove together."""
    if node.split < 0:
        return program.prove(box, node.dual, node.infeasible)
    if len(node.children) != 2 or node.split >= box.lo.size:
        return 0.0
    parts = zip(node.children, halves(box, node.split), strict=True)
    return min(prove_boxes(program, child, half) for child, half in parts)


class WeightSearch(BestFirst[Interval]):
    """Best-first branch and bound over boxes of hidden weights."""

    def __init__(self, program: WeightProgram) -> None:
        super().__init__()
        self.program = program
        self.add(program.root())

    def add(self, box: Interval) -> None:
        """Bound a box and keep the hidden weights that its program proposes."""
        program = self.program
        matrix, low, high = program.rows(box)
        model = LinearModel(sps.csr_array(matrix.middle()), (low, high), program.columns(box))
        cost = np.zeros(matrix.lo.shape[1])
        cost[-1] = 1.0
        found = model.solve(cost)
        infeasible = found.status == "infeasible"
        value = program.prove(box, found.dual, infeasible)
        reach = np.append(np.abs(program.phi).max(axis=0), 1.0)
        entry = int(np.argmax(box.width() * np.tile(reach, program.width)))
        point = program.hidden(box, found.x) if found.status == "solved" else None
        self.file(value, box, found.dual, infeasible, entry, point)

    def parts(self, part: Interval, split: int) -> tuple[Interval, Interval]:
        """Bisect a box along an entry."""
        return halves(part, split)


def reaches(weights: float, y: Reals, width: int = 1) -> float:
    """Bound the output bias that is of use with neurons whose values are in [-1, 1].

    Sigmoid neurons of negative output weight change it where signs are moved inside.
    """
    return float(up(up(weights * width) + np.max(np.abs(y))))


def fitted(
    network: Network, phi: Reals, y: Reals, weights: float, point: Reals | None
) -> tuple[Network | None, float]:
    """Fit the last layer to hidden weights by a linear program; return its error too."""
    if point is None:
        return None, np.inf
    width, d = network.weights[0].shape
    hidden = point.reshape(width, d + 1)
    z = activate(network.activation[0], phi @ hidden[:, :d].T + hidden[:, d], network.leak)
    one = np.ones((len(y), 1))
    matrix = sps.csr_array(np.block([[z, one, one], [z, one, -one]]))
    free, bias = np.full(len(y), np.inf), reaches(weights, y, width)
    columns = (
        np.append(np.zeros(width), [-bias, 0.0]),
        np.append(np.full(width, weights), [bias, np.inf]),
    )
    model = LinearModel(matrix, (np.append(y, -free), np.append(free, y)), columns)
    found = model.solve(np.append(np.zeros(width + 1), 1.0))
    if found.status != "solved":
        return None, np.inf
    last = np.clip(found.x[:width], 0.0, weights)
    trial = Network([hidden[:, :d], last[None]], [hidden[:, d], [0.0]], network.activation)
    rest = y - trial(phi)[:, 0]
    middle = np.clip(0.5 * (rest.max() + rest.min()), -bias, bias)
    error = float(np.max(np.abs(rest - middle)))
    return trial.with_last_layer(last[None], [middle]), error
