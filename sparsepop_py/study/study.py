"""Run many tasks, store each outcome, go on where an earlier run ended.

A kind of study says what its tasks are (:class:`Work`): the engine's are problems
(:mod:`sparsepop_py.study.problems`), those of setid are identifications.
"""

from __future__ import annotations

import json
import re
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar

from sparsepop_py.errors import FormatError, OutputError, ProblemError, check_kind, entries_of
from sparsepop_py.executors.dispatch import Done, completed, opened
from sparsepop_py.files import as_path, write_text
from sparsepop_py.pipeline.arguments import check_callable
from sparsepop_py.progress import Line
from sparsepop_py.study.content import dump, fingerprint, load
from sparsepop_py.study.store import Entry, Outcome, Store
from sparsepop_py.study.table import Table

__all__ = ["BaseStudy", "StudyStatus", "Work", "perform", "status_of", "table_of"]

Tags = Mapping[str, str | int | float | bool]

_DIGITS = 1e-12  # of the largest number in a row, as where JSON of results is read


@dataclass(frozen=True, slots=True)
class Work:
    """One kind of task: functions of importable modules, so that they reach other processes.

    Parameters
    ----------
    kind : str
        Stored in the file.
    run : callable
        From the input of a task to its result.
    rows : callable
        From a result to its rows of the table: a list of mappings.
    write, read : callable
        From a result to bytes, and back, given the trusted modules; reading checks what the
        bytes claim.
    certificate : callable
        From a result to the JSON text that ``checker/check.py`` reads.
    columns : tuple of str
        Of the table, after the name and the tags.
    belongs : callable
        Whether a result is about the input of a task, both given.
    """

    kind: str
    run: Callable[..., Any]
    rows: Callable[[Any], list[dict[str, Any]]]
    write: Callable[[Any, tuple[str, ...]], bytes]
    read: Callable[[bytes, str, tuple[str, ...]], Any]
    certificate: Callable[[Any], str]
    columns: tuple[str, ...]
    belongs: Callable[[Any, tuple[Any, ...]], bool]


@dataclass(frozen=True, slots=True)
class StudyStatus:
    """Progress of a study.

    Parameters
    ----------
    total : int
        Tasks that were added.
    done : int
        Tasks with a result.
    failed : int
        Tasks that raised an exception, or whose worker was lost three times.
    running : bool
        Whether somebody is writing the file now.
    rate : float or None
        Tasks a second in the last run; None where that says nothing yet.

    Examples
    --------
    >>> status = StudyStatus(total=100, done=38, failed=2, running=True, rate=0.5)
    >>> print(status)
    40 of 100 tasks (2 failed), 30.0 a minute, 2 min left
    """

    total: int
    done: int
    failed: int
    running: bool
    rate: float | None

    @property
    def waiting(self) -> int:
        """Number of tasks without outcome."""
        return self.total - self.done - self.failed

    @property
    def finished(self) -> bool:
        """True if no task waits."""
        return self.waiting == 0

    @property
    def seconds_left(self) -> float | None:
        """Seconds that the waiting tasks take at this rate; None without one."""
        if self.finished:
            return 0.0
        return self.waiting / self.rate if self.rate else None

    def __str__(self) -> str:
        failed = f" ({self.failed} failed)" if self.failed else ""
        text = f"{self.done + self.failed} of {self.total} tasks{failed}"
        if self.rate and not self.finished:
            text += f", {_pace(self.rate)}, {_duration(self.seconds_left or 0.0)} left"
        return text


def _pace(rate: float) -> str:
    if rate >= 1.0:
        return f"{rate:.1f} a second"
    return f"{60 * rate:.1f} a minute" if rate * 60 >= 1.0 else f"{3600 * rate:.1f} an hour"


def _duration(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size or (unit == "min" and seconds >= size):
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def _storable(value: Any) -> bool:
    """Check for a text of Unicode, a double, or an integer below 2^64."""
    if isinstance(value, str):
        return not any("\ud800" <= sign <= "\udfff" for sign in value)
    return isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**64)


def _check_name(name: Any) -> None:
    if not isinstance(name, str) or not name or not _storable(name):
        raise ProblemError(f"name: found {name!r:.80}, expected a text that is not empty")


