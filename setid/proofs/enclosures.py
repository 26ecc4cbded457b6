"""Proved ranges of the outputs of linear models over the feasible parameter set.

For one output with D(theta) y = N(theta) u + c + e let v be computed with a nominal theta
and d = y - v. Then D(theta) d = r(theta), the residual of v, is affine in theta. With h the
computed impulse response of 1 / D at the nominal parameters, h * D(theta) = 1 + E(theta)
with a small E, so that

    d = h * r(theta) - E(theta) * d.

The first part is affine in theta: its range over the feasible set is proved by linear
programs. The second is bounded sample by sample by what came before (and, where D begins
with parameters, by what d may be now). Whatever was rounded
in v and h is part of r and E, so that the result is a proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.data.checks import frozen
from setid.data.record import IOData
from setid.errors import ModelError, SetidError
from setid.models.equations import Equation, Lagged, Structure, channel_of
from setid.proofs.supports import Cover, Multipliers, supports

__all__ = ["Enclosure", "Nominal", "enclose"]

Reals = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Enclosure:
    """Ranges of one output, sample by sample.

    Parameters
    ----------
    nominal : (N,) float
    low, high : (N,) float
        Proved range of the model's output for the given inputs, without equation errors.
    driven_low, driven_high : (N,) float
        The same with equation errors within their bounds: of the system's output.
    """

    nominal: Reals
    low: Reals
    high: Reals
    driven_low: Reals
    driven_high: Reals


class _Affine(NamedTuple):
    """A coefficient constant + weights'theta."""

    constant: float
    weights: Reals

    def largest(self, cover: Cover) -> float:
        """Its largest absolute value over the box, up to rounding."""
        middle = self.constant + self.weights @ cover.centre
        return float(abs(middle) + np.abs(self.weights) @ cover.spread)

    def size(self, cover: Cover) -> float:
        """Sum of the absolute values in it, for rounding errors."""
        return float(abs(self.constant) + np.abs(self.weights) @ cover.magnitude)


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One equation as lags: sum over i >= 0 of D_i y(k-i) + sum b s(k-j) == e."""

    feedback: dict[int, _Affine]  # by lag; that of lag 0 is there
    others: list[tuple[int, float, str, int]]  # parameter, coefficient, signal or "", lag

    @property
    def terms(self) -> int:
        """Number of products in a coefficient of the feedback, for rounding errors."""
        return sum(1 + int(np.count_nonzero(a.weights)) for a in self.feedback.values())


@dataclass(frozen=True, slots=True, eq=False)
class Nominal:
    """Centre of an enclosure; any numbers will do, close ones give narrow ranges.

    Parameters
    ----------
    theta : (p,) float
        Nominal parameters.
    outputs : (N, ny) float
        What the model gives with them for the inputs of the record.
    proposer : callable
        Source of multipliers for the rows of a cover, as of :func:`setid.proofs.supports.supports`.
    """

    theta: Reals
    outputs: Reals
    proposer: Callable[[Cover], Multipliers]


def enclose(
    model: Structure,
    around: Nominal,
    cover: Cover,
    data: IOData,
    noise: tuple[Reals, Reals, Reals] | None = None,
    from_rest: bool = False,
) -> list[Enclosure]:
    """Bound all outputs for the inputs of one record or several.

    Parameters
    ----------
    model : Structure
        Linear, with one denominator an output.
    around : Nominal
        Not trusted.
    cover : Cover
        A finite one.
    data : IOData
        Inputs are readings; without ``from_rest`` the first outputs are too.
    noise : bounds of output noise, input noise and equation error, optional
        As :meth:`Noise.bounds` gives them; none when left out.
    from_rest : bool
        All signals are zero before the record.

    Returns
    -------
    list of Enclosure
        One an output.

    Raises
    ------
    SetidError
        If the structure does not allow it or the cover is not finite.
    """
    equations = model.regression()
    if not equations:
        raise ModelError(
            "model: separate denominators have no proved bands; use kind='sampled', or a "
            "common denominator"
        )
    if not np.all(np.isfinite(cover.lower) & np.isfinite(cover.upper)):
        raise SetidError(
            "result: found an infinite interval, expected finite ones for proved bands; "
            "give priors such as Box or Stable"
        )
    rows = [_row_of(equation, model) for equation in equations]
    bounds = noise or (np.zeros(data.y.shape), np.zeros(data.u.shape), np.zeros(data.y.shape))
    first = 0 if from_rest else max(e.lag for e in equations)
    edges = [*data.starts.tolist(), data.samples]
    found: list[Enclosure] = []
    for i, row in enumerate(rows):
        pieces = []
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            part = slice(begin, end)
            start = np.zeros(0) if from_rest else bounds[0][part, i][:first]
            v = around.outputs[part, i].copy()
            v[: start.size] = data.y[part, i][: start.size]
            u, errors = data.u[part], (bounds[1][part], bounds[2][part, i])
            pieces.append(_one_record(row, around, cover, v, u, start, errors))
        joined = np.concatenate(pieces, axis=1)
        none = np.isnan(joined)  # where numbers overflow nothing is proved
        joined = np.where(none, np.array([-np.inf, np.inf, -np.inf, np.inf])[:, None], joined)
        found.append(
            Enclosure(frozen(around.outputs[:, i].copy()), *(frozen(x.copy()) for x in joined))
        )
    return found


def _row_of(equation: Equation, model: Structure) -> _Row:
    place = {name: column for column, name in enumerate(model.parameters)}
    feedback: dict[int, _Affine] = {}
    others = []
    for term in equation.terms:
        signal = term.signals[0] if term.signals else Lagged("")
        own = signal.signal == equation.defines
        if len(term.signals) > 1 or len(term.parameters) > 1 or not (own or term.parameters):
            raise ModelError("model: found products, expected a linear structure for proved bands")
        if own:
            before = feedback.get(signal.lag, _Affine(0.0, np.zeros(len(place))))
            constant, weights = before.constant, before.weights.copy()
            if term.parameters:
                weights[place[term.parameters[0]]] += term.coefficient
            else:
                constant += term.coefficient
            feedback[signal.lag] = _Affine(constant, weights)
            continue
        column = place[term.parameters[0]]
        if not signal.signal or (signal.signal[0] == "u" and channel_of(signal.signal)):
            others.append((column, term.coefficient, signal.signal, signal.lag))
        else:
            raise ModelError("model: found coupled outputs, expected one denominator an output")
    return _Row(feedback, others)


def _one_record(
    row: _Row,
    around: Nominal,
    cover: Cover,
    v: Reals,
    u: Reals,
    start: Reals,
    noise: tuple[Reals, Reals],
) -> Reals:
    """low, high, driven_low, driven_high as (4, N)."""
    count, first = v.size, start.size
    begun = np.nextafter(v[:first] - start, -np.inf), np.nextafter(v[:first] + start, np.inf)
    if count == first:  # a record that is over before any equation is complete
        return np.stack([*begun, *begun])
    h = _impulse_response(row, around.theta, count - first)
    leak = _leak(row, cover, h)
    own, regressors, size = _residual(row, v, u, cover)
    constant, weights, doubt = _filtered(h, own[first:], regressors[first:], size[first:])
    ranges = -supports(cover, weights, around.proposer)[:, ::-1] - constant[:, None]
    ranges += np.stack([-doubt, doubt], axis=1)
    push = _input_push(row, cover, noise[0], count)[first:]
    push += _start_push(row, cover, start, count - first)
    errors = noise[1][first:]
    result = np.empty((4, count))
    result[:2, :first] = result[2:, :first] = np.stack(begun)
    for place, drive in ((0, push), (2, push + errors)):
        width = _convolve_up(np.abs(h), drive)
        spread = _with_leak(ranges, width, leak)
        low = np.nextafter(v[first:] + ranges[:, 0] - spread, -np.inf)
        high = np.nextafter(v[first:] + ranges[:, 1] + spread, np.inf)
        result[place, first:], result[place + 1, first:] = low, high
    return result


def _impulse_response(row: _Row, theta: Reals, count: int) -> Reals:
    h = np.zeros(max(count, 1))
    lead = row.feedback[0].constant + row.feedback[0].weights @ theta
    h[0] = 1.0 / lead  # simulation has refused zero
    for k in range(1, count):
        for lag, factor in row.feedback.items():
            if 0 < lag <= k:
                h[k] -= (factor.constant + factor.weights @ theta) * h[k - lag] / lead
    return h


def _leak(row: _Row, cover: Cover, h: Reals) -> Reals:
    """Bounds of abs(E): of h * D(theta) - 1 over the box, shape of h."""
    middle, spread, size = np.zeros(h.size), np.zeros(h.size), np.zeros(h.size)
    for lag, factor in row.feedback.items():
        shifted = np.concatenate([np.zeros(lag), h[: h.size - lag]])[: h.size]
        middle += (factor.constant + factor.weights @ cover.centre) * shifted
        spread += (np.abs(factor.weights) @ cover.spread) * np.abs(shifted)
        size += factor.size(cover) * np.abs(shifted)
    middle[0] -= 1.0
    leak = np.abs(middle) + spread + 4 * (row.terms + 4) * _EPS * size
    if not np.any(row.feedback[0].weights):
        leak[0] = 0.0  # h[0] is exactly 1 and the other lags are at least 1
    return leak


def _residual(row: _Row, v: Reals, u: Reals, cover: Cover) -> tuple[Reals, Reals, Reals]:
    """The residual of v as own (N,) + regressors (N, p) theta, with its size (N,).

    Zeros before the record.
    """
    own, found = np.zeros(v.size), np.zeros((v.size, cover.centre.size))
    size = np.zeros(v.size)
    for lag, factor in row.feedback.items():
        past = v[: v.size - lag]
        own[lag:] += factor.constant * past
        found[lag:] += past[:, None] * factor.weights
        size[lag:] += np.abs(past) * factor.size(cover)
    for column, coefficient, signal, lag in row.others:
        values = np.ones(v.size - lag)
        if signal:
            channel = channel_of(signal)
            assert channel is not None
            values = u[: v.size - lag, channel[1]]
        found[lag:, column] += coefficient * values
        size[lag:] += abs(coefficient) * np.abs(values) * cover.magnitude[column]
    return own, found, size


def _filtered(h: Reals, own: Reals, regressors: Reals, size: Reals) -> tuple[Reals, Reals, Reals]:
    """Sequences h*own (N,) and h*regressors (N, p), and a bound of their rounding (N,)."""
    count = own.size
    constant = np.convolve(h, own)[:count]
    weights = np.stack([np.convolve(h, column)[:count] for column in regressors.T], axis=1)
    doubt = np.convolve(np.abs(h), size)[:count]
    return constant, weights, 4 * (count + 4 * regressors.shape[1] + 16) * _EPS * doubt


def _input_push(row: _Row, cover: Cover, bound: Reals, count: int) -> Reals:
    """Effect of input noise on the residual, shape (N,)."""
    push = np.zeros(count)
    for column, coefficient, signal, lag in row.others:
        channel = channel_of(signal)
        if channel is not None:
            size = abs(coefficient) * cover.magnitude[column]
            push[lag:] += size * bound[: count - lag, channel[1]]
    return push


def _start_push(row: _Row, cover: Cover, start: Reals, count: int) -> Reals:
    """Effect of noise in the first outputs on later residuals, shape (N - first,)."""
    push = np.zeros(count)
    for lag, factor in row.feedback.items():
        largest = factor.largest(cover) + 4 * (row.terms + 4) * _EPS * factor.size(cover)
        for k in range(min(lag, count)):
            place = start.size + k - lag
            if 0 <= place < start.size:
                push[k] += largest * start[place]
    return push


def _convolve_up(left: Reals, right: Reals) -> Reals:
    """Convolution of non-negative sequences, rounded up."""
    found = np.convolve(left, right)[: right.size]
    return np.maximum(found, 0.0) * (1.0 + 4 * (right.size + 4) * _EPS)


def _with_leak(ranges: Reals, around: Reals, leak: Reals) -> Reals:
    """Width beside the affine range: around[k] + sum_m leak[m] abs(d[k-m]), rounded up."""
    affine = np.abs(ranges).max(axis=1)
    spread, size = np.empty(around.size), np.empty(around.size)
    grow = 1.0 + 4 * (around.size + 8) * _EPS
    rest = 1.0 - leak[0]  # of abs(d[k]) <= affine + around + carried + leak[0] abs(d[k])
    if not rest > 0.0:
        return np.full(around.size, np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(around.size):
            carried = leak[1 : k + 1] @ size[:k][::-1]
            spread[k] = (around[k] + carried + leak[0] * affine[k]) / rest * grow
            size[k] = (affine[k] + spread[k]) * grow
    return np.where(np.isnan(spread), np.inf, spread)
