"""The measurements run, say what they measured, and refuse wrong input by name."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks import runner
from benchmarks.__main__ import main
from benchmarks.errors import BenchmarkError
from benchmarks.measuring.measure import Setting, method
from benchmarks.measuring.records import PHASES, Row, read_rows
from benchmarks.measuring.registry import Case, Family, Registry, Selection, Task
from benchmarks.measuring.settings import options_from, switches, variants
from benchmarks.peers import environments
from benchmarks.peers import scip as peers
from benchmarks.problems import identification, random_problems, soundness
from benchmarks.problems.families import REGISTRY
from benchmarks.tables.groups import exponent, groups_of
from benchmarks.tables.report import report

PROBLEMS = Path(__file__).resolve().parents[2] / "examples" / "problems"


def tiny(name="tiny", size=None, seed=0):
    """min x^4 - 2 x^2 over [-2, 2]: -1 at +-1."""

    def make():
        (x,) = sp.variables(1)
        return Task.of(sp.Problem(x**4 - 2 * x**2, lower=-2, upper=2), -1.0)

    return Case(name, make, size, seed, {"order": 2})


def family(*cases):
    return Family("tinies", "one variable", lambda selection: cases)


# ---- the registry -----------------------------------------------------------------------


def test_the_registry_lists_all_families(capsys):
    assert main(["list"]) == 0
    shown = capsys.readouterr().out
    wanted = "oe eiv oe_positive eiv_positive block_structured channels identify "
    wanted += "identify-stable zoo certificates examples files pooling quartics box_programs "
    wanted += "maximum_cuts sensors power_flow broyden growth random"
    assert [f.name for f in REGISTRY] == wanted.split()
    for name in wanted.split():
        assert f"| {name} |" in shown


@pytest.mark.parametrize("name", ["zoo", "certificates", "examples", "pooling", "quartics"])
def test_every_family_yields_problems(name):
    cases = list(REGISTRY[name].chosen(Selection()))
    assert cases
    task = cases[0].make()
    assert len(task.objectives) == len(task.labels) == 1


def test_a_family_is_added_once():
    registry = Registry([family()])
    with pytest.raises(BenchmarkError, match="'tinies' is there already"):
        registry.add(family())


def test_haverly_is_what_the_literature_says():
    """The optimal flows of the first problem: 100 of b and 100 of c make 200 of y."""
    case = next(iter(REGISTRY["pooling"].chosen(Selection(names=("haverly1",)))))
    task = case.make()
    x = [0.0, 100.0, 0.0, 100.0, 0.0, 100.0, 1.0]
    assert task.problem.violation(x) == 0.0
    assert task.problem.objective(x) == task.optimum == -400.0


# ---- one family end to end --------------------------------------------------------------


def test_rows_of_our_own_solver():
    rows = list(runner.measure(family(tiny()), tiny(), Setting(("sparsepop_py",), repeats=2)))
    assert [row.repeat for row in rows] == [0, 1]
    for row in rows:
        assert (row.solver, row.status, row.proved) == ("sparsepop_py", "OPTIMAL", True)
        assert row.lower <= -1.0 <= row.upper
        assert row.gap <= 1e-6 and (row.closed, row.objectives) == (1, 1)
        assert row.valid and row.verified
        assert set(row.phases) == set(PHASES)
        counted = sum(s for name, s in row.phases.items() if name != "parse")
        assert counted == pytest.approx(row.cpu_seconds, rel=0.05, abs=5e-3)
        assert row.peak_mb > 1 and row.moments > 0 and row.certificate_bytes > 0


def test_rows_of_scip():
    rows = list(runner.measure(family(tiny()), tiny(), Setting(("scip",), repeats=1)))
    (row,) = rows
    assert row.solver == "SCIP" and not row.proved
    assert row.lower == pytest.approx(-1.0, abs=1e-5) and row.valid


def test_a_peer_that_runs_out_of_its_budget_says_so():
    case = next(iter(REGISTRY["quartics"].chosen(Selection(sizes=(8,)))))
    setting = Setting(("scip",), repeats=3, peer_limit=0.05)
    (row,) = runner.measure(REGISTRY["quartics"], case, setting)  # and is not asked again
    assert row.status == "budget: timelimit" and row.closed == 0


def test_a_peer_that_is_missing_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(environments, "FOLDER", tmp_path)
    monkeypatch.setattr(peers, "scip_is_installed", lambda: False)
    (row,) = runner.measure(family(tiny()), tiny(), Setting(("scip",), repeats=3))
    assert row.status == "missing" and "pip install pyscipopt" in row.notes[0]


def test_a_peer_that_breaks_off_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(environments, "FOLDER", tmp_path)

    class Broken:
        def optimize(self):
            raise Exception("SCIP: error in LP solver!")  # as pyscipopt does

    monkeypatch.setattr(peers, "_model", lambda *_: (Broken(), []))
    (row,) = runner.measure(family(tiny()), tiny(), Setting(("scip",), repeats=1))
    assert row.status == "error: RuntimeError: SCIP: error in LP solver!"


def test_a_crash_is_a_row():
    def crash(task):
        raise ZeroDivisionError("by zero")

    methods = {"default": method({"order": 2}), "crash": crash}
    good, bad = runner.rows_of_methods(family(), tiny(), methods, 1e-6, 1)
    assert good.status == "OPTIMAL" and bad.status == "error: ZeroDivisionError: by zero"
    assert bad.closed == 0 and math.isinf(bad.gap)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no child processes")
def test_the_death_of_a_process_is_a_row():
    def make():
        os.kill(os.getpid(), signal.SIGKILL)

    cases = (Case("deadly", make), tiny())
    dead, alive = runner.run([family(*cases)], Selection(), Setting(("sparsepop_py",), 1))
    assert (dead.problem, dead.status) == ("deadly", "error: killed by SIGKILL")
    assert (alive.problem, alive.status) == ("tiny", "OPTIMAL")


def test_run_writes_lines_that_report_reads(tmp_path, capsys):
    lines = tmp_path / "run.jsonl"
    command = ["run", "examples", "--names", "quartic", "--repeat", "1", "--output", str(lines)]
    assert main([*command, "--solvers", "sparsepop_py"]) == 0
    assert "| quartic | 0 | sparsepop_py | OPTIMAL | 1/1 |" in capsys.readouterr().out
    fields = json.loads(lines.read_text())
    assert set(fields) == {f.name for f in dataclasses.fields(Row)}
    assert fields["commit"] and fields["family"] == "examples"
    packages = {"python", "numpy", "scipy", "clarabel", "highspy", "pyscipopt", "sparsepop_py"}
    assert set(fields["versions"]) == packages
    folder = tmp_path / "report"
    assert main(["report", str(lines), "--output", str(folder)]) == 0
    text = (folder / "report.md").read_text()
    assert "## examples" in text and "| quartic | 2 | 1 | sparsepop_py |" in text
    assert (folder / "examples_phases.png").read_bytes()[:4] == b"\x89PNG"


def test_report_reads_what_run_wrote_last(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.__main__._RESULTS", tmp_path)
    assert main(["report", "--no-plots"]) == 2
    assert f"{tmp_path / 'run.jsonl'}: cannot be read" in capsys.readouterr().err


def test_growth_builds_without_solving(tmp_path):
    lines = tmp_path / "growth.jsonl"
    command = ["run", "growth", "--sizes", "20", "40", "--repeat", "1", "--output", str(lines)]
    assert main(command) == 0
    rows = list(read_rows([lines]))
    assert [(row.status, row.size) for row in rows] == [("built", 20), ("built", 40)] * 2
    assert all(row.moments > 0 and row.phases["relax"] >= 0 for row in rows)


# ---- reports ----------------------------------------------------------------------------


def row(**changes):
    base = Row("f", "p", 10, 0, 0, "sparsepop_py", "OPTIMAL", cpu_seconds=1.0, closed=1)
    return dataclasses.replace(base, **changes)


def test_rows_survive_json():
    before = row(lower=-math.inf, notes=("a | b",), phases={"solve": 1.0}, details=({"x": 1.0},))
    after = Row.from_json(before.to_json())
    assert after.to_json() == before.to_json()
    assert math.isnan(after.upper) and after.lower == -math.inf and after.gap == math.inf
    assert after.notes == ("a | b",) and after.optimum is None


def test_medians_over_repetitions_then_seeds():
    seconds = {(0, 0): 1.0, (0, 1): 9.0, (0, 2): 2.0, (1, 0): 4.0, (2, 0): 3.0}
    rows = [row(seed=s, repeat=k, cpu_seconds=t) for (s, k), t in seconds.items()]
    (group,) = groups_of(rows)
    assert group.middle("cpu_seconds") == 3.0  # of 2, 4, 3


def test_the_exponent_is_the_slope():
    rows = [row(size=n, problem=f"p n={n}", cpu_seconds=2e-6 * n**1.5) for n in (10, 100, 1000)]
    assert exponent(groups_of(rows)) == pytest.approx(1.5)
    assert "| 1.50 |" in report(rows)


def test_the_report_compares_with_a_peer():
    text = report([row(), row(solver="SCIP", status="budget: timelimit", cpu_seconds=4.0)])
    assert "| p | SCIP | 1 | 4 | 4 |" in text and "budget: timelimit" in text


# ---- orders -----------------------------------------------------------------------------


def test_orders_of_a_file(tmp_path, capsys):
    file = str(PROBLEMS / "quartic.gms")
    command = ["orders", file, "--orders", "1", "2", "--sparse", "both", "--output", str(tmp_path)]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "proved bound" in shown and "attained value" in shown
    rows = list(read_rows([tmp_path / "orders.jsonl"]))
    assert [(r.size, r.variant) for r in rows] == [
        (1, "sparse"), (1, "dense"), (2, "sparse"), (2, "dense"),
    ]  # fmt: skip
    assert all(r.lower <= -5.61583462 and r.moments > 0 for r in rows)
    assert (tmp_path / "orders_quartic.png").read_bytes()[:4] == b"\x89PNG"


# ---- identification ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["oe", "eiv"])
def test_the_true_parameters_explain_the_record(kind):
    data = identification.record(kind, 12, 5.0, seed=3)
    clean_u = 2 * np.random.RandomState(5492).random_sample(12) - 1  # the first draw is the input
    a1, a2, b0, b1, b2 = identification.THETA
    y = np.zeros(12)
    for k in range(12):
        past = [y[k - 1] if k > 0 else 0, y[k - 2] if k > 1 else 0]
        old = [clean_u[k - 1] if k > 0 else 0, clean_u[k - 2] if k > 1 else 0]
        y[k] = -a1 * past[0] - a2 * past[1] + b0 * clean_u[k] + b1 * old[0] + b2 * old[1]
    eta, xi = data.y - y, data.u - clean_u
    assert np.abs(eta).max() <= 5.0 and np.abs(xi).max() <= (0.05 if kind == "eiv" else 1e-15)
    task = identification.task(kind, 12, 5.0, seed=3)
    x = np.concatenate([identification.THETA, eta, xi if kind == "eiv" else []])
    assert task.problem.violation(x) <= 1e-9
    assert task.problem.dimension == (17 if kind == "oe" else 29)
    assert len(task.objectives) == 10 and task.pairs
    values = [p(x) for p in task.objectives]
    assert values[2:4] == [identification.THETA[1], -identification.THETA[1]]


def test_records_are_refused_by_field():
    for arguments, name in ((("arx", 20), "kind"), (("oe", 2), "samples"), (("oe", 9, 0), "noise")):
        with pytest.raises(BenchmarkError, match=name):
            identification.record(*arguments)


# ---- random problems --------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(10))
def test_samples_are_feasible(seed):
    made = random_problems.random_problem(seed)
    points, values = random_problems.samples(made, seed)
    assert np.array_equal(points[0], made.planted)
    for x, value in list(zip(points, values, strict=True))[:20]:
        assert made.problem.violation(x) == 0.0 and made.problem.objective(x) == value


def test_a_wrong_bound_is_found():
    made = random_problems.random_problem(0)
    result = sp.solve(made.problem, sp.Options(time_limit=20))
    assert list(soundness.findings(made, result, 0)) == []
    least = random_problems.samples(made, 0)[1].min()
    wrong = dataclasses.replace(result, lower_bound=float(least) + 1.0)
    assert any("is above the attained" in text for text in soundness.findings(made, wrong, 0))
    empty = dataclasses.replace(result, status=sp.Status.INFEASIBLE)
    assert "INFEASIBLE, but a point is feasible" in list(soundness.findings(made, empty, 0))
    claim = peers.Answer("optimal", result.upper_bound + 1.0, math.inf, None, 0.0, 0.0)
    assert list(soundness.disagreements(result, claim))


def test_damage_changes_one_place():
    thing = (1.0, np.arange(3.0), Task)
    for seed in range(20):
        forged, place = soundness.damaged(thing, np.random.default_rng(seed))
        changed = [not np.array_equal(a, b) for a, b in zip(thing[:2], forged[:2], strict=True)]
        assert place in ("[0]", "[1]")
        assert sum(changed) <= 1 and forged[2] is Task


# ---- switches and wrong input -----------------------------------------------------------


def test_variants_switch_one_thing_off():
    assert "sparse" in list(switches()) and "progress" not in list(switches())
    found = variants({"order": 2}, ["sparse"], ["plain:effort=plain,refine=none"])
    assert list(found) == ["default", "no sparse", "plain"]
    assert options_from(found["no sparse"]) == sp.Options(order=2, sparse=False)
    assert options_from(found["plain"]) == sp.Options(order=2, effort="plain", refine="none")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("run nowhere", "family: found 'nowhere'"),
        ("run zoo --solvers cplex", "--solvers: found 'cplex'"),
        ("run zoo --repeat 0", "--repeat: found 0"),
        ("run zoo --peer-limit 0", "--peer-limit: found 0"),
        ("run oe --sizes 0", "--sizes: found 0"),
        ("run zoo --seeds -1", "--seeds: found -1"),
        ("run random --count 0", "--count: found 0"),
        ("run files", "--files: found none"),
        ("run zoo --names no-such-problem", "--names: nothing is selected"),
        ("run zoo --set colour=red", "Options.colour: no such field"),
        ("run zoo --set order", "setting: found 'order'"),
        ("run zoo --gap -1", "Options.gap: found -1.0"),
        ("ablation zoo --switches colour", "--switches: found 'colour'"),
        ("ablation growth", "family: 'growth' solves nothing"),
        ("ablation zoo --variant plain", "--variant: found 'plain'"),
        ("orders nowhere.gms", "FILE: found 'nowhere.gms'"),
        (f"orders {PROBLEMS / 'quartic.gms'} --orders 0", "Options.order: found 0"),
        ("report nowhere.jsonl", "nowhere.jsonl: cannot be read"),
    ],
)
def test_wrong_input_is_named(command, message, tmp_path, capsys):
    words = command.split()
    extra = ["--output", str(tmp_path / "out")] if words[0] != "list" else []
    assert main([*words, *extra]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{", "line 1: found no JSON"),
        ("[]", "line 1: found list"),
        ("{}", "the field 'family' is missing"),
        (row().to_json()[:-1] + ', "colour": 1}', "found the field 'colour'"),
        (row().to_json().replace('"cpu_seconds": 1.0', '"cpu_seconds": "x"'), "cpu_seconds: found"),
    ],
)
def test_lines_that_are_no_rows_are_named(line, message, tmp_path, capsys):
    path = tmp_path / "wrong.jsonl"
    path.write_text(line + "\n")
    assert main(["report", str(path), "--output", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
