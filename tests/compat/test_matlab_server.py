"""The door for MATLAB and Octave, from its Python side."""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sps

import sparsepop_py as sp
from sparsepop_py.compat import matlab_server as door

ROOT = Path(__file__).resolve().parents[2]
END = "\x04\n"

# min x1^2 + x2 on the line x1 + x2 = 1 in the unit square: 3/4 at (1/2, 1/2)
OBJECTIVE = {
    "typeCone": 1.0,
    "sizeCone": 1.0,
    "dimVar": 2.0,
    "degree": 2.0,
    "noTerms": 2.0,
    "supports": sps.csc_matrix([[2.0, 0.0], [0.0, 1.0]]),
    "coef": np.array([[1.0], [1.0]]),
}
LINE = {
    "typeCone": -1.0,
    "sizeCone": 1.0,
    "dimVar": 2.0,
    "degree": 1.0,
    "noTerms": 3.0,
    "supports": np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
    "coef": np.array([[1.0], [1.0], [-1.0]]),
}
QUIET = {"printLevel": np.array([[0.0, 0.0]])}
BOX = (np.zeros((1, 2)), sps.csc_matrix(np.ones((2, 1))))


def cell(*items: Any) -> Any:
    made = np.empty((1, len(items)), dtype=object)
    for place, item in enumerate(items):
        made[0, place] = item
    return made


def write(path: Path, *arguments: Any) -> Path:
    scipy.io.savemat(path, {"arguments": cell(*arguments), "folder": str(path.parent)})
    return path


def asked(path: Path, *arguments: Any) -> dict[str, Any]:
    door.answer(write(path, *arguments))
    return read(path)


def read(path: Path) -> dict[str, Any]:
    return scipy.io.loadmat(path, mat_dtype=True)


def field(outputs: Any, output: int, name: str) -> Any:
    return outputs[0, output][name][0, 0]


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "question.mat"


# ---- one question -----------------------------------------------------------------------


def test_an_answer_has_structs_in_matlabs_shapes(file: Path) -> None:
    answer = asked(file, OBJECTIVE, cell(LINE), *BOX, {**QUIET, "SDPsolverEpsilon": 1e-9})
    outputs = answer["outputs"]
    assert outputs.shape == (1, 6)
    assert answer["error"].size == 0 and answer["warnings"].size == 0
    assert outputs[0, 1].shape == (1, 1)
    assert 0.75 - 1e-6 < outputs[0, 1].item() <= 0.75
    assert field(outputs, 2, "xVect").shape == (2, 1)
    assert field(outputs, 2, "xVectL").shape == (0, 0)
    assert field(outputs, 2, "status").item() == "OPTIMAL"
    assert field(outputs, 0, "printLevel").tolist() == [[0.0, 0.0]]
    assert field(outputs, 5, "SDPblock").shape[0] == 1
    assert field(outputs, 5, "fixedVar").shape == (0, 0)
    assert field(outputs, 5, "dimVar0").dtype == float


def test_no_field_is_lost(file: Path) -> None:
    """Everything that Python returns arrives, but for its own object of the result."""
    expected = sp.sparsePOP(OBJECTIVE, [LINE], [0, 0], [1, 1], QUIET)
    outputs = asked(file, OBJECTIVE, cell(LINE), *BOX, QUIET)["outputs"]
    for place in (2, 3, 4, 5):
        names = set(vars(expected[place])) - {"result"}
        assert names <= set(outputs[0, place].dtype.names)


def test_cells_of_unequal_parts_come_back(file: Path) -> None:
    """An index set, all variables and one variable: three balls, and param as it was."""
    asking = {**QUIET, "errorBdIdx": cell([1.0, 2.0], "a", 1.0)}
    outputs = asked(file, OBJECTIVE, cell(LINE), *BOX, asking)["outputs"]
    assert field(outputs, 2, "zeta").shape == (1, 3)
    centres = field(outputs, 2, "xCenter")
    assert [centre.shape for centre in centres.ravel()] == [(2, 1)] * 3
    given = field(outputs, 0, "errorBdIdx")
    assert [part.tolist() for part in given.ravel()] == [[[1, 2]], ["a"], [[1]]]


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        (({**OBJECTIVE, "coef": [1j, 1]}, cell(LINE), *BOX, QUIET), "objPoly.coef"),
        ((OBJECTIVE, cell(LINE, {**LINE, "coef": [1, 1, 1j]}), *BOX), "ineqPolySys{2}.coef"),
        ((OBJECTIVE, [], np.array([0, 1j]), [1, 1], QUIET), "lbd"),
        (("line.gms", {**QUIET, "eqTolerance": 1j}), "param.eqTolerance"),
    ],
)
def test_complex_numbers_are_refused(file: Path, arguments: Any, place: str) -> None:
    """A reading as doubles drops the imaginary parts: another problem would be solved."""
    answer = asked(file, *arguments)
    assert answer["error"].item() == f"{place}: found complex numbers, expected real ones"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"folder": None}, "question: found no variable 'folder'"),
        ({"arguments": None}, "question: found no variable 'arguments'"),
        ({"folder": 3.0}, "folder: found ndarray, expected the path of a folder"),
        ({"arguments": cell()}, "arguments: found 0, expected those of sparsePOP"),
        ({"arguments": cell(*[1.0] * 6)}, "arguments: found 6, expected those of sparsePOP"),
        ({"task": "sparsePOPintervals", "arguments": cell()}, "arguments: found 0"),
        ({"task": 3.0}, "task: found array"),
        ({"task": "setid:nothing"}, "task: found 'setid:nothing', expected one of sparsePOP"),
        ({"task": "setid.nothing:f"}, "task: found 'setid.nothing:f'"),
        ({"task": "setid:Stable", "arguments": cell()}, "task: found a function that returns"),
    ],
)
def test_malformed_questions_are_answered(file: Path, changed: dict[str, Any], message: str):
    asked = {"arguments": cell(OBJECTIVE, [], [0, 0], [1, 1]), "folder": str(file.parent)}
    question = {name: value for name, value in (asked | changed).items() if value is not None}
    scipy.io.savemat(file, question)
    door.answer(file)
    assert read(file)["error"][0].startswith(message)


