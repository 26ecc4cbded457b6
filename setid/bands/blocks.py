"""Bands of static maps and of internal signals of block structures, proved and sampled.

Linear programs over the cover of the parameters propose what ``proofs/block_bands.py`` proves of
a map, and the engine tightens it where asked to. Internal signals that are no unknowns are maps of
measured signals. The others have the bounds of their unknowns, and what simulation leaves of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.bands.responses import Kind
from setid.data.checks import frozen, real_array, seconds_of, word
from setid.errors import ModelError, SetidError
from setid.feasible_points.members import members, nominal
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.feasible_set.supports import cover_of, supports
from setid.formulation.units import in_units
from setid.models.block import BlockStructured
from setid.models.equations import channel_of
from setid.models.maps import StaticMap
from setid.proofs.block_bands import map_deviation, map_ends, map_slopes, simulated_ends
from setid.proofs.existence import proved_point
from sparsepop_py.algebra.read_only import ReadOnly

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["SignalBand", "StaticBand", "signal_band", "static_band"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StaticBand(ReadOnly):
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

    def __repr__(self) -> str:
        return f"<StaticBand: {self.kind}, {self.name}, {len(self.x)} points>"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it; see :func:`setid.plots.blocks.plot_static_band`.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.blocks import plot_static_band

        return plot_static_band(self, ax)


@dataclass(frozen=True, slots=True, eq=False)
class SignalBand(ReadOnly):
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

    def __repr__(self) -> str:
        return f"<SignalBand: {self.name}, {self.low.size} samples>"

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
    time_limit: float = 0.0,
) -> StaticBand:
    """Prove or sample the band of a static nonlinearity over the feasible set.

    Parameters
    ----------
    result : FeasibleSet
        Of a block structure.
    name : str, optional
        The signal that the map defines; needed where there are several maps.
    x : array_like (K,) or (K, arguments), optional
        Arguments at which the map is bounded. 41 over the range of the readings when left out,
        which needs a map of a single measured signal.
    kind : {"proved", "sampled"}
        Values of the map of every consistent system, or of those that are known.
    time_limit : float
        Seconds in which the engine narrows a proved band. With 0, the default, the band follows by
        linear programs from what is proved of the parameters already.

    Returns
    -------
    StaticBand
        With ``low`` and ``high`` (K,); ``kind`` says what they are.

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
    seconds = seconds_of(time_limit)
    model, target, item = _map_of(result, name)
    points = _arguments(result, item, x)
    slopes, constant = map_slopes(model, target, points)
    theta = nominal(result)
    middle = slopes @ theta + constant
    if word(kind, "kind", ("proved", "sampled"), SetidError) == "sampled":
        values = members(result) @ slopes.T + constant
        low, high = values.min(axis=0), values.max(axis=0)
    else:
        low, high = _proved(result, target, points, np.zeros_like(points), seconds)
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
    """Find the range of a measured signal, or of the bounds of an internal one."""
    data, groups = result.formulation.data, result.formulation.layout.groups
    if signal in groups and signal not in ("u", "y"):
        numbers = groups[signal][groups[signal] >= 0]
        return float(result.problem.lower[numbers].min()), float(
            result.problem.upper[numbers].max()
        )
    values = (data.u if signal[0] == "u" else data.y)[:, int(signal[1:]) - 1]
    return float(np.nanmin(values)), float(np.nanmax(values))


def _proved(
    result: FeasibleSet, target: str, points: Reals, reach: Reals, seconds: float = 0.0
) -> tuple[Reals, Reals]:
    """Bound a map at arguments (K, arguments) with errors up to ``reach``; ends (K,)."""
    model, _, _ = _map_of(result, target)
    slopes, constant = map_slopes(model, target, points)
    ends = supports(cover_of(result), slopes)
    if seconds > 0 and np.all(np.isfinite(ends)):
        ends = _tightened(result, slopes, ends, seconds)
    return map_ends(ends, constant, map_deviation(model, target, points, reach, result.outer_box))


