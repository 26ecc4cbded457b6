"""Reading and writing GAMS files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py.errors import FormatError
from sparsepop_py.io.gams import read_gms, write_gms

SMALL = """* a comment; with a semicolon
Variables  x1,x2,
           objvar;
Positive Variables x1;
Equations  e1,e2 , e3;

e1..  2*x1 - 3*x2
* a comment inside a statement
      + objvar =E= 1;
e2..  x1*x1 + x2^2 =G= 1; e3.. x1 =L= x2 + 4;
x1.up = 2; x2.lo = -1e10;
x1.l = 0.3; e1.m = 1; objvar.l = 2;
Model m / all /;
m.limrow=0; m.limcol=0;
$if NOT '%gams.u1%' == '' $include '%gams.u1%'
Solve m using NLP minimizing objvar;
"""


@pytest.fixture
def read(tmp_path: Path):
    def reader(text: str) -> sp.Problem:
        path = tmp_path / "case.gms"
        path.write_bytes(text.encode())
        return read_gms(path)

    return reader


def file(body: str, names: str = "x,y,objvar", equations: str = "e1,e2") -> str:
    return f"Variables {names};\nEquations {equations};\n{body}\n"


def test_small(read) -> None:
    problem = read(SMALL)
    assert problem.names == ("x1", "x2")
    assert str(problem.objective) == "1 - 2*x1 + 3*x2"
    assert [str(row) for row in problem.constraints] == [
        "e2: -1 + x1^2 + x2^2 >= 0",
        "e3: 4 - x1 + x2 >= 0",
    ]
    assert problem.lower.tolist() == [0, -np.inf]
    assert problem.upper.tolist() == [2, np.inf]
    assert problem.sense == "min"


def test_line_ends_and_case(read) -> None:
    expected = read(SMALL).fingerprint
    assert read(SMALL.replace("\n", "\r\n")).fingerprint == expected
    assert read(SMALL.upper()).fingerprint == expected
    assert read("\ufeff" + SMALL).fingerprint == expected


@pytest.mark.parametrize(
    ("equation", "objective"),
    [
        ("objvar =E= x^2 + 1", "1 + x^2"),
        ("x^2 + 1 =E= objvar", "1 + x^2"),
        ("- objvar + x^2 =G= -1", "1 + x^2"),
        ("2*objvar =E= x", "0.5*x"),
        ("x - 4*objvar =E= 2", "-0.5 + 0.25*x"),
        ("3*objvar - objvar + x =E= 0", "-0.5*x"),
        ("x + objvar/2 =L= (x - y)^2 + x", "2*x^2 - 4*x*y + 2*y^2"),
    ],
)
def test_objective_row(read, equation: str, objective: str) -> None:
    problem = read(file(f"e1.. {equation}; e2.. y =G= 0;"))
    assert str(problem.objective) == objective
    assert problem.names == ("x", "y")


@pytest.mark.parametrize(
    "ending",
    [
        "Solve m using NLP maximizing objvar;",
        "SOLVE m using %MINLP%  maximizing   OBJVAR;",
        "solve m maximising objvar using nlp;",
        "*  Solve m using NLP maximizing objvar;",
        "* Solve m using NLP minimizing objvar;\nSolve m using NLP maximizing objvar;",
    ],
)
def test_maximisation(read, ending: str) -> None:
    problem = read(file(f"e1.. objvar =E= x - y; e2.. y =G= 0;\n{ending}\n"))
    assert problem.sense == "max"
    assert str(problem.objective) == "-x + y"


def test_objective_variable_of_another_name(read) -> None:
    text = file("e1.. x =E= z + 1; e2.. y =G= 0;\nSolve m using nlp minimizing Z;", "x,y,z")
    assert str(read(text).objective) == "-1 + x"


@pytest.mark.parametrize(
    ("row", "direction"),
    [
        ("objvar =L= x", "minimizing"),
        ("x =G= objvar", "minimizing"),
        ("objvar =G= x", "maximizing"),
        ("-2*objvar =L= x", "maximizing"),
        ("objvar =G= x; objvar.lo = 0", "minimizing"),
        ("objvar =L= x; objvar.up = 0", "maximizing"),
        ("objvar =G= x; objvar.fx = 0", "minimizing"),
    ],
)
def test_objective_rows_that_do_not_bind_are_refused(read, row, direction) -> None:
    text = file(f"e1.. {row}; e2.. y =G= 0;\nSolve m using nlp {direction} objvar;")
    with pytest.raises(sp.FormatError, match="an inequality that leaves 'objvar' free"):
        read(text)


@pytest.mark.parametrize(
    ("row", "direction", "objective"),
    [
        ("objvar =G= x; objvar.up = 5", "minimizing", "x"),
        ("x =L= 2*objvar", "minimizing", "0.5*x"),
        ("objvar =L= x", "maximizing", "-x"),
        ("-objvar =G= x; objvar.lo = 5", "maximizing", "x"),
    ],
)
def test_objective_rows_that_bind_are_read(read, row, direction, objective) -> None:
    text = file(f"e1.. {row}; e2.. y =G= 0;\nSolve m using nlp {direction} objvar;")
    assert str(read(text).objective) == objective


def test_kinds_and_bounds(read) -> None:
    problem = read(
        """Variables a,b,c,d,e,f,objvar;
        positive variable a, f; NEGATIVE VARIABLES b; Free Variables e; Integer Variable d;
        Binary Variables c;
        Equations o; o.. a + b + c + d + e =E= objvar;
        a.up = 2e10; b.lo = -(1 + 1/2); d.up = 1; e.fx = -0.25; f.lo = -3;
        """
    )
    assert problem.lower.tolist() == [0, -1.5, 0, 0, -0.25, -3]
    assert problem.upper.tolist() == [np.inf, 0, 1, 1, -0.25, np.inf]
    assert [str(row) for row in problem.constraints] == [
        "binary c: -c + c^2 == 0",
        "binary d: -d + d^2 == 0",
    ]


def test_infinite_bounds_are_none(read) -> None:
    problem = read(file("e1.. x =E= objvar; e2.. y =G= 0; x.lo = -inf; x.up = +INF; y.up = inf;"))
    assert problem.lower[0] == -np.inf and problem.upper[:2].tolist() == [np.inf, np.inf]


def test_typed_variables_whose_terms_cancel_are_used(read) -> None:
    text = "Variables x,objvar; Positive Variables z; Equations o; o.. x + z - z =E= objvar;"
    assert read(text).names == ("x", "z")


def test_negative_exponents_are_ratios(read) -> None:
    problem = read(file("e1.. power(x/y,2) + x**(-2) + 3*power(y,-1) =E= objvar; e2.. y =G= 1;"))
    assert str(problem.objective) == "(x^2)/(y^2) + (1)/(x^2) + (3)/(y)"


def test_an_integer_without_room_is_named(read) -> None:
    text = "Variables x,objvar; Integer Variables x; Equations o; o.. x =E= objvar;"
    with pytest.raises(sp.ProblemError, match=r"x: found no integer between its bounds 0\.5, 0\.7"):
        read(text + " x.lo = 0.5; x.up = 0.7;")


def test_explicit_bounds_win_whatever_the_order(read) -> None:
    body = "e1.. x =E= objvar; e2.. y =G= 0; x.lo = -3;\nPositive Variables x;"
    assert read(file(body)).lower[0] == -3


def test_binaries_may_be_fixed(read) -> None:
    problem = read(file("Binaries x; e1.. x =E= objvar; e2.. y =G= 0; x.fx = 1;"))
    assert (problem.lower[0], problem.upper[0]) == (1, 1)


def test_bounds_of_the_objective_become_constraints(read) -> None:
    body = "e1.. x^2 =E= objvar; e2.. y =G= 0; objvar.lo = 1; objvar.up = 4;"
    rows = [str(row) for row in read(file(body)).constraints[1:]]
    assert rows == ["objvar_lo: -1 + x^2 >= 0", "objvar_up: 4 - x^2 >= 0"]
    body = "e1.. x^2 =E= objvar; e2.. y =G= 0; objvar.fx = 2;"
    assert str(read(file(body)).constraints[-1]) == "objvar_fx: -2 + x^2 == 0"


def test_small_coefficients_and_parentheses(read) -> None:
    body = "e1.. objvar =e= 1e-10*x + sqr(x - y)/2; e2.. power(y, 3) =g= (x + 1)*(x - 1);"
    problem = read(file(body))
    assert problem.objective.coefficients.min() == -1.0
    assert 1e-10 in problem.objective.coefficients
    assert str(problem.constraints[0]) == "e2: 1 - x^2 + y^3 >= 0"


def test_terms_are_merged(read) -> None:
    """Products in any order, repeated terms, signs before signs, constants on the left."""
    body = """e1.. objvar =E= x*y^2*x + 1.5e-3*y^2.0*x^2 + - 0.5*y - x*x + 2.0E+2*x^2 - 3*x
    + 3*x; e2.. y + 4 - x =L= 1;"""
    problem = read(file(body))
    assert str(problem.objective) == "-0.5*y + 199*x^2 + 1.0015*x^2*y^2"
    assert str(problem.constraints[0]) == "e2: -3 + x - y >= 0"


def test_blocks_and_text_after_solve_are_skipped(read) -> None:
    text = "$ontext\nVariables wrong\n$include wrong\n$OFFTEXT\n" + SMALL + "display x1.l;\n"
    assert read(text).fingerprint == read(SMALL).fingerprint


@pytest.mark.parametrize("rest", ["", " ", "\t", " of a comment", "; x1.up = 1;"])
def test_the_rest_of_a_line_that_opens_or_closes_a_block_is_ignored(read, rest: str) -> None:
    block = f"$OnText{rest}\nx1.up = 1;\n$if set none\n * \n$offText{rest}\n"
    text = SMALL.replace("Model m", block + "Model m")
    assert read(text).fingerprint == read(SMALL).fingerprint


@pytest.mark.parametrize(
    "line",
    [
        "$title A problem; $set x 1",
        "$STitle",
        "$hidden x1.up = 1;",
        "$offlisting",
        "$offsymxref offsymlist $offuelxref offuellist ",
        "$onUpper onDigit onWarning offDollar offInclude",
        "$eject",
        "$lines 7",
        "$if not set NLP $set NLP NLP",
    ],
)
def test_lines_about_the_listing_are_skipped(read, line: str) -> None:
    text = SMALL.replace("Model m", f"{line}\nModel m").replace("using NLP", "using %NLP%")
    assert read(text).fingerprint == read(SMALL).fingerprint


@pytest.mark.parametrize(
    "line",
    [
        "$include 'other.gms'",
        "$batinclude other.gms 3",
        "$if set none x1.up = 1;",
        "$if NOT '%gams.u1%' == '' $include 'other.gms'",
        "$if not set NLP $set x1 NLP",
        "$iftheni '%gams.u1%' == ''",
        "$elseif set none",
        "$else",
        "$endif",
        "$goto end",
        "$label end",
        "$exit",
        "$stop",
        "$terminate",
        "$abort",
        "$macro x3 x1",
        "$set x3 x1",
        "$setglobal x3 x1",
        "$evalLocal x3 1",
        "$onmacro",
        "$onecho > file",
        "$offlisting $include other.gms",
        "$offlisting include other.gms",
        "$eolcom --",
        "$comment x",
        "$maxcol 20",
        "$offtext",
        "$ontexts",
        "$",
        "$ title A problem",
    ],
)
def test_lines_that_can_change_the_problem_are_refused(read, line: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(SMALL.replace("Model m", f"{line}\nModel m"))
    assert f"case.gms:13: statement '{line[:16]}" in str(caught.value)
    assert f"found {line.split()[0]!r}, expected one file" in str(caught.value)


@pytest.mark.parametrize("line", ["$exit", "$if set x $abort", "$onecho > file", "$offecho"])
def test_lines_behind_the_first_solve_change_nothing(read, line: str) -> None:
    solves = SMALL.replace("Model m", "$offlisting\nModel m")
    assert read(f"{solves}\n{line}\n").fingerprint == read(SMALL).fingerprint


def test_a_star_in_column_one_is_a_comment_and_elsewhere_a_product(read) -> None:
    body = "e1.. objvar =E= 3\n*x\n  *y; e2.. y =G= 0;"
    assert str(read(file(body)).objective) == "3*y"


def test_quoted_explanations_and_lines_as_separators(read) -> None:
    text = file("e1.. x =E= objvar; e2.. y =G= 0;", "x 'first', y\n objvar \"cost\"")
    assert read(text).names == ("x", "y")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "found no statement"),
        ("* only a comment\n", "found no statement"),
        (file("e1.. objvar =E= x; e2.. y =G= 0"), "end of the file, expected ';'"),
        (file("e1.. objvar =E= x;"), "equation 'e2' without a definition"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; e3.. x =G= 0;"), "undeclared equation 'e3'"),
        (file("e1.. objvar =E= x; e1.. y =G= 0;"), "second definition of 'e1'"),
        (file("", equations="e1,E1"), "'E1' twice"),
        (file("", names="x,X,objvar"), "'X' twice"),
        (file("", names="x,2y,objvar"), "found '2y', expected a name"),
        (file("", names=""), "an empty list"),
        (file("e1.. objvar =E= x + z; e2.. y =G= 0;"), "unknown name 'z'"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; z.lo = 1;"), "undeclared variable 'z'"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; x.low = 1;"), "found '.low'"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; x.lo = inf;"), "expected a finite number"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; x.lo = 1e999;"), "expected a finite number"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; x.lo = nan;"), "expected a finite number"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; x.lo = 2; x.up = 1;"), "bounds [2, 1] of 'x'"),
        (file("e1.. objvar =E= 1e999*x; e2.. y =G= 0;"), "found '1e999'"),
        (file("e1.. objvar =E= 1/(1/x); e2.. y =G= 0;"), "division by a ratio"),
        (file("e1.. x/objvar =E= 1; e2.. y =G= 0;"), "'objvar' in a product or a power"),
        (file("e1.. objvar =E= x^1.5; e2.. y =G= 0;"), "exponent 1.5"),
        (file("e1.. objvar =E= exp(x); e2.. y =G= 0;"), "function 'exp'"),
        (file("e1.. objvar + x; e2.. y =G= 0;"), "0 relations"),
        (file("e1.. objvar =E= x =E= y; e2.. y =G= 0;"), "2 relations"),
        (file("e1.. objvar =N= x; e2.. y =G= 0;"), "found '=N=', expected one of =E="),
        (file("e1.. objvar*x =E= x; e2.. y =G= 0;"), "'objvar' in a product or a power"),
        (file("e1.. objvar^2 =E= x; e2.. y =G= 0;"), "'objvar' in a product or a power"),
        (file("e1.. objvar =E= x; e2.. y =G= objvar;"), "'objvar' in a second equation"),
        (file("e1.. x =E= 1; e2.. y =G= 0;"), "'objvar' in no equation"),
        (file("e1.. x =E= 1; e2.. y =G= 0;", "x,y"), "no variable 'objvar'"),
        (file("e1.. objvar =E= 1; e2.. objvar =G= 0;", "objvar"), "no variable but the objective"),
        (
            file("e1.. objvar =E= x; e2.. y =G= 0; Integer Variables x;"),
            "integer variable 'x', expected two bounds of each integer variable, smaller than 1e10",
        ),
        (file("e1.. objvar =E= x; e2.. y =G= 0; Binary Variables objvar;"), "as objective"),
        (file("SOS1 Variables x;"), "'SOS1' variables"),
        (file("Positive Variables x; Negative Variables x;"), "which is positive already"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; Positive Variables x2;"), "which no Variables"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; Solve m using nlp;"), "no direction"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; Solve m using nlp minimizing w;"), "variable 'w'"),
        (file("e1.. objvar =E= x; e2.. y =G= 0; Model m / e1 /;"), "a part of the equations"),
        (file("Parameter p / 3 /;"), "unknown statement"),
        ("$ontext\n" + SMALL, "no $offtext"),
        (
            "* Solve m using NLP maximizing objvar;\n* Solve m using NLP minimizing objvar;\n"
            + file("e1.. objvar =E= x; e2.. y =G= 0;"),
            "second direction",
        ),
    ],
)
def test_malformed_files(read, text: str, words: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(text)
    message = str(caught.value)
    assert words in message
    assert re.search(r"case\.gms:\d+: statement '.*': found .*, expected .*", message)


def test_the_line_is_that_of_the_slip(read) -> None:
    text = SMALL.replace("+ objvar =E= 1", "+ objvar + zz =E= 1")
    with pytest.raises(FormatError, match=r"case\.gms:9: statement 'e1\.\. .*unknown name 'zz'"):
        read(text)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="missing.gms: no such file") as caught:
        read_gms(tmp_path / "missing.gms")
    assert isinstance(caught.value.__cause__, OSError)
    with pytest.raises(FormatError, match="(?i)directory|permission"):
        read_gms(tmp_path)


# ---- writing ----------------------------------------------------------------------------


def check_round_trip(problem: sp.Problem, path: Path) -> sp.Problem:
    write_gms(problem, path)
    again = read_gms(path)
    assert again.fingerprint == problem.fingerprint
    assert again.sense == problem.sense
    assert all(not line.startswith("*") for line in path.read_text().split("\n")[1:])
    return again


def test_round_trip_of_a_maximisation(tmp_path: Path) -> None:
    x, y = sp.variables(2, ["x", "objvar"])
    problem = sp.Problem(
        -(3 - 0.1 * x * y), [x + y == 1, x >= y], [0, -2], [0, np.inf], sense="max"
    )
    path = tmp_path / "max.gms"
    check_round_trip(problem, path)
    assert "3.0 - 0.1*x*objvar_2" not in path.read_text()  # the user's objvar keeps its name
    assert "- objvar_2 + 3.0 - 0.1*x*objvar =E= 0;" in path.read_text()
    assert "maximizing objvar_2;" in path.read_text()


def test_names_become_legal_and_distinct(tmp_path: Path) -> None:
    names = ["eta[1]", "eta(1)", "2x", "Model", "a", "A", "größe"]
    v = sp.variables(7, names)
    row = sp.Constraint(v[0] * v[1], sp.Kind.ZERO, "a")
    problem = sp.Problem(sp.total(v), [row, v[6] >= 0], lower=-1)
    again = check_round_trip(problem, tmp_path / "names.gms")
    assert len({name.lower() for name in again.names}) == 7
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in again.names)


def test_legal_names_are_kept(tmp_path: Path) -> None:
    x, y = sp.variables(2, ["flow", "Q2"])
    row = sp.Constraint(x * y, sp.Kind.ZERO, "balance")
    again = check_round_trip(sp.Problem(x + y, [row]), tmp_path / "names.gms")
    assert again.names == ("flow", "Q2") and again.constraints[0].name == "balance"


def test_zero_polynomials_and_long_rows(tmp_path: Path) -> None:
    v = sp.variables(60)
    rows = [v[0] * 0.0 >= 0, sp.total(v) ** 2 >= 1]
    check_round_trip(sp.Problem(v[0] * 0.0, rows), tmp_path / "long.gms")
    text = (tmp_path / "long.gms").read_text()
    assert max(map(len, text.split("\n"))) <= 80


def test_large_finite_bounds_are_not_lost(tmp_path: Path) -> None:
    x, y = sp.variables(2)
    write_gms(sp.Problem(x + y, lower=[-2e10, 3e10], upper=[5e12, np.inf]), tmp_path / "large.gms")
    rows = [str(row).split(": ")[1] for row in read_gms(tmp_path / "large.gms").constraints]
    assert rows == ["20000000000 + x1 >= 0", "5000000000000 - x1 >= 0", "-30000000000 + x2 >= 0"]


doubles = st.floats(-1e9, 1e9).filter(bool)
polynomials = st.dictionaries(st.tuples(*[st.integers(0, 3)] * 3), doubles, max_size=6).map(
    lambda table: sp.Polynomial.from_terms(
        np.array(list(table), int).reshape(-1, 3), list(table.values())
    )
)
intervals = st.tuples(st.none() | st.floats(-9e9, 9e9), st.none() | st.floats(0, 9e9)).map(
    lambda pair: (
        -np.inf if pair[0] is None else pair[0],
        np.inf if pair[1] is None else (pair[0] or 0.0) + pair[1] * 1e-5,
    )
)
problems = st.builds(
    lambda objective, rows, bounds, sense: sp.Problem(
        objective,
        [sp.Constraint(row, kind) for row, kind in rows],
        [low for low, _ in bounds],
        [high for _, high in bounds],
        sense=sense,
    ),
    polynomials,
    st.lists(
        st.tuples(polynomials, st.sampled_from([sp.Kind.NONNEGATIVE, sp.Kind.ZERO])), max_size=4
    ),
    st.lists(intervals, min_size=3, max_size=3),
    st.sampled_from(["min", "max"]),
)


@settings(max_examples=100, deadline=None)
@given(problems)
def test_round_trips(tmp_path_factory: pytest.TempPathFactory, problem: sp.Problem) -> None:
    check_round_trip(problem, tmp_path_factory.mktemp("gms") / "random.gms")


def test_what_follows_solve_needs_no_end(read) -> None:
    text = file("e1.. objvar =E= x; e2.. y =G= 0; Solve m using nlp minimizing objvar;")
    problem = read(text + "\nScalar s 'status';\ns = m.modelstat\n\nScalar t\n")
    assert problem.names == ("x", "y")


def test_integers_are_sums_of_bits(read) -> None:
    problem = read(
        file("e1.. objvar =E= x; e2.. x =G= y;\nInteger Variables y; y.lo = 2; y.up = 7;")
    )
    assert problem.names == ("x", "y", "y_bit0", "y_bit1", "y_bit2")
    for y in range(2, 8):
        bits = [float(digit) for digit in f"{y - 2:03b}"[::-1]]
        assert problem.violation([9.0, y, *bits]) == 0
    assert problem.violation([9.0, 2.5, 0.5, 0, 0]) > 0.2


@pytest.mark.parametrize(
    ("bounds", "places"),
    [
        ("x1.lo = 0; x1.up = 1/3;", ["upper"]),
        ("x1.fx = 1/3;", ["lower", "upper"]),
        ("x1.lo = 0; x1.up = 0.1;", []),
        ("x1.lo = 1/4; x1.up = 1e0;", []),
    ],
)
def test_bounds_that_are_no_doubles_are_recorded(read, bounds: str, places: list[str]) -> None:
    """With x1 <= 1/3 rounded down the row leaves no point; as written it holds at 1/3."""
    text = (
        "Variables x1,x2,objvar; Equations e1,e2; e1.. objvar - x1 =E= 0;"
        "e2.. 1e16*x1 - x2 =E= 3333333333333333;" + bounds + "x2.lo = 0.25; x2.up = 5;"
        "Model m / all /; Solve m using NLP minimizing objvar;"
    )
    problem = read(text)
    assert [record.place for record in problem.rounding] == places
    if places == ["upper"]:
        found = sp.solve(problem)
        assert found.status is sp.Status.INFEASIBLE and "rounded bounds" in found.notes[0]


def test_bounds_of_the_objective_variable_are_exact(read) -> None:
    problem = read(
        "Variables x1,objvar; Equations e1; e1.. objvar - x1 =E= 0; objvar.up = 1/3; x1.lo = 0;"
        "x1.up = 1; Model m / all /; Solve m using NLP minimizing objvar;"
    )
    assert [record.place for record in problem.rounding] == ["constraint 0 (objvar_up)"]


def test_relaxed_classes_beside_binaries_are_refused(tmp_path: Path) -> None:
    """RMINLP takes b in [0, 1] with the minimum 0 of (b - 1/2)^2, which binary b do not reach."""
    text = "{kind} variables b; variables obj;\nEquations e; e.. obj =e= sqr(b - 0.5);\n"
    text += "Model m / all /;\nb.lo = 0; b.up = 1;\nSolve m using {how} minimizing obj;\n"
    path = tmp_path / "relaxed.gms"
    for how in ("RMINLP", "rmiqcp", "rmip"):
        path.write_text(text.format(kind="Binary", how=how))
        with pytest.raises(sp.FormatError, match="class .* and the binary variable 'b'"):
            sp.read(path)
        path.write_text(text.format(kind="Free", how=how))
        assert sp.solve(sp.read(path)).lower_bound == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("priority", ["inf", "+INF", " + inf"])
def test_priorities_that_relax_integers_are_refused(read, priority: str) -> None:
    """GAMS takes a discrete variable of infinite priority for a continuous one."""
    text = "Binary Variables b; Variables obj; Equations e; e.. obj =E= sqr(b - 0.5);\n"
    with pytest.raises(sp.FormatError, match="case.gms:2: .* that makes an integer variable"):
        read(f"{text}b.prior ={priority};\nSolve m using MINLP minimizing obj;")
    assert len(read(f"{text}b.prior = 2;\nSolve m using MINLP minimizing obj;").constraints) == 1


@pytest.mark.parametrize("option", ["option clear = x1", "Options limrow=0, KILL=x1"])
def test_options_that_take_bounds_back_are_refused(read, option: str) -> None:
    """GAMS gives x1 its default bounds again: the minimum is then not at 2."""
    text = "Variables x1,objvar; Equations e1;\ne1.. objvar =E= sqr(x1);\nx1.lo = 2;\n"
    with pytest.raises(FormatError, match=r"case.gms:4: .* expected only options that leave"):
        read(f"{text}{option};\nSolve m using NLP minimizing objvar;")
    assert read(f"{text}option limrow=0;\nSolve m using NLP minimizing objvar;").lower[0] == 2


def test_commas_in_quotes_part_no_names(tmp_path: Path) -> None:
    path = tmp_path / "case.gms"
    text = "Variables x 'tons, a day', objvar \"cost, all\"; Equations e 'one, two'; x.lo = 2;"
    path.write_text(f"{text} e.. objvar =E= x;")
    problem = read_gms(path)
    assert problem.names == ("x",)
    path.write_text("Variables x ' , objvar; Equations e; e.. objvar =E= x;")
    with pytest.raises(sp.FormatError, match='found "x \'", expected a name'):
        read_gms(path)
