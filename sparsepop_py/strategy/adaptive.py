"""Effort "auto" on a finite box: which rung next, until the gap is closed.

Each rung has a share of the gap that it closes as a rule and an expected time; the next
one is that with the largest expected gain per second. Branch and bound is one of them: it
runs in slices, and what the last slice gained per second is what it is expected to gain.
Whatever improves the attained value lowers the cut-off, and with it the box.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.relaxation_bound import (
    Argued,
    Bound,
    Model,
    argue,
    better,
    bound_of,
    level,
)
from sparsepop_py.branch_and_bound.node import Plan
from sparsepop_py.branch_and_bound.tree import Search
from sparsepop_py.context import Task
from sparsepop_py.local_search.incumbents import attained, extracted
from sparsepop_py.lp.highs import LinearSolution
from sparsepop_py.presolve.initial_box import room_of, shrinks
from sparsepop_py.relaxation.hierarchy import Recipe, expected_seconds, hashed, progress
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.result import Rung
from sparsepop_py.strategy.relaxation_queue import (
    NARROW,
    PROGRAM,
    TIGHTENING,
    Agenda,
    worth_in_parts,
)
from sparsepop_py.strategy.shared_state import Ground
from sparsepop_py.tightening.mccormick import Lifted, first_moments
from sparsepop_py.tightening.obbt_lp import narrowed, taken_again
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Node, Proved, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Step, Tightening, tighten

__all__ = ["Auto"]

_BRANCH = "branch"
_NODES = 4.0  # times the effort of the ground: parts that branch and bound is expected to need
_SLICE = 3.0  # most seconds that a tree grows before other rungs are considered again
_PATIENCE = 300  # parts after which linear programs alone are not trusted to close the gap
_SWEEPS = 3  # of propagation after a step that shrank the box
_ROUNDS = 3
_POOR = 0.5  # an attained value that falls by this share of the gap was a poor cut-off
_SMALLER = 0.7  # a box with a width below this share is worth the rungs climbed before


@dataclass(eq=False)
class Auto:
    """One objective on its way up.

    Parameters
    ----------
    task : Task
    model : Model
        The proof of the box and the box, both with the cut-off.
    near : list of (n,) float
        Nearly feasible vectors seen so far.
    ground : Ground
        The structure of the problem and what was learned on it.
    later : iterator of (n,) float
        Starts of local searches for where the first rung leaves a gap.
    cut : float
        The least cut-off under which the box was shrunk.
    """

    task: Task
    model: Model
    near: list[NDArray[np.float64]]
    ground: Ground
    history: list[Rung] = field(default_factory=list)
    outcome: Bound = field(init=False)
    search: Search | None = None
    seen: int = 0
    exhausted: bool = False
    best: Argued = field(init=False)
    rate: float | None = None
    linear: float = -np.inf
    later: Iterator[NDArray[np.float64]] = field(default_factory=lambda: iter(()))
    solved: set[int] = field(default_factory=set)
    last: tuple[Interval, Scaled] | None = None
    cut: float = np.inf

    def __post_init__(self) -> None:
        replay = self.task.replay()
        self.best = Argued(prove(replay, self.model.box, None, False), Node())
        self.outcome = bound_of(replay, self.model, self.best)
        self.agenda = Agenda(self.ground, self._scaled)
        self.first = self.best.proved.bound
        self.shared, self.start = self.model, self.model.box
        self.tried: list[tuple[Recipe, float, float]] = []  # recipe, bound, seconds

    @property
    def bound(self) -> float:
        """What is proved so far."""
        return level(self.outcome.certificate)

    @property
    def over(self) -> bool:
        """Whether the gap is closed or time is over."""
        return self.task.closed(self.bound) or self.task.clock.over

    def run(self, rungs: int | None = None) -> None:
        """Climb (at most so many rungs) while the gap is open and something is left to try."""
        climbed = 0
        try:
            while not self.over and climbed != rungs:
                recipe = self._next()
                self.exhausted = recipe is None
                if recipe is None:
                    break
                self._climb(recipe)
                self._attain(list(self.later))  # exhausted by the first rung
                climbed += 1
        finally:
            self.cut = self.task.level
            if self.search is not None:
                self._close_search()

    def restart(self, model: Model) -> None:
        """Begin again on a smaller box that others have proved, keeping what is proved.

        So it does where the cut-off has risen, with a width that is attained and smaller than
        thought: the box may be without points that count now.
        """
        old = self.shared
        if model is old and self.task.level <= self.cut:
            return
        moved = old.box.hi > old.box.lo
        width = (model.box.hi - model.box.lo)[moved] / (old.box.hi - old.box.lo)[moved]
        own = self.model.proof.steps[len(old.proof.steps) :]
        self.model, self.shared = model, model
        node, replay = self.best.node, self.task.replay()
        if any(isinstance(step, Tightening) for step in own):  # dear: they are kept
            self._take(taken_again(replay, own, model.box), *own)
        # another box than before, which need not be within it
        proved = prove(replay, self.model.box, node.argument, node.empty)
        self.best = replace(self.best, proved=proved)
        if self.search is None and self.tried and width.min(initial=1.0) < _SMALLER:
            # the same rung may do more now
            self.agenda.again(recipe for recipe, _, _ in self.tried)
            self.tried = []
        self._shrink()

    # ---- which rung -------------------------------------------------------------------------

    def _next(self) -> Recipe | str | None:
        """The rung with the largest expected gain per second, None if none is left."""
        if self.search is not None and not self.search.tell(self.task):
            self.seen, self.search = self.search.seen, None  # another tree must be grown
        with self.task.stages.stage("relax"):
            best, most = self.agenda.best(self.task.clock.left)
        branch = self._branch_rate()
        if branch is not None and (best is None or branch > most):
            return _BRANCH
        return best

    def _scaled(self) -> Scaled:
        """The problem scaled to the box as it is now, remembered for estimates."""
        if self.last is None or self.last[0] is not self.model.box:
            box, problem = self.model.box, self.task.problem
            scaling = Scaling.of_box(box, room=self._room)
            self.last = box, Scaled.of(problem, scaling, (problem.objective,))
        return self.last[1]

    def _branch_rate(self) -> float | None:
        """Share of the gap that branching is expected to close in a second."""
        limit = self.task.options.node_limit
        if "branch" in self.task.options.skip:
            return None
        if self.search is not None:
            if self.search.done or (limit is not None and self.search.seen >= limit):
                return None
            return self.rate
        if not self.ground.variables or not self.history or limit == self.seen:
            return None
        seen = self.ground.experience
        if _BRANCH in seen.progress:
            return seen.progress[_BRANCH] / max(1e-3, seen.seconds[_BRANCH])
        node = max(1e-2, min(h.seconds for h in self.history))
        return 1.0 / (node * _NODES * self.ground.effort)

    # ---- one rung ---------------------------------------------------------------------------

    def _climb(self, recipe: Recipe | str) -> None:
        start, before = time.process_time(), self._gap
        if isinstance(recipe, str):
            name, relaxation = recipe, None
            self._branch(start)
        else:
            name = recipe.name
            relaxation = self._relax(recipe)
            self.agenda.climbed(recipe)
            if relaxation is None:
                return
        seconds = time.process_time() - start
        share = 1.0 if self.over else progress(before, self._gap, self.task.allowed)
        self.ground.experience.learn(name, share, seconds)
        if name == _BRANCH:
            self.rate = max(share, 1e-3) / max(seconds, 1e-3)
        self.history.append(self._record(name, relaxation, seconds))

    @property
    def _gap(self) -> float:
        return self.task.upper - self.bound

    def _record(self, name: str, relaxation: Relaxation | None, seconds: float) -> Rung:
        return Rung(
            name=name,
            order=relaxation.order if relaxation is not None and "order" in name else 0,
            lower_bound=self.bound,
            upper_bound=self.task.upper,
            seconds=seconds,
            largest_block=max(relaxation.block_sizes, default=0) if relaxation else 0,
            moments=relaxation.moments.shape[0] if relaxation else 0,
            nodes=self.search.seen if self.search is not None else self.seen,
        )

    def _relax(self, recipe: Recipe) -> Relaxation | None:
        """Solve one relaxation of the whole box; None if another recipe has made the same."""
        if recipe.shape == "linear":
            return self._linear()
        if recipe.plain is not None:
            linear = self._tighten()
            if self.over:
                return linear
        with self.task.stages.stage("relax"):
            scaled = self._scaled()
            relaxation = recipe.build(scaled, self.ground.cliques)
        same = hashed(relaxation, self.model.box)
        if same in self.solved:
            return None
        self.solved.add(same)
        start = time.process_time()
        expected = expected_seconds(dict(relaxation.block_sizes), relaxation.rows)
        argued = argue(self.task, self.model.box, scaled, relaxation)
        spent = time.process_time() - start
        if spent > 0.05:
            self.ground.experience.pace = float(np.clip(spent / expected, 0.2, 5.0))
        self.tried.append((recipe, argued.proved.bound, spent))
        self._accept(argued, relaxation)
        full = recipe.shape == "full"
        starts = extracted(relaxation, argued.solution, scaled.scaling) if full else []
        if argued.solution is not None and argued.solution.status in ("solved", "almost"):
            starts.append(first_moments(scaled, relaxation, argued.solution.y))
        poor = self.task.upper - _POOR * self._gap
        self._attain(starts)
        if recipe.plain is not None and self.task.upper < poor:
            self.agenda.again([recipe])  # the cut-off was far from what it can be
        return relaxation

    def _accept(self, argued: Argued, relaxation: Relaxation | None) -> None:
        """Keep an argument if it is better, on the box as it was when it was made."""
        made = bound_of(self.task.replay(), self.model, argued, relaxation)
        if argued.proved.bound > self.best.proved.bound:
            self.best = argued
        self.outcome = better(self.outcome, made)

    def _attain(self, starts: list[NDArray]) -> None:
        """Local searches; a better point lowers the cut-off and shrinks the box."""
        if not starts or self.over:
            return
        upper = self.task.upper
        if self._attain_in_search(self.task, starts).upper < upper:
            self._shrink()

    def _attain_in_search(self, task: Task, starts: list[NDArray]) -> Task:
        self.task, near = attained(task, starts, self.bound)
        self.near = self.near + near
        return self.task

    def _shrink(self) -> None:
        """Propagate with the new cut-off."""
        with self.task.stages.stage("presolve"):
            box, step = tighten(self.task.replay(), self.model.box, _SWEEPS)
            if shrinks(self.model.box, box):
                self._take(box, step)

    def _take(self, box: Interval, *steps: Step) -> None:
        """Go on with a smaller box."""
        proof = BoxProof((*self.model.proof.steps, *steps))
        self.model = replace(self.model, proof=proof, box=box)
        if is_empty(box):
            self._accept(Argued(Proved(np.inf, 0.0, ""), Node()), None)

    def _linear(self) -> Relaxation:
        """The linear relaxation, and bounds of the variables that matter from others like it."""
        lifted = self._lifted()
        for number in range(_ROUNDS):
            solution = self._bound_linear(lifted)
            if solution is None or self.over:
                break
            if number == 0:
                self._attain([lifted.point(solution)])
            if self.over or self.agenda.dear or not self._narrow(lifted):
                break
            lifted = self._lifted(lifted)
        return lifted.relaxation

    def _lifted(self, warm: Lifted | None = None) -> Lifted:
        """The linear relaxation on the box as it is now."""
        cliques, active = self.ground.cliques["constraints"], self.ground.active
        with self.task.stages.stage("presolve"):
            return Lifted.of(self.task.problem, self.model.box, cliques, warm, active, self._room)

    @property
    def _room(self) -> NDArray[np.float64]:
        """What arguments on the box as it is now leave for the rounding of replays."""
        return room_of(self.model.box, self.start)

    def _bound_linear(self, lifted: Lifted) -> LinearSolution | None:
        """Take over what the linear relaxation proves; its solution where there is one."""
        start = time.process_time()
        with self.task.stages.stage("presolve"):
            solution = lifted.minimise(self.task.clock.left)
            self.ground.experience.learn(PROGRAM, 0.0, time.process_time() - start)
            if solution.status not in ("solved", "infeasible"):
                return None
            empty = solution.status == "infeasible"
            dual = lifted.objective_dual(solution)
            proved = prove(self.task.replay(), self.model.box, dual, empty)
        self._accept(Argued(proved, Node(argument=dual, empty=empty)), lifted.relaxation)
        self.linear = max(self.linear, proved.bound)
        return None if empty else solution

    def _narrow(self, lifted: Lifted) -> bool:
        """Tighten bounds by linear programs; whether another round may gain."""
        variables = self.ground.variables[:NARROW]
        if not variables or not self.ground.narrow:
            return False
        with self.task.stages.stage("presolve"):
            made = narrowed(self.task, self.model, lifted, variables)
        if made.empty:
            self._bound_linear(lifted)  # the same program proves it
        self.model = made.model
        if is_empty(self.model.box):
            self._accept(Argued(Proved(np.inf, 0.0, ""), Node()), None)
        return made.gains

    def _tighten(self) -> Relaxation:
        """Rounds of tightening before a relaxation, from a cut-off below the attained value."""
        start = time.process_time()
        self.task = replace(self.task, below=True)
        self._shrink()
        lifted = self._lifted()
        for _ in range(_ROUNDS):
            if not self._narrow(lifted) or self.over:
                break
            lifted = self._lifted(lifted)
        self.ground.experience.learn(TIGHTENING, 0.0, time.process_time() - start)
        return lifted.relaxation

    # ---- branch and bound ---------------------------------------------------------------------

    def _branch(self, start: float) -> None:
        """Grow the tree for about as long as the next rung would take."""
        slice_ = float(np.clip(self.agenda.shortest, 0.5, _SLICE))
        if self.search is None:
            proof, box, known = self.model.proof, self.model.box, self.best.node
            root, plan = (self.best.proved, known.argument, known.empty), self._plan()
            attain, seen = self._attain_in_search, self.seen
            self.search = Search(self.task, plan, proof, box, attain, root, seen=seen)
        search, limit = self.search, self.task.options.node_limit

        def stop() -> bool:
            late = time.process_time() - start > slice_
            return late or search.task.clock.over or search.task.closed(search.bound)

        nodes = 10**9 if limit is None else limit - search.seen
        search.grow(nodes, stop, self.task.options.executor)
        self.task = search.task
        self._reconsider(search)
        if search.done or search.bound > self.bound:
            self._close_search()

    def _reconsider(self, search: Search) -> None:
        """Parts that linear programs do not close get the strongest relaxation of the root."""
        slow = search.seen > _PATIENCE and search.plan.recipe is None and self.tried
        if slow and not search.done and not self.over:
            best = max(self.tried, key=lambda entry: entry[1])[0]
            search.plan = replace(search.plan, recipe=best)

    def _plan(self) -> Plan:
        """Parts that linear programs leave open get what closed most of the gap per second."""
        base = self.linear if np.isfinite(self.linear) else self.first
        narrow = len(self.ground.variables) <= NARROW and "narrow" not in self.task.options.skip
        seen = self.ground.experience.seconds
        program = seen.get(TIGHTENING if narrow else PROGRAM, seen.get(PROGRAM, np.inf))
        best = worth_in_parts(self.tried, (base, self.task.upper), program)
        parts = self.ground.cliques, self.ground.variables
        return Plan(*parts, best, narrow, self.ground.squeeze, self._room)

    def _close_search(self) -> None:
        """Take over what the tree proves now."""
        assert self.search is not None
        certificate = self.search.certificate()
        if level(certificate) > self.bound:
            self.outcome = replace(self.outcome, certificate=certificate)
