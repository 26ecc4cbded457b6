"""Training of small ReLU networks as a polynomial problem, for the engine.

With output weights s_j = +-1 (normalised: v relu(w x + b) = sign(v) relu(|v| w x + |v| b)) and
neurons of equal sign ordered by their first weight, the positive and negative parts of
z_tj = w_j phi_t + b_j are the solutions of

    p >= 0,  m >= 0,  p - m = z,  p m = 0,

and a neuron's output is p - leak m. Then abs(y_t - c - sum_j s_j out_tj) <= D is linear. Both
factors of the products are unknowns, so that branches decide which of them is zero. Feasible points
need no search: weights alone give all other unknowns by simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import ModelError

__all__ = ["TrainingProblem", "proved_by_certificate", "search_by_engine", "training_problem"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TrainingProblem:
    """Least equation error over all networks with given output signs.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        Variables: weights of each neuron, biases, c, D, then p and m of each sample and neuron.
    phi : (T, d) float
    y : (T,) float
    signs : (k,) float
    leak : float
    cap : float
        Largest D that is followed.
    """

    problem: sp.Problem
    phi: Reals
    y: Reals
    signs: Reals
    leak: float
    cap: float

    def point(self, w: Reals, b: Reals) -> Reals | None:
        """All unknowns (n,) of a network with hidden weights w (k, d), b (k,), by simulation.

        The best c and D follow. None where D is above the cap.
        """
        z = self.phi @ np.asarray(w, float).T + np.asarray(b, float)
        plus, minus = np.maximum(z, 0.0), np.maximum(-z, 0.0)
        rest = self.y - (plus - self.leak * minus) @ self.signs
        c, error = 0.5 * (rest.max() + rest.min()), 0.5 * (rest.max() - rest.min())
        if error > self.cap:
            return None
        return np.concatenate([np.ravel(w), np.ravel(b), [c, error], plus.ravel(), minus.ravel()])


def training_problem(
    phi: Reals, y: Reals, signs: Sequence[float], leak: float, weights: float, offset: float,
    cap: float,
) -> TrainingProblem:  # fmt: skip
    """State the training of one hidden layer as a polynomial problem.

    Parameters
    ----------
    phi : (T, d) float
    y : (T,) float
    signs : sequence of float
        Output weights +1 or -1, in descending order.
    leak : float
        Slope for negative arguments, 0 for ReLU, below 1.
    weights, offset, cap : float
        Bounds of hidden weights and biases, of c, and of D.
    """
    if not 0.0 <= leak < 1.0:
        raise ModelError(f"leak: found {leak!r}, expected a number in [0, 1)")
    (count, d), k = phi.shape, len(signs)
    pairs = count * k
    names = [f"w{j}_{i}" for j in range(k) for i in range(d)] + [f"b{j}" for j in range(k)]
    names += ["c", "D"] + [f"p{t}_{j}" for t in range(count) for j in range(k)]
    names += [f"m{t}_{j}" for t in range(count) for j in range(k)]
    x = sp.variables(len(names), names)
    base = k * d + k
    c, level = x[base], x[base + 1]
    rows, start = [], base + 2
    for t in range(count):
        output = c + 0.0
        for j in range(k):
            z = sum((float(phi[t, i]) * x[j * d + i] for i in range(d)), 1.0 * x[k * d + j])
            place = start + t * k + j
            plus, minus = x[place], x[place + pairs]
            rows += [plus - minus - z == 0, plus * minus == 0]
            output = output + float(signs[j]) * plus - float(signs[j] * leak) * minus
        rows += [level + output - float(y[t]) >= 0, level - output + float(y[t]) >= 0]
    for j in range(k - 1):
        if signs[j] == signs[j + 1]:
            rows.append(x[j * d] - x[(j + 1) * d] >= 0)
    # 1.001 covers the rounding of the sum: outputs of a neuron within its weights
    most = np.repeat(1.001 * weights * (np.abs(phi).sum(axis=1) + 1.0), k)
    own = np.concatenate([np.full(base, weights), [offset, cap]])
    low = np.concatenate([-own[:-1], [0.0], np.zeros(2 * pairs)])
    high = np.concatenate([own, most, most])
    problem = sp.Problem(level, rows, low, high)
    return TrainingProblem(
        problem, frozen(phi), frozen(y), frozen(np.asarray(signs, float)), float(leak), float(cap)
    )


def search_by_engine(item: TrainingProblem, seconds: float) -> tuple[sp.Result, Reals | None]:
    """Solve by branch and bound of the engine.

    Parameters
    ----------
    item : TrainingProblem
    seconds : float

    Returns
    -------
    result : sparsepop_py.Result
    weights : (k d + k,) float or None
        Hidden weights and biases that the engine proposes.
    """
    count = len(item.signs) * (item.phi.shape[1] + 1)
    result = sp.solve(item.problem, sp.Options(effort="auto", time_limit=max(seconds, 0.1)))
    return result, None if result.x is None else np.asarray(result.x[:count], np.float64)


def proved_by_certificate(item: TrainingProblem, certificate: sp.Certificate | None) -> float:
    """Lower bound of D that a certificate proves, at most the cap."""
    if certificate is None or not certificate.verify(item.problem):
        return 0.0
    return min(max(certificate.bound, 0.0), item.cap)
