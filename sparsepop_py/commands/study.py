"""Run and read studies from the command line: ``sparsepop study run|status|export``."""

from __future__ import annotations

import argparse
from typing import Any

from sparsepop_py.commands.parsers import add_command
from sparsepop_py.errors import FormatError, ProblemError, check_writable
from sparsepop_py.study.store import Store
from sparsepop_py.study.study import BaseStudy, status_of, table_of

__all__ = ["add_study"]


def add_study(commands: Any, study: type[BaseStudy]) -> argparse.ArgumentParser:
    """Add the command ``study`` to a command line.

    Parameters
    ----------
    commands : argparse subparsers
    study : type of BaseStudy
        Of the tasks that ``study run`` runs. The other commands read studies of any kind.

    Returns
    -------
    argparse.ArgumentParser
        Of ``study run``. Its default ``prepare`` may be set to a function of the arguments that
        returns tasks for ``add_all``.
    """
    text = "run, watch and export studies: many problems in one file"
    command = add_command(commands, "study", text)
    inner = command.add_subparsers(required=True, metavar="COMMAND")
    runs = _inner(inner, "run", "do the tasks that have no outcome yet", _run)
    runs.set_defaults(study_type=study, prepare=None)
    runs.add_argument("--workers", type=int, metavar="N", help="processes (1)")
    runs.add_argument("--retry", action="store_true", help="try failed tasks again")
    _inner(inner, "status", "count the tasks, also while another process runs them", _status)
    exports = _inner(inner, "export", "write the table", _export)
    exports.set_defaults(study_type=study)
    exports.add_argument("out", metavar="OUT", help="ends in .csv or .json")
    exports.add_argument("--timings", action="store_true", help="with the time of each task")
    exports.add_argument("--results", metavar="FOLDER", help="results for checker/check.py too")
    return runs


def _inner(commands: Any, name: str, text: str, run: Any) -> argparse.ArgumentParser:
    command = add_command(commands, name, text, run)
    command.add_argument("study", metavar="STUDY", help="the file of the study")
    return command


def _run(arguments: argparse.Namespace) -> int:
    """Return 0 if every task has a result, else 1."""
    if arguments.workers is not None and arguments.workers < 1:
        raise ProblemError(f"--workers: found {arguments.workers}, expected an integer >= 1")
    check_writable(arguments.study, "STUDY")
    tasks = arguments.prepare(arguments) if arguments.prepare is not None else []
    if not tasks:
        _expect(arguments.study, arguments.study_type)
    study = arguments.study_type(arguments.study)  # wrong input has left no study behind
    if tasks:
        study.add_all(tasks)
    status = study.run(arguments.workers, retry=arguments.retry)
    print(f"{arguments.study}: {status}")
    return 0 if status.done == status.total else 1


def _expect(path: str, study: type[BaseStudy]) -> None:
    """Refuse a file that is missing or of another kind."""
    kind = Store(path).kind
    if kind != study.work.kind:
        name = {"solve": "sparsepop", "identify": "setid"}.get(kind, kind)
        raise FormatError(f"{path}: found a study of another kind; say: {name} study run {path}")


def _status(arguments: argparse.Namespace) -> int:
    status = status_of(Store(arguments.study))
    print(f"{arguments.study}: {status}{', running' if status.running else ''}")
    return 0 if status.done == status.total else 1


def _export(arguments: argparse.Namespace) -> int:
    check_writable(arguments.out, "OUT")
    store = Store(arguments.study)
    if arguments.results:
        _expect(arguments.study, arguments.study_type)
    table_of(store, arguments.timings).write(arguments.out)
    if arguments.results:
        arguments.study_type(arguments.study).export_results(arguments.results)
    return 0
