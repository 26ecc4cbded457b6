"""Problems, certificates and results as JSON, exactly.

A certificate that is read back is verified like any other: it is multipliers and claims, and
nothing in a file is believed. Trees are written as lists of nodes with the numbers of their
children, and certificates that quote others as lists with those quoted first.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.files import read_text, write_text
from sparsepop_py.io import json_codecs as codecs
from sparsepop_py.io import json_version2 as version2
from sparsepop_py.io.json_certificates import CERTIFICATE
from sparsepop_py.io.json_codecs import (
    Codec,
    array,
    number,
    optional,
    record,
    sequence,
    text,
    whole,
)
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.result import HistoryEntry, Point, Result, Status
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.points.feasible_point import ProvedPoint
from sparsepop_py.verified.points.unbounded_ray import falling_ray

__all__ = ["from_json", "read_json", "to_json", "write_json"]

_FORMAT, _VERSION, _READ = "sparsepop-py", 4, (2, 3, 4)
_DIGITS = 1e-12  # of a point's value, which is bounded anew where its proof is repeated


def to_json(value: Problem | Certificate | Result) -> str:
    """Convert a problem, certificate or result to JSON text.

    Parameters
    ----------
    value : Problem, Certificate or Result
        A result is written without its relaxation and solution, on which nothing rests.

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
    for kind, (name, codec) in _KINDS.items():
        if isinstance(value, kind):
            found = {"format": _FORMAT, "version": _VERSION, "is": name, name: codec.write(value)}
            return json.dumps(found, allow_nan=False, separators=(",", ":"))
    raise ProblemError(
        f"to_json: found {type(value).__name__}, expected a Problem, Certificate or Result"
    )


