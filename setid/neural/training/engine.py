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

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import ModelError
from sparsepop_py.algebra.polynomial import Kind

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
        """Simulate all unknowns (n,) of a network with hidden weights w (k, d), b (k,).

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
    phi: Reals,
    y: Reals,
    signs: Sequence[float],
    leak: float,
    weights: float,
    offset: float,
    cap: float,
    until: float = np.inf,
) -> TrainingProblem | None:
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
    until : float
        Reading of ``time.monotonic`` after which the statement is given up.

    Returns
    -------
    TrainingProblem or None
        None where it was given up.
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
    level = x[base + 1]
    rows, start = list[sp.Constraint](), base + 2
    hidden = [np.append(np.arange(j * d, (j + 1) * d), k * d + j) for j in range(k)]
    for t in range(count):
        if time.monotonic() > until:
            return None
        places = start + t * k + np.arange(k)
        for j, place in enumerate(places):
            # plus - minus - z == 0 and plus minus == 0
            rows.append(_row([place, place + pairs, *hidden[j]], [1.0, -1.0, *-phi[t], -1.0], x))
            words = np.array([[place + 1, place + pairs + 1]])
            product = sp.Polynomial.from_words(words, np.ones(1), len(x), x[0].names)
            rows.append(sp.Constraint(product, Kind.ZERO))
        # level +- (c + sum_j s_j (plus_j - leak minus_j) - y_t) >= 0
        output = np.concatenate([[1.0], signs, -leak * np.asarray(signs)])
        which = [base, *places, *(places + pairs)]
        for side in (1.0, -1.0):
            rows.append(_row([base + 1, *which], [1.0, *(side * output)], x, -side * float(y[t])))
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


def _row(
    places: Sequence[int],
    weights: Sequence[float],
    x: Sequence[sp.Polynomial],
    constant: float | None = None,
) -> sp.Constraint:
    """A linear equation, or with a constant a linear inequality, weights x + constant >= 0."""
    words = np.array([[0], *([place + 1] for place in places)])
    coefficients = np.array([0.0 if constant is None else constant, *weights])
    row = sp.Polynomial.from_words(words, coefficients, len(x), x[0].names)
    return sp.Constraint(row, Kind.ZERO if constant is None else Kind.NONNEGATIVE)


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
    """Bound D from below by what a certificate proves, at most the cap."""
    if certificate is None or not certificate.verify(item.problem):
        return 0.0
    return min(max(certificate.bound, 0.0), item.cap)
