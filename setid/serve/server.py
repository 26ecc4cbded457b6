"""Server of the page: records, jobs and downloads over HTTP on this machine alone."""

from __future__ import annotations

import json
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import sparsepop_py as sp
from setid.data.checks import word
from setid.data.record import IOData
from setid.data.tables import column_names
from setid.errors import DataError, SetidError
from setid.serve.work import Form, check_columns, check_lines, check_samples, read_form, work
from sparsepop_py.executors.processes import Processes, WorkerLost

__all__ = ["Jobs", "make_app", "serve"]

MOST_BYTES = 16 * 2**20
SILENCE = 60.0  # seconds that a client may leave a request unfinished
_MOST_KEPT = 8  # records and jobs; older ones go
_HOSTS = ("127.0.0.1", "localhost")
_FILES = {
    "report.txt": "text/plain",
    "result.json": "application/json",
    "certificate.json": "application/json",
    "record.csv": "text/csv",
}


def _flask() -> Any:
    try:
        import flask
    except ImportError as error:
        raise sp.SolverNotFound(
            "serve: flask is missing; install it with: pip install 'sparsepop-py[serve]'"
        ) from error
    return flask


@dataclass(frozen=True, slots=True)
class _Table:
    """A table that was sent, and its decimal mark."""

    path: Path
    decimal: str


