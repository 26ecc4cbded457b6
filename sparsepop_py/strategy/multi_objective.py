"""Many objectives over one feasible set: what one proves helps the others.

The box is made once by arguments that hold for all objectives: propagation, and linear programs
for the variables that matter (where a star of few complicating variables may do without, only
once it has failed, and not for long records). Each objective in turn climbs some rungs, until
every gap is closed or nothing is left to try. A proved bound of a single variable shrinks the
shared box (its certificate is quoted, not repeated), and the next rungs are built on it; an
attained point is tried on all objectives. Cut-offs stay with their objective.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.relaxation_bound import Model
from sparsepop_py.context import SolveContext
from sparsepop_py.deadline import Deadline
from sparsepop_py.local_search.incumbents import adopt_points, random_starts, update_incumbent
from sparsepop_py.local_search.slp import violated_rows
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.problem.problem import Problem
from sparsepop_py.progress import Stages
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.sparsity.correlative import find_cliques
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.order_loop import INTERRUPTED, SearchState
from sparsepop_py.strategy.relaxation_queue import TIGHTENING
from sparsepop_py.strategy.shared_state import SharedState, branching
from sparsepop_py.tightening.mccormick import LinearRelaxation, coordinate_of, tightened
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.arithmetic.polynomial_range import range_over
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.steps import BoxProof, Known, Replay, Step, shrunk, tighten
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["MultiObjectiveSearch", "first_starts", "pairs", "tightened_for_all", "width_between"]

_ROUNDS = 4
_NARROW = 24  # variables whose bounds linear programs tighten for all objectives
_WINDOW = 40  # constraints that linear programs start with where windows are enough
_GAINED = 0.8
_TURN = 5  # rungs that an objective climbs before it is the next one's turn
_ROUNDING = 1e-12  # gaps this small, of values near 1, are closed


@dataclass(eq=False)
class MultiObjectiveSearch:
    """Objectives that climb together.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    options : Options
    model : Model
        Box and proof without cut-offs, finite in every variable.
    starts : list of (n,) float
    stages : Stages
    clock : Clock
    told : callable, optional
        Called after each climb of an objective.
    repair : callable, optional
        Improves candidate vectors before local searches.
    points : list of ProvedPoint
        Known feasible points; with any, no local search runs before the first climb.
    known : dict
        What verification of certificates found, for those that quote them.
    """

    problem: Problem
    objectives: Sequence[Polynomial]
    options: Options
    model: Model
    starts: list[NDArray[np.float64]]
    stages: Stages
    deadline: Deadline
    told: Callable[[int, SearchState], None] | None = None
    repair: Callable[[NDArray], NDArray] | None = None
    searches: list[AdaptiveSearch] = field(default_factory=list)
    points: list[ProvedPoint] = field(default_factory=list)
    quoted: dict[tuple[int, int], Certificate] = field(default_factory=dict)
    known: dict[Any, Any] = field(default_factory=dict)
    base: Model = field(init=False)
    pairs: dict[int, int] = field(init=False)
    shared_state: SharedState = field(init=False)
    tightened: bool = False

    def run(self) -> list[SearchState]:
        """Climb until every gap is closed or time is over."""
        self._begin()
        notes: tuple[str, ...] = ()
        try:
            self._first_points()
            turn = 1  # all boxes shrink by what is cheap before anything dear is tried
            while not self.over:
                for index in range(len(self.searches)):
                    self._run(index, turn)
                if self._stuck:
                    break
                turn = _TURN
        except KeyboardInterrupt:
            notes = (INTERRUPTED,)
        states = [self._state(auto, notes) for auto in self.searches]
        for index, state in enumerate(states if self.told is not None else ()):
            if not state.history:  # closed without climbing: nobody was told yet
                self.told(index, state)  # type: ignore[misc]
        return states

    def _state(self, auto: AdaptiveSearch, notes: tuple[str, ...] = ()) -> SearchState:
        return SearchState(auto.context, auto.outcome, auto.near, tuple(auto.history), notes)

    @property
    def _stuck(self) -> bool:
        return all(auto.over or auto.exhausted for auto in self.searches)

    @property
    def over(self) -> bool:
        """Whether all gaps are closed or time is over."""
        return self.deadline.over or all(auto.over for auto in self.searches)

    def _begin(self) -> None:
        """One climber an objective."""
        self.pairs, self.base = pairs(self.objectives), self.model
        self.shared_state = SharedState.of(self.problem, self.objectives, self.options)
        if (
            not self.shared_state.products.has_star
        ):  # a star may not need it, and is nearly as cheap
            try:
                self._tighten()
            except KeyboardInterrupt:
                self.deadline.stop()  # the box is kept as it was
        for objective in self.objectives:
            context = SolveContext(
                self.problem.with_objective(objective),
                self.options,
                Stages(self.options.progress),
                self.deadline,
                repair=self.repair,
                objectives=len(self.objectives),
            )
            self.searches.append(AdaptiveSearch(context, self.model, [], self.shared_state))

    def _first_points(self) -> None:
        """Local searches from the starts; what they find is tried on all objectives."""
        if not self.starts or self.points:
            self._carry(self.points)
            return
        several = self.shared_state.products.has_star  # then a local search costs little
        for auto in self.searches if several else self.searches[:1]:
            auto.context, auto.near = update_incumbent(
                adopt_points(auto.context, self.points), self.starts
            )
            if auto.context.best is not None:
                self.points.append(auto.context.best)
        self._carry(self.points)

    def _tighten(self) -> None:
        """Linear programs tighten the box of all, once."""
        if self.tightened or self.deadline.over or not self.shared_state.narrow:
            return
        self.tightened, start = True, time.process_time()
        with self.stages.stage("presolve"):
            self.model, self.shared_state.active = tightened_for_all(
                self.problem, self.objectives, self.model, self.options, self.deadline
            )
        self.base = self.model
        self.shared_state.cost_model.learn(TIGHTENING, 0.0, time.process_time() - start)

    def _run(self, index: int, most: int) -> None:
        """Let one objective climb some rungs on the shared box as it is now.

        What the first ones learn of the rungs saves the others detours.
        """
        auto = self.searches[index]
        if auto.over or self.deadline.over:
            return
        known = len(self.points)
        auto.restart(self.model)
        auto.run(most)
        if auto.context.best is not None and auto.context.best not in self.points:
            self.points.append(auto.context.best)
        self._carry(self.points[known:])
        self._quote(index)
        if not auto.over:
            self._tighten()
        if self.told is not None:
            self.told(index, self._state(auto))

    def _carry(self, points: list[ProvedPoint]) -> None:
        """Try points on all objectives, and say anew what their gaps are relative to."""
        for auto in self.searches:
            auto.context = adopt_points(auto.context, points)
        for index, auto in enumerate(self.searches):
            auto.context = replace(auto.context, unit=self._unit(index))

    def _unit(self, index: int) -> float | None:
        """The distance of the attained values of a pair of objectives, for width gaps."""
        if self.options.gap_kind != "width":
            return None
        other = self.searches[self.pairs[index]].context.upper
        width = width_between(self.searches[index].context.upper, other, self.options)
        if np.isfinite(width):
            return width
        reach = range_over(self.searches[index].context.problem.objective_row, self.model.box)
        return float(reach.hi[0] - reach.lo[0])  # for a start; the attained width is smaller

    def _quote(self, index: int) -> None:
        """A proved bound of a single variable shrinks the box of all."""
        auto, target = self.searches[index], coordinate_of(self.objectives[index])
        certificate = auto.outcome.certificate
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
            certificate = certificate.settled(auto.context.problem, self.known)
            auto.outcome = replace(auto.outcome, certificate=certificate)
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


def pairs(objectives: Sequence[Polynomial]) -> dict[int, int]:
    """For each objective p the number of the objective -p."""
    found: dict[int, int] = {}
    for i, p in enumerate(objectives):
        for j, q in enumerate(objectives):
            if (p + q).terms == 0:
                found[i] = j
                break
    return found


def width_between(upper: float, other: float, options: Options) -> float:
    """The distance of the attained values of p and -p; a single point counts as rounding wide."""
    rounding = _ROUNDING * max(1.0, abs(other)) / max(options.gap, _ROUNDING)
    return max(-other - upper, rounding) if np.isfinite(other + upper) else np.inf


def tightened_for_all(
    problem: Problem,
    objectives: Sequence[Polynomial],
    model: Model,
    options: Options,
    deadline: Deadline,
) -> tuple[Model, NDArray[np.bool_] | None]:
    """A box that linear programs without cut-off tighten in the variables that matter.

    Returns
    -------
    model : Model
    active : (m,) bool or None
        Constraints that were enough for these linear programs; None: all.
    """
    if is_empty(model.box):
        return model, None
    products = Products.of(problem, objectives)
    targets = [c[0] for p in objectives if (c := coordinate_of(p)) is not None]
    variables = tuple(dict.fromkeys((*branching(products, options), *targets)))
    if not products.pairs.size or not 0 < len(variables) <= _NARROW:
        return model, None
    return _tightened(problem, model, variables, options, products, deadline)


def _tightened(
    problem: Problem,
    model: Model,
    variables: tuple[int, ...],
    options: Options,
    products: Products,
    deadline: Deadline,
) -> tuple[Model, NDArray[np.bool_] | None]:
    """Rounds of bound tightening while they gain.

    Where few variables complicate many constraints, the programs start from a few of these
    (any choice is valid); those that are violated at a solution whatever the other variables
    are come in before the next round.
    """
    replay = Replay(problem, None)
    cliques = find_cliques(problem, sparse=options.sparse, method=options.chordal)
    held = np.array(products.complicating, np.int64)
    active: NDArray[np.bool_] | None = None
    if products.has_star and problem.rows.size > _WINDOW:
        active = np.zeros(problem.rows.size, bool)
        active[np.linspace(0, problem.rows.size - 1, _WINDOW).astype(int)] = True
    steps, box = list(model.proof.steps), model.box
    for _ in range(_ROUNDS if active is None else 2 * _ROUNDS):
        mccormick = LinearRelaxation.of(problem, box, cliques, None, active)
        seen: list[NDArray] = []
        smaller, step, _ = tightened(replay, mccormick, box, variables, deadline.left, seen)
        if step is not None and is_empty(smaller):
            break
        gained = False
        if step is not None:
            steps.append(step)
            chosen = list(variables)
            old, new = (box.hi - box.lo)[chosen], (smaller.hi - smaller.lo)[chosen]
            gained, box = bool(np.any(new < _GAINED * old)), smaller
        if active is not None:
            missing = [violated_rows(problem, x, held) for x in seen]
            wanted = np.unique(np.concatenate([*missing, np.zeros(0, np.int64)]))
            gained |= not np.all(active[wanted])
            active[wanted] = True
        if not gained or deadline.over:
            break
    if steps[len(model.proof.steps) :]:
        again, sweeps = tighten(replay, box, 1)
        if shrinks(box, again):
            box = again
            steps.append(sweeps)
    return replace(model, proof=BoxProof(tuple(steps)), box=box), active


def first_starts(problem: Problem, box: Interval, options: Options) -> list[NDArray]:
    """Random starts, the middle of the box alone where few variables complicate the problem."""
    if Products.of(problem).has_star:
        return [box.middle()]
    return random_starts(problem, box, options)
