"""The least output noise that explains a record over the initial state, by branch and bound.

On a box of initial states every output is y_t = c_t + g_t e + s_t with |e_i| <= 1 and |s_t| <= r_t
(see :mod:`setid.neural.simulations.forms`), so that the least D with |y~_t - y_t| <= D is at
least the value of a linear program in (e, D). Its multipliers a, b >= 0 prove, in intervals,

    D sum(a + b) >= sum (a - b) (y~ - c) - sum (a + b) r - |sum (a - b) g|.

The boxes are bisected along the widest generator until the bounds meet. Samples after which the
root's outputs no longer depend on the initial state are simulated once, for all boxes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

from setid import DataError, IOData, ModelError, Verification
from setid.data.checks import natural, number
from setid.neural.arithmetic import (
    Interval,
    LinearModel,
    at_least,
    down,
    matmul,
    quiet_overflow,
    require_ieee,
    row_sums,
    up,
)
from setid.neural.branching import BestFirst, DualNode, halves
from setid.neural.models.recurrent import GRU, LSTM, Elman, NeuralStateSpace
from setid.neural.models.regressor import RegressorNetwork, check_record
from setid.neural.simulations.forms import Form
from setid.neural.simulations.simulation import initial_box, run_forms, simulate_band
from setid.neural.status import Status, agreed
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["OutputError", "output_error"]

Reals = NDArray[np.float64]
Model = Elman | NeuralStateSpace | LSTM | GRU | RegressorNetwork
_MOST = 4  # open dimensions of the initial state


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class OutputError(ReadOnly):
    """Least bound of the output noise under which a network explains a record.

    Parameters
    ----------
    net, data : the network and the record
    box : Interval (states,)
        Range of the initial state.
    status : Status
        ``"proved"`` where the bounds agree within the tolerance, else ``"partial"``.
    lower_bound, upper_bound : float
        No state in the box explains the record with less; ``x0`` does with more.
    x0 : (states,) float
    tolerance : float
    horizon : int
        Samples that are simulated for each box; the rest is bounded at the root.
    tree : DualNode
    nodes : int
    """

    net: Model
    data: IOData
    box: Interval
    status: Status
    lower_bound: float
    upper_bound: float
    x0: Reals
    tolerance: float
    horizon: int
    tree: DualNode
    nodes: int

    @as_verdict
    def verify(self) -> Verification:
        """Bound every leaf again from its multipliers, and simulate ``x0``, without any solver."""
        require_ieee()
        tail = _Tail.of(self.net, self.data, self.box, self.horizon)
        least = _replay(self.net, self.data, tail, self.box, self.tree)
        inside = at_least(self.x0, self.box.lo) and at_least(self.box.hi, self.x0)
        closed = _closed(self.lower_bound, self.upper_bound, self.tolerance)
        return agreed(
            (self.lower_bound <= least, "the lower bound does not follow from the leaves"),
            (inside, "the attained state is outside the box"),
            (_attained(self.net, self.data, self.x0) <= self.upper_bound, "the upper bound"),
            (self.status is (Status.PROVED if closed else Status.PARTIAL), "the status"),
        )

    def __repr__(self) -> str:
        ends = f"[{rounded(self.lower_bound, False, 6)}, {rounded(self.upper_bound, True, 6)}]"
        return f"<OutputError: least bound in {ends}, {self.nodes} nodes, {self.status}>"


def _closed(lower: float, upper: float, tolerance: float) -> bool:
    """Check that bounds agree within a tolerance; with an infinite one they never do."""
    return upper < np.inf and upper - lower <= tolerance * upper


@dataclass(frozen=True, slots=True, eq=False)
class _Tail:
    """The error that samples from ``horizon`` on prove for all boxes."""

    horizon: int
    least: float

    @staticmethod
    def of(net: Model, data: IOData, box: Interval, horizon: int) -> _Tail:
        forms = run_forms(net, data, box)[horizon:]
        ranges = [f.range() for f in forms]
        if not ranges:
            return _Tail(horizon, 0.0)
        low, high = np.array([r.lo for r in ranges]), np.array([r.hi for r in ranges])
        return _Tail(horizon, _apart(data.y[horizon:], low, high))


def _apart(y: Reals, low: Reals, high: Reals) -> float:
    """Largest distance of readings from enclosures, rounded down."""
    with np.errstate(invalid="ignore"):
        gap = np.maximum(down(y - high), down(low - y))
    return float(max(np.nanmax(gap, initial=0.0), 0.0))


@quiet_overflow
def output_error(
    net: Model, data: IOData, x0_box: ArrayLike, tolerance: float = 1e-3, nodes: int = 200
) -> OutputError:
    """Bound the least output noise that explains a record over a box of initial states.

    Parameters
    ----------
    net : Elman, NeuralStateSpace, LSTM, GRU, NNOE or NNARX
    data : IOData
        One record; its inputs are exact, missing outputs are skipped.
    x0_box : (states, 2) or (states,) array_like
        Range of the initial state, with at most 4 entries that are open. Of regressor networks
        the first n outputs.
    tolerance : float
        Relative gap at which the search ends.
    nodes : int
        Most boxes that are bounded. Ctrl-C ends the search before that, with what is proved.

    Returns
    -------
    OutputError

    Raises
    ------
    ModelError, DataError
        If network, record and box do not fit.

    References
    ----------
    R. Horst, H. Tuy, Global Optimization, Springer 1996, chapter IV.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import neural
    >>> net = neural.Elman([([[1.0]], [[0.5]], [0.0])], ([[1.0]], [0.0]), "identity")
    >>> data = setid.IOData(np.zeros(3), [1.5, 0.5, 0.5])  # y = x0 / 2, x0 / 4, x0 / 8: 1 / 6
    >>> found = neural.output_error(net, data, [[-9.0, 9.0]])
    >>> round(found.lower_bound, 3), round(found.upper_bound, 3), bool(found.verify())
    (0.167, 0.167, True)
    """
    require_ieee()
    if not 0.0 <= number(tolerance, "tolerance", ModelError) < np.inf:
        raise ModelError(f"tolerance: found {tolerance!r}, expected a number >= 0")
    natural(nodes, "nodes", ModelError, 1)
    if not isinstance(net, (Elman, NeuralStateSpace, LSTM, GRU, RegressorNetwork)):
        raise ModelError(f"net: found {type(net).__name__}, expected a model of setid.neural")
    check_record(data, net.channels, net.outputs, single=True)
    if np.all(np.isnan(data.y)):
        raise DataError("data.y: found no reading, expected some")
    box = initial_box(net, data, x0_box)
    open_ = int(np.count_nonzero(box.hi > box.lo))
    if open_ > _MOST:
        raise ModelError(f"x0_box: found {open_} open entries, expected at most {_MOST}")
    return _Search(net, data, box, tolerance).least(nodes)


def _horizon(net: Model, data: IOData, box: Interval) -> int:
    """First sample from which on no output depends noticeably on the initial state."""
    width = np.array([np.max(f.range().hi - f.range().lo) for f in run_forms(net, data, box)])
    scale = float(np.nanmax(np.abs(data.y))) + 1e-300
    late = np.flatnonzero(~(width <= 1e-9 * scale))
    return int(late[-1]) + 1 if late.size else min(1, data.samples)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows abs(rest - g e) <= D + r of one box."""

    rest: Interval
    generators: Reals
    radius: Reals

    @staticmethod
    def of(net: Model, data: IOData, box: Interval, horizon: int) -> _Rows:
        kept = int(np.count_nonzero(box.hi > box.lo))
        forms = run_forms(net, data, box, horizon)
        y = data.y[:horizon].ravel()
        centre = np.concatenate([f.centre for f in forms])
        generators = np.vstack([f.generators[:, :kept] for f in forms])
        radius = np.concatenate([_rest(f, kept) for f in forms])
        known = ~np.isnan(y)
        rest = Interval.point(y[known]) - Interval.point(centre[known])
        return _Rows(rest, generators[known], radius[known])

    def prove(self, dual: Reals) -> float:
        """Bound D from below by multipliers a - b (T,); unbounded rows are left out."""
        good = np.isfinite(self.radius)
        if dual.shape != self.radius.shape or np.any(dual[~good] != 0):
            return 0.0
        used = np.flatnonzero(dual)
        if not used.size:
            return 0.0
        d, size = Interval.point(dual[None, used]), Interval.point(np.abs(dual[None, used]))
        gain = matmul(d, self.rest[used][:, None]).lo[0, 0]
        lost = matmul(size, Interval.point(self.radius[used, None])).hi[0, 0]
        slope = matmul(d, Interval.point(self.generators[used])).magnitude()
        total = matmul(size, Interval.point(np.ones((used.size, 1)))).hi[0, 0]
        value = down(down(gain - lost) - float(row_sums(slope)[0]) if slope.size else gain - lost)
        found = down(down(value) / up(total))
        return float(found) if found > 0 else 0.0

    def solve(self) -> tuple[Reals, Reals]:
        """Solve the linear program: multipliers a - b and the minimising e."""
        good = np.flatnonzero(np.isfinite(self.radius))
        g, r, y = self.generators[good], self.radius[good], self.rest.middle()[good]
        count, kept = g.shape
        one, free = np.ones((count, 1)), np.full(count, np.inf)
        matrix = sps.csr_array(np.block([[g, one], [g, -one]]))
        columns = np.append(-np.ones(kept), 0.0), np.append(np.ones(kept), np.inf)
        model = LinearModel(
            matrix, (np.concatenate([y - r, -free]), np.concatenate([free, y + r])), columns
        )
        found = model.solve(np.append(np.zeros(kept), 1.0))
        dual = np.zeros(self.radius.size)
        if found.status != "solved":
            return dual, np.zeros(kept)
        dual[good] = np.maximum(found.dual[:count], 0.0) + np.minimum(found.dual[count:], 0.0)
        return dual, np.asarray(found.x[:kept], np.float64)


