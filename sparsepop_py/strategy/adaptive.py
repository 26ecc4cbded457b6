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
    BoxBound,
    CertifiedBound,
    Model,
    better,
    bound_box,
    certified_bound,
    lower_bound,
)
from sparsepop_py.branch_and_bound.node import NodeSettings
from sparsepop_py.branch_and_bound.tree import Search
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import candidates_from_moments, update_incumbent
from sparsepop_py.lp.highs import LinearSolution
from sparsepop_py.presolve.initial_box import rounding_slack, shrinks
from sparsepop_py.relaxation.hierarchy import RelaxationSpec, expected_seconds, hashed, progress
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.result import HistoryEntry
from sparsepop_py.strategy.relaxation_queue import (
    MOST_TIGHTENED,
    PROGRAM,
    TIGHTENING,
    RelaxationQueue,
    worth_in_parts,
)
from sparsepop_py.strategy.shared_state import SharedState
from sparsepop_py.tightening.mccormick import LinearRelaxation, first_moments
from sparsepop_py.tightening.obbt_lp import apply_steps, tighten_by_lp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.box.scaling import Scaled, Scaling
from sparsepop_py.verified.certificate.certificate import Node, Proved, prove
from sparsepop_py.verified.certificate.steps import BoxProof, Step, Tightening, tighten

__all__ = ["AdaptiveSearch"]

_BRANCH = "branch"
_NODES = 4.0  # times the effort of the ground: parts that branch and bound is expected to need
_SLICE = 3.0  # most seconds that a tree grows before other rungs are considered again
_PATIENCE = 300  # parts after which linear programs alone are not trusted to close the gap
_SWEEPS = 3  # of propagation after a step that shrank the box
_ROUNDS = 3
_POOR = 0.5  # an attained value that falls by this share of the gap was a poor cut-off
_SMALLER = 0.7  # a box with a width below this share is worth the rungs climbed before


