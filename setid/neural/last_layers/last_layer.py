"""The last layer as a feasible set: hidden layers fixed, bounded equation error or noise.

With fixed hidden layers the output is linear in the last layer theta = (w, b). For exact
regressors the set |y_t - F_t theta| <= E_t is a polytope. The features F_t are only known within
enclosures, since no computer evaluates tanh exactly. So a linear program proposes multipliers d,
and interval arithmetic draws the conclusion that holds for all features in the enclosures:

    c theta >= sum_t (d_t y_t - |d_t| E_t) - |c - d F| |theta|.

Applied to c = +-e_i this says |theta| <= a + R |theta| with R of the size of rounding errors, and
since a member is a real vector, |theta| <= (I - R)^{-1} a wherever the row sums of R are below 1.

With noise on outputs or inputs the regressors lie in boxes and the features in wider enclosures
F +- W. Then every theta obeys |y - F theta| <= w0 + W |theta|, rows that
:func:`setid.parameter_box` bounds.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid import (
    IntervalStatus,
    IOData,
    ModelError,
    Noise,
    NoiseError,
    ParameterBox,
    ParameterInterval,
    Regression,
    Verification,
    parameter_box,
)
from setid.data.checks import FrozenMapping, frozen, natural, number, seconds_of
from setid.data.digits import all_digits
from setid.data.noise import EstimatedBound
from setid.neural.arithmetic import (
    Interval,
    at_least,
    down,
    nowhere_above,
    quiet_overflow,
    require_ieee,
    up,
)
from setid.neural.last_layers.equation_error import rows_of
from setid.neural.last_layers.polytope import (
    Rows,
    least_factor,
    multipliers,
    prove_bounds,
    prove_factor,
    prove_reach,
    surely_inside,
)
from setid.neural.models.network import Network
from setid.neural.models.regressor import RegressorNetwork
from setid.neural.status import Status, agreed, same_intervals
from setid.proofs.evidence import as_verdict
from sparsepop_py.algebra.read_only import ReadOnly

__all__ = ["LastLayer", "LayerBand", "OutputSet", "last_layer"]

Reals = NDArray[np.float64]
_CLOSED = 1e-6  # of the width of an interval: what "certified" allows between its ends
_MOST = 1_000_000  # members that are drawn at once
_FAILURES = 20  # of a walk in a row, after which the set is taken to be a point
_SHIFTS = (1e-9, 1e-7, 1e-5, 1e-3)  # towards the inside, tried until vertices are proved members


@dataclass(frozen=True, slots=True, eq=False)
class OutputSet(ReadOnly):
    """Proved and attained statements on the last layer of one output.

    Parameters
    ----------
    factor : (float, float)
        The least multiple of the noise bound that explains the record lies between them; the
        first is proved, the second attained (infinite where nothing was attained).
    outer : Interval (m,)
    inner : (2, m) float or None
        Least and largest values attained by proved members.
    reach : (m,) float
        Bound of abs(theta).
    dual, least : (2 m, T) and (2, T) float
        Multipliers of the bounds and of ``factor``.
    widened : float
        Multiple of the noise bound that the multipliers ``dual`` are about.
    centre : (m,) float
        What ``factor[1]`` is attained by.
    inside : (K, m) float
        Proved members.
    box : ParameterBox or None
        The proof where regressors are uncertain.
    """

    factor: tuple[float, float]
    outer: Interval
    inner: Reals | None
    reach: Reals
    dual: Reals
    least: Reals
    widened: float
    centre: Reals
    inside: Reals
    box: ParameterBox | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LayerBand(ReadOnly):
    """Proved one-step band of all members of a last layer, on some record.

    Parameters
    ----------
    result : LastLayer
    data : IOData
    low, high : (N, ny) float
        Range of the members' predictions; NaN where there is no regressor.
    reading_low, reading_high : (N, ny) float
        Where readings lie if plant = member + bounded error: equation error included.
    dual : tuple of (2 T, K) float
        Multipliers of each output, empty where the box alone was used.
    """

    result: LastLayer
    data: IOData
    low: Reals
    high: Reals
    reading_low: Reals
    reading_high: Reals
    dual: tuple[Reals, ...]

    @property
    def outside(self) -> NDArray[np.int64]:
        """Sample and output (from 0) of readings outside the band, shape (K, 2)."""
        with np.errstate(invalid="ignore"):
            gone = (self.data.y < self.reading_low) | (self.data.y > self.reading_high)
        return np.argwhere(gone)

    @property
    def width(self) -> float:
        """Mean width of the band of readings."""
        return float(np.nanmean(self.reading_high - self.reading_low))

    def __repr__(self) -> str:
        count = int(np.count_nonzero(~np.isnan(self.reading_low)))
        return f"<LayerBand: {count} readings, {self.width:.4g} wide, {len(self.outside)} outside>"

    @as_verdict
    def verify(self) -> Verification:
        """Draw the conclusions again from the stored multipliers, without any solver."""
        inner = self.result.verify()
        if not inner:
            return inner
        again = _band(self.result, self.data, self.dual)
        with np.errstate(invalid="ignore"):
            return agreed(
                (nowhere_above(self.low, again.low), "the band is too high"),
                (nowhere_above(again.high, self.high), "the band is too low"),
                (nowhere_above(self.reading_low, again.reading_low), "the readings' band"),
                (nowhere_above(again.reading_high, self.reading_high), "the readings' band"),
            )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LastLayer:
    """All last layers that explain a record, hidden layers fixed.

    Parameters
    ----------
    net : NNARX or NNOE
    data : IOData
    noise : Noise
    status : Status
        ``"proved"`` (every interval certified), ``"partial"``, ``"empty"`` or ``"open"``.
    sets : tuple of OutputSet
        One an output.
    intervals : mapping of str to ParameterInterval
        Of ``w1``, ``w2``, ..., ``b`` (``w[output]k`` for several outputs).
    assumptions : tuple of str
    """

    net: RegressorNetwork
    data: IOData
    noise: Noise
    status: Status
    sets: tuple[OutputSet, ...]
    intervals: Mapping[str, ParameterInterval]
    assumptions: tuple[str, ...]

    @property
    def lower_bound(self) -> Reals:
        """Proved lower bound of the least multiple of the noise bound, shape (ny,)."""
        return np.array([item.factor[0] for item in self.sets])

    @property
    def upper_bound(self) -> Reals:
        """Attained multiple of the noise bound, shape (ny,)."""
        return np.array([item.factor[1] for item in self.sets])

    def central(self) -> Network:
        """Return the network with a proved member as its last layer.

        Raises
        ------
        NoiseError
            If no member was attained.
        """
        if not all(item.inside.size for item in self.sets):
            raise NoiseError(f"noise: no member was attained, the set is {self.status}")
        theta = np.array([item.inside[0] for item in self.sets])
        return self.net.network.with_last_layer(theta[:, :-1], theta[:, -1])

    @quiet_overflow
    def members(self, count: int, seed: int = 0) -> Reals:
        """Draw members by hit and run; each is proved to explain the record.

        Parameters
        ----------
        count : int
            From 1 to a million.
        seed : int

        Returns
        -------
        (count, ny, m) float

        Raises
        ------
        ModelError, NoiseError
            If count or seed is out of range, or no member was attained.
        """
        count = natural(count, "count", ModelError, 1, _MOST)
        seed = natural(seed, "seed", ModelError)
        rows = _rows(self.net, self.data, self.noise)
        rng = np.random.default_rng(seed)
        drawn = [_walk(part, item, count, rng) for part, item in zip(rows, self.sets, strict=True)]
        return np.stack(drawn, axis=1)

    @quiet_overflow
    def band(self, data: IOData | None = None, time_limit: float = 60.0) -> LayerBand:
        """Bound the one-step predictions of all members.

        Parameters
        ----------
        data : IOData, optional
            Another record; the own one where left out.
        time_limit : float
            Seconds for linear programs; predictions that are left then are bounded over the
            intervals of the last layer.

        Raises
        ------
        DataError, SetidError
            If the record does not fit, or the limit is no number of at least 0.
        """
        until = time.monotonic() + seconds_of(time_limit)
        return _band(self, self.data if data is None else data, None, until)

    @as_verdict
    def verify(self) -> Verification:
        """Draw all conclusions again from the stored multipliers, without any solver."""
        if self.net.network.activation[-1] != "identity":
            return Verification(False, "the last layer is not linear")
        if not set(_assumptions(self.data, self.noise)) <= set(self.assumptions):
            return Verification(False, "an assumption is left out")
        rows = _rows(self.net, self.data, self.noise)
        if len(rows) != len(self.sets):
            return Verification(False, "the sets are not those of the outputs")
        for part, item in zip(rows, self.sets, strict=True):
            verdict = _verify_set(part, item)
            if not verdict:
                return verdict
        wanted, status = _intervals(self.sets)
        same = status is self.status and same_intervals(self.intervals, wanted)
        return agreed((same, "the intervals are not those of the sets"))

    def __repr__(self) -> str:
        items = ", ".join(repr(item) for item in list(self.intervals.values())[:3])
        return f"<LastLayer: {len(self.intervals)} parameters, {self.status}: {items}, ...>"


@quiet_overflow
def last_layer(
    net: RegressorNetwork,
    data: IOData,
    noise: Noise | None = None,
    factor: float = 1.05,
    time_limit: float = 60.0,
) -> LastLayer:
    """Bound the last layer of a network whose hidden layers are fixed.

    Parameters
    ----------
    net : NNARX or NNOE
        Its own last layer must be linear; its weights there are not used.
    data : IOData
    noise : Noise, optional
        Bounds of the equation error, or of output and input noise. Where left out: an equation
        error of ``factor`` times the least one that explains this record.
    factor : float
        Above 1; used where ``noise`` is left out, which is then an assumption.
    time_limit : float
        Seconds for linear programs. What is proved when it is over holds; where programs of an
        output are left then, its intervals may be infinite.

    Returns
    -------
    LastLayer

    Raises
    ------
    ModelError, DataError, NoiseError, SetidError
        If network, record and noise do not fit, the limit is no number of at least 0, or it is
        over before a noise bound that was left out is known.

    References
    ----------
    M. Milanese, C. Novara, "Set membership identification of nonlinear systems", Automatica 40
    (2004) 957-975.

    Examples
    --------
    >>> import setid
    >>> from setid import neural
    >>> net = neural.NNARX(neural.Network([[[0.0, 1.0, 0.0]], [[1.0]]], [[0.0], [0.0]],
    ...                                   "relu"), order=1)
    >>> data = setid.IOData([0, 0, 1, 2, 3], [0, 0, 2, 4, 6])
    >>> found = neural.last_layer(net, data, setid.Noise(equation=0.5))
    >>> found.intervals["w1"]
    w1 in [1.66666, 2.33334], attained [1.66667, 2.33333], certified
    >>> bool(found.verify())
    True
    """
    require_ieee()
    until = time.monotonic() + seconds_of(time_limit)
    rows_of(net, data)
    if net.network.activation[-1] != "identity":
        raise NoiseError("net: found a last layer that is not linear, expected 'identity'")
    if noise is not None and not isinstance(noise, Noise):
        raise NoiseError(
            f"noise: found {type(noise).__name__}, expected Noise, as Noise(equation=0.1)"
        )
    if noise is None:
        noise = _noise_of(net, data, factor, until)
    sets = tuple(_solve(part, until) for part in _rows(net, data, noise))
    intervals, status = _intervals(sets)
    texts = tuple(_assumptions(data, noise))
    return LastLayer(net, data, noise, status, sets, FrozenMapping(intervals), texts)


def _assumptions(data: IOData, noise: Noise) -> list[str]:
    """Name what the set rests on; the noise says where its bound comes from."""
    found = ["the hidden layers are those of the network", *data.assumptions, *noise.assumptions]
    if noise.constraints:
        found.append("constraints of the noise are not used: the intervals hold without them")
    return found


def _noise_of(net: RegressorNetwork, data: IOData, factor: float, until: float) -> Noise:
    if not 1.0 < number(factor, "factor", NoiseError) < np.inf:
        raise NoiseError(f"factor: found {factor!r}, expected a number above 1")
    parts = _rows(net, data, Noise(equation=1.0))
    found = np.array([least_factor(p, until)[0] for p in parts])
    if not np.all(np.isfinite(found)):
        over = "the time limit was over" if time.monotonic() >= until else "the solver failed"
        raise NoiseError(f"noise: found None, expected a bound: {over} before the least was known")
    least = np.maximum(found, [1e-12 * np.max(np.abs(p.target)) for p in parts])
    bound = least * factor
    if not np.all(np.isfinite(bound)):
        raise NoiseError(f"factor: found {factor!r}, whose bound is beyond all doubles")
    times = all_digits(factor)
    text = f"{times} times the least that explains this record, {', '.join(map(all_digits, bound))}"
    return Noise(equation=EstimatedBound(frozen(bound), frozen(np.zeros(bound.size)), text))


def _rows(net: RegressorNetwork, data: IOData, noise: Noise) -> list[Rows]:
    """Rows of each output, with the features of all regressors that the noise allows."""
    _, row = rows_of(net, data)
    output, inputs, equation = noise.bounds(data)
    features = net.network.enclose_features(_boxes(net, data, row, output, inputs))
    ones = np.ones((row.size, 1))
    full = Interval(np.hstack([features.lo, ones]), np.hstack([features.hi, ones]))
    total = np.asarray(up(output[row] + equation[row]), np.float64)
    radius: Reals = np.where(output[row] == 0.0, equation[row], total)
    return [Rows(full, data.y[row, k], radius[:, k]) for k in range(net.outputs)]


def _boxes(
    net: RegressorNetwork, data: IOData, row: NDArray[np.int64], output: Reals, inputs: Reals
) -> Interval:
    def stack(y: Reals, u: Reals) -> Reals:
        parts = [y[row - lag] for lag in range(1, net.order + 1)]
        return np.concatenate(parts + [u[row - lag] for lag in range(net.order + 1)], axis=1)

    exact = stack(data.y, data.u)
    if not (np.any(output) or np.any(inputs)):
        return Interval.point(exact)
    noisy = stack(output, inputs) > 0
    low, high = stack(data.y - output, data.u - inputs), stack(data.y + output, data.u + inputs)
    return Interval(np.where(noisy, down(low), exact), np.where(noisy, up(high), exact))


def _solve(rows: Rows, until: float) -> OutputSet:
    """Bound the last layer of one output."""
    uncertain = np.max(rows.features.hi - rows.features.lo) > 1e-9 * (
        1.0 + np.max(np.abs(rows.features.hi))
    )
    return _solve_uncertain(rows, until) if uncertain else _solve_exact(rows, until)


def _objectives(size: int) -> Reals:
    return np.asarray(np.kron(np.eye(size), [[1.0], [-1.0]]), np.float64)


def _solve_exact(rows: Rows, until: float) -> OutputSet:
    m = rows.size
    whole = Interval(np.full(m, -np.inf), np.full(m, np.inf))
    none = np.zeros((0, m))
    if not np.any(rows.radius > 0):
        dual = np.zeros((2 * m, rows.target.size))
        zero = np.zeros(m)
        return OutputSet(
            factor=(0.0, np.inf),
            outer=whole,
            inner=None,
            reach=whole.hi,
            dual=dual,
            least=dual[:2],
            widened=1.0,
            centre=zero,
            inside=none,
        )
    guess, centre, least = least_factor(rows, until)
    widened = 1.0 if guess <= 1.0 or not np.isfinite(guess) else 2.0 * guess
    dual, points = multipliers(rows.widened(widened), _objectives(m), until)
    factor, outer, reach = _conclude(rows, dual, least, widened)
    inside = none
    if guess < 1.0:
        inside = _members_near(rows, np.vstack([centre, points]), centre)
    attained = _attained_factor(rows, centre)
    inner = np.array([inside.min(axis=0), inside.max(axis=0)]) if len(inside) else None
    return OutputSet(
        factor=(factor, attained),
        outer=outer,
        inner=inner,
        reach=reach,
        dual=dual,
        least=least,
        widened=widened,
        centre=centre,
        inside=inside,
    )


def _conclude(
    rows: Rows, dual: Reals, least: Reals, widened: float
) -> tuple[float, Interval, Reals]:
    """Least factor, box and reach that multipliers prove."""
    m = rows.size
    infinite = np.full(m, np.inf)
    value, slack = prove_bounds(rows.widened(widened), Interval.point(_objectives(m)), dual)
    reach = prove_reach(value, slack)
    if reach is None:
        return 0.0, Interval(-infinite, infinite), infinite
    lost = up(up(slack @ reach) * (1.0 + 1e-12))
    ends = down(value - lost)
    proved = prove_factor(rows, least, reach)
    factor = min(proved, widened)  # the reach is about this multiple of the bound, not more
    return factor, Interval(ends[::2], -ends[1::2]), reach


def _members_near(rows: Rows, points: Reals, centre: Reals) -> Reals:
    """Points moved towards the centre until they are proved members; the centre first."""
    points = np.where(np.isnan(points), centre, points)
    for shift in _SHIFTS:
        moved = points + shift * (centre - points)
        good = surely_inside(rows, moved)
        if np.all(good):
            return moved
    return moved[good]


def _attained_factor(rows: Rows, theta: Reals) -> float:
    """A multiple of the radius that a vector is proved to obey, with a search by doubling."""
    low, high = 0.0, np.inf
    value = np.abs(rows.target - rows.features.middle() @ theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(rows.radius > 0, value / rows.radius, np.where(value > 0, np.inf, 0.0))
    low = float(np.max(ratio))
    for grow in (1e-14, 1e-12, 1e-9, 1e-6):
        high = low * (1.0 + grow) + grow * 1e-3
        shrunk = Rows(rows.features, rows.target, down(down(rows.radius * high)))
        if np.isfinite(high) and surely_inside(shrunk, theta[None])[0]:
            return float(high)
    return np.inf


def _solve_uncertain(rows: Rows, until: float) -> OutputSet:
    """Bound theta with features in boxes, by linear programs over signs of theta."""
    m, none = rows.size, np.zeros((0, rows.size))
    box = parameter_box(_regression(rows), until=until)
    factor = _least_of(box)
    reach = _reach_of(box)
    dual = np.zeros((2 * m, rows.target.size))
    outer = Interval(np.array(box.lower), np.array(box.upper))
    return OutputSet(
        factor=(factor, np.inf),
        outer=outer,
        inner=None,
        reach=reach,
        dual=dual,
        least=dual[:2],
        widened=1.0,
        centre=np.zeros(m),
        inside=none,
        box=box,
    )


def _least_of(box: ParameterBox) -> float:
    """Multiple of the noise bound that a box proves to be needed: more than 1 where it is empty."""
    return float(np.nextafter(1.0, 2.0)) if np.any(box.lower > box.upper) else 0.0


def _reach_of(box: ParameterBox) -> Reals:
    """Bound of abs(theta) in a box."""
    return np.asarray(np.maximum(np.abs(box.lower), np.abs(box.upper)), np.float64)


def _regression(rows: Rows) -> Regression:
    """Rows abs(Y + R theta) <= w0 + W abs(theta) with the features' middles and radii."""
    middle = rows.features.middle()
    width = np.maximum(up(rows.features.hi - middle), up(middle - rows.features.lo))
    width = np.where(rows.features.hi == rows.features.lo, 0.0, width)
    count = np.arange(rows.target.size)
    names = (*(f"w{k + 1}" for k in range(rows.size - 1)), "b")
    ones = np.ones_like(count)
    return Regression(names, -rows.target, middle, rows.radius, width, count, ones, count + 1, ones)


