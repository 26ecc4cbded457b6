"""Widths and signs as functions of the noise bounds.

An interval is as good as the noise bound behind it. All noise bounds are multiplied by factors, and
the identification is done again. For each sign that is proved, the least factor at which parameters
of the other sign explain the record is enclosed like any least noise: up to the proved end the sign
holds, at the attained end it is lost.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.consistency import consistency
from setid.data.checks import FrozenMapping, entries_of, frozen, number
from setid.data.digits import all_digits
from setid.data.frames import require_pandas
from setid.data.noise import Noise
from setid.errors import NoiseError, SetidError, warns_once
from setid.formulation.formulation import Formulation, formulate
from setid.html import listing, section
from setid.html import table as html_table
from setid.identify import identify
from setid.minimum_noise.consistency_result import READ_OFF, Consistency, ends_of
from setid.models.continuous import ContinuousTransferFunction, without_delta
from setid.models.equations import Structure
from setid.options import Options, check_executor, checked_options
from setid.priors import Box, parameters
from setid.proofs.evidence import Verification
from setid.proofs.least_noise.noise_scale import scaled_noise
from setid.proofs.parameter_box import start_of
from setid.result.identification import Identification
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.executors.dispatch import map_in_order
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FACTORS", "Sensitivity", "sensitivity"]

FACTORS = (1.0, 1.05, 1.1, 1.25, 1.5, 2.0)
_LEAST = 1e-3  # seconds for a factor when the time is over
_SIGN = {1: "+", -1: "-", 0: "?"}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sensitivity(ReadOnly):
    """Intervals and signs for several factors on all noise bounds.

    Parameters
    ----------
    names : tuple of str
        Parameters.
    factors : (F,) float
    outer : (F, p, 2) float
        Proved ends at each factor; (inf, -inf) where the set is proved empty.
    signs : (F, p) int
        1 or -1 where the sign is proved, 0 where it is not. All are 0 for an empty set.
    lost : mapping of str to (float, float)
        For each sign that is proved at the factor 1: up to the first factor it is proved, by its
        level or an identification; at the second a consistent parameter of the other sign (or
        zero) is attained, infinite where none was found. Both are infinite where the bounds of
        priors give the sign.
    least : Consistency
        The least factor that explains the record.
    results : tuple of Identification
        One a factor.
    levels : mapping of str to Consistency
        What proves ``lost``, where the record does, with the signs of ``base`` and ``results``.
    base : Identification
        The result itself, at the factor 1.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> found = result.sensitivity(factors=[1, 2])
    >>> found.signs.tolist(), found.lost["a1"]
    ([[-1, 1], [-1, 1]], (3.59, 3.5900000000000003))
    """

    names: tuple[str, ...]
    factors: NDArray[np.float64]
    outer: NDArray[np.float64]
    signs: NDArray[np.int64]
    lost: Mapping[str, tuple[float, float]]
    least: Consistency
    results: tuple[Identification, ...]
    levels: Mapping[str, Consistency]
    base: Identification

    def table(self) -> str:
        """Print outer ends and signs, one row a factor and parameter."""
        line = "{:>8}  {:<10}{:>15}{:>15}  {:<6}"
        head = line.format("factor", "parameter", "outer", "", "sign").rstrip()
        lines = [head, "-" * len(head)]
        lines += [line.format(*row).rstrip() for row in self._rows()]
        return "\n".join(lines)

    def summary(self) -> str:
        """Print the table, where signs are lost, and how near bounds are to the least."""
        return "\n".join([self.table(), "", *self._remarks()])

    def verify(self) -> Verification:
        """Check every interval and every factor again, without any solver."""
        if reason := self._misstated() or self._foreign():
            return Verification(False, reason)
        levels = [("the least factor", self.least.verify())]
        levels += [(f"the sign of {name}", level.verify()) for name, level in self.levels.items()]
        results = list(zip(self.factors.tolist(), self.results, strict=True))
        if not any(result is self.base for result in self.results):
            results.append((1.0, self.base))
        levels += [(f"factor {factor:g}", result.verify()) for factor, result in results]
        for what, verdict in levels:
            if not verdict:
                return Verification(False, f"{what}: {verdict.reason}")
        return Verification(True)

    def _misstated(self) -> str:
        """Say what differs from the results; empty where nothing does."""
        parameters = self.base.formulation.parameters
        if self.names != parameters or self.factors.shape != (len(self.results),):
            return "names or factors are not those of the results"
        drawn = _drawn(self.base, self.factors.tolist(), self.results, self.levels)
        same = np.array_equal(self.outer, drawn["outer"])
        same &= np.array_equal(self.signs, drawn["signs"])
        same &= dict(self.lost) == dict(drawn["lost"])
        return "" if same else "ends or signs are not those of the results"

    def _foreign(self) -> str:
        """Name a result that is not about the record with this factor; empty where none is."""
        known = self.base.formulation
        for factor, result in zip(self.factors.tolist(), self.results, strict=True):
            at_base = result is self.base and factor == 1.0
            if not at_base and not _is_with(known, result.formulation, factor):
                return f"factor {factor:g}: the result belongs to another problem"
        pairs = zip(known.parameters, _signs(self.base), strict=True)
        signs = {name: sign for name, sign in pairs if sign}
        if set(self.levels) != set(signs) - _given(known):
            return "levels are not those of the signs"
        levels: list[tuple[Consistency, tuple[Any, ...]]] = [(self.least, ())]
        levels += [(v, (_other(known, n, signs[n]),)) for n, v in self.levels.items()]
        for level, more in levels:
            if not _is_about(known, level.formulation, level.noise, level.limit, more):
                return "a level belongs to another problem"
        return ""

    def to_frame(self) -> Any:
        """Return the table as a pandas DataFrame.

        Raises
        ------
        SolverNotFound
            If pandas is missing; the message says how to install it.
        """
        rows = [
            (float(factor), name, *self.outer[k, i].tolist(), int(self.signs[k, i]))
            for k, factor in enumerate(self.factors)
            for i, name in enumerate(self.names)
        ]
        columns = ["factor", "parameter", "outer_low", "outer_high", "sign"]
        return require_pandas().DataFrame(rows, columns=columns)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the widths over the factors; returns the axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        """
        from setid.plots.decisions import plot_sensitivity

        return plot_sensitivity(self, ax)

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for k, factor in enumerate(self.factors):
            for i, name in enumerate(self.names):
                low, high = self.outer[k, i]
                ends = (
                    ("empty", "")
                    if low > high
                    else (rounded(low, False, 8), rounded(high, True, 8))
                )
                rows.append((f"{factor:g}", name, *ends, _SIGN[int(self.signs[k, i])]))
        return rows

    def _remarks(self) -> list[str]:
        lines = [f"least factor that explains the record: {ends_of(self.least.scale, 4)}"]
        if self.least.noise.model_error:
            lines.append(f"each factor multiplies {self.least.noise.scaled}")
        if any(READ_OFF in text for text in self.least.noise.assumptions):
            lines.append("the noise bound was read off this record: check it on another (holdout=)")
        return [*lines, *(self._remark(name) for name in self.lost)]

    def _remark(self, name: str) -> str:
        """Say where a sign is lost."""
        if name not in self.levels:
            return f"sign of {name}: given by priors"
        proved, attained = self.lost[name]
        if proved == inf:
            return f"sign of {name}: proved at every factor"
        found = f"lost at {rounded(attained, True, 4)}"
        last = found if attained < inf else "not found lost at any"
        return f"sign of {name}: proved up to factor {rounded(proved, False, 4)}, {last}"

    def _repr_html_(self) -> str:
        rows = self._rows()
        head = ["factor", "parameter", "outer (proved)", "", "sign"]
        return section("noise factors", html_table(head, rows), listing("signs", self._remarks()))

    def __repr__(self) -> str:
        return f"<Sensitivity: {len(self.factors)} factors, {len(self.lost)} proved signs>"


