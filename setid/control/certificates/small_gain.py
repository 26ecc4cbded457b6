"""Stability by the small-gain theorem: Delta = M - F P with F = K (1 - M) as one fraction.

From 1 - Delta = (1 - M) (1 + K P): where Delta is stable and abs(Delta) < 1 on the whole circle,
1 - Delta has no zero outside, and neither has 1 + K P. This holds for every P, also where the
ideal controller of P does not exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf

import numpy as np
from numpy.typing import NDArray

from setid.control.certificates.arcs import Ceiling, Family, ratio_on_arcs, zero_free
from setid.control.certificates.cells import Attempt
from setid.control.engine import TransferFunction
from setid.control.parameters.parameter_set import ParameterSet
from setid.control.transfer import Transfer, is_schur, times

__all__ = ["SmallGain", "denominator_of", "lags_of"]

Reals = NDArray[np.float64]
_SPARE = 0.1  # of what is left to 1 above the nominal maximum, below which arcs are not refined
_BELOW_ONE = 1.0 - 1e-9


def lags_of(model: TransferFunction) -> list[int]:
    """List the lags of the numerator coefficients."""
    return [model.nk[0][0] + j for j in range(model.nb[0][0])]


def denominator_of(model: TransferFunction, integrators: int = 0) -> Family:
    """Write the plant's denominator A; with an integrator its quotient by 1 - q^-1."""
    family = Family.of_products([Fraction(1)], [], model.na[0][0], lags_of(model))
    size = model.na[0][0] + 1
    family = Family(family.constants[:size], family.weights[:size])
    return family.divided() if integrators else family


@dataclass(frozen=True, slots=True)
class SmallGain:
    """The proof of abs(Delta) < 1 on one parameter set.

    Parameters
    ----------
    model : TransferFunction
    factor, reference : Transfer
        F and M. With a plant integrator F = K (1 - M) / (1 - q^-1).
    integrators : int
    margin : float, optional
        What is assumed of the poles of P; None: their stability is proved.
    ceiling : Ceiling, optional
        Bounds of abs(Delta) that are to be proved again; any below 1 when left out.
    """

    model: TransferFunction
    factor: Transfer
    reference: Transfer
    integrators: int
    margin: float | None
    ceiling: Ceiling | None = None

    def families(self) -> tuple[Family, Family, Family]:
        """Write numerator and denominator of Delta, and the denominator of P."""
        na, lags = self.model.na[0][0], lags_of(self.model)
        m, f = self.reference, self.factor
        own = denominator_of(self.model, self.integrators)
        below = _times(own, times(m.denominator, f.denominator))
        first = _times(own, times(m.numerator, f.denominator))
        second = [-c for c in times(m.denominator, f.numerator)]
        b = Family.of_products([Fraction(0)], second, na, lags)
        size = max(x.constants.size for x in (below, first, b))
        first, b, below = (x.padded(size) for x in (first, b, below))
        top = Family(first.constants + b.constants, first.weights + b.weights)
        return top, below, own

    def attempt(
        self, found: ParameterSet, hint: Sequence[float] = (), until: float = inf
    ) -> Attempt:
        """Bound abs(Delta) on arcs; failing frequencies where the bound is 1 or more."""
        top, below, own = self.families()
        theta = found.centre
        if self.margin is None:
            bad = zero_free(found, own, theta, hint=hint, until=until)
            if bad or not is_schur([Fraction(c) for c in own.at(theta)]):
                return Attempt(False, bad or [0.0], (), own)
        if hint and not max(b for *_, b in self._gains(found, theta, hint)) < _BELOW_ONE:
            return Attempt(False, list(hint), (), below)
        nominal = _nominal(top, below, theta)
        enough = nominal + _SPARE * max(1.0 - nominal, 0.0)
        arcs = tuple(
            ratio_on_arcs(found, top, below, theta, enough, until=until, ceiling=self.ceiling)
        )
        bad = [0.5 * (a + b) for a, b, bound in arcs if not self._enough(a, b, bound)]
        return Attempt(not bad, bad, arcs, below)

    def _enough(self, low: float, high: float, bound: float) -> bool:
        """Check a bound on an arc against 1, and against what is to be proved there."""
        asked = inf if self.ceiling is None else self.ceiling.over(low, high)
        return bound < _BELOW_ONE and bound <= asked

    def _gains(
        self, found: ParameterSet, theta: Reals, omega: Sequence[float]
    ) -> list[tuple[float, float, float]]:
        """Bounds at single frequencies."""
        top, below, _ = self.families()
        return ratio_on_arcs(found, top, below, theta, inf, [(w, 0.0) for w in omega])

    def excluded(self, found: ParameterSet) -> bool:
        """Check that no member of a set obeys the margin."""
        if self.margin is None:
            return False
        own = denominator_of(self.model, self.integrators)
        radius, theta = 1.0 - self.margin, found.centre
        outside = not is_schur([Fraction(c) for c in own.at(theta)], Fraction(radius))
        return outside and not zero_free(found, own.scaled(radius), theta)


def _times(family: Family, factor: tuple[Fraction, ...]) -> Family:
    """A family times a known polynomial."""
    values = np.array([float(c) for c in factor])
    columns = [np.convolve(column, values) for column in family.weights.T]
    return Family(np.convolve(family.constants, values), np.stack(columns, axis=1))


def _nominal(top: Family, below: Family, theta: Reals) -> float:
    """Largest abs(Delta) of nominal parameters on a grid (computed)."""
    step = np.exp(-1j * np.linspace(0.0, np.pi, 2001))
    values = [np.polynomial.polynomial.polyval(step, f.at(theta)) for f in (top, below)]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.abs(values[0] / values[1])
    return float(found.max()) if np.all(np.isfinite(found)) else inf
