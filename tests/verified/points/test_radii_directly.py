"""Radii of points and the rows that were not solved, for a box around a zero that is given."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import sparsepop_py as sp
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.points import feasible_point
from sparsepop_py.verified.points.feasible_point import prove_point

ROW = np.zeros(1, np.int64)
z = sp.variables(1)[0]


def proved(monkeypatch, at, low, high, *others):
    """What is proved from the claim that [low, high] holds a zero of the first row."""
    box = Interval(np.array([low]), np.array([high]))
    monkeypatch.setattr(feasible_point, "polished", lambda system, x, solved: x)
    monkeypatch.setattr(feasible_point, "zero_near", lambda system, x, solved: box)
    problem = sp.Problem(z, [z**2 == 2, *others], [-9.0], [9.0])
    return prove_point(problem, np.array([at]), ROW, ROW, "krawczyk")


@pytest.mark.parametrize(
    "at, low, high",
    [
        (1.0, 0.1, 1.7),
        (1.0, 0.9, 3.1),
        (-(2.0**-60), -0.5, 1.0),  # 1 + 2^-60 rounds to 1
        (2.0**-60, -1.0, 0.5),
    ],
)
def test_the_radius_reaches_both_ends(monkeypatch, at, low, high):
    found = proved(monkeypatch, at, low, high)
    exact = max(Fraction(high) - Fraction(at), Fraction(at) - Fraction(low))
    assert Fraction(found.radius) >= exact
    assert found.radius <= float(exact) * (1 + 1e-15)


def test_other_equations_hold_all_over_the_box_or_nothing_is_proved(monkeypatch):
    """z^2 + z = 3 is positive on [1.4, 1.5]; 0 z = 0 holds everywhere."""
    assert proved(monkeypatch, 1.4, 1.4, 1.5, z**2 + z - 3 >= 0) is not None
    assert proved(monkeypatch, 1.4, 1.4, 1.5, z**2 + z == 3) is None
    assert proved(monkeypatch, 1.4, 1.4, 1.5, 3 - z**2 - z == 0) is None
