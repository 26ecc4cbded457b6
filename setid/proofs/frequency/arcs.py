"""Trigonometric polynomials with uncertain coefficients on arcs of the unit circle.

f(w; theta) = sum_k (alpha_k + beta_k theta) exp(-j k w). On an arc of half width h about w0 its
Taylor polynomial of degree d, in Bernstein form, lies in the convex hull of d + 1 points, each
affine in theta, and the remainder is at most sum_k abs(c_k) (abs(k - s) h)^(d+1) / (d+1)! after the
harmless factor exp(j s w). Proved ranges of the points over a polytope bound f on the whole arc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb, factorial, pi

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEGREE", "Arc", "Family", "bernstein", "first_arcs", "halves", "taylor"]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Arc = tuple[float, float]  # centre, half width
DEGREE = 3
_ROUNDING = 1e-13  # relative to the sum of abs(coefficients); see taylor
_FIRST = 24  # arcs


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """Coefficients alpha_k + beta_k theta of q^-k.

    Parameters
    ----------
    constants, weights : (K,), (K, p) float
        Within one unit in the last place of the exact ones.
    """

    constants: Reals
    weights: Reals

    @classmethod
    def of_products(
        cls, first: Sequence[Fraction], second: Sequence[Fraction], na: int, lags: Sequence[int]
    ) -> Family:
        """Sum first A(theta) + second B(theta), A = 1 + a_1 q^-1 + ..., B with given lags.

        Parameters
        ----------
        first, second : polynomials in q^-1
        na : int
        lags : sequence of int
            One for each coefficient of B.
        """
        size = max(len(first) + na, len(second) + max(lags, default=0))
        constants, weights = np.zeros(size), np.zeros((size, na + len(lags)))
        constants[: len(first)] = [float(c) for c in first]
        for i in range(1, na + 1):
            weights[i : i + len(first), i - 1] = [float(c) for c in first]
        for j, lag in enumerate(lags):
            weights[lag : lag + len(second), na + j] = [float(c) for c in second]
        return cls(constants, weights)

    @property
    def shift(self) -> float:
        """Half the degree: s of the factor exp(j s w)."""
        return 0.5 * (self.constants.size - 1)

    def padded(self, size: int) -> Family:
        """Pad with coefficients 0 up to a number of them."""
        more = size - self.constants.size
        return Family(np.pad(self.constants, (0, more)), np.pad(self.weights, ((0, more), (0, 0))))

    def divided(self) -> Family:
        """Divide by (1 - q^-1), a factor of every member of the family."""
        return Family(np.cumsum(self.constants)[:-1], np.cumsum(self.weights, axis=0)[:-1])

    def scaled(self, radius: float) -> Family:
        """Scale to the circle of a radius: coefficient k divided by radius^k."""
        powers = radius ** -np.arange(float(self.constants.size))
        return Family(self.constants * powers, self.weights * powers[:, None])

    def at(self, theta: Reals) -> Reals:
        """Compute coefficients (K,) for parameters (p,)."""
        return np.asarray(self.constants + self.weights @ theta, np.float64)


def first_arcs(count: int = _FIRST) -> list[Arc]:
    """List arcs that cover [0, pi]."""
    half = 0.5 * pi / count
    return [((2 * i + 1) * half, half * (1.0 + 1e-9)) for i in range(count)]


def halves(arc: Arc) -> list[Arc]:
    """Cut an arc into two that cover it."""
    centre, half = arc
    return [(centre + sign * half / 2, half / 2 * (1.0 + 1e-9)) for sign in (-1.0, 1.0)]


def bernstein(degree: int) -> Reals:
    """Build the matrix from coefficients of t^m on [-1, 1] to Bernstein coefficients."""
    found = np.zeros((degree + 1, degree + 1))
    for m in range(degree + 1):
        for i in range(degree + 1):  # t = 2 x - 1
            for r in range(min(m, i) + 1):
                power = comb(m, r) * 2.0**r * (-1.0) ** (m - r)
                found[i, m] += power * comb(i, r) / comb(degree, r)
    return found


def taylor(size: int, shift: float, arcs: Sequence[Arc]) -> tuple[Complexes, Reals, Reals]:
    """Expand in t in [-1, 1]: combinations of coefficients, and the remainder.

    Parameters
    ----------
    size : int
        Number K of coefficients.
    shift : float
        s of the factor exp(j s w).
    arcs : sequence of (centre, half width)

    Returns
    -------
    powers : (arcs, DEGREE + 1, K) complex
    remainders : (arcs, K) float
        For each unit of a coefficient.
    rounding : (arcs, K) float
        For each unit of what a coefficient is summed from, products with a Bernstein matrix of
        degree up to DEGREE + 1 included.
    """
    centre, half = np.array(arcs).T
    lag = np.arange(size) - shift
    turn = np.exp(-1j * centre[:, None] * lag)  # (arcs, K)
    step = half[:, None] * lag
    powers = np.stack([(-1j * step) ** m / factorial(m) for m in range(DEGREE + 1)], axis=1)
    rest = np.abs(step) ** (DEGREE + 1) / factorial(DEGREE + 1) * (1.0 + 1e-12)
    most = np.abs(bernstein(DEGREE + 1)).sum(axis=1).max()
    grown = np.exp(np.minimum(np.abs(step), 50.0)) * most
    return powers * turn[:, None, :], rest, _ROUNDING * (size + 10) * grown
