"""Norm conditions for incremental stability: comparison systems of differences, rounded upwards.

Differences of two trajectories under the same network obey v_{t+1} <= A v_t + B d_u + E d_e, with
v the norms of blocks of the state, d_u and d_e bounds of the differences of inputs and of errors
added to the state. A has no negative entry; A w < w for some w > 0 proves contraction.

LSTM and GRU have sigmoid' <= 1/4 and tanh' <= 1. With a and b for the two trajectories,

    dc+ = f_a dc + (f_a - f_b) c_b + i_a (c~_a - c~_b) + (i_a - i_b) c~_b,
    dh+ = o_a (tanh(c+_a) - tanh(c+_b)) + (o_a - o_b) tanh(c+_b)            (LSTM),
    dh+ = (1 - z_a) dh + z_a (h~_a - h~_b) + (z_a - z_b) (h~_b - h_b)       (GRU),

and elementwise products obey |x y| <= max|x| |y| in both norms.

References
----------
E. Terzi, F. Bonassi, M. Farina, R. Scattolini, "Learning model predictive control with long
short-term memory networks", International Journal of Robust and Nonlinear Control 31 (2021).
F. Bonassi, M. Farina, R. Scattolini, "On the stability properties of gated recurrent units
neural networks", Systems & Control Letters 157 (2021).
F. Bonassi, M. Farina, J. Xie, R. Scattolini, "On recurrent neural networks for learning-based
control: recent results and ideas for future developments", Journal of Process Control 114 (2022).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.neural.arithmetic import (
    Interval,
    enclose,
    matmul,
    row_sums,
    slope_range,
    surely_semidefinite,
    up,
)
from setid.neural.models.network import Network
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.models.regressor import RegressorNetwork

__all__ = ["Comparison", "Weighted", "comparisons", "contraction", "norm", "output_slopes"]

Reals = NDArray[np.float64]
Model = Elman | NeuralStateSpace | LSTM | GRU | RegressorNetwork


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """v_{t+1} <= A v_t + B d_u + E d_e for the norms v of blocks of a state difference.

    Parameters
    ----------
    name : str
        The condition, with its source.
    norm : {"2", "inf", "entries"}
        Of each block and of the inputs; ``"entries"`` takes absolute values one by one.
    matrix : (k, k) float
    drive, error : (k,) float
    """

    name: str
    norm: str
    matrix: Reals
    drive: Reals
    error: Reals


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """A proved contraction: max_i v_i / w_i shrinks by ``rate`` a step.

    Parameters
    ----------
    weights : (k,) float
    rate : float
        At least 1 where the condition fails.
    """

    weights: Reals
    rate: float


def contraction(matrix: Reals) -> Weighted:
    """Prove A w <= rate w for positive weights near the Perron vector of A."""
    size = len(matrix)
    if not np.all(np.isfinite(matrix)):
        return Weighted(np.ones(size), np.inf)
    guesses: list[Reals] = [np.ones(size)]
    values, vectors = np.linalg.eig(matrix + 1e-6 * np.max(matrix, initial=1e-12))
    perron = np.abs(np.real(vectors[:, np.argmax(np.abs(values))]))
    guesses.append(np.array(perron + 1e-12, dtype=np.float64))
    with np.errstate(all="ignore"):
        try:
            drawn = np.linalg.solve(np.eye(size) - matrix, np.ones(size))
            guesses.append(np.array(drawn, dtype=np.float64))
        except np.linalg.LinAlgError:
            pass
    best = Weighted(guesses[0], np.inf)
    for guess in guesses:
        if not (np.all(np.isfinite(guess)) and np.all(guess > 0)):
            continue
        best = min(best, Weighted(guess, rate_of(matrix, guess)), key=lambda item: item.rate)
    return best


def rate_of(matrix: Reals, weights: Reals) -> float:
    """Bound max_i (A w)_i / w_i from above."""
    grown = matmul(Interval.point(matrix), Interval.point(weights[:, None])).hi[:, 0]
    return float(np.max(up(np.maximum(grown, 0.0) / weights)))


def norm(matrix: Reals, kind: str) -> float:
    """Bound the induced norm of a matrix from above, ``kind`` "2" or "inf".

    Examples
    --------
    >>> import numpy as np
    >>> 5.0 <= norm(np.array([[3.0, 4.0]]), "2") < 5.000001
    True
    >>> 7.0 <= norm(np.array([[3.0, 4.0]]), "inf") < 7.000001
    True
    """
    if kind == "inf":
        return float(np.max(row_sums(matrix), initial=0.0))
    wide = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    square = matmul(Interval.point(wide), Interval.point(wide.T))
    size = float(np.linalg.norm(wide, 2))
    guess = size * size * (1.0 + 1e-9) + 1e-300
    rest = Interval.point(guess * np.eye(len(wide))) - square
    if surely_semidefinite(rest):
        return float(up(np.sqrt(guess)))
    return float(up(np.sqrt(up(np.sum(matrix**2) * (1.0 + (matrix.size + 4.0) * 2.0**-52)))))


def _times(*factors: float | Reals) -> Reals:
    """Upper bound of a product of numbers that are not negative."""
    found = np.asarray(factors[0], float)
    for factor in factors[1:]:
        zero = (found == 0) | (np.asarray(factor) == 0)
        with np.errstate(invalid="ignore"):
            found = np.where(zero, 0.0, up(found * factor))
    return np.asarray(found, np.float64)


def _plus(*terms: float | Reals) -> Reals:
    """Upper bound of a sum."""
    found = np.asarray(terms[0], float)
    for term in terms[1:]:
        found = np.asarray(up(found + term), np.float64)
    return found


# ---- the models -----------------------------------------------------------------------------


def comparisons(net: Model, inputs: Interval | None) -> list[Comparison]:
    """Build comparison systems of a network, each a sufficient condition of its own.

    Parameters
    ----------
    net : a model of this room
    inputs : Interval (nu,) or None
        Range of the inputs; only LSTM and GRU need it.
    """
    if isinstance(net, Elman):
        return [_elman(net, "2"), _elman(net, "inf"), _elman_entries(net)]
    if isinstance(net, LSTM):
        assert inputs is not None
        return [_lstm(net, inputs, kind) for kind in ("2", "inf")]
    if isinstance(net, GRU):
        assert inputs is not None
        return [_gru(net, inputs)]
    if isinstance(net, NeuralStateSpace):
        return [_static(net, "2"), _static(net, "inf"), _static_entries(net)]
    return [_shifted(net)]


def _elman(net: Elman, kind: str) -> Comparison:
    """Cascade of layers: abs(dh_i+) <= L (norm(V_i) abs(dh_i) + norm(W_i) abs(dh_{i-1}+))."""
    size, slope = len(net.layers), slope_range(net.activation, net.leak)[1]
    matrix, drive, error = np.zeros((size, size)), np.zeros(size), np.ones(size)
    for i, (w, v, _) in enumerate(net.layers):
        matrix[i, i] = _times(slope, norm(v, kind))
        passed = _times(slope, norm(w, kind))
        if i:
            matrix[i] = _plus(matrix[i], _times(passed, matrix[i - 1]))
        drive[i] = _times(passed, drive[i - 1]) if i else passed
    name = f"Elman: norm of the state matrices, {kind}-norm (Bonassi et al. 2022)"
    return Comparison(name, kind, matrix, drive, error)


def _elman_entries(net: Elman) -> Comparison:
    slope = slope_range(net.activation, net.leak)[1]
    states, begin = net.states, 0
    matrix, drive = np.zeros((states, states)), np.zeros(states)
    below, fed = np.zeros((net.channels, states)), np.ones(net.channels)
    for w, v, b in net.layers:
        part = slice(begin, begin + b.size)
        own = np.zeros((b.size, states))
        own[:, part] = np.abs(v)
        below = _times(slope, _plus(own, _product(np.abs(w), below)))
        fed = _times(slope, _product(np.abs(w), fed[:, None])[:, 0])
        matrix[part], drive[part] = below, fed
        begin += b.size
    return Comparison(
        "Elman: absolute values entry by entry", "entries", matrix, drive, np.ones(states)
    )


def _product(left: Reals, right: Reals) -> Reals:
    """Upper bound of a product of matrices without negative entries; exact zeros stay."""
    found = matmul(Interval.point(left), Interval.point(right)).hi
    return np.asarray(np.where(left @ right == 0.0, np.maximum(found, 0.0), found), np.float64)


def _gain(net: Network, begin: int, end: int, kind: str) -> float:
    """Lipschitz constant with respect to some of the inputs of a network."""
    found = 1.0
    for i, (w, name) in enumerate(zip(net.weights, net.activation, strict=True)):
        part = w[:, begin:end] if i == 0 else w
        found = float(_times(found, norm(part, kind), slope_range(name, net.leak)[1]))
    return found


def _entries(net: Network) -> Reals:
    """Entrywise bounds of the Jacobian of a network, (outputs, inputs)."""
    found = np.eye(net.inputs)
    for w, name in zip(net.weights, net.activation, strict=True):
        found = _times(slope_range(name, net.leak)[1], _product(np.abs(w), found))
    return found


def _static(net: NeuralStateSpace, kind: str) -> Comparison:
    u, n = net.channels, net.channels + net.states
    matrix = np.array([[_gain(net.transition, u, n, kind)]])
    drive = np.array([_gain(net.transition, 0, u, kind)])
    name = f"state space: product of the norms of the layers, {kind}-norm"
    return Comparison(name, kind, matrix, drive, np.ones(1))


def _static_entries(net: NeuralStateSpace) -> Comparison:
    found = _entries(net.transition)
    u = net.channels
    return Comparison(
        "state space: absolute values entry by entry",
        "entries",
        found[:, u:],
        row_sums(found[:, :u]),
        np.ones(net.states),
    )


def _shifted(net: RegressorNetwork) -> Comparison:
    """Past outputs as states: the first block is new, the others are shifted."""
    found, n = _entries(net.network), net.states
    matrix = np.zeros((n, n))
    matrix[: net.outputs] = found[:, :n]
    matrix[net.outputs :, : n - net.outputs] = np.eye(n - net.outputs)
    drive, error = np.zeros(n), np.zeros(n)
    drive[: net.outputs], error[: net.outputs] = row_sums(found[:, n:]), 1.0
    return Comparison(
        "regressor network: absolute values entry by entry", "entries", matrix, drive, error
    )


def _arguments(gate: tuple[Reals, Reals, Reals], inputs: Interval, reach: Reals) -> Interval:
    """Range of W u + U h + b over the inputs and abs(h) <= reach."""
    w, v, b = gate
    fed = matmul(Interval.point(w), inputs[:, None])[:, 0]
    back = matmul(Interval.point(v), Interval(-reach[:, None], reach[:, None]))[:, 0]
    return fed + back + Interval.point(b)


def _lstm(net: LSTM, inputs: Interval, kind: str) -> Comparison:
    """The condition of Terzi, Bonassi, Farina and Scattolini (2021), gates bounded one by one."""
    ones = np.ones(net.width)
    f, i, o = (enclose("sigmoid", _arguments(g, inputs, ones)) for g in net.gates[:3])
    candidate = enclose("tanh", _arguments(net.gates[3], inputs, ones)).magnitude()
    cell = (Interval.point(i.hi) * Interval.point(candidate)) / (
        Interval.point(ones) - Interval.point(f.hi)
    )
    most = float(np.max(cell.hi))
    shown = float(enclose("tanh", Interval.point(np.array([most]))).hi[0])
    (wf, uf, _), (wi, ui, _), (wo, uo, _), (wc, uc, _) = net.gates
    top_f, top_i, top_o, top_c = (float(np.max(a)) for a in (f.hi, i.hi, o.hi, candidate))

    def into_cell(a: Reals, b: Reals, c: Reals) -> Reals:
        return _plus(
            _times(0.25, norm(a, kind), most),
            _times(top_i, norm(c, kind)),
            _times(0.25, norm(b, kind), top_c),
        )

    alpha, beta = into_cell(uf, ui, uc), into_cell(wf, wi, wc)
    matrix = np.array(
        [
            [top_f, alpha],
            [
                _times(top_o, top_f),
                _plus(_times(top_o, alpha), _times(0.25, shown, norm(uo, kind))),
            ],
        ],
        dtype=float,
    )
    drive = np.array(
        [beta, _plus(_times(top_o, beta), _times(0.25, shown, norm(wo, kind)))], dtype=float
    )
    name = f"LSTM: Terzi, Bonassi, Farina, Scattolini (2021), {kind}-norm"
    return Comparison(name, kind, matrix, drive, np.ones(2))


def _gru(net: GRU, inputs: Interval) -> Comparison:
    """Row by row; for reset before the product Bonassi, Farina and Scattolini (2021)."""
    size = net.states
    ones = np.ones(size)
    (wz, uz, _), (wr, ur, _), (w, v, b) = net.gates
    z, r = (enclose("sigmoid", _arguments(g, inputs, ones)) for g in net.gates[:2])
    rows = row_sums(v)
    reset_rows, reset_fed = row_sums(ur), row_sums(wr)
    if net.reset == "before":
        argument = _arguments((w, v, b), inputs, r.hi)
        inner = _product(np.abs(v), _plus(_times(0.25, reset_rows), r.hi)[:, None])[:, 0]
        fed = _product(np.abs(v), _times(0.25, reset_fed)[:, None])[:, 0]
    else:
        held = matmul(Interval.point(v), Interval(-ones[:, None], ones[:, None]))[:, 0]
        held = held + Interval.point(net.inner)
        argument = matmul(Interval.point(w), inputs[:, None])[:, 0] + r * held + Interval.point(b)
        inner = _plus(_times(r.hi, rows), _times(0.25, reset_rows, held.magnitude()))
        fed = _times(0.25, reset_fed, held.magnitude())
    candidate = _plus(1.0, enclose("tanh", argument).magnitude())
    factor = Interval.point(ones) - Interval.point(inner)
    passed = (Interval.point(ones) - z * factor).hi  # (1 - z) + z inner, z in its range
    rate = _plus(passed, _times(0.25, row_sums(uz), candidate))
    drive = _plus(_times(z.hi, _plus(row_sums(w), fed)), _times(0.25, row_sums(wz), candidate))
    source = "Bonassi, Farina, Scattolini (2021)" if net.reset == "before" else "derived alike"
    name = f"GRU, reset {net.reset} the product: {source}, inf-norm"
    return Comparison(name, "inf", np.array([[rate.max()]]), np.array([drive.max()]), np.ones(1))


def output_slopes(net: Model, kind: str) -> tuple[Reals, float]:
    """Bound gains of blocks of a comparison and of inputs to outputs, inf-norm of y."""
    if isinstance(net, RegressorNetwork):
        found = np.zeros(net.states)
        found[: net.outputs] = 1.0
        return found, 0.0
    if isinstance(net, NeuralStateSpace):
        u, n = net.channels, net.channels + net.states
        if kind == "entries":
            entries = _entries(net.output).max(axis=0)
            return entries[u:], float(row_sums(entries[None, :u])[0])
        return np.array([_gain(net.output, u, n, kind)]), _gain(net.output, 0, u, kind)
    width = net.output.inputs
    if kind == "entries":
        assert isinstance(net, Elman)
        last = np.zeros(net.states)
        last[-width:] = _entries(net.output).max(axis=0)
        return last, 0.0
    gain = _gain(net.output, 0, width, kind)
    if isinstance(net, LSTM):
        return np.array([0.0, gain]), 0.0
    blocks = np.zeros(len(net.layers) if isinstance(net, Elman) else 1)
    blocks[-1] = gain
    return blocks, 0.0