@dataclass(eq=False)
class AdaptiveSearch:
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

    context: SolveContext
    model: Model
    near: list[NDArray[np.float64]]
    shared_state: SharedState
    history: list[HistoryEntry] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    outcome: CertifiedBound = field(init=False)
    search: Search | None = None
    seen: int = 0
    exhausted: bool = False
    best: BoxBound = field(init=False)
    rate: float | None = None
    linear: float = -np.inf
    later: Iterator[NDArray[np.float64]] = field(default_factory=lambda: iter(()))
    solved: set[int] = field(default_factory=set)
    last: tuple[Interval, Scaled] | None = None
    cut: float = np.inf

    def __post_init__(self) -> None:
        replay = self.context.replay()
        self.best = BoxBound(prove(replay, self.model.box, None, False), Node())
        self.outcome = certified_bound(replay, self.model, self.best)
        self.queue = RelaxationQueue(self.shared_state, self._scaled)
        self.first = self.best.proved.bound
        self.shared, self.start = self.model, self.model.box
        self.tried: list[tuple[RelaxationSpec, float, float]] = []  # recipe, bound, seconds

    @property
    def bound(self) -> float:
        """What is proved so far."""
        return lower_bound(self.outcome.certificate)

    @property
    def over(self) -> bool:
        """Whether the gap is closed or time is over."""
        return self.context.closed(self.bound) or self.context.deadline.over

    def run(self, most: int | None = None) -> None:
        """Climb (at most so many rungs) while the gap is open and something is left to try."""
        done = 0
        try:
            while not self.over and done != most:
                spec = self._next()
                self.exhausted = spec is None
                if spec is None:
                    break
                self._run(spec)
                self._search_incumbent(list(self.later))  # exhausted by the first rung
                done += 1
        finally:
            self.cut = self.context.cutoff
            if self.search is not None:
                self._close_search()

    def restart(self, model: Model) -> None:
        """Begin again on a smaller box that others have proved, keeping what is proved.

        So it does where the cut-off has risen, with a width that is attained and smaller than
        thought: the box may be without points that count now.
        """
        old = self.shared
        if model is old and self.context.cutoff <= self.cut:
            return
        moved = old.box.hi > old.box.lo
        width = (model.box.hi - model.box.lo)[moved] / (old.box.hi - old.box.lo)[moved]
        own = self.model.proof.steps[len(old.proof.steps) :]
        self.model, self.shared = model, model
        node, replay = self.best.node, self.context.replay()
        if any(isinstance(step, Tightening) for step in own):  # dear: they are kept
            self._take(apply_steps(replay, own, model.box), *own)
        # another box than before, which need not be within it
        proved = prove(replay, self.model.box, node.argument, node.empty)
        self.best = replace(self.best, proved=proved)
        if self.search is None and self.tried and width.min(initial=1.0) < _SMALLER:
            # the same rung may do more now
            self.queue.again(spec for spec, _, _ in self.tried)
            self.tried = []
        self._shrink()

    # ---- which rung -------------------------------------------------------------------------

    def _next(self) -> RelaxationSpec | str | None:
        """The rung with the largest expected gain per second, None if none is left."""
        if self.search is not None and not self.search.update_context(self.context):
            self.seen, self.search = self.search.seen, None  # another tree must be grown
        with self.context.stages.stage("relax"):
            best, most = self.queue.best(self.context.deadline.left)
        branch = self._branch_rate()
        if branch is not None and (best is None or branch > most):
            return _BRANCH
        return best

    def _scaled(self) -> Scaled:
        """The problem scaled to the box as it is now, remembered for estimates."""
        if self.last is None or self.last[0] is not self.model.box:
            box, problem = self.model.box, self.context.problem
            scaling = Scaling.of_box(box, slack=self._slack)
            self.last = box, Scaled.of(problem, scaling, (problem.objective,))
        return self.last[1]

    def _branch_rate(self) -> float | None:
        """Share of the gap that branching is expected to close in a second."""
        limit = self.context.options.node_limit
        if "branch" in self.context.options.skip:
            return None
        if self.search is not None:
            if self.search.done or (limit is not None and self.search.seen >= limit):
                return None
            return self.rate
        if not self.shared_state.variables or not self.history or limit == self.seen:
            return None
        seen = self.shared_state.cost_model
        if _BRANCH in seen.progress:
            return seen.progress[_BRANCH] / max(1e-3, seen.seconds[_BRANCH])
        node = max(1e-2, min(self.costs))
        return 1.0 / (node * _NODES * self.shared_state.effort)

    # ---- one rung ---------------------------------------------------------------------------

    def _run(self, spec: RelaxationSpec | str) -> None:
        start, before, seconds = self.context.deadline.now(), self._gap, time.process_time()
        if isinstance(spec, str):
            name, relaxation = spec, None
            self._branch(start)
        else:
            name = spec.name
            relaxation = self._relax(spec)
            self.queue.state(spec)
            if relaxation is None:
                return
        cost = self.context.deadline.now() - start
        share = 1.0 if self.over else progress(before, self._gap, self.context.allowed)
        self.shared_state.cost_model.learn(name, share, cost)
        if name == _BRANCH:
            self.rate = max(share, 1e-3) / max(cost, 1e-3)
        self.costs.append(cost)
        self.history.append(self._record(name, relaxation, time.process_time() - seconds))

    @property
    def _gap(self) -> float:
        return self.context.upper - self.bound

    def _record(self, name: str, relaxation: Relaxation | None, seconds: float) -> HistoryEntry:
        return HistoryEntry(
            name=name,
            order=relaxation.order if relaxation is not None and "order" in name else 0,
            lower_bound=self.bound,
            upper_bound=self.context.upper,
            seconds=seconds,
            largest_block=max(relaxation.block_sizes, default=0) if relaxation else 0,
            moments=relaxation.moments.shape[0] if relaxation else 0,
            nodes=self.search.seen if self.search is not None else self.seen,
        )

    def _relax(self, spec: RelaxationSpec) -> Relaxation | None:
        """Solve one relaxation of the whole box; None if another recipe has made the same."""
        if spec.shape == "linear":
            return self._linear()
        if spec.plain is not None:
            linear = self._tighten()
            if self.over:
                return linear
        with self.context.stages.stage("relax"):
            scaled = self._scaled()
            relaxation = spec.build(scaled, self.shared_state.cliques)
        same = hashed(relaxation, self.model.box)
        if same in self.solved:
            return None
        self.solved.add(same)
        start = self.context.deadline.now()
        expected = expected_seconds(dict(relaxation.block_sizes), relaxation.rows)
        box_bound = bound_box(self.context, self.model.box, scaled, relaxation)
        spent = self.context.deadline.now() - start
        if spent > 0.05:
            self.shared_state.cost_model.pace = float(np.clip(spent / expected, 0.2, 5.0))
        self.tried.append((spec, box_bound.proved.bound, spent))
        self._accept(box_bound, relaxation)
        full = spec.shape == "full"
        starts = (
            candidates_from_moments(relaxation, box_bound.solution, scaled.scaling) if full else []
        )
        if box_bound.solution is not None and box_bound.solution.status in ("solved", "almost"):
            starts.append(first_moments(scaled, relaxation, box_bound.solution.y))
        poor = self.context.upper - _POOR * self._gap
        self._search_incumbent(starts)
        if spec.plain is not None and self.context.upper < poor:
            self.queue.again([spec])  # the cut-off was far from what it can be
        return relaxation

    def _accept(self, box_bound: BoxBound, relaxation: Relaxation | None) -> None:
        """Keep an argument if it is better, on the box as it was when it was made."""
        made = certified_bound(self.context.replay(), self.model, box_bound, relaxation)
        if box_bound.proved.bound > self.best.proved.bound:
            self.best = box_bound
        self.outcome = better(self.outcome, made)

    def _search_incumbent(self, starts: list[NDArray]) -> None:
        """Local searches; a better point lowers the cut-off and shrinks the box."""
        if not starts or self.over:
            return
        upper = self.context.upper
        if self._search_in_tree(self.context, starts).upper < upper:
            self._shrink()

    def _search_in_tree(self, context: SolveContext, starts: list[NDArray]) -> SolveContext:
        self.context, near = update_incumbent(context, starts, self.bound)
        self.near = self.near + near
        return self.context

    def _shrink(self) -> None:
        """Propagate with the new cut-off."""
        with self.context.stages.stage("presolve"):
            box, step = tighten(self.context.replay(), self.model.box, _SWEEPS)
            if shrinks(self.model.box, box):
                self._take(box, step)

    def _take(self, box: Interval, *steps: Step) -> None:
        """Go on with a smaller box."""
        proof = BoxProof((*self.model.proof.steps, *steps))
        self.model = replace(self.model, proof=proof, box=box)
        if is_empty(box):
            self._accept(BoxBound(Proved(np.inf, 0.0, ""), Node()), None)

    def _linear(self) -> Relaxation:
        """The linear relaxation, and bounds of the variables that matter from others like it."""
        mccormick = self._mccormick()
        for number in range(_ROUNDS):
            solution = self._bound_linear(mccormick)
            if solution is None or self.over:
                break
            if number == 0:
                self._search_incumbent([mccormick.point(solution)])
            if self.over or self.queue.dear or not self._narrow(mccormick):
                break
            mccormick = self._mccormick(mccormick)
        return mccormick.relaxation

    def _mccormick(self, warm: LinearRelaxation | None = None) -> LinearRelaxation:
        """The linear relaxation on the box as it is now."""
        cliques, active = self.shared_state.cliques["constraints"], self.shared_state.active
        with self.context.stages.stage("presolve"):
            return LinearRelaxation.of(
                self.context.problem, self.model.box, cliques, warm, active, self._slack
            )

    @property
    def _slack(self) -> NDArray[np.float64]:
        """What arguments on the box as it is now leave for the rounding of replays."""
        return rounding_slack(self.model.box, self.start)

    def _bound_linear(self, mccormick: LinearRelaxation) -> LinearSolution | None:
        """Take over what the linear relaxation proves; its solution where there is one."""
        start = self.context.deadline.now()
        with self.context.stages.stage("presolve"):
            solution = mccormick.minimise(self.context.deadline.left)
            self.shared_state.cost_model.learn(PROGRAM, 0.0, self.context.deadline.now() - start)
            if solution.status not in ("solved", "infeasible"):
                return None
            empty = solution.status == "infeasible"
            dual = mccormick.objective_dual(solution)
            proved = prove(self.context.replay(), self.model.box, dual, empty)
        self._accept(BoxBound(proved, Node(argument=dual, empty=empty)), mccormick.relaxation)
        self.linear = max(self.linear, proved.bound)
        return None if empty else solution

    def _narrow(self, mccormick: LinearRelaxation) -> bool:
        """Tighten bounds by linear programs; whether another round may gain."""
        variables = self.shared_state.variables[:MOST_TIGHTENED]
        if not variables or not self.shared_state.narrow:
            return False
        with self.context.stages.stage("presolve"):
            made = tighten_by_lp(self.context, self.model, mccormick, variables)
        if made.empty:
            self._bound_linear(mccormick)  # the same program proves it
        self.model = made.model
        if is_empty(self.model.box):
            self._accept(BoxBound(Proved(np.inf, 0.0, ""), Node()), None)
        return made.gains

    def _tighten(self) -> Relaxation:
        """Rounds of tightening before a relaxation, from a cut-off below the attained value."""
        start = self.context.deadline.now()
        self.context = replace(self.context, below=True)
        self._shrink()
        mccormick = self._mccormick()
        for _ in range(_ROUNDS):
            if not self._narrow(mccormick) or self.over:
                break
            mccormick = self._mccormick(mccormick)
        self.shared_state.cost_model.learn(TIGHTENING, 0.0, self.context.deadline.now() - start)
        return mccormick.relaxation

    # ---- branch and bound ---------------------------------------------------------------------

    def _branch(self, start: float) -> None:
        """Grow the tree for about as long as the next rung would take."""
        slice_ = float(np.clip(self.queue.shortest, 0.5, _SLICE))
        if self.search is None:
            proof, box, known = self.model.proof, self.model.box, self.best.node
            root, settings = (self.best.proved, known.argument, known.empty), self._plan()
            search_incumbent, seen = self._search_in_tree, self.seen
            self.search = Search(
                self.context, settings, proof, box, search_incumbent, root, seen=seen
            )
        search, limit = self.search, self.context.options.node_limit

        def stop() -> bool:
            late = self.context.deadline.now() - start > slice_
            return late or search.context.deadline.over or search.context.closed(search.bound)

        nodes = 10**9 if limit is None else limit - search.seen
        search.grow(nodes, stop, self.context.options.executor)
        self.context = search.context
        self._reconsider(search)
        if search.done or search.bound > self.bound:
            self._close_search()

    def _reconsider(self, search: Search) -> None:
        """Parts that linear programs do not close get the strongest relaxation of the root."""
        slow = search.seen > _PATIENCE and search.settings.spec is None and self.tried
        if slow and not search.done and not self.over:
            best = max(self.tried, key=lambda entry: entry[1])[0]
            search.settings = replace(search.settings, spec=best)

    def _plan(self) -> NodeSettings:
        """Parts that linear programs leave open get what closed most of the gap per second."""
        base = self.linear if np.isfinite(self.linear) else self.first
        narrow = (
            len(self.shared_state.variables) <= MOST_TIGHTENED
            and "narrow" not in self.context.options.skip
        )
        seen = self.shared_state.cost_model.seconds
        program = seen.get(TIGHTENING if narrow else PROGRAM, seen.get(PROGRAM, np.inf))
        best = worth_in_parts(self.tried, (base, self.context.upper), program)
        parts = self.shared_state.cliques, self.shared_state.variables
        return NodeSettings(*parts, best, narrow, self.shared_state.obbt_sdp, self._slack)

    def _close_search(self) -> None:
        """Take over what the tree proves now."""
        assert self.search is not None
        certificate = self.search.certificate()
        if lower_bound(certificate) > self.bound:
            self.outcome = replace(self.outcome, certificate=certificate)
