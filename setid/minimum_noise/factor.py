"""Search the least factor s on all noise bounds, by boxes of the parameters and by the engine.

The largest factor that is looked at gives all noise bounds, and s in [0, 1] multiplies them
(:func:`setid.proofs.least_noise.noise_scale.problem_with_factor`). A factor at which the rows leave
no box is refuted. On a finite box the engine minimises s; without one a search only attains it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.record import IOData
from setid.feasible_set.start import find_box
from setid.formulation.formulation import Formulation
from setid.formulation.units import in_units
from setid.options import Options
from setid.proofs.least_noise.noise_scale import problem_with_factor
from setid.proofs.parameter_box import ProvedBox, start_of
from sparsepop_py.budget import Deadline
from sparsepop_py.uncertain_rows.directions import units_of_rows
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["least_factor", "on_box", "refuted_factor", "rounding_factor", "search_factor"]

_REACH = 4.0  # of parameters whose terms are of the size of the others
_GAP = 0.01  # of the factor, in a search
_STEPS = 12  # halvings of the interval of s by boxes alone
_FURTHER = 4.0  # times a refuted factor, where none is known to be attained
_REACHED = 12  # such steps
_PART = 0.25  # of the time, for these
_TRIES = 6  # factors at which a finite box is looked for
_LEAST = 2.0**-6  # of a factor without a finite box: what is tried next is its geometric mean
_DIGITS = 2.0**-46  # of the readings: noise that rounding alone explains


def rounding_factor(data: IOData, bounds: tuple[NDArray[Any], ...]) -> float:
    """Compute the factor with which noise is as small as the rounding of readings."""
    sizes = np.nanmax(np.abs(data.y)), np.nanmax(np.abs(data.u)), np.nanmax(np.abs(data.y))
    parts = [size / b[b > 0].max() for size, b in zip(sizes, bounds, strict=True) if np.any(b > 0)]
    return float(min(parts)) * _DIGITS


def refuted_factor(
    stated: Callable[[float], Formulation], limit: float, until: float, attained: bool
) -> tuple[float, ParameterBox] | None:
    """Search for the largest factor at which no parameters pass the rows.

    Parameters
    ----------
    stated : callable
        The problem at a factor.
    limit : float
        The search ends there if that is attained, and goes beyond it otherwise.
    until : float
        Reading of ``time.monotonic``; a part of the time until then is taken.
    attained : bool
    """
    end = until if until == inf else time.monotonic() + _PART * (until - time.monotonic())
    found, low, high = None, 0.0, limit if attained else inf
    for _ in range(_STEPS if attained else _STEPS + _REACHED):
        factor = 0.5 * (low + high) if high < inf else max(limit, _FURTHER * low)
        formulation = stated(factor)
        if formulation.smoothed is None or time.monotonic() >= end:
            break
        box = parameter_box(formulation.smoothed, start_of(formulation), end)
        if box.empty:
            found, low = (factor, box), factor
        else:
            high = factor
    return found


def on_box(
    formulation: Formulation,
    problem: sp.Problem,
    options: sp.Options,
    x: NDArray[np.float64] | None,
) -> sp.Result | None:
    """Bound and attain the least factor; None without a finite box."""
    p = len(formulation.parameters)
    if not np.all(np.isfinite(problem.lower[:p]) & np.isfinite(problem.upper[:p])):
        return None
    scaled = in_units(problem, formulation)
    start = None if x is None else np.append(x, 1.0) / scaled.units
    return sp.solve(scaled.problem, options, start=start)


class FoundFactor(NamedTuple):
    """Parameters and the part of the noise that they need; nothing is proved."""

    share: float
    x: NDArray[np.float64]


def search_factor(
    formulation: Formulation, x: NDArray[np.float64] | None, deadline: Deadline
) -> FoundFactor | None:
    """Search the least factor where parameters are not huge, without a box.

    Parameters
    ----------
    formulation : Formulation
        With rows that are linear in the parameters.
    x : (n,) float or None
        Unknowns to begin from.
    deadline : Deadline
        At which it ends.
    """
    p = len(formulation.parameters)
    if formulation.smoothed is None or deadline.over:
        return None
    problem = problem_with_factor(formulation, None)
    reach = _REACH * units_of_rows(formulation.smoothed)
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:p], upper[:p] = np.maximum(lower[:p], -reach), np.minimum(upper[:p], reach)
    if np.any(lower > upper):
        return None
    scaled = in_units(sp.Problem(problem.objective, problem.constraints, lower, upper), formulation)
    start = None if x is None else np.append(x, 1.0) / scaled.units
    options = sp.Options(effort="auto", gap=_GAP, gap_kind="absolute")
    timed = replace(options, **deadline.limits)
    found = sp.solve(scaled.problem, timed, start=start).attained
    return None if found is None else FoundFactor(found.value, (found.x * scaled.units)[:-1])


def least_factor(
    stated: Callable[[float], Formulation],
    ends: tuple[float, float],
    x: NDArray[np.float64] | None,
    settings: Options,
    until: float,
    attained: bool = True,
) -> tuple[Formulation, float, ProvedBox | None, sp.Result | None]:
    """Bound and attain the least factor, up to a limit that leaves a finite box.

    With the noise of an estimate they may have none. Then less noise is tried: below the least
    factor the engine proves that, above it, it finds parameters. Where the upper end is not
    attained and the engine refutes it, more noise is tried.
    """
    low, limit = ends
    formulation, kept = stated(limit), None
    for _ in range(_TRIES):
        box = find_box(formulation, until)
        options = settings.for_engine("absolute", until)
        result = on_box(formulation, problem_with_factor(formulation, box), options, x)
        if result is not None:
            kept = formulation, limit, box, result
            if result.attained is not None or result.status is not sp.Status.INFEASIBLE:
                return kept
            low = limit
            if low >= ends[1] and attained:
                break
            ends = low, ends[1] if low < ends[1] else _FURTHER * low
        else:
            ends = low, limit
        if time.monotonic() >= until:
            break
        limit = float(np.sqrt(max(low, _LEAST * ends[1]) * ends[1]))
        formulation, x = stated(limit), None
    return kept or (formulation, limit, None, None)
