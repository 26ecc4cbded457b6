"""sparsePOP: the calls and outputs of the original, and the traps it falls into."""

from __future__ import annotations

import copy
import math
import pathlib
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from struct_cases import struct

import sparsepop_py as sp
from sparsepop_py.compat.sparsepop import sparsePOP
from sparsepop_py.errors import FormatError, ParameterWarning, ProblemError
from sparsepop_py.result import Status

QUIET = {"printLevel": 0}


def call(objective: Any, rows: Any, lower: Any, upper: Any, **param: Any) -> tuple[float, Any, Any]:
    output = sparsePOP(objective, rows, lower, upper, {**QUIET, **param})
    return output.SDPobjValue, output.POP, output


# min x1^2 + x2 on a line and a box, minimum 3/4 at (1/2, 1/2)
FREE = 1e10
LINE = (
    struct([[2, 0], [0, 1]], [1, 1]),
    [struct([[1, 0], [0, 1], [0, 0]], [1, 1, -1], -1)],
    [0, 0],
    [1, 1],
)
GMS = """Variables x1,x2,objvar; Equations e1,e2;
e1.. objvar - x1^2 - x2 =E= 0; e2.. x1 + x2 =E= 1;
x1.lo = 0; x1.up = 1; x2.lo = 0; x2.up = 1;
"""
LARGEST = """Variables x1,x2,objvar; Equations e1,e2;
e1.. objvar - x1*x2 =E= 3; e2.. x1 + x2 =L= 1;
x1.lo = 0; x1.up = 1; x2.lo = 0; x2.up = 1;
* Solve m using NLP maximizing objvar;
"""


@pytest.fixture
def gms(tmp_path: pathlib.Path) -> str:
    path = tmp_path / "line.gms"
    path.write_text(GMS)
    return str(path)


# ---- calls ------------------------------------------------------------------------------


def test_six_outputs_in_the_order_of_the_original() -> None:
    output = sparsePOP(*LINE, QUIET)
    param, value, POP, times, solver, sizes = output
    assert output._fields == (
        *("param", "SDPobjValue", "POP", "cpuTime", "SDPsolverInfo", "SDPinfo"),
    )
    assert value == POP.lowerBound <= 0.75 <= POP.upperBound < value + 1e-6
    assert POP.status is Status.OPTIMAL
    assert POP.certificate.verify(POP.result.problem).ok
    assert np.abs(POP.xVect - 0.5).max() < 1e-3
    assert POP.objValue == pytest.approx(0.75, abs=1e-6)
    assert param.relaxOrder == 1
    assert (solver.numerr, solver.pinf, solver.dinf, solver.feasratio) == (0, 0, 0, 1)
    assert times.total == times.conversion + times.SDPsolver + times.certification
    assert sizes.infeasibleSW == 0
    assert (sizes.dimVar0, sizes.dimVar, sizes.fixedVar.shape) == (2, 2, (0, 2))


def test_every_calling_form(gms: str) -> None:
    problem = sp.from_structs(*LINE)
    values = [
        sparsePOP(*LINE, param=SimpleNamespace(printLevel=0))[1],
        sparsePOP(gms, QUIET)[1],
        sparsePOP(pathlib.Path(gms), QUIET)[1],
        sparsePOP(problem, QUIET)[1],
        sparsePOP(LINE[0], LINE[1], np.zeros((2, 1)), np.ones((1, 2)), QUIET)[1],
    ]
    assert np.ptp(values) < 1e-6


@pytest.mark.parametrize("empty", [None, [], (), np.zeros((0, 0))])
def test_no_constraints(empty: Any) -> None:
    value, _, _ = call(struct([[2], [1]], [1, -2]), empty, [-5], [5])
    assert value == pytest.approx(-1, abs=1e-6)


def test_least_squares() -> None:
    residuals = [struct([[1, 0], [0, 0]], [1, -1]), struct([[0, 1], [2, 0]], [1, -1])]
    value, POP, _ = call(residuals, [], [-1e10] * 2, [1e10] * 2)
    assert -1e-6 < value <= 0
    assert np.abs(POP.xVect - 1).max() < 1e-3


def test_the_returned_param_serves_again(gms: str) -> None:
    first = sparsePOP(gms, {**QUIET, "relaxOrder": 0})
    assert first.param.relaxOrder == 1
    assert sparsePOP(gms, first.param).param == first.param


def test_a_raised_order_is_returned() -> None:
    _, _, output = call(struct([[4], [1]], [1, 1]), [], [-2], [2], relaxOrder=0)
    assert output.param.relaxOrder == 2


