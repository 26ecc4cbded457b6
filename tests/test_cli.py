"""The command line: what it prints, and what its exit codes say."""

from __future__ import annotations

import io
import json
import os
import pathlib
import shlex
import subprocess
import sys
from types import SimpleNamespace

import pytest

import sparsepop_py as sp
from sparsepop_py import plots
from sparsepop_py.cli import (
    EXIT_INPUT,
    EXIT_INTERRUPT,
    EXIT_MISSING,
    EXIT_OPEN,
    EXIT_OUTPUT,
    EXIT_PIPE,
    EXIT_PROVED,
    main,
)
from sparsepop_py.errors import SolverNotFound

ROOT = pathlib.Path(__file__).resolve().parents[1]
CHECKER = ROOT / "checker" / "check.py"

HEAD = "Variables x1,x2,objvar; Equations e1,e2;\n"
BOX = "x1.lo = 0; x1.up = 1; x2.lo = 0; x2.up = 1;\n"
FILES = {
    "closed": HEAD + "e1.. objvar - x1^2 - x2 =E= 0; e2.. x1 + x2 =E= 1;\n" + BOX,
    "largest": HEAD
    + "e1.. objvar - x1*x2 =E= 3; e2.. x1 + x2 =L= 1;\n"
    + BOX
    + "* Solve m using NLP maximizing objvar;\n",
    "empty": HEAD + "e1.. objvar - x1 =E= 0; e2.. x1 + x2 =E= 7;\n" + BOX,
    "unbounded": HEAD + "e1.. objvar - x1 =E= 0; e2.. x1 + x2 =L= 7;\n",
    # Motzkin's polynomial: bounds come only from a box, which --plain does not look for
    "open": HEAD + "e1.. objvar - x1^4*x2^2 - x1^2*x2^4 + 3*x1^2*x2^2 =E= 1; e2.. x1 + x2 =L= 9;\n",
    # concave: the least value, 2, is at a vertex, (1, 0); the least order proves 1.92
    "concave": HEAD + "e1.. objvar + x1^2 + x2^2 - x1*x2 =E= 3; e2.. x1 + x2 =L= 1.2;\n" + BOX,
    "broken": HEAD + "e1.. objvar - x1 =Q= 0;\n",
}


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    for name, text in FILES.items():
        (tmp_path / f"{name}.gms").write_text(text)
    return tmp_path


def run(folder: pathlib.Path, command: str, name: str, *options: str) -> int:
    return main([command, str(folder / f"{name}.gms"), *options])


# ---- exit codes -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "code"),
    [
        ("closed", [], EXIT_PROVED),
        ("closed", ["--order", "2", "--dense"], EXIT_PROVED),
        ("closed", ["--solver", "clarabel-moment"], EXIT_PROVED),
        ("empty", [], EXIT_PROVED),
        ("unbounded", [], EXIT_PROVED),
        ("open", ["--plain"], EXIT_OPEN),
        ("concave", ["--plain"], EXIT_OPEN),
        ("concave", ["--plain", "--gap", "0.5"], EXIT_PROVED),
    ],
)
def test_exit_codes(folder: pathlib.Path, name: str, options: list[str], code: int) -> None:
    assert run(folder, "solve", name, *options) == code


