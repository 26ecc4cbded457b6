"""Checking a result again, from the data and without any solver."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

import sparsepop_py as sp
from setid.data.record import IOData
from setid.formulation.formulation import Formulation, formulate
from setid.formulation.units import InUnits, in_units
from setid.identifiability.equivalence import unidentifiable
from setid.identifiability.unnormalised import reference_model
from setid.models.block import BlockStructured
from setid.proofs.free_parameters import idle_parameters
from setid.proofs.parameter_box import box_follows, objectives, problem_on_box

if TYPE_CHECKING:
    from setid.result.identification import Identification

__all__ = ["Verification", "verify"]


@dataclass(frozen=True, slots=True)
class Verification:
    """What a check found; true where every claim holds.

    Parameters
    ----------
    ok : bool
    reason : str
        The first claim that does not hold; empty where all do.
    """

    ok: bool
    reason: str = ""

    def __bool__(self) -> bool:
        return self.ok


def verify(result: Identification, data: IOData | None = None) -> Verification:
    """Check formulation, box, outer and inner ends; see :meth:`Identification.verify`."""
    given = result.formulation
    again = formulate(given.data if data is None else data, given.model, given.noise, given.priors)
    if again.problem.fingerprint != given.problem.fingerprint:
        return Verification(False, "the result belongs to other data")
    if result.reference is not None:
        return _verify_reference(result, result.reference, again)
    if result.box is not None:
        if not box_follows(result.box, again):
            return Verification(False, "the box does not follow from the data")
        if result.box.empty:
            return Verification(True)
    if result.bounds:
        return _verify_linear(result, again)
    problem = problem_on_box(again, result.box)
    if problem.fingerprint != result.problem.fingerprint:
        return Verification(False, "the problem is not that of the box")
    return _verify_results(result, again, in_units(problem, again))


def _verify_reference(
    result: Identification, found: Identification, again: Formulation
) -> Verification:
    """The result with a normalisation holds, and nothing more is claimed than follows."""
    if not isinstance(again.model, BlockStructured):
        return Verification(False, "only block structures have a reference")
    given = again.noise, again.priors
    wanted = formulate(again.data, reference_model(again.data, again.model, *given), *given).problem
    if wanted.fingerprint != found.formulation.problem.fingerprint:
        return Verification(False, "the reference is not that of the data")
    if found.empty != result.empty:
        return Verification(False, "emptiness is not that of the reference")
    known: dict[str, Any] = {n: (item.outer, item.inner) for n, item in found.intervals.items()}
    known |= dict.fromkeys(unidentifiable(again.model), ((-inf, inf), None))
    for name, item in result.intervals.items():
        if not result.empty and (item.outer, item.inner) != known[name]:
            return Verification(False, f"the interval of {name} is not that of the reference")
    return verify(found, again.data)


def _verify_linear(result: Identification, again: Formulation) -> Verification:
    proved = []
    for bound, objective in zip(result.bounds, objectives(again), strict=True):
        verdict = bound.verify(again.problem, objective)
        if not verdict.ok:
            return Verification(False, verdict.reason)
        proved.append((bound.lower, bound.upper))
    for place, item in enumerate(result.intervals.values()):
        endless = [upper == -inf for _, upper in proved[2 * place : 2 * place + 2]]
        if str(item.status) in ("unbounded", "unidentifiable"):
            if not (all if str(item.status) == "unidentifiable" else any)(endless):
                return Verification(False, f"it is not proved that {item.name} is {item.status}")
    return _ends_follow(result, proved)


def _verify_results(result: Identification, again: Formulation, scaled: InUnits) -> Verification:
    endless = {n for n, item in result.intervals.items() if str(item.status) == "unbounded"}
    why = result.endless if endless else None
    known_endless = why.names if why is not None and why.verify(again) else ()
    if not endless <= set(known_endless):
        return Verification(False, f"it is not proved that {', '.join(endless)} are unbounded")
    problem, known = scaled.problem, dict[int, Any]()
    count = 2 * len(again.parameters)
    ends = [(problem_low(problem, number), inf) for number in range(count)]
    asked, points = objectives(again), list[sp.ProvedPoint]()
    for number, found in enumerate(result.results):
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
            upper = point.value
            points.append(point)
        ends[number] = lower, upper
    for number, (lower, upper) in enumerate(ends):
        unit = float(scaled.units[number // 2])
        upper = min([upper, *(_reached(problem, p, number) for p in points)])
        ends[number] = lower * unit, upper * unit
    return _ends_follow(result, ends) if result.empty else _with_idle(result, again, ends, points)


def _with_idle(
    result: Identification,
    again: Formulation,
    ends: list[tuple[float, float]],
    points: list[sp.ProvedPoint],
) -> Verification:
    """The same for parameters that change no row, which the ends of the problem are not about."""
    free = set(idle_parameters(again)[0])
    for place, item in enumerate(result.intervals.values()):
        idle = not np.any(again.problem.rows.words == place + 1)
        if str(item.status) == "unidentifiable" and not (idle or item.name in free):
            return Verification(False, f"it is not proved that {item.name} is unidentifiable")
        if item.name in free:
            ends[2 * place : 2 * place + 2] = [(-inf, -inf)] * 2
        elif idle:
            ends[2 * place : 2 * place + 2] = _given(again, place, bool(points))
    return _ends_follow(result, ends)


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


def problem_low(problem: sp.Problem, number: int) -> float:
    """What the bounds of the problem say of objective ``number``."""
    i = number // 2
    return float(problem.lower[i] if number % 2 == 0 else -problem.upper[i])


def _ends_follow(result: Identification, ends: list[tuple[float, float]]) -> Verification:
    """Whether the intervals claim no more than was found again."""
    for number, item in enumerate(result.intervals.values()):
        low, high = ends[2 * number], ends[2 * number + 1]
        if result.empty:
            if not any(end[0] == inf for end in ends):
                return Verification(False, "emptiness does not follow")
            continue
        if item.outer[0] > low[0] or item.outer[1] < -high[0]:
            return Verification(False, f"the outer interval of {item.name} does not follow")
        if item.inner is not None and (item.inner[0] < low[1] or item.inner[1] > -high[1]):
            return Verification(False, f"the inner interval of {item.name} is not attained")
    return Verification(True)
