"""The largest noise that multipliers refute in a cone of denominators: a linear program.

The notation is that of ``proofs/denominators/varying_multipliers.py``: a cone is spanned by vectors
v_j, each with a multiplier lambda_j. For a target tau of the factor on the noise bounds w the
program is

    max t :   Y_p lambda - tau sum_i w(i) s_p(i) - sigma' H_p - t  >=  0,
              abs(v_j * lambda_k + v_k * lambda_j)(i)  <=  s_p(i)    for each pair p = (j, k),
              sum_p sum_i w(i) s_p(i)  =  1,    sigma >= 0,
              lambda_j orthogonal to the known columns,

with Y_p lambda = sum_i y(i) (v_j * lambda_k + v_k * lambda_j)(i). Where t > 0 no member of the cone
explains the record with noise of tau w; where t <= 0 the cone has to be split. It is solved by a
primal-dual interior-point method with a predictor and a corrector (S. Mehrotra, *SIAM J.
Optimization* 2 (1992) 575-601). Sizes s leave each step on their own, one by one. What remains in
lambda is a banded matrix, as a filter joins a sample with n others. So a step costs as much as the
record is long. The method ends where the target is refuted, where it cannot be, and where it comes
so slowly that two halves of the cone are cheaper.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from math import inf
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from setid.minimum_noise.cones import plain_steps
from setid.minimum_noise.cones.plain_steps import Coupled, Fixed, Sized, Totals, paired_columns
from setid.minimum_noise.programs import Programs
from setid.proofs.denominators.cones import Cone
from setid.proofs.denominators.varying_multipliers import hurwitz_minors, pairs

__all__ = ["EXACT", "QUICK", "ConeBound", "ConePrograms", "Effort"]

Reals = NDArray[np.float64]
_STEPS = 50
_INSIDE = 0.98  # of a step to the boundary
_LOOK = 3  # steps whose rate counts
_OVER = 1.0 + 1e-8  # of a target: what is lost to rounding
_COMPILATION = 40.0  # seconds of a time limit in which compilation (ten) is worth its time
_CONE_WORK, _ENTRY_WORK = 5e-3, 1e-7  # of a cone, and of an entry of its Newton matrices
_OFTEN = 30  # programs of a process: then compiled substitution is worth its loading
_counter = count()
_TINY = 1e-300
_FILL = 16  # columns together, for compiled steps


class Effort(NamedTuple):
    """Conditions under which a program is given up.

    Parameters
    ----------
    level : float
        Of the target: a level with which a cone is split.
    infeasible : float
        What is left of the infeasibility of dual values, where these tell.
    patience : float
        Steps in which the target has to be reached at the present rate.
    """

    level: float
    infeasible: float
    patience: float


QUICK = Effort(1e-3, 0.05, 8.0)  # splitting a cone is cheaper than many steps
EXACT = Effort(1e-6, 1e-4, 40.0)  # near feasible denominators splitting does little


class ConeBound(NamedTuple):
    """Multipliers of a cone, and the factor that they prove.

    Parameters
    ----------
    factor : float
        On the noise bounds; 0 for nothing.
    multipliers : (K, R) float
        One for each vector, over the rows of the record.
    minors : (n - 2,) float
        Weights >= 0 of the Hurwitz minors; none without a prior.
    weights : (pairs,) float
        Dual solution: products t_j t_k of a denominator that is hard to refute.
    """

    factor: float
    multipliers: Reals
    minors: Reals
    weights: Reals


@dataclass(slots=True)
class _Point:
    """Unknowns of the program, slacks and dual values; also a direction in them."""

    multipliers: Reals  # (K, R) lambda
    sized: Sized
    level: float
    minors: Reals
    slack: Reals  # (pairs,)
    coupled: Coupled  # weights are dual to the slacks; no level is larger than the dual one
    dual_minors: Reals

    def small(self) -> tuple[Reals, Reals]:
        """Compute slacks and minors, and their dual values."""
        return (
            np.concatenate([self.slack, self.minors]),
            np.concatenate([self.coupled.weights, self.dual_minors]),
        )


class ConePrograms:
    """Refute one cone of denominators after the other, on a stretch of rows.

    Parameters
    ----------
    programs : Programs
    stable : bool
        The zeros of all denominators lie in the closed unit disc.
    time_limit : float, optional
        Seconds of the whole search. Where they are few, nothing is compiled on a new machine.
    effort : Effort
    gain : int, optional
        Number of a known column to which multipliers need not be orthogonal.

    Attributes
    ----------
    work : float
        Of one cone, by a fixed model.
    """

    def __init__(
        self,
        programs: Programs,
        stable: bool,
        time_limit: float | None = None,
        effort: Effort = QUICK,
        gain: int | None = None,
    ) -> None:
        self.programs, self.stable, n = programs, stable, programs.order
        self.effort, self.gain, self.basis = effort, gain, programs.basis_without(gain)
        self._compiles = time_limit is None or time_limit >= _COMPILATION
        self._rows = programs.y.size - n
        self._scale = float(programs.bound.sum())
        self._minors = stable and n > 2
        known, first = self.basis.shape[1], len(pairs(n + 1)) + 1
        self._used = first + (n + 1) * known
        self.work = _CONE_WORK + _ENTRY_WORK * self._rows * self._used**2
        columns = np.zeros((self._rows, n + 1, -(-self._used // _FILL) * _FILL))
        for k in range(n + 1):
            columns[:, k, first + k * known : first + (k + 1) * known] = self.basis
        self._columns = columns.reshape(self._rows * (n + 1), -1)

    def solve(
        self, cone: Cone, powers: tuple[int, ...], target: float, value: float = 0.0
    ) -> ConeBound:
        """Refute a target in a cone, or find that it cannot be refuted there.

        Parameters
        ----------
        cone : (K, K) int
            One vector a row.
        powers : tuple of int
            Each vector is divided by 2 to this power.
        target : float
            Positive; factor on the noise bounds.
        value : float
            Of the gain, for which there are known outputs then.
        """
        vectors = np.ldexp(cone.astype(np.float64), -np.array(powers)[:, None])
        minors, units = np.zeros((0, len(pairs(len(cone))))), np.zeros(0)
        if self._minors:
            minors = hurwitz_minors(cone, powers)
            units = target * self._scale / np.maximum(np.abs(minors).max(axis=1), _TINY)
        program = _Program(
            self.programs,
            self._columns,
            self._used,
            vectors,
            minors * units[:, None],
            target * self._scale,
        )
        if self.gain is not None:
            program.drive(value * self.programs.column(self.gain))
        if next(_counter) > _OFTEN:
            program.steps = _compiled(self._compiles)
        with np.errstate(all="ignore"):
            factor, multipliers, shares, weights = program.run(self.effort)
        return ConeBound(factor / self._scale, multipliers, shares * units, weights)


class _Program:
    """One linear program: a target in a cone."""

    def __init__(
        self,
        programs: Programs,
        columns: Reals,
        used: int,
        vectors: Reals,
        minors: Reals,
        target: float,
    ) -> None:
        self.minors, self.used, size = minors, used, len(vectors)
        self.steps: ModuleType = plain_steps
        w = programs.bound / float(programs.bound.sum())
        one, two = np.array(pairs(size)).T
        self.count = one.size
        places = np.zeros((size, size), np.int64)
        places[one, two] = places[two, one] = np.arange(self.count)
        columns = columns.copy()
        columns[:, : self.count] = -paired_columns(np.tile(programs.y, (self.count, 1)), vectors).T
        silent = (programs.silent[:, None] * size + np.arange(size)).ravel()
        columns[silent] = 0.0
        self.fixed = Fixed(w, target, vectors, places, columns, silent)
        self._rows = programs.y.size - programs.order

    def drive(self, outputs: Reals) -> None:
        """Take known outputs (S,) off the readings that the first coefficients multiply."""
        first = np.zeros_like(self.fixed.vectors)
        first[:, 0] = self.fixed.vectors[:, 0]
        off = paired_columns(np.tile(outputs, (self.count, 1)), first).T
        off[self.fixed.silent] = 0.0
        self.fixed.columns[:, : self.count] += off

    def run(self, effort: Effort) -> tuple[float, Reals, Reals, Reals]:
        """Return the factor, multipliers, shares of minors and dual weights."""
        at, target = self._start(), self.fixed.target
        nothing = np.zeros(self.count), np.zeros(self.fixed.columns.shape[1])
        totals = Totals(at.sized.sizes @ self.fixed.w, *nothing)
        best = 0.0, at.multipliers, at.minors, at.coupled.weights
        infeasible, reached = 1.0, list[float]()
        for _ in range(_STEPS):
            try:
                at, totals, dual = self._step(at, totals)
            except np.linalg.LinAlgError:
                break
            infeasible *= 1.0 - dual
            factor = float(np.min(self.needed(at, totals) / np.maximum(totals.noise, _TINY)))
            if not np.isfinite(factor):
                break
            if factor > best[0]:
                best = factor, at.multipliers, at.minors, at.coupled.weights
            if factor >= target * _OVER:
                break
            reached.append(best[0] / target)
            if infeasible < effort.infeasible and at.coupled.dual_level < effort.level * target:
                break
            if _remaining(reached) > effort.patience:
                break
        return (*best[:3], at.coupled.weights)

    def needed(self, at: _Point, totals: Totals) -> Reals:
        """Compute the left side that each pair reaches, beside its noise (pairs,)."""
        return np.asarray(-totals.products[: self.count] - at.minors @ self.minors, np.float64)

    def _step(self, at: _Point, totals: Totals) -> tuple[_Point, Totals, float]:
        """Go a step, with a predictor and a corrector; return its part in the dual values too."""
        newton, (slacks, duals) = _Newton(self, at, totals), at.small()
        nothing = Sized(*np.zeros((4, *at.sized.sizes.shape)))
        affine = newton.direction(0.0, nothing, np.zeros(slacks.size))
        turns, dual_turns = affine.point.small()
        primal, dual = affine.lengths(at)
        now, forth, back, both = affine.sums
        after = now + primal * forth + dual * back + primal * dual * both
        after += float((slacks + primal * turns) @ (duals + dual * dual_turns))
        now += float(slacks @ duals)
        count = 2 * at.sized.sizes.size + slacks.size
        aim = (after / now) ** 3 * now / count
        step = newton.direction(aim, affine.point.sized, turns * dual_turns)
        primal, dual = (_INSIDE * length for length in step.lengths(at))
        change, coupled = step.point, at.coupled
        multipliers = at.multipliers + primal * change.multipliers
        sized, totals = self.steps.advanced(
            at.sized, change.sized, primal, dual, multipliers, self.fixed
        )
        following = _Point(
            multipliers,
            sized,
            at.level + primal * change.level,
            at.minors + primal * change.minors,
            at.slack + primal * change.slack,
            Coupled(
                coupled.weights + dual * change.coupled.weights,
                coupled.dual_level + dual * change.coupled.dual_level,
            ),
            at.dual_minors + dual * change.dual_minors,
        )
        return following, totals, dual

    def _start(self) -> _Point:
        """Begin with all products of a size near the least of them."""
        count, target, w = self.count, self.fixed.target, self.fixed.w
        shape = count, w.size
        sizes, weights = np.full(shape, 1.0 / count), np.full(count, 1.0 / count)
        mean = 0.5 * float(w.mean()) * target / count**2
        dual_minors = np.full(len(self.minors), target / count)
        minors = mean / dual_minors
        slack = mean * count
        level = -target / count - slack
        found = -target * (sizes @ w) - minors @ self.minors - level
        above = np.tile(0.5 * target / count * w, (count, 1))
        return _Point(
            np.zeros((len(self.fixed.vectors), self._rows)),
            Sized(sizes, np.zeros(shape), above, above.copy()),
            level,
            minors,
            np.maximum(found, slack),
            Coupled(weights, 0.0),
            dual_minors,
        )


class _Direction(NamedTuple):
    """A direction, with the quotients and sums of ``plain_steps.backward``."""

    point: _Point
    least: Reals
    sums: Reals

    def lengths(self, at: _Point) -> tuple[float, float]:
        """Compute steps to the boundary, at most 1, in unknowns and in dual values."""
        least = self.least
        if at.slack.size:
            pairs_ = zip(self.point.small(), at.small(), strict=True)
            least = np.minimum(least, [np.min(change / now) for change, now in pairs_])
        primal, dual = (min(1.0, -1.0 / value) if value < 0.0 else 1.0 for value in least.tolist())
        return primal, dual


class _Newton:
    """Directions from one point: the matrix is factored once.

    Sizes and multipliers are eliminated in ``plain_steps.py``. Pairs, the sum of sizes, the known
    columns, the level and the minors are left, some thirty unknowns.
    """

    def __init__(self, program: _Program, at: _Point, totals: Totals) -> None:
        self._program, self._at, self._totals = program, at, totals
        fixed = program.fixed
        self._reduced = program.steps.eliminated(at.sized, at.coupled.weights, fixed)
        if not self._reduced.fine:
            raise np.linalg.LinAlgError
        self._gap = program.needed(at, totals) - fixed.target * totals.sizes - at.level
        self._matrix = self._small()

    def _small(self) -> Reals:
        """The matrix of pairs, sizes, known columns, level and minors."""
        program, at, pairs_ = self._program, self._at, self._program.count
        minors, target, curve = program.minors, program.fixed.target, self._reduced.curve
        inner = program.used
        found = np.zeros((inner + 1 + len(minors),) * 2)
        found[:inner, :inner] = self._reduced.inner[:inner, :inner]
        every = np.arange(pairs_)
        found[every, every] += target**2 * curve + at.slack / at.coupled.weights
        found[:pairs_, pairs_] += target * curve
        found[pairs_, :pairs_] += target * curve
        found[pairs_, pairs_] += curve.sum()
        found[:pairs_, inner], found[inner, :pairs_] = -1.0, -1.0
        found[:pairs_, inner + 1 :], found[inner + 1 :, :pairs_] = -minors.T, -minors
        late = inner + 1 + np.arange(len(minors))
        found[late, late] = -at.dual_minors / at.minors
        return found

    def direction(self, aim: float, before: Sized, products: Reals) -> _Direction:
        """Step such that products of slacks and duals become ``aim`` in first order.

        Parameters
        ----------
        aim : float
        before : Sized
            A direction whose products of second order are taken off.
        products : (pairs + minors,) float
            Those of the slacks of pairs and of the minors.
        """
        program, at, fixed, reduced = self._program, self._at, self._program.fixed, self._reduced
        pairs_, used, weights, totals = (
            program.count,
            program.used,
            at.coupled.weights,
            self._totals,
        )
        one, two = at.small()
        aims = aim - one * two - products
        half = program.steps.forward(aim, at.sized, before, at.coupled, fixed, reduced)
        right = np.concatenate(
            [
                fixed.target * half.moved
                - half.inner[:pairs_]
                + aims[:pairs_] / weights
                - (self._gap - at.slack),
                [half.moved.sum() - half.inner[pairs_] + totals.sizes.sum() - 1.0],
                totals.products[pairs_ + 1 : used] - half.inner[pairs_ + 1 : used],
                [weights.sum() - 1.0],
                program.minors @ weights - at.dual_minors - aims[pairs_:] / at.minors,
            ]
        )
        solved = np.linalg.solve(self._matrix, right)
        change = Coupled(solved[:pairs_], float(solved[pairs_]))
        level, shares = float(solved[used]), solved[used + 1 :]
        beside = np.zeros(len(reduced.inner))
        beside[:used] = solved[:used]
        multipliers, sized, least, sums = program.steps.backward(
            beside, half, at.sized, change, fixed, reduced
        )
        point = _Point(
            multipliers,
            sized,
            level,
            shares,
            (aims[:pairs_] - at.slack * change.weights) / weights,
            change,
            (aims[pairs_:] - at.dual_minors * shares) / at.minors,
        )
        return _Direction(point, least, sums)


def _compiled(anew: bool) -> ModuleType:
    """Steps compiled by numba, which read factors once.

    Those by LAPACK where numba is missing or has no place for its cache, and where the machine code
    is not on disk and must not be made anew.
    """
    try:
        from setid.minimum_noise.cones import compiled_steps
    except (ImportError, RuntimeError):
        return plain_steps
    return compiled_steps if anew or compiled_steps.are_kept() else plain_steps


def _remaining(reached: list[float]) -> float:
    """Number the steps to a whole target at the rate of the last ones, from what each reached."""
    if len(reached) <= _LOOK + 1:
        return 0.0
    rate = (reached[-1] - reached[-1 - _LOOK]) / _LOOK
    return (1.0 - reached[-1]) / rate if rate > 0.0 else inf
