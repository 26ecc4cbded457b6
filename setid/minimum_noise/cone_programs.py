"""The largest noise that multipliers refute in a cone of denominators: a linear program.

The notation is that of ``proofs/least_noise/varying_multipliers.py``: a cone is spanned by vectors
v_j, each with a multiplier lambda_j. For a target tau of the factor on the noise bounds w the
program is

    max t :   Y_p lambda - tau sum_i w(i) s_p(i) - sigma' H_p - t  >=  0,
              abs(v_j * lambda_k + v_k * lambda_j)(i)  <=  s_p(i)    for each pair p = (j, k),
              sum_p sum_i w(i) s_p(i)  =  1,    sigma >= 0,
              lambda_j orthogonal to the known columns,

with Y_p lambda = sum_i y(i) (v_j * lambda_k + v_k * lambda_j)(i). Where t > 0 no member of the cone
explains the record with noise of tau w; where t <= 0 the cone has to be parted. It is solved by a
primal-dual interior-point method with a predictor and a corrector (S. Mehrotra, *SIAM J.
Optimization* 2 (1992) 575-601). Sizes s leave each step on their own, one by one. What remains in
lambda is a banded matrix, as a filter joins a sample with n others. So a step costs as much as the
record is long. The method ends where the target is refuted, where it cannot be, and where it comes
so slowly that two parts of the cone are cheaper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from setid.minimum_noise.programs import Programs
from setid.proofs.least_noise.denominator_cells import Cone
from setid.proofs.least_noise.varying_multipliers import hurwitz_minors, pairs

__all__ = ["ConeBound", "ConePrograms", "solved_cone"]

Reals = NDArray[np.float64]
_STEPS = 50
_INSIDE = 0.98  # of a step to the boundary
_OPEN = 1e-3  # of a target: a level with which a cone is parted
_INFEASIBLE = 0.05  # what is left of the infeasibility of dual values, where these tell
_LOOK = 3  # steps whose rate counts
_OVER = 1.0 + 1e-8  # of a target: what is lost to rounding
_OFTEN = 30  # programs of a process: then compiled substitution is worth its loading
_counter = count()
_TINY = 1e-300


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
    filtered: Reals  # (pairs, S) v_j * lambda_k + v_k * lambda_j
    sizes: Reals  # (pairs, S)
    level: float
    minors: Reals
    slack: Reals  # (pairs,)
    above: Reals  # (pairs, S) dual of filtered <= sizes
    below: Reals  # (pairs, S) dual of -filtered <= sizes
    weights: Reals  # (pairs,) dual of the slacks
    dual_minors: Reals
    dual_level: float  # no level is larger, where the dual values are feasible

    def products(self) -> list[tuple[Reals, Reals]]:
        """Pair what has to be positive with its dual."""
        return [
            (self.sizes - self.filtered, self.above),
            (self.sizes + self.filtered, self.below),
            (self.slack, self.weights),
            (self.minors, self.dual_minors),
        ]

    def moved(self, other: _Point, primal: float, dual: float) -> None:
        """Go a part of a direction, in the unknowns and in the dual values."""
        for name in ("multipliers", "filtered", "sizes", "level", "minors", "slack"):
            setattr(self, name, getattr(self, name) + primal * getattr(other, name))
        for name in ("above", "below", "weights", "dual_minors", "dual_level"):
            setattr(self, name, getattr(self, name) + dual * getattr(other, name))


class ConePrograms:
    """Refute one cone of denominators after the other, on a stretch of rows.

    Parameters
    ----------
    programs : Programs
    stable : bool
        The zeros of all denominators lie in the closed unit disc.
    """

    def __init__(self, programs: Programs, stable: bool) -> None:
        self._programs, n = programs, programs.order
        self._rows = programs.y.size - n
        self._scale = float(programs.bound.sum())
        self._minors = stable and n > 2
        columns = programs.basis.shape[1]
        known = np.zeros((n + 1, columns, self._rows, n + 1))
        for k in range(n + 1):
            known[k, :, :, k] = programs.basis.T
        self._known = known.reshape((n + 1) * columns, -1)

    def solve(
        self, cone: Cone, powers: tuple[int, ...], target: float, patience: float = inf
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
        patience : float
            Steps in which the target has to be reached at the present rate.
        """
        vectors = np.ldexp(cone.astype(np.float64), -np.array(powers)[:, None])
        minors, units = np.zeros((0, len(pairs(len(cone))))), np.zeros(0)
        if self._minors:
            minors = hurwitz_minors(cone, powers)
            units = target * self._scale / np.maximum(np.abs(minors).max(axis=1), _TINY)
        program = _Program(
            self._programs, self._known, vectors, minors * units[:, None], target * self._scale
        )
        if next(_counter) > _OFTEN:
            program.substitution = _compiled()
        with np.errstate(all="ignore"):
            factor, multipliers, shares, weights = program.run(patience)
        return ConeBound(factor / self._scale, multipliers, shares * units, weights)


