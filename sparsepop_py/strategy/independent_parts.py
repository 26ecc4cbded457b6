"""Bound several objectives over a feasible set that is a product of independent sets.

Constraints that share no variable, neither directly nor through others, part a problem: the
outputs of a system whose inputs are known, for one. An objective in variables of one part is
bounded on that part alone. The other parts decide nothing but whether there is a feasible point:
a bound holds whatever they are, and a feasible point is put together from one of each.

Certificates of the parts are restated for the whole problem, and verified there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sps
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.bounding.order_bound import Model
from sparsepop_py.bounding.subproblem import Restatement, Subproblem
from sparsepop_py.problem.problem import Problem
from sparsepop_py.strategy.multi_objective import MultiObjectiveSearch
from sparsepop_py.strategy.search_state import SearchState
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.certificate.steps import BoxProof
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["Part", "independent_parts", "search_parts"]

Kind = Literal["exact", "krawczyk", "substitution"]
_PROOFS: tuple[Kind, ...] = get_args(Kind)  # a point has the last one of those of its parts


@dataclass(frozen=True, eq=False)
class Part:
    """Some constraints of a problem, and the objectives in their variables.

    Parameters
    ----------
    small : Subproblem
        On a box within the bounds of the whole.
    numbers : list of int
        Of the objectives.
    objectives : list of Polynomial
        The same in the variables of the part.
    """

    small: Subproblem
    numbers: list[int]
    objectives: list[Polynomial]


def independent_parts(
    problem: Problem, objectives: Sequence[Polynomial], box: Interval
) -> list[Part]:
    """Split a problem; into nothing where a part has no objective.

    Parameters
    ----------
    problem : Problem
    objectives : sequence of Polynomial
    box : Interval
        Of the parts: within the bounds of the problem.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y, z = sp.variables(3)
    >>> apart = sp.Problem(x, [x * y >= 1, z**2 <= 2], lower=0, upper=4)
    >>> box = Interval(apart.lower, apart.upper)
    >>> [part.numbers for part in independent_parts(apart, [x, z, y], box)]
    [[0, 2], [1]]
    """
    n, rows = problem.dimension, problem.rows
    if problem.squares or any(c.entries for c in problem.constraints):
        return []
    row, column = rows.jacobian_places()
    edges = sps.csr_array((np.ones(row.size), (n + row, column)), shape=(n + rows.size,) * 2)
    label = connected_components(edges, directed=False)[1]
    labels = [np.unique(label[objective.support]) for objective in objectives]
    if any(found.size != 1 for found in labels):
        return []
    asked = list(dict.fromkeys(int(found[0]) for found in labels))
    if len(asked) < 2 or set(asked) != set(label[n:].tolist()):
        return []
    parts = []
    for number in asked:
        small = Subproblem.of(
            problem.with_objective(0.0 * objectives[0]),
            np.flatnonzero(label[n:] == number),
            np.flatnonzero(label[:n] == number),
        )
        bounds = small.box(box)
        own = [place for place, found in enumerate(labels) if found[0] == number]
        stated = [small.fewer(objectives[place]) for place in own]
        on_box = Problem(stated[0], small.problem.constraints, bounds.lo, bounds.hi)
        parts.append(Part(replace(small, whole=problem, problem=on_box), own, stated))
    return parts


def search_parts(
    parts: Sequence[Part], whole: MultiObjectiveSearch
) -> tuple[list[SearchState], dict[Any, Any]]:
    """Search part by part, each with its share of the time that is left.

    Parameters
    ----------
    parts : sequence of Part
    whole : MultiObjectiveSearch
        The search over all of them, not begun.

    Returns
    -------
    states : list of SearchState
        One for each objective, about the whole problem.
    known : dict
        For verifications to come.
    """
    found: dict[int, SearchState] = {}
    for place, part in enumerate(parts):
        last = place == len(parts) - 1
        deadline = whole.deadline if last else whole.deadline.part(1.0 / (len(parts) - place))
        search = _search_of(part, replace(whole, deadline=deadline))
        found |= zip(part.numbers, search.run(), strict=True)
        whole.deadline.cut |= deadline.cut or not (last or search.closed)
    bests = [[found[number].context.best for number in part.numbers] for part in parts]
    rests = [next((best for best in own if best is not None), None) for own in bests]
    states: dict[int, SearchState] = {}
    for place, part in enumerate(parts):
        restatement = Restatement(part.small, whole.model.proof.steps, whole.model.box)
        for number in part.numbers:
            own = found[number].context.best
            points = [own if k == place else rest for k, rest in enumerate(rests)]
            about = whole.problem.with_objective(whole.objectives[number])
            best = _joined(parts, points)
            best = None if best is None else best.recheck(about)
            states[number] = _restated(found[number], about, best, whole, restatement)
    return [states[number] for number in range(len(states))], {}


def _search_of(part: Part, whole: MultiObjectiveSearch) -> MultiObjectiveSearch:
    """Prepare the search over one part, from the same starts and points."""
    small, branch = part.small, whole.options.branch_on
    kept = None if branch is None else tuple(small.places(branch))
    start = whole.starts[0] if whole.starts else whole.model.box.middle()
    points = (_point_in(small, point) for point in whole.points)
    return MultiObjectiveSearch(
        small.problem,
        part.objectives,
        replace(whole.options, branch_on=kept),
        Model(BoxProof(), Interval(small.problem.lower, small.problem.upper)),
        [x[small.variables] for x in whole.starts],
        whole.stages,
        whole.deadline,
        repair=None if whole.repair is None else _RepairOfPart(whole.repair, small, start),
        points=[point for point in points if point is not None],
        numbers=part.numbers,
    )


@dataclass(frozen=True, eq=False)
class _RepairOfPart:
    """Repairs vectors of a part: the others stay as in a start."""

    repair: Callable[[NDArray[Any]], NDArray[Any]]
    small: Subproblem
    start: NDArray[np.float64]

    def __call__(self, x: NDArray[Any]) -> NDArray[Any]:
        """Repair a vector (v,)."""
        return np.asarray(self.repair(self.small.point(x, self.start)))[self.small.variables]


def _point_in(small: Subproblem, point: ProvedPoint) -> ProvedPoint | None:
    """Restrict a feasible point of the whole problem to a part."""
    kept = np.isin(point.rows, small.rows)
    rows = np.searchsorted(small.rows, point.rows[kept])
    solved = np.searchsorted(small.variables, point.solved[kept])
    mine = replace(point, x=point.x[small.variables], rows=rows, solved=solved)
    return mine.recheck(small.problem)


def _joined(parts: Sequence[Part], points: Sequence[ProvedPoint | None]) -> ProvedPoint | None:
    """Put a point together from those of the parts; None where one has none."""
    whole = parts[0].small.whole
    x, proof = np.clip(np.zeros(whole.dimension), whole.lower, whole.upper), 0
    rows, solved = [], []
    for part, point in zip(parts, points, strict=True):
        if point is None:
            return None
        x = part.small.point(point.x, x)
        rows.append(part.small.rows[point.rows])
        solved.append(part.small.variables[point.solved])
        proof = max(proof, _PROOFS.index(point.proof))
    places = np.concatenate(rows), np.concatenate(solved)
    return ProvedPoint(x, np.inf, 0.0, _PROOFS[proof], *places)


def _restated(
    state: SearchState,
    about: Problem,
    best: ProvedPoint | None,
    whole: MultiObjectiveSearch,
    restatement: Restatement,
) -> SearchState:
    """Restate what was found of an objective on its part for the whole problem."""
    outcome = state.outcome
    proofs = [
        None if proof is None else restatement.certificate(proof, about)
        for proof in (outcome.certificate, outcome.simpler)
    ]
    outcome = replace(
        outcome,
        model=whole.model,
        certificate=proofs[0],
        simpler=proofs[1],
        relaxation=None,
        solution=None,
    )
    context = replace(state.context, problem=about, options=whole.options, best=best, repair=None)
    return SearchState(context, outcome, [], state.history, state.notes)
