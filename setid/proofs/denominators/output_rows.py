"""Rows of one output, its noise bounds and the known columns of its numerator.

A linear structure without input or equation errors has the rows

    sum_i a_i (y(k - i) - eta(k - i))  =  sum_j b_j phi_j(k),          a_0 = 1,

of an output y with noise eta, where the columns phi are known: delayed inputs and a constant.

All signals are zero before a record of a system at rest. Then there are rows from its first sample
on, and n zeros without noise stand before it.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.formulation.lifting import lift
from setid.models.checked_structures import regression_of
from setid.models.equations import Equation, Structure, Term, channel_of
from setid.models.lti import TransferFunction
from setid.priors.checked_priors import stable_of

__all__ = ["OutputRows", "output_rows"]

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class OutputRows(NamedTuple):
    """Rows of one output of a record.

    Parameters
    ----------
    order : int
        The largest lag n of the output.
    row : (S,) bool
        Samples k with a row: all it asks for is in the record, or zero before it.
    y, bound : (S,) float
        Readings, 0 where there is none, and their noise bounds.
    known : (S, c) float
        Columns of the numerator, distinct and not zero; zero where there is no row.
    stable : bool
        Whether a prior has the zeros of the denominator in the closed unit disc.
    norm : {"linf", "l2", "l1"}
        In which the noise, each sample in parts of its bound, is at most 1.
    own : tuple of str
        The parameter that is the coefficient of each lag 1, ..., n; "" where it is none alone.
    gains : tuple of (str, int)
        For each known column the parameter that is its coefficient, times 1 or -1; "" as above.
    sample : (S,) int, optional
        Number of each in the data; -1 for zeros before a record at rest. S samples of the data
        when left out.
    """

    order: int
    row: NDArray[np.bool_]
    y: Reals
    bound: Reals
    known: Reals
    stable: bool
    norm: Literal["linf", "l2", "l1"] = "linf"
    own: tuple[str, ...] = ()
    gains: tuple[tuple[str, int], ...] = ()
    sample: Integers | None = None

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Mark what are samples of the data, (S,)."""
        return np.ones(self.y.size, bool) if self.sample is None else self.sample >= 0

    def numbers(self, places: Integers) -> Integers:
        """Number samples in the data.

        Parameters
        ----------
        places : (c,) int
            Numbers among the S.
        """
        return places if self.sample is None else self.sample[places]

    def places(self, numbers: Integers) -> Integers:
        """Number samples among the S.

        Parameters
        ----------
        numbers : (c,) int
            Numbers in the data, each of 0, ..., N - 1.
        """
        return numbers if self.sample is None else np.flatnonzero(self.sample >= 0)[numbers]

    @property
    def begun(self) -> NDArray[np.bool_]:
        """Mark rows whose outputs are all in the data, (S,)."""
        found, inside = self.row.copy(), self.inside
        for lag in range(1, self.order + 1):
            found[lag:] &= inside[:-lag]
            found[:lag] = False
        return found

    def spread(self, multipliers: Reals) -> Reals | None:
        """Put zeros before records at rest; None where these are no multipliers of the data.

        Parameters
        ----------
        multipliers : (M, N) float
            For each sample of the data.

        Returns
        -------
        (M, S) float or None
        """
        inside = self.inside
        if multipliers.ndim != 2 or multipliers.shape[1] != np.count_nonzero(inside):
            return None
        found = np.zeros((len(multipliers), inside.size))
        found[:, inside] = multipliers
        return found


