"""Tighten the box that several objectives share by linear programs, without a cutoff.

With workers, each takes a part of the variables: a round tightens all of them on the same box.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.budget import Deadline
from sparsepop_py.executors.dispatch import workers_of
from sparsepop_py.executors.within_limits import run_on
from sparsepop_py.local_search.slp import violated_rows
from sparsepop_py.options import Options
from sparsepop_py.presolve.initial_box import shrinks
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.shapes import Products
from sparsepop_py.sparsity.correlative import Cliques, find_cliques
from sparsepop_py.strategy.settings import BOUND_TIGHTENING
from sparsepop_py.strategy.shared_state import branching_variables
from sparsepop_py.tightening.mccormick import LinearRelaxation, coordinate_of
from sparsepop_py.tightening.obbt_lp import tighten_bounds
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.propagation import is_empty
from sparsepop_py.verified.certificate.steps import (
    BoxProof,
    Replay,
    Step,
    Tightening,
    tighten,
)

__all__ = ["tighten_for_all"]


def tighten_for_all(
    problem: Problem,
    objectives: Sequence[Polynomial],
    model: Model,
    options: Options,
    deadline: Deadline,
) -> tuple[Model, NDArray[np.bool_] | None]:
    """Tighten the branching variables and the objectives' variables without a cutoff.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    model : Model
        The box and its proof, without cutoffs.
    options : Options
    deadline : Deadline

    Returns
    -------
    model : Model
        The tightened box and its proof.
    active : (m,) bool or None
        Constraints that were enough for these linear programs; None: all.
    """
    if is_empty(model.box):
        return model, None
    products = Products.of(problem, objectives)
    targets = [c[0] for p in objectives if (c := coordinate_of(p)) is not None]
    variables = tuple(dict.fromkeys((*branching_variables(products, options), *targets)))
    if not products.pairs.size or not 0 < len(variables) <= BOUND_TIGHTENING.most_shared_variables:
        return model, None
    return _obbt_rounds(problem, model, variables, options, products, deadline)


def _obbt_rounds(
    problem: Problem,
    model: Model,
    variables: tuple[int, ...],
    options: Options,
    products: Products,
    deadline: Deadline,
) -> tuple[Model, NDArray[np.bool_] | None]:
    """Run rounds of OBBT by linear programs while they gain.

    Where few variables complicate many constraints, the programs start from a sample of the
    constraints (any choice is valid). Constraints that a solution violates whatever the other
    variables are come in before the next round.
    """
    replay = Replay(problem, None)
    cliques = find_cliques(problem, sparse=options.sparse, method=options.chordal)
    held = np.array(products.complicating, np.int64)
    active: NDArray[np.bool_] | None = None
    first = BOUND_TIGHTENING.first_constraints
    if products.has_star and problem.rows.size > first:
        active = np.zeros(problem.rows.size, bool)
        active[np.linspace(0, problem.rows.size - 1, first).astype(int)] = True
    steps, box = list(model.proof.steps), model.box
    for _ in range(
        BOUND_TIGHTENING.shared_rounds if active is None else 2 * BOUND_TIGHTENING.shared_rounds
    ):
        work = _Round(problem, box, cliques, active, held)
        smaller, made, wanted = work.tighten_all(replay, variables, options.executor, deadline)
        if is_empty(smaller):
            break
        gained = False
        if made:
            steps += made
            chosen = list(variables)
            old, new = box.width()[chosen], smaller.width()[chosen]
            gained, box = bool(np.any(new < BOUND_TIGHTENING.repeat_below * old)), smaller
        if active is not None:
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


@dataclass(frozen=True, eq=False)
class _Round:
    """One round of OBBT on a box.

    Parameters
    ----------
    problem : Problem
    box : Interval
    cliques : Cliques
    active : (m,) bool or None
        Constraints that the linear programs have; None: all.
    held : (k,) int
        The complicating variables.
    """

    problem: Problem
    box: Interval
    cliques: Cliques
    active: NDArray[np.bool_] | None
    held: NDArray[np.int64]

    def tighten(
        self, variables: Sequence[int], left: float | None, replay: Replay | None = None
    ) -> tuple[Interval, Tightening | None, NDArray[np.int64]]:
        """Tighten some variables; return box and step, and the rows that solutions violate."""
        replay = replay or Replay(self.problem, None)
        mccormick = LinearRelaxation.of(self.problem, self.box, self.cliques, None, self.active)
        seen: list[NDArray[Any]] = []
        box, step, _ = tighten_bounds(replay, mccormick, self.box, variables, left, seen)
        missing = [np.zeros(0, np.int64)]
        if self.active is not None:
            missing += [violated_rows(self.problem, x, self.held) for x in seen]
        return box, step, np.unique(np.concatenate(missing))

    def tighten_all(
        self,
        replay: Replay,
        variables: Sequence[int],
        executor: Executor | None,
        deadline: Deadline,
    ) -> tuple[Interval, list[Step], NDArray[np.int64]]:
        """Tighten all variables, each worker of an executor a part of them."""
        count = 1 if deadline.counts_work else max(1, workers_of(executor))
        parts = [variables[k::count] for k in range(min(count, len(variables)))]
        if executor is None or len(parts) == 1:
            found = [self.tighten(variables, deadline.left, replay)]
        else:
            tasks = [(self, part, deadline.left) for part in parts]
            answers, _ = run_on(executor, _Round.tighten, tasks, deadline)
            found = [each for each in answers if each is not None]
        box = self.box
        for smaller, _, _ in found:
            box = box.intersect(smaller)
        wanted = [np.zeros(0, np.int64), *(rows for _, _, rows in found)]
        steps: list[Step] = [step for _, step, _ in found if step is not None]
        return box, steps, np.unique(np.concatenate(wanted))
