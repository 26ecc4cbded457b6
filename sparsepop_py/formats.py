"""Read and write problems in any registered file format, by file ending.

To add a format, write a file with a :class:`Format` and enter it in ``FORMATS`` by its ending.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sparsepop_py.compat.mat import read_mat, write_mat
from sparsepop_py.errors import FormatError, ProblemError
from sparsepop_py.files import as_path, read_text
from sparsepop_py.io.gams import read_gms, write_gms
from sparsepop_py.io.json_files.files import read_json, write_json
from sparsepop_py.io.other_software.linear_files import read_linear
from sparsepop_py.io.other_software.mps import read_mps
from sparsepop_py.io.other_software.qplib import read_qplib
from sparsepop_py.io.other_software.scip_ import read_by_scip
from sparsepop_py.io.text import parse
from sparsepop_py.plugins.registry import Registry
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem

__all__ = ["FORMATS", "Format", "read", "read_stream", "write"]

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class Format:
    """A file format of problems.

    Parameters
    ----------
    read : callable
        From a path to a :class:`~sparsepop_py.Problem` (or to what holds one as ``problem``). It
        raises FormatError with file, line, what was found and what was expected.
    write : callable or None
        From a problem and a path to a file; None where the format is only read.
    """

    read: Callable[[Any], Any]
    write: Callable[[Any, Any], None] | None = None


def _read_text(path: PathLike) -> Problem | RationalProblem:
    text = read_text(path)
    try:
        return parse(text)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error


FORMATS: Registry[Format] = Registry(
    "file ending",
    {
        ".gms": Format(read_gms, write_gms),
        ".json": Format(read_json, write_json),
        ".mat": Format(read_mat, write_mat),
        ".txt": Format(_read_text),
        ".mps": Format(read_mps),
        ".lp": Format(read_linear),
        ".qplib": Format(read_qplib),
        ".nl": Format(read_by_scip),
        ".pip": Format(read_by_scip),
        ".osil": Format(read_by_scip),
    },
    FormatError,
    of=Format,
    prefix=".",
)


def read(path: PathLike) -> Problem | RationalProblem:
    """Read a problem from a file, in the format of its ending.

    Parameters
    ----------
    path : str or PathLike
        ``.gms`` (GAMS scalar format), ``.json``, ``.mat`` (SparsePOP's structs), ``.txt`` (the
        text that :func:`~sparsepop_py.parse` reads), ``.mps``, ``.lp``, ``.qplib``, with the
        extra ``scip`` also ``.nl``, ``.pip`` and ``.osil``, or an ending that was registered.

    Returns
    -------
    Problem or RationalProblem
        Of a file that holds a result, the problem in it.

    Raises
    ------
    FormatError
        If the ending is unknown, the file cannot be read or holds no problem.
    ProblemError
        If the problem in it is malformed.
    SolverNotFound
        If the package that reads the format is not installed.

    Examples
    --------
    >>> import pathlib, sparsepop_py as sp
    >>> _ = pathlib.Path("square.txt").write_text("min x1^2 - x1; s.t. x1 >= 0")
    >>> sp.read("square.txt").dimension
    1
    """
    reader, ending = _format(path).read, as_path(path).suffix.lower()
    try:
        found = FORMATS.ask(ending, reader, path)
    except (ProblemError, FormatError) as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error
    kinds = (Problem, RationalProblem)
    problem = found if isinstance(found, kinds) else getattr(found, "problem", None)
    if not isinstance(problem, kinds):
        raise FormatError(f"{path}: found a {type(found).__name__}, expected a problem")
    return problem


def read_stream(
    data: bytes, ending: str | None = None, name: str = "<stdin>"
) -> Problem | RationalProblem:
    """Read a problem from the bytes of a file, not by its name.

    Parameters
    ----------
    data : bytes
    ending : str, optional
        Such as ``.gms``; found from the content when left out: ``.json``, ``.mat``, ``.gms`` or
        ``.txt``.
    name : str
        What messages say in place of the path.

    Returns
    -------
    Problem

    Raises
    ------
    FormatError, ProblemError
        As :func:`read`.

    Examples
    --------
    >>> print(read_stream(b"min x1^2; s.t. x1 >= 1"))
    min x1^2
      s.t. -1 + x1 >= 0
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"input{ending or _guessed(data)}")
        path.write_bytes(data)
        try:
            return read(path)
        except (FormatError, ProblemError) as error:
            raise type(error)(str(error).replace(str(path), name)) from None


def _guessed(data: bytes) -> str:
    """Guess the ending of a file from its content."""
    start = data[:400].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(b"{"):
        return ".json"
    if start.startswith((b"MATLAB", b"\x89HDF")) or b"\x00" in start:
        return ".mat"
    gams = re.search(rb"^\s*([a-z]+\s+)?(variables?|equations?|binaries)\b", data, re.I | re.M)
    return ".gms" if gams and b".." in data else ".txt"


def write(problem: Problem | RationalProblem, path: PathLike) -> None:
    """Write a problem to a file, in the format of its ending.

    Parameters
    ----------
    problem : Problem or RationalProblem
    path : str or PathLike
        ``.gms``, ``.json`` or ``.mat``; the others of :func:`read` are only read.

    Raises
    ------
    FormatError
        If the ending is unknown or the format is only read.
    ProblemError
        If the first argument is no problem, or the format cannot hold it.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> sp.write(sp.Problem(x * y, [x**2 + y**2 <= 1]), "disc.gms")
    >>> sp.read("disc.gms").degree
    2
    """
    if not isinstance(problem, (Problem, RationalProblem)):
        raise ProblemError(f"write: found {type(problem).__name__}, expected a Problem")
    found = _format(path)
    if found.write is None:
        raise FormatError(f"{path}: this format is only read")
    FORMATS.ask(as_path(path).suffix.lower(), found.write, problem, path)


def _format(path: PathLike) -> Format:
    ending = as_path(path).suffix.lower()
    if ending not in FORMATS:
        known = ", ".join(FORMATS)
        raise FormatError(f"{path}: found the ending {ending!r}, expected one of {known}")
    return FORMATS[ending]
