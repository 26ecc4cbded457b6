"""Find proved points: the engine begins with them, and intervals reach to them without it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.context import BoundingContext
from setid.bounding.long_records import is_long
from setid.feasible_points.search import coupled, search_ends
from setid.feasible_points.start import first_point
from setid.feasible_points.sums import ends_of_long_record
from setid.formulation.completion import place_slack
from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.lifting import LIFTED
from setid.formulation.units import InUnits
from setid.proofs.existence import proved_point, solved_rows
from sparsepop_py.budget import EARLY, Deadline

__all__ = ["first_points", "points_at_ends", "starts_of_engine"]


def first_points(
    formulation: Formulation, problem: sp.Problem, scaled: InUnits, context: BoundingContext
) -> tuple[NDArray[np.float64] | None, list[sp.ProvedPoint]]:
    """Find a nearly feasible vector, proved where a point was known before all stages.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a box of the parameters.
    scaled : InUnits
        The problem that a point is proved to be consistent with.
    context : BoundingContext

    Returns
    -------
    (n,) float or None
        The vector with the least noise that was found, in the record's units.
    list of sparsepop_py.ProvedPoint
        Near it, in units; empty where none was known before or its proof fails.
    """
    find = partial(first_point, formulation, problem, context.known)
    if context.known is None:
        return context.kept("start", find, None), []
    if context.deadline.stopped:
        return None, []
    try:  # late too: there is a proof already, of a problem without this box and these units
        start = context.timed("start", find)
        return start, [] if start is None else _proved(
            formulation, scaled, [start], context.deadline
        )
    except EARLY as cause:
        context.deadline.ended(cause)
        return None, []


def points_at_ends(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    start: NDArray[np.float64],
    deadline: Deadline,
) -> list[sp.ProvedPoint]:
    """Search for the ends of all parameters, and prove the points that are found.

    Parameters
    ----------
    formulation : Formulation
    problem : sparsepop_py.Problem
        Its problem on a finite box of the parameters, where to search.
    scaled : InUnits
        The problem that the points are proved to be consistent with.
    start : (n,) float
        A nearly feasible vector.
    deadline : Deadline
    """
    if is_long(formulation) and not coupled(formulation):
        found = ends_of_long_record(formulation, problem, start, deadline)
    elif _many_sums(formulation) and not coupled(formulation):
        found = _ends_without_sums(formulation, problem, start)
    else:
        found = search_ends(formulation, problem, start)
    return _proved(formulation, scaled, found, deadline)


def starts_of_engine(
    formulation: Formulation,
    problem: sp.Problem,
    scaled: InUnits,
    start: NDArray[np.float64],
    deadline: Deadline,
) -> tuple[list[sp.ProvedPoint], bool]:
    """Find proved points where the engine would find none.

    Those are ends where rows couple samples or long records have sums of products, and any point
    of another long record, whose equations are solved one after the other for their newest samples.

    Parameters
    ----------
    formulation, problem, scaled, start, deadline
        As of :func:`points_at_ends`.

    Returns
    -------
    list of sparsepop_py.ProvedPoint
    bool
        Whether a search of a long record has gone to all ends, so that the engine need not.
    """
    long, found = is_long(formulation), list[NDArray[np.float64]]()
    if coupled(formulation):
        found = search_ends(formulation, problem, start)
    elif long and formulation.sums:
        found = ends_of_long_record(formulation, problem, start, deadline)
    at_ends = long and bool(found)
    if not found and _many_sums(formulation) and not coupled(formulation):
        found = _ends_without_sums(formulation, problem, start)
    if not found and long:
        found = [start]
    return _proved(formulation, scaled, found, deadline), at_ends


def _proved(
    formulation: Formulation,
    scaled: InUnits,
    found: Iterable[NDArray[np.float64]],
    deadline: Deadline,
) -> list[sp.ProvedPoint]:
    """Keep the vectors that are proved to be consistent in time, as points in units."""
    known, points = solved_rows(formulation, scaled.problem), list[sp.ProvedPoint]()
    try:
        for x in found:
            point = proved_point(formulation, scaled.problem, x / scaled.units, known)
            points += [] if point is None else [point]
    except EARLY as cause:
        if not points:
            raise
        deadline.ended(cause)
    return points


def _many_sums(formulation: Formulation) -> bool:
    """Check for sums of three products or more: local searches that hold their unknowns creep."""
    numbers, rows = formulation.layout.group(LIFTED), formulation.problem.constraints
    pairs = zip(numbers.tolist(), rows, strict=False)
    return any(row.polynomial.terms > 3 for _, row in pairs)


def _ends_without_sums(
    formulation: Formulation, problem: sp.Problem, start: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Search for ends where the sums are no unknowns, and add these."""
    plain = multiplied_out(formulation)
    n, p = plain.layout.dimension, len(plain.parameters)
    lower, upper = plain.problem.lower.copy(), plain.problem.upper.copy()
    lower[:p], upper[:p] = problem.lower[:p], problem.upper[:p]
    about = sp.Problem(plain.problem.objective, plain.problem.constraints, lower, upper)
    found = []
    for end in search_ends(plain, about, start[:n]):
        x = np.append(end, np.zeros(formulation.layout.group(LIFTED).size))
        place_slack(x, formulation, x[:p])
        found.append(x)
    return found
