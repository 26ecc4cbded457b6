"""Boxes of parameters from rows with bounded uncertainty: closed forms, and forged arguments."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

import sparsepop_py as sp
from sparsepop_py.uncertain_rows import (
    CoupledRows,
    DirectionBox,
    ProductRows,
    UncertainRows,
    complete_box,
    direction_box,
    lifted_box,
    lifted_rows,
    parameter_box,
)

NOTHING = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
ARMS = np.array([[1.0, 1.0], [1.0, -1.0]])
SCALES = UncertainRows(("m1", "m2"), [-5.0, -1.0], ARMS, [0.05, 0.05], 0.02 * np.abs(ARMS))


def by_signs(rows: UncertainRows) -> np.ndarray:
    """The hull over all sign patterns, by one linear program each: an oracle for few parameters."""
    p = len(rows.names)
    ends = np.array([np.full(p, np.inf), np.full(p, -np.inf)])
    for signs in np.array(np.meshgrid(*[[-1.0, 1.0]] * p)).reshape(p, -1).T:
        above = np.concatenate([rows.regressors, -rows.regressors]) - np.tile(
            rows.radii * signs, (2, 1)
        )
        right = np.concatenate([rows.radius - rows.target, rows.radius + rows.target])
        bounds = [(0, None) if s > 0 else (None, 0) for s in signs]
        for i in range(p):
            for side in (1.0, -1.0):
                found = linprog(side * np.eye(p)[i], above, right, bounds=bounds)
                if found.status == 0:
                    place = 0 if side > 0 else 1
                    ends[place, i] = (min if side > 0 else max)(ends[place, i], found.x[i])
    return ends


def test_two_masses_on_a_balance() -> None:
    """Sum s in [4.95 / 1.02, 5.05 / 0.98] and difference 1 +- (0.05 + 0.02 s)."""
    box = parameter_box(SCALES)
    low, high = Fraction(495, 102), Fraction(505, 98)
    spread = [Fraction(5, 100) + Fraction(2, 100) * s for s in (low, high)]
    wanted = [
        [(low + 1 - spread[0]) / 2, (low - 1 - spread[0]) / 2],
        [(high + 1 + spread[1]) / 2, (high - 1 + spread[1]) / 2],
    ]
    assert np.allclose([box.lower, box.upper], np.array(wanted, float), rtol=1e-12, atol=0)
    for k in range(2):
        assert Fraction(box.lower[k]) <= wanted[0][k] and wanted[1][k] <= Fraction(box.upper[k])
    assert box.verify(SCALES, NOTHING)


@pytest.mark.parametrize("seed", range(6))
def test_boxes_are_the_hulls_of_all_sign_patterns(seed: int) -> None:
    source = np.random.default_rng(seed)
    truth = source.uniform(-1, 1, 3) * [1.0, 0.02, 1.0]
    regressors = source.uniform(-1, 1, (12, 3))
    radii = source.uniform(0, 0.1, (12, 3))
    width = 0.05 + radii @ np.abs(truth)
    target = -regressors @ truth + source.uniform(-1, 1, 12) * width
    rows = UncertainRows(("x", "y", "z"), target, regressors, np.full(12, 0.05), radii)
    assert np.all(rows.margin(truth) >= 0.0)
    start = np.array([np.full(3, -np.inf), np.full(3, np.inf)])
    box, ends = parameter_box(rows, start), by_signs(rows)
    assert np.allclose([box.lower, box.upper], ends, rtol=0, atol=1e-6)
    assert np.all(box.lower <= truth) and np.all(truth <= box.upper)
    assert box.verify(rows, start)


def test_forged_boxes_are_refused() -> None:
    box = parameter_box(SCALES)
    assert not replace(box, upper=box.upper - 1e-9).verify(SCALES, NOTHING)
    assert not replace(box, steps=()).verify(SCALES, NOTHING)
    other = replace(SCALES, target=SCALES.target + 0.5)
    assert not box.verify(other, NOTHING)
    assert box.verify(SCALES, np.array([[0.0, 0.0], [9.0, 9.0]]))  # more is known: it still holds


def test_contradicting_rows_are_named() -> None:
    """2 m = 2 and m = 3 within 0.1; a third row says nothing against either."""
    rows = UncertainRows(("m",), [-2, -3, 0], [[2], [1], [0]], [0.1, 0.1, 1.0], np.zeros((3, 1)))
    start = np.array([[-np.inf], [np.inf]])
    box = parameter_box(rows, start)
    assert box.empty and box.verify(rows, start) and repr(box) == "<ParameterBox: empty, proved>"
    assert set(box.used_rows(rows)) == {0, 1}


def coupled(limit: float) -> tuple[UncertainRows, CoupledRows]:
    """(1 + e) x + y = 1, (1 - e) x + y = 2, x = y with |e| <= limit: x = y = 3/4, e = -2/3."""
    x, y, e = sp.variables(3, ["x", "y", "e"])
    equations = [x + e * x + y == 1, x - e * x + y == 2, x - y == 0]
    ends = {"lower": [-np.inf, -np.inf, -limit], "upper": [np.inf, np.inf, limit]}
    known = CoupledRows(sp.Problem(x, equations, **ends), 2, np.ones(3, bool), np.zeros(3))
    radii = np.array([[limit, 0.0], [limit, 0.0], [0.0, 0.0]])
    regressors = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    return UncertainRows(("x", "y"), [-1, -2, 0], regressors, np.zeros(3), radii), known


def test_shared_numbers_bound_what_rows_alone_do_not() -> None:
    rows, known = coupled(2.5)
    first = parameter_box(rows)
    assert np.all(np.isinf(first.upper))
    box = direction_box(rows, known, first)
    assert isinstance(box, DirectionBox) and np.all(np.isfinite([box.lower, box.upper]))
    assert np.all(box.lower <= 0.75) and np.all(box.upper >= 0.75)
    assert box.verify(rows, known, NOTHING)
    assert not replace(box, upper=np.full(2, 0.7)).verify(rows, known, NOTHING)
    assert not replace(box, certificates=box.certificates[::-1]).verify(rows, known, NOTHING)
    assert not box.verify(*coupled(2.6), NOTHING)


def test_no_box_where_shared_numbers_explain_a_direction() -> None:
    """E x = 1 with e in [-1, 1]: x is any number beyond 1."""
    x, e = sp.variables(2, ["x", "e"])
    problem = sp.Problem(x, [e * x == 1], lower=[-np.inf, -1], upper=[np.inf, 1])
    known = CoupledRows(problem, 1, np.ones(1, bool), np.zeros(2))
    rows = UncertainRows(("x",), [-1], [[0]], [0], [[1]])
    assert direction_box(rows, known, parameter_box(rows)) is None


def test_rows_in_products_bound_their_factors() -> None:
    """2 a + a b = 5, a - a b = 1 within 0.01, and e shared: a = 2, b = 1/2."""
    a, b, e, f = sp.variables(4, ["a", "b", "e", "f"])
    equations = [2 * a + a * b == 5 + e, a - a * b == 1 + f]
    low, high = np.array([-np.inf, -np.inf, -0.01, -0.01]), np.array([np.inf, np.inf, 0.01, 0.01])
    problem = sp.Problem(a, equations, low, high)
    known = CoupledRows(problem, 2, np.ones(2, bool), np.zeros(4))
    rows = lifted_rows(known, ("a", "b"))
    assert isinstance(rows, ProductRows) and rows.regression.names == ("a", "a*b")
    box = complete_box(lifted_box(rows, NOTHING), known, rows)
    # a = (6 + e + f) / 3, a b = (3 + e - 2 f) / 3
    assert np.allclose([box.lower[0], box.upper[0]], [5.98 / 3, 6.02 / 3], rtol=1e-9)
    assert box.lower[1] <= 2.97 / 6.02 and 3.03 / 5.98 <= box.upper[1]
    assert box.upper[1] - box.lower[1] <= 1.05 * (3.03 / 5.98 - 2.97 / 6.02)
    assert box.verify(rows, NOTHING, known)
    assert not replace(box, lower=box.lower + [0.0, 0.05]).verify(rows, NOTHING, known)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("target", [[1.0]], "target: found shape"),
        ("regressors", [[1.0]], "regressors: found shape"),
        ("radius", [0.1, -0.1], "radius: found a negative uncertainty"),
        ("radii", -np.ones((2, 2)), "radii: found a negative uncertainty"),
        ("radii", np.full((2, 2), np.inf), "radii: found a number that is not finite"),
    ],
)
def test_wrong_rows_are_refused(field: str, value: object, message: str) -> None:
    with pytest.raises(sp.ProblemError, match=message):
        replace(SCALES, **{field: value})


def test_rows_are_copied_and_read_only() -> None:
    target = np.array([-5.0, -1.0])
    rows = replace(SCALES, target=target)
    target[0] = 7.0
    assert rows.target[0] == -5.0
    with pytest.raises(ValueError, match="read-only"):
        rows.radii[0, 0] = 1.0
