"""One linear matrix inequality for networks with slope-restricted activations, verified.

The difference of two trajectories under the same inputs is x+ = A x + E q, p = C x + F q, with F
strictly lower triangular and each q_i = phi(a) - phi(b), p_i = a - b, between alpha p_i and
beta p_i. So (q_i - alpha p_i) (beta p_i - q_i) >= 0, and P > 0, Lambda >= 0 diagonal with

    rate^2 x'P x - (A x + E q)' P (A x + E q) - sum_i Lambda_i (q_i - alpha p_i) (beta p_i - q_i)

positive semidefinite in (x, q) prove sqrt(x+' P x+) <= rate sqrt(x' P x). A conic solver proposes
P and Lambda; interval arithmetic encloses the matrix and a Cholesky factor proves it definite.

References
----------
M. Fazlyab et al., "Efficient and accurate estimation of Lipschitz constants for deep neural
networks", NeurIPS 2019, theorem 2 (the same quadratic constraints).
W. D'Amico, A. La Bella, M. Farina, "An incremental input-to-state stability condition for a class
of recurrent neural networks", IEEE Transactions on Automatic Control 69 (2024).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.neural.arithmetic import (
    Interval,
    down,
    matmul,
    row_sums,
    slope_range,
    surely_semidefinite,
    up,
)
from setid.neural.models.network import Network
from setid.neural.models.recurrent import Elman, NeuralStateSpace
from setid.neural.models.regressor import RegressorNetwork
from sparsepop_py.executors.threads import silent

__all__ = ["Lyapunov", "difference_system", "find_lyapunov", "prove_lyapunov", "size_bounds"]

Reals = NDArray[np.float64]
_BISECTIONS = 7  # of the interval of rates
_SLOWEST = 0.9999  # rate that decides between "stable" and "open"


@dataclass(frozen=True, slots=True, eq=False)
class Lyapunov:
    """Matrices of the inequality and the rate that they prove.

    Parameters
    ----------
    P : (n, n) float
    multipliers : (m,) float
        Diagonal of Lambda.
    rate : float
    """

    P: Reals
    multipliers: Reals
    rate: float


@dataclass(frozen=True, slots=True, eq=False)
class DifferenceSystem:
    """x+ = A x + E q, p = C x + F q, slopes of q over p in [alpha, beta]."""

    A: Reals
    E: Reals
    C: Reals
    F: Reals
    alpha: Reals
    beta: Reals


def difference_system(net: Elman | NeuralStateSpace | RegressorNetwork) -> DifferenceSystem:
    """Write the difference of two trajectories as a linear system with sector-bounded feedback."""
    if isinstance(net, Elman):
        return _of_elman(net)
    if isinstance(net, NeuralStateSpace):
        zero = np.zeros((net.states, net.states))
        return _of_network(net.transition, slice(net.channels, None), zero, np.eye(net.states))
    n, ny = net.states, net.outputs
    shift = np.zeros((n, n))
    shift[ny:, : n - ny] = np.eye(n - ny)
    return _of_network(net.network, slice(0, n), shift, np.eye(n)[:, :ny])


def _of_elman(net: Elman) -> DifferenceSystem:
    n = net.states
    C, F, begin = np.zeros((n, n)), np.zeros((n, n)), 0
    for i, (w, v, b) in enumerate(net.layers):
        part = slice(begin, begin + b.size)
        C[part, part] = v
        if i:
            F[part, begin - w.shape[1] : begin] = w
        begin += b.size
    alpha, beta = slope_range(net.activation, net.leak)
    return DifferenceSystem(np.zeros((n, n)), np.eye(n), C, F, np.full(n, alpha), np.full(n, beta))


def _of_network(net: Network, part: slice, A: Reals, into: Reals) -> DifferenceSystem:
    """A = given part, and ``into`` times the network's output added to the next state."""
    linear = net.activation[-1] == "identity"
    layers = list(zip(net.weights, net.activation, strict=True))
    inner = layers[:-1] if linear else layers
    sizes = [len(w) for w, _ in inner]
    m, n = sum(sizes), A.shape[0]
    C, F = np.zeros((m, n)), np.zeros((m, m))
    slopes, begin = np.zeros((2, m)), 0
    for i, (w, name) in enumerate(inner):
        rows = slice(begin, begin + len(w))
        if i == 0:
            C[rows] = w[:, part]
        else:
            F[rows, begin - w.shape[1] : begin] = w
        slopes[:, rows] = np.array(slope_range(name, net.leak))[:, None]
        begin += len(w)
    last = layers[-1][0] if linear else np.eye(sizes[-1])
    E = np.zeros((n, m))
    if m == 0:  # a linear network
        return DifferenceSystem(A + into @ last[:, part], E, C, F, slopes[0], slopes[1])
    E[:, m - last.shape[1] :] = into @ last
    return DifferenceSystem(A, E, C, F, slopes[0], slopes[1])


