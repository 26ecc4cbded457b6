"""Expressions are multiplied out exactly and rounded once, against rationals."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.algebra import exact_terms
from sparsepop_py.algebra.exact_terms import ExactTerms, grid_of
from sparsepop_py.problem.rounding import note

NUMBERS = st.one_of(
    st.integers(-9, 9).map(float),
    st.sampled_from([0.1, 0.2, 0.3, -0.7, 1e-3, 1 / 3, 2.0**-40, 1e15 + 0.125, 3e-50, 1e30]),
    st.builds(math.ldexp, st.integers(-(2**53), 2**53), st.integers(-90, 10)),
)
EXACT = st.one_of(NUMBERS, st.fractions(max_denominator=50), st.integers(-(2**70), 2**70))
Table = dict[tuple[int, int], Fraction]


class Oracle:
    """Polynomials in two variables by tables of rationals, each operation by its definition."""

    def __init__(self, table: Table) -> None:
        self.table = {key: value for key, value in table.items() if value}

    def __add__(self, other: "Oracle") -> "Oracle":
        keys = {*self.table, *other.table}
        return Oracle({k: self.table.get(k, 0) + other.table.get(k, 0) for k in keys})

    def __mul__(self, other: "Oracle") -> "Oracle":
        found: Table = {}
        for (a, b), left in self.table.items():
            for (c, d), right in other.table.items():
                found[a + c, b + d] = found.get((a + c, b + d), Fraction(0)) + left * right
        return Oracle(found)

    def derivative(self) -> "Oracle":
        return Oracle({(a - 1, b): a * value for (a, b), value in self.table.items() if a})


def table_of(p: sp.Polynomial) -> dict[tuple[int, int], float]:
    powers = map(tuple, p.exponents.toarray().tolist())
    return dict(zip(powers, p.coefficients.tolist(), strict=True))


def check(p: sp.Polynomial, exact: Oracle) -> None:
    nearest = {key: float(value) for key, value in exact.table.items()}
    assert table_of(p) == {key: value for key, value in nearest.items() if value}
    changed = any(Fraction(nearest[key]) != value for key, value in exact.table.items())
    assert (p.exact is not None) == changed
    assert sorted(p.fractions) == sorted(exact.table.values())


@st.composite
def expressions(draw, depth=3):
    """An expression with the oracle's value of it."""
    x, y = sp.variables(2)
    if depth == 0 or draw(st.booleans()):
        number = draw(EXACT)
        leaf, power = draw(st.sampled_from([(x, (1, 0)), (y, (0, 1))]))
        rest = draw(EXACT)
        made = number * leaf + rest
        return made, Oracle({power: Fraction(number), (0, 0): Fraction(rest)})
    left, a = draw(expressions(depth - 1))
    right, b = draw(expressions(depth - 1))
    what = draw(st.sampled_from("+-*^/"))
    if what == "+":
        return sp.total([left, right]), a + b
    if what == "-":
        return left - right, a + b * Oracle({(0, 0): Fraction(-1)})
    if what == "*":
        return left * right, a * b
    if what == "^":
        return left**2, a * a
    number = draw(EXACT.filter(bool))
    exact = a * Oracle({(0, 0): 1 / Fraction(number)})
    assume(all(abs(value) < 2**900 for value in exact.table.values()))
    return left / number, exact


