"""Equations of linear models as lags with affine coefficients, and their residuals.

One output with ``sum_i D_i(theta) y(k-i) + sum_j theta_j s_j(k-l_j) == e(k)``, where every D_i is a
number plus a linear function of theta. The *denominator's parameters* are those in the D_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.errors import ModelError
from setid.models.equations import Equation, Lagged, Structure, channel_of
from setid.proofs.supports import Cover

__all__ = ["Affine", "OutputRow", "output_row"]

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


@dataclass(frozen=True, slots=True, eq=False)
class OutputRow:
    """The equation of one output as lags.

    Parameters
    ----------
    feedback : dict of int to Affine
        D_i by lag i; that of lag 0 is there.
    others : list of (parameter, coefficient, signal, lag)
        Terms of known signals; the signal is "" for a constant.
    """

    feedback: dict[int, Affine]
    others: list[tuple[int, float, str, int]]

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
        return OutputRow(self.feedback, [term for term in self.others if term[2]])

    def residual(self, v: Reals, u: Reals, cover: Cover) -> tuple[Reals, Reals, Reals]:
        """Write residuals of outputs v as own (N,) + regressors (N, p) theta, with their size.

        All signals are zero before the record. The size is the sum of absolute values over the
        cover.
        """
        own, found = np.zeros(v.size), np.zeros((v.size, cover.lower.size))
        size = np.zeros(v.size)
        for lag, factor in self.feedback.items():
            past = v[: v.size - lag]
            own[lag:] += factor.constant * past
            found[lag:] += past[:, None] * factor.weights
            size[lag:] += np.abs(past) * factor.size(cover)
        for column, coefficient, signal, lag in self.others:
            values = np.ones(v.size - lag)
            if signal:
                channel = channel_of(signal)
                assert channel is not None
                values = u[: v.size - lag, channel[1]]
            found[lag:, column] += coefficient * values
            size[lag:] += abs(coefficient) * np.abs(values) * cover.magnitude[column]
        return own, found, size


def output_row(equation: Equation, model: Structure) -> OutputRow:
    """State an equation as lags.

    Raises
    ------
    ModelError
        If it has products, or signals of other outputs.
    """
    place = {name: column for column, name in enumerate(model.parameters)}
    feedback: dict[int, Affine] = {}
    others = []
    for term in equation.terms:
        signal = term.signals[0] if term.signals else Lagged("")
        own = signal.signal == equation.defines
        if len(term.signals) > 1 or len(term.parameters) > 1 or not (own or term.parameters):
            raise ModelError("model: found products, expected a linear structure for proved bands")
        if own:
            before = feedback.get(signal.lag, Affine(0.0, np.zeros(len(place))))
            constant, weights = before.constant, before.weights.copy()
            if term.parameters:
                weights[place[term.parameters[0]]] += term.coefficient
            else:
                constant += term.coefficient
            feedback[signal.lag] = Affine(constant, weights)
            continue
        column = place[term.parameters[0]]
        if not signal.signal or (signal.signal[0] == "u" and channel_of(signal.signal)):
            others.append((column, term.coefficient, signal.signal, signal.lag))
        else:
            raise ModelError("model: found coupled outputs, expected one denominator an output")
    return OutputRow(feedback, others)
