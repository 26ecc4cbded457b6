"""Put results of identification together, with notes where nothing is found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping
from setid.formulation.formulation import Formulation
from setid.identifiability.dependent_signals import dependent_text
from setid.models.block import BlockStructured
from setid.models.lti import TransferFunction
from setid.options import Options
from setid.priors.base import denominators
from setid.priors.checked_priors import stable_of
from setid.proofs.cells.parts import can_start, parts_of
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import ProvedBox, start_of
from setid.proofs.uniqueness.normalisation import Nonzero
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.result.identification import Identification
from setid.result.reports import active_priors

__all__ = [
    "Outcome",
    "empty_result",
    "free_text",
    "result_of",
    "signals_text",
    "simpler_text",
    "stated_problem",
    "unbounded_text",
]


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Findings of the stages of an identification, ahead of its intervals.

    Parameters
    ----------
    problem : sparsepop_py.Problem, optional
        That of the formulation when left out.
    box, bounds, results, samples, notes, unbounded, reference, nonzero, driven
        As of :class:`Identification`.
    """

    problem: sp.Problem | None = None
    box: ProvedBox | None = None
    bounds: tuple[sp.LinearBound, ...] = ()
    results: tuple[sp.Result, ...] = ()
    samples: tuple[tuple[int, int], ...] = ()
    notes: tuple[str, ...] = ()
    unbounded: Unbounded | None = None
    reference: Identification | None = None
    nonzero: Nonzero | None = None
    driven: Identification | None = None


def stated_problem(outcome: Outcome) -> sp.Problem:
    """Return the problem on the box, which has to be there.

    Parameters
    ----------
    outcome : Outcome
    """
    assert outcome.problem is not None
    return outcome.problem


def result_of(
    formulation: Formulation,
    settings: Options,
    timings: Mapping[str, float],
    intervals: Sequence[ParameterInterval],
    outcome: Outcome,
) -> Identification:
    """Put the parts of a result together.

    Parameters
    ----------
    formulation : Formulation
    settings : Options
    timings : mapping of str to float
    intervals : sequence of ParameterInterval
        One a parameter, in their order.
    outcome : Outcome
    """
    points = [w for item in intervals for w in item.witnesses if w is not None]
    return Identification(
        formulation=formulation,
        intervals=FrozenMapping({item.name: item for item in intervals}),
        problem=formulation.problem if outcome.problem is None else outcome.problem,
        options=settings,
        assumptions=formulation.assumptions,
        box=outcome.box,
        bounds=outcome.bounds,
        results=outcome.results,
        active=FrozenMapping(active_priors(formulation, points) if points else {}),
        samples=tuple((record, sample - 1) for record, sample in outcome.samples),
        timings=FrozenMapping(dict(timings)),
        notes=outcome.notes,
        unbounded=outcome.unbounded,
        reference=outcome.reference,
        nonzero=outcome.nonzero,
        driven=outcome.driven,
    )


def empty_result(
    formulation: Formulation, settings: Options, timings: Mapping[str, float], outcome: Outcome
) -> Identification:
    """Put together the result of a feasible set that is proved empty.

    Parameters
    ----------
    formulation, settings, timings, outcome
        As of :func:`result_of`.
    """
    status = IntervalStatus.EMPTY
    items = [ParameterInterval(n, (inf, -inf), None, status) for n in formulation.parameters]
    noted = replace(outcome, notes=(*outcome.notes, *_exactness(formulation)))
    return result_of(formulation, settings, timings, items, noted)


def _exactness(formulation: Formulation) -> list[str]:
    """Readings are rounded, so noise of exactly zero is almost never consistent."""
    if any(np.any(bound > 0) for bound in formulation.noise.bounds(formulation.data)):
        return []
    y = formulation.data.y
    size = float(np.nanmax(np.abs(y))) * 2.0**-50
    return [
        "readings are rounded, so that no parameters explain them with noise of exactly zero: give "
        "bounds of the errors, output= and input= of the sensors or equation= of the model "
        "(setid.consistency finds the least that explain the record); of an exact simulation the "
        f"rounding alone, Noise(equation={size:.1e})"
    ]