@pytest.mark.parametrize("place", ["read", "solve"])
def test_an_interrupt_outside_of_the_work_is_said_in_a_line(
    folder: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    place: str,
) -> None:
    """No traceback, and the code by which shells know a process that Ctrl-C ended."""

    def interrupted(*arguments: object, **more: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"sparsepop_py.cli.{place}", interrupted)
    assert run(folder, "solve", "closed") == EXIT_INTERRUPT == 128 + 2
    assert capsys.readouterr() == ("", "sparsepop: interrupted\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "nowhere.gms"], "sparsepop: nowhere.gms: no such file"),
        (["info", "nowhere.gms"], "sparsepop: nowhere.gms: no such file"),
        (["solve", "{closed}", "--order", "0"], "Options.order: found 0, expected a positive"),
        (["solve", "{closed}", "--order", "two"], "argument --order: invalid int value: 'two'"),
        (["solve", "{closed}", "--time-limit", "-1"], "Options.time_limit: found -1.0"),
        (["solve", "{closed}", "--gap", "-1"], "Options.gap: found -1.0"),
        (["orders", "{closed}", "--gap", "-1"], "Options.gap: found -1.0"),
        (
            ["solve", "{closed}", "--plot", "a.xyz"],
            "--plot: found 'a.xyz', expected a file that ends in one of",
        ),
        (["solve", "{closed}", "--plot", "no/such/folder.png"], "--plot: found"),
        (["solve", "{broken}"], "broken.gms:2: statement 'e1.. objvar - x1 =Q= 0': found '=Q='"),
        (["solve"], "the following arguments are required: FILE"),
        (["prove", "{closed}"], "invalid choice: 'prove'"),
        ([], "the following arguments are required: COMMAND"),
    ],
)
def test_wrong_input(
    folder: pathlib.Path,
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    places = {name: str(folder / f"{name}.gms") for name in FILES}
    assert main([argument.format(**places) for argument in arguments]) == EXIT_INPUT
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error


def test_missing_software(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(folder, "solve", "closed", "--solver", "cvxpy:NOSUCH", "--plain") == EXIT_MISSING
    assert "cvxpy has no installed solver 'NOSUCH'" in capsys.readouterr().err

    def missing() -> None:
        raise SolverNotFound("plot: matplotlib is missing")

    monkeypatch.setattr(plots, "require_matplotlib", missing)
    assert run(folder, "solve", "closed", "--plot", str(folder / "a.png")) == EXIT_MISSING
    captured = capsys.readouterr()
    assert captured.out == ""  # said before the work
    assert captured.err == "sparsepop: plot: matplotlib is missing\n"


# ---- output -----------------------------------------------------------------------------


def test_text(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(folder, "solve", "closed")
    captured = capsys.readouterr()
    lines = dict(line.split(maxsplit=2)[::2] for line in captured.out.splitlines()[2:4])
    assert lines.keys() == {"lower", "upper"}
    assert lines["lower"].endswith("  proved") and lines["upper"].endswith("  attained")
    assert float(lines["lower"].split()[0]) <= 0.75 <= float(lines["upper"].split()[0])
    assert "2 variables, 0 inequalities, 1 equalities, degree 2, minimise" in captured.out
    assert "point         x1 = 0.5" in captured.out
    assert captured.err == ""  # a progress line only on a terminal


def test_a_maximum_is_printed_in_its_own_sense(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(folder, "solve", "largest")
    out = capsys.readouterr().out
    assert "maximise" in out
    lower = next(line for line in out.splitlines() if line.startswith("lower"))
    upper = next(line for line in out.splitlines() if line.startswith("upper"))
    assert lower.endswith("attained") and upper.endswith("proved")
    assert 3.2499 < float(lower.split()[2]) <= 3.25 <= float(upper.split()[2]) < 3.2501


def strictly(text: str) -> dict[str, object]:
    """What a strict JSON reader makes of a text: no NaN, no Infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_no_bound_is_shown_where_the_objective_falls_without_limit(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The status says what is proved; a bound of -inf with nothing attained would deny it."""
    run(folder, "solve", "unbounded")
    text = capsys.readouterr().out
    assert "status        UNBOUNDED: It is proved" in text and "point         x1 = " in text
    assert "bound  " not in text and "nothing attained" not in text


def test_json(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(folder, "solve", "closed", "--json", "--order", "2")
    record = strictly(capsys.readouterr().out)
    assert record["status"] == "OPTIMAL"
    assert record["lower_bound"] <= 0.75 <= record["upper_bound"]
    assert record["gap"] == record["upper_bound"] - record["lower_bound"]
    assert record["certificate_verified"] is True
    assert record["names"] == ["x1", "x2"]
    assert record["x"] == pytest.approx([0.5, 0.5], abs=1e-3)
    assert record["sizes"]["variables"] == 2
    assert {"search", "presolve"} <= record["timings"].keys()


@pytest.mark.parametrize(
    ("name", "status", "lower", "upper"),
    [("empty", "INFEASIBLE", "inf", "inf"), ("unbounded", "UNBOUNDED", "-inf", "-inf")],
)
def test_json_of_infinities(
    folder: pathlib.Path,
    name: str,
    status: str,
    lower: str,
    upper: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(folder, "solve", name, "--json") == EXIT_PROVED
    record = strictly(capsys.readouterr().out)
    assert (record["status"], record["lower_bound"]) == (status, lower)
    assert record["upper_bound"] == upper


def test_picture(folder: pathlib.Path) -> None:
    path = folder / "a.png"
    assert run(folder, "solve", "closed", "--plot", str(path)) == EXIT_PROVED
    assert path.read_bytes().startswith(b"\x89PNG")


def test_info(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "info", "open", "--order", "4") == 0
    out = capsys.readouterr().out
    assert "2 variables, 1 inequalities, 0 equalities, degree 6" in out
    assert "none: 2 (variables)" in out
    assert "moment relaxation of order 4: 2 variables, 1 cliques" in out
    assert "block sizes" in out
    run(folder, "info", "largest")
    out = capsys.readouterr().out
    assert "sense         max" in out
    assert "both: 2 (variables)" in out


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sparsepop-py {sp.__version__}\n"
    assert main(["solve", "--help"]) == 0
    text = capsys.readouterr().out
    assert "exit codes:" in text and "--time-limit" in text


# ---- files, streams, orders -------------------------------------------------------------


@pytest.mark.parametrize("ending", [".gms", ".json", ".mat", ".txt"])
@pytest.mark.parametrize("stream", [False, True])
def test_every_format_by_name_and_from_standard_input(
    ending: str,
    stream: bool,
    folder: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = folder / f"line{ending}"
    if ending == ".txt":
        path.write_text("min x1^2 + x2; s.t. x1 + x2 == 1; 0 <= x1 <= 1; 0 <= x2 <= 1")
    else:
        sp.write(sp.read(folder / "closed.gms"), path)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(path.read_bytes())))
    assert main(["solve", "-" if stream else str(path), "--order", "2", "--json"]) == EXIT_PROVED
    record = strictly(capsys.readouterr().out)
    assert record["file"] == ("-" if stream else str(path))
    assert record["lower_bound"] == pytest.approx(0.75, abs=1e-6)


def test_messages_about_standard_input_name_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(FILES["broken"].encode())))
    assert main(["solve", "-"]) == EXIT_INPUT
    assert "<stdin>:2: statement 'e1.. objvar - x1 =Q= 0'" in capsys.readouterr().err


def test_a_format_in_place_of_the_ending(folder: pathlib.Path) -> None:
    path = folder / "problem.data"
    path.write_text("min x^2 - x")
    assert main(["solve", str(path)]) == EXIT_INPUT
    assert main(["solve", str(path), "--format", ".txt"]) == EXIT_PROVED


def test_the_certificate_of_a_solve_is_checked_by_both_checkers(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = str(folder / "closed.gms"), str(folder / "proof.json")
    assert main(["solve", file, "--order", "2", "--certificate", out]) == EXIT_PROVED
    assert main(["verify", out]) == EXIT_PROVED
    call = [sys.executable, str(CHECKER), file, out]
    done = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout.startswith("proved: objective >= ")
    capsys.readouterr()
    assert main(["solve", file, "--certificate", str(folder / "no" / "out.json")]) == EXIT_INPUT
    assert "--certificate: found" in capsys.readouterr().err


def test_json_means_the_same_as_in_setid(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Alone or with - it replaces the text; with a name it writes the file beside the text."""
    file, out = str(folder / "closed.gms"), folder / "out.json"
    for arguments in ([file, "--json"], ["--json", file], [file, "--json", "-"]):
        assert main(["solve", *arguments]) == EXIT_PROVED
        assert strictly(capsys.readouterr().out)["status"] == "OPTIMAL"
    assert main(["solve", file, "--json", str(out)]) == EXIT_PROVED
    assert "status        OPTIMAL" in capsys.readouterr().out
    assert strictly(out.read_text())["status"] == "OPTIMAL"
    assert main(["solve", file, "--json", str(folder / "no" / "out.json")]) == EXIT_INPUT
    assert "--json: found" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="streams are closed by a shell")
@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("-m sparsepop_py.cli solve - >&-", EXIT_OUTPUT, "standard output: found it closed"),
        ("-m sparsepop_py.cli solve - <&-", 2, "standard input: found it closed"),
        ("-m setid.cli --help >&-", EXIT_OUTPUT, "standard output: found it closed"),
        ("checker/check.py --help >&-", 0, ""),
    ],
)
def test_closed_streams_are_named(words: str, code: int, said: str) -> None:
    call = ["sh", "-c", f"{shlex.quote(sys.executable)} {words}"]
    found = subprocess.run(call, stderr=subprocess.PIPE, input=b"min x^2", cwd=ROOT, check=False)
    assert found.returncode == code
    assert found.stderr.decode().count("\n") == bool(said) and said in found.stderr.decode()


def test_a_broken_pipe_is_silent() -> None:
    """The reader has gone before anything is printed."""
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "sparsepop_py.cli", "info", "-"]
    found = subprocess.run(
        words, stdout=writer, stderr=subprocess.PIPE, input=b"min x^2", cwd=ROOT, check=False
    )
    os.close(writer)
    assert (found.stderr, found.returncode) == (b"", EXIT_PIPE)


def test_files_are_written_though_the_reader_has_gone(tmp_path: pathlib.Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    out = tmp_path / "out.json"
    words = [sys.executable, "-m", "sparsepop_py.cli", "solve", "-", "--json", str(out)]
    found = subprocess.run(
        words, stdout=writer, stderr=subprocess.PIPE, input=b"min x^2", cwd=ROOT, check=False
    )
    os.close(writer)
    assert (found.stderr, found.returncode) == (b"", EXIT_PIPE)
    assert strictly(out.read_text())["status"] == "OPTIMAL"


@pytest.mark.skipif(not pathlib.Path("/dev/full").exists(), reason="there is no full device")
def test_a_full_standard_output_is_no_wrong_input() -> None:
    words = [sys.executable, "-m", "sparsepop_py.cli", "info", "-"]
    with open("/dev/full", "wb") as full:
        found = subprocess.run(
            words, stdout=full, stderr=subprocess.PIPE, input=b"min x^2", cwd=ROOT, check=False
        )
    assert found.returncode == EXIT_OUTPUT
    assert found.stderr.startswith(b"sparsepop: standard output: cannot be written")
    assert len(found.stderr.splitlines()) == 1


def test_completion(tmp_path: pathlib.Path) -> None:
    """What a shell asks for, as argcomplete's protocol has it."""
    pytest.importorskip("argcomplete")
    line = "sparsepop ord"
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "found"),
    }
    words = [sys.executable, "-m", "sparsepop_py.cli"]
    subprocess.run(words, env=environment, cwd=ROOT, check=False, capture_output=True)
    assert (tmp_path / "found").read_text().strip() == "orders"


def test_orders_plain_and_with_presolve_side_by_side(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, picture = str(ROOT / "examples" / "problems" / "laboratory.gms"), folder / "orders.png"
    assert main(["orders", file, "--orders", "1", "2", "--plot", str(picture)]) == EXIT_PROVED
    shown = capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    head = shown.splitlines()[1]
    for word in ("order", "effort", "proved", "attained", "solver's value", "moments", "CPU s"):
        assert word in head
    assert "together: 52.7066" in shown
    assert main(["orders", file, "--orders", "2", "--effort", "plain", "--json"]) == EXIT_OPEN
    (row,) = strictly(capsys.readouterr().out)["rows"]
    assert (row["order"], row["effort"], row["status"]) == (2, "plain", "BOUNDED")
    assert main(["orders", file, "--orders", "0"]) == EXIT_INPUT


# ---- files that are named twice --------------------------------------------------------------


@pytest.mark.parametrize("option", ["--json", "--certificate"])
def test_outputs_do_not_replace_the_input(option: str, tmp_path: pathlib.Path, capsys) -> None:
    path = tmp_path / "problem.txt"
    path.write_text("min x^2\n")
    linked = tmp_path / "linked.txt"
    linked.symlink_to(path)
    for name in (path, linked, tmp_path / "." / "problem.txt"):
        assert main(["solve", str(path), option, str(name)]) == 2
        assert "as the input too, expected another file" in capsys.readouterr().err
    assert path.read_text() == "min x^2\n"


def test_outputs_do_not_replace_each_other(tmp_path: pathlib.Path, capsys) -> None:
    path, out = tmp_path / "problem.txt", tmp_path / "out.json"
    path.write_text("min x^2\n")
    assert main(["solve", str(path), "--json", str(out), "--certificate", str(out)]) == 2
    assert "as --json too" in capsys.readouterr().err and not out.exists()


@pytest.mark.parametrize("option", ["--json", "--certificate", "--plot"])
@pytest.mark.parametrize("name", ["", "-"])
def test_outputs_have_names(option: str, name: str, tmp_path: pathlib.Path, capsys) -> None:
    path = tmp_path / "problem.txt"
    path.write_text("min x^2\n")
    expected = 0 if (option, name) == ("--json", "-") else 2
    assert main(["solve", str(path), option, name]) == expected
    assert (expected == 0) == (capsys.readouterr().err == "")


def test_solvers_of_no_name_are_wrong_input(tmp_path: pathlib.Path, capsys) -> None:
    path = tmp_path / "problem.txt"
    path.write_text("min x^2\n")
    assert main(["solve", str(path), "--solver", "foo"]) == 2
    assert "found 'foo', expected auto, " in capsys.readouterr().err
