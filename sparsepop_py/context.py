"""What every stage of a solve needs: the problem, the options, the clock, the best point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import Deadline
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import Stages
from sparsepop_py.verified.certificate.steps import Replay
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["SolveContext"]


@dataclass(frozen=True, eq=False)
class SolveContext:
    """One objective: what is asked, how, and the best attained point so far.

    Parameters
    ----------
    problem : Problem
    options : Options
    stages : Stages
    clock : Clock
    best : ProvedPoint or None
    unit : float or None
        What the gap is relative to; None: as ``options.gap_kind`` says.
    repair : callable or None
        Given a candidate vector (n,), a better one to start a local search from.
    objectives : int
        How many objectives share its feasible set.
    below : bool
        Whether the cut-off lies a little below the attained value, see :meth:`replay`.
    aim : float or None
        A bound at which solvers may end; None: one that closes the gap.
    """

    problem: Problem
    options: Options
    stages: Stages
    deadline: Deadline
    best: ProvedPoint | None = None
    unit: float | None = None
    repair: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None
    objectives: int = 1
    below: bool = False
    aim: float | None = None

    @property
    def upper(self) -> float:
        """The attained value, +inf without one."""
        return self.best.value if self.best is not None else np.inf

    @property
    def allowed(self) -> float:
        """The gap that counts as closed, in units of the objective."""
        if self.unit is not None:
            return self.options.gap * self.unit
        relative = self.options.gap_kind == "relative" and self.best is not None
        return self.options.gap * (max(1.0, abs(self.upper)) if relative else 1.0)

    @property
    def target(self) -> float:
        """A bound that closes the gap, +inf without an attained point."""
        return self.upper - self.allowed

    @property
    def goal(self) -> float | None:
        """A bound at which solvers may end: one that closes the gap with something to spare."""
        if self.aim is not None:
            return self.aim
        if self.best is None or self.options.effort != "auto":
            return None
        return self.target + 0.2 * self.allowed

    def closed(self, bound: float) -> bool:
        """Whether a proved bound closes the gap, or says that nothing is feasible."""
        return bound == np.inf or (self.best is not None and bound >= self.target)

    def enough(self, bound: float) -> float:
        """What shorter multipliers have to prove: that the gap is closed, or nearly the same.

        Points that are found later may make the allowed gap smaller, but not than this.
        """
        if bound == np.inf or self.best is None:
            return bound
        if self.closed(bound):
            return self.target
        return bound - 0.01 * self.options.gap * (1.0 if self.unit is None else self.unit)

    @property
    def cutoff(self) -> float:
        """The cut-off under which boxes shrink, +inf without one."""
        cutoff = self.replay().cutoff
        return np.inf if cutoff is None else cutoff

    def replay(self, *, below: bool | None = None) -> Replay:
        """The problem with the cut-off at the attained value.

        Where ``below`` (of the task, if not given), the cut-off lies a little below it, by most
        of the allowed gap, so that parts of the box can become empty; a bound can then not
        exceed that level.
        """
        idle = self.best is None or "cutoff" in self.options.skip
        cutoff = None if idle else self.upper
        if (self.below if below is None else below) and cutoff is not None:
            # falls with the attained value, whatever the gap, so that boxes found before hold
            cutoff -= 0.9 * min(self.allowed, max(1.0, abs(cutoff)))
        return Replay(self.problem, cutoff)
