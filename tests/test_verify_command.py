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
