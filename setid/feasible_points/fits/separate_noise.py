"""Parameters of little output noise for structures with several denominators an output.

For given denominators the least noise of an output is a linear program in all else. Descents over
the denominators begin from minima of least squares. Nothing proved rests on them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from setid.feasible_points.fits.exchanges import Approximation, approximated
from setid.feasible_points.fits.separate_denominators import OutputFit, SeparateOutput, fit_outputs
from setid.feasible_points.fits.stable_poles import monic
from setid.formulation.formulation import Formulation
from setid.models.lti import TransferFunction

__all__ = ["estimates_of_little_noise", "separate_noise"]

Reals = NDArray[np.float64]
_STARTS = 3
_DESCENT, _STEP, _AGAIN = 60, 0.03, 3  # evaluations for each unknown, first step, repetitions
_ALMOST = 1e-4  # of a level: where descents end
_FAR = 1e100
_APART = 1e-3  # least distance of minima that count as two
_RADII = 0.99, 0.9, 0.5, 0.0  # times poles, for estimates that are easier to prove
_LEAST = 1e-9  # of the largest noise bound


def separate_noise(
    formulation: Formulation, until: float = inf, enough: float = 0.0
) -> tuple[Reals, Reals] | None:
    """Search parameters that need little noise in each output.

    Parameters
    ----------
    formulation : Formulation
        Of a transfer function with noisy outputs and complete inputs.
    until : float
        The reading of ``time.monotonic`` at which the best so far is taken.
    enough : float
        Part of the noise bounds with which the search of an output ends.

    Returns
    -------
    theta : (p,) float
    outputs : (N, ny) float
        Of the model, as of :func:`separate_fit`.
    or None
        Where some output has too few readings, or none with noise.
    """
    model = formulation.model
    assert isinstance(model, TransferFunction)

    def fit(output: SeparateOutput) -> OutputFit | None:
        now = time.monotonic()
        own = now + max(until - now, 0.0) / (model.outputs - output.number)
        descent = _descent(formulation, output)
        return None if descent is None else descent.run(own, enough)

    return fit_outputs(formulation.data, model, fit)


def estimates_of_little_noise(
    formulation: Formulation, until: float = inf, enough: float = 0.0
) -> Iterator[Reals]:
    """Yield parameters (p,) with little noise, then with faster poles and all else fitted again.

    Where slow poles almost cancel, rounding of the first samples grows until nothing is proved.

    Parameters
    ----------
    formulation, until, enough
        As of :func:`separate_noise`. Where that finds nothing, nothing is yielded.
    """
    found = separate_noise(formulation, until, enough)
    if found is None:
        return
    yield found[0]
    for radius in _RADII:
        moved = _with_faster_poles(formulation, found[0], radius)
        if moved is not None:
            yield moved[0]


def _with_faster_poles(
    formulation: Formulation, theta: Reals, radius: float
) -> tuple[Reals, Reals] | None:
    """Multiply poles by a radius and fit all else again; theta and outputs as above."""
    model = formulation.model
    assert isinstance(model, TransferFunction)
    values = dict(zip(formulation.parameters, theta.tolist(), strict=True))

    def fit(output: SeparateOutput) -> OutputFit | None:
        parts = [
            [values[name] * radius ** (k + 1) for k, name in enumerate(names)]
            for names in output.names
        ]
        descent = _descent(formulation, output)
        return None if descent is None else descent.at(np.concatenate(parts))

    return fit_outputs(formulation.data, model, fit)


def _descent(formulation: Formulation, output: SeparateOutput) -> _Descent | None:
    """Begin with one output; None where it has no noise."""
    model, data = formulation.model, formulation.data
    stable = frozenset[tuple[str, ...]]().union(*(p.stable(model) for p in formulation.priors))
    bound = formulation.noise.bounds(data).output[:, output.number]
    size = np.maximum(bound, _LEAST * float(bound.max()))
    if not np.all(size > 0.0):
        return None
    return _Descent(output, data.y[:, output.number], size, stable)


class _Enough(Exception):
    """Raised inside a descent that has come low enough."""


class _Descent:
    """Descents of one output's noise."""

    def __init__(
        self, output: SeparateOutput, y: Reals, bound: Reals, stable: frozenset[tuple[str, ...]]
    ) -> None:
        self._output, self._stable = output, [names in stable for names in output.names]
        self._bound = bound[output.known]
        self._target = y[output.known] / self._bound
        self._best, self._level, self._enough = np.zeros(0), _FAR, 0.0

    def run(self, until: float, enough: float) -> OutputFit | None:
        """Descend from several minima of least squares; return outputs and parameters."""
        self._enough = enough
        with suppress(_Enough):
            self._search(until)
        return self.at(self._best) if self._level < _FAR else None

    def at(self, a: Reals) -> OutputFit | None:
        """Return outputs and parameters with the best of all else for some denominators."""
        found = self._approximation(a)
        if found is None:
            return None
        basis, approximation = found
        return self._output.at(a, basis @ approximation.coefficients * self._bound)

    def _search(self, until: float) -> None:
        starts = list[Reals]()
        for _, a in self._output.minima(until):
            if all(np.abs(a - other).max(initial=0.0) > _APART for other in starts):
                starts.append(a)
        for a in starts[:_STARTS]:
            for _ in range(_AGAIN):
                before = self._level
                a = self._descended(a, until)
                if not self._level < (1.0 - _ALMOST) * before:
                    break

    def _descended(self, a: Reals, until: float) -> Reals:
        """Descend from some denominators (J. A. Nelder, R. Mead, 1965)."""

        def level(at: Reals) -> float:
            if time.monotonic() >= until and self._level < _FAR:
                return _FAR
            inside = self._inside(at)
            found = self._approximation(inside)
            if found is not None and found[1].level < self._level:
                self._level, self._best = found[1].level, inside
                if self._level <= self._enough:
                    raise _Enough
            return _FAR if found is None else found[1].level

        simplex = a + _STEP * np.vstack([np.zeros(a.size), np.eye(a.size)])
        most = {"maxfev": _DESCENT * a.size, "initial_simplex": simplex, "fatol": 0.0}
        end = minimize(level, a, method="Nelder-Mead", options=most | {"xatol": 1e-6})
        return np.asarray(end.x, np.float64)

    def _inside(self, a: Reals) -> Reals:
        """Draw the poles of denominators that have to be stable into the unit disc."""
        parts = list[Reals]()
        for part, stable in zip(self._output.parts(a), self._stable, strict=True):
            drawn = monic(part, stable)
            assert drawn is not None
            parts.append(drawn[1:])
        return np.concatenate(parts)

    def _approximation(self, a: Reals) -> tuple[Reals, Approximation] | None:
        """Compute orthonormal columns in noise bounds, and the outputs nearest to the readings."""
        columns = self._output.columns(a)[self._output.known] / self._bound[:, None]
        with np.errstate(all="ignore"):
            if not np.all(np.abs(columns) < _FAR):
                return None
            basis = np.linalg.qr(columns)[0]
            found = approximated(basis, self._target)
        return None if found is None else (np.asarray(basis, np.float64), found)
