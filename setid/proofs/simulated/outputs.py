"""The outputs of a structure as affine forms over a region, and the rows that readings make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.equations import Equation, Term
from setid.proofs.simulated.forms import Form, Region, constant, filtered, late, plus, times
from setid.proofs.supports import Cover, cover

__all__ = ["Recursion", "half_spaces", "recursion_of"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53


@dataclass(frozen=True, slots=True, eq=False)
class Recursion:
    """The equations of a structure in the order in which they give its signals.

    Parameters
    ----------
    equations : tuple of Equation
        Each signal after those that it is made of.
    known : mapping of str to (N,) float
        Signals that are known exactly.
    parameters : tuple of str
    outputs : tuple of str
    """

    equations: tuple[Equation, ...]
    known: Mapping[str, Reals]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]

    def run(self, region: Region) -> dict[str, Form]:
        """Every signal as a form over a region; what overflows is no number there."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._run(region)

    def _run(self, region: Region) -> dict[str, Form]:
        d, signals = len(self.parameters), dict[str, Form]()
        for name, values in self.known.items():
            signals[name] = constant(values, d)
        for equation in self.equations:
            poles, samples = dict[int, Form](), next(iter(self.known.values())).size
            drive = constant(np.zeros(samples), d)
            for item in equation.terms[1:]:
                factor = self._factor(item, region)
                own = _own_lag(item, equation.defines)
                if own:
                    poles[own] = factor
                    continue
                part = _negated(factor)
                for signal in item.signals:
                    part = times(late(signals[signal.signal], signal.lag), part, region)
                drive = plus(drive, _broadcast(part, samples), region)
            found = filtered(sorted(poles.items()), drive, region) if poles else drive
            signals[equation.defines] = found
        return signals

    def _factor(self, item: Term, region: Region) -> Form:
        """The number and the parameters of a term, as a scalar form."""
        d = len(self.parameters)
        found = constant(np.array(item.coefficient), d)
        for name in item.parameters:
            place = self.parameters.index(name)  # fixed ones are in the coefficients
            other = Form(region.middle[place], np.eye(d)[place], np.array(0.0))
            found = times(found, other, region)
        return found


def _own_lag(item: Term, defined: str) -> int:
    lags = [s.lag for s in item.signals if s.signal == defined]
    return lags[0] if lags else 0


def _negated(form: Form) -> Form:
    return Form(-form.value, -form.slope, form.rest)


def _broadcast(form: Form, samples: int) -> Form:
    if form.value.ndim:
        return form
    ones = np.ones(samples)
    return Form(ones * form.value, ones[:, None] * form.slope, ones * form.rest)


def recursion_of(formulation: Formulation) -> Recursion | None:
    """State a structure as a recursion that exact inputs drive from rest.

    None where inputs are noisy or missing, equations have errors, the past is unknown, records are
    several, or a signal is fed back through a map.

    Parameters
    ----------
    formulation : Formulation
    """
    model, data = formulation.model, formulation.data
    if not isinstance(model, BlockStructured) or model.initial != "zero" or data.records != 1:
        return None
    _, xi, e = formulation.noise.bounds(data)
    if np.any(xi > 0) or np.any(e > 0) or np.any(np.isnan(data.u)):
        return None
    outputs = tuple(f"y{i + 1}" for i in range(model.outputs))
    known = {f"u{i + 1}": data.u[:, i] for i in range(model.inputs)} | model.driven(data.u)
    ordered, equations = set(known), []
    for equation in model.equations(outputs):
        if not _solvable(equation, ordered):
            return None
        equations.append(equation)
        ordered.add(equation.defines)
    if not set(outputs) <= ordered:
        return None
    return Recursion(tuple(equations), known, formulation.parameters, outputs)


def _solvable(equation: Equation, known: set[str]) -> bool:
    """Check that a signal is made of known ones and, linearly, of its own past."""
    lags: list[int] = []
    for item in equation.terms[1:]:
        own = [s.lag for s in item.signals if s.signal == equation.defines]
        if own and (len(item.signals) > 1 or own[0] < 1 or own[0] in lags):
            return False
        lags += own
        if not {s.signal for s in item.signals} <= known | {equation.defines}:
            return False
    return True


def half_spaces(formulation: Formulation, parts: Recursion, region: Region) -> Cover:
    """Rows that every consistent theta in a region obeys.

    Parameters
    ----------
    formulation : Formulation
    parts : Recursion
        Of this formulation.
    region : Region

    Returns
    -------
    Cover
        Of the readings from above and below, sample by sample, of the priors, and of the
        directions of the region.
    """
    signals, middle = parts.run(region), region.middle
    data, bound = formulation.data, formulation.noise.bounds(formulation.data)[0]
    size = np.maximum(np.abs(region.lower), np.abs(region.upper))
    matrix, right = [], []
    for channel, name in enumerate(parts.outputs):
        form = signals[name]
        y, usable = data.y[:, channel], ~np.isnan(data.y[:, channel])
        usable &= np.isfinite(form.rest) & np.isfinite(form.value)
        usable &= np.all(np.isfinite(form.slope), axis=1)
        value, slope, rest = (part[usable] for part in form)
        offset = slope @ middle
        loss = 8 * (size.size + 8) * _UNIT
        loss = loss * (np.abs(y[usable]) + np.abs(value) + np.abs(slope) @ size)
        width = (bound[usable, channel] + rest + loss) * (1 + 1e-12)
        away = y[usable] - value
        matrix += [slope, -slope]
        right += [away + offset + width, -away - offset + width]
    given = cover(formulation, region.lower, region.upper)
    matrix += [given.matrix, region.directions, -region.directions]
    right += [given.right, region.high, -region.low]
    return Cover(
        formulation.parameters,
        region.lower,
        region.upper,
        np.concatenate(matrix),
        np.concatenate(right),
        False,
    )
