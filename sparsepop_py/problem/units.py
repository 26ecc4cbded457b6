"""Problems in units in which unknowns and rows are neither tiny nor huge.

Units are powers of two, so that nothing is rounded: x = units * z is consistent if and only if
z satisfies the problem in z, and what is proved of one is proved of the other.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.arithmetic.array_checks import frozen

__all__ = ["COARSE", "InUnits", "in_units", "with_units"]

Reals = NDArray[np.float64]
_MOST_POWER = 1023  # of two, among doubles
COARSE = 16  # powers of two are multiples of this: records in ordinary units stay as they are
_SMALL, _LARGE = 1e-290, 1e290  # beyond this, products of units might be rounded


class InUnits(NamedTuple):
    """A problem in z, and how to read it in x.

    Parameters
    ----------
    problem : Problem
    units : (n,) float
        x = units * z.
    factor : float
        Values of the objective in x are this many times those in z.
    """

    problem: Problem
    units: Reals
    factor: float

    def asked(self, objective: Polynomial) -> tuple[Polynomial, float]:
        """Convert an objective in x to one in z; return the factor too."""
        restated = _restated(objective, self.units)
        if not _safe(restated):
            raise ProblemError("objective: expected coefficients that are neither tiny nor huge")
        return _balanced(restated, COARSE)


def in_units(
    problem: Problem, sizes: NDArray[np.float64] | None = None, coarse: int = COARSE
) -> InUnits:
    """State the same problem with unknowns and rows that are neither tiny nor huge.

    Parameters
    ----------
    problem : Problem
    sizes : (k,) float, optional
        Least sizes of the first k unknowns, for those that bounds do not tell; 0 for none.
    coarse : int
        Powers of two are multiples of this: with 1 units are within a factor of two of sizes,
        and with the default unknowns of ordinary size stay as they are.

    Returns
    -------
    InUnits
        With all units one where other ones would not be exact.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> large = sp.Problem(x * y, [x + 1e6 * y <= 2e6], lower=[0, 0], upper=[2e6, 2])
    >>> in_units(large).units.tolist()
    [65536.0, 1.0]
    """
    return with_units(problem, _units(problem, sizes, coarse), coarse)


def with_units(problem: Problem, units: Reals, coarse: int = 1) -> InUnits:
    """State the same problem in given units.

    Parameters
    ----------
    problem : Problem
    units : (n,) float
        Powers of two.
    coarse : int
        Rows are divided by a power of two near their largest coefficient, a multiple of this.

    Returns
    -------
    InUnits
        With all units one where these would not be exact.

    Examples
    --------
    >>> import numpy as np, sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> tiny = sp.Problem(x + y, [x**2 - y == 0], [-1e-3, 0], [1e-3, 1e-6])
    >>> scaled = with_units(tiny, np.array([2.0**-10, 2.0**-20]))
    >>> print(scaled.problem.constraints[0].polynomial)
    -0.5*x2 + 0.5*x1^2
    """
    with np.errstate(all="ignore"):
        lower, upper = problem.lower / units, problem.upper / units
        restated = [_restated(row.polynomial, units) for row in problem.constraints]
        objective, factor = _balanced(_restated(problem.objective, units), coarse)
        balanced = [_balanced(polynomial, coarse)[0] for polynomial in restated]
        exact = np.array_equal(lower * units, problem.lower)
        exact &= np.array_equal(upper * units, problem.upper)
    exact &= bool(np.all((units > _SMALL) & (units < _LARGE)))
    # a product that was rounded as a subnormal looks ordinary once it is balanced
    if not exact or not all(map(_safe, [*restated, *balanced, objective])):
        return InUnits(problem, np.ones(units.size), 1.0)
    pairs = zip(problem.constraints, balanced, strict=True)
    rows = [replace(row, polynomial=polynomial) for row, polynomial in pairs]
    return InUnits(Problem(objective, rows, lower, upper, problem.names), units, factor)


def _units(problem: Problem, sizes: NDArray[np.float64] | None, coarse: int) -> Reals:
    """Choose coarse powers of two near the sizes of variables; one for none."""
    size = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    size = np.where(np.isfinite(size) & (size > 0), size, 0.0)
    if sizes is not None:
        size[: sizes.size] = np.maximum(size[: sizes.size], sizes)
    power = np.frexp(np.where(size > 0, size, 1.0))[1]
    with np.errstate(over="ignore"):  # units that no double holds are refused
        return frozen(np.ldexp(1.0, coarse * np.round(power / coarse).astype(int)))


def _restated(polynomial: Polynomial, units: Reals) -> Polynomial:
    factors = np.append(1.0, units)[polynomial.words]
    return _with(polynomial, polynomial.coefficients * np.prod(factors, axis=1))


def _balanced(polynomial: Polynomial, coarse: int) -> tuple[Polynomial, float]:
    """Divided by a coarse power of two near the largest coefficient, and that power."""
    if not polynomial.terms:
        return polynomial, 1.0
    size = np.frexp(np.abs(polynomial.coefficients).max())[1]
    power = min(coarse * round(float(size) / coarse), _MOST_POWER)
    return _with(polynomial, np.ldexp(polynomial.coefficients, -power)), math.ldexp(1.0, power)


def _with(polynomial: Polynomial, values: Reals) -> Polynomial:
    # raw, since zeros and infinities are looked for afterwards
    return Polynomial._of_sorted(
        polynomial.words, frozen(values), polynomial.dimension, polynomial.names
    )


def _safe(polynomial: Polynomial) -> bool:
    """Check that no coefficient came near overflow or underflow."""
    size = np.abs(polynomial.coefficients)
    return bool(np.all((size > _SMALL) & (size < _LARGE)))