class BaseStudy:
    """Tasks and their outcomes in one file; subclasses say what the tasks are.

    Parameters
    ----------
    path : str or PathLike
        An SQLite file, made where there is none.
    trusted : iterable of str
        Modules of your own whose classes inputs and results may contain.

    Raises
    ------
    FormatError
        If the file is something else, or a study of another kind.
    OutputError
        If it cannot be made.
    """

    work: ClassVar[Work]

    def __init__(self, path: str | Path, *, trusted: Iterable[str] = ()) -> None:
        modules = entries_of(trusted, "trusted", "a list of modules")
        for number, module in enumerate(modules):
            check_kind(module, str, f"trusted[{number}]")
        self._trusted = tuple(modules)
        self._store = Store(path, self.work.kind, self.work.columns)
        self.path = self._store.path

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {str(self.path)!r}: {self.status()}>"

    # ---- tasks ------------------------------------------------------------------------------

    def _entry(self, name: str, arguments: tuple[Any, ...], tags: Tags | None) -> Entry:
        _check_name(name)
        if tags is not None and not isinstance(tags, Mapping):
            raise ProblemError(f"tags: found {tags!r:.80}, expected a mapping of columns to values")
        columns = dict(tags or {})
        taken = ("name", "seconds", "message", *self.work.columns)
        for key, value in columns.items():
            if not isinstance(key, str) or not (_storable(value) and _storable(key)):
                raise ProblemError(
                    f"tags[{key!r}]: found {value!r:.80}, expected a text or a number"
                )
            if key in taken:
                raise ProblemError(f"tags: found {key!r}, which is a column already")
        content = dump(arguments, f"task {name!r}", self._trusted)
        return Entry(name, json.dumps(columns), fingerprint((arguments, columns)), content)

    def _add(self, entries: Iterable[Entry]) -> None:
        with self._store.writing():
            self._store.add(entries)

    # ---- running ----------------------------------------------------------------------------

    def run(
        self,
        workers: int | None = None,
        executor: Executor | None = None,
        *,
        retry: bool = False,
        ahead: int = 64,
        progress: bool = True,
        on_progress: Callable[[StudyStatus], None] | None = None,
    ) -> StudyStatus:
        """Do all tasks that have no outcome, and store each outcome when it arrives.

        It can be ended at any moment, also by ``kill -9`` or a power cut: the next run goes on
        with the tasks that have no outcome. Ctrl-C ends it in order. Neither stores anything of
        a task that was not done. Results do not depend on the number of workers.

        Parameters
        ----------
        workers : int, optional
            Processes on this machine; 1 (in this process) when left out.
        executor : concurrent.futures.Executor, optional
            Does the tasks instead, such as ``dask_client.get_executor()``. Tasks whose worker
            was lost are submitted again, up to three times.
        retry : bool
            Whether tasks that failed are tried again.
        ahead : int
            Most tasks that an executor has at a time; at least its number of workers.
        progress : bool
            Whether to draw a line with the rate and the time that is left, on a terminal.
        on_progress : callable, optional
            Called with a :class:`StudyStatus` after each outcome.

        Returns
        -------
        StudyStatus

        Raises
        ------
        OutputError
            If another run writes the file, or it cannot be written.
        ProblemError
            If ``workers`` or ``executor`` is wrong.
        SparsePOPError
            If the executor takes no tasks any more. What was done is stored.
        """
        if isinstance(ahead, bool) or not isinstance(ahead, int) or ahead < 1:
            raise ProblemError(f"ahead: found {ahead!r}, expected an integer >= 1")
        check_callable("on_progress", on_progress)
        with suppress(KeyboardInterrupt):  # it ends processes of our own with their tasks
            with opened(workers, executor) as chosen, self._store.writing():
                self._store.begin()
                tasks = self._store.waiting(("failed", "lost") if retry else ())
                follower = _Follower(self, len(tasks), Line(progress), on_progress)
                with closing(follower), _interrupts() as interrupt:
                    with self._store.recording() as record:
                        for number, outcome in self._outcomes(tasks, chosen, ahead):
                            if interrupt.came:
                                raise KeyboardInterrupt
                            record(number, outcome)
                            follower.note(outcome)
        return self.status()

    def _outcomes(
        self, tasks: list[tuple[int, str]], executor: Executor | None, ahead: int
    ) -> Iterator[tuple[int, Outcome]]:
        """Do tasks and yield their numbers and outcomes as they are done."""
        jobs = (
            (number, _Job(self.work, name, self._store.content(number), self._trusted))
            for number, name in tasks
        )
        if executor is None:
            for number, job in jobs:
                yield number, perform(job)
            return
        with closing(completed(executor, perform, jobs, ahead=ahead)) as found:
            for done in found:
                yield done.key, _lost(done) if done.value is None else done.value

    # ---- reading ----------------------------------------------------------------------------

    def status(self) -> StudyStatus:
        """Count tasks and estimate the time that is left, also while another process runs it.

        Returns
        -------
        StudyStatus
        """
        return status_of(self._store)

    def table(self, *, timings: bool = False) -> Table:
        """List the outcomes of all tasks in the order in which they were added.

        Parameters
        ----------
        timings : bool
            Whether to add the wall time of each task, which differs from run to run.

        Returns
        -------
        Table
        """
        return table_of(self._store, timings)

    def result(self, name: str) -> Any:
        """Read the result of a task and check what it claims.

        Parameters
        ----------
        name : str

        Returns
        -------
        Result or Identification

        Raises
        ------
        ProblemError
            If there is no such task, it has no result yet, it failed, or its proofs do not hold.
        FormatError
            If what was stored is damaged, or belongs to another task.
        """
        _check_name(name)
        outcome = self._store.outcome(name)
        if outcome is None:
            raise ProblemError(f"name: found {name!r}, which has no result yet; run the study")
        if outcome.state != "done":
            message = json.loads(outcome.rows)[0].get("message")
            raise ProblemError(f"name: found {name!r}, which failed: {message}")
        place = f"{self.path}: result of {name!r}"
        found = self.work.read(outcome.content, place, self._trusted)
        given = load(self._store.given(name), f"{self.path}: task {name!r}", self._trusted)
        if not self.work.belongs(found, given):
            raise FormatError(f"{place}: found that of another task")
        if not _same(json.loads(outcome.rows), self.work.rows(found)):
            raise FormatError(f"{place}: found other numbers than in its rows of the table")
        return found

    def export(self, path: str | Path) -> None:
        """Write the table to a ``.csv`` or ``.json`` file, whole or not at all.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        ProblemError
            If the ending is another one.
        OutputError
            If the file cannot be written.
        """
        self.table().write(path)

    def export_results(self, folder: str | Path) -> list[Path]:
        """Write each result to a JSON file that the independent checker reads.

        Parameters
        ----------
        folder : str or Path
            Made where there is none.

        Returns
        -------
        list of Path
            One a task with a result, in their order; names of tasks with signs that file names
            should not have are followed by their number, and by ``_`` where that is the name of
            another task.

        Raises
        ------
        ProblemError
            If proofs do not hold, or a result has no such file; those of the others are written.
        OutputError
            If a file cannot be written.
        """
        target, written, without = as_path(folder), [], []
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{folder}: cannot be made: {error.strerror}") from error
        rows = self._store.rows()
        names = {row[0] for row in rows}
        for number, (name, _, state, _, _) in enumerate(rows, 1):
            if state != "done":
                continue
            try:
                text = self.work.certificate(self.result(name))
            except ValueError as error:  # ours and those of setid; the others have files
                without.append(f"{name!r}: {error}")
                continue
            written.append(target / f"{_file_name(name, number, names)}.json")
            write_text(written[-1], text)
        if without:
            raise ProblemError(
                f"results: wrote {len(written)} files, none of {len(without)} more: {without[0]}"
            )
        return written


