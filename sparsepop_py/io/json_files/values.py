"""Problems and results as JSON: their fields, and what reading proves again."""

from __future__ import annotations

from dataclasses import fields
from enum import Enum
from typing import Any

import numpy as np

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.polynomial import Constraint, Kind, Polynomial
from sparsepop_py.errors import ProblemError
from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.certificates import CERTIFICATE
from sparsepop_py.io.json_files.codecs import (
    Codec,
    array,
    array_of,
    bound,
    finite,
    number,
    optional,
    record,
    sequence,
    text,
    whole,
)
from sparsepop_py.io.json_files.references import check_references
from sparsepop_py.options import Options
from sparsepop_py.problem.problem import Problem
from sparsepop_py.problem.rounding import Rounding
from sparsepop_py.result import HistoryEntry, Point, Result, Status
from sparsepop_py.verified.points.feasible_point import ProvedPoint

__all__ = [
    "CONSTRAINT",
    "KIND",
    "OPTIONS",
    "POLYNOMIAL",
    "PROBLEM",
    "PROVED_POINT",
    "RESULT",
    "STATUS",
    "with_rounding",
]


# ---- problems -----------------------------------------------------------------------------


def _polynomial(words: Any, coefficients: Any, dimension: int) -> Polynomial:
    if words.ndim != 2 or coefficients.shape != (words.shape[0],) or dimension < 1:
        raise ProblemError(
            f"polynomial: found words {words.shape} and coefficients {coefficients.shape}, "
            "expected one word a coefficient"
        )
    integers = words.dtype in (np.int32, np.int64)
    if not integers or words.shape[1] < 1 or coefficients.dtype != np.float64:
        raise ProblemError(
            "polynomial: found other types, expected words i4 or i8 and coefficients f8"
        )
    if words.size and not (words.min() >= 0 and words.max() <= dimension):
        raise ProblemError(f"polynomial: found a variable outside 1..{dimension}")
    words = monomials.trim(np.sort(words.astype(np.int32), axis=1))
    if monomials.collect(words, dimension)[0].shape[0] < words.shape[0]:
        raise ProblemError("polynomial: found a word twice, expected distinct ones")
    return Polynomial.from_words(words, coefficients, dimension)


def _member(members: type[Enum]) -> Codec:
    """Make the codec of an enumeration, whose members are stored by their names."""

    def read(found: Any, place: str) -> Enum:
        if not isinstance(found, str) or found not in members.__members__:
            raise codecs.wrong(place, found, "one of " + ", ".join(members.__members__))
        return members[found]

    return Codec(lambda member: member.name, read)


def _problem(names: tuple[str, ...], squares: Any, **parts: Any) -> Problem:
    return Problem(**parts, names=names, squares=squares or None)


POLYNOMIAL = record(_polynomial, words=array, coefficients=array, dimension=whole)
KIND = _member(Kind)
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


_ROUNDINGS = sequence(
    record(Rounding, place=text, coefficients=whole, largest=number, shift=number)
)


def with_rounding(codec: Codec) -> Codec:
    """Add what was rounded, where anything was: files before had no such field."""

    def write(problem: Any) -> Any:
        found = codec.write(problem)
        return found | (
            {"rounding": _ROUNDINGS.write(problem.rounding)} if problem.rounding else {}
        )

    def read(found: Any, place: str) -> Any:
        problem = codec.read(found, place)
        if "rounding" in found:
            kept = _ROUNDINGS.read(found["rounding"], f"{place}.rounding")
            object.__setattr__(problem, "rounding", kept)
        return problem

    return Codec(write, read)


_PROBLEM = record(
    _problem,
    objective=POLYNOMIAL,
    constraints=sequence(CONSTRAINT),
    lower=array_of("F", 1),
    upper=array_of("F", 1),
    names=sequence(text),
    squares=sequence(_WEIGHTED),
    sense=text,
)
PROBLEM = with_rounding(_PROBLEM)


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


def _result(**parts: Any) -> Result:
    """Build the result if certificate and point prove the bounds that the text states."""
    result = Result(**parts, relaxation=None, solution=None)
    if result.ray is not None and result.ray.shape != (result.problem.dimension,):
        raise codecs.wrong("result.ray", f"{result.ray.size} numbers", "one a variable")
    if result.certificate is not None:
        check_references(result.certificate, result.problem, "result.certificate")
    return result.settled()  # the point as it is proved: nothing that a file says is believed


STATUS = _member(Status)
POINT = record(Point, x=array, value=number, violation=number)
PROVED_POINT = record(
    ProvedPoint, x=array, value=number, radius=number, proof=text, rows=array, solved=array
)
HISTORY_ENTRY = record(
    HistoryEntry,
    name=text,
    order=whole,
    lower_bound=bound,
    upper_bound=bound,
    seconds=number,
    largest_block=whole,
    moments=whole,
    nodes=whole,
)
OPTIONS = _simple(Options)
_RAY = Codec(
    lambda ray: [number.write(v) for v in ray],
    lambda found, place: np.array(sequence(finite).read(found, place), float),
)
RESULT = record(
    _result,
    problem=PROBLEM,
    options=OPTIONS,
    status=STATUS,
    lower_bound=bound,
    upper_bound=bound,
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