@settings(max_examples=150, deadline=None)
@given(expressions())
def test_expressions_are_rounded_once(pair):
    p, exact = pair
    check(p, exact)
    check(p.derivative(0), exact.derivative())


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2), NUMBERS), min_size=1, max_size=8))
def test_equal_monomials_are_added_exactly(terms):
    exact: dict[int, Fraction] = {}
    for power, value in terms:
        exact[power] = exact.get(power, Fraction(0)) + Fraction(value)
    p = sp.Polynomial.from_terms([[power] for power, _ in terms], [value for _, value in terms])
    nearest = {(power,): float(value) for power, value in exact.items() if float(value)}
    assert table_of(p) == nearest


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 12), NUMBERS, NUMBERS)
@example(11, 0.0, 1e30)  # a power of a number, which overflows by itself
def test_text_is_rounded_once(power, slope, constant):
    text = f"min ({slope!r}*x + {constant!r})^{power} + x/3 - 0.1*x*0.2"
    x = Oracle({(1, 0): Fraction(slope), (0, 0): Fraction(constant)})
    exact = Oracle({(0, 0): Fraction(1)})
    for _ in range(power):
        exact = exact * x
    exact = exact + Oracle({(1, 0): Fraction(1, 3) - Fraction(0.1) * Fraction(0.2)})
    try:
        nearest = {(a,): float(value) for (a, _), value in exact.table.items()}
    except OverflowError:
        with pytest.raises(sp.FormatError, match="overflow|expected a finite real number"):
            sp.parse(text)
        return
    problem = sp.parse(text)
    assert table_of(problem.objective) == {key: v for key, v in nearest.items() if v}
    rounded = [v for v in exact.table.values() if Fraction(float(v)) != v]
    assert [r.coefficients for r in problem.rounding] == ([len(rounded)] if rounded else [])


def test_a_tie_is_exact_where_the_product_is_a_double():
    (x,) = sp.variables(1)
    assert ((x / 3) * 3).exact is None
    assert ((x / 3) * 3).coefficients.tolist() == [1.0]
    assert (1e-200 * (1e-200 * x)).terms == 0
    assert (1e-200 * (1e-200 * x) * 2.0**700).coefficients.tolist() == [
        float(Fraction(1e-200) ** 2 * 2**700)
    ]
    assert (0.1 * x * 10).fractions == [Fraction(0.1) * 10]


def test_the_record_of_a_problem_is_right():
    x, y = sp.variables(2, ["x", "y"])
    problem = sp.Problem((x - 0.1) ** 2 + y, [0.1 * y + 0.2 * y <= 1], lower=-2, upper=[2, 3])
    goal, row = problem.rounding
    assert (goal.place, goal.coefficients) == ("objective", 1)
    exact = Fraction(0.1) ** 2
    error = abs(Fraction(0.1**2) - exact)
    assert (
        Fraction(goal.largest) >= error / exact > Fraction(goal.largest) * (1 - Fraction(1, 2**50))
    )
    assert Fraction(goal.shift) >= error > Fraction(goal.shift) * (1 - Fraction(1, 2**50))
    exact = Fraction(0.1) + Fraction(0.2)
    error = 3 * abs(Fraction(0.1 + 0.2) - exact)
    assert (row.place, row.coefficients) == ("constraint 0", 1)
    assert Fraction(row.shift) >= error > Fraction(row.shift) * (1 - Fraction(1, 2**50))
    assert problem.objective.exact is None
    assert problem.constraints[0].polynomial.exact is None
    assert "objective: 1 coefficient was rounded" in str(problem)


def test_a_record_without_bounds_bounds_no_shift():
    (x,) = sp.variables(1)
    assert [r.shift for r in sp.Problem(0.1 * x * 0.1).rounding] == [np.inf]
    # the constant alone was rounded: that needs no bounds
    assert sp.Problem((x - 0.1) ** 2).rounding[0].shift < 1e-17


def test_exact_problems_have_no_record():
    x, y = sp.variables(2)
    problem = sp.Problem(100 * (y - x**2) ** 2 + (1 - x) ** 2, [0.1 * x + 0.25 * y >= 0.3])
    assert problem.rounding == ()
    assert sp.solve(problem).notes == ()


def test_another_objective_has_its_own_record():
    (x,) = sp.variables(1)
    problem = sp.Problem(0.1 * x * 0.1, [0.1 * x * 0.3 <= 1], lower=0, upper=1)
    other = problem.with_objective(x)
    assert [r.place for r in other.rounding] == ["constraint 0"]
    again = other.with_objective((x - 0.1) ** 2)
    assert [r.place for r in again.rounding] == ["objective", "constraint 0"]
    assert again.objective.exact is None


