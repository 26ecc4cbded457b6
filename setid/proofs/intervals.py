"""Proved and attained intervals of parameters: what an identification claims."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import inf, isnan

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["IntervalStatus", "ParameterInterval", "overstated"]

_DIGITS = 1e-9  # relative: ends that differ by less are the same


class IntervalStatus(StrEnum):
    """Outcome of one interval; ``message`` says what it means and what to try."""

    CERTIFIED = "certified"
    PARTIAL = "partial"
    UNBOUNDED = "unbounded"
    EMPTY = "empty"
    UNIDENTIFIABLE = "unidentifiable"

    @property
    def message(self) -> str:
        """One sentence of help."""
        return _MESSAGES[self]


_MESSAGES = {
    IntervalStatus.CERTIFIED: "Proved and attained ends agree within the tolerance.",
    IntervalStatus.PARTIAL: (
        "The outer ends are proved but not attained within the tolerance: give more time, or "
        "priors such as Box and Stable."
    ),
    IntervalStatus.UNBOUNDED: (
        "Consistent parameters of any size exist in a direction: the data do not bound it; "
        "give a prior, more excitation or less noise."
    ),
    IntervalStatus.EMPTY: (
        "It is proved that no parameter is consistent: the order, a noise bound, a prior or a "
        "normalisation is wrong (see setid.consistency and setid.select)."
    ),
    IntervalStatus.UNIDENTIFIABLE: (
        "It may take every value without a change in the model's outputs: excite the input, or "
        "normalise the structure."
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class ParameterInterval(ReadOnly):
    """The uncertainty interval of one parameter.

    Parameters
    ----------
    name : str
    outer : (float, float)
        Proved: no consistent parameter vector lies outside. Infinite where nothing is
        proved; (inf, -inf) when the feasible set is proved empty.
    inner : (float, float) or None
        Attained: consistent parameter vectors with values at most ``inner[0]`` and at least
        ``inner[1]`` provably exist. None when no consistent vector was found.
    status : IntervalStatus
        Compares equal to its text, such as ``"certified"``.
    witnesses : (array or None, array or None)
        For each inner end the vector (n,) of all unknowns of the formulation, noise included.

    Examples
    --------
    >>> import setid
    >>> setid.ParameterInterval("a1", (-1.0, 1.0), (-0.9, 1.0), setid.IntervalStatus.PARTIAL)
    a1 in [-1, 1], attained [-0.9, 1], partial
    """

    name: str
    outer: tuple[float, float]
    inner: tuple[float, float] | None
    status: IntervalStatus
    witnesses: tuple[NDArray[np.float64] | None, NDArray[np.float64] | None] = (None, None)

    @property
    def stated(self) -> bool:
        """True if all ends are numbers: NaN claims nothing that could be checked."""
        return not any(isnan(end) for end in (*self.outer, *(self.inner or ())))

    @property
    def width(self) -> float:
        """Width of the outer interval; 0 if it is empty."""
        return max(0.0, self.outer[1] - self.outer[0])

    @property
    def centre(self) -> float:
        """Middle of the outer interval; NaN where that means nothing."""
        low, high = self.outer
        return 0.5 * low + 0.5 * high if -inf < low <= high < inf else float("nan")

    @property
    def gap(self) -> float:
        """Distance of outer from inner ends, as a fraction of the attained width."""
        if self.status is IntervalStatus.EMPTY:
            return 0.0
        if self.inner is None:
            return inf
        loose = max(self.inner[0] - self.outer[0], self.outer[1] - self.inner[1])
        size = self.inner[1] - self.inner[0]
        return loose / size if size > 0 else (0.0 if loose <= 0 else inf)

    def agrees(self, tol: float) -> bool:
        """Check that outer and attained ends are as near as those of a certified interval.

        Parameters
        ----------
        tol : float
            Their largest distance, as a fraction of the attained width. Nine digits are enough.

        Returns
        -------
        bool
            False where an end is infinite, or none is attained.

        Examples
        --------
        >>> import setid
        >>> known = setid.ParameterInterval("b", (0, 2), (0.1, 2), setid.IntervalStatus.PARTIAL)
        >>> known.agrees(0.1), known.agrees(0.01)
        (True, False)
        """
        if self.inner is None:
            return False
        loose = max(self.inner[0] - self.outer[0], self.outer[1] - self.inner[1])
        near = self.gap <= tol * (1.0 + _DIGITS) or loose <= _DIGITS * max(map(abs, self.outer))
        return near and loose < inf

    def __contains__(self, value: float) -> bool:
        return self.outer[0] <= value <= self.outer[1]

    def __repr__(self) -> str:
        if self.status is IntervalStatus.EMPTY:
            return f"{self.name}: empty"
        low, high = (
            _shown(end, side, 6) for end, side in zip(self.outer, (False, True), strict=True)
        )
        return f"{self.name} in [{low}, {high}], attained {_attained(self.inner)}, {self.status}"


def overstated(intervals: Mapping[str, ParameterInterval], tol: float) -> str:
    """Name an interval that is called certified while its ends are too far apart.

    Parameters
    ----------
    intervals : mapping of str to ParameterInterval
    tol : float
        As of :meth:`ParameterInterval.agrees`.

    Returns
    -------
    str
        A sentence about the first such interval; empty where there is none.
    """
    for item in intervals.values():
        if item.status is IntervalStatus.CERTIFIED and not item.agrees(tol):
            return f"the ends of {item.name} are too far from each other for certified"
    return ""


def _shown(value: float, upwards: bool, digits: int) -> str:
    return rounded(value, upwards, digits)


def _attained(inner: tuple[float, float] | None) -> str:
    """Show an attained interval, rounded inwards, with more digits where it is short.

    Where both ends come from one vector, they may cross by what its proof rounds.
    """
    if inner is None:
        return "none"
    for digits in (6, 10, 15):
        low, high = _shown(inner[0], True, digits), _shown(inner[1], False, digits)
        if float(low) <= float(high):
            return f"[{low}, {high}]"
    return f"near {0.5 * inner[0] + 0.5 * inner[1]:.10g}"
