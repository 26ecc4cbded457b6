"""Problems in units in which signals and parameters are neither tiny nor huge.

Noise has the unit of its signal, not that of its bound: both carry the same rounding errors.
Units are powers of two, so that nothing is rounded: x = units * z is consistent if and only if
z satisfies the problem in z, and what is proved of one is proved of the other.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.errors import SetidError
from setid.formulation.formulation import Formulation

__all__ = ["InUnits", "in_units"]

Reals = NDArray[np.float64]
_COARSE = 16  # records in ordinary units stay as they are
_SMALL, _LARGE = 1e-290, 1e290  # beyond this, products of units might be rounded


class InUnits(NamedTuple):
    """A problem in z, and how to read it in x.

    Parameters
    ----------
    problem : sparsepop_py.Problem
    units : (n,) float
        x = units * z.
    factor : float
        Values of the objective in x are this many times those in z.
    """

    problem: sp.Problem
    units: Reals
    factor: float

    def asked(self, objective: sp.Polynomial) -> tuple[sp.Polynomial, float]:
        """An objective in x as one in z of ordinary size, and the factor between their values."""
        restated = _restated(objective, self.units)
        if not _safe(restated):
            raise SetidError("objective: expected coefficients that are neither tiny nor huge")
        return _balanced(restated)


def in_units(problem: sp.Problem, formulation: Formulation) -> InUnits:
    """The same problem with signals, parameters and rows that are neither tiny nor huge.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        That of the formulation, with other bounds, rows and perhaps more unknowns.
    formulation : Formulation

    Returns
    -------
    InUnits
        With all units one where other ones would not be exact.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4e6, -3e6, 2e6, 1e6], [0, -6e-9, 1e-9, 2e-9])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=5e-10))
    >>> scaled = in_units(known.problem, known)
    >>> scaled.units.tolist() == [1, 1] + 4 * [2.0**-32]  # a1 and b0 have no bounds yet
    True
    >>> bool(abs(scaled.problem.upper[2:] - 5e-10 * 2.0**32).max() == 0)
    True
    """
    units = _units(problem, formulation)
    with np.errstate(all="ignore"):
        lower, upper = problem.lower / units, problem.upper / units
        restated = [_restated(row.polynomial, units) for row in problem.constraints]
        objective, factor = _balanced(_restated(problem.objective, units))
        balanced = [_balanced(polynomial)[0] for polynomial in restated]
    exact = np.array_equal(lower * units, problem.lower)
    exact &= np.array_equal(upper * units, problem.upper)
    exact &= bool(np.all((units > _SMALL) & (units < _LARGE)))
    # a product that was rounded as a subnormal looks ordinary once it is balanced
    if not exact or not all(map(_safe, [*restated, *balanced, objective])):
        return InUnits(problem, np.ones(units.size), 1.0)
    pairs = zip(problem.constraints, balanced, strict=True)
    rows = [replace(row, polynomial=polynomial) for row, polynomial in pairs]
    return InUnits(sp.Problem(objective, rows, lower, upper, problem.names), units, factor)


def _units(problem: sp.Problem, formulation: Formulation) -> Reals:
    """Coarse powers of two near the sizes of signals and bounds; one where there is none."""
    size = np.maximum(np.abs(problem.lower), np.abs(problem.upper))
    size = np.where(np.isfinite(size) & (size > 0), size, 0.0)
    data = formulation.data
    for group, signal in (("eta", data.y), ("e", data.y), ("xi", data.u)):
        numbers = formulation.layout.group(group)
        present = numbers >= 0
        largest = np.broadcast_to(np.nanmax(np.abs(signal), axis=0), numbers.shape)
        size[numbers[present]] = np.maximum(size[numbers[present]], largest[present])
    power = np.frexp(np.where(size > 0, size, 1.0))[1]
    return frozen(np.ldexp(1.0, _COARSE * np.round(power / _COARSE).astype(int)))


def _restated(polynomial: sp.Polynomial, units: Reals) -> sp.Polynomial:
    factors = np.append(1.0, units)[polynomial.words]
    return _with(polynomial, polynomial.coefficients * np.prod(factors, axis=1))


def _balanced(polynomial: sp.Polynomial) -> tuple[sp.Polynomial, float]:
    """Divided by a coarse power of two near the largest coefficient, and that power."""
    if not polynomial.terms:
        return polynomial, 1.0
    size = np.frexp(np.abs(polynomial.coefficients).max())[1]
    power = _COARSE * round(float(size) / _COARSE)
    return _with(polynomial, np.ldexp(polynomial.coefficients, -power)), math.ldexp(1.0, power)


def _with(polynomial: sp.Polynomial, values: Reals) -> sp.Polynomial:
    # raw, since zeros and infinities are found by _safe
    return sp.Polynomial._of_sorted(
        polynomial.words, frozen(values), polynomial.dimension, polynomial.names
    )


def _safe(polynomial: sp.Polynomial) -> bool:
    """Whether no coefficient came near overflow or underflow."""
    size = np.abs(polynomial.coefficients)
    return bool(np.all((size > _SMALL) & (size < _LARGE)))
