"""Networks that explain a record and have extreme weights: linear programs one after another.

Nothing here is proved; what is found is checked elsewhere.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from setid.neural.arithmetic import LinearModel, activate, slope_at
from setid.neural.training.weight_boxes import WeightProgram

__all__ = ["MemberSearch"]

Reals = NDArray[np.float64]
_ROUNDS = 40
_LEAST = 0.01  # seconds of a linear program that has begun
_SMALL = 1e-9  # steps below this end a search


class MemberSearch:
    """Local search over all weights x = (w_1, b_1, w_2, b_2, ..., v, c) within their ranges."""

    def __init__(self, program: WeightProgram, bound: float, until: float = np.inf) -> None:
        self.until = until  # reading of time.monotonic after which no step is tried
        self.program, self.room = program, bound * (1.0 - 1e-9)
        k, d = program.width, program.phi.shape[1]
        self.full = np.hstack([program.phi, np.ones((len(program.phi), 1))])
        self.hidden = k * (d + 1)
        high = np.full(self.hidden + k + 1, program.weights)
        high[-1] = program.bias
        self.high, self.low = high, np.where(np.arange(high.size) >= self.hidden, 0.0, -high)
        self.low[-1] = -program.bias

    @property
    def late(self) -> bool:
        """True where the time is over."""
        return time.monotonic() > self.until

    def residual(self, x: Reals) -> tuple[Reals, Reals]:
        """Compute errors (T,) and the derivatives (T, p) of the outputs."""
        program = self.program
        w = x[: self.hidden].reshape(program.width, -1)
        v = x[self.hidden : -1]
        a = self.full @ w.T
        z = activate(program.name, a, 0.0)
        slope = slope_at(program.name, a).middle()
        parts = [(slope[:, j] * v[j])[:, None] * self.full for j in range(program.width)]
        ones = np.ones((len(z), 1))
        return program.y - z @ v - x[-1], np.hstack([*parts, z, ones])

    def error(self, x: Reals) -> float:
        """Compute the largest error."""
        return float(np.max(np.abs(self.residual(x)[0])))

    def step(self, x: Reals, reach: float, cost: Reals, room: float) -> Reals | None:
        """Find the best step within a reach, errors linear; cost's last entry is of D."""
        if self.late:
            return None
        rest, slopes = self.residual(x)
        one = np.ones((len(rest), 1))
        matrix = sps.csr_array(np.vstack([np.hstack([slopes, one]), np.hstack([slopes, -one])]))
        free = np.full(len(rest), np.inf)
        rows = np.append(rest, -free), np.append(free, rest)
        low = np.append(np.maximum(self.low - x, -reach), 0.0)
        high = np.append(np.minimum(self.high - x, reach), room)
        left = self.until - time.monotonic()
        found = LinearModel(matrix, rows, (low, high)).solve(cost, max(left, _LEAST))
        return np.clip(x + found.x[:-1], self.low, self.high) if found.status == "solved" else None

    def least(self, x: Reals, enough: float = 0.0, reach: float = 0.5) -> tuple[Reals, float]:
        """Search weights near x of least error, or of an error small enough."""
        x = np.clip(x, self.low, self.high)
        value = self.error(x)
        cost = np.append(np.zeros(x.size), 1.0)
        for _ in range(_ROUNDS):
            trial = self.step(x, reach, cost, np.inf)
            reached = np.inf if trial is None else self.error(trial)
            if trial is not None and reached < value * (1.0 - 1e-6):
                x, value, reach = trial, reached, 2.0 * reach
            else:
                reach /= 3.0
            if reach < _SMALL or value <= enough or self.late:
                break
        return x, value

    def extreme(self, x: Reals, entry: int, side: float) -> Reals:
        """Search weights that explain the record, from x on, with side x_entry least."""
        reach, spare = 0.5, 0.0
        cost = np.zeros(x.size + 1)
        cost[entry] = side
        for _ in range(_ROUNDS):
            trial = self.step(x, reach, cost, self.room - spare)
            reached = np.inf if trial is None else self.error(trial)
            if trial is not None and reached <= self.room:
                gain = side * (x[entry] - trial[entry])
                if gain > 0.0:
                    x = trial
                if gain < _SMALL:
                    break
                reach, spare = 2.0 * reach, 0.25 * spare
            else:
                over = reached - self.room if np.isfinite(reached) else 0.0
                reach, spare = 0.5 * reach, min(0.5 * over, 0.1 * self.room)
            if reach < _SMALL or self.late:
                break
        return x