def _tightened(result: FeasibleSet, slopes: Reals, ends: Reals, seconds: float) -> Reals:
    """Tighten ends (K, 2) by the engine, which bounds the map on the problem itself."""
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
        One of ``result.formulation.model.internal``, such as ``"w"`` between the map and the
        linear block of a Hammerstein structure.

    Returns
    -------
    SignalBand
        ``low``, ``high`` (N,) are proved; NaN at samples without a value.

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
    unknown = _unknown_band(result, name, groups[name]) if name in groups else None
    item = dict(model.maps).get(name)
    if item is None or any(channel_of(argument) is None for argument in item.arguments):
        if unknown is not None:
            return unknown
        raise ModelError(
            f"name: found {name!r}, which is neither an unknown nor a map of measured signals"
        )
    readings, reach, numbers = (
        np.stack(columns, axis=1)
        for columns in zip(*(_measured(result, a) for a in item.arguments), strict=True)
    )
    rows = np.flatnonzero(~np.any(np.isnan(readings), axis=1))
    proved = _proved(result, name, readings[rows], reach[rows])
    parts = (*proved, *_attained(result, name, readings[rows], numbers[rows]))
    found = SignalBand(name, *(_spread(end, rows, data.samples) for end in parts))
    if unknown is None:
        return found
    low, high = np.fmax(unknown.low, found.low), np.fmin(unknown.high, found.high)
    return replace(unknown, low=frozen(low), high=frozen(high))


def _measured(result: FeasibleSet, signal: str) -> tuple[Reals, Reals, NDArray[np.int64]]:
    """Readings, noise bounds and variables of the noise (-1: none) of a channel, each (N,)."""
    data, noise = result.formulation.data, result.formulation.noise
    group, channel = result.formulation.layout.group, int(signal[1:]) - 1
    output_reach, input_reach, _ = noise.bounds(data)
    if signal[0] == "u":
        return data.u[:, channel], input_reach[:, channel], group("xi")[:, channel]
    return data.y[:, channel], output_reach[:, channel], group("eta")[:, channel]


def _attained(
    result: FeasibleSet, name: str, readings: Reals, numbers: NDArray[np.int64]
) -> tuple[Reals, Reals]:
    """Find ends (K,) of a map over systems that are known; NaN where none is."""
    model, target, _ = _map_of(result, name)
    theta, values = result.formulation.layout.group("theta"), list[Reals]()
    seen = [np.asarray(w, float) for w in result.witnesses]
    if seen and not np.any(numbers >= 0):  # mixtures of them are consistent, too
        slopes, constant = map_slopes(model, target, readings)
        values = list(members(result) @ slopes.T + constant)
    for x in seen if not values else ():
        errors = np.where(numbers >= 0, x[np.maximum(numbers, 0)], 0.0)
        slopes, constant = map_slopes(model, target, readings - errors)
        values.append(slopes @ x[theta] + constant)
    found = np.array(values) if values else np.full((1, len(readings)), np.nan)
    return found.min(axis=0), found.max(axis=0)


def _spread(values: Reals, rows: NDArray[np.int64], samples: int) -> Reals:
    full = np.full(samples, np.nan)
    full[rows] = values
    return frozen(full)


def _unknown_band(result: FeasibleSet, name: str, numbers: NDArray[np.int64]) -> SignalBand:
    rows, samples = np.flatnonzero(numbers >= 0), numbers.size
    chosen = numbers[rows]
    low, high = result.problem.lower[chosen], result.problem.upper[chosen]
    over = simulated_ends(result.formulation, name, result.outer_box)
    if over is not None:
        low, high = np.maximum(low, over[0][rows]), np.minimum(high, over[1][rows])
    seen = result.witnesses
    values = np.array([w[chosen] for w in seen]) if seen else np.full((1, rows.size), np.nan)
    ends = (low, high, values.min(axis=0), values.max(axis=0))
    return SignalBand(name, *(_spread(end, rows, samples) for end in ends))
