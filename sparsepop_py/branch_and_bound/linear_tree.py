"""Branch and bound by linear programs alone, for small problems of degree 2.

One model of HiGHS serves all nodes: its numbers change, its pattern and basis stay. A node
propagates its rows, solves one linear program, tightens its box by reduced costs and branches.
The search works in plain doubles on arrays. What it keeps of a node is a step or an argument of
the certificate language, so that the finished tree is a certificate, whose bound the trusted
kernel computes once, at the end.

References
----------
H. S. Ryoo, N. V. Sahinidis, A branch-and-reduce approach to global optimization, J. Global
Optim. 8, 1996 (reduced costs).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray

from sparsepop_py.branch_and_bound.float_propagation import FloatPropagation
from sparsepop_py.branch_and_bound.open_node import OpenNode, branching_point, certificate_node
from sparsepop_py.branch_and_bound.product_model import LinearData, ProductModel, SquareCut
from sparsepop_py.branch_and_bound.settings import LINEAR_TREE
from sparsepop_py.budget import check, spend, spent
from sparsepop_py.context import SolveContext
from sparsepop_py.lp.highs import LinearModel, LinearSolution
from sparsepop_py.presolve.initial_box import rounding_slack
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.solvers.quadratic import minimise_on_box
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.steps import BoxProof, Propagation, Tightening

__all__ = ["LinearTree", "convex_minimiser", "suits_linear_tree"]

Floats = NDArray[np.float64]


def suits_linear_tree(problem: Problem) -> bool:
    """Check for a small problem of degree 1 or 2 without matrices.

    It may be larger where branches decide all that is not convex.
    """
    if problem.degree > 2 or problem.matrices.constraints.size:
        return False
    n, m = problem.dimension, len(problem.constraints)
    if n <= LINEAR_TREE.most_variables and m <= LINEAR_TREE.most_constraints:
        return True
    larger = LINEAR_TREE.larger
    if n > larger * LINEAR_TREE.most_variables or m > larger * LINEAR_TREE.most_constraints:
        return False
    model = ProductModel.of(problem)
    few = model.columns <= LINEAR_TREE.most_columns
    return model.disjunctive or (few and model.convex_but_values)


def convex_minimiser(model: ProductModel, data: LinearData) -> Floats | None:
    """Minimise a convex objective over the linear relaxation on a box.

    Parameters
    ----------
    model : ProductModel
    data : LinearData
        Its numbers on the box.

    Returns
    -------
    (N,) float or None
        The columns at the minimiser; None where the objective is not convex or the solver fails.
    """
    n = model.dimension
    cut = model.cut(model.rows, np.zeros(n))
    if cut is None:
        return None
    spend(LINEAR_TREE.quadratic_work)
    _, slope = cut.scaled(data.scaling)
    spread = np.zeros((slope.shape[0], model.columns))
    spread[:, cut.variables] = slope / np.sqrt(data.size)
    linear = data.cost.copy()
    linear[n:] = 0.0
    kept = model.rows + 1 + model.envelopes
    rows = model.matrix(data.values)[:kept], data.low[:kept], data.free[:kept]
    hessian = sps.csc_array(2.0 * spread.T @ spread)
    return minimise_on_box(hessian, linear, rows, (model.least, np.ones(model.columns)))


@dataclass(eq=False)
class _Open(OpenNode):
    """A node with its box and bound. Mutable."""

    low: Floats
    high: Floats
    bound: float = -np.inf


@dataclass(frozen=True, eq=False)
class _Program:
    """The linear program of a node, with its solution and what it seems to prove.

    Parameters
    ----------
    data : LinearData
    price : (R,) float
        Dual prices of its rows.
    rest : (N,) float
        Reduced costs of its columns.
    bound : float
        Of the objective on the box, not proved; infinite where the program has no point.
    t : (N,) float or None
        The solution in scaled columns; None where there is none.
    empty : bool
        Whether a ray shows that the box holds no point below the cutoff.
    """

    data: LinearData
    price: Floats
    rest: Floats
    bound: float
    t: Floats | None
    empty: bool = False

    @property
    def point(self) -> Floats:
        """The solution in the variables of the problem, shape (n,)."""
        assert self.t is not None
        scaling = self.data.scaling
        return scaling.point(np.clip(self.t[: scaling.centre.size], -1.0, 1.0))


@dataclass(eq=False)
class LinearTree:
    """Search tree whose nodes are bounded by linear programs. Mutable.

    Parameters
    ----------
    context : SolveContext
        Its incumbent improves while the search runs.
    box : Interval
        The box of the root, with finite ends.
    search_incumbent : callable
        Given a context, candidate vectors, whether a proof of these is enough, without a search
        from them, and a bound: the context with a better incumbent if one is proved.
    variables : (k,) int, optional
        Branching variables. When left out: those of two values where all else is convex, otherwise
        those in products.
    nodes : int
        Nodes that were processed.
    search_work : float
        Units of work that local searches took, see :mod:`sparsepop_py.budget`.
    root : node
        The node of the whole box.
    """

    context: SolveContext
    box: Interval
    search_incumbent: Callable[[SolveContext, list[NDArray[Any]], bool, float], SolveContext]
    variables: NDArray[np.int64] | None = None
    nodes: int = 0
    search_work: float = 0.0
    root: _Open = field(init=False)
    _heap: list[tuple[float, int, _Open]] = field(default_factory=list)
    _least: float = np.inf
    _fathomed: float = 0.0
    _obbt_rounds: int = 0
    _searched: bool = False
    _point: Floats | None = None
    _highs: LinearModel | None = None

    def __post_init__(self) -> None:
        self.model = ProductModel.of(self.context.problem)
        self.propagation = FloatPropagation(self.model)
        self.root = _Open(self.box.lo.copy(), self.box.hi.copy())
        if self.variables is None:
            convex = self.model.convex_but_values
            self.variables = self.model.two_valued if convex else self.model.factors
        self._preference = np.full(self.model.dimension, LINEAR_TREE.others)
        products = Products.of(self.context.problem)
        self._preference[list(products.complicating)] = 1.0
        self._begin = spent()
        self._branches = np.zeros(self.model.dimension, bool)
        self._branches[self.variables] = True
        pairs = self.model.complementary
        self._pairs = pairs[np.all(self.box.lo[pairs] >= 0, axis=1)]
        found = self.model.complements
        known = self.box.lo[found.variable] >= 0
        self._factors, self._rows = found.variable[known], found.inequality[known]
        self._width = np.maximum(self.box.width(), 1e-300)
        if self._decides:  # it may last until time is over, and its proof takes time, too
            deadline = self.context.deadline.part(LINEAR_TREE.time_share)
            self.context = replace(self.context, deadline=deadline)

    # ---- the search ---------------------------------------------------------------------------

    @property
    def tree_cutoff(self) -> float:
        """The cutoff, a little below the attained value; +inf without an incumbent."""
        cutoff = self.context.at_cutoff(below=True).cutoff
        return np.inf if cutoff is None else cutoff

    @property
    def goal(self) -> float:
        """A bound that fathoms a node: the cutoff and a margin for rounding."""
        return self.tree_cutoff + LINEAR_TREE.margin * self.context.allowed

    @property
    def closed(self) -> bool:
        """True if every leaf is fathomed."""
        return self.bound >= self.goal

    @property
    def bound(self) -> float:
        """Least bound of open nodes and leaves, as the search estimates it."""
        return min(self._heap[0][0] if self._heap else np.inf, self._least)

    def run(self) -> bool:
        """Search until all nodes are fathomed or it no longer pays; return whether they are.

        Returns
        -------
        bool
        """
        self._process(self.root)
        first = self.bound
        while self._heap and not self.closed and not self.context.deadline.over:
            check()
            if self._stalls(first):
                return False
            self._process(heapq.heappop(self._heap)[2])
        return self.closed

    @cached_property
    def _decides(self) -> bool:
        """True if branches decide all that is not convex: values, or zero factors."""
        if self.model.convex_but_values:
            return bool(np.all(self._branches[self.model.two_valued]))
        found = self._pairs.shape[0] + self._factors.size
        every = self.model.complementary.shape[0] + self.model.complements.variable.size
        return found == every and self.model.disjunctive

    @property
    def _most_nodes(self) -> int:
        """Nodes that the tree may have: fewer where programs are larger.

        Where every branch decides a value, or which factor of a product is zero, it is finite.
        """
        if self._decides:
            return LINEAR_TREE.most_decisions
        return min(LINEAR_TREE.most_nodes, LINEAR_TREE.most_columns // self.model.columns + 1)

    def _stalls(self, first: float) -> bool:
        """Check whether the gap shrinks too slowly for a small tree."""
        if self.nodes >= self._most_nodes or self._least < self.goal:
            return True
        if self._decides or self.nodes < min(LINEAR_TREE.patience, self._most_nodes):
            return False
        whole = self.goal - first
        gained = (self.bound - first) / whole if 0 < whole < np.inf else 0.0
        share = self.nodes / self._most_nodes
        return max(gained, self._fathomed) < LINEAR_TREE.pace * share

    def _process(self, node: _Open) -> None:
        """Propagate, bound and tighten a node; branch it if it stays open."""
        self.nodes += 1
        spend(LINEAR_TREE.node_work)
        program: _Program | None = None
        self._searched = False
        rounds = LINEAR_TREE.root_rounds if node is self.root else LINEAR_TREE.rounds
        for number in range(rounds):
            self._propagate(node)
            program = self._solve(node) if node.bound < np.inf else None
            if program is None or program.t is None or node.bound >= self.goal:
                break
            if not self._improve(node, program, number):
                break
        if node.bound >= self.goal:
            self._fathom(node)
        else:
            self._branch(node, program)

    def _improve(self, node: _Open, program: _Program, number: int) -> bool:
        """Add cuts, search points and tighten the box; return whether another round may gain."""
        new = self._cut(node, program, number)
        self._search_minimiser(node)
        if new:
            return node.bound < self.goal
        if self._promises(program.point):
            self._search(program.point, node)
        elif number == LINEAR_TREE.search_round and self._worth_a_search():
            self._search(program.point, node)  # tightening goes on with a better cutoff
        if node.bound >= self.goal:
            return False
        if self._reduce(node, program) or self._tighten(node, program):
            return True
        if not self._worth_a_search():
            return False
        upper = self.context.upper
        self._search(program.point, node)
        return node.bound < self.goal and self.context.upper < upper

    def _fathom(self, node: _Open) -> None:
        """Record a leaf, and its share of the tree: a half of its parent's."""
        self._least = min(self._least, node.bound)
        self._fathomed += 0.5**node.depth

    def _propagate(self, node: _Open) -> None:
        """Propagate the rows of a node; keep the step where a width shrinks by enough."""
        most = LINEAR_TREE.root_sweeps if node is self.root else LINEAR_TREE.sweeps
        cutoff = self.tree_cutoff
        low, high, count, empty = self.propagation.sweeps(node.low, node.high, cutoff, most)
        step = Propagation(count, cutoff < np.inf)
        if empty:
            node.steps.append(step)
            node.bound, node.argument, node.empty = np.inf, None, True
        elif np.any(high - low < LINEAR_TREE.worth * (node.high - node.low)):
            node.steps.append(step)
            node.low, node.high = low, high

    def _solve(self, node: _Open) -> _Program | None:
        """Solve the linear program of a node; keep its argument where it proves more."""
        data = self._data(node)
        found = self._highs_of(data).solve(data.cost, self.context.deadline.left)
        if found.status == "infeasible":
            program = self._farkas(data, found)
        elif found.status == "solved":
            price = self.model.signed(data, found.dual)
            rest = self.model.rest(data, data.cost, price)
            bound = data.constant + self.model.bound(data, rest, price)
            program = _Program(data, price, rest, data.size * bound, found.x)
        else:
            return None
        if program.bound > node.bound:
            size = 1.0 if program.empty else data.size
            if self.model.uses_cuts(program.price):
                node.argument = self.model.identity(data, program.price, size)
            else:
                node.argument = self.model.dual(data, [program.price], [size])
            node.bound, node.empty = program.bound, program.empty
        return program

    def _cut(self, node: _Open, program: _Program, number: int) -> bool:
        """Add cuts of convex rows that the solution of a node violates.

        The oldest make room where all but values is convex. Elsewhere a tree that has filled the
        room is given up soon.
        """
        model, most = self.model, LINEAR_TREE.cut_rounds if node is self.root else 1
        room = len(model.cuts) < LINEAR_TREE.most_cuts or model.convex_but_values
        if program.t is None or number >= most or not model.convex or not room:
            return False
        own = program.point
        made = [
            model.cut(row, self._minimiser(program, number) if row == model.rows else own)
            for row in model.convex
        ]
        new = tuple(cut for cut in made if cut is not None and self._violates(cut, program))
        if new:
            self.model = model.with_cuts((*model.cuts, *new)[-LINEAR_TREE.most_cuts :])
        return bool(new)

    def _minimiser(self, program: _Program, number: int) -> Floats:
        """Minimise a convex objective over the rows of a node.

        Where that fails, take the incumbent in the first round, then the solution.
        """
        model, data = self.model, program.data
        assert program.t is not None
        n, point = model.dimension, program.t
        found = convex_minimiser(model, data)
        best = self.context.best
        if found is None and number == 0 and best is not None:
            return best.x
        if found is not None:
            point = found
        minimiser = data.scaling.point(np.clip(point[:n], -1.0, 1.0))
        self._point = minimiser if found is not None else None
        return minimiser

    def _search_minimiser(self, node: _Open) -> None:
        """Start a local search from a convex program's minimiser that promises a gain."""
        point, self._point = self._point, None
        if point is not None and self._promises(point):
            self._search(point, node)

    def _violates(self, cut: SquareCut, program: _Program) -> bool:
        """Check whether a solution violates a cut by more than rounding."""
        assert program.t is not None
        row, right = cut.row(program.data.scaling)
        value = row @ program.t[np.append(cut.columns, cut.variables)]
        return bool(value < right - 1e-7 * np.abs(row).max(initial=0.0))

    def _farkas(self, data: LinearData, found: LinearSolution) -> _Program:
        """Take the ray of an infeasible program with the sign that proves more."""
        best = _Program(data, np.zeros(data.low.size), data.cost * 0.0, -np.inf, None)
        for ray in (found.dual, -found.dual):
            price = self.model.signed(data, ray)
            largest = np.abs(price).max(initial=0.0)
            if largest == 0:
                continue
            price = price / largest
            rest = self.model.rest(data, np.zeros(self.model.columns), price)
            if self.model.bound(data, rest, price) > LINEAR_TREE.infeasible:
                return _Program(data, price, rest, np.inf, None, True)
        return best

    def _data(self, node: _Open) -> LinearData:
        box = Interval(node.low, node.high)
        return self.model.on_box(Scaling.of_box(box, slack=rounding_slack(box, self.box)))

    def _highs_of(self, data: LinearData, cutoff: float = np.inf) -> LinearModel:
        """Load the program of a box, with the cutoff row where a cutoff is given."""
        high = self.model.high(data)
        high[self.model.rows] = cutoff / data.size - data.constant
        rows, columns = (data.low, high), (self.model.least, np.ones(self.model.columns))
        matrix = self.model.sparse_rows(data.values)
        if self._highs is None:
            self._highs = LinearModel(matrix, rows, columns)
        else:
            self._highs.load(matrix, rows, columns)
        return self._highs

    # ---- points -------------------------------------------------------------------------------

    def _worth_a_search(self) -> bool:
        """Decide on a local search at this node; one search costs more than many nodes."""
        if self._searched or self.search_work > LINEAR_TREE.search_share * (spent() - self._begin):
            return False
        self._searched = self.nodes in LINEAR_TREE.searched  # once a node
        return self._searched

    def _promises(self, point: Floats) -> bool:
        """Check for a point that is nearly feasible and better than the incumbent."""
        gain = self.context.upper - self.context.problem.objective(point)
        if gain <= LINEAR_TREE.worth_a_search * self.context.allowed:
            return False
        return self.context.problem.violation(point) <= LINEAR_TREE.feasible

    def _search(self, point: Floats, node: _Open) -> None:
        before, upper = spent(), self.context.upper
        bound = min(self.bound, node.bound)
        if self._promises(point):
            self.context = self.search_incumbent(self.context, [point], True, bound)
        if self.context.upper == upper:
            self.context = self.search_incumbent(self.context, [point], False, bound)
        self.search_work += spent() - before

    # ---- bounds of variables ------------------------------------------------------------------

    def _reduce(self, node: _Open, program: _Program) -> bool:
        """Tighten bounds by reduced costs; return whether one moved by much.

        From cutoff >= f >= bound + r (t + 1) with a reduced cost r > 0 follows
        t <= -1 + (cutoff - bound) / r.
        """
        data, cutoff = program.data, self.tree_cutoff
        if not program.bound < cutoff < np.inf or self.model.uses_cuts(program.price):
            return False
        n = self.model.dimension
        rest, room = program.rest[:n], (cutoff - program.bound) / data.size
        with np.errstate(divide="ignore"):
            reach = room / np.abs(rest)
        wide = node.high - node.low
        gains = (reach < 2.0 * LINEAR_TREE.gained) & (wide > 1e-9 * self._width)
        gains &= self._branches
        chosen = np.flatnonzero(gains)
        if not chosen.size:
            return False
        weight = 1.0 / np.abs(rest[chosen])
        prices = [program.price * w for w in weight]
        dual = self.model.dual(data, prices, data.scaling.scale[chosen], weight / data.size)
        side = np.where(rest[chosen] > 0, -1, 1)
        self._take(node, data, chosen, side, 1.0 - reach[chosen], dual)
        return bool(np.any(reach[chosen] < 2.0 * LINEAR_TREE.again))

    def _tighten(self, node: _Open, program: _Program) -> bool:
        """Tighten bounds of the root by linear programs (OBBT) where reduced costs do not."""
        assert self.variables is not None
        open_ = [v for v in self.variables.tolist() if node.high[v] > node.low[v]]
        few = len(open_) <= LINEAR_TREE.most_tightened
        if node is not self.root or not few or self._obbt_rounds >= LINEAR_TREE.obbt_rounds:
            return False
        self._obbt_rounds += 1
        data, cutoff = program.data, self.tree_cutoff
        highs = self._highs_of(data, cutoff)
        points = [program.t] if program.t is not None else []
        chosen, sides, values, prices, weights = [], [], [], [], []
        for v, side in ((v, side) for v in open_ for side in (1, -1)):
            if any(side * t[v] <= -1.0 + LINEAR_TREE.touched for t in points):
                continue
            cost = np.zeros(self.model.columns)
            cost[v] = side
            found = highs.solve(cost, self.context.deadline.left)
            if found.status != "solved":
                continue
            points.append(found.x)
            if self.model.uses_cuts(self.model.signed(data, found.dual)):
                continue
            price, weight = (
                self.model.signed(data, found.dual),
                max(0.0, -found.dual[self.model.rows]),
            )
            rest = self.model.rest(data, cost + weight * data.cost, price)
            value = self.model.bound(data, rest, price)
            if weight:
                value -= weight * (cutoff / data.size - data.constant)
            if value > -1.0 + 2.0 * LINEAR_TREE.least_gain:
                chosen.append(v)
                sides.append(side)
                values.append(value)
                prices.append(price)
                weights.append(weight / data.size)
        if not chosen:
            return False
        variable = np.array(chosen, np.int64)
        scale = data.scaling.scale[variable]
        row = weights if cutoff < np.inf else None
        dual = self.model.dual(data, prices, scale, row)
        old = node.high - node.low
        self._take(node, data, variable, np.array(sides), np.array(values), dual)
        return bool(np.any(node.high - node.low < LINEAR_TREE.obbt_again * old))

    def _take(
        self,
        node: _Open,
        data: LinearData,
        variable: NDArray[np.int64],
        side: NDArray[np.int64],
        value: Floats,
        dual: LinearDual,
    ) -> None:
        """Tighten a box by side * t_v >= value, less a margin for rounding."""
        scaling = data.scaling
        value = np.maximum(value - LINEAR_TREE.slack, -1.0)
        claim = side * scaling.centre[variable] + scaling.scale[variable] * value
        claim -= 1e-14 * np.abs(claim)
        uses = self.tree_cutoff < np.inf
        node.steps.append(Tightening(variable, side.astype(np.int64), claim, dual, uses))
        low, high = node.low.copy(), node.high.copy()
        up = side > 0
        np.maximum.at(low, variable[up], claim[up])
        np.minimum.at(high, variable[~up], -claim[~up])
        middle = 0.5 * (low + high)
        crossed = low > high
        node.low, node.high = np.where(crossed, middle, low), np.where(crossed, middle, high)

    # ---- branching ----------------------------------------------------------------------------

    def _branch(self, node: _Open, program: _Program | None) -> None:
        """Split an open node in two; one that is too small stays as it is."""
        assert self.variables is not None
        chosen = self.variables
        width = (node.high - node.low)[chosen]
        relative = width / self._width[chosen]
        score = relative.copy()
        if program is not None and program.t is not None:
            score = (self._errors(program)[chosen] + 1e-9) * np.sqrt(relative)
            score *= self._preference[chosen]
        score = np.where(width > 1e-8 * (1.0 + np.abs(node.low[chosen])), score, -1.0)
        if not chosen.size or score.max() < 0:
            self._least = min(self._least, node.bound)
            return
        pair = self._apart(node, program)
        if pair is not None:
            self._separate(node, pair)
            return
        v = self._undecided(node, program)
        v = int(chosen[np.argmax(score)]) if v is None else v
        value = None
        if program is not None and program.t is not None:
            scaling = program.data.scaling
            value = float(scaling.centre[v] + scaling.scale[v] * program.t[v])
        ends = float(node.low[v]), float(node.high[v])
        self._split(node, v, branching_point(ends, value, LINEAR_TREE.middle, LINEAR_TREE.edge))

    def _split(self, node: _Open, v: int, point: float) -> None:
        """Split a node at a point of a variable, and queue both halves."""
        left, right = node.high.copy(), node.low.copy()
        left[v] = right[v] = point
        children = [(node.low.copy(), left), (right, node.high.copy())]
        node.branch = v, point
        node.children = tuple(
            _Open(a, b, node.bound, depth=node.depth + 1, argument=node.argument)
            for a, b in children
        )
        for number, child in enumerate(node.children):
            heapq.heappush(self._heap, (child.bound, 2 * self.nodes + number, child))

    def _apart(self, node: _Open, program: _Program | None) -> tuple[int, int] | None:
        """Find the factors that are farthest from zero though their product is zero, if far.

        The second is a variable, or -1 where it is a row.
        """
        none = not self._pairs.size and not self._factors.size
        if none or program is None or program.t is None:
            return None
        x, data = program.point, program.data
        first, second = np.append(self._pairs[:, 0], self._factors), self._pairs[:, 1]
        height = self._heights(data, program.t)
        other = np.append(x[second] / self._width[second], height)
        open_ = (node.low[first] <= 0) & (node.high[first] > LINEAR_TREE.zero * self._width[first])
        open_ &= x[first] > LINEAR_TREE.apart * node.high[first]
        open_ &= other > LINEAR_TREE.apart
        far = np.where(open_, np.minimum(x[first] / self._width[first], other), 0.0)
        place = int(np.argmax(far))
        if not far[place] > 0:
            return None
        return int(first[place]), int(second[place]) if place < second.size else -1

    def _heights(self, data: LinearData, t: Floats) -> Floats:
        """Values of the rows that are factors, relative to the sum of their terms' sizes."""
        rows = self._rows
        matrix = self.model.matrix(data.values)[rows]
        size = np.abs(matrix).sum(axis=1)
        return np.asarray((matrix @ t - data.low[rows]) / np.maximum(size, 1e-300))

    def _separate(self, node: _Open, pair: tuple[int, int]) -> None:
        """Split a node where the first of two complementary factors is zero, or not.

        Not quite zero: a variable is zero by propagation wherever the other is positive. A row is
        an equation in the linear program there, whose proof divides by the least value of the
        variable; that must not be too small, so that zero is approached in steps.
        """
        first, second = pair
        if second < 0:
            self._split(node, first, LINEAR_TREE.step * float(node.high[first]))
            return
        self._split(node, first, LINEAR_TREE.positive)
        positive = node.children[1]
        positive.high[second] = 0.0
        positive.steps.append(Propagation(1, False))

    def _undecided(self, node: _Open, program: _Program | None) -> int | None:
        """Find the variable of two values that is farthest from both, if far."""
        assert self.variables is not None
        v = np.intersect1d(self.model.two_valued, self.variables)
        if not v.size or program is None or program.t is None:
            return None
        width = node.high[v] - node.low[v]
        point = program.point[v]
        far = np.minimum(point - node.low[v], node.high[v] - point)
        far = np.where(width > 0.5 * self._width[v], far / np.maximum(width, 1e-300), 0.0)
        place = int(np.argmax(far))
        return int(v[place]) if far[place] > LINEAR_TREE.undecided else None

    def _errors(self, program: _Program) -> Floats:
        """Errors of products at the solution, weighted by prices, summed by variable."""
        model, t = self.model, program.t
        assert t is not None
        n, i, j = model.dimension, model.first, model.second
        error = np.abs(t[n:] - t[i] * t[j])
        price = np.abs(program.price)
        price[model.rows :] = 0.0
        weight = model.combined(np.abs(program.data.values), price) + np.abs(program.data.cost)
        error *= weight[n:]
        total: Floats = np.bincount(i, error, minlength=n).astype(float)
        return total + np.bincount(j, error * (i != j), minlength=n)

    # ---- the certificate ----------------------------------------------------------------------

    def certificate(self, proof: BoxProof) -> Certificate | None:
        """Build the certificate of the tree; its claim is an estimate, to be verified.

        Open nodes are leaves with the argument of their parent.

        Parameters
        ----------
        proof : BoxProof
            Steps from the problem's bounds to the box of the root.

        Returns
        -------
        Certificate or None
            None where nothing is expected to be proved.
        """
        root = certificate_node(self.root)
        root = replace(root, box=BoxProof((*proof.steps, *root.box.steps)))
        uses = any(node.box.uses_cutoff for node in root)
        cutoff = self.tree_cutoff if uses else None
        bound = self.bound if cutoff is None else min(self.bound, cutoff)
        if bound == -np.inf:
            return None
        return Certificate(self.context.problem.fingerprint, bound, root, cutoff)
