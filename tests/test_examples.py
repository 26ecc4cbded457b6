"""The examples run as a user runs them, and the README's code does what it says."""

from __future__ import annotations

import contextlib
import io
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

import sparsepop_py as sp
from setid import cli as setid_cli
from sparsepop_py import cli

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
PROBLEMS = sorted((EXAMPLES / "problems").glob("*.gms"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


def run(name: str, folder: Path, *arguments: str) -> str:
    """Output of an example, started in another folder; pytest makes warnings errors."""
    path = EXAMPLES / f"{name}.py"
    printed = io.StringIO()
    with (
        mock.patch.object(sys, "argv", [str(path), *arguments]),
        mock.patch.object(sys, "path", [str(path.parent), *sys.path]),
        contextlib.chdir(folder),
        contextlib.redirect_stdout(printed),
    ):
        runpy.run_path(str(path), run_name="__main__")
    return printed.getvalue()


def numbers(text: str) -> list[float]:
    return [float(token) for token in re.findall(r"-?\d+\.\d+(?:e[+-]\d+)?", text)]


def test_every_example_is_tested() -> None:
    named = {"demo", "expressions", "ratios", "structs", "certificate", "many_objectives"}
    studied = (
        "estimators",
        "hairdryer",
        "cd_player",
        "tank",
        "sampling_rates",
        "hammerstein",
        "cascade",
        "motor",
        "report",
    )
    records = {f"identify_{name}" for name in studied}
    found = {path.stem for path in EXAMPLES.glob("*.py")}
    added = {"control_hairdryer", "neural_gradients", "neural_records"}
    added |= {
        "order_comparison",
        "interval_script",
        "structs_from_identification",
        "measured_records",
    }
    assert found == named | records | added


def test_interval_script(tmp_path) -> None:
    """The loop of scripts: truth inside, what is attained inside what is proved, and close."""
    rows = run("interval_script", tmp_path).splitlines()[1:]
    for row, true in zip(rows, (-0.8, 2.0), strict=True):
        _, low, high, first, last = (
            float(v) for v in re.findall(r"[-+]?\d+\.\d+(?:e[-+]\d+)?", row)
        )
        assert low <= true <= high
        assert low <= first <= last <= high
        assert (first - low) + (high - last) <= 1e-4 * (high - low)


@pytest.mark.slow
def test_measured_records(tmp_path: Path) -> None:
    pytest.importorskip("jinja2")
    text = run("measured_records", tmp_path, "--record", "heating_system", "--output", ".")
    # warm metal stays warm for a while: a1 < -1; that sample 104 refutes the bound is on the page
    assert re.search(r"a1 +-1\.\d+ +-1\.\d+", text) and "falsified" in text
    assert (tmp_path / "heating_system.html").stat().st_size > 100_000


# Minima (the maximum of pooling) that follow by hand or from enumeration; chain, quartic
# and laboratory from multistart search, to the digits that are given.
OPTIMA = {
    "binary": -23.0,
    "chain": -6.9,
    "complementarity": -7.0,
    "laboratory": 52.70660654,
    "pooling": 700.0,
    "quartic": -5.61583463,
}


def test_demo(tmp_path: Path) -> None:
    output = run("demo", tmp_path, "--output", str(tmp_path / "pictures"))
    rows = {line.split()[0]: line.split() for line in output.splitlines() if line.strip()}
    assert set(OPTIMA) == {path.stem for path in PROBLEMS}
    for name, optimum in OPTIMA.items():
        _, _, sense, _, status, proved, attained, gap, _, verified = rows[name]
        assert (status, verified) == ("OPTIMAL", "yes"), name
        assert float(gap) <= 1e-6 * max(1.0, abs(optimum))
        sign = -1.0 if sense == "max" else 1.0
        assert sign * float(proved) <= sign * optimum + 1e-8
        assert sign * float(attained) >= sign * optimum - 1e-8
        picture = tmp_path / "pictures" / f"{name}.png"
        assert picture.read_bytes()[:4] == b"\x89PNG"
    end = output.split("measured record")[1]
    assert end.count("certified") == 5 and "verified        yes" in end
    assert (tmp_path / "pictures" / "hairdryer_bode.png").read_bytes()[:4] == b"\x89PNG"


def test_binary_optimum_by_enumeration() -> None:
    problem = sp.read_gms(EXAMPLES / "problems" / "binary.gms")
    n = problem.dimension
    points = [[float(k >> i & 1) for i in range(n)] for k in range(2**n)]
    feasible = [x for x in points if problem.violation(x) == 0.0]
    assert min(problem.objective(x) for x in feasible) == OPTIMA["binary"]


def test_expressions(tmp_path: Path) -> None:
    output = run("expressions", tmp_path)
    assert "status        OPTIMAL" in output
    exact = -1.0 / (2.0 + 2.0**0.5)
    proved = re.search(r"lower bound +(\S+) +proved", output)
    assert proved and exact - 1e-6 <= float(proved.group(1)) <= exact + 1e-9


def test_ratios(tmp_path: Path) -> None:
    """Shekel's function with five terms: the deepest hole, located by a fine grid around it."""
    output = run("ratios", tmp_path)
    assert "status        OPTIMAL" in output and "variables True" in output
    x, y = np.meshgrid(*[np.linspace(3.99, 4.01, 401)] * 2)
    holes = [(4, 4, 0.1), (1, 1, 0.2), (8, 8, 0.2), (6, 6, 0.4), (3, 7, 0.4)]
    least = -float(sum(1 / ((x - a) ** 2 + (y - b) ** 2 + c) for a, b, c in holes).max())
    proved = re.search(r"lower bound +(\S+) +proved", output)
    assert proved and least - 2e-5 <= float(proved.group(1)) <= least
    checked = subprocess.run(
        [sys.executable, str(ROOT / "checker" / "check.py"), "ratios.json"],
        cwd=tmp_path,
        check=False,
    )
    assert checked.returncode == 0


def test_identify_motor(tmp_path: Path) -> None:
    """The parameters that made the record lie in the intervals, which are attained inside."""
    output = run("identify_motor", tmp_path)
    assert "verified       True" in output
    for name, true in {"J": 0.02, "b": 0.1, "K": 0.3, "R": 1.0, "L": 0.2}.items():
        row = re.search(rf"^{name} +(\S+) +(\S+) +(\S+) +(\S+)", output, re.M)
        assert row is not None
        low, high, first, last = (float(value) for value in row.groups())
        assert low <= true <= high and low <= first <= last <= high


def test_structs(tmp_path: Path) -> None:
    output = run("structs", tmp_path)
    lines = {line.split()[0]: line for line in output.splitlines() if line.strip()}
    assert "OPTIMAL" in lines["status"]
    (proved,), (attained,) = (numbers(lines[key]) for key in ("SDPobjValue", "POP.upperBound"))
    assert proved <= attained <= proved + 1e-5
    plain = lines["param.tighten"].split()[-1]
    assert float(plain) <= attained


def test_certificate(tmp_path: Path) -> None:
    lines = run("certificate", tmp_path).splitlines()[1:]
    assert ["accepted" in line for line in lines] == [True, False, False, False, True, False]
    claim, _, damaged, short, *_ = (float(line.split()[-1]) for line in lines)
    assert damaged < short < claim


def test_many_objectives(tmp_path: Path) -> None:
    output = run("many_objectives", tmp_path)
    for true, name in ((0.6, "a"), (1.5, "b")):
        block = output.split(f"{name}  true value")[1].split("\n")
        outer, inner = numbers(block[1]), numbers(block[2])
        assert outer[0] <= inner[0] <= true <= inner[1] <= outer[1]
        assert outer[1] - outer[0] <= 1.001 * (inner[1] - inner[0])
    assert "one relaxation for all: True" in output


def test_order_comparison(tmp_path: Path) -> None:
    rows = [line.split() for line in run("order_comparison", tmp_path).splitlines()[1:]]
    assert len(rows) == 12
    for name in ("laboratory", "chain"):
        for effort in ("plain", "presolve"):
            bounds = [float(r[4]) for r in rows if r[0] == name and r[2] == effort]
            assert len(bounds) == 3 and max(bounds) <= OPTIMA[name]
            if effort == "presolve":
                assert all(a <= b + 1e-5 for a, b in zip(bounds, bounds[1:], strict=False))
                assert bounds[-1] >= OPTIMA[name] - 1e-5


# ---- identification ---------------------------------------------------------------------


def interval(output: str, name: str) -> list[float]:
    (line,) = [line for line in output.splitlines() if line.startswith(f"{name} ")]
    return [float(token) for token in line.split()[1:3]]


def test_identify_estimators(tmp_path: Path) -> None:
    output = run("identify_estimators", tmp_path)
    low, high = interval(output, "b0")
    assert low <= 1.9166667 and high >= 2.1093022 and high - low < 0.19264
    least, batch, recursive = (
        [line.split()[-5:] for line in output.splitlines() if line.startswith(key)]
        for key in ("true", "least squares", "recursive")
    )
    assert batch == recursive
    biased, true = float(batch[1][0]), float(least[0][0])
    assert abs(biased - true) > 3 * abs(float(batch[0][0]) - true)
    row = next(line for line in output.splitlines() if line.startswith("|e| <= 1 "))
    assert "-0.76576 .. -0.76433" in row and "32.22668 .. 32.25638" in row


def test_identify_hairdryer(tmp_path: Path) -> None:
    output = run("identify_hairdryer", tmp_path, "--output", str(tmp_path / "pictures"))
    assert "0.10269 V (proved)" in output and "the result is: empty" in output
    assert output.count("certified") == 5
    low, high = interval(output, "a1")
    assert -1.497 < low < -1.49 and -1.257 < high < -1.25
    assert "readings outside the proved band of readings  0 of 96" in output
    for name in ("intervals", "bode", "prediction", "parameters"):
        assert (tmp_path / "pictures" / f"hairdryer_{name}.png").stat().st_size > 1000


def test_identify_cd_player(tmp_path: Path) -> None:
    output = run("identify_cd_player", tmp_path, "--output", str(tmp_path / "pictures"))
    levels = [float(line.split()[-1]) for line in re.findall(r"na = nb = \d: \S+", output)]
    assert levels == sorted(levels, reverse=True) and levels[2] < 0.5 * levels[0]
    assert output.count("certified") == 15 and "b[2,2]1, b[2,2]2" in output
    assert "0 of 194" in output


def test_identify_tank(tmp_path: Path) -> None:
    output = run("identify_tank", tmp_path, "--output", str(tmp_path / "pictures"))
    linear, quadratic = re.findall(r"equation error (\S+) V", output)
    assert float(linear) > float(quadratic) > 0.05
    one_step, simulated = output.split("output errors, every fifth sample:")
    assert "falsified" in one_step and one_step.count("certified") == 4
    part, whole = (float(v) for v in re.findall(r"output error (\S+) V on", simulated))
    assert 0.3 < part < whole < 0.4  # 40 samples are among the 60
    assert simulated.count("certified\n") == 3 and "verified again from the data: yes" in simulated
    assert "readings outside the proved band of readings  0 of 20" in simulated
    fast, slow = (float(v) for v in re.search(r"between (\d+) and (\d+) s", simulated).groups())
    low, high = interval(simulated, "a1")
    # a level that decays with time constant T falls to exp(-25 / T) in 25 s
    assert np.exp(-25 / (fast - 1)) < -high + 1e-3 and np.exp(-25 / (slow + 1)) > -low - 1e-3


@pytest.mark.slow
def test_identify_sampling_rates(tmp_path: Path) -> None:
    output = run("identify_sampling_rates", tmp_path, "--output", str(tmp_path / "pictures"))
    assert (tmp_path / "pictures" / "sampling_rates.png").stat().st_size > 10_000
    lines = output.splitlines()
    covered = [k for k, line in enumerate(lines) if line[:5].strip()[:2] == "0."]
    truth = {"a1": 1.2, "a0": 2.0, "b1": 0.5, "b0": 2.0}
    widths = []
    for k in covered[::2]:  # delta covers the error, then delta = 0
        ends = re.findall(r"(\w\d) \[([-.\d]+), ([-.\d]+)\]", lines[k])
        assert [name for name, *_ in ends] == list(truth)
        assert all(float(low) - 5e-4 <= truth[n] <= float(high) + 5e-4 for n, low, high in ends)
        assert lines[k + 1].strip() == "the truth is inside"
        widths.append([float(high) - float(low) for _, low, high in ends])
    assert len(widths) == 3
    assert all(new < old for old, new in zip(widths[0], widths[2], strict=True))
    assert "the truth is lost" in output and "give delta >=" in output


# ---- README -----------------------------------------------------------------------------

BLOCKS = re.findall(r"^```python\n(.*?)^```", README, re.M | re.S)
COMMANDS = re.findall(r"^(?:sparsepop|setid) .*", README, re.M)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scratch copy of the examples, as the current folder."""
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_readme_code(number: int, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(BLOCKS[number], f"README.md block {number}", "exec"), {})
    printed = capsys.readouterr().out
    for promise in re.findall(r"print\(.*#\s+(\w+)$", BLOCKS[number], re.M):
        assert promise in printed


@pytest.mark.parametrize("command", COMMANDS)
def test_readme_commands(command: str, folder: Path) -> None:
    program, *arguments = shlex.split(command.split("#")[0])
    main = {"sparsepop": cli.main, "setid": setid_cli.main}[program]
    assert main(arguments) == cli.EXIT_PROVED


def test_readme_has_code_and_commands() -> None:
    assert len(BLOCKS) >= 2
    assert len(COMMANDS) >= 2


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", *ROOT.glob("docs/*.md")])
def test_links_lead_somewhere(page: str | Path) -> None:
    path = ROOT / page
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{path.name} links to {target}"


def test_identify_cascade(tmp_path: Path) -> None:
    output = run("identify_cascade", tmp_path, "--samples", "20")
    assert "verified: True" in output
    assert "verified after storing: True" in output
    assert "the true values are inside: True" in output
    assert output.count("certified") == 4


def test_identify_hammerstein(tmp_path: Path) -> None:
    output = run("identify_hammerstein", tmp_path, "--output", str(tmp_path / "pictures"))
    assert "refused: normalise" in output
    assert "proved" in output
    fit = float(output.split("fit ")[1].split(" %")[0])
    assert fit > 50.0
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert names == {"hammerstein_band.png", "hammerstein_diagram.png", "hammerstein_fit.png"}


def test_structs_from_identification(tmp_path: Path) -> None:
    """Rows of 12 terms, and what is proved by both ways holds the truth."""
    text = run("structs_from_identification", tmp_path)
    assert "12 terms each" in text
    rows = [line for line in text.splitlines() if re.match(r"[ab]\d ", line)]
    assert len(rows) == 5
    for row in rows:
        truth, low, high, first, last, left, right = numbers(row)
        assert low <= left <= first <= last <= right <= high or low <= first <= last <= high
        assert low <= truth <= high and left <= truth <= right


def test_neural_gradients(tmp_path: Path) -> None:
    """The gradient of a scalar recursion, t alpha^(t-1), and where stability is proved."""
    rows = [line.split() for line in run("neural_gradients", tmp_path).splitlines()]
    table = [row for row in rows if row and re.fullmatch(r"[01]\.\d\d", row[0])]
    for alpha, t, closed, *_ in table:
        assert float(closed) == pytest.approx(int(t) * float(alpha) ** (int(t) - 1), rel=1e-5)
    assert all(("stable," in row) == (float(row[0]) < 1) for row in table)


@pytest.mark.parametrize(
    "name", [pytest.param("control_hairdryer", marks=pytest.mark.slow), "neural_records"]
)
def test_records_of_control_and_neural(name: str, tmp_path: Path) -> None:
    assert numbers(run(name, tmp_path))


# ---- gallery ------------------------------------------------------------------------------------

GALLERY = sorted(p.stem for p in (EXAMPLES / "gallery").glob("*.py") if p.stem != "style")


def pictures(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*.svg")}


def test_the_gallery_shows_every_picture_in_both_schemes() -> None:
    page = (ROOT / "docs" / "gallery" / "README.md").read_text(encoding="utf-8")
    shown = re.findall(r"\]\((\w+)_(light|dark)\.svg#only-(light|dark)\)", page)
    assert all(scheme == only for _, scheme, only in shown)
    assert {f"{name}_{scheme}.svg" for name, scheme, _ in shown} == pictures(ROOT / "docs/gallery")
    assert [name for name in GALLERY if f"examples/gallery/{name}.py" not in page] == []


@pytest.mark.slow
def test_the_gallery_can_be_drawn_again(tmp_path: Path) -> None:
    for name in GALLERY:
        run(f"gallery/{name}", tmp_path, str(tmp_path / "drawn"))
    assert pictures(tmp_path / "drawn") == pictures(ROOT / "docs/gallery")


def test_a_picture_is_drawn_for_light_and_dark_pages(tmp_path: Path) -> None:
    """The quickest script runs with the fast tests."""
    run("gallery/feasible_set", tmp_path, str(tmp_path))
    assert pictures(tmp_path) == {"feasible_set_light.svg", "feasible_set_dark.svg"}


def test_a_report_from_a_file(tmp_path: Path) -> None:
    pytest.importorskip("jinja2")
    printed = run("identify_report", tmp_path, "--output", str(tmp_path))
    assert "the noise bounds hold on the part that was held out" in printed
    assert "read off this record" in printed and "sign of a1: proved up to" in printed
    page = (tmp_path / "hairdryer.html").read_text(encoding="utf-8")
    assert "Verified again for this page" in page
