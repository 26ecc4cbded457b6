"""Problems of a formulation in units in which signals are neither tiny nor huge.

Noise has the unit of its signal, not that of its bound: both carry the same rounding errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.lifting import LIFTED
from setid.models.products import PRODUCT
from sparsepop_py.problem import units
from sparsepop_py.problem.units import InUnits
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows

__all__ = ["InUnits", "coupled_rows", "in_fine_units", "in_units", "sizes_of"]

Reals = NDArray[np.float64]


def sizes_of(formulation: Formulation) -> Reals:
    """Compute sizes (n,) of the signals to which noise samples belong, else 0.

    Parameters
    ----------
    formulation : Formulation
    """
    data = formulation.data
    found = np.zeros(formulation.problem.dimension)
    for group, signal in (("eta", data.y), ("e", data.y), ("xi", data.u)):
        numbers = formulation.layout.group(group)
        present = numbers >= 0
        largest = np.broadcast_to(np.nanmax(np.abs(signal), axis=0), numbers.shape)
        found[numbers[present]] = largest[present]
    return frozen(found)


def in_units(problem: sp.Problem, formulation: Formulation) -> InUnits:
    """State the same problem with signals, parameters and rows neither tiny nor huge.

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
    sizes = sizes_of(formulation).copy()
    _size_products(sizes, problem, formulation)
    return units.in_units(problem, sizes)


def _size_products(sizes: Reals, problem: sp.Problem, formulation: Formulation) -> None:
    """Enter sizes (n,) of products without bounds, by the rows x - product == 0 of each."""
    largest = np.append(1.0, np.maximum(np.abs(problem.lower), np.abs(problem.upper)))
    unknown = np.zeros(largest.size, bool)
    for name, numbers in formulation.layout.groups.items():
        if name == LIFTED or name.startswith(PRODUCT):
            unknown[numbers[numbers >= 0] + 1] = True
    unknown &= ~np.isfinite(largest)
    for row in problem.constraints if np.any(unknown) else ():
        words, values = row.polynomial.words, np.abs(row.polynomial.coefficients)
        own = np.any(unknown[words], axis=1)
        if np.count_nonzero(own) != 1 or np.count_nonzero(words[own]) != 1:
            continue
        number = int(words[own].max())
        with np.errstate(invalid="ignore"):
            size = values[~own] @ np.prod(largest[words[~own]], axis=1)
        if np.isfinite(size):
            sizes[number - 1] = largest[number] = size
            unknown[number] = False


def in_fine_units(problem: sp.Problem, formulation: Formulation, near: ArrayLike) -> InUnits:
    """State the same problem in units within a factor of two of the sizes of its unknowns.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        That of the formulation, with other bounds.
    formulation : Formulation
    near : (n,) float
        A vector that is nearly feasible. Samples of a signal without bounds, such as a power of
        an internal signal, have the size of the largest of them there.

    Returns
    -------
    InUnits
        For searches; results are stored in those of :func:`in_units`.
    """
    sizes, vector = sizes_of(formulation).copy(), np.abs(np.asarray(near, float))
    bounded = np.isfinite(problem.lower) & np.isfinite(problem.upper)
    for numbers in formulation.layout.groups.values():
        open_ = numbers[numbers >= 0]
        open_ = open_[~bounded[open_]]
        sizes[open_] = np.maximum(sizes[open_], vector[open_].max(initial=0.0))
    return units.in_units(problem, sizes, coarse=1)


def coupled_rows(formulation: Formulation) -> CoupledRows:
    """State the rows of samples with the noise that they share.

    Parameters
    ----------
    formulation : Formulation
        Sums of products of parameters are no uncertain numbers: they are multiplied out.
    """
    formulation = multiplied_out(formulation)
    samples = frozen(formulation.rows.sample > 0)
    count = len(formulation.parameters)
    return CoupledRows(formulation.problem, count, samples, sizes_of(formulation))
