"""State of the interior-point method: settings, points, log, and termination.

A solve ends on what matters to a proof: the distance of the primal value from the safe value,
which is the dual value less the largest effect of its residual on moments in [-1, 1].

References
----------
C. Jansson, D. Chaykin, C. Keil, Rigorous error bounds for the optimal value in semidefinite
programming, SIAM J. Numer. Anal. 46, 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers

__all__ = [
    "Iterate",
    "Iteration",
    "Outcome",
    "Settings",
    "better",
    "gap",
    "judge",
    "verdict",
    "wants_repair",
]

Reals = NDArray[np.float64]
_NOISE = 3e-5  # times the asked gap: what rounding leaves of sum |q|
_ROUNDING = 0.5  # part of the gap below which complementarity is not what is missing
_HALTING = 0.3  # length of a step near the end that shows rounding errors
_FAR = 1e3  # size of moments up to which emptiness, and from which unboundedness, is claimed


@dataclass(frozen=True, slots=True)
class Settings:
    """Tolerances and limits.

    Parameters
    ----------
    gap : float
        Largest distance of q'y and the safe value, relative to max(1, |q'y + offset|) in the
        program's own units.
    accepted : float
        The same, for a solve that makes no progress any more.
    feasibility : float
        Largest residual of the scaled rows.
    loose : float
        Gap and residual at which a solve that cannot go on is called ``almost``.
    patience : int
        Iterations without progress after which a solve cannot go on.
    penalty : float
        delta of the equality rows.
    second_penalty : float
        The same for a second attempt, where the first one does not solve.
    regularisation : float
        Relative change of pivots.
    refinements : int
        Most refinement steps of one linear solve.
    boundary, stretch : float
        Part of the way to the boundary that a step may go, and what is added to it times the
        length of the predictor.
    height : float
        Multiple of the size of the objective that first multipliers are.
    iterations : int
    kernels : {"auto", "numpy", "numba"}
        ``"auto"``: those of numba where it is installed and the program is large enough.
    solves : int
        Number of solves of this kind to come: loading compiled kernels is paid for once.
    threads : int
        Of the compiled kernels, over blocks and over branches of the tree. Results are the same
        to the last bit. BLAS is to have one thread (``OMP_NUM_THREADS=1``).
    """

    gap: float = 1e-7
    accepted: float = 1e-6
    feasibility: float = 1e-8
    loose: float = 1e-5
    patience: int = 6
    penalty: float = 1e-7
    second_penalty: float = 1e-9
    regularisation: float = 1e-13
    refinements: int = 4
    boundary: float = 0.9
    stretch: float = 0.06
    height: float = 1.0
    iterations: int = 80
    kernels: Literal["auto", "numpy", "numba"] = "auto"
    solves: int = 1
    threads: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """Point of the method, in scaled numbers.

    Parameters
    ----------
    y : (M,) float
    s, z : (N,) float
        Inside the cone.
    w : (zero,) float
    """

    y: Reals
    s: Reals
    z: Reals
    w: Reals


@dataclass(frozen=True, slots=True)
class Iteration:
    """One line of the log, in scaled numbers.

    Parameters
    ----------
    mu : float
    primal_residual, dual_residual : float
        Largest entries.
    primal, dual, safe : float
        q'y, the dual objective, and its safe value on moments in [-1, 1].
    centring, primal_step, dual_step : float
        Of the step that led here.
    """

    mu: float
    primal_residual: float
    dual_residual: float
    primal: float
    dual: float
    safe: float
    centring: float
    primal_step: float
    dual_step: float


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Final point and status of the method.

    Parameters
    ----------
    status, detail : str
    iterate : Iterate
        The last point, with the multipliers of the highest safe value.
    log : tuple of Iteration
    seconds : dict
        CPU seconds of each phase.
    early : Iterate, optional
        The point after three steps: a start for nearby programs of the same pattern.
    """

    status: str
    detail: str
    iterate: Iterate
    log: tuple[Iteration, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    early: Iterate | None = None


def judge(
    numbers: Numbers,
    settings: Settings,
    log: list[Iteration],
    at: Iterate,
    target: float | None,
) -> tuple[str, str]:
    """Decide status and reason, or two empty strings to go on.

    Parameters
    ----------
    numbers : Numbers
    settings : Settings
    log : list of Iteration
    at : Iterate
    target : float or None
        A safe value that is enough, scaled.

    Returns
    -------
    status, detail : str
    """
    now = log[-1]
    if not np.isfinite(now.mu + now.primal + now.dual):
        return "failed", "not finite"
    if target is not None and now.safe >= target:
        return "solved", "target"
    extreme = _extreme(numbers, settings, now, at)
    if extreme[0]:
        return extreme
    if now.primal_residual < settings.feasibility:
        distance = gap(numbers, log)
        if distance < settings.gap:
            return "solved", "gap"
        if distance < settings.accepted and _complementarity(numbers, log) < _ROUNDING * distance:
            return "solved", "rounding"
        if distance < settings.accepted and (
            min(now.primal_step, now.dual_step) < _HALTING
            or _stalled(log, settings.patience // 2, settings)
        ):
            return "solved", "no progress"
    if len(log) > settings.iterations:
        return verdict(numbers, settings, log), "iteration limit"
    if _stalled(log, settings.patience, settings):
        return verdict(numbers, settings, log), "no progress"
    return "", ""


def _extreme(numbers: Numbers, settings: Settings, now: Iteration, at: Iterate) -> tuple[str, str]:
    """Decide whether the values left the range that moments in [-1, 1] allow."""
    reach = float(np.abs(numbers.q).sum())
    fall = -now.primal / max(reach, 1e-300)
    if fall > _FAR and now.primal_residual < settings.loose * fall:
        return "failed", "the objective falls without limit"
    if now.safe > reach:
        ray = numbers.Ct @ at.z + numbers.rows_turned(at.w)
        if now.dual > _FAR * float(np.abs(ray).sum()):
            return "infeasible", "dual ray"
    return "", ""


def gap(numbers: Numbers, log: list[Iteration]) -> float:
    """Measure the distance of q'y and the best safe value, relative to a scale.

    The scale is max(1, |q'y + offset|) in the program's units, or a part of sum |q| that rounding
    errors do not allow to resolve.
    """
    distance = abs(log[-1].primal - max(line.safe for line in log))
    return max(distance / _scale(numbers, log), _complementarity(numbers, log))


def wants_repair(numbers: Numbers, settings: Settings, log: list[Iteration]) -> bool:
    """Check that the dual residual alone keeps the gap open."""
    now = log[-1]
    return (
        now.primal_residual < settings.feasibility
        and _complementarity(numbers, log) < settings.gap
        and now.dual - now.safe > 0.0
    )


def _complementarity(numbers: Numbers, log: list[Iteration]) -> float:
    """Measure the gap that exact arithmetic would leave, on the same scale."""
    return log[-1].mu * numbers.cone.degree / _scale(numbers, log)


def _scale(numbers: Numbers, log: list[Iteration]) -> float:
    value = log[-1].primal + numbers.offset
    noise = _NOISE * float(np.abs(numbers.q).sum())
    return max(1.0 / numbers.unit, abs(value), noise)


def _stalled(log: list[Iteration], patience: int, settings: Settings) -> bool:
    """Check that nothing improved for a number of iterations.

    Once the rows hold, only the distance of primal and safe value counts.
    """
    if len(log) <= patience:
        return False
    old, new = log[:-patience], log[-patience:]

    def gained(measure: Callable[[Iteration], float], part: float) -> bool:
        return min(measure(line) for line in new) < part * min(measure(line) for line in old)

    highest = max(line.primal for line in new)
    if gained(lambda line: highest - line.safe, 0.9):
        return False
    if log[-1].primal_residual < settings.loose:
        return True
    return not (gained(lambda line: line.mu, 0.5) or gained(lambda line: line.primal_residual, 0.5))


def verdict(numbers: Numbers, settings: Settings, log: list[Iteration]) -> str:
    """Name the status of a solve that cannot go on."""
    distance = gap(numbers, log)
    if log[-1].primal_residual > settings.loose or distance > max(settings.loose, settings.gap):
        return "failed"
    return "solved" if distance < max(settings.accepted, settings.gap) else "almost"


def better(first: Outcome, second: Outcome) -> Outcome:
    """Return the outcome with the higher safe value, with the CPU seconds of both."""
    chosen = max(second, first, key=lambda out: max(line.safe for line in out.log))
    seconds = {
        phase: first.seconds.get(phase, 0.0) + second.seconds.get(phase, 0.0)
        for phase in first.seconds | second.seconds
    }
    return replace(chosen, seconds=seconds)
