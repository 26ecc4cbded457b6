"""Records of a second-order system and the set of parameters that explains them.

The system is y_k = -a1 y_{k-1} - a2 y_{k-2} + b0 u_k + b1 u_{k-1} + b2 u_{k-2} at rest
before the record. Outputs are measured with an error |eta_k| <= De, inputs exactly (output
error, "oe") or with |xi_k| <= Dx (errors in variables, "eiv"). The parameters that some
noise within the bounds explains solve, for k = 3, ..., N,

    (y~_k - eta_k) + sum_i a_i (y~_{k-i} - eta_{k-i}) - sum_j b_j (u~_{k-j} - xi_{k-j}) = 0.

References
----------
V. Cerone, D. Piga, D. Regruto, Set-membership error-in-variables identification through
convex relaxation techniques, IEEE Trans. Autom. Control 57 (2012).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

import sparsepop_py as sp

from ..errors import BenchmarkError
from ..measuring.registry import Case, Selection, Task

__all__ = ["NAMES", "THETA", "Record", "cases", "record", "start_box", "task"]

NAMES = ("a1", "a2", "b0", "b1", "b2")
THETA = (-0.7647, 0.3012, 0.0, 32.24, 21.41)
SIZES = (20, 50, 100, 200, 500)
NOISES = (1.0, 5.0)
_OUTPUT_NOISE, _INPUT_NOISE = 1.0, 0.01
_OUTWARD = 1e-7  # of the width: what linear programs in floating point may miss


@dataclass(frozen=True, eq=False)
class Record:
    """Measured signals and the bounds of their errors.

    Parameters
    ----------
    u, y : (N,) float
        Measured input and output.
    output_noise, input_noise : float
        De and Dx; Dx = 0 says that the input is exact.
    """

    u: NDArray[np.float64]
    y: NDArray[np.float64]
    output_noise: float
    input_noise: float

    def regressors(self) -> NDArray[np.float64]:
        """Rows (y~_{k-1}, y~_{k-2}, -u~_k, -u~_{k-1}, -u~_{k-2}), shape (N - 2, 5)."""
        u, y = self.u, self.y
        return np.column_stack([y[1:-1], y[:-2], -u[2:], -u[1:-1], -u[:-2]])


def record(
    kind: str, samples: int, noise: float = 1.0, seed: int = 0, lowest: float = -1.0
) -> Record:
    """Simulate a record.

    Parameters
    ----------
    kind : {"oe", "eiv"}
    samples : int
        N, at least 3.
    noise : float
        Factor on the noise bounds De = 1 and Dx = 0.01.
    seed : int
    lowest : float
        Inputs are drawn from [lowest, 1].

    Examples
    --------
    >>> record("oe", 20).y.shape
    (20,)
    """
    if kind not in ("oe", "eiv"):
        raise BenchmarkError(f"kind: found {kind!r}, expected 'oe' or 'eiv'")
    if samples < 3:
        raise BenchmarkError(f"samples: found {samples}, expected at least 3")
    if not noise > 0:
        raise BenchmarkError(f"noise: found {noise}, expected a factor > 0")
    draw = partial(_signed_samples, np.random.RandomState(5489 + seed), samples)
    output, below = noise * _OUTPUT_NOISE, noise * _INPUT_NOISE * (kind == "eiv")
    u = lowest + (1.0 - lowest) * (0.5 * draw() + 0.5)
    y = _response(u)
    return Record(u + below * draw(), y + output * draw(), output, below)


def _signed_samples(source: np.random.RandomState, count: int) -> NDArray[np.float64]:
    return 2.0 * source.random_sample(count) - 1.0


def _response(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Output without noise, from rest."""
    a1, a2, b0, b1, b2 = THETA
    past_u, past_y, y = [0.0, 0.0], [0.0, 0.0], []
    for value in u.tolist():
        new = -a1 * past_y[0] - a2 * past_y[1] + b0 * value + b1 * past_u[0] + b2 * past_u[1]
        y.append(new)
        past_u, past_y = [value, past_u[0]], [new, past_y[0]]
    return np.array(y)


