"""Results of ends that claim proved points, and no bound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf, nan

import sparsepop_py as sp
from setid.formulation.formulation import Formulation
from setid.formulation.units import InUnits
from setid.proofs.parameter_box import objectives
from sparsepop_py.verified.points.feasible_point import valued

__all__ = ["attained_result", "best_point", "best_results"]


def attained_result(about: sp.Problem, point: sp.ProvedPoint | None) -> sp.Result:
    """Make a result of the engine that claims a point, and no bound.

    Parameters
    ----------
    about : sparsepop_py.Problem
    point : sparsepop_py.ProvedPoint or None
    """
    return sp.Result(
        problem=about,
        options=sp.Options(),
        status=sp.Status.UNPROVED,
        lower_bound=-inf,
        upper_bound=inf if point is None else point.value,
        x=None if point is None else point.x,
        certificate=None,
        attained=point,
        points=(),
        relaxation=None,
        solution=None,
        solver_value=nan,
    )


def best_point(points: Iterable[sp.ProvedPoint], about: sp.Problem) -> sp.ProvedPoint:
    """Choose the point with the least value of a problem's objective.

    Parameters
    ----------
    points : iterable of sparsepop_py.ProvedPoint
        At least one.
    about : sparsepop_py.Problem
    """
    return min((valued(point, about) for point in points), key=lambda point: point.value)


def best_results(
    formulation: Formulation, scaled: InUnits, points: Sequence[sp.ProvedPoint]
) -> tuple[sp.Result, ...]:
    """Claim the best of some points at each end; no results without points.

    Parameters
    ----------
    formulation : Formulation
    scaled : InUnits
        The problem on the box, in units.
    points : sequence of sparsepop_py.ProvedPoint
        In these units.

    Returns
    -------
    tuple of sparsepop_py.Result
        Two a parameter, as :func:`setid.bounding.ends.intervals_of` takes them.
    """
    if not points:
        return ()
    asked = [scaled.asked(objective)[0] for objective in objectives(formulation)]
    ends = [scaled.problem.with_objective(objective) for objective in asked]
    return tuple(attained_result(about, best_point(points, about)) for about in ends)
