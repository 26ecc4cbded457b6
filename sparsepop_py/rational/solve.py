"""Solve a problem with ratios by polynomial problems.

Several ratios: one polynomial problem, with the reciprocals of denominators as variables.
One ratio p / q: find the level c at which min sign(q) (p - c q) is zero, by Newton's method
on that minimum as a function of c (Dinkelbach 1967): each minimiser gives the next level.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import cpu_seconds, spend, spent
from sparsepop_py.errors import ProblemError, SparsePOPError
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import Range, RationalProblem
from sparsepop_py.problem.rounding import note as rounding_note
from sparsepop_py.rational.denominators import limits_of, prove_ranges, sharpened
from sparsepop_py.rational.descent import descended, sampled
from sparsepop_py.rational.result import RationalResult, attained_value
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.certificate.rational_bound import RangeProof, RationalCertificate

__all__ = ["solve_rational"]

Solve = Callable[..., Result]
_LEAST = 1e-3  # of a limit, for a polynomial problem that is solved after its end
_PROBLEM_WORK = 0.03  # of a polynomial problem, beside what its solvers count
_LEVELS = 8  # Newton's method doubles the digits with each
_STILL = 1e-9  # relative change of the level that ends it
_DESCENT, _DESCENT_WORK = 0.1, 5.0  # of what is left for a first descent; without a limit


def solve_rational(
    problem: RationalProblem,
    options: Options,
    start: NDArray[np.float64] | None,
    solve: Solve,
) -> RationalResult:
    """Solve a problem with ratios.

    Parameters
    ----------
    problem : RationalProblem
    options : Options
        Limits hold for all polynomial problems together.
    start : (n,) float or None
    solve : callable
        Solves a polynomial problem: problem, options, and start by name.

    Returns
    -------
    RationalResult

    Raises
    ------
    DenominatorError
        If the sign of a denominator is not proved.
    ProblemError
        If gaps are asked for by width.
    """
    if options.gap_kind == "width":
        raise ProblemError("Options.gap_kind: found 'width', which needs pairs of objectives")
    return _RationalSearch(problem, options, solve).run(start)


class _RationalSearch:
    """One solve: the limits that are left, and the proofs of signs."""

    def __init__(self, problem: RationalProblem, options: Options, solve: Solve) -> None:
        self.problem, self.options, self.solve = problem, options, solve
        self.clocks = [
            (name, clock, np.inf if given is None else clock() + given)
            for name, clock, given in (
                ("time_limit", time.monotonic, options.time_limit),
                ("cpu_limit", cpu_seconds, options.cpu_limit),
                ("work_limit", spent, options.work_limit),
            )
        ]
        self.interrupted = False
        self.proofs: tuple[RangeProof, ...] = ()
        self.ranges: list[Range] = []
        self.known: dict[Any, Any] = {}  # certificates that were checked

    def limited(self, options: Options) -> Options:
        """Reduce the limits to what is left."""
        changed: dict[str, Any] = {}
        for name, clock, end in self.clocks:
            given = getattr(options, name)
            if end < np.inf:
                left = max(_LEAST, end - clock())
                changed[name] = left if given is None else min(left, given)
        return replace(options, **changed)

    @property
    def over(self) -> bool:
        """True if a limit is reached, or the user ended the work."""
        return self.interrupted or any(clock() >= end for _, clock, end in self.clocks)

    def run(self, start: NDArray[np.float64] | None) -> RationalResult:
        problem = self.problem
        self.proofs = prove_ranges(problem, self.options, self.limited_solve)
        self.replay()
        if any(size.least == np.inf for size in self.ranges):
            note = ("no point satisfies the polynomial constraints and bounds",)
            proof = RationalCertificate(problem.fingerprint, np.inf, self.proofs)
            return self.result(proof, None, note)
        return self.searched(self.first_point(start))

    def searched(self, start: NDArray[np.float64] | None) -> RationalResult:
        """Try levels from a point, the reciprocals, and levels from the point that these find."""
        found: list[RationalResult] = []
        if self.problem.has_level and start is not None:
            found.append(self.by_levels(start))
            if found[-1].lower_bound == -np.inf and not self.done(found):
                found.append(self.by_lower_levels(found[-1]))
        if not self.done(found):
            found.append(self.by_reciprocals(found[-1].x if found else start))
        x = found[-1].x
        if self.problem.has_level and start is None and x is not None and not self.done(found):
            found.append(self.by_levels(x))
        return min(found, key=lambda result: result.gap)

    def by_reciprocals(self, start: NDArray[np.float64] | None) -> RationalResult:
        """Solve with reciprocals as variables; with sharper ranges if the gap stays open."""
        if self.options.effort == "auto":
            self.sharpen()
        found = self.bounded(None, start)
        if self.done([found]) or self.options.effort == "auto" or not self.sharpen():
            return found
        return min(found, self.bounded(None, found.x), key=lambda result: result.gap)

    def sharpen(self) -> bool:
        """Improve the ranges of denominators whose reciprocals are variables; False if none is."""
        places = self.problem.lifted_places()
        before = self.proofs
        options = self.limited(self.options)
        solve, ended = self.limited_solve, lambda: self.over
        self.proofs = sharpened(self.problem, before, places, options, solve, ended)
        self.replay()
        return any(new is not old for new, old in zip(self.proofs, before, strict=True))

    def replay(self) -> None:
        """Compute the ranges that the proofs prove."""
        proof = RationalCertificate(self.problem.fingerprint, -np.inf, self.proofs)
        found = proof.proved_ranges(self.problem, self.known)
        if isinstance(found, str):
            raise SparsePOPError(f"a proof of a sign does not repeat: {found}; please report")
        self.ranges = found

    def limited_solve(self, problem: Problem, options: Options) -> Result:
        """Solve a polynomial problem in at most the time that is left."""
        spend(_PROBLEM_WORK)
        found = self.solve(problem, self.limited(options))
        self.interrupted |= found.status is Status.INTERRUPTED
        return found

    def done(self, found: list[RationalResult]) -> bool:
        """Check whether the gap is closed, or time is over after a first result."""
        if any(result.status in (Status.OPTIMAL, Status.INFEASIBLE) for result in found):
            return True
        return bool(found) and self.over

    def first_point(self, start: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        """Find a point to begin with, from a given one or from a sample."""
        if self.options.refine == "none":
            return start
        found = sampled(self.problem, self.options.seed) if start is None else start
        if found is None:
            return None
        deadline = limits_of(self.limited(self.options))
        return descended(self.problem, found, deadline.part(_DESCENT, _DESCENT_WORK))

    def by_levels(self, start: NDArray[np.float64]) -> RationalResult:
        """Find the level of an objective of one ratio; the best of all results."""
        problem = self.problem
        constant = problem.objective.whole.constant_term
        level = float(problem.objective(start)) - constant
        level = level if np.isfinite(level) else 0.0
        best: RationalResult | None = None
        x = start
        for _ in range(_LEVELS):
            found = self.bounded(level, x)
            if best is None or found.gap < best.gap or found.lower_bound == np.inf:
                best = found
            if found.x is None or best.status in (Status.OPTIMAL, Status.INFEASIBLE):
                break
            x = found.x
            after = float(problem.objective(x)) - constant
            still = abs(after - level) <= _STILL * max(1.0, abs(level))
            if still or not np.isfinite(after) or self.over:
                break
            level = after
        assert best is not None
        return best

    def by_lower_levels(self, found: RationalResult) -> RationalResult:
        """Look for a level below one at which the polynomial has no bound.

        So it is where a ratio comes near its infimum far away: the leading terms of p - c q change
        their sign there.
        """
        assert found.certificate.level is not None
        without, step, proved, best = found.certificate.level, 1.0, -np.inf, found
        for _ in range(_LEVELS):
            level = without - step if proved == -np.inf else 0.5 * (proved + without)
            one = self.bounded(level, found.x)
            if one.lower_bound > -np.inf:
                proved = level
                best = max(best, one, key=lambda result: result.lower_bound)
            else:
                without, step = level, 8.0 * step
            if self.over or best.status in (Status.OPTIMAL, Status.INFEASIBLE):
                break
        return best

    def bounded(self, level: float | None, start: NDArray[np.float64] | None) -> RationalResult:
        """Solve the polynomial problem of one level, or that with all reciprocals."""
        problem = self.problem
        polynomial = problem.lifted(self.ranges, level)
        lifted = None if start is None else self.point(start, level, polynomial)
        found = self.solve(polynomial, self.limited(self.options), start=lifted)
        self.interrupted |= found.status is Status.INTERRUPTED
        proof = RationalCertificate(
            problem.fingerprint, -np.inf, self.proofs, level, found.certificate
        )
        bound, _ = proof.recompute(problem, self.known)
        return self.result(replace(proof, bound=bound), found, found.notes)

    def point(
        self, x: NDArray[np.float64], level: float | None, polynomial: Problem
    ) -> NDArray[np.float64] | None:
        """Append reciprocals and the level to a point, None where a denominator is zero."""
        places = self.problem.lifted_places(level)
        with np.errstate(divide="ignore"):
            new = [1.0 / np.float64(self.problem.denominators[k](x)) for k in places]
        point = np.array([*x, *new, *([] if level is None else [level])])
        return (
            np.clip(point, polynomial.lower, polynomial.upper)
            if np.all(np.isfinite(point))
            else None
        )

    def result(
        self, proof: RationalCertificate, found: Result | None, notes: tuple[str, ...]
    ) -> RationalResult:
        """Translate the result of a polynomial problem back."""
        problem, options = self.problem, self.options
        upper, x, attained = np.inf, None, None
        if found is not None:
            attained = found.attained
            x = None if found.x is None else found.x[: problem.dimension]
            if attained is not None:
                upper = attained_value(problem, self.ranges, proof.level, attained.value)
            if found.status is Status.UNBOUNDED and proof.level is None:
                upper = -np.inf
        if proof.bound > upper:
            raise SparsePOPError(
                f"contradiction: a bound of {proof.bound!r} is proved and {upper!r} is attained; "
                "this is a defect of the program, please report the problem"
            )
        status = _status(proof, upper, found, options)
        return RationalResult(
            problem=problem,
            options=options,
            status=status,
            lower_bound=proof.bound,
            upper_bound=upper,
            x=x,
            certificate=proof,
            attained=attained,
            polynomial=found,
            notes=(*rounding_note(problem.rounding), *notes),
        )


def _status(
    proof: RationalCertificate, upper: float, found: Result | None, options: Options
) -> Status:
    if proof.bound == np.inf:
        return Status.INFEASIBLE
    if upper == -np.inf:
        return Status.UNBOUNDED
    allowed = options.gap * (max(1.0, abs(upper)) if options.gap_kind == "relative" else 1.0)
    both = np.isfinite(upper) and np.isfinite(proof.bound)
    if both and proof.bound >= upper - allowed:
        return Status.OPTIMAL
    ended = (Status.LIMIT, Status.FAILED, Status.INTERRUPTED)
    if found is not None and found.status in ended:
        return found.status
    return Status.BOUNDED if proof.bound > -np.inf else Status.UNPROVED
