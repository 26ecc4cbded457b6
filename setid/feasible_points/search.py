"""Parameter vectors at the ends of intervals: local searches where rows are not linear.

With products of unknown samples (noise in powers, internal signals) the parameters alone no
longer make rows linear. The engine's sequential linear programs
(:mod:`sparsepop_py.local_search.slp`) first find a vector that needs little noise, then go from it
to the end of each parameter. What comes back as attained is proved.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.formulation.completion import defined_unknowns, held_unknowns, polished
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import LIFTED
from setid.formulation.units import in_fine_units
from setid.proofs.existence import proved_point, solved_rows
from setid.proofs.least_noise.noise_scale import problem_with_factor
from sparsepop_py.local_search.slp import sequential_search
from sparsepop_py.problem import units

__all__ = ["coupled", "search_ends"]

Reals = NDArray[np.float64]
_NEAR = 1e-4  # violations of equations that steps of Newton repair
_TRUST = (0.1, 0.5, 1e-3)  # first trust regions, one after the other
_INSIDE = 1e-6  # of the width of each bound: what a search keeps away from it


def coupled(formulation: Formulation) -> bool:
    """Check for products of unknown samples, or of one with several parameters.

    Sums of products that are unknowns of their own do not count as samples.

    Parameters
    ----------
    formulation : Formulation
    """
    words, p = formulation.problem.rows.words, len(formulation.parameters)
    sample = np.arange(formulation.layout.dimension + 1) > p
    sample[formulation.layout.group(LIFTED) + 1] = False
    samples = np.count_nonzero(sample[words], axis=1)
    parameters = np.count_nonzero(words, axis=1) - samples
    return bool(np.any(samples > 1) or np.any((samples > 0) & (parameters > 1)))


def search_ends(formulation: Formulation, problem: sp.Problem, start: Reals) -> list[Reals]:
    """Search for the ends of all parameters.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem on a box of the parameters, all unknowns with finite bounds or none.
    start : (n,) float
        A nearly feasible vector.

    Returns
    -------
    list of (n,) float
        Near each of them a consistent vector is proved to exist, in units of its own. Fewer than
        2 p where a search or a proof failed.
    """
    scaled = in_fine_units(problem, formulation, start)
    inner = replace(formulation, problem=scaled.problem)
    least = _least_noise(formulation, problem, start, scaled.units)
    inside = _polished(inner, least / scaled.units)
    if inside is None:
        return []
    ends, within = [inside], _within(formulation, scaled.problem)
    for place in range(len(formulation.parameters)):
        for sign in (1.0, -1.0):
            goal = within.with_objective(sign * formulation.layout.polynomial(place))
            ends += _end(inner, goal, inside)
    known = solved_rows(inner, scaled.problem)
    found = [proved_point(inner, scaled.problem, end, known) for end in ends]
    return [point.x * scaled.units for point in found if point is not None]


def _end(formulation: Formulation, goal: sp.Problem, inside: Reals) -> list[Reals]:
    """Minimise locally; try other trust regions where a search leaves the equations."""
    for trust in _TRUST:
        end = _polished(formulation, sequential_search(goal, inside, trust=trust))
        if end is not None:
            return [end]
    return []


def _least_noise(
    formulation: Formulation, problem: sp.Problem, start: Reals, sizes: Reals
) -> Reals:
    """Find a vector of little noise, its parameters within the problem's bounds."""
    stated, p = problem_with_factor(formulation, None), len(formulation.parameters)
    lower, upper = stated.lower.copy(), stated.upper.copy()
    noise = np.append(held_unknowns(formulation), False)
    lower[noise], upper[noise], upper[-1] = -inf, inf, inf  # the factor alone bounds them
    lower[:p], upper[:p] = problem.lower[:p], problem.upper[:p]
    wide = sp.Problem(stated.objective, stated.constraints, lower, upper)
    scaled = units.in_units(wide, np.append(sizes, 1.0), coarse=1)
    bound = formulation.problem.upper[noise[:-1]]
    factor = float(np.max(np.abs(start[noise[:-1]]) / bound, initial=0.0))
    found = sequential_search(scaled.problem, np.append(start, factor) / scaled.units)
    return (found * scaled.units)[:-1]


def _within(formulation: Formulation, problem: sp.Problem) -> sp.Problem:
    """Leave room to the bounds of a problem; drop those that follow from others.

    Those would stop linearised squares at zero.
    """
    low, high = problem.lower, problem.upper
    with np.errstate(invalid="ignore"):
        room = _INSIDE * np.where(np.isfinite(high - low), high - low, 0.0)
    follow = defined_unknowns(formulation)
    lower, upper = np.where(follow, -inf, low + room), np.where(follow, inf, high - room)
    return sp.Problem(problem.objective, problem.constraints, lower, upper, problem.names)


def _polished(formulation: Formulation, x: Reals) -> Reals | None:
    """Move a vector to the equations; None where it is too far from them."""
    problem = formulation.problem
    off = np.abs(problem.rows.values(x)[problem.equality])
    if np.max(off, initial=0.0) > _NEAR:
        return None
    return polished(formulation, x, np.arange(x.size))
