"""Noise-free samples as what is known plus at most one unknown each, and their ranges.

At sample k a signal is ``known[k] + slope[k] * x[variable[k]]``: a measured output with
noise is ``y~ - eta``, an exact input ``u~``, a missing sample or an internal signal its
own unknown. Whatever lies before the record is zero (and only used when that is assumed).

Ranges of missing samples are those that the user gives, or what the row of the sample implies:
the equation of a missing output y_k bounds it where every other sample in the row has a range
and every parameter in it is bounded by a prior. Such a range follows from the formulation, so
it is no assumption. Missing inputs need a range from the user.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, nextafter

import numpy as np
from numpy.typing import NDArray

from setid.data.noise import NoiseBounds
from setid.data.record import IOData
from setid.models.checked_structures import regression_of
from setid.models.equations import Equation, Lagged, Structure, Term, channel_of
from sparsepop_py.verified.arithmetic.scalar_interval import plus

__all__ = ["Ball", "Signal", "internal_range", "measured", "missing_ranges", "product", "unknown"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
_ULPS = 8 * np.finfo(float).eps  # more than the rounding of one product of balls


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """Ranges centre +- radius, shape (R,) each; the radius may be infinite."""

    centre: Reals
    radius: Reals


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Samples of one signal, arrays of shape (N,)."""

    known: Reals
    slope: Reals
    variable: Integers  # -1 where there is none; then the slope is 0
    centre: Reals
    radius: Reals

    def at(self, rows: Integers, lag: int, first: Integers) -> tuple[Reals, Reals, Integers]:
        """Take known part, slope and variable ``lag`` samples before the rows."""
        place, inside = _places(rows, lag, first)
        return (
            np.where(inside, self.known[place], 0.0),
            np.where(inside, self.slope[place], 0.0),
            np.where(inside, self.variable[place], -1),
        )

    def ball(self, rows: Integers, lag: int, first: Integers) -> Ball:
        """Take the range ``lag`` samples before the rows."""
        place, inside = _places(rows, lag, first)
        return Ball(
            np.where(inside, self.centre[place], 0.0), np.where(inside, self.radius[place], 0.0)
        )


def _places(rows: Integers, lag: int, first: Integers) -> tuple[Integers, NDArray[np.bool_]]:
    place = rows - lag
    inside = place >= first[rows]
    return np.where(inside, place, 0), inside


def measured(
    values: Reals,
    bound: Reals,
    noise: Integers,
    missing: Integers,
    limits: Reals,
) -> Signal:
    """Make the signal of a measured channel.

    Parameters
    ----------
    values : (N,) float
        NaN where missing.
    bound : (N,) float
        Of the noise.
    noise, missing : (N,) int
        Variables of noise and of missing samples, -1 for none.
    limits : (N, 2) float
        Ranges of missing samples, infinite where there are none.
    """
    gone = np.isnan(values)
    given = np.where(gone, 0.0, values)
    centre, radius = _ball(limits[:, 0], limits[:, 1])
    return Signal(
        known=given,
        slope=np.where(missing >= 0, 1.0, np.where(noise >= 0, -1.0, 0.0)),
        variable=np.where(missing >= 0, missing, noise),
        centre=np.where(gone, centre, given),
        radius=np.where(gone, radius, bound),
    )


def unknown(variable: Integers, low: Reals, high: Reals) -> Signal:
    """Make a signal that nobody measures, with the range of each sample."""
    centre, radius = _ball(low, high)
    present = variable >= 0
    return Signal(np.zeros(variable.size), present.astype(float), variable, centre, radius)


def _ball(low: Reals, high: Reals) -> tuple[Reals, Reals]:
    """Centre and radius that cover [low, high]; exact for points."""
    finite = np.isfinite(low) & np.isfinite(high)
    safe_low, safe_high = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
    centre = safe_low / 2 + safe_high / 2
    radius = np.maximum(safe_high - centre, centre - safe_low)
    radius = np.where(safe_low == safe_high, 0.0, np.nextafter(radius, np.inf))
    return centre, np.where(finite, radius, np.inf)


def product(
    factors: tuple[Lagged, ...],
    signals: Mapping[str, Signal],
    rows: Integers,
    first: Integers,
    coefficient: float = 1.0,
) -> Ball:
    """Enclose coefficient * product of lagged signals at the rows.

    A single factor without a coefficient keeps its ball exactly; the radius of others is
    rounded up, and products of several are rounded outwards. The centres become
    the coefficients of the rows. Equal factors are taken as one power.
    """
    centre, radius = np.full(rows.size, coefficient), np.zeros(rows.size)
    exact = centre  # multiplied in the order in which rows are, for factors without a radius
    powers = {factor: factors.count(factor) for factor in factors}
    for factor, power in powers.items():
        ball = signals[factor.signal].ball(rows, factor.lag, first)
        if len(factors) == 1:
            return Ball(coefficient * ball.centre, _times(abs(coefficient), ball.radius))
        raised = _power(ball, power)
        with np.errstate(invalid="ignore"):
            spread = (
                np.abs(centre) * raised.radius
                + radius * np.abs(raised.centre)
                + radius * raised.radius
            )
        centre = centre * raised.centre
        slack = np.where(spread > 0, _ULPS * (np.abs(centre) + spread), 0.0)
        radius = np.nan_to_num(spread + slack, nan=np.inf, posinf=np.inf)
    for factor in factors:
        exact = exact * signals[factor.signal].ball(rows, factor.lag, first).centre
    return Ball(np.where(radius == 0, exact, centre), radius)


