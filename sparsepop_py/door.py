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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sps
from numpy.typing import NDArray

from .certificate.certificate import Certificate
from .errors import SparsePOPError
from .parameter_table import FIELDS
from .parameters import Parameters
from .sparsepop import sparsePOP
from .sparsepop_output import POPOutput, SparsePOPOutput

__all__ = ["answer", "folder", "main", "serve"]

_END = "\x04\n"  # the line that ends an answer
_EMPTY = np.zeros((0, 0))

# Fields that scripts may read of the original's structs: empty where there is no value here.
_ORIGINAL = {
    "POP": """xVect objValue objValueScaled absError scaledError xVectL objValueL absErrorL
        scaledErrorL""",
    "cpuTime": "conversion SDPsolver total readData localMethod",
    "SDPsolverInfo": "iter feasratio pinf dinf numerr r0 timing wallsec cpusec err",
    "SDPinfo": """rowSizeA colSizeA nonzerosInA noOfFreevar noOfLPvariables SOCPblock SDPblock
        reduceAMatSW infeasibleSW objConstant objValScale SeDuMiA SeDuMib SeDuMic SeDuMiK Amat
        bVect dimVar0 dimVar fixedVar x y xIdxVec""",
}


def folder() -> Path:
    """The folder to put on the path of MATLAB or Octave.

    Examples
    --------
    >>> (folder() / "sparsePOP.m").exists()
    True
    """
    return Path(__file__).resolve().parent / "matlab"


def answer(path: str | os.PathLike[str]) -> None:
    """Read a question, call ``sparsePOP`` and write the answer to the same file.

    Parameters
    ----------
    path : path of a MAT file (version 6)
        It holds ``arguments``, a cell array with those of
        :func:`~sparsepop_py.sparsepop.sparsePOP`, and ``folder``, to which names of files are
        relative. Afterwards it holds ``outputs``, a cell array of the six outputs as structs,
        ``warnings``, a cell array of texts, and ``error``, a text that is empty without one.

    Examples
    --------
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
    question = scipy.io.loadmat(path, mat_dtype=True)
    reply: dict[str, Any] = {"outputs": _cell([], row=True), "error": ""}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            os.chdir(_text(question["folder"]))
            output = sparsePOP(*map(_text, question["arguments"].ravel()))
            reply["outputs"] = _cell(_structs(output), row=True)
        except (SparsePOPError, OSError) as error:
            reply["error"] = _counted_from_one(str(error))
    reply["warnings"] = _cell([_counted_from_one(str(warning.message)) for warning in caught])
    sys.stdout.flush()
    scipy.io.savemat(path, reply, long_field_names=True, oned_as="column")


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
    """``python -m sparsepop_py.door`` serves; with the word ``folder`` it prints that."""
    words = list(sys.argv[1:] if argv is None else argv)
    if not words:
        serve()
    if words != ["folder"]:
        sys.stderr.write("usage: python -m sparsepop_py.door [folder]\n")
        return 2
    sys.stdout.write(f"{folder()}\n")
    return 0


def _listen(questions: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        questions.put(line.rstrip("\r\n"))
    os._exit(0)  # the parent has ended: nobody waits for an answer


# ---- questions --------------------------------------------------------------------------


def _text(value: Any) -> Any:
    """A char array as a string; anything else as it is."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return "".join(value.ravel().tolist())
    return value


def _counted_from_one(message: str) -> str:
    """``ineqPolySys[0]`` as MATLAB counts and writes it."""
    return re.sub(
        r"\b(objPoly|ineqPolySys)\[(\d+)\]", lambda m: f"{m[1]}{{{int(m[2]) + 1}}}", message
    )


# ---- answers ----------------------------------------------------------------------------


def _structs(output: SparsePOPOutput) -> list[Any]:
    """The six outputs with the original's names first, in its order."""
    given = {name: _matlab(value) for name, value in output._asdict().items()}
    for name, known in _ORIGINAL.items():
        given[name] = dict.fromkeys(known.split(), _EMPTY) | given[name]
    return list(given.values())


def _matlab(value: Any) -> Any:
    """A value as MATLAB holds it: doubles, columns, rows of sizes, ``[]`` for None."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (str, bool, np.bool_)):
        return value
    if isinstance(value, (int, float, np.number)):
        return float(value)
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value  # a cell array already
    if value is None or np.size(value) == 0:
        return _EMPTY
    if sps.issparse(value):
        return sps.csc_matrix(value, dtype=float)
    if isinstance(value, (list, tuple)):
        numeric = all(isinstance(item, (int, float, np.number)) for item in value)
        return np.array([value], float) if numeric else _cell(map(_matlab, value), row=True)
    if isinstance(value, np.ndarray):
        return value
    return {name: _matlab(item) for name, item in _fields(value).items()}


def _fields(value: Any) -> dict[str, Any]:
    """The fields of a struct in MATLAB."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Parameters):
        every = {entry.name: getattr(value, entry.name) for entry in FIELDS} | dict(value.given)
        return {name: item for name, item in every.items() if item is not None}
    if isinstance(value, Certificate):
        names = ("bound", "cutoff", "leaves", "numbers", "fingerprint")
        return {"claim": str(value)} | {name: getattr(value, name) for name in names}
    found = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, POPOutput):
        del found["result"]
        found["notes"] = _cell(value.result.notes)
    return found


def _cell(items: Iterable[Any], row: bool = False) -> NDArray[np.object_]:
    """A cell array, column or row."""
    listed = list(items)
    cell = np.empty((len(listed), 1), dtype=object)
    for place, item in enumerate(listed):
        cell[place, 0] = item
    return cell.T if row else cell


if __name__ == "__main__":
    raise SystemExit(main())
