"""Checking a result again, from the data and without any solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp

from .boxes import ParameterBox
from .cells import CellBox
from .data import IOData
from .errors import ModelError
from .formulation import Formulation, formulate
from .lifted import LiftedBox, lifted_rows

if TYPE_CHECKING:
    from .intervals import Identification

Box = ParameterBox | LiftedBox | CellBox

__all__ = ["Verification", "boxed", "consistent", "objectives", "proved_point", "verify"]


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


def objectives(formulation: Formulation) -> list[sp.Polynomial]:
    """The polynomials theta_1, -theta_1, theta_2, ... in all unknowns."""
    theta = formulation.layout.group("theta").tolist()
    return [sign * formulation.layout.polynomial(i) for i in theta for sign in (1.0, -1.0)]


def boxed(formulation: Formulation, box: Box | None) -> sp.Problem:
    """The problem of a formulation with the parameters in a box.

    A parameter that no constraint speaks of, and that has no finite bounds, is set to
    zero: that changes nothing for the others.
    """
    problem = formulation.problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    p = len(formulation.parameters)
    if box is not None:
        lower[:p], upper[:p] = np.maximum(lower[:p], box.lower), np.minimum(upper[:p], box.upper)
    if isinstance(box, CellBox):
        samples = box.unknowns
        lower[samples] = np.maximum(lower[samples], box.low)
        upper[samples] = np.minimum(upper[samples], box.high)
    silent = np.array([i for i in range(p) if not _occurs(problem, i)], int)
    idle = silent[(lower[silent] <= 0) & (upper[silent] >= 0)]
    lower[idle] = upper[idle] = 0.0
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _occurs(problem: sp.Problem, variable: int) -> bool:
    return bool(np.any(problem.rows.words == variable + 1))


def verify(result: Identification, data: IOData | None = None) -> Verification:
    """Check formulation, box, outer and inner ends; see :meth:`Identification.verify`."""
    given = result.formulation
    if result.reference is not None:
        return _verify_reference(result, data)
    again = formulate(given.data if data is None else data, given.model, given.noise, given.priors)
    if again.problem.fingerprint != given.problem.fingerprint:
        return Verification(False, "the result belongs to other data")
    p = len(given.parameters)
    if result.box is not None:
        start = np.array([again.problem.lower[:p], again.problem.upper[:p]])
        if not _box_follows(result.box, again, start):
            return Verification(False, "the box does not follow from the data")
        if result.box.empty:
            return Verification(True)
    if result.bounds:
        return _verify_linear(result, again)
    problem = boxed(again, result.box)
    if problem.fingerprint != result.problem.fingerprint:
        return Verification(False, "the problem is not that of the box")
    return _verify_results(result, again, problem)


def _verify_reference(result: Identification, data: IOData | None) -> Verification:
    """The result with a normalisation holds, and nothing more is claimed than follows."""
    found = result.reference
    assert found is not None
    for name, item in result.intervals.items():
        if str(item.status) in ("unidentifiable", "empty"):
            continue
        known = found.intervals.get(name)
        if known is None or item.outer != known.outer or item.inner != known.inner:
            return Verification(False, f"the interval of {name} is not that of the reference")
    return verify(found, data)


def _box_follows(box: Box, again: Formulation, start: NDArray[np.float64]) -> bool:
    if isinstance(box, ParameterBox):
        return again.smoothed is not None and box.verify(again.smoothed, start)
    if isinstance(box, CellBox):
        return box.verify(again, start)
    rows = lifted_rows(again)
    return rows is not None and box.verify(rows, start)


def _verify_linear(result: Identification, again: Formulation) -> Verification:
    proved = []
    for bound, objective in zip(result.bounds, objectives(again), strict=True):
        verdict = bound.verify(again.problem, objective)
        if not verdict.ok:
            return Verification(False, verdict.reason)
        proved.append((bound.lower, bound.upper))
    return _ends_follow(result, proved)


def _verify_results(
    result: Identification, again: Formulation, problem: sp.Problem
) -> Verification:
    known: dict[int, Any] = {}
    count = 2 * len(again.parameters)
    ends = [(problem_low(problem, number), inf) for number in range(count)]
    asked, points = objectives(again), list[sp.ProvedPoint]()
    for number, found in enumerate(result.results):
        about = problem.with_objective(asked[number])
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
        ends[number] = lower, min([upper, *(_reached(problem, p, number) for p in points)])
    return _ends_follow(result, ends)


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
        if str(item.status) == "unidentifiable" and item.outer == (-inf, inf):
            continue
        if item.outer[0] > low[0] or item.outer[1] < -high[0]:
            return Verification(False, f"the outer interval of {item.name} does not follow")
        if item.inner is not None and (item.inner[0] < low[1] or item.inner[1] > -high[1]):
            return Verification(False, f"the inner interval of {item.name} is not attained")
    return Verification(True)


def consistent(
    formulation: Formulation, theta: ArrayLike | Mapping[str, float]
) -> NDArray[np.float64] | None:
    """A witness that parameters are consistent, proved; see :meth:`Identification.consistent`."""
    try:
        witness = formulation.witness(theta)
    except ModelError:
        return None
    problem, p = formulation.problem, len(formulation.parameters)
    if not np.isfinite(witness.level) or witness.level > 1.0 + 1e-9:
        return None
    point = proved_point(formulation, problem, witness.x)
    return None if point is None or not np.array_equal(point.x[:p], witness.x[:p]) else point.x


def proved_point(
    formulation: Formulation, problem: sp.Problem, x: NDArray[np.float64]
) -> sp.ProvedPoint | None:
    """A proof that a feasible point exists near x, each equation solved for its newest sample.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem, or that on a box of the parameters.
    x : (n,) float
    """
    rows = np.flatnonzero(problem.equality)
    solved = _newest(formulation, rows)
    if solved is None:
        return None
    for proof in ("exact", "krawczyk") if rows.size else ("exact",):
        point = sp.ProvedPoint(x, inf, 0.0, proof, rows, solved).recheck(problem)
        if point is not None:
            return point
    return None


def _newest(formulation: Formulation, rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """For each equality an unknown of its own that it gives: the newest noise sample."""
    problem, taken = formulation.problem, set(range(len(formulation.parameters)))
    layout = formulation.layout
    age = np.full(problem.dimension, -1)
    for group, numbers in formulation.layout.groups.items():
        if group != "theta":
            places = np.nonzero(numbers >= 0)
            age[numbers[places]] = places[0] if group != "slack" else 0
    order = {"eta": 1, "e": 2, "xi": 0}
    rank = np.zeros(problem.dimension, int)
    for group, value in order.items():
        numbers = formulation.layout.group(group)
        rank[numbers[numbers >= 0]] = value
    solved = []
    for row in rows.tolist():
        support = problem.constraints[row].polynomial.support.tolist()
        own = layout.groups.get(formulation.rows.equation[row])
        mine = set() if own is None else set(own[own >= 0].tolist())
        free = [v for v in support if v in mine and v not in taken] or [
            v for v in support if v not in taken
        ]
        if not free and formulation.rows.origin[row] == "prior":
            free = support[-1:]  # the normalisation gives a parameter
        if not free:
            return None
        best = max(free, key=lambda v: (age[v], rank[v]))
        taken.add(best)
        solved.append(best)
    return np.array(solved, np.int64)
