"""The steps of :func:`setid.formulate`: plan rows, number unknowns, multiply out, add priors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import asked, frozen, natural
from setid.data.noise import Noise, NoiseBounds, NoiseConstraint
from setid.data.record import IOData
from setid.errors import ModelError, NoiseError, PriorError, SetidError
from setid.formulation.compiler import Planned, assemble, bands, equalities, plan, used_samples
from setid.formulation.layout import Layout, LayoutBuilder
from setid.formulation.lifting import DRIVEN, LIFTED, Lifting, Sum, definitions, lift
from setid.formulation.products import build_products
from setid.formulation.regression import (
    Regression,
    build_regression,
    driven_signals,
    usable_samples,
)
from setid.formulation.signals import Signal, internal_range, measured, missing_ranges, unknown
from setid.formulation.smoothing import smoothed
from setid.models.block import BlockStructured
from setid.models.checked_structures import equations_of
from setid.models.equations import Equation, Structure
from setid.models.lti import TransferFunction
from setid.priors.base import Facts, Prior
from setid.priors.checked_priors import (
    bounds_of,
    description_of,
    rows_of_prior,
    stable_of,
    unknowns_of,
)
from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.problem.rounding import Rounding, rounding_of
from sparsepop_py.verified.uncertain_rows.products import ProductRows

__all__ = ["Built", "Rows", "build", "check_rows_of_priors"]


@dataclass(frozen=True, slots=True, eq=False)
class Rows(ReadOnly):
    """Origin of each constraint of the problem, in arrays of shape (m,).

    Parameters
    ----------
    origin : tuple of {"model", "noise", "prior"}
    equation : tuple of str
        The signal that the equation defines, such as ``"y1"``; empty for others.
    record, sample : (m,) int
        From 1; 0 for constraints of noise and priors.
    item : (m,) int
        Number of the noise constraint or prior, from 0; -1 for the model.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> rows = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=0.5)).rows
    >>> rows.equation, rows.of_sample(3)
    (('y1', 'y1', 'y1'), [1])
    """

    origin: tuple[str, ...]
    equation: tuple[str, ...]
    record: NDArray[np.int64]
    sample: NDArray[np.int64]
    item: NDArray[np.int64]

    @property
    def samples(self) -> set[tuple[int, int]]:
        """The samples that have a constraint, as (record, sample) from 1."""
        return {*zip(self.record.tolist(), self.sample.tolist(), strict=True)} - {(0, 0)}

    def of_sample(self, k: int, record: int = 1) -> list[int]:
        """List constraints of sample k of a record.

        Parameters
        ----------
        k : int
            From 1.
        record : int
            From 1.
        """
        k, record = natural(k, "k", SetidError, 1), natural(record, "record", SetidError, 1)
        return np.flatnonzero((self.sample == k) & (self.record == record)).tolist()

    def of_prior(self, place: int) -> list[int]:
        """List constraints of one prior, by its place among them.

        Parameters
        ----------
        place : int
            From 0.
        """
        place = natural(place, "place", SetidError)
        prior = np.array([origin == "prior" for origin in self.origin], bool)
        return np.flatnonzero(prior & (self.item == place)).tolist()


class Built(NamedTuple):
    """Problem, layout, rows and equations, as :func:`build` returns them."""

    problem: sp.Problem
    layout: Layout
    rows: Rows
    regression: Regression | None
    smoothed: Regression | None
    products: ProductRows | None
    equations: tuple[Equation, ...]
    sums: tuple[Sum, ...]
    dropped: int
    roundings: tuple[Rounding, ...]


class _Collected(NamedTuple):
    constraint: sp.Constraint
    origin: str
    equation: str = ""
    record: int = 0
    sample: int = 0
    item: int = -1


def build(data: IOData, model: Structure, noise: Noise, priors: Sequence[Prior]) -> Built:
    """Assemble the problem; the parts have been checked to fit together."""
    bounds = noise.bounds(data)
    facts = _facts(model, priors)
    equations = equations_of(model, _noisy(data, bounds))
    _check_errors(equations, bounds)
    ranges = missing_ranges(data, model, bounds, facts.bounds)
    driven = driven_signals(data, model)
    usable = usable_samples(data, ranges, driven)
    lifting = lift(equations) if _lifts(model) else Lifting(equations)
    plans = plan(lifting.equations, data, usable, model.initial)
    layout = _number(data, model, noise, priors, bounds, plans, lifting)
    lower, upper = np.full(layout.dimension, -inf), np.full(layout.dimension, inf)
    signals = _signals(data, bounds, layout, plans, ranges, (lower, upper)) | driven
    _bound_noise(layout, bounds, (lower, upper))
    _bound_priors(layout, model, priors, facts, (lower, upper))
    of_priors, roundings = _prior_rows(model, priors, facts, layout)
    rows = [
        *(_Collected(row, "model", LIFTED) for row in definitions(lifting, layout)),
        *_model_rows(plans, data, signals, layout, bounds),
        *_noise_rows(noise, layout),
        *of_priors,
    ]
    problem = sp.Problem(
        layout.polynomial(0), [row.constraint for row in rows], lower, upper, layout.names
    )
    regression = build_regression(data, model, signals, usable, bounds.equation)
    return Built(
        problem=problem,
        layout=layout,
        rows=_rows(rows),
        regression=regression,
        smoothed=smoothed(regression, data, model, bounds),
        products=build_products(data, model, signals, usable, bounds.equation),
        equations=tuple(equations),
        sums=lifting.sums,
        dropped=sum(item.dropped for item in plans),
        roundings=roundings,
    )


def _lifts(model: Structure) -> bool:
    return isinstance(model, TransferFunction | BlockStructured) and model.form in (LIFTED, DRIVEN)


def _rows(found: Sequence[_Collected]) -> Rows:
    return Rows(
        tuple(row.origin for row in found),
        tuple(row.equation for row in found),
        *(
            frozen(np.array([getattr(row, key) for row in found], np.int64))
            for key in ("record", "sample", "item")
        ),
    )


# ---- before any unknown is numbered -----------------------------------------------------


def _noisy(data: IOData, bounds: NoiseBounds) -> set[str]:
    """Measured signals that are not known exactly."""
    groups = (("y", data.y, bounds.output), ("u", data.u, bounds.input))
    return {
        f"{letter}{channel + 1}"
        for letter, values, bound in groups
        for channel in range(values.shape[1])
        if np.any(bound[:, channel] > 0) or np.any(np.isnan(values[:, channel]))
    }


def _check_errors(equations: Sequence[Equation], bounds: NoiseBounds) -> None:
    for equation in equations:
        output = equation.output
        if output is not None and not equation.error:
            if np.any(bounds.equation[:, output] > 0):
                raise ModelError(
                    f"equation noise: found a bound > 0 for output {output + 1}, which is a sum of "
                    "partial outputs without a difference equation of its own; expected output "
                    "noise, common_denominator=True or form='direct'"
                )


def _facts(model: Structure, priors: Sequence[Prior]) -> Facts:
    """Bounds of all priors, intersected."""
    found: dict[str, tuple[float, float]] = {}
    stable: frozenset[tuple[str, ...]] = frozenset()
    for prior in priors:
        described = description_of(prior)
        for name, (low, high) in bounds_of(prior, model).items():
            if name not in model.parameters:
                raise PriorError(
                    f"{described}: found {name!r}, expected one of {', '.join(model.parameters)}"
                )
            if low != low or high != high:
                raise PriorError(f"{described}: found [{low}, {high}] for {name}: no number")
            before = found.get(name, (-inf, inf))
            found[name] = (max(before[0], low), min(before[1], high))
            if found[name][0] > found[name][1]:
                raise PriorError(
                    f"{described}: found [{low:g}, {high:g}] for {name}, expected a part of "
                    f"[{before[0]:g}, {before[1]:g}] from the priors before it"
                )
        stable |= stable_of(prior, model)
    return Facts(found, stable)


# ---- unknowns ---------------------------------------------------------------------------


def _number(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Sequence[Prior],
    bounds: NoiseBounds,
    plans: Sequence[Planned],
    lifting: Lifting,
) -> Layout:
    """Number what occurs in rows; with noise constraints, every noise sample."""
    builder = LayoutBuilder(data)
    used = used_samples(plans, data)
    nothing = np.zeros(data.samples, bool)

    def mask(letter: str, channels: int) -> NDArray[np.bool_]:
        columns = [used.get(f"{letter}{i + 1}", nothing) for i in range(channels)]
        return np.stack(columns, axis=1)

    y_used, u_used = mask("y", data.outputs), mask("u", data.inputs)
    every = bool(noise.constraints)
    builder.named("theta", model.parameters)
    builder.samples("eta", (bounds.output > 0) & (y_used | every))
    builder.samples("xi", (bounds.input > 0) & (u_used | every))
    errors = np.zeros(data.y.shape, bool)
    for item in plans:
        output = item.equation.output
        if item.equation.error and every and output is not None:
            errors[item.rows, output] = bounds.equation[item.rows, output] > 0
    builder.samples("e", errors)
    builder.samples("y", np.isnan(data.y) & y_used)
    builder.samples("u", np.isnan(data.u) & u_used)
    for item in plans:
        if item.equation.output is None:
            builder.samples(item.equation.defines, used[item.equation.defines])
    slack = [name for prior in priors for name in unknowns_of(prior, model)]
    builder.named("slack", slack)
    builder.named(LIFTED, lifting.names)
    return builder.finish()


Box = tuple[NDArray[np.float64], NDArray[np.float64]]


def _signals(
    data: IOData,
    bounds: NoiseBounds,
    layout: Layout,
    plans: Sequence[Planned],
    ranges: Mapping[str, NDArray[np.float64]],
    box: Box,
) -> dict[str, Signal]:
    """All signals, and the boxes of missing samples and products written into ``box``."""
    lower, upper = box
    signals: dict[str, Signal] = {}
    groups = (
        ("y", data.y, bounds.output, "eta"),
        ("u", data.u, bounds.input, "xi"),
    )
    for letter, values, bound, group in groups:
        noise, missing = layout.group(group), layout.group(letter)
        for i in range(values.shape[1]):
            name = f"{letter}{i + 1}"
            limits = ranges[name]
            gone = missing[:, i] >= 0
            lower[missing[gone, i]], upper[missing[gone, i]] = limits[gone].T
            signals[name] = measured(values[:, i], bound[:, i], noise[:, i], missing[:, i], limits)
    internal = [item for item in plans if item.equation.defines not in signals]
    free = np.full(data.samples, inf)
    for item in internal:  # in a loop one is used before it is defined
        name = item.equation.defines
        signals[name] = unknown(layout.group(name), -free, free)
    for item in internal:
        if item.equation.parametric:
            continue
        variable, low, high = layout.group(item.equation.defines), -free, free.copy()
        low[item.rows], high[item.rows] = internal_range(
            item.equation, signals, item.rows, data.first
        )
        present = variable >= 0
        lower[variable[present]], upper[variable[present]] = low[present], high[present]
        signals[item.equation.defines] = unknown(variable, low, high)
    return signals


def _bound_noise(layout: Layout, bounds: NoiseBounds, box: Box) -> None:
    for group, bound in zip(("eta", "xi", "e"), bounds, strict=True):
        numbers = layout.group(group)
        present = numbers >= 0
        box[0][numbers[present]], box[1][numbers[present]] = -bound[present], bound[present]


def _bound_priors(
    layout: Layout, model: Structure, priors: Sequence[Prior], facts: Facts, box: Box
) -> None:
    unknowns = {name: ends for prior in priors for name, ends in unknowns_of(prior, model).items()}
    for name, (low, high) in {**facts.bounds, **unknowns}.items():
        number = layout.index(name)
        box[0][number], box[1][number] = low, high


# ---- rows -------------------------------------------------------------------------------


def _model_rows(
    plans: Sequence[Planned],
    data: IOData,
    signals: Mapping[str, Signal],
    layout: Layout,
    bounds: NoiseBounds,
) -> list[_Collected]:
    """Rows of the equations, in the order of samples."""
    numbers = [*layout.group("theta").tolist(), *layout.group(LIFTED).tolist()]
    parameters = {layout.names[i]: i for i in numbers}
    collected: list[tuple[int, int, _Collected]] = []
    for order, item in enumerate(plans):
        found = assemble(item, signals, parameters, data.first)
        name, first = item.equation.defines, data.first
        samples = (item.rows - first[item.rows] + 1).tolist()
        records = (data.record[item.rows] + 1).tolist()
        many = data.records > 1
        labels = [
            f"{name}[{r},{k}]" if many else f"{name}[{k}]"
            for r, k in zip(records, samples, strict=True)
        ]
        width = np.zeros(item.rows.size)
        output = item.equation.output
        if item.equation.error and output is not None:
            errors = layout.group("e")[item.rows, output]
            found = found.minus(errors)
            width = np.where(errors >= 0, 0.0, bounds.equation[item.rows, output])
        exact, wide = np.flatnonzero(width == 0), np.flatnonzero(width > 0)
        rows = equalities(found.take(exact), layout.names, [labels[i] for i in exact])
        both = bands(found.take(wide), width[wide], layout.names, [labels[i] for i in wide])
        for place, row in zip([*exact, *np.repeat(wide, 2)], [*rows, *both], strict=True):
            entry = _Collected(row, "model", name, records[place], samples[place])
            collected.append((int(item.rows[place]), order, entry))
    collected.sort(key=lambda triple: triple[:2])
    return [entry for _, _, entry in collected]


def _noise_rows(noise: Noise, layout: Layout) -> list[_Collected]:
    rows = []
    for place, item in enumerate(noise.constraints):
        for constraint in _stated(item, layout, f"Noise.constraints[{place}]"):
            good = isinstance(constraint, sp.Constraint)
            good = good and not constraint.kind.is_matrix
            if not good or constraint.polynomial.dimension != layout.dimension:
                raise NoiseError(
                    f"Noise.constraints[{place}]: found {type(constraint).__name__}, expected "
                    "inequalities and equations in layout.variable(...) polynomials"
                )
            rows.append(_Collected(constraint, "noise", item=place))
    return rows


def _stated(item: NoiseConstraint, layout: Layout, place: str) -> list[sp.Constraint]:
    """Ask a constraint on the noise for its rows, and name it where it raises."""
    found: Any = asked(place, lambda: item(layout), NoiseError)
    if not isinstance(found, Iterable):
        raise NoiseError(f"{place}: found {type(found).__name__}, expected a list of constraints")
    return asked(place, lambda: list(found), NoiseError)  # a generator raises here


def check_rows_of_priors(model: Structure, priors: Sequence[Prior]) -> None:
    """Check that priors have bounds and rows for a structure, whatever the samples.

    Raises
    ------
    PriorError
        If one of them speaks of other parameters, or two contradict each other.
    """
    facts = _facts(model, priors)
    slack = [name for prior in priors for name in unknowns_of(prior, model)]
    symbols = _symbols(model, [*model.parameters, *slack])
    for prior in priors:
        rows_of_prior(prior, model, symbols, facts)


def _symbols(model: Structure, names: Sequence[str]) -> dict[str, sp.Polynomial]:
    """Parameters and unknowns of priors as polynomials; in a block structure fixed values too."""
    symbols = dict(zip(names, sp.variables(len(names), names), strict=True))
    if isinstance(model, BlockStructured):
        one = next(iter(symbols.values())) * 0.0 + 1.0
        symbols |= {name: value * one for name, value in model.fixed}
    return symbols


def _prior_rows(
    model: Structure, priors: Sequence[Prior], facts: Facts, layout: Layout
) -> tuple[list[_Collected], tuple[Rounding, ...]]:
    """Rows of priors, and their coefficients that are no doubles as they were written."""
    numbers = np.concatenate([layout.group("theta"), layout.group("slack")])
    symbols = _symbols(model, [layout.names[number] for number in numbers])
    free = np.full(numbers.size, inf)
    rows, roundings = [], []
    for place, prior in enumerate(priors):
        own = rows_of_prior(prior, model, symbols, facts)
        for constraint in own:
            lifted = layout.lift(constraint.polynomial, numbers)
            row = sp.Constraint(lifted, constraint.kind, constraint.name)
            rows.append(_Collected(row, "prior", item=place))
        record = rounding_of(
            f"prior {description_of(prior)}", [row.polynomial for row in own], -free, free
        )
        if record is not None:
            roundings.append(record)
    return rows, tuple(roundings)