def _verify_set(rows: Rows, item: OutputSet) -> Verification:
    if item.box is not None:
        m = rows.size
        start = np.array([np.full(m, -np.inf), np.full(m, np.inf)])
        return agreed(
            (item.box.verify(_regression(rows), start), "the box does not follow"),
            (
                np.array_equal(item.outer.lo, item.box.lower)
                and np.array_equal(item.outer.hi, item.box.upper),
                "the intervals are not those of the box",
            ),
            (item.factor[0] <= _least_of(item.box), "the least noise bound is not proved"),
            (item.factor[1] == np.inf, "the attained noise bound"),
            (at_least(item.reach, _reach_of(item.box)), "the size of theta is not proved"),
            (item.inner is None and not item.inside.size, "members of an uncertain set"),
        )
    shape = (2 * rows.size, rows.target.size)
    if item.dual.shape != shape or item.least.shape != (2, shape[1]):
        return Verification(False, "the multipliers do not fit the record")
    if not item.widened >= 1.0:
        return Verification(False, "the multipliers are about a smaller noise bound")
    factor, outer, reach = _conclude(rows, item.dual, item.least, item.widened)
    members = item.inside
    inner = None if item.inner is None or not len(members) else item.inner
    attained = inner is None or (
        at_least(inner[0], members.min(axis=0)) and at_least(members.max(axis=0), inner[1])
    )
    return agreed(
        (item.factor[0] <= factor, "the least noise bound is not proved"),
        (at_least(outer.lo, item.outer.lo), "a lower end is not proved"),
        (at_least(item.outer.hi, outer.hi), "an upper end is not proved"),
        (at_least(item.reach, reach), "the size of theta is not proved"),
        (bool(np.all(surely_inside(rows, members))), "a member does not explain the record"),
        (attained, "an inner end is not attained"),
        (item.factor[1] >= _attained_factor(rows, item.centre), "the attained noise bound"),
        (item.inner is None or inner is not None, "an inner end has no member"),
    )


