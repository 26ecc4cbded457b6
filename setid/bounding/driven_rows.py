"""Bound the parameters of several denominators where the data bound no offset of the output.

Rows with an offset of the equation bound all parameters but that. What they prove is the box of the
problem asked for, and the points that attain their ends, with the offset of the output, are
consistent there too. The engine has to close the ends of offsets alone, where these are finite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.attained import best_results
from setid.bounding.context import BoundingContext
from setid.bounding.ends import intervals_of
from setid.bounding.engine import by_engine
from setid.bounding.starts import first_points
from setid.feasible_points.start import with_offsets
from setid.formulation.completion import place_slack
from setid.formulation.formulation import Formulation
from setid.formulation.lifting import LIFTED
from setid.formulation.units import InUnits, in_units
from setid.models.lti import TransferFunction
from setid.proofs.driven import driven, within_driven
from setid.result.assembling import Outcome, stated_problem
from setid.result.identification import Identification
from sparsepop_py.local_search.feasibility import prove_feasible

__all__ = ["by_driven_rows"]

Reals = NDArray[np.float64]
_SHARE = 0.85  # of the time, for these rows
_OFFSETS = (
    "where a pole may be at 1 the data do not bound what is added to the output; the other "
    "parameters are bounded by rows in which its product with the denominators at q = 1 stands"
)


def by_driven_rows(
    formulation: Formulation,
    context: BoundingContext,
    outcome: Outcome,
    loose: NDArray[np.int64],
    bound: Callable[[Formulation, BoundingContext, tuple[str, ...]], Identification],
) -> Identification | None:
    """Bound all parameters where offsets alone are unbounded; None for other cases.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    outcome : Outcome
        With the problem on the box.
    loose : (m,) int
        Places of unbounded parameters.
    bound : callable
        Bounds the parameters of another formulation.
    """
    model = formulation.model
    if not isinstance(model, TransferFunction):
        return None
    if not {formulation.parameters[i] for i in loose} <= {*model.offsets()}:
        return None
    other = driven(formulation)
    if other is None:
        return None
    found = bound(other, replace(context, deadline=context.deadline.part(_SHARE)), ())
    if found.empty:
        return context.empty(formulation, replace(outcome, driven=found))
    problem = within_driven(stated_problem(outcome), formulation, found.intervals)
    notes = *outcome.notes, *found.notes, _OFFSETS
    outcome = replace(outcome, problem=problem, driven=found, notes=tuple(dict.fromkeys(notes)))
    scaled = in_units(problem, formulation)
    points = context.timed("points", lambda: _points(formulation, scaled, found))
    if not points and context.known is not None:
        _, points = first_points(formulation, problem, scaled, context)
    p = len(formulation.parameters)
    if np.all(np.isfinite([problem.lower[:p], problem.upper[:p]])):
        return by_engine(formulation, context, outcome, False, points, at_ends=False)
    results = best_results(formulation, scaled, points)
    items = intervals_of(formulation, scaled, results, context.settings.tol)
    return context.result(formulation, items, replace(outcome, results=results))


def _points(
    formulation: Formulation, scaled: InUnits, found: Identification
) -> list[sp.ProvedPoint]:
    """Prove points at the ends that the rows attain."""
    sums, layout = found.formulation.layout.group(LIFTED), formulation.layout
    if found.problem.dimension - sums.size != layout.dimension - layout.group(LIFTED).size:
        return []  # a prior that speaks of an offset has unknowns of its own
    every = [w for interval in found.intervals.values() for w in interval.witnesses]
    points = list[sp.ProvedPoint]()
    for witness in {w.tobytes(): w for w in every if w is not None}.values():
        theta = with_offsets(formulation, witness[: len(formulation.parameters)])
        if theta is None:
            continue
        x = np.zeros(layout.dimension)
        same = witness.size - sums.size  # the sums are the last unknowns of both
        x[:same] = witness[:same]
        x[: theta.size] = theta
        place_slack(x, formulation, theta)
        point = prove_feasible(scaled.problem, x / scaled.units)
        points += [] if point is None else [point]
    return points
