"""Keep the tasks of a study and their outcomes in one SQLite file.

Each outcome is one transaction, so the file holds a task's whole outcome or nothing of it,
whatever happens to the program or the machine. SQLite's rollback journal is used, not its
write-ahead log, which needs shared memory that file systems of clusters do not have.

The writer holds the lock of a second file, ``PATH.lock``. The operating system gives it up
when the process ends, however that happens.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sparsepop_py.errors import FormatError, OutputError, ProblemError
from sparsepop_py.files import as_path

__all__ = ["Counts", "Entry", "Outcome", "Store"]

_APPLICATION, _VERSION = 0x73705374, 2
_UNSEALED = 1  # the version whose rows carry no checksum; such a file stays as it is
_STATES = ("done", "failed", "lost")
_OF_TASKS = "FROM outcomes WHERE task IN (SELECT id FROM tasks)"
_SEAL = 16  # digits of a checksum
_PATIENCE = 30.0  # seconds that a statement waits for another process to finish its own
_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE tasks (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, tags TEXT NOT NULL,
    fingerprint TEXT NOT NULL, content BLOB NOT NULL);
CREATE TABLE outcomes (
    task INTEGER PRIMARY KEY REFERENCES tasks (id), state TEXT NOT NULL, rows TEXT NOT NULL,
    content BLOB, seconds REAL NOT NULL, finished REAL NOT NULL);
CREATE TABLE runs (
    id INTEGER PRIMARY KEY, started REAL NOT NULL, host TEXT NOT NULL, process INTEGER NOT NULL);
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """One task as it is stored.

    Parameters
    ----------
    name : str
    tags : str
        JSON object of further columns of the table.
    fingerprint : str
    content : bytes
    """

    name: str
    tags: str
    fingerprint: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one task as it is stored.

    Parameters
    ----------
    state : {"done", "failed", "lost"}
    rows : str
        JSON list of objects: its rows of the table.
    content : bytes
        The result with its proofs; empty where there is none.
    seconds : float
        Wall time of the task where it was done.
    """

    state: str
    rows: str
    content: bytes
    seconds: float


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of tasks, and the times that the rate follows from.

    Parameters
    ----------
    total, done, failed : int
    recent : int
        Outcomes of the last run.
    started, latest : float or None
        When that run and its last outcome were, in seconds since 1970.
    """

    total: int
    done: int
    failed: int
    recent: int
    started: float | None
    latest: float | None


class Store:
    """Tasks and outcomes of one study in an SQLite file.

    Parameters
    ----------
    path : str or PathLike
        Made where there is none.
    kind : str, optional
        What the tasks are; a file of another kind is refused. None opens an existing file of
        any kind.
    columns : tuple of str
        Of the table, stored in a new file.

    Raises
    ------
    FormatError
        If the file is something else, is damaged, or comes from a newer version.
    OutputError
        If it cannot be made.

    Examples
    --------
    >>> store = Store("letters.study", "letters", ("status",))
    >>> with store.writing():
    ...     store.add([Entry("a", "{}", "0", b"")])
    >>> store.counts().total
    1
    """

    def __init__(self, path: Any, kind: str | None = None, columns: tuple[str, ...] = ()) -> None:
        self.path = as_path(path)
        if kind is None and not self.path.is_file():
            raise FormatError(f"{path}: no such file")
        with _translated(self.path), closing(self._open("rw" if kind is None else "rwc")) as db:
            if kind is not None and not _meta(db, self.path):
                self._create(db, kind, columns)
            meta = _meta(db, self.path)
            self._sealed = db.execute("PRAGMA user_version").fetchone()[0] != _UNSEALED
        if not meta:
            raise FormatError(f"{path}: found an empty file, expected a study")
        with _sound(self.path):
            self.kind, names = meta["kind"], _of(list, json.loads(meta["columns"]))
            self.columns = tuple(_of(str, name) for name in names)
        if kind not in (None, self.kind):
            raise FormatError(f"{path}: found a study of kind {self.kind!r}, expected {kind!r}")

    def _create(self, db: sqlite3.Connection, kind: str, columns: tuple[str, ...]) -> None:
        """Write the empty tables in one transaction, unless another process was faster."""
        with _transaction(db, "EXCLUSIVE"):
            if not _meta(db, self.path):
                for statement in _SCHEMA.split(";"):
                    db.execute(statement)
                db.execute(f"PRAGMA application_id = {_APPLICATION}")
                db.execute(f"PRAGMA user_version = {_VERSION}")
                values = [("kind", kind), ("columns", json.dumps(columns))]
                db.executemany("INSERT INTO meta VALUES (?, ?)", values)

    def _open(self, mode: str) -> sqlite3.Connection:
        return _connect(self.path, mode)

    @property
    def _lock(self) -> Path:
        """Name the file that the writer locks, the same one by all links."""
        path = Path(os.path.realpath(self.path))
        return path.with_name(path.name + ".lock")

    # ---- the one writer ---------------------------------------------------------------------

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Be the only writer of the file for a with statement.

        Raises
        ------
        OutputError
            If another process, or another object of this one, is.
        """
        lock = self._lock
        with _translated(lock):
            held = sqlite3.connect(lock, timeout=0.2, isolation_level=None)
        with closing(held):
            try:
                held.execute("BEGIN EXCLUSIVE")
            except sqlite3.OperationalError as error:
                if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY:
                    raise OutputError(f"{lock}: {error}") from error
                raise OutputError(
                    f"{self.path}: found another writer{self._last_writer()}, expected none"
                ) from error
            yield

    def _last_writer(self) -> str:
        with _translated(self.path), closing(self._open("rw")) as db:
            row = db.execute("SELECT process, host FROM runs ORDER BY id DESC LIMIT 1").fetchone()
        return "" if row is None else f" (the last run is of process {row[0]} on {row[1]})"

    @property
    def written(self) -> bool:
        """True while somebody is writing."""
        lock = self._lock
        if not lock.exists():
            return False
        with closing(sqlite3.connect(lock, timeout=0.0, isolation_level=None)) as db:
            try:
                db.execute("SELECT count(*) FROM sqlite_master")
            except sqlite3.OperationalError:
                return True
        return False

    # ---- tasks ------------------------------------------------------------------------------

    def add(self, entries: Iterable[Entry]) -> None:
        """Add tasks, all or none; those that are there already stay.

        Parameters
        ----------
        entries : iterable of Entry

        Raises
        ------
        ProblemError
            If a name is taken by a task with other content.
        """
        with _translated(self.path), closing(self._open("rw")) as db, _transaction(db):
            for entry in entries:
                known = db.execute(
                    "SELECT fingerprint FROM tasks WHERE name = ?", (entry.name,)
                ).fetchone()
                if known is None:
                    values = entry.name, entry.tags, entry.fingerprint, entry.content
                    db.execute(
                        "INSERT INTO tasks (name, tags, fingerprint, content) VALUES (?, ?, ?, ?)",
                        values,
                    )
                elif known[0] != entry.fingerprint:
                    raise ProblemError(
                        f"name: found {entry.name!r}, which is another task of {self.path} "
                        "already; expected a new name, or the same task again"
                    )

    def waiting(self, states: tuple[str, ...] = ()) -> list[tuple[int, str]]:
        """List numbers and names of tasks without outcome, or with one of these states.

        Parameters
        ----------
        states : tuple of str
        """
        marks = ", ".join("?" * len(states))
        query = (
            "SELECT id, name FROM tasks LEFT JOIN outcomes ON task = id "
            f"WHERE state IS NULL OR state IN ({marks}) ORDER BY id"
        )
        with _translated(self.path), closing(self._open("rw")) as db:
            return list(db.execute(query, states))

    def content(self, task: int) -> bytes:
        """Read the input of a task.

        Parameters
        ----------
        task : int
        """
        with _translated(self.path), closing(self._open("rw")) as db:
            row = db.execute("SELECT content FROM tasks WHERE id = ?", (task,)).fetchone()
        return _blob(row[0])

    def given(self, name: str) -> bytes:
        """Read the input of the task of a name, which exists.

        Parameters
        ----------
        name : str
        """
        with _translated(self.path), closing(self._open("rw")) as db:
            row = db.execute("SELECT content FROM tasks WHERE name = ?", (name,)).fetchone()
        return _blob(row[0])

    # ---- outcomes ---------------------------------------------------------------------------

    def begin(self) -> None:
        """Note that a run begins."""
        values = time.time(), platform.node(), os.getpid()
        with _translated(self.path), closing(self._open("rw")) as db, _transaction(db):
            db.execute("INSERT INTO runs (started, host, process) VALUES (?, ?, ?)", values)

    @contextmanager
    def recording(self) -> Iterator[Callable[[int, Outcome], None]]:
        """Provide a function that stores the outcome of a task, each in a transaction.

        Yields
        ------
        callable
            Of the number of a task and its outcome. When it returns, the outcome is on the disk.
        """
        with _translated(self.path), closing(self._open("rw")) as db:

            def record(task: int, found: Outcome) -> None:
                rows = _seal(found.rows) + found.rows if self._sealed else found.rows
                values = found.state, rows, found.content, found.seconds, time.time()
                with _transaction(db):
                    db.execute(
                        "INSERT OR REPLACE INTO outcomes VALUES (?, ?, ?, ?, ?, ?)", (task, *values)
                    )

            yield record

    def outcome(self, name: str) -> Outcome | None:
        """Read the outcome of a task; None where it waits.

        Parameters
        ----------
        name : str

        Raises
        ------
        ProblemError
            If there is no such task.
        """
        query = (
            "SELECT state, rows, outcomes.content, seconds FROM tasks "
            "LEFT JOIN outcomes ON task = id WHERE name = ?"
        )
        with _translated(self.path), closing(self._open("rw")) as db:
            row = db.execute(query, (name,)).fetchone()
        if row is None:
            raise ProblemError(f"name: found {name!r}, expected a task of {self.path}")
        if row[0] is None:
            return None
        with _sound(self.path):
            _listed(text := self._unsealed(row[1]))
            return Outcome(_state(row[0]), text, _blob(row[2]), float(row[3]))

    def _unsealed(self, rows: str) -> str:
        """Take the checksum off what was stored."""
        if not self._sealed:
            return rows
        text = rows[_SEAL:]
        if rows[:_SEAL] != _seal(text):
            raise ValueError("rows do not have their checksum")
        return text

    def rows(self) -> list[tuple[str, dict[str, Any], str, list[dict[str, Any]], float | None]]:
        """List name, tags, state ("waiting" without outcome), rows and seconds of all tasks."""
        query = (
            "SELECT name, tags, state, rows, seconds FROM tasks "
            "LEFT JOIN outcomes ON task = id ORDER BY id"
        )
        with _translated(self.path), closing(self._open("rw")) as db:
            found = db.execute(query).fetchall()
        with _sound(self.path):
            return [
                (
                    _of(str, name),
                    _of(dict, json.loads(tags)),
                    "waiting" if state is None else _state(state),
                    [] if state is None else _listed(self._unsealed(rows)),
                    seconds if seconds is None else float(seconds),
                )
                for name, tags, state, rows, seconds in found
            ]

    def counts(self) -> Counts:
        """Count tasks and outcomes."""
        with _translated(self.path), closing(self._open("rw")) as db:
            total = db.execute("SELECT count(*) FROM tasks").fetchone()[0]
            states = dict(db.execute(f"SELECT state, count(*) {_OF_TASKS} GROUP BY state"))
            started = db.execute("SELECT max(started) FROM runs").fetchone()[0]
            recent, latest = db.execute(
                f"SELECT count(*), max(finished) {_OF_TASKS} AND finished >= ?",
                (started or 0.0,),
            ).fetchone()
        with _sound(self.path):
            times = [time if time is None else float(time) for time in (started, latest)]
        done = states.pop("done", 0)
        return Counts(total, done, sum(states.values()), recent, *times)


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open the file; readers may write too, since they undo what a killed writer left."""
    uri = f"file:{quote(str(path.absolute()))}?mode={mode}"
    db = sqlite3.connect(uri, timeout=_PATIENCE, isolation_level=None, uri=True)
    db.execute("PRAGMA synchronous = FULL")
    return db


def _meta(db: sqlite3.Connection, path: Path) -> dict[str, str]:
    """Read what a study says of itself; nothing of an empty file."""
    if not db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        return {}
    if db.execute("PRAGMA application_id").fetchone()[0] != _APPLICATION:
        raise FormatError(f"{path}: found a database of another program, expected a study")
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version not in (_UNSEALED, _VERSION):
        raise FormatError(f"{path}: found a study of version {version}, expected {_VERSION}")
    return dict(db.execute("SELECT key, value FROM meta"))


def _seal(rows: str) -> str:
    """Compute the checksum that stands before stored rows."""
    return hashlib.sha256(rows.encode()).hexdigest()[:_SEAL]


def _of(kind: type, found: Any) -> Any:
    """Return what is of a type; anything else is damage."""
    if not isinstance(found, kind):
        raise ValueError(f"found {found!r:.40}, expected {kind.__name__}")
    return found


def _state(found: Any) -> str:
    if found not in _STATES:
        raise ValueError(f"found the state {found!r:.40}, expected one of {', '.join(_STATES)}")
    return str(found)


def _listed(text: str) -> list[dict[str, Any]]:
    """Read rows of the table; an outcome has one at least."""
    rows = _of(list, json.loads(text))
    if not rows:
        raise ValueError("found no rows")
    return [_of(dict, row) for row in rows]


def _blob(found: Any) -> bytes:
    return bytes(found) if isinstance(found, bytes) else b""


@contextmanager
def _sound(path: Path) -> Iterator[None]:
    """Turn errors of what was read into one that says that the file is damaged."""
    try:
        yield
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FormatError(f"{path}: found a damaged file: {error}") from error


@contextmanager
def _transaction(db: sqlite3.Connection, mode: str = "IMMEDIATE") -> Iterator[None]:
    db.execute(f"BEGIN {mode}")
    try:
        yield
    except BaseException:
        db.execute("ROLLBACK")
        raise
    db.execute("COMMIT")


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Turn errors of SQLite into ours."""
    try:
        yield
    except UnicodeDecodeError as error:  # where a message of SQLite quotes damaged names
        raise FormatError(f"{path}: found a damaged file: {error}") from error
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
            raise FormatError(f"{path}: found a damaged file or no study: {error}") from error
        raise OutputError(f"{path}: {error}") from error
