"""Read intervals off what is proved of their ends.

With lower bounds l of theta_i and -u of -theta_i on a box [low, high], the outer interval is
[max(l, low), min(u, high)]. The inner one reaches as far as points that are proved to exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.bounding.context import BoundingContext
from setid.data.checks import frozen
from setid.feasible_points.inner_ends import inner_ends
from setid.formulation.formulation import Formulation
from setid.formulation.units import InUnits
from setid.proofs.existence import admitted
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.uniqueness.unbounded import Unbounded
from setid.result.identification import Identification
from setid.result.progress import Progress

__all__ = ["intervals_of", "is_closed", "is_open", "report_ends", "with_unbounded"]


def is_open(item: ParameterInterval) -> bool:
    """Check that a gap is left between what is proved and what is attained.

    Parameters
    ----------
    item : ParameterInterval
    """
    return item.status is IntervalStatus.PARTIAL


def is_closed(found: Identification) -> bool:
    """Check that no interval is open.

    Parameters
    ----------
    found : Identification
    """
    return found.empty or not any(is_open(item) for item in found.intervals.values())


def intervals_of(
    formulation: Formulation,
    scaled: InUnits,
    results: Sequence[sp.Result],
    tol: float,
) -> list[ParameterInterval]:
    """Read the intervals of all parameters off the results of their ends.

    Parameters
    ----------
    formulation : Formulation
    scaled : InUnits
        The problem on the box, in units.
    results : sequence of sparsepop_py.Result
        Of the ends in units, two a parameter; none where the box is all that is proved.
    tol : float
        Largest gap of a certified interval, in attained widths.

    Returns
    -------
    list of ParameterInterval
        In the record's units.
    """
    problem = scaled.problem
    points = [_admitted_point(formulation, scaled, r.attained) for r in results]
    attained = any(point is not None for point in points)
    items = []
    for place, name in enumerate(formulation.parameters):
        low, high = float(problem.lower[place]), float(problem.upper[place])
        if not np.any(problem.rows.words == place + 1):
            ends = formulation.problem.lower[place], formulation.problem.upper[place]
            outer = (float(ends[0]), float(ends[1]))
            inner = outer if attained else None
            free = IntervalStatus.UNIDENTIFIABLE if attained else IntervalStatus.PARTIAL
            items.append(ParameterInterval(name, outer, inner, free))
            continue
        if results:
            low = max(low, results[2 * place].lower_bound)
            high = min(high, -results[2 * place + 1].lower_bound)
        inner, witnesses = inner_ends(points, place)
        if inner is not None and problem.lower[place] == problem.upper[place]:
            inner = (low, high)  # whatever point is attained has this value
        item = ParameterInterval(name, (low, high), inner, IntervalStatus.PARTIAL, witnesses)
        if item.gap <= tol * (1.0 + 1e-9) or inner == item.outer:
            item = replace(item, status=IntervalStatus.CERTIFIED)
        items.append(_restored(item, float(scaled.units[place]), scaled.units))
    return items


def _admitted_point(
    formulation: Formulation, scaled: InUnits, point: sp.ProvedPoint | None
) -> sp.ProvedPoint | None:
    """Keep a point that passes the priors' own tests, which may ask for more than their rows."""
    if point is None:
        return None
    p = len(formulation.parameters)
    units = scaled.units[:p]
    return point if admitted(formulation, point.x[:p] * units, point.radius * units) else None


def _restored(
    item: ParameterInterval, unit: float, units: NDArray[np.float64]
) -> ParameterInterval:
    """Convert an interval in units to the record's units: powers of two round nothing."""
    low, high = item.witnesses
    return replace(
        item,
        outer=(item.outer[0] * unit, item.outer[1] * unit),
        inner=None if item.inner is None else (item.inner[0] * unit, item.inner[1] * unit),
        witnesses=(
            None if low is None else frozen(low * units),
            None if high is None else frozen(high * units),
        ),
    )


def report_ends(
    formulation: Formulation, context: BoundingContext, items: Sequence[ParameterInterval]
) -> None:
    """Tell whoever listens of all ends.

    Parameters
    ----------
    formulation : Formulation
    context : BoundingContext
    items : sequence of ParameterInterval
    """
    settings = context.settings
    progress = Progress(
        formulation.parameters, settings.tol, settings.progress, None, context.on_progress
    )
    try:
        for place, item in enumerate(items):
            low, high = (inf, -inf) if item.inner is None else item.inner
            progress.report(2 * place, item.outer[0], low)
            progress.report(2 * place + 1, -item.outer[1], -high)
    finally:
        progress.close()


def with_unbounded(
    item: ParameterInterval,
    unbounded: Unbounded | None,
    free: tuple[str, ...],
    witness: NDArray[np.float64] | None,
) -> ParameterInterval:
    """State what is proved of a parameter that nothing bounds.

    Parameters
    ----------
    item : ParameterInterval
    unbounded : Unbounded or None
        Parameters that a common factor leaves unbounded.
    free : tuple of str
        Parameters that no row speaks of.
    witness : (n,) float or None
        A consistent vector, for these.
    """
    if item.name in free:
        ends, status = (-inf, inf), IntervalStatus.UNIDENTIFIABLE
        return ParameterInterval(item.name, ends, ends, status, (witness, witness))
    proved = unbounded is not None and item.name in unbounded.names
    return replace(item, status=IntervalStatus.UNBOUNDED) if proved else item
