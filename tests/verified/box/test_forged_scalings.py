"""Scalings of boxes that they do not contain, and scalings that are none, in rationals."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaling

INF = np.inf


def box_of(low, high):
    return Interval(np.atleast_1d(np.array(low, float)), np.atleast_1d(np.array(high, float)))


def unit(n=1, **fields):
    """x = t in [-1, 1]."""
    return replace(
        Scaling(np.zeros(n), np.ones(n), np.ones(n, bool), np.zeros(n, np.int64)), **fields
    )


def of(*values):
    return np.array(values, float)


# ---- what contains a box ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "low, high, inside",
    [
        (-0.5, 0.5, True),
        (-1.5, 0.5, False),
        (-0.5, 1.5, False),
        (-1.5, 1.5, False),
        (-INF, 0.5, False),
        (-0.5, INF, False),
    ],
)
def test_both_ends_of_every_variable_lie_inside(low, high, inside):
    assert unit().contains(box_of(low, high)) == inside
    for order in ((low, 0.0), (0.0, low)):
        ends = [0.0 if v == 0.0 else high for v in order]
        assert unit(2).contains(box_of(order, ends)) == inside


@pytest.mark.parametrize("seed", range(10))
def test_ends_of_t_are_compared_in_rationals(seed):
    """centre + scale t with all digits: a box that begins at the double beyond is refused."""
    rng = np.random.default_rng(seed)
    for _ in range(60):
        centre = float(rng.normal() * 10.0 ** rng.integers(-3, 4))
        scale = float(rng.uniform(0.5, 2) * 10.0 ** rng.integers(-3, 4))
        a, b = -rng.uniform(0.1, 1), rng.uniform(0.1, 1)
        scaling = unit(centre=of(centre), scale=of(scale), ends=(of(a), of(b)))
        low = Fraction(centre) + Fraction(scale) * Fraction(a)
        high = Fraction(centre) + Fraction(scale) * Fraction(b)
        for steps in range(-3, 4):
            start, end = float(low), float(high)
            start, end = start + steps * np.spacing(start), end + steps * np.spacing(end)
            middle = 0.5 * start + 0.5 * end
            if scaling.contains(box_of(start, middle)):
                assert Fraction(start) >= low
            if scaling.contains(box_of(middle, end)):
                assert Fraction(end) <= high
            if scaling.contains(box_of(start, end)):
                assert Fraction(start) >= low and Fraction(end) <= high


def test_half_lines_are_compared_at_their_end():
    for side, ends in ((1, None), (-1, None), (0, (of(0.0), of(INF))), (0, (of(-INF), of(0.0)))):
        scaling = unit(boxed=np.zeros(1, bool), side=np.array([side]), ends=ends)
        right = side > 0 or (ends is not None and ends[1][0] == INF)
        assert scaling.contains(box_of(0.0, INF) if right else box_of(-INF, 0.0))
        assert not scaling.contains(box_of(-INF, INF))
        assert not scaling.contains(box_of(-5e-324, INF) if right else box_of(-INF, 5e-324))
    free = unit(boxed=np.zeros(1, bool))
    assert free.contains(box_of(-INF, INF)) and free.contains(box_of(-1e300, 1e300))


def test_fixed_variables_have_their_value():
    fixed = unit(2, centre=of(2.0, 0.0), scale=of(0.0, 1.0))
    assert fixed.contains(box_of([2.0, -0.5], [2.0, 0.5]))
    for low, high in ((2.0, 2.5), (1.5, 2.0), (3.0, 3.0), (1.0, 1.0)):
        assert not fixed.contains(box_of([low, -0.5], [high, 0.5]))


@pytest.mark.parametrize("scale", [-1.0, -0.5])
def test_scales_that_turn_a_variable_around_contain_nothing(scale):
    """x = -t with t in [-1, 1/2] is x in [-1/2, 1]."""
    for fields in ({}, {"ends": (of(-1.0), of(0.5))}, {"ends": (of(1.0), of(1.0))}):
        assert not unit(scale=of(scale), **fields).contains(box_of(-0.25, 0.25))
        assert not unit(scale=of(scale), **fields).contains(box_of(0.0, 0.0))
    open_ = np.zeros(1, bool)
    for side in (-1, 0, 1):
        turned = unit(scale=of(scale), boxed=open_, side=np.array([side]))
        assert not turned.contains(box_of(0.0, INF))
        assert not replace(turned, scale=of(0.0)).contains(box_of(0.0, INF))
        assert not replace(turned, scale=of(0.0)).contains(box_of(0.0, 0.0))


@pytest.mark.parametrize("wrong", [INF, -INF, np.nan])
def test_centres_and_scales_are_numbers(wrong):
    box = box_of([-0.5, -0.5], [0.5, 0.5])
    assert unit(2).contains(box)
    for fields in ({"centre": of(0.0, wrong)}, {"scale": of(wrong, 1.0)}):
        with np.errstate(all="ignore"):
            assert not unit(2, **fields).contains(box)
            open_ = unit(2, boxed=np.zeros(2, bool), **fields)
            assert not open_.contains(box_of([-INF] * 2, [INF] * 2))


# ---- what is a scaling ------------------------------------------------------------------------

GOOD = (of(-1.0, -INF, 0.0), of(0.5, INF, INF))


def three(**fields):
    return replace(
        Scaling(
            np.zeros(3), np.ones(3), np.array([True, False, False]), np.zeros(3, np.int64), GOOD
        ),
        **fields,
    )


def test_a_good_scaling_fits():
    assert three().fits(3) and three(ends=None).fits(3)
    assert three().contains(box_of([-0.9, -INF, 0], [0.4, INF, INF]))
    assert not three().fits(2) and not three().fits(4)


@pytest.mark.parametrize("name", ["centre", "scale", "boxed", "side", "low", "high"])
@pytest.mark.parametrize("shape", [2, 4, "row", "none"])
def test_every_array_has_one_number_a_variable(name, shape):
    def cut(array):
        if shape == "row":
            return array[None]
        return array[0] if shape == "none" else np.resize(array, shape)

    low, high = GOOD
    if name == "low":
        wrong = three(ends=(cut(low), high))
    elif name == "high":
        wrong = three(ends=(low, cut(high)))
    else:
        wrong = three(**{name: cut(getattr(three(), name))})
    assert not wrong.fits(3)


@pytest.mark.parametrize("name", ["centre", "scale", "low", "high"])
@pytest.mark.parametrize("kind", [np.float32, np.longdouble, int, object, complex])
def test_numbers_are_doubles(name, kind):
    low, high = of(-1.0, -1.0, 0.0), of(0.5, 1.0, 1.0)
    assert three(ends=(low, high)).fits(3)
    given = {"centre": np.zeros(3), "scale": np.ones(3), "low": low, "high": high}
    given[name] = given[name].astype(kind)
    ends = (given.pop("low"), given.pop("high"))
    assert not three(ends=ends, **given).fits(3)


@pytest.mark.parametrize("kind", [int, float, np.int8, object])
def test_what_is_boxed_is_a_truth_value(kind):
    """As numbers, [1, 0, 0] would choose columns."""
    assert not three(boxed=three().boxed.astype(kind)).fits(3)


@pytest.mark.parametrize(
    "low, high",
    [
        ((-1.5, -INF, 0), (0.5, INF, INF)),
        ((-1, -INF, 0), (1.5, INF, INF)),
        ((0.75, -INF, 0), (0.5, INF, INF)),
        ((-1, 1, 0), (0.5, -1, INF)),
        ((-1, -INF, 5), (0.5, INF, 4)),
        ((-1, INF, 0), (0.5, INF, INF)),
        ((-1, -INF, 0), (0.5, -INF, INF)),
        ((-1, -INF, INF), (0.5, INF, INF)),
        ((-INF, -INF, 0), (0.5, INF, INF)),
        ((-1, -INF, 0), (INF, INF, INF)),
        ((np.nan, -INF, 0), (0.5, INF, INF)),
        ((-1, -INF, 0), (0.5, np.nan, INF)),
        ((-1e-200, -INF, 0), (0.5, INF, INF)),
        ((-1, -INF, 0), (1e-200, INF, INF)),
        ((-1, -INF, -5e-324), (0.5, INF, INF)),
    ],
)
def test_ends_of_t_are_intervals_of_real_numbers(low, high):
    """Within [-1, 1] where boxed, in order, and large enough for their products to be doubles."""
    scaling = three(ends=(of(*low), of(*high)))
    assert not scaling.fits(3)
    for box in (box_of([0, 0, 4], [0, 0, 4]), box_of([-0.5, 5, 5], [0.25, 5, 5])):
        assert not scaling.contains(box)


def test_bounds_of_t_are_those_of_boxes_sides_and_nothing():
    scaling = Scaling(
        np.zeros(5),
        of(1, 0, 1, 1, 1),
        np.array([True, True, False, False, False]),
        np.array([0, 0, 1, -1, 0]),
    )
    low, high = scaling.bounds
    assert low.tolist() == [-1, 0, 0, -INF, -INF]
    assert high.tolist() == [1, 0, INF, 0, INF]