def _rest(form: Form, kept: int) -> Reals:
    """Radius of a form beside its leading generators."""
    other = np.abs(form.generators[:, kept:]).sum(axis=1)
    terms = form.generators.shape[1] + 8.0
    return np.asarray(up((other + form.radius) * (1.0 + terms * 2.0**-52) + 1e-300), np.float64)


def _attained(net: Model, data: IOData, x0: Reals) -> float:
    """Upper bound of the largest output error from one initial state, proved."""
    found = simulate_band(net, data, x0)
    most = np.maximum(up(np.abs(data.y - found.low)), up(np.abs(found.high - data.y)))
    return float(np.nanmax(most))


def _replay(net: Model, data: IOData, tail: _Tail, box: Interval, node: DualNode) -> float:
    """Least of the bounds that the leaves of a tree prove."""
    if node.split >= 0:
        if len(node.children) != 2 or node.split >= box.lo.size:
            return 0.0
        parts = zip(halves(box, node.split), node.children, strict=True)
        return min(_replay(net, data, tail, half, child) for half, child in parts)
    rows = _Rows.of(net, data, box, tail.horizon)
    return max(tail.least, rows.prove(node.dual))


class _Search(BestFirst[Interval]):
    """Best-first branch and bound over the initial state."""

    def __init__(self, net: Model, data: IOData, box: Interval, tolerance: float) -> None:
        super().__init__()
        self.net, self.data, self.box, self.tolerance = net, data, box, tolerance
        self.horizon = _horizon(net, data, box)
        self.tail = _Tail.of(net, data, box, self.horizon)
        self.x0, self.guess = 0.5 * box.lo + 0.5 * box.hi, np.inf

    def least(self, most: int) -> OutputError:
        """Bisect until the bounds meet or ``most`` nodes are bounded."""
        try:
            self._try(self.x0)
            self.add(self.box)
            while (
                len(self.known) < most
                and self.guess - self.bound > 0.9 * self.tolerance * self.guess
            ):
                self.branch()
        except KeyboardInterrupt:
            if not self.known:
                raise
        lower = max(self.tail.least, self.bound)
        upper = _attained(self.net, self.data, self.x0)
        closed = _closed(lower, upper, self.tolerance)
        status = Status.PROVED if closed else Status.PARTIAL
        return OutputError(
            net=self.net,
            data=self.data,
            box=self.box,
            status=status,
            lower_bound=lower,
            upper_bound=upper,
            x0=self.x0,
            tolerance=self.tolerance,
            horizon=self.horizon,
            tree=self.tree(),
            nodes=len(self.known),
        )

    def parts(self, part: Interval, split: int) -> tuple[Interval, Interval]:
        """Bisect a box along an entry of the state."""
        return halves(part, split)

    def add(self, part: Interval) -> None:
        """Bound a box, and try the state that its program proposes."""
        rows = _Rows.of(self.net, self.data, part, self.horizon)
        dual, e = rows.solve()
        value = max(self.tail.least, rows.prove(dual))
        open_ = np.flatnonzero(part.hi > part.lo)
        x0 = 0.5 * part.lo + 0.5 * part.hi
        x0[open_] += 0.5 * part.width()[open_] * e
        self._try(np.clip(x0, part.lo, part.hi))
        reach = np.abs(rows.generators[np.isfinite(rows.radius)]).max(axis=0, initial=0.0)
        relative = part.width()[open_] / np.maximum(self.box.width()[open_], 1e-300)
        score = np.where(np.isfinite(reach) & (reach > 0), reach, relative)
        entry = int(open_[np.argmax(score)]) if open_.size else 0
        self.file(value, part, dual, False, entry, None)

    def _try(self, x0: Reals) -> None:
        """Simulate a state in floating point; keep it if it is the best so far."""
        found = self.net.simulate(self.data, x0)
        value = float(np.nanmax(np.abs(found - self.data.y)))
        if value < self.guess:
            self.x0, self.guess = x0, value