def from_json(source: str) -> Any:
    """Read the JSON text of :func:`to_json`, of this version or of versions 2 and 3.

    The certificate of a result of version 2 gets the fingerprint of today, if it had that of
    the result's problem. A certificate alone keeps its own: ``verify`` knows it.

    Parameters
    ----------
    source : str

    Returns
    -------
    Problem, Certificate or Result

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
        found = json.loads(source)
    except (TypeError, ValueError, RecursionError) as error:
        raise ProblemError(f"JSON: {error}") from error
    if codecs.field_of(found, "format", "JSON") != _FORMAT:
        raise codecs.wrong("JSON.format", found["format"], repr(_FORMAT))
    version = codecs.field_of(found, "version", "JSON")
    if type(version) is not int or version not in _READ:
        raise codecs.wrong("JSON.version", version, "one of " + ", ".join(map(str, _READ)))
    name = codecs.field_of(found, "is", "JSON")
    for known, codec in _KINDS.values():
        if name == known:
            content = codecs.field_of(found, name, "JSON")
            if version == 2:
                _upgrade(name, content)
            if name == "result" and version < _VERSION:
                codecs.fields_of(content, name).setdefault("ray", None)
            return codec.read(content, name)
    raise codecs.wrong("JSON.is", name, "one of " + ", ".join(n for n, _ in _KINDS.values()))


def _upgrade(name: str, content: Any) -> None:
    """Turn the content of a text of version 2 into that of today, in place."""
    if name == "certificate":
        version2.rename(content)
    elif name == "result":
        certificates = codecs.field_of(content, "certificate", name)
        version2.rename(certificates)
        version2.rename_skipped(content.get("options"))
        problem = PROBLEM.read(codecs.field_of(content, "problem", name), f"{name}.problem")
        version2.refingerprint(certificates, problem)


def write_json(value: Problem | Certificate | Result, path: str | Path) -> None:
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

    Raises
    ------
    FormatError
        If the file cannot be read.
    ProblemError
        If its text is malformed.

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
    return from_json(read_text(path))


# ---- problems -----------------------------------------------------------------------------


def _polynomial(words: Any, coefficients: Any, dimension: int) -> Polynomial:
    if words.ndim != 2 or coefficients.shape != (words.shape[0],) or dimension < 1:
        raise ProblemError(
            f"polynomial: found words {words.shape} and coefficients {coefficients.shape}, "
            "expected one word a coefficient"
        )
    if words.dtype != np.int32 or words.shape[1] < 1 or coefficients.dtype != np.float64:
        raise ProblemError("polynomial: found other types, expected i4 words and f8 coefficients")
    if words.size and not (words.min() >= 0 and words.max() <= dimension):
        raise ProblemError(f"polynomial: found a variable outside 1..{dimension}")
    return Polynomial.from_words(np.sort(words, axis=1), coefficients, dimension)


def _kind(found: Any, place: str) -> Kind:
    if not isinstance(found, str) or found not in Kind.__members__:
        raise codecs.wrong(place, found, "one of " + ", ".join(Kind.__members__))
    return Kind[found]


def _problem(names: tuple[str, ...], squares: Any, **parts: Any) -> Problem:
    return Problem(**parts, names=names, squares=squares or None)


POLYNOMIAL = record(_polynomial, words=array, coefficients=array, dimension=whole)
KIND = Codec(lambda kind: kind.name, _kind)
CONSTRAINT = record(
    Constraint, polynomial=POLYNOMIAL, kind=KIND, name=text, entries=sequence(POLYNOMIAL)
)
_WEIGHTED = Codec(
    lambda pair: [number.write(pair[0]), POLYNOMIAL.write(pair[1])],
    lambda found, place: _pair(found, place),
)


def _pair(found: Any, place: str) -> tuple[float, Polynomial]:
    if not isinstance(found, list) or len(found) != 2:
        raise codecs.wrong(place, found, "a weight and a polynomial")
    return number.read(found[0], place), POLYNOMIAL.read(found[1], place)


PROBLEM = record(
    _problem,
    objective=POLYNOMIAL,
    constraints=sequence(CONSTRAINT),
    lower=array,
    upper=array,
    names=sequence(text),
    squares=sequence(_WEIGHTED),
    sense=text,
)


# ---- results ------------------------------------------------------------------------------


def _simple(kind: type) -> Codec:
    """Options and switches: numbers, strings and lists as they are."""
    names = [f.name for f in fields(kind) if f.name not in ("executor", "switches")]

    def plain(value: Any) -> Any:
        return [plain(v) for v in value] if isinstance(value, (list, tuple)) else _scalar(value)

    def read(found: Any, place: str) -> Any:
        given = codecs.fields_of(found, place)
        values = {name: given[name] for name in names if name in given}  # others: as by default
        made = {k: tuple(v) if isinstance(v, list) else _special(v) for k, v in values.items()}
        if found.get("switches") is not None:
            made["switches"] = _switches().read(found["switches"], place)
        try:
            return kind(**made)
        except TypeError as error:
            raise ProblemError(f"{place}: {error}") from error

    def write(value: Any) -> dict[str, Any]:
        made = {name: plain(getattr(value, name)) for name in names}
        if kind is Options:
            made["switches"] = value.switches and _switches().write(value.switches)
        return made

    return Codec(write, read)


def _switches() -> Codec:
    # Loaded where it is used: reading stored results must not load relaxations.
    from sparsepop_py.relaxation.sparsepop.relaxation import Switches

    return optional(_simple(Switches))


def _scalar(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return number.write(value) if isinstance(value, float) else value


def _special(value: Any) -> Any:
    return float(value) if value in ("inf", "-inf", "nan") else value


def _status(found: Any, place: str) -> Status:
    if not isinstance(found, str) or found not in Status.__members__:
        raise codecs.wrong(place, found, "one of " + ", ".join(Status.__members__))
    return Status[found]


def _result(**parts: Any) -> Result:
    """Build the result if certificate and point prove the bounds that the text states."""
    result = Result(**parts, relaxation=None, solution=None)
    proved = -math.inf
    if result.certificate is not None:
        proved = result.certificate.verify(result.problem).bound
    if result.lower_bound > proved:
        raise ProblemError(
            f"result.lower_bound: found {result.lower_bound!r}, expected at most {proved!r}, "
            "which its certificate proves"
        )
    attained = math.inf
    point = None if result.attained is None else result.attained.recheck(result.problem)
    if point is not None:
        ends = result.status is not Status.UNBOUNDED
        ray = None if ends else falling_ray(result.problem, point, result.ray)
        attained = point.value if ray is None else -math.inf
    near = math.isclose(result.upper_bound, attained, rel_tol=_DIGITS, abs_tol=_DIGITS)
    if result.upper_bound < attained and not near:
        raise ProblemError(
            f"result.upper_bound: found {result.upper_bound!r}, expected at least {attained!r}, "
            "which its point attains"
        )
    claims = {Status.INFEASIBLE: proved == math.inf, Status.UNBOUNDED: attained == -math.inf}
    if not claims.get(result.status, True):
        raise ProblemError(f"result.status: found {result.status!s}, expected one that is proved")
    # the point as it was proved again: nothing that a file says of it is believed
    return replace(result, upper_bound=max(result.upper_bound, attained), attained=point)


STATUS = Codec(lambda status: status.name, _status)
POINT = record(Point, x=array, value=number, violation=number)
PROVED_POINT = record(
    ProvedPoint, x=array, value=number, radius=number, proof=text, rows=array, solved=array
)
HISTORY_ENTRY = record(
    HistoryEntry,
    name=text,
    order=whole,
    lower_bound=number,
    upper_bound=number,
    seconds=number,
    largest_block=whole,
    moments=whole,
    nodes=whole,
)
_RAY = Codec(
    lambda ray: [number.write(v) for v in ray],
    lambda found, place: np.array(sequence(number).read(found, place), float),
)
RESULT = record(
    _result,
    problem=PROBLEM,
    options=_simple(Options),
    status=STATUS,
    lower_bound=number,
    upper_bound=number,
    x=optional(array),
    certificate=optional(CERTIFICATE),
    attained=optional(PROVED_POINT),
    points=sequence(POINT),
    solver_value=number,
    history=sequence(HISTORY_ENTRY),
    timings=codecs.mapping(number),
    notes=sequence(text),
    ray=optional(_RAY),
)

_KINDS: dict[type, tuple[str, Codec]] = {
    Problem: ("problem", PROBLEM),
    Certificate: ("certificate", CERTIFICATE),
    Result: ("result", RESULT),
}
