"""Bound many objectives over one feasible set; results of one help the others (``solve_each``).

The shared box is made once by arguments that hold for all objectives: propagation, and linear
programs for the branching variables (where a star relaxation exists, only once it has failed,
and not for long records). The objectives take turns of a few steps each, until every gap is
closed or nothing is left to try. A proved bound of a single variable tightens the shared box
(its certificate is quoted, not repeated), and later relaxations are built on it. An attained
point is tried on all objectives. Cutoffs stay with their objective.
"""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.order_bound import Model, lower_bound
from sparsepop_py.budget import EARLY, Deadline
from sparsepop_py.context import SolveContext
from sparsepop_py.errors import doubles
from sparsepop_py.executors.dispatch import workers_of
from sparsepop_py.local_search.incumbents import adopt_points, random_starts
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.hierarchy import CostModel
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.relaxation_queue import TIGHTENING
from sparsepop_py.strategy.search_state import SearchState, state_of
from sparsepop_py.strategy.settings import STRATEGY
from sparsepop_py.strategy.shared_box import tighten_for_all
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.strategy.turns import AnyTurn, FirstSearch, Turn, TurnsApart
from sparsepop_py.strategy.working_set import WorkingSetSearch, suits, takes_long
from sparsepop_py.tightening.mccormick import coordinate_of
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Replay, Step, shrunk, tighten
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["MultiObjectiveSearch", "first_starts", "pairs", "width_between"]


