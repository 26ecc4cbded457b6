"""Bound one objective on a working set of constraints, for problems with many of them.

Where few variables complicate many constraints (records of a dynamic system, say), few of the
constraints decide an objective: those that bind at its minimiser, with their neighbours. A lower
bound from these alone is a bound of the whole problem, at a price that does not grow with it.

    binding at the incumbent -> neighbours -> search -> gap closed: done
                                  ^             | else the complicating variables of its last point
                                  +- violated --+ are held fixed in one linear program over all

Constraints that no choice of the other variables satisfies then join the set. Where there are
none, the point leads to a better incumbent, or the relaxation has to become tighter. The search
goes on over all constraints where a good part of them has joined, or where nothing is left to try.

References
----------
J. E. Kelley, The cutting-plane method for solving convex programs, J. SIAM 8, 1960 (constraints
added where they are violated).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.bounding.order_bound import Model, better
from sparsepop_py.bounding.subproblem import Subproblem
from sparsepop_py.context import SolveContext
from sparsepop_py.local_search.incumbents import update_incumbent
from sparsepop_py.local_search.slp import conflict_prices, row_prices, sequential_search
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.hierarchy import CostModel, Families, RelaxationSpec, progress
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.strategy.adaptive import AdaptiveSearch
from sparsepop_py.strategy.settings import STRATEGY, WORKING_SET
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import BoxProof, Step, Tightening
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["WorkingSetSearch", "suits", "takes_long"]

_NO_PRICE = 1e-9
_FIRST = "first step"  # of each objective on its set, in the record of the sets


def suits(search: AdaptiveSearch) -> bool:
    """Check that a search is worth working sets.

    Few variables have to complicate many constraints, each of them a polynomial that meets few
    others. The star of all has to take a while, or more for each constraint than the linear
    programs that choose a set.
    """
    problem, state = search.context.problem, search.shared_state
    if "working_set" in search.context.options.skip or not state.products.has_star:
        return False
    if len(problem.constraints) < WORKING_SET.least_constraints or problem.squares:
        return False
    if any(c.entries for c in problem.constraints):
        return False
    costly = WORKING_SET.costly_constraint_seconds * len(problem.constraints)
    least = max(costly, WORKING_SET.medium_star_seconds)
    return takes_long(search) or _star_seconds(search) >= least


def takes_long(search: AdaptiveSearch) -> bool:
    """Check that the star relaxation of all constraints is expected to take long.

    To be asked before relaxations are solved: measured seconds replace expected ones.
    """
    return _star_seconds(search) >= WORKING_SET.long_star_seconds


def _star_seconds(search: AdaptiveSearch) -> float:
    """Estimate the seconds of the star relaxation of all constraints, 0 without one."""
    stars = (spec for spec in search.shared_state.specs if spec.shape == "star")
    return next((search.queue.seconds(spec) for spec in stars), 0.0)


@dataclass(eq=False)
class WorkingSetSearch:
    """Search for one objective on a working set of constraints. Mutable.

    Parameters
    ----------
    whole : AdaptiveSearch
        The search on all constraints: it gets what is proved, incumbents and history.
    costs : CostModel
        Seconds and progress of relaxations on working sets: they are far smaller than the whole.
    long : bool
        Whether the star of all constraints was expected to take long before any was solved.
    done : bool
        Whether the whole search has to go on.
    spent : float
        Seconds of all steps so far.
    judged_nodes : int
        Nodes of the tree on the set when its gain was judged last; 0 before.
    judged_gap_ratio : float
        The gap by then, in gaps that count as closed.
    rows : (r,) int or None
        Numbers of the constraints in the set.
    small : Subproblem or None
        The problem of these constraints alone.
    search : AdaptiveSearch or None
        The search on it.
    base : Model or None
        The shared box from which that search began.
    before : (Subproblem, tuple of Step) or None
        A smaller set, and the steps that tightened the box there: the next search begins with them.
    given : Tightening or None
        The last of the steps that the whole search was given.
    """

    whole: AdaptiveSearch
    costs: CostModel
    long: bool = True
    done: bool = False
    spent: float = 0.0
    judged_nodes: int = 0
    judged_gap_ratio: float = np.inf
    rows: NDArray[np.int64] | None = None
    small: Subproblem | None = None
    search: AdaptiveSearch | None = None
    base: Model | None = None
    before: tuple[Subproblem, tuple[Step, ...]] | None = None
    given: Tightening | None = None

    def step(self) -> bool:
        """Take one step on the working set for the whole search.

        Returns
        -------
        bool
            False where no step was taken, as the whole search has to go on.
        """
        if self._whole_first():
            self._hand_over()
            return False
        deadline = self.whole.context.deadline
        start = deadline.now()
        if self.done or not self._ready():
            self.done = True
            self._hand_over()
            return False
        assert self.search is not None
        before = self.search.gap_ratio
        self.search.run(1)
        self._take()
        if not self.spent:
            share, seconds = progress(before, self.search.gap_ratio, 1.0), deadline.now() - start
            self.costs.learn(_FIRST, share, seconds, goes_on=True)
        slow = self._slow(before)
        if not self.whole.over:
            self._grow(slow)
        self.spent += deadline.now() - start
        return True

    def _whole_first(self) -> bool:
        """Check whether the untried star on all constraints costs far less by now.

        A tree on the set is not interrupted.
        """
        if self._nodes:
            return False
        queue = self.whole.queue
        stars = (queue.seconds(spec) for spec in queue.specs if spec.shape == "star")
        return self.spent > WORKING_SET.star_seconds_before_whole * next(stars, np.inf)

    def _hand_over(self) -> None:
        """Give the box that the tree has tightened to the whole search, once."""
        found = self.before
        if self.small is not None and self.search is not None:
            found = self.small, self.search.steps_below
        if found is None:
            return
        small, steps = found
        last = next((step for step in reversed(steps) if isinstance(step, Tightening)), None)
        if last is not self.given:
            self.given = last
            self.whole.adopt(small.restated_steps(steps, self.whole.model.box))

    # ---- the set ------------------------------------------------------------------------------

    @cached_property
    def _held(self) -> NDArray[np.int64]:
        """The complicating variables."""
        return np.array(self.whole.shared_state.products.complicating, np.int64)

    @cached_property
    def _meet(self) -> sps.csr_array:
        """Constraints that share a variable other than those that most of them share, (m, m)."""
        rows = self.whole.context.problem.rows
        row, column = rows.jacobian_places()
        own = ~np.isin(column, self.whole.shared_state.products.shared)
        shape = rows.size, rows.dimension
        meets = sps.csr_array((np.ones(own.sum()), (row[own], column[own])), shape=shape)
        return (meets @ meets.T).tocsr()

    def _near(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Add to constraints those that share a variable with them."""
        mark = np.zeros(self._meet.shape[0])
        mark[rows] = 1.0
        return np.flatnonzero(self._meet @ mark + mark)

    def _ready(self) -> bool:
        """Prepare the search on the current box; False if there is no small set."""
        context = self.whole.context
        if context.best is None:
            return False
        if self.rows is None:
            if self._in_vain:
                return False
            with context.stages.stage("refine"):
                on_box = _on_box(context.problem, self.whole.model.box)
                price = row_prices(on_box, context.best.x, self._held, end=context.deadline.end)
            if not self._set(self._near(_largest(price, WORKING_SET.binding_price))):
                return False
            self._complete(context.best.x)
            if self.done:
                return False
        if self.search is None:
            self._begin()
        elif self.base is not self.whole.shared_model:
            self._restart()
        assert self.search is not None and self.small is not None
        self.search.context = replace(
            self.search.context, best=self._incumbent(), unit=context.unit
        )
        return not (self.search.exhausted or self.search.over)

    @property
    def _in_vain(self) -> bool:
        """Check that other sets gained little, where the star of all is short."""
        return not self.long and self.costs.progress.get(_FIRST, 1.0) < WORKING_SET.least_progress

    def _set(self, rows: NDArray[np.int64]) -> bool:
        """Check that a working set is neither empty nor large, and take it."""
        total = len(self.whole.context.problem.constraints)
        most = WORKING_SET.largest_share if self.long else WORKING_SET.largest_share_short
        if not 0 < rows.size <= most * total:
            return False
        if self.search is not None and self.small is not None:
            self.before = self.small, self.search.steps_below
        self.rows, self.search = rows, None
        self.judged_nodes = 0
        self.small = Subproblem.of(self.whole.context.problem, rows, self._held)
        return True

    @property
    def _nodes(self) -> int:
        """Nodes of the tree on this set, 0 before the first."""
        tree = None if self.search is None else self.search.tree
        return 0 if tree is None else tree.seen

    def _slow(self, gap_ratio: float) -> bool:
        """Check whether a tree gained little; ``gap_ratio`` is that before the step.

        The bound of a node moves with the second of its children: two nodes are judged at a time.
        """
        assert self.search is not None
        new = self._nodes - self.judged_nodes
        if new < 1 or (new == 1 and self.judged_nodes):
            return False
        before = self.judged_gap_ratio if self.judged_nodes else gap_ratio
        self.judged_gap_ratio, self.judged_nodes = self.search.gap_ratio, self._nodes
        return self.judged_gap_ratio > STRATEGY.little_gain_share * before

    def _grow(self, slow: bool) -> None:
        """Add constraints that the last point, or the minimiser near it, contradicts.

        The point of a loose relaxation contradicts many that are not needed: it counts where the
        gap is small, and no tree goes on to close it. Where a tree gains little and none is
        missing, neighbours join: constraints that do not bind make a relaxation tighter, too.
        """
        assert self.search is not None and self.small is not None
        point, self.search.point = self.search.point, None
        best = self.whole.context.best
        if point is not None and best is not None:
            x = self.small.point(point, best.x)
            if self.search.gap_ratio < STRATEGY.small_gap_ratio and (slow or not self._nodes):
                self._joined(x)
            self._complete(x)
        if slow and self.search is not None and not self.whole.over:
            self.done = not self._set(self._wider())

    def _wider(self) -> NDArray[np.int64]:
        """Add neighbours to the set, and theirs, until it is half as large again."""
        assert self.rows is not None
        rows, size = self._near(self._near(self.rows)), 0
        while size < rows.size < WORKING_SET.growth * self.rows.size:
            rows, size = self._near(rows), rows.size
        return rows

    def _complete(self, x: NDArray[np.float64]) -> None:
        """Add constraints until local searches on the set find nothing below the target."""
        for _ in range(WORKING_SET.most_searches):
            if self.small is None or self.done or self.whole.over:
                return
            least = self._minimiser(self.small, x)
            below = self.whole.context.problem.objective(least) < self.whole.context.target
            if not below or not self._joined(least):
                return

    def _minimiser(self, small: Subproblem, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Find a local minimiser on the set, in the variables of the whole problem."""
        context, problem = self.whole.context, small.problem
        held = np.searchsorted(small.variables, self._held)
        on_box = _on_box(problem, small.box(self.whole.model.box))
        with context.stages.stage("refine"):
            start, end = x[small.variables], context.deadline.end
            y = sequential_search(on_box, start, tuple(held.tolist()), end=end)
        return small.point(y, x)

    def _joined(self, x: NDArray[np.float64]) -> bool:
        """Add constraints in conflict at a point, or search an incumbent where there are none."""
        assert self.rows is not None
        context = self.whole.context
        with context.stages.stage("refine"):
            on_box = _on_box(context.problem, self.whole.model.box)
            price = conflict_prices(on_box, x, self._held, context.deadline.end)
        if not price.any():
            self.whole.context, _ = update_incumbent(context, [x], self.whole.bound)
            return False
        price[self.rows] = 0.0
        missing = _largest(price, WORKING_SET.joining_price)
        return bool(missing.size) and self._set(np.union1d(self.rows, self._near(missing)))

    # ---- the search on it ---------------------------------------------------------------------

    def _begin(self) -> None:
        small, whole = self.small, self.whole
        assert small is not None
        problem, context = small.problem, whole.context
        place = np.full(context.problem.dimension, -1, np.int64)
        place[small.variables] = np.arange(small.variables.size)
        branch = context.options.branch_on
        options = replace(
            context.options,
            refine="none",
            branch_on=None
            if branch is None
            else tuple(int(v) for v in place[list(branch)] if v >= 0),
        )
        shared = whole.shared_state
        specs = _from_stars(shared.specs)
        state = replace(
            shared,
            products=Products.of(problem),
            cliques=Families(problem, (), options.sparse, options.chordal),
            variables=tuple(int(place[v]) for v in shared.variables),
            cost_model=self.costs,
            estimates=self._estimates(specs),
            active=None,
            specs=specs,
            obbt_lp=False,  # costs more than a relaxation here, and gains little
        )
        own: SolveContext = replace(
            context, problem=problem, options=options, best=self._incumbent(), repair=None
        )
        longest = WORKING_SET.longest_slice
        self.search = AdaptiveSearch(own, self._model(), [], state, longest_slice=longest)
        if self.before is not None:
            fewer, steps = self.before
            box, self.before = self.search.model.box, None
            self.search.adopt(fewer.within(small).restated_steps(steps, box))

    def _estimates(self, specs: tuple[RelaxationSpec, ...]) -> dict[str, float]:
        """Estimate seconds on the set by its share of those on all constraints.

        These are estimated once for all sets, but not for long records: that would take longer.
        What does not fit in memory there is not tried here.
        """
        assert self.small is not None
        if self.long:
            return {}
        for spec in specs:
            self.whole.queue.seconds(spec)
        problem, known = self.whole.context.problem, self.whole.shared_state.estimates
        share = self.small.rows.size / len(problem.constraints)
        return {spec.name: share * known[spec.name] for spec in specs if spec.name in known}

    def _restart(self) -> None:
        assert self.search is not None
        self.search.restart(self._model())

    def _model(self) -> Model:
        """The shared box, restricted; its proof stands in front when certificates are restated."""
        assert self.small is not None
        self.base = self.whole.shared_model
        return Model(BoxProof(), self.small.box(self.base.box))

    def _incumbent(self) -> ProvedPoint | None:
        """The incumbent's value, for cutoffs: the point is feasible here, too."""
        best, small = self.whole.context.best, self.small
        if best is None or small is None:
            return None
        nothing = np.zeros(0, np.int64)
        return replace(best, x=best.x[small.variables], rows=nothing, solved=nothing)

    def _take(self) -> None:
        """Give the whole search what is proved, restated."""
        small, search, whole, base = self.small, self.search, self.whole, self.base
        assert small is not None and search is not None and base is not None
        certificate = search.outcome.certificate
        if certificate is not None and certificate.bound > whole.bound:
            steps, box = base.proof.steps, base.box
            simpler = search.outcome.simpler
            made = replace(
                search.outcome,
                model=base,
                certificate=small.restated(certificate, steps, box),
                relaxation=None,
                solution=None,
                simpler=None if simpler is None else small.restated(simpler, steps, box),
            )
            whole.outcome = better(whole.outcome, made)
            whole.context.report(whole.bound)
        number = small.rows.size
        for entry in search.history:
            name = f"{entry.name} on {number} constraints"
            whole.history.append(
                replace(entry, name=name, lower_bound=whole.bound, upper_bound=whole.context.upper)
            )
        search.history.clear()


def _from_stars(specs: tuple[RelaxationSpec, ...]) -> tuple[RelaxationSpec, ...]:
    """Leave out what is weaker than a star, and splits, which save little here."""
    star = max((spec.share for spec in specs if spec.shape == "star"), default=0.0)
    return tuple(spec for spec in specs if spec.share >= star and spec.shape != "split")


def _largest(price: NDArray[np.float64], share: float) -> NDArray[np.int64]:
    """List the constraints whose prices are a good share of the largest, without rounding."""
    return np.flatnonzero(price > max(share * price.max(initial=0.0), _NO_PRICE))


def _on_box(problem: Problem, box: Interval) -> Problem:
    """Put a problem on a smaller box."""
    return Problem(problem.objective, problem.constraints, box.lo, box.hi, problem.names)