def _file_name(name: str, number: int, names: set[str]) -> str:
    """Make a file name of that of a task, which no other task has."""
    plain = re.sub(r"[^\w.-]", "_", name)
    file = name if plain == name else f"{plain}-{number}"
    while file != name and file in names:
        file += "_"
    return file


def _same(stored: list[dict[str, Any]], rows: list[dict[str, Any]]) -> bool:
    """Compare stored rows with those of a result, in the columns that were stored."""
    return len(stored) == len(rows) and all(map(_agree, stored, rows))


def _agree(old: dict[str, Any], row: dict[str, Any]) -> bool:
    """Compare one row but for last digits: points are proved again where results are read."""
    numbers = [abs(v) for v in old.values() if isinstance(v, float) and isfinite(v)]
    error = _DIGITS * max([1.0, *numbers])
    pairs = [(value, row.get(column)) for column, value in old.items()]
    return all(
        v == w or (isinstance(v, float) and isinstance(w, float) and abs(v - w) <= error)
        for v, w in pairs
    )


# ---- one task -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Job:
    """One task as it goes to a worker: bytes and names of functions."""

    work: Work
    name: str
    content: bytes
    trusted: tuple[str, ...]


def perform(job: _Job) -> Outcome:
    """Do one task; an exception becomes an outcome too. Safe in a worker process.

    Parameters
    ----------
    job : _Job

    Returns
    -------
    Outcome
    """
    begin, work = time.perf_counter(), job.work
    try:
        found = work.run(*load(job.content, f"task {job.name!r}", job.trusted))
        rows, content = work.rows(found), work.write(found, job.trusted)
    except Exception as error:  # one bad task is not to end the others
        rows = [{"message": f"{type(error).__name__}: {error}"}]
        return Outcome("failed", json.dumps(rows), b"", time.perf_counter() - begin)
    return Outcome("done", json.dumps(rows), content, time.perf_counter() - begin)


