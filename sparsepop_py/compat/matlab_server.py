"""The door for MATLAB and Octave: ``sparsePOP`` asked and answered in MAT files.

``matlab/sparsePOP.m`` writes its arguments to a file and says its name, to :func:`answer` or
to a process that runs :func:`serve`. The answer is written over the question.
"""

from __future__ import annotations

import os
import queue
import re
import signal
import sys
import threading
import warnings
from collections.abc import Sequence
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sps

from sparsepop_py.compat.intervals import IntervalsDetail, interval_details
from sparsepop_py.compat.mat import load, save
from sparsepop_py.compat.output import (
    SparsePOPOutput,
    cell,
    intervals_struct,
    matlab_structs,
)
from sparsepop_py.compat.sparsepop import sparsePOP
from sparsepop_py.errors import ProblemError, SparsePOPError

__all__ = ["answer", "folder", "main", "serve"]

_END = "\x04\n"  # the line that ends an answer


def folder() -> Path:
    """Return the folder to put on the path of MATLAB or Octave.

    Returns
    -------
    Path

    Examples
    --------
    >>> (folder() / "sparsePOP.m").exists()
    True
    """
    return Path(__file__).resolve().parent / "matlab"


def answer(path: str | os.PathLike[str]) -> None:
    """Answer the question in a file, over which the answer is written.

    Parameters
    ----------
    path : path of a MAT file (version 6)
        It holds ``task``, ``sparsePOP`` (also when left out), ``sparsePOPintervals`` or
        ``module:function`` of setid;
        ``arguments``, a cell array with those of the function of that name; and ``folder``, to
        which names of files are relative. Afterwards it holds ``outputs``, a cell array of the
        outputs as structs (six, or one with the intervals), ``warnings``, a cell array of texts,
        and ``error``, a text that is empty without one.

    Examples
    --------
    >>> import os, numpy as np, scipy.io
    >>> square = {"typeCone": 1, "dimVar": 1, "noTerms": 2, "supports": [[1], [2]],
    ...           "coef": [-2, 1]}
    >>> arguments = np.empty((1, 5), dtype=object)
    >>> arguments[0] = [square, [], [-5], [5], {"printLevel": 0}]
    >>> scipy.io.savemat("question.mat", {"arguments": arguments, "folder": os.getcwd()})
    >>> answer("question.mat")
    >>> outputs = scipy.io.loadmat("question.mat", simplify_cells=True)["outputs"]
    >>> outputs[2]["status"], round(outputs[2]["xVect"], 6)
    ('OPTIMAL', 1.0)
    """
    path = Path(path).resolve()
    reply: dict[str, Any] = {"outputs": cell([], row=True), "error": ""}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            reply["outputs"] = cell(_outputs(_question(path)), row=True)
        except (SparsePOPError, OSError) as error:
            reply["error"] = _counted_from_one(str(error))
    reply["warnings"] = cell([_counted_from_one(str(warning.message)) for warning in caught])
    sys.stdout.flush()
    save(path, reply)


def _structs(found: SparsePOPOutput) -> list[Any]:
    return list(matlab_structs(found).values())


def _intervals(found: IntervalsDetail) -> list[Any]:
    return [intervals_struct(found)]


def _listed(found: Any) -> list[Any]:
    if not isinstance(found, list):
        raise ProblemError(
            f"task: found a function that returns {type(found).__name__}, expected a list of "
            "structs"
        )
    return found


_GUESTS = ("setid",)  # packages whose functions may be asked for by name
_TASKS: dict[str, tuple[Any, Any]] = {  # what is called, and what makes its outputs structs
    "sparsePOP": (sparsePOP, _structs),
    "sparsePOPintervals": (interval_details, _intervals),
}


def _outputs(question: dict[str, Any]) -> list[Any]:
    """Do what a question asks for, in its folder."""
    where = _field(question, "folder")
    if not isinstance(where, str):
        raise ProblemError(f"folder: found {type(where).__name__}, expected the path of a folder")
    called, made = _task(_text(question.get("task", "sparsePOP")))
    arguments = [_text(value) for value in np.ravel(_field(question, "arguments"))]
    try:
        signature(called).bind(*arguments)
    except TypeError as error:
        raise ProblemError(
            f"arguments: found {len(arguments)}, expected those of {called.__name__}: {error}"
        ) from None
    os.chdir(where)
    outputs: list[Any] = made(called(*arguments))
    return outputs


