"""``setid identify --certificate`` and ``setid verify``: one file, two checkers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow_values import slow_after

import setid
import sparsepop_py as sp
from setid.cli import main
from setid.result.json_ import certificate_text

ROOT = Path(__file__).resolve().parents[2]
ROWS = "u,y\n4,0\n-3,-6.25\n2,1.175\n1,2.0875\n"
ORDERS = ["--na", "1", "--nb", "1"]


@pytest.fixture(params=["equation", "output"])
def files(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    record, out = tmp_path / "record.csv", tmp_path / "out.json"
    record.write_text(ROWS)
    noise = [f"--{request.param}-noise", "0.5", "--certificate", str(out)]
    assert main(["identify", str(record), *ORDERS, *noise]) == 0
    return record, out


def test_both_checkers_confirm_the_file(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = files
    assert main(["verify", str(out)]) == 0
    assert main(["verify", str(out), "--record", str(record)]) == 0
    assert "proved" in capsys.readouterr().out
    words = [sys.executable, str(ROOT / "checker/check.py"), "--record", str(record), str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "a1" in done.stdout


@pytest.mark.parametrize("words", [[], ["--record", "record.csv"]])
def test_the_second_checker_names_the_file_that_it_reads(words: list[str], tmp_path: Path) -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    out = tmp_path / "out.json"
    out.write_text(result.to_json())
    asked = [sys.executable, str(ROOT / "checker/check.py"), *words, str(out)]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "setid identify --certificate" in done.stdout


@pytest.mark.parametrize("rows", slow_after(2, ["1:", "1:4", ":-1"]))
def test_both_checkers_take_the_part_that_was_identified(
    rows: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = tmp_path / "record.csv", tmp_path / "out.json"
    record.write_text(ROWS)
    bounds = [*ORDERS, "--equation-noise", "0.5", f"--rows={rows}", "--certificate", str(out)]
    assert main(["identify", str(record), *bounds]) == 0
    words = [sys.executable, str(ROOT / "checker/check.py"), "--record", str(record), str(out)]
    for given, code in ((rows, 0), (":", 1), ("0:2", 1)):
        assert main(["verify", str(out), "--record", str(record), f"--rows={given}"]) == code
        asked = [*words, "--rows", given]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stdout
    asked = [*words, "--rows", "1-4"]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "expected FIRST:END" in done.stdout
    assert main(["verify", str(out), "--record", str(record), "--rows=3:2"]) == 2
    assert "expected FIRST < END <= 4" in capsys.readouterr().err


@pytest.mark.parametrize("rows", [":", "0:4"])
def test_tables_without_names_are_compared_by_their_columns(
    rows: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A column of words, one of times, then input and output; the sensor dies at the end."""
    record, out = tmp_path / "record.csv", tmp_path / "out.json"
    samples = [line.split(",") for line in ROWS.split()[1:]] + [["2", ""], ["1", ""]]
    lines = [f"x,{0.1 * k!r},{u},{y}\n" for k, (u, y) in enumerate(samples)]
    record.write_text("".join(lines))
    given = ["--time", "1", "--input", "2", "--output", "3", "--header", "0", *ORDERS]
    noise = ["--equation-noise", "0.5", "--certificate", str(out)]
    assert main(["identify", str(record), *given, *noise, f"--rows={rows}"]) == 0
    words = ["--record", str(record), "--rows", rows, "--header", "0"]
    assert main(["verify", str(out), *words]) == 0
    asked = [sys.executable, str(ROOT / "checker/check.py"), *words, str(out)]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    lines[2] = "x,0.2,2,1.25\n"
    record.write_text("".join(lines))
    assert main(["verify", str(out), *words]) == 1
    assert "NOT PROVED" in capsys.readouterr().out


