"""Problems, certificates and results as JSON, exactly.

A certificate that is read back is verified like any other: it is multipliers and claims, and
nothing in a file is believed. Trees are written as lists of nodes with the numbers of their
children, and certificates that quote others as lists with those quoted first.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sparsepop_py.errors import ProblemError
from sparsepop_py.files import read_text, write_text
from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.certificates import CERTIFICATE
from sparsepop_py.io.json_files.codecs import Codec
from sparsepop_py.io.json_files.rational import (
    RATIONAL_CERTIFICATE,
    RATIONAL_PROBLEM,
    RATIONAL_RESULT,
)
from sparsepop_py.io.json_files.values import PROBLEM, RESULT
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.result import Result
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.rational_bound import RationalCertificate

__all__ = ["from_json", "read_json", "to_json", "write_json"]

_FORMAT, _VERSION, _READ = "sparsepop-py", 7, (3, 4, 5, 6, 7)
_RAYS = 4  # the version from which results have rays
Value = Problem | Certificate | Result | RationalProblem | RationalCertificate | RationalResult


def to_json(value: Value) -> str:
    """Convert a problem, certificate or result to JSON text.

    Parameters
    ----------
    value : Problem, Certificate or Result
        Or one about ratios: RationalProblem, RationalCertificate, RationalResult. A result is
        written without its relaxation and solution, on which nothing rests.

    Returns
    -------
    str

    Raises
    ------
    ProblemError
        If it is something else.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.Problem(x * y, [x**2 + y**2 <= 1])
    >>> certificate = sp.from_json(sp.to_json(sp.solve(problem).certificate))
    >>> certificate.verify(sp.from_json(sp.to_json(problem))).ok
    True
    """
    for kind, (name, codec, _) in _KINDS.items():
        if isinstance(value, kind):
            found = {"format": _FORMAT, "version": _VERSION, "is": name, name: codec.write(value)}
            return json.dumps(found, allow_nan=False, separators=(",", ":"))
    own = " (this object has a method to_json of its own)" if hasattr(value, "to_json") else ""
    raise ProblemError(
        f"to_json: found {type(value).__name__}, expected a Problem, Certificate or Result{own}"
    )


def from_json(source: str) -> Any:
    """Read the JSON text of :func:`to_json`, of version 7 or of versions 3 to 6.

    Parameters
    ----------
    source : str
        The text itself; :func:`read_json` takes a path.

    Returns
    -------
    Problem, Certificate or Result
        Or one about ratios.

    Raises
    ------
    ProblemError
        If the text is malformed; the message names the place.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, y = sp.variables(2)
    >>> problem = sp.from_json(sp.to_json(sp.Problem(x * y, [x + y <= 1])))
    >>> print(problem)
    min x1*x2
      s.t. 1 - x1 - x2 >= 0
    """
    try:
        found = codecs.parsed(source)
    except ValueError as error:
        raise ProblemError(f"JSON: {error}") from error
    if isinstance(found, dict) and "format" not in found and {"file", "sense"} <= set(found):
        raise ProblemError(
            "JSON: found what --json writes, numbers for other programs without their proofs, "
            "expected what `sparsepop solve --certificate` or write_json writes"
        )
    if codecs.field_of(found, "format", "JSON") != _FORMAT:
        raise codecs.wrong("JSON.format", found["format"], repr(_FORMAT))
    version = codecs.field_of(found, "version", "JSON")
    if type(version) is not int or version not in _READ:
        raise codecs.wrong(
            "JSON.version", version, "one of the integers " + ", ".join(map(str, _READ))
        )
    name = codecs.field_of(found, "is", "JSON")
    for known, codec, since in _KINDS.values():
        if name == known and version >= since:
            content = codecs.field_of(found, name, "JSON")
            if name == "result" and version < _RAYS:
                codecs.fields_of(content, name).setdefault("ray", None)
            return codec.read(content, name)
    known_here = [kind for kind, _, since in _KINDS.values() if version >= since]
    raise codecs.wrong("JSON.is", name, "one of " + ", ".join(known_here))


def write_json(value: Value, path: str | Path) -> None:
    """Write a problem, certificate or result to a JSON file, whole or not at all.

    Parameters
    ----------
    value : Problem, Certificate or Result
    path : str or Path

    Raises
    ------
    ProblemError
        If the value is something else.
    OutputError
        If the file cannot be written.

    Examples
    --------
    >>> import sparsepop_py as sp, pathlib, tempfile
    >>> x, = sp.variables(1)
    >>> result = sp.solve(sp.Problem(x, lower=0, upper=1))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sp.write_json(result, pathlib.Path(folder) / "result.json")
    ...     again = sp.read_json(pathlib.Path(folder) / "result.json")
    >>> again.lower_bound == result.lower_bound, again.certificate.verify(result.problem).ok
    (True, True)
    """
    write_text(path, to_json(value))


def read_json(path: str | Path) -> Any:
    """Read a file of :func:`write_json`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Problem, Certificate or Result
        Or one about ratios.

    Raises
    ------
    FormatError
        If the file cannot be read.
    ProblemError
        If its text is malformed; the message names the file.

    Examples
    --------
    >>> import sparsepop_py as sp, pathlib, tempfile
    >>> x, = sp.variables(1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "problem.json"
    ...     sp.write_json(sp.Problem(x, lower=0, upper=1), path)
    ...     print(sp.read_json(path).upper)
    [1.]
    """
    text = read_text(path)
    try:
        return from_json(text)
    except ProblemError as error:
        raise type(error)(f"{path}: {error}") from error


_KINDS: dict[type, tuple[str, Codec, int]] = {
    Problem: ("problem", PROBLEM, 2),
    Certificate: ("certificate", CERTIFICATE, 2),
    Result: ("result", RESULT, 2),
    RationalProblem: ("rational_problem", RATIONAL_PROBLEM, 4),
    RationalCertificate: ("rational_certificate", RATIONAL_CERTIFICATE, 4),
    RationalResult: ("rational_result", RATIONAL_RESULT, 4),
}
