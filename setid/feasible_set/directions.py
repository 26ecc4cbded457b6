"""Search for certificates that no consistent parameters are far away.

The engine minimises s over each side phi_i = +-1 of the cube of directions of
:mod:`setid.proofs.directions`, with the noise that rows share. Where s = 0 is attained, noise
within its bounds explains the record along a direction. The first rows of a long record mostly
prove s > 0 in a fraction of the time; else twice as many are tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import frozen
from setid.feasible_set.sign_tree import parameter_box
from setid.formulation.formulation import Formulation
from setid.formulation.regression import Regression
from setid.formulation.units import InUnits
from setid.proofs.directions import (
    LARGEST,
    POWERS,
    Cube,
    DirectionBox,
    cubes,
    data_rows,
    suits,
    within,
)
from setid.proofs.sign_tree import ParameterBox

__all__ = ["direction_box", "units_of_rows"]

Reals = NDArray[np.float64]
_GAP = 0.06  # of s, as a fraction of the largest, at first
_NONE = 2e-7  # of the largest: s that is attained below this is taken for zero
_SLICE = 2.0  # seconds, twice as many each time: any positive s will do
_SIDE = 20.0  # seconds for one side of the cube
_FEW, _BRIEFLY = 80, 6.0  # rows that are tried first, and seconds for them; then twice as many
_ALL = 120.0  # seconds for all of them, and half of the time that is left


def direction_box(
    formulation: Formulation, first: ParameterBox, until: float = inf
) -> DirectionBox | None:
    """Bound parameters for which rows one by one give no bounds.

    Parameters
    ----------
    formulation : Formulation
        With rows that are linear in the parameters.
    first : ParameterBox
        Of its rows.
    until : float
        Reading of ``time.monotonic`` at which all work ends; at most half of it is for this.

    Returns
    -------
    DirectionBox or None
        None where no finite box was proved: the set may be unbounded.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([1, -1, 1, 1, -1, 1], [1.1, -0.4, 0.8, 1.5, -0.2, 0.9])
    >>> known = setid.formulate(data, setid.TransferFunction(1, 1), setid.Noise(output=1.2))
    >>> first = setid.parameter_box(known.regression)
    >>> first
    <ParameterBox: a1 in [-inf, inf], b0 in [-inf, inf]>
    >>> direction_box(known, first) is None  # order zero explains this record
    True
    """
    rows = formulation.smoothed
    if rows is None or first.empty or not suits(formulation):
        return None
    begun = time.monotonic()
    end = min(begun + _ALL, begun + 0.5 * (until - begun))
    scale = units_of_rows(rows)
    cube, whole = cubes(formulation, first, scale), len(data_rows(formulation))
    certificates, used, least = list[sp.Certificate](), list[int](), LARGEST
    try:
        for number in range(2 * scale.size):
            found = _proved(cube, number, whole, end)
            if found is None:
                return None
            certificate, count, bound = found
            certificates.append(certificate)
            used.append(count)
            least = min(least, bound)
    except KeyboardInterrupt:  # nothing follows from some of the sides
        return None
    last = parameter_box(rows, within(first, scale, least), until)
    proofs = tuple(certificates), tuple(used)
    return DirectionBox(first.names, last.lower, last.upper, first, scale, *proofs, last)


def units_of_rows(rows: Regression) -> Reals:
    """Powers of two with which all terms of a row are of one size."""
    size = np.abs(rows.regressors).max(axis=0, initial=0.0)
    whole = max(float(np.abs(rows.target).max(initial=0.0)), 1e-300)
    with np.errstate(divide="ignore"):
        power = np.where(size > 0, np.round(np.log2(whole / np.maximum(size, 1e-300))), 0.0)
    return frozen(np.exp2(np.clip(power, -POWERS, POWERS)))


def _proved(
    cube: Callable[[int], Cube], number: int, whole: int, end: float
) -> tuple[sp.Certificate, int, float] | None:
    """A proof that s is positive on one side, from how many rows, and the bound of s."""
    count, seconds = min(_FEW, whole), _BRIEFLY
    while True:
        side = cube(count).side(number)
        seconds = _SIDE if count == whole else min(seconds, _SIDE)
        found = _least(side, min(end, time.monotonic() + seconds))
        if found is not None:
            return found, count, found.bound * side.factor
        if count == whole or time.monotonic() >= end:
            return None
        count, seconds = min(2 * count, whole), 2.0 * seconds


def _least(side: InUnits, end: float) -> sp.Certificate | None:
    """A proof that s is positive; None where none was found, or where s = 0 is attained."""
    gap, slice_ = _GAP, _SLICE
    while (left := end - time.monotonic()) > 0:
        options = sp.Options(
            effort="auto", gap=gap, gap_kind="absolute", time_limit=min(left, slice_)
        )
        found = sp.solve(side.problem, options)
        if found.certificate is not None and found.certificate.bound > 0:
            return found.certificate
        if any(note.startswith("interrupted") for note in found.notes):
            raise KeyboardInterrupt
        if found.status is sp.Status.LIMIT:
            slice_ *= 2.0
        elif found.status is not sp.Status.OPTIMAL or not found.upper_bound > _NONE or gap < _NONE:
            return None  # s = 0 is attained, or nothing was proved
        else:
            gap = min(0.5 * found.upper_bound, 0.25 * gap)
    return None
