"""The command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import setid
from setid import cli
from setid.cli import main
from setid.proofs.evidence import Verification

ROWS = "u,y\n4,0\n-3,-6.25\n2,1.175\n1,2.0875\n"
FIRST = ["--na", "1", "--nb", "1"]


@pytest.fixture
def record(tmp_path: Path) -> str:
    path = tmp_path / "record.csv"
    path.write_text(ROWS)
    return str(path)


def test_identify(record: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", record, *FIRST, "--equation-noise", "0.5"]) == cli.EXIT_PROVED
    text = capsys.readouterr().out
    assert "a1" in text and "certified" in text and "-0.5232" in text


@pytest.mark.parametrize(("tol", "code"), [("1e-12", cli.EXIT_OPEN), ("0.5", cli.EXIT_PROVED)])
def test_tolerances_say_what_is_closed(record: str, tol: str, code: int) -> None:
    """Linear programs leave gaps of some 1e-8 of the width, and none of a half."""
    arguments = ["identify", record, *FIRST, "--output-noise", "0.5", "--tol", tol]
    assert main(arguments) == code
    refused = ["consistency", record, *FIRST, "--equation-noise", "0.5", "--tol", "-1"]
    assert main(refused) == cli.EXIT_INPUT


def test_identify_writes_json_and_a_picture(record: str, tmp_path: Path) -> None:
    out, picture = tmp_path / "out.json", tmp_path / "out.png"
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5", "--stable"]
    assert main([*arguments, "--json", str(out), "--plot", str(picture)]) == cli.EXIT_PROVED
    found = json.loads(out.read_text())
    low, high = found["intervals"]["b0"]["outer"]
    assert low <= 1.9166667 and high >= 2.109302 and high - low < 0.1927
    assert found["status"] == "certified" and any("Stable" in t for t in found["assumptions"])
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_identify_writes_a_page(record: str, tmp_path: Path) -> None:
    page = tmp_path / "out.html"
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5", "--report", str(page)]
    assert main(arguments) == cli.EXIT_PROVED
    assert "What is taken for granted" in page.read_text(encoding="utf-8")


def test_software_of_pages_is_missed_before_the_work(
    record: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5"]
    assert main([*arguments, "--report", str(tmp_path / "out.html")]) == cli.EXIT_MISSING
    printed = capsys.readouterr()
    assert printed.out == "" and "jinja2 is missing" in printed.err


def test_json_alone(record: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", record, *FIRST, "--equation-noise", "0.5", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["file"] == record


def test_an_empty_set_has_its_exit_code(record: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", record, *FIRST, "--equation-noise", "0.3"]) == cli.EXIT_EMPTY
    text = capsys.readouterr().out
    assert "empty" in text and "inf" not in text and "samples that contradict each other" in text
    assert main(["identify", record, *FIRST, "--output-noise", "0"]) == cli.EXIT_EMPTY
    text = capsys.readouterr().out
    assert "noise of exactly zero" in text and "setid.consistency" in text


def test_results_are_verified_on_request(
    record: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5", "--verify"]
    assert main(arguments) == cli.EXIT_PROVED
    assert "\nverified: " in capsys.readouterr().out
    wrong = Verification(False, "nothing holds")
    monkeypatch.setattr(cli.Identification, "verify", lambda self, data: wrong)
    assert main([*arguments, "--json", "-"]) == cli.EXIT_OPEN
    assert json.loads(capsys.readouterr().out)["verified"] is False
    assert main(arguments) == cli.EXIT_OPEN
    assert "NOT VERIFIED: nothing holds" in capsys.readouterr().out


def test_consistency(record: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "level.json"
    arguments = ["consistency", record, *FIRST, "--equation-noise"]
    assert main([*arguments, "0.5", "--json", str(out)]) == cli.EXIT_PROVED
    low, high = json.loads(out.read_text())["scale"]
    assert 0.5 * low == pytest.approx(0.33902834, abs=1e-6) and low <= high
    assert main([*arguments, "0.3"]) == cli.EXIT_EMPTY
    assert "too small" in capsys.readouterr().out


def test_columns_by_name_and_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "other.csv"
    path.write_text(
        "time,level,valve\n"
        + "".join(
            f"{k},{line.split(',')[1]},{line.split(',')[0]}\n"
            for k, line in enumerate(ROWS.split()[1:])
        )
    )
    bounds = [*FIRST, "--equation-noise", "0.5"]
    named = ["identify", str(path), "--input", "valve", "--output", "level", *bounds]
    assert main(named) == cli.EXIT_PROVED
    first = capsys.readouterr().out
    assert main(["identify", str(path), "--input", "2", "--output", "1", *bounds]) == 0
    assert capsys.readouterr().out == first
    assert main(["identify", str(path), *bounds]) == cli.EXIT_INPUT
    path.write_text("\n".join(line for line in ROWS.split()[1:]))
    assert main(["identify", str(path), *bounds]) == cli.EXIT_PROVED


@pytest.mark.parametrize(("before", "after"), [("", "\t"), ("\t", "")])
def test_separators_around_each_line_make_no_third_column(
    before: str, after: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files of benchmarks end each line with a tab."""
    path, samples = tmp_path / "record.dat", ["4\t0", "-3\t-6.25", "2\t1.175", "1\t2.0875"]
    path.write_text("".join(f"{before}{line}{after}\n" for line in samples))
    assert main(["identify", str(path), *FIRST, "--equation-noise", "0.5"]) == cli.EXIT_PROVED
    assert "-0.5232" in capsys.readouterr().out


