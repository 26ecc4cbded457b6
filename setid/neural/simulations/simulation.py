"""Verified simulation: proved bands of outputs from a known or boxed initial state.

The state is an affine form, so that a contractive network contracts it too; plain intervals grow
without limit even for stable networks. What linearisation adds is of second order in the width.
A band that grows says so: ``blown_up`` is the first sample at which it is infinite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from setid import IOData, ModelError, NoiseError, Verification
from setid.data.checks import number
from setid.neural.arithmetic import (
    Interval,
    at_least,
    down,
    enclose,
    quiet_overflow,
    require_ieee,
    up,
)
from setid.neural.models.network import Network, finite_array
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.models.regressor import RegressorNetwork, check_record
from setid.neural.simulations.forms import (
    Form,
    activation,
    affine_map,
    clip,
    join,
    network_output,
    product,
    reduce,
)
from setid.neural.status import Status, agreed
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["SimulationBand", "initial_box", "run_forms", "simulate_band"]

Reals = NDArray[np.float64]
Model = Elman | NeuralStateSpace | LSTM | GRU | RegressorNetwork
Step = Callable[[Form, int], tuple[Form, Form]]
_EXTRA = 60  # generators beside those of the initial state
_HUGE = 1e8  # width of a state at which the simulation stops being followed


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SimulationBand(ReadOnly):
    """Outputs of a network in simulation, enclosed for every initial state in a box.

    Parameters
    ----------
    net : a model of this room
    data : IOData
    x0 : Interval (states,)
    status : Status
        ``"proved"`` where the whole band is finite, else ``"open"``.
    low, high : (N, ny) float
    """

    net: Model
    data: IOData
    x0: Interval
    status: Status
    low: Reals
    high: Reals

    @property
    def blown_up(self) -> int | None:
        """First sample, from 0, at which the band is infinite; None if it never is."""
        bad = np.flatnonzero(~np.all(np.isfinite(self.high - self.low), axis=1))
        return int(bad[0]) if bad.size else None

    @property
    def width(self) -> Reals:
        """Largest width over the outputs, shape (N,)."""
        return np.asarray(np.max(self.high - self.low, axis=1), np.float64)

    def outside(self, noise: float = 0.0) -> NDArray[np.int64]:
        """List sample and output (from 0) of readings that no state explains.

        Parameters
        ----------
        noise : float
            Bound of the output noise.
        """
        bound = number(noise, "noise", NoiseError)
        if not 0.0 <= bound < np.inf:
            raise NoiseError(f"noise: found {noise!r:.60}, expected a number >= 0")
        with np.errstate(invalid="ignore"):
            gone = (self.data.y < down(self.low - bound)) | (self.data.y > up(self.high + bound))
        return np.argwhere(gone)

    @as_verdict
    def verify(self) -> Verification:
        """Simulate again and compare."""
        again = simulate_band(self.net, self.data, np.column_stack([self.x0.lo, self.x0.hi]))
        return agreed(
            (at_least(again.low, self.low), "the band is too high"),
            (at_least(self.high, again.high), "the band is too low"),
            (self.status is again.status, "the status"),
        )

    def __repr__(self) -> str:
        last = "" if self.blown_up is None else f", infinite from sample {self.blown_up} on"
        return f"<SimulationBand: {len(self.low)} samples, {self.status}{last}>"


@quiet_overflow
def simulate_band(net: Model, data: IOData, x0: ArrayLike | None = None) -> SimulationBand:
    """Enclose the simulated outputs of a network for all initial states in a box.

    Parameters
    ----------
    net : Elman, NeuralStateSpace, LSTM, GRU, NNOE or NNARX
    data : IOData
        One record; its inputs are exact.
    x0 : (states,) or (states, 2) array_like, optional
        A state, or its range. Of regressor networks the first n outputs, sample by sample.
        Where left out: zero, or the first readings.

    Returns
    -------
    SimulationBand

    Raises
    ------
    ModelError, DataError
        If network, record and state do not fit.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import neural
    >>> net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]))
    >>> data = setid.IOData(np.sin(np.arange(40.0)), np.zeros(40))
    >>> found = neural.simulate_band(net, data, [[-1.0, 1.0]])
    >>> bool(found.width[0] > 0.8), bool(found.width[-1] < 1e-6)
    (True, True)
    """
    require_ieee()
    if not isinstance(net, (Elman, NeuralStateSpace, LSTM, GRU, RegressorNetwork)):
        raise ModelError(f"net: found {type(net).__name__}, expected a model of setid.neural")
    check_record(data, net.channels, net.outputs, single=True)
    box = initial_box(net, data, x0)
    outputs = run_forms(net, data, box)
    ranges = [form.range() for form in outputs]
    low, high = np.array([r.lo for r in ranges]), np.array([r.hi for r in ranges])
    status = Status.PROVED if np.all(np.isfinite(high - low)) else Status.OPEN
    return SimulationBand(net, data, box, status, low, high)


def initial_box(net: Model, data: IOData, x0: Any) -> Interval:
    """Find the range of the initial state, (states,) ends."""
    if x0 is None:
        if isinstance(net, RegressorNetwork):
            x0 = data.y[: net.order].ravel()
        else:
            x0 = np.zeros(net.states)
    values = finite_array(x0, "x0")
    if values.size == net.states:
        values = np.repeat(values.reshape(-1, 1), 2, axis=1)
    if values.shape != (net.states, 2):
        raise ModelError(
            f"x0: found shape {values.shape}, expected ({net.states},) or ({net.states}, 2)"
        )
    if not np.all(values[:, 0] <= values[:, 1]):
        raise ModelError("x0: found a lower end above the upper one, expected (low, high)")
    return Interval(values[:, 0].copy(), values[:, 1].copy())


def run_forms(net: Model, data: IOData, box: Interval, samples: int | None = None) -> list[Form]:
    """Compute output forms of each sample; their first generators belong to the initial state.

    Parameters
    ----------
    net, data : the network and one record
    box : Interval (states,)
    samples : int, optional
        Only the first samples.
    """
    count = data.samples if samples is None else min(samples, data.samples)
    state = Form.of_box(box.lo, box.hi)
    kept = state.generators.shape[1]
    found: list[Form] = []
    step = _stepper(net, data.u)
    begin = 0
    if isinstance(net, RegressorNetwork):
        begin = min(net.order, count)
        ny = net.outputs
        found = [state.rows(slice(t * ny, (t + 1) * ny)) for t in range(begin)]
        order = np.arange(net.states).reshape(net.order, ny)[::-1].ravel()
        state = Form(state.centre[order], state.generators[order], state.radius[order])
    for t in range(begin, count):
        width = np.abs(state.generators).sum(axis=1) + state.radius
        if not np.all(width < _HUGE):
            unknown = np.full(net.outputs, np.inf)
            found.append(Form(np.zeros(net.outputs), np.zeros((net.outputs, kept)), unknown))
            continue
        state, output = step(reduce(state, kept, kept + _EXTRA).promoted(), t)
        found.append(output)
    return found


def _stepper(net: Model, u: Reals) -> Step:
    """One step of a model on forms."""
    if isinstance(net, RegressorNetwork):
        return lambda x, t: _regressor_step(net, x, u[t - net.order : t + 1][::-1].ravel())
    if isinstance(net, Elman):
        return lambda x, t: _elman_step(net, x, u[t])
    if isinstance(net, NeuralStateSpace):
        return lambda x, t: _static_step(net, x, u[t])
    if isinstance(net, LSTM):
        return lambda x, t: _lstm_step(net, x, u[t])
    return lambda x, t: _gru_step(net, x, u[t])


def _with_inputs(net: Network, before: int, u: Reals) -> tuple[Reals, Reals]:
    """First-layer weights of the form's part; the inputs' part is added as a second map."""
    w = net.weights[0]
    return np.delete(w, np.s_[before : before + u.size], axis=1), w[:, before : before + u.size]


def _first_layer(net: Network, x: Form, u: Reals, before: int) -> Form:
    """Argument of the first layer for a form beside exact inputs at a place of its input."""
    own, fed = _with_inputs(net, before, u)
    exact = affine_map(fed, net.biases[0], Form.of_point(u, 0))
    moved = affine_map(own, exact.centre, x)
    return Form(moved.centre, moved.generators, up(moved.radius + exact.radius))


def _after_first(net: Network, argument: Form) -> Form:
    value = activation(net.activation[0], argument, net.leak)
    for w, b, name in list(zip(net.weights, net.biases, net.activation, strict=True))[1:]:
        value = activation(name, affine_map(w, b, value.promoted()), net.leak)
    return value


def _regressor_step(net: RegressorNetwork, x: Form, u: Reals) -> tuple[Form, Form]:
    output = _after_first(net.network, _first_layer(net.network, x, u, net.states))
    output = output.promoted()
    kept = x.rows(slice(0, net.states - net.outputs))
    return join(output, kept), output


def _elman_step(net: Elman, x: Form, u: Reals) -> tuple[Form, Form]:
    parts: list[Form] = []
    begin, below = 0, Form.of_point(u, x.generators.shape[1])
    for w, v, b in net.layers:
        both = join(below, x.rows(slice(begin, begin + b.size)))
        below = activation(net.activation, affine_map(np.hstack([w, v]), b, both), net.leak)
        below = below.promoted()
        parts.append(below)
        begin += b.size
    return join(*parts), network_output(net.output, below)


def _static_step(net: NeuralStateSpace, x: Form, u: Reals) -> tuple[Form, Form]:
    after = _after_first(net.transition, _first_layer(net.transition, x, u, 0))
    return after, _after_first(net.output, _first_layer(net.output, x, u, 0))


def _gate_arguments(gates: tuple[tuple[Reals, Reals, Reals], ...], h: Form, u: Reals) -> Form:
    """Arguments of several gates, stacked."""
    weight = np.vstack([np.hstack([w, v]) for w, v, _ in gates])
    bias = np.concatenate([b for _, _, b in gates])
    return affine_map(weight, bias, join(Form.of_point(u, h.generators.shape[1]), h))


def _shares(form: Form, count: int) -> list[Form]:
    size = form.centre.size // count
    return [form.rows(slice(k * size, (k + 1) * size)) for k in range(count)]


def _lstm_step(net: LSTM, x: Form, u: Reals) -> tuple[Form, Form]:
    n = net.width
    h, c = x.rows(slice(0, n)), x.rows(slice(n, 2 * n))
    argument = _gate_arguments(net.gates, h, u)
    inner = activation("sigmoid", argument.rows(slice(0, 3 * n)))
    candidate = activation("tanh", argument.rows(slice(3 * n, 4 * n)))
    f, i, o, g = _shares(join(inner, candidate).promoted(), 4)
    cell = _sum(product(f, c), product(i, g))
    cell = clip(cell, f.range() * c.range() + i.range() * g.range()).promoted()
    o, shown = join(o, cell).rows(slice(0, n)), activation("tanh", cell).promoted()
    h = clip(
        product(o, shown),
        enclose("sigmoid", argument.rows(slice(2 * n, 3 * n)).range())
        * enclose("tanh", cell.range()),
    )
    return join(h, cell), network_output(net.output, h)


def _gru_step(net: GRU, x: Form, u: Reals) -> tuple[Form, Form]:
    z, r = _shares(activation("sigmoid", _gate_arguments(net.gates[:2], x, u)).promoted(), 2)
    w, v, b = net.gates[2]
    zero = np.zeros(net.states)
    fed = affine_map(w, b, Form.of_point(u, 0))
    if net.reset == "before":
        back = affine_map(v, zero, product(r, x).promoted())
    else:
        back = product(r, affine_map(v, net.inner, x))
    candidate = activation("tanh", _sum(back, fed)).promoted()
    # (1 - z) h + z g = h + z (g - h): one product keeps more of the dependence than two
    change = _sum(candidate, Form(-x.centre, -x.generators, x.radius))
    old, new = x.range(), candidate.range()
    ends = Interval(np.minimum(old.lo, new.lo), np.maximum(old.hi, new.hi))  # 0 <= z <= 1
    h = clip(_sum(x, product(z, change)), ends)
    return h, network_output(net.output, h)


def _sum(x: Form, y: Form) -> Form:
    """Sum of forms that share their generators."""
    both = join(x, y)
    one = np.eye(x.centre.size)
    return affine_map(np.hstack([one, one]), np.zeros(x.centre.size), both)