def test_a_result_says_what_was_rounded():
    (x,) = sp.variables(1)
    result = sp.solve(sp.Problem((x - 0.1) ** 2, lower=-1, upper=1))
    (note,) = result.notes
    assert note == (
        "objective: 1 coefficient was rounded when it was multiplied out, by at most 8.4e-17 of "
        "each, which moves it by at most 8.4e-19 within the bounds of the variables; what is "
        "proved is about the rounded coefficients, see result.problem"
    )
    kept = sp.from_json(sp.to_json(result))
    assert kept.problem.rounding == result.problem.rounding
    assert kept.notes == result.notes


def test_bounds_that_are_no_doubles_have_a_record():
    x, y = sp.variables(2)
    big = 2**60 + 1
    problem = sp.Problem(x * y, [], [Fraction(1, 3), 0.1], [big, np.inf])
    lower, upper = problem.rounding
    assert (lower.place, lower.coefficients, upper.place) == ("lower", 1, "upper")
    error = abs(Fraction(1 / 3) - Fraction(1, 3))
    assert error <= Fraction(lower.shift) < error * (1 + Fraction(2) ** -50)
    assert 3 * error <= Fraction(lower.largest) < 3 * error * (1 + Fraction(2) ** -50)
    assert upper.shift == 1 and Fraction(1, big) <= Fraction(upper.largest)
    assert str(lower) == "lower: 1 bound was rounded, by at most 5.6e-17 of each"
    assert problem.with_objective(x).rounding == problem.rounding
    assert sp.from_json(sp.to_json(problem)).rounding == problem.rounding
    (both,) = sp.Problem(x * y, [], [Fraction(1, 3), Fraction(64, 3)], 99).rounding
    assert both.coefficients == 2 and both.largest == lower.largest
    assert both.shift == 64 * lower.shift
    ratio = sp.RationalProblem(sp.ratio(x, 1 + y), [], [Fraction(1, 3), 0], 2)
    assert ratio.rounding == (lower,)
    for plain in (None, 1, [0, 2**53], np.array([0.1, -np.inf]), [True, Fraction(1, 4)]):
        assert sp.Problem(x + y, lower=plain, upper=np.inf).rounding == ()
    result = sp.solve(sp.Problem(x**2, [], Fraction(1, 3), 2))
    assert "lower: 1 bound was rounded, by at most 5.6e-17 of each; what is proved is about " in (
        " ".join(result.notes)
    )
    assert "the rounded bounds, see" in " ".join(result.notes)


def test_files_without_rounding_have_no_such_field():
    (x,) = sp.variables(1)
    assert '"rounding"' not in sp.to_json(sp.Problem(x, lower=0))


def test_ratios_keep_a_record_too():
    (x,) = sp.variables(1)
    problem = sp.RationalProblem((x - 0.1) ** 2 / (1 + x**2), [0.1 * x * 0.3 <= 1], -1, 1)
    assert [(r.place, r.coefficients, r.shift) for r in problem.rounding] == [
        ("objective", 1, np.inf),
        ("constraint 0", 1, np.inf),
    ]
    again = sp.from_json(sp.to_json(problem))
    assert again.rounding == problem.rounding
    assert again.fingerprint == problem.fingerprint
    assert "rounded when" in sp.solve(problem).notes[0]


def test_gms_files_are_rounded_once(tmp_path):
    path = tmp_path / "p.gms"
    path.write_text(
        "Variables x, objvar; Equations e1; e1.. (x - 0.1)**2 - 0.3*objvar =E= 0;\n"
        "Model m / all /; Solve m using NLP minimizing objvar;"
    )
    problem = sp.read(path)
    three = Fraction(0.3)
    exact = [Fraction(0.1) ** 2 / three, -2 * Fraction(0.1) / three, 1 / three]
    assert problem.objective.coefficients.tolist() == [float(value) for value in exact]
    assert problem.rounding[0].coefficients == 3


