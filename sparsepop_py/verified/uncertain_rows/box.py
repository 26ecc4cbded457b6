"""Bounds of parameters: what all boxes have in common, however they are proved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.verified.arithmetic.array_checks import at_least
from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["Bounds", "Box", "gained"]

Reals = NDArray[np.float64]
Box = tuple[Reals, Reals]
_GAINED = 0.9  # another round follows where a width fell below this share


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Bounds(ReadOnly):
    """Proved bounds of parameters.

    Parameters
    ----------
    names : tuple of str
    lower, upper : (p,) float
        Infinite where nothing is proved; lower > upper where no parameter is consistent.
    """

    names: tuple[str, ...]
    lower: Reals
    upper: Reals

    @property
    def empty(self) -> bool:
        """True if it is proved that no parameter vector is consistent."""
        return bool(np.any(self.lower > self.upper))

    def follow(self, low: Reals, high: Reals) -> bool:
        """Check that they hold a proved box of one pair of ends a parameter.

        Parameters
        ----------
        low, high : (p,) float
        """
        return at_least(low, self.lower) and at_least(self.upper, high)

    @property
    def cut_short(self) -> bool:
        """True if time ended before all that could tighten the box was tried."""
        return False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._text()}>"

    def _text(self) -> str:
        """Format the ends, rounded outwards."""
        if self.empty:
            return "empty, proved"
        triples = zip(self.names, self.lower.tolist(), self.upper.tolist(), strict=True)
        return ", ".join(
            f"{name} in [{rounded(low, False, 6)}, {rounded(high, True, 6)}]"
            for name, low, high in triples
        )


def gained(old: Box | Reals, new: Box | Reals) -> bool:
    """Check that some width shrank by enough for another round."""
    with np.errstate(invalid="ignore"):
        before, after = old[1] - old[0], new[1] - new[0]
        smaller = (after < _GAINED * before) | (np.isinf(before) & np.isfinite(after))
    return bool(np.any(smaller))
