"""The door for sympy: what comes in, and what is refused with which words."""

import re
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Kind, Problem, ProblemError
from sparsepop_py.algebra.sympy_ import convert

A, B = sympy.symbols("a b")


def read(polynomial):
    rows = polynomial.exponents.toarray().tolist()
    return dict(zip(map(tuple, rows), polynomial.coefficients.tolist(), strict=True))


@given(
    st.dictionaries(
        st.tuples(st.integers(0, 3), st.integers(0, 3)),
        st.fractions(-3, 3, max_denominator=40).filter(bool),
        max_size=5,
    )
)
@settings(max_examples=40, deadline=None)
def test_rational_coefficients_become_the_nearest_doubles(table):
    expression = sympy.Add(
        *(sympy.Rational(c.numerator, c.denominator) * A**i * B**j for (i, j), c in table.items())
    )
    problem = Problem(expression, names=["a", "b"])
    assert read(problem.objective) == {e: c.numerator / c.denominator for e, c in table.items()}


def test_products_and_powers_are_expanded():
    problem = Problem((A - 1) ** 3 * (B + 2))
    expected = {(3, 1): 1, (3, 0): 2, (2, 1): -3, (2, 0): -6, (1, 1): 3, (1, 0): 6}
    assert read(problem.objective) == expected | {(0, 1): -1, (0, 0): -2}


def test_floats_keep_every_bit():
    problem = Problem(0.1 * A + 1e-300 * B + A * B / 3)
    assert read(problem.objective) == {(1, 0): 0.1, (0, 1): 1e-300, (1, 1): 1 / 3}


def test_irrational_coefficients_are_rounded_to_nearest():
    problem = Problem(sympy.sqrt(2) * A + sympy.pi * B)
    assert read(problem.objective) == {(1, 0): float(np.sqrt(2.0)), (0, 1): float(np.pi)}
    (record,) = problem.rounding
    assert record.place == "objective" and "by an unknown amount" in str(record)
    assert not Problem(A / 4 + 3 * B).rounding


def test_relations_become_constraints_of_the_right_sign():
    rows = [A >= 1, A <= B, sympy.Eq(A * B, 2), 3 <= A, 3 >= A]
    problem = Problem(A + B, rows)
    assert [c.kind for c in problem.constraints] == [
        Kind.NONNEGATIVE,
        Kind.NONNEGATIVE,
        Kind.ZERO,
        Kind.NONNEGATIVE,
        Kind.NONNEGATIVE,
    ]
    assert [read(c.polynomial) for c in problem.constraints] == [
        {(0, 0): -1, (1, 0): 1},
        {(1, 0): -1, (0, 1): 1},
        {(0, 0): -2, (1, 1): 1},
        {(0, 0): -3, (1, 0): 1},
        {(0, 0): 3, (1, 0): -1},
    ]


def test_variables_come_in_natural_order():
    symbols = sympy.symbols("x10 x2 x1 y")
    assert Problem(sympy.Add(*symbols)).names == ("x1", "x2", "x10", "y")


def test_names_choose_and_order_the_variables():
    problem = Problem(A - 2 * B, names=["b", "unused", "a"])
    assert problem.names == ("b", "unused", "a")
    assert read(problem.objective) == {(1, 0, 0): -2, (0, 0, 1): 1}


def test_symbols_of_rows_alone_are_variables_too():
    assert Problem(A**2, [A * B >= 1]).names == ("a", "b")


def test_a_number_is_an_objective_beside_sympy_rows():
    problem = Problem(2, [A >= 1])
    assert read(problem.objective) == {(0,): 2.0}


