"""Bands of static maps and of internal signals of block structures, proved and sampled.

A map N(x) = sum_m gamma_m phi_m(x) is linear in its coefficients at each x: its range over
the feasible set is that of a linear function over the cover of the parameters, and the
engine narrows it where asked to. Internal signals that are no unknowns are maps of measured
inputs u = u~ - xi, abs(xi) <= w. A monomial then differs from its value at the readings by at most

    prod_i (abs(u~_i) + w_i)^p_i  -  prod_i abs(u~_i)^p_i,

and the map by the sum of these, each times the largest size of its coefficient. Other internal
signals have the bounds of their unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.bands.responses import Kind
from setid.data.checks import frozen, number, real_array, word
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import members, nominal
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.supports import cover_of, supports
from setid.formulation.units import in_units
from setid.models.block import BlockStructured
from setid.models.maps import StaticMap
from setid.proofs.cells.output_cells import cell_box
from setid.proofs.existence import proved_point
from setid.proofs.parameter_box import start_of
from setid.proofs.simulated.forms import Region
from setid.proofs.simulated.outputs import recursion_of
from setid.proofs.supports import Cover

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["SignalBand", "StaticBand", "signal_band", "static_band"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
_EXPONENT = 900  # of products that are normal doubles
_TINY = 1e-300
_MORE = 1.0 + 1e-12  # more than the rounding of sums of positive numbers


@dataclass(frozen=True, slots=True, eq=False)
class StaticBand:
    """Ranges of a static map at given arguments.

    Parameters
    ----------
    name : str
        The signal that the map defines.
    arguments : tuple of str
    x : (K, arguments) float
    low, high, nominal : (K,) float
    kind : {"proved", "sampled"}
        Whether every consistent system lies inside, at these arguments.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    >>> u = np.linspace(-1, 1, 9)
    >>> result = setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))
    >>> setid.static_band(result, x=[0.5, 1.0]).nominal.round(2)
    array([0.62, 1.5 ])
    """

    name: str
    arguments: tuple[str, ...]
    x: Reals
    low: Reals
    high: Reals
    nominal: Reals
    kind: Kind

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it; see :func:`setid.plots.blocks.plot_static_band`.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.blocks import plot_static_band

        return plot_static_band(self, ax)


@dataclass(frozen=True, slots=True, eq=False)
class SignalBand:
    """Ranges of an internal signal, arrays of shape (N,), NaN where it has no value.

    Parameters
    ----------
    name : str
    low, high : (N,) float
        Proved.
    sampled_low, sampled_high : (N,) float
        What consistent systems that are known attain.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    >>> u = np.linspace(-1, 1, 9)
    >>> result = setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))
    >>> setid.signal_band(result, model.internal[0]).name
    'w'
    """

    name: str
    low: Reals
    high: Reals
    sampled_low: Reals
    sampled_high: Reals

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it; see :func:`setid.plots.blocks.plot_signal_band`.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.blocks import plot_signal_band

        return plot_signal_band(self, ax)


def static_band(
    result: FeasibleSet,
    name: str | None = None,
    x: ArrayLike | None = None,
    kind: Kind = "proved",
    seconds: float = 0.0,
) -> StaticBand:
    """Prove or sample the band of a static nonlinearity over the feasible set.

    Parameters
    ----------
    result : FeasibleSet
        Of a block structure.
    name : str, optional
        The signal that the map defines; needed where there are several maps.
    x : array_like (K,) or (K, arguments), optional
        Arguments; 41 over the range of the readings when left out, for a single measured one.
    kind : {"proved", "sampled"}
    seconds : float
        Time of the engine to narrow a proved band; 0 for linear programs over what is proved
        of the parameters already.

    Raises
    ------
    ModelError
        If there is no such map, or arguments are to be given.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    >>> u = np.linspace(-1, 1, 9)
    >>> data = setid.IOData(u, u + 0.5 * u**2)
    >>> result = setid.identify(data, model, setid.Noise(output=0.01))
    >>> band = setid.static_band(result, x=[1.0])
    >>> bool(band.low[0] <= 1.5 <= band.high[0]), bool(band.high[0] - band.low[0] < 0.05)
    (True, True)
    """
    check_result(result)
    seconds = number(seconds, "seconds", SetidError)
    if seconds < 0.0:
        raise SetidError(f"seconds: found {seconds}, expected at least 0")
    model, target, item = _map_of(result, name)
    points = _arguments(result, item, x)
    slopes, constant = _directions(model, target, item, points)
    theta = nominal(result)
    middle = slopes @ theta + constant
    if word(kind, "kind", ("proved", "sampled"), SetidError) == "sampled":
        values = members(result) @ slopes.T + constant
        low, high = values.min(axis=0), values.max(axis=0)
    else:
        off = _deviation(result, target, points, np.zeros_like(points))
        low, high = _proved(result, cover_of(result), (slopes, constant), off, seconds)
    low, high = frozen(np.asarray(low, np.float64)), frozen(np.asarray(high, np.float64))
    arguments = item.arguments
    return StaticBand(target, arguments, frozen(points), low, high, frozen(middle), kind)


def _map_of(result: FeasibleSet, name: str | None) -> tuple[BlockStructured, str, StaticMap]:
    model = result.formulation.model
    if not isinstance(model, BlockStructured) or not model.maps:
        raise ModelError(f"result: found a {type(model).__name__}, expected one with static maps")
    maps = dict(model.maps)
    target = next(iter(maps)) if name is None and len(maps) == 1 else name
    target = word(target, "name", maps, ModelError)
    return model, target, maps[target]


def _arguments(result: FeasibleSet, item: StaticMap, x: ArrayLike | None) -> Reals:
    if x is not None:
        points = real_array(x, "x", SetidError)
        points = points[:, None] if points.ndim == 1 else points
        if points.ndim != 2 or points.shape[1] != len(item.arguments):
            raise SetidError(f"x: found shape {points.shape}, expected (K, {len(item.arguments)})")
        if np.any(np.isnan(points)):
            row = int(np.isnan(points).any(axis=1).argmax())
            raise SetidError(f"x: found NaN at [{row}], expected finite numbers")
        return points
    if len(item.arguments) == 1:
        low, high = _readings(result, item.arguments[0])
        if np.isfinite(low) and np.isfinite(high):
            return np.linspace(low, high, 41)[:, None]
    raise ModelError(
        f"x: found none, expected values of {', '.join(item.arguments)}, which are not measured"
    )


def _readings(result: FeasibleSet, signal: str) -> tuple[float, float]:
    """The range of a measured signal, or of the bounds of an internal one."""
    data, groups = result.formulation.data, result.formulation.layout.groups
    if signal in groups and signal not in ("u", "y"):
        numbers = groups[signal][groups[signal] >= 0]
        return float(result.problem.lower[numbers].min()), float(
            result.problem.upper[numbers].max()
        )
    values = (data.u if signal[0] == "u" else data.y)[:, int(signal[1:]) - 1]
    return float(np.nanmin(values)), float(np.nanmax(values))


def _directions(
    model: BlockStructured, target: str, item: StaticMap, points: Reals
) -> tuple[Reals, Reals]:
    """The map as slopes (K, p) times theta plus a constant (K,)."""
    fixed, place = dict(model.fixed), {name: i for i, name in enumerate(model.parameters)}
    slopes, constant = np.zeros((len(points), len(place))), np.zeros(len(points))
    for m, weight in enumerate(model.wiring.weights(target)):
        values = item.value(m, *points.T)
        if weight in fixed:
            constant = constant + fixed[weight] * values
        else:
            slopes[:, place[weight]] = values
    return slopes, constant


def _deviation(result: FeasibleSet, target: str, points: Reals, reach: Reals) -> Reals:
    """Distance of a map from its computed values (K,), by rounding and errors in arguments.

    Functions that are given are taken as they are; they need arguments without errors.
    """
    model, _, item = _map_of(result, target)
    low, high = result.outer_box
    largest = dict(zip(result.formulation.parameters, np.maximum(-low, high), strict=True))
    largest |= {name: abs(value) for name, value in model.fixed}
    off, weights = np.zeros(len(points)), model.wiring.weights(target)
    for m, weight in enumerate(weights):
        powers = item.basis[m]
        with np.errstate(all="ignore"):
            if callable(powers):
                far, rounding = np.abs(item.value(m, *points.T)), 0
                apart = np.where(np.any(reach > 0, axis=1), inf, 0.0)
            else:
                far, apart = _monomial(item, m, powers, points, reach)
                rounding = 2 * sum(powers)
            apart += (rounding + len(weights) + 4) * _EPS * far
        found = ~(apart == 0.0)
        off[found] += largest[weight] * apart[found]
    return np.where(np.isnan(off), inf, off) * _MORE


def _monomial(
    item: StaticMap, m: int, powers: tuple[int, ...], points: Reals, reach: Reals
) -> tuple[Reals, Reals]:
    """The largest size of a monomial (K,), and how far it may be from that at the points."""
    used, most = np.array(powers) > 0, 2.0 ** (_EXPONENT / max(sum(powers), 1))
    size = np.abs(points) + reach
    far, near = item.value(m, *size.T), item.value(m, *np.abs(points).T)
    size = size[:, used]
    normal = np.all((size == 0.0) | ((size >= 1.0 / most) & (size <= most)), axis=1)
    apart = far - near + np.where(normal, 0.0, _TINY)  # below 1 underflow loses no more than that
    return far, np.where(normal | np.all(size <= 1.0, axis=1), apart, inf)


def _proved(
    result: FeasibleSet, cover: Cover, values: tuple[Reals, Reals], off: Reals, seconds: float
) -> tuple[Reals, Reals]:
    """Bound slopes times theta plus a constant, which may be ``off`` (K,) from the map."""
    slopes, constant = values
    ends = supports(cover, slopes)
    if seconds > 0 and np.all(np.isfinite(ends)):
        ends = _narrowed(result, slopes, ends, seconds)
    size = off + 8 * _EPS * (np.abs(ends).max(axis=1) + np.abs(constant))
    return ends[:, 0] + constant - size, ends[:, 1] + constant + size


def _narrowed(result: FeasibleSet, slopes: Reals, ends: Reals, seconds: float) -> Reals:
    """Ends that the engine proves on the problem itself."""
    layout = result.formulation.layout
    theta = [layout.polynomial(i) for i in layout.group("theta").tolist()]
    forms = [
        sp.total([float(c) * t for c, t in zip(row, theta, strict=True) if c] or [0.0 * theta[0]])
        for row in slopes
    ]
    asked = [sign * form for form in forms for sign in (1.0, -1.0)]
    options = replace(result.options, time_limit=seconds, tol=1e-2).for_engine()
    scaled = in_units(result.problem, result.formulation)
    again = (
        proved_point(result.formulation, scaled.problem, x / scaled.units) for x in result.witnesses
    )
    known = [point for point in again if point is not None]
    objectives, factors = zip(*map(scaled.asked, asked), strict=True)
    found = sp.solve_each(scaled.problem, objectives, options, points=known)
    bounds = np.array([r.lower_bound for r in found]) * factors
    low, high = bounds[0::2], -bounds[1::2]
    return np.stack([np.maximum(low, ends[:, 0]), np.minimum(high, ends[:, 1])], axis=1)


def signal_band(result: FeasibleSet, name: str) -> SignalBand:
    """Enclose an internal signal over the record, for all consistent systems.

    Parameters
    ----------
    result : FeasibleSet
        Of a block structure.
    name : str
        One of ``model.internal``.

    Raises
    ------
    ModelError
        If there is no such signal.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model = setid.Hammerstein(setid.TransferFunction(0, 1), 2, normalise="b0")
    >>> u = np.linspace(-1, 1, 9)
    >>> result = setid.identify(setid.IOData(u, u + 0.5 * u**2), model, setid.Noise(output=0.01))
    >>> band = setid.signal_band(result, model.internal[0])
    >>> bool(band.low[-1] <= 1.5 <= band.high[-1])
    True
    """
    check_result(result)
    model, data = result.formulation.model, result.formulation.data
    if not isinstance(model, BlockStructured) or not model.internal:
        raise ModelError(f"name: found {name!r:.60}, expected a structure with internal signals")
    word(name, "name", model.internal, ModelError)
    groups = result.formulation.layout.groups
    if name in groups:
        return _unknown_band(result, name, groups[name])
    item = dict(model.maps).get(name)
    if item is None or not all(a[0] == "u" for a in item.arguments):
        raise ModelError(f"name: found {name!r}, which is neither an unknown nor a map of inputs")
    channels = np.array([int(argument[1:]) - 1 for argument in item.arguments])
    rows = np.flatnonzero(~np.any(np.isnan(data.u[:, channels]), axis=1))
    points = data.u[np.ix_(rows, channels)]
    reach = result.formulation.noise.bounds(data)[1][np.ix_(rows, channels)]
    off = _deviation(result, name, points, reach)
    values = _directions(model, name, item, points)
    proved = _proved(result, cover_of(result), values, off, 0.0)
    parts = (*proved, *_attained(result, name, rows, channels))
    return SignalBand(name, *(_spread(end, rows, data.samples) for end in parts))


def _attained(
    result: FeasibleSet, name: str, rows: NDArray[np.int64], channels: NDArray[np.int64]
) -> tuple[Reals, Reals]:
    """Ends (K,) of a map of inputs over systems that are known; NaN where none is."""
    model, target, item = _map_of(result, name)
    data, layout = result.formulation.data, result.formulation.layout
    theta, xi = layout.group("theta"), layout.group("xi")[np.ix_(rows, channels)]
    readings, values = data.u[np.ix_(rows, channels)], list[Reals]()
    seen = [np.asarray(w, float) for w in result.witnesses]
    if seen and not np.any(xi >= 0):  # mixtures of them are consistent, too
        slopes, constant = _directions(model, target, item, readings)
        values = list(members(result) @ slopes.T + constant)
    for x in seen if not values else ():
        errors = np.where(xi >= 0, x[np.maximum(xi, 0)], 0.0)
        slopes, constant = _directions(model, target, item, readings - errors)
        values.append(slopes @ x[theta] + constant)
    found = np.array(values) if values else np.full((1, rows.size), np.nan)
    return found.min(axis=0), found.max(axis=0)


def _spread(values: Reals, rows: NDArray[np.int64], samples: int) -> Reals:
    full = np.full(samples, np.nan)
    full[rows] = values
    return frozen(full)


def _simulated_range(result: FeasibleSet, name: str) -> tuple[Reals, Reals] | None:
    """Ends (N,) of a signal over the outer box, by simulation; None for what is no recursion."""
    formulation, box = result.formulation, result.outer_box
    parts = recursion_of(formulation)
    if parts is None:
        cells = cell_box(formulation, start_of(formulation))
        parts = None if cells is None else recursion_of(formulation, cells)
    if parts is None or not np.all(np.isfinite(box)):
        return None
    lower, upper = parts.box(*box)
    region = Region(lower, upper, np.zeros((0, lower.size)), np.zeros(0), np.zeros(0))
    form = parts.run(region)[name]
    with np.errstate(over="ignore", invalid="ignore"):
        off = (region.reach(form.slope) + form.rest) * _MORE + 1e-15 * np.abs(form.value)
        low, high = form.value - off, form.value + off
    return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def _unknown_band(result: FeasibleSet, name: str, numbers: NDArray[np.int64]) -> SignalBand:
    rows, samples = np.flatnonzero(numbers >= 0), numbers.size
    chosen = numbers[rows]
    low, high = result.problem.lower[chosen], result.problem.upper[chosen]
    over = _simulated_range(result, name)
    if over is not None:
        low, high = np.maximum(low, over[0][rows]), np.minimum(high, over[1][rows])
    seen = result.witnesses
    values = np.array([w[chosen] for w in seen]) if seen else np.full((1, rows.size), np.nan)
    ends = (low, high, values.min(axis=0), values.max(axis=0))
    return SignalBand(name, *(_spread(end, rows, samples) for end in ends))
