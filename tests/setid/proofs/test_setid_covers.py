"""Rows and ranges of covers against exact rationals, where one rounding decides."""

from __future__ import annotations

from fractions import Fraction
from math import inf
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from setid.proofs.supports import Cover, _chords, box_ranges, cover

RNG = np.random.default_rng(5)


def rationals(values: Any) -> list[Fraction]:
    return [Fraction(float(v)) for v in values]


def product(left: Any, right: list[Fraction]) -> Fraction:
    return sum((a * b for a, b in zip(rationals(left), right, strict=True)), Fraction(0))


def rounded_up(value: Fraction) -> float:
    found = float(value)
    return found if Fraction(found) >= value else float(np.nextafter(found, inf))


def box_of(low: Any, high: Any) -> Cover:
    low, high = np.array(low, float), np.array(high, float)
    names = tuple("abcdefgh"[: low.size])
    return Cover(names, low, high, np.zeros((0, low.size)), np.zeros(0), True)


# ---- ranges over boxes ------------------------------------------------------------------


def test_ranges_over_boxes_hold_the_exact_ones() -> None:
    low = RNG.normal(size=(200, 4))
    high = low + np.abs(RNG.normal(size=(200, 4)))
    for ends, direction in zip(zip(low, high, strict=True), RNG.normal(size=(200, 4)), strict=True):
        pairs = [
            sorted((d * a, d * b))
            for d, a, b in zip(*map(rationals, (direction, *ends)), strict=True)
        ]
        (found,) = box_ranges(box_of(*ends), direction[None, :])
        assert Fraction(float(found[0])) <= sum(pair[0] for pair in pairs)
        assert Fraction(float(found[1])) >= sum(pair[1] for pair in pairs)


def test_ranges_over_boxes_hold_products_that_underflow() -> None:
    """1e-200 * 1e-200 is 1e-400, which is more than the double 0."""
    (found,) = box_ranges(box_of([-1e-200], [1e-200]), np.array([[1e-200]]))
    assert found[0] < 0 < found[1]
    (found,) = box_ranges(box_of([0.0], [0.0]), np.array([[1e-200]]))
    assert found[0] == 0 == found[1]


@pytest.mark.parametrize("sign", [1, -1])
def test_ranges_over_boxes_hold_what_overflows(sign: int) -> None:
    """No infinity bounds 2e200 * 1e200 = 2e400 on its own side, nor a sum of large numbers."""
    (one,) = box_ranges(box_of([1e200], [2e200]), np.array([[sign * 1e200]]))
    large = np.full(2, 1.5e308)
    (two,) = box_ranges(box_of(large, large), np.array([[sign, sign]], float))
    for found, value in ((one, 2 * 10**400), (two, 3 * 10**308)):
        assert found[0] == -inf or Fraction(float(found[0])) <= sign * value
        assert found[1] == inf or Fraction(float(found[1])) >= sign * value


# ---- rows of the regression -------------------------------------------------------------

BOXES = {
    "mixed": ([-0.7, -1.3, -2.1], [1.9, 0.3, 1.1]),
    "positive": ([0.3, 0.1, 0.7], [1.9, 0.3, 1.1]),
    "negative": ([-0.7, -1.3, -2.1], [-0.1, -0.3, -1.1]),
    "one of each": ([-0.7, 0.1, -2.1], [1.9, 0.3, -1.1]),
}


def stated(target: Any, regressors: Any, radius: Any, radii: Any) -> Any:
    """What :func:`cover` reads of a formulation with these rows and no other constraint."""
    problem = SimpleNamespace(constraints=(), degree=2, dimension=radii.shape[1])
    rows = SimpleNamespace(target=target, regressors=regressors, radius=radius, radii=radii)
    names = tuple("abcdefgh"[: radii.shape[1]])
    return SimpleNamespace(parameters=names, problem=problem, smoothed=rows)