def _intervals(
    sets: tuple[OutputSet, ...],
) -> tuple[dict[str, ParameterInterval], Status]:
    """Intervals with their names, and what they are worth together."""
    found: dict[str, ParameterInterval] = {}
    empty = any(item.factor[0] > 1.0 for item in sets)
    for k, item in enumerate(sets):
        label = "" if len(sets) == 1 else f"[{k + 1}]"
        names = [f"w{label}{i + 1}" for i in range(item.outer.lo.size - 1)] + [f"b{label}"]
        for i, name in enumerate(names):
            found[name] = _interval(name, item, i, empty)
    states = {item.status for item in found.values()}
    if empty:
        return found, Status.EMPTY
    if states == {IntervalStatus.CERTIFIED}:
        return found, Status.PROVED
    infinite = any(not np.isfinite(item.width) for item in found.values())
    return found, Status.OPEN if infinite else Status.PARTIAL


def _interval(name: str, item: OutputSet, i: int, empty: bool) -> ParameterInterval:
    if empty:
        return ParameterInterval(name, (np.inf, -np.inf), None, IntervalStatus.EMPTY)
    outer = float(item.outer.lo[i]), float(item.outer.hi[i])
    if item.inner is None:
        return ParameterInterval(name, outer, None, IntervalStatus.PARTIAL)
    inner = float(item.inner[0, i]), float(item.inner[1, i])
    loose = max(inner[0] - outer[0], outer[1] - inner[1])
    closed = loose <= _CLOSED * max(inner[1] - inner[0], 0.0)
    status = IntervalStatus.CERTIFIED if closed else IntervalStatus.PARTIAL
    return ParameterInterval(name, outer, inner, status)