@warns_once
def sensitivity(
    result: Identification,
    factors: Iterable[float] = FACTORS,
    options: Options | None = None,
    executor: Executor | None = None,
) -> Sensitivity:
    """Identify again with noise bounds times factors; find where signs are lost.

    Parameters
    ----------
    result : Identification
    factors : iterable of float
        Positive; 1 takes the result itself. ``delta`` of a continuous-time structure is multiplied
        with the noise bounds.
    options : Options, optional
        ``time_limit`` is for all of it together; those of the result when left out.
    executor : concurrent.futures.Executor, optional
        Identifies each factor, and finds each sign's least factor, as a task of its own; every task
        may then take the whole ``time_limit``.

    Returns
    -------
    Sensitivity

    Raises
    ------
    NoiseError
        If the noise has constraints over the record.
    SetidError
        If a factor is not positive.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> print(setid.sensitivity(result, [1.0]).table().splitlines()[2])
           1  a1            -0.52325582    -0.34533333  -
    """
    if not isinstance(result, Identification):
        raise SetidError(f"result: found {type(result).__name__}, expected Identification")
    check_executor(executor)
    listed = entries_of(factors, "factors", "a list of factors", SetidError)
    values = [number(f, "factors", SetidError) for f in listed]
    if not values or not all(0.0 < value < inf for value in values):
        raise SetidError(f"factors: found {values!r:.60}, expected positive numbers")
    formulation = result.formulation
    if formulation.noise.constraints:
        raise NoiseError("noise: found constraints over the record, expected bounds alone")
    settings = checked_options(options, result.options)
    work = _Work(result, settings, settings.deadline())
    every = [(n, s) for n, s in zip(formulation.parameters, _signs(result), strict=True) if s]
    given = _given(formulation)
    signed = [(name, sign) for name, sign in every if name not in given]
    work.left = len(values) + 1 + len(signed)
    tasks: list[tuple[_Work, float | None, tuple[Any, ...]]] = [
        *((work, value, ()) for value in values),
        (work, None, ()),
        *((work, None, (_other(formulation, name, sign),)) for name, sign in signed),
    ]
    if executor is not None:
        work.left = 1
    found = map_in_order(executor, _answer, tasks)
    results, least = tuple(found[: len(values)]), found[len(values)]
    levels = dict(zip([name for name, _ in signed], found[len(values) + 1 :], strict=True))
    return Sensitivity(
        names=formulation.parameters,
        factors=frozen(np.array(values)),
        least=least,
        results=results,
        levels=FrozenMapping(levels),
        base=result,
        **_drawn(result, values, results, levels),
    )