WRONG: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
    (LINE[:3], {}, r"sparsePOP: found no ubd, expected sparsePOP\(objPoly, ineqPolySys, lbd"),
    (LINE[:2], {}, r"sparsePOP: found no lbd and no ubd, expected sparsePOP\("),
    (LINE[:1], {}, r"or sparsePOP\('file.gms', param\)"),
    (("line.gms", [], [0, 0], [1, 1]), {}, r"found more than a problem and its parameters"),
    (("line.gms", QUIET), {"param": QUIET}, r"found more than a problem and its parameters"),
    (("line(3)",), {}, r"objPoly: found the string 'line\(3\)', expected the name of a .gms file"),
    (("line.txt",), {}, r"objPoly: found the string 'line.txt'"),
    ((7, *LINE[1:]), {}, r"objPoly: found int, expected a struct"),
    ((LINE[0], LINE[1], [0], [1, 1]), {}, r"lbd: found 1 values, expected 2"),
    ((LINE[0], LINE[1], [2, 2], [1, 1]), {}, r"lbd, ubd: found \[2, 1\] for variable 1"),
    ((*LINE, 5), {}, r"param: found int, expected a dict or a struct"),
    ((*LINE, {"relaxOrder": -2}), {}, r"param.relaxOrder: found -2, expected a number >= 0"),
    ((*LINE, {"relaxOrdr": 2}), {"strict": True}, r"relaxOrdr: unknown field, did you mean rela"),
    ((LINE[0] | {"degree": 5}, *LINE[1:]), {}, r"objPoly.degree: found 5, expected 2"),
]


@pytest.mark.parametrize(("inputs", "named", "message"), WRONG)
def test_wrong_calls(inputs: Any, named: Any, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        sparsePOP(*inputs, **named)


def test_a_missing_file() -> None:
    with pytest.raises(FormatError, match=r"nowhere.gms: no such file"):
        sparsePOP("nowhere.gms")


def test_warnings_show_the_line_of_the_caller() -> None:
    with pytest.warns(ParameterWarning, match="did you mean relaxOrder") as seen:
        sparsePOP(*LINE, {**QUIET, "relaxOrdr": 2})
    assert seen[0].filename == __file__


def test_inputs_are_not_modified() -> None:
    inputs = (*copy.deepcopy(LINE), {"printLevel": np.array([[0, 0]]), "POPsolver": "active-set"})
    before = copy.deepcopy(inputs)
    sparsePOP(*inputs)
    np.testing.assert_equal(inputs, before)


# ---- outputs ----------------------------------------------------------------------------


def test_refined_point_only_when_asked_for() -> None:
    _, POP, _ = call(*LINE)
    assert POP.xVectL.shape == (0,)
    assert (POP.objValueL, POP.absErrorL, POP.scaledErrorL) == (None, None, None)
    _, POP, _ = call(*LINE, POPsolver="active-set")
    assert np.abs(POP.xVectL - 0.5).max() < 1e-3
    assert POP.objValueL == pytest.approx(0.75, abs=1e-6)
    assert -1e-12 <= POP.absErrorL <= 0


def test_errors_are_not_swapped() -> None:
    """At (3, 2) the row 10 - x1^3 x2 lacks 44, and x1 its bound by 1: absolute -44."""
    from sparsepop_py.compat.sparsepop import _errors

    x, y = sp.variables(2)
    problem = sp.Problem(x, [10 - x**3 * y >= 0, x - 3 * y == -2], lower=0, upper=2)
    absolute, scaled = _errors(problem, np.array([3.0, 2.0]))
    assert absolute == -44
    assert scaled == -44 / 54  # its largest term is 54; the bound counts -1/3
    assert _errors(problem, np.array([1.0, 1.0])) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("sparse", "rows", "columns", "blocks", "nonzeros"),
    [(0, 5, 1 + 9, (3,), 1 + 8), (1, 4, 1 + 2 * 4, (2, 2), 1 + 2 * 3)],
)
def test_sizes_in_sedumi_form(
    sparse: int, rows: int, columns: int, blocks: tuple[int, ...], nonzeros: int
) -> None:
    """Order 1, x1 >= 1 and no bounds: moment matrices, of which the constant is no row of A."""
    constraints = [struct([[1, 0], [0, 0]], [1, -1])]
    param = {"tighten": 0, "relaxOrder": 1, "sparseSW": sparse}
    objective = struct([[2, 0], [0, 2]], [1, 1])
    _, POP, output = call(objective, constraints, [-1e10] * 2, [1e10] * 2, **param)
    sizes = output.SDPinfo
    assert (sizes.rowSizeA, sizes.colSizeA) == (rows, columns)
    assert (sizes.noOfFreevar, sizes.noOfLPvariables, sizes.SDPblock) == (0, 1, blocks)
    assert sizes.nonzerosInA == nonzeros
    assert sizes.SOCPblock == ()
    assert output.SDPsolverInfo.solver == "clarabel"
    assert output.SDPsolverInfo.iter > 0
    assert POP.solverValue == pytest.approx(1, abs=1e-4)