def solved_cone(task: tuple[ConePrograms, Cone, tuple[int, ...], float, float]) -> ConeBound:
    """Solve the program of a cone, in any process.

    Parameters
    ----------
    task : tuple
        Programs of the record, and the arguments of :meth:`ConePrograms.solve`.
    """
    programs, cone, powers, target, patience = task
    return programs.solve(cone, powers, target, patience)


class _Program:
    """One linear program: a target in a cone. Flat multipliers have those of a row together."""

    def __init__(
        self, programs: Programs, known: Reals, vectors: Reals, minors: Reals, target: float
    ) -> None:
        self._order, self._vectors = programs.order, vectors
        self.minors, self.target, self.known = minors, target, known
        self.substitution: Callable[[Reals, Reals], Reals] = _by_lapack
        self.w = programs.bound / float(programs.bound.sum())
        self._one, self._two = np.array(pairs(len(vectors))).T
        self.count, size = self._one.size, len(vectors)
        self._rows = programs.y.size - self._order
        joined = np.zeros((self.count, size, size))  # [p, i, k]: of lambda_k i samples ahead
        every = np.arange(self.count)
        joined[every, :, self._two] += vectors[self._one]
        joined[every, :, self._one] += vectors[self._two]
        self._bands = [
            np.einsum("pic,pie->ceip", joined[:, : size - d], joined[:, d:]).reshape(
                size * size, -1
            )
            for d in range(size)
        ]
        self.needed = self.columns(np.tile(programs.y, (self.count, 1)))

    def filtered(self, multipliers: Reals) -> Reals:
        """Filter multipliers (K, R) by the vectors, (pairs, S)."""
        size, samples = len(self._vectors), self.w.size
        padded = np.zeros((size, samples + size - 1))
        padded[:, size - 1 : samples] = multipliers
        shifted = np.stack([padded[:, i : i + samples] for i in range(size)])
        each = (self._vectors @ shifted.reshape(size, -1)).reshape(size, size, samples)
        return np.asarray(each[self._one, self._two] + each[self._two, self._one], np.float64)

    def adjoint(self, filtered: Reals) -> Reals:
        """Transpose :meth:`filtered`, from (pairs, S) to flat (R K,)."""
        size, rows = len(self._vectors), self._rows
        each = np.zeros((size, size, self.w.size))
        each[self._one, self._two] += filtered
        each[self._two, self._one] += filtered
        back = (self._vectors.T @ each.reshape(size, -1)).reshape(size, size, -1)
        found = np.zeros((size, rows))
        for i in range(size):
            found += back[i, :, self._order - i : self._order - i + rows]
        return found.T.ravel()

    def columns(self, filtered: Reals) -> Reals:
        """Transpose :meth:`filtered` pair by pair, (pairs, R K)."""
        size, every = len(self._vectors), np.arange(self.count)
        back = self._windows(filtered)
        found = np.zeros((self.count, self._rows, size))
        found[every, :, self._two] += np.einsum("pi,ipr->pr", self._vectors[self._one], back)
        found[every, :, self._one] += np.einsum("pi,ipr->pr", self._vectors[self._two], back)
        return found.reshape(self.count, -1)

    def band(self, weights: Reals) -> Reals:
        """The lower band of F' diag(weights) F, (K K, R K)."""
        size, back = len(self._vectors), self._windows(weights)
        found = np.zeros((size, size, self._rows, size))
        for d, entries in enumerate(self._bands):
            part = entries @ back[: size - d].reshape(-1, self._rows)
            table = part.reshape(size, size, -1)
            for c in range(size):
                for e in range(c if d == 0 else 0, size):
                    place = d * size + e - c
                    found[place // size, place % size, :, c] = table[c, e]
        return found.reshape(size * size, -1)

    def _windows(self, table: Reals) -> Reals:
        n = self._order
        return np.stack([table[:, n - i : n - i + self._rows] for i in range(n + 1)])

    def run(self, patience: float) -> tuple[float, Reals, Reals, Reals]:
        """Return the factor, multipliers, shares of minors and dual weights."""
        at = self._start()
        best = 0.0, at.multipliers, at.minors, at.weights
        infeasible, reached = 1.0, list[float]()
        for _ in range(_STEPS):
            try:
                newton = _Newton(self, at)
            except (np.linalg.LinAlgError, ValueError):  # as good as singular
                break
            products = at.products()
            affine = newton.direction([-one * two for one, two in products])
            primal, dual = _lengths(at, affine)
            count = sum(one.size for one, _ in products)
            mean = sum(float(np.sum(one * two)) for one, two in products) / count
            turns = affine.products()
            after = sum(
                float(np.sum((one + primal * d_one) * (two + dual * d_two)))
                for (one, two), (d_one, d_two) in zip(products, turns, strict=True)
            )
            aim = (after / count / mean) ** 3 * mean
            step = newton.direction(
                [
                    aim - one * two - d_one * d_two
                    for (one, two), (d_one, d_two) in zip(products, turns, strict=True)
                ]
            )
            primal, dual = (_INSIDE * length for length in _lengths(at, step))
            at.moved(step, primal, dual)
            infeasible *= 1.0 - dual
            factor = self._factor(at)
            if not np.isfinite(factor):
                break
            if factor > best[0]:
                best = factor, at.multipliers, at.minors, at.weights
            if factor >= self.target * _OVER:
                break
            reached.append(best[0] / self.target)
            if infeasible < _INFEASIBLE and at.dual_level < _OPEN * self.target:
                break
            if _remaining(reached) > patience:
                break
        return (*best[:3], at.weights)

    def _factor(self, at: _Point) -> float:
        """The factor that the multipliers refute."""
        value = self.needed @ at.multipliers.T.ravel() - at.minors @ self.minors
        noise = np.abs(at.filtered) @ self.w
        return float(np.min(value / np.maximum(noise, _TINY)))

    def _start(self) -> _Point:
        """Begin with all products of a size near the least of them."""
        count, target, w = self.count, self.target, self.w
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
            np.zeros((len(self._vectors), self._rows)),
            np.zeros(shape),
            sizes,
            level,
            minors,
            np.maximum(found, slack),
            above,
            above.copy(),
            weights,
            dual_minors,
            0.0,
        )


