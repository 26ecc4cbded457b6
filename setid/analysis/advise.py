"""Advice on the acquisition of a record, from a step response and a record at rest.

Nothing here is proved. Sampling times follow the rule of thumb of 20 to 50 samples in the
transient, and what a record at rest says of its noise has a confidence, not a proof.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, floor, inf, log10, prod
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sps
from numpy.typing import ArrayLike, NDArray

from setid.data.checks import FrozenMapping, frozen, natural, number
from setid.data.digits import all_digits
from setid.data.noise import EstimatedBound, Noise, bound_at_rest
from setid.data.record import IOData
from setid.errors import DataError, ModelError, SetidError, SetidWarning
from setid.formulation.formulation import formulate
from setid.html import listing, section
from setid.models.continuous import at_rate, interval_of
from setid.models.equations import Structure
from setid.simulation.simulate import simulate
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.executors.threads import silent
from sparsepop_py.lp.scaled import solve_scaled
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Advice", "Excitation", "advise", "excitation"]

Reals = NDArray[np.float64]

_FEWEST, _USUAL, _MOST = 20, 30, 50  # samples in the transient
_BAND = 0.02  # of the height of a step: within it the response has settled
_STILL = 0.1  # of a step: by which an input may move besides it
_REST = 0.2  # of the transient: how long a response stays near its final value, at least
_ANSWER = 1.5  # times the range before the step: less is no answer to it
_TAIL = 0.1  # of the record, from which the final value is taken
_CONFIDENCE = 0.95
_RUN = 5  # equal readings at an end of the range that count as saturation, at least
_DIGITS = 2.0**-40  # of the largest reading: smaller steps are those of doubles
_LEVELS = 0.5  # distinct values a sample, below which a channel counts as quantised
_SAMPLES = 10**8  # of a square wave, at most
_LARGEST = 1e300  # beyond, sums and times might overflow
_CUT = "saturation; use a smaller step or another range"
_SMALLER = "the response to a smaller step tells which"
_WIDE = 0.3  # relative half width from which a parameter is called wide


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Advice:
    """Advice on how to record data of a system.

    Parameters
    ----------
    sampling_time : float
        The transient then has 30 samples; NaN where the response has not settled.
    sampling_range : (float, float)
        Sampling times with 50 and with 20 samples in the transient.
    settling_time : float
        From the step until the response stays within 2 % of its height, its noise added.
    noise_bound : EstimatedBound or None
        Of the outputs; None where no part of a record is at rest. An assumption, not a proof. At
        least half a step where readings are quantised: at rest they may hide smaller noise.
    coverage : float
        With the confidence 95 %, at least this share of noise samples lies within the range that
        was seen (tolerance limits without a distribution; samples are taken as independent).
    saturation : mapping of str to (float or None, float or None)
        Channels whose readings stick to the lower or the upper end of their range.
    quantisation : mapping of str to float
        Steps between the readings of channels that are quantised.
    text : str
        All of it in sentences, with an input to begin with.
    record : IOData
        The step record.

    References
    ----------
    S. S. Wilks, Annals of Mathematical Statistics 12 (1941) 91-96 (tolerance limits).

    Examples
    --------
    >>> import numpy as np, setid
    >>> u = np.append(np.zeros(20), np.ones(180))
    >>> y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    >>> found = setid.advise(setid.IOData(u, y, 0.01))
    >>> round(found.settling_time, 6), round(found.sampling_time, 6)
    (0.38, 0.013)
    """

    sampling_time: float
    sampling_range: tuple[float, float]
    settling_time: float
    noise_bound: EstimatedBound | None
    coverage: float
    saturation: Mapping[str, tuple[float | None, float | None]]
    quantisation: Mapping[str, float]
    text: str
    record: IOData

    def square_wave(self, samples: int = 300, low: float = -1.0, high: float = 1.0) -> Reals:
        """Propose a first input (samples,): a square wave of two half periods in turn.

        Half periods are the settling time, which shows the static gain, and a fifth of it, which
        shows the dynamics, at the advised sampling time.

        Parameters
        ----------
        samples : int
        low, high : float
            Levels.

        Raises
        ------
        SetidError
            If no sampling time is known, or a setting is none.
        """
        count = natural(samples, "samples", SetidError, 1, _SAMPLES)
        levels = number(low, "low", SetidError), number(high, "high", SetidError)
        if not np.all(np.isfinite(levels)):
            raise SetidError(f"low, high: found {low!r}, {high!r}, expected finite numbers")
        if not np.isfinite(self.sampling_time):
            raise SetidError("sampling_time: found none, expected a step response that settles")
        return frozen(_square(count, *levels))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the step response with its settling time; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_advice

        return plot_advice(self, ax)

    def _repr_html_(self) -> str:
        return section("acquisition", listing("advice", self.text.splitlines()))

    def __repr__(self) -> str:
        return f"<Advice: Ts = {self.sampling_time:g}, settling time {self.settling_time:g}>"


def advise(step_record: IOData, zero_record: IOData | ArrayLike | None = None) -> Advice:
    """Advise on sampling time, noise bound and input from a step response.

    Parameters
    ----------
    step_record : IOData
        One record in which one input steps once; sampled as fast as may be.
    zero_record : IOData or array_like (N,), optional
        Outputs at rest with zero input, for the noise bound: one part, or (N, channels). When
        left out, the parts of the step record before the step and after settling.

    Returns
    -------
    Advice

    Raises
    ------
    DataError
        If no input changes, there are several records, numbers are beyond 1e300, or the channels
        of both records differ.

    Examples
    --------
    >>> import numpy as np, setid
    >>> u = np.append(np.zeros(20), np.ones(180))
    >>> y = setid.simulate(setid.TransferFunction(1, 1, 1), [-0.9, 0.1], u)
    >>> rest = np.random.default_rng(0).uniform(-0.01, 0.01, 500)
    >>> found = setid.advise(setid.IOData(u, y, 0.01), rest)
    >>> print(found.text.splitlines()[0])
    sampling time 0.013 (0.0076 to 0.019): 20 to 50 samples in the transient of 0.38
    """
    if not isinstance(step_record, IOData):
        raise DataError(f"step_record: found {type(step_record).__name__}, expected IOData")
    if step_record.records > 1:  # an input that differs between two records is no step
        raise DataError(f"step_record: found {step_record.records} records, expected one")
    sizes = [np.nanmax(np.abs(values)) for values in (step_record.u, step_record.y, step_record.Ts)]
    if max(sizes) > _LARGEST:
        raise DataError(
            f"step_record: found {max(sizes):g}, expected numbers up to {_LARGEST:g}; choose "
            "other units"
        )
    begin = _step_at(step_record)
    once = _steps_once(step_record, begin)
    answers = [y for y in step_record.y.T if _answers(y, begin)]
    last = max((_settled(y, begin) for y in answers), default=inf) if once else inf
    settling = (last - begin) * step_record.Ts if last < inf else float("nan")
    if zero_record is None:
        parts = _at_rest(step_record, begin, last)
        bound = bound_at_rest(np.concatenate(parts), "step_record") if parts else None
    else:
        bound = bound_at_rest(zero_record, "zero_record")
        if bound.value.size != step_record.outputs:
            raise DataError(
                f"zero_record: found {bound.value.size} channels, expected "
                f"{step_record.outputs}, one an output of step_record"
            )
        parts = [zero_record.y if isinstance(zero_record, IOData) else np.asarray(zero_record)]
    counts = [int(np.min(np.count_nonzero(~np.isnan(part), axis=0))) for part in parts]
    steps = _quantised(step_record)
    found = Advice(
        sampling_time=_rounded(settling / _USUAL),
        sampling_range=(_rounded(settling / _MOST), _rounded(settling / _FEWEST)),
        settling_time=settling,
        noise_bound=bound and _with_rounding(bound, steps, step_record.output_names),
        coverage=_coverage(counts),
        saturation=FrozenMapping(_saturated(step_record)),
        quantisation=FrozenMapping(steps),
        text="",
        record=step_record,
    )
    return replace(found, text="\n".join(_sentences(found, sum(counts), zero_record is not None)))


# ---- what a step response shows ---------------------------------------------------------


def _step_at(data: IOData) -> int:
    """The sample from which some input is another than before, at its largest change."""
    change = np.nan_to_num(np.abs(np.diff(data.u, axis=0)))
    size = change.max(axis=1) if change.size else np.zeros(1)
    if not size.max() > 0:
        raise DataError(
            "step_record: found inputs that never change from one known sample to the next, "
            "expected a step; begin the record before it"
        )
    return int(np.argmax(size)) + 1


def _steps_once(data: IOData, begin: int) -> bool:
    """Check that inputs stay where they are, before and after their largest change."""
    step = np.nan_to_num(np.abs(data.u[begin] - data.u[begin - 1])).max()
    parts = data.u[:begin], data.u[begin:]  # missing samples say nothing
    moved = [np.nan_to_num(np.fmax.reduce(u) - np.fmin.reduce(u)).max() for u in parts]
    return bool(max(moved) <= _STILL * step)


def _settled(y: Reals, begin: int) -> float:
    """The sample from which an output stays near its final value; infinite where it does not."""
    known = np.flatnonzero(~np.isnan(y))
    before, tail = _both_ends(y, begin)
    if not tail.size or not before.size:
        return inf
    final, start = float(np.median(tail)), float(np.median(before))
    noise = max(np.abs(tail - final).max(), np.abs(before - start).max() if begin > 3 else 0.0)
    band = _BAND * abs(final - start) + float(noise)
    after = known[known >= begin]
    outside = after[np.abs(y[after] - final) > band]
    if not outside.size:
        return float(begin + 1)
    last = int(outside[-1]) + 1
    drift = abs(float(np.median(tail[: tail.size // 2]) - np.median(tail[tail.size // 2 :])))
    moving = tail.size > 3 and drift > _BAND * abs(final - start) and drift > 0.5 * float(noise)
    short = y.size - last < max(tail.size / 2, _REST * (last - begin))
    return inf if moving or short else float(last)


def _both_ends(y: Reals, begin: int) -> tuple[Reals, Reals]:
    """Readings before the step and those from which the final value is taken, without gaps."""
    ends = y[:begin], y[max(y.size - max(int(_TAIL * y.size), 3), 0) :]
    return ends[0][~np.isnan(ends[0])], ends[1][~np.isnan(ends[1])]


def _answers(y: Reals, begin: int) -> bool:
    """Check that an output leaves the range that it had before the step, where that is known."""
    before, after = y[:begin], y[begin:]
    if np.count_nonzero(~np.isnan(before)) <= 3 or np.all(np.isnan(after)):
        return True
    start = float(np.nanmedian(before))
    return bool(np.nanmax(np.abs(after - start)) > _ANSWER * np.nanmax(np.abs(before - start)))


def _at_rest(data: IOData, begin: int, last: float) -> list[Reals]:
    """Deviations (N, ny) from rest, before the step and after settling, each about its middle."""
    parts = [data.y[:begin]] if begin > 3 and _constant(data.u[:begin]) else []
    if last < data.samples - 3 and _constant(data.u[begin:]):
        parts.append(data.y[int(last) + (data.samples - int(last)) // 2 :])
    parts = [part[~np.any(np.isnan(part), axis=1)] for part in parts]
    return [part - (part.max(axis=0) + part.min(axis=0)) / 2 for part in parts if len(part) > 1]


def _with_rounding(
    bound: EstimatedBound, steps: Mapping[str, float], names: tuple[str, ...]
) -> EstimatedBound:
    """Widen a bound to half a step of quantisation, by which rounding alone changes readings."""
    halves = np.array([steps.get(name, 0.0) / 2 for name in names])
    if np.all(halves <= bound.value):
        return bound
    value = frozen(np.maximum(bound.value, halves))
    shown = ", ".join(all_digits(v) for v in value)
    text = f"{bound.assumption}, widened to {shown}: half a step of quantised readings"
    return replace(bound, value=value, assumption=text)


def _constant(u: Reals) -> bool:
    """True if no input changes."""
    return bool(np.all(np.nanmax(u, axis=0) == np.nanmin(u, axis=0)))


def _coverage(counts: list[int]) -> float:
    """Share p of noise samples in the widest range of several parts of N samples each.

    A part misses it with the probability N p^(N-1) - (N-1) p^N; the widest misses it if all do.
    """
    if max(counts, default=0) < 2:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(60):
        p = 0.5 * (low + high)
        sure = 1.0 - prod(n * p ** (n - 1) - (n - 1) * p**n for n in counts if n > 1)
        low, high = (p, high) if sure >= _CONFIDENCE else (low, p)
    return low


def _quantised(data: IOData) -> dict[str, float]:
    """Steps of outputs that take few values, all of them multiples of one step."""
    found = {}
    for name, values in zip(data.output_names, data.y.T, strict=True):
        known = values[~np.isnan(values)]
        levels = np.unique(known)
        if 2 < levels.size < _LEVELS * known.size:
            gaps = np.diff(levels)
            step = float(gaps.min())
            parts = gaps / step
            coarse = step > _DIGITS * np.abs(levels).max()
            if coarse and np.all(np.abs(parts - np.round(parts)) < 1e-3 * np.maximum(parts, 1)):
                found[name] = step
    return found


def _saturated(data: IOData) -> dict[str, tuple[float | None, float | None]]:
    """Ends of the ranges of outputs at which readings stick longer than anywhere else."""
    found: dict[str, tuple[float | None, float | None]] = {}
    for name, values in zip(data.output_names, data.y.T, strict=True):
        known = values[~np.isnan(values)]
        runs = _runs(known)
        low, high = float(known.min()), float(known.max())
        if high - low <= _DIGITS * max(abs(low), abs(high)):
            continue  # the doubles themselves have no finer steps
        inner = max([length for value, length in runs if low < value < high], default=1)
        least = max(_RUN, ceil(0.02 * known.size), 2 * inner)
        longest = {end: max(n for value, n in runs if value == end) for end in (low, high)}
        # a signal that rests at an end before the step is no saturation
        first = known[0]
        ends = (
            low if longest[low] >= least and first != low and low < high else None,
            high if longest[high] >= least and first != high and low < high else None,
        )
        if ends != (None, None):
            found[name] = ends
    return found


def _runs(values: Reals) -> list[tuple[float, int]]:
    """Values with the lengths of their runs."""
    edges = np.flatnonzero(np.diff(values) != 0) + 1
    bounds = [0, *edges.tolist(), values.size]
    return [(float(values[a]), b - a) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def _rounded(value: float) -> float:
    """Two digits, which is what a rule of thumb is worth."""
    if not np.isfinite(value) or value <= 0:
        return float("nan")
    return round(value, 1 - floor(log10(value)))


def _square(samples: int, low: float, high: float) -> Reals:
    """Half periods of 30 and 6 samples in turn."""
    long, short = _USUAL, max(_USUAL // 5, 1)
    pattern = [1] * long + [0] * long + ([1] * short + [0] * short) * 3
    levels = np.resize(np.array(pattern, float), samples)
    return np.asarray(low + (high - low) * levels, np.float64)


def _sentences(found: Advice, count: int, own: bool) -> list[str]:
    lines = []
    unit = f" {found.record.time_unit}" if found.record.time_unit else ""
    if np.isfinite(found.sampling_time):
        low, high = found.sampling_range
        lines.append(
            f"sampling time {found.sampling_time:g}{unit} ({low:g} to {high:g}): {_FEWEST} to "
            f"{_MOST} samples in the transient of {found.settling_time:g}{unit}"
        )
        if found.record.Ts > high:
            lines.append(
                f"this record itself is sampled too slowly (Ts = {found.record.Ts:g}{unit}) to "
                "tell the settling time well"
            )
    elif not _steps_once(found.record, _step_at(found.record)):
        lines.append(
            "no input steps once and then stays: sampling and settling times are read off a step "
            "response; record one"
        )
    elif not any(_answers(y, _step_at(found.record)) for y in found.record.y.T):
        lines.append(
            "no output answers the step: what follows it is no larger than what was before; take "
            "a larger step, or record longer"
        )
    elif unknown := _unknown_ends(found):
        lines.append(
            f"no reading of {', '.join(unknown)} is known before the step or at the end of the "
            "record: the settling time needs both"
        )
    else:
        lines.append(
            "the response has not settled by the end of the record: record longer (or the system "
            "integrates, and a pulse is the better test)"
        )
    lines += _on_noise(found, count, own)
    for name, ends in found.saturation.items():
        shown = " and ".join(f"{end:g}" for end in ends if end is not None)
        lines.append(f"{name} sticks at {shown}: {_why_it_sticks(found, name, ends)}")
    for name, step in found.quantisation.items():
        lines.append(
            f"{name} is quantised in steps of {step:g}: at least {step / 2:g} of its noise bound "
            "is rounding; use more of the range of the converter"
        )
    if np.isfinite(found.sampling_time):
        lines.append(
            "an input to begin with: a square wave with half periods of "
            f"{found.settling_time:g}{unit} and of {found.settling_time / 5:g}{unit} in turn, as "
            "advice.square_wave() makes it; several levels where the system may be nonlinear"
        )
    return lines


def _unknown_ends(found: Advice) -> list[str]:
    """Outputs that answer the step and whose level before it, or final value, is missing."""
    begin, names = _step_at(found.record), found.record.output_names
    return [
        name
        for name, y in zip(names, found.record.y.T, strict=True)
        if _answers(y, begin) and not all(part.size for part in _both_ends(y, begin))
    ]


def _why_it_sticks(found: Advice, name: str, ends: tuple[float | None, float | None]) -> str:
    """Say what may hold readings at an end of their range."""
    begin = _step_at(found.record)
    y = found.record.y[:, found.record.output_names.index(name)]
    before, after = (part[~np.isnan(part)] for part in (y[:begin], y[begin:]))
    if after.size and after[-1] in ends:  # it stays there, as what has settled does
        if name in found.quantisation:
            return f"it settles there within a step of its quantisation, or {_CUT}"
        exact = np.unique(before).size == 1
        if exact and not _goes_on(np.append(before[-1:], after)):
            return f"it settles there without any noise, or saturates; {_SMALLER}"
    return _CUT


def _goes_on(values: Reals) -> bool:
    """Check that exact readings end at the last one before their increments would have ended.

    These are continued as a geometric sequence, if there are enough of them.
    """
    reached = int(np.flatnonzero(values == values[-1])[0])
    if np.count_nonzero(np.diff(values[:reached])) < _RUN:
        return False
    before, last = np.abs(np.diff(values[reached - 3 : reached]))
    rest = last**2 / (before - last) if before > last else inf
    height = abs(values[-1] - values[0])
    return bool(rest - abs(values[-1] - values[reached - 1]) > _BAND * height)


def _on_noise(found: Advice, count: int, own: bool) -> list[str]:
    if found.noise_bound is None:
        return ["no part of the record is at rest: record the outputs with zero input"]
    if count < 2:
        return ["one sample at rest shows no noise: record more of them"]
    where = "at rest" if own else "of this record where it is at rest"
    share = rounded(100 * found.coverage, False, 4)
    lines = [
        f"noise bound {found.noise_bound} from {count} samples {where}: with 95 % confidence at "
        f"least {share} % of noise samples lie within the range seen, if they are independent; "
        "take a margin"
    ]
    names = found.record.output_names
    for name, value in zip(names, found.noise_bound.value.tolist(), strict=True):
        half = found.quantisation.get(name, 0.0) / 2
        if value == half > 0:
            lines.append(f"the noise bound of {name} is half a step of its quantisation")
        elif value == 0:
            lines.append(
                f"{name} never changes at rest: noise below the resolution of its sensor is not "
                "seen; take at least half of that as its bound"
            )
    return lines


# ---- planned inputs ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Excitation(ReadOnly):
    """Widths of intervals to expect from a planned input.

    Parameters
    ----------
    names : tuple of str
    theta : (p,) float
        The parameters that were assumed.
    widths : (p,) float
        Of the set that noise of zero would leave: an expectation, no bound.
    wide : tuple of str
        Parameters whose half width is above 30 % of their value, widest first.

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> step = setid.excitation(model, [-0.5, 1.0], [0.0] + [1.0] * 20, setid.Noise(output=0.1))
    >>> step.names, step.widths.shape
    (('a1', 'b1'), (2,))
    """

    names: tuple[str, ...]
    theta: Reals
    widths: Reals
    wide: tuple[str, ...]

    @property
    def text(self) -> str:
        """One sentence."""
        if np.all(np.isinf(self.widths)):
            return "the input says nothing of any parameter: is it zero, or too short?"
        if not self.wide:
            return "every parameter is excited: half widths stay below 30 % of the values"
        return f"will stay wide: {', '.join(self.wide)}; excite more where the system responds"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the expected widths; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_excitation

        return plot_excitation(self, ax)


def excitation(
    model: Structure,
    theta: ArrayLike | Mapping[str, float],
    u: ArrayLike,
    noise: Noise,
    Ts: float | None = None,
) -> Excitation:
    """Expect the widths of intervals for a planned input.

    The plant is simulated with assumed parameters. The rows of its noise-free record leave a set
    about them whose widths are computed by linear programs, the weights of the noise taken at the
    assumed parameters.

    Parameters
    ----------
    model : Structure
        With a regression form.
    theta : array_like (p,) or mapping of names to numbers
        Assumed parameters, such as an estimate from a first record.
    u : array_like (N,) or (N, nu)
        The planned input.
    noise : Noise
    Ts : float, optional
        Sampling interval; that of a continuous-time structure, or 1, when left out.

    Returns
    -------
    Excitation

    Raises
    ------
    ModelError
        If the structure is not linear in its parameters.

    Examples
    --------
    >>> import numpy as np, setid
    >>> model, noise = setid.TransferFunction(na=1, nb=1, nk=1), setid.Noise(equation=0.1)
    >>> rest = setid.excitation(model, [-0.5, 1.0], np.append(np.zeros(20), 1e-3), noise)
    >>> rest.wide
    ('a1', 'b1')
    """
    interval = interval_of(model, Ts)
    model = model if Ts is None else at_rate(model, interval)
    outputs = simulate(model, theta, u)
    inputs = np.asarray(u, float).reshape(len(outputs), model.inputs)
    with silent(SetidWarning):  # widths say what an input does not excite
        formulation = formulate(IOData(inputs, outputs, interval), model, noise)
    rows = formulation.regression
    if rows is None:
        raise ModelError("model: found no regression form, expected one to plan an input for")
    values = formulation.parameter_vector(theta)
    right = rows.radius + rows.radii @ np.abs(values)
    below = sps.csr_array(np.vstack([rows.regressors, -rows.regressors]))
    widths = []
    for direction in np.eye(values.size):
        free = np.full(values.size, inf)
        limits = np.concatenate([right, right])
        found = solve_scaled(-direction, (below, limits), None, (-free, free))
        half = float(found.x @ direction) if found.status == "solved" else inf
        widths.append(2.0 * half)
    share = np.array(widths) / np.maximum(np.abs(values), np.finfo(float).tiny)
    order = [int(i) for i in np.argsort(-share) if share[i] > 2 * _WIDE]
    return Excitation(
        names=formulation.parameters,
        theta=frozen(values.copy()),
        widths=frozen(np.array(widths)),
        wide=tuple(formulation.parameters[i] for i in order),
    )