def unbounded_text(formulation: Formulation, loose: NDArray[np.int64]) -> str:
    """Say which parameters the data leave unbounded, and what bounds them."""
    names = ", ".join(formulation.parameters[i] for i in loose)
    model = formulation.model
    if isinstance(model, BlockStructured) and formulation.products is None:
        return (
            f"no finite bounds of {names} were found: the outputs are no sums of products of "
            f"measured signals; give Box for {names}{_other_way(formulation)}"
        )
    apart = dependent_text(formulation)
    if apart:
        return f"the data give no finite bounds of {names}: {apart}"
    why, prior = _why_loose(formulation)
    return (
        f"no finite bounds of {names} were found: {why}; give a prior such as {prior}, a longer "
        "record, or more excitation"
    )


def _why_loose(formulation: Formulation) -> tuple[str, str]:
    """Say what leaves parameters unbounded, and which priors bound them."""
    model, why = formulation.model, "the noise is strong for this input"
    if not isinstance(model, TransferFunction):
        return why, "Box or Stable"
    stable = {names for prior in formulation.priors for names in stable_of(prior, model)}
    prior = "Box" if set(denominators(model)) <= stable else "Stable or Box"
    if all(len(model.denominators(i)) < 2 for i in range(model.outputs)):
        return why, prior
    why = "rows with the denominators multiplied out leave them open at this noise"
    pairs = [(i, j) for i in range(model.outputs) for j in range(model.inputs)]
    every = [model.transfer(i + 1, j + 1) for i, j in pairs]
    if any(one.denominator and len(one.numerator) > 1 for one in every):
        why += ", and no record tells a factor that a numerator shares with its denominator"
    return why, prior


def _other_way(formulation: Formulation) -> str:
    """Say what else gives a box to a structure with a map behind a linear block."""
    parts = parts_of(formulation)
    if parts is None:
        return ""
    number = {name: i for i, name in enumerate(formulation.parameters)}
    start = start_of(formulation)[:, [number[name] for name in parts.poles]]
    missing = "" if np.all(np.isfinite(start)) else "Stable"
    rest = "initial='zero' where the record begins at rest"
    if parts.initial and len(parts.poles) == 1:
        rest = f"Box for {parts.poles[0]} that leaves out -1 and 0, or {rest}"
    if not can_start(parts):
        return f", or {missing} and {rest}" if missing else f", or {rest}"
    if missing:
        return f", or {missing}"
    return f", or {rest}" if parts.initial else ""


def signals_text(formulation: Formulation, problem: sp.Problem) -> tuple[str, ...]:
    """Say which internal signals nothing bounds, and what does.

    Parameters
    ----------
    formulation : Formulation
    problem : Problem
        With the box of the parameters, as it is solved.
    """
    model, groups = formulation.model, formulation.layout.groups
    if not isinstance(model, BlockStructured) or model.initial != "free":
        return ()
    sizes = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    loose = [n for n in model.internal if n in groups]
    loose = [n for n in loose if np.any(np.isinf(sizes[groups[n][groups[n] >= 0]]))]
    if not loose:
        return ()
    return (
        f"nothing bounds the internal signals {', '.join(loose)}, whose first samples are unknown: "
        "with initial='zero', where the record begins at rest, the past bounds them",
    )


def free_text(free: tuple[str, ...]) -> tuple[str, ...]:
    """Say that noise alone explains the record."""
    if not free:
        return ()
    return (
        "noise within its bounds explains the whole record without any system: nothing is learnt "
        f"of {', '.join(free)}; excite more strongly, or lower the noise bounds",
    )


def simpler_text(unbounded: Unbounded) -> tuple[str, ...]:
    """Say that a simpler structure makes parameters unbounded."""
    simpler = unbounded.model
    return (
        f"the data give no finite bounds of {', '.join(unbounded.names)}, proved: {simpler!r} with "
        "a pole less explains the data as well, and nothing limits the pole that is added to it; "
        "take the lower order, less noise, more excitation, or a prior such as Stable",
    )
