"""The files that sparsePOP writes: SDPA data and map, reports, the solver's log."""

from __future__ import annotations

import pathlib
import warnings
from typing import Any

import numpy as np
import pytest

import sparsepop_py as sp

QUIET = {"printLevel": 0}


def problem() -> sp.Problem:
    x, y, z = sp.variables(3)
    return sp.Problem(x * y - z, [x + y == 1.5, z**2 <= x, x * z >= -2], [0, 0, -2], [1, 3, 2])


def roomy() -> sp.Problem:
    """A problem whose box stays wide when it is tightened, so that the program stays regular."""
    x, y, z = sp.variables(3)
    rows = [x + y + z == 1.5, z**2 <= x + 1, x * z >= -2]
    return sp.Problem(x * y - z, rows, [-1, -2, -2], [1, 3, 2])


def tiny() -> sp.Problem:
    (x,) = sp.variables(1)
    return sp.Problem(x**4 - x, (), -1, 1)


@pytest.mark.parametrize("tighten", [0, 1])
def test_the_sdpa_file_has_the_value_of_the_sdp(tmp_path: pathlib.Path, tighten: int) -> None:
    path = tmp_path / "relaxation.dat-s"
    param = {**QUIET, "relaxOrder": 2, "tighten": tighten, "sdpaDataFile": str(path)}
    output = sp.sparsePOP(roomy() if tighten else problem(), param)
    program = sp.read_sdpa(path)
    solution = sp.solve_conic(program)
    assert solution.status == "solved"
    assert program.cones.zero == output.SDPinfo.noOfFreevar
    assert program.cones.psd == output.SDPinfo.SDPblock
    if not tighten:  # then the objective's size is known
        value = output.SDPinfo.objValScale * solution.primal
        assert value == pytest.approx(output.POP.solverValue, abs=1e-5)
        rows = np.loadtxt(path.with_suffix(".info"))
        assert rows.shape == (3, 3)
        point = rows[:, 1] * solution.y[rows[:, 0].astype(int) - 1] + rows[:, 2]
        assert point == pytest.approx(output.POP.xVect, abs=1e-3)


