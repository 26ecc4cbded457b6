"""Serve tasks in a process that :class:`~sparsepop_py.executors.processes.Processes` started."""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
import traceback
from typing import Any

__all__ = ["serve"]


def serve() -> None:
    """Do the tasks that come through standard input until it ends; then end at once.

    What tasks print goes to standard error.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks,), daemon=True).start()
    while True:
        answers.write(_answer(tasks.get()))
        answers.flush()


def _listen(tasks: queue.SimpleQueue[bytes]) -> None:
    """Queue what comes in; when the other end is gone, nobody waits for an answer."""
    while True:
        try:
            tasks.put(pickle.load(sys.stdin.buffer))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)


def _answer(call: bytes) -> bytes:
    """Do a pickled call and pickle (True, result) or (False, exception)."""
    try:
        function, arguments, named = pickle.loads(call)
        return pickle.dumps((True, function(*arguments, **named)), 5)
    except Exception as error:  # whatever the task raises: its future raises it
        found: Any = error
        found.add_note(traceback.format_exc())
        try:
            return pickle.dumps((False, pickle.loads(pickle.dumps(found, 5))), 5)
        except Exception:  # exceptions whose arguments do not pickle
            return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")), 5)
