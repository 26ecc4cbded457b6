"""The outputs of a structure as affine forms over a region, and the rows that readings make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.formulation.formulation import Formulation
from setid.models.block import BlockStructured
from setid.models.checked_structures import equations_of
from setid.models.equations import Equation, Term, channel_of
from setid.proofs.cells.output_cells import CellBox
from setid.proofs.simulated.forms import (
    Form,
    Region,
    constant,
    filtered,
    late,
    negated,
    plus,
    times,
)
from setid.proofs.supports import Cover, cover

__all__ = ["Past", "Recursion", "half_spaces", "recursion_from", "recursion_of"]

Reals = NDArray[np.float64]
_UNIT = 2.0**-53


class Past(NamedTuple):
    """First samples of a signal that no equation gives.

    Parameters
    ----------
    begin : int
        The first sample with an equation.
    lower, upper : (s,) float
        Bounds of the s samples before it, on which the equations rest. Those before are not asked.
    """

    begin: int
    lower: Reals
    upper: Reals


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
    past : mapping of str to Past
        Of the signals that do not start from rest. Their samples are unknowns of the region,
        after the parameters.
    """

    equations: tuple[Equation, ...]
    known: Mapping[str, Reals]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    past: Mapping[str, Past] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """Number d of unknowns of a region: parameters and first samples."""
        return len(self.parameters) + sum(past.lower.size for past in self.past.values())

    @property
    def readings(self) -> NDArray[np.int64]:
        """Numbers of the unknowns of a region that are first samples of outputs."""
        place, found = len(self.parameters), list[int]()
        for name, past in self.past.items():
            if channel_of(name) is not None:
                found += range(place, place + past.lower.size)
            place += past.lower.size
        return np.array(found, np.int64)

    def box(self, lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
        """Find ends (d,) of a region from those of the parameters (p,)."""
        every = self.past.values()
        return (
            np.concatenate([lower, *(past.lower for past in every)]),
            np.concatenate([upper, *(past.upper for past in every)]),
        )

    def cover(self, formulation: Formulation, lower: Reals, upper: Reals) -> tuple[Reals, Reals]:
        """State rows ``matrix @ x <= right`` of priors and smoothed readings in all unknowns."""
        p = len(self.parameters)
        given = cover(formulation, lower[:p], upper[:p])
        return np.pad(given.matrix, ((0, 0), (0, lower.size - p))), given.right

    def run(self, region: Region, bounded: bool = True) -> dict[str, Form]:
        """Every signal as a form over a region; what overflows is no number there.

        Parameters
        ----------
        region : Region
            Of d unknowns.
        bounded : bool
            False leaves out what proves, and is faster.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            return self._run(region, bounded)

    def _run(self, region: Region, bounded: bool) -> dict[str, Form]:
        d, signals = self.dimension, dict[str, Form]()
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
                part = negated(factor)
                for signal in item.signals:
                    part = times(late(signals[signal.signal], signal.lag), part, region)
                drive = plus(drive, _broadcast(part, samples), region)
            start = self._start(equation.defines, region)
            if poles or start is not None:
                drive = filtered(sorted(poles.items()), drive, region, start, bounded)
            signals[equation.defines] = drive
        return signals

    def _start(self, signal: str, region: Region) -> Form | None:
        """Affine forms of the samples before the first, for the signal that is asked."""
        if signal not in self.past:
            return None
        place = len(self.parameters)
        for name, past in self.past.items():
            if name == signal:
                break
            place += past.lower.size
        begin, count = past.begin, past.lower.size
        found = constant(np.zeros(begin), self.dimension)
        found.rest[: begin - count] = np.inf
        for k in range(count):
            found.value[begin - count + k] = region.middle[place + k]
            found.slope[begin - count + k, place + k] = 1.0
        return found

    def _factor(self, item: Term, region: Region) -> Form:
        """The number and the parameters of a term, as a scalar form."""
        d = self.dimension
        found = constant(np.array(item.coefficient), d)
        for name in item.parameters:
            place = self.parameters.index(name)  # fixed ones are in the coefficients
            other = Form(region.middle[place], np.eye(d)[place], np.array(0.0))
            found = times(found, other, region)
        return found


def _own_lag(item: Term, defined: str) -> int:
    lags = [s.lag for s in item.signals if s.signal == defined]
    return lags[0] if lags else 0


def _broadcast(form: Form, samples: int) -> Form:
    if form.value.ndim:
        return form
    ones = np.ones(samples)
    return Form(ones * form.value, ones[:, None] * form.slope, ones * form.rest)


def recursion_of(formulation: Formulation, first: object = None) -> Recursion | None:
    """State a structure as a recursion that exact inputs drive, from rest or from first samples.

    None where inputs are noisy or missing, equations have errors, records are several, or a signal
    is fed back through a map. The past may be unknown where readings or cells bound the first
    samples.

    Parameters
    ----------
    formulation : Formulation
    first : object, optional
        A :class:`CellBox` bounds first samples of an internal signal; others say nothing of them.
    """
    model = formulation.model
    cells = first if isinstance(first, CellBox) else None
    if model.initial == "free" and isinstance(model, BlockStructured) and cells is None:
        return None
    equations = equations_of(model, tuple(f"y{i + 1}" for i in range(model.outputs)))
    return recursion_from(formulation, equations, cells)


def recursion_from(
    formulation: Formulation, given: Sequence[Equation], cells: CellBox | None = None
) -> Recursion | None:
    """State equations as a recursion; None as for :func:`recursion_of`.

    Parameters
    ----------
    formulation : Formulation
    given : sequence of Equation
        Of all outputs, and of internal signals before they are used.
    cells : CellBox, optional
    """
    model, data = formulation.model, formulation.data
    if data.records != 1 or (model.initial == "free" and not _complete(formulation)):
        return None
    _, xi, e = formulation.noise.bounds(data)
    if np.any(xi > 0) or np.any(e > 0) or np.any(np.isnan(data.u)):
        return None
    outputs = tuple(f"y{i + 1}" for i in range(model.outputs))
    known = {f"u{i + 1}": data.u[:, i] for i in range(model.inputs)}
    if isinstance(model, BlockStructured):
        known |= model.driven(data.u)
    ordered, equations = set(known), []
    for equation in given:
        if not _solvable(equation, ordered):
            return None
        equations.append(equation)
        ordered.add(equation.defines)
    if not set(outputs) <= ordered:
        return None
    past = _pasts(formulation, equations, cells)
    if past is None:
        return None
    return Recursion(tuple(equations), known, formulation.parameters, outputs, past)


def _pasts(
    formulation: Formulation, equations: Sequence[Equation], cells: CellBox | None
) -> dict[str, Past] | None:
    """First samples that are unknown; None where they are not bounded."""
    found = dict[str, Past]()
    for equation in equations if formulation.model.initial == "free" else ():
        past = _past(formulation, equation, cells)
        if not np.all(np.isfinite([past.lower, past.upper])):
            return None
        if past.lower.size or equation.output is not None:
            found[equation.defines] = past
    return found


def _complete(formulation: Formulation) -> bool:
    """Check that every reading is there, and more of them than the equations look back."""
    model, data = formulation.model, formulation.data
    outputs = tuple(f"y{i + 1}" for i in range(model.outputs))
    lag = max((equation.lag for equation in equations_of(model, outputs)), default=0)
    return not np.any(np.isnan(data.y)) and data.samples > lag


def _past(formulation: Formulation, equation: Equation, cells: CellBox | None) -> Past:
    """Bounds of the samples on which the first equation of a signal rests."""
    begin, channel = equation.lag, equation.output
    if channel is None:
        return _internal_past(formulation, equation, cells)
    lags = [s.lag for t in equation.terms for s in t.signals if s.signal == equation.defines]
    before = slice(begin - max(lags), begin)
    y = formulation.data.y[before, channel]
    bound = formulation.noise.bounds(formulation.data).output[before, channel]
    return Past(begin, np.nextafter(y - bound, -np.inf), np.nextafter(y + bound, np.inf))


def _internal_past(formulation: Formulation, equation: Equation, cells: CellBox | None) -> Past:
    """Bounds of all samples of an internal signal without an equation, by cells."""
    begin, low = equation.lag, np.full(equation.lag, -np.inf)
    high, numbers = -low, formulation.layout.group(equation.defines)[:begin]
    if cells is not None and begin:
        of = {number: k for k, number in enumerate(cells.unknowns.tolist())}
        for place, number in enumerate(numbers.tolist()):
            if number in of and number >= 0:
                low[place], high[place] = cells.low[of[number]], cells.high[of[number]]
    return Past(begin, low, high)


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
    """List rows that every consistent theta in a region obeys.

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
    data, bound = formulation.data, formulation.noise.bounds(formulation.data).output
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
    more, most = parts.cover(formulation, region.lower, region.upper)
    matrix += [more, region.directions, -region.directions]
    right += [most, region.high, -region.low]
    return Cover(
        formulation.parameters,
        region.lower,
        region.upper,
        np.concatenate(matrix),
        np.concatenate(right),
        False,
    )
