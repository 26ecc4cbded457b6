"""Studies: what is stored, what is refused, and that nothing is lost or done twice."""

from __future__ import annotations

import json
import os
import pickle
import signal
import sqlite3
import subprocess
import sys
import time
import zlib
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from math import nextafter
from pathlib import Path
from typing import Any

import pytest

import setid
import sparsepop_py as sp
from setid.result.json_ import to_json
from sparsepop_py.cli import main
from sparsepop_py.errors import FormatError, OutputError, ProblemError
from sparsepop_py.executors import dispatch
from sparsepop_py.executors.processes import Processes
from sparsepop_py.study.content import dump, fingerprint, load

# minimise x^2 - 2 c x on [0, 20]: -c^2, where x = c
CENTRES = tuple(range(1, 13))


def square(centre: float) -> sp.Problem:
    (x,) = sp.variables(1)
    return sp.Problem(x**2 - 2 * centre * x, lower=0, upper=20)


def squares(path: Path, centres: tuple[int, ...] = CENTRES) -> sp.Study:
    study = sp.Study(path)
    study.add_all([(f"centre {c}", square(c), None, {"centre": c}) for c in centres])
    return study


def check(study: sp.Study, centres: tuple[int, ...] = CENTRES) -> None:
    table = study.table()
    assert [row["centre"] for row in table] == list(centres)
    for row in table:
        assert row["lower_bound"] <= -(row["centre"] ** 2) <= row["upper_bound"]
        assert row["upper_bound"] - row["lower_bound"] <= 1e-6 * row["centre"] ** 2


# ---- kill -9 -------------------------------------------------------------------------------------

CHILD = """
import sys
sys.path[:0] = {paths!r}
from test_study import squares
squares({path!r}).run(workers={workers})
"""


def start(path: Path, workers: int | None) -> subprocess.Popen[bytes]:
    code = CHILD.format(paths=[str(Path(__file__).parent)], path=str(path), workers=workers)
    return subprocess.Popen([sys.executable, "-c", code], env=environment())


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def kill_after(path: Path, child: subprocess.Popen[bytes], done: int) -> None:
    """Kill a child when so many tasks have outcomes (or when it has ended by itself)."""
    while child.poll() is None:
        try:
            if sp.Study(path).status().done >= done:
                break
        except OutputError:  # it is just being made
            pass
        time.sleep(0.002)
    child.kill()
    child.wait()


def outlive_kills(tmp_path: Path, kills: int, workers: int | None) -> None:
    undisturbed = squares(tmp_path / "undisturbed.study")
    undisturbed.run()
    path, kept = tmp_path / "killed.study", {}
    for number in range(kills):
        child = start(path, workers)
        kill_after(path, child, 1 + number * (len(CENTRES) - 1) // kills)
        rows = [row for row in sp.Study(path).table(timings=True) if row["status"] != "waiting"]
        found = {row["name"]: row["seconds"] for row in rows}
        assert kept.items() <= found.items()  # nothing is lost, nothing was solved again
        assert all(sp.Study(path).result(name).certificate is not None for name in found)
        kept = found
    assert 0 < len(kept) <= len(CENTRES)
    study = squares(path)
    assert study.run().finished
    assert study.table() == undisturbed.table()
    again = {row["name"]: row["seconds"] for row in study.table(timings=True)}
    assert kept.items() <= again.items()
    check(study)


def test_a_study_that_is_killed_ends_with_the_same_table(tmp_path: Path) -> None:
    outlive_kills(tmp_path, 2, None)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [None, 2])
def test_a_study_that_is_killed_ten_times_ends_with_the_same_table(
    tmp_path: Path, workers: int | None
) -> None:
    outlive_kills(tmp_path, 10, workers)


# ---- workers and executors -----------------------------------------------------------------------


def test_results_do_not_depend_on_the_workers(tmp_path: Path) -> None:
    """Effort auto learns from clocks, but not in a study."""
    tables = []
    for name, workers in (("one", None), ("two", 2)):
        study = sp.Study(tmp_path / f"{name}.study")
        quartic = sp.problems.random_quartic(4, seed=1)
        study.add("quartic", quartic, sp.Options(effort="auto", node_limit=4))
        study.add("square", square(2))
        study.run(workers)
        tables.append(study.table())
    assert tables[0] == tables[1]
    assert [row["status"] for row in tables[0]] != ["failed", "failed"]