@dataclass(eq=False)
class _Job:
    """One identification at work or done. Mutable."""

    folder: Path
    pool: Processes
    future: Future[dict[str, Any]]
    begin: float = field(default_factory=time.monotonic)
    end: float | None = None
    stopped: bool = False

    def __post_init__(self) -> None:
        self.future.add_done_callback(self._note)

    def _note(self, _: Future[dict[str, Any]]) -> None:
        self.end = time.monotonic()

    def state(self) -> dict[str, Any]:
        """Say how far it is, with the sections that are done."""
        found: dict[str, Any] = {"state": "running", "sections": [], "files": []}
        try:
            found |= json.loads((self.folder / "progress.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            pass
        if self.future.done():
            found |= self._ended()
        last = time.monotonic() if self.end is None else self.end
        return found | {"seconds": round(last - self.begin, 1)}

    def _ended(self) -> dict[str, Any]:
        if self.future.cancelled():  # stopped before it began
            return {"state": "stopped"}
        error = self.future.exception()
        if error is None:
            return {"state": "done", **self.future.result()}
        if self.stopped:
            return {"state": "stopped"}
        lost = isinstance(error, WorkerLost)
        text = "the process ended; it may have run out of memory" if lost else str(error)
        return {"state": "failed", "error": text}

    def stop(self) -> None:
        """End it now."""
        self.stopped = self.stopped or not self.future.done()
        self.pool.stop()


class Jobs:
    """Records and jobs of a server, the newest few. Mutable; for many threads.

    Parameters
    ----------
    folder : Path
        For the files; emptied by :meth:`close`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._lock, self._count = folder, threading.Lock(), 0
        self._records: dict[str, _Table] = {}
        self._jobs: dict[str, _Job] = {}

    def _name(self) -> str:
        self._count += 1
        return str(self._count)

    def add_record(self, content: bytes, decimal: str = ".") -> tuple[str, dict[str, Any]]:
        """Keep a table and say what is in it.

        Parameters
        ----------
        content : bytes
        decimal : {".", ","}
            The decimal mark.

        Raises
        ------
        DataError
            If it is no table of numbers, or too long.
        """
        with self._lock:
            name = self._name()
            path = self._folder / f"record{name}.csv"
        check_lines(content)
        path.write_bytes(content)
        try:
            word(decimal, "decimal", (".", ","), DataError)
            columns = column_names(path, decimal)
            check_columns(columns)
            data = IOData.from_csv(path, 0, len(columns) - 1, decimal=decimal)
            check_samples(data)
        except SetidError as error:
            path.unlink()
            raise DataError(str(error).replace(str(path), "the file")) from None
        with self._lock:
            self._records[name] = _Table(path, decimal)
            for old in list(self._records)[:-_MOST_KEPT]:
                self._records.pop(old).path.unlink(missing_ok=True)
        return name, {"columns": columns, "samples": data.samples}

    def start(self, record: Any, given: dict[str, Any]) -> str:
        """Start an identification; an earlier one ends.

        Parameters
        ----------
        record : str
        given : dict
            As of :func:`~setid.serve.work.read_form`.

        Raises
        ------
        SetidError
            If a field is wrong.
        """
        table = self._records.get(record) if isinstance(record, str) else None
        if table is None:
            raise DataError("record: found none of this name, expected one that was sent")
        try:
            form: Form = read_form(table.path, given, table.decimal)
        except SetidError as error:
            raise SetidError(str(error).replace(str(table.path), "the file")) from None
        with self._lock:
            for job in self._jobs.values():
                job.stop()
            name = self._name()
            folder = self._folder / f"job{name}"
            folder.mkdir()
            pool = Processes(1)
            self._jobs[name] = _Job(folder, pool, pool.submit(work, form, str(folder)))
            for old in list(self._jobs)[:-_MOST_KEPT]:
                shutil.rmtree(self._jobs.pop(old).folder, ignore_errors=True)
        return name

    def job(self, name: str) -> _Job | None:
        """Find a job; None where there is none.

        Parameters
        ----------
        name : str
        """
        return self._jobs.get(name)

    def close(self) -> None:
        """End all jobs and delete all files."""
        for job in self._jobs.values():
            job.stop()
        shutil.rmtree(self._folder, ignore_errors=True)


class _Routes:
    """Answers to requests."""

    def __init__(self, jobs: Jobs, flask: Any) -> None:
        self._jobs, self._flask = jobs, flask

    def guard(self) -> Any:
        """Refuse names of other hosts, and changes that another site's page asks for."""
        request = self._flask.request
        if request.host.rsplit(":", 1)[0] not in _HOSTS:
            return {"error": "host: expected 127.0.0.1"}, 403
        if request.method != "GET" and request.headers.get("X-Setid") != "page":
            return {"error": "request: expected one of the page"}, 403
        return None

    def secure(self, response: Any) -> Any:
        """Let the page load nothing from elsewhere."""
        response.headers.update(_HEADERS)
        return response

    def page(self) -> Any:
        """Send the page."""
        return self._flask.Response(_own("page.html"), mimetype="text/html")

    def script(self) -> Any:
        """Send the script of the page."""
        return self._flask.Response(_own("page.js"), mimetype="text/javascript")

    def add_record(self) -> Any:
        """Take a table."""
        request = self._flask.request
        if "Transfer-Encoding" in request.headers:  # such a body ends at the limit, unsaid
            return {
                "error": "record: found no Content-Length, expected the length of the file"
            }, 411
        decimal = request.args.get("decimal", ".")
        name, found = self._jobs.add_record(request.get_data(), decimal)
        return {"record": name, **found}

    def start(self) -> Any:
        """Start a job."""
        try:
            given = self._flask.request.get_json(silent=True)
        except RecursionError:
            given = None
        if not isinstance(given, dict):
            raise DataError("request: expected a JSON object")
        return {"job": self._jobs.start(given.get("record"), given)}

    def state(self, name: str) -> Any:
        """Say how far a job is."""
        job = self._jobs.job(name)
        return _NONE if job is None else job.state()

    def stop(self, name: str) -> Any:
        """End a job."""
        job = self._jobs.job(name)
        if job is None:
            return _NONE
        job.stop()
        return job.state()

    def download(self, name: str, file: str) -> Any:
        """Send a file of a job."""
        job = self._jobs.job(name)
        if job is None or file not in _FILES or not (job.folder / file).is_file():
            return _NONE
        headers = {"Content-Disposition": f"attachment; filename={file}"}
        content = (job.folder / file).read_bytes()
        return self._flask.Response(content, mimetype=_FILES[file], headers=headers)


_NONE = {"error": "found none of this name"}, 404
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; "
    "connect-src 'self'; img-src 'self' data:; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


def _too_large(error: Any) -> Any:
    return {"error": f"record: found more than {MOST_BYTES >> 20} MiB, expected less"}, 413


def _wrong(error: Any) -> Any:
    return {"error": str(error)}, 400


def _refused(error: Any) -> Any:
    return {"error": f"request: {error.description}"}, error.code


def _failed(error: Any) -> Any:
    traceback.print_exception(error)
    return {"error": f"the server failed, please report it: {error!r:.300}"}, 500


def make_app(jobs: Jobs) -> Any:
    """Make the application; requests of other hosts and sites are refused.

    Parameters
    ----------
    jobs : Jobs

    Returns
    -------
    flask.Flask

    Raises
    ------
    SolverNotFound
        If flask is not installed.
    """
    flask = _flask()
    from werkzeug.exceptions import HTTPException

    app, routes = flask.Flask("setid.serve", static_folder=None), _Routes(jobs, flask)
    app.config["MAX_CONTENT_LENGTH"] = MOST_BYTES
    app.before_request(routes.guard)
    app.after_request(routes.secure)
    app.register_error_handler(413, _too_large)
    app.register_error_handler(HTTPException, _refused)
    app.register_error_handler(Exception, _failed)
    app.register_error_handler(SetidError, _wrong)
    app.register_error_handler(sp.SparsePOPError, _wrong)
    app.add_url_rule("/", view_func=routes.page)
    app.add_url_rule("/page.js", view_func=routes.script)
    app.add_url_rule("/records", view_func=routes.add_record, methods=["POST"])
    app.add_url_rule("/jobs", view_func=routes.start, methods=["POST"])
    app.add_url_rule("/jobs/<name>", view_func=routes.state)
    app.add_url_rule("/jobs/<name>", view_func=routes.stop, methods=["DELETE"])
    app.add_url_rule("/jobs/<name>/<file>", view_func=routes.download)
    return app


def _own(name: str) -> str:
    return resources.files("setid.serve").joinpath(name).read_text(encoding="utf-8")


def _handler() -> Any:
    """Make the class that handles requests and gives up those whose clients fall silent."""
    from werkzeug.serving import WSGIRequestHandler

    class Handler(WSGIRequestHandler):
        timeout = SILENCE  # of the socket

    return Handler


def serve(port: int = 8321, on_start: Callable[[str], object] | None = None) -> None:
    """Serve the page on 127.0.0.1 until Ctrl-C, SIGTERM or SIGHUP.

    Parameters
    ----------
    port : int
        0 takes any that is free.
    on_start : callable, optional
        Called with the address when it is served.

    Raises
    ------
    SolverNotFound
        If flask is not installed.
    OSError
        If the port is taken.
    """
    _flask()
    from werkzeug.serving import make_server

    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):  # so that the files are deleted then, too
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # nohup
                signal.signal(number, signal.default_int_handler)
    try:
        kept = tempfile.TemporaryDirectory(prefix="setid-", ignore_cleanup_errors=True)
        with kept as folder, closing(Jobs(Path(folder))) as jobs:
            server = make_server(
                "127.0.0.1", port, make_app(jobs), True, request_handler=_handler()
            )
            with closing(server.socket):
                if on_start is not None:
                    on_start(f"http://127.0.0.1:{server.server_port}/")
                server.serve_forever()
    except KeyboardInterrupt:
        pass
