"""Signs of denominators: by interval arithmetic, else by a polynomial problem of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.budget import Deadline
from sparsepop_py.errors import DenominatorError
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import find_box
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.result import Result, Status
from sparsepop_py.verified.arithmetic.display import rounded
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.certificate import Certificate, Node, certify, prove
from sparsepop_py.verified.certificate.rational_bound import RangeProof
from sparsepop_py.verified.certificate.steps import BoxProof, Replay

__all__ = ["limits_of", "prove_ranges", "sharpened"]

Solve = Callable[[Problem, Options], Result]
_MOST, _HALF = 20.0, 0.5  # seconds, or work, for one denominator; of the limit, if that is less
_QUICK = 1.0  # seconds, or work, for a proof over all of space
_FAR, _DIRECTIONS = 1e4, 64  # where polynomials with a minimum are positive
_SHARP, _SHARE = 2.0, 0.2  # seconds, or work, to sharpen a range; of the limit, for all


def limits_of(options: Options) -> Deadline:
    """Return a deadline after the limits of a solve, counted from now."""
    return Deadline(options.time_limit, options.work_limit, options.cpu_limit)


def prove_ranges(
    problem: RationalProblem, options: Options, solve: Solve
) -> tuple[RangeProof, ...]:
    """Prove the sign of each denominator on the base.

    Parameters
    ----------
    problem : RationalProblem
    options : Options
    solve : callable
        Solves a polynomial problem.

    Returns
    -------
    tuple of RangeProof

    Raises
    ------
    DenominatorError
        Naming the denominator and what is proved of it.
    """
    base = problem.base
    proof, box = find_box(base, None, options)
    found = []
    for q in problem.denominators:
        sides = {sign: _by_intervals(base, q * float(sign), proof, box) for sign in (1, -1)}
        sign = next((s for s, c in sides.items() if c is not None and c.bound > 0), None)
        if sign is None:
            sign, sides[sign] = _by_relaxations(base, q, options, solve)
        below = sides[sign]
        assert below is not None
        found.append(RangeProof(sign, below, sides[-sign]))
    return tuple(found)


def sharpened(
    problem: RationalProblem,
    proofs: tuple[RangeProof, ...],
    places: tuple[int, ...],
    options: Options,
    solve: Solve,
    ended: Callable[[], bool] = bool,
) -> tuple[RangeProof, ...]:
    """Bound denominators away from zero as far as relaxations and branching prove.

    Where a reciprocal is large the objective often has its minimum, and a bound of the
    reciprocal that is not sharp leaves a gap.

    Parameters
    ----------
    problem : RationalProblem
    proofs : tuple of RangeProof
    places : tuple of int
        Denominators to be treated.
    options : Options
    solve : callable
    ended : callable
        True when the whole solve has ended.

    Returns
    -------
    tuple of RangeProof
        As given where the solve had ended, or the share of its limits was used up.
    """
    if not places or options.effort == "plain":
        return proofs
    share = _SHARE / len(places)
    attempt = replace(_for_denominators(options, _SHARP, share), effort="auto", gap=1e-7)
    whole = limits_of(options).part(_SHARE)
    found = list(proofs)
    for place in places:
        if ended() or whole.over:
            break
        proof, q = proofs[place], problem.denominators[place]
        below = _better(problem.base, q * float(proof.sign), attempt, solve)
        if below is not None and below.bound > proof.below.bound:
            found[place] = replace(proof, below=below)
    return tuple(found)


def _better(
    base: Problem, objective: Polynomial, attempt: Options, solve: Solve
) -> Certificate | None:
    """Bound a polynomial over all of space if possible, else over the base."""
    found = _everywhere(base, objective, attempt, solve)
    return solve(base.with_objective(objective), attempt).certificate if found is None else found


def _everywhere(
    base: Problem, objective: Polynomial, attempt: Options, solve: Solve
) -> Certificate | None:
    """Prove the minimum over all of space by an exact sum of squares.

    Such a proof is sharp and needs no box. It is not tried if the polynomial is negative far out.
    """
    generator = np.random.default_rng(attempt.seed)
    far = _FAR * generator.standard_normal((_DIRECTIONS, objective.dimension))
    if objective.degree % 2 or not np.all(objective(far) > 0):
        return None
    quick = replace(attempt, effort="presolve", **_brief(attempt, _QUICK))
    result = solve(Problem(objective), quick)
    if result.status is not Status.OPTIMAL or result.certificate is None:
        return None
    moved = replace(result.certificate, fingerprint=base.with_objective(objective).fingerprint)
    return moved if moved.verify(base.with_objective(objective)).ok else None


def _brief(options: Options, most: float, share: float = 1.0) -> dict[str, Any]:
    """Limit seconds, or work where no limit in time is given: such runs repeat."""
    timed = options.time_limit is not None or options.cpu_limit is not None
    name = "time_limit" if timed else "work_limit"
    given = getattr(options, name)
    return {name: most if given is None else min(most, share * given)}


def _for_denominators(options: Options, most: float, share: float) -> Options:
    """Derive the options for bounds of denominators from those of the whole problem."""
    return replace(
        options,
        gap=1e-6,
        gap_kind="relative",
        branch_on=None,
        order=None,
        effort="presolve",
        switches=None,
        **_brief(options, most, share),
    )


def _by_intervals(
    base: Problem, objective: Polynomial, proof: BoxProof, box: Interval
) -> Certificate | None:
    """Bound a polynomial by its range over the box that presolve proves."""
    replay = Replay(base.with_objective(objective), None)
    return certify(replay, Node(proof), prove(replay, box, None, False))


def _by_relaxations(
    base: Problem, q: Polynomial, options: Options, solve: Solve
) -> tuple[int, Certificate]:
    """Bound q from below, or -q where q is attained below zero."""
    first = _for_denominators(options, _MOST, _HALF)
    efforts = [first, replace(first, effort="auto")]
    for sign in (1, -1):
        proof = _everywhere(base, q * float(sign), first, solve)
        if proof is not None and proof.bound > 0:
            return sign, proof
    low, high = -np.inf, np.inf  # what is proved of q
    seen: list[str] = []
    for attempt in efforts:
        result = solve(base.with_objective(q), attempt)
        low = max(low, result.lower_bound)
        if low > 0 and result.certificate is not None:
            return 1, result.certificate
        if result.upper_bound <= 0:
            negative = solve(base.with_objective(-q), attempt)
            high = min(high, -negative.lower_bound)
            if high < 0 and negative.certificate is not None:
                return -1, negative.certificate
            if negative.upper_bound <= 0:
                seen = [_attained(result), _attained(negative)]
                break
    raise DenominatorError(
        f"denominator {q}: its sign is not proved where the polynomial constraints and bounds "
        f"hold, only {rounded(low, False, 12)} <= q <= {rounded(high, True, 12)}"
        + (f"; it is not positive at {seen[0]} and not negative at {seen[1]}" if seen else "")
        + "; expected bounds or constraints that keep it away from zero"
        + (", or a larger limit" if not seen and _limited(options) else "")
    )


def _limited(options: Options) -> bool:
    """Check whether larger limits would leave more for the sign of a denominator."""
    given = (options.time_limit, options.cpu_limit, options.work_limit)
    return any(limit is not None and _HALF * limit < _MOST for limit in given)


def _attained(result: Result) -> str:
    if result.x is None:
        return "some point"
    more = ", ..." if result.x.size > 6 else ""
    return f"x = ({', '.join(f'{v:.6g}' for v in result.x[:6])}{more})"