class LosesTheFirst(ThreadPoolExecutor):
    """Loses the workers of the first tasks, as clusters do."""

    def __init__(self, losses: int) -> None:
        super().__init__(1)
        self.losses = losses

    def submit(self, function, /, *arguments, **named):
        self.losses -= 1
        return super().submit(_lost if self.losses >= 0 else function, *arguments, **named)


def _lost(job: object) -> None:
    from sparsepop_py.executors.processes import WorkerLost

    raise WorkerLost("its machine is gone")


def test_tasks_of_lost_workers_are_submitted_again(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1, 2))
    with LosesTheFirst(3) as executor:
        status = study.run(executor=executor)
    assert (status.done, status.failed) == (2, 0)
    check(study, (1, 2))


def test_a_task_that_always_loses_its_worker_is_given_up(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1,))
    with LosesTheFirst(100) as executor:
        assert study.run(executor=executor).failed == 1
    assert study.table()[0]["status"] == "lost"
    assert "3 times (its machine is gone)" in study.table()[0]["message"]
    assert study.run().failed == 1  # not tried again
    assert study.run(retry=True).failed == 0
    check(study, (1,))


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_broken_process_pool_is_replaced(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1, 2, 3))
    with ProcessPoolExecutor(1) as executor:
        os.kill(executor.submit(os.getpid).result(), signal.SIGKILL)
        status = study.run(executor=executor)
    assert (status.done, status.failed) == (3, 0)
    check(study, (1, 2, 3))