def _cross(left: Interval, right: Interval) -> Interval:
    """Left' right."""
    return matmul(Interval(left.lo.T, left.hi.T), right)


def prove_lyapunov(system: DifferenceSystem, found: Lyapunov) -> bool:
    """Check P > 0, Lambda >= 0 and the inequality, all rounding errors counted."""
    n, m = system.C.shape[1], system.C.shape[0]
    if found.P.shape != (n, n) or found.multipliers.shape != (m,):
        return False
    if not np.array_equal(found.P, found.P.T) or not np.all(found.multipliers >= 0):
        return False
    if not (np.all(np.isfinite(found.P)) and 0.0 <= found.rate < 1.0):
        return False
    if not surely_semidefinite(Interval.point(found.P)):
        return False
    P, scale = Interval.point(found.P), Interval.point(found.multipliers[:, None])
    step = Interval.point(np.hstack([system.A, system.E]))
    p = Interval.point(np.hstack([system.C, system.F]))
    q = Interval.point(np.hstack([np.zeros((m, n)), np.eye(m)]))
    upper, lower = (Interval.point(s[:, None]) for s in (system.beta, system.alpha))
    # (q - alpha p)(beta p - q): half the sum of the product and its transpose
    sector = _cross(q - lower * p, scale * (upper * p - q))
    half = Interval.point(0.5)
    sector = half * (sector + Interval(sector.lo.T, sector.hi.T))
    square = Interval.point(found.rate) * Interval.point(found.rate)
    kept = Interval(np.zeros((n + m, n + m)), np.zeros((n + m, n + m)))
    block = square * P
    kept.lo[:n, :n], kept.hi[:n, :n] = block.lo, block.hi
    total = kept - _cross(step, matmul(P, step)) - sector
    symmetric = Interval(np.minimum(total.lo, total.lo.T), np.maximum(total.hi, total.hi.T))
    return bool(surely_semidefinite(symmetric))


def find_lyapunov(system: DifferenceSystem) -> Lyapunov | None:
    """Search the least rate for which a solver's matrices can be verified, by bisection."""
    best = _solve(system, _SLOWEST)
    if best is None:
        return None
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + best.rate)
        found = _solve(system, middle)
        if found is None:
            low = middle
        else:
            best = found
    return best


def _cvxpy() -> Any:
    """Import cvxpy, whose modelling takes a second to import."""
    try:
        import cvxpy
    except ImportError as error:
        raise sp.SolverNotFound(
            "cvxpy is missing; install it with: pip install 'sparsepop-py[cvxpy]'"
        ) from error
    return cvxpy


def _solve(system: DifferenceSystem, rate: float) -> Lyapunov | None:
    """Matrices for one rate, verified; None where the solver or the proof fails."""
    cp = _cvxpy()
    n, m = system.C.shape[1], system.C.shape[0]
    P, scale = cp.Variable((n, n), PSD=True), cp.Variable(m, nonneg=True)
    step = np.hstack([system.A, system.E])
    p, q = np.hstack([system.C, system.F]), np.hstack([np.zeros((m, n)), np.eye(m)])
    lower, upper = q - system.alpha[:, None] * p, system.beta[:, None] * p - q
    keep = np.hstack([np.eye(n), np.zeros((n, m))])
    sector = lower.T @ cp.diag(scale) @ upper
    total = rate**2 * keep.T @ P @ keep - step.T @ P @ step - 0.5 * (sector + sector.T)
    slack = cp.Variable()
    problem = cp.Problem(
        cp.Maximize(slack),
        [
            total >> slack * np.eye(n + m),
            P >> slack * np.eye(n),
            cp.trace(P) <= n,
            scale <= 1e3 * n,
            slack <= 1,
        ],
    )
    try:
        with silent():  # about inaccurate solutions: what it proposes is verified
            problem.solve(solver=cp.CLARABEL)
    except (cp.error.SolverError, ValueError):
        return None
    if P.value is None or scale.value is None:
        return None
    matrix = 0.5 * (P.value + P.value.T)
    found = Lyapunov(matrix, np.maximum(scale.value, 0.0), float(rate))
    return found if prove_lyapunov(system, found) else None


def size_bounds(P: Reals) -> tuple[float, float]:
    """Bound least and largest eigenvalue of a definite matrix from below and above."""
    values = np.linalg.eigvalsh(P)
    high = float(np.max(row_sums(P)))
    near = float(values[-1]) * (1.0 + 1e-9)
    if surely_semidefinite(Interval.point(near * np.eye(len(P))) - Interval.point(P)):
        high = near
    for part in (1.0 - 1e-6, 0.9, 0.5):
        low = float(down(values[0] * part))
        if low > 0 and surely_semidefinite(
            Interval.point(P) - Interval.point(low * np.eye(len(P)))
        ):
            return low, float(up(high))
    return 0.0, float(up(high))
