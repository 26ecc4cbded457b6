"""Context of one solve: problem, options, deadline, incumbent."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

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
    """Context of the search for one objective: problem, options, deadline, incumbent.

    Parameters
    ----------
    problem : Problem
    options : Options
    stages : Stages
    deadline : Deadline
    best : ProvedPoint or None
        The incumbent: the best point whose existence is proved.
    unit : float or None
        Value that the gap is relative to; None: as ``options.gap_kind`` says.
    repair : callable or None
        Given a candidate vector (n,), a better one to start a local search from.
    objectives : int
        Number of objectives that share the feasible set.
    below : bool
        Whether the cutoff lies a little below the attained value, see :meth:`at_cutoff`.
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

    def for_worker(self) -> SolveContext:
        """Return a copy for a task of another process or thread, which reports nothing."""
        options = replace(self.options, executor=None)  # an executor cannot be pickled
        return replace(self, stages=Stages(), options=options, repair=None)

    def report(self, lower: float) -> None:
        """Report a proved lower bound, with the attained value, to whoever watches."""
        self.stages.bounds(lower, self.upper)

    def report_last(self, lower: float) -> None:
        """Report the bounds at the end; an interrupt then comes too late to end anything."""
        try:
            self.report(lower)
        except KeyboardInterrupt as cause:
            self.deadline.ended(cause)

    @property
    def notes(self) -> list[str]:
        """Sentences for the user that stages left on the way."""
        return self.stages.notes

    @property
    def upper(self) -> float:
        """The attained value of the incumbent, +inf without one."""
        return self.best.value if self.best is not None else np.inf

    @property
    def attains(self) -> bool:
        """True if a search may still attain a point."""
        limit = self.options.search_limit
        return self.options.refine != "none" and (limit is None or self.stages.searched < limit)

    @property
    def allowed(self) -> float:
        """The gap that counts as closed, in units of the objective."""
        if self.unit is not None:
            return self.options.gap * self.unit
        relative = self.options.gap_kind == "relative" and self.best is not None
        return self.options.gap * (max(1.0, abs(self.upper)) if relative else 1.0)

    @property
    def target(self) -> float:
        """A bound that closes the gap; +inf without an attained point, never -inf."""
        if self.best is None:
            return np.inf
        return max(self.upper - self.allowed, -sys.float_info.max)

    @property
    def goal(self) -> float | None:
        """A bound at which solvers may end; None: at their own accuracy."""
        if self.aim is not None:
            return self.aim
        if self.best is None or self.options.effort != "auto":
            return None
        return self.target + 0.2 * self.allowed

    def closed(self, bound: float) -> bool:
        """Check whether a proved bound closes the gap, or proves that nothing is feasible."""
        return bound == np.inf or (self.best is not None and bound >= self.target)

    def enough(self, bound: float) -> float:
        """Return a bound that shorter multipliers have to prove.

        It closes the gap, or is nearly the bound given. Points that are found later may make the
        allowed gap smaller, but not than this.
        """
        if bound == np.inf or self.best is None:
            return bound
        if self.closed(bound):
            return self.target
        return bound - 0.01 * self.options.gap * (1.0 if self.unit is None else self.unit)

    @property
    def cutoff(self) -> float:
        """The cutoff with which boxes are tightened, +inf without one."""
        cutoff = self.at_cutoff().cutoff
        return np.inf if cutoff is None else cutoff

    def at_cutoff(self, *, below: bool | None = None) -> Replay:
        """Attach the cutoff to the problem: the attained value, or a little below it.

        A cutoff below the attained value, by most of the allowed gap, lets nodes become empty; a
        bound can then not exceed the cutoff.

        Parameters
        ----------
        below : bool, optional
            Place the cutoff below the attained value; as the context says when left out.

        Returns
        -------
        Replay
        """
        without = self.best is None or "cutoff" in self.options.skip
        cutoff = None if without else self.upper
        if (self.below if below is None else below) and cutoff is not None:
            # a smaller attained value gives a smaller cutoff, whatever the gap: boxes that were
            # found with the larger one stay proved
            cutoff -= 0.9 * min(self.allowed, max(1.0, abs(cutoff)))
        return Replay(self.problem, cutoff)
