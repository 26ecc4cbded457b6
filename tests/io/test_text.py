"""Expressions and problems as text."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.errors import FormatError
from sparsepop_py.io.expressions import parse_expression, parse_number
from sparsepop_py.io.text import parse

NAMES = ("x1", "x2", "x3")


def terms(polynomial: sp.Polynomial) -> dict[tuple[int, ...], float]:
    rows = polynomial.exponents.toarray().tolist()
    return dict(zip(map(tuple, rows), polynomial.coefficients.tolist(), strict=True))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-x1^2", {(2, 0, 0): -1.0}),
        ("(-x1)^2", {(2, 0, 0): 1.0}),
        ("3*2*x1", {(1, 0, 0): 6.0}),
        ("x1/2", {(1, 0, 0): 0.5}),
        ("x1/2*4", {(1, 0, 0): 2.0}),
        ("+ - 0.5*x2", {(0, 1, 0): -0.5}),
        ("x1 - -x2", {(1, 0, 0): 1.0, (0, 1, 0): 1.0}),
        ("2*-x1", {(1, 0, 0): -2.0}),
        ("x1**2*x2^2.0", {(2, 2, 0): 1.0}),
        ("x1*x2^2*x1", {(2, 2, 0): 1.0}),
        ("1.5e-3*x1 + 2.0E+2 + .5", {(1, 0, 0): 1.5e-3, (0, 0, 0): 200.5}),
        ("(1/3)*x1^6", {(6, 0, 0): 1 / 3}),
        ("((x1 + 1))*(x1 - 1)", {(2, 0, 0): 1.0, (0, 0, 0): -1.0}),
        ("(x1 + 2*x2)^2/4", {(2, 0, 0): 0.25, (1, 1, 0): 1.0, (0, 2, 0): 1.0}),
        ("sqr(x1 - 1)", {(2, 0, 0): 1.0, (1, 0, 0): -2.0, (0, 0, 0): 1.0}),
        ("Power(x1, 1 + 2) + power(2, 3)", {(3, 0, 0): 1.0, (0, 0, 0): 8.0}),
        ("10^-3*x1", {(1, 0, 0): 1e-3}),
        ("x1 - x1", {}),
        ("x1/(1 + x2 - x2)", {(1, 0, 0): 1.0}),
        ("(x1 + x2)^0", {(0, 0, 0): 1.0}),
        ("1e-10*x1", {(1, 0, 0): 1e-10}),
    ],
)
def test_expressions(text: str, expected: dict[tuple[int, ...], float]) -> None:
    assert terms(parse_expression(text, NAMES)) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("min", "nothing after the keyword"),
        ("", "no objective"),
        ("  ; ;", "no objective"),
        ("x1 >= 0", "'x1 >= 0': found no objective"),
        ("min x1; max x2", "statement 'max x2': found a second objective"),
        ("min 3", "no variable"),
        ("min x1; x1", "found no relation, expected one of >=, <=, =="),
        ("min x1; x1 < 2", "found '<', expected one of >="),
        ("min x1; x1 != 2", "found '!='"),
        ("min x1; >= 2", "nothing on one side"),
        ("min x1; 0 <= x1 >= -1", "in one chain, expected the same relation twice, or ';' between"),
        ("min x1; 0 <= x1 <= 1 <= 2", "3 relations, expected at most two"),
        ("min x1; s.t.", "nothing after the keyword"),
        ("min x1 >= 2", "found '>='"),
        ("min x1/(1/x2)", "division by a ratio, expected a polynomial"),
        ("min x1/(x2 - x2)", "division by zero"),
        ("min (x1/x2)^20", "exponent 20 of a ratio, expected an integer from 0 to 10"),
        ("min x1/x2 + exp(x1)", "function 'exp'"),
        ("min x1/0", "division by zero"),
        ("min x1^0.5", "exponent 0.5, expected a non-negative integer"),
        ("min x1^(-1.5)", "exponent -1.5, expected a non-negative integer"),
        ("min x1^x2", "exponent with variables, expected a number"),
        ("min x1^2^3", "second exponent, expected parentheses"),
        ("min x1^1001", "degree 1001, expected at most degree 1000"),
        ("min exp(x1)", "function 'exp'"),
        ("min power(x1)", "found ')', expected ','"),
        ("min (x1 + 2", "end of the expression, expected one of + - * / ^ or ')'"),
        ("min x1 + 2)", "found ')', expected a matching '('"),
        ("min 2x1", "found 'x1', expected one of"),
        ("min x1 +", "end of the expression, expected a number, a name or '('"),
        ("min x1 ? x2", "found '?'"),
        ("min x1, x2", "found ','"),
        ("min 1e400*x1", "found '1e400', expected a number that a double can hold"),
        ("min x1;\n x1 >= 1e-400", "found '1e-400', expected a number that a double can hold"),
        ("min 1e200*1e200*x1", "coefficient that overflows"),
        ("min (-8)^(1/3)*x1", "finite real number"),
        ("min " + "(" * 101 + "x1" + ")" * 101, "at most 100 nested parentheses"),
        ("min (x1+x2+x3+x4+x5+x6+x7+x8+x9)^16", "product of parentheses"),
        ("min x1\n; x1 >= 0;\n x2 + * 3 >= 0", "line 3: statement 'x2 + * 3 >= 0': found '*'"),
    ],
)
def test_malformed_text(text: str, words: str) -> None:
    with pytest.raises(FormatError) as caught:
        parse(text)
    assert words in str(caught.value)
    assert re.match(r"line \d+: statement '.*': found .*, expected .*", str(caught.value))


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(FormatError, match="position 5: found the unknown name 'y', expected .*x1"):
        parse_expression("x1 + y", NAMES)


def test_number() -> None:
    assert parse_number("-(1 + 1/2)^2") == -2.25
    with pytest.raises(FormatError, match="unknown name"):
        parse_number("x1")
    with pytest.raises(FormatError, match="finite"):
        parse_number("1e300*1e300")


def test_problem() -> None:
    problem = parse("min x1^2*x2; s.t. 1-x1^2>=0; x1*x2==1; x2 <= 3 + x1")
    assert [str(row) for row in problem.constraints] == [
        "1 - x1^2 >= 0",
        "-1 + x1*x2 == 0",
        "3 + x1 - x2 >= 0",
    ]
    assert str(problem.objective) == "x1^2*x2"
    assert np.all(np.isinf(problem.lower)) and np.all(np.isinf(problem.upper))
    assert problem.sense == "min" and problem.squares == ()


def test_variables_are_those_that_occur_in_natural_order() -> None:
    problem = parse("min x10; x2 + a_3 >= 0*y")
    assert problem.names == ("a_3", "x2", "x10", "y")


@pytest.mark.parametrize("word", ["max", "maximize", "Maximise", "MAX"])
def test_maximisation_is_negated(word: str) -> None:
    problem = parse(f"{word} x1 - (x1)^2")
    assert problem.sense == "max" and problem.squares == ()
    assert problem.objective([3.0]) == 6.0


@pytest.mark.parametrize(
    "text",
    [
        "min x1; s.t. x1 >= 0; x2 = 1",
        "minimize x1 s.t. x1 >= 0; x2 == 1;",
        "minimise x1 subject to x1 >= 0; x2 == 1",
        "MIN x1;\nSubject To\n x1 >= 0;\n x2 == 1;\n",
        "min: x1; st x1 >= 0; x2 == 1",
        "min x1; x1 >= 0; s.t. x2 == 1",
    ],
)
def test_spellings(text: str) -> None:
    assert parse(text).fingerprint == parse("min x1; s.t. x1 >= 0; x2 == 1").fingerprint


def test_chains_make_two_constraints() -> None:
    problem = parse("min x1; -1 <= x1 <= x2; x1 == x2 = 3")
    assert [str(row) for row in problem.constraints] == [
        "1 + x1 >= 0",
        "-x1 + x2 >= 0",
        "x1 - x2 == 0",
        "-3 + x2 == 0",
    ]


@pytest.mark.parametrize(
    ("objective", "expected"),
    [
        ("(x1^2+x2-11)^2+(x1+x2^2-7)^2", [(1, "-11 + x2 + x1^2"), (1, "-7 + x1 + x2^2")]),
        ("100*(x2-x1^2)^2+(1-x1)^2+3", [(100, "x2 - x1^2"), (1, "1 - x1")]),
        ("3*x1^4/2 - 5 + sqr(x2)", [(1.5, "x1^2"), (1, "x2")]),
        ("(x1+x2)^4", [(1, "x1^2 + 2*x1*x2 + x2^2")]),
        ("2*((x1-1)^2+0.5*x2^2)", [(2, "-1 + x1"), (1, "x2")]),
        ("x1^2*x2^2*3 + x1**2", [(3, "x1*x2"), (1, "x1")]),
        ("(1/3)*x1^2 - (0.5)^2", [(1 / 3, "x1")]),
        ("- -x1^2", [(1, "x1")]),
        ("-(-2)*x1^2", [(2, "x1")]),
        ("0*x1^2 + x2^2", [(1, "x2")]),
    ],
)
def test_sums_of_squares_are_seen(objective: str, expected: list[tuple[float, str]]) -> None:
    squares = parse(f"min {objective}").squares
    assert [(weight, str(root)) for weight, root in squares] == expected


@pytest.mark.parametrize(
    "objective",
    ["x1^2 - x2^2", "x1^3", "x1^2 + x1", "-(x1)^2", "x1^2 + x1*x2", "(x1)*(x1)", "5*x1"],
)
def test_other_objectives_have_no_squares(objective: str) -> None:
    assert parse(f"min {objective}").squares == ()


def test_many_terms_and_factors_do_not_recurse() -> None:
    text = " + ".join(f"{v}.5*x{v}*x{v + 1}" for v in range(1, 20001))
    problem = parse(f"min {text} " + "-" * 5001 + "x1")
    assert problem.objective.terms == 20001
    assert problem.dimension == 20001


# ---- random expressions against Python's own evaluation ---------------------------------

numbers = st.floats(-4, 4, allow_nan=False).map(lambda value: repr(abs(round(value, 3))))
atoms = numbers | st.sampled_from(NAMES)


def compound(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    operator = st.sampled_from([" + ", "-", "*", " - -", "*-"])
    return (
        st.tuples(inner, operator, inner).map("".join)
        | inner.map(lambda text: f"({text})")
        | st.tuples(inner, st.integers(0, 3)).map(lambda pair: f"({pair[0]})**{pair[1]}")
        | st.tuples(inner, st.integers(1, 9)).map(lambda pair: f"({pair[0]})/{pair[1]}")
        | inner.map(lambda text: f"-{text}")
    )


@settings(max_examples=200, deadline=None)
@given(
    st.recursive(atoms, compound, max_leaves=8), st.lists(st.floats(-2, 2), min_size=3, max_size=3)
)
def test_expressions_agree_with_python(text: str, point: list[float]) -> None:
    assume(text.count("**") <= 4)
    values = dict(zip(NAMES, point, strict=True))
    expected = eval(text, {"__builtins__": {}}, values)  # the grammar is Python's, with **
    size = eval(
        text.replace("-", "+"), {"__builtins__": {}}, {k: abs(v) for k, v in values.items()}
    )
    polynomial = parse_expression(text.replace("**", "^"), NAMES)
    assert abs(polynomial(point) - expected) <= 1e-11 * (1 + abs(size))


# ---- infinite bounds, long texts ---------------------------------------------------------


@pytest.mark.parametrize(
    "rows",
    ["x <= inf", "-inf <= x", "x >= -Inf; y <= Infinity", "-inf <= x <= +inf", "inf >= y >= -INF"],
)
def test_infinite_bounds_are_no_constraints_and_no_variables(rows: str) -> None:
    problem = parse(f"min x*y; s.t. {rows}")
    assert problem.names == ("x", "y")
    assert problem.constraints == ()


def test_a_problem_is_read_as_it_is_printed() -> None:
    x, y = sp.variables(2, ["x", "y"])
    text = str(sp.Problem(x * y, [x + y >= 1], lower=[2, -np.inf])).replace("\n", ";")
    assert "2 <= x <= inf" in text
    again = parse(text)
    assert [str(row) for row in again.constraints] == ["-1 + x + y >= 0", "-2 + x >= 0"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("min x; x >= inf", "an infinite bound"),
        ("min x; x == inf", "an infinite bound"),
        ("min x; x = -inf", "an infinite bound"),
        ("min x; inf <= x", "an infinite bound"),
        ("min x; -inf <= x <= -inf", "an infinite bound"),
        ("min x; x <= 2*inf", "'inf'"),
        ("min x; x <= (inf)", "'inf'"),
        ("min x; x <= nan", "'nan'"),
        ("min inf*x; x >= 1", "'inf'"),
        ("min x + NaN", "'NaN'"),
    ],
)
def test_what_is_no_number_is_refused(text: str, found: str) -> None:
    with pytest.raises(FormatError, match=re.escape(f"found {found}, expected a finite number")):
        parse(text)


def test_names_that_begin_like_infinity_are_names() -> None:
    assert parse("min info + nano + infinite").names == ("infinite", "info", "nano")


@pytest.mark.parametrize("count", [1, 2, 100_000, 100_001])
def test_many_signs(count: int) -> None:
    signs, expected = "-" * count, "x" if count % 2 == 0 else "-x"
    assert str(parse(f"min {signs}x").objective) == expected
    problem = parse(f"min {signs}x^2; {signs}x >= 1; x*{signs}3 <= 1")
    assert len(problem.squares) == (count % 2 == 0)
    assert str(problem.constraints[0].polynomial) == f"-1 {'+' if count % 2 == 0 else '-'} x"


def test_lines_are_counted_once_for_all_statements() -> None:
    with pytest.raises(FormatError, match="line 2001: "):
        parse("min x;\n" + "x >= 1;\n" * 1_999 + "x ! 1")


def test_numbers_in_names_may_be_long_and_equal() -> None:
    long = "x" + "1" * 5000
    assert parse(f"min {long} + x2 + x02 + x01 + x1").names == ("x01", "x1", "x02", "x2", long)


@pytest.mark.parametrize("text", ["min x² - 2*x; s.t. 0 <= x <= 5", "min x*½", "min y + x³1"])
def test_numbers_that_are_no_digits_are_part_of_no_name(text: str) -> None:
    with pytest.raises(sp.FormatError, match="line 1.*expected x\\^2 for a power"):
        sp.parse(text)


def test_letters_of_all_languages_are_part_of_names() -> None:
    assert sp.parse("min größe2 + x٢; s.t. größe2 >= 1; x٢ >= 0").names == ("größe2", "x٢")
