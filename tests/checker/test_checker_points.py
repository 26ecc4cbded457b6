"""Attained points and rays of the second checker, by hand."""

from __future__ import annotations

import itertools
from fractions import Fraction

import pytest
from hand_made_proofs import INF, PSD, array, poly, problem

from checker.certificates import point
from checker.files.reading import Constraint


def entries(kind, *pairs):
    made = [poly({}) for _ in pairs]
    given = [(Fraction(low), Fraction(high)) for low, high in pairs]
    return point.entries_hold(Constraint(kind, poly({}), made), given)


def test_matrices_hold_for_all_entries_of_their_intervals():
    assert entries("SECOND_ORDER", (5, 5), (3, 3), (4, 4))
    assert not entries("SECOND_ORDER", (5, 5), (3, 3), (4, 4.001))
    assert not entries("SECOND_ORDER", (4.999, 5), (3, 3), (-4, 4))
    assert not entries("SECOND_ORDER", (5, 5), (3, 3), (-4.001, 4))
    assert not entries("SECOND_ORDER", (-5, -5), (3, 3), (4, 4))
    assert entries("PSD", (4, 4), (6, 6), (9, 9))
    assert not entries("PSD", (4, 4), (6.001, 6.001), (9, 9))
    assert not entries("PSD", (-1, 4), (0, 0), (9, 9))
    assert entries("PSD", (4, 4), (-1, 1), (9, 9))
    for a, b, c in itertools.product((1, 1.5), (-0.5, 0.875, 1), (1, 2)):
        pairs = [(a, a + 0.25), (b, b + 0.25), (c, c + 0.25)]
        corners = itertools.product(*pairs)
        if entries("PSD", *pairs):
            assert all(p >= 0 and r >= 0 and p * r >= q * q for p, q, r in corners)
    whole = Constraint("PSD", poly({}), [poly({})] * 3)
    assert not point.entries_hold(whole, [(1, INF), (0, 0), (1, 1)])


@pytest.mark.parametrize(
    ("direction", "falls"),
    [((1, 1), True), ((1, 0), True), ((0, 1), False), ((-1, 0), False), ((2, 3), False)],
)
def test_rays_are_feasible_and_fall(direction, falls):
    """-x^2 + y with x >= 0, x - y >= 0 and -5 <= y, from the origin."""
    rows = [Constraint("NONNEGATIVE", poly({(1,): 1, (2,): -1}))]
    given = problem(2, {(1, 1): -1, (2,): 1}, rows, low=[0, -5])
    step = [Fraction(v) for v in direction]
    assert point.falls(given, [Fraction(0)] * 2, step) == falls


@pytest.mark.parametrize(
    ("kind", "terms", "falls"),
    [
        ("ZERO", {(1,): 1, (2,): -1}, True),
        ("ZERO", {(1,): 1, (2,): -2}, False),
        ("ZERO", {(1,): 1, (2,): -1, (): 1}, False),
        ("NONNEGATIVE", {(1,): 1, (): -1}, False),  # at the beginning of the ray
        ("NONNEGATIVE", {(1, 1): -1, (2,): 9, (): 1}, False),
        ("NONNEGATIVE", {(1, 2): 1, (): 0}, True),
    ],
)
def test_rays_keep_rows(kind, terms, falls):
    given = problem(2, {(1,): -1}, [Constraint(kind, poly(terms))])
    assert point.falls(given, [Fraction(0)] * 2, [Fraction(1)] * 2) == falls


def test_rays_keep_matrices_and_bounds():
    """[x 1; 1 y] along (1, 1) from (1, 1); x <= 5 ends a ray, and so does y <= 5."""
    x, one = [Fraction(1)] * 2, [Fraction(1)] * 2
    rows = [Constraint("PSD", poly({}), [poly({(1,): 1}), poly({(): 1}), poly({(2,): 1})])]
    assert point.falls(problem(2, {(1,): -1}, rows), x, one)
    assert not point.falls(problem(2, {(1,): -1}, rows), x, [Fraction(1), Fraction(-1)])
    for high in ([5, INF], [INF, 5]):
        assert not point.falls(problem(2, {(1,): -1}, high=high), x, one)
    for low in ([-5, -INF], [-INF, -5]):
        assert not point.falls(problem(2, {(1,): 1}, low=low), x, [Fraction(-1)] * 2)


def attained(given, x, value, **changes):
    found = {"x": array("f8", *x), "value": value, "radius": 0.0, "proof": "exact"}
    found |= {"rows": array("i8"), "solved": array("i8")}
    return point.ProvedPoint(found | changes, given, "point").fails()


