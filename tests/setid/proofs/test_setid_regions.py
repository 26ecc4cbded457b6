"""Rounding of regions of responses and of static bands, against exact values."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from typing import Any

import mpmath
import numpy as np

import setid
from setid.feasible_set.proposer import Proposer
from setid.feasible_set.supports import supports
from setid.proofs.block_bands import map_ends
from setid.proofs.frequency.regions import _rectangles, rounding_of
from setid.proofs.supports import Cover
from setid.simulation.responses import frequency_weights

RNG = np.random.default_rng(11)


def unit_box(p: int) -> Cover:
    names = tuple("abcdefgh"[:p])
    return Cover(names, np.full(p, -1.0), np.ones(p), np.zeros((0, p)), np.zeros(0), True)


def at_corners(constant: float, slopes: Any) -> list[Fraction]:
    """Exact values of constant + slopes'theta at the corners of the unit box."""
    exact = [Fraction(float(s)) for s in slopes]
    return [
        Fraction(constant) + sum(s * sign for s, sign in zip(exact, signs, strict=True))
        for signs in product((-1, 1), repeat=len(exact))
    ]


def test_rectangles_hold_the_rounding_of_their_constants() -> None:
    """Constants a thousand times the rest: what supports allows for rounding does not cover it."""
    constants: Any = 1e3 * (RNG.normal(size=100) + 1j * RNG.normal(size=100))
    weights = RNG.normal(size=(100, 2)) + 1j * RNG.normal(size=(100, 2))
    low, high = _rectangles(unit_box(2), constants, weights, 2.0**-48, Proposer)
    for k in range(100):
        for part in ("real", "imag"):
            values = at_corners(float(getattr(constants[k], part)), getattr(weights[k], part))
            assert Fraction(float(getattr(low[k], part))) <= min(values)
            assert Fraction(float(getattr(high[k], part))) >= max(values)


def test_allowances_hold_the_rounding_of_angles_of_large_lags() -> None:
    """exp(-j omega lag) against 60 digits; the product with the lag is rounded."""
    for delay in (1, 50, 1000, 20000):
        model = setid.TransferFunction(0, 1, delay)
        omega = RNG.uniform(0.0, np.pi, 200)
        weights = frequency_weights(model, 1, 1, omega, 1.0)[0][:, 0]
        with mpmath.workdps(60):
            off = max(
                abs(mpmath.expj(-mpmath.mpf(float(w)) * delay) - mpmath.mpc(complex(found)))
                for w, found in zip(omega, weights, strict=True)
            )
        assert off <= rounding_of(model, 1, 1)


def test_static_bands_hold_the_rounding_of_their_constants() -> None:
    slopes, constant = RNG.normal(size=(100, 2)), 1e3 * RNG.normal(size=100)
    found = map_ends(supports(unit_box(2), slopes), constant, np.zeros(100))
    for k, (low, high) in enumerate(zip(*found, strict=True)):
        values = at_corners(float(constant[k]), slopes[k])
        assert Fraction(float(low)) <= min(values) and max(values) <= Fraction(float(high))
