"""Proved ranges of one output on one cell of the parameters: a Taylor form of order 2.

For one output with D(theta) y = N(theta) u + c + e let v be any numbers, close to the output at
a theta0, and d = y - v. Then D(theta) d = -r(theta), where the residual r of v is affine in
theta. With any numbers h, close to the impulse response of 1 / D(theta0), h * D(theta) =
1 + E(theta), and E is affine in the denominator's parameters. So

    d = d1 - E(theta) * d,    d1 = -h * r(theta).

On a cell the denominator's parameters are theta0 + T s with a small s, up to roundings, and
E = E0 + sum_j s_j E_j. One step further

    d2 = -sum_j s_j (E_j * d1),    d = d1 + d2 + e,    e = -E0 * d1 - E * d2 - E * e.

The ranges of d1 and of the factors of d2 are linear programs at each sample. With bounds l(k) of
abs(E(k)), by linear programs too, e is bounded sample by sample whatever the sum of l is. Where h
ends and that sum is below 1, e is bounded for all time, and every D(theta) of the cell is stable.
What was rounded in v and h is part of r and E; what is rounded in sums of products of n terms is
at most ``unit = 4 (n + ...) eps`` times the sum of their absolute values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.proofs.supports import Cover, Multipliers, supports
from setid.proofs.time_bands.rows import OutputRow

__all__ = [
    "Centre",
    "Enclosure",
    "Experiment",
    "Frame",
    "Leak",
    "enclosure",
    "leak",
    "noise_reach",
]

Reals = NDArray[np.float64]
Proposer = Callable[[Cover], Multipliers]
_EPS = float(np.finfo(float).eps)
_TINY = 1e-290  # more than everything that underflows
_SMALL = 2.0**-100  # of the largest number: what is smaller at the end is bounded together


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Inputs and first values of one output of a record.

    Parameters
    ----------
    row : OutputRow
    u : (N, nu) float
        Inputs, as they were read.
    first : (n,) float
        Readings from which the output starts; none from rest.
    start : (n,) float
        Bound of their noise.
    input_noise : (N, nu) float
        Bound of the noise in the inputs.
    errors : (N,) float
        Bound of the equation error.
    """

    row: OutputRow
    u: Reals
    first: Reals
    start: Reals
    input_noise: Reals
    errors: Reals

    @property
    def samples(self) -> int:
        """Number of samples after those from which the output starts."""
        return len(self.u) - self.first.size


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Coordinates s = rows theta[columns] of the denominator's parameters.

    Parameters
    ----------
    columns : (q,) int
    rows, back : (q, q) float
        Nearly inverse to each other; what is missing is bounded.
    """

    columns: NDArray[np.int64]
    rows: Reals
    back: Reals

    def directions(self, p: int) -> Reals:
        """State the coordinates as linear functions of theta, (q, p)."""
        found = np.zeros((len(self.rows), p))
        found[:, self.columns] = self.rows
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """Centre of an enclosure; any numbers will do, close ones give narrow ranges.

    Parameters
    ----------
    theta : (p,) float
        Parameters.
    outputs : (N,) float
        What the model gives with them; the first readings are put in place of the first ones.
    impulse : (K,) float
        Impulse response of 1 / D with them, as many as there are samples after the first ones;
        zero from a sample on where a bound for all time is wanted.
    """

    theta: Reals
    outputs: Reals
    impulse: Reals

    def fits(self, experiment: Experiment) -> bool:
        """Check that there is a number for every sample."""
        sizes = self.outputs.size, self.impulse.size
        return sizes == (len(experiment.u), experiment.samples)


class Leak(NamedTuple):
    """Bounds of h * D(theta) - 1 on a cell.

    Parameters
    ----------
    whole : (K,) float
        Of its absolute value, sample by sample.
    rest : (K,) float
        Of what the terms s_j E_j do not hold.
    slopes : (q, K) float
        E_j, as computed.
    lost : (K,) float
        Bound of the roundings of sum_j s_j E_j.
    spread : (2, q) float
        Least and largest s_j.
    """

    whole: Reals
    rest: Reals
    slopes: Reals
    lost: Reals
    spread: Reals

    @property
    def gain(self) -> float:
        """Sum of the bounds, rounded up."""
        return float(self.whole.sum() * (1.0 + 4 * (self.whole.size + 4) * _EPS))


class Enclosure(NamedTuple):
    """Ranges of one output, sample by sample.

    Parameters
    ----------
    low, high : (N,) float
        Of the model's output for the given inputs, without equation errors.
    driven_low, driven_high : (N,) float
        The same with equation errors within their bounds: of the system's output.
    later : (2,) float
        Of the model's output after the last sample, where the input and the outputs of the centre
        stay as they are at the end; infinite where nothing is proved.
    cost : (q, N) float
        What each coordinate adds to the width; for choices alone.
    """

    low: Reals
    high: Reals
    driven_low: Reals
    driven_high: Reals
    later: Reals
    cost: Reals


# ---- the leak ---------------------------------------------------------------------------


def leak(
    row: OutputRow,
    frame: Frame,
    box: tuple[Reals, Reals],
    cover: Cover,
    centre: Centre,
    proposer: Proposer,
) -> Leak:
    """Bound E(theta) = h * D(theta) - 1 on a cell.

    Parameters
    ----------
    row : OutputRow
    frame : Frame
    box : (low, high), each (q,) float
        Proved range of the coordinates on the cell.
    cover : Cover
        The cell.
    centre : Centre
    proposer : callable
    """
    h, theta, columns = centre.impulse, centre.theta, frame.columns
    unit = 8 * (len(row.feedback) + columns.size + 8) * _EPS
    slopes = np.zeros((columns.size, h.size))  # h * dD / dtheta_j
    size = np.zeros_like(slopes)
    own, total = np.zeros(h.size), np.zeros(h.size)
    for lag, factor in row.feedback.items():
        past = np.concatenate([np.zeros(lag), h[: max(h.size - lag, 0)]])[: h.size]
        slopes += factor.weights[columns][:, None] * past
        size += np.abs(factor.weights[columns][:, None]) * np.abs(past)
        own += factor.at(theta) * past
        total += (abs(factor.constant) + np.abs(factor.weights) @ np.abs(theta)) * np.abs(past)
    own[0] -= 1.0
    total[0] += 1.0
    constant = np.abs(own) + (4 * row.terms + 8) * _EPS * total  # abs of E at theta0
    away = np.maximum(cover.upper - theta, theta - cover.lower)[columns] * (1.0 + 4 * _EPS)
    constant += away @ (unit * size)  # slopes are rounded

    directions = np.zeros((h.size, theta.size))
    directions[:, columns] = slopes.T
    ranges = supports(cover, directions, proposer)
    at = directions @ theta
    slack = 4 * (theta.size + 8) * _EPS * (np.abs(directions) @ (np.abs(theta) + cover.magnitude))
    whole = np.maximum(ranges[:, 1] - at, at - ranges[:, 0]) + slack + constant
    whole = np.maximum(whole, 0.0) * (1.0 + 8 * _EPS) + _TINY

    turned, spread, missing = _coordinates(frame, box, cover, theta)
    rotated = turned @ slopes
    lost = (unit * np.abs(spread).max(axis=0)) @ (np.abs(turned) @ size)
    rest = (constant + missing @ size) * (1.0 + unit) + _TINY
    if row.leads_with_one and h[0] == 1.0:
        whole[0] = rest[0] = lost[0] = 0.0  # exactly: the other lags are at least 1
    return Leak(whole, rest, rotated, lost * (1.0 + unit) + _TINY, spread)


def _coordinates(
    frame: Frame, box: tuple[Reals, Reals], cover: Cover, theta: Reals
) -> tuple[Reals, Reals, Reals]:
    """T', ranges of s - (any origin), and bounds of theta - theta0 - T s, all in columns.

    With g = G theta0 as computed, s_j - g_j is in the box less g_j, and what T (s - g) misses of
    theta - theta0 is (1 - T G) (theta - theta0) + T (g - G theta0).
    """
    q, here = frame.columns.size, theta[frame.columns]
    origin = frame.rows @ here
    spread = np.stack(
        [np.nextafter(box[0] - origin, -np.inf), np.nextafter(box[1] - origin, np.inf)]
    )
    away = np.maximum(cover.upper - theta, theta - cover.lower)[frame.columns]
    unit = 8 * (q + 8) * _EPS
    product = np.abs(frame.back) @ np.abs(frame.rows)
    gap = np.abs(np.eye(q) - frame.back @ frame.rows) + unit * (np.eye(q) + product)
    missing = gap @ (away * (1.0 + unit)) + unit * (product @ np.abs(here))
    return frame.back.T, spread, missing * (1.0 + unit)


# ---- the output -------------------------------------------------------------------------


def enclosure(
    experiment: Experiment, cover: Cover, centre: Centre, known: Leak, proposer: Proposer
) -> Enclosure:
    """Bound the output on a cell, from a bound of the leak there.

    Parameters
    ----------
    experiment : Experiment
        With at least one sample after the first ones.
    cover : Cover
        The cell.
    centre : Centre
    known : Leak
        Of the same cell and centre.
    proposer : callable
    """
    row, begun = experiment.row, experiment.first.size
    count, h = experiment.samples, centre.impulse
    v = centre.outputs.copy()
    v[:begun] = experiment.first
    own, regressors, size = row.residual(v, experiment.u, cover)
    factors = max((len(term.inputs) for term in row.others), default=0)
    unit = 4 * (count + 4 * regressors.shape[1] + factors + 16) * _EPS
    columns = np.column_stack([own, regressors])[begun:]
    first = -np.stack([_convolved(h, column) for column in columns.T], axis=1)
    doubt = unit * _convolve_up(np.abs(h), size[begun:])

    one = _ranges(first, cover, proposer)
    second, cost = np.zeros((count, 2)), np.zeros((len(known.slopes), count))
    lost, summed = np.zeros(count), np.zeros((count, 2))
    reach = np.abs(first[:, 0]) + np.abs(first[:, 1:]) @ cover.magnitude
    for j, slope in enumerate(known.slopes):
        product = -np.stack([_convolved(slope, x) for x in first.T], axis=1)
        ends = _products(known.spread[:, j], _ranges(product, cover, proposer))
        second += ends
        summed += np.abs(ends)
        cost[j] = ends[:, 1] - ends[:, 0]
        most = float(np.abs(known.spread[:, j]).max())
        lost += most * (2 * unit) * _convolve_up(np.abs(slope), reach)
    second += 4 * len(cost) * _EPS * summed * np.array([-1.0, 1.0])

    sizes = _largest(one) + doubt
    drive = doubt + lost + _convolve_up(known.rest + known.lost, sizes)
    drive += _convolve_up(known.whole, _largest(second) + lost)
    noise = noise_reach(experiment, (cover.lower, cover.upper), centre.theta, h)
    errors = _convolve_up(np.abs(h), experiment.errors[begun:])
    grow = 1.0 + 16 * _EPS
    rests = [(drive + extra) * grow + _TINY for extra in (noise, (noise + errors) * grow)]
    spans = [_with_leak(rest, known.whole) for rest in rests]
    joined = one + second
    joined += 8 * _EPS * (np.abs(one) + np.abs(second)) * np.array([-1.0, 1.0])
    found = [_outside(v[begun:], joined, span) for span in spans]
    later = _NOTHING
    if not np.any(noise):
        bounds = np.stack([doubt, lost, sizes, _largest(second), spans[0]])
        later = _later(experiment, centre, known, joined[-1], bounds)
    cost += _shares(known) * spans[0] * 2.0
    return _assembled(experiment, found, later, cost)


def noise_reach(experiment: Experiment, box: tuple[Reals, Reals], theta: Reals, h: Reals) -> Reals:
    """Bound what noise in inputs and first outputs does to the output, where E is left out.

    Parameters
    ----------
    experiment : Experiment
    box : (lower, upper), each (p,) float
        Of the parameters.
    theta : (p,) float
        Any numbers, close to the box.
    h : (K,) float

    Returns
    -------
    (K,) float
        Bound of abs(h * (what noise adds to the residual)); 0 without noise.
    """
    found = np.zeros(experiment.samples)
    if np.any(experiment.start) or np.any(experiment.input_noise):
        away = np.maximum(box[1] - theta, theta - box[0]) * (1.0 + 4 * _EPS)
        most = np.maximum(np.abs(box[0]), np.abs(box[1]))
        found += _start_reach(experiment, theta, h, away)
        for channel in range(experiment.u.shape[1]):
            found += _input_reach(experiment, channel, (theta, away, most), h)
        found += _product_reach(experiment, most, h)
        found = found * (1.0 + 16 * _EPS) + _TINY
    return found


def _start_reach(experiment: Experiment, theta: Reals, h: Reals, away: Reals) -> Reals:
    """Reach of noise in the first outputs: abs(h * D(theta0) w), and h times the rest of D."""
    row, begun, count = experiment.row, experiment.first.size, experiment.samples
    found = np.zeros(count)
    for i, bound in enumerate(experiment.start):
        middle, off = np.zeros(count), np.zeros(count)
        for lag, factor in row.feedback.items():
            k = lag - (begun - i)
            if 0 <= k < count:
                size = abs(factor.constant) + np.abs(factor.weights) @ np.abs(theta)
                middle[k] = factor.at(theta)
                off[k] = np.abs(factor.weights) @ away * (1.0 + 1e-12)
                off[k] += (4 * row.terms + 8) * _EPS * size
        found += bound * _reach(h, middle, off, count)
    return found


def _input_reach(
    experiment: Experiment, channel: int, ends: tuple[Reals, Reals, Reals], h: Reals
) -> Reals:
    """Reach of noise in one input, the samples before the first residual taken apart."""
    (theta, away, most), count = ends, experiment.samples
    bound, begun = experiment.input_noise[:, channel], experiment.first.size
    middle, off, early = np.zeros(count), np.zeros(count), np.zeros(count)
    terms = [t for t in experiment.row.others if [at for at, _ in t.inputs] == [channel]]
    for column, coefficient, ((_, lag),) in terms:
        value, spread, size = abs(coefficient), 0.0, abs(coefficient)
        if column is not None:
            value, spread = value * abs(theta[column]), size * away[column]
            size = size * most[column]
        if lag < count:
            middle[lag] += coefficient * (1.0 if column is None else theta[column])
            off[lag] += (spread + 8 * _EPS * value) * (1.0 + 8 * _EPS)
        for k in range(min(lag, begun, count)):
            early[k] += size * bound[begun + k - lag]
    off += 4 * (len(terms) + 4) * _EPS * (np.abs(middle) + off)
    reach = _reach(h, middle, off, count)
    return _convolve_up(reach, bound[begun:]) + _convolve_up(np.abs(h), early * (1.0 + 1e-12))


def _product_reach(experiment: Experiment, most: Reals, h: Reals) -> Reals:
    """Reach of noise in products of inputs: abs(h) times what it may change each by."""
    found = np.zeros(len(experiment.u))
    larger = np.abs(experiment.u) + experiment.input_noise
    for term in experiment.row.others:
        if len(term.inputs) > 1:
            size = abs(term.coefficient) * (1.0 if term.column is None else most[term.column])
            with_noise, without = term.values(larger), np.abs(term.values(experiment.u))
            change = with_noise - without + 8 * len(term.inputs) * _EPS * with_noise
            noisy = np.any([experiment.input_noise[:, at] > 0 for at, _ in term.inputs])
            found += size * change if noisy else 0.0
    grow = 1.0 + 8 * (len(experiment.row.others) + 4) * _EPS
    return _convolve_up(np.abs(h), found[experiment.first.size :] * grow)


def _reach(h: Reals, middle: Reals, off: Reals, count: int) -> Reals:
    """Bound of abs(h * x) over all x with abs(x - middle) <= off."""
    unit = 4 * (count + 8) * _EPS
    size = _convolve_up(np.abs(h), off + unit * np.abs(middle))
    return np.asarray(np.abs(_convolved(h, middle)) + size, np.float64)


_NOTHING = np.array([-np.inf, np.inf])


def _ranges(functions: Reals, cover: Cover, proposer: Proposer) -> Reals:
    """Ranges (K, 2) of functions[:, 0] + functions[:, 1:] theta."""
    ends = supports(cover, functions[:, 1:], proposer)
    found = functions[:, :1] + ends
    wide = 4 * _EPS * (np.abs(functions[:, :1]) + np.abs(ends))
    return np.asarray(found + wide * np.array([-1.0, 1.0]), np.float64)


def _products(s: Reals, ends: Reals) -> Reals:
    """Ranges (K, 2) of products of a number in s (2,) and one in each of the ranges (K, 2)."""
    corners = np.stack([s[0] * ends[:, 0], s[0] * ends[:, 1], s[1] * ends[:, 0], s[1] * ends[:, 1]])
    found = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
    return np.asarray(found + 2 * _EPS * np.abs(found) * np.array([-1.0, 1.0]), np.float64)


def _largest(ends: Reals) -> Reals:
    return np.asarray(np.abs(ends).max(axis=1), np.float64)


def _convolved(left: Reals, right: Reals) -> Reals:
    """Convolution as long as the second sequence; zeros at the end of the first are left out."""
    return np.convolve(left[: max(_length(left), 1)], right)[: right.size]


def _length(sequence: Reals, share: float = 0.0) -> int:
    """Samples before all that follows is at most a share of the largest absolute value."""
    size = np.abs(sequence)
    small = share * size.max(initial=0.0) if share else 0.0
    large = np.flatnonzero(~(size <= small))  # NaN counts as large
    return int(large[-1]) + 1 if large.size else 0


def _convolve_up(left: Reals, right: Reals) -> Reals:
    """Convolution of non-negative sequences, rounded up, as long as the second.

    The first one's small end counts as the largest number in it.
    """
    count = max(_length(left, _SMALL), 1)
    found = np.convolve(left[:count], right)[: right.size]
    most = left[count:].max(initial=0.0)
    if most > 0.0 and count < right.size:
        found[count:] += most * np.cumsum(right)[: right.size - count]
    return np.maximum(found, 0.0) * (1.0 + 4 * (right.size + 4) * _EPS) + _TINY


def _with_leak(rest: Reals, whole: Reals) -> Reals:
    """Bounds e of abs(e(k)) <= rest(k) + sum_i whole(i) abs(e(k-i)), rounded up.

    The leak's small end counts as the largest number in it.
    """
    found = np.empty(rest.size)
    grow = 1.0 + 4 * (rest.size + 8) * _EPS
    left = np.nextafter(1.0 - whole[0], -np.inf)
    if not left > 0.0:
        return np.full(rest.size, np.inf)
    count = max(_length(whole, _SMALL), 1)
    most, before = float(whole[count:].max(initial=0.0)), 0.0
    back = whole[1:count][::-1].copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(rest.size):
            before += found[k - count] if k >= count else 0.0
            begin = max(k - count + 1, 0)
            near = back[back.size - (k - begin) :] @ found[begin:k]
            found[k] = (rest[k] + near + most * before) / left * grow
    return np.where(np.isnan(found), np.inf, found)


def _outside(v: Reals, ends: Reals, span: Reals) -> tuple[Reals, Reals]:
    """Round v + ends +- span outwards."""
    wide = span + 8 * _EPS * (np.abs(v)[:, None] + np.abs(ends)).max(axis=1)
    wide = np.nextafter(wide * (1.0 + 4 * _EPS), np.inf)
    return (
        np.nextafter(v + ends[:, 0] - wide, -np.inf),
        np.nextafter(v + ends[:, 1] + wide, np.inf),
    )


def _later(
    experiment: Experiment, centre: Centre, known: Leak, last: Reals, bounds: Reals
) -> Reals:
    """Range of the output after the last sample, where everything that drives it has settled.

    Residual and d1 have been the same for as many samples as h and E are long. From the last
    sample on d1 and d2 are taken to be what was computed for it, which differs from what was
    computed before by roundings. So abs(e) is at most what it was before, or what drives it over
    1 - gain. The bounds are those of these roundings, of d1, d2 and e, sample by sample.
    """
    h, gain = centre.impulse, known.gain
    length = int(np.flatnonzero(h)[-1]) + 1 if np.any(h) else 1
    lag = max(experiment.row.lag, *(term.lag for term in experiment.row.others), 1)
    window = length + lag
    ends = np.column_stack([centre.outputs, experiment.u])[-2 * window - lag - 1 :]
    settled = len(ends) == 2 * window + lag + 1 and bool(np.all(ends == ends[-1]))
    if not gain < 1.0 or not settled or experiment.samples < len(ends):
        return _NOTHING
    doubt, lost, one, two, span = bounds[:, -window:].max(axis=1)
    turned = np.abs(known.spread).max(axis=0) @ np.abs(known.slopes).sum(axis=1)
    drive = doubt + lost + float((known.rest + known.lost).sum()) * one
    drive += gain * (two + lost) + 2.0 * turned * doubt
    rest = float(np.nextafter(1.0 - gain, -np.inf))
    most = np.maximum(span, drive / rest) * (1.0 + 1e-9)
    low, high = _outside(centre.outputs[-1:], last[None, :], np.array([most]))
    found = np.array([low[0], high[0]])
    return found if np.all(np.isfinite(found)) else _NOTHING


def _shares(known: Leak) -> Reals:
    """Share of each coordinate in the leak, (q, 1)."""
    each = np.abs(known.spread).max(axis=0)[:, None] * np.abs(known.slopes)
    total = each.sum(axis=1, keepdims=True)
    return np.asarray(total / max(float(total.sum()), _TINY), np.float64)


def _assembled(
    experiment: Experiment, found: list[tuple[Reals, Reals]], later: Reals, cost: Reals
) -> Enclosure:
    """The first samples in front of the others; infinite ranges where numbers overflow."""
    first, start = experiment.first, experiment.start
    begun = np.nextafter(first - start, -np.inf), np.nextafter(first + start, np.inf)
    ends = [
        np.concatenate([begun[side], values]) for pair in found for side, values in enumerate(pair)
    ]
    signs = (-np.inf, np.inf) * 2
    ends = [np.where(np.isnan(x), sign, x) for x, sign in zip(ends, signs, strict=True)]
    shown = np.concatenate([np.zeros((len(cost), first.size)), cost], axis=1)
    return Enclosure(ends[0], ends[1], ends[2], ends[3], later, shown)
