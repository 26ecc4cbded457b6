"""Certificates: a claim about one problem and the argument for it.

``verify`` replays the whole chain from the exact doubles of the problem: the attained
point behind the cut-off, the steps that made the box, and the identity on that box. It
needs no solver and trusts no stored number but as a multiplier, a candidate or a claim.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..enclosure import range_over
from ..feasibility import ProvedPoint
from ..presolve.propagation import is_empty
from ..problem import Problem
from ..rounding import Interval, require_ieee
from ..system import PolynomialSystem
from .box import BoxProof
from .identity import Evaluated, Identity

__all__ = ["Certificate", "Verdict", "certify"]


class Verdict(NamedTuple):
    """What a verification found: whether the claim holds, the recomputed bound, and why not."""

    ok: bool
    bound: float
    reason: str


@dataclass(frozen=True, eq=False)
class Certificate:
    """A proved lower bound of the objective, or a proof that no point is feasible.

    Parameters
    ----------
    fingerprint : str
        Of the problem that the claim is about.
    bound : float
        The claim; +inf says that no point is feasible.
    box : BoxProof
    cutoff : ProvedPoint or None
        The attained point whose value cuts the box off.
    identity : Identity or None
        Multipliers of the objective (or of the constant 0 in a proof of emptiness).
    correction : float
        What the identity's remainder cost, in units of the objective.
    assumptions : tuple of str
        What the conclusion is conditional on; empty for problems given as numbers.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> certificate = sp.solve(problem).certificate
    >>> certificate.verify(problem).ok
    True
    """

    fingerprint: str
    bound: float
    box: BoxProof
    cutoff: ProvedPoint | None = None
    identity: Identity | None = None
    correction: float = 0.0
    assumptions: tuple[str, ...] = ()

    def verify(self, problem: Problem) -> Verdict:
        """Recompute the bound from the problem's exact doubles, without any solver.

        Returns
        -------
        Verdict
            ``ok`` is true exactly when the problem is the one that was certified and the
            recomputed bound is at least the claimed one.
        """
        if problem.fingerprint != self.fingerprint:
            return Verdict(False, -np.inf, "the certificate belongs to another problem")
        recomputed, _, reason = self.recompute(problem)
        if recomputed >= self.bound:
            return Verdict(True, recomputed, "")
        reason = reason or "the argument proves less than what is claimed"
        return Verdict(False, recomputed, reason)

    def recompute(self, problem: Problem) -> tuple[float, float, str]:
        """The bound that the argument proves, its correction, and a reason when it is -inf."""
        require_ieee()
        cutoff = None
        if self.cutoff is not None:
            point = self.cutoff.recheck(problem)
            if point is None:
                return -np.inf, np.inf, "the attained point behind the cut-off is not feasible"
            cutoff = point.value
        box = self.box.replay(problem, cutoff)
        if is_empty(box):
            if self.box.uses_cutoff:
                return -np.inf, np.inf, "the box is empty after a cut-off, which proves nothing"
            return np.inf, 0.0, ""
        bound, reason = _without_multipliers(problem, box), ""
        correction = 0.0
        if self.identity is not None:
            evaluated = self._evaluate(problem, box)
            if self.bound == np.inf and evaluated.bound > 0 and not self.box.uses_cutoff:
                return np.inf, evaluated.correction, ""
            reason = evaluated.reason
            if self.bound < np.inf and evaluated.bound >= bound:
                bound, correction = evaluated.bound, evaluated.correction
        return bound, correction, reason

    def _evaluate(self, problem: Problem, box: Interval) -> Evaluated:
        assert self.identity is not None
        if not self.identity.scaling.contains(box):
            return Evaluated(-np.inf, np.inf, 0.0, "the box is larger than the multipliers assume")
        objective = problem.objective_row
        if self.bound == np.inf:
            objective = PolynomialSystem.stack([problem.objective * 0.0], problem.dimension)
        return self.identity.evaluate(problem.rows, problem.equality, objective)

    @property
    def numbers(self) -> int:
        """How many multipliers are stored."""
        return sum(m.numbers for m in self.identity.multipliers) if self.identity else 0

    def __str__(self) -> str:
        claim = "no feasible point" if self.bound == np.inf else f"objective >= {self.bound:.12g}"
        parts = [claim, f"{len(self.box.steps)} box steps", f"{self.numbers} multipliers"]
        if self.cutoff is not None:
            parts.append(f"cut-off at an attained {self.cutoff.value:.12g}")
        return "certificate: " + ", ".join(parts)


def _without_multipliers(problem: Problem, box: Interval) -> float:
    """What the box alone proves: the range of the objective, or the constant of its squares."""
    bound = float(range_over(problem.objective_row, box).lo[0])
    constant = problem.squares_constant
    bound = bound if np.isfinite(bound) else -np.inf
    return bound if constant is None else max(bound, constant)


def certify(
    problem: Problem,
    box: BoxProof,
    cutoff: ProvedPoint | None,
    identity: Identity | None,
    *,
    empty: bool = False,
) -> Certificate | None:
    """The certificate of what an argument proves, None where it proves nothing.

    The claim is recomputed by the very code that verifies it later.
    """
    kept = cutoff if box.uses_cutoff else None
    claim = np.inf if empty else 0.0
    draft = Certificate(problem.fingerprint, claim, box, kept, identity)
    bound, correction, _ = draft.recompute(problem)
    if bound == -np.inf or (empty and bound != np.inf):
        return None
    if correction and bound < np.inf:
        # another machine may add in another order: leave it a hundredth of what rounding cost
        bound -= 0.01 * correction + 1e-15 * abs(bound)
    return Certificate(problem.fingerprint, bound, box, kept, identity, correction)
