"""Enclosures of activations against arbitrary precision (mpmath, an independent oracle)."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from setid.neural import arithmetic
from setid.neural.arithmetic import Interval, nowhere_above

SMOOTH = {
    "tanh": mpmath.tanh,
    "sigmoid": lambda x: 1 / (1 + mpmath.exp(-x)),
    "algebraic": lambda x: x / mpmath.sqrt(1 + x * x),
}
NASTY = [0.0, -0.0, 5e-324, 1e-310, 1e-160, 1e-8, 1 / 64, np.nextafter(1 / 64, 0), 0.5, 1.0,
         17.3, 19.0, 19.999, 20.0, 20.0001, 40.0, 41.0, 745.0, 1e9, 1e200, 1e308]  # fmt: skip


@pytest.fixture(autouse=True)
def precision():
    with mpmath.workdps(60):
        yield


def arguments(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    spread = rng.normal(size=count) * 10.0 ** rng.uniform(-12, 2, size=count)
    return np.concatenate([NASTY, np.negative(NASTY), spread])


def test_exp_holds_the_truth_and_is_narrow() -> None:
    y = np.abs(arguments(4000))
    found = arithmetic.exp_negative(y)
    for a, low, high in zip(y.tolist(), found.lo.tolist(), found.hi.tolist(), strict=True):
        truth = mpmath.exp(-mpmath.mpf(a))
        assert mpmath.mpf(low) <= truth <= mpmath.mpf(high), a
    inside = y <= 40
    assert np.all((found.hi - found.lo)[inside] <= 2e-15 * found.hi[inside])


def test_table_entries_are_the_nearest_doubles() -> None:
    table = arithmetic._table()
    for n, value in enumerate(table.tolist()):
        truth = mpmath.exp(-mpmath.mpf(n) / 64)
        assert abs(mpmath.mpf(value) - truth) <= mpmath.mpf(2) ** -53 * mpmath.mpf("1.01") * truth


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_activations_hold_the_truth(name: str) -> None:
    x = arguments(4000)
    found = arithmetic.enclose(name, Interval.point(x))
    for a, low, high in zip(x.tolist(), found.lo.tolist(), found.hi.tolist(), strict=True):
        truth = SMOOTH[name](mpmath.mpf(a))
        assert mpmath.mpf(low) <= truth <= mpmath.mpf(high), a
    assert np.max(found.hi - found.lo) <= 4e-15


@pytest.mark.parametrize("name", SMOOTH)
def test_slopes_hold_the_truth(name: str) -> None:
    x = arguments(500)[np.abs(arguments(500)) < 1e3]
    found = arithmetic.slope_at(name, x)
    for a, low, high in zip(x.tolist(), found.lo.tolist(), found.hi.tolist(), strict=True):
        z = SMOOTH[name](mpmath.mpf(a))
        truth = {"tanh": 1 - z * z, "sigmoid": z * (1 - z), "algebraic": (1 - z * z) ** 1.5}[name]
        assert mpmath.mpf(low) <= truth + mpmath.mpf(10) ** -50, a
        assert truth <= mpmath.mpf(high) + mpmath.mpf(10) ** -50, a


def test_what_is_no_number_gives_the_whole_range() -> None:
    found = arithmetic.enclose("tanh", Interval(np.array([np.nan]), np.array([np.inf])))
    assert found.lo[0] == -1.0 and found.hi[0] == 1.0
    found = arithmetic.enclose("sigmoid", Interval(np.array([-np.inf]), np.array([np.nan])))
    assert found.lo[0] == 0.0 and found.hi[0] == 1.0


@pytest.mark.parametrize("name", arithmetic.ACTIVATIONS)
def test_linear_enclosures_are_never_crossed(name: str) -> None:
    rng = np.random.default_rng(1)
    centre = rng.normal(size=2000) * rng.choice([0.1, 1.0, 5.0], size=2000)
    width = 10.0 ** rng.uniform(-12, 1.3, size=2000)
    x = Interval(centre - width, centre + width)
    slope, offset, radius = arithmetic.linearise(name, x, leak=0.1)
    for part in np.linspace(0.0, 1.0, 501):  # 10^6 points
        a = np.clip(x.lo + part * (x.hi - x.lo), x.lo, x.hi)
        gap = np.abs(arithmetic.activate(name, a, 0.1) - slope * a - offset)
        assert np.all(gap <= radius * (1 + 1e-12) + 1e-15 * (1 + np.abs(slope * a)))
    # not wider than the constant enclosure by half of the range
    found = arithmetic.enclose(name, x, 0.1)
    assert np.all(radius <= 0.5 * (found.hi - found.lo) + 1e-12)


def test_linear_enclosures_close_faster_than_the_interval() -> None:
    """The radius of the secant enclosure is of second order: about |f''| w^2 / 4."""
    for width in (1e-1, 1e-2, 1e-3):
        x = Interval(np.array([1.0 - width]), np.array([1.0 + width]))
        _, _, radius = arithmetic.linearise("tanh", x)
        curvature = 2 * np.tanh(1.0) * (1 - np.tanh(1.0) ** 2)
        assert radius[0] == pytest.approx(curvature * width**2 / 4, rel=0.15)


def test_bands_are_compared_sample_by_sample_and_claim_nothing_at_the_same_samples() -> None:
    one = np.array([1.0, np.nan])
    assert nowhere_above(one, one) and nowhere_above(one, np.array([1.5, np.nan]))
    assert not nowhere_above(one, np.array([0.5, np.nan]))
    filled = np.array([1.5, 0.0])
    assert not nowhere_above(one, filled) and not nowhere_above(filled - 1.0, one)
    for other in (np.zeros(0), np.full(1, 9.0), np.full((2, 1), 9.0)):
        assert not nowhere_above(one, other) and not nowhere_above(other - 99.0, one)
