"""Adaptive bound search for one objective over a finite box (effort "auto").

Each step either solves one relaxation of the hierarchy or processes a slice of the
branch-and-bound tree. The step with the largest expected gap reduction per CPU second comes
next, until the gap is closed, time is over or nothing is left to try. What the last slice of
the tree gained per second is what the next one is expected to gain. A better incumbent lowers
the cutoff, and with it the box.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import (
    CertifiedBound,
    Model,
    better,
    certified_bound,
    lower_bound,
)
from sparsepop_py.bounding.relaxation_bound import BoxBound, bound_box
from sparsepop_py.branch_and_bound.node import NodeSettings
from sparsepop_py.branch_and_bound.tree import SearchTree
from sparsepop_py.budget import TOO_MUCH, cpu_seconds, outlasts
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import candidates_from_moments, update_incumbent
from sparsepop_py.lp.highs import LinearSolution
from sparsepop_py.presolve.initial_box import rounding_slack, shrinks
from sparsepop_py.problem.generators import count_chains
from sparsepop_py.relaxation.hierarchy import (
    RelaxationSpec,
    expected_seconds,
    hashed,
    progress,
    worth_of,
)
from sparsepop_py.relaxation.moment import Relaxation
from sparsepop_py.result import HistoryEntry
from sparsepop_py.strategy.relaxation_queue import (
    PROGRAM,
    TIGHTENING,
    RelaxationQueue,
    relaxation_for_nodes,
)
from sparsepop_py.strategy.settings import BOUND_TIGHTENING, STRATEGY, TREE
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
_CHAIN_WORK = 3e-5  # of pricing and building a linear relaxation, by products of bounds
_LEAST_SHARE = 0.4  # of the work of a relaxation, without which its multipliers prove nothing


@dataclass(eq=False)
class AdaptiveSearch:
    """Adaptive bound search for one objective.

    Each step solves the relaxation with the largest expected gap reduction per CPU second, or
    processes a slice of the branch-and-bound tree. Mutable; its path depends on measured times.

    Parameters
    ----------
    context : SolveContext
        Problem, options, deadline and incumbent.
    model : Model
        The box and its proof, both with the cutoff.
    candidates : list of (n,) float
        Nearly feasible vectors seen so far.
    shared_state : SharedState
        Structure of the problem, and what was learned on it.
    history : list of HistoryEntry
        One entry for each step.
    costs : list of float
        Seconds of each step.
    outcome : CertifiedBound
        The best proved bound.
    tree : SearchTree or None
        The branch-and-bound tree that grows now.
    seen : int
        Nodes of trees that were left.
    exhausted : bool
        Whether nothing was left to try on the current box.
    best : BoxBound
        The argument on the own box that proves most.
    rate : float or None
        Share of the gap that the last slice of the tree closed per second.
    linear_bound : float
        The largest bound of a linear relaxation.
    more_starts : iterator of (n,) float
        Starts of local searches for where the first relaxation leaves a gap.
    solved : set of bytes
        Hashes of the relaxations that were solved, each with its box.
    last : (Interval, Scaled) or None
        A box, and the problem scaled to it.
    least_cutoff : float
        The least cutoff with which the box was tightened.
    point : (n,) float or None
        First moments of the last relaxation from which an incumbent was searched.
    longest_slice : float
        Seconds that a tree grows at most before relaxations are considered again.
    at_nodes : RelaxationSpec or None
        The relaxation of each node, once a tree of linear programs has proved too little.

    Attributes
    ----------
    queue : RelaxationQueue
        Relaxations that are left to try.
    tried : list of (RelaxationSpec, float, float)
        Those that were solved on the current box, with the bound and the seconds of each.
    first_bound : float
        What interval arithmetic alone proves on the first box.
    first_box : Interval
        The box at the beginning: slack for rounding is measured by its widths.
    shared_model : Model
        The box that holds for all objectives, without steps of this one.
    """

    context: SolveContext
    model: Model
    candidates: list[NDArray[np.float64]]
    shared_state: SharedState
    history: list[HistoryEntry] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    outcome: CertifiedBound = field(init=False)
    tree: SearchTree | None = None
    seen: int = 0
    exhausted: bool = False
    best: BoxBound = field(init=False)
    rate: float | None = None
    linear_bound: float = -np.inf
    more_starts: Iterator[NDArray[np.float64]] = field(default_factory=lambda: iter(()))
    solved: set[bytes] = field(default_factory=set)
    last: tuple[Interval, Scaled] | None = None
    least_cutoff: float = np.inf
    point: NDArray[np.float64] | None = None
    longest_slice: float = TREE.longest_slice
    at_nodes: RelaxationSpec | None = None

    def __post_init__(self) -> None:
        replay = self.context.at_cutoff()
        self.best = BoxBound(prove(replay, self.model.box, None, False), Node())
        self.outcome = certified_bound(replay, self.model, self.best)
        self.queue = RelaxationQueue(self.shared_state, self._scaled)
        self.first_bound = self.best.proved.bound
        self.shared_model, self.first_box = self.model, self.model.box
        self._put_off = False
        self._branched = 0.0  # seconds of trees
        self._gained = -np.inf, 0  # the bound when it last gained, and the nodes of the tree then
        self.tried: list[tuple[RelaxationSpec, float, float]] = []  # relaxation, bound, seconds

    @property
    def bound(self) -> float:
        """The lower bound proved so far, -inf before the first."""
        return lower_bound(self.outcome.certificate)

    @property
    def over(self) -> bool:
        """True if the gap is closed or time is over."""
        return self.context.closed(self.bound) or self.context.deadline.over

    @property
    def gap_ratio(self) -> float:
        """The gap, in gaps that count as closed."""
        return self._gap / max(self.context.allowed, 1e-300)

    def run(self, most: int | None = None) -> None:
        """Improve the bound while the gap is open and something is left to try.

        Parameters
        ----------
        most : int, optional
            Largest number of steps; without limit when left out.
        """
        done = 0
        try:
            while not self.over and done != most:
                spec = self._next()
                if self.costs and self._costly(spec) and self.search_more_starts():
                    continue
                self.exhausted = spec is None
                if spec is None:
                    self._say_what_was_left_out()
                    break
                self._run(spec)
                done += 1
        finally:
            self.least_cutoff = self.context.cutoff
            if self.tree is not None:
                self._close_search()

    @property
    def next_seconds(self) -> float:
        """Expected seconds of the next step, 0 for branching and where nothing is left."""
        spec = None if self.over else self._next()
        return self.queue.seconds(spec) if isinstance(spec, RelaxationSpec) else 0.0

    @property
    def branches(self) -> bool:
        """True if the next step grows the tree."""
        return not self.over and self._next() == _BRANCH

    def _costly(self, spec: RelaxationSpec | str | None) -> bool:
        """Check that the next step takes long, so that a better incumbent should precede it."""
        if not isinstance(spec, RelaxationSpec):
            return True
        return self.queue.seconds(spec) > STRATEGY.cheap_seconds

    def search_more_starts(self) -> bool:
        """Search from the starts that are left, all at once; return whether there were any."""
        starts = [] if self.over else list(self.more_starts)
        self._search_incumbent(starts)
        return bool(starts)

    def _say_what_was_left_out(self) -> None:
        if self.over:
            return
        text, slow = self.queue.left_out(self.context.deadline.expected)
        if text:
            self.context.deadline.cut |= slow
            self.context.stages.note(text)

    def restart(self, model: Model) -> None:
        """Continue on another box proved for all objectives, and keep what is proved.

        Nothing happens where the box is the old one and the cutoff has not risen. It rises with
        gaps relative to a width when the attained width turns out smaller than thought: the old box
        may then have lost points that count now.

        Parameters
        ----------
        model : Model
            The new box and its proof, without cutoffs.
        """
        old = self.shared_model
        if model is old and self.context.cutoff <= self.least_cutoff:
            return
        moved = old.box.hi > old.box.lo
        width = model.box.width()[moved] / old.box.width()[moved]
        own = self.model.proof.steps[len(old.proof.steps) :]
        self.model, self.shared_model = model, model
        node, replay = self.best.node, self.context.at_cutoff()
        if any(isinstance(step, Tightening) for step in own):  # costly: kept
            self._take(apply_steps(replay, own, model.box), *own)
        # another box than before, which need not be within it
        proved = prove(replay, self.model.box, node.argument, node.empty)
        self.best = replace(self.best, proved=proved)
        # a gap shrinks about as fast as the widths of the branching variables: it may close now
        smaller = max(STRATEGY.smaller_box_share, 1.0 / max(self.gap_ratio, 1.0))
        if self.tree is None and self.tried and width.min(initial=1.0) < smaller:
            chosen = np.isin(np.flatnonzero(moved), self.shared_state.variables)
            kept = float(np.mean(width[chosen] if chosen.any() else width))
            share = progress(self.gap_ratio, self.gap_ratio * kept, 1.0)
            self.queue.requeue((spec for spec, _, _ in self.tried), worth_of(share))
            self.tried = []
        self._shrink()

    @property
    def steps_below(self) -> tuple[Step, ...]:
        """Steps that tightened the own box below the cutoff, with those of the tree's root."""
        own = self.model.proof.steps[len(self.shared_model.proof.steps) :]
        return own if self.tree is None else (*own, *self.tree.root_steps)

    def adopt(self, steps: tuple[Step, ...]) -> None:
        """Tighten the own box by steps that other searches below the cutoff have found.

        Parameters
        ----------
        steps : tuple of Step
            About this problem. What they prove is recomputed. Without relaxations or linear
            programs among them nothing happens: propagation is done in any case.
        """
        if not any(isinstance(step, Tightening) for step in steps):
            return
        self.context = replace(self.context, below=True)
        with self.context.stages.stage("presolve"):
            box = apply_steps(self.context.at_cutoff(), steps, self.model.box)
        if shrinks(self.model.box, box):
            self._take(box, *steps)

    # ---- choice of the next step --------------------------------------------------------------

    def _next(self) -> RelaxationSpec | str | None:
        """Select the step with the largest expected gain per second, None if none is left."""
        if self.tree is not None and not self.tree.update_context(self.context):
            self.seen, self.tree = self.tree.seen, None  # another tree must be grown
        if not self.costs and self._needs_too_much("linear", self._chains * _CHAIN_WORK):
            return None
        seconds_left = self.context.deadline.expected
        with self.context.stages.stage("relax"):
            best, most = self.queue.best(seconds_left)
            order = self.queue.next_order(best, seconds_left)
        if order is not None:
            return order
        branch = self._branch_rate()
        if branch is not None and (best is None or branch > most or self._is_early(best)):
            return _BRANCH
        return best

    def _needs_too_much(self, name: str, work: float) -> bool:
        """Check that a relaxation needs far more work than is left, and say so."""
        if not outlasts(work):
            return False
        self.context.deadline.give_up()
        self.context.stages.note(f"{name}: not begun, it needs {TOO_MUCH}")
        return True

    @property
    def _chains(self) -> int:
        """Products of bounds for long monomials, which take the longest to price and to build."""
        problem = self.context.problem
        return sum(map(count_chains, (problem.rows.words, problem.objective.words)))

    def _is_early(self, spec: RelaxationSpec) -> bool:
        """Check that a relaxation takes long, and the tree has had little of its seconds.

        One slice without gain tells little of a tree, and what a long relaxation costs is not well
        known before.
        """
        share = TREE.share_before_relaxation * self.queue.seconds(spec)
        return share > max(self._branched, TREE.shortest_slice)

    def _scaled(self) -> Scaled:
        """Scale the problem to the current box; remembered until the box changes."""
        if self.last is None or self.last[0] is not self.model.box:
            box, problem = self.model.box, self.context.problem
            scaling = Scaling.of_box(box, slack=self._room)
            self.last = box, Scaled.of(problem, scaling, (problem.objective,))
        return self.last[1]

    def _branch_rate(self) -> float | None:
        """Estimate the share of the gap that branching closes per second, None if not allowed."""
        limit = self.context.options.node_limit
        if "branch" in self.context.options.skip:
            return None
        if self.tree is not None:
            over = limit is not None and self.tree.seen >= limit
            return None if over or self.tree.done or self._idle(self.tree) else self.rate
        if not self.shared_state.variables or not self.costs or limit == self.seen:
            return None
        seen, node = self.shared_state.cost_model, max(1e-2, min(self.costs))
        rate = 1.0 / (node * TREE.nodes_per_effort * self.shared_state.effort)
        if _BRANCH in seen.progress:  # a slice without gain does not speak for all trees
            return max(0.3 * rate, seen.progress[_BRANCH] / max(1e-3, seen.seconds[_BRANCH]))
        return rate

    def _idle(self, tree: SearchTree) -> bool:
        """Check that a tree which nothing else ends has doubled in vain.

        Nothing ends it where no limit is given and the gap cannot close: without a way to attain
        a point, or where rounding is all that is left of the gap.
        """
        options, upper = self.context.options, self.context.upper
        if options.node_limit is not None or not self.context.deadline.unlimited:
            return False
        if np.isfinite(upper):
            stays_open = self._gap <= STRATEGY.rounding_gap * max(1.0, abs(upper))
        else:
            stays_open = not self.context.attains
        nodes = self._gained[1]
        return stays_open and tree.seen - nodes >= max(TREE.idle_nodes, nodes)

    def _note_gain(self, tree: SearchTree) -> None:
        """Note where the bound has gained what counts as a gap, and more than rounding."""
        bound = max(self.bound, tree.bound)
        least = max(self.context.allowed, STRATEGY.rounding_gap * max(1.0, abs(bound)))
        if bound - self._gained[0] > least:
            self._gained = bound, tree.seen

    # ---- one step -----------------------------------------------------------------------------

    def _run(self, spec: RelaxationSpec | str) -> None:
        start, before, seconds = self.context.deadline.now(), self._gap, cpu_seconds()
        if isinstance(spec, str):
            name, relaxation = spec, None
            self._branch(start)
        else:
            name = spec.name
            relaxation = self._relax(spec)
            if self._put_off:
                return
            self.queue.remove_up_to(spec)
            if relaxation is None:
                return
            self._leave_weak_tree()
        cost = self.context.deadline.now() - start
        share = 1.0 if self.over else progress(before, self._gap, self.context.allowed)
        self.shared_state.cost_model.learn(name, share, cost, goes_on=name == _BRANCH)
        if name == _BRANCH:
            self.rate = max(share, 1e-3) / max(cost, 1e-3)
            self._branched += cost
        self.costs.append(cost)
        self.history.append(self._record(name, relaxation, cpu_seconds() - seconds))

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
            nodes=self.tree.seen if self.tree is not None else self.seen,
        )

    def _relax(self, spec: RelaxationSpec) -> Relaxation | None:
        """Solve one relaxation on the root box; None if an equal one was solved before.

        One that turns out to take too long once it is built is put off.
        """
        self._put_off = False
        if spec.shape == "linear":
            return self._linear()
        if self._needs_too_much(spec.name, _LEAST_SHARE * self.queue.seconds(spec)):
            return None
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
        expected = self._expected(spec, relaxation)
        seconds_left, cost_model = self.context.deadline.expected, self.shared_state.cost_model
        longest = np.inf if seconds_left is None else STRATEGY.most_overtime * seconds_left
        self._put_off = cost_model.pace * expected > longest
        if self._put_off:
            self.queue.set_expected_seconds(spec, expected)
            return None
        self.solved.add(same)
        start = self.context.deadline.now()
        box_bound = bound_box(self.context, self.model.box, scaled, relaxation)
        spent = self.context.deadline.now() - start
        if max(spent, expected) > STRATEGY.telling_seconds:
            self.shared_state.cost_model.pace = float(np.clip(spent / expected, 0.2, 5.0))
        self.tried.append((spec, box_bound.proved.bound, spent))
        self._accept(box_bound, relaxation)
        full = spec.shape == "full"
        starts = (
            candidates_from_moments(relaxation, box_bound.solution, scaled.scaling) if full else []
        )
        if box_bound.solution is not None and box_bound.solution.status in ("solved", "almost"):
            point = first_moments(scaled, relaxation, box_bound.solution.y)
            starts = [*(x for x in starts if not np.array_equal(x, point)), point]
        poor = self.context.upper - STRATEGY.poor_cutoff_share * self._gap
        self._search_incumbent(starts)
        if spec.plain is not None and self.context.upper < poor:
            self.queue.requeue([spec])  # the cutoff was far from what it can be
        return relaxation

    def _expected(self, spec: RelaxationSpec, relaxation: Relaxation) -> float:
        """Estimate the seconds of a relaxation that is built."""
        built = expected_seconds(dict(relaxation.block_sizes), relaxation.rows)
        counted = spec.shape == "full" and spec.terms != "chordal"  # cliques, whose overlap counts
        return min(built, self.shared_state.estimates.get(spec.name, built)) if counted else built

    def _accept(self, box_bound: BoxBound, relaxation: Relaxation | None) -> None:
        """Keep an argument on its box if its bound is better."""
        made = certified_bound(self.context.at_cutoff(), self.model, box_bound, relaxation)
        if box_bound.proved.bound > self.best.proved.bound:
            self.best = box_bound
        self.outcome = better(self.outcome, made)
        self.context.report(self.bound)

    def _search_incumbent(self, starts: list[NDArray[Any]]) -> None:
        """Run local searches; a better incumbent lowers the cutoff and tightens the box."""
        if not starts or self.over:
            return
        upper = self.context.upper
        if self._search_in_tree(self.context, starts).upper < upper:
            self._shrink()

    def _search_in_tree(self, context: SolveContext, starts: list[NDArray[Any]]) -> SolveContext:
        self.point = starts[-1]
        self.context, candidates = update_incumbent(context, starts, self.bound)
        self.candidates = self.candidates + candidates
        self.context.report(self.bound)
        return self.context

    def _shrink(self) -> None:
        """Propagate bounds with the current cutoff."""
        with self.context.stages.stage("presolve"):
            replay, sweeps = self.context.at_cutoff(), STRATEGY.propagation_sweeps
            box, step = tighten(replay, self.model.box, sweeps)
            if shrinks(self.model.box, box):
                self._take(box, step)

    def _take(self, box: Interval, *steps: Step) -> None:
        """Replace the box by a smaller one and record the steps that prove it."""
        proof = BoxProof((*self.model.proof.steps, *steps))
        self.model = replace(self.model, proof=proof, box=box)
        if is_empty(box):
            self._accept(BoxBound(Proved(np.inf, 0.0, ""), Node()), None)

    def _linear(self) -> Relaxation:
        """Solve the linear relaxation, then alternate with OBBT rounds while these gain."""
        mccormick = self._mccormick()
        for number in range(BOUND_TIGHTENING.rounds):
            if self.context.deadline.late:
                break
            solution = self._bound_linear(mccormick)
            if solution is None or self.over:
                break
            if number == 0:
                self._search_incumbent([mccormick.point(solution)])
            if self.over or self.queue.obbt_too_slow or not self._obbt_lp(mccormick):
                break
            mccormick = self._mccormick(mccormick)
        return mccormick.relaxation

    def _mccormick(self, warm: LinearRelaxation | None = None) -> LinearRelaxation:
        """Build the linear relaxation on the current box."""
        cliques, active = self.shared_state.cliques["constraints"], self.shared_state.active
        with self.context.stages.stage("presolve"):
            return LinearRelaxation.of(
                self.context.problem, self.model.box, cliques, warm, active, self._slack
            )

    @property
    def _slack(self) -> NDArray[np.float64]:
        """Slack that arguments on the current box keep for the rounding of replays, shape (n,)."""
        return rounding_slack(self.model.box, self.first_box)

    @property
    def _room(self) -> NDArray[np.float64]:
        """The same for semidefinite relaxations; an objective that is a variable has more.

        Bound and cutoff enclose that variable, and soon within about the gap that counts as closed.
        On so flat a box solvers find neither a better bound nor that there is no point.
        """
        slack, objective = self._slack, self.context.problem.objective
        if objective.degree == 1 and objective.support.size == 1:
            (variable,) = objective.support
            size = abs(float(objective.coefficients[-1]))
            room = STRATEGY.objective_room * self.context.allowed / size
            if self.model.box.width()[variable] <= room < np.inf:
                slack[variable] = room
        return slack

    def _bound_linear(self, mccormick: LinearRelaxation) -> LinearSolution | None:
        """Accept the bound of the linear relaxation; return its solution, None without one."""
        start = self.context.deadline.now()
        with self.context.stages.stage("presolve"):
            solution = mccormick.minimise(self.context.deadline.left)
            self.shared_state.cost_model.learn(PROGRAM, 0.0, self.context.deadline.now() - start)
            if solution.status not in ("solved", "infeasible", "stopped"):
                return None
            empty = solution.status == "infeasible"
            dual = mccormick.objective_dual(solution)
            proved = prove(self.context.at_cutoff(), self.model.box, dual, empty)
        self._accept(BoxBound(proved, Node(argument=dual, empty=empty)), mccormick.relaxation)
        self.linear_bound = max(self.linear_bound, proved.bound)
        return solution if solution.status == "solved" else None

    def _obbt_lp(self, mccormick: LinearRelaxation) -> bool:
        """Tighten bounds by linear programs; return whether another round may gain."""
        variables = self.shared_state.variables[: BOUND_TIGHTENING.most_variables]
        if not variables or not self.shared_state.obbt_lp:
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
        """Run OBBT rounds before a relaxation, with a cutoff a little below the attained value."""
        start = self.context.deadline.now()
        self.context = replace(self.context, below=True)
        self._shrink()
        mccormick = self._mccormick()
        for _ in range(BOUND_TIGHTENING.rounds):
            if not self._obbt_lp(mccormick) or self.over:
                break
            mccormick = self._mccormick(mccormick)
        self.shared_state.cost_model.learn(TIGHTENING, 0.0, self.context.deadline.now() - start)
        return mccormick.relaxation

    # ---- branch and bound ---------------------------------------------------------------------

    def _branch(self, start: float) -> None:
        """Grow the tree for about as long as the next relaxation would take."""
        slice_ = float(np.clip(self.queue.shortest, TREE.shortest_slice, self.longest_slice))
        if self.tree is None:
            proof, box, known = self.model.proof, self.model.box, self.best.node
            root, settings = (self.best.proved, known.argument, known.empty), self._plan()
            search_incumbent, seen = self._search_in_tree, self.seen
            self.tree = SearchTree(
                self.context, settings, proof, box, search_incumbent, root, seen=seen
            )
        tree, limit = self.tree, self.context.options.node_limit

        def stop() -> bool:
            self._note_gain(tree)
            late = self.context.deadline.now() - start > slice_ or self._idle(tree)
            return late or tree.context.deadline.over or tree.context.closed(tree.bound)

        nodes = 10**9 if limit is None else limit - tree.seen
        tree.grow(nodes, stop, self.context.options.executor)
        self.context = tree.context
        self._reconsider(tree)
        if tree.done or tree.bound > self.bound:
            self._close_search()

    def _leave_weak_tree(self) -> None:
        """Leave a tree where a relaxation of the root has proved far more.

        Each open node would need that relaxation once; another tree has it from its root on.
        """
        tree = self.tree
        if tree is None or tree.done or not self.tried:
            return
        if self._gap < TREE.weak_gap_share * (self.context.upper - tree.bound):
            self.seen, self.tree, self.at_nodes = tree.seen, None, self._strongest

    @property
    def _strongest(self) -> RelaxationSpec:
        """The relaxation of the root that proved most."""
        return max(self.tried, key=lambda entry: entry[1])[0]

    def _reconsider(self, tree: SearchTree) -> None:
        """Give open nodes the strongest relaxation of the root after many without one."""
        slow = tree.seen > TREE.patience_nodes and tree.settings.spec is None and self.tried
        if slow and not tree.done and not self.over:
            tree.settings = replace(tree.settings, spec=self._strongest)

    def _plan(self) -> NodeSettings:
        """Choose how nodes are bounded: linear programs, then the best relaxation per second."""
        base = self.linear_bound if np.isfinite(self.linear_bound) else self.first_bound
        obbt_lp = (
            len(self.shared_state.variables) <= BOUND_TIGHTENING.most_variables
            and "obbt_lp" not in self.context.options.skip
        )
        seen = self.shared_state.cost_model.seconds
        program = seen.get(TIGHTENING if obbt_lp else PROGRAM, seen.get(PROGRAM, np.inf))
        gap = base, self.context.upper
        best = self.at_nodes or relaxation_for_nodes(self.tried, gap, program)
        where = self.shared_state.cliques, self.shared_state.variables
        slack, obbt_sdp = (self._slack, self._room), self.shared_state.obbt_sdp
        return NodeSettings(*where, best, obbt_lp, obbt_sdp, *slack)

    def _close_search(self) -> None:
        """Accept the bound that the tree proves now."""
        assert self.tree is not None
        certificate = self.tree.certificate()
        if lower_bound(certificate) > self.bound:
            simpler = self.outcome.simpler or self.outcome.certificate
            self.outcome = replace(self.outcome, certificate=certificate, simpler=simpler)