# ---- interrupts ----------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupt_stores_nothing_of_the_task_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A solve that is interrupted returns what is proved so far, which is half a result."""
    study = squares(tmp_path / "squares.study", (1, 2, 3))
    study.add("other", sp.parse("min x1^2"))
    # a shell may start background jobs with this signal ignored
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def solve(problem: sp.Problem, options: sp.Options) -> sp.Result:
        if problem.fingerprint == square(2).fingerprint:
            try:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(60)
            except KeyboardInterrupt:
                pass
        return sp.solve(problem, options)

    with monkeypatch.context() as patched:
        patched.setattr(sp.Study, "work", replace(sp.Study.work, run=solve))
        try:
            status = study.run()
        finally:
            signal.signal(signal.SIGINT, before)
    assert (status.done, status.failed, status.waiting) == (1, 0, 3)
    assert study.table()[1]["status"] == "waiting"
    assert study.table()[1]["lower_bound"] is None
    assert study.run().finished


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupt_ends_the_processes_of_a_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tasks that are at work are not waited for."""
    stopped = []

    class Hanging(Processes):
        def submit(self, fn: Any, /, *given: Any, **named: Any) -> Future[Any]:
            os.kill(os.getpid(), signal.SIGINT)
            return Future()

        def stop(self) -> None:
            stopped.append(True)
            super().stop()

    study = squares(tmp_path / "squares.study", (1, 2, 3))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(dispatch, "Processes", Hanging)
    try:
        status = study.run(workers=2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert stopped and status.waiting == 3 and not status.running


# ---- one writer ----------------------------------------------------------------------------------


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1, 2))
    other = sp.Study(study.path)
    refused = []

    def interfere(status: sp.StudyStatus) -> None:
        for act in (lambda: other.add("more", square(3)), other.run):
            with pytest.raises(OutputError, match=f"another writer .*process {os.getpid()}"):
                act()
            refused.append(True)
        assert other.status().running and len(other.table()) == 2  # reading is allowed

    study.run(on_progress=interfere)
    assert len(refused) == 4
    assert not other.status().running
    other.add("more", square(3))
    assert other.run().done == 3


# ---- what is stored ------------------------------------------------------------------------------


def test_a_writer_by_another_link_is_refused(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1,))
    (tmp_path / "link.study").symlink_to(study.path)
    with study._store.writing():
        assert sp.Study(tmp_path / "link.study").status().running
        with pytest.raises(OutputError, match="found another writer"):
            sp.Study(tmp_path / "link.study").run()


def test_names_stand_for_one_task(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1,))
    study.add("centre 1", square(1), tags={"centre": 1})  # the same again
    with pytest.raises(ProblemError, match="found 'centre 1', which is another task"):
        study.add("centre 1", square(2), tags={"centre": 1})
    with pytest.raises(ProblemError, match="which is another task"):
        study.add("centre 1", square(1), sp.Options(order=3), tags={"centre": 1})
    with pytest.raises(ProblemError):  # all or none
        study.add_all([("new", square(3), None, None), ("centre 1", square(2), None, None)])
    assert study.status().total == 1


def test_a_task_that_raises_fails_alone(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1,))
    study.add("wrong", square(1), sp.Options(branch_on=[7]))
    status = study.run()
    assert (status.done, status.failed) == (1, 1)
    row = study.table()[1]
    assert (row["status"], row["lower_bound"]) == ("failed", None)
    assert row["message"].startswith("ProblemError: Options.branch_on: found 7")
    with pytest.raises(ProblemError, match="which failed: ProblemError"):
        study.result("wrong")


def test_results_come_back_with_their_proofs(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1, 2))
    with pytest.raises(ProblemError, match="no result yet"):
        study.result("centre 1")
    with pytest.raises(ProblemError, match="found 'nobody'"):
        study.result("nobody")
    study.run()
    result = sp.Study(study.path).result("centre 2")
    assert result.certificate.verify(square(2)).ok and -4 <= result.upper_bound
    (first, second) = study.export_results(tmp_path / "results")
    assert first.name == "centre_1-1.json"
    assert sp.read_json(second).lower_bound == result.lower_bound <= -4


def test_each_result_has_a_file_of_its_own(tmp_path: Path) -> None:
    """Number 1 would be ``a_b-1``, which is the name of number 2 and, with ``_``, of number 3."""
    study = sp.Study(tmp_path / "names.study")
    for centre, name in enumerate(("a b", "a_b-1", "a_b-1_"), 1):
        study.add(name, square(centre))
    study.run()
    written = study.export_results(tmp_path / "results")
    assert [path.name for path in written] == ["a_b-1__.json", "a_b-1.json", "a_b-1_.json"]
    for centre, path in enumerate(written, 1):
        assert sp.read_json(path).problem.fingerprint == square(centre).fingerprint


def test_a_result_that_claims_too_much_is_refused(tmp_path: Path) -> None:
    study = squares(tmp_path / "squares.study", (1,))
    study.run()
    found = json.loads(sp.to_json(study.result("centre 1")))
    found["result"]["lower_bound"] = -0.9
    write(study, zlib.compress(json.dumps(found).encode()))
    with pytest.raises(ProblemError, match=r"lower_bound: found -0\.9"):
        study.result("centre 1")
    write(study, b"no such content")
    with pytest.raises(FormatError, match="damaged content"):
        study.result("centre 1")


def test_rows_that_were_changed_are_refused(tmp_path: Path) -> None:
    """One digit of a bound in the table, which no certificate holds."""
    study = squares(tmp_path / "squares.study", (1,))
    study.run()
    db = sqlite3.connect(study.path)
    (text,) = db.execute("SELECT rows FROM outcomes").fetchone()
    with db:
        db.execute("UPDATE outcomes SET rows = ?", (text.replace("4", "3", 1),))
    db.close()
    with pytest.raises(FormatError, match=r"squares\.study: found a damaged file"):
        study.table()


@pytest.mark.parametrize(
    "change",
    [
        "outcomes SET rows = substr(rows, 17, 5)",
        "outcomes SET rows = '[]'",
        "outcomes SET rows = '[1]'",
        "outcomes SET rows = '{}'",
        "outcomes SET state = 'proved'",
        "outcomes SET state = x'646f6e65'",
        "outcomes SET seconds = 'long'",
        "tasks SET name = x'00'",
        "tasks SET tags = '[1]'",
        """meta SET value = '[["status"]]' WHERE key = 'columns'""",
    ],
)
def test_cells_of_another_type_are_damage(tmp_path: Path, change: str) -> None:
    """They once ended in a TypeError, also with the first version, which has no checksums."""
    path = squares(tmp_path / "squares.study", (1,)).path
    squares(path, (1,)).run()
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("PRAGMA user_version = 1")
        db.execute("UPDATE outcomes SET rows = substr(rows, 17)")
        db.execute(f"UPDATE {change}")
    with pytest.raises(FormatError, match=r"squares\.study: found a damaged file"):
        sp.Study(path).table()


def test_damaged_names_of_tables_are_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.study"
    sp.Study(path)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"CREATE TABLE outcomes", b"CREATE\xd9TABLE outcomes"))
    with pytest.raises(FormatError, match="found a damaged file"):
        sp.Study(path)


def test_outcomes_of_no_task_do_not_count(tmp_path: Path) -> None:
    """Two tasks were once three done, with less than no time left."""
    study = squares(tmp_path / "squares.study", (1,))
    total = study.run().total
    with closing(sqlite3.connect(study.path)) as db, db:
        db.execute("INSERT INTO outcomes SELECT 77, state, '', '', 0.0, finished FROM outcomes")
    assert study.status().done == study.status().total == total
    with closing(sqlite3.connect(study.path)) as db, db:
        db.execute("UPDATE outcomes SET finished = 'late'")
    with pytest.raises(FormatError, match=r"squares\.study: found a damaged file"):
        study.status()


def test_studies_of_the_first_version_are_read_and_go_on(tmp_path: Path) -> None:
    """They have rows without checksums."""
    study = squares(tmp_path / "squares.study", (1,))
    study.run()
    table = study.table()
    db = sqlite3.connect(study.path)
    with db:
        db.execute("UPDATE outcomes SET rows = substr(rows, 17)")
        db.execute("PRAGMA user_version = 1")
    db.close()
    study = squares(tmp_path / "squares.study", (1, 2))
    assert [row for row in study.table() if row["status"] != "waiting"] == [*table]
    study.run()
    assert len(sp.Study(study.path).table()) == 2 * len(table)


def write(study: sp.Study, content: bytes) -> None:
    db = sqlite3.connect(study.path)
    db.execute("UPDATE outcomes SET content = ?", (content,))
    db.commit()
    db.close()


@pytest.mark.parametrize("content", [b"", b"no database at all, but long enough" * 100])
def test_files_of_another_kind_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file.study"
    path.write_bytes(content)
    if not content:  # what a kill before the first transaction leaves
        assert sp.Study(path).status().total == 0
        return
    with pytest.raises(FormatError, match="no study"):
        sp.Study(path)
    assert path.read_bytes() == content


def test_a_database_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file.db"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE letters (a)")
    db.commit()
    db.close()
    with pytest.raises(FormatError, match="another program"):
        sp.Study(path)
    study = sp.Study(tmp_path / "mine.study")
    with pytest.raises(FormatError, match="kind 'solve', expected 'identify'"):
        setid.Study(study.path)


def test_contents_run_no_code() -> None:
    class Evil:
        def __reduce__(self):
            return os.system, ("echo harm",)

    with pytest.raises(FormatError, match=r"found (posix|nt)\.system, expected records"):
        load(zlib.compress(pickle.dumps(Evil())), "task")
    with pytest.raises(FormatError, match="expected records of sparsepop_py"):
        dump(Path("a"), "task")
    function = zlib.compress(b"csparsepop_py.files\nwrite_text\n.")
    with pytest.raises(FormatError, match="found sparsepop_py.files.write_text"):
        load(function, "task")


def test_fingerprints_say_what_a_value_is() -> None:
    values = [1, 1.0, True, "1", None, (1,), ((1,),), [1], (1, 1), {"a": 1}, -0.0, 0.0]
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint(square(1)) == fingerprint(pickle.loads(pickle.dumps(square(1))))
    with pytest.raises(ProblemError, match="found object"):
        fingerprint(object())


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s: s.add("", square(1)), "name: found ''"),
        (lambda s: s.add("a", "square"), "problem: found str"),
        (lambda s: s.add("a", square(1), {"order": 2}), "options: found dict"),
        (lambda s: s.add("a", square(1), tags={"gap": 1}), "found 'gap', which is a column"),
        (lambda s: s.add("a", square(1), tags={"b": [1]}), r"tags\['b'\]: found \[1\]"),
        (lambda s: s.add("a", square(1), tags="b=1"), "tags: found 'b=1', expected a mapping"),
        (lambda s: s.add("a", square(1), tags={"b": "\ud800"}), r"tags\['b'\]: found '\\ud800'"),
        (
            lambda s: s.add("a", square(1), tags={"b": 10**5} | {"c": 2**64}),
            r"tags\['c'\]: found 18",
        ),
        (lambda s: s.add("a\ud800", square(1)), r"name: found 'a\\ud800'"),
        (lambda s: s.add_all(None), "tasks: found NoneType"),
        (lambda s: s.add_all([3]), r"tasks\[0\]: found int"),
        (lambda s: s.add_all([("a",)]), r"tasks\[0\]: found 1 entries"),
        (lambda s: s.result([]), r"name: found \[\]"),
        (lambda s: s.result("a\ud800"), r"name: found 'a\\ud800'"),
        (lambda s: sp.Study(s.path, trusted=None), "trusted: found NoneType"),
        (lambda s: sp.Study(s.path, trusted=[3]), r"trusted\[0\]: found int"),
        (lambda s: s.run(on_progress=3), "on_progress: found int"),
        (lambda s: s.run(0), "workers: found 0"),
        (lambda s: s.run(2, ThreadPoolExecutor(1)), "found both"),
        (lambda s: s.run(ahead=0), "ahead: found 0"),
        (lambda s: s.run(executor=print), "executor: found builtin"),
        (lambda s: s.export("table.xls"), r"found the ending '\.xls'"),
    ],
)
def test_wrong_arguments_are_named(tmp_path: Path, act, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        act(sp.Study(tmp_path / "a.study"))


def test_options_with_an_executor_cannot_be_stored(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(ProblemError, match="give it to Study.run"):
        sp.Study(tmp_path / "a.study").add("a", square(1), sp.Options(executor=pool))


# ---- progress, tables, command line --------------------------------------------------------------


def test_progress_says_rate_and_time_left() -> None:
    """By hand: 50 waiting at 2 a minute are 25 minutes; at 100 a second half of one."""
    status = sp.StudyStatus(total=100, done=49, failed=1, running=True, rate=2 / 60)
    assert str(status) == "50 of 100 tasks (1 failed), 2.0 a minute, 25 min left"
    assert status.waiting == 50 and status.seconds_left == pytest.approx(1500)
    fast = sp.StudyStatus(total=100, done=50, failed=0, running=True, rate=100.0)
    assert str(fast) == "50 of 100 tasks, 100.0 a second, 0 s left"
    slow = sp.StudyStatus(total=100, done=50, failed=0, running=True, rate=10 / 3600)
    assert str(slow) == "50 of 100 tasks, 10.0 an hour, 5 h left"
    assert sp.StudyStatus(2, 0, 0, True, None).seconds_left is None
    assert sp.StudyStatus(2, 2, 0, False, None).seconds_left == 0.0


def test_tables_are_written_with_all_digits(tmp_path: Path) -> None:
    table = sp.Table(("name", "value"), ({"name": 'a,"b"', "value": 0.1}, {"value": float("inf")}))
    assert table.csv() == 'name,value\n"a,""b""",0.1\n,inf\n'
    assert json.loads(table.json()) == [
        {"name": 'a,"b"', "value": 0.1},
        {"name": None, "value": "inf"},
    ]
    assert str(table).splitlines()[1] == 'a,"b"  0.1'
    table.write(tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text() == table.csv()


def test_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """A square: x^2 - x is least at 1/2."""
    monkeypatch.chdir(tmp_path)
    Path("square.txt").write_text("min x1^2 - x1; s.t. x1 >= 0")  # -1/4 at 1/2
    assert main(["study", "status", "a.study"]) == 2
    assert main(["study", "run", "a.study"]) == 2
    assert not Path("a.study").exists()
    assert main(["study", "run", "a.study", "square.txt", "--orders", "1", "2"]) == 0
    assert main(["study", "run", "a.study"]) == 0
    assert main(["study", "status", "a.study"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "a.study: 2 of 2 tasks"
    assert main(["study", "export", "a.study", "a.json", "--results", "results"]) == 0
    rows = json.loads(Path("a.json").read_text())
    assert [row["order"] for row in rows] == [1, 2]
    assert all(abs(row["lower_bound"] + 0.25) < 1e-6 for row in rows)
    assert len(list(Path("results").iterdir())) == 2


@pytest.mark.parametrize(
    "wrong",
    [["square.txt", "none.txt"], ["square.txt", "ratio.txt"], ["square.txt", "--orders", "1", "0"]],
)
def test_wrong_files_leave_no_study_behind(
    wrong: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("square.txt").write_text("min x1^2 - x1; s.t. x1 >= 0")
    Path("ratio.txt").write_text("min x1 / (1 + x1^2)")
    before = sorted(Path().iterdir())
    assert main(["study", "run", "a.study", *wrong]) == 2
    assert sorted(Path().iterdir()) == before


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["run", "none/a.study", "square.txt"], "STUDY: found 'none/a.study'"),
        (["run", "folder", "square.txt"], "STUDY: found 'folder'"),
        (["export", "squares.study", "none/table.csv"], "OUT: found 'none/table.csv'"),
        (["export", "squares.study", "folder"], "OUT: found 'folder'"),
    ],
)
def test_outputs_in_no_folder_are_wrong_input(
    words: list[str], named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """The table of exit codes in README.md says 2 of them."""
    monkeypatch.chdir(tmp_path)
    Path("square.txt").write_text("min x1^2 - x1; s.t. x1 >= 0")
    Path("folder").mkdir()
    squares(tmp_path / "squares.study", (1,))
    assert main(["study", *words]) == 2
    assert named in capsys.readouterr().err


def test_names_of_files_are_no_patterns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``a[1].txt`` is a file, whose pattern is that of the other one alone: -1/4 and -4."""
    monkeypatch.chdir(tmp_path)
    Path("a[1].txt").write_text("min x1^2 - x1; s.t. x1 >= 0")
    Path("a1.txt").write_text("min x1^2 - 4*x1; s.t. x1 >= 0")
    assert main(["study", "run", "a.study", "a[1].txt", "a?.txt"]) == 0
    values = {row["file"]: round(row["lower_bound"], 4) for row in sp.Study("a.study").table()}
    assert values == {"a[1].txt": -0.25, "a1.txt": -4.0}


@pytest.mark.parametrize("option", [["--orders", "2"], ["--auto"], ["--time-limit", "0"]])
def test_options_of_files_are_refused_without_files(
    option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tasks keep the options that they were added with."""
    path = squares(tmp_path / "squares.study", (1,)).path
    assert main(["study", "run", str(path), *option]) == 2
    assert f"{option[0]}: found no FILE" in capsys.readouterr().err
    assert sp.Study(path).status().waiting == 1


def test_tables_say_that_an_order_was_raised(tmp_path: Path) -> None:
    """A polynomial of degree 4 needs order 2."""
    (x,) = sp.variables(1)
    study = sp.Study(tmp_path / "quartic.study")
    study.add("quartic", sp.Problem(x**4 - x, lower=-1, upper=1), sp.Options(order=1))
    study.run()
    assert study.table()[0]["message"].startswith("order 1 raised to 2")


# ---- setid ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_studies_of_identifications(tmp_path: Path) -> None:
    """The record of four samples, by hand in the documentation: b0 in [23/12, 2.10930...]."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    model = setid.TransferFunction(1, 1)
    study = setid.Study(tmp_path / "levels.study")
    for bound in (0.5, 1e-6):
        study.add(f"{bound}", data, model, setid.Noise(equation=bound), tags={"bound": bound})
    study.add("output", data, model, setid.Noise(output=0.3), setid.Stable())
    assert study.run(workers=2).finished
    row = study.table()[1]
    assert (row["bound"], row["parameter"], row["status"]) == (0.5, "b0", "certified")
    assert row["outer_low"] <= 23 / 12 <= row["outer_low"] + 1e-12
    assert study.table()[2]["status"] == "empty"
    assert bool(study.result("output").verify(data))
    with pytest.raises(setid.SetidError, match="noise: found float"):
        study.add("a", data, model, 0.5)
    direct = setid.identify(data, model, setid.Noise(equation=0.5))
    assert study.result("0.5").intervals["b0"].outer == direct.intervals["b0"].outer


def test_a_stored_identification_that_claims_too_much_is_refused(tmp_path: Path) -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    study = setid.Study(tmp_path / "a.study")
    study.add("a", data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    study.run()
    found = study.result("a")
    tight = replace(found.intervals["b0"], outer=(1.95, 2.0))
    claims = replace(found, intervals={**found.intervals, "b0": tight})
    write(study, zlib.compress(to_json(claims).encode()))
    with pytest.raises(setid.SetidError, match="result of 'a': from_json: found a claim"):
        study.result("a")


OWN = """
from dataclasses import dataclass
import setid
from setid.models.equations import Equation, Lagged, Term


@dataclass(frozen=True)
class Gain:  # y_k = c u_k
    inputs = outputs = 1
    initial = "free"
    parameters = ("c",)

    def equations(self, noisy=()):
        terms = [Term(1.0, (), (Lagged("y1"),)), Term(-1.0, ("c",), (Lagged("u1", 0),))]
        return (Equation("y1", tuple(terms), error=True),)

    def regression(self):
        return self.equations()

    def transfer(self, output, input):
        raise setid.ModelError("model: a gain")
"""


def test_structures_of_trusted_modules_are_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """|1 - c| <= 1/2 and |3 - 2 c| <= 1/2: c in [5/4, 3/2]."""
    (tmp_path / "own_structures.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    from own_structures import Gain

    data, noise = setid.IOData([1.0, 2.0], [1.0, 3.0]), setid.Noise(equation=0.5)
    with pytest.raises(FormatError, match=r"own_structures.Gain.*trusted="):
        setid.Study(tmp_path / "a.study").add("gain", data, Gain(), noise)
    study = setid.Study(tmp_path / "b.study", trusted=["own_structures"])
    study.add("gain", data, Gain(), noise)
    assert study.run(workers=2).done == 1
    row = study.table()[0]
    assert (row["outer_low"], row["outer_high"]) == (1.25, 1.5)
    assert study.result("gain").verify(data)
    with pytest.raises(FormatError, match="trusted="):
        setid.Study(study.path).result("gain")
    monkeypatch.delitem(sys.modules, "own_structures")


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("arx", "model: found str, expected a structure"),
        (setid.TransferFunction, "model: found .*, expected a structure"),
        (setid.TransferFunction(1, 1, inputs=2), "data: found 1 inputs"),
    ],
)
def test_other_models_are_refused_before_they_are_stored(
    tmp_path: Path, model: object, message: str
) -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    study = setid.Study(tmp_path / "wrong.study")
    with pytest.raises(setid.SetidError, match=message):
        study.add("wrong", data, model, setid.Noise(equation=0.5))  # type: ignore[arg-type]
    assert len(study.table()) == 0


@pytest.mark.parametrize("kind", ["problems", "records", "priors"])
def test_results_of_other_tasks_are_refused(tmp_path: Path, kind: str) -> None:
    """Both results hold by themselves, but each about its own task."""
    path = tmp_path / "two.study"
    study: Any
    if kind == "problems":
        x = sp.variables(1)[0]
        study = sp.Study(path)
        for low in (1.0, 2.0):
            study.add(f"task {low}", sp.Problem(x, lower=low, upper=3.0))
    else:
        data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        study = setid.Study(path)
        for bound in (1.0, 2.0):
            noise = setid.Noise(equation=1.0 if kind == "priors" else bound)
            prior = setid.Box({"b0": (1.0, 1.0 + bound)}) if kind == "priors" else ()
            study.add(f"task {bound}", data, setid.TransferFunction(1, 1), noise, prior)
    study.run()
    with closing(sqlite3.connect(path)) as db, db:
        (other,) = db.execute("SELECT content FROM outcomes WHERE task = 2").fetchone()
        db.execute("UPDATE outcomes SET content = ? WHERE task = 1", (other,))
    assert study.result("task 2.0").status in ("OPTIMAL", "certified")
    with pytest.raises(sp.FormatError, match="result of 'task 1.0': found that of another task"):
        study.result("task 1.0")


def test_rows_of_other_tasks_are_refused_with_the_result(tmp_path: Path) -> None:
    """Their checksums hold, but the bounds of x in [1, 3] are not those of x in [2, 3]."""
    (x,) = sp.variables(1)
    study = sp.Study(tmp_path / "two.study")
    for low in (1.0, 2.0):
        study.add(f"task {low}", sp.Problem(x, lower=low, upper=3.0))
    study.run()
    assert 1.0 - 1e-6 <= study.result("task 1.0").lower_bound <= 1.0
    with closing(sqlite3.connect(study.path)) as db, db:
        (other,) = db.execute("SELECT rows FROM outcomes WHERE task = 2").fetchone()
        db.execute("UPDATE outcomes SET rows = ? WHERE task = 1", (other,))
    with pytest.raises(FormatError, match="other numbers than in its rows of the table"):
        study.result("task 1.0")


def test_a_last_digit_of_another_machine_is_no_other_number(tmp_path: Path) -> None:
    """A point of x^2 = 2 is proved again with each reading, and its value bounded anew."""
    (x,) = sp.variables(1)
    study = sp.Study(tmp_path / "root.study")
    study.add("root", sp.Problem(x, [x**2 == 2], 0.0, 2.0))
    study.run()
    known = study.result("root")
    there = nextafter(known.upper_bound, 0.0)
    with closing(sqlite3.connect(study.path)) as db, db:
        content, text = db.execute("SELECT content, substr(rows, 17) FROM outcomes").fetchone()
        stored, (row,) = json.loads(zlib.decompress(content)), json.loads(text)
        assert stored["result"]["upper_bound"] == row["upper_bound"] == known.upper_bound
        stored["result"]["upper_bound"] = there
        row |= {"upper_bound": there, "gap": there - known.lower_bound}
        values = zlib.compress(json.dumps(stored).encode()), json.dumps([row])
        db.execute("UPDATE outcomes SET content = ?, rows = ?", values)
        db.execute("PRAGMA user_version = 1")  # whose rows have no checksums
    again = sp.Study(study.path).result("root")
    assert again.upper_bound == known.upper_bound


@pytest.mark.parametrize("delta", [0.0, 0.25, pytest.param("estimate", marks=pytest.mark.slow)])
def test_results_of_structures_in_continuous_time_come_back(tmp_path: Path, delta: Any) -> None:
    """Identifying settles their sampling interval and their discretisation error."""
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875], Ts=0.5)
    model = setid.ContinuousTransferFunction(1, 0, delta=delta)
    box = setid.Box({"a0": (0.0, 50.0), "b0": (0.0, 50.0)})
    study = setid.Study(tmp_path / "continuous.study")
    study.add("task", data, model, setid.Noise(output=2.0), [box])
    study.run()
    known = study.result("task").formulation
    assert known.model.Ts == 0.5
    assert delta == "estimate" or known.noise.model_error == delta


def test_results_without_a_file_for_the_checker_keep_none_of_the_others(tmp_path: Path) -> None:
    """b0 gamma1 is all that y = gamma1 b0 u says, so both are reported as not unique."""
    u = [-1.0, 0.5, 1.0]
    data, noise = setid.IOData(u, u), setid.Noise(0.01)
    report = setid.Options(unidentifiable="report")
    study = setid.Study(tmp_path / "reported.study")
    study.add("bare", data, setid.Hammerstein(setid.TransferFunction(0, 1), 1), noise, (), report)
    study.add("gain", data, setid.TransferFunction(0, 1), noise)
    study.run()
    with pytest.raises(ProblemError, match="wrote 1 files, none of 1 more: 'bare'"):
        study.export_results(tmp_path / "results")
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["gain.json"]


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        (3, "^tasks: found int, expected a list of tasks"),
        ([3], r"^tasks\[0\]: found int, expected name, data, model"),
        ([("a", None)], r"^tasks\[0\]: found 2 entries, expected name, data, model"),
        ([("a", *[None] * 7)], r"^tasks\[0\]: found 8 entries"),
        ("priors", "^priors: found int, expected priors"),
    ],
)
def test_malformed_lists_of_identifications_are_refused(
    tasks: object, message: str, tmp_path: Path
) -> None:
    data, model = setid.IOData([0.0, 1, 0], [0.0, 0, 1]), setid.TransferFunction(1, 1, 1)
    if tasks == "priors":
        tasks = [("a", data, model, setid.Noise(equation=1), 3)]
    with pytest.raises(setid.SetidError, match=message):
        setid.Study(tmp_path / "a.study").add_all(tasks)  # type: ignore[arg-type]
