"""Search for certificates that no consistent parameters are far away.

The engine minimises s over each side phi_i = +-1 of the cube of directions of
:mod:`sparsepop_py.verified.uncertain_rows.directions`, with the uncertain numbers that rows
share. Where s = 0 is attained, they explain all rows along a direction. The first rows of many
mostly prove s > 0 in a fraction of the time; else twice as many are tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.budget import spent
from sparsepop_py.options import Options
from sparsepop_py.pipeline import solve
from sparsepop_py.problem.units import InUnits
from sparsepop_py.result import Status
from sparsepop_py.uncertain_rows.sign_tree import parameter_box
from sparsepop_py.verified.arithmetic.array_checks import frozen
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.directions import (
    LARGEST,
    POWERS,
    Cube,
    DirectionBox,
    cubes,
    suits,
    within,
)
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = ["direction_box", "units_of_rows"]

Reals = NDArray[np.float64]
_GAP = 0.06  # of s, as a fraction of the largest, at first
_NONE = 2e-7  # of the largest: s that is attained below this is taken for zero
_SLICE = 2.0  # seconds, twice as many each time: any positive s will do
_SIDE = 20.0  # seconds for one side of the cube
_FEW, _BRIEFLY = 80, 6.0  # rows that are tried first, and seconds for them; then twice as many
_ALL = 120.0  # seconds for all of them, and half of the time that is left


def direction_box(
    rows: UncertainRows,
    coupled: CoupledRows,
    first: ParameterBox,
    until: float = inf,
    most: float = _ALL,
) -> DirectionBox | None:
    """Bound parameters for which rows one by one give no bounds.

    Parameters
    ----------
    rows : UncertainRows
    coupled : CoupledRows
        The same rows with the uncertain numbers that they share, linear in the parameters.
    first : ParameterBox
        What rows one by one give.
    until : float
        Reading of ``time.monotonic`` at which all work ends; at most half of it is for this.
        Where that is infinite units of work are counted instead of seconds, so that runs repeat.
    most : float
        Seconds, or units of work, for this.

    Returns
    -------
    DirectionBox or None
        None where no finite box was proved: the set may be unbounded.

    Examples
    --------
    The number e is the same in both rows, which their sum shows and neither row alone does:

    >>> import numpy as np, sparsepop_py as sp
    >>> from sparsepop_py.uncertain_rows import CoupledRows, UncertainRows, parameter_box
    >>> x, y, e = sp.variables(3, ["x", "y", "e"])
    >>> equations = [x + e * x + y == 1, x - e * x + y == 2, x - y == 0]
    >>> bounds = {"lower": [-np.inf, -np.inf, -2.5], "upper": [np.inf, np.inf, 2.5]}
    >>> problem = sp.Problem(x, equations, **bounds)
    >>> coupled = CoupledRows(problem, 2, np.ones(3, bool), np.zeros(3))
    >>> regressors, radii = [[1, 1], [1, 1], [1, -1]], [[2.5, 0], [2.5, 0], [0, 0]]
    >>> rows = UncertainRows(("x", "y"), [-1, -2, 0], regressors, [0, 0, 0], radii)
    >>> first = parameter_box(rows)
    >>> bool(np.isinf(first.upper).all())
    True
    >>> box = direction_box(rows, coupled, first)
    >>> bool(np.isfinite(box.upper).all()), bool(box.lower[0] <= 0.75 <= box.upper[0])
    (True, True)
    """
    if first.empty or not suits(coupled):
        return None
    now = _clock(until)
    begun = now()
    end = min(begun + most, begun + 0.5 * (until - begun))
    scale = units_of_rows(rows)
    cube, whole = cubes(coupled, first, scale), len(coupled.constraints)
    certificates, used, least = list[Certificate](), list[int](), LARGEST
    try:
        for number in range(2 * scale.size):
            found = _proved(cube, number, whole, end, now)
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


def units_of_rows(rows: UncertainRows) -> Reals:
    """Choose powers of two with which all terms of a row are of one size."""
    size = np.abs(rows.regressors).max(axis=0, initial=0.0)
    whole = max(float(np.abs(rows.target).max(initial=0.0)), 1e-300)
    with np.errstate(divide="ignore"):
        power = np.where(size > 0, np.round(np.log2(whole / np.maximum(size, 1e-300))), 0.0)
    return frozen(np.exp2(np.clip(power, -POWERS, POWERS)))


def _proved(
    cube: Callable[[int], Cube], number: int, whole: int, end: float, now: Callable[[], float]
) -> tuple[Certificate, int, float] | None:
    """Search a proof that s is positive on one side.

    Returns the proof, the number of rows it uses, and the bound of s.
    """
    count, seconds = min(_FEW, whole), _BRIEFLY
    while True:
        side = cube(count).side(number)
        seconds = _SIDE if count == whole else min(seconds, _SIDE)
        found = _least(side, min(end, now() + seconds), now)
        if found is not None:
            return found, count, found.bound * side.factor
        if count == whole or now() >= end:
            return None
        count, seconds = min(2 * count, whole), 2.0 * seconds


def _clock(until: float) -> Callable[[], float]:
    """Choose what is counted: seconds, or units of work where no moment ends it."""
    return spent if until == inf else time.monotonic


def _least(
    side: InUnits, end: float, now: Callable[[], float] = time.monotonic
) -> Certificate | None:
    """Search a proof that s is positive; None if none is found."""
    gap, slice_, plain = _GAP, _SLICE, Options(effort="auto", gap_kind="absolute")
    while (left := end - now()) > 0:
        most = min(left, slice_)
        work, seconds = (most, None) if now is spent else (None, most)
        options = replace(plain, gap=gap, work_limit=work, time_limit=seconds)
        found = solve(side.problem, options)
        if found.certificate is not None and found.certificate.bound > 0:
            return found.certificate
        if any(note.startswith("interrupted") for note in found.notes):
            raise KeyboardInterrupt
        if found.status is Status.LIMIT:
            slice_ *= 2.0
        elif found.status is not Status.OPTIMAL or not found.upper_bound > _NONE or gap < _NONE:
            return None  # s = 0 is attained, or nothing was proved
        else:
            gap = min(0.5 * found.upper_bound, 0.25 * gap)
    return None