class _Newton:
    """Directions from one point: the matrix is factored once.

    With slacks u, v = sizes -+ filtered and their duals a, b, sizes leave by the diagonal matrix
    a / u + b / v. The multipliers then have the banded matrix F' diag(4 / (u / a + v / b)) F,
    where F filters. Its factor takes them out as well. Pairs, the sum of sizes, the known
    columns, the level and the minors are left, some thirty unknowns.
    """

    def __init__(self, program: _Program, at: _Point) -> None:
        self._program, self._at = program, at
        w, target = program.w, program.target
        self._down, self._up = at.sizes - at.filtered, at.sizes + at.filtered
        one, two = at.above / self._down, at.below / self._up
        self._sum, self._difference = one + two, one - two
        self._skew = self._difference / self._sum
        band = program.band(4.0 * one * two / self._sum)
        self._factor = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=True)
        spread = w * self._skew
        rows = np.vstack(
            [
                target * program.columns(spread) - program.needed,
                program.adjoint(spread)[None],
                program.known,
            ]
        )
        self._columns = program.substitution(self._factor, rows)
        self._inner = self._columns.T @ self._columns
        self._curve = (w * w / self._sum).sum(axis=1)
        self._loss = program.adjoint(at.above - at.below) - at.weights @ program.needed
        self._size_loss = (target * at.weights[:, None] + at.dual_level) * w - at.above - at.below
        self._matrix = self._small()

    def _forward(self, column: Reals, transposed: bool = False) -> Reals:
        return _substituted(self._factor, column, transposed)

    def _small(self) -> Reals:
        """The matrix of pairs, sizes, known columns, level and minors."""
        program, at, pairs_ = self._program, self._at, self._program.count
        minors, target = program.minors, program.target
        inner = len(self._inner)
        found = np.zeros((inner + 1 + len(minors),) * 2)
        found[:inner, :inner] = self._inner
        every = np.arange(pairs_)
        found[every, every] += target**2 * self._curve + at.slack / at.weights
        found[:pairs_, pairs_] += target * self._curve
        found[pairs_, :pairs_] += target * self._curve
        found[pairs_, pairs_] += self._curve.sum()
        found[:pairs_, inner], found[inner, :pairs_] = -1.0, -1.0
        found[:pairs_, inner + 1 :], found[inner + 1 :, :pairs_] = -minors.T, -minors
        late = inner + 1 + np.arange(len(minors))
        found[late, late] = -at.dual_minors / at.minors
        return found

    def direction(self, aims: list[Reals]) -> _Point:
        """Step such that products of slacks and duals change by ``aims`` in first order."""
        program, at, w = self._program, self._at, self._program.w
        target, minors, pairs_ = program.target, program.minors, program.count
        first, second = aims[0] / self._down, aims[1] / self._up
        size = first + second - self._size_loss
        drive = self._forward(program.adjoint(first - second - self._skew * size) + self._loss)
        inner = -(self._columns.T @ drive)
        moved = (w * size / self._sum).sum(axis=1)
        flat = at.multipliers.T.ravel()
        gap = program.needed @ flat - target * (at.sizes @ w) - at.minors @ minors - at.level
        right = np.concatenate(
            [
                inner[:pairs_] + target * moved + aims[2] / at.weights - (gap - at.slack),
                [inner[pairs_] + moved.sum() + float((at.sizes @ w).sum()) - 1.0],
                inner[pairs_ + 1 :] + program.known @ flat,
                [at.weights.sum() - 1.0],
                minors @ at.weights - at.dual_minors - aims[3] / at.minors,
            ]
        )
        solved = np.linalg.solve(self._matrix, right)
        count = len(self._inner)
        weights, dual_level = solved[:pairs_], float(solved[pairs_])
        level, shares = float(solved[count]), solved[count + 1 :]
        back = self._forward(drive + self._columns @ solved[:count], transposed=True)
        multipliers = -back.reshape(-1, len(at.multipliers)).T
        filtered = program.filtered(multipliers)
        pull = (target * weights[:, None] + dual_level) * w
        sizes = (size - pull + self._difference * filtered) / self._sum
        return _Point(
            multipliers,
            filtered,
            sizes,
            level,
            shares,
            (aims[2] - at.slack * weights) / at.weights,
            (aims[0] - at.above * (sizes - filtered)) / self._down,
            (aims[1] - at.below * (sizes + filtered)) / self._up,
            weights,
            (aims[3] - at.dual_minors * shares) / at.minors,
            dual_level,
        )