def test_entries_of_a_matrix_are_rounded_before_their_trace():
    x, y = sp.variables(2)
    problem = sp.Problem(x, [sp.psd([[0.1 * x + 0.2 * x, y], [y, 1]])], lower=-1, upper=1)
    row = problem.constraints[0]
    assert row.entries[0].coefficients.tolist() == [0.1 + 0.2]
    assert all(p.exact is None for p in (row.polynomial, *row.entries))
    assert [(r.place, r.coefficients) for r in problem.rounding] == [("constraint 0", 1)]


def test_numbers_that_grow_too_long_are_rounded_on_the_way():
    (x,) = sp.variables(1)
    problem = sp.Problem((0.1 * x + 1) ** 200, lower=0, upper=1)
    (record,) = problem.rounding
    assert (record.largest, record.shift) == (np.inf, np.inf)
    assert "by an unknown amount" in str(record)
    (text,) = note([record])  # where it is not known when, the note does not say it
    assert "rounded, on the way too, by an unknown amount" in text and "multiplied" not in text
    nearest = [float(Fraction(0.1) ** 2 * 200 * 199 / 2), float(Fraction(0.1) * 200), 1.0]
    assert problem.objective.coefficients[:3].tolist() == pytest.approx(nearest[::-1], rel=1e-14)
    text = sp.parse("min (0.1*x + 1)^200").rounding[0]
    assert text.largest == np.inf


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=6))
def test_a_grid_holds_its_numbers(values):
    step, size = grid_of(np.array(values))
    assert all((Fraction(value) / Fraction(2) ** step).denominator == 1 for value in values)
    assert size == np.inf or Fraction(size) * (1 + Fraction(1, 2**40)) >= sum(
        abs(Fraction(value)) for value in values
    )
    step_of_one, size_of_one = exact_terms.grid_of_number(values[0])
    assert (Fraction(values[0]) / Fraction(2) ** step_of_one).denominator == 1
    assert size_of_one == abs(values[0])
    if exact_terms.held(step, size):
        assert Fraction(float(sum(map(Fraction, values)))) == sum(map(Fraction, values))


def test_a_grid_ends_where_doubles_end():
    assert exact_terms.held(-1074, 2.0**-1023)
    assert not exact_terms.held(-1074, 2.0**-1022)
    assert not exact_terms.held(-1075, 2.0**-1074)
    assert exact_terms.held(0, 2.0**52 - 1)
    assert not exact_terms.held(0, 2.0**52)
    assert not exact_terms.held(1020, 2.0**1020)


def test_exact_terms_are_shortened_before_they_are_rounded():
    words = np.array([[1]], np.int32)
    long = ExactTerms(words, np.array([3 * 7**2000], object), 7**2000)
    assert long.scaled(Fraction(1, 3)).fractions == [Fraction(1)]


def test_sympy_expressions_are_multiplied_out_exactly():
    sympy = pytest.importorskip("sympy", reason="an optional package")
    x = sympy.Symbol("x")
    problem = sp.Problem((x - 0.1) ** 2 + x / 3)
    exact = [Fraction(0.1) ** 2, Fraction(1, 3) - 2 * Fraction(0.1), Fraction(1)]
    assert problem.objective.coefficients.tolist() == [float(value) for value in exact]
    assert problem.rounding[0].coefficients == 2


def test_what_was_rounded_on_the_way_stays_known():
    (x,) = sp.variables(1)
    long = (0.1 * x + 1) ** 200
    for p in (long * (x + 1), (x + 1) * long, long + x, x - long, long / 3, long.derivative(0)):
        assert p.exact is not None
        assert not p.exact.followed