@pytest.mark.parametrize(
    ("objective", "rows", "names", "message"),
    [
        (1 / A, [], None, "objective: found 1/a, expected a polynomial"),
        (sympy.sin(A), [], None, "objective: found sin(a), expected a polynomial"),
        (sympy.sqrt(A), [], None, "objective: found sqrt(a), expected a polynomial"),
        (A, [sympy.exp(B) >= 1], None, "constraints[0]: found"),
        (sympy.I * A, [], None, "expected real coefficients"),
        (A, [A > 1], None, "constraints[0]: found a > 1, expected a sympy relation"),
        (A, [A >= 0, sympy.Ne(A, 1)], None, "constraints[1]: found"),
        (A, [sympy.Eq(A, A)], None, "constraints[0]: found True"),
        (A, [A + B], None, "constraints[0]: found a + b"),
        (A + B, [], ["a"], "names: sympy symbols b are not among the names"),
        (sympy.Integer(3), [], None, "objective: found no symbol"),
        (sympy.Function("f")(A), [], None, "objective: found f(a), expected a polynomial"),
        (sympy.Symbol("c", commutative=False) * A, [], None, "non-commutative generators"),
    ],
)
def test_what_is_no_polynomial_problem_is_refused(objective, rows, names, message):
    with pytest.raises(ProblemError, match=re.escape(message)):
        Problem(objective, rows, names=names)


def test_sympy_and_polynomials_do_not_mix():
    x, y = sp.variables(2)
    with pytest.raises(ProblemError, match="mixed"):
        Problem(A, [x >= 0])
    with pytest.raises(ProblemError, match="mixed"):
        Problem(x + y, [A >= 0])


def test_what_is_not_symbolic_passes_unchanged():
    x, _ = sp.variables(2)
    rows = [x >= 0]
    objective, same = convert(x, rows, None)
    assert objective is x
    assert same is rows


def test_the_value_of_a_converted_polynomial_is_that_of_the_expression():
    expression = (A + 2 * B) ** 3 - A * B
    f = Problem(expression).objective
    for a, b in [(1, 2), (-3, 5), (7, -2)]:
        assert Fraction(f([a, b])) == Fraction(int(expression.subs({A: a, B: b})))


def test_relations_are_no_objectives_and_integer_symbols_are_refused():
    """sympy makes the polynomial a - b of the equation a = b."""
    a, b = sympy.symbols("a b")
    for objective in (sympy.Eq(a, b), a <= b):
        with pytest.raises(ProblemError, match="objective: found .*, expected a polynomial"):
            Problem(objective)
    k = sympy.Symbol("k", integer=True)
    for objective, rows in ((k**2 + a, []), (a, [k >= a])):
        with pytest.raises(ProblemError, match="found the integer symbols k, expected real"):
            Problem(objective, rows)


def test_signs_that_symbols_were_given_are_constraints():
    """sympy writes sqrt(x^2) as x where x is positive: its least value is 0, not -3."""
    x, y = sympy.Symbol("x", positive=True), sympy.Symbol("y", nonpositive=True)
    problem = Problem(sympy.sqrt(x**2) - y, [x <= 2], -3, 3)
    assert [str(row) for row in problem.constraints] == ["2 - x >= 0", "x >= 0", "-y >= 0"]
    result = sp.solve(problem)
    assert result.attained.value == 0.0 and -1e-6 <= result.lower_bound <= 0.0
    assert sp.RationalProblem(1 / (x + 1), [], -3, 3).constraints


def test_symbols_that_are_not_real_are_refused():
    z = sympy.Symbol("z", imaginary=True)
    with pytest.raises(ProblemError, match="found the symbols z, which are not real"):
        Problem(z**2, [], -1, 1)


def test_a_sympy_poly_is_an_objective():
    for domain in (sympy.QQ, sympy.RR):
        poly = sympy.Poly(A**2 - A / 3, A, domain=domain)
        assert read(Problem(poly).objective) == {(2,): 1.0, (1,): -1 / 3}
    with pytest.raises(ProblemError, match="objective: found Poly.*modulus=3.*expected a poly"):
        Problem(sympy.Poly(A, modulus=3))
