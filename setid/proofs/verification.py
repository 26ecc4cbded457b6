"""Check claims about a record again, from the data and without any solver."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

import sparsepop_py as sp
from setid.data.record import IOData
from setid.errors import NoiseError
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.models.block import BlockStructured
from setid.proofs.driven import driven, within_driven
from setid.proofs.evidence import Evidence, Verification, as_verdict
from setid.proofs.existence import admitted, rows_say_all
from setid.proofs.intervals import IntervalStatus
from setid.proofs.parameter_box import box_follows, objectives, problem_on_box
from setid.proofs.uniqueness.free_parameters import free_parameters
from setid.proofs.uniqueness.normalisation import reference_follows, unidentifiable

__all__ = ["verify"]


@as_verdict
def verify(claims: Evidence, data: IOData | None = None) -> Verification:
    """Check formulation, box, outer and inner ends from the data.

    Parameters
    ----------
    claims : Evidence
    data : IOData, optional
        The record; the one that was stored when left out.

    Returns
    -------
    Verification
        True where every claim holds; no value of a solver is trusted.
    """
    given = claims.formulation
    record = given.data if data is None else data
    try:
        again = formulate(record, given.model, given.noise, given.priors)
    except NoiseError as cause:
        return Verification(False, f"the noise bounds are those of another record: {cause}")
    if again.problem.fingerprint != given.problem.fingerprint:
        return Verification(False, _other_data(given.data, record))
    if reason := _misstated(claims, again):
        return Verification(False, reason)
    if claims.reference is not None:
        return _verify_reference(claims, claims.reference, again)
    if reason := _box_fails(claims, again):
        return Verification(False, reason)
    if any(part is not None and part.empty for part in (claims.box, claims.driven)):
        return Verification(claims.empty, "" if claims.empty else _NOT_EMPTY)
    if claims.bounds:
        return _verify_linear(claims, again)
    problem = problem_on_box(again, claims.box)
    if claims.driven is not None:
        problem = within_driven(problem, again, claims.driven.intervals)
    if problem.fingerprint != claims.problem.fingerprint:
        return Verification(False, "the problem is not that of the box")
    fewer = _verify_fewer(claims.fewer_priors, again)
    return _verify_results(claims, again, in_units(problem, again)) if fewer.ok else fewer


def _other_data(given: IOData, found: IOData) -> str:
    """Say that a record is not the one identified from, nor the whole of which that is a part."""
    reason = "the result belongs to other data"
    if given.samples < found.samples:
        reason += (
            f": it has {given.samples} samples, this record {found.samples}; result.verify() "
            "takes the right one, also where some were held out"
        )
    return reason


def _misstated(claims: Evidence, again: Formulation) -> str:
    """Say what is wrong with intervals as they are stated; nothing if they may hold."""
    names = [(name, item.name) for name, item in claims.intervals.items()]
    if names != [(name, name) for name in again.parameters]:
        return "the intervals are not those of the parameters, in their order"
    nothing = IntervalStatus.EMPTY, (inf, -inf), None
    for item in claims.intervals.values():
        if claims.empty and (item.status, item.outer, item.inner) != nothing:
            return f"nothing is consistent, and {item.name} is not said to be empty"
        if item.status is IntervalStatus.CERTIFIED and item.inner is None:
            return f"{item.name} is said to be certified, and nothing is attained"
    return ""


_SAYS = (IntervalStatus.UNBOUNDED, IntervalStatus.UNIDENTIFIABLE)  # more than intervals do
_NOT_EMPTY = "the box is empty, and the intervals are not"


def _verify_fewer(found: Evidence | None, again: Formulation) -> Verification:
    """Check the evidence with some of the priors, as if they had been given alone."""
    if found is None:
        return Verification(True)
    if found.fewer_priors is not None:
        return Verification(False, "evidence with fewer priors rests on further evidence")
    kept = [prior for prior in again.priors if prior in found.formulation.priors]
    stated = formulate(again.data, again.model, again.noise, kept)
    if stated.problem.fingerprint != found.formulation.problem.fingerprint:
        return Verification(False, "the evidence with fewer priors is about another problem")
    return verify(replace(found, formulation=stated), again.data)


def _box_fails(claims: Evidence, again: Formulation) -> str:
    """Say why the box of the parameters does not follow; empty where it does.

    Rows with an offset of the equation are checked as if they had been asked.
    """
    if claims.box is not None and not box_follows(claims.box, again):
        return "the box does not follow from the data"
    if claims.driven is None:
        return ""
    stated = driven(again)
    if stated is None:
        return "rows with an offset of the equation prove nothing here"
    if stated.problem.fingerprint != claims.driven.formulation.problem.fingerprint:
        return "rows with an offset of the equation are those of another problem"
    return verify(replace(claims.driven, formulation=stated), again.data).reason


def _verify_reference(claims: Evidence, found: Evidence, again: Formulation) -> Verification:
    """Check the evidence with a normalisation, and that no more is claimed than follows."""
    reference = found.formulation.model
    if not isinstance(again.model, BlockStructured) or not isinstance(reference, BlockStructured):
        return Verification(False, "only block structures have a reference")
    if not reference_follows(again, reference, claims.nonzero):
        return Verification(False, "the normalisation of the reference does not follow")
    stated = formulate(again.data, reference, again.noise, again.priors)
    if stated.problem.fingerprint != found.formulation.problem.fingerprint:
        return Verification(False, "the reference is not that of the data")
    if found.empty != claims.empty:
        return Verification(False, "emptiness is not that of the reference")
    known: dict[str, Any] = {n: (item.outer, item.inner) for n, item in found.intervals.items()}
    scales = dict.fromkeys(unidentifiable(again.model), ((-inf, inf), None))
    known |= scales
    for name, item in claims.intervals.items():
        if not claims.empty and (item.outer, item.inner) != known.get(name):
            return Verification(False, f"the interval of {name} is not that of the reference")
        of_scale = name in scales and item.status is IntervalStatus.UNIDENTIFIABLE
        if item.status in _SAYS and not of_scale:
            if name not in found.intervals or found.intervals[name].status is not item.status:
                return Verification(False, f"it is not proved that {name} is {item.status}")
    # with the priors as stated: a prior may ask for more than its rows do
    return verify(replace(found, formulation=stated), again.data)


def _verify_linear(claims: Evidence, again: Formulation) -> Verification:
    if not rows_say_all(again):
        return Verification(False, "a prior means more than rows say, and is not asked of points")
    proved, asked = [], objectives(again)
    if len(claims.bounds) != len(asked):
        return Verification(False, "bounds are missing")
    for bound, objective in zip(claims.bounds, asked, strict=True):
        verdict = bound.verify(again.problem, objective)
        if not verdict.ok:
            return Verification(False, verdict.reason)
        proved.append((bound.lower, bound.upper))
    for place, item in enumerate(claims.intervals.values()):
        falls = [upper == -inf for _, upper in proved[2 * place : 2 * place + 2]]
        if str(item.status) in ("unbounded", "unidentifiable"):
            if not (all if str(item.status) == "unidentifiable" else any)(falls):
                return Verification(False, f"it is not proved that {item.name} is {item.status}")
    return _ends_follow(claims, proved)


def _verify_results(claims: Evidence, again: Formulation, scaled: InUnits) -> Verification:
    claimed = {n for n, item in claims.intervals.items() if str(item.status) == "unbounded"}
    why = claims.unbounded if claimed else None
    shown = why.names if why is not None and why.verify(again) else ()
    if not claimed <= set(shown):
        return Verification(False, f"it is not proved that {', '.join(claimed)} are unbounded")
    problem, known = scaled.problem, dict[int, Any]()
    count = 2 * len(again.parameters)
    if len(claims.ends) not in (0, count):
        return Verification(False, "proofs of ends are missing")
    ends = [(problem_low(problem, number), inf) for number in range(count)]
    asked, points = objectives(again), list[sp.ProvedPoint]()
    for number, found in enumerate(claims.ends):
        about = problem.with_objective(scaled.asked(asked[number])[0])
        lower, upper = problem_low(problem, number), inf
        if found.certificate is not None:
            verdict = found.certificate.verify(about, known)
            if not verdict.ok:
                return Verification(False, verdict.reason)
            lower = max(lower, found.certificate.bound)
        if found.attained is not None:
            point = found.attained.recheck(about)
            if point is None:
                return Verification(False, "an attained point could not be proved again")
            if _is_admitted(again, scaled, point):
                upper = point.value
                points.append(point)
        ends[number] = lower, upper
    for number, (lower, upper) in enumerate(ends):
        unit = float(scaled.units[number // 2])
        upper = min([upper, *(_reached(problem, p, number) for p in points)])
        ends[number] = max(lower * unit, _with_fewer(claims, number)), upper * unit
    return _ends_follow(claims, ends) if claims.empty else _with_free(claims, again, ends, points)


def _is_admitted(again: Formulation, scaled: InUnits, point: sp.ProvedPoint) -> bool:
    p = len(again.parameters)
    units = scaled.units[:p]
    return admitted(again, point.x[:p] * units, point.radius * units)


def _with_free(
    claims: Evidence,
    again: Formulation,
    ends: list[tuple[float, float]],
    points: list[sp.ProvedPoint],
) -> Verification:
    """Add the ends of parameters that change no row."""
    free = set(free_parameters(again)[0])
    for place, item in enumerate(claims.intervals.values()):
        silent = not np.any(again.problem.rows.words == place + 1)
        if str(item.status) == "unidentifiable" and not (silent or item.name in free):
            return Verification(False, f"it is not proved that {item.name} is unidentifiable")
        if item.name in free:
            ends[2 * place : 2 * place + 2] = [(-inf, -inf)] * 2
        elif silent:
            ends[2 * place : 2 * place + 2] = _given(again, place, bool(points))
    return _ends_follow(claims, ends)


def _given(again: Formulation, place: int, attained: bool) -> list[tuple[float, float]]:
    """The ends of a parameter that no row speaks of: its own bounds."""
    low, high = float(again.problem.lower[place]), -float(again.problem.upper[place])
    return [(low, low if attained else inf), (high, high if attained else inf)]


def _reached(problem: sp.Problem, point: sp.ProvedPoint, number: int) -> float:
    """An upper end of objective ``number`` at a proved point."""
    place, sign = number // 2, 1.0 if number % 2 == 0 else -1.0
    if problem.lower[place] == problem.upper[place]:
        return sign * float(problem.lower[place])
    return float(np.nextafter(sign * point.x[place] + point.radius, inf))


def _with_fewer(claims: Evidence, number: int) -> float:
    """Lower bound of objective ``number`` from checked evidence with fewer priors."""
    if claims.fewer_priors is None:
        return -inf
    low, high = list(claims.fewer_priors.intervals.values())[number // 2].outer
    return low if number % 2 == 0 else -high


def problem_low(problem: sp.Problem, number: int) -> float:
    """Lower bound of objective ``number`` from the bounds of the problem."""
    i = number // 2
    return float(problem.lower[i] if number % 2 == 0 else -problem.upper[i])


def _ends_follow(claims: Evidence, ends: list[tuple[float, float]]) -> Verification:
    """Check that the intervals claim no more than was found again."""
    for number, item in enumerate(claims.intervals.values()):
        low, high = ends[2 * number], ends[2 * number + 1]
        if claims.empty:
            if not any(end[0] == inf for end in ends):
                return Verification(False, "emptiness does not follow")
            continue
        if not item.stated:
            return Verification(False, f"an end of the interval of {item.name} is no number")
        if item.outer[0] > low[0] or item.outer[1] < -high[0]:
            return Verification(False, f"the outer interval of {item.name} does not follow")
        if item.inner is not None and (item.inner[0] < low[1] or item.inner[1] > -high[1]):
            return Verification(False, f"the inner interval of {item.name} is not attained")
    return Verification(True)