def _substituted(factor: Reals, right: Reals, transposed: bool = False) -> Reals:
    """Solve L x = r or L' x = r with the lower band (b + 1, n) of L, for columns r."""
    found, info = dtbtrs(factor, right, uplo="L", trans="T" if transposed else "N")
    if info:
        raise np.linalg.LinAlgError
    return np.asarray(found, np.float64)


def _by_lapack(factor: Reals, rows: Reals) -> Reals:
    """Solve L x = r for each row r of (m, n); one solution a column."""
    return _substituted(factor, rows.T)


def _compiled() -> Callable[[Reals, Reals], Reals]:
    """The same compiled by numba, which reads the factor once; LAPACK's where numba is missing."""
    try:
        from setid.minimum_noise.compiled_forward import forward
    except ImportError:
        return _by_lapack
    return forward


def _remaining(reached: list[float]) -> float:
    """Number the steps to a whole target at the rate of the last ones, from what each reached."""
    if len(reached) <= _LOOK + 1:
        return 0.0
    rate = (reached[-1] - reached[-1 - _LOOK]) / _LOOK
    return (1.0 - reached[-1]) / rate if rate > 0.0 else inf


def _lengths(at: _Point, step: _Point) -> tuple[float, float]:
    """Steps to the boundary, at most 1, in the unknowns and in the dual values."""
    least = [0.0, 0.0]
    for now, change in zip(at.products(), step.products(), strict=True):
        for side in range(2):
            if now[side].size:
                least[side] = min(least[side], float(np.min(change[side] / now[side])))
    primal, dual = (min(1.0, -1.0 / value) if value < 0.0 else 1.0 for value in least)
    return primal, dual
