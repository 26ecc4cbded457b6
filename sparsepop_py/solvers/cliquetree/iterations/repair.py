"""Least-squares repair of the dual, before its value is read.

Rounding errors leave a residual d = -q - C'z - E'w of a size that no linear solve of the method
takes away, and over all moments it may cost more than the gap. The changes Z (Cx) Z of the
multipliers and v Ex of those of equalities remove it if (C'(Z x Z)C + v E'E) x = d, one more
system on the same tree; measured in the metric of Z they are the least ones, which is how z
stays in the cone. They are taken if it does and the safe value rises.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.solvers.cliquetree.iterations.numbers import Numbers
from sparsepop_py.solvers.cliquetree.iterations.progress import Iterate
from sparsepop_py.solvers.cliquetree.symbolic.fronts import FrontFactor
from sparsepop_py.solvers.cliquetree.symbolic.tree import Factor

__all__ = ["Repair", "safe_value"]

Reals = NDArray[np.float64]

_WEIGHT = 1e3  # v: multipliers of equalities may change more
_PASSES = 3  # of the projection, each of which also removes rounding of the one before
_SOFT = 1e-9  # multiple of the unit matrix that is added to Z in the weights


class Repair:
    """Repair of the points of one solve.

    Parameters
    ----------
    numbers : Numbers
    factor : Factor or FrontFactor
        Memory for a factorization; its content is lost.
    deadline : float, optional
        CPU time after which to give up.
    """

    def __init__(
        self, numbers: Numbers, factor: Factor | FrontFactor, deadline: float | None = None
    ) -> None:
        self._numbers = numbers
        self._factor = factor
        self._deadline = deadline

    def __call__(self, at: Iterate) -> Iterate:
        """Repair the multipliers of a point; return it as it was where nothing is gained.

        Raises
        ------
        OutOfTime
            If the deadline passes.
        """
        n, z, w = self._numbers, at.z, at.w
        soft = z + _SOFT * n.cone.identity()
        try:
            self._factorize(soft)
            for _ in range(_PASSES):
                x = self._factor.solve(-n.q - n.Ct @ z - n.rows_turned(w))
                z, w = z + n.cone.sandwich(soft, n.C @ x, soft), w + _WEIGHT * n.rows(x)
            n.cone.inverse_factor(z)
        except np.linalg.LinAlgError:
            return at
        new = replace(at, z=z, w=w)
        return new if safe_value(n, new) > safe_value(n, at) else at

    def _factorize(self, soft: Reals) -> None:
        n = self._numbers
        fixed = n.fixed_entries(_WEIGHT)
        n.fill(self._factor.entries, fixed, soft, soft, self._deadline)
        self._factor.refactor(1e-13, self._deadline)


def safe_value(numbers: Numbers, at: Iterate) -> float:
    """Compute the dual value less the largest effect of its residual.

    Moments lie in [-1, 1].
    """
    residual = -numbers.q - numbers.Ct @ at.z - numbers.rows_turned(at.w)
    return float(-numbers.c @ at.z - numbers.e @ at.w - np.abs(residual).sum())
