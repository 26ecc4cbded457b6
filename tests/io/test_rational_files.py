"""Problems with ratios as text, .gms and JSON."""

import functools
import json
import subprocess
import sys

import pytest

import sparsepop_py as sp


def test_text_with_ratios():
    problem = sp.parse("max x/(1 + x^2) - 2*(y - 1)/(3 + y^2); s.t. x/(4 - y) <= 2; 0 <= y <= 3")
    assert isinstance(problem, sp.RationalProblem) and problem.sense == "max"
    # 1/2 - 2 * (-1)/3 by hand at x = 1, y = 0; stored negated
    assert problem.objective([1.0, 0.0]) == pytest.approx(-(0.5 + 2 / 3), rel=1e-15)
    assert [type(row).__name__ for row in problem.constraints] == [
        "RationalConstraint",
        "Constraint",
        "Constraint",
    ]
    assert str(problem.constraints[0]) == "(8 - x - 2*y)/(4 - y) >= 0"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("x/y", 2 / 3),
        ("-x/y + 1", 1 / 3),
        ("x/y/y", 2 / 9),
        ("2*x*y/(x + y)^2", 12 / 25),
        ("(x/y + 1)^2", (2 / 3 + 1) ** 2),
        ("sqr(x/y)", 4 / 9),
        ("3 - (x - 1)/-(y + 1)", 3 + 1 / 4),
        ("(1/x + 1/y)*x*y", 5.0),
        ("-(x/(y + 1))*-2", 1.0),
        ("x/(2*y - y)", 2 / 3),
    ],
)
def test_expressions_are_evaluated_as_written(text, value):
    problem = sp.parse(f"min {text}; s.t. x >= 1; y >= 1")
    assert problem.objective([2.0, 3.0]) == pytest.approx(value, rel=1e-14)


def test_gams_files_with_ratios(tmp_path):
    path = tmp_path / "ratio.gms"
    path.write_text(
        "Variables x, y, objvar; Positive Variables y; Equations e1, e2;\n"
        "e1.. 2*objvar - x/(1 + sqr(x)) =E= y/(3 + y);\n"
        "e2.. x*y/(5 - x) =G= -1;\n"
        "x.lo = -2; x.up = 2; y.up = 4;\n"
        "Model m / all /; Solve m using NLP minimizing objvar;\n"
    )
    problem = sp.read(path)
    assert isinstance(problem, sp.RationalProblem)
    assert problem.objective([1.0, 1.0]) == (0.5 + 0.25) / 2
    assert str(problem.constraints[0]) == "e2: (5 - x + x*y)/(5 - x) >= 0"
    again = tmp_path / "again.gms"
    sp.write(problem, again)
    assert sp.read(again).fingerprint == problem.fingerprint


def test_other_formats_refuse_ratios(tmp_path):
    problem = sp.parse("min x/(1 + x^2)")
    with pytest.raises(sp.ProblemError, match="found RationalProblem"):
        sp.write(problem, tmp_path / "ratio.mat")
    sp.write(problem, tmp_path / "ratio.gms")
    with pytest.raises(sp.ProblemError, match="found a problem with ratios"):
        sp.sparsePOP(str(tmp_path / "ratio.gms"))


def test_problem_certificate_and_result_survive_json():
    problem = sp.parse("min x/(2 + x^2) + y/(3 + x*y); s.t. x/(y + 3) >= -1; x^2 + y^2 <= 1")
    result = sp.solve(problem)
    again = sp.from_json(sp.to_json(problem))
    assert again.fingerprint == problem.fingerprint and again.names == problem.names
    assert sp.from_json(sp.to_json(result.certificate)).verify(again).ok
    read = sp.from_json(sp.to_json(result))
    assert (read.lower_bound, read.upper_bound) == (result.lower_bound, result.upper_bound)
    assert read.status is result.status and read.certificate.verify(read.problem).ok


