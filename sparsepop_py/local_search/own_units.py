"""Units in which no unknown of a local search is tiny.

Its tolerances, and those of proofs of points, are absolute, or relative to 1 + abs(x). An unknown
in [0, 1e-6] would be lost among them. Its size is that of its bounds. Large unknowns stay as they
are, since bounds are often far larger than what they bound.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.units import InUnits, with_units

__all__ = ["in_own_units", "largest_violation"]

_ORDINARY = 8  # unknowns within so many powers of two below 1 stay as they are


def in_own_units(problem: Problem) -> InUnits:
    """State a problem in units in which no unknown is tiny.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    InUnits
        The problem itself with units of one, where none of its unknowns is tiny.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> a, b = sp.variables(2)
    >>> current = sp.Problem(a, [a * b >= 1e-6], lower=[0, 0], upper=[1e-3, 5])
    >>> in_own_units(current).units.tolist()
    [0.001953125, 1.0]
    """
    bound = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    power = np.frexp(np.where(np.isfinite(bound), bound, 1.0))[1]
    tiny = power < -_ORDINARY
    if not tiny.any():
        return InUnits(problem, np.ones(tiny.size), 1.0)
    return _stated(problem, np.where(tiny, power, 0).astype(np.int32).tobytes())


def largest_violation(problem: Problem, x: NDArray[np.float64]) -> float:
    """Measure by how much constraints fail, in the given units and without tiny unknowns.

    Parameters
    ----------
    problem : Problem
    x : (n,) float

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> a, b = sp.variables(2)
    >>> either = sp.Problem(a, [a * b == 0], lower=[0, 0], upper=[2.0**-20, 2.0**-20])
    >>> largest_violation(either, either.upper)
    0.125
    """
    scaled, given = in_own_units(problem), problem.violation(x)
    if scaled.problem is problem:
        return given
    return max(given, scaled.problem.violation(x / scaled.units))


@lru_cache(maxsize=8)
def _stated(problem: Problem, powers: bytes) -> InUnits:
    return with_units(problem, np.ldexp(1.0, np.frombuffer(powers, np.int32)))
