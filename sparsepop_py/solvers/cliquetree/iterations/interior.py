"""Infeasible primal-dual interior-point steps on a program in place.

    minimise q'y  subject to  c - C y = s in K,  E y = e,

with multipliers z in K and free w: q + C'z + E'w = 0. The HKM direction solves

    M dy + E'dw = h,  E dy = e - E y,   M = C' (S^-1 x Z) C,

with M + E'E / delta factorized on the tree and the exact system refined with it.

References
----------
C. Helmberg, F. Rendl, R. J. Vanderbei, H. Wolkowicz, An interior-point method for
semidefinite programming, SIAM J. Optim. 6, 1996.
M. Kojima, S. Shindoh, S. Hara, SIAM J. Optim. 7, 1997; R. D. C. Monteiro, ibid. (direction).
S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM J. Optim. 2,
1992 (predictor and corrector).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.iterations.progress import (
    Iterate,
    Iteration,
    Outcome,
    Settings,
    gap,
    judge,
    verdict,
    wants_repair,
)
from sparsepop_py.solvers.cliquetree.iterations.repair import Repair, safe_value
from sparsepop_py.solvers.cliquetree.kernels.batched import OutOfTime
from sparsepop_py.solvers.cliquetree.symbolic.fronts import FrontFactor
from sparsepop_py.solvers.cliquetree.symbolic.tree import Factor

__all__ = ["minimise"]

Reals = NDArray[np.float64]
_ROUGH, _EXACT = 1e-5, 1e-12  # range of residuals of linear solves for the corrector
_SPARED = 1e-2  # part of the gap that linear solves may leave as a residual
_EARLY = 3  # steps after which a point is a good start for nearby programs
_ATTEMPTS = 3  # to factorize
_CORRECTORS = 4  # where a factorization costs so many times what a direction costs:
_EXPENSIVE = 20.0  # see above
# Step of the predictor below which its second-order term is weakened, and by how much at most;
# not with equations, where records need up to twice the iterations without it:
_TRUSTED, _LEAST_TRUST = 0.3, 0.1
_LONG = 0.9  # part of the whole step that no further corrector is to lengthen


@dataclass(slots=True)
class _Clock:
    seconds: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.process_time)

    def charge(self, phase: str) -> None:
        now = time.process_time()
        self.seconds[phase] = self.seconds.get(phase, 0.0) + now - self.last
        self.last = now


@dataclass(frozen=True, slots=True, eq=False)
class _Residuals:
    cone: Reals  # c - C y - s
    equal: Reals  # e - E y
    dual: Reals  # -q - C'z - E'w


@dataclass(frozen=True, slots=True, eq=False)
class _Newton:
    """Factorized Newton system of one iteration."""

    numbers: Numbers
    settings: Settings
    factor: Factor | FrontFactor
    inverse: Reals
    z: Reals
    residuals: _Residuals
    moved: Reals  # D(r): what the primal residual takes from z
    mu: float

    def direction(self, centring: float, correction: Reals | None) -> Iterate:
        """Compute the direction towards mu * centring, with Mehrotra's second-order term."""
        n = self.numbers
        fixed = centring * self.mu * self.inverse - self.z - self.moved
        if correction is not None:
            fixed = fixed - correction
        right = self.residuals.dual - n.Ct @ fixed
        accuracy = np.inf if correction is None else self._needed(right)
        dy, dw, change, image = self._solve(right, self.residuals.equal, accuracy)
        return Iterate(dy, self.residuals.cone - change, fixed + image, dw)

    def _needed(self, right: Reals) -> float:
        """Compute the accuracy that leaves a dual residual well below the gap."""
        allowed = _SPARED * self.mu * self.numbers.cone.degree / max(right.size, 1)
        return float(min(_ROUGH, max(_EXACT, allowed / np.abs(right).max(initial=1e-300))))

    def _solve(self, h: Reals, equal: Reals, accuracy: float) -> tuple[Reals, ...]:
        """Solve M dy + E'dw = h, E dy = equal to an accuracy.

        Refines the solution of the factorized system. Returns dy, dw, C dy and D(C dy).
        """
        n, delta = self.numbers, self.settings.penalty
        first, second = h, equal
        size, before = np.abs(h).max(initial=1e-300), np.inf
        best: tuple[Reals, ...]
        best = np.zeros_like(h), np.zeros_like(equal), np.zeros_like(self.z), np.zeros_like(self.z)
        for _ in range(self.settings.refinements + 1):
            step = self.factor.solve(first + n.rows_turned(second / delta))
            dy, dw = best[0] + step, best[1] + (n.rows(step) - second) / delta
            change = n.C @ dy
            image = n.cone.sandwich(self.inverse, change, self.z)
            if np.isinf(accuracy):
                return dy, dw, change, image
            first = h - n.Ct @ image - n.rows_turned(dw)
            second = equal - n.rows(dy)
            error = np.abs(first).max(initial=0.0) / size + np.abs(second).max(initial=0.0)
            if not error < 0.5 * before:
                break
            best, before = (dy, dw, change, image), error
            if error < accuracy:
                break
        return best