@functools.cache
def stored():
    """A result in JSON, solved once."""
    return sp.to_json(sp.solve(sp.parse("min x/(2 + x^2); s.t. x^2 <= 1")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda r: r.update(lower_bound=r["lower_bound"] + 1e-3),
            "lower_bound: found|result.certificate: ",
        ),
        (lambda r: r.update(upper_bound=r["upper_bound"] - 1e-3), "upper_bound: found"),
        (lambda r: r.update(status="INFEASIBLE"), "status: found INFEASIBLE"),
        (lambda r: r.update(status="UNBOUNDED"), "status: found UNBOUNDED"),
        (lambda r: r["certificate"].update(ranges=[]), "lower_bound: found|result.certificate: "),
        (lambda r: r["certificate"]["ranges"][0].update(sign=2), "sign: found 2"),
        (
            lambda r: r["certificate"]["ranges"][0].update(sign=-1),
            "lower_bound: found|result.certificate: ",
        ),
        (lambda r: r["certificate"].update(level=9.0), "lower_bound: found|result.certificate: "),
        (
            lambda r: r["certificate"].update(certificate=None),
            "lower_bound: found|result.certificate: ",
        ),
        (
            lambda r: r["certificate"].update(fingerprint="r1:0"),
            "lower_bound: found|result.certificate: ",
        ),
        (
            lambda r: r["problem"]["objective"]["ratios"][0][1]["coefficients"]["data"].__setitem__(
                0, 3.0
            ),
            "lower_bound: found|result.certificate: ",
        ),
    ],
)
def test_damaged_results_are_refused(change, message):
    found = json.loads(stored())
    change(found["rational_result"])
    with pytest.raises(sp.ProblemError, match=message):
        sp.from_json(json.dumps(found))


def test_older_versions_know_no_ratios():
    text = sp.to_json(sp.parse("min x/(2 + x^2)"))
    assert json.loads(text)["version"] == 7
    with pytest.raises(sp.ProblemError, match="JSON.is"):
        sp.from_json(text.replace('"version":7', '"version":3'))


def test_command_line(tmp_path):
    path = tmp_path / "ratio.txt"
    path.write_text("max x/(1 + x^2); s.t. x^2 <= 4")
    done = subprocess.run(
        [sys.executable, "-m", "sparsepop_py.cli", "solve", str(path), "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    record = json.loads(done.stdout)
    assert record["certificate_verified"] and record["status"] == "OPTIMAL"
    assert record["lower_bound"] <= 0.5 <= record["upper_bound"]  # of the maximum


def test_sympy_expressions():
    sympy = pytest.importorskip("sympy")
    x, y = sympy.symbols("x y")
    rows = [x / (3 + y) >= sympy.Rational(1, 4), x + y <= 2, sympy.Eq(y / (1 + x**2), 0)]
    problem = sp.RationalProblem(x / (1 + x**2) + 2 * y + 1 / (y + 3), rows, lower=-1, upper=2)
    assert problem.names == ("x", "y")
    assert problem.objective([1.0, 2.0]) == pytest.approx(0.5 + 4 + 0.2, rel=1e-15)
    kinds = [type(row).__name__ for row in problem.constraints]
    assert kinds == ["RationalConstraint", "Constraint", "RationalConstraint"]
    assert problem.constraints[0].expression([1.0, 0.0]) == pytest.approx(1 / 3 - 1 / 4, rel=1e-14)
    with pytest.raises(sp.ProblemError, match="objective: found"):
        sp.RationalProblem(sympy.exp(x) / y)
    with pytest.raises(sp.ProblemError, match="objective: found"):
        sp.Problem(x / y)


RATIOS = " + ".join(f"1/(x + {k})" for k in range(100))  # and the polynomial 0: 101 parts


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sqr(1/x 2", r"'\(' that is not closed"),
        ("power(1/x, 2 3", r"'\(' that is not closed"),
        ("(1/x + 1) 2)", "found '2'|a matching '\\('"),
        ("sqr(1/x)(1 + 1/x)", r"found '\(', expected one of"),
        ("1e308/x*10", "overflows, expected finite coefficients"),
        (f"({RATIOS})*({RATIOS})", "10201 pairs of ratios .* at most 10000 pairs"),
        (f"({RATIOS})^2", "10201 pairs of ratios .* at most 10000 pairs"),
        (f"sqr(sqr({RATIOS}))", "10201 pairs of ratios .* at most 10000 pairs"),
        ("(1/x + " * 101 + "1" + ")" * 101, "at most 100 nested parentheses"),
    ],
)
def test_wrong_or_endless_expressions_with_ratios_are_refused(text, message):
    with pytest.raises(sp.FormatError, match=f"^line 1: statement '.*{message}"):
        sp.parse(f"min x; s.t. {text} >= 0; x >= 1")


def test_sums_with_ratios_are_divided_by_constant_polynomials():
    objective = sp.parse("min (x + 3/y)/(1 + 1); s.t. y >= 1").objective
    assert objective([4.0, 1.0]) == 3.5  # (4 + 3) / 2
    x, y = sp.variables(2)
    assert str((x + 3 / y) / (x - x + 2)) == "0.5*x1 + (1.5)/(x2)"