def _walk(rows: Rows, item: OutputSet, count: int, rng: np.random.Generator) -> Reals:
    """Hit and run inside the rows, between proved members only."""
    if not len(item.inside):
        raise NoiseError("noise: no member was attained, so that none can be drawn")
    features, found = rows.features.middle(), list[Reals]()
    at = item.inside[0]
    spread, failed = _spread(item.inside), 0
    while len(found) < count:
        for _ in range(4):
            way = spread @ rng.normal(size=rows.size)
            drift, rest = features @ way, rows.target - features @ at
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.array([(rest - rows.radius) / drift, (rest + rows.radius) / drift])
            low, high = ends.min(axis=0).max(), ends.max(axis=0).min()
            if low < high < np.inf and low > -np.inf:
                at = at + rng.uniform(low, high) * (1.0 - 1e-6) * way
        if surely_inside(rows, at[None])[0]:
            found.append(at)
            failed = 0
            continue
        at, failed = item.inside[0], failed + 1
        if failed > _FAILURES:  # a set as thin as rounding errors: a member that is known
            found.append(at)
    return np.array(found)


def _spread(members: Reals) -> Reals:
    """A square root of the covariance of members (K, m); directions without spread stay 0."""
    size = members.shape[1]
    if len(members) < 2:
        return np.zeros((size, size))
    values, vectors = np.linalg.eigh(np.reshape(np.cov(members.T), (size, size)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), np.float64)


