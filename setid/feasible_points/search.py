"""Parameter vectors at the ends of intervals: local searches where rows are not linear.

With products of unknown samples (noise in powers, internal signals) the parameters alone no
longer make rows linear. Each step minimises a parameter, plus a penalty on what the rows miss,
over all rows linearised at the point before, within a trust region. Where the samples' products
curve the rows, a step is followed by others with the slopes of where it led, in the same region,
before it is judged: without these second-order corrections regions would shrink and shrink. Near
a vertex this converges quadratically. What comes back as attained is proved.

References
----------
R. Fletcher, "Second order corrections for non-differentiable optimization", in: Numerical
Analysis, Lecture Notes in Mathematics 912 (1982) 85-114.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.errors import SetidError
from setid.feasible_set.linear_programs import minimise
from setid.formulation.completion import (
    affine,
    defined_unknowns,
    held_unknowns,
    polished,
    redefined,
)
from setid.formulation.formulation import Formulation
from setid.proofs.existence import proved_point

__all__ = ["search_ends", "recheck_results", "coupled"]

Reals = NDArray[np.float64]
_STEPS = 20
_TRUST = 0.25  # of the width of each bound
_CORRECTIONS = 2
_PENALTIES = 1e2, 1e4, 1e6  # of a miss by a row's largest coefficient; a width of the box costs 1
_PROMISED = 1e-5  # widths: a step that promises less is the last; tolerances promise some, too
_SETTLED = 1e-6  # change of the least noise level at rest
_MET = 1e-7  # violations that no larger penalty makes smaller
_NEAR = 1e-4  # violations that steps of Newton repair
_INSIDE = 1e-6  # of the width of each bound: what the last step keeps away from it


def coupled(formulation: Formulation) -> bool:
    """Whether unknown samples are multiplied with each other, or by several parameters."""
    words, p = formulation.problem.rows.words, len(formulation.parameters)
    samples = np.count_nonzero(words > p, axis=1)
    parameters = np.count_nonzero(words, axis=1) - samples
    return bool(np.any(samples > 1) or np.any((samples > 0) & (parameters > 1)))


def search_ends(
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
    inside = search.inside(start)
    if inside is None:
        return []
    found = [proved_point(formulation, problem, inside)]
    for place in range(len(formulation.parameters)):
        for sign in (1.0, -1.0):
            end = search.end(inside, _Goal(place, sign))
            if end is not None:
                found.append(proved_point(formulation, problem, end))
    return [point for point in found if point is not None]


def recheck_results(problem: sp.Problem, results: Sequence[sp.Result]) -> tuple[sp.Result, ...]:
    """Results with what their certificates prove when they are walked once more.

    Trees are made at several cut-offs and walked at the last of them: should rounding make a box
    larger than its argument allows, that part keeps what its box proves, here and not at the
    user's.
    """
    known: dict[int, Any] = {}
    return tuple(_walked(problem, found, known) for found in results)


def _walked(problem: sp.Problem, found: sp.Result, known: dict[int, Any]) -> sp.Result:
    proof = found.certificate
    if proof is None:
        return found
    about = problem.with_objective(found.problem.objective)
    verdict = proof.verify(about, known)
    if verdict.ok:
        return found
    weaker, bounded = replace(proof, bound=verdict.bound), sp.Status.BOUNDED
    if np.isfinite(verdict.bound) and weaker.verify(about, known).ok:
        return replace(found, certificate=weaker, lower_bound=verdict.bound, status=bounded)
    return replace(found, certificate=None, lower_bound=-inf, status=sp.Status.UNPROVED)


@dataclass(frozen=True)
class _Goal:
    """The least (sign 1) or largest (-1) value of a parameter, and what missing rows cost."""

    place: int
    sign: float
    penalty: float = _PENALTIES[0]


@dataclass(eq=False)
class _Search:
    """Sequential linear programs on one problem."""

    formulation: Formulation
    problem: sp.Problem

    @cached_property
    def size(self) -> Reals:
        """Largest coefficient of each row."""
        found = np.full(self.problem.rows.size, 1e-300)
        np.maximum.at(found, self.problem.rows.row, np.abs(self.problem.rows.coefficients))
        return found

    @cached_property
    def ends(self) -> tuple[Reals, Reals]:
        """Bounds with some room, but none that only follow from others.

        Those would stop linearised squares at zero.
        """
        low, high = self.problem.lower, self.problem.upper
        room = _INSIDE * np.where(np.isfinite(high - low), high - low, 0.0)
        follow = defined_unknowns(self.formulation)
        return np.where(follow, -inf, low + room), np.where(follow, inf, high - room)

    def inside(self, start: Reals) -> Reals | None:
        """A vector that needs little noise, parameters within trust regions."""
        x, trust, before = start.copy(), _TRUST, inf
        off = self._off(x)
        for _ in range(_STEPS):
            found = self._least_noise(x, trust)
            worse = inf if found is None else self._off(found[0])
            if found is None or worse > max(1e-7, 4.0 * off, 1e-2 * trust):
                trust *= 0.25
                if trust < 1e-7:
                    break
                continue
            x, off = found[0], worse
            if off <= 1e-9 and abs(before - found[1]) <= _SETTLED * found[1]:
                break
            before = found[1]
        return polished(self.formulation, x, np.arange(x.size)) if off <= _NEAR else None

    def end(self, start: Reals, goal: _Goal) -> Reals | None:
        """From a vector to one at the end of a parameter."""
        x = redefined(self.formulation, start)
        for penalty in _PENALTIES:
            x = self._descended(x, replace(goal, penalty=penalty))
            if self._off(x) <= _MET:
                break
        return polished(self.formulation, x, np.arange(x.size)) if self._off(x) <= _NEAR else None

    def _descended(self, x: Reals, goal: _Goal) -> Reals:
        """A local minimiser of the merit."""
        merit, trust = self._merit(x, goal), _TRUST
        for _ in range(_STEPS):
            promised, new, value = self._trial(x, merit, goal, trust)
            gained = merit - value
            if gained > 0:
                x, merit = new, value
            if promised <= _PROMISED:
                break
            trust = min(1.0, 2.0 * trust) if gained > 0.5 * promised else 0.25 * trust
            if trust < 1e-9:
                break
        return x

    def _trial(
        self, x: Reals, merit: float, goal: _Goal, trust: float
    ) -> tuple[float, Reals, float]:
        """Gain that one step promises, and where it leads with its corrections; the merit there."""
        promised, new, value = 0.0, x, inf
        region = self._region(x, trust, slice(None))
        for number in range(1 + _CORRECTIONS):
            found = self._step(new, goal, region)
            if found is None:
                break
            promised = promised if number else merit - found[1]
            trial = redefined(self.formulation, found[0])
            there = self._merit(trial, goal)
            if there >= value:
                break
            new, value = trial, there
            if merit - value > 0.5 * promised:
                break
        return promised, new, value

    def _off(self, x: Reals) -> float:
        equal = np.abs(self.problem.rows.values(x)[self.problem.equality])
        return float(np.max(equal, initial=0.0))

    def _merit(self, x: Reals, goal: _Goal) -> float:
        """The parameter in widths of its bounds, and the penalty."""
        rows = self.problem.rows.values(x) / self.size
        violation = np.where(self.problem.equality, np.abs(rows), np.maximum(-rows, 0.0))
        return float(self._cost(goal) @ x + goal.penalty * violation.sum())

    def _cost(self, goal: _Goal) -> Reals:
        width = self.problem.upper[goal.place] - self.problem.lower[goal.place]
        cost = np.zeros(self.problem.dimension)
        cost[goal.place] = goal.sign / width if 0.0 < width < inf else goal.sign
        return cost

    def _region(self, x: Reals, trust: float, which: slice) -> tuple[Reals, Reals]:
        """Bounds of all unknowns, those of some within a trust region around x."""
        low, high = self.ends[0].copy(), self.ends[1].copy()
        width = self.problem.upper - self.problem.lower
        reach = trust * np.where(np.isfinite(width), width, 1.0 + np.abs(x))
        reach = np.where(defined_unknowns(self.formulation), inf, reach)
        low[which] = np.maximum(low, x - reach)[which]
        high[which] = np.minimum(high, x + reach)[which]
        return np.minimum(low, high), high

    def _step(
        self, x: Reals, goal: _Goal, region: tuple[Reals, Reals]
    ) -> tuple[Reals, float] | None:
        """One linear program with the slopes at x: its vector and the merit it expects there."""
        rows, equal = affine(self.formulation, x, np.arange(x.size)), self.problem.equality
        scale = sps.diags_array(1.0 / self.size)
        slopes, constant = sps.csr_array(scale @ rows.matrix), rows.constant / self.size
        names, groups = self.formulation.rows.equation, self.formulation.layout.groups
        loose = np.array([name not in groups for name in names], bool)  # the others define
        unit = sps.eye_array(equal.size, format="csc")
        short, over = unit[:, loose], unit[:, loose & equal]  # what a row lacks, or has too much
        whole = sps.csr_array(sps.hstack([slopes, short, -over]))
        violation = whole.shape[1] - x.size
        cost = np.append(self._cost(goal), np.full(violation, goal.penalty))
        bounds = (
            np.append(region[0], np.zeros(violation)),
            np.append(region[1], np.full(violation, inf)),
        )
        below = -whole[~equal], constant[~equal]
        found = _solved(cost, below, (whole[equal], -constant[equal]), bounds)
        return None if found is None else (found[: x.size], float(cost @ found))

    def _least_noise(self, x: Reals, trust: float) -> tuple[Reals, float] | None:
        """One linear program for the least noise level: its vector, and the level."""
        problem = self.problem
        rows = affine(self.formulation, x, np.arange(x.size))
        low, high = self._region(x, trust, slice(len(self.formulation.parameters)))
        below = -rows.matrix[~rows.equality], rows.constant[~rows.equality]
        equal = rows.matrix[rows.equality], -rows.constant[rows.equality]
        noise = np.flatnonzero(held_unknowns(self.formulation))
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
        return None if found is None else (found[:-1], float(found[-1]))


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