def _field(question: dict[str, Any], name: str) -> Any:
    if name not in question:
        raise ProblemError(f"question: found no variable {name!r}, expected arguments and folder")
    return _text(question[name])


def _task(name: Any) -> tuple[Any, Any]:
    """A task by its name, or ``module:function`` of a package that stands on this one."""
    expected = f"one of {', '.join(_TASKS)}, or module:function of {', '.join(_GUESTS)}"
    if isinstance(name, str) and name in _TASKS:
        return _TASKS[name]
    module, _, function = str(name).partition(":")
    if module.split(".")[0] not in _GUESTS:
        raise ProblemError(f"task: found {name!r}, expected {expected}")
    try:
        called = getattr(import_module(module), function)
    except (ModuleNotFoundError, AttributeError):
        called = None
    if not callable(called):
        raise ProblemError(f"task: found {name!r}, expected {expected}")
    return called, _listed


def serve() -> None:
    """Answer the files named on standard input, one a line, until it closes.

    What is printed goes to standard output, where the character EOT ends each answer. The
    process ends with its parent, even in the middle of a solve, and leaves Ctrl-C to it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    questions: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions,), daemon=True).start()
    while True:
        answer(questions.get())
        sys.stdout.write(_END)
        sys.stdout.flush()


def main(argv: Sequence[str] | None = None) -> int:
    """Serve requests; with the word ``folder`` print the folder for MATLAB's path.

    Called as ``python -m sparsepop_py.compat.matlab_server``.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if not words:
        serve()
    if words != ["folder"]:
        sys.stderr.write("usage: python -m sparsepop_py.compat.matlab_server [folder]\n")
        return 2
    sys.stdout.write(f"{folder()}\n")
    return 0


def _listen(questions: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        questions.put(line.rstrip("\r\n"))
    os._exit(0)  # the parent has ended: nobody waits for an answer


# ---- questions --------------------------------------------------------------------------


def _question(path: Path) -> dict[str, Any]:
    """Read the arguments of the file; complex numbers, which would lose a part, are refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        try:
            return load(path, mat_dtype=True)
        except np.exceptions.ComplexWarning:
            pass
    question = load(path)
    arguments = np.ravel(_field(question, "arguments"))
    names = ["objPoly", "ineqPolySys", "lbd", "ubd", "param"]
    task = _text(question.get("task", ""))
    if task == "sparsePOPintervals":
        names = ["ineqPolySys", "lbd", "ubd", "indices", "param"]
    elif ":" in task:
        names = list(signature(_task(task)[0]).parameters)
    elif arguments.size <= 2:
        del names[1:4]
    places = (_complex(value, name) for value, name in zip(arguments, names, strict=False))
    found = next((place for place in places if place), "arguments")
    raise ProblemError(f"{found}: found complex numbers, expected real ones")


def _complex(value: Any, place: str) -> str:
    """Locate complex numbers in structs and cells; empty for none."""
    if not isinstance(value, np.ndarray) or not value.size:
        return place if sps.issparse(value) and value.dtype.kind == "c" else ""
    if value.dtype.kind == "c":
        return place
    if value.dtype.names is not None:
        parts = [(value.ravel()[0][name], f"{place}.{name}") for name in value.dtype.names]
    elif value.dtype == object:
        parts = [(part, f"{place}[{k}]") for k, part in enumerate(value.ravel())]
    else:
        parts = []
    return next((found for part, name in parts if (found := _complex(part, name))), "")


def _text(value: Any) -> Any:
    """Convert a char array to a string; anything else stays."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return "".join(value.ravel().tolist())
    return value


def _counted_from_one(message: str) -> str:
    """``ineqPolySys[0]`` as MATLAB counts and writes it."""
    return re.sub(
        r"\b(objPoly|ineqPolySys)\[(\d+)\]", lambda m: f"{m[1]}{{{int(m[2]) + 1}}}", message
    )


if __name__ == "__main__":
    raise SystemExit(main())
