"""Random problems of 25 kinds whose answers are known by construction, against all claims.

No claim of a result may contradict the planted points and least values.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

import numpy as np

import sparsepop_py as sp

from .exact_points import is_feasible, value_at
from .planted_kinds import KINDS, Planted, planted

__all__ = ["attack", "contradictions"]

_EFFORTS = ("plain", "presolve", "auto")
_LONGEST = 4.0  # seconds a solve


def contradictions(made: Planted, result: sp.Result | sp.RationalResult) -> Iterator[str]:
    """Claims of a result that planted points or a known least value refute.

    Parameters
    ----------
    made : Planted
    result : Result or RationalResult

    Yields
    ------
    str
    """
    problem, lower, upper = made.problem, result.lower_bound, result.upper_bound
    known = [value_at(problem.objective, p) for p in made.points if is_feasible(problem, p)]
    if known and lower > min(known):
        yield f"the bound {lower!r} is above the value {float(min(known))!r} of a planted point"
    if made.least is not None and (lower > made.least or upper < made.least):
        yield f"[{lower!r}, {upper!r}] leaves out the least value {float(made.least)!r}"
    if made.falls and lower > -np.inf:
        yield f"the bound {lower!r} of an objective that falls without limit"
    if result.status is sp.Status.UNBOUNDED and not made.falls and made.least is not None:
        yield "UNBOUNDED, but the least value is known"
    infeasible = not made.points and made.least is None and not made.falls
    if infeasible and upper < np.inf:
        yield f"{upper!r} is attained, but no point is feasible"
    if result.certificate is not None and not result.certificate.verify(problem).ok:
        yield "its certificate does not verify"
    again = sp.from_json(sp.to_json(result))
    if (again.lower_bound, again.problem.rounding) != (lower, problem.rounding):
        yield "its file says something else"
    if again.certificate is not None and not again.certificate.verify(again.problem).ok:
        yield "its certificate does not verify when it is read again"


def attack(minutes: float, first: int = 0) -> Iterator[str]:
    """Solve planted problems and yield a line for each contradiction, then counts.

    Parameters
    ----------
    minutes : float
        CPU time.
    first : int
        Seed of the first problem.

    Yields
    ------
    str
    """
    end, seed = time.process_time() + 60.0 * minutes, first
    statuses, false = Counter[str](), 0
    while time.process_time() < end:
        kind, made = planted(seed)
        effort = _EFFORTS[seed // len(KINDS) % len(_EFFORTS)]
        result = sp.solve(made.problem, sp.Options(effort=effort, time_limit=_LONGEST))
        statuses[str(result.status)] += 1
        for found in contradictions(made, result):
            false += 1
            yield f"seed {seed}, {kind}, {effort}: {found}"
        seed += 1
    counts = ", ".join(f"{name} {count}" for name, count in sorted(statuses.items()))
    yield f"{seed - first} problems of {len(KINDS)} kinds, {false} contradictions: {counts}"