def test_attained_points_satisfy_all_that_is_asked():
    """3 x = y and x + y <= 4 with bounds: (1, 3) attains 1; near doubles attain what rows give."""
    rows = [
        Constraint("ZERO", poly({(1,): 3, (2,): -1})),
        Constraint("NONNEGATIVE", poly({(1,): -1, (2,): -1, (): 4})),
    ]
    given = problem(2, {(1,): 1}, rows, low=0, high=[5, 3])
    assert attained(given, [1.0, 3.0], 1.0) == ""
    assert "objective" in attained(given, [1.0, 3.0], 0.999)
    assert "constraint 0" in attained(given, [1.0, 2.5], 1.0)
    assert "constraint 0" in attained(given, [0.5, 3.0], 1.0)
    assert "variable 2" in attained(given, [1.25, 3.75], 2.0)
    assert "variable 1" in attained(given, [-1.0, 3.0], 2.0)
    solved = {"rows": array("i8", 0), "solved": array("i8", 0)}
    assert attained(given, [1 / 3, 1.0], 0.34, **solved, radius=1e-9) == ""
    assert "radius" in attained(given, [1 / 3, 1.0], 0.34, **solved)
    assert "radius" in attained(given, [0.5, 1.0], 0.6, **solved, radius=0.1)
    loose = problem(2, {(1,): 1}, rows[1:], low=0, high=[5, 5])
    assert "constraint 0" in attained(loose, [2.0, 2.5], 3.0)


def test_attained_points_keep_matrices_and_linear_rows():
    rows = [PSD, Constraint("ZERO", poly({(1, 2): 1, (): -2}))]
    given = problem(2, {(1,): 1}, rows)
    assert attained(given, [1.0, 2.0], 1.0) == ""
    assert "matrix 0" in attained(problem(2, {(1,): 1}, rows[:1]), [1.0, 0.5], 1.0)
    both = {"rows": array("i8", 1), "solved": array("i8", 0)}
    assert attained(given, [1.0, 2.0], 1.0, **both) == ""
    both = {"rows": array("i8", 0, 1), "solved": array("i8", 0, 1)}
    rows = [Constraint("ZERO", poly({(1,): 1, (2,): 1, (): -3})), rows[1]]
    assert "not linear" in attained(problem(2, {(1,): 1}, rows), [1.0, 2.0], 1.0, **both)


def near_zero(rest=(), objective=None, x=(0.0, 1.0), value=1.5, rows=(0,), solved=(1,)):
    """Attain a value near a zero of x^2 + y^2 - 1, or of more rows."""
    circle = Constraint("ZERO", poly({(1, 1): 1, (2, 2): 1, (): -1}))
    given = problem(len(x), objective or {(2,): 1}, [circle, *rest])
    changes = {"proof": "krawczyk", "radius": 1e-6}
    changes |= {"rows": array("i8", *rows), "solved": array("i8", *solved)}
    return attained(given, x, value, **changes)


def test_zeros_are_known_but_for_a_little():
    """(0, 1) lies on the circle; what is just 1 may be less or more."""
    assert near_zero() == ""
    assert near_zero(value=1 + 1e-9) == ""
    assert "objective" in near_zero(value=1.0)
    moved = (0.0, 1 - 1e-7)
    assert near_zero(x=moved, value=1 + 1e-9) == ""
    assert "objective" in near_zero(x=moved, value=1 - 0.5e-7)
    assert "objective" in near_zero(x=moved, value=1 - 0.5e-7, objective={(1,): 1, (2,): 1})
    for kind, terms in (
        ("NONNEGATIVE", {(1,): 1, (): -0.1}),
        ("NONNEGATIVE", {(2,): 1, (): -1}),
        ("ZERO", {(2,): 1, (): -1}),
        ("ZERO", {(1,): 1, (): -0.1}),
    ):
        assert "constraint 1" in near_zero([Constraint(kind, poly(terms))])
    assert near_zero([Constraint("ZERO", poly({(1,): 1}))]) == ""


def test_each_row_needs_a_zero():
    """z^2 + 1 has none, beside a row that has one and alone."""
    none = Constraint("ZERO", poly({(3, 3): 1, (): 1}))
    for rows, solved in (((0, 1), (1, 2)), ((1,), (2,))):
        found = near_zero([none], x=(0.0, 1.0, 0.5), rows=rows, solved=solved)
        assert found == point.PROOFS["krawczyk"]


def test_rays_begin_at_feasible_points_and_fall():
    ahead = [Fraction(1), Fraction(0)]
    given = problem(2, {(1,): -1}, low=[-INF, 0], high=[INF, 1])
    for y, falls in ((0.5, True), (5.0, False)):
        found = {"x": array("f8", 0.0, y), "value": 0.0, "radius": 0.0, "proof": "exact"}
        found |= {"rows": array("i8"), "solved": array("i8")}
        start = point.ProvedPoint(found, given, "point")
        assert point.falls_without_limit(given, start, ahead) == falls
    zero = [Fraction(0)] * 2
    for objective in ({(): -1}, {(1,): 1}, {(1, 1): 1, (1,): -9}, {(2,): -1}):
        assert not point.falls(problem(2, objective), zero, ahead)