def _band(
    result: LastLayer, data: IOData, known: tuple[Reals, ...] | None, until: float = inf
) -> LayerBand:
    """Ranges of the members' predictions, with given or with new multipliers."""
    net = result.net
    _, row = rows_of(net, data)
    output, inputs, equation = result.noise.bounds(data)
    features = net.network.enclose_features(_boxes(net, data, row, output, inputs))
    ones = np.ones((row.size, 1))
    full = Interval(np.hstack([features.lo, ones]), np.hstack([features.hi, ones]))
    costs = Interval(np.vstack([full.lo, -full.hi]), np.vstack([full.hi, -full.lo]))
    low, high = np.full((2, data.samples, net.outputs), np.nan)
    duals = []
    for k, (part, item) in enumerate(
        zip(_rows(net, result.data, result.noise), result.sets, strict=True)
    ):
        dual = np.zeros((0, part.target.size))
        if item.box is None and np.all(np.isfinite(item.reach)) and item.widened == 1.0:
            dual = multipliers(part, costs.middle(), until)[0] if known is None else known[k]
        ends = _box_ends(costs, item.outer)
        if len(dual):
            value, slack = prove_bounds(part, costs, dual)
            lost = up(up(slack @ item.reach) * (1.0 + 1e-12))
            ends = np.maximum(ends, down(value - lost))
        low[row, k], high[row, k] = ends[: row.size], -ends[row.size :]
        duals.append(dual)
    error = up(output + equation)
    return LayerBand(result, data, low, high, -up(-low + error), up(high + error), tuple(duals))


def _box_ends(costs: Interval, box: Interval) -> Reals:
    """Lower ends of cost theta over the box."""
    terms = costs * Interval(box.lo[None], box.hi[None])
    with np.errstate(invalid="ignore"):
        total = terms.lo.sum(axis=1)
        size = np.abs(terms.lo).sum(axis=1)
        found = down(total - (terms.lo.shape[1] + 4.0) * 2.0**-52 * size)
    return np.asarray(np.where(np.isfinite(found), found, -np.inf), np.float64)