def test_files_are_relative_to_the_folder_named(file: Path, tmp_path: Path) -> None:
    problem = sp.from_structs(OBJECTIVE, [LINE], [0, 0], [1, 1])
    sp.write_gms(problem, tmp_path / "line.gms")
    assert asked(file, "line.gms", QUIET)["outputs"][0, 1].item() == pytest.approx(0.75, abs=1e-6)


def test_errors_count_from_one_and_warnings_are_passed_on(file: Path) -> None:
    wrong = {**LINE, "degree": 3.0}
    answer = asked(file, OBJECTIVE, cell(LINE, wrong), *BOX, {**QUIET, "sparsesw": 1.0})
    assert answer["error"].item().startswith("ineqPolySys{2}.degree: found 3")
    assert answer["outputs"].size == 0
    answer = asked(file, OBJECTIVE, cell(LINE), *BOX, {**QUIET, "sparsesw": 1.0})
    assert "sparseSW" in answer["warnings"].item().item()
    answer = asked(file, "nowhere.gms", QUIET)
    assert "nowhere.gms" in answer["error"].item()


# ---- the process ------------------------------------------------------------------------


@pytest.fixture
def child() -> Iterator[subprocess.Popen[str]]:
    words = [sys.executable, "-m", "sparsepop_py.compat.matlab_server"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(words, cwd=ROOT, text=True, **pipes) as process:
        yield process
        process.kill()


def say(child: subprocess.Popen[str], path: Path) -> None:
    assert child.stdin is not None
    child.stdin.write(f"{path}\n")
    child.stdin.flush()


def test_one_process_answers_until_its_input_closes(
    child: subprocess.Popen[str], file: Path
) -> None:
    assert child.stdin is not None and child.stdout is not None
    printed = []
    for level in (2, 0):
        say(child, write(file, OBJECTIVE, cell(LINE), *BOX, {"printLevel": float(level)}))
        lines: list[str] = []
        for line in child.stdout:
            if line == END:
                break
            lines.append(line)
        printed.append("".join(lines))
        assert read(file)["outputs"][0, 1].item() == pytest.approx(0.75, abs=1e-6)
    assert "SDPobjValue" in printed[0] and printed[1] == ""
    child.stdin.close()
    assert child.wait(timeout=60) == 0


def test_the_process_ends_with_its_parent_in_the_middle_of_a_solve(
    child: subprocess.Popen[str], file: Path
) -> None:
    """All products of four of 16 variables on a ball, dense: minutes of work."""
    x = sp.variables(16)
    products = [a * b * c * d for a, b, c, d in itertools.combinations(x, 4)]
    ball = 1 - sp.total([v * v for v in x])
    problem = sp.Problem(sp.total(products), [ball >= 0], lower=-1, upper=1)
    objective, rows, lower, upper = sp.to_structs(problem)
    param = {**QUIET, "relaxOrder": 2.0, "sparseSW": 0.0, "SDPsolver": "clarabel", "tighten": 0.0}
    say(child, write(file, objective, cell(*rows), lower, upper, param))
    assert child.stdin is not None
    child.stdin.close()
    assert child.wait(timeout=60) == 0
    assert "arguments" in read(file)  # no answer was written


# ---- where it is ------------------------------------------------------------------------


def test_the_folder_has_the_function(capsys: pytest.CaptureFixture[str]) -> None:
    assert door.main(["folder"]) == 0
    folder = Path(capsys.readouterr().out.strip())
    assert folder == door.folder()
    assert {"sparsePOP.m", "private"} <= {path.name for path in folder.iterdir()}
    assert door.main(["nonsense"]) == 2
    assert "usage" in capsys.readouterr().err
