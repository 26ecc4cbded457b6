"""Peers in interpreters of their own, how they are judged, and what is measured together."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sparsepop_py as sp
from benchmarks import runner
from benchmarks.__main__ import main
from benchmarks.errors import BenchmarkError
from benchmarks.measuring import measure
from benchmarks.measuring.measure import Setting
from benchmarks.measuring.records import Row, read_rows, write_row
from benchmarks.measuring.registry import Case, Family, Selection, Task
from benchmarks.peers import environments
from benchmarks.peers.elsewhere import Stops, ask, task_of
from benchmarks.peers.environments import PEERS, interpreter, make, may_be_published, peer
from benchmarks.peers.scip import Answer
from benchmarks.problems.families import REGISTRY
from benchmarks.tables.curves import gaps_over_time, profile, speed_ups
from benchmarks.tables.groups import groups_of
from benchmarks.tables.report import publishable, report

ROOT = Path(__file__).resolve().parents[2]
ADAPTERS = Path(environments.__file__).parent / "adapters"


def bilinear():
    """Least x y on [-1, 1]^2 with x + y >= 1: both are then at least 0, so it is 0 at (0, 1)."""
    x, y = sp.variables(2)
    return sp.Problem(x * y, [x + y - 1 >= 0], lower=-1, upper=1)


def case(problem=None):
    return Case("bilinear", lambda: Task.of(problem or bilinear(), 0.0))


def family():
    return Family("bilinears", "for tests", lambda _: [case()], options={"order": 1})


def row(solver, seconds, closed=1, problem="p", **more):
    return Row(
        "f", problem, None, 0, 0, solver, "optimal", cpu_seconds=seconds, closed=closed, **more
    )


# ---- an interpreter of its own ----------------------------------------------------------


def test_scip_answers_from_an_interpreter_of_its_own():
    pytest.importorskip("pyscipopt")
    problem, stops = bilinear(), Stops((1e-6,), 0.0, 10.0)
    (found,) = ask(peer("scip"), Path(sys.executable), problem, [problem.objective], stops)
    assert found.status in ("optimal", "gaplimit")
    assert found.lower == pytest.approx(0.0, abs=1e-5) == found.upper
    assert problem.violation(found.x) <= 1e-6


@pytest.mark.parametrize("name", ["sdpa", "csdp"])
def test_conic_programs_are_solved_or_refused(name):
    """The relaxation of order 1 proves nothing above the minimum, 0."""
    problem, stops = bilinear(), Stops((1e-6,), 0.0, 10.0)
    (found,) = ask(peer(name), Path(sys.executable), problem, [problem.objective], stops)
    if found.status != f"refused: {peer(name).title} is not installed":
        assert found.status in ("solved", "almost") and found.lower <= 1e-5
        relaxed = sp.solve(problem, sp.Options(order=1, effort="plain")).lower_bound
        assert found.lower == pytest.approx(relaxed, abs=1e-5)


@pytest.mark.octave
def test_the_folder_of_sparsepop_is_asked_under_octave(monkeypatch):
    """Our own sparsePOP.m stands in for the original, which has the same interface."""
    if shutil.which("octave-cli") is None:
        pytest.skip("GNU Octave is not installed")
    monkeypatch.setenv("SPARSEPOP", str(ROOT / "matlab"))
    monkeypatch.setenv("SPARSEPOP_PYTHON", sys.executable)
    problem, stops = bilinear(), Stops((1e-6,), 0.0, 60.0, order=2)
    (found,) = ask(peer("sparsepop"), Path(sys.executable), problem, [problem.objective], stops)
    assert found.status == "solved" and found.lower == pytest.approx(0.0, abs=1e-5)
    assert found.upper == pytest.approx(0.0, abs=1e-5) and problem.violation(found.x) <= 1e-6


def test_sparsepop_without_its_folder_is_refused(monkeypatch):
    monkeypatch.delenv("SPARSEPOP", raising=False)
    problem, stops = bilinear(), Stops((1e-6,), 0.0, 10.0)
    (found,) = ask(peer("sparsepop"), Path(sys.executable), problem, [problem.objective], stops)
    assert found.status == "refused: SPARSEPOP names no folder that has SparsePOP and SeDuMi"


def test_two_objectives_come_back_in_order():
    pytest.importorskip("pyscipopt")
    problem, (x, y) = bilinear(), sp.variables(2)
    low, high = ask(
        peer("scip"), Path(sys.executable), problem, [x + 2 * y, -x - y], Stops((1e-6,) * 2, 0, 10)
    )
    # least x + 2 y with x + y >= 1 is 1 at (1, 0); least -x - y is -2 at (1, 1)
    assert low.upper == pytest.approx(1.0, abs=1e-5)
    assert high.upper == pytest.approx(-2.0, abs=1e-5)


def test_an_adapter_that_cannot_begin_says_why(monkeypatch, tmp_path):
    problem, broken = bilinear(), replace(peer("scip"), adapter="nothing.py")
    (found,) = ask(
        broken, Path(sys.executable), problem, [problem.objective], Stops((1e-6,), 0.0, 1.0)
    )
    assert found.status.startswith("error: ") and "nothing.py" in found.status
    assert found.lower == -np.inf and found.upper == np.inf


def test_a_missing_interpreter_is_an_answer(tmp_path):
    problem = bilinear()
    (found,) = ask(
        peer("maingo"), tmp_path / "python", problem, [problem.objective], Stops((1.0,), 0.0, 1.0)
    )
    assert found.status.startswith("error: ")


def test_a_task_says_the_problem_without_the_package():
    problem = bilinear()
    task = json.loads(json.dumps(task_of(peer("gurobi"), problem, [problem.objective])))
    assert task["lower"] == [-1, -1] and task["n"] == 2 and task["order"] == 1
    assert task["objectives"] == [[[1.0, [0, 1]]]]
    (only,) = task["rows"]
    assert not only["equal"]
    assert sorted(map(tuple, ((c, *v) for c, v in only["terms"]))) == [(-1.0,), (1.0, 0), (1.0, 1)]


def test_conic_peers_get_the_program_of_the_relaxation():
    problem = bilinear()
    (program,) = task_of(peer("scs"), problem, [problem.objective], 2)["programs"]
    relaxation = sp.relax(problem, 2)
    assert len(program["q"]) == relaxation.moments.shape[0]
    assert len(program["b"]) == relaxation.rows
    assert sum(s * (s + 1) // 2 for s in program["psd"]) + program["zero"] + program[
        "nonnegative"
    ] == len(program["b"])


def test_every_peer_has_an_adapter_and_a_licence():
    for each in PEERS.values():
        assert (ADAPTERS / each.adapter).exists() and each.licence
        assert each.packages or each.adapter == "octave.py"
        compile((ADAPTERS / each.adapter).read_text(encoding="utf-8"), each.adapter, "exec")


def test_environments_that_are_not_made_are_missing(tmp_path):
    assert interpreter(peer("gurobi"), tmp_path) is None
    (tmp_path / "gurobi" / "bin").mkdir(parents=True)
    (tmp_path / "gurobi" / "bin" / "python").touch()
    assert interpreter(peer("gurobi"), tmp_path) is None  # its installation was broken off
    (tmp_path / "gurobi" / "ready").touch()
    assert interpreter(peer("gurobi"), tmp_path) is not None
    assert list(make(["gurobi"], tmp_path)) == ["gurobi: there already"]


def test_unknown_peers_are_refused():
    with pytest.raises(BenchmarkError, match="found 'cplex', expected one of scip"):
        peer("cplex")
    with pytest.raises(BenchmarkError, match="--solvers: found 'cplex'"):
        list(runner.run([family()], Selection(), Setting(("cplex",))))


def test_a_peer_that_refuses_is_a_row_and_not_asked_again(monkeypatch, tmp_path):
    refused = [Answer("refused: too large", -np.inf, np.inf, None, 0.0, 0.0)]
    monkeypatch.setattr(measure, "ask", lambda *_: refused)
    monkeypatch.setattr(environments, "interpreter", lambda _: Path(sys.executable))
    setting = Setting(("gurobi",), repeats=3)
    (found,) = runner.measure(family(), case(), setting)
    assert (found.solver, found.status, found.closed) == ("Gurobi", "refused: too large", 0)


# ---- exact judgement --------------------------------------------------------------------


def test_points_below_a_proved_bound_are_named_exactly(monkeypatch):
    """x y = -2^-40 at (-2^-40, 1), which violates x + y >= 1 by 2^-40."""
    point = np.array([-(2.0**-40), 1.0])
    claimed = [Answer("optimal", 0.5, -(2.0**-40), point, 0.0, 0.1)]
    monkeypatch.setattr(measure, "ask", lambda *_: claimed)
    monkeypatch.setattr(environments, "interpreter", lambda _: Path(sys.executable))
    own = {"label": "objective", "lower": 0.0, "upper": 0.0}
    known = row("sparsepop_py", 1.0, details=(own,))
    (found,) = measure.peer_rows(family(), case(), known, 1e-6, Setting(repeats=1), "gurobi")
    assert found.violation == 2.0**-40
    assert found.notes == (
        "objective: its bound lies 5.0e-01 above an attained value",
        "objective: its point lies 9.1e-13 below a proved bound",
    )


def test_points_outside_bounds_violate_them(monkeypatch):
    outside = [Answer("optimal", 0.0, 0.0, np.array([0.0, 1.25]), 0.0, 0.1)]
    monkeypatch.setattr(measure, "ask", lambda *_: outside)
    monkeypatch.setattr(environments, "interpreter", lambda _: Path(sys.executable))
    (found,) = measure.peer_rows(family(), case(), None, 1e-6, Setting(repeats=1), "gurobi")
    assert found.violation == 0.25


# ---- what is stored ---------------------------------------------------------------------


def test_stored_rows_are_not_measured_again(tmp_path, capsys):
    words = ["run", "pooling", "--names", "haverly1", "--repeat", "1", "--resume"]
    words += ["--solvers", "sparsepop_py", "--output", str(tmp_path / "rows.jsonl")]
    assert main(words) == 0 and main(words) == 0
    assert "nothing is left to measure" in capsys.readouterr().out
    (found,) = read_rows([tmp_path / "rows.jsonl"])
    assert found.details[0]["trace"] and found.wall_seconds > 0


def test_figures_that_licences_forbid_stay_out_of_reports(tmp_path, capsys):
    assert not may_be_published("Gurobi") and not may_be_published("Xpress")
    path = tmp_path / "rows.jsonl"
    for name in ("sparsepop_py", "Gurobi", "SCIP"):
        write_row(row(name, 1.0), path)
    kept, left_out = publishable(list(read_rows([path])))
    assert [each.solver for each in kept] == ["sparsepop_py", "SCIP"] and left_out == ["Gurobi"]
    assert main(["report", str(path), "--no-plots", "--output", str(tmp_path)]) == 0
    assert "Gurobi" not in (tmp_path / "report.md").read_text(encoding="utf-8")
    more = ["report", str(path), "--no-plots", "--unpublished", "--output", str(tmp_path)]
    assert main(more) == 0
    assert "Gurobi" in (tmp_path / "report.md").read_text(encoding="utf-8")


def test_a_profile_is_that_of_dolan_and_more():
    rows = [row("A", 1.0), row("B", 4.0), row("A", 6.0, problem="q"), row("B", 2.0, problem="q")]
    rows += [row("A", 1.0, problem="r"), row("B", 1.0, 0, problem="r"), row("C", 1.0, 0)]
    assert profile(groups_of(rows)) == {"A": [1.0, 1.0, 3.0], "B": [1.0, 4.0, np.inf]}
    assert "| A | 67 % | 67 % | 100 % |" in report(rows)


def test_speed_ups_are_ratios_of_wall_times():
    alone = row("sparsepop_py", 8.0, wall_seconds=8.0)
    two = row("sparsepop_py", 4.0, wall_seconds=5.0, variant="2 workers")
    assert speed_ups(groups_of([alone, two])) == {"p": {2: 1.6}}
    assert speed_ups(groups_of([alone, replace(two, closed=0)])) == {}
    assert "| p | 1.6 |" in report([alone, two])


def test_gaps_follow_the_trace():
    detail = {"trace": [[1.0, -3.0, 1.0], [2.5, 0.0, 1.0]]}
    (gap,) = gaps_over_time(groups_of([row("sparsepop_py", 3.0, upper=1.0, details=(detail,))]))
    assert (gap.seconds, gap.gaps) == ((1.0, 2.5), (4.0, 1.0))


def test_pictures_of_peers_traces_and_workers(tmp_path):
    pytest.importorskip("matplotlib")
    detail = {"trace": [[1.0, -3.0, 1.0], [2.5, 0.0, 1.0]]}
    ours = row("sparsepop_py", 3.0, upper=1.0, details=(detail,), wall_seconds=3.0)
    two = row("sparsepop_py", 2.0, wall_seconds=2.0, variant="2 workers")
    path = tmp_path / "rows.jsonl"
    for each in (ours, two, row("SCIP", 1.0)):
        write_row(each, path)
    assert main(["report", str(path), "--output", str(tmp_path)]) == 0
    assert {"f_profile.png", "f_gaps.png", "f_speed_up.png"} <= {p.name for p in tmp_path.iterdir()}


# ---- a smoke run of each family ---------------------------------------------------------


@pytest.mark.parametrize("name", [f.name for f in REGISTRY if f.name != "files"])
def test_each_family_runs(name):
    chosen = REGISTRY[name]
    # the first pooling, zoo and example problem; the smallest of what has sizes
    sizes = {"growth": (50,), "broyden": (20,), "quartics": (3,)}.get(name, (12,))
    selection = Selection(sizes=sizes, noises=(1.0,), count=1)
    setting = Setting(("sparsepop_py",), repeats=1, options={"time_limit": 0.2})
    first = next(iter(chosen.chosen(selection)))
    rows = list(runner.measure(chosen, first, setting))
    assert rows and all(each.family == name for each in rows)
    assert not [each.status for each in rows if each.status.startswith("error")]
    assert all(each.verified is not False for each in rows)