def minimise(
    numbers: Numbers,
    settings: Settings,
    *,
    start: Iterate | None = None,
    target: float | None = None,
    deadline: float | None = None,
) -> Outcome:
    """Run the interior-point method.

    Parameters
    ----------
    numbers : Numbers
    settings : Settings
    start : Iterate, optional
        A point inside the cone from a nearby problem.
    target : float, optional
        Stop once the safe value reaches it (scaled).
    deadline : float, optional
        CPU time (``time.process_time``) after which to stop.

    Returns
    -------
    Outcome
    """
    clock = _Clock()
    point = start or _cold_start(numbers, settings.height)
    fixed = numbers.fixed_entries(1.0 / settings.penalty)
    log: list[Iteration] = []
    best, early = point, None
    step = (1.0, 0.0, 0.0)
    factor = numbers.factor()
    repair = Repair(numbers, factor, deadline)
    while True:
        residuals = _residuals(numbers, point)
        log.append(_measure(numbers, point, residuals, step))
        if log[-1].safe >= max(line.safe for line in log):
            best = point
        status, detail = judge(numbers, settings, log, point, target)
        if not status and deadline is not None and time.monotonic() > deadline:
            status, detail = verdict(numbers, settings, log), "time limit"
        if wants_repair(numbers, settings, log) or detail in ("rounding", "no progress"):
            new = _repaired(numbers, log, point, repair)
            if new is not None and (status or gap(numbers, log) < settings.gap):
                best = point = new
                status, detail = verdict(numbers, settings, log), "repaired"
        if status:
            break
        if len(log) == 1 + _EARLY:
            early = point
        clock.charge("rest")
        try:
            root_s = numbers.cone.inverse_factor(point.s)
            root_z = numbers.cone.inverse_factor(point.z)
            inverse = numbers.cone.inverse(root_s)
            clock.charge("inverses")
            _factorize(numbers, factor, fixed, inverse, point.z, settings, clock, deadline)
        except (np.linalg.LinAlgError, OutOfTime) as error:
            status, detail = verdict(numbers, settings, log), str(error)
            break
        moved = numbers.cone.sandwich(inverse, residuals.cone, point.z)
        newton = _Newton(numbers, settings, factor, inverse, point.z, residuals, moved, log[-1].mu)
        point, step = _advance(newton, point, root_s, root_z, clock)
        if max(step[1:]) < 1e-4:
            status, detail = verdict(numbers, settings, log), "steps too short"
            break
    ended = Iterate(point.y, point.s, best.z, best.w)
    return Outcome(status, detail, ended, tuple(log), clock.seconds, early)


def _repaired(
    numbers: Numbers,
    log: list[Iteration],
    point: Iterate,
    repair: Repair,
) -> Iterate | None:
    """Repair the multipliers of a point; None unless its safe value is the best.

    The safe value is put into the log.
    """
    try:
        new = repair(point)
    except OutOfTime:
        return None
    safe = safe_value(numbers, new)
    if safe <= max(line.safe for line in log):
        return None
    log[-1] = replace(log[-1], safe=safe)
    return new