def _lost(done: Done[int, Outcome]) -> Outcome:
    return Outcome("lost", json.dumps([{"message": done.lost}]), b"", 0.0)


# ---- progress and interrupts --------------------------------------------------------------------


@dataclass(eq=False)
class _Follower:
    """Draw and report the progress of a run. Mutable."""

    study: BaseStudy
    tasks: int
    line: Line
    report: Callable[[StudyStatus], None] | None
    done: int = 0
    failed: int = 0
    begin: float = field(default_factory=time.monotonic)
    before: StudyStatus = field(init=False)

    def __post_init__(self) -> None:
        self.before = self.study.status()

    def note(self, outcome: Outcome) -> None:
        """Count an outcome."""
        good = outcome.state == "done"
        self.done, self.failed = self.done + good, self.failed + (not good)
        left = self.tasks - self.done - self.failed
        total = self.before.total
        done = self.before.done + self.done
        rate = (self.done + self.failed) / max(time.monotonic() - self.begin, 1e-9)
        status = StudyStatus(total, done, total - done - left, True, rate)
        self.line.draw(str(status))
        if self.report is not None:
            self.report(status)

    def close(self) -> None:
        """Erase the line."""
        self.line.close()


@dataclass(eq=False)
class _Interrupt:
    """Mark of Ctrl-C: a task then returned half a result. Mutable."""

    came: bool = False


@contextmanager
def _interrupts() -> Iterator[_Interrupt]:
    """Note Ctrl-C, which solvers turn into results with what is proved so far."""
    mark, old = _Interrupt(), signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and callable(old)

    def note(number: int, frame: Any) -> None:
        mark.came = True
        old(number, frame)  # type: ignore[operator, misc]

    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield mark
    finally:
        if ours:
            signal.signal(signal.SIGINT, old)


# ---- tables -------------------------------------------------------------------------------------


def status_of(store: Store) -> StudyStatus:
    """Count the tasks of a study and estimate its rate from its file.

    Parameters
    ----------
    store : Store

    Returns
    -------
    StudyStatus
    """
    counts, running, rate = store.counts(), store.written, None
    if counts.recent and counts.started is not None and counts.latest is not None:
        end = time.time() if running else counts.latest
        rate = counts.recent / max(end - counts.started, 1e-3)
    return StudyStatus(counts.total, counts.done, counts.failed, running, rate)


def table_of(store: Store, timings: bool = False) -> Table:
    """Make the table of a study from its file.

    Parameters
    ----------
    store : Store
    timings : bool

    Returns
    -------
    Table
    """
    found: list[dict[str, Any]] = []
    tagged: dict[str, None] = {}
    for name, tags, state, rows, seconds in store.rows():
        tagged.update(dict.fromkeys(tags))
        for row in rows or [{}]:
            status = {} if state == "done" else {"status": state}
            found.append({"name": name, **tags, **row, **status, "seconds": seconds})
    names = ("name", *tagged, *store.columns, "message", *(("seconds",) if timings else ()))
    full = [{column: row.get(column) for column in names} for row in found]
    return Table(names, tuple(full))