def test_maximise(tmp_path: pathlib.Path) -> None:
    """Max 3 + x1 x2 with x1 + x2 <= 1 is 3.25; all values are in the sense of the file."""
    path = tmp_path / "largest.gms"
    path.write_text(LARGEST)
    output = sparsePOP(str(path), {**QUIET, "POPsolver": "active-set"})
    POP = output.POP
    assert output.SDPobjValue == POP.upperBound
    assert POP.lowerBound <= 3.25 <= POP.upperBound < 3.25 + 1e-5
    assert POP.objValue == pytest.approx(3.25, abs=1e-5)
    assert POP.objValueL == pytest.approx(3.25, abs=1e-5)
    assert POP.solverValue is None or POP.solverValue == pytest.approx(3.25, abs=1e-5)
    assert output.SDPinfo.objConstant == 3


# ---- the report -------------------------------------------------------------------------


def test_report(gms: str, capsys: pytest.CaptureFixture[str]) -> None:
    sparsePOP(gms, {"POPsolver": "active-set"})
    text = capsys.readouterr().out
    for part in (
        f"# Problem File Name   = {gms}",
        "# parameters:",
        "  relaxOrder          = 1",
        "# Approximate optimal value information:",
        "  SDPobjValue         = +7.49999",
        "proved lower bound",
        "  POP.absError        = ",
        "  POP.scaledErrorL    = ",
        "# elapsed time (CPU seconds):",
        "# POP.xVect:\n       1: +5.0",
        "# POP.xVectL:",
    ):
        assert part in text


def test_report_levels(capsys: pytest.CaptureFixture[str]) -> None:
    sparsePOP(*LINE, {"printLevel": 1})
    text = capsys.readouterr().out
    assert "SDPobjValue" in text and "xVect:" not in text
    sparsePOP(*LINE, {"printLevel": [0, 2]})
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


def test_vectors_have_five_numbers_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    sparsePOP(struct(2 * np.eye(7), np.ones(7)), [], [1] * 7, [2] * 7)
    lines = capsys.readouterr().out.split("# POP.xVect:\n")[1].split("\n")
    one = [f"       {k}: +1.0000000e+00" for k in range(1, 8)]
    assert lines[:2] == ["".join(one[:5]), "".join(one[5:])]


def test_programs_that_read_the_report_find_what_they_look_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # as NLCertify (its file sparsepop.ml) looks for them, after asking for SDPA
    param = {"printLevel": [2, 0], "SDPsolver": "sdpa", "POPsolver": "interior-point"}
    with pytest.warns(ParameterWarning, match="sdpa"):
        sparsePOP(*LINE, param)
    text = capsys.readouterr().out
    number = r"[-+][0-9.]+e[-+][0-9][0-9]"
    names = (
        "SDPobjValue",
        r"POP\.objValueL",
        r"POP\.scaledError",
        "obj error",
        r"xVect:\s+1[ \t]*:",
    )
    missing = [name for name in names if not re.search(f"{name}[ \t]*=?[ \t]*{number}", text)]
    assert missing == [] and "phase value = pdOPT" in text


def test_report_of_an_infeasible_problem(capsys: pytest.CaptureFixture[str]) -> None:
    sparsePOP(struct([[1]], [1]), [struct([[1], [0]], [1, -9])], [0], [5], {})
    text = capsys.readouterr().out
    assert "SDPobjValue         = +inf" in text
    assert "no point is feasible" in text