@dataclass(eq=False)
class MultiObjectiveSearch:
    """Adaptive searches for several objectives over one feasible set.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    options : Options
    model : Model
        Box and proof without cutoffs, finite in every variable.
    starts : list of (n,) float
        Vectors to start local searches from.
    stages : Stages
    deadline : Deadline
    repair : callable, optional
        Improves candidate vectors before local searches.
    searches : list of AdaptiveSearch
        One for each objective.
    working_sets : list of WorkingSetSearch
        One for each objective where working sets serve; empty otherwise.
    points : list of ProvedPoint
        Known feasible points; with any, no local search runs before the first turn.
    quoted : dict
        Certificates that tighten the shared box, by variable and side (1 or -1).
    known : dict
        What verification of certificates found, for those that quote them.
    numbers : sequence of int, optional
        Of the objectives, for progress; in their order from 0 when left out.
    base : Model
        The shared box before bounds of variables were quoted.
    pairs : dict
        For each objective p the number of -p, where that is one of them.
    shared_state : SharedState
        Structure of the problem, and what was learned on it.
    obbt_done : bool
        Whether linear programs have tightened the shared box.
    unsearched : set of int
        Numbers of the objectives whose first local searches are still to come.
    repaired : callable or None
        The repair, done once for each vector.
    """

    problem: Problem
    objectives: Sequence[Polynomial]
    options: Options
    model: Model
    starts: list[NDArray[np.float64]]
    stages: Stages
    deadline: Deadline
    repair: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    searches: list[AdaptiveSearch] = field(default_factory=list)
    working_sets: list[WorkingSetSearch] = field(default_factory=list)
    points: list[ProvedPoint] = field(default_factory=list)
    quoted: dict[tuple[int, int], Certificate] = field(default_factory=dict)
    known: dict[Any, Any] = field(default_factory=dict)
    numbers: Sequence[int] | None = None
    base: Model = field(init=False)
    pairs: dict[int, int] = field(init=False)
    shared_state: SharedState = field(init=False)
    obbt_done: bool = False
    unsearched: set[int] = field(default_factory=set)
    repaired: _RepairOnce | None = None

    def run(self) -> list[SearchState]:
        """Search until every gap is closed, nothing is left to try or time is over.

        Returns
        -------
        list of SearchState
            One for each objective.
        """
        self._begin()
        try:
            self._plan_first_searches()
            if self._parallel:
                self._turns_apart()
            if not self.over:
                self._first_searches()  # those that an executor which failed has left
            turn = 1  # every objective takes its cheapest step before costlier ones are tried
            while not self.over:
                for index in range(len(self.searches)):
                    self._run(index, turn)
                if self._stuck:
                    break
                turn = STRATEGY.turn_steps
        except EARLY as cause:
            self.deadline.ended(cause)
        states = [state_of(search) for search in self.searches]
        for state in states:
            state.context.report_last(lower_bound(state.outcome.certificate))
        return states

    @property
    def _stuck(self) -> bool:
        return all(search.over or search.exhausted for search in self.searches)

    @property
    def closed(self) -> bool:
        """True if all gaps are closed."""
        return all(search.context.closed(search.bound) for search in self.searches)

    @property
    def over(self) -> bool:
        """True if all gaps are closed or time is over."""
        return self.deadline.over or all(search.over for search in self.searches)

    def _begin(self) -> None:
        """Prepare the shared state and one adaptive search for each objective."""
        self.pairs, self.base = pairs(self.objectives), self.model
        self.shared_state = SharedState.of(self.problem, self.objectives, self.options)
        # a star may not need it, and is nearly as cheap
        if not self.shared_state.products.has_star:
            try:
                self._tighten()
            except EARLY as cause:
                self.deadline.ended(cause)  # the box is kept as it was
        self.repaired = None if self.repair is None else _RepairOnce(self.repair)
        for number, objective in enumerate(self.objectives):
            context = SolveContext(
                self.problem.with_objective(objective),
                self.options,
                self.stages.of_objective(number if self.numbers is None else self.numbers[number]),
                self.deadline,
                repair=self.repaired,
                objectives=len(self.objectives),
            )
            self.searches.append(AdaptiveSearch(context, self.model, [], self.shared_state))
        if self.searches and suits(self.searches[0]):
            costs, long = CostModel(), takes_long(self.searches[0])
            self.working_sets = [WorkingSetSearch(search, costs, long) for search in self.searches]

    def _plan_first_searches(self) -> None:
        """Choose the objectives that are searched for a point first, and from where."""
        if self.working_sets and self.points:  # these are chosen at minimisers
            self.starts = [self.points[0].x]
        elif self.points:
            self.starts = []
        several = self.shared_state.products.has_star  # then a local search costs little
        self.unsearched = set(range(len(self.searches) if several else 1) if self.starts else ())
        if not (several and self._parallel):
            self._first_searches()
        self._share_points(self.points)

    def _first_searches(self) -> None:
        """Run the first local searches that are left, in this process."""
        for index in sorted(self.unsearched):
            self.unsearched.discard(index)
            self._first_search(index).take()
            self._share_point(index)

    def _first_search(self, index: int) -> FirstSearch:
        working_set = self.working_sets[index] if self.working_sets else None
        every = not self.shared_state.products.has_star
        return FirstSearch(self.searches[index], working_set, self.starts, self.points, every)

    def _tighten(self) -> None:
        """Tighten the shared box by linear programs, once."""
        if self.obbt_done or self.deadline.over or not self.shared_state.obbt_lp:
            return
        self.obbt_done, start = True, self.deadline.now()
        with self.stages.stage("presolve"):
            self.model, self.shared_state.active = tighten_for_all(
                self.problem, self.objectives, self.model, self.options, self.deadline
            )
        self.base = self.model
        self.shared_state.cost_model.learn(TIGHTENING, 0.0, self.deadline.now() - start)

    def _run(self, index: int, most: int) -> None:
        """Give one objective a turn of a few steps on the current shared box.

        Costs and progress learned in the first turns guide the turns after them.
        """
        if self.searches[index].over or self.deadline.over:
            return
        self._turn(index, most).take()
        self._share(index)

    def _turn(self, index: int, most: int, returns: bool = False) -> Turn:
        working_set = self.working_sets[index] if self.working_sets else None
        return Turn(self.searches[index], working_set, self.model, most, returns)

    def _share(self, index: int) -> None:
        """Let all objectives have what one has found and proved."""
        search = self.searches[index]
        self._share_point(index)
        self._quote(index)
        # a gap that one step has nearly closed may be closed by what others prove
        nearly = search.gap_ratio <= STRATEGY.small_gap_ratio and len(search.history) == 1
        if not (search.over or nearly):
            self._tighten()
        search.context.report(search.bound)

    # ---- in other processes -------------------------------------------------------------------

    @property
    def _parallel(self) -> bool:
        """True if turns of several objectives go to workers; counted work has to be repeatable."""
        several = len(self.searches) > 1 and workers_of(self.options.executor) > 1
        return several and not self.deadline.counts_work

    def _turns_apart(self) -> None:
        """Run turns on the executor until no objective can go on or the executor fails."""
        assert self.options.executor is not None
        costs = {id(each.costs): each.costs for each in self.working_sets}
        costs |= {id(self.shared_state.cost_model): self.shared_state.cost_model}
        apart = TurnsApart(
            self.options.executor, self.shared_state, tuple(costs.values()), self.deadline
        )
        problems = (search.context.problem for search in self.searches)
        apart.references.keep(
            self.problem, *problems, self.options, self.repaired, *self.base.proof.steps
        )
        taken = [0] * len(self.searches)  # turns of each objective
        last: dict[int, tuple[Any, ...]] = {}  # box and incumbent of its last turn
        try:
            while not self.over and not apart.failure:
                ready = [i for i in range(len(taken)) if self._goes_on(i, apart, last)]
                ready.sort(key=lambda i: self._rank(i, taken[i]))
                here = next((i for i in ready if taken[i] and self._is_divided(i)), None)
                if here is not None:
                    ready.remove(here)
                free = workers_of(self.options.executor) - len(apart.running)
                # a first turn waits for a worker, so that none waits for what is verified here
                ahead = sum(not taken[index] for index in ready[max(free, 0) : free + 1])
                for index in ready[: max(free, 0) + ahead]:
                    if index not in self.unsearched:
                        last[index] = self.model, self.searches[index].context.best
                        taken[index] += 1
                    apart.begin(index, self._next_turn(index, taken[index]))
                if here is not None:
                    last[here] = self.model, self.searches[here].context.best
                    self._run(here, 1)
                elif not apart.running:
                    break
                for index, turn in apart.finished(here is None):
                    self._returned(index, turn, apart)
        finally:  # what an early end finds done is kept
            for index, turn in apart.close():
                self._take_back(index, turn)
        if apart.failure:
            text = f"the executor failed ({apart.failure}): objectives are bounded in this process"
            self.searches[0].context.stages.note(text, logging.WARNING)

    def _is_divided(self, index: int) -> bool:
        """Check that a tree is grown here, and workers have its nodes and their relaxations.

        Where few objectives are left, workers would soon have nothing else to do.
        """
        others = sum(not search.over for search in self.searches) - 1
        few = others <= workers_of(self.options.executor)
        return few and not self.working_sets and self.searches[index].branches

    def _goes_on(self, index: int, apart: TurnsApart, last: dict[int, tuple[Any, ...]]) -> bool:
        """Check that an objective has something left to try, and no turn under way."""
        search, other = self.searches[index], self.pairs.get(index, index)
        if search.over or index in apart.objectives:
            return False
        if index in self.unsearched:
            return True
        if other in self.unsearched and not self.searches[other].over:
            return False  # the width between both is not known yet
        return not search.exhausted or last.get(index) != (self.model, search.context.best)

    def _next_turn(self, index: int, number: int) -> AnyTurn:
        """Choose what an objective does next: local searches, or a turn."""
        if index in self.unsearched:
            return self._first_search(index)
        steps = 1 if number == 1 else STRATEGY.turn_steps
        return self._turn(index, steps, returns=not self.working_sets)

    def _rank(self, index: int, taken: int) -> tuple[float, ...]:
        """Return what objectives are sorted by: searches, first turns, then the largest gaps."""
        gap = -self.searches[index].gap_ratio if taken else 0.0
        return (index not in self.unsearched, taken, gap)

    def _returned(self, index: int, turn: AnyTurn, apart: TurnsApart) -> None:
        """Take the search of an objective back and let the others have what it found."""
        self._take_back(index, turn)
        if isinstance(turn, FirstSearch):
            self.unsearched.discard(index)
            self._share_point(index)
            return
        self._share(index)
        apart.references.keep(*self.model.proof.steps, *self.quoted.values())

    def _take_back(self, index: int, turn: AnyTurn) -> None:
        """Take the search of an objective back from another process."""
        turn.search.context = adopt_points(turn.search.context, self.points)
        self.searches[index] = turn.search
        if turn.working_set is not None:
            self.working_sets[index] = turn.working_set

    def _share_point(self, index: int) -> None:
        """Try the incumbent of an objective on all others."""
        best, known = self.searches[index].context.best, len(self.points)
        if best is not None and all(best is not point for point in self.points):
            self.points.append(best)
        self._share_points(self.points[known:])

    def _share_points(self, points: list[ProvedPoint]) -> None:
        """Try points on all objectives, then update the units of their gaps."""
        for search in self.searches:
            search.context = adopt_points(search.context, points)
        for index, search in enumerate(self.searches):
            search.context = replace(search.context, unit=self._unit(index))

    def _unit(self, index: int) -> float | None:
        """Compute the distance of the attained values of a pair, None unless gaps are widths."""
        if self.options.gap_kind != "width":
            return None
        other = self.searches[self.pairs[index]].context.upper
        width = width_between(self.searches[index].context.upper, other, self.options)
        if np.isfinite(width):
            return width
        reach = range_over(self.searches[index].context.problem.objective_row, self.model.box)
        return float(reach.hi[0] - reach.lo[0])  # for a start; the attained width is smaller

    def _quote(self, index: int) -> None:
        """Tighten the shared box by a proved bound of a single variable."""
        search, target = self.searches[index], coordinate_of(self.objectives[index])
        certificate = search.outcome.certificate
        if "quote" in self.options.skip:
            return
        if target is None or certificate is None or not np.isfinite(certificate.bound):
            return
        variable, side = target
        box = self.model.box
        gained = certificate.bound - (box.lo[variable] if side > 0 else -box.hi[variable])
        if gained <= 1e-4 * (box.hi[variable] - box.lo[variable]):
            return
        with self.stages.stage("verify"):
            certificate = certificate.settled(search.context.problem, self.known)
            search.outcome = replace(search.outcome, certificate=certificate)
        if certificate is None:
            return
        with self.stages.stage("presolve"):
            self.quoted[variable, side] = certificate
            bounds = tuple((v, s, proof) for (v, s), proof in self.quoted.items())
            variables, sides = np.array(list(self.quoted), np.int64).T
            values = np.array([proof.bound for _, _, proof in bounds])
            known = Known(bounds)
            # their certificates are verified: no need to replay
            box = shrunk(self.base.box, variables, sides, values)
            replay = Replay(self.problem, None)
            if is_empty(box):
                return
            steps: list[Step] = [*self.base.proof.steps, known]
            again, step = tighten(replay, box, 1)
            if shrinks(box, again):
                box = again
                steps.append(step)
            self.model = replace(self.model, proof=BoxProof(tuple(steps)), box=box)


