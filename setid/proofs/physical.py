"""Claims about physical parameters: the problem they rest on, and its check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

import sparsepop_py as sp
from setid.data.record import IOData
from setid.errors import PriorError
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.priors.coefficients import Box
from setid.priors.physical import Physical
from setid.proofs.evidence import EndProof, Evidence, Verification
from setid.proofs.existence import admitted
from setid.proofs.fields import well_formed
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.verification import verify

__all__ = ["objectives_of", "problem_within", "verify_physical", "with_relations"]

_ROOM = 1e-6  # of the larger end of an interval: how far the box about it reaches beyond


def with_relations(
    known: Formulation, physical: Physical, intervals: Mapping[str, ParameterInterval]
) -> Formulation:
    """State a problem again with physical parameters and their relations.

    Parameters
    ----------
    known : Formulation
    physical : Physical
    intervals : mapping of str to ParameterInterval
        Proved ones of the coefficients. They become a prior where divisors have no sign without
        them.

    Raises
    ------
    PriorError
        If a relation is none, or divides by what may be zero.
    """
    given = known.data, known.model, known.noise
    try:
        return formulate(*given, (*known.priors, physical))
    except PriorError:
        box = _around(intervals)
        if box is None:
            raise
        return formulate(*given, (*known.priors, box, physical))


def _around(intervals: Mapping[str, ParameterInterval]) -> Box | None:
    """A box around proved intervals, with room for points at their ends."""
    ends = {}
    for name, item in intervals.items():
        low, high = item.outer
        if low <= high and np.any(np.isfinite([low, high])):
            size = max(abs(end) for end in (low, high) if np.isfinite(end))
            ends[name] = (low - _ROOM * size, high + _ROOM * size)
    return Box(ends) if ends else None


def problem_within(
    formulation: Formulation, intervals: Mapping[str, ParameterInterval]
) -> sp.Problem:
    """State the problem of a formulation with the coefficients in proved intervals.

    Parameters
    ----------
    formulation : Formulation
    intervals : mapping of str to ParameterInterval
        One a parameter of the structure; an infinite end says nothing.
    """
    problem = formulation.problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    for place, name in enumerate(formulation.parameters):
        low, high = intervals[name].outer
        lower[place], upper[place] = max(lower[place], low), min(upper[place], high)
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def objectives_of(formulation: Formulation, physical: Physical) -> list[sp.Polynomial]:
    """List the polynomials phi_1, -phi_1, phi_2, ... in all unknowns.

    Parameters
    ----------
    formulation : Formulation
    physical : Physical
    """
    variables = [formulation.layout.variable(name) for name in physical.names]
    return [sign * variable for variable in variables for sign in (1.0, -1.0)]


def verify_physical(
    claims: Evidence,
    physical: Physical,
    intervals: Mapping[str, ParameterInterval],
    ends: Sequence[EndProof],
    data: IOData | None = None,
) -> Verification:
    """Check intervals of physical parameters from the data.

    Parameters
    ----------
    claims : Evidence
        Of the identification of the coefficients, which is checked first.
    physical : Physical
    intervals : mapping of str to ParameterInterval
        The claims about the physical parameters.
    ends : sequence of EndProof
        Certificates and attained points of phi_1, -phi_1, phi_2, ..., in the units of
        :func:`setid.formulation.units.in_units`.
    data : IOData, optional
        The record; the one that was stored when left out.

    Returns
    -------
    Verification
    """
    first = verify(claims, data)
    if not first.ok:
        return first
    empty = all(item.outer == (inf, -inf) for item in intervals.values())
    wrong = _misstated(intervals, empty)
    if claims.empty and not wrong:
        return Verification(empty, "" if empty else "the set is empty, and the intervals are not")
    if tuple(intervals) != physical.names or len(ends) != 2 * len(physical.names):
        return Verification(False, "the intervals are not those of the physical parameters")
    if wrong:
        return Verification(False, f"the status, name or an end of {wrong} is not what is proved")
    known = claims.formulation
    stated = formulate(known.data if data is None else data, known.model, known.noise, known.priors)
    again = with_relations(stated, physical, claims.intervals)
    scaled = in_units(problem_within(again, claims.intervals), again)
    proved = _proved(again, scaled, physical, ends)
    if isinstance(proved, str):
        return Verification(False, proved)
    if empty:
        found = any(low == inf for low, _ in proved)
        return Verification(found, "" if found else "emptiness does not follow")
    for place, (name, item) in enumerate(intervals.items()):
        low, high = proved[2 * place], proved[2 * place + 1]
        if item.outer[0] > low[0] or item.outer[1] < -high[0]:
            return Verification(False, f"the outer interval of {name} does not follow")
        if item.inner is not None and (item.inner[0] < low[1] or item.inner[1] > -high[1]):
            return Verification(False, f"the inner interval of {name} is not attained")
    return Verification(True)


def _misstated(intervals: Mapping[str, ParameterInterval], empty: bool) -> str:
    """Name the first interval whose words claim more than its ends; empty where none does."""
    open_ = (IntervalStatus.CERTIFIED, IntervalStatus.PARTIAL)
    for name, item in intervals.items():
        said = item.status is IntervalStatus.EMPTY if empty else item.status in open_
        if item.name != name or not said or not item.stated or not well_formed(item):
            return name
        if item.status is IntervalStatus.CERTIFIED and item.inner is None:
            return name
    return ""


def _proved(
    again: Formulation, scaled: InUnits, physical: Physical, ends: Sequence[EndProof]
) -> list[tuple[float, float]] | str:
    """Lower bound and attained value of each objective; a sentence where a proof fails."""
    problem, known = scaled.problem, dict[int, Any]()
    found: list[tuple[float, float]] = []
    for objective, end in zip(objectives_of(again, physical), ends, strict=True):
        variable = int(objective.support[0])
        sign, unit = float(objective.coefficients[0]), float(scaled.units[variable])
        lower = float(problem.lower[variable] if sign > 0 else -problem.upper[variable])
        fixed = problem.lower[variable] == problem.upper[variable]
        upper, about = inf, problem.with_objective(scaled.asked(objective)[0])
        if end.attained is not None:
            point = end.attained.recheck(about)
            if point is None:
                return "an attained point could not be proved again"
            if _is_admitted(again, scaled, point):
                upper = lower if fixed else point.value
        if end.certificate is not None:
            verdict = end.certificate.verify(about, known)
            if not verdict.ok:
                return verdict.reason
            lower = max(lower, end.certificate.bound)
        found.append((lower * unit, upper * unit))
    return found


def _is_admitted(again: Formulation, scaled: InUnits, point: sp.ProvedPoint) -> bool:
    units = scaled.units[: len(again.parameters)]
    return admitted(again, point.x[: units.size] * units, np.array(point.radius * units))
