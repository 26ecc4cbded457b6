"""Claims of results, computed again: the bound, the attained value, its point, the status."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sparsepop_py.errors import ClaimError, shown
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = ["Recomputed", "check_claims", "proved_bound", "raised"]

_DIGITS = 1e-12  # in which machines differ that bound the value of one point


class Recomputed(NamedTuple):
    """Bounds and point that the evidence of a result proves.

    Parameters
    ----------
    proved : float
        The lower bound; -inf without a certificate.
    attained : float
        The value of the point; +inf without one, -inf where a ray falls from it.
    point : ProvedPoint or None
        As it was proved again.
    """

    proved: float
    attained: float
    point: ProvedPoint | None


def proved_bound(certificate: Any, problem: Any) -> float:
    """Compute what a certificate proves: at least the bound that it states.

    Raises
    ------
    ClaimError
        If it proves less.
    """
    verdict = certificate.verify(problem)
    if not verdict.ok:
        raise ClaimError(
            f"result.certificate: found the bound {certificate.bound!r}, expected one that is "
            f"proved ({verdict.reason})"
        )
    return float(verdict.bound)


def raised(upper: float, attained: float) -> float:
    """Raise a stored upper bound to what its point attains, where digits alone differ.

    Parameters
    ----------
    upper : float
        As another machine may have rounded it.
    attained : float
        As computed again.

    Returns
    -------
    float
        ``upper`` where it is not below, or so far below that no rounding explains it.

    Examples
    --------
    >>> raised(0.3, 0.30000000000000004), raised(0.3, 0.4)
    (0.30000000000000004, 0.3)
    """
    near = math.isclose(upper, attained, rel_tol=_DIGITS, abs_tol=_DIGITS)
    return max(upper, attained) if near else upper


def check_claims(result: Any, proved: float, attained: float) -> None:
    """Refuse a result that claims more than its evidence proves.

    Parameters
    ----------
    result : Result or RationalResult
        Its bounds, its point and its status are compared.
    proved, attained : float
        As computed again.

    Raises
    ------
    ClaimError
        That names the claim.
    """
    lower, upper = result.lower_bound, result.upper_bound
    if not lower <= proved:
        raise ClaimError(
            f"result.lower_bound: found {lower!r}, expected at most {proved!r}, "
            "which its certificate proves"
        )
    if not upper >= attained:
        raise ClaimError(
            f"result.upper_bound: found {upper!r}, expected at least {attained!r}, "
            "which its point attains"
        )
    point = result.attained
    if point is not None and not np.array_equal(result.x, point.x[: result.problem.dimension]):
        raise ClaimError(f"result.x: found {shown(result.x)}, expected the point that is attained")
    evident = {
        "OPTIMAL": math.isfinite(proved) and math.isfinite(attained),
        "INFEASIBLE": proved == math.inf,
        "UNBOUNDED": attained == -math.inf,
    }
    if not evident.get(result.status, True):
        raise ClaimError(f"result.status: found {result.status!s}, expected one that is proved")