@pytest.mark.parametrize(
    ("objective", "rows", "words"),
    [
        (
            struct([[1, 0]], [1]),
            [struct([[2, 0], [1, 1], [0, 2], [0, 0]], [-1, 2, -1, -1])],
            "the relaxation has no point",
        ),
        (struct([[3, 0]], [1]), [], "no sum of squares of this order"),
    ],
)
@pytest.mark.slow
def test_the_report_says_what_the_solver_reports(
    objective: Any, rows: Any, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """-(x - y)^2 >= 1 has no point; x^3 is not bounded below, so no sum of squares."""
    output = sparsePOP(objective, rows, [-FREE] * 2, [FREE] * 2, {"tighten": 0})
    assert words in capsys.readouterr().out
    assert output.SDPinfo.infeasibleSW == 0.5
    assert output.SDPsolverInfo.feasratio == -1
    assert output.POP.xVect.shape == (2,)


# ---- the traps of the original ----------------------------------------------------------


@pytest.mark.parametrize(
    ("objective", "rows", "bound", "minimum"),
    [
        (struct([[3]], [1]), [struct([[2], [0]], [1, -4], -1)], 5.0, -8.0),
        (struct([[3]], [1]), [struct([[2], [0]], [1, -4], -1)], FREE, -8.0),
        (
            struct([[2, 1]], [1]),
            [struct([[2, 0], [0, 0]], [1, -4], -1), struct([[0, 2], [0, 0]], [1, -1], -1)],
            FREE,
            -4.0,
        ),
    ],
    ids=["x^3 boxed", "x^3", "x^2*y"],
)
def test_squares_that_are_not_one(objective: Any, rows: Any, bound: float, minimum: float) -> None:
    n = objective["dimVar"]
    value, POP, _ = call(objective, rows, [-bound] * n, [bound] * n, relaxOrder=2)
    assert minimum - 1e-5 < value <= minimum
    assert POP.objValue == pytest.approx(minimum, abs=1e-5)


@pytest.mark.parametrize("tighten", [0, 1])
def test_squares_that_are_not_binary(tighten: int) -> None:
    rows = [struct([[2], [1]], [1, -3], -1)]
    value, POP, _ = call(struct([[2]], [-1]), rows, [0], [10], tighten=tighten)
    assert -9 - 1e-5 < value <= -9
    assert POP.xVect == pytest.approx([3])


@pytest.mark.parametrize(
    "rows",
    [
        [struct([[1], [0]], [-1, 5])],
        pytest.param([], marks=pytest.mark.slow),  # the local search runs far along the ray
    ],
)
def test_unbounded(rows: Any) -> None:
    value, POP, _ = call(struct([[1]], [1]), rows, [-FREE], [FREE])
    assert (value, POP.lowerBound, POP.status) == (-math.inf, -math.inf, Status.UNBOUNDED)
    assert POP.certificate is None


def test_all_fixed_and_infeasible() -> None:
    rows = [struct([[1, 0], [0, 1], [0, 0]], [1, 1, -7], -1)]
    value, POP, output = call(struct([[1, 0], [0, 1]], [1, 1]), rows, [1, 2], [1, 2])
    assert (value, POP.status, POP.xVect.tolist()) == (math.inf, Status.INFEASIBLE, [1, 2])
    assert (POP.objValue, POP.absError, POP.violation) == (3, -4, 4)
    assert (output.SDPinfo.infeasibleSW, output.SDPinfo.dimVar) == (2, 0)
    assert output.SDPinfo.fixedVar.tolist() == [[1, 1], [2, 2]]


def test_all_fixed_and_feasible() -> None:
    rows = [struct([[1, 0], [0, 1], [0, 0]], [1, 1, -3], -1)]
    value, POP, output = call(struct([[1, 0], [0, 1]], [1, 1]), rows, [1, 2], [1, 2])
    assert 3 - 1e-9 < value <= 3
    assert POP.xVect.tolist() == [1, 2]
    assert output.SDPinfo.infeasibleSW == -2


def test_infeasible_maximum_is_minus_infinity(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "empty.gms"
    path.write_text(LARGEST.replace("=L= 1", "=G= 3"))
    output = sparsePOP(str(path), QUIET)
    assert (output.SDPobjValue, output.POP.status) == (-math.inf, Status.INFEASIBLE)
    assert output.POP.lowerBound == output.POP.upperBound == -math.inf


@pytest.mark.parametrize("order", [3, 4])
def test_motzkin_without_bounds(order: int) -> None:
    """Minimum 0, no sum of squares at any order."""
    motzkin = struct([[4, 2], [2, 4], [2, 2], [0, 0]], [1, 1, -3, 1])
    value, POP, _ = call(motzkin, [], [-FREE] * 2, [FREE] * 2, relaxOrder=order)
    assert value <= 0
    assert POP.status in (Status.OPTIMAL, Status.BOUNDED, Status.UNPROVED, Status.FAILED)
    assert POP.upperBound >= 0


def test_bounds_of_1e10_are_none_and_1e8_are_bounds() -> None:
    linear, square = struct([[1]], [1]), struct([[2], [1]], [1, -2])
    value, _, _ = call(linear, [], [-1e8], [0])
    assert -1e8 * (1 + 1e-6) <= value <= -1e8
    for none in (1e10, 1e20, np.inf):
        value, POP, _ = call(square, [], [-none], [none])
        assert value == pytest.approx(-1, abs=1e-5)
        assert np.all(np.isinf(POP.result.problem.lower))


def test_small_coefficients_are_kept() -> None:
    value, _, _ = call(struct([[1]], [1e-10]), [], [-1], [1])
    assert value == pytest.approx(-1e-10, rel=1e-3)
    assert value <= -1e-10


def test_no_output_is_a_matrix() -> None:
    """The original returns errors as 1 x 1 sparse matrices."""
    _, POP, _ = call(*LINE)
    assert all(type(v) is float for v in (POP.objValue, POP.absError, POP.scaledError))
