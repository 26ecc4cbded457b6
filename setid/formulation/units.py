"""Problems of a formulation in units in which signals are neither tiny nor huge.

Noise has the unit of its signal, not that of its bound: both carry the same rounding errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.formulation.formulation import Formulation, multiplied_out
from setid.formulation.lifting import LIFTED
from sparsepop_py.problem import units
from sparsepop_py.problem.units import InUnits
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows

__all__ = ["InUnits", "coupled_rows", "in_fine_units", "in_units", "sizes_of"]


def sizes_of(formulation: Formulation) -> NDArray[np.float64]:
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
    numbers = formulation.layout.group(LIFTED).tolist()
    defined = list(zip(numbers, range(len(problem.constraints)), strict=False))
    return units.in_units(problem, _with_defined(problem, formulation, defined))


def in_fine_units(problem: sp.Problem, formulation: Formulation) -> InUnits:
    """State the same problem in units within a factor of two of the sizes of its unknowns.

    Unknowns without bounds, such as powers of internal signals, have the size of what their
    definition says.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        That of the formulation, with other bounds.
    formulation : Formulation

    Returns
    -------
    InUnits
        As of :func:`in_units`. Where units are used to prove something, those of that function
        are meant: results are stored in them.
    """
    groups, rows = formulation.layout.groups, formulation.rows
    open_ = ~(np.isfinite(problem.lower) & np.isfinite(problem.upper))
    defined = []
    for row, name in enumerate(rows.equation):
        if name in groups:
            support = problem.constraints[row].polynomial.support
            own = support[open_[support] & np.isin(support, groups[name])].tolist()
            defined += [(number, row) for number in own[:1]]
    return units.in_units(problem, _with_defined(problem, formulation, defined), coarse=1)


def _with_defined(
    problem: sp.Problem, formulation: Formulation, defined: list[tuple[int, int]]
) -> NDArray[np.float64]:
    """Compute sizes (n,) of noise, and of unknowns that rows define, each by its row in turn."""
    sizes = sizes_of(formulation).copy()
    largest = np.append(1.0, np.maximum(np.abs(problem.lower), np.abs(problem.upper)))
    for number, row in defined:
        polynomial = problem.constraints[row].polynomial
        words, values = polynomial.words, np.abs(polynomial.coefficients)
        own = np.all(words != number + 1, axis=1)  # the terms that define it
        with np.errstate(invalid="ignore"):
            sizes[number] = float(values[own] @ np.prod(largest[words[own]], axis=1))
        largest[number + 1] = sizes[number]
    return np.where(np.isfinite(sizes), sizes, 0.0)


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