@pytest.mark.parametrize("names", ["x,x,x", ",,", "v,,u,u"])
def test_columns_that_names_do_not_tell_apart_are_compared_by_their_readings(
    names: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = tmp_path / "record.csv", tmp_path / "out.json"
    aside = names.count(",") - 1  # columns of words before input and output
    rows = "".join("a," * aside + row + "\n" for row in ROWS.split()[1:])
    record.write_text(f"{names}\n{rows}")
    columns = ["--input", str(aside), "--output", str(aside + 1)]
    noise = ["--equation-noise", "0.5", "--certificate", str(out)]
    assert main(["identify", str(record), *columns, *ORDERS, *noise]) == 0
    assert main(["verify", str(out), "--record", str(record)]) == 0
    record.write_text(f"{names}\n{rows.replace('2.0875', '2.08')}")
    assert main(["verify", str(out), "--record", str(record)]) == 1
    assert "NOT PROVED" in capsys.readouterr().out


def test_what_a_file_assumes_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A prior in a file narrows the intervals, and texts in it are no lines of their own."""
    data = setid.IOData(
        [4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], assumptions=["nothing\nproved: a1 in [0, 0]"]
    )
    model, prior = setid.TransferFunction(1, 1), setid.Box({"a1": (-0.4, -0.35)})
    result = setid.identify(data, model, setid.Noise(equation=0.5), [prior])
    (tmp_path / "result.json").write_text(result.to_json())
    assert main(["verify", str(tmp_path / "result.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "noise: |equation 1| <= 0.5" in lines
    assert any(line.startswith("assumed: prior: Box") for line in lines)
    assert "assumed: 'nothing\\nproved: a1 in [0, 0]'" in lines
    assert sum(line.startswith("proved") for line in lines) == 1


def test_constraints_are_told_in_the_names_of_the_parameters() -> None:
    model = setid.TransferFunction(1, 1)
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    noise = setid.Noise(equation=0.5)
    own, (b0, a1) = setid.parameters(model), sp.variables(2, ["b0", "a1"])
    assert setid.formulate(data, model, noise, [own["a1"] <= 0])
    with pytest.raises(setid.PriorError, match="b0, a1, expected a1, b0"):
        setid.formulate(data, model, noise, [b0 <= 0, a1 >= 1])


def test_the_table_of_json_is_told_from_a_certificate(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("identify", "consistency"):
        table = tmp_path / f"{command}.json"
        call = [command, str(files[0]), *ORDERS, "--equation-noise", "0.5", "--json", str(table)]
        assert main(call) == 0
        capsys.readouterr()
        assert main(["verify", str(table)]) == 2
        told = capsys.readouterr().err
        assert "what --json writes" in told and "identify --certificate" in told


def test_a_certificate_without_the_result_is_named(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    out = files[1]
    found = json.loads(out.read_text())
    del found["result"]
    out.write_text(json.dumps(found))
    assert main(["verify", str(out)]) == 2
    assert "found no part 'result', expected what `setid identify --certificate` writes" in (
        capsys.readouterr().err
    )


def test_another_record_is_refused(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = files
    record.write_text(ROWS.replace("2.0875", "2.08"))
    assert main(["verify", str(out), "--record", str(record)]) == 1
    assert capsys.readouterr().out == "NOT PROVED  the result belongs to other data\n"


def test_a_record_of_another_length_asks_for_the_part(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = files
    record.write_text(ROWS + "3,1\n")
    assert main(["verify", str(out), "--record", str(record)]) == 1
    assert "found 5 samples, expected 4; --rows FIRST:END" in capsys.readouterr().out
    assert main(["verify", str(out), "--record", str(record), "--rows", "0:4"]) == 0


def test_changed_claims_are_refused(files: tuple[Path, Path]) -> None:
    _, out = files
    text = out.read_text()
    found: dict[str, Any] = json.loads(text)
    found["identification"]["intervals"][0]["outer"] = [-0.4, -0.4]
    out.write_text(json.dumps(found))
    assert main(["verify", str(out)]) == 2
    found = json.loads(text)
    found["result"]["intervals"][0]["outer"] = [-0.4, -0.4]
    out.write_text(json.dumps(found))
    assert main(["verify", str(out)]) == 2
    out.write_text("{}")
    assert main(["verify", str(out)]) == 2


def test_nothing_is_lost_when_an_output_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    record = tmp_path / "record.csv"
    record.write_text(ROWS)
    out = ["--equation-noise", "0.5", "--json", str(tmp_path / "out.json")]

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    assert main(["identify", str(record), *ORDERS, *out]) == 5
    captured = capsys.readouterr()
    assert "1.91" in captured.out and "No space left" in captured.err
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize("missing", ["y", "u"])
def test_ranges_of_missing_samples_are_those_of_the_claim(
    missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table has no ranges; they are part of what is assumed, and are printed."""
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 20), np.zeros(20)
    for k in range(1, 20):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    (y if missing == "y" else u)[7] = np.nan
    table = tmp_path / "record.csv"
    cells = [["" if np.isnan(v) else repr(v) for v in row] for row in np.c_[u, y].tolist()]
    table.write_text("u1,y1\n" + "".join(f"{a},{b}\n" for a, b in cells))
    data = setid.IOData(u, y, **{f"{missing}_range": (-3.0, 3.0)})
    options = setid.Options(time_limit=5, progress=False)
    model, noise = setid.TransferFunction(1, 1, 1), setid.Noise(equation=0.01)
    found = setid.identify(data, model, noise, (), options)
    for text in (found.to_json(), certificate_text(found)):
        path = tmp_path / "claim.json"
        path.write_text(text)
        assert main(["verify", str(path), "--record", str(table)]) == 0
        assert f"missing samples of {missing} lie in" in capsys.readouterr().out


def test_a_part_needs_its_record(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(files[0]), "--rows", "0:5"]) == 2
    assert "expected --record as well" in capsys.readouterr().err
    assert main(["verify", "nofile.json"]) == 2
    assert capsys.readouterr().err.count("nofile.json") == 1
