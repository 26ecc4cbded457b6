"""Take turns of objectives over one feasible set, here or in other processes.

Turns of different objectives need nothing of each other while they last: what one proves helps
those that begin after it. So as many run at a time as there are workers. A turn takes the
search of its objective to another process and brings it back
(:mod:`~sparsepop_py.executors.references`); what all objectives share stays here.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import CertifiedBound, Model
from sparsepop_py.budget import EARLY, Deadline, LimitReached
from sparsepop_py.executors.references import Packet, References, received
from sparsepop_py.executors.within_limits import Timed, run_timed
from sparsepop_py.local_search.incumbents import adopt_points, update_incumbent
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.hierarchy import CostModel
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.strategy.working_set import WorkingSetSearch
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["FirstSearch", "Turn", "TurnsApart"]

_PATIENCE = 0.2  # of what was left at the beginning: turns may end so much after the deadline


@dataclass(eq=False)
class Turn:
    """A turn of one objective: a few steps on a box. Mutable.

    Parameters
    ----------
    search : AdaptiveSearch
    working_set : WorkingSetSearch or None
        The search on a working set of constraints, where these serve.
    model : Model
        The shared box and its proof.
    most : int
        Steps at most.
    returns : bool
        Whether it ends before a tree, which may be grown elsewhere, unless that is its first step.
    """

    search: AdaptiveSearch
    working_set: WorkingSetSearch | None
    model: Model
    most: int
    returns: bool = False

    def take(self) -> None:
        """Take steps until one leaves more than a share of the gap.

        On working sets a turn goes on where little is left: constraints that a point contradicts
        have joined, and the next relaxation may close the gap.
        """
        search = self.search
        search.restart(self.model)
        for number in range(self.most):
            if number and self.returns and search.branches:
                break
            gap = search.context.upper - search.bound
            if self.working_set is None or not self.working_set.step():
                search.run(1)
            gained = search.context.upper - search.bound < STRATEGY.little_gain_share * gap
            near = self.working_set is not None and search.gap_ratio < STRATEGY.small_gap_ratio
            if search.over or not (gained or near):
                break


@dataclass(eq=False)
class FirstSearch:
    """Local searches for one objective before its first turn. Mutable.

    Parameters
    ----------
    search : AdaptiveSearch
    working_set : WorkingSetSearch or None
        The search on a working set, which goes and comes with that of the whole.
    starts : list of (n,) float
    points : list of ProvedPoint
        Those known at the time are tried, too.
    every : bool
        Whether to go on from every start; else the first that leads to a point is the last, since
        moments of relaxations are better starts than the others.
    """

    search: AdaptiveSearch
    working_set: WorkingSetSearch | None
    starts: list[NDArray[np.float64]]
    points: list[ProvedPoint]
    every: bool = False

    def take(self) -> None:
        """Search from one start after the other."""
        search = self.search
        search.context = adopt_points(search.context, self.points)
        for start in self.starts:
            search.context, found = update_incumbent(search.context, [start])
            search.candidates = [*search.candidates, *found]
            if search.context.best is not None and not self.every:
                break


@dataclass(frozen=True)
class _News:
    """Changes that a turn in another process made to what is shared.

    Parameters
    ----------
    learned : tuple of list
        What each cost model recorded.
    paces : tuple of float
        Their ratios of measured to estimated seconds.
    estimates : dict
        Expected seconds of relaxations.
    seconds : dict
        CPU seconds by stage.
    notes : list of str
    searched : float
        Seconds of local searches.
    cut : bool
        Whether something would have taken too long.
    """

    learned: tuple[list[tuple[str, float, float, bool]], ...]
    paces: tuple[float, ...]
    estimates: dict[str, float]
    seconds: dict[str, float]
    notes: list[str]
    searched: float
    cut: bool


AnyTurn = FirstSearch | Turn


@dataclass(eq=False)
class TurnsApart:
    """Turns in other processes. Mutable.

    Parameters
    ----------
    executor : Executor
    shared_state : SharedState
    costs : tuple of CostModel
        All cost models that turns learn from.
    deadline : Deadline
    references : References
    failure : str
        What the executor failed with; empty where it did not.
    running : dict
        By future, the number of the objective and its turn as it was handed over.
    """

    executor: Executor
    shared_state: SharedState
    costs: tuple[CostModel, ...]
    deadline: Deadline
    references: References = field(default_factory=References)
    failure: str = ""
    running: dict[Future[Timed[bytes]], tuple[int, AnyTurn]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        left = self.deadline.left
        self._end = None if left is None else time.monotonic() + (1.0 + _PATIENCE) * left
        self.references.keep(self.shared_state.products, self.shared_state.cliques)

    @property
    def objectives(self) -> set[int]:
        """Numbers of the objectives whose turns run."""
        return {number for number, _ in self.running.values()}

    def begin(self, number: int, turn: AnyTurn) -> None:
        """Hand a turn of an objective to a worker."""
        search = turn.search
        whole = search.outcome
        search.outcome, search.last = _without_output(whole), None
        try:
            if search.context.best is not None:
                # unless a better one is found, it returns as itself
                self.references.keep(search.context.best)
            packet = self.references.packed(
                (turn, search.context.stages.searched), self._live(search.context.stages)
            )
            self.running[self.executor.submit(run_timed, _in_worker, packet)] = number, turn
        except Exception as error:  # of any executor; this process takes the turns instead
            self._fail(error)
        finally:
            search.outcome = whole

    def finished(self, waits: bool = True) -> Iterator[tuple[int, AnyTurn]]:
        """Wait for turns to end; yield them with the numbers of their objectives.

        Parameters
        ----------
        waits : bool
            Whether to wait until one ends.

        Raises
        ------
        LimitReached
            If the deadline ends the work first.
        """
        left = None if self._end is None else max(0.0, self._end - time.monotonic())
        done, _ = wait(self.running, left if waits else 0.0, FIRST_COMPLETED)
        if waits and not done:
            raise LimitReached
        yield from self._taken(done)

    def close(self) -> Iterator[tuple[int, AnyTurn]]:
        """Cancel the turns that did not begin, and yield those that have ended.

        Others are given up.
        """
        done = [job for job in self.running if not job.cancel() and job.done()]
        yield from self._taken(done)
        self.running.clear()

    def _taken(self, done: Iterable[Future[Timed[bytes]]]) -> Iterator[tuple[int, AnyTurn]]:
        """Take ended turns one by one: an interrupt leaves the others in place."""
        for job in done:
            number, old = self.running.pop(job)
            # executors of other packages raise exceptions that share no base below Exception
            try:
                answer = job.result().counted(self.deadline)
            except Exception as error:
                self._fail(error)
                continue
            yield number, self._returned(old, answer)

    def _live(self, stages: Stages) -> list[Any]:
        return [self.shared_state, self.deadline, stages, *self.costs]

    def _returned(self, old: AnyTurn, answer: bytes) -> AnyTurn:
        """Unpack a turn and take over its news."""
        stages = old.search.context.stages
        turn, news = self.references.unpacked(answer, self._live(stages))
        for costs, learned, pace in zip(self.costs, news.learned, news.paces, strict=True):
            for record in learned:
                costs.learn(*record)
            costs.pace = pace
        self.shared_state.estimates.update(news.estimates)
        stages.include(news.seconds, news.notes, news.searched)
        self.deadline.cut |= news.cut
        found: AnyTurn = turn
        if found.search.outcome.relaxation is None:  # nothing was solved
            before = old.search.outcome
            found.search.outcome = replace(
                found.search.outcome, relaxation=before.relaxation, solution=before.solution
            )
        return found

    def _fail(self, error: Exception) -> None:
        self.failure = f"{type(error).__name__}: {error}".rstrip(": ")


def _without_output(outcome: CertifiedBound) -> CertifiedBound:
    """Leave out what a solver said: no search looks at it again."""
    return replace(outcome, relaxation=None, solution=None)


def _in_worker(packet: Packet) -> bytes:
    """Take a turn in another process, within the limits."""
    there = received(packet)
    turn, searched = there.value
    shared, deadline, stages, *costs = there.live
    stages.searched = searched
    for each in costs:
        each.learned = []
    try:
        with deadline.kept():
            turn.take()
    except EARLY as cause:  # what is proved so far is kept
        if isinstance(cause, LimitReached) and not deadline.over:
            raise  # it is not this limit: turn after turn would end at once
    turn.search.last = None
    news = _News(
        tuple(each.learned or [] for each in costs),
        tuple(each.pace for each in costs),
        shared.estimates,
        stages.seconds,
        stages.notes,
        stages.searched - searched,
        deadline.cut,
    )
    return there.answer((turn, news))