def test_fixed_variables_have_no_moment_in_the_map(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.dat-s"
    x, y = sp.variables(2)
    fixed = sp.Problem(x * y, [x + y >= 1], [0, 2], [1, 2])
    sp.sparsePOP(fixed, {**QUIET, "tighten": 0, "SDPsolverSW": 0, "sdpaDataFile": str(path)})
    lines = path.with_suffix(".info").read_text().splitlines()
    assert lines[0].split()[0] == "1"
    assert lines[1].split() == ["-1", "0.0", "2.0"]


def test_an_sdpa_file_that_is_not_written_is_said(tmp_path: pathlib.Path) -> None:
    """The least x - y on [0, 1]^2 is -1, at a vertex: presolve closes the gap."""
    x, y = sp.variables(2)
    corner = sp.Problem(x - y, lower=0, upper=1)
    path = tmp_path / "a.dat-s"
    for tighten, written in ((1, False), (0, True)):
        param = {**QUIET, "tighten": tighten, "sdpaDataFile": str(path)}
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            assert sp.sparsePOP(corner, param).POP.upperBound == -1
        said = [str(warning.message) for warning in seen]
        assert path.exists() == written
        hint = "was not written, since no SDP was needed: tighten = 0 gives the plain relaxation"
        assert said == ([] if written else [f"param.sdpaDataFile: {path} {hint}"])


def test_a_program_without_variables_is_read_again(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.dat-s"
    param = {**QUIET, "tighten": 0, "sdpaDataFile": str(path)}
    value = sp.sparsePOP(sp.Problem(sp.variables(1)[0], [], 1, 1), param).SDPobjValue
    program = sp.read_sdpa(path)
    assert program.q.size == 0
    assert program.offset == pytest.approx(1) == value


def test_the_printed_file(tmp_path: pathlib.Path, capsys: Any) -> None:
    path = tmp_path / "out.txt"
    sp.sparsePOP(tiny(), {"printLevel": [0, 1], "printFileName": str(path)})
    first = path.read_text()
    assert "SDPobjValue" in first and "xVect:" not in first
    assert capsys.readouterr().out == ""
    sp.sparsePOP(tiny(), {"printLevel": [0, 2], "printFileName": str(path)})
    both = path.read_text()
    assert both.startswith(first) and "# POP.xVect:" in both
    sp.sparsePOP(tiny(), {"printLevel": [0, 2], "printFileName": 1})
    sp.sparsePOP(tiny(), {"printLevel": [0, 0], "printFileName": str(path)})
    assert path.read_text() == both


def test_the_detailed_file(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "detail.txt"
    param = {**QUIET, "tighten": 0, "boundSW": 1, "detailedInfFile": str(path)}
    output = sp.sparsePOP(problem(), param)
    text = path.read_text()
    for part in (
        "  boundSW             = 1",
        "# POP to be solved:",
        "  constraint 1: p == 0",
        "    +1.000000000000000e+00  1^1 2^1",
        "# Scaled POP:",
        "# Cliques: ",
        "# Blocks:",
        f"# SDP: conic program: {output.SDPinfo.rowSizeA} moments",
    ):
        assert part in text, part
    sp.sparsePOP(problem(), param)
    assert path.read_text() == 2 * text


def test_the_log_of_the_solver(tmp_path: pathlib.Path, capsys: Any) -> None:
    path = tmp_path / "log.txt"
    output = sp.sparsePOP(tiny(), {**QUIET, "SDPsolverOutFile": str(path)})
    text = path.read_text()
    assert output.SDPsolverInfo.solver in text
    assert f"{output.SDPsolverInfo.iter} iterations" in text
    sp.sparsePOP(tiny(), {**QUIET, "SeDuMiOutFile": str(path)})
    assert len(path.read_text().splitlines()) == 2
    assert capsys.readouterr().out == ""
    sp.sparsePOP(tiny(), {**QUIET, "SDPsolverOutFile": 1})
    assert "iterations" in capsys.readouterr().out


def test_the_report_names_switches_and_what_the_point_is(capsys: Any) -> None:
    sp.sparsePOP(tiny(), {"tighten": 0, "boundSW": 1, "printLevel": 1, "errorBdIdx": "a"})
    text = capsys.readouterr().out
    assert "  boundSW             = 1" in text
    assert "first moments of the SDP, not proved" in text
    assert "  POP.zeta(1)         = " in text
    sp.sparsePOP(tiny(), {"SDPsolverSW": 0})
    text = capsys.readouterr().out
    assert "# SDP, not solved:" in text
    assert "none: the SDP was not to be solved" in text


@pytest.mark.parametrize(
    ("field", "name"),
    [
        ("sdpaDataFile", "nowhere/a.dat-s"),
        ("detailedInfFile", "nowhere/a.txt"),
        ("printFileName", "nowhere/a.txt"),
        ("SDPsolverOutFile", "nowhere/a.txt"),
        ("detailedInfFile", ""),  # the directory itself
    ],
)
def test_files_that_cannot_be_written_are_named_before_the_work(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, field: str, name: str
) -> None:
    monkeypatch.setattr("sparsepop_py.compat.sparsepop.solve", None)  # not to be reached
    with pytest.raises(sp.ProblemError, match=rf"param\.{field}: found .*expected a file in a dir"):
        sp.sparsePOP(tiny(), {"printLevel": (0, 1), field: str(tmp_path / name)})


def test_a_report_that_is_not_asked_for_needs_no_directory(tmp_path: pathlib.Path) -> None:
    name = str(tmp_path / "nowhere" / "report.txt")
    assert sp.sparsePOP(tiny(), {**QUIET, "printFileName": name}).POP.status is sp.Status.OPTIMAL