def start_box(data: Record) -> NDArray[np.float64]:
    """Bounds of the parameters from linear programs, one family for each sign pattern.

    With the signs of theta fixed, |y~_k + sum a_i y~_{k-i} - sum b_j u~_{k-j}| <=
    De (1 + sum |a_i|) + Dx sum |b_j| is linear.

    Returns
    -------
    (2, 5) float
        Lower and upper ends, widened by 1e-7 of the width.

    Raises
    ------
    BenchmarkError
        If the record does not bound a parameter, or no parameters explain it.
    """
    ends = [_ends(data, np.array(signs)) for signs in itertools.product((-1.0, 1.0), repeat=5)]
    found = [pair for pair in ends if pair is not None]
    if not found:
        raise BenchmarkError("record: no parameters explain it, expected larger noise bounds")
    low = np.min([pair[0] for pair in found], axis=0)
    high = np.max([pair[1] for pair in found], axis=0)
    if not np.all(np.isfinite(high - low)):
        raise BenchmarkError("record: it does not bound all parameters, expected more samples")
    outward = _OUTWARD * (high - low)
    return np.array([low - outward, high + outward])


def _ends(data: Record, signs: NDArray) -> tuple[NDArray, NDArray] | None:
    """Least and largest parameters of one sign pattern, None where it is empty."""
    rows, output = data.regressors(), data.y[2:]
    noise = np.array([data.output_noise] * 2 + [data.input_noise] * 3) * signs
    A = np.vstack([rows - noise, -rows - noise])
    b = np.concatenate([data.output_noise - output, data.output_noise + output])
    bounds = [(0.0, None) if sign > 0 else (None, 0.0) for sign in signs]
    if linprog(np.zeros(5), A, b, bounds=bounds, method="highs").status == 2:
        return None
    low, high = np.empty(5), np.empty(5)
    for i, unit in enumerate(np.eye(5)):
        low[i] = _least(unit, A, b, bounds)
        high[i] = -_least(-unit, A, b, bounds)
    return low, high


def _least(cost: NDArray, A: NDArray, b: NDArray, bounds: list) -> float:
    found = linprog(cost, A, b, bounds=bounds, method="highs")
    return float(found.fun) if found.status == 0 else -np.inf


def task(kind: str, samples: int, noise: float = 1.0, seed: int = 0, lowest: float = -1.0) -> Task:
    """All ten bounds of one record: the least and the largest value of each parameter."""
    data = record(kind, samples, noise, seed, lowest)
    low, high = start_box(data)
    eta_names = [f"eta{k}" for k in range(1, samples + 1)]
    xi_names = [f"xi{k}" for k in range(1, samples + 1)] if data.input_noise else []
    x = sp.variables(5 + len(eta_names) + len(xi_names), [*NAMES, *eta_names, *xi_names])
    theta, eta, xi = x[:5], x[5 : 5 + samples], x[5 + samples :]
    limit = np.repeat([data.output_noise, data.input_noise], [len(eta), len(xi)])
    rows = [_row(data, k, theta, eta, xi) for k in range(2, samples)]
    lower, upper = np.concatenate([low, -limit]), np.concatenate([high, limit])
    problem = sp.Problem(theta[0], rows, lower, upper)
    objectives = tuple(sign * p for p in theta for sign in (1.0, -1.0))
    labels = tuple(f"{sense} {name}" for name in NAMES for sense in ("min", "max"))
    return Task(problem, objectives, labels, True, tuple(float(w) for w in high - low))


def _row(data: Record, k: int, theta: tuple, eta: tuple, xi: tuple) -> sp.Constraint:
    """The equation of sample k, counted from 0."""
    outputs = [float(data.y[j]) - eta[j] for j in (k, k - 1, k - 2)]
    inputs = [float(data.u[j]) - (xi[j] if xi else 0.0) for j in (k, k - 1, k - 2)]
    past = [a * y for a, y in zip(theta[:2], outputs[1:], strict=True)]
    driven = [-(b * u) for b, u in zip(theta[2:], inputs, strict=True)]
    return sp.total([outputs[0], *past, *driven]) == 0


def cases(kind: str, lowest: float, selection: Selection) -> Iterator[Case]:
    """Records of all sizes, noise factors and seeds that are wanted, inputs in [lowest, 1]."""
    wanted = itertools.product(
        selection.noises or NOISES, selection.sizes or SIZES, selection.seeds
    )
    for noise, samples, seed in wanted:
        make = partial(task, kind, samples, noise, seed, lowest)
        yield Case(f"{kind} N={samples} noise x{noise:g}", make, samples, seed)