def test_both_ends_of_the_bounds_count():
    x, y = sp.variables(2)
    slope = Fraction(0.1) * Fraction(0.1)
    error = abs(Fraction(float(slope)) - slope)
    for lower, upper in ((-3, 1), (-1, 3)):
        (record,) = sp.Problem(0.1 * x * y * 0.1, lower=lower, upper=upper).rounding
        assert (
            Fraction(record.shift) >= 9 * error > Fraction(record.shift) * (1 - Fraction(1, 2**50))
        )


LONG = np.longdouble(1) / 3
WIDE = pytest.mark.skipif(np.finfo(np.longdouble).nmant <= 52, reason="long doubles are doubles")


@WIDE
@pytest.mark.parametrize(
    ("place", "make"),
    [
        ("objective", lambda x: sp.Problem(LONG * x)),
        ("objective", lambda x: sp.Problem(x + LONG)),
        ("constraint 0", lambda x: sp.Problem(x, [x >= LONG])),
        ("lower", lambda x: sp.Problem(x, lower=LONG)),
        ("upper", lambda x: sp.Problem(x, upper=np.array([LONG]))),
    ],
)
def test_long_doubles_have_a_record(place, make):
    """A bound of 1/3 in 64 bits was one of 53 bits, and the attained value lay below it."""
    (x,) = sp.variables(1)
    (record,) = make(x).rounding
    assert (record.place, record.coefficients) == (place, 1)
    error = abs(Fraction(float(LONG)) - Fraction(*LONG.as_integer_ratio()))
    assert record.largest >= error / Fraction(1, 3) * (1 - Fraction(1, 2**50)) > 0


@WIDE
def test_long_doubles_beyond_doubles_are_refused():
    (x,) = sp.variables(1)
    with pytest.raises(sp.ProblemError, match="too large for a double"):
        np.longdouble("1e400") * x
    with pytest.raises(sp.ProblemError, match="found 0.33333333333333333.*, which no double"):
        sp.Polynomial(np.array([[1]], np.int32), np.array([LONG]), 1)


def test_numbers_of_other_packages_are_doubles_or_refused():
    sympy = pytest.importorskip("sympy", reason="an optional package")
    (x,) = sp.variables(1)
    assert sp.Problem(sympy.Float(0.5) * x).rounding == ()
    assert sp.Problem(sympy.Rational(1, 3) * x).rounding[0].place == "objective"
    with pytest.raises(sp.ProblemError, match="found Float .*, which is no double"):
        x * sympy.Float("0.1", 50)


@pytest.mark.parametrize(
    "coefficients",
    [[2**62 + 255], np.array([2**62 + 255]), np.array([-(2**53) - 1]), np.array([2**64 - 1], "u8")],
)
def test_arrays_of_integers_that_no_double_holds_are_refused(coefficients):
    with pytest.raises(sp.ProblemError, match="coefficients: found .*, which no double holds"):
        sp.Polynomial(np.array([[1]], np.int32), np.array(coefficients), 1)
    with pytest.raises(sp.ProblemError, match="coefficients: found .*, which no double holds"):
        sp.Polynomial.from_terms([[1]], coefficients)


def test_integers_beside_floats_are_looked_at_before_they_are_rounded():
    with pytest.raises(sp.ProblemError, match="found 4611686018427388159, which no double holds"):
        sp.Polynomial.from_terms([[1], [2]], [2**62 + 255, 0.5])
    assert sp.Polynomial.from_terms([[1], [2]], [2**62, 0.5]).coefficients.tolist() == [
        2.0**62,
        0.5,
    ]


@pytest.mark.parametrize("number", [2**70 + 1, Fraction(1, 3)])
def test_numbers_in_arrays_of_objects_are_looked_at(number):
    with pytest.raises(sp.ProblemError, match="which no double holds"):
        sp.Polynomial.from_terms([[1], [2]], [number, 0.5])
