"""Problems with ratios, their certificates and results as JSON."""

from __future__ import annotations

from typing import Any

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.rational import Rational, RationalConstraint
from sparsepop_py.io.json_files import codecs
from sparsepop_py.io.json_files.certificates import CERTIFICATE
from sparsepop_py.io.json_files.codecs import (
    Codec,
    array,
    array_of,
    bound,
    finite,
    optional,
    record,
    sequence,
    text,
    whole,
)
from sparsepop_py.io.json_files.values import (
    CONSTRAINT,
    KIND,
    OPTIONS,
    POLYNOMIAL,
    PROVED_POINT,
    STATUS,
    with_rounding,
)
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.rational.result import RationalResult
from sparsepop_py.verified.certificate.rational_bound import RangeProof, RationalCertificate

__all__ = ["RATIONAL_CERTIFICATE", "RATIONAL_PROBLEM", "RATIONAL_RESULT"]


def _write_ratio(pair: tuple[Polynomial, Polynomial]) -> list[Any]:
    return [POLYNOMIAL.write(part) for part in pair]


def _read_ratio(found: Any, place: str) -> tuple[Polynomial, Polynomial]:
    if not isinstance(found, list) or len(found) != 2:
        raise codecs.wrong(place, found, "a numerator and a denominator")
    return POLYNOMIAL.read(found[0], place), POLYNOMIAL.read(found[1], place)


def _write_problem(problem: RationalProblem) -> Any:
    return {
        "objective": RATIONAL.write(problem.objective),
        "constraints": [CONSTRAINT.write(row) for row in problem.base.constraints],
        "rational_constraints": [RATIONAL_CONSTRAINT.write(row) for row in problem.rational_rows],
        "lower": array.write(problem.lower),
        "upper": array.write(problem.upper),
        "names": list(problem.names),
        "sense": problem.sense,
    }


def _read_problem(found: Any, place: str) -> RationalProblem:
    part = codecs.reader_of(found, place)
    rows = [*part("constraints", sequence(CONSTRAINT))]
    rows += part("rational_constraints", sequence(RATIONAL_CONSTRAINT))
    bounds = part("lower", array_of("F", 1)), part("upper", array_of("F", 1))
    names = part("names", sequence(text))
    return RationalProblem(part("objective", RATIONAL), rows, *bounds, names, part("sense", text))


def _result(**parts: Any) -> RationalResult:
    """Build the result if certificate and point prove the bounds that the text states."""
    return RationalResult(**parts).settled()


RATIONAL = record(Rational, whole=POLYNOMIAL, ratios=sequence(Codec(_write_ratio, _read_ratio)))
RATIONAL_CONSTRAINT = record(RationalConstraint, expression=RATIONAL, kind=KIND, name=text)
RATIONAL_PROBLEM = with_rounding(Codec(_write_problem, _read_problem))
RANGE = record(RangeProof, sign=whole, below=CERTIFICATE, above=optional(CERTIFICATE))
RATIONAL_CERTIFICATE = record(
    RationalCertificate,
    fingerprint=text,
    bound=bound,
    ranges=sequence(RANGE),
    level=optional(finite),
    certificate=optional(CERTIFICATE),
)
RATIONAL_RESULT = record(
    _result,
    problem=RATIONAL_PROBLEM,
    options=OPTIONS,
    status=STATUS,
    lower_bound=bound,
    upper_bound=bound,
    x=optional(array),
    certificate=RATIONAL_CERTIFICATE,
    attained=optional(PROVED_POINT),
    notes=sequence(text),
)