def _factorize(
    numbers: Numbers,
    factor: Factor | FrontFactor,
    fixed: tuple[NDArray[np.int64], Reals],
    inverse: Reals,
    z: Reals,
    settings: Settings,
    clock: _Clock,
    deadline: float | None,
) -> None:
    """Assemble and factorize, with larger regularisation where a pivot fails."""
    for attempt in range(_ATTEMPTS):
        numbers.fill(factor.entries, fixed, inverse, z, deadline)
        clock.charge("assembly")
        try:
            factor.refactor(settings.regularisation * 1e3**attempt, deadline)
            return
        except np.linalg.LinAlgError:
            if attempt == _ATTEMPTS - 1:
                raise
        finally:
            clock.charge("factor")


def _cold_start(numbers: Numbers, multiple: float) -> Iterate:
    """Multiples of the unit matrix; the dual one by the size of the objective."""
    unit = numbers.cone.identity()
    spread = float(np.sqrt(np.mean(numbers.q**2))) if numbers.q.size else 1.0
    height = min(1.0, max(multiple * spread, 1e-2))
    return Iterate(np.zeros_like(numbers.q), unit, height * unit, np.zeros_like(numbers.e))


def _residuals(numbers: Numbers, at: Iterate) -> _Residuals:
    return _Residuals(
        numbers.c - numbers.C @ at.y - at.s,
        numbers.e - numbers.rows(at.y),
        -numbers.q - numbers.Ct @ at.z - numbers.rows_turned(at.w),
    )


def _measure(
    numbers: Numbers, at: Iterate, residuals: _Residuals, step: tuple[float, float, float]
) -> Iteration:
    dual = float(-numbers.c @ at.z - numbers.e @ at.w)
    primal_residual = max(
        np.abs(residuals.cone).max(initial=0.0), np.abs(residuals.equal).max(initial=0.0)
    )
    return Iteration(
        float(at.s @ at.z) / max(numbers.cone.degree, 1),
        float(primal_residual),
        float(np.abs(residuals.dual).max(initial=0.0)),
        float(numbers.q @ at.y),
        dual,
        dual - float(np.abs(residuals.dual).sum()),
        *step,
    )


def _correctors(numbers: Numbers) -> int:
    """Choose the number of correctors, by the costs of factorization and direction.

    Each starts from the second-order term of the one before.
    """
    tree, stacks = numbers.symbolic.tree, numbers.cone.stacks
    factorization = tree.operations + sum(s.count * s.size**4 for s in stacks)
    direction = 4 * tree.entries + 30 * numbers.c.size
    return _CORRECTORS if factorization > _EXPENSIVE * direction else 1


def _advance(
    newton: _Newton, point: Iterate, root_s: Reals, root_z: Reals, clock: _Clock
) -> tuple[Iterate, tuple[float, float, float]]:
    """Take one step by a predictor and a corrector, or the longest of several."""
    cone, settings = newton.numbers.cone, newton.settings

    def lengths(d: Iterate, part: float, roughly: bool) -> tuple[float, float]:
        first = cone.largest_step(root_s, d.s, 1.0 / part, roughly) * part
        second = cone.largest_step(root_z, d.z, 1.0 / part, roughly) * part
        clock.charge("steps")
        return first, second

    predictor = newton.direction(0.0, None)
    clock.charge("solves")
    first, second = lengths(predictor, settings.boundary, True)
    ahead = (point.s + first * predictor.s) @ (point.z + second * predictor.z)
    ratio = max(float(ahead), 0.0) / max(float(point.s @ point.z), 1e-300)
    shorter = min(first, second)
    centring = min(1.0, max(1e-4, (1.0 - shorter) ** 2 * ratio))
    part = settings.boundary + settings.stretch * shorter
    trusted = 1.0 if newton.residuals.equal.size else (shorter / _TRUSTED) ** 2
    weight = min(1.0, max(_LEAST_TRUST, trusted))
    corrector, first, second = predictor, 0.0, 0.0
    for _ in range(_correctors(newton.numbers)):
        correction = cone.sandwich(newton.inverse, corrector.s, corrector.z)
        other = newton.direction(centring, weight * correction)
        clock.charge("solves")
        longer = lengths(other, part, False)
        if min(longer) < min(first, second):
            break
        corrector, (first, second), weight = other, longer, 1.0
        if min(longer) > _LONG:
            break
    after = Iterate(
        point.y + first * corrector.y,
        point.s + first * corrector.s,
        point.z + second * corrector.z,
        point.w + second * corrector.w,
    )
    return after, (centring, first, second)