def output_rows(formulation: Formulation, output: int) -> OutputRows | None:
    """State the rows of an output; None where inputs or equations have errors.

    Parameters
    ----------
    formulation : Formulation
        Of a linear structure in discrete time with one denominator an output.
    output : int
        Channel, from 0.
    """
    model, data = formulation.model, formulation.data
    eta, xi, e = formulation.noise.bounds(data)
    equations = _equations(model)
    if not equations or np.any(xi > 0) or np.any(e[:, output] > 0) or np.any(np.isnan(data.u)):
        return None
    equation = equations[output]
    lags = _own_lags(equation)
    if lags is None:
        return None
    order = max(lags, default=0)
    at_rest = _is_at_rest(model)
    sample, age = _samples(np.asarray(data.first), order if at_rest else 0)
    y = np.where(sample >= 0, data.y[sample, output], 0.0)
    row = (sample >= 0) & (at_rest | (age >= equation.lag))
    for lag in lags:
        row &= ~np.isnan(y[np.maximum(np.arange(y.size) - lag, 0)])
    names = tuple(name for lag in sorted(lags) for name in lags[lag])
    stable = _denominators(model, output) <= frozenset[tuple[str, ...]]().union(
        *(stable_of(prior, model) for prior in formulation.priors)
    )
    columns = dict[bytes, tuple[Reals, tuple[str, int]]]()
    for item in _others(equation):
        column = np.where(row, _column(data.u, item, sample, age), 0.0)
        shared = column.tobytes() in columns
        if np.any(column):
            columns[column.tobytes()] = column, ("", 1) if shared else _gain(item)
    known = np.array([column for column, _ in columns.values()]).reshape(len(columns), y.size).T
    return OutputRows(
        order,
        row,
        np.where(np.isnan(y), 0.0, y),
        np.where(sample >= 0, eta[sample, output], 0.0),
        known,
        stable and len(names) == order > 0,
        own=tuple(_alone(lags.get(lag, ())) for lag in range(1, order + 1)),
        gains=tuple(gain for _, gain in columns.values()),
        sample=sample if at_rest else None,
    )


def _is_at_rest(model: Structure) -> bool:
    """Check that rows hold with zeros before a record.

    They do not where denominators are multiplied out and an offset is added to the output itself.
    """
    assert isinstance(model, TransferFunction)
    return model.initial == "zero" and (not model.offset or bool(regression_of(model)))


def _samples(first: Integers, before: int) -> tuple[Integers, Integers]:
    """Number samples, -1 for each that stands before a record, and count those before it."""
    begins = np.flatnonzero(first == np.arange(first.size))
    sample = np.insert(np.arange(first.size), np.repeat(begins, before), -1)
    return sample, np.where(sample >= 0, sample - first[sample], 0)


def _equations(model: Structure) -> tuple[Equation, ...]:
    """Equations of all outputs that are linear in parameters, or in sums of their products.

    Several denominators are multiplied out, which follows from every form of the structure once
    all delayed samples are in the record.
    """
    if not isinstance(model, TransferFunction):
        return ()
    return regression_of(model) or lift(model.multiplied()).equations


def _denominators(model: Structure, output: int) -> frozenset[tuple[str, ...]]:
    """Denominators whose product is that of the rows."""
    assert isinstance(model, TransferFunction)
    return frozenset(model.denominators(output))


def _alone(parameters: tuple[str, ...]) -> str:
    return parameters[0] if len(parameters) == 1 else ""


def _gain(item: Term) -> tuple[str, int]:
    """The parameter of a term on the right of the rows, and its sign there."""
    alone = len(item.parameters) == 1 and abs(item.coefficient) == 1.0
    return (item.parameters[0], -int(item.coefficient)) if alone else ("", 1)


def _own_lags(equation: Equation) -> dict[int, tuple[str, ...]] | None:
    """Parameters of the output by its lag; None where a term is of another kind."""
    found: dict[int, tuple[str, ...]] = {0: ()}
    for item in equation.terms[1:]:
        channels = [channel_of(lagged.signal) for lagged in item.signals]
        if [c for c in channels if c is None] or len(channels) > 1:
            return None
        if item.signals and item.signals[0].signal == equation.defines:
            lag = item.signals[0].lag
            if lag in found:
                return None
            found[lag] = item.parameters if item.coefficient == 1.0 else ("", *item.parameters)
        elif any(channel is not None and channel[0] == "y" for channel in channels):
            return None
    return found


def _others(equation: Equation) -> list[Term]:
    """Terms of the numerator, and of a constant."""
    own = equation.defines
    return [t for t in equation.terms[1:] if not t.signals or t.signals[0].signal != own]


def _column(u: Reals, item: Term, sample: Integers, age: Integers) -> Reals:
    """The known factor of a term at each sample; zero before a record."""
    if not item.signals:
        return np.ones(sample.size)
    lagged = item.signals[0]
    channel = channel_of(lagged.signal)
    assert channel is not None
    delayed = u[np.maximum(sample - lagged.lag, 0), channel[1]]
    return np.asarray(np.where(age >= lagged.lag, delayed, 0.0), np.float64)
