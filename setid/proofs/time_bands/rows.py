"""Equations of one output as lags with affine coefficients, and their residuals.

One output with ``sum_i D_i(theta) y(k-i) + sum_j theta_j s_j(k) == e(k)``, where every D_i is a
number plus a linear function of theta, and every s_j is a product of inputs some samples ago. The
*denominator's parameters* are those in the D_i. Where denominators are multiplied out, theta holds
sums of products of parameters too (:mod:`setid.proofs.time_bands.sums`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.errors import ModelError
from setid.models.equations import Equation, Lagged, Transfer, channel_of
from setid.proofs.supports import Cover

__all__ = ["Affine", "Known", "OutputRow", "output_row", "transfer_row"]

Reals = NDArray[np.float64]


class Affine(NamedTuple):
    """A coefficient constant + weights'theta."""

    constant: float
    weights: Reals

    def at(self, theta: Reals) -> float:
        """Evaluate it, up to rounding."""
        return float(self.constant + self.weights @ theta)

    def size(self, cover: Cover) -> float:
        """Sum of the absolute values in it, for rounding errors."""
        return float(abs(self.constant) + np.abs(self.weights) @ cover.magnitude)


class Known(NamedTuple):
    """A term coefficient * theta[column] * (product of inputs).

    Parameters
    ----------
    column : int or None
        None for a coefficient alone.
    coefficient : float
    inputs : tuple of (channel, lag)
        Channels from 0; none for a constant.
    """

    column: int | None
    coefficient: float
    inputs: tuple[tuple[int, int], ...]

    @property
    def lag(self) -> int:
        """Largest lag of an input."""
        return max((lag for _, lag in self.inputs), default=0)

    def values(self, u: Reals) -> Reals:
        """Multiply inputs (N, nu), zero before the record; (N,)."""
        found = np.ones(len(u))
        for channel, lag in self.inputs:
            found[:lag] = 0.0
            found[lag:] *= u[: max(len(u) - lag, 0), channel]
        return found

    def most(self, cover: Cover) -> float:
        """Bound the factor of the product of inputs."""
        size = 1.0 if self.column is None else float(cover.magnitude[self.column])
        return abs(self.coefficient) * size


@dataclass(frozen=True, slots=True, eq=False)
class OutputRow:
    """The equation of one output as lags.

    Parameters
    ----------
    feedback : dict of int to Affine
        D_i by lag i; that of lag 0 is there.
    others : list of Known
        Terms of inputs and constants.
    """

    feedback: dict[int, Affine]
    others: list[Known]

    @property
    def terms(self) -> int:
        """Number of products in a coefficient of the feedback, for rounding errors."""
        return sum(1 + int(np.count_nonzero(a.weights)) for a in self.feedback.values())

    @property
    def lag(self) -> int:
        """Largest lag of the output itself."""
        return max(self.feedback)

    @property
    def columns(self) -> NDArray[np.int64]:
        """Places of the denominator's parameters, (q,)."""
        used = np.any([factor.weights != 0.0 for factor in self.feedback.values()], axis=0)
        return np.asarray(np.flatnonzero(used), np.int64)

    @property
    def leads_with_one(self) -> bool:
        """True if D_0 is exactly 1."""
        return self.feedback[0].constant == 1.0 and not np.any(self.feedback[0].weights)

    def without_constant(self) -> OutputRow:
        """Drop what acts all the time from the row: that of the plant alone."""
        return OutputRow(self.feedback, [term for term in self.others if term.inputs])

    def residual(self, v: Reals, u: Reals, cover: Cover) -> tuple[Reals, Reals, Reals]:
        """Write residuals of outputs v as own (N,) + regressors (N, p) theta, with their size.

        All signals are zero before the record. The size is the sum of absolute values over the
        cover.
        """
        own, found = np.zeros(v.size), np.zeros((v.size, cover.lower.size))
        size = np.zeros(v.size)
        for lag, factor in self.feedback.items():
            past = v[: max(v.size - lag, 0)]
            own[lag:] += factor.constant * past
            found[lag:] += past[:, None] * factor.weights
            size[lag:] += np.abs(past) * factor.size(cover)
        for term in self.others:
            values = term.values(u)
            if term.column is None:
                own += term.coefficient * values
            else:
                found[:, term.column] += term.coefficient * values
            size += term.most(cover) * np.abs(values)
        return own, found, size


def output_row(equation: Equation, names: Sequence[str]) -> OutputRow:
    """State an equation as lags.

    Parameters
    ----------
    equation : Equation
    names : sequence of str
        What theta holds.

    Raises
    ------
    ModelError
        If it has products of parameters or of outputs, or signals of other outputs.
    """
    place = {name: column for column, name in enumerate(names)}
    feedback: dict[int, Affine] = {}
    others = []
    for term in equation.terms:
        if len(term.parameters) > 1:
            raise ModelError("model: found products, expected a linear structure for proved bands")
        column = place[term.parameters[0]] if term.parameters else None
        if term.signals and term.signals[0].signal == equation.defines and len(term.signals) == 1:
            lag = term.signals[0].lag
            before = feedback.get(lag, Affine(0.0, np.zeros(len(place))))
            constant, weights = before.constant, before.weights.copy()
            if column is None:
                constant += term.coefficient
            else:
                weights[column] += term.coefficient
            feedback[lag] = Affine(constant, weights)
        else:
            others.append(Known(column, term.coefficient, _inputs(term.signals, equation.defines)))
    return OutputRow(feedback, others)


def transfer_row(transfer: Transfer, input: int, names: Sequence[str]) -> OutputRow:
    """State what one input adds to an output, with a denominator of its own.

    Parameters
    ----------
    transfer : Transfer
        In discrete time.
    input : int
        Its channel, from 0.
    names : sequence of str
        What theta holds.
    """
    place = {name: column for column, name in enumerate(names)}
    each = np.eye(len(place))
    feedback = {0: Affine(1.0, np.zeros(len(place)))}
    feedback |= {lag: Affine(0.0, each[place[a]]) for lag, a in enumerate(transfer.denominator, 1)}
    others = [
        Known(place[b], -1.0, ((input, lag),))
        for lag, b in enumerate(transfer.numerator, transfer.delay)
    ]
    return OutputRow(feedback, others)


def _inputs(signals: Sequence[Lagged], output: str) -> tuple[tuple[int, int], ...]:
    found = []
    for signal in signals:
        channel = channel_of(signal.signal)
        if channel is None:
            raise ModelError(
                f"model: found the signal {signal.signal}, expected measured ones for proved bands"
            )
        if channel[0] == "y":
            own = signal.signal == output
            what = "products with outputs" if own or len(signals) > 1 else "coupled outputs"
            raise ModelError(
                f"model: found {what}, expected outputs that are fed back linearly, each to "
                "itself, for proved bands"
            )
        found.append((channel[1], signal.lag))
    return tuple(found)