def _drawn(
    base: Identification,
    factors: Sequence[float],
    results: Sequence[Identification],
    levels: Mapping[str, Consistency],
) -> dict[str, Any]:
    """Ends, signs and where these are lost, from the results."""
    proved = _proved(((1.0, base), *zip(factors, results, strict=True)))
    lost = {n: (max(v.scale[0], proved.get(n, 0.0)), v.scale[1]) for n, v in levels.items()}
    pairs = zip(base.formulation.parameters, _signs(base), strict=True)
    return {
        "outer": frozen(np.array([[i.outer for i in r.intervals.values()] for r in results])),
        "signs": frozen(np.array([_signs(r) for r in results])),
        "lost": FrozenMapping({name: lost.get(name, (inf, inf)) for name, sign in pairs if sign}),
    }


def _is_about(
    known: Formulation, found: Formulation, noise: Noise, factor: float, more: Iterable[Any]
) -> bool:
    """Check that a problem is that of a record with its noise bounds times a factor."""
    given, own = noise.bounds(known.data), known.noise.bounds(known.data)
    if not all(map(np.array_equal, given, own)):
        return False
    priors = [*known.priors, *more]
    again = formulate(known.data, without_delta(known.model), scaled_noise(own, factor), priors)
    return again.problem.fingerprint == found.problem.fingerprint


def _is_with(known: Formulation, found: Formulation, factor: float) -> bool:
    """Check that a problem is that of a record with all its noise times a factor."""
    again = formulate(known.data, *_times(known, factor), known.priors)
    return again.problem.fingerprint == found.problem.fingerprint


def _times(known: Formulation, factor: float) -> tuple[Structure, Noise]:
    """Multiply all noise bounds, and delta of a continuous-time structure with them."""
    model, error = known.model, factor * known.noise.model_error
    if isinstance(model, ContinuousTransferFunction):
        model = replace(model, delta=error)
    own = known.noise.covering(0.0).bounds(known.data)
    texts = [f"{text}, times {all_digits(factor)}" for text in known.noise.assumptions]
    return model, scaled_noise(own, factor).covering(error).assuming(texts)


@dataclass(slots=True, eq=False)
class _Work:
    """Identifications and noise levels that share the time."""

    result: Identification
    settings: Options
    until: float
    left: int = 1

    def _options(self) -> Options:
        share = None
        if self.until < inf:
            share = max((self.until - time.monotonic()) / max(self.left, 1), _LEAST)
        self.left -= 1
        return replace(self.settings, time_limit=share)

    def identified(self, factor: float) -> Identification:
        """Identify with all noise bounds times a factor."""
        options, known = self._options(), self.result.formulation
        if factor == 1.0:
            return self.result
        found = identify(known.data, *_times(known, factor), known.priors, options)
        if found.interrupted:  # the others get the least time
            self.until = time.monotonic()
        return found

    def level(self, more: Iterable[Any]) -> Consistency:
        """Find the least factor on the noise bounds with further priors."""
        options, known = self._options(), self.result.formulation
        model, priors = without_delta(known.model), [*known.priors, *more]
        return consistency(known.data, model, known.noise, priors, options)


def _answer(task: tuple[_Work, float | None, tuple[Any, ...]]) -> Any:
    """Identify with a factor, or find the least one with further priors; in any process."""
    work, factor, more = task
    return work.level(more) if factor is None else work.identified(factor)


def _signs(result: Identification) -> list[int]:
    if result.empty:
        return [0] * len(result.intervals)
    return [
        int(item.outer[0] > 0.0) - int(item.outer[1] < 0.0) for item in result.intervals.values()
    ]


def _proved(results: Iterable[tuple[float, Identification]]) -> dict[str, float]:
    """Largest factor whose identification proves a sign; less noise leaves no other members."""
    found: dict[str, float] = {}
    for factor, result in results:
        for name, sign in zip(result.intervals, _signs(result), strict=True):
            if sign:
                found[name] = max(factor, found.get(name, 0.0))
    return found


def _given(formulation: Formulation) -> set[str]:
    """Name the parameters whose sign the bounds of priors give."""
    low, high = start_of(formulation)
    known = (low > 0.0) | (high < 0.0)
    return {n for n, k in zip(formulation.parameters, known, strict=True) if k}


def _other(formulation: Formulation, name: str, sign: int) -> Box | sp.Constraint:
    """The half line where a parameter is zero or has the other sign."""
    low, high = start_of(formulation)
    number = formulation.parameters.index(name)
    if low[number] == 0.0 or high[number] == 0.0:  # a row, so that priors still read their sign
        value = parameters(formulation.model)[name]
        return value <= 0.0 if sign > 0 else value >= 0.0
    return Box({name: (None, 0.0) if sign > 0 else (0.0, None)})