class _RepairOnce:
    """Repairs each vector once: all objectives search from the same starts.

    In another process vectors stay as they are where the repair does not pickle.
    """

    def __init__(self, repair: Callable[[NDArray[Any]], NDArray[Any]] | None) -> None:
        self._repair = repair
        self._known: dict[bytes, NDArray[Any]] = {}

    def __call__(self, x: NDArray[Any]) -> NDArray[Any]:
        """Repair a vector."""
        key = np.asarray(x, float).tobytes()
        if key not in self._known:
            self._known[key] = x if self._repair is None else doubles(self._repair(x), "repair")
        return self._known[key].copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process without what is known."""
        try:
            pickle.dumps(self._repair)
        except (pickle.PicklingError, AttributeError, TypeError):
            return _RepairOnce, (None,)
        return _RepairOnce, (self._repair,)


def pairs(objectives: Sequence[Polynomial]) -> dict[int, int]:
    """Map the number of each objective p to the number of the objective -p."""
    found: dict[int, int] = {}
    for i, p in enumerate(objectives):
        for j, q in enumerate(objectives):
            if (p + q).terms == 0:
                found[i] = j
                break
    return found


def width_between(upper: float, other: float, options: Options) -> float:
    """Compute the distance of the attained values of p and -p.

    +inf where one of them is missing; a single point counts as wide as rounding.
    """
    gap = STRATEGY.rounding_gap
    rounding = gap * max(1.0, abs(other)) / max(options.gap, gap)
    return max(-other - upper, rounding) if np.isfinite(other + upper) else np.inf


def first_starts(problem: Problem, box: Interval, options: Options) -> list[NDArray[Any]]:
    """Choose starts of local searches: random, or the middle of the box with a star."""
    if Products.of(problem).has_star:
        return [box.middle()]
    return random_starts(problem, box, options)