def rows_through(theta: Any) -> Any:
    """Rows |Y + R theta| <= w + W |theta| that theta just obeys, with either side tight."""
    count, p = len(theta), theta.shape[1]
    target, regressors = RNG.normal(size=count), RNG.normal(size=(count, p))
    radii = np.abs(RNG.normal(size=(count, p)))
    radius = np.empty(count)
    for k, point in enumerate(theta):
        exact = rationals(point)
        away = Fraction(target[k]) + product(regressors[k], exact)
        width = product(radii[k], [abs(t) for t in exact])
        if abs(away) < width:
            target[k] += 100.0 if k % 2 else -100.0
            away = Fraction(target[k]) + product(regressors[k], exact)
        radius[k] = rounded_up(abs(away) - width)
    return target, regressors, radius, radii


@pytest.mark.parametrize("name", BOXES)
@pytest.mark.parametrize("size", [1.0, 1e-8, 1e12])
def test_rows_hold_where_noise_is_largest(name: str, size: float) -> None:
    """At corners the chords are abs(theta) itself, and rows hold with equality."""
    low, high = (np.array(end) * size for end in BOXES[name])
    corners = np.where(RNG.random((60, 3)) < 0.5, low, high)
    inside = np.clip(low + RNG.random((60, 3)) * (high - low), low, high)
    for theta in (corners, inside):
        found = cover(stated(*rows_through(theta)), low, high)
        assert found.right.size >= 20
        for row, right in zip(found.matrix, found.right, strict=True):
            assert np.all(np.isfinite(row)) and np.isfinite(right)
    for theta in (corners, inside):
        for point in theta:
            found = cover(stated(*rows_through(point[None, :])), low, high)
            for row, right in zip(found.matrix, found.right, strict=True):
                assert product(row, rationals(point)) <= Fraction(float(right))


def test_chords_lie_above_the_absolute_value() -> None:
    low, high = -np.abs(RNG.normal(size=500)), np.abs(RNG.normal(size=500))
    low[:100], high[50:150] = low[:100] * 1e-318, high[50:150] * 1e-318  # with few digits
    for a, b, slope, level in zip(*map(rationals, (low, high, *_chords(low, high))), strict=True):
        assert -a <= slope * a + level and b <= slope * b + level


@pytest.mark.parametrize("low, high", [(-inf, inf), (0.0, inf), (-inf, 0.0), (-1.0, inf)])
def test_rows_hold_where_parameters_have_no_bounds(low: float, high: float) -> None:
    """The rounding of R - W grows with the parameters, so that no constant makes up for it."""
    for size in (1.0, 1e20):
        theta = np.abs(RNG.normal(size=(40, 3))) * size
        theta = -theta if high <= 0 else theta
        ends = np.full(3, low), np.full(3, high)
        for point in theta:
            given = stated(*rows_through(point[None, :]))
            found = cover(given, *ends)
            for row, right in zip(found.matrix, found.right, strict=True):
                assert product(row, rationals(point)) <= Fraction(float(right))


def test_rows_without_noise_of_regressors_need_no_bounds() -> None:
    one = np.ones(1)
    found = cover(stated(one, np.ones((1, 1)), one, np.zeros((1, 1))), -one * inf, one * inf)
    assert sorted(found.matrix[:, 0].tolist()) == [-1.0, 1.0]
    assert np.all(found.right >= [0.0, 2.0]) and np.all(found.right <= [1e-12, 2.0 + 1e-12])


def test_rows_hold_where_the_ends_are_too_far_apart_for_a_chord() -> None:
    """With high - low beyond all doubles noise of regressors may explain parameters of any size."""
    one, ends = np.ones(1), np.full(1, 1e308)
    given = stated(0.1 * one, np.full((1, 1), 0.1), one, np.full((1, 1), 0.15))
    found = cover(given, -ends, ends)
    for theta in (-1e300, 1e300, 1e308):  # abs(0.1 + 0.1 theta) <= 1 + 0.15 abs(theta)
        for row, right in zip(found.matrix, found.right, strict=True):
            assert product(row, rationals([theta])) <= Fraction(float(right))
