"""Problems with ratios, their certificates and results as JSON."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from sparsepop_py.algebra.polynomial import Polynomial
from sparsepop_py.algebra.rational import Rational, RationalConstraint
from sparsepop_py.errors import ClaimError
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
    check_bounds,
    proved_bound,
    with_rounding,
)
from sparsepop_py.problem.rational_problem import RationalProblem
from sparsepop_py.rational.result import RationalResult, attained_value
from sparsepop_py.result import Status
from sparsepop_py.verified.certificate.rational_bound import RangeProof, RationalCertificate
from sparsepop_py.verified.points.unbounded_ray import falling_ray

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
    result = RationalResult(**parts)
    proof, problem = result.certificate, result.problem
    proved, attained, point = proved_bound(proof, problem), math.inf, None
    ranges = proof.proved_ranges(problem)
    if isinstance(ranges, str):
        raise ClaimError(f"result.certificate: {ranges}")
    if result.attained is not None:
        lifted = problem.lifted(ranges, proof.level)
        point = result.attained.recheck(lifted)
        if point is not None:
            attained = attained_value(problem, ranges, proof.level, point.value)
            falls = result.status is Status.UNBOUNDED and proof.level is None
            attained = -math.inf if falls and falling_ray(lifted, point) is not None else attained
    check_bounds(result.lower_bound, result.upper_bound, proved, attained)
    claims = {Status.INFEASIBLE: proved == math.inf, Status.UNBOUNDED: attained == -math.inf}
    if not claims.get(result.status, True):
        raise ClaimError(f"result.status: found {result.status!s}, expected one that is proved")
    return replace(result, upper_bound=max(result.upper_bound, attained), attained=point)


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