def _times(size: float, radius: Reals) -> Reals:
    """Product, rounded up where it may be rounded."""
    product_ = size * radius
    if size == 1.0:
        return product_
    return np.where(product_ > 0, np.nextafter(product_, np.inf), product_)


def _power(ball: Ball, power: int) -> Ball:
    """Range of x^power, rounded outwards."""
    if power == 1:
        return ball
    centre = ball.centre.copy()
    for _ in range(power - 1):
        centre = centre * ball.centre
    low, high = ball.centre - ball.radius, ball.centre + ball.radius
    ends = np.sort(np.stack([low**power, high**power]), axis=0)
    least = np.where((power % 2 == 0) & (low <= 0) & (high >= 0), 0.0, ends[0])
    grow = power * _ULPS * np.abs(ends).max(axis=0)
    finite = np.isfinite(ball.radius)
    middle, radius = _ball(
        np.where(finite, least - grow, -np.inf), np.where(finite, ends[1] + grow, np.inf)
    )
    point = ball.radius == 0
    return Ball(np.where(point, centre, middle), np.where(point, 0.0, radius))


def internal_range(
    equation: Equation, signals: Mapping[str, Signal], rows: Integers, first: Integers
) -> tuple[Reals, Reals]:
    """Enclose the signal that an equation without parameters defines, at the rows."""
    low, high = np.zeros(rows.size), np.zeros(rows.size)
    for item in equation.terms[1:]:
        ball = product(item.signals, signals, rows, first, -item.coefficient)
        below = np.nextafter(low + np.nextafter(ball.centre - ball.radius, -np.inf), -np.inf)
        above = np.nextafter(high + np.nextafter(ball.centre + ball.radius, np.inf), np.inf)
        gone = _rests(item.signals, signals, rows, first)
        low, high = np.where(gone, low, below), np.where(gone, high, above)
    return low, high


def _rests(
    factors: tuple[Lagged, ...], signals: Mapping[str, Signal], rows: Integers, first: Integers
) -> NDArray[np.bool_]:
    """Find rows at which a factor is exactly 0, such as a sample before the record."""
    balls = [signals[factor.signal].ball(rows, factor.lag, first) for factor in factors]
    return np.any([(ball.centre == 0.0) & (ball.radius == 0.0) for ball in balls], axis=0)


Interval = tuple[float, float]


def missing_ranges(
    data: IOData, model: Structure, bounds: NoiseBounds, parameters: Mapping[str, Interval]
) -> dict[str, NDArray[np.float64]]:
    """Take low and high ends for the missing samples of each measured signal.

    Parameters
    ----------
    data : IOData
    model : Structure
    bounds : NoiseBounds
    parameters : mapping of str to (low, high)
        What priors say of the parameters.

    Returns
    -------
    mapping of str to (N, 2) float
        Infinite ends where nothing is known, and for samples that are not missing.
    """
    found = {}
    groups = (("y", data.y, data.y_range), ("u", data.u, data.u_range))
    for letter, values, limits in groups:
        for channel in range(values.shape[1]):
            table = np.tile([-inf, inf], (data.samples, 1))
            if limits is not None:
                table[np.isnan(values[:, channel])] = limits[channel]
            found[f"{letter}{channel + 1}"] = table
    equations = {equation.defines: equation for equation in regression_of(model)}
    for sample, channel in np.argwhere(np.isnan(data.y)).tolist():
        equation = equations.get(f"y{channel + 1}")
        if equation is None or (
            model.initial == "free" and sample - equation.lag < data.first[sample]
        ):
            continue
        low, high = _implied(equation, sample, data, bounds, parameters, found)
        table = found[equation.defines]
        table[sample] = max(low, table[sample, 0]), min(high, table[sample, 1])
    return found


def _implied(
    equation: Equation,
    sample: int,
    data: IOData,
    bounds: NoiseBounds,
    parameters: Mapping[str, Interval],
    ranges: Mapping[str, NDArray[np.float64]],
) -> Interval:
    """Range of the defined sample: minus the other terms, plus the equation error."""
    error = float(bounds.equation[sample, equation.output])
    total = (-error, error)
    for item in equation.terms[1:]:
        factors = [parameters.get(name, (-inf, inf)) for name in item.parameters]
        factors += [_signal(s, sample, data, bounds, ranges) for s in item.signals]
        if not all(isfinite(low) and isfinite(high) for low, high in factors):
            return (-inf, inf)
        total = plus(total, _product(item, factors))
    return total


def _signal(
    lagged: Lagged,
    sample: int,
    data: IOData,
    bounds: NoiseBounds,
    ranges: Mapping[str, NDArray[np.float64]],
) -> Interval:
    place = sample - lagged.lag
    if place < data.first[sample]:
        return (0.0, 0.0)
    found = channel_of(lagged.signal)
    if found is None:
        return (-inf, inf)
    output, channel = found[0] == "y", found[1]
    value = float((data.y if output else data.u)[place, channel])
    if np.isnan(value):
        low, high = ranges[lagged.signal][place].tolist()
        return low, high
    width = float((bounds.output if output else bounds.input)[place, channel])
    return (value, value) if width == 0.0 else plus((value, value), (-width, width))


def _product(item: Term, factors: list[Interval]) -> Interval:
    low, high = -item.coefficient, -item.coefficient
    for a, b in factors:
        ends = (low * a, low * b, high * a, high * b)
        low, high = nextafter(min(ends), -inf), nextafter(max(ends), inf)
    return low, high