def test_columns_without_names_are_not_guessed_among_three(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first of them counts samples: it is no input."""
    path = tmp_path / "record.dat"
    path.write_text("1 4 0\n2 -3 -6.25\n3 2 1.175\n4 1 2.0875\n")
    given = ["identify", str(path), *FIRST, "--equation-noise", "0.5"]
    assert main(given) == cli.EXIT_INPUT
    assert "found 3 columns without names" in capsys.readouterr().err
    assert main([*given, "--input", "1", "--output", "2"]) == cli.EXIT_PROVED
    assert "-0.5232" in capsys.readouterr().out


def test_matlab_files_are_named_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "record.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file\0\xff\xfe")
    assert main(["identify", str(path), *FIRST, "--output-noise", "1"]) == cli.EXIT_INPUT
    assert "setid.IOData.from_mat" in capsys.readouterr().err


def test_decimal_commas(tmp_path: Path, record: str, capsys: pytest.CaptureFixture[str]) -> None:
    bounds = [*FIRST, "--equation-noise", "0.5"]
    main(["identify", record, *bounds])
    with_points = capsys.readouterr().out.split("\n", 1)[1]
    path = tmp_path / "comma.csv"
    path.write_text(ROWS.replace(",", ";").replace(".", ","))
    assert main(["identify", str(path), *bounds]) == cli.EXIT_INPUT
    assert "say decimal=" in capsys.readouterr().err
    out = str(tmp_path / "comma.json")
    call = ["identify", str(path), *bounds, "--decimal", ",", "--certificate", out]
    assert main(call) == cli.EXIT_PROVED
    assert with_points in capsys.readouterr().out
    assert main(["verify", out, "--record", str(path), "--decimal", ","]) == 0


def test_rows(record: str, capsys: pytest.CaptureFixture[str]) -> None:
    bounds = [*FIRST, "--equation-noise", "0.5", "--rows"]
    assert main(["identify", record, *bounds, "1:4"]) == cli.EXIT_PROVED
    assert "3 samples" in capsys.readouterr().out
    assert main(["identify", record, *bounds, "x"]) == cli.EXIT_INPUT
    assert main(["identify", record, *bounds[:-1], "--rows=-3:"]) == cli.EXIT_PROVED
    assert "3 samples" in capsys.readouterr().out
    for rows in ("3:1", "2:2", "1:500", "4:", "-9:"):
        assert main(["identify", record, *bounds[:-1], f"--rows={rows}"]) == cli.EXIT_INPUT
        told = capsys.readouterr().err
        assert f"--rows: found '{rows}', expected FIRST < END <= 4" in told


@pytest.mark.parametrize("kind", ["output", "input", "equation"])
@pytest.mark.parametrize("bound", ["-1", "nan", "inf"])
def test_wrong_noise_bounds_name_their_option(
    record: str, kind: str, bound: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", record, *FIRST, f"--{kind}-noise={bound}"]) == cli.EXIT_INPUT
    assert f"--{kind}-noise: found {bound}, expected a finite bound" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["identify", "nowhere.csv", *FIRST], "nowhere.csv"),
        (["identify", "record.csv", *FIRST, "--equation-noise", "-1"], "bound >= 0"),
        (["identify", "record.csv", *FIRST, "--equation-noise", "1", "--relative"], "no shares"),
        (["identify", "record.csv", "--na", "-1", "--nb", "1"], "na"),
        (
            ["identify", "record.csv", *FIRST, "--output-noise", "1", "--time-limit", "-1"],
            "time_limit",
        ),
        (["identify", "record.csv", "--na", "1"], "--nb"),
        (["identify", "record.csv", "--nb", "1"], "--na: found none, expected orders, or"),
        (
            ["identify", "record.csv", *FIRST, "--tau", "1"],
            "--tau: found a value",
        ),
        (["identify", "record.csv", *FIRST, "--continuous", "1", "0"], "--na: found a value"),
        (["identify", "record.csv", "--continuous", "1", "0", "--delta", "x"], "--delta: found"),
        (["consistency", "record.csv", *FIRST], "noise"),
        (["identify", "record.csv", *FIRST], "`setid consistency`"),
        (
            [*"identify record.csv --output-noise 1 --input y --output y".split(), *FIRST],
            "'y' for two signals",
        ),
    ],
)
def test_wrong_input(
    arguments: list[str],
    message: str,
    record: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([record if a == "record.csv" else a for a in arguments]) == cli.EXIT_INPUT
    assert message in capsys.readouterr().err


def test_a_wrong_suffix_of_a_picture(record: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5", "--plot", "out.nothing"]
    assert main(arguments) == cli.EXIT_INPUT
    printed = capsys.readouterr()
    assert printed.out == "" and "--plot: found 'out.nothing'" in printed.err


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sparsepop-py {setid.__version__}\n"
    assert main(["identify", "--help"]) == 0
    assert "exit codes" in capsys.readouterr().out


def test_as_a_module(record: str) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-m",
            "setid.cli",
            "identify",
            record,
            *FIRST,
            "--equation-noise",
            "0.5",
        ],
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
        check=False,
    )
    assert done.returncode == 0 and "certified" in done.stdout, done.stderr


@pytest.mark.parametrize("option", ["--json", "--plot", "--report"])
def test_outputs_that_cannot_be_written_are_named_before_the_work(
    record: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    arguments = ["identify", record, *FIRST, "--equation-noise", "0.5", option]
    assert main([*arguments, str(tmp_path / "nowhere" / "out.png")]) == cli.EXIT_INPUT
    printed = capsys.readouterr()
    assert printed.out == "" and f"{option}: found" in printed.err


def test_records_that_are_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "record.csv"
    path.write_bytes(b"\xff\xfe\x00u,y\n\x01")
    assert main(["identify", str(path), *FIRST, "--output-noise", "1"]) == cli.EXIT_INPUT
    assert "no UTF-8 text" in capsys.readouterr().err
    assert main(["identify", str(tmp_path), *FIRST, "--output-noise", "1"]) == cli.EXIT_INPUT


def test_times_and_a_second_line_of_headers(
    tmp_path: Path, record: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [line.split(",") for line in Path(record).read_text().splitlines()[1:]]
    lines = [f"{0.5 * k:g};{u};{y}".replace(".", ",") for k, (u, y) in enumerate(rows)]
    path, out = tmp_path / "european.csv", str(tmp_path / "proof.json")
    path.write_text("t;valve;level\ns;V;mm\n" + "\n".join(lines) + "\n", encoding="utf-8")
    call = ["identify", str(path), "--input", "valve", "--output", "level", "--decimal", ","]
    call += ["--na", "1", "--nb", "1", "--equation-noise", "0.5", "--time", "t"]
    assert main(call) == 2
    assert "say header=2" in capsys.readouterr().err
    assert main([*call, "--header", "2", "--certificate", out]) == 0
    assert "y1 = level [mm], u1 = valve [V]" in capsys.readouterr().out
    checked = ["verify", out, "--record", str(path), "--decimal", ","]
    assert main(checked) == 2
    assert main([*checked, "--header", "2"]) == 0
    path.write_text("t;valve;level\ns;V;mm\n" + "\n".join([*lines[:1], *lines[2:]]) + "\n")
    assert main([*call, "--header", "2"]) == 2
    assert "found an interval" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("4;0\n-3;-6,25\n2;1,175\n1;2,0875\n", ["--decimal", ","]),
        ("4;0,0\n-3;-6,25\n2;1,175\n1;2,0875\n", ["--decimal", ",", "--input", "0"]),
        ("2021,u,y\n0,4,0\n0,-3,-6.25\n0,2,1.175\n0,1,2.0875\n", ["--header", "1"]),
    ],
)
def test_columns_are_found_with_the_decimal_mark_and_the_header_that_are_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: list[str]
) -> None:
    path, proof = tmp_path / "record.csv", tmp_path / "proof.json"
    path.write_text(text)
    noise = ["--equation-noise", "0.5", "--certificate", str(proof)]
    assert main(["identify", str(path), *words, *FIRST, *noise]) == cli.EXIT_PROVED
    assert "-0.5232" in capsys.readouterr().out
    if "--input" not in words:
        assert main(["verify", str(proof), "--record", str(path), *words]) == 0


def test_a_superscript_is_no_number_of_a_column(
    record: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", record, *FIRST, "--output-noise", "1", "--input", "\u00b2"]) == 2
    assert "found no single column '\u00b2'" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "status", "export"])
def test_a_study_that_is_not_there_is_wrong_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    more = [str(tmp_path / "table.csv")] if command == "export" else []
    assert main(["study", command, str(tmp_path / "no.study"), *more]) == cli.EXIT_INPUT
    assert "no such file" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--json", "--certificate"])
def test_outputs_do_not_replace_the_record(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "record.csv"
    path.write_text("u,y\n1,0\n0,1\n-1,0\n2,-1\n0,2\n")
    kept = path.read_bytes()
    asked = ["identify", str(path), "--na", "0", "--nb", "1", "--nk", "1"]
    assert main([*asked, "--equation-noise", "1", option, str(path)]) == 2
    assert "as the input too" in capsys.readouterr().err and path.read_bytes() == kept


def test_degrees_are_of_structures_that_have_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "record.csv"
    path.write_text("u,y\n1,0\n0,1\n-1,0\n2,-1\n0,2\n1,1\n")
    asked = ["identify", str(path), "--order", "1", "--equation-noise", "5", "--degree", "2"]
    assert main([*asked, "--structure", "TransferFunction"]) == 2
    assert "TransferFunction has no degree" in capsys.readouterr().err
    main([*asked, "--structure", "PolynomialNARX"])
    assert "has no degree" not in capsys.readouterr().err


def test_a_number_that_names_a_column_is_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sensors named 1, 2 and 3: by number, 1 would be the second of them."""
    record = tmp_path / "record.csv"
    record.write_text("1;2;3\n4;0;9\n-3;-6.25;9\n2;1.175;9\n1;2.0875;9\n")
    words = ["identify", str(record), *FIRST, "--equation-noise", "0.5", "--header", "1"]
    assert main([*words, "--input", "1", "--output", "2"]) == 0
    text = capsys.readouterr().out
    assert "y1 = 2, u1 = 1" in text and "-0.5232" in text
    assert main([*words, "--input", "0", "--output", "2"]) == 0  # no name: the first column
    assert "y1 = 2, u1 = 1" in capsys.readouterr().out
