"""Least squares of simulations with several denominators an output, from many starts.

For given denominators an output is affine in all else, in numerators, an offset and the first
samples. These are left to linear least squares, so that the search is over the denominators alone
(G. H. Golub, V. Pereyra, *SIAM J. Numerical Analysis* 10 (1973) 413-432). It begins from the best
of random stable ones. The points found are local minima, and starts for other norms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import reduce
from itertools import pairwise
from math import inf
from typing import TypeGuard

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares

from setid.data.record import IOData
from setid.feasible_points.fits.stable_poles import random_denominator
from setid.models.checked_structures import coefficients_of, regression_of
from setid.models.equations import Structure
from setid.models.lti import TransferFunction

__all__ = [
    "OutputFit",
    "SeparateOutput",
    "fit_outputs",
    "has_separate_denominators",
    "separate_fit",
]

Reals = NDArray[np.float64]
OutputFit = tuple[Reals, dict[str, float]]  # outputs, and the parameters that give them
_SEED = 7
_RANDOM, _STARTS = 100, 5  # denominators for each that is sought; those that are followed
_STEPS = 100  # evaluations of a local search
_HUGE = 1e100  # stands for errors that overflow
_TINY = 1e-200


def has_separate_denominators(model: Structure) -> TypeGuard[TransferFunction]:
    """Check that an output of a structure is a sum over several denominators.

    Parameters
    ----------
    model : Structure
    """
    return isinstance(model, TransferFunction) and not regression_of(model)


def separate_fit(
    data: IOData, model: TransferFunction, until: float = inf
) -> tuple[Reals, Reals] | None:
    """Fit the simulation of each output by least squares.

    Parameters
    ----------
    data : IOData
        With complete inputs.
    model : TransferFunction
    until : float
        The reading of ``time.monotonic`` at which the best so far is taken.

    Returns
    -------
    theta : (p,) float
    outputs : (N, ny) float
        Of the model. Samples that it does not give are the readings, or 0.
    or None
        Where some output has too few readings.
    """

    def fit(problem: SeparateOutput) -> OutputFit | None:
        minima = problem.minima(until)
        return problem.at(minima[0][1]) if minima else None

    return fit_outputs(data, model, fit)


def fit_outputs(
    data: IOData, model: TransferFunction, fit: Callable[[SeparateOutput], OutputFit | None]
) -> tuple[Reals, Reals] | None:
    """Fit one output after the other; return what :func:`separate_fit` does.

    Parameters
    ----------
    data : IOData
    model : TransferFunction
    fit : callable
        Fits one output; None where it cannot.
    """
    place = {name: k for k, name in enumerate(model.parameters)}
    theta, outputs = np.zeros(len(place)), np.where(np.isnan(data.y), 0.0, data.y)
    for number in range(model.outputs):
        output = SeparateOutput(data, model, number)
        found = fit(output)
        if found is None:
            return None
        outputs[output.modelled, number], values = found
        for name, value in values.items():
            theta[place[name]] = value
    return theta, outputs


class SeparateOutput:
    """One output as a function of its denominators.

    Parameters
    ----------
    data : IOData
        With complete inputs.
    model : TransferFunction
    output : int
        From 0.

    Attributes
    ----------
    number : int
        That of the output.
    names : list of tuple of str
        Parameters of each denominator.
    modelled : (N,) bool
        Samples that occur in equations, the first ones of a record among them.
    known : (N,) bool
        Those with a reading.
    """

    def __init__(self, data: IOData, model: TransferFunction, output: int) -> None:
        self._u, self._model, self.number = data.u, model, output
        self.names = model.denominators(output)
        equation, order = model.multiplied()[output], sum(map(len, self.names))
        rest = model.initial == "zero"
        self._free = 0 if rest else order  # first samples of each record
        self._begin = 0 if rest else equation.lag - order
        self._records = list(pairwise([*data.starts.tolist(), data.samples]))
        self.modelled = np.asarray(np.arange(data.samples) - data.first >= self._begin)
        self.known = self.modelled & ~np.isnan(data.y[:, output])
        self._y = data.y[self.known, output]
        self._constants = [t.parameters for t in equation.terms if not t.signals]

    def minima(self, until: float) -> list[tuple[float, Reals]]:
        """Follow the best of random denominators; list their errors and coefficients.

        Parameters
        ----------
        until : float
            The reading of ``time.monotonic`` at which the best so far are taken.

        Returns
        -------
        list of (float, (n,) float)
            The least error first.
        """
        random, tried = np.random.default_rng(_SEED), list[tuple[float, Reals]]()
        for _ in range(_RANDOM * len(self.names)):
            if tried and time.monotonic() >= until:
                break
            parts = [random_denominator(random, len(names))[1:] for names in self.names]
            a = np.concatenate(parts)
            tried.append((self._size(a), a))
        tried.sort(key=lambda pair: pair[0])
        found = tried[:1]
        for _, a in tried[:_STARTS]:
            if time.monotonic() >= until:
                break
            end = least_squares(self._errors, a, x_scale="jac", max_nfev=_STEPS).x
            found.append((self._size(end), end))
        return sorted(((size, a) for size, a in found if size < _HUGE), key=lambda pair: pair[0])

    def _size(self, a: Reals) -> float:
        return float(np.linalg.norm(self._errors(a)))

    def _errors(self, a: Reals) -> Reals:
        """Compute errors at known readings with the best of all else; huge where it overflows."""
        columns = self.columns(a)[self.known]
        if not np.all(np.abs(columns) < _HUGE):
            return np.full(self._y.size, _HUGE)
        return np.asarray(columns @ _solved(columns, self._y) - self._y, np.float64)

    def at(self, a: Reals, target: Reals | None = None) -> OutputFit:
        """Return outputs (modelled,) with the best of all else, and the parameters.

        Parameters
        ----------
        a : (n,) float
            Coefficients of all denominators.
        target : (known,) float, optional
            Outputs that are to be approximated; the readings when left out.
        """
        columns = self.columns(a)
        values = _solved(columns[self.known], self._y if target is None else target)
        names = [name for part in self.names for name in part] + self._linear()
        pairs = zip(names, [*a.tolist(), *values.tolist()], strict=False)
        return np.asarray(columns[self.modelled] @ values, np.float64), dict(pairs)

    def _linear(self) -> list[str]:
        """List the names of the numerators' coefficients and of the offset."""
        model, inputs = self._model, range(1, self._model.inputs + 1)
        found = [b for j in inputs for b in coefficients_of(model, self.number + 1, j).numerator]
        return [*found, *self._constants[0][-1:]] if self._constants else found

    def parts(self, a: Reals) -> list[Reals]:
        """Split coefficients among the denominators, each with its 1.

        Parameters
        ----------
        a : (n,) float
        """
        ends = np.cumsum([len(names) for names in self.names])[:-1]
        return [np.append(1.0, part) for part in np.split(a, ends)]

    def columns(self, a: Reals) -> Reals:
        """Compute what multiplies numerators, offset and first samples, (N, c).

        Parameters
        ----------
        a : (n,) float
        """
        monic = dict(zip(self.names, self.parts(a), strict=True))
        whole = reduce(np.convolve, monic.values(), np.ones(1))
        linear, n = len(self._linear()), self._free
        found = np.zeros((len(self._u), linear + n * len(self._records)))
        for number, (begin, end) in enumerate(self._records):
            place, later = slice(begin, end), slice(begin + self._begin, end)
            found[place, :linear] = self._of_inputs(self._u[place], monic, whole)
            start = linear + n * number
            impulses = np.eye(max(end - begin - self._begin, 0), n)
            found[later, start : start + n] = _filtered(whole, impulses)
        return found

    def _of_inputs(self, u: Reals, monic: dict[tuple[str, ...], Reals], whole: Reals) -> Reals:
        """Filter delayed inputs and a constant, all zero before the record."""
        model, columns = self._model, list[Reals]()
        for j in range(model.inputs):
            own = coefficients_of(model, self.number + 1, j + 1)
            output = _filtered(monic.get(own.denominator, np.ones(1)), u[:, j])
            for lag in range(own.delay, own.delay + len(own.numerator)):
                columns.append(np.concatenate([np.zeros(lag), output])[: len(u)])
        if self._constants:
            alone = len(self._constants) == 1  # it drives the equation, else it is added
            columns.append(_filtered(whole, np.ones(len(u))) if alone else np.ones(len(u)))
        return np.array(columns).reshape(len(columns), len(u)).T


def _filtered(denominator: Reals, signals: Reals) -> Reals:
    """Filter along the first axis; ``scipy.signal`` is loaded here, when asked."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(scipy.signal.lfilter([1.0], denominator, signals, axis=0), np.float64)


def _solved(columns: Reals, target: Reals) -> Reals:
    size = np.maximum(np.linalg.norm(columns, axis=0), _TINY)
    found = np.linalg.lstsq(columns / size, target, rcond=None)[0] / size
    return np.asarray(found, np.float64)
