"""Affine scaling: the box of t contains the box of x, exactly, and the problem is the same."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Problem
from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.verified.arithmetic.interval import Interval
from sparsepop_py.verified.box.scaling import Scaled, Scaling

INF = np.inf
finite = st.one_of(
    st.floats(-1e300, 1e300),
    st.floats(-10, 10),
    st.sampled_from([0.0, 1e-300, -5e-324, 2.0**-1022, 1e15, 0.1, 1 / 3]),
)


def box_of(low, high):
    return Interval(np.atleast_1d(np.array(low, float)), np.atleast_1d(np.array(high, float)))


def covers(scaling, low, high):
    """centre - scale <= low and high <= centre + scale in rationals."""
    centre, scale = Fraction(float(scaling.centre[0])), Fraction(float(scaling.scale[0]))
    return centre - scale <= Fraction(low) and Fraction(high) <= centre + scale


@given(finite, finite)
@example(1e15, 1e15 + 0.125)
@example(0.0, 5e-324)
@example(1.0, 1 + 2.0**-52)
@example(-1e300, 1e300)
@example(0.1, 0.3)
@settings(deadline=None)
def test_the_t_box_contains_the_x_box_exactly(a, b):
    low, high = min(a, b), max(a, b)
    scaling = Scaling.of_box(box_of(low, high))
    assert scaling.boxed.all()
    assert covers(scaling, low, high)
    assert scaling.contains(box_of(low, high))
    assert (scaling.scale[0] == 0) == (low == high)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
@settings(deadline=None)
def test_the_scale_is_hardly_wider_than_half_the_box(low, width):
    high = low + width
    scaling = Scaling.of_box(box_of(low, high))
    assert scaling.scale[0] <= 0.5 * (high - low) * (1 + 1e-9) + 1e-9 * max(abs(low), abs(high))


@pytest.mark.parametrize("centre", [1e3, -1e8, 2.0**40, 0.1])
@pytest.mark.parametrize("steps", [1, 2, 3, 1000])
def test_a_few_last_digits_at_a_large_centre(centre, steps):
    high = centre + steps * np.spacing(abs(centre))
    scaling = Scaling.of_box(box_of(centre, high))
    assert high > centre
    assert scaling.scale[0] > 0
    assert covers(scaling, centre, high)


@given(st.floats(1e-300, 1e300))
@settings(deadline=None)
def test_symmetric_boxes_keep_their_centre_at_zero(radius):
    scaling = Scaling.of_box(box_of(-radius, radius))
    assert scaling.centre[0] == 0.0
    assert covers(scaling, -radius, radius)


@given(st.floats(1e-3, 1e6), st.integers(-3, 3), st.integers(-3, 3))
@settings(deadline=None)
def test_boxes_symmetric_up_to_rounding_keep_their_centre_at_zero(radius, left, right):
    low = -radius + left * np.spacing(radius)
    high = radius + right * np.spacing(radius)
    scaling = Scaling.of_box(box_of(low, high))
    assert scaling.centre[0] == 0.0
    assert covers(scaling, low, high)


@given(finite)
@settings(deadline=None)
def test_a_fixed_variable_has_scale_zero_and_its_value_as_centre(value):
    scaling = Scaling.of_box(box_of(value, value))
    assert scaling.boxed[0]
    assert scaling.scale[0] == 0.0
    assert scaling.centre[0] == value
    assert scaling.bounds[0][0] == scaling.bounds[1][0] == 0.0
    assert scaling.point(np.array([0.7]))[0] == value


def test_half_lines_start_at_their_bound():
    scaling = Scaling.of_box(
        box_of([2.0, -INF, -INF], [INF, -3.0, INF]), typical=np.array([7.0, -100.0, 0.5])
    )
    assert scaling.boxed.tolist() == [False] * 3
    assert scaling.side.tolist() == [1, -1, 0]
    assert scaling.centre.tolist() == [2.0, -3.0, 0.0]
    low, high = scaling.bounds
    assert low.tolist() == [0.0, -INF, -INF]
    assert high.tolist() == [INF, 0.0, INF]
    distance = np.maximum(np.abs(np.array([7.0, -100.0, 0.5]) - scaling.centre), 1.0)
    assert np.all((distance <= scaling.scale) & (scaling.scale < 2 * distance))
    assert np.all(np.frexp(scaling.scale)[0] == 0.5)  # powers of two: scaling is exact


@given(finite, finite, st.sampled_from(["lo", "hi"]))
@settings(deadline=None)
def test_contains_refuses_a_box_that_sticks_out(a, b, end):
    low, high = min(a, b), max(a, b)
    scaling = Scaling.of_box(box_of(low, high))
    reach = float(scaling.scale[0])
    centre = float(scaling.centre[0])
    with np.errstate(over="ignore"):
        lower = float(np.nextafter(centre - reach, -INF))
        upper = float(np.nextafter(centre + reach, INF))
    wider = box_of(lower, high) if end == "lo" else box_of(low, upper)
    assert not covers(scaling, wider.lo[0], wider.hi[0])
    assert not scaling.contains(wider)


def test_contains_judges_sides_and_fixed_variables():
    half = Scaling.of_box(box_of(2.0, INF))
    assert half.contains(box_of(2.0, 1e9))
    assert half.contains(box_of(3.0, INF))
    assert not half.contains(box_of(np.nextafter(2.0, 0.0), INF))
    free = Scaling.of_box(box_of(-INF, INF))
    assert free.contains(box_of(-INF, INF))
    fixed = Scaling.of_box(box_of(2.0, 2.0))
    assert fixed.contains(box_of(2.0, 2.0))
    assert not fixed.contains(box_of(2.0, np.nextafter(2.0, 3.0)))
    boxed = Scaling.of_box(box_of(0.0, 1.0))
    assert not boxed.contains(box_of(0.0, INF))


# ---- scaled problems ---------------------------------------------------------------------

coefficient = st.integers(-8, 8).filter(bool).map(lambda k: k / 4)
table = st.dictionaries(
    st.tuples(st.integers(0, 2), st.integers(0, 2)), coefficient, min_size=2, max_size=5
)


@given(
    st.lists(table, min_size=2, max_size=4),
    st.tuples(st.integers(-8, 8), st.integers(1, 8)),
    st.tuples(st.integers(-8, 8), st.integers(1, 8)),
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_scaled_rows_and_objective_take_the_same_values(rows, first, second, points):
    x, y = sp.variables(2)
    polynomials = [
        sp.total([x * 0.0, *(c * x**i * y**j for (i, j), c in row.items())]) for row in rows
    ]
    lower = np.array([first[0], second[0]]) / 2
    upper = lower + np.array([first[1], second[1]]) / 2
    constraints = [p >= 0 for p in polynomials[1:]]
    problem = Problem(polynomials[0], constraints, lower, upper)
    scaling = Scaling.of_box(Interval(lower, upper))
    scaled = Scaled.of(problem, scaling, (problem.objective,))
    assert scaled.problem.lower.tolist() == [-1.0, -1.0]
    assert scaled.problem.upper.tolist() == [1.0, 1.0]
    pairs = [(problem.objective, scaled.problem.objective, scaled.objective_sizes[0])]
    kept = [c.polynomial.terms > 0 for c in scaled.problem.constraints]
    pairs += [
        (old.polynomial, new.polynomial, size)
        for old, new, size, keep in zip(
            constraints, scaled.problem.constraints, scaled.row_sizes, kept, strict=True
        )
        if keep
    ]
    for t in points:
        where = scaling.point(np.array(t))
        for old, new, size in pairs:
            assert abs(old(where) - size * new(np.array(t))) <= 1e-9 * (1 + abs(old(where)) + size)
    for old, keep in zip(constraints, kept, strict=True):
        if not keep:  # only rows that the bounds imply (linear in one variable) may go
            corners = np.array([lower, upper, [lower[0], upper[1]], [upper[0], lower[1]]])
            assert old.polynomial.terms == 0 or np.all(old.polynomial(corners) >= -1e-8)


def test_rows_and_objective_are_normalised_to_largest_coefficient_one():
    x, y = sp.variables(2)
    problem = Problem(400 * x * y + 7, [3e6 * x + y**2 >= 5, 1e-4 * y == x * y], -1, 1)
    scaled = Scaled.of(problem, Scaling.of_box(box_of([-1, -1], [1, 1])), (problem.objective,))
    for p in [scaled.problem.objective, *(c.polynomial for c in scaled.problem.constraints)]:
        varying = p.coefficients[p.words.any(axis=1)]
        assert np.isclose(np.abs(varying).max(), 1.0, rtol=1e-12)
    assert np.allclose(scaled.row_sizes, [3e6, 1.0], rtol=1e-9)
    assert np.isclose(scaled.objective_sizes[0], 400.0, rtol=1e-9)


def test_even_symmetry_survives_scaling():
    x, y = sp.variables(2)
    problem = Problem(x**4 + x**2 * y**2, lower=[-3, -0.1], upper=[3, 0.1])
    scaled = Scaled.of(
        problem, Scaling.of_box(Interval(problem.lower, problem.upper)), (problem.objective,)
    )
    assert np.all(scaled.problem.objective.exponents.toarray() % 2 == 0)
    assert scaled.problem.objective.terms == 2


def test_fixed_variables_disappear_from_the_scaled_problem():
    x, y, z = sp.variables(3)
    problem = Problem(x * y + z, [x * z >= y, y == 2], [-1, 2, 0], [1, 2, 4])
    scaled = Scaled.of(
        problem, Scaling.of_box(Interval(problem.lower, problem.upper)), (problem.objective,)
    )
    for p in [scaled.problem.objective, *(c.polynomial for c in scaled.problem.constraints)]:
        assert 1 not in p.support
    assert scaled.problem.lower[1] == scaled.problem.upper[1] == 0.0


def test_several_objectives_share_the_scaled_problem():
    x, y = sp.variables(2)
    problem = Problem(x, [x * y >= 0.25], 0, 1)
    wanted = (x, -1.0 * x, 10 * y**2)
    scaled = Scaled.of(problem, Scaling.of_box(box_of([0, 0], [1, 1])), wanted)
    t = np.array([0.3, -0.6])
    where = scaled.scaling.point(t)
    assert len(scaled.objectives) == len(scaled.objective_sizes) == 3
    for f, g, size in zip(wanted, scaled.objectives, scaled.objective_sizes, strict=True):
        assert np.isclose(f(where), size * g(t), rtol=1e-9)


def test_rows_that_repeat_the_bounds_are_emptied_and_others_are_kept():
    x, y = sp.variables(2)
    rows = [x <= 3, x >= -5, y >= 0.5, x + y <= 2, x == 0.5, 1 - x**2 >= 0]
    problem = Problem(x, rows, [-1, 0], [3, 1])
    scaled = Scaled.of(
        problem, Scaling.of_box(Interval(problem.lower, problem.upper)), (problem.objective,)
    )
    kept = [c.polynomial.terms > 0 for c in scaled.problem.constraints]
    assert kept == [False, False, True, True, True, True]


def test_polynomials_that_overflow_become_empty():
    x, y = sp.variables(2)
    # 1e3^120 is no double, and 1e3^3 is one
    problem = Problem(x**120 + y, [x**3 + y >= -1, x**120 - y >= 0], lower=-1e3, upper=1e3)
    scaling = Scaling.of_box(Interval(problem.lower, problem.upper))
    scaled = Scaled.of(problem, scaling, (problem.objective, y))
    assert scaled.problem.objective.terms == 0
    assert [row.polynomial.terms > 0 for row in scaled.problem.constraints] == [True, False]
    assert scaled.objectives[1].terms == 1


@pytest.mark.parametrize("effort", ["plain", "presolve", "auto"])
def test_powers_that_overflow_are_no_wrong_input(effort):
    (x,) = sp.variables(1)
    problem = Problem(x**120 - 2 * x**60, lower=-1e3, upper=1e3)  # (x^60 - 1)^2 - 1
    result = sp.solve(problem, sp.Options(effort=effort, time_limit=5))
    assert result.lower_bound <= -1 <= result.upper_bound
    assert result.certificate.verify(problem).ok


FREE = np.zeros(2, bool)


def test_a_moved_origin_is_expanded_exactly():
    """(x - 100)^8 + y is 2^8 t^8 + 4 s - 30 with x = 100 + 2 t and y = -30 + 4 s."""
    x, y = sp.variables(2)
    scaling = Scaling.about(np.array([100.0, -30.0]), np.array([2.0, 4.0]), FREE)
    assert scaling.translated
    assert scaling.contains(Interval(np.full(2, -np.inf), np.full(2, np.inf)))
    words, _, value = scaling.expanded(PolynomialSystem.stack([(x - 100) ** 8 + y], 2))
    found = {tuple(w[w > 0].tolist()): k for k, w in enumerate(words)}
    assert found.keys() == {(), (2,), (1,) * 8}
    assert np.array_equal(value.lo, value.hi)
    assert [value.lo[found[w]] for w in ((), (2,), (1,) * 8)] == [-30.0, 4.0, 256.0]


@pytest.mark.parametrize(
    ("centre", "side", "boxed", "expected"),
    [
        ([0.0, 0.0], [0, 0], [False, False], False),
        ([0.0, 3.0], [0, 0], [False, False], True),
        ([0.0, 3.0], [0, 1], [False, False], False),  # starts at its bound
        ([0.0, 3.0], [0, -1], [False, False], False),
        ([0.0, 3.0], [0, 0], [False, True], False),
        ([np.nan, 3.0], [0, 0], [False, False], False),
        ([0.0, np.inf], [0, 0], [False, False], False),
    ],
)
def test_only_origins_of_free_variables_are_moved(centre, side, boxed, expected):
    scaling = Scaling(np.array(centre), np.ones(2), np.array(boxed), np.array(side))
    assert scaling.translated is expected


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_no_number_at_all_is_no_rational(number):
    """Forged scalings and coefficients are refused elsewhere; nothing is raised here."""
    x, y = sp.variables(2)
    system = PolynomialSystem.stack([x + y], 2)
    for centre, scale in (([number, 1.0], [1.0, 1.0]), ([1.0, 1.0], [number, 1.0])):
        Scaling.about(np.array(centre), np.array(scale), FREE).expanded(system)
    forged = PolynomialSystem(
        system.words, np.full(system.row.size, number), system.row, 1, system.dimension
    )
    Scaling.about(np.ones(2), np.ones(2), FREE).expanded(forged)
