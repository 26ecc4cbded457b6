"""Parameter vectors at the ends of intervals: local searches where rows are not linear.

With products of unknown samples (noise in powers, internal signals) the parameters alone no
longer make rows linear. Each step minimises a parameter over all rows linearised at the
point before, parameters within a trust region, all else free within its bounds; near a
vertex this converges quadratically. What comes back as attained is proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp

from .completion import affine, defined_unknowns, held_unknowns, polished
from .errors import SetidError
from .existence import proved_point
from .formulation import Formulation
from .linear import minimise

__all__ = ["attained_ends", "checked", "coupled"]

Reals = NDArray[np.float64]
_STEPS = 20
_TRUST = 0.25  # of the width of the box
_NEAR = 1e-4  # violations that steps of Newton repair
_INSIDE = 1e-6  # of the width of each bound: what the last step keeps away from it


def coupled(formulation: Formulation) -> bool:
    """Whether unknown samples are multiplied with each other."""
    problem, p = formulation.problem, len(formulation.parameters)
    words = problem.rows.words
    return bool(np.any(np.count_nonzero(words > p, axis=1) > 1))


def attained_ends(
    formulation: Formulation, problem: sp.Problem, start: Reals
) -> list[sp.ProvedPoint]:
    """Proved points near the ends of all parameters.

    Parameters
    ----------
    formulation : Formulation
    problem : sp.Problem
        Its problem on a box of the parameters, all unknowns with finite bounds or none.
    start : (n,) float
        A nearly feasible vector.

    Returns
    -------
    list of sp.ProvedPoint
        Fewer than 2 p where a search or a proof failed.
    """
    search = _Search(formulation, problem)
    inside = search.run(start, None)
    if inside is None:
        return []
    found = [proved_point(formulation, problem, inside)]
    for place in range(len(formulation.parameters)):
        for sign in (1.0, -1.0):
            end = search.run(inside, (place, sign))
            if end is not None:
                found.append(proved_point(formulation, problem, end))
    return [point for point in found if point is not None]


def checked(problem: sp.Problem, results: Sequence[sp.Result]) -> tuple[sp.Result, ...]:
    """Results whose certificates hold when they are walked once more; others prove nothing.

    Trees are made at several cut-offs and walked at the last of them: should rounding make a box
    larger than its argument allows, the refusal costs the bound here and not at the user's.
    """
    known: dict[int, Any] = {}
    kept = []
    for found in results:
        proof = found.certificate
        about = problem.with_objective(found.problem.objective)
        if proof is not None and not proof.verify(about, known).ok:
            unproved = sp.Status.UNPROVED
            found = replace(found, certificate=None, lower_bound=-inf, status=unproved)
        kept.append(found)
    return tuple(kept)


@dataclass(eq=False)
class _Search:
    """Sequential linear programs on one problem."""

    formulation: Formulation
    problem: sp.Problem

    def run(self, start: Reals, goal: tuple[int, float] | None) -> Reals | None:
        """From a vector to one at the end of a parameter, or well inside without a goal."""
        p = len(self.formulation.parameters)
        width = self.problem.upper[:p] - self.problem.lower[:p]
        width = np.where(np.isfinite(width), width, 1.0 + np.abs(start[:p]))
        x, trust, before = start.copy(), _TRUST, inf
        off = self._violation(x)
        for _ in range(_STEPS):
            new = self._step(x, goal, trust * width)
            if new is None:
                trust *= 0.5
                if trust < 1e-7:
                    break
                continue
            value = 0.0 if goal is None else goal[1] * float(new[goal[0]])
            worse = self._violation(new)
            if worse > max(1e-7, 4.0 * off, 1e-2 * trust):
                trust *= 0.25
                if trust < 1e-7:
                    break
                continue
            x, off = new, worse
            size = 1e-9 * float(width[goal[0]]) if goal is not None else 1e-9
            if off <= 1e-9 and abs(before - value) <= size:
                break
            before = value
        return polished(self.formulation, x, np.arange(x.size)) if off <= _NEAR else None

    def _violation(self, x: Reals) -> float:
        rows = self.problem.rows.values(x)
        equal = np.abs(rows[self.problem.equality])
        return float(np.max(equal, initial=0.0))

    def _step(self, x: Reals, goal: tuple[int, float] | None, trust: Reals) -> Reals | None:
        """One linear program; without a goal the least noise level."""
        problem, p = self.problem, trust.size
        held = held_unknowns(self.formulation)
        rows = affine(self.formulation, x, np.arange(x.size))
        shrink = _INSIDE * np.where(
            np.isfinite(problem.upper - problem.lower), problem.upper - problem.lower, 0.0
        )
        low, high = problem.lower + shrink, problem.upper - shrink
        # bounds that only follow from those of others would stop linearised squares at zero
        follow = defined_unknowns(self.formulation)
        low[follow], high[follow] = -inf, inf
        low[:p] = np.maximum(low[:p], x[:p] - trust)
        high[:p] = np.minimum(high[:p], x[:p] + trust)
        if np.any(low > high):
            return None
        below = -rows.matrix[~rows.equality], rows.constant[~rows.equality]
        equal = rows.matrix[rows.equality], -rows.constant[rows.equality]
        if goal is not None:
            cost = np.zeros(x.size)
            cost[goal[0]] = goal[1]
            return _solved(cost, below, equal, (low, high))
        noise = np.flatnonzero(held)
        bound = problem.upper[noise]
        pick = sps.csr_array(
            (np.ones(noise.size), (np.arange(noise.size), noise)), shape=(noise.size, x.size)
        )
        level = sps.csr_array(-bound[:, None])
        wide = sps.csr_array((below[1].size, 1))
        both = sps.vstack(
            [
                sps.hstack([below[0], wide]),
                sps.hstack([pick, level]),
                sps.hstack([-pick, level]),
            ]
        ).tocsr()
        right = np.concatenate([below[1], np.zeros(2 * noise.size)])
        tied = sps.hstack([equal[0], sps.csr_array((equal[1].size, 1))]).tocsr()
        low[noise], high[noise] = -inf, inf
        cost = np.append(np.zeros(x.size), 1.0)
        ends = np.append(low, 0.0), np.append(high, inf)
        found = _solved(cost, (both, right), (tied, equal[1]), ends)
        return None if found is None else found[:-1]


def _solved(
    cost: Reals,
    below: tuple[sps.csr_array, Reals],
    equal: tuple[sps.csr_array, Reals],
    bounds: tuple[Reals, Reals],
) -> Reals | None:
    try:
        return minimise(cost, below, equal, bounds)
    except SetidError:
        return None
