"""Stability without small gain: the characteristic polynomial has no zero on or outside the circle.

C = D_K A + N_K B is affine in theta. On a connected set on which the leading coefficient keeps its
sign and no C has a zero on the unit circle, all C have as many zeros inside as any one of them;
that one is decided in rationals. For a polytope the test at each frequency is exact (a half plane
separates a convex set from 0), so that no common Lyapunov function is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.control.certificates.arcs import Family, zero_free
from setid.control.certificates.cells import Attempt
from setid.control.certificates.small_gain import lags_of
from setid.control.engine import TransferFunction
from setid.control.parameters.parameter_set import ParameterSet
from setid.control.transfer import Transfer, is_schur, times

__all__ = ["Characteristic", "closed_loop_polynomial", "polynomials_of"]

Reals = NDArray[np.float64]


def polynomials_of(model: TransferFunction, theta: Reals) -> tuple[list[Fraction], list[Fraction]]:
    """Write A and B in powers of q^-1, exactly as the doubles are."""
    na, lags = model.na[0][0], lags_of(model)
    below = [Fraction(1), *(Fraction(float(t)) for t in theta[:na])]
    top = [Fraction(0)] * (max(lags) + 1)
    for lag, value in zip(lags, theta[na:], strict=True):
        top[lag] = Fraction(float(value))
    return below, top


def closed_loop_polynomial(
    controller: Transfer, model: TransferFunction, theta: Reals
) -> list[Fraction]:
    """Compute C = D_K A + N_K B in powers of q^-1, exactly."""
    a, b = polynomials_of(model, theta)
    first, second = times(controller.denominator, a), times(controller.numerator, b)
    size = max(len(first), len(second))
    found = [Fraction(0)] * size
    for part in (first, second):
        for lag, value in enumerate(part):
            found[lag] += value
    return found


@dataclass(frozen=True, slots=True)
class Characteristic:
    """The proof that every closed loop is stable, on one parameter set.

    Parameters
    ----------
    model : TransferFunction
    controller : Transfer
    """

    model: TransferFunction
    controller: Transfer

    @property
    def family(self) -> Family:
        """C with coefficients affine in theta."""
        k = self.controller
        return Family.of_products(
            k.denominator, k.numerator, self.model.na[0][0], lags_of(self.model)
        )

    def attempt(
        self, found: ParameterSet, hint: Sequence[float] = (), until: float = inf
    ) -> Attempt:
        """Prove zero exclusion, the leading coefficient's sign, and one stable loop."""
        family, theta = self.family, found.centre
        low, _ = found.ranges(family.constants[:1], family.weights[:1])
        lead = float(low[0]) > 0.0 and family.at(theta)[0] > 0.0
        if not lead or not is_schur(closed_loop_polynomial(self.controller, self.model, theta)):
            return Attempt(False, [0.0], (), family)
        bad = zero_free(found, family, theta, hint=hint, until=until)
        return Attempt(not bad, bad, (), family)

    def excluded(self, found: ParameterSet) -> bool:
        """Exclude no set: nothing is assumed that could."""
        return False
