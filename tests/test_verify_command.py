"""``sparsepop verify``: what it confirms, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import sparsepop_py as sp
from sparsepop_py.cli import main


@pytest.fixture(scope="module")
def result() -> sp.Result:
    """The least value of x y on the unit disc is -1/2."""
    x, y = sp.variables(2)
    return sp.solve(sp.Problem(x * y, [x**2 + y**2 <= 1]))


def test_results_and_certificates_are_confirmed(
    result: sp.Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in (("r", result), ("c", result.certificate), ("p", result.problem)):
        sp.write_json(value, tmp_path / f"{name}.json")
    r, c, p = (str(tmp_path / f"{name}.json") for name in "rcp")
    for files in ([r], [p, r], [p, c]):
        assert main(["verify", *files]) == 0
        text = capsys.readouterr().out
        assert f"proved: objective >= {result.lower_bound!r}" in text
    assert main(["verify", c]) == 2 and main(["verify", p, p]) == 2
    assert main(["verify", r, r, r]) == 2


def test_claims_that_do_not_follow_are_refused(
    result: sp.Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    sp.write_json(result.problem, path)
    content = json.loads(sp.to_json(result.certificate))
    content["certificate"][-1]["bound"] = -0.4
    (tmp_path / "c.json").write_text(json.dumps(content))
    assert main(["verify", str(path), str(tmp_path / "c.json")]) == 1
    assert "NOT PROVED" in capsys.readouterr().out
    x, y = sp.variables(2)
    other = tmp_path / "other.json"
    sp.write_json(sp.Problem(x * y, [x**2 + y**2 <= 2]), other)
    sp.write_json(result.certificate, tmp_path / "c.json")
    assert main(["verify", str(other), str(tmp_path / "c.json")]) == 1
    assert "another problem" in capsys.readouterr().out


def test_other_claims_have_their_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (x,) = sp.variables(1)
    for problem, words in (
        (sp.Problem(x, [x**2 <= -1.0], lower=-5, upper=5), "no point is feasible"),
        (sp.Problem(-1.0 * x, lower=0), "falls without limit"),
        (sp.Problem(x, lower=0, upper=1, sense="max"), "negative of what is maximised"),
    ):
        sp.write_json(sp.solve(problem), tmp_path / "r.json")
        assert main(["verify", str(tmp_path / "r.json")]) == 0
        assert words in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "text", "words", "message"),
    [
        ("f.lp", "garbage here", "solve", "f.lp: expected a section keyword, found `garbage`"),
        ("f.lp", "", "solve", "f.lp: found no variables, expected a problem in this format"),
        ("f.txt", "min x", "verify", "f.txt: JSON: found no JSON (Expecting value"),
        ("f.json", "{}", "solve", "f.json: JSON.format: found nothing"),
        ("f.txt", "min x", "solve --format .gms", "f.txt:1: statement 'min x'"),
        ("f.txt", "{}", "solve --format .json", "f.txt: JSON.format: found nothing"),
    ],
)
def test_messages_name_the_file_and_its_fault(
    name: str,
    text: str,
    words: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(text)
    assert main([*words.split(), name]) == 2
    assert capsys.readouterr().err.startswith(f"sparsepop: {message}")


def test_files_of_scip_without_variables_are_named(tmp_path: Path) -> None:
    pytest.importorskip("pyscipopt")
    (tmp_path / "f.pip").write_text("Minimize\n obj: 0\nSubject to\nEnd\n")
    with pytest.raises(sp.FormatError, match=r"f.pip: found no variables"):
        sp.read(tmp_path / "f.pip")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"version":7', '"version":7.0', "version: found 7.0, expected one of the integers 3, 4"),
        ('"dimension":2', '"dimension":9223372036854775808', "expected an integer of 64 bits"),
        ('"dimension":2', '"dimension":-9223372036854775809', "expected an integer of 64 bits"),
    ],
)
def test_numbers_of_another_kind_are_told_apart(
    result: sp.Result, old: str, new: str, message: str
) -> None:
    text = sp.to_json(result)
    assert old in text
    with pytest.raises(sp.ProblemError, match=message):
        sp.from_json(text.replace(old, new, 1))


def test_the_table_of_json_is_told_from_a_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "p.txt").write_text("min x; s.t. x >= 1")
    table = str(tmp_path / "table.json")
    assert main(["solve", str(tmp_path / "p.txt"), "--json", table]) == 0
    capsys.readouterr()
    assert main(["verify", table]) == 2
    seen = capsys.readouterr().err
    assert "what --json writes" in seen and "solve --certificate" in seen
