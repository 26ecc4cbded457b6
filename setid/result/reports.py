"""Reports for people: the table, the samples that bind, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.feasible_points.centre import central
from setid.feasible_set.feasible_set import FeasibleSet
from setid.formulation.completion import noise_shares
from setid.formulation.formulation import Formulation
from setid.html import listing, section
from setid.html import table as html_table
from setid.identifiability.dependent_signals import dependent_parameters
from setid.minimum_noise.conflicting_samples import samples_listed
from setid.priors.checked_priors import bounds_of, description_of, unknowns_of
from setid.priors.transfer import Stable
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = [
    "NOT_CLAIMED",
    "Remarks",
    "active_priors",
    "advice",
    "binding",
    "binding_kinds",
    "conflict",
    "channels",
    "html",
    "summary",
    "table",
]

_KINDS = {"eta": "output noise", "xi": "input noise", "e": "equation error"}
NOT_CLAIMED = "nothing is claimed to be attained"  # the end of a note that says why
_FEW = 12  # samples that are listed even where they are all
_NEAR = 1e-6  # closer than this share of a bound counts as at it
_WIDE = 0.3  # relative half width from which an interval is called wide


def table(result: FeasibleSet) -> str:
    """Print intervals as text: outer ends and widths rounded outwards, inner ends inwards."""
    line = "{:<10}{:>15}{:>15}{:>15}{:>15}{:>10}  {}"
    head = line.format("parameter", "outer", "", "inner", "", "width", "status")
    lines = [head, "-" * len(head)]
    for item in result.intervals.values():
        ends = _ends(result, item, "-")
        lines.append(line.format(item.name, *ends, rounded(item.width, True, 3), item.status))
    named = channels(result.formulation.data)
    return "\n".join(lines + ([named] if named else []))


def _ends(result: FeasibleSet, item: ParameterInterval, none: str) -> tuple[str, str, str, str]:
    """Round outer ends outwards and inner ends inwards; ``none`` stands for no inner end.

    Inner ends that cross when they are rounded are shown as one number, "near" it.
    """
    if result.empty:
        return "empty", "", none, none
    inner = (none, none)
    if item.inner is not None:
        inner = rounded(item.inner[0], True, 8), rounded(item.inner[1], False, 8)
        if float(inner[0]) > float(inner[1]):
            inner = "near", f"{0.5 * item.inner[0] + 0.5 * item.inner[1]:.8g}"
    return rounded(item.outer[0], False, 8), rounded(item.outer[1], True, 8), *inner


def html(result: FeasibleSet, remarks: Remarks, said: list[str] | None = None) -> str:
    """Write intervals and what they rest on as HTML for notebooks.

    Parameters
    ----------
    result : FeasibleSet
    remarks : Remarks
    said : list of str, optional
        The advice, where it is known.
    """
    rows = []
    for item in result.intervals.values():
        rows.append(
            (item.name, *_ends(result, item, ""), rounded(item.width, True, 3), item.status)
        )
    head = ["parameter", "outer (proved)", "", "inner (attained)", "", "width", "status"]
    named = channels(result.formulation.data)
    return section(
        repr(result.formulation.model) + (f": {named}" if named else ""),
        html_table(head, rows),
        listing("remarks", advice(result, remarks) if said is None else said),
        listing("notes", remarks.notes),
        listing("taken for granted", remarks.assumptions),
    )


def advice(result: FeasibleSet, remarks: Remarks, time_limit: float = 10.0) -> list[str]:
    """Write sentences on statuses, wide intervals and the samples that bind.

    Parameters
    ----------
    result : FeasibleSet
    remarks : Remarks
    time_limit : float
        Seconds for what is said of the centre; see :func:`setid.central`.
    """
    mixed = _mixed(result)
    known = [item for item in result.intervals.values() if item.name not in mixed]
    statuses = dict.fromkeys(item.status for item in known)
    helps = {IntervalStatus.PARTIAL: _help(result, known, remarks)}
    lines = [f"{status}: {helps.get(status, status.message)}" for status in statuses]
    return lines + _centre(result, time_limit) + _narrowing(result, remarks)


def _help(result: FeasibleSet, items: list[ParameterInterval], remarks: Remarks) -> str:
    """Say what keeps intervals open in this run, and what would close them."""
    partial = [item for item in items if item.status is IntervalStatus.PARTIAL]
    loose = [item.name for item in partial if not np.all(np.isfinite(item.outer))]
    stable = any(isinstance(prior, Stable) for prior in result.formulation.priors)
    if loose:
        shown = ", ".join(loose[:6]) + (", ..." if len(loose) > 6 else "")
        prior = f"Box for {loose[0]}" if stable else f"Stable, or Box for {loose[0]}"
        return (
            f"No finite ends of {shown} follow from the data and the priors by the methods that "
            f"were tried: give a prior such as {prior}, a stronger input or less noise."
        )
    if any(text.endswith(NOT_CLAIMED) for text in remarks.notes):
        return "The outer ends are proved. The notes say why none is claimed to be attained."
    found = "not attained within the tolerance"
    if any(item.inner is None for item in partial):
        found = "no consistent parameters were found"
    prior = "Box" if stable else "Box and Stable"
    return f"The outer ends are proved, but {found}: give more time, or priors such as {prior}."


def _mixed(result: FeasibleSet) -> set[str]:
    """Find open parameters that no time settles, since their signals depend on each other."""
    loose = {n for n, item in result.intervals.items() if item.outer == (-np.inf, np.inf)}
    loose = {n for n in loose if result.intervals[n].status is IntervalStatus.PARTIAL}
    return loose & set(dependent_parameters(result.formulation)) if loose else loose


def channels(data: IOData) -> str:
    """List names and units of channels by number, empty where they have none."""
    own = [f"y{i + 1}" for i in range(data.outputs)] + [f"u{j + 1}" for j in range(data.inputs)]
    shown = (*data.output_labels, *data.input_labels)
    pairs = [f"{o} = {s}" for o, s in zip(own, shown, strict=True) if o != s]
    return ", ".join(pairs)


def binding(result: FeasibleSet) -> tuple[tuple[int, int, int], ...]:
    """List samples with noise at its bound where ends are attained: (record, sample, count)."""
    count: dict[tuple[int, int], int] = {}
    for record, sample, _ in _hits(result):
        count[record, sample] = count.get((record, sample), 0) + 1
    order = sorted(count, key=lambda key: (-count[key], key))
    return tuple((*key, count[key]) for key in order)


def binding_kinds(result: FeasibleSet) -> dict[str, int]:
    """Count how often each kind of noise is at its bound where ends are attained."""
    count: dict[str, int] = {}
    for *_, kind in _hits(result):
        count[kind] = count.get(kind, 0) + 1
    return count


def _hits(result: FeasibleSet) -> list[tuple[int, int, str]]:
    """(record, sample, kind) for each noise sample at its bound at each attained end."""
    formulation, found = result.formulation, []
    problem, rows, data = formulation.problem, formulation.rows, formulation.data
    band = np.flatnonzero((rows.sample > 0) & ~problem.equality)
    near = _near_bound(formulation, band)
    for x in result.witnesses:
        values = problem.rows.values(x)[band]
        for row in band[np.abs(values) <= near].tolist():
            found.append((int(rows.record[row]), int(rows.sample[row]) - 1, _KINDS["e"]))
        for group, kind in _KINDS.items():
            numbers = formulation.layout.group(group)
            place, channel = np.nonzero(numbers >= 0)
            bound = problem.upper[numbers[place, channel]]
            full = np.abs(x[numbers[place, channel]]) >= (1.0 - _NEAR) * bound
            for row in place[full].tolist():
                sample = row - int(data.first[row])
                found.append((int(data.record[row]) + 1, sample, kind))
    return found


def _near_bound(formulation: Formulation, band: NDArray[np.int64]) -> NDArray[np.float64]:
    """Distance from the bound of an equation error below which it counts as at it, for each row."""
    rows, constraints = formulation.rows, formulation.problem.constraints
    constant = np.array([constraints[i].polynomial.constant_term for i in band], float)
    pairs = [(rows.record[i], rows.sample[i], rows.equation[i]) for i in band]
    number = {pair: place for place, pair in enumerate(dict.fromkeys(pairs))}
    place = np.array([number[pair] for pair in pairs], int)
    width = np.bincount(place, constant)  # the two rows of an error differ in sign but for it
    rounding = 16.0 * np.finfo(float).eps * np.abs(constant) + 1e-300
    return 0.5 * _NEAR * np.abs(width[place]) + rounding


def active_priors(formulation: Formulation, points: list[NDArray[np.float64]]) -> dict[str, bool]:
    """Tell for each prior whether it holds with equality at some of the points."""
    problem, layout = formulation.problem, formulation.layout
    values = [problem.rows.values(x) for x in points]
    found: dict[str, bool] = {}
    for place, prior in enumerate(formulation.priors):
        own = {layout.index(name) for name in unknowns_of(prior, formulation.model)}
        every = formulation.rows.of_prior(place)
        rows = [r for r in every if not problem.equality[r]]
        fixed = [problem.constraints[r].polynomial.support for r in every if problem.equality[r]]
        tight = any(
            v[r] <= _NEAR * _size(problem.constraints[r].polynomial, x)
            for x, v in zip(points, values, strict=True)
            for r in rows
        )
        # an equation in the parameters alone always holds; others may define own unknowns
        tight = tight or any(own.isdisjoint(np.asarray(used).tolist()) for used in fixed)
        ends = {**bounds_of(prior, formulation.model), **unknowns_of(prior, formulation.model)}
        for name, (low, high) in ends.items():
            x = np.array([point[layout.index(name)] for point in points])
            most = float(np.max(np.abs(x), initial=0.0))
            unit = [_NEAR * (max(abs(e), most) if np.isfinite(e) else 0.0) for e in (low, high)]
            tight = tight or bool(np.any((x <= low + unit[0]) | (x >= high - unit[1])))
        found[description_of(prior)] = found.get(description_of(prior), False) or tight
    return found


def _size(polynomial: sp.Polynomial, x: NDArray[np.float64]) -> float:
    """Sum of the sizes of a polynomial's terms at a point: its scale there."""
    used = polynomial.support
    powers = polynomial.exponents[:, used].toarray()
    return float(np.abs(polynomial.coefficients) @ np.prod(np.abs(x[used]) ** powers, axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Remarks:
    """Remarks of a summary beside the intervals; fields as of :class:`Identification`."""

    active: Mapping[str, bool]
    samples: tuple[tuple[int, int], ...]
    notes: tuple[str, ...]
    assumptions: tuple[str, ...]


def summary(result: FeasibleSet, remarks: Remarks) -> str:
    """Write the table, its assumptions, and advice on wide or empty intervals.

    Parameters
    ----------
    result : FeasibleSet
    remarks : Remarks
    """
    lines = [repr(result.formulation)[1:-1], "", table(result), ""]
    lines += advice(result, remarks)
    for text, active in remarks.active.items():
        lines.append(f"prior {text}: {'active' if active else 'not active'}")
    lines += [f"note: {text}" for text in remarks.notes]
    lines += ["taken for granted:", *(f"- {text}" for text in remarks.assumptions)]
    return "\n".join(lines)


def _narrowing(result: FeasibleSet, remarks: Remarks) -> list[str]:
    """Name wide intervals, and the samples and noise that keep them so; or what contradicts."""
    if result.empty:
        return [_conflicting(result, remarks)]
    lines = []
    mixed = _mixed(result)
    wide = [
        item.name
        for item in result.intervals.values()
        if not item.width < 2 * _WIDE * abs(item.centre)
        and item.width > 0
        and item.status is not IntervalStatus.UNIDENTIFIABLE
        and item.name not in mixed
    ]
    if wide:
        lines.append(
            f"wide (more than {100 * _WIDE:.0f} % about the centre, or zero inside): "
            f"{', '.join(wide)}. A longer record, or an input with more power where the system "
            "responds, narrows them; so does a lower noise bound, as far as the record allows one."
        )
    hits, kinds = binding(result), binding_kinds(result)
    if hits:
        shown = samples_listed(tuple((r, k) for r, k, _ in hits), result.formulation.data.records)
        lines.append(f"samples that bind at the ends: {shown}: check these readings first")
    if kinds:
        parts = ", ".join(f"{kind} {count} times" for kind, count in sorted(kinds.items()))
        lines.append(f"at its bound where ends are attained: {parts}")
    return lines + _sensors(result)


def _sensors(result: FeasibleSet) -> list[str]:
    """Compare the kinds of noise in the equations: the gain of a better sensor."""
    points = result.witnesses
    theta = result.formulation.layout.group("theta")
    if not points:
        return []
    shares = noise_shares(result.formulation, np.mean([x[theta] for x in points], axis=0))
    named = {_KINDS[group]: share for group, share in shares.items()}
    if not named:
        return []
    if len(named) == 1:
        (kind,) = named
        if result.formulation.noise.model_error and kind == _KINDS["eta"]:
            kind = "output noise, with delta in it"
        return [
            f"all uncertainty of the equations is {kind}: a lower bound of it narrows all intervals"
        ]
    most, least = max(named, key=lambda k: named[k]), min(named, key=lambda k: named[k])
    parts = ", ".join(f"{kind} {100 * share:.0f} %" for kind, share in named.items())
    return [
        f"shares of the uncertainty of the equations: {parts}; a better sensor pays most for "
        f"{most}, and a cheaper one costs least for {least}"
    ]


def _centre(result: FeasibleSet, time_limit: float) -> list[str]:
    """The centre with its worst-case errors, where all intervals are finite."""
    if result.empty or not all(np.isfinite(item.width) for item in result.intervals.values()):
        return []
    return [f"centre: {central(result, time_limit)}"]


def _conflicting(result: FeasibleSet, remarks: Remarks) -> str:
    if not remarks.samples:
        return "no few samples are to blame: the proof uses the record as a whole"
    return conflict(remarks.samples, result.formulation)


def conflict(samples: tuple[tuple[int, int], ...], formulation: Formulation) -> str:
    """Name samples that are proved to contradict each other, or say that no few were found.

    Parameters
    ----------
    samples : tuple of (record, sample)
        Records from 1, samples from 0.
    formulation : Formulation
    """
    every = len(formulation.rows.samples)
    if len(samples) == every > _FEW:
        return (
            f"the equations of {every} samples, all that there are, contradict each other "
            "together; no smaller group was found"
        )
    return (
        f"samples that contradict each other: {samples_listed(samples, formulation.data.records)}"
    )
