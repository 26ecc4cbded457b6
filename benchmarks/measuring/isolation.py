"""Measure in a child process: what crashes a library ends one case and not the run."""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator

from ..errors import BenchmarkError
from .records import Row

__all__ = ["Crash", "isolated"]

_WRONG_INPUT = "!"  # first letter of a line that is no row but a message


class Crash(RuntimeError):
    """The child process ended before it was done; the message says how."""


def isolated(rows: Callable[[], Iterable[Row]]) -> Iterator[Row]:
    """Rows that a child process makes, as they come; where there is no fork, made here.

    Raises
    ------
    BenchmarkError
        If the child meets wrong input.
    Crash
        If it dies.
    """
    if not hasattr(os, "fork"):
        yield from rows()
        return
    sys.stdout.flush()
    sys.stderr.flush()
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of threads: libraries hold idle ones
        child = os.fork()
    if child == 0:
        os.close(reading)
        _work(rows, writing)
    os.close(writing)
    try:
        with os.fdopen(reading, encoding="utf-8") as lines:
            for line in lines:
                if line.startswith(_WRONG_INPUT):
                    raise BenchmarkError(line[1:].strip())
                yield Row.from_json(line)
    finally:
        _, status = os.waitpid(child, 0)
    if status:
        raise Crash(_words(os.waitstatus_to_exitcode(status)))


def _work(rows: Callable[[], Iterable[Row]], writing: int) -> None:
    """The child's life: rows into the pipe, and no way back into the caller's code."""
    code = 1
    try:
        with os.fdopen(writing, "w", encoding="utf-8") as pipe:
            try:
                for row in rows():
                    print(row.to_json(), file=pipe, flush=True)
            except BenchmarkError as error:
                print(_WRONG_INPUT + " ".join(str(error).split()), file=pipe)
        code = 0
    except BaseException:  # the parent hears of it by the exit code
        traceback.print_exc()
    finally:
        os._exit(code)


def _words(code: int) -> str:
    return f"exit code {code}" if code > 0 else f"killed by {signal.Signals(-code).name}"
