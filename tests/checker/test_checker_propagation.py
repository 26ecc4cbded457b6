"""Sweeps of interval propagation in the second checker."""

from __future__ import annotations

import math

import pytest

from checker.arithmetic import interval as iv
from checker.arithmetic.polynomial import Polynomial
from checker.certificates.propagation import Box, Row, Rows

INF = math.inf


@pytest.mark.parametrize(
    ("constant", "target"), [(-1.0, (0, INF)), (-5e-324, (0, INF)), (1.0, (0, 0))]
)
@pytest.mark.parametrize("stale", [{0}, set()])
def test_a_false_row_without_variables_leaves_no_point(constant, target, stale):
    rows = Rows([Row(Polynomial.of([()], [constant]), target)], [])
    box = Box([(0, iv.above(1.0))], {False: set(stale), True: set(stale)})
    rows.sweep(box, False)
    assert box.empty


@pytest.mark.parametrize(("constant", "target"), [(1.0, (0, INF)), (0.0, (0, 0))])
def test_a_true_row_without_variables_leaves_the_box(constant, target):
    rows = Rows([Row(Polynomial.of([()], [constant]), target)], [])
    box = Box([(0, iv.above(1.0))])
    rows.sweep(box, False)
    assert [(iv.exact(a), iv.exact(b)) for a, b in box.ends] == [(0, 1)]


def test_a_root_chooses_its_branch_by_what_the_same_sweep_found():
    """Two signs with (x1 + x2 + x3 - 1.5)^2 <= 0.25: x1 = -1 leaves x2 = x3 = 1.

    With x1 = -1 the row of the cutoff takes x2 above -0.57; x2^2 = 1, which has not changed, then
    has one root only.
    """
    squares = [Row(Polynomial.of([(v, v), ()], [1.0, -1.0]), (0, 0)) for v in (1, 2, 3)]
    words = [(), *((v,) for v in (1, 2, 3)), *((v, v) for v in (1, 2, 3)), (1, 2), (1, 3), (2, 3)]
    objective = Polynomial.of(words, [2.25, -3.0, -3.0, -3.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    rows = Rows([*squares, Row(objective, (-INF, iv.above(0.25)))], [])
    box = Box([(-INF, INF)] * 3)
    for _ in range(2):
        rows.sweep(box, True)
    box.shrink(0, -INF, iv.above(-0.45))
    for _ in range(2):
        rows.sweep(box, True)
    assert [(iv.exact(a), iv.exact(b)) for a, b in box.ends] == [(-1, -1), (1, 1), (1, 1)]


def test_ends_that_escape_stop_beyond_all_doubles():
    """x1 >= 2, x2 >= x1^2 and x1 >= x2^2: the exponents of both ends grow fourfold a sweep."""
    words = [(1,), (2, 2)], [(2,), (1, 1)]
    rows = Rows([Row(Polynomial.of(pair, [1.0, -1.0]), (0, INF)) for pair in words], [])
    box = Box([(iv.above(2.0), INF), (-INF, INF)])
    for _ in range(60):
        rows.sweep(box, False)
    assert [low for low, _ in box.ends] == [iv.above(2**1024)] * 2
    assert not box.stale[False]


def test_upper_ends_beyond_all_doubles_say_nothing():
    box = Box([(-INF, INF)] * 2)
    box.shrink(0, -INF, iv.above(2**1025))
    box.shrink(1, -iv.above(2**1025), iv.above(2**1025))
    assert box.ends == [(-INF, INF)] * 2
    box.shrink(0, INF, -INF)
    assert box.empty
